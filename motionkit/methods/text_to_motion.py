"""Paper 1, stage 1: text to motion, and the discriminator that says how well a motion goes with a sentence."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property

import torch
from torch import Tensor, nn
from tqdm.auto import tqdm

from .. import checkpoints, judges, sampling, text
from ..checkpoints import Checkpoint, Saved, load_into, skeleton_card, training_card
from ..datasets import Clip, Dataset, Split
from ..datasets.batches import FeatureCache, WindowSampler, fit_normalizer
from ..diffusion import NoiseSchedule, simple_loss
from ..errors import MotionKitError
from ..features import FacingFree, Normalizer
from ..features.facing_free import OfBody, encode_normalized, scaled_skeleton
from ..judges import Judge
from ..layers import Denoiser, SemanticEncoder, TransformerConfig, semantic_loss
from ..metrics import AMONG, fmd, recall_at_k
from ..motion import Motion
from ..text import TextEncoder, similarity
from ..text.train import nonsense, texts_for
from ..training import TrainConfig, TrainOrder, fit

GUIDANCE_SCALE = 2.0  # of guidance: the least with nine styles of ten named right on `actor`'s validation part
Sampler = Callable[..., Tensor]


@dataclass(eq=False)
class Prior(Checkpoint):
    """Paper 1's text-to-motion model (section 3.3): sentences to motions, for one skeleton and frame rate.

    network: the denoiser. layout, normalizer: what it sees of a motion. schedule: of the noise. encoder: of the
    sentences. train_captions: sentences that it learned from, some of each meaning; ood_threshold: how near to one of
    them a prompt should be.
    guided: whether it also learned to do without a sentence, which guidance needs. card: how it was made.

    >>> import motionkit as mk
    >>> prior = mk.methods.text_to_motion.load("actor")
    >>> prior.generate(["an old person walks"], seconds=2)[0]
    Motion('an old person walks', 60 frames at 30 fps, 2.0 s, 22 joints)
    """

    kind = "prior"

    network: Denoiser
    layout: OfBody
    normalizer: Normalizer
    schedule: NoiseSchedule
    encoder: text.TextEncoder
    train_captions: tuple[str, ...]
    ood_threshold: float
    guided: bool = True
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        millions = sum(p.numel() for p in self.network.parameters()) / 1e6
        return f"Prior({millions:.1f} million parameters, text by {self.encoder.name!r}, {self.layout.skeleton!r})"

    @property
    def fps(self) -> float:
        """Frames a second of what it makes."""
        return self.layout.fps

    @property
    def longest(self) -> int:
        """The most frames of what it learned from, and so of what it makes."""
        return self.network.config.frames

    @cached_property
    def key(self) -> str:
        """The same for the same weights, and for no others: what was learned beside them goes by it."""
        state = {name: value.half() for name, value in self.network.state_dict().items()}  # as `save` writes them
        return text.content_key(state, self.encoder.key)

    @cached_property
    def caption_embeddings(self) -> Tensor:
        """Of the sentences in `train_captions`, [N, E]."""
        return self.encoder.encode(self.train_captions)

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to the normalised features [F, D] that noise is added to."""
        return encode_normalized(motion, self.layout, self.normalizer)

    def decode(self, x: Tensor, name: str = "") -> Motion:
        """Normalised features [F, D] to a motion, by their rotations; it starts at the origin, facing +Z.

        Bones are as long as the positions among the features say, all in one proportion: people of all sizes are made.
        """
        x = self.normalizer.denormalize(x.detach().cpu().float())
        return FacingFree(scaled_skeleton(self.layout, x), self.fps).decode(x).replace(name=name)

    def noise(self, prompts: Sequence[str], frames: int, seed: int = 0) -> Tensor:
        """What sampling starts from, [B, F, D]: standard normal, the same for a seed on every machine."""
        shape = (len(prompts), frames, self.layout.size)
        return torch.randn(shape, generator=torch.Generator().manual_seed(seed))

    def predict(
        self, prompts: Sequence[str], scale: float = GUIDANCE_SCALE, mask: Tensor | None = None
    ) -> sampling.Denoise:
        """The network with these sentences, for any function in `sampling`; see `sampling.guided` for scale.

        mask: bool [B, F], frames that are there, where motions differ in length. Raises MotionKitError for an empty
        sentence, and for guidance where it was trained without. Warns of a sentence that is far from all that it knows,
        and names the nearest.
        """
        if scale != 1 and not self.guided:
            raise MotionKitError(
                "this prior always saw a sentence while it was trained, so it cannot be guided: take scale=1, or train "
                "one with drop above 0"
            )
        for prompt in prompts:
            text.check_prompt(prompt, self.encoder, self.train_captions, self.caption_embeddings, self.ood_threshold)
        vectors, more = self.encoder.encode(prompts), {} if mask is None else {"mask": mask}
        return sampling.classifier_free_guidance(
            self.network.eval(), vectors, torch.zeros(vectors.shape[1]), scale, **more
        )

    @torch.no_grad()
    def generate(
        self,
        prompts: str | Sequence[str],
        seconds: float | Sequence[float] = 4.0,
        *,
        scale: float = GUIDANCE_SCALE,
        sampler: Sampler = sampling.ddim,
        steps: sampling.Steps = 20,
        seed: int = 0,
        **more,
    ) -> list[Motion]:
        """A motion for each sentence (paper 1, section 3.3).

        seconds: of all, or one for each sentence; at most what it learned from. scale: of guidance; 1 is none. sampler,
        steps: from `sampling`. more: what the sampler takes beside, such as `inpaint` and `callback`. Raises
        MotionKitError for a time that is too long or too short, and as `predict`.
        """
        prompts = [prompts] if isinstance(prompts, str) else list(prompts)
        frames = self._frames(seconds, len(prompts))
        longer = torch.tensor(frames)[:, None] + self.network.config.frames_per_token // 2  # the last token whole
        mask = torch.arange(max(frames)) < longer if len(set(frames)) > 1 else None
        predict = self.predict(prompts, scale, mask)
        with torch.random.fork_rng(devices=[]):  # what a sampler draws beside, as ddpm does, follows the seed too
            torch.manual_seed(seed)
            x = sampler(predict, self.noise(prompts, max(frames), seed), self.schedule, steps, **more)
        return [self.decode(one[:count], prompt) for one, prompt, count in zip(x, prompts, frames)]

    def _frames(self, seconds: float | Sequence[float], count: int) -> list[int]:
        each = list(seconds) if isinstance(seconds, Sequence) else [seconds] * count
        if not each or len(each) != count:
            raise MotionKitError(f"expected at least one prompt, and seconds for each; found {count} and {len(each)}")
        for one in each:
            number = isinstance(one, int | float) and math.isfinite(one)
            if not number or not 2 <= round(one * self.fps) <= self.longest:
                raise MotionKitError(
                    f"seconds: this prior learned from motions of up to {self.longest / self.fps:.1f} s "
                    f"({self.longest} frames); found {one!r}: make several and put them together with mk.concatenate"
                )
        return [round(one * self.fps) for one in each]

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network}

    def tensors(self) -> dict[str, Tensor]:
        """What the features and the noise are scaled by."""
        return {"mean": self.normalizer.mean, "std": self.normalizer.std, "alphas_bar": self.schedule.alphas_bar}

    def facts(self) -> dict:
        """Sizes, features, text encoder and the sentences that it learned from."""
        facts = _facts(self.network, self.layout, self.normalizer, self.encoder)
        return {**facts, "guided": self.guided, "known": list(self.train_captions), "least": self.ood_threshold}

    @classmethod
    def restore(cls, saved: Saved, encoder: TextEncoder | None = None) -> Prior:
        """encoder: of the sentences, where it is not one that `text.load` finds by its name."""
        layout, normalizer, encoder = _restored(saved, encoder)
        schedule, card = NoiseSchedule(saved.tensors["alphas_bar"]), saved.card
        network = Denoiser(layout.size, encoder.size, saved.config(TransformerConfig), schedule.steps)
        network = saved.fill("network", network)
        known, guided = tuple(card["known"]), card["guided"]
        return cls(network, layout, normalizer, schedule, encoder, known, card["least"], guided, card)


