"""The BVH reader and writer: every dialect, a chain done by hand, there and back, and what is refused."""

import math
import os
import re
import stat
import warnings

import pytest
import torch

import motionkit as mk
from motionkit import files
from motionkit import rotations as rot
from motionkit.bvh import parse, parse_numbers
from motionkit.motion import Motion
from motionkit.skeleton import Skeleton

CHAIN = """HIERARCHY
ROOT Hips
{
  OFFSET 0 1 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Knee
  {
    OFFSET 0 2 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Foot
    {
      OFFSET 1 0 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0 0 0.5
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
5 6 7 90 0 0  0 0 0  0 0 0
5 6 7 90 0 0  0 0 90  0 0 0
"""
STILL = "0 0 0 0 0 0  0 0 0  0 0 0"


def read(text: str | bytes, **more) -> Motion:
    return parse(text.encode() if isinstance(text, str) else text, "clip.bvh", **{"metres_per_unit": 1.0, **more})


def one_joint(channels: str, *rows: str, offset: str = "0 0 0") -> str:
    """Text of a file with a root that has only rotations and a child with the given channels and rows."""
    count = len(channels.split())
    return (
        f"HIERARCHY\nROOT a\n{{\nOFFSET 1 2 3\nCHANNELS 0\nJOINT b\n{{\nOFFSET {offset}\n"
        f"CHANNELS {count} {channels}\n}}\n}}\nMOTION\nFrames: {len(rows)}\nFrame Time: 0.1\n"
        + "".join(r + "\n" for r in rows)
    )


def same(a: Motion, b: Motion) -> None:
    """Names, tree, ends, channels, rate and unit equal; places to 1e-4 of the height; turns up to sign."""
    assert a.skeleton.names == b.skeleton.names and a.skeleton.parents == b.skeleton.parents
    assert a.skeleton.channels == b.skeleton.channels
    assert [j for j, _ in a.skeleton.end_sites] == [j for j, _ in b.skeleton.end_sites]
    near = max(1e-4 * a.skeleton.height, 1e-6 * float(a.translations.abs().amax() if len(a) else 0), 1e-6)
    for (_, x), (_, y) in zip(a.skeleton.end_sites, b.skeleton.end_sites, strict=True):
        assert math.dist(x, y) < near
    assert len(a) == len(b) and a.fps == pytest.approx(b.fps, rel=1e-7) and a.metres_per_unit == b.metres_per_unit
    assert torch.allclose(a.skeleton.offsets, b.skeleton.offsets, atol=near, rtol=0)
    if len(a):
        assert (a.positions() - b.positions()).norm(dim=-1).max() < near
        assert rot.quaternion_angle(a.rotations.double(), b.rotations.double()).max() < 1e-5


def test_chain_by_hand():
    m = read(CHAIN)
    assert m.skeleton.names == ("Hips", "Knee", "Foot") and m.skeleton.parents == (-1, 0, 1)
    assert m.fps == 30.0 and len(m) == 2 and m.name == "clip"
    # the root's position channels replace its offset; a quarter turn about Z takes +Y to -X and +X to +Y
    expected = [[[5, 6, 7], [3, 6, 7], [3, 7, 7]], [[5, 6, 7], [3, 6, 7], [3, 6, 6]]]
    assert torch.allclose(m.positions(), torch.tensor(expected).float(), atol=1e-5)
    assert m.skeleton.end_sites == ((2, (0.0, 0.0, 0.5)),)


def test_positions_on_an_inner_joint_replace_its_offset():
    channels = "Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    m = read(one_joint(channels, "7 8 9 0 0 0", "1 1 1 0 0 0", offset="100 100 100"))
    assert m.positions()[:, 1].tolist() == [[8, 10, 12], [2, 3, 4]]


def test_partial_positions_replace_only_their_axes():
    m = read(one_joint("Yposition Zrotation", "7 0", offset="100 200 300"))
    assert m.translations[0, 1].tolist() == [100, 7, 300]


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_rotation_order_is_that_of_the_channels(order):
    m = read(one_joint(" ".join(f"{a}rotation" for a in order), "10 20 30"))
    expected = rot.euler_to_quaternion(torch.deg2rad(torch.tensor([10.0, 20.0, 30.0])), order)
    assert torch.allclose(m.rotations[0, 1], expected, atol=1e-6)


@pytest.mark.parametrize("axes", ["", "X", "Y", "Z", "XZ", "ZX", "YX"])
def test_joints_with_fewer_rotations(axes):
    channels = " ".join(["Xposition", *(f"{a}rotation" for a in axes)])
    m = read(one_joint(channels, " ".join(["4", "130", "-170"][: 1 + len(axes)])))
    expected = rot.identity_quaternion()
    for axis, degrees in zip(axes, (130.0, -170.0), strict=False):
        turn = rot.axis_angle_to_quaternion(torch.eye(3)["XYZ".index(axis)], torch.deg2rad(torch.tensor(degrees)))
        expected = rot.quaternion_multiply(expected, turn)
    assert rot.quaternion_angle(m.rotations[0, 1], expected) < 1e-3
    same(m, there_and_back(m))


