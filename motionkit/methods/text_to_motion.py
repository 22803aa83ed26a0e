"""The prior: a network that has learned which motions there are, and which sentence goes with which."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor, nn
from tqdm.auto import tqdm

from .. import checkpoints, judges, sampling, text
from ..checkpoints import load_into
from ..datasets import Clip, Dataset, Split
from ..datasets.batches import FeatureCache, fit_normalizer
from ..diffusion import NoiseSchedule, simple_loss
from ..errors import MotionKitError
from ..features import FacingFree, Normalizer
from ..features.facing_free import OfBody, encode_normalized, scaled_skeleton
from ..judges import Judge
from ..layers import Denoiser, SemanticEncoder, TransformerConfig, semantic_loss
from ..metrics import AMONG, fmd, recall_at_k
from ..motion import Motion
from ..text import TextEncoder, similarity
from ..text.train import STEPS as TEXT_STEPS
from ..text.train import nonsense, texts_for, train_text
from ..training import TrainConfig, default_path, device_of, fit, main_process_first, seed_batch, training_card

GUIDANCE_SCALE = 2.0  # of guidance: the least with nine styles of ten named right on `actor`'s validation part
Sampler = Callable[..., Tensor]


@dataclass(eq=False)
class Prior:
    """Paper 1's text-to-motion model (section 3.3): sentences to motions, for one skeleton and frame rate.

    network: the denoiser. layout, normalizer: what it sees of a motion. schedule: of the noise. encoder: of the
    sentences. known: sentences that it learned from, some of each meaning; least: how near to one a prompt should be.
    guided: whether it also learned to do without a sentence, which guidance needs. card: how it was made.

    >>> import motionkit as mk
    >>> prior = mk.methods.text_to_motion.load("actor")
    >>> prior.generate(["an old person walks"], seconds=2)[0]
    Motion('an old person walks', 60 frames at 30 fps, 2.0 s, 22 joints)
    """

    network: Denoiser
    layout: OfBody
    normalizer: Normalizer
    schedule: NoiseSchedule
    encoder: text.TextEncoder
    known: tuple[str, ...]
    least: float
    guided: bool = True
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        millions = sum(p.numel() for p in self.network.parameters()) / 1e6
        return f"Prior({millions:.1f} million weights, text by {self.encoder.name!r}, {self.layout.skeleton!r})"

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
    def known_embeddings(self) -> Tensor:
        """Of the sentences in `known`, [N, E]."""
        return self.encoder.encode(self.known)

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
            text.check_prompt(prompt, self.encoder, self.known, self.known_embeddings, self.least)
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
        steps: int = 20,
        seed: int = 0,
        **more,
    ) -> list[Motion]:
        """A motion for each sentence (paper 1, section 3.3).

        seconds: of all, or one for each sentence; at most what it learned from. scale: of guidance; 1 is none. sampler,
        steps: from `sampling`. more: what the sampler takes beside, such as `inpaint`, `callback` and `spacing`. Raises
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

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`. Weights are written with 16 bits."""
        tensors = {name: value.half() for name, value in self.network.state_dict().items()}
        tensors |= {"mean": self.normalizer.mean, "std": self.normalizer.std, "alphas_bar": self.schedule.alphas_bar}
        card = {"kind": "prior", **self.card, "config": asdict(self.network.config), "features": "FacingFree"}
        card |= {"fps": self.fps, "text_encoder": self.encoder.name, "text_size": self.encoder.size}
        card |= {"text_key": self.encoder.key, "guided": self.guided, "known": list(self.known), "least": self.least}
        card |= {"features_hash": self.normalizer.data_hash}
        return checkpoints.save(path, tensors, card | {"skeleton": checkpoints.skeleton_card(self.layout.skeleton)})

    @classmethod
    def load(cls, path: str | os.PathLike, encoder: text.TextEncoder | None = None) -> Prior:
        """From what `save` wrote, with the text encoder that it was trained with; see `text_to_motion.load`.

        Raises MotionKitError if the files are damaged, of a newer format, of another kind or configuration, or if the
        text encoder's weights are others than those it learned from.
        """
        tensors, card = checkpoints.load(path, "prior")
        encoder = checkpoints.same_encoder(path, card, encoder or text.load(card["text_encoder"]))
        layout = OfBody(checkpoints.skeleton_of(card["skeleton"]), card["fps"])
        normalizer = Normalizer(tensors.pop("mean"), tensors.pop("std"), card["features"], card["features_hash"])
        schedule = NoiseSchedule(tensors.pop("alphas_bar"))
        config = checkpoints.load_config(path, card, TransformerConfig)
        network = Denoiser(layout.size, card["text_size"], config, schedule.steps).eval()
        checkpoints.load_into(network, {name: value.float() for name, value in tensors.items()}, path)
        return cls(
            network, layout, normalizer, schedule, encoder, tuple(card["known"]), card["least"], card["guided"], card
        )


@dataclass(eq=False)
class Discriminator:
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

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`. Weights are written with 16 bits."""
        tensors = {name: value.half() for name, value in self.network.state_dict().items()}
        tensors |= {"mean": self.normalizer.mean, "std": self.normalizer.std}
        card = {"kind": "discriminator", **self.card, "config": asdict(self.network.config), "features": "FacingFree"}
        card |= {"fps": self.layout.fps, "text_encoder": self.encoder.name, "text_size": self.encoder.size}
        card |= {"text_key": self.encoder.key, "features_hash": self.normalizer.data_hash}
        return checkpoints.save(path, tensors, card | {"skeleton": checkpoints.skeleton_card(self.layout.skeleton)})

    @classmethod
    def load(cls, path: str | os.PathLike, encoder: text.TextEncoder | None = None) -> Discriminator:
        """From what `save` wrote; raises MotionKitError as `Prior.load` does."""
        tensors, card = checkpoints.load(path, "discriminator")
        encoder = checkpoints.same_encoder(path, card, encoder or text.load(card["text_encoder"]))
        layout = OfBody(checkpoints.skeleton_of(card["skeleton"]), card["fps"])
        normalizer = Normalizer(tensors.pop("mean"), tensors.pop("std"), card["features"], card["features_hash"])
        config = checkpoints.load_config(path, card, TransformerConfig)
        network = SemanticEncoder(layout.size, card["text_size"], config).eval()
        checkpoints.load_into(network, {name: value.float() for name, value in tensors.items()}, path)
        return cls(network, layout, normalizer, encoder, card)


BATCH, RATE = 48, 7e-4
STEPS = {"prior": 25000, "discriminator": 1000}
SNR_SHIFT = 6.0  # noise than the plain cosine's: how fast a motion goes is settled where there is least signal
DROP = 0.1  # share of the motions that come without their sentence, so that guidance can be used
SHORTEST = 40  # frames of a window


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
    config: TransformerConfig | None = None,
    schedule: TrainConfig | None = None,
    *,
    noise: NoiseSchedule | None = None,
    drop: float = DROP,
    batch: int = BATCH,
    start: Prior | None = None,
    **running,
) -> Prior:
    """Paper 1's generative prior (section 3.3, eq. 5) on the training part of a dataset with captions.

    config: sizes; `laptop()` if left out. noise: a `louder` cosine with 1000 steps if left out. drop: share of the
    motions that it sees without a sentence; with 0 it cannot be guided. batch: windows a step, all of one length, which
    is drawn. start: a prior to go on from, of the same sizes, with its normalizer and noise. running: as in `fit`.
    Raises MotionKitError for clips without captions, or where `start` has other sizes.
    """
    split = data.split() if isinstance(data, Dataset) else data
    config, noise = config or TransformerConfig.laptop(), noise or NoiseSchedule.cosine(1000).snr_shift(SNR_SHIFT)
    schedule = schedule or TrainConfig(STEPS["prior"], rate=RATE, decay=1e-2, average=0.999)
    encoded, normalizer = fit_normalizer(split.train)
    if start is not None:
        normalizer, noise = start.normalizer, start.schedule
    sentences = Sentences.of(split.train, encoder)
    torch.manual_seed(schedule.seed)
    network = Denoiser(encoded.layout.size, encoder.size, config, noise.steps)
    if start is not None:
        load_into(network, start.network.state_dict(), "start")
    loss_fn, batch_of = _prior_loss(encoded, normalizer, sentences, noise, config.frames, drop, batch, schedule)
    run = fit(network, loss_fn, schedule, batch_of=batch_of, **running)
    known, least = ood_captions(split.train, encoder)
    card = {**training_card(split.train, schedule, run, network), "batch": batch, "drop": drop}
    card["last_loss"] = round(sum(run.losses[-200:]) / len(run.losses[-200:]), 4)
    card |= {} if start is None else {"started_from": {k: start.card.get(k) for k in ("command", "steps", "seconds")}}
    return Prior(network, encoded.layout, normalizer, noise, encoder, known, least, drop > 0, card)


def _prior_loss(
    encoded: FeatureCache,
    normalizer: Normalizer,
    sentences: Sentences,
    noise: NoiseSchedule,
    frames: int,
    drop: float,
    batch: int,
    schedule: TrainConfig,
) -> tuple[Callable[[nn.Module, int], Tensor], Callable[[int], str]]:
    """The loss of a step (paper 1, eq. 5), and what is in its batch, in words."""

    def chosen() -> tuple[Tensor, int]:
        clips = torch.randint(len(encoded.dataset), (batch,))
        return clips, int(torch.randint(min(SHORTEST, frames) // 4, frames // 4 + 1, ())) * 4

    def loss_fn(network: nn.Module, step: int) -> Tensor:
        clips, length = chosen()
        x, mask = encoded.sample_padded(clips, length)
        text = sentences.draw(clips) * (torch.rand(batch, 1) >= drop)
        t = torch.randint(1, noise.steps + 1, (batch,))
        x, mask, text, t = (value.to(device_of(network)) for value in (normalizer.normalize(x), mask, text, t))
        everyone = bool(mask.all())
        return simple_loss(
            lambda x, t: network(x, t, text, None if everyone else mask), x, noise, t, None if everyone else mask
        )

    def batch_of(step: int) -> str:
        seed_batch(schedule, step)
        clips, length = chosen()
        names = [encoded.dataset[n].name for n in clips.tolist()]
        return f"{length} frames of {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"

    return loss_fn, batch_of


def train_discriminator(
    data: Dataset | Split,
    prior: Prior,
    schedule: TrainConfig | None = None,
    *,
    batch: int = BATCH,
    **running,
) -> Discriminator:
    """Paper 1's motion-semantic discriminator (section 3.3, eq. 6), with a prior's embedding, which stays as it is.

    Sizes are the prior's. The card holds R@1 and R@3 among 32 sentences on the test part. running: as in `fit`.
    """
    split = data.split() if isinstance(data, Dataset) else data
    schedule = schedule or TrainConfig(STEPS["discriminator"], rate=RATE, decay=1e-2, average=0.999)
    encoded = FeatureCache(split.train, prior.layout)
    sentences = Sentences.of(split.train, prior.encoder)
    torch.manual_seed(schedule.seed)
    config, embedding = prior.network.config, prior.network.embedding
    network = SemanticEncoder(prior.layout.size, prior.encoder.size, config, embedding)

    def loss_fn(model: nn.Module, step: int) -> Tensor:
        clips = torch.randint(len(split.train), (batch,))
        length = int(torch.randint(min(SHORTEST, config.frames) // 4, config.frames // 4 + 1, ())) * 4
        x, mask = encoded.sample_padded(clips, length)
        text, here = sentences.draw(clips), device_of(model)
        everyone = None if mask.all() else mask.to(here)
        return semantic_loss(model(prior.normalizer.normalize(x).to(here), everyone), text.to(here))

    run = fit(network, loss_fn, schedule, **running)
    made = Discriminator(network, prior.layout, prior.normalizer, prior.encoder)
    made.card = {**training_card(split.train, schedule, run, network), "batch": batch}
    made.card["metrics"] = retrieval(made, split.test) if len(split.test) else {}
    return made


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


def evaluate_checkpoint(path: str | os.PathLike, split: Split) -> dict[str, float]:
    """Write the `quality` of weights into their card; nothing where no judge was trained on the dataset."""
    name = split.train.name
    if name not in judges.names() or not len(split.test):
        return {}
    tensors, card = checkpoints.load(path, "prior")
    card["metrics"] = quality(Prior.load(path), split, judges.load(name))
    checkpoints.save(path, tensors, card)
    return card["metrics"]


def train_part(
    part: str,
    data: Dataset,
    config: TransformerConfig,
    steps: int | None,
    seed: int,
    command: str,
    encoder: str = "mini",
    start: str | None = None,
    rate: float | None = None,
) -> Path:
    """Train a `prior`, `discriminator` or `text` and write it where `load` finds it; returns the weights' path.

    steps, rate: of the training; left out, the recipe's. encoder: of the sentences, see `text.load`. start: the name
    of a prior to go on from, the one trained before for instance. The state of the run is kept beside the weights, so a
    run that was broken off goes on. A discriminator needs the dataset's prior. Of several processes the first writes.
    """
    path = default_path(data.name, part) if part != "text" else checkpoints.folder() / "text-mini.safetensors"
    keep, split = path.with_suffix(".run"), data.split()
    if part == "text":
        schedule = TrainConfig(steps or TEXT_STEPS, rate=1e-3, decay=1e-2, seed=seed)
        made = train_text(split, None, schedule, keep=keep, title=path.stem)
    else:
        schedule = TrainConfig(steps or STEPS[part], rate=rate or RATE, decay=1e-2, seed=seed, average=0.999)
        if part == "prior":
            first = Prior.load(checkpoints.find(start)) if start else None
            made = train_prior(split, text.load(encoder), config, schedule, start=first, keep=keep, title=path.stem)
        else:
            prior = Prior.load(default_path(data.name, "prior"))
            made = train_discriminator(split, prior, schedule, keep=keep, title=path.stem)
    made.card = {"name": path.stem, "command": command, **made.card}
    main_process_first(lambda: made.save(path))
    if part == "prior":
        main_process_first(lambda: evaluate_checkpoint(path, split))
    return path


def load(data: str = "actor", encoder: TextEncoder | None = None) -> Prior:
    """The prior that was trained on a dataset.

    encoder: of the sentences, where it is not one that `text.load` finds by its name. Raises MotionKitError naming
    those that there are, or if the files are damaged or do not fit.

    >>> load("actor")
    Prior(1.9 million weights, text by 'mini', Skeleton(22 joints, root 'pelvis', height ... m))
    """
    return Prior.load(checkpoints.find(f"{data}-prior"), encoder)


def load_discriminator(data: str = "actor", encoder: TextEncoder | None = None) -> Discriminator:
    """The motion-semantic discriminator that was trained on a dataset; as `load`."""
    return Discriminator.load(checkpoints.find(f"{data}-discriminator"), encoder)
