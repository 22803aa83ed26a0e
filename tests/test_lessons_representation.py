"""The hand-turned widgets: they can be made without a kernel, and moving a control changes the picture."""

import base64
import time

import pytest
import torch

import motionkit as mk
from motionkit import rotations as rot
from motionkit.lessons import representation


@pytest.fixture(scope="module")
def walk():
    return mk.load("data/actor/walk_neutral.bvh")


def ink(png: bytes) -> int:
    """How many pixels of a picture are not white."""
    import io

    import numpy as np
    from PIL import Image

    return int((np.asarray(Image.open(io.BytesIO(png)).convert("L")) < 250).sum())


@pytest.mark.parametrize("name", ["first", "second", "third"])
def test_every_angle_moves_the_gimbal(name):
    explorer = representation.rotation_explorer()
    before = explorer.png
    explorer.controls[name].value += 25
    assert explorer.png != before and ink(explorer.png) > 5000


def test_order_renames_the_sliders_and_changes_the_picture():
    explorer = representation.rotation_explorer("ZXY")
    before = explorer.png
    explorer.controls["order"].value = "XYZ"
    assert [explorer.controls[n].description[0] for n in ("first", "second", "third")] == ["X", "Y", "Z"]
    assert explorer.png != before


@pytest.mark.parametrize("order", representation.ORDERS)
def test_lock_button_makes_two_axles_one(order):
    explorer = representation.rotation_explorer(order)
    explorer.children[1].children[0].children[-1].click()
    degrees = [explorer.controls[n].value for n in ("first", "second", "third")]
    axles = representation.gimbal_axles(order, degrees)
    assert representation.gimbal_freedom(order, degrees) < 1e-6
    assert abs(axles[0] @ axles[2]) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("order", representation.ORDERS)
def test_axles_are_what_small_turns_turn_about(order):
    degrees = torch.tensor([20.0, 50.0, -70.0], dtype=torch.float64)
    axles = representation.gimbal_axles(order, degrees.tolist())
    here = rot.euler_to_quaternion(torch.deg2rad(degrees), order)
    for n in range(3):
        there = rot.euler_to_quaternion(torch.deg2rad(degrees + 0.01 * torch.eye(3)[n]), order)
        axis, _ = rot.quaternion_to_axis_angle(rot.quaternion_multiply(there, rot.quaternion_inverse(here)))
        assert torch.allclose(axis.float(), axles[n], atol=1e-4)


def test_every_control_moves_the_body(walk):
    explorer = representation.fk_explorer(walk)
    for name, value in {"angle": 10, "axis": "X", "joint": "right_hip", "frame": 30}.items():
        before = explorer.png
        explorer.controls[name].value = value
        assert explorer.png != before, name


def test_turned_joint_carries_what_hangs_on_it_rigidly(walk):
    skeleton, joint = walk.skeleton, walk.skeleton.index("spine2")
    moved = representation.turn_joint(walk, "spine2", "Y", 33).positions()
    still = [j for j in range(len(skeleton)) if j not in skeleton.descendants(joint)[1:]]
    carried = skeleton.descendants(joint)
    assert torch.equal(moved[:, still], walk.positions()[:, still])
    before, after = (torch.cdist(p[:, carried], p[:, carried]) for p in (walk.positions(), moved))
    assert torch.allclose(before, after, atol=1e-5)


def test_saved_output_holds_the_picture_in_few_bytes(walk):
    for explorer in (representation.rotation_explorer(), representation.fk_explorer(walk, "head", "X", 20)):
        bundle = explorer._repr_mimebundle_()
        assert "application/vnd.jupyter.widget-view+json" in bundle
        still = base64.b64decode(bundle["image/png"])
        assert len(still) < 40_000 and ink(still) > 5000


def test_redraws_fast_enough_to_drag(walk):
    explorer = representation.fk_explorer(walk)
    took = []
    for angle in range(20, 25):
        start = time.process_time()  # of this process alone: a busy machine is not the widget's fault
        explorer.controls["angle"].value = angle
        took.append(time.process_time() - start)
    assert min(took) < 0.2


def test_any_skeleton_and_any_joint():
    skeleton = mk.Skeleton(("a", "b"), (-1, 0), torch.tensor([[0.0, 1.0, 0.0], [0.0, 0.5, 0.0]]))
    clip = mk.Motion.from_root(skeleton, rot.identity_quaternion(3, 2), torch.zeros(3, 3), 30.0)
    explorer = representation.fk_explorer(clip)
    before = explorer.png
    explorer.controls["joint"].value = "a"
    assert explorer.png != before


def test_mistakes_are_told():
    with pytest.raises(mk.MotionKitError, match="Euler order 'XXY'"):
        representation.rotation_explorer("XXY")
    with pytest.raises(mk.MotionKitError, match="no joint 'elbow'"):
        representation.fk_explorer(mk.load("data/actor/walk_neutral.bvh"), "elbow")
    with pytest.raises(mk.MotionKitError, match="no motion|no frame"):
        representation.fk_explorer(mk.load("data/actor/walk_neutral.bvh")[:0])


def texts(picture) -> list[str]:
    import matplotlib.text

    return [t.get_text() for t in picture.findobj(matplotlib.text.Text)]


@pytest.mark.parametrize("order", representation.ORDERS)
@pytest.mark.parametrize("degrees", [(40, 60, 20), (20, 90, 0), (0, 0, 0), (-35, 75, 10)])
def test_no_axle_is_named_on_the_dart(order, degrees):
    named = [t for t in representation.plot_gimbal(order, degrees).axes[0].texts if t.get_text()[-1] in "₁₂₃"]
    assert len(named) == 3
    for text in named:
        x, y = text.get_position()
        assert 0.7 < (x * x + y * y) ** 0.5 < 1.45


def test_rotation_paths_measure_the_turn_and_mark_both_ends():
    turn = rot.yaw_to_quaternion(torch.linspace(0, torch.pi / 2, 61))
    picture = representation.plot_rotation_paths({"even": turn, "back": turn.flip(0)})
    assert {"start", "end", "even: 90° in all", "back: 90° in all"} <= set(texts(picture))


def test_numbers_are_named_and_a_jump_turns_the_title_pink():
    from motionkit.viewer import colours

    along = torch.linspace(0, 1, 101)
    ways = {"smooth": torch.stack((along, -along), 1), "broken": (along > 0.5).float()[:, None]}
    picture = representation.plot_numbers(ways, {"smooth": "wx", "broken": "y"}, along, "turns")
    titles = [ax._left_title for ax in picture.axes]
    assert [t.get_text() for t in titles] == ["smooth: largest step 0.01", "broken: largest step 1.00"]
    assert titles[1].get_color() == colours.CONTACT != titles[0].get_color()
    assert {"w", "x", "y", "turns"} <= set(texts(picture))


def test_motions_from_the_side_share_one_scale(walk):
    few = walk[::40]
    far = few.transform(offset=(0.0, 0.0, 3.0))
    picture = representation.plot_from_side({"here": few, "there": far}, right="here")
    one, two = picture.axes
    assert one.get_xlim() == two.get_xlim() and one.get_ylim() == two.get_ylim()
    assert len(one.lines) == len(two.lines) == len(few) * 21 + 1
