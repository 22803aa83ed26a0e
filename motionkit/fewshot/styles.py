"""A style that was learned from one clip: what it changes in a prior, in a small file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from .. import checkpoints, text
from ..errors import MotionKitError
from ..priors import Prior
from ..sampling import Predict
from .adapters import Adapter
from .chain import Chain
from .space import Point, StyleSpace


@dataclass(eq=False)
class LearnedStyle:
    """What `learn` of the few-shot method gives.

    prior: what was fine-tuned. adapter: its changes, or the style's place in a space of styles. chain: the steps that
    it was taught on. prompt: of the style example. style: the words of style in it. card: how it was made. neutral: the
    pair's neutral motion, features [F, D], where it was just learned.
    """

    prior: Prior
    adapter: Adapter | Point
    chain: Chain
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
        return self.adapter.frozen()

    def predict(self, caption: str) -> Predict:
        """The changed denoiser with a content's sentence told in this style, for any function of `sampling`."""
        told = text.to_style(caption, self.style) if self.adapter.hears_style else text.to_neutral(caption)
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
        card |= {} if isinstance(self.adapter, Adapter) else {"space": self.adapter.space[0].key}
        return checkpoints.save(path, tensors, card | {"stops": list(self.chain.stops), "prior": self.prior.key})

    @classmethod
    def load(cls, path: str | os.PathLike, prior: Prior, space: StyleSpace | None = None) -> LearnedStyle:
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
        adapter = Point(space) if card.get("space") else Adapter(prior.network, card["rank"])
        checkpoints.load_into(adapter.changes, {name: value.float() for name, value in tensors.items()}, path)
        return cls(prior, adapter, Chain(prior.schedule, tuple(card["stops"])), card["prompt"], card["style"], card)


def prior_of(path: str | os.PathLike) -> str:
    """The dataset whose prior a saved style belongs to; MotionKitError as `LearnedStyle.load`."""
    card = checkpoints.load(path, "style")[1]
    if not card.get("data"):
        raise MotionKitError(f"{path}: its card does not name a dataset; load it with LearnedStyle.load(path, prior)")
    return card["data"]


def blended(styles: Mapping[LearnedStyle, float], caption: str, base: Predict) -> Predict:
    """Predictions of several styles together, each with its weight, and the rest of 1 from the prior as it is.

    base: the prior with the content's own sentence. One style with a weight of 1 is that style, 0.5 half of it, 1.5 a
    caricature; two with 0.5 each lie between both; a style with 1.5 and another with -0.5 lies beyond. It is
    DiffusionBlending (Shafir et al. 2024), which paper 1, section 7, names for this. Raises MotionKitError where no
    style is given.

    >>> blended({}, "a person walks", lambda x, t: x)
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
