"""Style codes: random styles and pairs in them, the two networks and their files, codes read off clips and labels, and
what the shipped ones can do."""

import pickle
import random
from dataclasses import replace

import pytest
import torch

import motionkit as mk
from motionkit import checkpoints
from motionkit.actor import Style, parameters, perform, retell
from motionkit.actor.style import TRAIN_STYLES, get_style
from motionkit.arena.transfers import error_against
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.layers import Denoiser, LoRA, TransformerConfig
from motionkit.methods import few_shot, style_code_training, text_to_motion
from motionkit.methods.style_code import (
    CODES,
    CodedDenoiser,
    CodeSearch,
    GaussianCode,
    StyleCode,
    StyleCodeModel,
    StyleEncoder,
    load,
)
from motionkit.methods.style_code_training import (
    FRAMES,
    beta_nll,
    code_of,
    decoder_error,
    encoder_error,
    make_style_code,
    make_style_encoder,
    random_style,
    style_pairs,
    train_decoder,
    train_encoder,
)
from motionkit.training import TrainConfig, TrainOrder

pytestmark = pytest.mark.slow

WALKS = Labels(texts=("a person walks",))


@pytest.fixture(scope="module")
def prior():
    return text_to_motion.load("actor")


@pytest.fixture(scope="module")
def pairs(prior):
    return style_pairs(prior, 4, each=2, jobs=1)


@pytest.fixture(scope="module")
def small(prior, pairs):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style_code_training, "BATCH", 4)
        patch.setattr(style_code_training, "_BACK", 1)
        return train_decoder(prior, pairs, TrainConfig(8, 1e-3, ema=0.5), title="")


@pytest.fixture(scope="module")
def method():
    return mk.methods.load("style-code")


def test_random_styles_lie_in_their_ranges_and_go_beyond_those_known():
    styles = [random_style(random.Random(n)) for n in range(200)]  # a Style checks its ranges itself
    for key, about in parameters().items():
        values = torch.tensor([getattr(style, key) for style in styles])
        reach = max(abs(getattr(get_style(style), key) - about.neutral) for style in TRAIN_STYLES)
        far = (values - about.neutral).abs()
        assert float(far.median()) <= max(0.5 * reach, 0.25 * (about.high - about.low)) and far.max() > 0
    assert random_style(random.Random(3)) == random_style(random.Random(3))


def test_a_code_is_the_numbers_and_back(prior):
    style = get_style("zombie")
    model = StyleCodeModel(prior, CodedDenoiser(Denoiser(10, 16, TransformerConfig.tiny())), None)
    code = StyleCode(model, code_of(style), "a person walks in a zombie-like way", "zombie")
    assert code.code.shape == (CODES,)
    assert code.style().values() == pytest.approx(style.values(), abs=1e-5)
    assert bool((code_of(Style()) == 0).all())


def test_pairs_have_the_same_beat_in_both(prior, pairs):
    """Pelvis and feet of both go the same way in time, whoever's time it is; contents come in turn."""
    assert pairs.neutral.shape == pairs.styled.shape == (8, FRAMES, prior.layout.size)
    assert pairs.codes.shape == (8, CODES) and len(pairs.captions) == 8
    assert pairs.captions[0] == pairs.captions[1] != pairs.captions[2]
    assert bool((pairs.neutral != pairs.styled).any(2).any(1).all())
    again = style_pairs(prior, 4, each=2, jobs=1)
    assert torch.equal(again.styled, pairs.styled)


def test_a_model_starts_at_its_prior_and_learns(prior, pairs, small):
    before = decoder_error(StyleCodeModel(prior, CodedDenoiser(prior.network), small.partial), pairs)
    after = decoder_error(small, pairs)
    assert after["copied"] == before["copied"]
    assert after["styled"] < before["styled"] and after["neutral"] < before["neutral"]
    assert small.card["steps"] == 8 and small.card["training_clips"] == 8
    assert text_to_motion.load("actor").network.training is False


