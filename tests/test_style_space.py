"""A space of styles: invented styles, lessons in them, points, files, and what the shipped one can do."""

import random

import pytest
import torch

import motionkit as mk
from motionkit import checkpoints
from motionkit.actor import Style, parameters, perform, retell
from motionkit.actor.style import TRAIN_STYLES, get_style
from motionkit.arena.transfers import error_against
from motionkit.layers import Denoiser, TransformerConfig
from motionkit.methods import style_code, text_to_motion
from motionkit.methods import style_code as spaces
from motionkit.methods.few_shot import LearnedStyle, LoRA, Recipe
from motionkit.methods.style_code import (
    CODES,
    FRAMES,
    CodedDenoiser,
    GaussianCode,
    StyleCode,
    StyleCodeModel,
    beta_nll,
    code_of,
    decoder_error,
    encoder_error,
    random_style,
    style_pairs,
    train_decoder,
    train_encoder,
)
from motionkit.training import TrainConfig


@pytest.fixture(scope="module")
def prior():
    return text_to_motion.load("actor")


@pytest.fixture(scope="module")
def known(prior):
    return style_pairs(prior, 4, each=2, jobs=1)


@pytest.fixture(scope="module")
def small(prior, known):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style_code, "BATCH", 4)
        patch.setattr(style_code, "_BACK", 1)
        return train_decoder(prior, known, TrainConfig(8, 1e-3, average=0.5), title="")


def test_invented_styles_lie_in_their_ranges_and_go_beyond_those_known():
    made = [random_style(random.Random(n)) for n in range(200)]  # a Style checks its ranges itself
    for key, about in parameters().items():
        values = torch.tensor([getattr(style, key) for style in made])
        reach = max(abs(getattr(get_style(style), key) - about.neutral) for style in TRAIN_STYLES)
        far = (values - about.neutral).abs()
        assert float(far.median()) <= max(0.5 * reach, 0.25 * (about.high - about.low)) and far.max() > 0
    assert random_style(random.Random(3)) == random_style(random.Random(3))


def test_a_code_is_the_numbers_and_back(prior):
    style = get_style("zombie")
    space = StyleCodeModel(prior, CodedDenoiser(Denoiser(10, 16, TransformerConfig.tiny())), None)
    point = StyleCode(space, style)
    assert point.code.shape == (CODES + 1,) and float(point.code[-1].detach()) == 0
    assert point.style().values() == pytest.approx(style.values(), abs=1e-5)
    assert bool((code_of(Style()) == 0).all())


def test_lessons_tell_the_same_beat_in_both(prior, known):
    """Pelvis and feet of both go the same way in time, whoever's time it is; contents come in turn."""
    assert known.neutral.shape == known.styled.shape == (8, FRAMES, prior.layout.size)
    assert known.codes.shape == (8, CODES) and len(known.captions) == 8
    assert known.captions[0] == known.captions[1] != known.captions[2]
    assert bool((known.neutral != known.styled).any(2).any(1).all())
    again = style_pairs(prior, 4, each=2, jobs=1)
    assert torch.equal(again.styled, known.styled)


def test_a_space_starts_at_its_prior_and_learns(prior, known, small):
    before = decoder_error(StyleCodeModel(prior, CodedDenoiser(prior.network), small.chain), known)
    after = decoder_error(small, known)
    assert after["copied"] == before["copied"]
    assert after["styled"] < before["styled"] and after["neutral"] < before["neutral"]
    assert small.card["steps"] == 8 and small.card["lessons"] == 8
    assert text_to_motion.load("actor").network.training is False


def test_a_space_is_kept_for_its_prior_alone(prior, small, tmp_path):
    path = small.save(tmp_path / "actor-space.safetensors")
    again = StyleCodeModel.load(path, prior)
    x, t, words, code = torch.randn(1, 20, prior.layout.size), torch.tensor([9]), torch.zeros(1, 128), torch.ones(1, 38)
    assert torch.allclose(again.network(x, t, words, code), small.network(x, t, words, code), atol=0.05)
    assert again.key == small.key and again.chain.stops == small.chain.stops
    tensors, card = checkpoints.load(path)
    for change in ({"prior": "other"}, {"codes": ["tempo"]}):
        checkpoints.save(path, tensors, card | change)
        with pytest.raises(mk.MotionKitError, match="made from another prior, or by another performer"):
            StyleCodeModel.load(path, prior)


