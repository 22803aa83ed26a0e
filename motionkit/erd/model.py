"""A trained Style-ERD with all that it must know beside its weights."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .. import checkpoints
from ..errors import MotionKitError
from ..layers import ErdConfig, StyleErd
from ..pairs import NEUTRAL
from ..restyling import check_share
from ..skeleton import Skeleton
from .fast import FastErd
from .labels import Labeller
from .quick_body import QuickBody

_LABELS = "labels."  # before the names of the labeller's weights


@dataclass(eq=False)
class ErdModel:
    """A trained Style-ERD: its network, the labels that it knows (the neutral style first), its skeleton and rate.

    labeller: what guesses labels that nobody says; None where there is none.
    """

    network: StyleErd
    contents: tuple[str, ...]
    styles: tuple[str, ...]
    skeleton: Skeleton
    fps: float
    labeller: Labeller | None = None
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"ErdModel({len(self.contents)} contents, {len(self.styles)} styles, {self.fps:g} fps)"

    @cached_property
    def fast(self) -> FastErd:
        """The network's quick step."""
        return FastErd(self.network)

    @cached_property
    def body(self) -> QuickBody:
        """The skeleton's quick kinematics."""
        return QuickBody(self.skeleton)

    def number(self, what: str, label: str) -> int:
        """Of a `content` or a `style`, neutral by any name; MotionKitError names the nearest."""
        if what == "style" and label in NEUTRAL:
            return 0
        known = self.contents if what == "content" else self.styles
        if label not in known:
            near = difflib.get_close_matches(str(label), known, 1, 0.4)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise MotionKitError(f"style-erd knows no {what} {label!r}; {hint}it knows {', '.join(known)}")
        return known.index(label)

    def wanted(self, style: str | Mapping[str, float], strength: float = 1.0) -> np.ndarray:
        """How much of each style, [S], from a name or a mix such as {"old": 0.5, "proud": 0.5} (paper 2, section 4.4).

        What a mix leaves of 1 is neutral, and what is beyond 1 is taken from it. Raises MotionKitError for unknown
        styles and numbers that are not finite.
        """
        if not isinstance(style, str | Mapping):
            hint = "a name, or a mix such as {'old': 0.5, 'proud': 0.5}"
            raise MotionKitError(f"style-erd takes a style by {hint}; found {style!r:.80}")
        mix, found = {style: 1.0} if isinstance(style, str) else dict(style), np.zeros(len(self.styles), np.float32)
        check_share("style-erd: strength", strength)
        for name, share in mix.items():
            check_share(f"style-erd: the share of style {name!r}", share)
            found[self.number("style", name)] += share * strength
        found[0] = 1 - found[1:].sum()
        return found

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`; 32 bits, since errors would add up from frame to frame."""
        card = {"kind": "style-erd", **self.card, "config": asdict(self.network.config), "fps": self.fps}
        card |= {"contents": list(self.contents), "styles": list(self.styles)}
        card["skeleton"] = checkpoints.skeleton_card(self.skeleton)
        tensors = dict(self.network.state_dict())
        if self.labeller is not None:
            tensors |= {_LABELS + name: value for name, value in self.labeller.state_dict().items()}
        return checkpoints.save(path, tensors, card)

    @classmethod
    def load(cls, path: str | os.PathLike) -> ErdModel:
        """From what `save` wrote; MotionKitError if the files are damaged, of another kind or of other sizes."""
        tensors, card = checkpoints.load(path, "style-erd")
        config = checkpoints.config_of(path, card, ErdConfig)
        config = replace(config, encoder=tuple(config.encoder), decoder=tuple(config.decoder))
        skeleton = checkpoints.skeleton_of(card["skeleton"])
        contents, styles = tuple(card["contents"]), tuple(card["styles"])
        sizes, labeller = (len(skeleton), len(contents), len(styles)), None
        labels = {name.removeprefix(_LABELS): tensors.pop(name) for name in list(tensors) if name.startswith(_LABELS)}
        network = StyleErd(*sizes, config).eval()
        checkpoints.load_into(network, tensors, path)
        if labels:
            labeller = Labeller(*sizes).eval()
            checkpoints.load_into(labeller, labels, path)
            labeller.requires_grad_(False)
        return cls(network.requires_grad_(False), contents, styles, skeleton, card["fps"], labeller, card)
