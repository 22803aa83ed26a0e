"""Random motions there and back, and thousands of broken files, each refused clearly or read right.

MOTIONKIT_FUZZ sets how many broken files (500; `make fuzz` takes 20,000), MOTIONKIT_FUZZ_SEED where to start.
A file that breaks the reader is saved to out/fuzz/ with its seed.
"""

import math
import os
import random
import re
import time
import warnings
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from test_bvh import CHAIN, same

import motionkit as mk
from motionkit import rotations as rot
from motionkit.bvh import format_bvh, parse
from motionkit.motion import Motion
from motionkit.skeleton import POSITION_CHANNELS, Skeleton

COUNT = int(os.environ.get("MOTIONKIT_FUZZ", "500"))
SEED = int(os.environ.get("MOTIONKIT_FUZZ_SEED", "0"))
SECONDS = 2.0  # of this thread's work, so that a busy machine does not fail the test
LITTER = Path(__file__).resolve().parent.parent / "out" / "fuzz"

NAMES = st.text(
    st.characters(exclude_categories=("Cs", "Cc", "Zl", "Zp"), exclude_characters="{}"),
    min_size=1,
    max_size=12,
)
ROTATIONS = st.permutations(["Xrotation", "Yrotation", "Zrotation"])


@st.composite
def motions(draw) -> Motion:
    """A random tree, listed branch by branch, with random channels and a motion that they can hold."""
    count, frames = draw(st.integers(1, 8)), draw(st.integers(0, 5))
    names = draw(st.lists(NAMES.map(str.strip).filter(bool), min_size=count, max_size=count, unique=True))
    parents, branch = [-1], [0]
    for joint in range(1, count):
        del branch[draw(st.integers(1, len(branch))) :]
        parents.append(branch[-1])
        branch.append(joint)
    random_numbers = torch.Generator().manual_seed(draw(st.integers(0, 2**31)))
    size = 10.0 ** draw(st.integers(-2, 3))
    offsets = torch.randn(count, 3, generator=random_numbers) * size
    ends = [(j, tuple((torch.randn(3, generator=random_numbers) * size).tolist())) for j in range(count) if j % 2]
    channels, turns, moves = (
        [],
        rot.identity_quaternion(frames, count),
        offsets.expand(frames, -1, -1).clone(),
    )
    for joint in range(count):
        axes = draw(ROTATIONS)[: draw(st.integers(0, 3))]
        places = draw(st.permutations(POSITION_CHANNELS))[: draw(st.integers(0, 3))]
        channels.append(tuple(draw(st.permutations([*axes, *places]))))
        for axis in (c[0] for c in channels[-1] if c in axes):
            angle = (torch.rand(frames, generator=random_numbers) - 0.5) * 2 * math.pi
            turn = rot.axis_angle_to_quaternion(torch.eye(3)["XYZ".index(axis)], angle)
            turns[:, joint] = rot.quaternion_multiply(turns[:, joint], turn)
        for place in places:
            moves[:, joint, POSITION_CHANNELS.index(place)] = torch.randn(frames, generator=random_numbers) * size
    if not any(channels):
        channels[0] = tuple(draw(ROTATIONS))
    skeleton = Skeleton(tuple(names), tuple(parents), offsets, tuple(channels), tuple(ends))
    fps = draw(st.sampled_from([24.0, 29.97, 30.0, 60.0, 119.88, 120.0, 0.5, 1000.0]))
    return Motion(skeleton, turns, moves, fps, "fuzz", draw(st.sampled_from([1.0, 0.01, 0.0254, 0.056444])))


