"""Metrics against cases with a known answer: themselves, frozen, slid, shifted, noisier, shuffled, broken."""

from pathlib import Path
from types import SimpleNamespace

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


@pytest.fixture(scope="module")
def walks() -> list[mk.Motion]:
    return [mk.actor.perform("walk", seed=n, seconds=2).motion for n in range(6)]


def heights(motions: list[mk.Motion]) -> torch.Tensor:
    """A stand-in for a content classifier: the mean height of the pelvis, [N, 1]."""
    return torch.stack([m.positions()[:, m.skeleton.pelvis, 1].mean().view(1) for m in motions])


def speeds(motions: list[mk.Motion]) -> torch.Tensor:
    """A stand-in for a style classifier: the mean and the spread of the ankles' speed, [N, 2]."""
    joints = [motions[0].skeleton.index(f"{side}_ankle") for side in ("left", "right")]
    steps = [(m.positions()[:, joints].diff(dim=0) * m.fps).norm(dim=-1) for m in motions]
    return torch.stack([torch.stack((x.mean(), x.std())) for x in steps])


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


def test_fmd_of_motions_is_that_of_what_the_encoder_sees(walks):
    lifted = [m.transform(0.0, (0.0, 0.1, 0.0)) for m in walks]
    for encoder in (heights, SimpleNamespace(features=heights)):
        assert metrics.fmd(walks, walks, encoder=encoder) < 1e-9  # clips against themselves
        assert metrics.fmd(walks, lifted, encoder=encoder) == pytest.approx(0.01, rel=1e-3)
    assert metrics.fmd(walks, lifted, heights) == metrics.fmd(heights(walks), heights(lifted))
    judge = SimpleNamespace(content=heights, style=speeds)
    assert metrics.content_fmd(lifted, walks, judge) == pytest.approx(0.01, rel=1e-3)
    assert metrics.style_fmd(lifted, walks, judge) < 1e-6
    hasty = [m.replace(fps=2 * m.fps) for m in walks]  # the same poses, twice as fast
    assert metrics.content_fmd(hasty, walks, judge) < 1e-9
    doubled = metrics.fmd(2 * speeds(walks), speeds(walks))
    assert metrics.style_fmd(hasty, walks, judge) == pytest.approx(doubled, rel=1e-3) and doubled > 0.1
    frozen = [m[0].sample(torch.zeros(len(m))) for m in walks]
    assert metrics.style_fmd(frozen, walks, judge, shrinkage=0.1) > doubled / 2


def test_fmd_of_motions_says_what_is_missing(walks):
    ask = r'encoder=mk\.judges\.load\("actor"\)\.content'
    told = mk.actor.perform("walk", seed=1, seconds=1)
    judge = SimpleNamespace(content=heights, style=speeds)
    for arguments, message in (
        ((walks, walks), ask),
        ((heights(walks), walks), ask),
        ((heights(walks), heights(walks), heights), "a holds features, and an encoder takes motions"),
        ((walks, heights(walks), heights), "b holds features"),
        ((walks[0], walks, heights), "between two sets of motions, not between two clips"),
        (("walk.bvh", walks, heights), "list of Motions; found a str"),
        ((walks, [*walks, "walk.bvh"], heights), r"b\[6\]: expected a Motion; found 'walk.bvh'; load it with mk.load"),
        ((walks, [told], heights), r"b\[0\]: .* found a Performance; it holds one: give its .motion"),
        ((walks, [walks[0][:0]], heights), r"b\[0\]: .* has 0 frames"),
        ((walks, [], heights), "b has 0 rows"),
        ((walks, walks, judge), "a judge has several: give its .content"),
        ((walks, walks, lambda motions: heights(motions[1:])), r"\[5, 1\] for the 6 motions of a"),
        ((walks, walks, lambda motions: [1.0]), "features of a as a torch tensor; found a list"),
    ):
        with pytest.raises(mk.MotionKitError, match=message):
            metrics.fmd(*arguments)
    with pytest.raises(mk.MotionKitError, match=r"expected a judge with a .style classifier, .* found a function"):
        metrics.style_fmd(walks, walks, heights)


