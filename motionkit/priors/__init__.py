"""Text to motion: the prior that papers 1, 4 and 5 stand on, and the discriminator that says how well both agree."""

from __future__ import annotations

from .. import checkpoints
from ..text import TextEncoder
from .discriminator import Discriminator
from .prior import SCALE, Prior
from .recipes import retrieval, train_discriminator, train_prior
from .retrieval import recalls
from .text_recipe import train_text

__all__ = [
    "SCALE",
    "Discriminator",
    "Prior",
    "load",
    "load_discriminator",
    "recalls",
    "retrieval",
    "train_discriminator",
    "train_prior",
    "train_text",
]


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
