"""What fine-tuning changes: all weights of a prior, as in paper 1, or a few numbers beside each of its matrices."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace

import torch
from torch import Tensor, nn
from torch.func import functional_call

from .. import checkpoints, sampling, text
from ..actor.style import HELD_OUT_STYLES, TRAIN_STYLES, get_style
from ..contacts import foot_contacts
from ..datasets import Clip, Dataset
from ..datasets.batches import FeatureCache
from ..datasets.loading import load as load_dataset
from ..diffusion import add_noise
from ..errors import MotionKitError, motion_inside
from ..features import FacingFree
from ..layers import Denoiser, semantic_loss
from ..metrics import foot_contact_accuracy
from ..motion import Motion
from ..sampling import (
    PAPER_G,
    PAPER_K,
    PAPER_S,
    PAPER_SCHEDULE,
    Denoise,
    PartialDiffusion,
    reconstruction_loss,
    total_loss,
)
from ..training import Run, TrainConfig, fit
from . import text_to_motion
from .base import (
    LRUCache,
    align_start,
    check_motions,
    check_strength,
    clamp_ratio,
    clean_up_feet,
    match_root_speed,
    motion_hash,
    result_name,
    retarget_to,
    scale_path,
    speed_ratio,
    without_helper_joints,
)
from .neutral_pairs import NEUTRAL, NeutralPairs
from .style_code import StyleCode, StyleCodeModel, load_for
from .text_to_motion import Discriminator, Prior


class LoRA(nn.Module):
    """A denoiser with changed weights, of which only the changes are trained: theta to theta_s (paper 1, section 3.4).

    Every matrix W becomes W + B A with A [rank, in] and B [out, rank] (low-rank adaptation, Hu et al. 2022), every
    vector gets one to add; with rank 0 every matrix gets a whole matrix to add, as in paper 1. At first nothing is
    changed. network: stays as it is and belongs to all adapters alike. Raises MotionKitError for a rank below 0.
    `uses_style_text`: it is given sentences told in the style.

    >>> from motionkit.layers import TransformerConfig
    >>> network = Denoiser(features=10, text_size=16, config=TransformerConfig.tiny())
    >>> adapter = LoRA(network, rank=4)
    >>> x, t, text = torch.randn(2, 30, 10), torch.tensor([5, 900]), torch.zeros(2, 16)
    >>> bool(torch.allclose(adapter(x, t, text), network(x, t, text), atol=1e-5))
    True
    """

    uses_style_text = True

    def __init__(self, network: Denoiser, rank: int = 8, seed: int = 0) -> None:
        super().__init__()
        if not isinstance(rank, int) or isinstance(rank, bool) or rank < 0:
            raise MotionKitError(f"an adapter's rank is a whole number, 8 for instance, or 0 for all; found {rank!r}")
        self.rank, self._network = rank, (network,)  # in a tuple, so that it is no part of this module's state
        chance = torch.Generator().manual_seed(seed)
        self.changes = nn.ParameterDict()
        for name, weight in network.named_parameters():
            key = name.replace(".", "/")
            if rank and weight.ndim == 2:
                down = torch.randn(rank, weight.shape[1], generator=chance) / math.sqrt(weight.shape[1])
                self.changes[f"{key}/A"] = down
                self.changes[f"{key}/B"] = torch.zeros(weight.shape[0], rank)
            else:
                self.changes[key] = torch.zeros(weight.shape)

    @property
    def network(self) -> Denoiser:
        """The denoiser that is changed."""
        return self._network[0]

    def weights(self) -> dict[str, Tensor]:
        """The changed weights by their names in the network."""
        found = {}
        for name, weight in self.network.named_parameters():
            key, weight = name.replace(".", "/"), weight.detach()
            whole = key in self.changes
            found[name] = weight + (self.changes[key] if whole else self.changes[f"{key}/B"] @ self.changes[f"{key}/A"])
        return found

    def forward(self, x: Tensor, t: Tensor, text: Tensor, mask: Tensor | None = None) -> Tensor:
        """As `layers.Denoiser.forward`."""
        return functional_call(self.network, self.weights(), (x, t, text, mask))

    def merged(self):
        """The changed denoiser as a function that works its weights out once: for use after training."""
        with torch.no_grad():
            weights = self.weights()
        return lambda x, t, text, mask=None: functional_call(self.network, weights, (x, t, text, mask))


KEPT = ("root x velocity", "root z velocity")  # O_hori of paper 1, eq. 8
GUIDANCE = 2.0


@torch.no_grad()
def neutral_pair(
    prior: Prior,
    style: Motion,
    prompt: str,
    *,
    noise: int = PAPER_G,
    steps: int | None = None,
    scale: float = GUIDANCE,
    seed: int = 0,
    **more,
) -> torch.Tensor:
    """A neutral motion aligned with a style example, as features [F, D] of the prior (paper 1, eqs. 7 and 8).

    The example is noised to step G = `noise` of the paper's 1000, which leaves its timing and little else, and brought
    back by DDPM with its prompt made neutral (`captions.to_neutral`); at every step, the root's velocity over the
    ground is that of the example. steps: of the sampler; left out, every one, as in the paper. scale: of guidance.
    more: what `sampling.ddpm` takes beside, such as `callback`. Raises MotionKitError as `Prior.predict` does.
    """
    x = prior.encode(style)[None]
    start = prior.schedule.matching_step(noise, PAPER_SCHEDULE)
    chance = torch.Generator().manual_seed(seed)
    noised = add_noise(x, start, prior.schedule, torch.randn(x.shape, generator=chance))
    keep = sampling.inpainting(x[0], sampling.feature_mask(prior.layout, *KEPT))
    predict = sampling.sliding_window(prior.predict([text.to_neutral(prompt)], scale), prior.longest, round(prior.fps))
    return sampling.ddpm(predict, noised, prior.schedule, steps, start, keep, generator=chance, **more)[0]


@dataclass(eq=False)
class LearnedStyle:
    """What `learn` of the few-shot method gives.

    prior: what was fine-tuned. adapter: its changes, or the style's place in a space of styles. chain: the steps that
    it was taught on. prompt: of the style example. style: the words of style in it. card: how it was made. neutral: the
    pair's neutral motion, features [F, D], where it was just learned.
    """

    prior: Prior
    adapter: LoRA | StyleCode
    chain: PartialDiffusion
    prompt: str
    style: str
    card: dict = field(default_factory=dict, repr=False)
    neutral: Tensor | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        numbers = sum(p.numel() for p in self.adapter.parameters())
        much = f"{numbers / 1000:.0f} thousand" if numbers >= 1000 else f"{numbers}"
        return f"LearnedStyle({self.style!r}, {much} numbers beside {self.prior!r})"

    @cached_property
    def network(self):
        """The changed denoiser, epsilon_theta_s."""
        return self.adapter.merged()

    def predict(self, caption: str) -> Denoise:
        """The changed denoiser with a content's sentence told in this style, for any function of `sampling`."""
        told = text.to_style(caption, self.style) if self.adapter.uses_style_text else text.to_neutral(caption)
        words = self.prior.encoder.encode([told])
        return lambda x, t: self.network(x, t, words.expand(len(x), -1))

    def save(self, path: str | os.PathLike) -> Path:
        """The changes and a card, see `checkpoints.save`. Numbers are written with 16 bits.

        Raises MotionKitError for the style of an autoencoder, whose own weights no file holds.
        """
        if not self.chain.stops:
            raise MotionKitError("an autoencoder's style is not kept: it is an ablation, made anew where it is needed")
        tensors = {name: value.detach().half() for name, value in self.adapter.changes.items()}
        card = {"kind": "style", **self.card, "prompt": self.prompt, "style": self.style, "rank": self.adapter.rank}
        card |= {} if isinstance(self.adapter, LoRA) else {"space": self.adapter.space[0].key}
        return checkpoints.save(path, tensors, card | {"stops": list(self.chain.stops), "prior": self.prior.key})

    @classmethod
    def load(cls, path: str | os.PathLike, prior: Prior, space: StyleCodeModel | None = None) -> LearnedStyle:
        """From what `save` wrote, for the prior, and the space of styles if any, that it was learned with.

        Raises MotionKitError if the files are damaged, of another kind, or belong to another prior.
        """
        tensors, card = checkpoints.load(path, "style")
        if card.get("prior") != prior.key:
            raise MotionKitError(
                f"{path}: this style was learned with another prior, whose weights it changes; load it with that one, "
                "or learn it again from its clip"
            )
        if card.get("space") and (space is None or card["space"] != space.key):
            raise MotionKitError(
                f"{path}: this style is a point in another space of styles; learn it again from its clip"
            )
        adapter = StyleCode(space) if card.get("space") else LoRA(prior.network, card["rank"])
        checkpoints.load_into(adapter.changes, {name: value.float() for name, value in tensors.items()}, path)
        return cls(
            prior, adapter, PartialDiffusion(prior.schedule, tuple(card["stops"])), card["prompt"], card["style"], card
        )


