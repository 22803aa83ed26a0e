"""The few-shot method as a user calls it: learn from a clip, restyle any other one, and what it refuses."""

from dataclasses import replace

import pytest
import torch

import motionkit as mk
from motionkit.actor import perform, retell
from motionkit.arena.transfers import error_against
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.layers import Denoiser
from motionkit.methods.few_shot import LearnedStyle, LoRA, Recipe

QUICK = Recipe(steps=2, batch=1, pair_steps=10)


@pytest.fixture(scope="module")
def library():
    path = "data/actor/walk_neutral.bvh"
    return from_items("mine", [Item("walk", Labels("walk", "neutral", ("a person is walking",)), BvhSource.at(path))])


@pytest.fixture(scope="module")
def method(library):
    return mk.methods.load("few-shot", library=library, recipe=QUICK)


@pytest.fixture(scope="module")
def plain(method) -> LearnedStyle:
    """A style that changes nothing in the prior."""
    return LearnedStyle(method.prior, LoRA(method.prior.network, 1), method.chain, "an old person walks", "old")


def test_learn_then_stylize(method):
    old, walk = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("old", "neutral"))
    learned = method.learn(old, "an old person walks", title="")
    assert (learned.style, learned.card["steps"]) == ("old", 2)
    out = method.stylize(walk)
    assert (len(out), out.fps, out.skeleton.names) == (len(walk), walk.fps, walk.skeleton.names)
    assert out.name == "walk_neutral as old"
    again = method.stylize(walk, style=learned)
    assert torch.equal(out.rotations, again.rotations)
    assert method.stylize(walk, strength=0).rotations is walk.rotations
    half = method.stylize(walk, strength=0.5)
    both = method.stylize(walk, style={learned: 0.5})
    assert torch.allclose(half.rotations, both.rotations, atol=1e-5)


def test_names_mix_and_a_clip_needs_no_sentence_in_the_space():
    method, walk = mk.methods.load("few-shot"), mk.load("data/actor/walk_neutral.bvh")
    both = method.stylize(walk, style={"old": 0.5, "proud": 0.5})
    assert both.name == "walk_neutral as old + proud"
    ends = [method.stylize(walk, style=name) for name in ("old", "proud")]
    gaps = [float((both.positions() - one.positions()).norm(dim=-1).mean()) for one in ends]
    assert max(gaps) < float((ends[0].positions() - ends[1].positions()).norm(dim=-1).mean())
    quick = method.with_recipe(steps=1).learn(mk.load("data/actor/walk_old.bvh"), title="")
    assert quick.style == "walk_old" and "walk" in quick.prompt
    old = mk.load("data/actor/walk_old.bvh")
    funky = method.with_recipe(steps=1).learn(old, "a person walks in a funky style", title="")
    assert funky.style == "funky" and "funky" in funky.prompt


def test_twice_a_style_goes_slower_still_where_the_style_is_slow():
    method, walk = mk.methods.load("few-shot"), mk.load("data/actor/walk_neutral.bvh")
    made = [method.stylize(walk, style="old", strength=s, caption="a person walks") for s in (0, 0.5, 1, 1.5, 2)]
    ways = [float((m.root_path()[-1] - m.root_path()[0]).norm()) for m in made]
    assert ways == sorted(ways, reverse=True) and ways[-1] > 0.5


def test_a_file_of_the_style_does_the_same(method, tmp_path):
    learned = method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="")
    walk = mk.load("data/actor/walk_neutral.bvh")
    before = method.stylize(walk)
    method.load_style(learned.save(tmp_path / "old.safetensors"))
    assert float((method.stylize(walk).positions() - before.positions()).abs().max()) < 0.02


def test_a_neutral_prompt_leaves_the_content(method, plain):
    """Forwards and back by the same prior with nearly the same words is the content again."""
    walk = perform("walk", "neutral", seed=9, seconds=4.0).motion
    same = replace(plain)  # a copy: other tests have the style as it is
    same.predict = lambda caption: method.prior.predict([caption], 1.0)  # told nothing of a style
    out = method.stylize(walk, style=same, caption="a person is walking neutrally", lock=False)
    gap = torch.linalg.vector_norm(out.at_origin().positions() - walk.at_origin().positions(), dim=-1)
    assert float(gap.mean()) < 0.05


