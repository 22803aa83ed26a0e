"""Retargeting: rigs whose answer is known, and 30 real captures: feet, joint angles, twist, and no pops."""

import random
import zipfile

import pytest
import torch
from rigs import LIMBS, SIDES, along_x, cmu, flexion, other_name, rerigged, rest_pose

import motionkit as mk
from motionkit import Motion, MotionKitError, Skeleton
from motionkit import rotations as rot
from motionkit.contacts import feet_of, foot_contacts, foot_sliding
from motionkit.skeleton import smpl

THIGH, SHIN = (float(-smpl().offsets[smpl().index(f"left_{j}"), 1]) for j in ("knee", "ankle"))


@pytest.fixture(scope="module")
def walk() -> Motion:
    """A walk whose arms, hands and head also turn about their own bones."""
    motion = mk.load("data/actor/walk_old.bvh")
    rotations, time = motion.rotations.double(), torch.arange(len(motion), dtype=torch.float64) / motion.fps
    for name, axis, size in (
        ("left_elbow", 1, -0.7),
        ("right_elbow", 1, 0.7),
        ("left_wrist", 0, 0.8),
        ("right_wrist", 0, 0.5),
        ("head", 1, 0.6),
    ):
        turn = rot.axis_angle_to_quaternion(torch.eye(3, dtype=torch.float64)[axis], size * (0.5 + torch.sin(3 * time)))
        joint = motion.skeleton.index(name)
        rotations[:, joint] = rot.quaternion_multiply(rotations[:, joint], turn)
    order = [motion.skeleton.index(name) for name in smpl().names]
    return Motion.from_root(smpl(), rotations[:, order], motion.translations[:, 0].double(), motion.fps)


def errors(found: Motion, truth: Motion) -> tuple[float, float]:
    """Largest distance in metres and angle in degrees between two motions on one rig."""
    apart = (found.positions() - truth.positions()).norm(dim=-1).max()
    angle = rot.quaternion_angle(found.world_rotations(), truth.world_rotations()).max()
    return float(apart), float(torch.rad2deg(angle))


def test_a_motion_on_its_own_skeleton_is_itself(walk):
    apart, angle = errors(mk.retarget(walk, walk.skeleton), walk)
    assert apart < 1e-6 and angle < 1e-3


@pytest.mark.parametrize("size", [0.6, 1.3])
def test_a_scaled_copy_scales_every_position(walk, size):
    big = smpl()
    big = Skeleton(big.names, big.parents, big.offsets * size)
    assert torch.allclose(mk.retarget(walk, big).positions(), walk.positions() * size, atol=1e-6)


@pytest.mark.parametrize("kind", ["T-pose", "A-pose", "arms-down", "faces-x"])
def test_other_names_order_and_rest_pose_give_the_very_same_motion(walk, kind):
    truth = rerigged(walk, rest_pose(kind), other_name)
    for found, wanted in ((mk.retarget(walk, truth.skeleton), truth), (mk.retarget(truth, smpl()), walk)):
        apart, angle = errors(found, wanted)
        assert apart < 0.001 and angle < 0.5


def test_a_rest_pose_that_is_no_body_is_told_from_the_clip(walk):
    truth = rerigged(walk, along_x(), other_name)
    knees = truth.skeleton.offsets[[truth.skeleton.index(f"{s}Shin") for s in ("Left", "Right")]]
    assert torch.allclose(knees, torch.tensor([[THIGH, 0, 0], [-THIGH, 0, 0]]).double())  # one leg points up, one down
    for found, wanted in ((mk.retarget(walk, truth), truth), (mk.retarget(truth, smpl()), walk)):
        apart, angle = errors(found, wanted)
        assert apart < 0.005 and angle < 8  # how high the soles are is a guess, and the collars' slope at rest is lost
    turned = mk.retarget(walk, truth.skeleton)  # without a clip the places are right, the twist may be off
    assert (turned.positions() - truth.positions()).norm(dim=-1).max() < 0.03