def test_a_model_is_kept_for_its_prior_alone(prior, small, tmp_path):
    path = small.save(tmp_path / "actor-style-code.safetensors")
    again = StyleCodeModel.load(path, prior=prior)
    x, t, words, code = torch.randn(1, 20, prior.layout.size), torch.tensor([9]), torch.zeros(1, 128), torch.ones(1, 38)
    assert torch.allclose(again.network(x, t, words, code), small.network(x, t, words, code), atol=0.05)
    assert again.key == small.key and again.partial.timesteps == small.partial.timesteps
    tensors, card = checkpoints.load(path)
    for change in ({"prior": "other"}, {"codes": ["tempo"]}):
        checkpoints.save(path, tensors, card | change)
        with pytest.raises(mk.MotionKitError, match="made from another prior, or by another performer"):
            StyleCodeModel.load(path, prior=prior)


def test_an_encoder_guesses_codes_and_belongs_to_its_prior(prior, pairs, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style_code_training, "ENCODER_BATCH", 4)
        encoder = train_encoder(prior, pairs, TrainConfig(60, 1e-3, ema=0.9), title="")
    errors = encoder_error(encoder, pairs)
    assert errors["read"] < 0.7 * errors["guessed"] and encoder.card["training_clips"] == 8 and errors["expected"] > 0
    long = torch.cat((pairs.styled[0], pairs.styled[0])).float()  # the middle is read
    code, spread = encoder(long)
    assert code.shape == spread.shape == (CODES,) and bool((spread > 0).all())
    path = encoder.save(tmp_path / "actor-style-encoder.safetensors")
    again = StyleEncoder.load(path, prior=prior)
    assert all(torch.allclose(a, b, atol=0.01) for a, b in zip(again(long), (code, spread)))
    tensors, card = checkpoints.load(path)
    checkpoints.save(path, tensors, card | {"prior": "other"})
    with pytest.raises(mk.MotionKitError, match="as another prior does"):
        StyleEncoder.load(path, prior=prior)


def test_a_model_goes_on_from_another(prior, pairs, small):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style_code_training, "BATCH", 4)
        patch.setattr(style_code_training, "_BACK", 1)
        later = train_decoder(prior, pairs, TrainConfig(1, 1e-9), small, title="")
    assert decoder_error(later, pairs) == pytest.approx(decoder_error(small, pairs), abs=1e-3)
    assert later.card["started_from"]["steps"] == small.card["steps"] and later.card["steps"] == 1
    assert later.network is not small.network


def test_the_search_starts_from_what_is_read_and_stays_near_where_that_is_sure(small):
    estimate = GaussianCode(torch.full((CODES,), 0.3), torch.full((CODES,), 0.1))
    estimate.spread[0] = 1.0
    search = CodeSearch(small, estimate)
    assert torch.equal(search.code, estimate.code) and float(search.prior_nll().detach()) == 0

    def off_by(distance, number, start=estimate):
        moved = CodeSearch(small, start)
        with torch.no_grad():
            moved.code[number] += distance
        return float(moved.prior_nll().detach())

    assert 0 < off_by(0.1, 1) < off_by(0.5, 1)
    assert off_by(0.5, 0) == pytest.approx(off_by(0.05, 1), rel=1e-3)
    assert bool((CodeSearch(small).code == 0).all()) and 0 < off_by(0.1, 1, None) < off_by(0.5, 1, None)  # nothing read


def test_doubt_is_learned_where_nothing_is_to_be_read():
    numbers = torch.zeros(2, 2, requires_grad=True)
    codes = torch.tensor([[1.0], [-1.0]])
    optimizer = torch.optim.Adam([numbers], 0.05)
    for _ in range(300):
        loss = beta_nll(GaussianCode.of(numbers.mean(0, keepdim=True).expand(2, -1)), codes)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    code, spread = GaussianCode.of(numbers.mean(0).detach())
    assert abs(float(code)) < 0.05 and float(spread) == pytest.approx(1.0, rel=0.05)  # as far as they lie apart