@dataclass(eq=False)
class Discriminator(Checkpoint):
    """Paper 1's Dis (section 3.3, figure 3): motions as vectors in the space of sentences.

    network: reads normalised features. layout, normalizer: those of the prior whose embedding it shares. encoder: of
    the sentences. card: how it was made.

    >>> import motionkit as mk
    >>> judge = mk.methods.text_to_motion.load_discriminator("actor")
    >>> walk = mk.load("data/actor/walk_old.bvh")
    >>> scores = judge.similarity([walk], ["an old person walks", "a person kicks angrily"])
    >>> bool(scores[0, 0] > scores[0, 1])
    True
    """

    kind = "discriminator"

    network: SemanticEncoder
    layout: OfBody
    normalizer: Normalizer
    encoder: text.TextEncoder
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"Discriminator(text by {self.encoder.name!r}, {self.layout.skeleton!r})"

    @property
    def longest(self) -> int:
        """The most frames that it sees at a time."""
        return self.network.config.frames

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to the normalised features [F, D] that the network reads."""
        return encode_normalized(motion, self.layout, self.normalizer)

    @torch.no_grad()
    def embed(self, motions: Sequence[Motion]) -> Tensor:
        """H_token of each motion, [N, E]; of longer motions than it learned from the middle counts."""
        if not motions:
            raise MotionKitError("expected at least one motion; found none")
        self.network.eval()
        return torch.cat([self.network(self._middle(self.encode(motion))[None]) for motion in motions])

    def _middle(self, x: Tensor) -> Tensor:
        first = max(len(x) - self.longest, 0) // 2
        return x[first : first + self.longest]

    def similarity(self, motions: Sequence[Motion], sentences: Sequence[str]) -> Tensor:
        """Cosine of each motion with each sentence, [N, M] (paper 1, eqs. 6 and 11, without the one minus)."""
        return text.similarity(self.embed(motions), self.encoder.encode(sentences))

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network}

    def tensors(self) -> dict[str, Tensor]:
        """What the features are scaled by."""
        return {"mean": self.normalizer.mean, "std": self.normalizer.std}

    def facts(self) -> dict:
        """Sizes, features and text encoder."""
        return _facts(self.network, self.layout, self.normalizer, self.encoder)

    @classmethod
    def restore(cls, saved: Saved, encoder: TextEncoder | None = None) -> Discriminator:
        """encoder: of the sentences, where it is not one that `text.load` finds by its name."""
        layout, normalizer, encoder = _restored(saved, encoder)
        network = SemanticEncoder(layout.size, encoder.size, saved.config(TransformerConfig))
        return cls(saved.fill("network", network), layout, normalizer, encoder, saved.card)


def _facts(network: nn.Module, layout: OfBody, normalizer: Normalizer, encoder: TextEncoder) -> dict:
    return {
        "config": asdict(network.config),
        "features": "FacingFree",
        "features_hash": normalizer.data_hash,
        "fps": layout.fps,
        "skeleton": skeleton_card(layout.skeleton),
        "text_encoder": encoder.name,
        "text_size": encoder.size,
        "text_key": encoder.key,
    }


def _restored(saved: Saved, encoder: TextEncoder | None) -> tuple[OfBody, Normalizer, TextEncoder]:
    card, tensors = saved.card, saved.tensors
    encoder = saved.encoder(encoder or text.load(card["text_encoder"]))
    normalizer = Normalizer(tensors["mean"], tensors["std"], card["features"], card["features_hash"])
    return OfBody(saved.skeleton, card["fps"]), normalizer, encoder


LR = 7e-4
STEPS = {"prior": 25000, "discriminator": 1000}
SHORTEST = 40  # frames of a window


@dataclass(frozen=True)
class Config:
    """Sizes and data of the prior and the discriminator.

    sizes: of the networks. noise: the schedule; the cosine with 1000 steps and six times its noise-to-signal ratio,
    since how fast a motion goes is settled where there is least signal. drop: share of the motions that come without
    their sentence, which guidance needs. batch: windows a step.

    >>> Config.paper().sizes.width, Config.laptop().sizes.width
    (512, 192)
    """

    sizes: TransformerConfig
    noise: NoiseSchedule = field(default_factory=lambda: NoiseSchedule.cosine(1000).snr_shift(6.0), repr=False)
    drop: float = 0.1
    batch: int = 48

    @classmethod
    def paper(cls) -> Config:
        """Paper 1, section 4: 8 layers, 512 wide, a token a frame, 1000 steps of the plain cosine, batch 64."""
        return cls(TransformerConfig.paper(), NoiseSchedule.cosine(1000), batch=64)

    @classmethod
    def laptop(cls) -> Config:
        """The same parts at a size that trains on two cores within the hour."""
        return cls(TransformerConfig.laptop())

    @classmethod
    def tiny(cls) -> Config:
        """For tests."""
        return cls(TransformerConfig.tiny())


@dataclass(frozen=True, eq=False)
class Sentences:
    """The captions of clips as vectors. vectors: [N, E], one for each caption; starts: long [C + 1], of each clip."""

    texts: tuple[str, ...]
    vectors: Tensor
    starts: Tensor

    @classmethod
    def of(cls, clips: Sequence[Clip], encoder: TextEncoder) -> Sentences:
        """All captions of these clips; MotionKitError if one has none."""
        mute = next((clip.name for clip in clips if not clip.texts), None)
        if mute is not None:
            raise MotionKitError(f"clip {mute!r} has no caption, and a prior learns from captions; give it texts")
        texts = tuple(text for clip in clips for text in clip.texts)
        starts = torch.tensor([0, *(len(clip.texts) for clip in clips)]).cumsum(0)
        return cls(texts, encoder.encode(texts), starts)

    def draw(self, clips: Tensor) -> Tensor:
        """A random caption's vector for each of these clips, [B, E]."""
        counts = self.starts[1:] - self.starts[:-1]
        return self.vectors[self.starts[clips] + (torch.rand(len(clips)) * counts[clips]).long()]


