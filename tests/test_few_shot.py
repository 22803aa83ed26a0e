"""Paper 1's second stage: the chain, the neutral pair, the losses, adapters and the files of learned styles."""

import math
from dataclasses import replace

import pytest
import torch

import motionkit as mk
from motionkit import sampling, text
from motionkit.actor import perform, retell
from motionkit.arena.transfers import error_against
from motionkit.features import FacingFree
from motionkit.layers import Denoiser, TransformerConfig, semantic_loss
from motionkit.methods.few_shot import (
    ContentBank,
    FinetuneTask,
    LearnedStyle,
    LoRA,
    Recipe,
    blend,
    finetune,
    neutral_pair,
)
from motionkit.methods.text_to_motion import Prior
from motionkit.sampling import PartialDiffusion

PROMPT = "an old person is walking"


@pytest.fixture(scope="module")
def prior() -> Prior:
    return mk.methods.text_to_motion.load("actor")


@pytest.fixture(scope="module")
def judge():
    return mk.methods.text_to_motion.load_discriminator("actor")


@pytest.fixture(scope="module")
def walk():
    """An old walk of 4 s, and the same walk done neutrally, frame by frame."""
    old = perform("walk", "old", seed=5, seconds=4.0)
    return old.motion, retell(old, "neutral").time_aligned(old)


@pytest.fixture(scope="module")
def lesson(prior, judge, walk) -> FinetuneTask:
    chain, chance = PartialDiffusion.from_paper(prior.schedule), torch.Generator().manual_seed(0)
    clean = torch.stack([prior.encode(walk[1])[:40], prior.encode(walk[1])[40:80]])
    noised = clean + 0.1 * torch.randn(clean.shape, generator=chance)
    contents = ContentBank(clean, noised, ("a person is walking neutrally", "a person is kicking neutrally"))
    styled, neutral = prior.encode(walk[0])[:40], prior.encode(walk[1])[:40]
    return FinetuneTask(prior, judge, chain, styled, neutral, PROMPT, "old", contents)


def test_chain_has_the_papers_steps_in_any_schedule(prior):
    paper = mk.diffusion.NoiseSchedule.cosine(1000)
    assert PartialDiffusion.from_paper(paper).stops == (300, 250, 200, 150, 100, 50)  # section 4: K = 300 is 6 steps
    stops = PartialDiffusion.from_paper(prior.schedule).stops
    assert len(stops) == 6
    for there, here in zip((300, 250, 200, 150, 100, 50), stops):
        assert abs(float(paper.log_snr[there] - prior.schedule.log_snr[here])) < 0.12


def test_chain_forward_and_back_is_the_motion_again():
    chain = PartialDiffusion.from_paper(mk.diffusion.NoiseSchedule.cosine(1000), steps=200)
    x, seen = torch.randn(2, 8, 3), torch.full((2, 8, 3), 0.5)
    noised = chain.forward(lambda x, t: seen, x)
    assert torch.allclose(chain.reverse(lambda x, t: seen, noised)[-1], seen)
    assert not torch.allclose(noised, x, atol=0.1)


