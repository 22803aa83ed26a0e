"""Paper 1's second stage: noise forwards and back, the neutral pair, the losses, LoRA, files of learned styles; and the
method as a user calls it: learn from a clip, restyle any other one, and what it refuses."""

import math
import pickle
from dataclasses import replace

import pytest
import torch

import motionkit as mk
from motionkit import sampling, text
from motionkit.actor import perform, retell
from motionkit.arena.transfers import error_against
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.features import FacingFree
from motionkit.layers import Denoiser, LoRA, TransformerConfig, semantic_loss
from motionkit.methods.few_shot import (
    Config,
    ContentBank,
    FinetuneLoss,
    FinetuneTask,
    LearnedStyle,
    blend,
    finetune,
    neutral_pair,
)
from motionkit.methods.text_to_motion import Prior
from motionkit.sampling import PartialDiffusion

PROMPT = "an old person is walking"
QUICK = Config(steps=2, batch=1, pair_steps=10)
WALKS = Labels(texts=("a person is walking",))


@pytest.fixture(scope="module")
def prior() -> Prior:
    return mk.methods.text_to_motion.load("actor")


@pytest.fixture(scope="module")
def judge():
    return mk.methods.text_to_motion.load_discriminator("actor")


@pytest.fixture(scope="module")
def pair_of_walks():
    """An old walk of 4 s, and the same walk done neutrally, frame by frame."""
    old = perform("walk", "old", seed=5, seconds=4.0)
    return old.motion, retell(old, "neutral").time_aligned(old)


@pytest.fixture(scope="module")
def task(prior, pair_of_walks) -> FinetuneTask:
    partial, generator = PartialDiffusion.from_paper(prior.schedule), torch.Generator().manual_seed(0)
    styled, neutral = (prior.encode(motion) for motion in pair_of_walks)
    clean = torch.stack([neutral[:40], neutral[40:80]])
    noised = clean + 0.1 * torch.randn(clean.shape, generator=generator)
    contents = ContentBank(noised, ("a person is walking neutrally", "a person is kicking neutrally"))
    return FinetuneTask(prior, partial, styled[:40], neutral[:40], PROMPT, "old", contents)


@pytest.fixture(scope="module")
def losses(task, judge) -> FinetuneLoss:
    return FinetuneLoss(task.partial, judge.network, (1.0, 0.1))


def test_partial_diffusion_has_the_papers_steps_in_any_schedule(prior):
    paper = mk.diffusion.NoiseSchedule.cosine(1000)
    assert PartialDiffusion.from_paper(paper).timesteps == (300, 250, 200, 150, 100, 50)  # section 4: 6 steps of 20
    timesteps = PartialDiffusion.from_paper(prior.schedule).timesteps
    assert len(timesteps) == 6
    for theirs, ours in zip((300, 250, 200, 150, 100, 50), timesteps):
        assert abs(float(paper.log_snr[theirs] - prior.schedule.log_snr[ours])) < 0.12


def test_forward_and_back_is_the_motion_again():
    partial = PartialDiffusion.from_paper(mk.diffusion.NoiseSchedule.cosine(1000), K=200)
    x, clean = torch.randn(2, 8, 3), torch.full((2, 8, 3), 0.5)
    noised = partial.forward(lambda x, t: clean, x)
    assert torch.allclose(partial.reverse(lambda x, t: clean, noised)[-1], clean)
    assert not torch.allclose(noised, x, atol=0.1)


