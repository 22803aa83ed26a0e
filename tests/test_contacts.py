"""Feet: contacts and sliding with known answers, two-bone IK, and locking."""

import pytest
import torch

import motionkit as mk
from motionkit import rotations as rot
from motionkit.contacts import feet_of, foot_contacts, foot_sliding, lock_feet, two_bone_ik
from motionkit.skeleton import smpl


@pytest.fixture(scope="module")
def walk():
    return mk.load("data/actor/walk_neutral.bvh")


def standing(frames=30, slide=0.0):
    root = torch.tensor([0.0, 0.96, 0.0]) + torch.arange(frames)[:, None] * torch.tensor([0.0, 0.0, slide])
    return mk.Motion.from_root(smpl(), rot.identity_quaternion(frames, 22), root, 30.0)


def test_a_standing_person_stands_and_does_not_slide():
    assert foot_contacts(standing()).all() and foot_sliding(standing()) == 0.0


def test_sliding_is_measured_in_millimetres_a_frame():
    clip = standing(slide=0.007)
    assert abs(foot_sliding(clip, torch.ones(30, 4, dtype=torch.bool)) - 7.0) < 1e-3


def test_a_jump_has_no_contacts():
    clip = standing()
    up = clip.translations.clone()
    up[10:20, 0, 1] += 0.4
    stands = foot_contacts(clip.replace(translations=up))
    assert stands[:9].all() and not stands[11:19].any() and stands[21:].all()


def test_a_walk_stands_on_one_foot_or_both(walk):
    stands = foot_contacts(walk)
    left, right = stands[:, :2].any(1), stands[:, 2:].any(1)
    assert (left | right).float().mean() > 0.95
    assert 0.05 < (left & right).float().mean() < 0.5  # double support
    assert 0.45 < left.float().mean() < 0.8


@pytest.mark.captures
def test_captured_walks_stand_as_walks_do(captures_dir):
    for path in sorted(captures_dir.glob("*walk_*.bvh")):
        stands = foot_contacts(mk.load(path))
        some = (stands[:, :2].any(1) | stands[:, 2:].any(1)).float().mean()
        assert some > 0.8, (path.name, float(some))
        assert foot_sliding(mk.load(path), stands) < 4.0


def test_two_bone_ik_reaches_and_keeps_the_rest(walk):
    joints = tuple(walk.skeleton.index(f"left_{n}") for n in ("hip", "knee", "ankle"))
    before = walk.positions()
    target = before[:, joints[2]] + torch.tensor([0.03, 0.05, -0.04])
    bent = two_bone_ik(walk, joints, target)
    after = bent.positions()
    assert (after[:, joints[2]] - target).norm(dim=-1).max() < 1e-3
    others = [j for j in range(22) if j not in walk.skeleton.descendants(joints[0])]
    assert torch.equal(bent.rotations[:, others], walk.rotations[:, others])
    turned = rot.quaternion_angle(bent.world_rotations()[:, joints[2]], walk.world_rotations()[:, joints[2]])
    assert turned.max() < 2e-3  # the foot keeps its rotation in the world
    assert torch.allclose(
        after[:, joints[1]].sub(after[:, joints[0]]).norm(dim=-1), walk.skeleton.offsets[joints[1]].norm(), atol=1e-5
    )


def test_two_bone_ik_stretches_towards_what_it_cannot_reach(walk):
    joints = tuple(walk.skeleton.index(f"right_{n}") for n in ("hip", "knee", "ankle"))
    places = two_bone_ik(walk, joints, torch.tensor([0.0, -50.0, 0.0]).expand(len(walk), 3)).positions()
    assert torch.isfinite(places).all()
    leg = walk.skeleton.offsets[list(joints[1:])].norm(dim=-1).sum()
    assert (places[:, joints[0]] - places[:, joints[2]]).norm(dim=-1).sub(leg).abs().max() < 1e-2


def test_two_bone_ik_bends_a_straight_leg_forward():
    clip = standing(2)
    joints = tuple(clip.skeleton.index(f"left_{n}") for n in ("hip", "knee", "ankle"))
    target = clip.positions()[:, joints[2]] + torch.tensor([0.0, 0.2, 0.0])
    knee = two_bone_ik(clip, joints, target).positions()[:, joints[1]]
    assert (knee[:, 2] > 0.1).all()


def test_two_bone_ik_wants_a_chain(walk):
    with pytest.raises(mk.MotionKitError, match="three joints in a row"):
        two_bone_ik(walk, (0, 2, 5), torch.zeros(120, 3))


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_locking_takes_added_skating_out(walk, factor):
    stands = foot_contacts(walk)
    skating = walk.replace(translations=walk.translations * torch.tensor([1.0, 1.0, factor]))
    locked = lock_feet(skating, stands)
    assert foot_sliding(skating, stands) > 4.0
    assert foot_sliding(locked, stands) < 1.0
    upper = [j for j in range(22) if walk.skeleton.sides[j] == "middle"][1:]
    assert torch.equal(locked.rotations[:, upper], skating.rotations[:, upper])
    moved = (locked.positions() - skating.positions()).norm(dim=-1)
    assert moved[:, 0].max() < 0.05  # the pelvis sinks only where a leg is too short
    assert moved.max() < 0.2
    jump = (locked.positions()[2:] - 2 * locked.positions()[1:-1] + locked.positions()[:-2]).norm(dim=-1).max() * 900
    was = (skating.positions()[2:] - 2 * skating.positions()[1:-1] + skating.positions()[:-2]).norm(dim=-1).max() * 900
    assert jump < 2.5 * was  # no pops where contacts begin and end


def test_locking_holds_the_height_too(walk):
    """Feet that nod up and down while they stand come to rest at one level."""
    stands = foot_contacts(walk)
    nod = torch.zeros_like(walk.translations)
    nod[:, 0, 1] = 0.02 * torch.sin(torch.arange(120) * 0.9)
    locked = lock_feet(walk.replace(translations=walk.translations + nod), stands)
    toe = walk.skeleton.index("left_foot")
    heights = locked.positions()[:, toe, 1][stands[:, 1]]
    assert (walk.translations + nod)[stands[:, 1], 0, 1].std() > 0.012 and heights.std() < 0.004


@pytest.mark.captures
def test_locking_on_captures_with_added_skating(captures_dir):
    for path in sorted(captures_dir.glob("*walk_*.bvh"))[:4]:
        clip = mk.load(path)
        stands = foot_contacts(clip)
        drift = torch.zeros_like(clip.translations)
        drift[:, clip.skeleton.pelvis, 0] = 0.06 * torch.sin(torch.arange(len(clip)) / 6)
        skating = clip.replace(translations=clip.translations + drift)
        assert foot_sliding(lock_feet(skating, stands), stands) < 1.0, path.name


def test_locking_leaves_a_clip_that_does_not_slide_alone():
    clip = standing()
    drift = (lock_feet(clip).positions() - clip.positions()).norm(dim=-1)
    assert drift.max() < 0.01 and drift.mean() < 2e-3  # a leg as straight as a rod bends by a hair


def test_contacts_of_another_shape_are_refused(walk):
    with pytest.raises(mk.MotionKitError, match=r"expected contacts \[120, 4\]"):
        foot_sliding(walk, torch.ones(120, 2))
    with pytest.raises(mk.MotionKitError, match="did you mean"):
        feet_of(walk, ["left_foott"])
