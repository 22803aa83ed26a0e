"""What names and offsets of a skeleton tell: sides, mirror joints, roles, pelvis, parts, size; on rigs people have."""

import pytest
import torch

import motionkit as mk
from motionkit import skeleton
from motionkit.skeleton import Skeleton, smpl

# (names of hips, knee, ankle, toe, shoulder, elbow, wrist on the left; on the right; the pelvis; the midline)
RIGS = {
    "smpl": ("left_hip left_knee left_ankle left_foot left_shoulder left_elbow left_wrist", "left_", "right_"),
    "mixamo": ("LeftUpLeg LeftLeg LeftFoot LeftToeBase LeftArm LeftForeArm LeftHand", "Left", "Right"),
    "bandai": ("UpperLeg_L LowerLeg_L Foot_L Toes_L UpperArm_L LowerArm_L Hand_L", "_L", "_R"),
    "blender": ("thigh.L shin.L foot.L toe.L upper_arm.L forearm.L hand.L", ".L", ".R"),
    "cmu": ("lfemur ltibia lfoot ltoes lhumerus lradius lwrist", "l", "r"),
    "unreal": ("thigh_l calf_l foot_l ball_l upperarm_l lowerarm_l hand_l", "_l", "_r"),
}
ROLES = "hip knee ankle toe shoulder elbow wrist".split()


def right_of(name, mark, other):
    return other + name[len(mark) :] if name.startswith(mark) else name[: -len(mark)] + other


def rig(style):
    """Pelvis, spine, neck, head, then the left and right limbs of a style of naming."""
    left, mark, other = RIGS[style]
    left = left.split()
    right = [right_of(n, mark, other) for n in left]
    names = ["Hips", "Spine", "Neck", "Head"]
    parents = [-1, 0, 1, 2]
    offsets = [(0, 1.0, 0), (0, 0.3, 0), (0, 0.25, 0), (0, 0.1, 0)]
    for sign, limb in ((1, left), (-1, right)):
        for n, joint in enumerate(limb):
            parents.append({0: 0, 4: 1}.get(n, len(names) - 1))
            names.append(joint)
            offsets.append((0.1 * sign if n in (0, 4) else 0.0, 0.0 if n in (0, 4) else -0.4, 0.0))
    return Skeleton(tuple(names), tuple(parents), torch.tensor(offsets, dtype=torch.float32))


@pytest.mark.parametrize("style", RIGS)
def test_names_of_many_rigs_tell_roles_sides_and_twins(style):
    s = rig(style)
    for side, first in (("left", 4), ("right", 11)):
        for n, role in enumerate(ROLES):
            assert s.roles[f"{side}_{role}"] == first + n, (role, s.names)
            assert s.sides[first + n] == side
    assert s.sides[:4] == ("middle",) * 4
    assert [s.mirror_joints[n] for n in range(4, 11)] == list(range(11, 18)) and s.mirror_joints[:4] == (0, 1, 2, 3)
    assert s.pelvis == 0


@pytest.mark.parametrize("style", RIGS)
def test_body_parts(style):
    parts = rig(style).body_parts
    assert parts["torso"] == (0, 1, 2, 3)
    assert parts["left_leg"] == (4, 5, 6, 7) and parts["left_arm"] == (8, 9, 10)
    assert parts["right_leg"] == (11, 12, 13, 14) and parts["right_arm"] == (15, 16, 17)


def test_a_helper_joint_on_the_ground_is_not_the_pelvis():
    s = rig("bandai")
    names, parents = ("joint_Root", *s.names), (-1, *(p + 1 for p in s.parents))
    helped = Skeleton(names, parents, torch.cat((torch.zeros(1, 3), s.offsets)))
    assert helped.pelvis == 1 and helped.height == pytest.approx(s.height, abs=1e-5)
    assert helped.subtree(helped.descendants(1)).names == s.names


def test_pelvis_of_rigs_without_names():
    nameless = Skeleton(("a", "b", "c", "d"), (-1, 0, 1, 1), torch.ones(4, 3))
    assert nameless.pelvis == 1 and nameless.roles == {}
    assert Skeleton(("a", "b"), (-1, 0), torch.ones(2, 3)).pelvis == 0


def test_height_is_a_leg_and_the_midline():
    assert rig("smpl").height == pytest.approx(0.9 + 0.65, abs=1e-5)
    assert Skeleton(("a",), (-1,), torch.zeros(1, 3)).height == 0


def test_words_and_sides():
    assert skeleton.words("mixamorig:LeftHandIndex1") == ["left", "hand", "index", "1"]
    sides, bare = skeleton.split_sides(["lowerback", "lowerneck", "root", "LHipJoint", "RHipJoint", "lfoot", "rfoot"])
    assert sides == ["middle", "middle", "middle", "left", "right", "left", "right"]
    assert bare[3] == bare[4] == "hipjoint"


def test_twins_are_unknown_where_one_is_missing():
    assert skeleton.find_mirror_joints(["Hips", "LeftFoot"]) is None
    assert skeleton.find_mirror_joints(["a", "b"]) == (0, 1)


def test_feet():
    s = smpl()
    assert [s.names[j] for j in s.feet()] == ["left_ankle", "left_foot", "right_ankle", "right_foot"]
    with pytest.raises(mk.MotionKitError, match="cannot tell the feet"):
        Skeleton(("a", "b"), (-1, 0), torch.ones(2, 3)).feet()


def test_levels_and_chains_cover_every_joint_once():
    s = smpl()
    assert sorted(j for level in s.levels for j in level) == list(range(22))
    order, back = s.level_order
    assert torch.equal(order[back], torch.arange(22))
    assert [s.names[j] for j in s.ancestors(s.index("left_knee"))] == ["pelvis", "left_hip", "left_knee"]


@pytest.mark.parametrize(
    "change, part",
    [
        ({"names": ()}, "at least one joint"),
        ({"names": ("a", "a")}, "'a' appears twice"),
        ({"parents": (-1, 1)}, "comes before it"),
        ({"parents": (-1, -1)}, "-1 for joint 0 alone"),
        ({"parents": (-1,)}, "expected 2 parents"),
        ({"offsets": torch.zeros(3, 3)}, "expected 2 offsets"),
    ],
)
def test_what_is_no_skeleton_is_refused(change, part):
    given = {"names": ("a", "b"), "parents": (-1, 0), "offsets": torch.zeros(2, 3), **change}
    with pytest.raises(mk.MotionKitError, match=part):
        Skeleton(**given)


def test_a_joint_that_is_not_there_brings_the_nearest_names():
    with pytest.raises(mk.MotionKitError, match="did you mean 'left_knee'"):
        smpl().index("left_kne")