def test_a_reader_guesses_codes_and_belongs_to_its_prior(prior, known, small, tmp_path):
    other = StyleCodeModel(prior, small.network, small.chain)
    assert other.read(known.styled[0].float()) is None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style_code, "READER_BATCH", 4)
        card = train_encoder(other, known, TrainConfig(60, 1e-3, average=0.9), title="")
    errors = encoder_error(other, known)
    assert errors["read"] < 0.7 * errors["guessed"] and card["lessons"] == 8 and errors["expected"] > 0
    long = torch.cat((known.styled[0], known.styled[0])).float()  # the middle is read
    code, spread = other.read(long)
    assert code.shape == spread.shape == (CODES,) and bool((spread > 0).all())
    path = other.save_reader(tmp_path / "actor-reader.safetensors", card)
    again = StyleCodeModel(prior, small.network, small.chain).load_reader(path)
    assert all(torch.allclose(a, b, atol=0.01) for a, b in zip(again.read(long), (code, spread)))
    tensors, card = checkpoints.load(path)
    checkpoints.save(path, tensors, card | {"prior": "other"})
    with pytest.raises(mk.MotionKitError, match="as another prior does"):
        again.load_reader(path)


def test_a_space_goes_on_from_another(prior, known, small):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style_code, "BATCH", 4)
        patch.setattr(style_code, "_BACK", 1)
        later = train_decoder(prior, known, TrainConfig(1, 1e-9), small, title="")
    assert decoder_error(later, known) == pytest.approx(decoder_error(small, known), abs=1e-3)
    assert later.card["started_from"]["steps"] == small.card["steps"] and later.card["steps"] == 1
    assert later.network is not small.network


def test_learning_starts_from_what_is_read_and_stays_near_where_that_is_sure(small):
    read = GaussianCode(torch.full((CODES,), 0.3), torch.full((CODES,), 0.1))
    read.spread[0] = 1.0
    point = StyleCode(small, read)
    assert torch.equal(point.code[:-1], read.code) and float(point.unlikely().detach()) == 0

    def off_by(distance, number):
        moved = StyleCode(small, read)
        with torch.no_grad():
            moved.changes["code"][number] += distance
        return float(moved.unlikely().detach())

    assert 0 < off_by(0.1, 1) < off_by(0.5, 1)
    assert off_by(0.5, 0) == pytest.approx(off_by(0.05, 1), rel=1e-3)


def test_doubt_is_learned_where_nothing_is_to_be_read():
    found = torch.zeros(2, 2, requires_grad=True)
    codes = torch.tensor([[1.0], [-1.0]])
    optimizer = torch.optim.Adam([found], 0.05)
    for _ in range(300):
        loss = beta_nll(GaussianCode.of(found.mean(0, keepdim=True).expand(2, -1)), codes)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    code, spread = GaussianCode.of(found.mean(0).detach())
    assert abs(float(code)) < 0.05 and float(spread) == pytest.approx(1.0, rel=0.05)  # as far as they lie apart


def test_only_the_code_is_learned_and_kept(prior, small, tmp_path):
    clip = mk.load("data/actor/walk_old.bvh")
    recipe = Recipe(model="space", pair="space", weights=(1.0, 0.0), steps=3, rate=0.05)
    method = mk.methods.load("few-shot", recipe=recipe, space=small)
    weights = {name: value.clone() for name, value in small.network.state_dict().items()}
    learned = method.learn(clip, "an old person walks", title="")
    assert isinstance(learned.adapter, StyleCode) and float(learned.adapter.code.detach().abs().max()) > 0
    assert all(torch.equal(value, weights[name]) for name, value in small.network.state_dict().items())
    assert "37 numbers" in repr(learned)
    walk = mk.load("data/actor/walk_neutral.bvh")
    out = method.stylize(walk, learned, caption="a person walks")
    path = learned.save(tmp_path / "old.safetensors")
    assert path.stat().st_size < 1000
    back = method.load_style(path)
    again = method.stylize(walk, back, caption="a person walks")
    assert float((again.positions() - out.positions()).abs().max()) < 0.02
    with pytest.raises(mk.MotionKitError, match="a point in another space"):
        LearnedStyle.load(path, prior)


