"""The shipped priors, discriminators and text encoder, measured again and compared with their cards."""

import pytest
import torch

import motionkit as mk
from motionkit import checkpoints
from motionkit.__main__ import _TRAINERS
from motionkit.datasets import Labels
from motionkit.methods.text_to_motion import generate_for, retrieval
from motionkit.text.encoders import Mini

ACTOR = ["a person walks in depression", "an old person walks", "a person kicks angrily", "a person jumps neutrally"]
SEEN = [("walk", "depressed"), ("walk", "old"), ("kick", "angry"), ("jump", "neutral")]


@pytest.fixture(scope="module")
def actor():
    return mk.datasets.load("actor").split()


@pytest.fixture(scope="module")
def prior():
    return mk.methods.text_to_motion.load("actor")


JUDGES, PRIORS = ("autoencoder", "content", "style"), ("prior", "discriminator")
SHIPPED = {
    "text-mini",
    "actor-held-back-style",
    *(f"actor-{what}" for what in (*JUDGES, *PRIORS, "style-code", "style-encoder", "style-erd")),
    *(f"bandai-2-{what}" for what in (*JUDGES, *PRIORS, "style-erd")),
}


def what_it_is(card: dict) -> str:
    """What its command trains."""
    return card["command"].split()[4]


def test_what_is_shipped():
    assert set(checkpoints.names()) == SHIPPED
    files = [path for path in checkpoints.folder().rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 40e6


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_cards_say_what_they_must(name):
    """Of each: how it was made, under which licence; and its weights are 16-bit."""
    tensors, card = checkpoints.load(checkpoints.find(name))
    assert card["command"].startswith("python -m motionkit train ")
    assert card["steps"] > 0 and (what_it_is(card) in JUDGES or card["steps_per_second"] > 0)  # theirs are older
    what = what_it_is(card)
    assert what in _TRAINERS and name == ("text-mini" if what == "text" else f"{card['data']}-{what}")
    assert card["name"] == name and card["format"] == checkpoints.FORMAT
    assert card["seconds"] > 0 and card["metrics"] and card["data_sha256"] and card["hardware"]
    assert card["licence"] == ("CC-BY-NC-4.0" if "bandai" in name else "MIT")
    assert ("cc-by-nc-4.0" in str(checkpoints.find(name))) == ("bandai" in name)
    weights = {key: value for key, value in tensors.items() if key.startswith(("network.", "labels."))}
    assert weights and not any(value.dtype in (torch.float32, torch.float64) for value in weights.values())
    others = {key for key in tensors if key not in weights}
    assert others <= {"mean", "std", "alphas_bar"}  # what features and noise are scaled by, a number for each


def test_the_data_are_those_that_the_weights_learned_from(actor, prior):
    # processors differ in the last digits of the clips; these weights were made on two kinds
    cards = [checkpoints.load(checkpoints.find(f"actor-{what}"))[1] for what in ("prior", "content")]
    assert checkpoints.data_hash(actor.train) in {card["data_sha256"] for card in cards}
    assert {card["training_clips"] for card in cards} == {prior.card["training_clips"]} == {len(actor.train)}


@pytest.mark.slow
def test_the_prior_is_as_good_as_its_card_says(actor, prior):
    few = actor.test[::6]
    judge, made = mk.judges.load("actor"), generate_for(prior, few)
    for label, classifier in (("content", judge.content), ("style", judge.style)):
        hits = classifier.scores(made).argmax(1) == classifier.ids([getattr(clip, label) for clip in few])
        share = 100 * float(hits.double().mean())
        assert abs(share - prior.card["metrics"][label]) < 12, (label, share)


def test_prompts_give_what_they_say(prior):
    judge, made = mk.judges.load("actor"), prior.generate(ACTOR, seconds=4)
    content = [judge.content.labels[n] for n in judge.content.scores(made).argmax(1).tolist()]
    style = [judge.style.labels[n] for n in judge.style.scores(made).argmax(1).tolist()]
    assert sum(a == b for a, b in zip(zip(content, style), SEEN)) >= 3
    assert all(torch.isfinite(motion.positions()).all() and len(motion) == 120 for motion in made)


def test_motions_are_as_smooth_as_real_ones(actor, prior):
    """Frames of neighbouring tokens must not jump: accelerations at the seams are those in between."""

    def acceleration(motion: mk.Motion) -> torch.Tensor:
        return motion.positions().diff(n=2, dim=0).norm(dim=-1).mean(1)[:116]

    made = torch.stack([acceleration(motion) for motion in prior.generate(ACTOR, seconds=4)])
    seams = made.unflatten(1, (-1, 4)).mean((0, 1))
    assert float(seams.max() / seams.min()) < 2
    real = torch.stack([acceleration(actor.test[n].motion) for n in range(0, len(actor.test), 24)])
    assert float(made.mean()) < 3 * float(real.mean())


def test_joints_may_come_in_any_order_and_at_any_rate(prior):
    """A BVH file writes joints depth first, the dataset that the prior learned from does not."""
    walk = mk.load("data/actor/walk_old.bvh")
    assert walk.skeleton.names != prior.layout.skeleton.names
    back = prior.decode(prior.encode(walk))
    places = [back.skeleton.index(name) for name in walk.skeleton.names]
    turned = mk.rotations.quaternion_angle(back.rotations[:, places], walk.at_origin().rotations)
    assert float(turned.max()) < 0.01  # radians
    assert prior.encode(walk.resample(60)).shape == prior.encode(walk).shape
    with pytest.raises(mk.MotionKitError, match="make a layout"):
        prior.encode(mk.load("data/actor/dog_trot_neutral.bvh"))


def test_people_of_all_sizes_stand_on_the_ground(actor, prior):
    """The layout's skeleton is one person's; what is decoded has the size that its positions tell."""
    for clip in (actor.test[0], actor.test[50], actor.test[200]):
        back = prior.decode(prior.encode(clip.motion))
        assert float((back.positions() - clip.motion.at_origin().positions()).abs().max()) < 0.03
    for motion in prior.generate(ACTOR, seconds=4):
        assert -0.03 < float(motion.positions()[..., 1].amin(1).quantile(0.25)) < 0.08


def test_far_prompts_are_told(prior):
    with pytest.warns(mk.MotionKitWarning, match="nearest"):
        prior.generate("a dog barks at the moon", seconds=1)


@pytest.mark.slow
def test_the_discriminator_finds_as_much_as_its_card_says(actor):
    judge = mk.methods.text_to_motion.load_discriminator("actor")
    assert retrieval(judge, actor.test) == pytest.approx(judge.card["metrics"], abs=2.0)


@pytest.mark.slow
@pytest.mark.captures
def test_the_discriminator_of_captures_too(captures):
    judge = mk.methods.text_to_motion.load_discriminator("bandai-2")
    assert retrieval(judge, mk.datasets.load("bandai-2", captures).split().test) == pytest.approx(
        judge.card["metrics"], abs=2.0
    )


def test_mini_finds_the_motion_of_a_sentence(actor):
    encoder = mk.text.load("mini")
    assert isinstance(encoder, Mini) and encoder.card["metrics"]["sentence_by_motion_r1"] > 90
    a, b = (encoder.encode([clip.texts[n] for clip in actor.test]) for n in (0, 1))
    groups = [(clip.content, clip.style) for clip in actor.test]
    found = mk.metrics.recall_at_k(a, b, groups)["r1"]
    assert found == pytest.approx(encoder.card["metrics"]["sentence_by_sentence_r1"], abs=2)


@pytest.mark.slow
def test_the_shipped_style_erd_is_as_good_as_its_card_says(actor):
    from motionkit.methods.style_erd import evaluate_model

    model = mk.methods.load("style-erd").model
    found, wrote = evaluate_model(model, actor.test), model.card["metrics"]
    assert found["rebuilt_mm"] == pytest.approx(wrote["rebuilt_mm"], rel=0.05)
    assert all(abs(found[name] - wrote[name]) < 4 for name in wrote)
    assert found["rebuilt_mm"] < 25 and found["content"] > 85 and found["style"] > 75


def test_style_erd_comes_near_the_performers_own_answer():
    """Neutral walks and kicks of somebody new in three styles: under half as far from the answer as the content is."""
    from motionkit.actor import perform, retell
    from motionkit.arena.transfers import error_against

    method, errors = mk.methods.load("style-erd"), []
    for content in ("walk", "kick"):
        played = perform(content, "neutral", seed=920, seconds=4.0, performer=46)
        for style in ("old", "proud", "depressed"):
            answer = retell(played, style).time_aligned(played)
            made = method.stylize(played.motion, style, labels=Labels(content, "neutral"))
            errors.append((error_against(made, answer), error_against(played.motion, answer)))
    mine, untouched = (sum(part) for part in zip(*errors))
    assert mine < 0.5 * untouched