def test_there_and_back_over_another_number_of_joints(walk):
    there = mk.retarget(walk, cmu())
    assert len(there.skeleton) == 31
    back = mk.retarget(there, smpl())
    assert (back.positions() - walk.positions()).norm(dim=-1).max() < 0.01
    for name in ("head", "left_wrist", "right_wrist", "spine3", "left_foot"):
        joint = smpl().index(name)
        apart = rot.quaternion_angle(back.world_rotations()[:, joint], walk.world_rotations()[:, joint])
        assert torch.rad2deg(apart).max() < 0.5, name


@pytest.mark.parametrize("joint", LIMBS)
def test_knees_and_elbows_bend_as_they_did(walk, joint):
    loose, held = (flexion(mk.retarget(walk, cmu(), feet=f), joint) - flexion(walk, joint) for f in (False, True))
    assert flexion(walk, joint).max() > 40 and loose.abs().max() < 0.01
    assert held.abs().median() < 0.5 and held.abs().max() < 2.5  # knees give a little to keep the feet in place


@pytest.mark.parametrize("joints", [1, 2, 5])
def test_a_spine_of_other_joints_leans_and_turns_as_far(walk, joints):
    spine = [(f"spine{n + 1}", (0.0, 0.32 / joints, 0.0)) for n in range(joints)]
    rows = [
        (n, smpl().names[p] if p >= 0 else None, o) for n, p, o in zip(smpl().names, smpl().parents, smpl().offsets)
    ]
    rows = [row for row in rows if not row[0].startswith("spine")]
    rows = [(n, f"spine{joints}" if p == "spine3" else p, tuple(o)) for n, p, o in rows]
    above = ["pelvis", *(name for name, _ in spine)]
    rows[1:1] = [(name, parent, offset) for (name, offset), parent in zip(spine, above, strict=False)]
    names = [name for name, _, _ in rows]
    parents = tuple(names.index(p) if p else -1 for _, p, _ in rows)
    result = mk.retarget(walk, Skeleton(tuple(names), parents, torch.tensor([o for _, _, o in rows])))
    chest = result.world_rotations()[:, names.index(f"spine{joints}")], walk.world_rotations()[:, 9]
    assert torch.rad2deg(rot.quaternion_angle(*chest)).max() < 2.5  # the rest line of the other spine is upright
    lean = []
    for m in (result, walk):
        places, roles = m.positions(), m.skeleton.roles
        lean.append(rot.normalize(places[:, [roles["left_shoulder"], roles["right_shoulder"]]].mean(1) - places[:, 0]))
    assert torch.rad2deg(torch.acos((lean[0] * lean[1]).sum(-1).clamp(-1, 1))).max() < 8


def test_the_mirrored_source_gives_the_mirrored_result(walk):
    apart = mk.retarget(walk.mirror(), cmu()).positions() - mk.retarget(walk, cmu()).mirror().positions()
    assert apart.norm(dim=-1).max() < 0.002  # the spine of the CMU skeleton leans aside by as much


@pytest.mark.parametrize("channels", ["position", "rotation"])
def test_a_helper_joint_above_the_pelvis_carries_or_stays(walk, channels, tmp_path):
    turns = ("Zrotation", "Xrotation", "Yrotation")
    moves = ("Xposition", "Yposition", "Zposition", *turns)
    inner = smpl()
    rig = Skeleton(
        ("Reference", *inner.names),
        (-1, *(p + 1 for p in inner.parents)),
        torch.cat((torch.zeros(1, 3), inner.offsets)),
        (moves, moves if channels == "position" else turns, *[turns] * 21),
    )
    result = mk.retarget(walk, rig)
    assert torch.allclose(result.without_helper_joints().positions(), walk.positions(), atol=1e-6)
    mk.save(result, tmp_path / "helped.bvh")
    read = mk.load(tmp_path / "helped.bvh", metres_per_unit=1.0)
    order = [read.skeleton.index(name) for name in rig.names]
    assert torch.allclose(read.positions()[:, order], result.positions().float(), atol=1e-4)
    assert (mk.retarget(result, smpl()).positions() - walk.positions()).abs().max() < 1e-5


