"""Stage II of paper 1: one clip teaches a style (section 3.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import torch
from torch import Tensor

from .. import text
from ..errors import MotionKitError
from ..layers import semantic_loss
from ..motion import Motion
from ..priors import Discriminator, Prior
from ..training import Run, Schedule, fit
from .adapters import Adapter
from .chain import CHANGE, NOISE, STEPS, Chain, reconstruction_loss, total_loss
from .space import Point, StyleSpace

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

    noise: int = NOISE
    change: int = CHANGE
    chain: int = STEPS
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
class Contents:
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
        chain: Chain,
        frames: int = 120,
        seed: int = 0,
    ) -> Contents:
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
class Lesson:
    """What is there to learn from: a style example beside its neutral pair, and contents for the semantic loss.

    styled, neutral: features [F, D]. prompt: d^s. style: its words, see `text.style_in`. contents: None where the
    semantic loss is left out. space: where the style is looked for, see `Recipe`.
    """

    prior: Prior
    discriminator: Discriminator
    chain: Chain
    styled: Tensor
    neutral: Tensor
    prompt: str
    style: str
    contents: Contents | None = None
    space: StyleSpace | None = None

    @cached_property
    def own_text(self) -> Tensor:
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

    def example_loss(self, network: Callable[..., Tensor]) -> Tensor:
        """L_sr of a network (x, t, text) that is being taught (paper 1, eqs. 9 and 10)."""
        seen = self.chain.reverse(lambda x, t: network(x, t, self.own_text), self.own_noised)
        return reconstruction_loss(seen, self.styled)

    def meaning_loss(self, network: Callable[..., Tensor], batch: int) -> Tensor:
        """L_s: contents restyled by the network, as the frozen discriminator sees them (paper 1, eq. 11).

        batch: how many contents are drawn, by torch's random numbers.
        """
        chosen = torch.randint(len(self.contents.noised), (batch,))
        words = heard = self.content_texts[chosen]
        if self.space is not None:
            heard = self.prior.encoder.encode([self.contents.captions[n] for n in chosen.tolist()])
        restyled = self.chain.reverse(lambda x, t: network(x, t, heard), self.contents.noised[chosen])[-1]
        return semantic_loss(self.discriminator.network(restyled), words)


def teach(lesson: Lesson, recipe: Recipe, seed: int = 0, **running) -> tuple[Adapter | Point, Run]:
    """Fine-tune the lesson's prior on it (paper 1, section 3.4, eq. 12); the prior itself stays as it is.

    A lesson with a space of styles finds a point in it, by the same losses, near what is read off the clip.

    running: as in `training.fit`, such as `keep` for a file to go on from, `show` and `title`.
    """
    in_space = lesson.space is not None
    if in_space:
        adapter = Point(lesson.space, lesson.space.read(lesson.styled))
    else:
        adapter = Adapter(lesson.prior.network.eval(), recipe.rank, seed)
    lesson.discriminator.network.eval().requires_grad_(False)
    same = f"{recipe}, {lesson.prompt!r}, {len(lesson.styled)} frames"
    schedule = Schedule(recipe.steps, recipe.rate, decay=0.0, seed=seed, recipe=same)

    def loss_of(network: torch.nn.Module, step: int) -> Tensor:
        example = lesson.example_loss(network)
        guided = recipe.weights[1] > 0 and lesson.contents is not None
        meaning = lesson.meaning_loss(network, recipe.batch) if guided else example.new_zeros(())
        total = total_loss(example, meaning, recipe.weights)
        return total + adapter.unlikely() if in_space else total

    return adapter, fit(adapter, loss_of, schedule, **running)