@pytest.mark.slow
@settings(max_examples=max(100, COUNT // 50))
@given(motions())
def test_any_motion_there_and_back(m):
    same(m, parse(format_bvh(m).encode(), "fuzz.bvh", m.metres_per_unit))


def lines_changed(random: random.Random, lines: list[bytes]) -> list[bytes]:
    at, other = random.randrange(len(lines)), random.randrange(len(lines))
    kind = random.randrange(5)
    if kind == 0:
        del lines[at : at + random.choice((1, 1, 2, 10))]
    elif kind == 1:
        lines[at:at] = lines[other : other + random.choice((1, 1, 5))] * random.choice((1, 2, 1000))
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        random.shuffle(lines)
    else:
        lines[at:] = random.sample(lines[at:], len(lines) - at)
    return lines


NUMBERS = (
    b"nan inf -inf 1e999 -1e308 1e-999 0x10 1_0 --1 1.2.3 1e 1,5 - . \xd9\xa3 1e5 +.5e-3 -0 999999999999 4294967296 "
    b"1e9 12345678901234567 "
).split(b" ") + [b"9" * 40]


def mutate(random: random.Random, data: bytes) -> bytes:
    """One random change."""
    kind = random.randrange(9)
    if kind == 0:
        return data[: random.randrange(len(data) + 1)]
    if kind == 1:
        changed = bytearray(data)
        for _ in range(random.choice((1, 1, 3, 30)) if data else 0):
            changed[random.randrange(len(data))] ^= 1 << random.randrange(8)
        return bytes(changed)
    if kind == 2:
        return b"\n".join(lines_changed(random, data.split(b"\n")))
    if kind in (3, 4):
        found = list(re.finditer(rb"[-+.\w]+", data))
        if kind == 3:
            found = [m for m in found if m[0][:1] in b"-+.0123456789"]
        if not found:
            return data
        word = random.choice(found)
        return data[: word.start()] + random.choice(NUMBERS) + data[word.end() :]
    if kind == 5:
        return re.sub(rb"Frames:\s*\S+", b"Frames: " + random.choice(NUMBERS + [b"10000000000000000"]), data)
    if kind == 6:
        deep = b"JOINT x { OFFSET 0 1 0 CHANNELS 0 " * random.choice((10, 1000, 5000))
        at = data.find(b"End Site")
        return data[:at] + deep + b"}" * random.choice((0, 10, 1000, 5000)) + data[at:]
    junk = random.randbytes(random.choice((0, 1, 10, 10_000)))
    if kind == 7:
        return junk
    at = random.randrange(len(data) + 1)
    return data[:at] + junk + data[at + random.choice((0, len(junk))) :]


def seeds() -> list[bytes]:
    walk = Path(__file__).resolve().parent.parent / "data" / "actor" / "walk_neutral.bvh"
    texts = [CHAIN.encode(), CHAIN.replace("\n", "\r\n").encode(), CHAIN.replace("\n", "\r").encode()]
    return texts + ([b"\n".join(walk.read_bytes().split(b"\n")[:250])] if walk.exists() else [])


def check(data: bytes, out: Path) -> str | None:
    """What is wrong with the way the reader takes these bytes, or None."""
    start = time.thread_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mk.MotionKitWarning)
            m = parse(data, "fuzz.bvh")
            path = mk.save(m, out)
            seconds = time.thread_time() - start
            if len(m.skeleton) < 100:
                same(m, mk.load(path, m.metres_per_unit))
    except mk.MotionKitError as error:
        seconds = time.thread_time() - start
        if not re.match(r"fuzz\.bvh(, line \d+\b|: no joint has channels)", str(error)):
            return f"an error that does not name file and line: {error}"
    except BaseException as error:  # whatever it is, the bytes that caused it must be kept
        return f"{type(error).__name__}: {error}"
    return f"took {seconds:.1f} s" if seconds > SECONDS else None


@pytest.mark.slow
def test_broken_files_are_refused_or_read_right(tmp_path):
    texts = seeds()
    for number in range(COUNT):
        chance = random.Random(SEED + number)
        data = chance.choice(texts)
        for _ in range(chance.choice((1, 1, 1, 2, 5))):
            data = mutate(chance, data)
        wrong = check(data, tmp_path / "out.bvh")
        if wrong:
            LITTER.mkdir(parents=True, exist_ok=True)
            kept = LITTER / f"{SEED + number}.bvh"
            kept.write_bytes(data)
            again = f"MOTIONKIT_FUZZ_SEED={SEED + number} MOTIONKIT_FUZZ=1"
            pytest.fail(f"{wrong}\nthe file is kept as {kept.relative_to(LITTER.parent.parent)}; again with {again}")
    assert set(os.listdir(tmp_path)) <= {"out.bvh"}
