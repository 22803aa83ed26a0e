"""Metrics against cases with a known answer: themselves, frozen, slid, shifted, noisier, shuffled, broken.

At the end the tests of the tests: a metric with one thing wrong in it fails its known answers.
"""

import inspect
import math
import time
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
    half = metrics.bootstrap(torch.mean, noise(2000), level=0.5)
    assert half.high - half.low == pytest.approx(2 * 0.6745 / 2000**0.5, rel=0.15)  # between a normal's quartiles
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


def crossed(contents: int, styles: int, seed: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A table with known sources of luck: each content clip (1.0), style clip (0.7), and transfer (1.5) has its own."""
    content, style = (x.flatten() for x in torch.meshgrid(torch.arange(contents), torch.arange(styles), indexing="ij"))
    luck = noise(contents + styles + len(content), seed=seed).split([contents, styles, len(content)])
    return luck[0][content] + 0.7 * luck[1][style] + 1.5 * luck[2], content, style


def test_rows_that_share_clips_are_drawn_with_their_clips():
    """A known variance-components model: intervals by clips hold the truth, those by rows are far too narrow."""
    size, tables = 16, 60
    inside, widths = {"rows": 0, "one": 0, "both": 0}, {"rows": 0.0, "one": 0.0, "both": 0.0}
    for seed in range(tables):
        values, content, style = crossed(size, size, seed)
        for name, groups in (("rows", ()), ("one", content), ("both", (content, style))):
            found = metrics.bootstrap(torch.mean, values, groups=groups, repeats=150, seed=seed)
            inside[name] += found.low <= 0 <= found.high
            widths[name] += (found.high - found.low) / tables
    true_width = 2 * 1.96 * math.sqrt((1.0 + 0.49) / size + 2.25 / size**2)
    assert inside["both"] >= 0.87 * tables > 0.6 * tables > inside["rows"]
    assert widths["both"] == pytest.approx(true_width, rel=0.15)
    assert widths["rows"] < 0.45 * true_width and widths["rows"] < widths["one"] < widths["both"]


def test_groups_of_one_row_each_are_rows():
    values = noise(200)
    alone = metrics.bootstrap(torch.mean, values, groups=torch.arange(200).flip(0) * 7 - 3)  # any ids will do
    assert alone == pytest.approx(metrics.bootstrap(torch.mean, values), abs=0.03)
    copied = metrics.bootstrap(torch.mean, values.repeat_interleave(9), groups=torch.arange(200).repeat_interleave(9))
    assert copied == pytest.approx(metrics.bootstrap(torch.mean, values), abs=1e-9)  # copies tell nothing new
    with_one_style = metrics.bootstrap(torch.mean, values, groups=(torch.arange(200), torch.zeros(200)))
    assert with_one_style == pytest.approx(metrics.bootstrap(torch.mean, values), abs=0.03)


def test_draws_that_miss_every_row_are_drawn_again_and_short_ones_repeated():
    values, ids = torch.tensor([1.0, 2.0, 3.0]), torch.arange(3)  # three transfers that share no clip
    least = []
    found = metrics.bootstrap(lambda x: least.append(len(x)) or x.mean(), values, groups=(ids, ids), repeats=100)
    assert found.low == 1 and found.high == 3 and min(least) >= 3


@pytest.mark.parametrize(
    "groups, message",
    [
        (torch.arange(5), r"an id for each of 8 rows; found \[5\]"),
        ((torch.arange(8), torch.arange(8)[None]), r"found \[1, 8\]"),
        ((torch.zeros(8), torch.ones(8)), "all rows are of one group"),
        (["walk"] * 8, "found a str"),
        ([0] * 8, "found a int"),
    ],
)
def test_groups_that_do_not_fit(groups, message):
    with pytest.raises(mk.MotionKitError, match=message):
        metrics.bootstrap(torch.mean, noise(8), groups=groups)


def test_centred_intervals_hold_the_value_of_statistics_that_repeats_drive_up():
    made, real = noise(120, 12), noise(400, 12, seed=1) + 0.2
    plain, centred = (
        metrics.bootstrap(lambda x: metrics.fmd(x, real), made, repeats=200, centred=c) for c in (False, True)
    )
    assert plain.low > plain.value  # what is wrong without: drawn rows repeat, and FMD rises with every repeat
    assert centred.low < centred.value < centred.high and centred.value == plain.value
    assert centred.high - centred.low == pytest.approx(plain.high - plain.low)
    known = [metrics.fmd(noise(120, 12, seed=n), real) for n in range(2, 202)]  # the experiment itself, made again
    spread = torch.quantile(torch.tensor(known), torch.tensor([0.025, 0.975])).diff().item()
    assert centred.high - centred.low == pytest.approx(spread, rel=0.35)


def test_fmd_of_a_whole_table_has_its_interval_in_seconds():
    made, real = noise(3780, 64).float(), noise(290, 64, seed=1).float()
    groups = (torch.arange(3780) // 54, torch.arange(3780) % 70)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        start = time.process_time()
        found = metrics.bootstrap(lambda x: metrics.fmd(x, real), made, groups=groups, repeats=200, centred=True)
        seconds = time.process_time() - start
    finally:
        torch.set_num_threads(threads)
    assert found.low < found.value < found.high
    assert seconds < 5


def test_bootstrap_counts_rows_that_are_not_finite():
    values = noise(50)
    values[[1, 2, 30]] = torch.nan
    with pytest.raises(mk.MotionKitError, match="of the rows given to it 3 of 50 are not"):
        metrics.bootstrap(torch.mean, values)
    with pytest.raises(mk.MotionKitError, match="samples as a torch tensor; found a list"):
        metrics.bootstrap(torch.mean, [1.0, 2.0])
    for wrong in ({"level": "95"}, {"repeats": 2.5}, {"repeats": 3}):
        with pytest.raises(mk.MotionKitError, match="level between 0 and 1 and 10 repeats"):
            metrics.bootstrap(torch.mean, noise(5), **wrong)


def test_spread_prints_as_in_the_papers():
    found = metrics.spread([58.8, 60.86, 62.92])
    assert str(found) == f"{found}" == "60.86±2.06" and f"{found:.0f}" == "61±2"
    assert found == pytest.approx((60.86, 2.06, 3))
    assert metrics.spread(noise(20000) * 3 + 1) == pytest.approx((1, 3, 20000), abs=0.06)
    assert metrics.spread(torch.full((4,), 7.0)).std == 0
    for values, message in (
        ([60.0], "two repeats or more"),
        ([[1.0, 2.0]], "two repeats or more"),
        ([1.0, math.nan], "1 of 2 rows of the repeats are not finite"),
        (["a", "b"], "one number a repeat"),
        (60.0, "two repeats or more"),
    ):
        with pytest.raises(mk.MotionKitError, match=message):
            metrics.spread(values)


def test_accuracy_over_repeats():
    labels, right = torch.arange(8) % 4, torch.eye(4).repeat(2, 1)
    shuffled = right.roll(1, 0)
    assert metrics.repeated_accuracy([right, right, right], labels) == (100, 0, 3)
    assert metrics.repeated_accuracy([right, shuffled], labels) == pytest.approx((50, 100 / 2**0.5, 2))
    assert metrics.repeated_accuracy([right, right[:3]], [labels, labels[:3]]).mean == 100  # repeats of their own size
    assert metrics.repeated_accuracy(torch.stack([right, shuffled]), torch.stack([labels, labels.roll(1)])).mean == 100
    with pytest.raises(mk.MotionKitError, match="2 repeats of scores, 1 of labels"):
        metrics.repeated_accuracy([right, right], [labels])


def test_what_is_not_finite_is_counted():
    values = noise(6, 2, 3)
    values[1, 0, 2], values[4, 1, 1] = torch.nan, torch.inf
    assert metrics.finite_rows(values).tolist() == [True, False, True, True, False, True]
    assert metrics.finite_share(values) == (4 / 6, 4, 6) and str(metrics.finite_share(values)) == "without 2 of 6"
    assert str(metrics.finite_share(noise(5))) == "all 5" and len(metrics.finite_rows(torch.zeros(0, 3))) == 0
    walk = mk.load("data/actor/walk_neutral.bvh")
    broken = walk[:10]
    broken.rotations[3, 2, 0] = torch.nan
    assert metrics.finite_rows([walk, None, broken]).tolist() == [True, False, False]
    assert metrics.finite_share([]).count == 0
    for wrong in (walk, "walk.bvh", [walk, "walk.bvh"], torch.tensor(1.0)):
        with pytest.raises(mk.MotionKitError, match="finite_rows: expected a tensor"):
            metrics.finite_share(wrong)


# function, what stands there, what a careless hand might write, and how the test begins that must notice
MUTANTS = [
    ("fmd", "- 2 * inner.sqrt().sum()", "", "fmd_against_scipy"),
    ("fmd", "((mean_a - mean_b) ** 2).sum() + ", "", "fmd_against_scipy"),
    ("gaussian", "(x - mean).T @ (x - mean)", "x.T @ x", "fmd_against_scipy"),
    ("gaussian", "/ (count - 1)", "* 0", "fmd_against_scipy"),
    ("style_fmd", '_classifier(judge, "style")', '_classifier(judge, "content")', "fmd_of_motions_is"),
    ("recognition_accuracy", "& torch.isfinite(scores).all(1)", "", "recognition_counts"),
    ("recognition_accuracy", "scores.argmax(1)", "scores.argmin(1)", "recognition_counts"),
    ("confusion", "[known]", "", "recognition_counts"),
    ("repeated_accuracy", "recognition_accuracy(*repeat)", "0.5", "accuracy_over_repeats"),
    ("spread", "figures.std()", "figures.std(correction=0)", "spread_prints"),
    ("finite_rows", ".all(1)", ".any(1)", "what_is_not_finite"),
    ("pair_similarities", "x / length", "x", "text_similarity"),
    ("foot_contact_accuracy", "standing == contacts", "standing != contacts", "feet"),
    ("foot_sliding_factor", "result, contacts)", "result, None)", "feet"),
    ("trajectory_similarity", ".at_origin()", "", "trajectories"),
    ("jitter", "3 * positions[1:-2]", "2 * positions[1:-2]", "soundness"),
    ("bone_length_error", "motion.skeleton.offsets[1:]", "0 * motion.skeleton.offsets[1:]", "soundness"),
    ("penetration", "ground - lowest", "lowest - ground", "soundness"),
    ("local_diversity", ".amin(1)", ".mean(1)", "diversity"),
    ("global_diversity", "best[start] + piece", "piece", "diversity"),
    ("bands", "(rates < high)", "(rates < 99)", "speed_bands"),
    ("bootstrap", "sample[rows]", "sample", "intervals_hold_the_truth"),
    ("bootstrap", "(1 - level) / 2", "1 - level", "intervals_hold_the_truth"),
    ("bootstrap", "_factors(groups, count) or ", "", "rows_that_share_clips"),
    ("_draw_rows", "times * torch.bincount", "torch.bincount", "rows_that_share_clips"),
    ("_draw_rows", "(sizes,), generator", "(1,), generator", "rows_that_share_clips"),
    ("bootstrap", "draws - draws.median() + value", "draws", "centred_intervals"),
]


def mutant(module: object, name: str, old: str, new: str) -> object:
    """A function of a module with a piece of its source replaced."""
    source = inspect.getsource(getattr(module, name))
    assert old in source, f"{name} no longer says {old!r}: choose another mutation"
    scope: dict[str, object] = {}
    exec("from __future__ import annotations\n" + source.replace(old, new), vars(module), scope)
    return scope[name]


def known_answers(beginning: str):
    """The one test whose name begins so."""
    (test,) = (value for name, value in globals().items() if name.startswith(f"test_{beginning}"))
    return test


@pytest.mark.slow
@pytest.mark.parametrize("name, old, new, beginning", MUTANTS)
def test_a_mutated_metric_is_caught(name, old, new, beginning, monkeypatch, request):
    test = known_answers(beginning)
    fixtures = [request.getfixturevalue(fixture) for fixture in inspect.signature(test).parameters]
    monkeypatch.setattr(metrics, name, mutant(metrics, name, old, new))
    with pytest.raises((AssertionError, pytest.fail.Exception)):
        test(*fixtures)