def train_prior(
    data: Dataset | Split,
    encoder: TextEncoder,
    config: Config | None = None,
    training: TrainConfig | None = None,
    *,
    start: Prior | None = None,
    **running,
) -> Prior:
    """Paper 1's generative prior (section 3.3, eq. 5) on the training part of a dataset with captions.

    config: `Config.laptop()` if left out. start: a prior to go on from, of the same sizes, with its normalizer and
    noise. running: as in `fit`. Raises MotionKitError for clips without captions, or where `start` has other sizes.
    """
    split = data.split() if isinstance(data, Dataset) else data
    config = config or Config.laptop()
    noise, batch_size = config.noise, config.batch
    training = training or TrainConfig(STEPS["prior"], LR, weight_decay=1e-2, ema=0.999)
    features, normalizer = fit_normalizer(split.train)
    if start is not None:
        normalizer, noise = start.normalizer, start.schedule
    torch.manual_seed(training.seed)
    network = Denoiser(features.layout.size, encoder.size, config.sizes, noise.steps)
    if start is not None:
        load_into(network, start.network.state_dict(), "start")
    sentences = Sentences.of(split.train, encoder)
    windows = WindowSampler(features, normalizer, batch_size, (SHORTEST, config.sizes.frames))

    def draw(step: int) -> dict:
        batch = windows.sample()
        kept = torch.rand(batch_size, 1) >= config.drop  # the others come without their sentence
        batch["text"] = sentences.draw(batch["clips"]) * kept
        return batch | {"t": torch.randint(1, noise.steps + 1, (batch_size,))}

    def loss_fn(network: nn.Module, batch: dict) -> Tensor:
        text, mask = batch["text"], batch["mask"]
        return simple_loss(lambda x, t: network(x, t, text, mask), batch["x"], noise, batch["t"], mask)

    run = fit(network, draw, loss_fn, training, **running)
    captions, threshold = ood_captions(split.train, encoder)
    card = {**training_card(split.train, training, run, network), "batch": batch_size, "drop": config.drop}
    card |= {} if start is None else {"started_from": {k: start.card.get(k) for k in ("command", "steps", "seconds")}}
    return Prior(network, features.layout, normalizer, noise, encoder, captions, threshold, config.drop > 0, card)