def test_only_the_code_is_learned_and_kept(small, tmp_path):
    clip, walk = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("old", "neutral"))
    method = mk.methods.load("style-code", model=small)
    weights = {name: value.clone() for name, value in small.network.state_dict().items()}
    learned = method.learn(clip, "an old person walks", steps=3, title="")
    assert isinstance(learned, StyleCode) and float(learned.code.abs().max()) > 0 and learned.card["steps"] == 3
    assert all(torch.equal(value, weights[name]) for name, value in small.network.state_dict().items())
    assert "37 numbers" in repr(learned)
    out = method.stylize(walk, learned, labels=WALKS)
    path = learned.save(tmp_path / "old.safetensors")
    assert path.stat().st_size < 1000
    again = method.stylize(walk, method.load_style(path), labels=WALKS)
    assert float((again.positions() - out.positions()).abs().max()) < 0.02


def test_files_load_with_their_own_method_and_prior_alone(method, small, prior, tmp_path):
    code = StyleCode(small, torch.zeros(CODES), "an old person walks", "old").save(tmp_path / "code.safetensors")
    with pytest.raises(mk.MotionKitError, match="a code of another model"):
        method.load_style(code)
    paper = mk.methods.load("few-shot")
    with pytest.raises(mk.MotionKitError, match="code.safetensors"):
        paper.load_style(code)
    changes, partial = LoRA(prior.network, 1), paper.partial
    style = few_shot.LearnedStyle(prior, changes, partial, "an old person walks", "old").save(
        tmp_path / "a.safetensors"
    )
    with pytest.raises(mk.MotionKitError, match="a.safetensors"):
        method.load_style(style)
    assert paper.load_style(style).name == "old"
    with pytest.raises(mk.MotionKitError, match="another prior"):
        mk.methods.load("few-shot", prior="bandai-2").load_style(style)


def test_a_prior_of_unknown_data_needs_its_model_too(prior):
    unknown = replace(prior, card={k: v for k, v in prior.card.items() if k != "data"})
    with pytest.raises(mk.MotionKitError, match="does not say its data; give a model"):
        load(unknown)


