"""How Style-ERD learns: windows, whom a window is told as, two networks in one loop that do not disturb each other."""

from dataclasses import replace

import pytest
import torch

import motionkit as mk
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.methods import style_erd
from motionkit.methods import style_erd as recipes
from motionkit.methods.style_erd import (
    ABLATIONS,
    Config,
    ErdConfig,
    FTAttDiscriminator,
    MultiClassDiscriminator,
    Pair,
    StyleErd,
    StyleErdLoss,
    Windows,
    evaluate_model,
    frames_of,
    lowest_foot,
    placed_positions,
    split,
    train_content_classifier,
    train_erd,
    train_model,
)
from motionkit.methods.style_erd_stream import FrameClassifier, LabelTracker, label_accuracy, train_frame_classifier

SMALL = Config(ErdConfig.tiny(), steps=4, batch=6, rate=1e-3, fps=30.0)


def four_clips():
    """Four clips."""
    kinds = [("walk", "neutral"), ("walk", "old"), ("walk", "proud"), ("jump", "neutral")]
    paths = [(f"data/actor/{content}_{style}.bvh", content, style) for content, style in kinds]
    return from_items("mine", [Item(path[11:-4], Labels(c, s, ()), BvhSource.at(path)) for path, c, s in paths])


@pytest.fixture(scope="module")
def data():
    return four_clips()


@pytest.fixture(scope="module")
def course(data):
    pieces = Windows.of(data, 30.0)
    return StyleErdLoss(pieces, data[0].motion.skeleton, train_content_classifier(pieces, 22, steps=2, title=""), SMALL)


@pytest.fixture
def pair(course):
    torch.manual_seed(0)
    counts = len(course.pieces.contents), len(course.pieces.styles)
    return Pair(StyleErd(22, *counts, SMALL.config), FTAttDiscriminator(22, *counts), 0.5)