def test_feet_stay_where_they_stand_on_longer_legs_and_wider_hips(walk):
    big = smpl()
    offsets = big.offsets.clone()
    for side in SIDES:
        offsets[big.index(f"{side}_hip"), 0] *= 1.6
        offsets[big.index(f"{side}_knee")] *= 1.25
    offsets[0, 1] += 0.25 * THIGH
    rig = Skeleton(big.names, big.parents, offsets)
    contacts = foot_contacts(walk)
    loose, held = mk.retarget(walk, rig, feet=False), mk.retarget(walk, rig)
    longer = (THIGH * 1.25 + SHIN) / (THIGH + SHIN)
    own = foot_sliding(walk, contacts) * longer
    assert foot_sliding(held, contacts) < 1.05 * own < 0.7 * foot_sliding(loose, contacts)
    heights = held.positions()[:, feet_of(held), 1]
    soles = torch.tensor([0.039, 0.012, 0.039, 0.012]) * 1.75
    assert heights.min(0).values.sub(soles).min() > -0.01
    assert [abs(float(heights[c, n].median() - soles[n])) < 0.005 for n, c in enumerate(contacts.T)] == [True] * 4


def test_scale_sets_how_far_it_walks(walk):
    way = (walk.root_path()[-1] - walk.root_path()[0]).norm()
    result = mk.retarget(walk, smpl(), scale=0.5, feet=False)
    assert torch.isclose((result.root_path()[-1] - result.root_path()[0]).norm(), way / 2, rtol=0.05)


def test_a_table_pairs_what_names_do_not_tell(walk):
    codes = [f"bone_{n:02d}" for n in range(22)]
    parts = {name: code for name, code in zip(smpl().names, codes, strict=True)}
    coded = rerigged(walk, rest_pose("A-pose"), parts.get)
    with pytest.raises(MotionKitError, match=r"not found: left_hip, .*names=\{'target joint for left_hip': 'left_hip'"):
        mk.retarget(walk, coded.skeleton)
    table = {code: name for name, code in parts.items() if "pelvis" not in name}
    apart, angle = errors(mk.retarget(walk, coded.skeleton, table), coded)
    assert apart < 0.001 and angle < 0.5
    back = mk.retarget(coded, smpl(), {name: code for code, name in table.items()})
    assert errors(back, walk)[0] < 0.001


def test_none_in_the_table_keeps_a_joint_still(walk):
    result = mk.retarget(walk, smpl(), {"head": None, "left_elbow": None})
    for name in ("head", "left_elbow"):
        local = result.rotations[:, smpl().index(name)]
        assert rot.quaternion_angle(local, local[:1]).max() < 1e-5
    assert (
        rot.quaternion_angle(walk.rotations[:, smpl().index("head")], walk.rotations[:1, smpl().index("head")]).max()
        > 0.5
    )


def test_wrong_tables_and_arguments_say_what_to_do(walk):
    with pytest.raises(MotionKitError, match="no joint 'left_knie'; did you mean 'left_knee'"):
        mk.retarget(walk, smpl(), {"left_knie": "left_knee"})
    with pytest.raises(MotionKitError, match="no joint 'LeftLeg'; did you mean"):
        mk.retarget(walk, smpl(), {"left_knee": "LeftLeg"})
    with pytest.raises(MotionKitError, match="scale must be above 0"):
        mk.retarget(walk, smpl(), scale=0.0)
    with pytest.raises(MotionKitError, match="expected a Motion and a Skeleton .*found Motion and str"):
        mk.retarget(walk, "smpl")
    arms = [j for j in range(22) if j not in smpl().descendants(smpl().index("left_knee"))]
    with pytest.raises(MotionKitError, match="not found: left_knee, left_ankle.*names={.*no part yet: "):
        mk.retarget(walk, smpl().subtree(arms))


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_very_short_clips(walk, frames):
    result = mk.retarget(walk[:frames], cmu())
    assert len(result) == frames and torch.isfinite(result.positions()).all()