def test_a_label_is_read_off_the_librarys_clips_and_never_asks_the_performer(method, monkeypatch):
    walk = mk.load("data/actor/walk_neutral.bvh")
    len(method.pairs.library)  # its clips are made before

    def refuse(*_, **__):
        raise AssertionError("the performer's own numbers were asked for")

    for where in ("motionkit.actor.style.get_style", "motionkit.methods.style_code_training.get_style"):
        monkeypatch.setattr(where, refuse)
    monkeypatch.setattr("motionkit.actor.get_style", refuse, raising=False)
    for name in ("perform", "retell"):
        monkeypatch.setattr(f"motionkit.actor.{name}", refuse)
    for style in ("old", "Old", "an old person walks"):
        out = method.stylize(walk, style, labels=WALKS)
        assert len(out) == len(walk)
    clips = list(method.pairs.library.filter(style="old"))
    clips = clips[:: len(clips) // 12][:12]
    codes = [method.codes.encoder(method.prior.encode(method.onto_model(clip.motion))).code for clip in clips]
    (code,) = method.read_style("old")
    assert torch.allclose(code.code, torch.stack(codes).mean(0), atol=1e-6) and code.name == "old"
    assert torch.equal(out.rotations, method.stylize(walk, code, labels=WALKS).rotations)


def test_labels_of_a_library_of_ones_own():
    source = BvhSource.at("data/actor/walk_proud.bvh"), BvhSource.at("data/actor/walk_neutral.bvh")
    items = [
        Item(name, Labels("walk", name, ("a person walks",)), clip) for name, clip in zip(("regal", "neutral"), source)
    ]
    method = mk.methods.load("style-code", library=from_items("mine", items))
    (code,) = method.read_style("regal")
    proud = method.onto_model(mk.load("data/actor/walk_proud.bvh"))
    assert torch.allclose(code.code, method.codes.encoder(method.prior.encode(proud)).code, atol=1e-6)
    with pytest.raises(mk.MotionKitError, match="'old' is no style that its library has: regal"):
        method.read_style("old")


def test_names_mix_and_a_clip_needs_no_sentence(method):
    walk, old = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old"))
    both = method.stylize(walk, style={"old": 0.5, "proud": 0.5})
    assert both.name == "walk_neutral as old + proud"
    ends = [method.stylize(walk, style=name) for name in ("old", "proud")]
    gaps = [float((both.positions() - end.positions()).norm(dim=-1).mean()) for end in ends]
    assert max(gaps) < float((ends[0].positions() - ends[1].positions()).norm(dim=-1).mean())
    quick = method.learn(old, steps=1, title="")
    assert quick.name == "walk_old" and "walk" in quick.prompt
    funky = method.learn(old, "a person walks in a funky style", steps=1, title="")
    assert funky.name == "funky" and "funky" in funky.prompt


def test_a_clip_may_stand_for_a_style(small):
    method = mk.methods.load("style-code", model=small)  # no encoder: the search starts at neutral
    walk, old = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old"))
    with pytest.MonkeyPatch.context() as patch:
        learn = method.learn
        patch.setattr(method, "learn", lambda *all, **more: learn(*all, steps=2, **more), raising=False)
        out = method.stylize(walk, old, labels=WALKS)
    assert out.name == "walk_neutral as walk_old" and len(out) == len(walk)
    (learned,) = method.read_style(old)  # remembered
    assert torch.equal(
        method.stylize(walk, old, labels=WALKS).rotations, method.stylize(walk, learned, labels=WALKS).rotations
    )
    with pytest.raises(mk.MotionKitError, match="knows no style by name"):  # nothing reads codes off the library
        method.stylize(walk, "old")


def test_twice_a_style_goes_slower_still_where_the_style_is_slow(method):
    walk = mk.load("data/actor/walk_neutral.bvh")
    results = [method.stylize(walk, "old", strength, labels=WALKS) for strength in (0, 0.5, 1, 1.5, 2)]
    ways = [float((motion.root_path()[-1] - motion.root_path()[0]).norm()) for motion in results]
    assert ways == sorted(ways, reverse=True) and ways[-1] > 0.5
    assert results[0].rotations is walk.rotations and results[0].translations is walk.translations


def test_a_style_must_be_given_each_time(method):
    with pytest.raises(TypeError, match="style"):
        method.stylize(mk.load("data/actor/walk_neutral.bvh"))


def test_labels_say_what_the_content_is(method):
    old = perform("walk", "old", seed=5, seconds=4.0).motion
    results = {
        style: method.stylize(old, "proud", labels=Labels("walk", style, ("a person walks",))).rotations
        for style in ("", "neutral", "old")
    }
    assert torch.equal(results[""], results["neutral"])
    assert not torch.equal(results["old"], results["neutral"])  # made neutral first
    kick = method.stylize(old, "proud", labels=Labels(texts=("a person kicks",))).rotations
    assert not torch.equal(kick, results[""])


def test_a_pickled_method_answers_the_same(method):
    walk = mk.load("data/actor/walk_neutral.bvh")
    again = pickle.loads(pickle.dumps(method))
    assert again.codes.key == method.codes.key
    out, other = (one.stylize(walk, "proud", labels=WALKS) for one in (method, again))
    assert torch.equal(out.rotations, other.rotations) and torch.equal(out.translations, other.translations)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m, w: m.stylize(w, "purple"), "'purple' is no style that its library has: .*old.* method.learn"),
        (lambda m, w: m.stylize(w, "zombie"), "'zombie' is no style that its library has"),
        (lambda m, w: m.stylize(w, {"old": 0.5, "zombie": 0.5}), "'zombie' is no style that its library has"),
        (lambda m, w: m.stylize(w, "a person walks in a zombie-like way"), "is no style that its library has"),
        (lambda m, w: m.stylize(w, "neutral"), "'neutral' is no style that its library has"),
        (lambda m, w: m.stylize(w, "prowd"), "Did you mean 'proud'"),
        (lambda m, w: m.stylize(w, "a person walks"), "says nothing of a style"),
        (lambda m, w: m.stylize(w, "old.safetensors"), r"read it first: method.load_style\('old.safetensors'\)"),
        (lambda m, w: m.stylize(w, "my old walk.bvh"), r"read it first: mk.load\('my old walk.bvh'\)"),
        (lambda m, w: m.stylize(w, "my clip.bvh"), r"read it first: mk.load\('my clip.bvh'\)"),
        (lambda m, w: m.stylize(w, "old.bvh"), r"read it first: mk.load\('old.bvh'\)"),
        (lambda m, w: m.stylize(w, {"old": float("nan")}), "weight of style 'old' must be a number .* found nan"),
        (lambda m, w: m.stylize(w, {"old": "a"}), "weight of style 'old' must be a number .* found 'a'"),
        (lambda m, w: m.stylize(w, ["old", "proud"]), "several styles are mixed with weights"),
        (lambda m, w: m.learn(w[:20]), r"lasts 0.67 s; .* from 1 s"),
        (lambda m, w: m.learn("walk.bvh"), "learns a style from a Motion"),
        (lambda m, w: m.learn(w, 7), "a prompt is a sentence, or left out; found 7"),
        (lambda m, w: m.learn(w, "a person walks"), "says nothing of a style"),
        (lambda m, w: m.learn(w, rank=3), "learn takes resume, title, callback beside the clip, not 'rank'"),
        (lambda m, w: mk.methods.load("style-code", model="actor"), "model is a StyleCodeModel"),
        (lambda m, w: mk.methods.load("style-code", prior="bandai-2"), "no checkpoint 'bandai-2-style-code'"),
        (lambda m, w: mk.methods.load("style-code", prior="bandai-2", model=m.codes), "made from another prior"),
        (lambda m, w: mk.methods.load("style-code", config=few_shot.Config()), "has no option 'config'"),
    ],
)
def test_bad_input_is_one_clear_error(method, make, message):
    with pytest.raises(mk.MotionKitError, match=message):
        make(method, mk.load("data/actor/walk_neutral.bvh"))


