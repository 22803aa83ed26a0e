"""The motion-semantic discriminator: how well a motion goes with a sentence."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from .. import checkpoints, text
from ..errors import MotionKitError
from ..features import Normalizer
from ..layers import SemanticEncoder, TransformerConfig
from ..motion import Motion
from .features import OfBody, encoded


@dataclass(eq=False)
class Discriminator:
    """Paper 1's Dis (section 3.3, figure 3): motions as vectors in the space of sentences.

    network: reads normalised features. layout, normalizer: those of the prior whose embedding it shares. encoder: of
    the sentences. card: how it was made.

    >>> import motionkit as mk
    >>> judge = mk.priors.load_discriminator("actor")
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
        return encoded(motion, self.layout, self.normalizer)

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
        config = checkpoints.config_of(path, card, TransformerConfig)
        network = SemanticEncoder(layout.size, card["text_size"], config).eval()
        checkpoints.load_into(network, {name: value.float() for name, value in tensors.items()}, path)
        return cls(network, layout, normalizer, encoder, card)
