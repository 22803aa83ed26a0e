"""BVH files: read and written so that nothing is lost on the way there and back.

A file is a hierarchy (joints in nested braces, each with an OFFSET and CHANNELS) and, after MOTION, a row of numbers a
frame: one for each channel, in the order in which the hierarchy lists them. Here stand, one after the other, `load` and
`parse`, the guess of the unit, the two halves of the reader, turns about the channels' axes, and the writer.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from . import rotations as rot
from .errors import MotionKitError, motion_inside
from .files import MotionKitWarning, read_bytes, write_atomic
from .motion import Motion
from .skeleton import POSITION_CHANNELS, Skeleton

__all__ = ["MotionKitWarning", "format_bvh", "guess_metres_per_unit", "load", "parse", "save"]

ROTATION_CHANNELS = ("Xrotation", "Yrotation", "Zrotation")
LARGEST = 1e9  # numbers beyond this are no offsets, positions or angles, and would overflow further on
_MOST_JOINTS = 4096  # far above any character; a guard against files that only nest
_SAME_TURN = 1e-5  # radians; a rotation that a joint's own channels give this closely needs no further channel
# Sizes (as `Skeleton.height`, in file units) up to which a file is taken to be in that unit.
_UNIT_GUESSES = ((5.0, 1.0), (45.0, 0.056444), (450.0, 0.01), (float("inf"), 0.001))

_CHANNELS = {c.lower(): c for c in POSITION_CHANNELS + ROTATION_CHANNELS}
_MOTION = re.compile(rb"(?:^|\})[ \t]*(MOTION)(?=\s|$)", re.MULTILINE | re.IGNORECASE)
_NEWLINE = re.compile(r"\r\n?|\n")
_WORD = re.compile(rb"\S+")
# a brace, a heading with the rest of its line (names may hold spaces), or a word
_TOKEN = re.compile(r"[{}]|(?:ROOT|JOINT|END)(?![^\s{}])[^{}\r\n]*|[^\s{}]+", re.IGNORECASE)
_HEADING = re.compile(r"(ROOT|JOINT|END)(?!\S)(.*)", re.IGNORECASE)


def load(path: str | os.PathLike, metres_per_unit: float | None = None, fps: float | None = None) -> Motion:
    """Read a BVH file.

    path: the file. metres_per_unit: the length of one unit of the file in metres (0.01 for centimetres). No
    BVH file states it; left out, it is guessed from the skeleton's size: up to 5 units tall is metres, up to
    45 the unit of the CMU captures (0.056444 m), up to 450 centimetres, above that millimetres. fps: a frame
    rate in place of the file's own. Returns a `Motion`. Warns (MotionKitWarning) where `Frames:` disagrees
    with the data. Raises MotionKitError naming file and line.

    >>> m = load("data/actor/walk_neutral.bvh")
    >>> m.fps, m.skeleton.names[0]
    (30.0, 'pelvis')
    """
    return parse(read_bytes(path), os.fspath(path), metres_per_unit, fps)


def parse(
    data: bytes, source: str = "<bytes>", metres_per_unit: float | None = None, fps: float | None = None
) -> Motion:
    """The text of a BVH file as bytes to a `Motion`; `source` is what errors call it. See `load`.

    >>> text = "HIERARCHY ROOT a { OFFSET 0 1 0 CHANNELS 1 Yrotation } MOTION Frames: 1 Frame Time: 0.5 90"
    >>> parse(text.encode()).rotations[0, 0]
    tensor([0.7071, 0.0000, 0.7071, 0.0000])
    """
    for what, value in (("metres_per_unit", metres_per_unit), ("fps", fps)):
        try:
            fits = value is None or 0 < float(value) < 1e6
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise MotionKitError(f"{source}: {what} must be a number above 0; found {value!r}")
    data = _plain_text(data, source)
    cut = _MOTION.search(data)
    if cut is None:
        _HeaderReader(_decode(data[:1_000_000]), source).read()  # most often it says more exactly what is wrong
        line = _line_at(data, len(data))
        raise MotionKitError(f"{source}, line {line}: no line says MOTION; the file is cut off or holds no motion")
    header = _HeaderReader(_decode(data[: cut.start(1)]), source).read()
    rows, rate = _read_rows(data, cut.end(), header, source, fps)
    return _to_motion(header, rows, metres_per_unit, rate, Path(source).stem)


def _plain_text(data: bytes, source: str) -> bytes:
    """The bytes without UTF-16, which some Windows tools write, and with ends of lines that `^` knows."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            data = data.decode("utf-16").encode()
        except UnicodeError:
            raise MotionKitError(f"{source}, line 1: neither text nor UTF-16; this is no BVH file") from None
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _line_at(text: str | bytes, offset: int) -> int:
    """The number of the line, from 1, that a character (or byte) is on."""
    before = text[:offset] if isinstance(text, str) else text[:offset].decode("latin-1")
    return len(_NEWLINE.findall(before)) + 1


