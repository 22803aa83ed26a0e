"""Priors: captions, the normalizer, retrieval with known answers, prompts, files, and every kind of bad input."""

import json
import random
import warnings
from pathlib import Path

import pytest
import torch

import motionkit as mk
from motionkit import sampling, text
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.batches import _LEAST_SPREAD, _ROOT_WEIGHT, fit_normalizer
from motionkit.datasets.loading import from_items
from motionkit.diffusion import NoiseSchedule
from motionkit.features.facing_free import OfBody
from motionkit.files import MotionKitWarning
from motionkit.layers import TransformerConfig
from motionkit.methods import text_to_motion
from motionkit.methods.text_to_motion import Discriminator, Prior, Sentences, ood_captions
from motionkit.metrics import recall_at_k
from motionkit.text.encoders import TextEncoder, content_key
from motionkit.text.train import meanings, nonsense, texts_for
from motionkit.training import TrainConfig

ACTOR = Path(__file__).resolve().parent.parent / "data" / "actor"
SMALL = TransformerConfig(32, 1, 2, 32, frames_per_token=4, frames=48, dropout=0.0)


def config(**changes) -> text_to_motion.Config:
    return text_to_motion.Config(**{"sizes": SMALL, "batch": 6, **changes})


class Letters(TextEncoder):
    """Sentences as how often each pair of letters is in them: no weights, and the same on every machine."""

    name, size = "letters", 64

    def __init__(self, key: str = "a") -> None:
        self.key = content_key({}, key)

    def embed(self, texts: list[str]) -> torch.Tensor:
        found = torch.zeros(len(texts), self.size)
        for row, sentence in zip(found, texts):
            for a, b in zip(sentence, sentence[1:]):
                row[(ord(a) * 31 + ord(b)) % self.size] += 1
        return found


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """Six clips of the performer's in three meanings, and the cache for them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        items = []
        for content, style in (("walk", "old"), ("walk", "angry"), ("run", "angry")):
            source = BvhSource.at(ACTOR / f"{content}_{style}.bvh")
            said = texts_for(content, style)[:3]
            items += [Item(f"{content}_{style}_{n}", Labels(content, style, said, take=f"{n}"), source) for n in (0, 1)]
        yield from_items("six", items)


@pytest.fixture(scope="module")
def split(clips):
    return mk.datasets.Split(clips, clips[:0], clips)


@pytest.fixture(scope="module")
def prior(split):
    """Hardly trained, of one layer, with 20 steps of noise."""
    return text_to_motion.train_prior(split, Letters(), config(noise=NoiseSchedule.cosine(20)), TrainConfig(6, ema=0.5),
                                      title="")  # fmt: skip


@pytest.fixture(scope="module")
def judge(split, prior):
    return text_to_motion.train_discriminator(split, prior, TrainConfig(40, lr=3e-3), batch=6, title="")


@pytest.fixture
def saved(prior, tmp_path):
    return prior.save(tmp_path / "six-prior.safetensors")


PROMPT = "an old person walks"


def make(prior: Prior, prompts=PROMPT, seconds=1.0, **more) -> list[mk.Motion]:
    """Without a word about prompts that are far."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionKitWarning)
        return prior.generate(prompts, seconds, **{"steps": 4, **more})


def equal(a: mk.Motion, b: mk.Motion) -> bool:
    return torch.equal(a.positions(), b.positions())


def test_captions_of_a_clip_are_drawn_for_it(clips):
    sentences, encoder = Sentences.of(clips, Letters()), Letters()
    assert sentences.starts.tolist() == [0, 3, 6, 9, 12, 15, 18]
    torch.manual_seed(0)
    asked = torch.tensor([4, 0, 4, 2] * 25)
    drawn = sentences.draw(asked)
    for n in (0, 2, 4):
        own = encoder.encode(clips[n].texts)
        rows = drawn[asked == n]
        hits = (rows[:, None] == own[None]).all(-1)
        assert hits.any(1).all() and hits.any(0).all()  # only its own, and all of them


