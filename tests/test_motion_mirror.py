"""Mirroring on rigs whose joint frames differ, against the mirror image of the positions, and for twist."""

from pathlib import Path

import pytest
import torch

import motionkit as mk
from motionkit import Motion, MotionKitError, Skeleton
from motionkit import rotations as rot
from motionkit.motion import _choose_flips

PI = torch.pi
X, Y, Z = torch.eye(3, dtype=torch.float64)
M = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
# name, parent, where it stands in a T pose
BODY = [
    ("Hips", None, (0.0, 1.0, 0.0)),
    ("Spine", "Hips", (0.0, 1.2, 0.0)),
    ("Head", "Spine", (0.0, 1.6, 0.02)),
    ("LeftUpLeg", "Hips", (0.1, 0.95, 0.0)),
    ("LeftLeg", "LeftUpLeg", (0.1, 0.5, 0.01)),
    ("LeftFoot", "LeftLeg", (0.1, 0.1, 0.0)),
    ("LeftToe", "LeftFoot", (0.1, 0.0, 0.15)),
    ("LeftArm", "Spine", (0.2, 1.4, 0.0)),
    ("LeftForeArm", "LeftArm", (0.5, 1.4, 0.0)),
    ("LeftHand", "LeftForeArm", (0.75, 1.4, 0.0)),
]
BODY += [(n.replace("Left", "Right"), p.replace("Left", "Right"), (-x, y, z)) for n, p, (x, y, z) in BODY[3:]]
NAMES = [name for name, _, _ in BODY]
TWINS = [NAMES.index(n.replace("Left", "~").replace("Right", "Left").replace("~", "Right")) for n in NAMES]


def along_the_bone(forward: torch.Tensor, axis: int) -> torch.Tensor:
    """A joint frame [3, 3] whose axis 0, 1 or 2 points `forward`, and the next one as far to +Z as may be."""
    aside = Z if forward[2].abs() < 0.9 else X
    second = rot.normalize(aside - (aside * forward).sum() * forward)
    columns = [forward, second, torch.linalg.cross(forward, second)]
    return torch.stack(columns[-axis:] + columns[:-axis] if axis else columns, -1)


def bone(name: str) -> torch.Tensor:
    """Where the bone that leaves a joint points to in the T pose."""
    places = {n: torch.tensor(place, dtype=torch.float64) for n, _, place in BODY}
    child = next((n for n, parent, _ in BODY if parent == name), None)
    if child is None:
        return bone(next(parent for n, parent, _ in BODY if n == name))
    return rot.normalize(places[child] - places[name])


def frame(rig: str, name: str) -> torch.Tensor:
    """How the frame of a joint is turned in the T pose, [3, 3]."""
    if rig == "world":  # CMU, SMPL: all frames along the world's axes
        return torch.eye(3, dtype=torch.float64)
    if rig == "mixamo":  # y along every bone
        return along_the_bone(bone(name), 1)
    middle = not name.startswith(("Left", "Right"))
    if rig == "bandai":  # x along the bones; on the right all axes reversed, so that left +x is right -x
        if middle:  # hips turned by 90 degrees: x up, and left is another axis than the world's
            return torch.stack((Y, Z, X) if name == "Hips" else (Y, -X, Z), -1)
        left = along_the_bone(bone(name.replace("Right", "Left")), 0)
        return left if name.startswith("Left") else -M[:, None] * left
    # as bandai, but the right frame is the left one's mirror image with one axis reversed: x or z
    flip = {"opposite": M, "alike": torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)}[rig]
    if middle:
        return torch.eye(3, dtype=torch.float64)
    left = along_the_bone(bone(name.replace("Right", "Left")), 0)
    return left if name.startswith("Left") else M[:, None] * left * flip


RIGS = ["world", "mixamo", "bandai", "opposite", "alike"]


def make(rig: str, channels: bool = False) -> tuple[Skeleton, torch.Tensor]:
    """A skeleton with the rig's joint frames, and these frames in the T pose [J, 3, 3]."""
    frames = torch.stack([frame(rig, n) for n in NAMES])
    parents = [-1 if p is None else NAMES.index(p) for _, p, _ in BODY]
    places = torch.tensor([place for _, _, place in BODY], dtype=torch.float64)
    offsets = [frames[p].T @ (places[n] - places[p]) if p >= 0 else places[n] for n, p in enumerate(parents)]
    six = ("Xposition", "Yposition", "Zposition", "Zrotation", "Xrotation", "Yrotation")
    more = {"channels": (six,) * len(BODY)} if channels else {}
    return Skeleton(tuple(NAMES), tuple(parents), torch.stack(offsets), **more), frames