def _to_motion(header: Header, rows: np.ndarray, metres_per_unit: float | None, fps: float, name: str) -> Motion:
    """The hierarchy and the numbers [F, C] as a motion in metres and quaternions."""
    offsets, channels = torch.tensor(header.offsets, dtype=torch.float64), tuple(header.channels)
    skeleton = Skeleton(tuple(header.names), tuple(header.parents), offsets.float(), channels, tuple(header.end_sites))
    unit = guess_metres_per_unit(skeleton) if metres_per_unit is None else float(metres_per_unit)
    if unit != 1.0:
        ends = tuple((joint, tuple(x * unit for x in offset)) for joint, offset in header.end_sites)
        skeleton = replace(skeleton, offsets=(offsets * unit).float(), end_sites=ends)
    frames, joints = len(rows), len(skeleton)
    rotations = torch.empty(frames, joints, 4)
    translations = skeleton.offsets.expand(frames, -1, -1).clone()
    groups = _joints_by_channels(channels)
    for group, (members, columns) in groups.items():
        shape = (frames, len(members), len(group))
        if len(groups) == 1:  # every joint alike, as in many captures: views instead of copies
            members = columns = slice(None)
        block = torch.from_numpy(rows[:, columns].reshape(shape))
        turns = [n for n, channel in enumerate(group) if channel not in POSITION_CHANNELS]
        for n, channel in enumerate(group):
            if channel in POSITION_CHANNELS:
                translations[:, members, POSITION_CHANNELS.index(channel)] = (block[:, :, n] * unit).float()
        angles = torch.deg2rad(block[:, :, turns])
        rotations[:, members] = _compose(angles, [group[n][0] for n in turns]).float()
    return Motion(skeleton, rotations, translations, fps, name, unit)


def guess_metres_per_unit(skeleton: Skeleton, unit: float = 1.0) -> float:
    """Metres a unit, guessed for a skeleton written in units of `unit` metres; see `load` for the steps.

    >>> import torch
    >>> guess_metres_per_unit(Skeleton(("a", "b"), (-1, 0), torch.tensor([[0.0, 90, 0], [0.0, 80, 0]])))
    0.01
    """
    size = (skeleton.height or float(skeleton.offsets.norm(dim=-1).max())) / unit
    return next(metres for limit, metres in _UNIT_GUESSES if size <= limit) if size else 1.0