def test_reverse_gives_every_prediction_and_gradients_through_all_steps():
    partial = PartialDiffusion.from_paper(mk.diffusion.NoiseSchedule.cosine(1000))
    noised = torch.randn(1, 4, 2, dtype=torch.float64)

    def last(a: torch.Tensor) -> torch.Tensor:
        return partial.reverse(lambda x, t: a * x + 0.3, noised)[-1].square().sum()

    a = torch.tensor(0.8, dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(last(a), a)
    step = 1e-6
    difference = last(a.detach() + step) - last(a.detach() - step)
    assert float(slope) == pytest.approx(float(difference) / (2 * step), rel=1e-5)
    one_step_only = 2 * (0.8 * noised + 0.3) * noised  # what one step alone would give
    assert abs(float(slope) - float(one_step_only.sum())) > 1e-3


def test_losses_by_hand(task, losses, prior, judge):
    network, batch = prior.network.eval(), task.draw(1)(0)
    predictions, x, words = [], batch["noised"], prior.encoder.encode([PROMPT])
    timesteps = task.partial.timesteps
    with torch.no_grad():
        for t, s in zip(timesteps, [*timesteps[1:], 0]):  # eq. 9, deterministic DDIM
            x0 = network(x, torch.tensor([t]), words)
            bar_t, bar_s = (float(prior.schedule.alphas_bar[n]) for n in (t, s))
            noise = (x - math.sqrt(bar_t) * x0) / math.sqrt(1 - bar_t)
            x = math.sqrt(bar_s) * x0 + math.sqrt(1 - bar_s) * noise
            predictions.append(x0)
        expected = sum(((x0 - task.styled) ** 2).mean() for x0 in predictions) / len(timesteps)  # eq. 10
        reconstruction = float(losses.reconstruction(network, batch))
        assert reconstruction == pytest.approx(float(expected), rel=1e-4)
        torch.manual_seed(3)
        batch = task.draw(4)(0)
        torch.manual_seed(3)
        chosen = torch.randint(2, (4,))
        styled = prior.encoder.encode(["a person is walking in old age", "a person is kicking in old age"])[chosen]
        noised = task.contents.noised[chosen]
        y = sampling.ddim(lambda x, t: network(x, t, styled), noised, prior.schedule, list(timesteps))
        cosines = torch.nn.functional.cosine_similarity(judge.network(y), styled)
        semantic = float(losses.semantic(network, batch))
        assert semantic == pytest.approx(float((1 - cosines).mean()), abs=1e-4)  # eq. 11
        assert semantic == pytest.approx(float(semantic_loss(judge.network(y), styled)), abs=1e-4)
        assert float(losses(network, batch)) == pytest.approx(reconstruction + 0.1 * semantic, rel=1e-4)  # eq. 12
    total = sampling.total_loss(torch.tensor(2.0), torch.tensor(3.0), (1.0, 0.1))
    assert float(total) == pytest.approx(2.3)
    assert float(sampling.reconstruction_loss(torch.zeros(6, 1, 4, 2), torch.ones(4, 2))) == 1.0


def test_pair_is_neutral_and_keeps_the_path(prior, pair_of_walks):
    old, exact = pair_of_walks
    pair = neutral_pair(prior, old, PROMPT, steps=100)
    example = prior.encode(old)
    path = sampling.feature_mask(prior.layout, "root x velocity", "root z velocity")
    assert torch.equal(pair[:, path], example[:, path])  # eq. 8
    neutral = FacingFree(old.skeleton, old.fps).decode(prior.normalizer.denormalize(pair))
    assert error_against(neutral, exact) < 0.5 * error_against(old, exact)  # eq. 7


def test_a_low_noise_leaves_the_style_in_the_pair(prior, pair_of_walks):
    old = pair_of_walks[0]
    pairs = [neutral_pair(prior, old, PROMPT, steps=60, G=G) for G in (100, 950)]
    gaps = [float((pair - prior.encode(old)).abs().mean()) for pair in pairs]
    assert gaps[0] < 0.5 * gaps[1]


def test_a_bank_of_contents_needs_long_clips_with_captions(prior, pair_of_walks):
    neutral, partial = pair_of_walks[1], PartialDiffusion.from_paper(prior.schedule)
    bank = ContentBank.of(prior, partial, [(neutral, PROMPT), (neutral[:20], "")], frames=40)  # one is too short
    assert bank.noised.shape == (1, 40, prior.layout.size) and bank.captions == (text.to_neutral(PROMPT),)
    with pytest.raises(mk.MotionKitError, match="no neutral clip has 400 frames"):
        ContentBank.of(prior, partial, [(neutral, PROMPT)], frames=400)
    with pytest.raises(mk.MotionKitError, match="has no caption, which the semantic loss needs"):
        ContentBank.of(prior, partial, [(neutral, "")], frames=40)


def test_lora_changes_nothing_at_first_and_by_the_book_then():
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
    assert sum(2 * p.numel() for p in LoRA(network, Config.laptop().rank).changes.parameters()) < 1e6


@pytest.mark.slow
def test_finetuning_lowers_the_loss_and_leaves_the_prior_alone(task, losses, prior, judge, tmp_path):
    before = {name: weight.clone() for name, weight in prior.network.state_dict().items()}
    config = Config(steps=12, batch=2, lr=3e-3)
    adapter, run = finetune(task, judge, config, title="")
    assert run.losses[-1] < 0.7 * run.losses[0]
    assert all(torch.equal(before[name], weight) for name, weight in prior.network.state_dict().items())
    with torch.no_grad():
        batch = task.draw(2)(0)
        after, plain = (float(losses.reconstruction(network, batch)) for network in (adapter, prior.network))
    assert after < 0.7 * plain

    def stop(step: int, loss: float) -> None:
        if step == 5:
            raise KeyboardInterrupt

    resume = tmp_path / "old.run"
    with pytest.raises(KeyboardInterrupt):
        finetune(task, judge, config, title="", resume=resume, callback=stop)
    again, _ = finetune(task, judge, config, title="", resume=resume)
    assert all(torch.equal(a, b) for a, b in zip(adapter.parameters(), again.parameters()))


def test_the_semantic_loss_counts(task, losses, judge):
    with_meaning, _ = finetune(task, judge, Config(steps=3, batch=2), title="")
    plain = replace(task, contents=None)  # as `FewShot.task` makes it where the weight of the loss is 0
    without, run = finetune(plain, judge, Config(steps=3, batch=2, loss_weights=(1.0, 0.0)), title="")
    assert any(not torch.equal(a, b) for a, b in zip(with_meaning.parameters(), without.parameters()))
    expected = float(losses.reconstruction(task.prior.network, plain.draw(2)(0)).detach())
    assert run.losses[0] == pytest.approx(expected, rel=1e-3)


@pytest.fixture(scope="module")
def styles(task, prior) -> list[LearnedStyle]:
    learned = []
    for seed, name in ((0, "old"), (1, "proud")):
        adapter = LoRA(prior.network, 4, seed)
        with torch.no_grad():
            for change in adapter.changes.values():
                change.add_(0.01 * torch.randn(change.shape, generator=torch.Generator().manual_seed(seed)))
        learned.append(LearnedStyle(prior, adapter, task.partial, f"a {name} person walks", name))
    return learned


def test_a_saved_style_is_the_same_style(styles, prior, tmp_path):
    x, t = torch.randn(1, 40, prior.layout.size), torch.tensor([30])
    path = styles[0].save(tmp_path / "old.safetensors")
    again = LearnedStyle.load(path, prior=prior)
    caption = "a person is kicking"
    assert torch.allclose(again.predict(caption)(x, t), styles[0].predict(caption)(x, t), atol=2e-2)
    assert (again.name, again.prompt) == ("old", "a old person walks")
    assert again.partial.timesteps == styles[0].partial.timesteps and "thousand parameters" in repr(again)
    data = path.read_bytes()
    path.write_bytes(data[:-100])
    with pytest.raises(mk.MotionKitError, match="damaged"):
        LearnedStyle.load(path, prior=prior)


def test_a_style_of_another_prior_is_refused(styles, prior, tmp_path):
    path = styles[0].save(tmp_path / "old.safetensors")
    other = replace(prior, network=Denoiser(prior.layout.size, prior.encoder.size, prior.network.config))
    with pytest.raises(mk.MotionKitError, match="another prior"):
        LearnedStyle.load(path, prior=other)


def test_blending_is_a_weighted_sum_and_the_rest_is_the_prior(styles, prior):
    caption, x, t = "a person is walking", torch.randn(1, 40, prior.layout.size), torch.tensor([30])
    base = prior.predict([text.to_neutral(caption)], 1.0)
    with torch.no_grad():
        old, proud, plain = (predict(x, t) for predict in (*(style.predict(caption) for style in styles), base))
        for weights, expected in (
            ((1.0, 0.0), old),
            ((0.5, 0.5), 0.5 * old + 0.5 * proud),
            ((0.4, 0.0), 0.4 * old + 0.6 * plain),
            ((1.5, -0.5), 1.5 * old - 0.5 * proud),
        ):
            blended = blend(dict(zip(styles, weights)), caption, base)(x, t)
            assert torch.allclose(blended, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"pair": "magic"}, "config.s pair is .prior. or .knn-dtw."),
        ({"steps": 0}, "steps is a whole number from 1"),
        ({"rank": -1}, "rank is a whole number from 0"),
        ({"loss_weights": (1.0, -0.1)}, "two loss weights"),
        ({"loss_weights": 1.0}, "two loss weights"),
        ({"lr": 0.0}, "rate is above 0"),
        ({"lr": "fast"}, "rate is above 0"),
    ],
)
def test_configs_that_cannot_be(wrong, message):
    with pytest.raises(mk.MotionKitError, match=message):
        Config(**wrong)


