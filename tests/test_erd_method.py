"""Style-ERD as a method: whole clips, other rates and bodies, labels, a style more from one clip."""

import pytest
import torch
from erd_small import CONTENTS, small_model

import motionkit as mk
from motionkit.actor import perform, retell
from motionkit.arena.transfers import error_against
from motionkit.methods.style_erd import StyleErdMethod
from motionkit.methods.style_erd_new_style import StyleBranch, learn_style
from motionkit.methods.style_erd_stream import ErdStream
from motionkit.metrics import truth_error

SAID = {"content_label": "walk", "content_style": "neutral"}


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "neutral", seed=2, seconds=2.0).motion


@pytest.fixture(scope="module")
def method():
    return StyleErdMethod(small_model())


def test_a_clip_is_what_its_stream_gives(method, walk):
    made = method.stylize(walk, "old", lock=False, **SAID)
    stream = method.stream("old", content="walk", own_style="neutral")
    frames = [stream(walk[n : n + 1]).positions() for n in range(len(walk))]
    moved = made.positions() - torch.cat(frames)
    assert float((moved - moved[:1, :1]).abs().max()) < 1e-4  # but for where it begins
    assert made.name.endswith("as old") and made.skeleton is walk.skeleton
    assert isinstance(stream, ErdStream)


def test_other_rates_and_bodies_come_back_as_they_were(method):
    faster = perform("walk", "neutral", seed=1, seconds=2, fps=50).motion
    for motion in (mk.load("data/actor/walk_neutral.bvh"), faster):
        made = method.stylize(motion, "proud", **SAID)
        assert (len(made), made.fps) == (len(motion), motion.fps) and made.skeleton.same_tree(motion.skeleton)
        assert bool(made.positions().isfinite().all())
        start = made.root_path()[0] - motion.root_path()[0]
        assert float(start.norm()) < 0.05
    with pytest.raises(mk.MotionKitError):
        method.stylize(mk.load("data/actor/dog_trot_neutral.bvh"), "old", **SAID)


def test_mixes_strengths_and_names(method, walk):
    whole, half, none = (method.stylize(walk, "old", s, lock=False, **SAID).positions() for s in (1.0, 0.5, 0.0))
    neutral = method.stylize(walk, "neutral", lock=False, **SAID).positions()
    assert torch.equal(none, neutral)
    assert not torch.equal(half, whole) and not torch.equal(half, none)
    mixed = method.stylize(walk, {"old": 0.5, "proud": 0.5}, **SAID)
    assert mixed.name.endswith("as old + proud")
    with pytest.raises(mk.MotionKitError, match="did you mean 'proud'"):
        method.stylize(walk, "prud", **SAID)
    with pytest.raises(mk.MotionKitError, match="guesses no labels; give content_label and content_style"):
        method.stylize(walk, "old")


def test_a_mix_goes_as_fast_as_its_parts_together():
    method, clips = mk.methods.load("style-erd"), [mk.load(f"data/actor/{n}_neutral.bvh") for n in ("idle", "walk")]
    for clip in clips:
        made = [method.stylize(clip, "old", s).root_path() for s in (0.0, 0.25, 0.5, 1.0, 1.5)]
        ways = [float((path[1:] - path[:-1]).norm(dim=-1).sum()) for path in made]
        if clip is clips[0]:
            assert max(ways[:-1]) < 0.1 and ways[-1] < 0.15  # who stands, stands, if less so beyond what was learned
        else:
            assert ways == sorted(ways, reverse=True) and ways[-1] < 0.5 * ways[0]


def test_every_part_of_a_clip_is_restyled_by_what_it_does():
    method, played = mk.methods.load("style-erd"), perform("walk, jump, kick", "neutral", seed=3, seconds=11)
    labels, style = method._labelled(method.seen(played.motion), None, None)
    assert {"walk", "jump", "kick"} <= set(labels) and style == "neutral"
    answer = retell(played, "old").time_aligned(played)
    parts, *others = (
        error_against(method.stylize(played.motion, "old", content_label=label), answer)
        for label in (None, "walk", "jump", "kick", "wave")
    )
    assert parts < min(others) and parts < 0.8 * others[-1]