def act(rig: str, turns: torch.Tensor, root: torch.Tensor, channels: bool = False) -> Motion:
    """One movement on any rig. turns: [F, J, 4], how far joints are turned from the T pose, in the world."""
    skeleton, frames = make(rig, channels)
    world = rot.quaternion_multiply(turns, rot.matrix_to_quaternion(frames))
    local = mk.kinematics.local_rotations(skeleton, world)
    return Motion.from_root(skeleton, local, root, 30)


def walk(frames: int = 40, yaw: float = 0.0) -> tuple[torch.Tensor, torch.Tensor]:
    """Whole cycles of a walk, arms hanging; turns [F, J, 4] in the world and the root's path [F, 3]."""
    time = torch.arange(frames, dtype=torch.float64) / frames * 4 * PI
    turns = rot.identity_quaternion(frames, len(BODY), dtype=torch.float64)
    heading = rot.yaw_to_quaternion(torch.as_tensor(yaw, dtype=torch.float64))
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        swing = rot.exp_map(0.5 * sign * time.sin()[:, None] * X)
        bend = rot.exp_map(0.3 * (1 + sign * time.cos())[:, None] * X)
        down = rot.exp_map(-1.3 * sign * Z)
        for name, turn in (
            ("UpLeg", swing),
            ("Leg", rot.quaternion_multiply(swing, bend)),
            ("Foot", swing),
            ("Toe", swing),
            ("Arm", rot.quaternion_multiply(rot.quaternion_inverse(swing), down)),
            ("ForeArm", rot.quaternion_multiply(rot.quaternion_inverse(bend), down)),
            ("Hand", rot.quaternion_multiply(rot.quaternion_inverse(bend), down)),
        ):
            turns[:, NAMES.index(side + name)] = turn
    turns[:, NAMES.index("Spine")] = rot.exp_map(0.1 * time.sin()[:, None] * Y)
    root = torch.stack((0.05 * time.sin(), 1.0 + 0 * time, 0.2 * time), -1)
    return rot.quaternion_multiply(heading, turns), rot.quaternion_rotate(heading, root) + X


def one_sided(yaw: float = 0.0) -> tuple[torch.Tensor, torch.Tensor]:
    """A walk in which the left arm is held up sideways and bent, and the body leans."""
    turns, root = walk(yaw=yaw)
    for name, up in (("LeftArm", 0.9), ("LeftForeArm", 1.4), ("LeftHand", 1.5)):
        turns[:, NAMES.index(name)] = rot.quaternion_multiply(
            rot.yaw_to_quaternion(torch.tensor(yaw, dtype=torch.float64)), rot.exp_map(up * Z)
        )
    return turns, root


def reflected(motion: Motion) -> torch.Tensor:
    """What a mirror shows of the mirror_joints, [F, J, 3]."""
    return motion.positions()[:, list(motion.skeleton.mirror_joints)] * M.to(motion.rotations)