def test_reverse_gives_every_prediction_and_gradients_through_all_steps():
    chain = PartialDiffusion.from_paper(mk.diffusion.NoiseSchedule.cosine(1000))
    noised = torch.randn(1, 4, 2, dtype=torch.float64)

    def last(a: torch.Tensor) -> torch.Tensor:
        return chain.reverse(lambda x, t: a * x + 0.3, noised)[-1].square().sum()

    a = torch.tensor(0.8, dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(last(a), a)
    step = 1e-6
    difference = last(a.detach() + step) - last(a.detach() - step)
    assert float(slope) == pytest.approx(float(difference) / (2 * step), rel=1e-5)
    one_step_only = 2 * (0.8 * noised + 0.3) * noised  # what a chain of one step would give
    assert abs(float(slope) - float(one_step_only.sum())) > 1e-3


def test_losses_by_hand(lesson, prior, judge):
    network = prior.network.eval()
    seen, x, words = [], lesson.own_noised, prior.encoder.encode([PROMPT])
    stops = lesson.chain.stops
    with torch.no_grad():
        for t, s in zip(stops, [*stops[1:], 0]):  # eq. 9, deterministic DDIM
            x0 = network(x, torch.tensor([t]), words)
            bar_t, bar_s = (float(prior.schedule.alphas_bar[n]) for n in (t, s))
            noise = (x - math.sqrt(bar_t) * x0) / math.sqrt(1 - bar_t)
            x = math.sqrt(bar_s) * x0 + math.sqrt(1 - bar_s) * noise
            seen.append(x0)
        expected = sum(((x0 - lesson.styled) ** 2).mean() for x0 in seen) / len(stops)  # eq. 10
        assert float(lesson.reconstruction_loss(network)) == pytest.approx(float(expected), rel=1e-4)
        torch.manual_seed(3)
        found = lesson.semantic_loss(network, 4)
        torch.manual_seed(3)
        chosen = torch.randint(2, (4,))
        told = prior.encoder.encode(["a person is walking in old age", "a person is kicking in old age"])[chosen]
        y = sampling.ddim(lambda x, t: network(x, t, told), lesson.contents.noised[chosen], prior.schedule, list(stops))
        cosines = torch.nn.functional.cosine_similarity(judge.network(y), told)
        assert float(found) == pytest.approx(float((1 - cosines).mean()), abs=1e-4)  # eq. 11
        assert float(found) == pytest.approx(float(semantic_loss(judge.network(y), told)), abs=1e-4)
    total = sampling.total_loss(torch.tensor(2.0), torch.tensor(3.0), (1.0, 0.1))  # eq. 12
    assert float(total) == pytest.approx(2.3)
    assert float(sampling.reconstruction_loss(torch.zeros(6, 1, 4, 2), torch.ones(4, 2))) == 1.0


def test_pair_is_neutral_and_keeps_the_path(prior, walk):
    old, exact = walk
    found = neutral_pair(prior, old, PROMPT, steps=100)
    given = prior.encode(old)
    kept = sampling.feature_mask(prior.layout, "root x velocity", "root z velocity")
    assert torch.equal(found[:, kept], given[:, kept])  # eq. 8
    made = FacingFree(old.skeleton, old.fps).decode(prior.normalizer.denormalize(found))
    assert error_against(made, exact) < 0.5 * error_against(old, exact)  # eq. 7


def test_a_low_noise_leaves_the_style_in_the_pair(prior, walk):
    given = prior.encode(walk[0])
    gaps = [float((neutral_pair(prior, walk[0], PROMPT, steps=60, noise=g) - given).abs().mean()) for g in (100, 950)]
    assert gaps[0] < 0.5 * gaps[1]


def test_adapter_changes_nothing_at_first_and_by_the_book_then():
    network = Denoiser(10, 16, TransformerConfig.tiny()).eval()
    x, t, words = torch.randn(2, 30, 10), torch.tensor([5, 900]), torch.randn(2, 16)
    for rank in (0, 4):
        adapter = LoRA(network, rank)
        assert torch.allclose(adapter(x, t, words), network(x, t, words), atol=1e-5)
        with torch.no_grad():
            for change in adapter.changes.values():
                change.normal_(0, 0.1)
        name = "encoder.layers.0.linear1.weight"
        weight, key = network.get_parameter(name), name.replace(".", "/")
        changed = adapter.changes[key] if rank == 0 else adapter.changes[f"{key}/B"] @ adapter.changes[f"{key}/A"]
        assert torch.allclose(adapter.weights()[name], weight + changed)
        assert not torch.allclose(adapter(x, t, words), network(x, t, words), atol=1e-3)
        assert torch.allclose(adapter(x, t, words), adapter.merged()(x, t, words), atol=1e-5)
    with pytest.raises(mk.MotionKitError, match="rank is a whole number"):
        LoRA(network, -1)


@pytest.mark.parametrize("size", ["laptop", "paper"])
def test_a_style_is_less_than_a_megabyte(size):
    network = Denoiser(199, 128, getattr(TransformerConfig, size)())
    assert sum(2 * p.numel() for p in LoRA(network, Recipe.laptop().rank).parameters()) < 1e6


def test_teaching_lowers_the_loss_and_leaves_the_prior_alone(lesson, prior, tmp_path):
    before = {name: weight.clone() for name, weight in prior.network.state_dict().items()}
    recipe = Recipe(steps=12, batch=2, rate=3e-3)
    adapter, run = finetune(lesson, recipe, title="")
    assert run.losses[-1] < 0.7 * run.losses[0]
    assert all(torch.equal(before[name], weight) for name, weight in prior.network.state_dict().items())
    with torch.no_grad():
        assert float(lesson.reconstruction_loss(adapter)) < 0.7 * float(lesson.reconstruction_loss(prior.network))

    def stop(step: int, loss: float) -> None:
        if step == 5:
            raise KeyboardInterrupt

    kept = tmp_path / "old.run"
    with pytest.raises(KeyboardInterrupt):
        finetune(lesson, recipe, title="", keep=kept, show=stop)
    again, _ = finetune(lesson, recipe, title="", keep=kept)
    assert all(torch.equal(a, b) for a, b in zip(adapter.parameters(), again.parameters()))


def test_the_semantic_loss_counts(lesson):
    with_meaning, _ = finetune(lesson, Recipe(steps=3, batch=2), title="")
    without, run = finetune(lesson, Recipe(steps=3, batch=2, weights=(1.0, 0.0)), title="")
    assert any(not torch.equal(a, b) for a, b in zip(with_meaning.parameters(), without.parameters()))
    assert run.losses[0] == pytest.approx(float(lesson.reconstruction_loss(lesson.prior.network).detach()), rel=1e-3)


@pytest.fixture(scope="module")
def styles(lesson, prior) -> list[LearnedStyle]:
    found = []
    for seed, name in ((0, "old"), (1, "proud")):
        adapter = LoRA(prior.network, 4, seed)
        with torch.no_grad():
            for change in adapter.changes.values():
                change.add_(0.01 * torch.randn(change.shape, generator=torch.Generator().manual_seed(seed)))
        found.append(LearnedStyle(prior, adapter, lesson.chain, f"a {name} person walks", name))
    return found


def test_a_saved_style_is_the_same_style(styles, prior, tmp_path):
    x, t = torch.randn(1, 40, prior.layout.size), torch.tensor([30])
    path = styles[0].save(tmp_path / "old.safetensors")
    again = LearnedStyle.load(path, prior)
    caption = "a person is kicking"
    assert torch.allclose(again.predict(caption)(x, t), styles[0].predict(caption)(x, t), atol=2e-2)
    assert (again.style, again.prompt, again.chain.stops) == ("old", "a old person walks", styles[0].chain.stops)
    data = path.read_bytes()
    path.write_bytes(data[:-100])
    with pytest.raises(mk.MotionKitError, match="damaged"):
        LearnedStyle.load(path, prior)


def test_a_style_of_another_prior_is_refused(styles, prior, tmp_path):
    path = styles[0].save(tmp_path / "old.safetensors")
    other = replace(prior, network=Denoiser(prior.layout.size, prior.encoder.size, prior.network.config))
    with pytest.raises(mk.MotionKitError, match="another prior"):
        LearnedStyle.load(path, other)


def test_blending_is_a_weighted_sum_and_the_rest_is_the_prior(styles, prior):
    caption, x, t = "a person is walking", torch.randn(1, 40, prior.layout.size), torch.tensor([30])
    base = prior.predict([text.to_neutral(caption)], 1.0)
    with torch.no_grad():
        old, proud, plain = (one(x, t) for one in (*(style.predict(caption) for style in styles), base))
        for weights, expected in (
            ((1.0, 0.0), old),
            ((0.5, 0.5), 0.5 * old + 0.5 * proud),
            ((0.4, 0.0), 0.4 * old + 0.6 * plain),
            ((1.5, -0.5), 1.5 * old - 0.5 * proud),
        ):
            found = blend(dict(zip(styles, weights)), caption, base)(x, t)
            assert torch.allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"pair": "magic"}, "recipe.s pair is .prior. or"),
        ({"steps": 0}, "steps is a whole number from 1"),
        ({"rank": -1}, "rank is a whole number from 0"),
        ({"weights": (1.0, -0.1)}, "two weights"),
        ({"weights": 1.0}, "two weights"),
        ({"rate": 0.0}, "rate is above 0"),
        ({"rate": "fast"}, "rate is above 0"),
    ],
)
def test_recipes_that_cannot_be(wrong, message):
    with pytest.raises(mk.MotionKitError, match=message):
        Recipe(**wrong)


def test_a_recipe_is_changed_by_what_it_has():
    assert Recipe().changed(steps=3) == Recipe(steps=3)
    with pytest.raises(mk.MotionKitError, match="a recipe has no 'chnge'; it has noise, change"):
        Recipe().changed(chnge=3)


def test_the_papers_recipe():
    paper = Recipe.paper()
    assert (paper.noise, paper.change, paper.chain, paper.weights) == (950, 300, 20, (1.0, 0.1))
    assert (paper.batch, paper.rate, paper.rank, paper.pair_steps) == (64, 1e-4, 0, None)
    assert paper.steps == math.ceil(23384 / 64) == Recipe.laptop().steps