def prior_name(path: str | os.PathLike) -> str:
    """The dataset whose prior a saved style belongs to; MotionKitError as `LearnedStyle.load`."""
    card = checkpoints.load(path, "style")[1]
    if not card.get("data"):
        raise MotionKitError(f"{path}: its card does not name a dataset; load it with LearnedStyle.load(path, prior)")
    return card["data"]


def blend(styles: Mapping[LearnedStyle, float], caption: str, base: Denoise) -> Denoise:
    """Predictions of several styles together, each with its weight, and the rest of 1 from the prior as it is.

    base: the prior with the content's own sentence. One style with a weight of 1 is that style, 0.5 half of it, 1.5 a
    caricature; two with 0.5 each lie between both; a style with 1.5 and another with -0.5 lies beyond. It is
    DiffusionBlending (Shafir et al. 2024), which paper 1, section 7, names for this. Raises MotionKitError where no
    style is given.

    >>> blend({}, "a person walks", lambda x, t: x)
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nothing to blend: give at least one learned style
    """
    if not styles:
        raise MotionKitError("nothing to blend: give at least one learned style")
    parts = [(style.predict(caption), float(weight)) for style, weight in styles.items() if weight]
    rest = 1 - sum(weight for _, weight in parts)
    if abs(rest) > 1e-6:
        parts.append((base, rest))

    def predict(x: Tensor, t: Tensor) -> Tensor:
        return torch.stack([weight * one(x, t) for one, weight in parts]).sum(0)

    return predict


_AE_STEPS, _AE_BATCH, _AE_RATE, _AE_FRAMES = 1500, 48, 1e-3, 64
_AE_WIDTHS = (128, 192)


class ConvAutoencoder(nn.Module):
    """The autoencoder of unpaired motion style transfer (Aberman et al. 2020), its normalisations left out.

    Two convolutions over time, each halving the frames, and a residual block; then the same backwards. Paper 1's table
    3 takes it so, "while omitting the Instance Normalization and AdaIN layers". It is called like `layers.Denoiser`,
    but hears no step and no sentence. features: D.

    >>> network = ConvAutoencoder(features=10)
    >>> network(torch.randn(2, 30, 10)).shape
    torch.Size([2, 30, 10])
    """

    def __init__(self, features: int, longest: int = 160) -> None:
        super().__init__()
        near, far = _AE_WIDTHS
        self.config = SimpleNamespace(frames=longest, frames_per_token=4)
        self.down = nn.ModuleList((_strided(features, near), _strided(near, far)))
        self.middle = nn.ModuleList((_residual(far), _residual(far)))
        self.up = nn.ModuleList((_smooth(far, near), _smooth(near, features)))

    def forward(self, x: Tensor, t: Tensor | None = None, text: Tensor | None = None, mask: Tensor | None = None):
        """x: clean [B, F, D]; the rest is not looked at. Returns [B, F, D]."""
        frames = x.shape[1]
        y = nn.functional.pad(x.transpose(1, 2), (0, -frames % 4), mode="replicate")  # [B, D, F]
        for layer in self.down:
            y = nn.functional.leaky_relu(layer(y), 0.2)
        for block in self.middle:
            y = y + block(y)
        for n, layer in enumerate(self.up):
            y = nn.functional.interpolate(y, scale_factor=2, mode="nearest")
            y = layer(y if n == 0 else nn.functional.leaky_relu(y, 0.2))
        return y.transpose(1, 2)[:, :frames]


