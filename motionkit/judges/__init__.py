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
from .recipes import train_autoencoder, train_classifier

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
    ['actor', 'bandai-2']
    """
    there = set(checkpoints.names())
    found = {name.removesuffix("-content") for name in there if name.endswith("-content")}
    return sorted(name for name in found if {f"{name}-style", f"{name}-autoencoder"} <= there)


@lru_cache(maxsize=4)
def load(name: str = "actor") -> Judge:
    """The shipped judge of a dataset; MotionKitError if there is none, and how to train one."""
    if name not in names():
        raise MotionKitError(
            f"no judge for {name!r}; there are {', '.join(names()) or 'none'}. Train one: python -m motionkit train "
            f"judge --data {name}"
        )
    content, style = (Classifier.load(checkpoints.find(f"{name}-{label}")) for label in ("content", "style"))
    return Judge(name, content, style, MotionAutoencoder.load(checkpoints.find(f"{name}-autoencoder")))
