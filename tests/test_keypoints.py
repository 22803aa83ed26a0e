"""Keypoints of a pose estimator to a motion: what comes back, noise, gaps, and what is refused."""

import math

import pytest
import torch

import motionkit as mk
from motionkit import rotations as rot
from motionkit.actor import perform
from motionkit.video import fill_gaps, lowpass, motion_from_keypoints

COCO = [f"{s}_{r}" for r in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for s in ("left", "right")]


@pytest.fixture(scope="module")
def walk() -> mk.Motion:
    return perform("walk", "old", seed=2, seconds=4.0).motion


def seen(motion: mk.Motion, names: list[str]) -> torch.Tensor:
    return motion.positions()[:, [motion.skeleton.names.index(name) for name in names]]


def gap(found: mk.Motion, motion: mk.Motion) -> float:
    """How far limbs stand from where they were, seen from the pelvis and the facing, per metre of leg; mean."""
    pairs = []
    for m in (found, motion):
        local = m.positions() - m.positions()[:, m.skeleton.pelvis, None]
        local = rot.quaternion_rotate(rot.yaw_to_quaternion(-m.facing())[:, None].expand(*local.shape[:2], 4), local)
        limbs = local[:, [m.skeleton.names.index(name) for name in COCO]]
        leg = m.skeleton.offsets[[m.skeleton.names.index(f"left_{j}") for j in ("knee", "ankle")]].norm(dim=-1).sum()
        pairs.append(limbs / leg)
    return float((pairs[0] - pairs[1]).norm(dim=-1).mean())


def test_limbs_come_back(walk):
    found = motion_from_keypoints(seen(walk, COCO), COCO, 30, cutoff=10)
    assert gap(found, walk) < 0.08
    assert found.skeleton.same_tree(mk.skeleton.smpl()) and len(found) == len(walk)
    assert float(found.root_path().abs().max()) < 1e-3  # no global translation
    assert -0.05 < float(found.positions()[..., 1].min()) < 0.1


@pytest.mark.parametrize("up", [(0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
def test_any_axis_may_be_up(walk, up):
    points = seen(walk, COCO)
    turn = rot.rotation_between(torch.tensor([0.0, 1.0, 0.0]), torch.tensor(up))
    turned = 100 * rot.quaternion_rotate(turn.expand(*points.shape[:2], 4), points)  # and centimetres
    found, same = (motion_from_keypoints(p, COCO, 30) for p in (turned, points))
    assert gap(found, same) < 1e-3


def test_noise_is_taken_out(walk):
    points = seen(walk, COCO)
    noisy = points + 0.02 * torch.randn(points.shape, generator=torch.Generator().manual_seed(0))
    still = lowpass(noisy, 30)
    assert float((still - points).norm(dim=-1).mean()) < 0.75 * float((noisy - points).norm(dim=-1).mean())
    calm, raw = (mk.metrics.jitter(motion_from_keypoints(noisy, COCO, 30, cutoff=c)) for c in (3.0, 14.0))
    assert calm < 0.3 * raw


def test_butterworth_halves_the_power_at_its_cutoff_twice():
    """Each way lets half of the power through at the cut-off: forwards and back, half of the amplitude."""
    time = torch.arange(600) / 30
    for hertz, share in ((0.3, 1.0), (3.0, 0.5), (9.0, 0.0)):
        wave = torch.sin(2 * math.pi * hertz * time)[:, None]
        assert float(lowpass(wave, 30)[150:450].abs().max()) == pytest.approx(share, abs=0.03)


def test_short_gaps_are_filled_and_long_ones_refused(walk):
    points = seen(walk, COCO).clone()
    points[40:49, 2] = math.nan  # 0.3 s
    points[0, 3] = math.nan
    whole = fill_gaps(points, COCO, 30)
    assert whole.isfinite().all()
    assert torch.allclose(whole[44, 2], (5 * points[39, 2].double() + 5 * points[49, 2].double()) / 10, atol=1e-6)
    assert torch.equal(whole[0, 3], points[1, 3].double())
    assert gap(motion_from_keypoints(points, COCO, 30), motion_from_keypoints(seen(walk, COCO), COCO, 30)) < 0.02
    points[40:50, 2] = math.nan
    with pytest.raises(mk.MotionKitError, match=r"'left_knee' is missing from frame 40 to 49, 0.33 s"):
        motion_from_keypoints(points, COCO, 30)
    points[:, 2] = math.nan
    with pytest.raises(mk.MotionKitError, match="missing from frame 0"):
        motion_from_keypoints(points, COCO, 30)


@pytest.mark.parametrize(
    ("points", "names", "fps", "message"),
    [
        (torch.zeros(10, 12), COCO, 30, "expected keypoints"),
        (torch.zeros(10, 12, 2), COCO, 30, "expected keypoints"),
        (torch.zeros(2, 12, 3), COCO, 30, "3 frames or more"),
        (torch.zeros(10, 11, 3), COCO[:-1], 30, "no keypoint is called 'right_wrist'"),
        (torch.zeros(10, 12, 3), COCO, 5, "below half the frame rate"),
    ],
)
def test_bad_keypoints(points, names, fps, message):
    with pytest.raises(mk.MotionKitError, match=message):
        motion_from_keypoints(points, names, fps)


def test_a_style_from_keypoints(walk):
    """The whole way of paper 1, section 5.1: keypoints, motion, a style that is learned."""
    from motionkit.methods.few_shot import Config

    config = Config(steps=1, batch=1, pair_steps=5, loss_weights=(1.0, 0.0))
    method = mk.methods.load("few-shot", config=config)
    style = method.learn(motion_from_keypoints(seen(walk, COCO), COCO, 30), "an old person walks", title="")
    labels = mk.methods.Labels(texts=("a person walks",))
    assert len(method.stylize(mk.load("data/actor/walk_neutral.bvh"), style, labels=labels)) == 120