def train_discriminator(
    data: Dataset | Split, prior: Prior, training: TrainConfig | None = None, *, batch: int = 48, **running
) -> Discriminator:
    """Paper 1's motion-semantic discriminator (section 3.3, eq. 6), with a prior's embedding, which stays as it is.

    Sizes are the prior's. The card holds R@1 and R@3 among 32 sentences on the test part. running: as in `fit`.
    """
    split = data.split() if isinstance(data, Dataset) else data
    training = training or TrainConfig(STEPS["discriminator"], LR, weight_decay=1e-2, ema=0.999)
    config, sentences = prior.network.config, Sentences.of(split.train, prior.encoder)
    torch.manual_seed(training.seed)
    network = SemanticEncoder(prior.layout.size, prior.encoder.size, config, prior.network.embedding)
    windows = WindowSampler(FeatureCache(split.train, prior.layout), prior.normalizer, batch, (SHORTEST, config.frames))

    def draw(step: int) -> dict:
        window = windows.sample()
        return window | {"text": sentences.draw(window["clips"])}

    def loss_fn(network: nn.Module, batch: dict) -> Tensor:
        return semantic_loss(network(batch["x"], batch["mask"]), batch["text"])

    run = fit(network, draw, loss_fn, training, **running)
    discriminator = Discriminator(network, prior.layout, prior.normalizer, prior.encoder)
    discriminator.card = {**training_card(split.train, training, run, network), "batch": batch}
    discriminator.card["metrics"] = retrieval(discriminator, split.test) if len(split.test) else {}
    return discriminator


