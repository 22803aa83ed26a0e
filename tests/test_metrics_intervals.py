"""Intervals, spreads and counts of what is missing, against experiments whose spread is known."""

import math
import time

import pytest
import torch

import motionkit as mk
from motionkit import metrics


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


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