def test_a_config_is_changed_by_what_it_has():
    assert Config().changed(steps=3) == Config(steps=3)
    with pytest.raises(mk.MotionKitError, match="a config has no 'chnge'; it has G, K"):
        Config().changed(chnge=3)


def test_the_papers_config():
    paper = Config.paper()
    assert (paper.G, paper.K, paper.S, paper.loss_weights) == (950, 300, 20, (1.0, 0.1))
    assert (paper.batch, paper.lr, paper.rank, paper.pair_steps) == (64, 1e-4, 0, None)
    assert paper.steps == math.ceil(23384 / 64) == Config.laptop().steps


@pytest.fixture(scope="module")
def library():
    return from_items("mine", [walk_item("data/actor/walk_neutral.bvh", "neutral")])


def walk_item(path, style: str) -> Item:
    return Item("walk", Labels("walk", style, ("a person is walking",)), BvhSource.at(path))


@pytest.fixture(scope="module")
def method(library):
    return mk.methods.load("few-shot", library=library, config=QUICK)


@pytest.fixture(scope="module")
def plain(method) -> LearnedStyle:
    """A style that changes nothing in the prior."""
    return LearnedStyle(method.prior, LoRA(method.prior.network, 1), method.partial, "an old person walks", "old")


@pytest.fixture
def mute(method, plain) -> LearnedStyle:
    """The same, and its sentence says nothing of a style."""
    style = replace(plain)  # a copy: other tests have the style as it is
    style.predict = lambda caption: method.prior.predict([caption], 1.0)
    return style