def retrieval(judge: Discriminator, clips: Dataset) -> dict[str, float]:
    """R@1 and R@3 of clips' own first captions, see `recall_at_k`; among half of the meanings where 32 are too many."""
    groups = [(clip.content, clip.style) for clip in clips]
    motions = judge.embed([clip.motion for clip in clips])
    texts = judge.encoder.encode([clip.text for clip in clips])
    return recall_at_k(motions, texts, groups, min(AMONG, max(len(set(groups)) // 2, 1)))


def ood_captions(train: Dataset, encoder: TextEncoder, each: int = 4) -> tuple[tuple[str, ...], float]:
    """Some captions of each content and style, and how near to one of them a prompt should be.

    That is halfway between what other wordings of the same meanings reach (all but one in a hundred) and what sentences
    of words that do not exist reach (all but five in a hundred).
    """
    found: dict[tuple[str, str], dict[str, None]] = {}
    for clip in train:
        several = found.setdefault((clip.content, clip.style), {})
        several.update(dict.fromkeys(clip.texts[: each if len(several) < each else 0]))
    known = tuple(sorted({text for several in found.values() for text in several}))
    chance = random.Random(0)
    again = sorted({text for content, style in found for text in texts_for(content, style, seed=1)})
    near, far = (
        similarity(encoder.encode(texts), encoder.encode(known)).amax(1)
        for texts in (again, [nonsense(chance) for _ in range(200)])
    )
    return known, round(float(near.quantile(0.01) + far.quantile(0.95)) / 2, 3)


PROMPTS_AT_ONCE = 48
SEEDS = (0, 1, 2)  # one seed's figures differ from another's by a per cent or two


def generate_for(
    prior: Prior,
    clips: Dataset,
    sampler: Sampler = sampling.ddim,
    steps: int = 20,
    seed: int = 0,
    title: str = "",
    **more,
) -> list[Motion]:
    """A motion for the first sentence of each clip, as long as the clip, or as the prior's longest if that is less.

    seed: of all of them; another one, other answers. more: what `Prior.generate` takes beside, such as `scale`.
    """
    made = []
    for start in tqdm(range(0, len(clips), PROMPTS_AT_ONCE), title, disable=not title):
        part = list(clips[start : start + PROMPTS_AT_ONCE])
        seconds = [min(len(clip), prior.longest) / prior.fps for clip in part]
        prompts = [clip.text for clip in part]
        made += prior.generate(prompts, seconds, sampler=sampler, steps=steps, seed=seed * 1_000_003 + start, **more)
    return made


def quality(prior: Prior, split: Split, judge: Judge, title: str = "", **more) -> dict[str, float]:
    """Per cent of answers whose content and style the judges name, and Fréchet distances to the test clips.

    Means over answers from several seeds to the test part's sentences, by 20 DDIM steps. `fmd`: in the content
    classifier's features (paper 1, section 5.2), and beside it `fmd_real`, of as many training clips; the same with
    `_ae` in the autoencoder's (paper 2). `real_content` and `real_style` are what the judges name of the clips
    themselves. more: what `generate_for` takes beside, such as `scale`.
    """
    test = split.test
    few = torch.randperm(len(split.train), generator=torch.Generator().manual_seed(0))[: len(test)].tolist()
    real, others = [clip.motion for clip in test], [split.train[n].motion for n in few]
    made = [generate_for(prior, test, seed=seed, title=title, **more) for seed in SEEDS]
    found = {}
    for label, classifier in (("content", judge.content), ("style", judge.style)):
        ids = classifier.ids([getattr(clip, label) for clip in test])
        for name, crowds in ((label, made), (f"real_{label}", [real])):
            shares = [(classifier.scores(crowd).argmax(1) == ids).double().mean() for crowd in crowds]
            found[name] = 100 * float(torch.stack(shares).mean())
    for name, encoder in (("fmd", judge.content), ("fmd_ae", judge.autoencoder)):
        there = encoder.features(real)
        for key, crowds in ((name, made), (f"{name}_real", [others])):
            found[key] = sum(fmd(encoder.features(crowd), there) for crowd in crowds) / len(crowds)
    return {name: round(value, 3) for name, value in found.items()}


def make_prior(order: TrainOrder) -> Prior:
    """For the command line: the prior of a dataset, with its `quality` where there are judges of the dataset."""
    split, config = order.data.split(), getattr(Config, order.size)()
    training = order.config(STEPS["prior"], LR, weight_decay=1e-2, ema=0.999)
    start = Prior.load(checkpoints.find(order.start)) if order.start else None
    prior = train_prior(split, text.load(order.text), config, training, start=start, **order.running)
    if order.data.name in judges.names() and len(split.test):
        prior.card["metrics"] = quality(prior, split, judges.load(order.data.name))
    return prior


def make_discriminator(order: TrainOrder) -> Discriminator:
    """For the command line: the discriminator beside the prior of a dataset."""
    prior = Prior.load(checkpoints.default_path(order.data.name, "prior"))
    training = order.config(STEPS["discriminator"], LR, weight_decay=1e-2, ema=0.999)
    return train_discriminator(order.data, prior, training, **order.running)


def load(data: str = "actor", encoder: TextEncoder | None = None) -> Prior:
    """The prior that was trained on a dataset.

    encoder: of the sentences, where it is not one that `text.load` finds by its name. Raises MotionKitError naming
    those that there are, or if the files are damaged or do not fit.

    >>> load("actor")
    Prior(1.9 million parameters, text by 'mini', Skeleton(22 joints, root 'pelvis', height ... m))
    """
    return Prior.load(checkpoints.find(f"{data}-prior"), encoder=encoder)


def load_discriminator(data: str = "actor", encoder: TextEncoder | None = None) -> Discriminator:
    """The motion-semantic discriminator that was trained on a dataset; as `load`."""
    return Discriminator.load(checkpoints.find(f"{data}-discriminator"), encoder=encoder)
