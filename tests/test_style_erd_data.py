"""What Style-ERD learns from: windows, pairs in time, and the batches that are drawn of them."""

from dataclasses import replace

import pytest
import torch
from style_erd_small import four_clips

import motionkit as mk
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.features.style_erd import frames_of
from motionkit.methods.style_erd_data import Draw, Windows


@pytest.fixture(scope="module")
def data():
    return four_clips()


@pytest.fixture(scope="module")
def windows(data):
    return Windows.of(data, 30.0)


@pytest.fixture(scope="module")
def paired(data):
    return Windows.of(data, 30.0, paired=True)


def test_windows_are_as_the_paper_cuts_them(data, windows):
    assert windows.styles[0] == "neutral" and set(windows.styles) == {"neutral", "old", "proud"}
    frames = [len(clip) for clip in data]
    assert len(windows.x) == sum((n - 24) // 20 + 1 for n in frames) and windows.x.shape[1:] == (24, 220)
    assert torch.equal(windows.x[0, 20:, :154], windows.x[1, :4, :154])  # they overlap by four frames
    assert not windows.x[:, 0, 154:].any() and windows.x[:, 1, 154:].any()
    with pytest.raises(mk.MotionKitError, match="needs a neutral style"):
        Windows.of(data.filter(style="old"), 30.0)
    with pytest.raises(mk.MotionKitError, match="no clip of 'mine' has 9000 frames at 30 a second"):
        Windows.of(data, 30.0, 9000)


def test_a_burn_in_is_what_the_clip_did_before_the_window(data, windows):
    clip = frames_of(data[0].motion).x
    assert windows.window_index[:3].tolist() == [0, 1, 2] and len(windows.initial_velocity) == len(windows.x)
    assert torch.equal(windows.mid_stream(torch.tensor([2]))[0], clip[40:64])
    before = windows.burn_in(torch.tensor([2]), 2)[0]
    assert torch.equal(before[1:], clip[1:40]) and not before[0, 154:].any()
    assert torch.equal(windows.burn_in(torch.tensor([2]), 1)[0, 1:], clip[21:40])
    longer = Draw(windows, 6, burn_in=3)
    torch.manual_seed(0)
    drawn = [longer.back() for _ in range(60)]
    assert set(drawn) == {0, 1, 2, 3} and 15 < drawn.count(0) < 45
    assert all(int(windows.window_index[longer.choose(2)[0]].min()) >= 2 for _ in range(5))
    others = Draw(windows, 6), Draw(windows, 6, burn_in=3, unpaired=True)
    assert {draw.back() for _ in range(9) for draw in others} == {0}


def test_batches_begin_a_stream_or_are_in_the_middle_of_one(windows):
    draw, kinds = Draw(windows, 6, burn_in=3), set()
    for seed in range(12):
        torch.manual_seed(seed)
        batch = draw(0)
        warm = batch["burn_in"] is not None
        kinds.add(warm)
        assert bool(batch["x"][:, 0, 154:].any()) is bool(batch["real"][:, 0, 66:].any()) is warm
        assert batch["x"].shape == batch["pair"].shape == (6, 24, 220) and batch["real"].shape == (6, 24, 132)
        assert batch["offsets"].shape == (6, 1, 22, 3) and batch["has_pair"].dtype == torch.bool
        if warm:
            assert batch["burn_in"].shape[0] == 6 and batch["burn_in"].shape[1] in (20, 40, 60)
        torch.manual_seed(seed)
        again = draw(1)  # by torch's random numbers alone, so that a resumed run draws the same
        assert torch.equal(batch["x"], again["x"]) and torch.equal(batch["real"], again["real"])
    assert kinds == {False, True}


def test_pairs_do_the_same_in_step(data, windows, paired):
    captured = paired.num_captured
    assert torch.equal(paired.x[:captured], windows.x) and windows.num_captured == len(windows.x)
    assert (windows.paired_with == -1).all()
    walks = torch.nonzero(paired.style)[:, 0]
    assert len(paired.x) - captured == len(walks) and (paired.paired_with[walks] >= captured).all()
    warped = torch.arange(captured, len(paired.x))
    assert torch.equal(paired.paired_with[paired.paired_with[warped]], warped) and not paired.style[warped].any()
    for labels in (paired.content, paired.window_index):
        assert torch.equal(labels[warped], labels[paired.paired_with[warped]])
    feet = list(data[0].motion.skeleton.feet())
    both = paired.x[walks], paired.x[paired.paired_with[walks]]
    ahead = [x[..., 88:154].unflatten(-1, (22, 3))[:, :, feet, 2] for x in both]
    together, chance = ((ahead[0] - other).abs().mean() for other in (ahead[1], ahead[1].roll(1, 0)))
    assert together < 0.7 * chance  # the same foot is in front


def test_a_clip_that_nobody_does_neutrally_has_no_pair():
    kinds = [("walk", "neutral"), ("kick", "old")]
    clips = [Item(c, Labels(c, s, ()), BvhSource.at(f"data/actor/walk_{s}.bvh")) for c, s in kinds]
    windows = Windows.of(from_items("mine", clips), 30.0, paired=True)
    assert (windows.paired_with == -1).all() and windows.num_captured == len(windows.x)


def test_who_has_a_pair_is_restyled_in_its_style_and_critics_see_captures_alone(paired):
    draw = Draw(paired, 6)
    torch.manual_seed(0)
    for _ in range(10):
        chosen, target = draw.choose()
        pair = paired.paired_with[chosen]
        assert torch.equal(target[pair >= 0], paired.style[pair[pair >= 0]])
    assert max(int(rows.max()) for rows in (*paired.members.values(), *paired.by_style.values())) < paired.num_captured
    torch.manual_seed(0)
    chosen, _ = draw.choose(draw.back())
    torch.manual_seed(0)
    batch, pair = draw(0), paired.paired_with[chosen]
    assert torch.equal(batch["has_pair"], pair >= 0) and batch["has_pair"].any()
    assert torch.equal(batch["pair"][pair >= 0], paired.x[pair[pair >= 0]])


def test_neutral_goes_to_any_style_that_its_content_has_and_styles_to_neutral(windows):
    draw, kinds = Draw(windows, 6), set()
    torch.manual_seed(0)
    for _ in range(40):
        chosen, target = draw.choose()
        labels = zip(windows.content[chosen].tolist(), windows.style[chosen].tolist(), target.tolist())
        kinds |= {(windows.contents[c], windows.styles[s], windows.styles[t]) for c, s, t in labels}
    assert kinds == {("walk", "neutral", "old"), ("walk", "neutral", "proud"), ("walk", "old", "neutral"),
                     ("walk", "proud", "neutral"), ("jump", "neutral", "neutral")}  # fmt: skip
    batch = draw(0)
    assert torch.equal(batch["real_content"], batch["content"])  # real motion does the same, in the target style


def test_unpaired_no_style_need_have_the_content(windows):
    draw, kinds = Draw(windows, 6, unpaired=True), {}
    torch.manual_seed(0)
    for _ in range(40):
        batch = draw(0)
        for content, target, real in zip(*(batch[name].tolist() for name in ("content", "target", "real_content"))):
            kinds.setdefault((windows.contents[content], windows.styles[target]), set()).add(windows.contents[real])
    assert kinds["jump", "old"] == kinds["jump", "proud"] == {"walk"}  # nobody jumps in these styles


def test_contents_that_nobody_does_neutrally_are_left_out(data):
    windows = Windows.of(data, 30.0)
    lonely = int(windows.content[windows.style > 0][0])
    kept = (windows.content != lonely) | (windows.style > 0)  # nobody does this content neutrally any more
    rows = {name: getattr(windows, name)[kept] for name in ("x", "content", "style", "offsets", "window_index",
                                                            "initial_velocity", "paired_with")}  # fmt: skip
    draw = Draw(replace(windows, **rows, num_captured=int(kept.sum())), 6)
    assert not draw.usable.all() and all(lonely not in draw(step)["content"] for step in range(8))
    styled = replace(draw.windows, **{name: value[draw.windows.style > 0] for name, value in
                                      {name: getattr(draw.windows, name) for name in rows}.items()})  # fmt: skip
    with pytest.raises(mk.MotionKitError, match="take a config with cycle above 0"):
        Draw(styled, 6)(0)