@pytest.fixture(scope="module")
def learned(method) -> LearnedStyle:
    return method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="")


def test_learn_then_stylize(method, learned):
    walk = mk.load("data/actor/walk_neutral.bvh")
    assert (learned.name, learned.card["steps"]) == ("old", 2) and isinstance(learned.adapter, LoRA)
    out = method.stylize(walk, learned)
    assert (len(out), out.fps, out.skeleton.names) == (len(walk), walk.fps, walk.skeleton.names)
    assert out.name == "walk_neutral as old"
    assert torch.equal(out.rotations, method.stylize(walk, style=learned).rotations)
    half = method.stylize(walk, learned, strength=0.5)
    both = method.stylize(walk, style={learned: 0.5})
    assert torch.allclose(half.rotations, both.rotations, atol=1e-5)


def test_no_strength_is_the_content_itself(method, learned):
    walk = mk.load("data/actor/walk_neutral.bvh")
    for lock_feet in (True, False):
        out = method.stylize(walk, learned, strength=0, lock_feet=lock_feet)
        assert out.rotations is walk.rotations and out.translations is walk.translations
    with pytest.raises(mk.MotionKitError, match="knows no style by name"):  # wrong all the same
        method.stylize(walk, "old", strength=0)


def test_a_style_must_be_given_each_time(method, learned):
    """What was learned last is no style by default."""
    with pytest.raises(TypeError, match="style"):
        method.stylize(mk.load("data/actor/walk_neutral.bvh"))