def _strided(inside: int, outside: int) -> nn.Conv1d:
    return nn.Conv1d(inside, outside, 8, stride=2, padding=3, padding_mode="replicate")


def _smooth(inside: int, outside: int) -> nn.Conv1d:
    return nn.Conv1d(inside, outside, 5, padding=2, padding_mode="replicate")


def _residual(width: int) -> nn.Sequential:
    first, second = (nn.Conv1d(width, width, 3, padding=1) for _ in range(2))
    return nn.Sequential(first, nn.LeakyReLU(0.2), second)


class Direct:
    """In place of a `PartialDiffusion`: no noise, one call, so that eqs. 10 to 12 of paper 1 teach an autoencoder
    (table 3).

    >>> Direct().reverse(lambda x, t: 2 * x, torch.ones(1, 4, 2)).shape
    torch.Size([1, 1, 4, 2])
    """

    stops: tuple[int, ...] = ()

    def forward(self, predict, x: Tensor) -> Tensor:
        """x [B, F, D] as it is."""
        return x

    def reverse(self, predict, noised: Tensor) -> Tensor:
        """What the network makes of it, [1, B, F, D]."""
        return predict(noised, torch.zeros(len(noised), dtype=torch.long))[None]


def with_autoencoder(prior: Prior, library: Dataset, steps: int = _AE_STEPS, seed: int = 0, **running) -> Prior:
    """A prior whose network is an autoencoder that learned to give a library's motions back (paper 1, table 3).

    It has the prior's features, sentences and card; it cannot make motions. running: as in `training.fit`. Raises
    MotionKitError where no clip of the library is as long as a window.
    """
    encoded = FeatureCache(library, prior.layout)
    long = (encoded.lengths >= _AE_FRAMES).nonzero()[:, 0]
    if not len(long):
        raise MotionKitError(f"no clip of the library has {_AE_FRAMES} frames for the autoencoder to learn from")
    torch.manual_seed(seed)
    network = ConvAutoencoder(prior.layout.size, prior.longest)

    def loss_fn(model: nn.Module, step: int) -> Tensor:
        x = prior.normalizer.normalize(encoded.sample(long[torch.randint(len(long), (_AE_BATCH,))], _AE_FRAMES))
        return ((model(x) - x) ** 2).mean()

    running.setdefault("title", "an autoencoder")
    fit(network, loss_fn, TrainConfig(steps, _AE_RATE, seed=seed), **running)
    return replace(prior, network=network)