def test_labels_are_guessed_and_a_clip_may_lend_its_style(walk):
    knowing = StyleErdMethod(small_model(labels=True))
    label, own = knowing.recognised(walk)
    assert label in CONTENTS
    made = knowing.stylize(walk, "old")
    said = knowing.stylize(walk, "old", content_label=label, content_style=own)
    assert torch.equal(made.rotations, said.rotations)
    lent = knowing.stylize(walk, walk, content_label="walk", content_style="neutral")
    named = knowing.stylize(walk, own, content_label="walk", content_style="neutral")
    assert torch.equal(lent.rotations, named.rotations) and lent.name == f"{walk.name} as {walk.name}"


@pytest.mark.parametrize("skip", [False, True])
def test_a_new_branch_stands_beside_the_others_which_stay(skip):
    model = small_model(skip=skip)
    branch = StyleBranch(model.network, like=2)
    with torch.no_grad():
        branch.told += 0.3
    wider, x = branch.beside(), torch.randn(1, 6, 220)
    content, style = torch.tensor([1]), torch.tensor([0])
    for name in (1, 2):
        same = [net(x, content, style, net.weights_of(torch.tensor([name])))[0] for net in (model.network, wider)]
        assert torch.allclose(*same, atol=1e-5)
    new = wider(x, content, style, wider.weights_of(torch.tensor([3])))[0]
    assert torch.allclose(new, branch(x, content, style), atol=1e-5)


def test_with_a_skip_who_is_told_in_his_own_style_moves_as_he_did(walk):
    method = StyleErdMethod(small_model(skip=True))
    played = walk.resample(30.0)
    for asked in ({"style": "neutral"}, {"style": "old", "strength": 0.0}):
        made = method.stylize(played, lock=False, **asked, **SAID)
        assert (made.positions() - played.positions())[1:, 1:].norm(dim=-1).max() < 0.01
    assert (method.stylize(played, "old", lock=False, **SAID).positions() - played.positions()).abs().max() > 0.02


def test_one_clip_teaches_a_style_more(walk):
    model, played = small_model(skip=True), perform("walk", "neutral", seed=3, seconds=2.0)
    angry = retell(played, "angry").time_aligned(played)
    wider, run = learn_style(model, "angry", angry, played.motion, "walk", title="")
    assert sum(run.losses[-20:]) < 0.98 * sum(run.losses[:20])  # a decoder by chance can say little
    assert wider.styles == (*model.styles, "angry") and len(model.styles) == 3
    old = [StyleErdMethod(one).stylize(walk, "old", **SAID).rotations for one in (model, wider)]
    assert torch.allclose(*old, atol=1e-4)
    with pytest.raises(mk.MotionKitError, match="knows a style 'old' already"):
        learn_style(model, "old", angry, played.motion, "walk")
    with pytest.raises(mk.MotionKitError, match="in step with it"):
        learn_style(model, "new", angry[:10], played.motion, "walk")


def test_a_style_learned_from_a_walk_carries_nobody_along_who_stands():
    """A bow at rest, in a style that the shipped model has learned from somebody walking: two metres, once."""
    model, played = mk.methods.load("style-erd").model, perform("walk", "neutral", seed=3, seconds=4, fps=60)
    zombie = retell(played, "zombie").time_aligned(played)
    wider, _ = learn_style(model, "zombie", zombie, played.motion, "walk", title="")
    bow = perform("bow", "neutral", seed=31, seconds=4, fps=60)
    said = {"content_label": "bow", "content_style": "neutral"}
    made = StyleErdMethod(wider).stylize(bow.motion, "zombie", lock=False, **said)
    way = made.root_path() - bow.motion.root_path()
    assert float((way - way[:1]).norm(dim=-1).max()) < 0.5
    after, before = (truth_error(motion, retell(bow, "zombie"), bow).mean() for motion in (made, bow.motion))
    assert after < 0.8 * before