def test_channels_in_any_order_and_mixed():
    m = read(one_joint("yrotation Zposition XROTATION Xposition Zrotation Yposition", "90 3 0 1 0 2"))
    assert m.translations[0, 1].tolist() == [1, 2, 3]
    assert torch.allclose(m.rotations[0, 1], rot.yaw_to_quaternion(torch.tensor(math.pi / 2)), atol=1e-6)
    assert m.skeleton.channels[1][:2] == ("Yrotation", "Zposition")
    same(m, there_and_back(m))


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.replace("\n", "\r\n"),
        lambda t: t.replace("\n", "\r"),
        lambda t: t.replace(" ", "\t"),
        lambda t: t.rstrip("\n"),
        lambda t: "\ufeff" + t,
        lambda t: t.encode("utf-16"),
        lambda t: "\n\n  " + t + "\n \n",
        lambda t: t.replace("5 6 7 90", "5.0e0 +60E-1 .7e+1 9.0e+01"),
        lambda t: t.replace("\n  {", " {").replace("\n    {", "{"),
        lambda t: t.partition("MOTION")[0].replace("\n", " ") + "MOTION" + t.partition("MOTION")[2],
        lambda t: t.replace("  0 0 0", "\n0 0\n 0"),
        lambda t: t.replace("}\nMOTION\nFrames: ", "}\n\nmotion  \n\n Frames :\t").replace(
            "Frame Time:", "frame time :"
        ),
        lambda t: t.replace("HIERARCHY", "hierarchy").replace("JOINT", "Joint").replace("End Site", "END SITE"),
        lambda t: t.replace("CHANNELS 3 Z", "CHANNELS 3\n      Z"),
    ],
    ids="crlf cr tabs no-end bom utf-16 blank scientific braces one-line wrapped words case split".split(),
)
def test_dialects_read_alike(change):
    same(read(CHAIN), read(change(CHAIN)))


@pytest.mark.parametrize(
    "name", ["left hand", "mixamorig:LeftHand", "a  b", "Hand.L", "手", "End", "JOINT", "MOTION x", "1e5"]
)
def test_names_are_kept(name):
    m = read(CHAIN.replace("JOINT Knee", f"JOINT  {name} "))
    assert m.skeleton.names == ("Hips", name, "Foot")
    same(m, there_and_back(m))


def test_latin1_names_and_no_name_at_all():
    assert read(CHAIN.replace("Knee", "Fuß").encode("latin-1")).skeleton.names[1] == "Fuß"
    assert read(CHAIN.replace("JOINT Knee\n", "JOINT\n")).skeleton.names[1] == "joint1"
    assert read(CHAIN.replace("JOINT Knee\n", "JOINT\nKnee\n")).skeleton.names[1] == "Knee"


def test_repeated_names_are_numbered():
    m = read(CHAIN.replace("Foot", "Knee").replace("Hips", "Knee#2"))
    assert m.skeleton.names == ("Knee#2", "Knee", "Knee#3")


def test_several_end_sites_and_end_sites_before_joints():
    text = CHAIN.replace("    JOINT Foot", "    End Site\n{\nOFFSET 1 1 1\n}\nEnd Site\n{\nOFFSET 2 2 2\n}\nJOINT Foot")
    m = read(text)
    assert m.skeleton.end_sites == ((1, (1.0, 1.0, 1.0)), (1, (2.0, 2.0, 2.0)), (2, (0.0, 0.0, 0.5)))
    same(m, there_and_back(m))


@pytest.mark.parametrize("said", ["1", "3", "999999999999999"])
def test_complete_rows_count_where_frames_disagrees(said):
    for text in (CHAIN, CHAIN.rstrip("\n")):
        with pytest.warns(mk.MotionKitWarning, match=f"'Frames: {said}' disagrees.*which have 2"):
            m = read(text.replace("Frames: 2", f"Frames: {said}"))
        assert len(m) == 2


def test_zero_frames_and_one_frame():
    head = CHAIN.partition("Frames")[0]
    none = read(head + "Frames: 0\nFrame Time: 0.0333333\n")
    assert len(none) == 0 and none.positions().shape == (0, 3, 3)
    same(none, there_and_back(none))
    one = read(head + "Frames: 1\nFrame Time: 0.0333333\n" + STILL)
    assert len(one) == 1
    same(one, there_and_back(one))