def seen(turns: torch.Tensor, root: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The movement itself in the mirror: turns from the T pose are those of every rig, so this is true."""
    return turns[:, TWINS] * torch.tensor([1.0, 1.0, -1.0, -1.0]), root * M


MOVES = {"walk": walk, "one-sided": one_sided}


@pytest.mark.parametrize("channels", [False, True], ids=["rotations", "positions"])
@pytest.mark.parametrize("yaw", [0.0, PI / 2, -2.0])
@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("rig", RIGS)
def test_rotations_are_those_of_the_mirrored_movement(rig, move, yaw, channels):
    """Not only positions: the mirrored movement, acted on the same rig, has the same twist in every bone."""
    turns, root = MOVES[move](yaw=yaw)
    mirrored = act(rig, turns, root, channels).mirror()
    truth = act(rig, *seen(turns, root), channels)
    assert torch.allclose(mirrored.positions(), truth.positions(), atol=1e-9)
    assert rot.quaternion_angle(mirrored.rotations, truth.rotations).max() < 1e-6


@pytest.mark.parametrize("frame", [0, 7, 33])
@pytest.mark.parametrize("rig", RIGS)
def test_a_single_frame_is_mirrored_as_within_its_clip(rig, frame):
    m = act(rig, *one_sided(yaw=1.0))
    alone, within = m[frame].mirror(), m.mirror()[frame]
    assert rot.quaternion_angle(alone.rotations, within.rotations).max() < 1e-6
    assert torch.allclose(alone.positions(), within.positions())


@pytest.mark.parametrize("rig", RIGS)
def test_the_choice_of_flips_does_not_change_with_facing(rig):
    m = act(rig, *one_sided())
    chosen = [
        _choose_flips(m.transform(yaw), m.skeleton.mirror_joints).tolist() for yaw in (0.0, 0.8, PI / 2, PI, -2.0)
    ]
    assert all(c == chosen[0] for c in chosen)


@pytest.mark.parametrize("rig", RIGS)
def test_mirroring_twice_gives_the_motion_back(rig):
    m = act(rig, *one_sided(yaw=0.7))
    again = m.mirror().mirror()
    assert torch.allclose(again.positions(), m.positions(), atol=1e-12)
    assert torch.allclose(again.translations, m.translations, atol=1e-12)
    assert rot.quaternion_angle(again.rotations, m.rotations).max() < 1e-6


def test_any_rotations_at_all_come_back_and_keep_their_bones():
    """Even where no flip is right: random poses, and a skeleton whose sides are a few per cent apart."""
    generator = torch.Generator().manual_seed(0)
    skeleton, _ = make("bandai")
    uneven = skeleton.offsets * (1 + 0.03 * torch.rand(len(BODY), 1, generator=generator, dtype=torch.float64))
    skeleton = Skeleton(skeleton.names, skeleton.parents, uneven)
    q = rot.normalize(torch.randn(20, len(BODY), 4, generator=generator, dtype=torch.float64))
    m = Motion.from_root(skeleton, q, torch.randn(20, 3, generator=generator, dtype=torch.float64), 30)
    mirrored = m.mirror()
    assert torch.equal(mirrored.translations[:, 1:], m.translations[:, 1:])
    assert (mirrored.positions() - reflected(m)).abs().max() < 0.05
    again = mirrored.mirror()
    assert rot.quaternion_angle(again.rotations, m.rotations).max() < 1e-6


@pytest.mark.parametrize("rig", RIGS)
def test_joints_that_move_through_their_positions_are_mirrored_too(rig):
    m = act(rig, *walk(), channels=True)
    jitter = 0.02 * torch.randn(m.translations.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    m = m.replace(translations=m.translations + jitter)
    assert torch.allclose(m.mirror().positions(), reflected(m), atol=1e-9)


@pytest.mark.parametrize("rig", RIGS)
def test_the_hand_that_waves_changes_sides(rig):
    m = act(rig, *one_sided())
    left, right = NAMES.index("LeftHand"), NAMES.index("RightHand")
    before, after = m.positions(), m.mirror().positions()
    assert (before[:, left, 1] > before[:, right, 1] + 0.3).all()
    assert (after[:, right, 1] > after[:, left, 1] + 0.3).all()
    assert torch.allclose(after[:, right], before[:, left] * M)


def test_a_helper_joint_on_the_ground_does_not_change_the_choice():
    """A root that stays as it is while the body turns by more than a right angle against it."""
    skeleton, _ = make("world")
    whole = Skeleton(
        ("Reference", *skeleton.names),
        (-1, *(p + 1 for p in skeleton.parents)),
        torch.cat((torch.zeros(1, 3, dtype=torch.float64), skeleton.offsets)),
    )
    turns, _ = walk(yaw=2.0)
    body = act("world", turns, torch.zeros(40, 3, dtype=torch.float64) + Y)
    stays = rot.identity_quaternion(40, 1, dtype=torch.float64)
    m = Motion.from_root(whole, torch.cat((stays, body.rotations), 1), torch.zeros(40, 3), 30)
    mirrored = m.mirror()
    assert torch.allclose(mirrored.positions(), reflected(m), atol=1e-6)
    assert torch.allclose(mirrored.rotations[:, 0], stays[:, 0])


def test_neighbouring_frames_keep_their_signs():
    m = act("bandai", *walk()).mirror()
    assert ((m.rotations[1:] * m.rotations[:-1]).sum(-1) > 0.8).all()


def test_gradients_pass_through():
    m = act("bandai", *walk(frames=8))
    q = m.rotations.clone().requires_grad_()
    m.replace(rotations=q).mirror().positions()[:, NAMES.index("LeftHand")].sum().backward()
    assert q.grad[:, NAMES.index("RightArm")].abs().max() > 0  # the left hand now hangs on what was the right arm
    assert torch.isfinite(q.grad).all()


def test_no_frames_and_one_joint():
    m = act("world", *walk())
    assert len(m[:0].mirror()) == 0
    dot = Motion.from_root(
        Skeleton(("dot",), (-1,), torch.zeros(1, 3)), rot.identity_quaternion(2, 1), torch.ones(2, 3), 30
    )
    assert dot.mirror().positions()[0, 0].tolist() == [-1, 1, 1]


# refused


def nameless(motion: Motion) -> Motion:
    s = motion.skeleton
    return motion.replace(skeleton=Skeleton(tuple(f"j{n}" for n in range(len(s))), s.parents, s.offsets))


@pytest.mark.parametrize("rig", RIGS)
def test_names_that_do_not_tell_left_from_right_need_twins(rig):
    m = act(rig, *one_sided(yaw=0.5))
    with pytest.raises(MotionKitError, match="cannot tell left from right on j0, j1.*give mirror_joints"):
        nameless(m).mirror()
    given = nameless(m).mirror(m.skeleton.mirror_joints)
    assert torch.allclose(given.positions(), m.mirror().positions())
    assert rot.quaternion_angle(given.rotations, m.mirror().rotations).max() < 1e-6


@pytest.mark.parametrize("mirror_joints", [[0], list(range(1, 17)) + [0], [0] * 17, [99] * 17, list(range(-1, 16))])
def test_twins_that_do_not_pair_up_are_refused(mirror_joints):
    with pytest.raises(MotionKitError, match="cannot tell left from right"):
        act("world", *walk()).mirror(mirror_joints)


def test_twins_whose_parents_are_no_twins_are_refused():
    mirror_joints = list(range(len(BODY)))
    a, b = NAMES.index("LeftHand"), NAMES.index("RightHand")
    mirror_joints[a], mirror_joints[b] = b, a
    with pytest.raises(MotionKitError, match="'LeftHand' and 'RightHand' mirror each other, but their parents"):
        act("world", *walk()).mirror(mirror_joints)


def test_a_rest_pose_that_is_no_mirror_image_is_refused():
    m = act("world", *walk())
    offsets = m.skeleton.offsets.clone()
    offsets[NAMES.index("LeftLeg")] = torch.tensor([0.3, 0.3, 0.0])  # one thigh at right angles to the other
    s = Skeleton(m.skeleton.names, m.skeleton.parents, offsets)
    with pytest.raises(MotionKitError, match="the bone to 'LeftLeg' is no mirror image of the bone to 'RightLeg'"):
        m.replace(skeleton=s).mirror()


# real captures


def mean_turn(motion: Motion) -> torch.Tensor:
    """The mean rotation of each joint in the world, [J, 4], as seen by the body."""
    mean = rot.quaternion_to_matrix(motion.at_origin().world_rotations().double()).mean(0)
    u, _, v = torch.linalg.svd(mean)
    return rot.matrix_to_quaternion(u @ v)


@pytest.mark.captures
@pytest.mark.parametrize("style", ["normal", "elderly", "active"])
def test_captured_walks_stay_plausible_in_the_mirror(captures_dir: Path, style):
    m = mk.load(captures_dir / f"dataset-2_walk_{style}_001.bvh")
    mirrored = m.mirror()
    assert (mirrored.positions() - reflected(m)).abs().max() < 1e-5
    again = mirrored.mirror()
    assert rot.quaternion_angle(again.rotations, m.rotations).max() < 1e-3
    # a walk is as good as even over time; a wrong flip would be half a turn off
    assert torch.rad2deg(rot.quaternion_angle(mean_turn(m), mean_turn(mirrored))).max() < 45
    for frame in range(0, len(m), 40):
        assert rot.quaternion_angle(m[frame].mirror().rotations[0], mirrored.rotations[frame]).max() < 1e-2