def fastest_change(motion: Motion) -> float:
    """The largest acceleration of a limb's joint, metres a second squared."""
    places = motion.positions()[:, sorted(motion.skeleton.roles.values())]
    return float((places[2:] - 2 * places[1:-1] + places[:-2]).norm(dim=-1).max()) * motion.fps**2


@pytest.fixture(scope="module")
def clips(captures, tmp_path_factory) -> list[tuple[Motion, Motion]]:
    """30 captures of all kinds, each with itself on the 22-joint skeleton."""
    folder, found = tmp_path_factory.mktemp("clips"), []
    with zipfile.ZipFile(captures) as archive:
        members = sorted(n for n in archive.namelist() if "dataset-2_" in n and n.endswith(".bvh"))
        for n, member in enumerate(random.Random(0).sample(members, 30)):
            path = folder / f"{n}.bvh"
            path.write_bytes(archive.read(member))
            motion = mk.load(path)
            found.append((motion, mk.retarget(motion, smpl())))
    return found


def test_captures_keep_their_angles(clips):
    for source, result in clips:
        assert (flexion(source, "elbow") - flexion(result, "elbow")).abs().max() < 1
        assert (flexion(source, "knee") - flexion(result, "knee")).abs().median() < 3


def test_captures_keep_their_feet_on_the_ground(clips):
    for source, result in clips:
        contacts = foot_contacts(source)
        slid = foot_sliding(source, contacts)
        assert foot_sliding(result, contacts) < max(2.0, 1.1 * slid)
        places = result.positions()[:, feet_of(result), 1]
        toes = places[:, [1, 3]]
        assert toes.min() > 0.02 - 0.005  # the toe's joint is 2 cm over the sole
        floor = torch.quantile(toes[contacts[:, [1, 3]]], 0.02)
        assert abs(float(floor) - 0.02) < 0.002


def test_captures_do_not_pop(clips):
    assert max(fastest_change(result) / fastest_change(source) for source, result in clips) < 1.3


def test_captures_come_out_as_bodies(clips):
    """Twist: heads face ahead, knees and elbows bend about their hinge, no collar or spine is turned about itself."""
    for source, result in clips:
        turn = rot.log_map(result.rotations.double())  # [F, 22, 3]
        for name, axis in (("left_knee", 0), ("right_knee", 0)):
            knee = turn[:, smpl().index(name)]
            assert (knee[:, axis] > -0.05).all() and knee.abs().mean(0).argmax() == axis
        for name in ("spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "left_foot", "right_foot"):
            assert turn[:, smpl().index(name)].mean(0).norm() < torch.pi / 4, (source, name)
        ahead = rot.quaternion_rotate(
            result.world_rotations()[:, 15], torch.tensor([0.0, 0.0, 1.0]).expand(len(result), 3)
        )
        aside = rot.wrap_angle(rot.direction_to_yaw(ahead) - result.facing())
        assert aside.median().abs() < torch.pi / 4


def test_a_capture_on_another_of_its_kind_is_itself(clips):
    source, _ = clips[0]
    assert (mk.retarget(source, source.skeleton).positions() - source.positions()).abs().max() < 1e-4


def test_a_mirrored_capture_gives_the_mirrored_result(clips):
    for source, result in clips[:6]:
        mirrored = mk.retarget(source.mirror(), smpl())
        assert (mirrored.positions() - result.mirror().positions()).norm(dim=-1).max() < 0.005