def test_windows_are_as_the_paper_cuts_them(data, course):
    pieces = course.pieces
    assert pieces.styles[0] == "neutral" and set(pieces.styles) == {"neutral", "old", "proud"}
    frames = [len(clip) for clip in data]
    assert len(pieces.x) == sum((n - 24) // 20 + 1 for n in frames) and pieces.x.shape[1:] == (24, 220)
    assert torch.equal(pieces.x[0, 20:, :154], pieces.x[1, :4, :154])  # they overlap by four frames
    assert not pieces.x[:, 0, 154:].any() and pieces.x[:, 1, 154:].any()
    with pytest.raises(mk.MotionKitError, match="needs a neutral style"):
        Windows.of(data.filter(style="old"), 30.0)


def test_a_run_up_is_what_the_clip_did_before_the_window(data, course):
    pieces, clip = course.pieces, frames_of(data[0].motion).x
    assert pieces.earlier[:3].tolist() == [0, 1, 2] and len(pieces.going) == len(pieces.x)
    assert torch.equal(pieces.amid(torch.tensor([2]))[0], clip[40:64])
    before = pieces.run_up(torch.tensor([2]), 2)[0]
    assert torch.equal(before[1:], clip[1:40]) and not before[0, 154:].any()
    assert torch.equal(pieces.run_up(torch.tensor([2]), 1)[0, 1:], clip[21:40])
    longer = StyleErdLoss(pieces, course.skeleton, course.contents, replace(SMALL, run_up=3))
    torch.manual_seed(0)
    drawn = [longer.back() for _ in range(60)]
    assert set(drawn) == {0, 1, 2, 3} and 15 < drawn.count(0) < 45
    assert all(int(pieces.earlier[longer.draw(2)[0]].min()) >= 2 for _ in range(5))
    cycle = StyleErdLoss(pieces, course.skeleton, course.contents, replace(SMALL, run_up=3, cycle=1.0))
    assert {one.back() for _ in range(9) for one in (course, cycle)} == {0}


@pytest.fixture(scope="module")
def twins(data):
    pieces = Windows.of(data, 30.0, registered=True)
    return StyleErdLoss(pieces, data[0].motion.skeleton, train_content_classifier(pieces, 22, steps=2, title=""), SMALL)


def test_twins_do_the_same_in_step(data, course, twins):
    pieces, plain = twins.pieces, course.pieces
    assert torch.equal(pieces.x[: pieces.recorded], plain.x) and plain.recorded == len(plain.x)
    assert (plain.twin == -1).all()
    walks = torch.nonzero(pieces.style)[:, 0]
    assert len(pieces.x) - pieces.recorded == len(walks) and (pieces.twin[walks] >= pieces.recorded).all()
    warped = torch.arange(pieces.recorded, len(pieces.x))
    assert torch.equal(pieces.twin[pieces.twin[warped]], warped) and not pieces.style[warped].any()
    for labels in (pieces.content, pieces.earlier):
        assert torch.equal(labels[warped], labels[pieces.twin[warped]])
    feet = list(twins.skeleton.feet())
    windows = pieces.x[walks], pieces.x[pieces.twin[walks]]
    ahead = [x[..., 88:154].unflatten(-1, (22, 3))[:, :, feet, 2] for x in windows]
    together, chance = ((ahead[0] - other).abs().mean() for other in (ahead[1], ahead[1].roll(1, 0)))
    assert together < 0.7 * chance  # the same foot is in front


def test_a_clip_that_nobody_does_neutrally_has_no_twin(data):
    kinds = [("walk", "neutral"), ("kick", "old")]
    clips = [Item(c, Labels(c, s, ()), BvhSource.at(f"data/actor/walk_{s}.bvh")) for c, s in kinds]
    pieces = Windows.of(from_items("mine", clips), 30.0, registered=True)
    assert (pieces.twin == -1).all() and pieces.recorded == len(pieces.x)


def test_who_has_a_twin_is_told_in_its_style_and_critics_see_recordings_alone(twins):
    pieces = twins.pieces
    torch.manual_seed(0)
    for _ in range(10):
        chosen, wanted = twins.draw()
        twin = pieces.twin[chosen]
        assert torch.equal(wanted[twin >= 0], pieces.style[twin[twin >= 0]])
    assert max(int(rows.max()) for rows in (*twins.members.values(), *twins.by_style.values())) < pieces.recorded


@torch.no_grad()
def test_a_twin_is_the_right_answer_and_costs_nothing(twins, pair):
    """The loss is 0 where the twin is told, by hand what it is elsewhere, and counts by its weight."""
    pieces, joints = twins.pieces, 22
    chosen = torch.cat((torch.nonzero(pieces.twin >= 0)[:5, 0], torch.nonzero(pieces.twin < 0)[:1, 0]))
    offsets = pieces.offsets[chosen][:, None]

    def place(turns):
        return placed_positions(twins.skeleton, offsets, turns, torch.zeros(turns.shape[:2]))

    right = pieces.x[pieces.twin[chosen]]
    turns, speeds = (part.unflatten(-1, (joints, -1)) for part in (right[..., :88], right[..., -66:]))
    assert twins._unlike_twins(chosen, False, place, place(turns), (turns, speeds)).abs().max() < 1e-3
    off = twins._unlike_twins(chosen, False, place, place(turns), (turns, speeds + 0.5))
    assert torch.allclose(off[:5], torch.full((5, 24), 0.25 * 3 * joints), atol=1e-2) and not off[5].any()
    found = []
    for weight in (0.0, 1.0, 2.0):
        torch.manual_seed(3)
        rec = replace(SMALL, adversarial=False, perceptual=False, registered=weight)
        found.append(float(StyleErdLoss(pieces, twins.skeleton, twins.contents, rec).loss(pair)))
    assert found[2] - found[1] == pytest.approx(found[1] - found[0], rel=1e-3) and found[1] > found[0]


def test_with_a_run_up_it_learns_from_the_middle_of_streams(course, pair, monkeypatch):
    seen, longer = [], StyleErdLoss(course.pieces, course.skeleton, course.contents, replace(SMALL, run_up=2))
    monkeypatch.setattr(StyleErdLoss, "back", lambda self: 2)
    hear = pair.generator.hear

    def watched(x, *rest):
        seen.append((x.shape[1], torch.is_grad_enabled()))
        return hear(x, *rest)

    monkeypatch.setattr(pair.generator, "hear", watched)
    longer.loss(pair).backward()
    assert seen == [(40, False), (24, True)]
    assert pair.generator.neutral.hidden.grad is None  # its own beginning is not what it is learning from here


@torch.no_grad()
def test_what_trembles_costs_where_steadiness_counts(course, pair):
    found = []
    for steady in (0.0, 3.0):
        torch.manual_seed(3)
        rec = replace(SMALL, adversarial=False, perceptual=False, steady=steady)
        found.append(float(StyleErdLoss(course.pieces, course.skeleton, course.contents, rec).loss(pair)))
    torch.manual_seed(3)
    chosen = StyleErdLoss(course.pieces, course.skeleton, course.contents, SMALL).draw()[0]
    x, content, style = (part[chosen] for part in (course.pieces.x, course.pieces.content, course.pieces.style))
    turns = split(pair.generator(x, content, style, pair.generator.weights_of(style))[0])[0]
    came = x[..., 88:154].unflatten(-1, (22, 3))
    low = lowest_foot(course.skeleton, came)
    off = placed_positions(course.skeleton, course.pieces.offsets[chosen][:, None], turns, low) - came
    moved = 3.0 * (off.diff(dim=1) * (30.0 / 10)).square().sum((1, 2, 3)).mean()
    assert found[1] - found[0] == pytest.approx(float(moved), rel=1e-4) and moved > 0


@torch.no_grad()
def test_with_a_skip_the_network_learns_what_comes_out_of_it(course, pair):
    """Told in its own style a window comes back whole, whatever the network says; and that is what is judged."""
    pieces, rows = course.pieces, torch.arange(4)
    skip = StyleErd(22, len(pieces.contents), len(pieces.styles), replace(SMALL.config, skip=True))
    x, content, style = (part[rows] for part in (pieces.x, pieces.content, pieces.style))
    other = (style + 1) % len(pieces.styles)
    heard, _ = skip.listen(x, content, style)
    _, same = course._answers(skip, x, heard, style, style)
    assert torch.allclose(same[1].flatten(2), x[..., 154:], atol=1e-5)
    turns = x[..., :88].unflatten(-1, (22, 4))
    assert style_erd.quaternion_loss(same[0], turns).max() < 1e-4
    rebuilt, told = course._answers(skip, x, heard, style, other)
    whole = split(skip(x, content, style, skip.weights_of(other))[0])
    assert all(torch.allclose(a, b, atol=1e-5) for a, b in zip(told, whole))
    assert style_erd.quaternion_loss(rebuilt[0], turns).min() > 1e-2


def test_neutral_goes_to_any_style_that_its_content_has_and_styles_to_neutral(course):
    torch.manual_seed(0)
    seen = set()
    for _ in range(40):
        chosen, wanted = course.draw()
        kinds = [(course.pieces.contents[c], course.pieces.styles[s]) for c, s in
                 zip(course.pieces.content[chosen].tolist(), course.pieces.style[chosen].tolist())]  # fmt: skip
        seen |= {(*kind, course.pieces.styles[w]) for kind, w in zip(kinds, wanted.tolist())}
    assert seen == {("walk", "neutral", "old"), ("walk", "neutral", "proud"), ("walk", "old", "neutral"),
                    ("walk", "proud", "neutral"), ("jump", "neutral", "neutral")}  # fmt: skip


def test_neither_network_learns_from_the_others_loss(course, pair):
    torch.manual_seed(1)
    both = {}
    for name, changed in (("all", SMALL), ("rec", replace(SMALL, adversarial=False, perceptual=False))):
        pair.zero_grad()
        torch.manual_seed(1)
        StyleErdLoss(course.pieces, course.skeleton, course.contents, changed).loss(pair).backward()
        both[name] = {key: None if w.grad is None else w.grad.clone() for key, w in pair.named_parameters()}
    assert all(grad is None for key, grad in both["rec"].items() if key.startswith("critic"))
    pair.zero_grad()
    x, none = torch.randn(2, 24, 132), torch.zeros(2, dtype=torch.long)
    style_erd.adversarial_loss(pair.judged(x, none, none)).sum()
    assert all(w.grad is None for w in pair.critic.parameters())
    assert any(float((both["all"][key] - both["rec"][key]).abs().max()) > 0 for key in both["all"] if "decoder" in key)
    assert any(float(grad.abs().max()) > 0 for key, grad in both["all"].items() if key.startswith("critic"))


def test_the_critic_has_a_rate_of_its_own(course, pair):
    from motionkit.training import TrainConfig, fit

    before = {key: value.clone() for key, value in pair.state_dict().items()}
    fit(pair, lambda model, step: course.loss(model), TrainConfig(1, 1e-3, decay=0.0, clip=1e6), title="")
    moved = {key: float((value - before[key]).abs().max()) for key, value in pair.state_dict().items()}
    # Adam's first step is as long as the rate
    assert max(v for k, v in moved.items() if k.startswith("critic")) == pytest.approx(5e-4, rel=0.01)
    assert max(v for k, v in moved.items() if k.startswith("generator")) == pytest.approx(1e-3, rel=0.01)


def test_table_1_has_its_rows_and_each_leaves_out_its_part(data, course, monkeypatch):
    full = replace(Config.laptop(), registered=0.0, config=ErdConfig.paper())
    assert list(ABLATIONS) == [
        "ours", "L_gen = L_rec", "L_gen = L_rec + L_adv", "L_gen = L_rec + L_per", "without attention",
        "without learned beginnings", "ours + twins", "ours + twins + skip",
    ]  # fmt: skip
    assert ABLATIONS["ours + twins + skip"] == Config.laptop()
    assert ABLATIONS["ours"] == full and ABLATIONS["L_gen = L_rec + L_adv"] == replace(full, perceptual=False)
    made = []
    for cls in (FTAttDiscriminator, MultiClassDiscriminator):
        monkeypatch.setattr(recipes, cls.__name__, lambda *a, cls=cls: made.append(cls) or cls(*a))
    for changes in ({}, {"attention": False}, {"beginnings": False}):
        net, run, pieces = train_erd(data, replace(SMALL, **changes), contents=course.contents, title="")
        assert len(run.losses) == 4 and not net.training
        assert bool(net.neutral.hidden.any()) is changes.get("beginnings", True)
    assert made == [FTAttDiscriminator, MultiClassDiscriminator, FTAttDiscriminator]


def test_rebuilding_is_learned(data, course):
    recipe = replace(SMALL, steps=60, rate=1e-2, adversarial=False, perceptual=False)
    _, run, _ = train_erd(data, recipe, contents=course.contents, title="")
    assert sum(run.losses[-5:]) < 0.6 * sum(run.losses[:5])


def test_with_a_cycle_no_style_need_have_the_content(course, pair):
    free = StyleErdLoss(course.pieces, course.skeleton, course.contents, replace(SMALL, cycle=1.0))
    torch.manual_seed(0)
    seen = set()
    for _ in range(40):
        chosen, wanted = free.draw()
        labels = zip(course.pieces.content[chosen].tolist(), wanted.tolist())
        seen |= {(course.pieces.contents[c], course.pieces.styles[w]) for c, w in labels}
    assert ("jump", "old") in seen and ("jump", "proud") in seen
    jump, old = (torch.tensor([kind.index(name)] * 3) for kind, name in
                 ((course.pieces.contents, "jump"), (course.pieces.styles, "old")))  # fmt: skip
    real, theirs = free.real(jump, old)
    assert real.shape == (3, 24, 132) and bool((theirs != jump).all())  # of walks, since nobody jumps in this style
    losses = []
    for recipe in (replace(SMALL, cycle=1.0), replace(SMALL, cycle=2.0)):
        torch.manual_seed(2)
        losses.append(float(StyleErdLoss(course.pieces, course.skeleton, course.contents, recipe).loss(pair).detach()))
    assert losses[1] > losses[0]
    net, run, _ = train_erd(four_clips(), replace(SMALL, cycle=1.0), contents=course.contents, title="")
    assert len(run.losses) == SMALL.steps and all(torch.isfinite(w).all() for w in net.parameters())


def test_a_model_is_trained_and_measured(data):
    model = train_model(data, SMALL, label_steps=3, title="")
    assert model.styles[0] == "neutral" and model.labeller is not None and model.card["batch"] == 6
    found = evaluate_model(model, data)
    assert found["rebuilt_mm"] > 0 and set(found) == {"rebuilt_mm", "content", "style", "first_content", "first_style"}
    assert all(0 <= found[name] <= 100 for name in found if name != "rebuilt_mm")
    assert train_model(data, SMALL, label_steps=0, title="").labeller is None


def test_labels_are_learned(data):
    pieces = Windows.of(data, 30.0, 60)
    before, after = FrameClassifier(22, 2, 3), train_frame_classifier(pieces, 22, steps=150, title="")
    assert (
        label_accuracy(after, pieces)["content"] > 85
        and label_accuracy(after, pieces)["style"] > label_accuracy(before, pieces)["style"]
    )
    guesses = LabelTracker(after)
    for frame in pieces.x[int((pieces.content == pieces.contents.index("jump")).nonzero()[0])].numpy():
        guesses.hear(frame[None])
    assert pieces.contents[int(guesses.content[0])] == "jump"