def test_any_frame_rate_and_any_length(method, plain):
    long = perform("walk", "neutral", seed=3, seconds=12.0).motion
    fast, plain = long.resample(60), replace(plain)
    plain.predict = lambda caption: method.prior.predict([caption], 1.0)  # so that jumps come from windows alone
    slow, quick = (method.stylize(m, style=plain, caption="a person is walking") for m in (long, fast))
    assert (len(slow), len(quick), quick.fps) == (len(long), len(fast), 60)
    gap = quick.resample(30).positions()[: len(slow)] - slow.positions()[: len(quick.resample(30))]
    assert float(gap.abs().mean()) < 0.03
    jumps = torch.linalg.vector_norm(slow.positions().diff(n=2, dim=0), dim=-1).amax(1)
    theirs = torch.linalg.vector_norm(long.positions().diff(n=2, dim=0), dim=-1).amax(1)
    assert float(jumps.max()) < 2 * float(theirs.max())  # no seam between windows


def test_content_that_is_styled_is_made_neutral_first():
    made = perform("walk", "old", seed=5, seconds=4.0)
    exact = retell(made, "neutral").time_aligned(made)
    slow = mk.methods.load("few-shot", library=None, recipe=Recipe(pair_steps=100))
    style = LearnedStyle(slow.prior, LoRA(slow.prior.network, 1), slow.chain, "an old person walks", "old")
    style.predict = lambda caption: slow.prior.predict([caption], 1.0)
    how = {"caption": "a person is walking", "lock": False}
    as_it_is = slow.stylize(made.motion, style=style, **how)
    neutral = slow.stylize(made.motion, style=style, content_style="old", **how)
    assert error_against(neutral, exact) < 0.6 * error_against(as_it_is, exact)


def test_neutral_motion_keeps_the_path_or_goes_with_the_movements(method):
    old = perform("walk", "old", seed=5, seconds=4.0).motion
    kept, warped = (method.neutral_motion(old, "an old person is walking", warp=w, lock=False) for w in (False, True))
    assert float((kept.root_path() - old.root_path()).abs().max()) < 0.05
    assert torch.allclose(kept.rotations, warped.rotations, atol=1e-5) and kept.name == f"{old.name}, neutral"


def test_another_skeleton_is_retargeted(method, plain, captures_dir):
    walk = mk.load(captures_dir / "dataset-2_walk_normal_001.bvh")[:90]
    out = method.stylize(walk, style=plain, caption="a person is walking")
    assert out.skeleton.names == walk.skeleton.names and len(out) == len(walk)
    learned = method.learn(walk, "an old person walks", title="")
    assert learned.neutral.shape[1] == method.prior.layout.size


def test_a_library_on_another_skeleton_serves_the_semantic_loss(captures_dir):
    path = captures_dir / "dataset-2_walk_normal_001.bvh"
    item = Item("walk", Labels("walk", "normal", ("a person is walking",)), BvhSource.at(path))
    method = mk.methods.load("few-shot", library=from_items("captured", [item]), recipe=QUICK)
    learned = method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="")
    assert learned.style == "old" and method._neutral_contents().clean.shape[2] == method.prior.layout.size


def test_the_caption_is_found(method):
    kick = perform("kick", "neutral", seed=1, seconds=4.0).motion
    assert "kick" in method.caption_of(kick)


def test_knn_pairs(library):
    method = mk.methods.load("few-shot", library=library, recipe=Recipe(steps=1, batch=1, pair="knn-dtw"))
    learned = method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", content="walk", title="")
    assert learned.neutral.isfinite().all()