@dataclass
class Header:
    """Joints as the file lists them; offsets in the file's own unit."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[tuple[float, float, float]] = field(default_factory=list)
    channels: list[tuple[str, ...]] = field(default_factory=list)
    end_sites: list[tuple[int, tuple[float, float, float]]] = field(default_factory=list)


class _HeaderReader:
    """Walks the words of a hierarchy once, keeping the open joints on a stack."""

    def __init__(self, text: str, source: str) -> None:
        self.text, self.source = text, source
        self.tokens = _TOKEN.findall(text)
        self.taken = 0
        self.header = Header()
        self.open: list[int | None] = []  # numbers of open joints; None is an End Site
        self.stated: list[set[str]] = []  # of each open block: whether its OFFSET and CHANNELS were there

    def fail(self, what: str) -> MotionKitError:
        """An error on the line of the token taken last; only here are places in the text looked up."""
        last = min(self.taken, len(self.tokens)) - 1
        starts = (match.start() for n, match in enumerate(_TOKEN.finditer(self.text)) if n == last)
        return MotionKitError(f"{self.source}, line {_line_at(self.text, next(starts, 0))}: {what}")

    def take(self) -> str:
        """The next token."""
        if self.taken == len(self.tokens):
            raise self.fail("the file ends in the middle of the hierarchy; it seems to be cut off, get it again")
        self.taken += 1
        return self.tokens[self.taken - 1]

    def read(self) -> Header:
        """The hierarchy; MotionKitError names the line of what is wrong."""
        if not self.tokens or self.take().upper() != "HIERARCHY":
            raise self.fail("expected the word HIERARCHY; this is no BVH file")
        while self.taken < len(self.tokens):
            token = self.take()
            word = token.upper()
            if word == "OFFSET":
                self.offset()
            elif word == "CHANNELS":
                self.channels()
            elif word == "}":
                self.close()
            elif (heading := _HEADING.match(token)) is None:
                raise self.fail(f"expected JOINT, End Site, OFFSET, CHANNELS or '}}'; found {token[:40]!r}")
            elif word.startswith("END"):
                self.open_end_site(heading[2])
            else:
                self.open_joint(heading[2], root=word.startswith("ROOT"))
        if self.open or not self.header.names:
            raise self.fail("the hierarchy is not closed before MOTION; a '}' is missing or the file is cut off")
        self.header.names = _distinct(self.header.names)
        return self.header

    def open_joint(self, name: str, *, root: bool) -> None:
        header = self.header
        if root and self.open:
            raise self.fail("a ROOT inside another joint; expected JOINT or a closing '}' before it")
        if root and header.names:
            raise self.fail(
                f"a second character starts here (the first has the root {header.names[0]!r}); the kit reads "
                "one character a file: save each character to a file of its own"
            )
        if not root and (not self.open or self.open[-1] is None):
            raise self.fail("a JOINT outside of any joint; expected ROOT first, and no joint inside an End Site")
        if len(header.names) >= _MOST_JOINTS:
            raise self.fail(f"more than {_MOST_JOINTS} joints; this is no character")
        header.names.append(self.name_until_brace(name) or f"joint{len(header.names)}")
        header.parents.append(self.open[-1] if self.open else -1)
        header.offsets.append((0.0, 0.0, 0.0))
        header.channels.append(())
        self.open.append(len(header.names) - 1)
        self.stated.append(set())

    def open_end_site(self, name: str) -> None:
        if not self.open or self.open[-1] is None:
            raise self.fail("an End Site outside of any joint")
        self.name_until_brace(name)
        self.open.append(None)
        self.stated.append(set())

    def name_until_brace(self, name: str) -> str:
        """The name that a heading such as `JOINT left hand` gives, or the line below it, up to `{`."""
        name, word = name.strip(), self.take()
        if not name and word != "{":
            name, word = word.strip(), self.take()
        if word != "{":
            raise self.fail(f"expected '{{' after the joint's name; found {word[:40]!r}")
        return name

    def state_once(self, what: str) -> None:
        if not self.open:
            raise self.fail(f"{what} outside of any joint")
        if what in self.stated[-1]:
            raise self.fail(f"a second {what} in one joint")
        self.stated[-1].add(what)

    def offset(self) -> None:
        self.state_once("OFFSET")
        numbers: list[float] = []
        for _ in range(3):
            word = self.tokens[self.taken] if self.taken < len(self.tokens) else ""
            self.taken += 1
            number = _to_number(word)
            if number is None or not abs(number) <= LARGEST:
                what = repr(word[:40]) if word else "the end of the hierarchy"
                raise self.fail(f"OFFSET needs 3 finite numbers up to {LARGEST:g}; found {what}")
            numbers.append(number)
        if self.open[-1] is None:
            self.header.end_sites.append((self.open[-2], tuple(numbers)))
        else:
            self.header.offsets[self.open[-1]] = tuple(numbers)

    def channels(self) -> None:
        self.state_once("CHANNELS")
        if self.open[-1] is None:
            raise self.fail("CHANNELS inside an End Site; only joints have channels")
        size = self.take()
        if size not in ("0", "1", "2", "3", "4", "5", "6"):
            raise self.fail(f"CHANNELS needs a count from 0 to 6; found {size[:40]!r}")
        names: list[str] = []
        for _ in range(int(size)):
            word = self.take()
            name = _CHANNELS.get(word.lower())
            if name is None or name in names:
                problem = "appears twice" if name else "is not known"
                expected = f"expected {size} different ones of {', '.join(_CHANNELS.values())}"
                raise self.fail(f"channel {word[:40]!r} {problem}; {expected}")
            names.append(name)
        self.header.channels[self.open[-1]] = tuple(names)

    def close(self) -> None:
        if not self.open:
            raise self.fail("a '}' that closes nothing")
        joint = self.open.pop()
        if "OFFSET" not in self.stated.pop():
            name = "an End Site" if joint is None else f"joint {self.header.names[joint]!r}"
            raise self.fail(f"{name} ends without an OFFSET")


def _distinct(names: list[str]) -> list[str]:
    """Repeated names numbered (`hand`, `hand#2`): some exporters repeat them; here names are looked up."""
    taken, distinct, copies = set(names), {}, dict.fromkeys(names, 1)
    for name in names:
        unique = name
        while unique in distinct or (unique != name and unique in taken):
            copies[name] += 1
            unique = f"{name}#{copies[name]}"
        distinct[unique] = None
    return list(distinct)


def _to_number(word: str | bytes) -> float | None:
    """What a word says as a number, None if it is none; Python alone takes 1_000 for one."""
    try:
        return None if (b"_" if isinstance(word, bytes) else "_") in word else float(word)
    except ValueError:
        return None


def _read_rows(data: bytes, start: int, header: Header, source: str, fps: float | None) -> tuple[np.ndarray, float]:
    """What follows MOTION, from byte `start` on: float64 [F, C] in file units and degrees, and frames a second."""
    size, after_size = _field("Frames", data, start, source)
    seconds, start = _field("Frame Time", data, after_size, source)
    frames = int(size) if re.fullmatch(r"\+?\d+|-0+", size, re.ASCII) else -1
    if not 0 <= frames < 1e18:
        where = f"{source}, line {_line_at(data, after_size)}"
        raise MotionKitError(f"{where}: 'Frames:' needs a whole number from 0 up; found {size!r}")
    rate = float(fps) if fps is not None else _rate(seconds)
    if rate is None:
        where = f"{source}, line {_line_at(data, start)}"
        raise MotionKitError(f"{where}: 'Frame Time:' needs seconds above 0; found {seconds!r}; give load(..., fps=30)")
    columns = [(name, c) for name, channels in zip(header.names, header.channels, strict=True) for c in channels]
    width = len(columns)
    if width == 0:
        raise MotionKitError(f"{source}: no joint has channels, so nothing can move; export the motion with channels")
    numbers = parse_numbers(data, start, source)
    rows = len(numbers) // width
    if len(numbers) % width or rows == 0 < frames or rows <= frames and _ends_inside_number(data, start, width):
        raise _cut_off(data, start, frames, len(numbers), width, source)
    if rows != frames:
        what = f"{source}: 'Frames: {frames}' disagrees with the data, which have {rows}; read {rows}"
        warnings.warn(what, MotionKitWarning, 4)
    if not max(numbers.max(initial=0), -numbers.min(initial=0)) <= LARGEST:  # also where one is NaN
        first = int((~(np.abs(numbers) <= LARGEST)).argmax())
        joint, channel = columns[first % width]
        line = _line_at(data, next(islice(_WORD.finditer(data, start), first, None)).start())
        raise MotionKitError(
            f"{source}, line {line}, frame {first // width}: {channel} of joint {joint!r} is {numbers[first]:g}; "
            f"expected a finite number up to {LARGEST:g}: cut this frame out or fill it from its neighbours"
        )
    return numbers.reshape(rows, width), rate


def _field(name: str, data: bytes, start: int, source: str) -> tuple[str, int]:
    """The word after a heading such as `Frames:`, and where it ends."""
    heading = name.replace(" ", r"[ \t]*")
    match = re.compile(rf"\s*{heading}\s*:[ \t]*(\S*)".encode(), re.IGNORECASE).match(data, start)
    if match is None:
        word = _WORD.search(data, start)
        where = f"{source}, line {_line_at(data, word.start() if word else len(data))}"
        what = repr(word[0][:40].decode("latin-1")) if word else "the end of the file"
        raise MotionKitError(f"{where}: expected '{name}:' and a number after MOTION; found {what}")
    return match[1][:40].decode("latin-1"), match.end()


def _rate(word: str) -> float | None:
    """Frames a second from a frame time as written, None if it is none: 0.0333333 means 30, not 30.00003.

    A whole number is taken where the last digit written leaves it open.
    """
    seconds = _to_number(word)
    if seconds is None or not 1e-6 < seconds < 1e6:
        return None
    step = 10.0 ** Decimal(word).as_tuple().exponent
    whole = round(1 / seconds)
    return float(whole) if whole and abs(1 / whole - seconds) < min(step, 5e-4 * seconds) else 1 / seconds


def parse_numbers(data: bytes, start: int = 0, source: str = "<bytes>") -> np.ndarray:
    """All numbers of a text from byte `start` on, separated by white space, as float64 [N].

    Each equals what Python's `float` makes of it. Raises MotionKitError at the first piece of text that is no number.

    >>> parse_numbers(b"1 -2.5\\t3e2\\r\\n")
    array([  1. ,  -2.5, 300. ])
    """
    text = data[start:].strip()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # older numpy warns of what it cannot read
            return np.fromstring(text, sep=" ") if text else np.empty(0)
    except (ValueError, DeprecationWarning):
        bad = next(word for word in _WORD.finditer(data, start) if _to_number(word[0]) is None)
        where = f"{source}, line {_line_at(data, bad.start())}"
        raise MotionKitError(f"{where}: expected a number; found {bad[0][:40].decode('latin-1')!r}") from None


def _ends_inside_number(data: bytes, start: int, width: int) -> bool:
    """Whether the file is cut off inside its last number: no line end, and fewer decimals than all before."""
    if data.endswith((b"\n", b"\r")):
        return False
    words = data[start:].rsplit(None, 2 * width)[-2 * width :]
    decimals = [len(w.partition(b".")[2]) for w in words]
    fixed = len(set(decimals[:-1])) == 1 and decimals[0] >= 3  # written with so many decimals always
    return fixed and decimals[-1] < decimals[0]


def _cut_off(data: bytes, start: int, frames: int, size: int, width: int, source: str) -> MotionKitError:
    """An error for data whose `size` numbers do not fill whole frames; it names the first line that is off."""
    lines = [len(line.split()) for line in _NEWLINE.split(data[start:].decode("latin-1"))]
    filled = [n for n, words in enumerate(lines) if words]
    line, on_line = _line_at(data, len(data)), ""
    if filled and (len(filled) == 1 or width in lines):  # a frame a line; otherwise lines are wrapped anyhow
        wrong = next((n for n in filled if lines[n] != width), filled[-1])
        line, on_line = _line_at(data, start) + wrong, f"{lines[wrong]} on this line and "
    return MotionKitError(
        f"{source}, line {line}: expected {frames} frames of {width} numbers; found {on_line}{size} numbers in "
        "all; the file is cut off or its channels do not fit: export it again"
    )


def _joints_by_channels(
    channels: Sequence[tuple[str, ...]],
) -> dict[tuple[str, ...], tuple[list[int], list[int]]]:
    """For each different list of channels the joints that have it, and their columns: what is alike goes at once."""
    groups: dict[tuple[str, ...], tuple[list[int], list[int]]] = {}
    first = 0
    for joint, names in enumerate(channels):
        joints, columns = groups.setdefault(names, ([], []))
        joints.append(joint)
        columns.extend(range(first, first + len(names)))
        first += len(names)
    return groups


def _compose(angles: Tensor, axes: list[str]) -> Tensor:
    """Zero to three turns about different axes, in turn: radians [..., n] to unit quaternions [..., 4]."""
    half = (angles / 2).movedim(-1, 0).contiguous()  # one plane an angle
    cosine, sine = torch.cos(half), torch.sin(half)
    one = torch.ones(angles.shape[:-1], dtype=angles.dtype)
    zero = torch.zeros_like(one)
    planes = [one, zero, zero, zero]
    for c, s, axis in zip(cosine, sine, axes, strict=True):
        k = 1 + rot.AXES[axis]
        i, j = k % 3 + 1, (k + 1) % 3 + 1  # the axes that follow k in the cycle x y z
        w, qi, qj, qk = (planes[n] for n in (0, i, j, k))
        planes[0], planes[k] = w * c - qk * s, qk * c + w * s
        planes[i], planes[j] = qi * c + qj * s, qj * c - qi * s
    return torch.stack(planes, -1)


def _decompose(q: Tensor, axes: list[str]) -> Tensor:
    """The turns about zero to three axes that give, or come close to, rotations [..., 4]; radians [..., n]."""
    if len(axes) == 3:
        return rot.quaternion_to_euler(q, "".join(axes))
    if not axes:
        return q[..., :0]
    # Without a third turn there is no gimbal lock: each angle shows on a vector that the other leaves alone.
    i = rot.AXES[axes[0]]
    j = rot.AXES[axes[1]] if len(axes) == 2 else (i + 1) % 3
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = rot.quaternion_to_matrix(q)
    first = torch.atan2(sign * m[..., k, j], m[..., j, j])
    second = torch.atan2(sign * m[..., i, k], m[..., i, i])
    return torch.stack((first, second), -1)[..., : len(axes)]


def save(motion: Motion, path: str | os.PathLike) -> Path:
    """Write a BVH file that other tools read, in the motion's own unit; `load(save(m))` is the motion again.

    Joint names, hierarchy, End Sites, channels and their order, frame rate and unit are kept. A joint gets
    channels that it did not have only where the motion needs them. As braces nest, the file lists joints branch by
    branch, whatever their order in the skeleton. The file is written whole or not at all. Returns the path. Warns
    (MotionKitWarning) where `load` would guess another unit than the motion's. Raises MotionKitError if it cannot
    be written, a joint's name does not fit into a BVH file, or the path does not end in .bvh.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = load(save(load("data/actor/walk_neutral.bvh"), folder + "/again.bvh"))
    >>> len(again)
    120
    """
    if not isinstance(motion, Motion):
        hint = motion_inside(motion)
        raise MotionKitError(f"save(motion, path): expected a Motion first; found {type(motion).__name__}{hint}")
    if isinstance(path, str | os.PathLike) and str(path) and Path(path).suffix.lower() != ".bvh":
        raise MotionKitError(f"{path}: what is written is a BVH file; let its name end in .bvh")
    text = format_bvh(motion)
    unit = motion.metres_per_unit
    guess = guess_metres_per_unit(motion.skeleton, unit)
    if not math.isclose(guess, unit, rel_tol=1e-3):
        warnings.warn(
            f"{path}: one unit of this file is {unit:g} m, but from its size {guess:g} m would be guessed: "
            f"read it with load(..., metres_per_unit={unit:g})",
            MotionKitWarning,
            2,
        )
    return write_atomic(path, text)


def format_bvh(motion: Motion) -> str:
    """The text of a BVH file; see `save`.

    >>> print(format_bvh(load("data/actor/walk_neutral.bvh")[:1])[:9])
    HIERARCHY
    """
    skeleton, unit, fps = motion.skeleton, motion.metres_per_unit, motion.fps
    channels, order = _channels_needed(motion), _file_order(skeleton)
    rows = _rows(motion, [channels[joint] for joint in order], order)
    broken = (~rows.isfinite()).any(1).nonzero()
    if len(broken):
        raise MotionKitError(
            f"motion {motion.name!r}: frame {int(broken[0])} holds numbers that are not finite, which no file can hold"
        )
    line = " ".join([f"%.{_decimals(skeleton.height / unit)}f"] * rows.shape[1]) + "\n"
    body = "".join(line % tuple(row) for row in rows.tolist())
    hierarchy = _format_hierarchy(skeleton, channels, order, unit)
    seconds = f"{1 / fps:.9f}" if fps < 1000 else f"{1 / fps:.15f}"
    return f"{hierarchy}\nMOTION\nFrames: {len(motion)}\nFrame Time: {seconds}\n{body}"


def _channels_needed(motion: Motion) -> list[tuple[str, ...]]:
    """The skeleton's channels, and what this motion needs besides: positions in front, rotations behind."""
    skeleton, needed = motion.skeleton, [()] * len(motion.skeleton)
    drift = (motion.translations - skeleton.offsets).abs()
    drift = drift.amax(0) if len(motion) else torch.zeros_like(skeleton.offsets)
    adrift = (drift > 1e-5 * skeleton.height).tolist()
    for names, (joints, _) in _joints_by_channels(skeleton.channels).items():
        axes = [c[0] for c in names if c not in POSITION_CHANNELS]
        spare = tuple(f"{x}rotation" for x in "ZXY" if x not in axes)
        q = motion.rotations[:, joints].double()
        turned = rot.quaternion_angle(_compose(_decompose(q, axes), axes), q) > _SAME_TURN
        for joint, more in zip(joints, turned.any(0).tolist(), strict=True):
            moved = tuple(c for n, c in enumerate(POSITION_CHANNELS) if c not in names and adrift[joint][n])
            needed[joint] = moved + names + (spare if more else ())
    if not any(needed):  # a file without any channel has nothing to hold its frames
        needed[0] = ("Zrotation", "Xrotation", "Yrotation")
    return needed