def test_clips_without_captions_are_named(clips):
    mute = from_items("mute", [Item("walk_1", Labels("walk", "old", ()), BvhSource.at(ACTOR / "walk_old.bvh"))])
    with pytest.raises(mk.MotionKitError, match="clip 'walk_1' has no caption"):
        Sentences.of(mute, Letters())
    with pytest.raises(mk.MotionKitError, match="clip 'walk_1' has no caption"):
        text_to_motion.train_prior(mk.datasets.Split(mute, mute, mute), Letters(), config(), TrainConfig(1), title="")


def test_the_normalizer_has_floors_and_weighs_the_root(clips):
    encoded, found = fit_normalizer(clips)
    rows = torch.cat([encoded.layout.encode(clip.motion) for clip in clips]).double()
    plain, parts = rows.std(0, correction=0), encoded.layout.slices
    assert torch.allclose(found.mean.double(), rows.mean(0), atol=1e-4)
    for name in ("positions", "rotations"):
        std, part = found.std[parts[name]].double(), plain[parts[name]]
        least = _LEAST_SPREAD * part.square().mean().sqrt()
        assert torch.allclose(std, part.clamp(min=float(least)), rtol=1e-3) and (part < least).any()
    speed = plain[1:3].clamp(min=float(_LEAST_SPREAD * plain[1:3].square().mean().sqrt()))
    assert torch.allclose(found.std[1:3].double(), speed / _ROOT_WEIGHT, rtol=1e-3)
    assert found.std[0].item() == pytest.approx(plain[0].item() / _ROOT_WEIGHT, rel=1e-3)


def on_the_ground(motion: mk.Motion) -> mk.Motion:
    """The same body under a helper joint that drifts away from it, as in some captures."""
    own = motion.skeleton
    parents = (-1, *(parent + 1 for parent in own.parents))
    skeleton = mk.Skeleton(("ground", *own.names), parents, torch.cat((torch.zeros(1, 3), own.offsets)))
    still = torch.tensor([1.0, 0, 0, 0]).expand(len(motion), 1, 4)
    drift = torch.arange(float(len(motion)))[:, None, None] * torch.tensor([0.05, 0.0, 0.02])
    places = torch.cat((drift, motion.translations), 1)
    places[:, 1] -= drift[:, 0]
    return motion.replace(skeleton=skeleton, rotations=torch.cat((still, motion.rotations), 1), translations=places)


def test_helper_joints_above_the_pelvis_are_not_seen(clips, prior, judge):
    walk = clips[0].motion
    helped = on_the_ground(walk)
    assert torch.allclose(helped.positions()[:, 1:], walk.positions(), atol=1e-5)
    assert torch.allclose(OfBody().encode(helped), OfBody().encode(walk), atol=1e-5)
    assert torch.allclose(prior.encode(helped), prior.encode(walk), atol=1e-2)
    assert torch.allclose(judge.embed([helped]), judge.embed([walk]), atol=1e-3)