def test_labels_say_what_the_content_is(method, learned):
    walk = mk.load("data/actor/walk_neutral.bvh")
    asked = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(method), "caption_of", lambda self, content: asked.append(content) or "a person is walking")
        by_sentence = method.stylize(walk, learned, labels=WALKS)
        assert not asked
        assert torch.equal(method.stylize(walk, learned).rotations, by_sentence.rotations) and len(asked) == 1
    kick = method.stylize(walk, learned, labels=Labels(texts=("a person is kicking",)))
    assert not torch.equal(kick.rotations, by_sentence.rotations)
    styled = method.stylize(walk, learned, labels=WALKS._replace(style="old"))  # made neutral first
    assert not torch.equal(styled.rotations, by_sentence.rotations)
    another = method.stylize(walk, learned, labels=WALKS._replace(style="old"), seed=5)  # another neutral motion
    assert not torch.equal(styled.rotations, another.rotations)
    neutral = method.stylize(walk, learned, labels=WALKS._replace(style="neutral"))
    assert torch.equal(neutral.rotations, by_sentence.rotations)


@pytest.mark.slow
def test_a_clip_is_learned_when_it_first_comes(method, monkeypatch):
    walk, old = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old"))
    prompts, learn = [], method.learn

    def counted(style, prompt, **more):
        prompts.append(prompt)
        return learn(style, prompt, **more)

    monkeypatch.setattr(method, "learn", counted, raising=False)
    example = mk.methods.Example(old, Labels("walk", "old", ("an old person walks",)))
    first, again = (method.stylize(walk, example, labels=WALKS) for _ in range(2))
    assert prompts == ["an old person walks"] and torch.equal(first.rotations, again.rotations)
    method.stylize(walk, old, labels=WALKS)  # nothing is said of it: a sentence of its own
    assert len(prompts) == 2 and "given" in prompts[1]
    neutral = method.stylize(old, mk.methods.Example(walk, Labels("walk", "neutral")), labels=WALKS)
    assert len(prompts) == 2 and len(neutral) == len(old)  # of a neutral clip there is nothing to learn


def test_a_file_of_the_style_does_the_same(method, learned, tmp_path):
    walk = mk.load("data/actor/walk_neutral.bvh")
    before = method.stylize(walk, learned, labels=WALKS)
    again = method.load_style(learned.save(tmp_path / "old.safetensors"))
    after = method.stylize(walk, again, labels=WALKS)
    assert float((after.positions() - before.positions()).abs().max()) < 0.02


def test_a_neutral_prompt_leaves_the_content(method, mute):
    """Forwards and back by the same prior with nearly the same words is the content again."""
    walk = perform("walk", "neutral", seed=9, seconds=4.0).motion
    labels = Labels(texts=("a person is walking neutrally",))
    out = method.stylize(walk, mute, labels=labels, lock_feet=False)
    gap = torch.linalg.vector_norm(out.at_origin().positions() - walk.at_origin().positions(), dim=-1)
    assert float(gap.mean()) < 0.05


def test_any_frame_rate_and_any_length(method, mute):
    long = perform("walk", "neutral", seed=3, seconds=12.0).motion
    fast = long.resample(60)
    slow, quick = (method.stylize(motion, mute, labels=WALKS) for motion in (long, fast))
    assert (len(slow), len(quick), quick.fps) == (len(long), len(fast), 60)
    gap = quick.resample(30).positions()[: len(slow)] - slow.positions()[: len(quick.resample(30))]
    assert float(gap.abs().mean()) < 0.03
    jumps = torch.linalg.vector_norm(slow.positions().diff(n=2, dim=0), dim=-1).amax(1)
    theirs = torch.linalg.vector_norm(long.positions().diff(n=2, dim=0), dim=-1).amax(1)
    assert float(jumps.max()) < 2 * float(theirs.max())  # no seam between windows


