"""Metrics against cases with a known answer: themselves, frozen, slid, shifted, noisier, shuffled, broken."""

import numpy as np
import pytest
import scipy.linalg
import torch

import motionkit as mk
from motionkit import metrics
from motionkit.contacts import foot_contacts


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@pytest.fixture(scope="module")
def walk() -> mk.Motion:
    return mk.load("data/actor/walk_neutral.bvh")


def test_fmd_against_scipy_and_closed_forms():
    a, b = noise(400, 6) @ noise(6, 6, seed=1), noise(300, 6, seed=2) @ noise(6, 6, seed=3) + 1
    (ma, ca), (mb, cb) = ((x.numpy().mean(0), np.cov(x.numpy().T)) for x in (a, b))
    root = scipy.linalg.sqrtm(ca @ cb).real
    wanted = ((ma - mb) ** 2).sum() + np.trace(ca + cb - 2 * root)
    assert metrics.fmd(a, b) == pytest.approx(wanted, rel=1e-6)
    assert metrics.fmd(a, b) == pytest.approx(metrics.fmd(b, a), rel=1e-9)
    assert metrics.fmd(a, a[torch.randperm(400)]) < 1e-9  # the order of motions does not matter
    assert metrics.fmd(a, a + torch.tensor([3.0, 4, 0, 0, 0, 0])) == pytest.approx(25)
    x = noise(5000, 1)
    x = (x - x.mean()) / x.std()
    assert metrics.fmd(x, 3 * x) == pytest.approx(4.0)  # (3 - 1)^2 in one dimension
    distances = [metrics.fmd(a, a + s * noise(400, 6, seed=4)) for s in (0.0, 0.3, 1.0, 3.0)]
    assert distances == sorted(distances) and distances[0] < 1e-9 < distances[1]


def test_fmd_says_what_is_wrong():
    few = noise(10, 20)
    with pytest.raises(mk.MotionKitError, match="a has 10 rows of 20 numbers; a covariance needs at least 21 rows"):
        metrics.fmd(few, few)
    assert metrics.fmd(few, few, shrinkage=0.1) < 1e-9 < metrics.fmd(few, few + noise(10, 20, seed=1), shrinkage=0.1)
    with pytest.raises(mk.MotionKitError, match="shrinkage is a share"):
        metrics.fmd(few, few, shrinkage=0.0)
    broken = noise(50, 3)
    broken[[3, 7], 1] = torch.nan
    with pytest.raises(mk.MotionKitError, match="2 of 50 rows of b are not finite"):
        metrics.fmd(noise(50, 3), broken)
    with pytest.raises(mk.MotionKitError, match="one encoder for both"):
        metrics.fmd(noise(50, 3), noise(50, 4))
    with pytest.raises(mk.MotionKitError, match=r"expected a \[N, D\]"):
        metrics.fmd(noise(50), noise(50))


def test_recognition_counts_right_answers_and_broken_ones_as_wrong():
    labels = torch.arange(8) % 4
    scores = torch.nn.functional.one_hot(labels, 4).double()
    assert metrics.recognition_accuracy(scores, labels) == 100
    assert metrics.recognition_accuracy(scores, (labels + 1) % 4) == 0  # shuffled labels
    scores[0, 0] = torch.nan
    assert metrics.recognition_accuracy(scores, labels) == 87.5
    chance = [metrics.recognition_accuracy(noise(4000, 4, seed=n), torch.arange(4000) % 4) for n in range(3)]
    assert all(abs(c - 25) < 4 for c in chance)
    table = metrics.confusion(torch.eye(4), torch.tensor([0, 1, 1, 3]))
    assert table.tolist() == [[1, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0], [0, 0, 0, 1]]
    with pytest.raises(mk.MotionKitError, match="trained for other labels"):
        metrics.recognition_accuracy(scores, labels + 1)
    with pytest.raises(mk.MotionKitError, match="expected scores"):
        metrics.recognition_accuracy(scores, labels[:3])


def test_intervals_hold_the_truth_as_often_as_they_say():
    inside = 0
    for n in range(60):
        found = metrics.bootstrap(torch.mean, noise(80, seed=n), repeats=300, seed=n)
        assert found.low <= found.value <= found.high
        inside += found.low <= 0 <= found.high
    assert 50 <= inside <= 60  # 95 % of 60 is 57
    wide = metrics.bootstrap(torch.mean, noise(20), level=0.99)
    narrow = metrics.bootstrap(torch.mean, noise(2000), level=0.99)
    assert wide.high - wide.low > 4 * (narrow.high - narrow.low)
    assert metrics.bootstrap(torch.mean, noise(30)) == metrics.bootstrap(torch.mean, noise(30))
    paired = metrics.bootstrap(lambda a, b: (a == b).double().mean(), torch.arange(50), torch.arange(50))
    assert paired == (1.0, 1.0, 1.0)  # rows are drawn together
    for arguments, message in (
        ((torch.mean, noise(1)), "two rows"),
        ((torch.mean, noise(5), noise(6)), "one length"),
        ((lambda x: x.mean() / 0, noise(5)), "not finite"),
    ):
        with pytest.raises(mk.MotionKitError, match=message):
            metrics.bootstrap(*arguments)
    with pytest.raises(mk.MotionKitError, match="level"):
        metrics.bootstrap(torch.mean, noise(5), level=95)