def test_a_clip_or_a_name_may_stand_for_a_style(small):
    method = mk.methods.load("few-shot", recipe=Recipe(model="space", pair="space", steps=2, rate=0.05), space=small)
    method = method.with_recipe(weights=(1.0, 0.0))
    walk, old = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old"))
    for style, name in (("zombie", "zombie"), ("an old person walks", "old"), (old, "walk_old")):
        out = method.stylize(walk, style, caption="a person walks")
        assert out.name == f"walk_neutral as {name}" and len(out) == len(walk)
    assert torch.equal(method.stylize(walk, old).rotations, method.stylize(walk, method.last).rotations)
    named = method.stylize(walk, "zombie", caption="a person walks")
    by_hand = LearnedStyle(small.prior, StyleCode(small, get_style("zombie")), small.chain, "zombie", "zombie")
    assert torch.equal(named.rotations, method.stylize(walk, by_hand, caption="a person walks").rotations)
    with pytest.raises(mk.MotionKitError, match="'purple' is no style that it knows by name: neutral, "):
        method.stylize(walk, "purple")


def test_the_semantic_loss_works_in_a_space_too(small, prior):
    from motionkit.datasets import BvhSource, Item, Labels
    from motionkit.datasets.loading import from_items

    source = BvhSource.at("data/actor/walk_neutral.bvh")
    library = from_items("mine", [Item("walk", Labels("walk", "neutral", ("a person is walking",)), source)])
    recipe = Recipe(model="space", pair="space", steps=2, batch=1, rate=0.05)
    method = mk.methods.load("few-shot", library=library, recipe=recipe, space=small)
    assert method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="").style == "old"


def test_recipes_say_what_does_not_fit():
    with pytest.raises(mk.MotionKitError, match="where its model is 'space' too"):
        Recipe(pair="space")
    assert Recipe.in_space().model == Recipe.in_space().pair == "space"
    assert spaces.load_for(text_to_motion.load("bandai-2")) is None
    method = mk.methods.load("few-shot", prior="bandai-2", recipe=Recipe.in_space())
    with pytest.raises(mk.MotionKitError, match="no space of styles of this prior"):
        method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks")


def test_captures_make_no_space():
    with pytest.raises(mk.MotionKitError, match="learned from the performer"):
        style_code.train_part(type("Set", (), {"name": "bandai-2"}), 1, 0, "")


def test_the_shipped_space_is_as_good_as_its_card_says(prior):
    space = spaces.load("actor")
    found, wrote = decoder_error(space, style_pairs(prior, 60, seed=space.card["seed"] + 1)), space.card["metrics"]
    assert all(found[name] == pytest.approx(wrote[name], rel=0.05) for name in wrote)
    assert found["styled"] < 0.35 * found["copied"] and found["neutral"] < 0.35 * found["copied"]


def test_the_shipped_reader_is_as_good_as_its_card_says(prior):
    space, card = spaces.load("actor"), checkpoints.load(checkpoints.find("actor-reader"))[1]
    found, wrote = encoder_error(space, style_pairs(prior, 60, seed=1)), card["metrics"]
    assert all(found[name] == pytest.approx(wrote[name], rel=0.05) for name in wrote)
    assert found["read"] < 0.45 * found["guessed"] and 0.7 < found["expected"] / found["read"] < 1.3


def test_a_style_that_nobody_has_seen_is_carried_over():
    """From one walk of a zombie to a kick; what is learned is nearer to the performer's own kick than KNN + DTW."""
    method, style = mk.methods.load("few-shot"), perform("walk", "zombie", seed=3, seconds=4.0)
    assert method.recipe == Recipe.in_space()
    kick = perform("kick", "neutral", seed=7, seconds=5.0)
    answer = retell(kick, "zombie").time_aligned(kick)
    learned = method.learn(style.motion, "a person walks in a zombie-like way", title="")
    error = error_against(method.stylize(kick.motion, learned, caption="a person kicks"), answer)
    assert error < 0.5 * error_against(kick.motion, answer)
    assert learned.adapter.style().arm_forward > 0.6  # held out in front: neutral is 0.02, a zombie's 1.3


def test_adapters_still_serve_where_they_are_asked_for():
    method = mk.methods.load("few-shot", recipe=Recipe(steps=1, weights=(1.0, 0.0), pair_steps=4))
    learned = method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="")
    assert isinstance(learned.adapter, LoRA)