def test_text_similarity():
    motions = noise(200, 16)
    assert metrics.text_similarity(motions, 3 * motions) == pytest.approx(1)  # lengths do not matter
    assert metrics.text_similarity(motions, -motions) == pytest.approx(-1)
    assert abs(metrics.text_similarity(motions, motions.roll(1, 0))) < 0.1  # shuffled pairs
    right = [metrics.text_similarity(motions, motions + s * noise(200, 16, seed=1)) for s in (0, 0.5, 1, 3, 9)]
    assert right == sorted(right, reverse=True) and right[2] == pytest.approx(2**-0.5, abs=0.02)
    half = torch.cat((motions[:100], -motions[100:]))
    assert metrics.text_similarity(motions, half) == pytest.approx(0, abs=1e-9)
    assert torch.allclose(
        metrics.pair_similarities(motions, half), torch.ones(200).double().index_fill(0, torch.arange(100, 200), -1)
    )
    broken, empty = motions.clone(), motions.clone()
    broken[[3, 5, 8], 0], empty[:2] = torch.inf, 0
    for arguments, message in (
        ((motions, broken), "3 of 200 rows of texts are not finite"),
        ((empty, motions), "2 of 200 rows of motions are all zeros"),
        ((motions, motions[1:]), r"\[200, 16\] and \[199, 16\]"),
        ((motions[0], motions[0]), "one pair a row"),
        ((motions[:0], motions[:0]), "one pair a row"),
        ((motions, "a man walks"), r"texts \[N, D\] as a torch tensor; found a str"),
    ):
        with pytest.raises(mk.MotionKitError, match=message):
            metrics.text_similarity(*arguments)


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
    unsure = torch.eye(4)
    unsure[2] = torch.nan  # taken for nothing, not for class 0
    assert metrics.confusion(unsure, torch.arange(4)).diag().tolist() == [1, 1, 0, 1]
    assert metrics.confusion(unsure, torch.arange(4)).sum() == 3
    with pytest.raises(mk.MotionKitError, match="trained for other labels"):
        metrics.recognition_accuracy(scores, labels + 1)
    with pytest.raises(mk.MotionKitError, match="expected scores"):
        metrics.recognition_accuracy(scores, labels[:3])
    with pytest.raises(mk.MotionKitError, match="class numbers, whole ones; found torch.float32"):
        metrics.recognition_accuracy(scores, labels.float())
    with pytest.raises(mk.MotionKitError, match=r"labels \[N\] as a torch tensor; found a list; use torch.as_tensor"):
        metrics.recognition_accuracy(scores, labels.tolist())


def test_trajectories(walk):
    assert metrics.trajectory_similarity(walk, walk) == 0
    assert metrics.trajectory_similarity(walk.transform(2.0, (5.0, 0.0, 1.0)), walk) < 1e-5
    slower = walk.replace(translations=walk.translations.clone())
    slower.translations[:, 0, [0, 2]] *= 0.5
    gap = metrics.trajectory_similarity(slower, walk)
    half = walk.at_origin().root_path().norm(dim=1).mean() / 2
    assert gap == pytest.approx(float(half), rel=0.02)
    frozen = walk[0].sample(torch.zeros(len(walk)))
    assert metrics.trajectory_similarity(frozen, walk) == pytest.approx(float(2 * half), rel=1e-3)
    late = walk[5:].sample(torch.arange(len(walk)).clamp(max=len(walk) - 6))  # a time-shifted clip
    assert 0 < metrics.trajectory_similarity(late, walk) < gap
    with pytest.raises(mk.MotionKitError, match="the result has 119 frames and the content 120"):
        metrics.trajectory_similarity(walk[1:], walk)


def test_feet(walk):
    told = mk.actor.perform("walk", seed=1, seconds=5)
    assert metrics.foot_sliding_factor(told.motion, told.contacts) < 0.1
    skating = told.motion.replace(translations=told.motion.translations.clone())
    skating.translations[:, 0, 2] += 0.01 * torch.arange(len(told))  # slides 10 mm a frame
    assert metrics.foot_sliding_factor(skating, told.contacts) == pytest.approx(10, abs=0.5)
    assert metrics.foot_sliding_factor(told.motion[40].sample(torch.zeros(30))) == 0  # frozen
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
    broken = clip.clone()
    broken[4:6] = torch.nan
    with pytest.raises(mk.MotionKitError, match="2 of 90 rows of the source are not finite"):
        metrics.local_diversity(clip, broken)
    with pytest.raises(mk.MotionKitError, match="windows of 30 frames"):
        metrics.global_diversity(clip[:20], clip)
    with pytest.raises(mk.MotionKitError, match="expected features"):
        metrics.local_diversity(clip, clip[:, :3])