EPOCH = -(-23384 // 64)  # batches of paper 1's one epoch (section 4)
PAIRS = ("prior", "knn-dtw", "space")
MODELS = ("diffusion", "autoencoder", "space")


@dataclass(frozen=True)
class Recipe:
    """How a style is learned.

    noise: G, for the neutral pair; change: K; chain: S (paper 1, section 4). weights: lambda_sr and lambda_s; with 0
    for the second there is no semantic loss (table 3). steps, batch, rate: of fine-tuning. rank: of the adapter; 0
    changes all weights. pair: where the neutral motion of the pair comes from (tables 2 and 3); pair_steps: of DDPM,
    where the prior makes it; None for every one. frames: of the windows that the semantic loss sees. model: what
    learns: the prior, an autoencoder (table 3), or a point in a space of styles, which can make the pair too. `paper()`
    is as published; `laptop()` takes as many steps of smaller batches, a minute or so on two cores; `in_space()` finds
    such a point, beyond the paper.
    Raises MotionKitError for values out of range.
    """

    noise: int = PAPER_G
    change: int = PAPER_K
    chain: int = PAPER_S
    weights: tuple[float, float] = (1.0, 0.1)
    steps: int = EPOCH
    batch: int = 8
    rate: float = 3e-4
    rank: int = 8
    pair: str = "prior"
    pair_steps: int | None = 100
    frames: int = 120
    model: str = "diffusion"

    def __post_init__(self) -> None:
        for name, known in (("pair", PAIRS), ("model", MODELS)):
            if getattr(self, name) not in known:
                raise MotionKitError(
                    f"a recipe's {name} is {' or '.join(map(repr, known))}; found {getattr(self, name)!r}"
                )
        if self.pair == "space" and self.model != "space":
            raise MotionKitError("a recipe's pair comes from a space of styles where its model is 'space' too")
        for name, least in (("noise", 1), ("change", 1), ("chain", 1), ("steps", 1), ("batch", 1), ("rank", 0)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < least:
                raise MotionKitError(f"a recipe's {name} is a whole number from {least}; found {value!r}")
        pair = self.weights if isinstance(self.weights, tuple | list) else ()
        if len(pair) != 2 or not all(isinstance(one, int | float) and one >= 0 for one in pair):
            raise MotionKitError(f"a recipe has two weights from 0 up, such as (1.0, 0.1); found {self.weights!r}")
        if not isinstance(self.rate, int | float) or not self.rate > 0:
            raise MotionKitError(f"a recipe's rate is above 0; found {self.rate!r}")

    def changed(self, **changes) -> Recipe:
        """The same but for these; MotionKitError for what no recipe has.

        >>> Recipe().changed(change=200).change
        200
        """
        known = [one.name for one in fields(self)]
        for name in changes:
            if name not in known:
                raise MotionKitError(f"a recipe has no {name!r}; it has {', '.join(known)}")
        return replace(self, **changes)

    @classmethod
    def paper(cls, contents: int = 23384) -> Recipe:
        """Paper 1, section 4: all weights, batch 64, rate 0.0001, one epoch; contents: how many, here HumanML3D's."""
        return cls(steps=-(-contents // 64), batch=64, rate=1e-4, rank=0, pair_steps=None, frames=196)

    @classmethod
    def laptop(cls) -> Recipe:
        """The same parts and as many steps, of small batches."""
        return cls()

    @classmethod
    def in_space(cls) -> Recipe:
        """Find the style in a space of styles, by the reconstruction loss alone: it has no words that it must know."""
        return cls(model="space", pair="space", weights=(1.0, 0.0), steps=100, batch=1, rate=0.05)


ABLATIONS = {  # the rows of paper 1's table 3, each one call: mk.methods.load("few-shot", recipe=ABLATIONS[row])
    "ours": Recipe(),
    "with KNN + DTW": Recipe(pair="knn-dtw"),
    "with AE": Recipe(model="autoencoder"),
    "without L_s": Recipe(weights=(1.0, 0.0)),
}


@dataclass(frozen=True, eq=False)
class ContentBank:
    """Neutral motions with sentences, M^c and D^c of paper 1: what a style is to be carried to while it is learned.

    clean, noised: features [N, F, D] and their m_K by the chain. captions: N sentences.
    """

    clean: Tensor
    noised: Tensor
    captions: tuple[str, ...]

    @classmethod
    def of(
        cls,
        prior: Prior,
        motions: Sequence[Motion],
        captions: Sequence[str],
        chain: PartialDiffusion,
        frames: int = 120,
        seed: int = 0,
    ) -> ContentBank:
        """A window of each motion, on the prior's skeleton; captions: a sentence for each.

        Raises MotionKitError where no motion is as long, or one has no caption.
        """
        long = [pair for pair in zip(motions, captions, strict=True) if len(pair[0]) >= frames]
        if not long:
            raise MotionKitError(f"no neutral clip has {frames} frames; give longer ones, or fewer frames")
        mute = next((motion.name for motion, caption in long if not caption), None)
        if mute is not None:
            raise MotionKitError(f"clip {mute!r} has no caption, which the semantic loss needs; give it texts")
        chance, windows = torch.Generator().manual_seed(seed), []
        for motion, _ in long:
            start = int(torch.randint(len(motion) - frames + 1, (), generator=chance))
            windows.append(prior.encode(motion[start : start + frames]))
        clean, captions = torch.stack(windows), tuple(text.to_neutral(caption) for _, caption in long)
        with torch.no_grad():
            noised = [
                chain.forward(prior.predict(captions[n : n + 32], 1.0), clean[n : n + 32])
                for n in range(0, len(clean), 32)
            ]
        return cls(clean, torch.cat(noised), captions)


@dataclass(frozen=True, eq=False)
class FinetuneTask:
    """What is there to learn from: a style example beside its neutral pair, and contents for the semantic loss.

    styled, neutral: features [F, D]. prompt: d^s. style: its words, see `captions.style_in`. contents: None where the
    semantic loss is left out. space: where the style is looked for, see `Recipe`.
    """

    prior: Prior
    discriminator: Discriminator
    chain: PartialDiffusion
    styled: Tensor
    neutral: Tensor
    prompt: str
    style: str
    contents: ContentBank | None = None
    space: StyleCodeModel | None = None

    @cached_property
    def style_text(self) -> Tensor:
        """E_text(d^s), [1, E]; neutral where a space of styles is told the style otherwise."""
        return self.prior.encoder.encode([self.prompt if self.space is None else text.to_neutral(self.prompt)])

    @cached_property
    def own_noised(self) -> Tensor:
        """The neutral pair's m_K, [1, F, D]."""
        with torch.no_grad():
            predict = self.prior.predict([text.to_neutral(self.prompt)], 1.0)
            return self.chain.forward(predict, self.neutral[None])

    @cached_property
    def content_texts(self) -> Tensor:
        """E_text of the contents' sentences told in the style, D^(c,s), [N, E]."""
        return self.prior.encoder.encode([text.to_style(caption, self.style) for caption in self.contents.captions])

    def reconstruction_loss(self, network: Callable[..., Tensor]) -> Tensor:
        """L_sr of a network (x, t, text) that is being taught (paper 1, eqs. 9 and 10)."""
        seen = self.chain.reverse(lambda x, t: network(x, t, self.style_text), self.own_noised)
        return reconstruction_loss(seen, self.styled)

    def semantic_loss(self, network: Callable[..., Tensor], batch: int) -> Tensor:
        """L_s: contents restyled by the network, as the frozen discriminator sees them (paper 1, eq. 11).

        batch: how many contents are drawn, by torch's random numbers.
        """
        chosen = torch.randint(len(self.contents.noised), (batch,))
        words = heard = self.content_texts[chosen]
        if self.space is not None:
            heard = self.prior.encoder.encode([self.contents.captions[n] for n in chosen.tolist()])
        restyled = self.chain.reverse(lambda x, t: network(x, t, heard), self.contents.noised[chosen])[-1]
        return semantic_loss(self.discriminator.network(restyled), words)


def finetune(lesson: FinetuneTask, recipe: Recipe, seed: int = 0, **running) -> tuple[LoRA | StyleCode, Run]:
    """Fine-tune the lesson's prior on it (paper 1, section 3.4, eq. 12); the prior itself stays as it is.

    A lesson with a space of styles finds a point in it, by the same losses, near what is read off the clip.

    running: as in `training.fit`, such as `keep` for a file to go on from, `show` and `title`.
    """
    in_space = lesson.space is not None
    if in_space:
        adapter = StyleCode(lesson.space, lesson.space.read(lesson.styled))
    else:
        adapter = LoRA(lesson.prior.network.eval(), recipe.rank, seed)
    lesson.discriminator.network.eval().requires_grad_(False)
    same = f"{recipe}, {lesson.prompt!r}, {len(lesson.styled)} frames"
    schedule = TrainConfig(recipe.steps, recipe.rate, decay=0.0, seed=seed, recipe=same)

    def loss_fn(network: torch.nn.Module, step: int) -> Tensor:
        example = lesson.reconstruction_loss(network)
        guided = recipe.weights[1] > 0 and lesson.contents is not None
        meaning = lesson.semantic_loss(network, recipe.batch) if guided else example.new_zeros(())
        total = total_loss(example, meaning, recipe.weights)
        return total + adapter.unlikely() if in_space else total

    return adapter, fit(adapter, loss_fn, schedule, **running)


_RUNNING = ("content", "keep", "every", "show", "title")
NAMELESS = "given"  # the style's word in the sentence for a clip of which nothing is said


def as_styles(method, style: object) -> dict[LearnedStyle, float]:
    """A style as `stylize` of the few-shot method takes it, with weights.

    method: a `methods.few_shot.FewShot`. style: None, for the one learned last; a LearnedStyle; a label or sentence,
    see `named_style`; a mapping from these to weights; a Motion, which is learned first. Raises MotionKitError for what
    is none of these, and for styles of another prior.
    """
    if isinstance(style, list | tuple | set):
        raise MotionKitError("few-shot: several styles are mixed with weights, {old: 0.5, proud: 0.5}; found a list")
    if style is None:
        style = method.last
    elif isinstance(style, Motion):
        prompt = method.prompt_for(style)
        style = method.learned.get(motion_hash(style), lambda: method.learn(style, prompt, title=""))
    elif isinstance(style, str):
        style = named_style(method.space, style)
    if style is None:
        raise MotionKitError("few-shot: no style was learned yet; first method.learn(clip, 'an old person walks')")
    mix = style if isinstance(style, Mapping) else {style: 1.0} if isinstance(style, LearnedStyle) else {}
    styles = {named_style(method.space, one) if isinstance(one, str) else one: share for one, share in mix.items()}
    if not styles or not all(isinstance(one, LearnedStyle) for one in styles):
        raise MotionKitError(f"few-shot takes learned styles, a clip, or the name of a style; found {style!r:.80}")
    if any(one.prior.key != method.model.key for one in styles):
        raise MotionKitError("few-shot: this style was learned with another prior; learn it with this one")
    for one, weight in styles.items():
        check_strength(f"few-shot: the weight of style {one.style!r}", weight)
    return styles


def check_made(recipe: object, space: object, seed: object) -> None:
    """Raises MotionKitError where the few-shot method was made with what is no recipe, space or seed."""
    if recipe is not None and not isinstance(recipe, Recipe):
        raise MotionKitError(
            f"few-shot: a recipe is mk.methods.few_shot.Recipe.laptop(), for instance; found {recipe!r:.80}"
        )
    if space is not None and not isinstance(space, StyleCodeModel):
        raise MotionKitError(f"few-shot: space is a StyleSpace, or left out for the prior's own; found {space!r:.80}")
    if not isinstance(seed, int):
        raise MotionKitError(f"few-shot: a seed is a whole number; found {seed!r}")


def check_learning(method, clip: object, prompt: object, running: Mapping) -> None:
    """Raises MotionKitError where `learn` of the few-shot method was given what it does not take.

    prompt: a sentence; None only where the style is looked for in a space. running: of `_RUNNING`.
    """
    if not isinstance(clip, Motion):
        hint = motion_inside(clip) or "; read a file with mk.load"
        raise MotionKitError(f"few-shot learns a style from a Motion; found {clip!r:.80}{hint}")
    if not isinstance(prompt, str) and (prompt is not None or method.recipe.model != "space"):
        raise MotionKitError(
            "few-shot learns a style from a clip and a sentence: method.learn(clip, 'an old person walks'); found "
            f"{prompt!r:.80}"
        )
    for name in running:
        if name not in _RUNNING:
            hint = ": give it to mk.methods.load('few-shot', recipe=...), or method.with_recipe(...)" * (
                name == "recipe"
            )
            raise MotionKitError(f"few-shot: learn takes {', '.join(_RUNNING)} beside the clip, not {name!r}{hint}")


def named_style(space: StyleCodeModel | None, words: str) -> LearnedStyle:
    """A style of the performer by its label, or by a sentence that speaks of it: its numbers are its place in a space.

    Raises MotionKitError for other styles, and where there is no space.

    >>> from motionkit.methods.style_code import load
    >>> named_style(load("actor"), "an old person walks")
    LearnedStyle('old', 37 numbers beside ...)
    """
    known, label = (*TRAIN_STYLES, *HELD_OUT_STYLES), words.lower()
    label = label if label in known else text.style_in(words) if " " in words else label
    if words.endswith((".safetensors", ".bvh")):
        how = "method.load_style" if words.endswith(".safetensors") else "mk.load"
        raise MotionKitError(f"few-shot: {words!r} is a file; read it first: {how}({words!r})")
    if space is None or label not in known:
        near = difflib.get_close_matches(label, known, 1, 0.5) if space is not None else []
        hint = f" Did you mean {near[0]!r}?" if near else ""
        there = f": {', '.join(known)}" if space is not None else ", since this prior has no space of styles"
        raise MotionKitError(
            f"few-shot: {words!r} is no style that it knows by name{there}.{hint} "
            "Any other is learned from a clip, style = method.learn(clip, 'an old person walks'), and given as it comes"
        )
    return LearnedStyle(space.prior, StyleCode(space, get_style(label)), space.chain, words, label)


_LEAST = 1.0  # seconds of a style clip
_OVERLAP = 1.0  # seconds that windows of longer motions share
_BEYOND = 8  # frames added at either end while it is restyled: where a token sees nothing on one side, poses jump
_MOST = 144  # contents for the semantic loss


class FewShot:
    """Few-shot style transfer (paper 1): a prior is fine-tuned on one clip, then its few steps of denoising restyle.

    prior, discriminator: by the name of the dataset that they learned from, or as objects. library: a labelled Dataset
    with captions, whose neutral clips the semantic loss is taken on; left out, the training part of the prior's
    dataset. recipe: see `few_shot.Recipe`; left out, the style is looked for in the kit's space of styles where the
    prior has one (`Recipe.in_space()`), or else learned as in the paper (`Recipe.laptop()`). seed: of all that is
    drawn. space: for `Recipe.in_space()`, one of your own.

    >>> import motionkit as mk
    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> item = Item("walk", Labels("walk", "neutral", ("a person walks",)), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> quick = mk.methods.few_shot.Recipe(steps=2, batch=1, noise=500)
    >>> method = mk.methods.load("few-shot", library=from_items("mine", [item]), recipe=quick)
    >>> old = method.learn(style, "an old person walks", title="")
    >>> method.stylize(walk, style=old)
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "few-shot"

    def __init__(
        self,
        prior: str | Prior = "actor",
        discriminator: str | Discriminator | None = None,
        library: Dataset | None = None,
        recipe: Recipe | None = None,
        seed: int = 0,
        space: StyleCodeModel | None = None,
    ) -> None:
        check_made(recipe, space, seed)
        self.prior = text_to_motion.load(prior) if isinstance(prior, str) else prior
        if discriminator is None and not isinstance(prior, str):
            raise MotionKitError("few-shot: with a prior of your own, give its discriminator too")
        judge = prior if discriminator is None else discriminator
        self.discriminator = text_to_motion.load_discriminator(judge) if isinstance(judge, str) else judge
        self.space, self.seed = load_for(self.prior) if space is None else space, seed
        self.recipe = recipe or (Recipe.in_space() if self.space is not None else Recipe.laptop())
        self.fit(library)

    @property
    def chain(self) -> PartialDiffusion | Direct:
        """The steps that motions go forwards and back, as the recipe says."""
        if self.recipe.model == "autoencoder":
            return Direct()
        if self.recipe.model == "diffusion":
            return PartialDiffusion.from_paper(self.prior.schedule, self.recipe.change, self.recipe.chain)
        if self.space is None or self.space.prior.key != self.prior.key:
            raise MotionKitError("few-shot: there is no space of styles of this prior; give space=, or another recipe")
        return self.space.chain

    def fit(self, train: Dataset | None) -> FewShot:
        """Take neutral contents from this dataset from now on; its clips are read when a style is first learned."""
        self._library, self._contents = train, LRUCache(1)
        self.learned, self._pairs, self.last = LRUCache(16), LRUCache(), None
        for known in ("pairs", "taught"):
            self.__dict__.pop(known, None)
        return self

    def __getstate__(self) -> dict:
        """What the method is, without what it has worked out or learned so far."""
        kept = ("prior", "discriminator", "recipe", "seed", "space", "_library")
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self.fit(self._library)

    def with_recipe(self, **changes) -> FewShot:
        """The same method with another recipe, such as `having(change=200)`: prior, library and seed stay."""
        recipe = self.recipe.changed(**changes)
        other = FewShot(self.prior, self.discriminator, self._library, recipe, self.seed, self.space)
        other.__dict__.update({"pairs": self.pairs})
        return other

    @cached_property
    def pairs(self) -> NeutralPairs:
        """The library's neutral clips."""
        if self._library is None:
            return NeutralPairs(load_dataset(self.prior.card.get("data") or "actor").split().train)
        return NeutralPairs(self._library)

    @cached_property
    def model(self) -> Prior:
        """What is fine-tuned: the prior, or the autoencoder in its place, which then learns first (table 3)."""
        if self.recipe.model != "autoencoder":
            return self.prior
        return with_autoencoder(self.prior, self.pairs.library, seed=self.seed)

    def learn(self, style: Motion, prompt: str | None = None, *, content: str | None = None, **running) -> LearnedStyle:
        """Teach the prior the style of one clip (paper 1, section 3.4); `stylize` uses it from now on.

        style: at least 1 s, of a human body. prompt: d^s, a sentence that says what is done and in which style; it may
        be left out in a space of styles, which hears no words of style. content: what is done, a label of the library,
        where the recipe's pair comes from there. running: as in `training.fit`: `keep`, a file for the state of the
        run, `show`, `title`. Raises MotionKitError for a clip that is too short or cannot be retargeted to the prior's
        body, a prompt without words of a style, and words that are none of these.
        """
        check_learning(self, style, prompt, running)
        check_motions(self.name, style, style)
        nameless = prompt is None
        if nameless:
            prompt = self.prompt_for(style)
        if style.duration < _LEAST - 1e-6:
            raise MotionKitError(
                f"style clip {style.name!r} lasts {style.duration:.2f} s; a style is learned from {_LEAST:g} s or more"
            )
        lesson = self.lesson(style, prompt, content)
        running.setdefault("title", f"learning {lesson.style!r}")
        adapter, run = finetune(lesson, self.recipe, self.seed, **running)
        card = {"steps": self.recipe.steps, "seconds": round(run.seconds, 1), "seed": self.seed}
        card |= {"data": self.prior.card.get("data", ""), "licence": self.prior.card.get("licence", "")}
        words = style.name or NAMELESS if nameless else lesson.style
        self.last = LearnedStyle(self.model, adapter, self.chain, prompt, words, card, lesson.neutral)
        return self.last

    def lesson(self, style: Motion, prompt: str, content: str | None = None) -> FinetuneTask:
        """What `learn` learns from: the style example's features, its neutral pair, and contents; see
        `few_shot.FinetuneTask`.

        A clip that is longer than the prior's longest motion is cut to its middle. Raises MotionKitError as `learn`.
        """
        words, chain = text.style_in(prompt), self.chain
        clip = self._middle(self.seen(style))
        neutral = self.neutral_of(clip, prompt, content)
        wanted = self.recipe.weights[1] > 0
        return FinetuneTask(
            self.model,
            self.discriminator,
            chain,
            self.prior.encode(clip),
            neutral,
            prompt,
            words,
            self._neutral_contents() if wanted else None,
            self.space if self.recipe.model == "space" else None,
        )

    def neutral_of(self, style: Motion, prompt: str, content: str | None = None) -> Tensor:
        """The neutral motion paired with a clip, features [F, D], as the recipe says: eqs. 7 and 8, for instance."""
        if self.recipe.pair == "knn-dtw":
            return self.prior.encode(self.pairs.neutral_of(style, content))
        return self._neutral(style, prompt)

    def load_style(self, path: str | os.PathLike) -> LearnedStyle:
        """A style that was saved; `stylize` uses it from now on. MotionKitError where it does not fit the prior."""
        self.last = LearnedStyle.load(path, self.model, self.space)
        return self.last

    def stylize(
        self,
        content: Motion,
        style: LearnedStyle | Mapping[LearnedStyle, float] | Motion | str | None = None,
        strength: float = 1.0,
        lock: bool = True,
        *,
        caption: str | None = None,
        content_style: str | None = None,
    ) -> Motion:
        """The content clip in a style that was learned (paper 1, section 3.5).

        content: F frames of any length and frame rate, of a human body. style: of `learn` or `load_style`, the last one
        if left out; several with weights, see `few_shot.blend`; a clip, learned when it first comes; or in the kit's
        space of styles a label or a sentence, such as "old", with nothing to learn. strength: 0 keeps the content, 1 is
        the style, more exaggerates. lock: hold standing feet still. caption: a sentence that says what the content
        does; left out, the discriminator picks one that the prior knows. content_style: the content's own style; unless
        it is neutral, or left out, the content is made neutral first. Returns F frames at the content's rate, on its
        skeleton. Raises MotionKitError where nothing was learned yet, and for arguments that are none of these.
        """
        check_motions(self.name, content, content, strength)
        styles = as_styles(self, style)
        what = style.name if isinstance(style, Motion) else " + ".join(one.style for one in styles)
        if strength == 0:
            return content.replace(name=result_name(content, what))
        given = without_helper_joints(content)
        seen = self.seen(given)
        caption = text.to_neutral(self.caption_of(seen) if caption is None else caption)
        x = self.prior.encode(seen)
        if content_style is not None and content_style not in NEUTRAL:
            x = self._neutral(seen, caption)
        body = self._restyled(x, caption, {one: strength * weight for one, weight in styles.items()}, seen, given)
        if lock:
            body = clean_up_feet(body, given)
        return content.with_helper_joints_of(body).replace(name=result_name(content, what))

    def _restyled(
        self, x: Tensor, caption: str, styles: Mapping[LearnedStyle, float], seen: Motion, given: Motion
    ) -> Motion:
        """Neutral features on the content's body in styles, at a speed that goes with them.

        Poses beyond all of a style say little of its speed: there the style's own factor counts so many times.
        """
        y, same = self.translated(x, caption, styles)
        body, plain = (self._decoded(features, x, seen, given) for features in (y, same))
        total = sum(styles.values())
        if total <= 1:
            return match_root_speed(body, plain)
        once, _ = self.translated(x, caption, {one: weight / total for one, weight in styles.items()})
        return scale_path(body, clamp_ratio(speed_ratio(self._decoded(once, x, seen, given), plain) ** total))

    @torch.no_grad()
    def translated(self, x: Tensor, caption: str, styles: Mapping[LearnedStyle, float]) -> tuple[Tensor, Tensor]:
        """Neutral features [F, D] to styled ones: K steps of noise forwards and back (paper 1, section 3.5).

        The way forwards is the prior's own, with the content's caption; the way back that of the styles, see `blend`.
        The second answer is what the prior itself makes on the way back: the content, as nearly as it can.
        """
        chain = next(iter(styles)).chain
        plain = self._windows(self.model.predict([caption], 1.0))
        longer = torch.cat((x[:1].expand(_BEYOND, -1), x, x[-1:].expand(_BEYOND, -1)))
        noised = chain.forward(plain, longer[None])
        there = self._windows(blend(styles, caption, plain))
        return tuple(chain.reverse(way, noised)[-1, 0, _BEYOND:-_BEYOND] for way in (there, plain))

    def neutral_motion(self, motion: Motion, caption: str, warp: bool = False, lock: bool = True) -> Motion:
        """The prior's neutral motion for one in some style (paper 1, sections 3.4 and 3.5, table 2).

        motion: F frames. caption: a sentence that says what it does. warp: let the speed over the ground go with the
        movements, see `base.match_root_speed`; else the path is the motion's own, as in paper 1, eq. 8. lock: hold
        standing feet still. Returns F frames on the motion's skeleton.
        """
        given = without_helper_joints(motion)
        seen = self.seen(given)
        x = self._neutral(seen, caption)
        body = self._decoded(x, self.prior.encode(seen), seen, given)
        body = match_root_speed(body, given) if warp else body
        body = clean_up_feet(body, given) if lock else body
        return motion.with_helper_joints_of(body).replace(name=f"{motion.name}, neutral")

    def caption_of(self, content: Motion) -> str:
        """The neutral sentence that goes best with a motion, of those that the prior knows (paper 1, eq. 6)."""
        known = [one for one in self.prior.known if text.to_neutral(one) == one or " neutral" in one]
        known = known or sorted({text.to_neutral(one) for one in self.prior.known})
        return known[int(self.discriminator.similarity([content], known)[0].argmax())]

    def prompt_for(self, style: Motion) -> str:
        """A sentence for a style clip of which nothing is said."""
        return text.to_style(self.caption_of(self.seen(style)), NAMELESS)

    def transfer(self, content: Clip, style: Clip) -> Motion:
        """`stylize` for labelled clips with captions, as the arena asks: the style is learned when it first comes."""
        if style.style in NEUTRAL:
            return self.neutral_motion(content.motion, content.text, warp=True)
        learned = self.learned.get(
            motion_hash(style.motion), lambda: self.learn(style.motion, style.text, content=style.content, title="")
        )
        return self.stylize(content.motion, learned, caption=content.text, content_style=content.style)

    def seen(self, motion: Motion) -> Motion:
        """A motion as the prior sees it: its skeleton and frame rate. MotionKitError where it cannot be."""
        body, wanted = without_helper_joints(motion), self.prior.layout.skeleton
        if not body.skeleton.same_tree(wanted):
            still = Motion.from_root(wanted, torch.eye(4)[:1].expand(1, len(wanted), 4), torch.zeros(1, 3), body.fps)
            body = retarget_to(body, still)
        return body if abs(body.fps - self.prior.fps) < 1e-3 else body.resample(self.prior.fps, smooth=True)

    def _middle(self, motion: Motion) -> Motion:
        first = max(len(motion) - self.prior.longest, 0) // 2
        return motion[first : first + self.prior.longest]

    def _windows(self, predict: sampling.Denoise) -> sampling.Denoise:
        return sampling.sliding_window(predict, self.prior.longest, round(_OVERLAP * self.prior.fps))

    def _neutral_contents(self) -> ContentBank:
        def work_out() -> ContentBank:
            library = self.pairs.library
            clips = [clip for clip in library if clip.style in NEUTRAL]
            order = torch.randperm(len(clips), generator=torch.Generator().manual_seed(self.seed)).tolist()
            chosen = [clips[n] for n in order[:_MOST]]
            motions = [self.seen(clip.motion) for clip in chosen]
            frames = min(self.recipe.frames, self.prior.longest, max(map(len, motions)))
            return ContentBank.of(self.model, motions, [clip.text for clip in chosen], self.chain, frames, self.seed)

        return self._contents.get("contents", work_out)

    def _neutral(self, motion: Motion, caption: str) -> Tensor:
        """The neutral motion for one in some style, features [F, D]: the space's, or paper 1's, eqs. 7 and 8."""
        if self.recipe.pair == "space":
            return self.space.neutral(self.prior.encode(motion), caption)
        how = {"noise": self.recipe.noise, "steps": self.recipe.pair_steps, "seed": self.seed}
        return self._pairs.get((motion_hash(motion), caption), lambda: neutral_pair(self.prior, motion, caption, **how))

    def _decoded(self, y: Tensor, x: Tensor, seen: Motion, given: Motion) -> Motion:
        """Features to a motion on the content's body, on the content's own path, in its frames."""
        y = self.prior.normalizer.denormalize(y)
        y[:, :3] = self.prior.normalizer.denormalize(x)[:, :3]
        body = FacingFree(seen.skeleton, self.prior.fps).decode(y)
        if body.skeleton is not given.skeleton:
            body = retarget_to(body, given)
        if len(body) != len(given):
            body = body.sample(
                torch.arange(len(given), dtype=torch.float64) * (self.prior.fps / given.fps), smooth=True
            )
        return align_start(body.replace(fps=given.fps), given)


PAPER_NOISE = (700, 800, 900, 950, 1000)
PAPER_CHANGE = (100, 200, 300, 400, 500, 600)


def sweep_noise(method, examples: Sequence[Clip], values: Iterable[int] = PAPER_NOISE) -> list[dict]:
    """What G does to the neutral motion of a pair (paper 1, figure 8, left).

    method: of `methods.load("few-shot")`. examples: styled clips with captions. values: of G. For each value a row:
    `g`; `fca`, how well the feet of pair and example agree, per cent; `similarity`, the cosine between the pair and the
    neutral sentence as the discriminator sees them. Raises MotionKitError for no examples, and values out of range.
    """
    _some("examples", examples)
    rows = []
    for value in values:
        own = method.with_recipe(noise=value)
        made = [own.neutral_motion(clip.motion, clip.text) for clip in examples]
        prompts = [text.to_neutral(clip.text) for clip in examples]
        rows.append({"g": value} | _agreement(method, made, [clip.motion for clip in examples], prompts))
    return rows


def sweep_change(
    method, examples: Sequence[Clip], contents: Sequence[Clip], values: Iterable[int] = PAPER_CHANGE
) -> list[dict]:
    """What K does to the result (paper 1, figure 8, right): every style is learned anew with each K.

    examples, contents: styled and neutral clips with captions; every content is told in every style. values: of K. For
    each value a row: `k`; `fca`, how well the feet of result and content agree, per cent; `similarity`, the cosine
    between the result and the content's sentence in the style. Raises MotionKitError as `sweep_noise`.
    """
    _some("examples", examples)
    _some("contents", contents)
    rows = []
    for value in values:
        own, made, prompts = method.with_recipe(change=value), [], []
        for example in examples:
            learned = own.learn(example.motion, example.text, content=example.content, title="")
            made += [own.stylize(clip.motion, learned, caption=clip.text) for clip in contents]
            prompts += [text.to_style(clip.text, learned.style) for clip in contents]
        given = [clip.motion for clip in contents] * len(examples)
        rows.append({"k": value} | _agreement(method, made, given, prompts))
    return rows


def _agreement(method, made: list[Motion], given: list[Motion], prompts: list[str]) -> dict:
    feet = [foot_contact_accuracy(one, foot_contacts(other)) for one, other in zip(made, given)]
    similar = method.discriminator.similarity(made, prompts).diagonal()
    return {"fca": round(sum(feet) / len(feet), 2), "similarity": round(float(similar.mean()), 4)}


def _some(what: str, clips: Sequence[Clip]) -> None:
    mute = next((clip.name for clip in clips if not clip.text), None)
    if not clips or mute is not None:
        found = "none" if not clips else f"{mute!r} without one"
        raise MotionKitError(f"a sweep needs {what}, clips with captions; found {found}")