def _file_order(skeleton: Skeleton) -> list[int]:
    """Joint numbers as nested braces can hold them: a joint's whole branch before its next sibling."""
    order, waiting = [], [0]
    while waiting:
        order.append(waiting.pop())
        waiting.extend(reversed(skeleton.children[order[-1]]))
    return order


def _rows(motion: Motion, channels: list[tuple[str, ...]], order: list[int]) -> Tensor:
    """What the channels of the joints in file order hold, float64 [F, C]: degrees, and places in the motion's unit."""
    rows = torch.empty(len(motion), sum(map(len, channels)), dtype=torch.float64)
    for group, (members, columns) in _joints_by_channels(channels).items():
        joints = [order[n] for n in members]
        axes = [c[0] for c in group if c not in POSITION_CHANNELS]
        angles = torch.rad2deg(_decompose(motion.rotations[:, joints].double(), axes))
        positions = motion.translations[:, joints].double() / motion.metres_per_unit
        parts = [
            positions[..., POSITION_CHANNELS.index(c)] if c in POSITION_CHANNELS else angles[..., axes.index(c[0])]
            for c in group
        ]
        if parts:
            rows[:, columns] = torch.stack(parts, -1).flatten(1)
    return rows


def _format_hierarchy(skeleton: Skeleton, channels: list[tuple[str, ...]], order: list[int], unit: float) -> str:
    """The hierarchy as BVH text, from HIERARCHY to the last closing brace; offsets in units of `unit` metres."""
    offsets = (skeleton.offsets.double() / unit).tolist()
    lines, depths, depth = ["HIERARCHY"], {-1: 0}, 0

    def add(depth: int, *rows: str) -> None:
        lines.extend("    " * min(depth, 40) + row for row in rows)

    def close(stop: int) -> None:
        for level in range(depth - 1, stop - 1, -1):
            add(level, "}")

    for joint in order:
        start = depths[skeleton.parents[joint]]
        close(start)
        add(start, f"{'JOINT' if joint else 'ROOT'} {_checked_name(skeleton.names[joint])}", "{")
        depths[joint] = depth = start + 1
        add(depth, _format_offset(offsets[joint]), " ".join(("CHANNELS", str(len(channels[joint])), *channels[joint])))
        for owner, end in skeleton.end_sites:
            if owner == joint:
                add(depth, "End Site", "{", "    " + _format_offset([x / unit for x in end]), "}")
    close(0)
    return "\n".join(lines)


def _format_offset(offset: list[float]) -> str:
    """An OFFSET line; at least seven digits, however small the numbers."""
    decimals = _decimals(max(map(abs, offset)))
    return "OFFSET " + " ".join(f"{x:.{decimals}f}" for x in offset)


def _decimals(size: float) -> int:
    """Six, as most tools write; more where numbers of this size are so small that six would be coarse."""
    return 6 if size >= 0.1 or size <= 0 else min(6 - math.floor(math.log10(size)), 15)


def _checked_name(name: str) -> str:
    fits = name and name == name.strip() and not set(name) & set("{}\r\n")
    try:
        name.encode()
    except UnicodeEncodeError:
        fits = False
    if not fits:
        raise MotionKitError(
            f"joint name {name!r} does not fit into a BVH file; expected a text without braces, line ends and "
            "outer spaces: give the skeleton other names"
        )
    return name