@pytest.mark.parametrize("make", [make_style_code, make_style_encoder])
def test_captures_make_no_codes(make):
    with pytest.raises(mk.MotionKitError, match="learned from the performer"):
        make(TrainOrder(type("Set", (), {"name": "bandai-2"})))


def test_the_shipped_model_is_as_good_as_its_card_says(prior):
    model = load("actor")
    errors, card = decoder_error(model, style_pairs(prior, 60, seed=model.card["seed"] + 1)), model.card["metrics"]
    assert all(errors[name] == pytest.approx(card[name], rel=0.05) for name in card)
    assert errors["styled"] < 0.35 * errors["copied"] and errors["neutral"] < 0.35 * errors["copied"]


def test_the_shipped_encoder_is_as_good_as_its_card_says(prior):
    encoder = load("actor").encoder
    errors, card = encoder_error(encoder, style_pairs(prior, 60, seed=1)), encoder.card["metrics"]
    assert all(errors[name] == pytest.approx(card[name], rel=0.05) for name in card)
    assert errors["read"] < 0.45 * errors["guessed"] and 0.7 < errors["expected"] / errors["read"] < 1.3


def test_a_style_that_nobody_has_seen_is_carried_over(method):
    """From one walk of a zombie to a kick; what is learned is nearer to the performer's own kick than KNN + DTW."""
    style = perform("walk", "zombie", seed=3, seconds=4.0)
    kick = perform("kick", "neutral", seed=7, seconds=5.0)
    answer = retell(kick, "zombie").time_aligned(kick)
    learned = method.learn(style.motion, "a person walks in a zombie-like way", title="")
    result = method.stylize(kick.motion, learned, labels=Labels(texts=("a person kicks",)))
    assert error_against(result, answer) < 0.5 * error_against(kick.motion, answer)
    assert learned.style().arm_forward > 0.6  # held out in front: neutral is 0.02, a zombie's 1.3
