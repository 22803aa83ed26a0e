"""What the BVH reader and writer refuse, and that each refusal names the file, the line and what to do."""

import os
import re
import stat

import pytest
import torch
from test_bvh import CHAIN, STILL

import motionkit as mk
from motionkit import files
from motionkit import rotations as rot
from motionkit.bvh import parse

CASES = {
    "empty": (lambda t: "", 1, "expected the word HIERARCHY"),
    "other text": (lambda t: "hello\n" + t, 1, "expected the word HIERARCHY"),
    "two roots": (
        lambda t: t.replace("MOTION", "ROOT Other\n{\nOFFSET 0 0 0\nCHANNELS 0\n}\nMOTION"),
        21,
        "a second character starts here (the first has the root 'Hips'); the kit reads one character a file",
    ),
    "root in joint": (lambda t: t.replace("JOINT Knee", "ROOT Knee"), 6, "a ROOT inside another joint"),
    "joint outside": (lambda t: t.replace("ROOT", "JOINT"), 2, "a JOINT outside of any joint"),
    "joint in end": (lambda t: t.replace("OFFSET 0 0 0.5", "JOINT x {"), 16, "no joint inside an End Site"),
    "no brace": (
        lambda t: t.replace("Knee\n  {", "Knee\n"),
        8,
        "expected '{' after the joint's name; found 'OFFSET'",
    ),
    "extra brace": (lambda t: t.replace("MOTION", "}\nMOTION"), 21, "a '}' that closes nothing"),
    "missing brace": (
        lambda t: t.replace("}\nMOTION", "\nMOTION"),
        19,
        "a '}' is missing or the file is cut off",
    ),
    "no offset": (lambda t: t.replace("    OFFSET 0 2 0\n", ""), 18, "joint 'Knee' ends without an OFFSET"),
    "two offsets": (
        lambda t: t.replace("    OFFSET 0 2 0", "OFFSET 0 1 0 OFFSET 0 2 0"),
        8,
        "a second OFFSET",
    ),
    "bad offset": (
        lambda t: t.replace("OFFSET 0 2 0", "OFFSET 0 x 0"),
        8,
        "OFFSET needs 3 finite numbers up to 1e+09; found 'x'",
    ),
    "nan offset": (lambda t: t.replace("OFFSET 0 2 0", "OFFSET 0 0 nan"), 8, "found 'nan'"),
    "huge offset": (lambda t: t.replace("OFFSET 0 2 0", "OFFSET 1e30 0 0"), 8, "found '1e30'"),
    "short offset": (lambda t: t.replace("OFFSET 0 2 0", "OFFSET 0 2"), 9, "found 'CHANNELS'"),
    "channel count": (
        lambda t: t.replace("CHANNELS 6", "CHANNELS six"),
        5,
        "a count from 0 to 6; found 'six'",
    ),
    "too many channels": (lambda t: t.replace("CHANNELS 6", "CHANNELS 5"), 5, "found 'Yrotation'"),
    "unknown channel": (lambda t: t.replace("6 Xposition", "6 Xscale"), 5, "channel 'Xscale' is not known"),
    "double channel": (lambda t: t.replace("3 Zrot", "3 Xrot"), 9, "channel 'Xrotation' appears twice"),
    "unknown word": (lambda t: t.replace("    OFFSET 0 2 0", "SIZE 0 2 0"), 8, "found 'SIZE'"),
    "cut in header": (lambda t: t[: t.index("JOINT Foot")], 9, "a '}' is missing or the file is cut off"),
    "cut after header": (lambda t: t[: t.index("MOTION")], 21, "no line says MOTION"),
    "cut after MOTION": (
        lambda t: t[: t.index("Frames")],
        22,
        "expected 'Frames:' and a number after MOTION",
    ),
    "no frames": (lambda t: t.replace("Frames: 2\n", ""), 22, "expected 'Frames:'"),
    "bad frames": (lambda t: t.replace("Frames: 2", "Frames: two"), 22, "found 'two'"),
    "negative frames": (lambda t: t.replace("Frames: 2", "Frames: -2"), 22, "found '-2'"),
    "no time": (lambda t: t.replace("Frame Time: 0.0333333\n", ""), 23, "expected 'Frame Time:'"),
    "bad time": (lambda t: t.replace("0.0333333", "nan"), 23, "found 'nan'"),
    "bad number": (lambda t: t.replace("0 0 90", "0 0 90?"), 25, "expected a number; found '90?'"),
    "comma": (lambda t: t.replace("5 6 7 90", "5,6,7,90"), 24, "found '5,6,7,90'"),
    "nan": (lambda t: t.replace("0 0 90", "0 nan 90"), 25, "frame 1: Xrotation of joint 'Knee' is nan"),
    "inf": (lambda t: t.replace("5 6 7", "5 -inf 7", 1), 24, "frame 0: Yposition of joint 'Hips' is -inf"),
    "overflow": (lambda t: t.replace("5 6 7", "5 1e999 7", 1), 24, "is inf; expected a finite number"),
    "huge": (
        lambda t: t.replace("5 6 7", "5 1e20 7", 1),
        24,
        "is 1e+20; expected a finite number up to 1e+09",
    ),
    "short row": (
        lambda t: t.replace("5 6 7 90", "5 6 7", 1),
        24,
        "12 numbers; found 11 on this line and 23 numbers in all",
    ),
    "long row": (lambda t: t.rstrip() + " 1", 25, "found 13 on this line and 25 numbers in all"),
    "cut in a row": (lambda t: t[:-9], 25, "found 9 on this line"),
    "cut in a number": (lambda t: t[: t.index("5 6 7")] + "1.250 " * 23 + "1.2", 24, "the file is cut off"),
    "cut after the heads": (lambda t: t[: t.index("5 6 7")], 24, "found 0 numbers in all"),
    "wrapped and short": (
        lambda t: t.replace("5 6 7", "5\n6 7").replace(" 0 0", "\n0 0")[:-4],
        35,
        "found 22 numbers in all",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_errors_name_file_and_line(case):
    change, line, message = CASES[case]
    with pytest.raises(mk.MotionKitError) as caught:
        parse(change(CHAIN).encode(), "clips/walk.bvh")
    assert str(caught.value).startswith(f"clips/walk.bvh, line {line}") and message in str(caught.value), str(
        caught.value
    )
    for end in ("\r\n", "\r"):  # whatever way lines end
        with pytest.raises(mk.MotionKitError, match=f", line {line}[:,]"):
            parse(change(CHAIN).replace("\n", end).encode(), "clips/walk.bvh")


def test_no_channels_at_all():
    text = re.sub("CHANNELS.*", "CHANNELS 0", CHAIN)
    with pytest.raises(mk.MotionKitError, match="x.bvh: no joint has channels"):
        parse(text.encode(), "x.bvh")


@pytest.mark.parametrize(
    "junk", [bytes(range(256)) * 10, b"\x00" * 100, b"\xff\xfe\x00", b"\x89PNG\r\n\x1a\n", b"PK\x03\x04"]
)
def test_binary_junk(junk):
    with pytest.raises(mk.MotionKitError, match=r"x.bvh, line \d+: "):
        parse(junk, "x.bvh")


@pytest.mark.parametrize(
    "more", [{"fps": 0}, {"fps": "fast"}, {"metres_per_unit": -1}, {"metres_per_unit": float("nan")}]
)
def test_wrong_arguments(more):
    with pytest.raises(mk.MotionKitError, match="x.bvh: .* must be a number above 0"):
        parse(CHAIN.encode(), "x.bvh", **more)


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(mk.MotionKitError, match="nowhere.bvh: no such file"):
        mk.load(tmp_path / "nowhere.bvh")
    with pytest.raises(mk.MotionKitError, match="this is a folder"):
        mk.load(tmp_path)
    with pytest.raises(mk.MotionKitError, match="cannot be written"):
        mk.save(parse(CHAIN.encode()), tmp_path / "no" / "such" / "folder.bvh")


@pytest.mark.parametrize("name", ["", " a", "a\nb", "a{b", "a}", "\ud800"])
def test_names_that_no_file_can_hold(name, tmp_path):
    skeleton = mk.Skeleton((name,), (-1,), torch.zeros(1, 3))
    m = mk.Motion.from_root(skeleton, rot.identity_quaternion(1, 1), torch.zeros(1, 3), 30)
    with pytest.raises(mk.MotionKitError, match="does not fit into a BVH file"):
        mk.save(m, tmp_path / "out.bvh")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("broken", ["fdopen", "replace", "chmod"])
@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch, broken, error):
    path = tmp_path / "out.bvh"
    path.write_text("old")

    def fail(*_, **__):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(files.os, broken, fail)
        with pytest.raises(mk.MotionKitError if isinstance(error, OSError) else KeyboardInterrupt):
            files.write_atomic(path, "new")
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["out.bvh"]
    files.write_atomic(path, "new")
    assert path.read_text() == "new" and os.listdir(tmp_path) == ["out.bvh"]


def test_a_write_that_fails_halfway(tmp_path, monkeypatch):
    real = os.fdopen

    def small_disk(*arguments, **more):
        file = real(*arguments, **more)
        write = file.write

        class Half:
            def __enter__(self):
                return self

            def __exit__(self, *_):
                file.close()

            def write(self, data):
                write(data[: len(data) // 2])
                raise OSError(28, "No space left on device")

        return Half()

    path = tmp_path / "out.bvh"
    mk.save(parse(CHAIN.encode()), path)
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(files.os, "fdopen", small_disk)
        with pytest.raises(mk.MotionKitError, match="out.bvh: cannot be written: .*No space left"):
            mk.save(parse(CHAIN.replace(STILL, STILL).encode()), path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == ["out.bvh"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such permissions")
def test_written_files_have_usual_permissions(tmp_path):
    path = files.write_atomic(tmp_path / "a", "x")
    (tmp_path / "b").write_text("x")
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE((tmp_path / "b").stat().st_mode)


def test_numbers_that_are_not_finite_are_not_written(tmp_path):
    walk = mk.load("data/actor/walk_neutral.bvh")
    walk.translations[7, 0, 0] = float("nan")
    with pytest.raises(mk.MotionKitError, match="frame 7 holds numbers that are not finite"):
        mk.save(walk, tmp_path / "walk.bvh")
    assert not list(tmp_path.iterdir())
    with pytest.raises(mk.MotionKitError, match="concatenate takes a list of Motions; found 'a'"):
        mk.concatenate(["a"])


def test_a_file_is_named_as_what_it_is(tmp_path):
    walk = mk.load("data/actor/walk_neutral.bvh")
    with pytest.raises(mk.MotionKitError, match="let its name end in .bvh"):
        mk.save(walk, tmp_path / "walk.fbx")
    assert not list(tmp_path.iterdir()) and mk.save(walk, tmp_path / "walk.BVH").exists()