def test_content_that_is_styled_is_made_neutral_first(method, mute):
    old = perform("walk", "old", seed=5, seconds=4.0)
    exact = retell(old, "neutral").time_aligned(old)
    slow = method.with_config(pair_steps=100)
    as_it_is = slow.stylize(old.motion, mute, labels=WALKS, lock_feet=False)
    neutral = slow.stylize(old.motion, mute, labels=WALKS._replace(style="old"), lock_feet=False)
    assert error_against(neutral, exact) < 0.6 * error_against(as_it_is, exact)


def test_neutral_motion_keeps_the_path_or_goes_with_the_movements(method):
    old = perform("walk", "old", seed=5, seconds=4.0).motion
    kept = method.neutral_motion(old, "an old person is walking", lock_feet=False)
    assert float((kept.root_path() - old.root_path()).abs().max()) < 0.05 and kept.name == f"{old.name}, neutral"
    neutral, labels = mk.methods.Example(old, Labels(style="neutral")), Labels(texts=("an old person is walking",))
    warped = method.stylize(old, neutral, labels=labels, lock_feet=False)
    assert torch.allclose(kept.rotations, warped.rotations, atol=1e-5)


def test_another_skeleton_is_retargeted(method, plain, captures_dir):
    walk = mk.load(captures_dir / "dataset-2_walk_normal_001.bvh")[:90]
    out = method.stylize(walk, plain, labels=WALKS)
    assert out.skeleton.names == walk.skeleton.names and len(out) == len(walk)
    learned = method.learn(walk, "an old person walks", title="")
    assert learned.neutral.shape[1] == method.prior.layout.size


def test_a_library_on_another_skeleton_serves_the_semantic_loss(captures_dir):
    library = from_items("captured", [walk_item(captures_dir / "dataset-2_walk_normal_001.bvh", "normal")])
    method = mk.methods.load("few-shot", library=library, config=QUICK)
    learned = method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="")
    assert learned.name == "old" and method.contents.noised.shape[2] == method.prior.layout.size


def test_the_caption_is_found(method):
    kick = perform("kick", "neutral", seed=1, seconds=4.0).motion
    assert "kick" in method.caption_of(kick)


def test_knn_pairs(library):
    method = mk.methods.load("few-shot", library=library, config=Config(steps=1, batch=1, pair="knn-dtw"))
    learned = method.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", content="walk", title="")
    assert learned.neutral.isfinite().all()


def test_a_new_config_keeps_the_rest(method):
    other = method.with_config(K=200)
    assert (other.config.K, other.prior, other.pairs) == (200, method.prior, method.pairs)
    assert other.partial.timesteps != method.partial.timesteps
    walk = perform("walk", "neutral", seed=3, seconds=2.0).motion
    reconstruction_only = method.with_config(loss_weights=(1.0, 0.0))
    learned = reconstruction_only.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="")
    assert len(reconstruction_only.stylize(walk, learned)) == 60


def test_a_pickled_method_answers_the_same(method, learned, library):
    again = pickle.loads(pickle.dumps(method))
    assert again.config == method.config and "pairs" not in vars(again)  # what was worked out stays behind
    walk = mk.load("data/actor/walk_neutral.bvh")
    out, other = (one.stylize(walk, learned, labels=WALKS._replace(style="old")) for one in (method, again))
    assert torch.equal(out.rotations, other.rotations) and torch.equal(out.translations, other.translations)
    assert method.with_config(steps=1).fit(library).pairs is not method.pairs