def test_soundness(walk):
    frozen = walk[10].sample(torch.zeros(30))
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
    sunk = walk.transform(0.0, (0.0, -0.1, 0.0))
    assert metrics.penetration(sunk) == pytest.approx(1000 * (0.1 - float(walk.positions()[..., 1].min())), abs=0.1)
    with pytest.raises(mk.MotionKitError, match="four are the least"):
        metrics.jitter(walk[:3])


def test_speed_bands_find_swings_where_they_are():
    point = mk.Skeleton(("root",), (-1,), torch.zeros(1, 3))
    times = torch.arange(600) / 60
    for hertz, band in ((0.5, 1), (2.0, 2), (4.0, 3), (8.0, 4)):
        speed = 2 + torch.sin(2 * torch.pi * hertz * times)  # m/s, along X
        path = torch.stack((speed.cumsum(0) / 60, torch.zeros(600), torch.zeros(600)), -1)
        motion = mk.Motion.from_root(point, mk.rotations.identity_quaternion(600, 1), path, fps=60)
        found = metrics.speed_bands(motion)[0]
        assert found[0] == pytest.approx(2, abs=0.03) and found[band] == pytest.approx(2**-0.5, rel=0.05)
        assert found[1:].argmax() == band - 1 and found[1:].sum() < 1.2 * found[band]
    reference = torch.arange(101)[:, None].expand(101, 3) / 100
    assert metrics.within_spread(torch.tensor([0.01, 0.5, 0.99]), reference).tolist() == [False, True, False]


ONE_MOTION = (
    metrics.jitter,
    metrics.bone_length_error,
    metrics.penetration,
    metrics.foot_sliding_factor,
    metrics.speed_bands,
    lambda m: metrics.foot_contact_accuracy(m, torch.zeros(0, 4, dtype=torch.bool)),
    lambda m: metrics.trajectory_similarity(m, m),
)


@pytest.mark.parametrize("metric", ONE_MOTION)
def test_what_is_no_motion_or_has_no_frames_is_no_score(metric, walk):
    told = mk.actor.perform("walk", seed=1, seconds=1)
    for found, message in (
        ("walk.bvh", "expected a Motion; found 'walk.bvh'; load it with mk.load"),
        (Path("walk.bvh"), "expected a Motion; found 'walk.bvh'; load it with mk.load"),
        (told, "found a Performance; it holds one: give its .motion"),
        (walk.positions(), "expected a Motion; found a Tensor"),
        (None, "expected a Motion; found a NoneType"),
        (walk[:0], "has 0 frames; (one is|two are|four are) the least"),
    ):
        with pytest.raises(mk.MotionKitError, match=message):
            metric(found)


def test_other_wrong_types_are_told(walk):
    told = mk.actor.perform("walk", seed=1, seconds=1)
    for call, message in (
        (lambda: metrics.foot_contact_accuracy(walk, [True]), "contacts .* found a list"),
        (lambda: metrics.foot_sliding_factor(walk, "own"), "contacts .* found a str"),
        (lambda: metrics.foot_sliding_factor(walk[0]), "has 1 frames; two are the least"),
        (lambda: metrics.local_diversity(walk, walk), "features of the result .* found a Motion"),
        (lambda: metrics.truth_error(told, told, told), "result must be a Motion; .* give its .motion"),
        (lambda: metrics.truth_error(told.motion, told.motion, told), "truth must be a Performance"),
        (lambda: metrics.fmd([1.0], [2.0]), r"a\[0\]: expected a Motion; found a float"),
        (lambda: metrics.fmd(3, 4), "found a int"),
        (lambda: metrics.within_spread(torch.zeros(2), torch.zeros(9, 3)), r"found \[2\] and \[9, 3\]"),
        (lambda: metrics.within_spread(torch.zeros(2), walk), "reference .* found a Motion"),
        (lambda: metrics.repeated_accuracy(None, torch.arange(3)), "of each repeat in a list; found NoneType"),
        (lambda: metrics.bootstrap(noise(9), noise(9)), "expected a function of the samples first"),
    ):
        with pytest.raises(mk.MotionKitError, match=message):
            call()