def test_trajectories(walk):
    assert metrics.trajectory_similarity(walk, walk) == 0
    assert metrics.trajectory_similarity(walk.moved(2.0, (5.0, 0.0, 1.0)), walk) < 1e-5
    slower = walk.replace(translations=walk.translations.clone())
    slower.translations[:, 0, [0, 2]] *= 0.5
    gap = metrics.trajectory_similarity(slower, walk)
    half = walk.at_origin().root_path().norm(dim=1).mean() / 2
    assert gap == pytest.approx(float(half), rel=0.02)
    late = walk[5:].at(torch.arange(len(walk)).clamp(max=len(walk) - 6))  # a time-shifted clip
    assert 0 < metrics.trajectory_similarity(late, walk) < gap
    with pytest.raises(mk.MotionKitError, match="149 frames and the content 150|frames"):
        metrics.trajectory_similarity(walk[1:], walk)


def test_feet(walk):
    told = mk.actor.perform("walk", seed=1, seconds=5)
    assert metrics.foot_sliding_factor(told.motion, told.contacts) < 0.1
    skating = told.motion.replace(translations=told.motion.translations.clone())
    skating.translations[:, 0, 2] += 0.01 * torch.arange(len(told))  # slides 10 mm a frame
    assert metrics.foot_sliding_factor(skating, told.contacts) == pytest.approx(10, abs=0.5)
    stands = foot_contacts(walk)
    assert metrics.foot_contact_accuracy(walk, stands) == 100
    assert metrics.foot_contact_accuracy(walk, ~stands) == 0
    assert metrics.foot_contact_accuracy(walk, stands.roll(8, 0)) < 85  # a time-shifted clip
    with pytest.raises(mk.MotionKitError, match="one length on one skeleton"):
        metrics.foot_contact_accuracy(walk, stands[1:])


def test_diversity():
    clip = noise(90, 5)
    assert metrics.local_diversity(clip, clip) == 0 and metrics.global_diversity(clip, clip) == 0
    pieces = torch.cat((clip[50:], clip[:45]))
    assert metrics.global_diversity(pieces, clip) == 0
    short = torch.cat([clip[n : n + 10] for n in (60, 5, 33, 70, 20, 48)])  # pieces too short for one patch
    assert metrics.global_diversity(short, clip) > 0.5
    assert metrics.local_diversity(clip + 2, clip) == pytest.approx(2, rel=0.4)
    far = [metrics.global_diversity(clip + s * noise(90, 5, seed=1), clip) for s in (0.1, 0.5, 1.0)]
    near = [metrics.local_diversity(clip + s * noise(90, 5, seed=1), clip) for s in (0.1, 0.5, 1.0)]
    assert far == sorted(far) and near == sorted(near)
    assert far[0] == pytest.approx(0.1, rel=0.1)
    with pytest.raises(mk.MotionKitError, match="windows of 30 frames"):
        metrics.global_diversity(clip[:20], clip)
    with pytest.raises(mk.MotionKitError, match="expected features"):
        metrics.local_diversity(clip, clip[:, :3])


def test_soundness(walk):
    frozen = walk[10].at(torch.zeros(30))
    assert metrics.jitter(frozen) < 1e-6 < metrics.jitter(walk)
    shaken = [
        walk.replace(translations=walk.translations + s * noise(*walk.translations.shape).float())
        for s in (0.001, 0.01)
    ]
    assert metrics.jitter(walk) < metrics.jitter(shaken[0]) < metrics.jitter(shaken[1])
    assert metrics.bone_length_error(walk) < 0.01 < 1 < metrics.bone_length_error(shaken[1])
    helper = mk.Skeleton(  # as in many captures: a joint on the ground, from which the hips move freely
        ("ground", *walk.skeleton.names),
        (-1, *(p + 1 for p in walk.skeleton.parents)),
        torch.cat((torch.zeros(1, 3), walk.skeleton.offsets)),
    )
    still = mk.rotations.identity_quaternion(len(walk), 1)
    lifted = walk.replace(
        skeleton=helper,
        rotations=torch.cat((still, walk.rotations), 1),
        translations=torch.cat((torch.zeros(len(walk), 1, 3), walk.translations), 1),
    )
    assert metrics.bone_length_error(lifted) < 0.01
    stretched = walk.replace(translations=walk.translations.clone())
    knee = walk.skeleton.index("left_knee")
    stretched.translations[7, knee] *= 1.1
    wanted = 100 * float(walk.skeleton.offsets[knee].norm())
    assert metrics.bone_length_error(stretched) == pytest.approx(wanted, rel=1e-3)
    assert metrics.penetration(walk) == 0
    sunk = walk.moved(0.0, (0.0, -0.1, 0.0))
    assert metrics.penetration(sunk) == pytest.approx(1000 * (0.1 - float(walk.positions()[..., 1].min())), abs=0.1)
    with pytest.raises(mk.MotionKitError, match="four are the least"):
        metrics.jitter(walk[:3])


def test_a_mutated_metric_is_caught(monkeypatch):
    """The tests of the tests: a distance that forgets the covariances fails its known answers."""
    from motionkit.metrics import frechet

    whole = frechet.gaussian
    monkeypatch.setattr(frechet, "gaussian", lambda *a: (whole(*a)[0], torch.zeros_like(whole(*a)[1])))
    with pytest.raises(AssertionError):
        test_fmd_against_scipy_and_closed_forms()
