"""What Style-ERD sees of a motion: causal, the same wherever one walks, and back to the motion again."""

import torch

import motionkit as mk
from motionkit import rotations as rot
from motionkit.actor import perform
from motionkit.features.style_erd import (
    Frames,
    frames_of,
    lowest_foot,
    motion_from,
    placed_positions,
    split,
    split_frames,
)


def walk(seconds=3.0) -> mk.Motion:
    return perform("walk", "old", seed=2, seconds=seconds).motion


def test_there_and_back_is_the_motion():
    for motion in (walk(), mk.load("data/actor/jump_neutral.bvh")):
        seen = frames_of(motion)
        back = motion_from(motion, seen, seen.rotations, seen.velocities)
        assert float((back.positions() - motion.positions()).abs().max()) < 1e-4
        assert back.skeleton is motion.skeleton and back.fps == motion.fps


def test_place_and_direction_do_not_matter():
    motion = walk()
    a, b = frames_of(motion), frames_of(motion.transform(2.0, (5.0, 0.0, -3.0)))
    assert torch.allclose(a.x, b.x, atol=1e-4)
    turned = rot.yaw_to_quaternion(b.yaw - a.yaw)[:, 2]
    assert torch.allclose(turned, torch.tensor(1.0).sin().expand(len(motion)), atol=1e-4)


def test_a_frame_needs_the_one_before_and_no_other():
    motion = walk()
    whole, cut = frames_of(motion), frames_of(motion[30:32])
    assert torch.allclose(cut.x[1], whole.x[31], atol=1e-5)
    assert not cut.velocities[0].any() and torch.allclose(cut.positions[0], whole.positions[30], atol=1e-5)


def test_velocities_are_the_same_at_every_frame_rate():
    motion = walk()
    slow, fast = (frames_of(one).velocities[:, 0, 2][5:].mean() for one in (motion, motion.resample(60)))
    assert torch.allclose(slow, fast, rtol=0.02) and 0.02 < float(slow) < 0.2  # metres in a tenth of a second


def test_what_the_network_sees_and_says():
    seen = frames_of(walk())
    assert isinstance(seen, Frames) and len(seen) == 90
    assert seen.x.shape == (90, 220)
    assert bool((seen.rotations[..., 0] >= 0).all())
    for part, whole in zip(split_frames(seen.x), (seen.rotations, seen.positions, seen.velocities), strict=True):
        assert torch.equal(part, whole)
    turns, speeds = split(torch.cat((3 * seen.rotations.flatten(1), seen.velocities.flatten(1)), 1))
    assert torch.allclose(turns, seen.rotations, atol=1e-6) and torch.equal(speeds, seen.velocities)


def test_bent_knees_bring_the_body_down():
    motion = mk.load("data/actor/walk_neutral.bvh")
    seen, skeleton = frames_of(motion), motion.skeleton
    low = lowest_foot(skeleton, seen.positions)
    same = placed_positions(skeleton, motion.translations, seen.rotations, low)
    assert torch.allclose(same, seen.positions, atol=1e-4)
    bent = seen.rotations.clone()
    for side in ("left", "right"):
        for role, turn in (("hip", -0.8), ("knee", 1.6), ("ankle", -0.8)):
            joint = skeleton.roles[f"{side}_{role}"]
            more = rot.axis_angle_to_quaternion(torch.tensor([1.0, 0.0, 0.0]), torch.tensor(turn))
            bent[:, joint] = rot.quaternion_multiply(bent[:, joint], more)
    down = placed_positions(skeleton, motion.translations, bent, low)
    assert torch.allclose(lowest_foot(skeleton, down), low, atol=1e-5)
    assert float((same - down)[:, 0, 1].min()) > 0.1
