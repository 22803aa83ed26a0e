"""Networks that judge motions: classifiers of content and style, and the feature encoders that FMD measures in.

>>> import motionkit as mk
>>> mk.judges.load("actor")
Judge('actor', 12 contents, 8 styles)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from .. import checkpoints
from ..errors import MotionKitError
from .autoencoder import DenoisingAutoencoder, MotionAutoencoder, denoising_loss
from .classifier import Classifier
from .recipes import PARTS, train_autoencoder, train_classifier

__all__ = [
    "Classifier",
    "DenoisingAutoencoder",
    "Judge",
    "MotionAutoencoder",
    "denoising_loss",
    "load",
    "names",
    "train_autoencoder",
    "train_classifier",
]


@dataclass(frozen=True, eq=False)
class Judge:
    """What a dataset's results are measured with; `mk.arena.run` takes one.

    content, style: classifiers of the dataset's labels. autoencoder: paper 2's feature encoder.
    """

    name: str
    content: Classifier
    style: Classifier
    autoencoder: MotionAutoencoder

    def __repr__(self) -> str:
        return f"Judge({self.name!r}, {len(self.content.labels)} contents, {len(self.style.labels)} styles)"


def names() -> list[str]:
    """The datasets that `load` has judges of.

    >>> names()
    ['actor', 'actor-held-back', 'bandai-2']
    """
    there = set(checkpoints.names())
    found = {name.removesuffix("-style") for name in there if name.endswith("-style")}
    return sorted(name for name in found if {_home(name, part) for part in PARTS} <= there)


def _home(name: str, part: str) -> str:
    """The checkpoint of a part of a dataset's judge: `actor-held-back` has but styles of its own."""
    return f"{'actor' if name == 'actor-held-back' and part != 'style' else name}-{part}"


@lru_cache(maxsize=4)
def load(name: str = "actor") -> Judge:
    """The shipped judge of a dataset; MotionKitError if there is none, and how to train one."""
    if name not in names():
        raise MotionKitError(
            f"no judge for {name!r}; there are {', '.join(names()) or 'none'}. Train one: python -m motionkit train "
            f"judge --data {name}"
        )
    content, style = (Classifier.load(checkpoints.find(_home(name, label))) for label in ("content", "style"))
    return Judge(name, content, style, MotionAutoencoder.load(checkpoints.find(_home(name, "autoencoder"))))