def test_frame_time_zero_needs_fps():
    text = CHAIN.replace("0.0333333", "0")
    with pytest.raises(mk.MotionKitError, match=r"clip.bvh, line 23: .*load\(\.\.\., fps=30\)"):
        read(text)
    assert read(text, fps=24).fps == 24


@pytest.mark.parametrize(
    "word, fps",
    [("0.033333", 30), ("0.03333333333", 30), (".008333", 120), ("8.3333e-3", 120), ("0.04", 25),
     ("0.033", 1 / 0.033), ("0.033366700", 1 / 0.0333667), ("0.033344448", 29.99), ("2", 0.5), ("1", 1)],
)  # fmt: skip
def test_frame_time_is_read_as_meant(word, fps):
    assert read(CHAIN.replace("0.0333333", word)).fps == pytest.approx(fps, rel=1e-6)


@pytest.mark.parametrize("scale, unit", [(1.0, 1.0), (17.0, 0.056444), (100.0, 0.01), (1000.0, 0.001)])
def test_unit_is_guessed_from_the_size(scale, unit):
    skeleton = Skeleton(
        ("a", "b", "c"), (-1, 0, 0), torch.tensor([[0, 1.0, 0], [0, 0.9, 0], [0, -0.9, 0]]) * scale * unit
    )
    m = Motion(skeleton, rot.identity_quaternion(1, 3), skeleton.offsets[None].clone(), 30, metres_per_unit=unit)
    same(m, there_and_back(m))


def test_saving_warns_where_the_unit_would_be_guessed_wrong(tmp_path):
    m = read(CHAIN, metres_per_unit=0.0254)
    with pytest.warns(mk.MotionKitWarning, match=r"load\(\.\.\., metres_per_unit=0.0254\)"):
        path = mk.save(m, tmp_path / "inch.bvh")
    same(m.replace(name=""), mk.load(path, metres_per_unit=0.0254))


@pytest.mark.parametrize(
    "text", ["", "0", "-0.0", "1 2\n", "7.", "-.5", "123456789.123456 1234567890.12345 99999999999999999999"]
)
def test_numbers_equal_those_of_python(text):
    assert parse_numbers(text.encode()).tolist() == [float(w) for w in text.split()]
    assert str(parse_numbers(text.encode()).tolist()) == str([float(w) for w in text.split()])


def test_joints_in_any_order_are_written_branch_by_branch():
    names, parents = ("a", "l_b", "r_b", "l_c", "r_c"), (-1, 0, 0, 1, 2)
    skeleton = Skeleton(names, parents, torch.randn(5, 3, generator=torch.Generator().manual_seed(0)))
    turns = rot.exp_map(torch.randn(4, 5, 3, generator=torch.Generator().manual_seed(1)))
    m = Motion.from_root(skeleton, turns, torch.ones(4, 3), 30)
    again = there_and_back(m)
    assert again.skeleton.names == ("a", "l_b", "l_c", "r_b", "r_c")
    order = [again.skeleton.names.index(n) for n in names]
    assert torch.allclose(again.positions()[:, order], m.positions(), atol=1e-4)


def test_a_motion_gets_the_channels_it_needs():
    m = read(one_joint("Zrotation", "10"))
    turned = m.replace(rotations=rot.exp_map(torch.tensor([[[0.1, 0.2, 0.3]] * 2])), translations=m.translations + 0.5)
    again = there_and_back(turned)
    assert again.skeleton.channels[1] == (
        "Xposition",
        "Yposition",
        "Zposition",
        "Zrotation",
        "Xrotation",
        "Yrotation",
    )
    assert torch.allclose(again.positions(), turned.positions(), atol=1e-5)
    assert rot.quaternion_angle(again.rotations, turned.rotations).max() < 1e-3


def there_and_back(m: Motion) -> Motion:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mk.MotionKitWarning)
        return parse(mk.bvh.format_bvh(m).encode(), "clip.bvh", m.metres_per_unit)


@pytest.mark.captures
def test_real_captures_there_and_back(captures_dir, tmp_path):
    for source in sorted(captures_dir.glob("*_001.bvh")):
        m = mk.load(source)
        assert m.metres_per_unit == 0.01 and m.fps == 30 and len(m.skeleton) == 22
        assert 1.2 < m.skeleton.height < 2.2
        same(m, mk.load(mk.save(m, tmp_path / source.name)))


@pytest.mark.captures
def test_real_captures_move_their_hips_through_position_channels(captures_dir):
    source = captures_dir / "dataset-2_walk_normal_001.bvh"
    rows = [line.split() for line in source.read_text().splitlines()[135:]]
    m = mk.load(source)
    hips = torch.tensor([[float(x) / 100 for x in row[6:9]] for row in rows[-len(m) :]])
    assert m.skeleton.names[1] == "Hips" and torch.allclose(m.positions()[-len(hips) :, 1], hips, atol=1e-5)


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