def some(count: int, size: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(count, size, generator=torch.Generator().manual_seed(seed))


def test_recall_with_known_answers():
    ones = torch.eye(40)
    assert recall_at_k(ones, ones, range(40)) == {"r1": 100.0, "r3": 100.0}
    assert recall_at_k(-ones, ones, range(40)) == {"r1": 0.0, "r3": 0.0}  # the own sentence is the farthest
    second = ones + 2 * ones.roll(1, 0)
    found = recall_at_k(second, ones, range(40), among=40)
    assert found == {"r1": 0.0, "r3": 100.0}
    by_chance = recall_at_k(some(500, 16), some(500, 16, 1), range(500), rounds=200)
    assert by_chance["r1"] == pytest.approx(100 / 32, abs=1.0) and by_chance["r3"] == pytest.approx(300 / 32, abs=1.5)


def test_recall_of_who_says_the_same_of_all_is_chance():
    same = torch.ones(40, 4)
    for motions, texts in ((same, same), (some(40, 4), same)):
        assert recall_at_k(motions, texts, range(40)) == {"r1": round(100 / 32, 2), "r3": round(300 / 32, 2)}


def test_recall_counts_no_sentence_of_the_same_meaning_as_wrong():
    groups = [n // 2 for n in range(80)]
    vectors = torch.eye(40).repeat_interleave(2, 0)  # both of a group are alike
    assert recall_at_k(vectors, vectors, groups)["r1"] == 100.0
    with pytest.raises(mk.MotionKitError, match="among 32 needs pairs of as many groups; found 3"):
        recall_at_k(vectors, vectors, [n % 3 for n in range(80)])


def test_known_sentences_and_how_near_a_prompt_should_be(clips):
    known, least = ood_captions(clips, Letters())
    assert set(known) <= {sentence for clip in clips for sentence in clip.texts} and len(known) == 9
    encoder = Letters()
    vectors = encoder.encode(known)
    assert 0 < least < 1 and float(text.similarity(encoder.encode(list(known)), vectors).amax(1).min()) > least
    odd = [nonsense(random.Random(n)) for n in range(100)]
    assert (text.similarity(encoder.encode(odd), vectors).amax(1) < least).float().mean() > 0.6
    assert ood_captions(clips, Letters()) == (known, least)


def test_meanings_are_told_apart():
    found = meanings()
    assert len({(one.content, one.style) for one in found}) == len(found)
    assert all(len(set(one.texts)) == len(one.texts) for one in found)


def test_training_learns_and_says_how_it_was_made(prior, clips, split):
    card = prior.card
    assert card["steps"] == 6 and card["batch"] == 6 and card["drop"] == 0.1 and card["training_clips"] == 6
    assert card["parameters"] == sum(p.numel() for p in prior.network.parameters()) and prior.guided
    losses = []
    text_to_motion.train_prior(split, Letters(), config(), TrainConfig(60, lr=5e-3), title="",
                       callback=lambda _, loss: losses.append(loss))  # fmt: skip
    assert sum(losses[-10:]) < 0.7 * sum(losses[:10])


def test_a_bad_clip_is_named(split):
    class Broken(Letters):
        def encode(self, texts):
            return super().encode(texts) * torch.nan

    with pytest.raises(mk.MotionKitError, match=r"the loss of step 0 is nan.*its batch: (walk|run)_"):
        text_to_motion.train_prior(split, Broken(), config(batch=3), TrainConfig(2), title="")


def test_files_give_the_prior_back_with_16_bits(prior, saved):
    again = Prior.load(saved, encoder=Letters())
    for name, value in prior.network.state_dict().items():
        assert torch.equal(again.network.state_dict()[name], value.half().float()), name
    assert (again.train_captions, again.ood_threshold, again.guided, again.fps) == (
        prior.train_captions,
        prior.ood_threshold,
        True,
        prior.fps,
    )
    assert torch.equal(again.schedule.alphas_bar, prior.schedule.alphas_bar)
    assert torch.equal(again.normalizer.std, prior.normalizer.std) and again.network.config == SMALL
    gap = make(again)[0].positions() - make(prior)[0].positions()
    assert gap.abs().max() < 0.05
    assert equal(
        make(again)[0], make(Prior.load(again.save(saved), encoder=Letters()))[0]
    )  # what is written once is exact


def test_files_that_do_not_fit_are_refused(saved, judge, tmp_path):
    with pytest.raises(mk.MotionKitError, match="another 'letters' encodes them"):
        Prior.load(saved, encoder=Letters("b"))
    with pytest.raises(mk.MotionKitError, match="expected a 'discriminator'"):
        Discriminator.load(saved, encoder=Letters())
    card = json.loads(saved.with_suffix(".json").read_text())
    for change, message in (
        ({"format": 99}, "newer motionkit"),
        ({"config": {**card["config"], "width": 64}}, "trained with another configuration"),
        ({"config": {**card["config"], "layers": 2}}, "encoder.layers.1.* is missing"),
        ({"config": {**card["config"], "gates": 2}}, "this version's TransformerConfig has width, layers"),
        ({"sha256": "0"}, "damaged"),
    ):
        saved.with_suffix(".json").write_text(json.dumps({**card, **change}))
        with pytest.raises(mk.MotionKitError, match=message):
            Prior.load(saved, encoder=Letters())


def test_the_same_seed_gives_the_same_motions(prior):
    for sampler in (sampling.ddim, sampling.ddpm):
        torch.manual_seed(1)
        first = make(prior, [PROMPT, "someone runs"], sampler=sampler, seed=3)
        torch.manual_seed(2)
        state = torch.get_rng_state()
        again = make(prior, [PROMPT, "someone runs"], sampler=sampler, seed=3)
        assert torch.equal(state, torch.get_rng_state())  # nobody else's numbers change
        assert all(equal(a, b) for a, b in zip(first, again)) and not equal(*first)
        assert not equal(first[0], make(prior, [PROMPT, "someone runs"], sampler=sampler, seed=4)[0])
    assert [len(motion) for motion in first] == [30, 30] and first[0].name == PROMPT and first[0].fps == 30


def test_guidance_and_the_sentence_change_the_motion(prior):
    plain, guided = make(prior, scale=1.0)[0], make(prior, scale=4.0)[0]
    assert not equal(plain, guided) and not equal(guided, make(prior, "someone runs", scale=4.0)[0])


def test_what_is_inpainted_is_kept(prior, clips):
    known = prior.encode(clips[0].motion)[:30]
    where = sampling.feature_mask(prior.layout, "root")
    last: dict[int, torch.Tensor] = {}
    inside, seen = sampling.inpainting(known, where), lambda step, x, x0: last.update({step: x[0]})
    kept = make(prior, inpaint=inside, callback=seen)[0]
    assert torch.equal(last[0][:, where], known[:, where]) and not torch.allclose(last[0], known, atol=0.1)
    height = kept.positions()[:, prior.layout.skeleton.pelvis, 1]
    assert torch.allclose(height, clips[0].motion.positions()[:30, clips[0].motion.skeleton.pelvis, 1], atol=1e-3)
    free = make(prior, callback=seen)[0]
    assert not torch.allclose(last[0][:, where], known[:, where], atol=0.1) and not equal(kept, free)


def test_bad_prompts(prior):
    for empty in ("", "  ", ["an old person walks", ""]):
        with pytest.raises(mk.MotionKitError, match="the prompt is empty"):
            make(prior, empty)
    near = prior.train_captions[0]
    with pytest.warns(MotionKitWarning, match=r"far from anything known: similarity 0\.\d\d to the nearest, '"):
        prior.generate("zzyzx qqq", 1.0, steps=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(prior.generate(near, 1.0, steps=2)) == 1


@pytest.mark.parametrize("seconds", [0, -1.0, 1.7, 99, float("nan"), float("inf"), "4", None, [1.0, 1.0]])
def test_bad_lengths(prior, seconds):
    with pytest.raises(mk.MotionKitError, match="seconds"):
        make(prior, PROMPT, seconds)
    assert len(make(prior, PROMPT, 1.6)[0]) == prior.longest == 48


def test_guidance_needs_a_prior_that_did_without_sentences(split):
    deaf = text_to_motion.train_prior(split, Letters(), config(drop=0.0, batch=2), TrainConfig(1), title="")
    with pytest.raises(mk.MotionKitError, match="take scale=1, or train one with drop above 0"):
        make(deaf)
    assert len(make(deaf, scale=1)) == 1


def test_the_discriminator_learns_shares_and_comes_back(judge, prior, clips, tmp_path):
    assert torch.equal(judge.network.embedding.linear.weight, prior.network.embedding.linear.weight)
    assert set(judge.card["metrics"]) == {"r1", "r3"}
    motions, sentences = [clips[n].motion for n in (0, 2, 4)], [clips[n].text for n in (0, 2, 4)]
    found = judge.similarity(motions, sentences)
    assert found.shape == (3, 3) and found.abs().max() <= 1
    again = Discriminator.load(judge.save(tmp_path / "six-discriminator.safetensors"), encoder=Letters())
    assert torch.allclose(again.similarity(motions, sentences), found, atol=1e-2)
    long = clips[0].motion
    middle = (len(long) - judge.longest) // 2
    assert torch.allclose(judge.embed([long]), judge.network(judge.encode(long)[middle : middle + 48][None]), atol=1e-5)
    with pytest.raises(mk.MotionKitError, match="at least one motion"):
        judge.embed([])