@pytest.mark.slow
def test_in_the_arena(library):
    test = mk.datasets.load("actor").split().test
    few = test.filter(content=["walk", "kick"], style=["neutral", "old"])
    split = mk.datasets.Split(library, few[:0], few)
    table = mk.arena.run(
        mk.methods.load("few-shot", library=library, config=QUICK),
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
        (lambda m, w: m.task(w[:20], "an old person walks"), r"lasts 0.67 s; .* from 1 s"),
        (lambda m, w: m.learn(w, "a person walks"), "says nothing of a style"),
        (lambda m, w: m.learn(w, ""), "says nothing of a style|empty"),
        (lambda m, w: m.learn("walk.bvh", "an old person walks"), "learns a style from a Motion"),
        (lambda m, w: m.stylize(w, style="purple"), "knows no style by name, 'purple' neither; .* method.learn"),
        (lambda m, w: m.stylize(w, style="old"), "knows no style by name, 'old' neither; .* method.learn"),
        (lambda m, w: m.stylize(w, style={"old": 0.5, "proud": 0.5}), "knows no style by name, 'old' neither"),
        (lambda m, w: m.stylize(w, style="an old person walks"), "knows no style by name"),
        (lambda m, w: m.stylize(w, style=["old", "proud"]), "several styles are mixed with weights"),
        (lambda m, w: m.stylize(w, style="old.safetensors"), r"read it first: method.load_style\('old.safetensors'\)"),
        (lambda m, w: m.stylize(w, style="old.bvh"), r"read it first: mk.load\('old.bvh'\)"),
        (lambda m, w: m.stylize(w, style="old", strength=50), "strength must be a number from -5 to 5"),
        (lambda m, w: mk.methods.load("few-shot", config="laptop"), "a config is mk.methods.few_shot.Config.laptop"),
        (
            lambda m, w: mk.methods.load("few-shot", config=Config.laptop),
            "a config is mk.methods.few_shot.Config.laptop",
        ),
        (lambda m, w: mk.methods.load("few-shot", seed="a"), "a seed is a whole number"),
        (lambda m, w: m.stylize(w, style={}), "takes learned styles or a clip"),
        (lambda m, w: m.stylize(w, style=None), "takes learned styles or a clip"),
        (lambda m, w: m.stylize(w, style=7), "takes learned styles or a clip"),
        (lambda m, w: m.stylize(w, style={7: 1.0}), "takes learned styles"),
        (lambda m, w: m.learn(w, None), "from a clip and a sentence"),
        (lambda m, w: m.learn(w, 7), "from a clip and a sentence"),
        (lambda m, w: m.learn(w, "an old person walks", config=QUICK), "not 'config': give it to mk.methods.load"),
        (lambda m, w: m.load_style("old.bvh"), "weights are .safetensors files"),
        (lambda m, w: m.load_style(3), "weights are .safetensors files"),
        (lambda m, w: mk.methods.load("few-shot", prior="dragons"), "no checkpoint"),
        (lambda m, w: mk.methods.load("few-shot", prior=m.prior), "give its discriminator too"),
    ],
)
def test_bad_input_is_one_clear_error(method, make, message):
    with pytest.raises(mk.MotionKitError, match=message):
        make(method, mk.load("data/actor/walk_neutral.bvh"))


@pytest.mark.parametrize("wrong", [float("nan"), "a"])
def test_weights_of_a_mix_are_numbers(method, plain, wrong):
    with pytest.raises(mk.MotionKitError, match=f"weight of style 'old' must be a number .* found {wrong!r}"):
        method.stylize(mk.load("data/actor/walk_neutral.bvh"), {plain: wrong})


def test_a_style_learned_with_another_prior_is_refused(method, library, plain):
    walk = mk.load("data/actor/walk_neutral.bvh")
    other = replace(method.prior, network=Denoiser(199, method.prior.encoder.size, method.prior.network.config))
    theirs = LearnedStyle(other, LoRA(other.network, 1), method.partial, "an old person walks", "old")
    with pytest.raises(mk.MotionKitError, match="another prior"):
        method.stylize(walk, theirs)
    fresh = mk.methods.load("few-shot", library=library, config=QUICK)
    assert len(fresh.stylize(walk, plain)) == len(walk)  # loaded twice, but the same weights


def test_a_creature_is_refused(method, plain):
    dog = perform("walk", "neutral", performer="dog", seconds=3.0).motion
    with pytest.raises(mk.MotionKitError):
        method.stylize(dog, style=plain)