def test_in_the_arena(library):
    test = mk.datasets.load("actor").split().test
    few = test.filter(content=["walk", "kick"], style=["neutral", "old"])
    split = mk.datasets.Split(library, few[:0], few)
    table = mk.arena.run(
        mk.methods.load("few-shot", library=library, recipe=QUICK),
        split,
        mk.arena.Protocol("two", "neutral to styled", most=2, columns=("cra", "truth_error")),
        judge="actor",
        jobs=1,
    )
    assert table.rows[0].failed == {}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m, w: m.learn(w[:20], "an old person walks"), r"lasts 0.67 s; .* from 1 s"),
        (lambda m, w: m.learn(w, "a person walks"), "says nothing of a style"),
        (lambda m, w: m.learn(w, ""), "says nothing of a style|empty"),
        (lambda m, w: m.learn("walk.bvh", "an old person walks"), "learns a style from a Motion"),
        (lambda m, w: m.stylize(w, style="purple"), "'purple' is no style that it knows by name: .* method.learn"),
        (lambda m, w: m.stylize(w, style="zombi"), "Did you mean 'zombie'"),
        (lambda m, w: m.stylize(w, style=["old", "proud"]), "several styles are mixed with weights"),
        (lambda m, w: m.stylize(w, style="old.safetensors"), r"read it first: method.load_style\('old.safetensors'\)"),
        (lambda m, w: m.stylize(w, style="old.bvh"), r"read it first: mk.load\('old.bvh'\)"),
        (lambda m, w: m.stylize(w, style="old", strength=50), "strength must be a number from -5 to 5"),
        (lambda m, w: mk.methods.load("few-shot", recipe="laptop"), "a recipe is mk.methods.few_shot.Recipe.laptop"),
        (
            lambda m, w: mk.methods.load("few-shot", recipe=Recipe.laptop),
            "a recipe is mk.methods.few_shot.Recipe.laptop",
        ),
        (lambda m, w: mk.methods.load("few-shot", space="actor"), "space is a StyleSpace"),
        (lambda m, w: mk.methods.load("few-shot", seed="a"), "a seed is a whole number"),
        (lambda m, w: m.stylize(w, style="a person walks"), "says nothing of a style"),
        (lambda m, w: m.stylize(w, style={}), "takes learned styles, a clip, or the name of a style"),
        (lambda m, w: m.stylize(w, style=7), "takes learned styles, a clip, or the name of a style"),
        (lambda m, w: m.stylize(w, style={7: 1.0}), "takes learned styles"),
        (lambda m, w: m.stylize(w, style={"old": float("nan")}), "weight of style 'old' must be a number .* found nan"),
        (lambda m, w: m.stylize(w, style={"old": "a"}), "weight of style 'old' must be a number .* found 'a'"),
        (lambda m, w: m.learn(w), "from a clip and a sentence"),
        (lambda m, w: m.learn(w, 7), "from a clip and a sentence"),
        (lambda m, w: m.learn(w, "an old person walks", recipe=QUICK), "not 'recipe': give it to mk.methods.load"),
        (lambda m, w: m.load_style("old.bvh"), "weights are .safetensors files"),
        (lambda m, w: m.load_style(3), "weights are .safetensors files"),
        (lambda m, w: mk.methods.load("few-shot", prior="dragons"), "no checkpoint"),
        (lambda m, w: mk.methods.load("few-shot", prior=m.prior), "give its discriminator too"),
    ],
)
def test_bad_input_is_one_clear_error(method, make, message):
    with pytest.raises(mk.MotionKitError, match=message):
        make(method, mk.load("data/actor/walk_neutral.bvh"))


def test_nothing_learned_yet_and_another_prior(library, plain):
    fresh = mk.methods.load("few-shot", library=library, recipe=QUICK)
    walk = mk.load("data/actor/walk_neutral.bvh")
    with pytest.raises(mk.MotionKitError, match="no style was learned yet"):
        fresh.stylize(walk)
    other = replace(fresh.prior, network=Denoiser(199, fresh.prior.encoder.size, fresh.prior.network.config))
    theirs = LearnedStyle(other, LoRA(other.network, 1), fresh.chain, "an old person walks", "old")
    with pytest.raises(mk.MotionKitError, match="another prior"):
        fresh.stylize(walk, style=theirs)
    assert len(fresh.stylize(walk, style=plain)) == len(walk)  # loaded twice, but the same weights


def test_a_creature_is_refused(method, plain):
    dog = perform("walk", "neutral", performer="dog", seconds=3.0).motion
    with pytest.raises(mk.MotionKitError):
        method.stylize(dog, style=plain)
