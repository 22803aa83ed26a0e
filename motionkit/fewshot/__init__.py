"""Paper 1's second stage: one clip teaches a style to a prior (section 3.4). `mk.methods.load("few-shot")` uses it."""

from .adapters import Adapter
from .chain import Chain, reconstruction_loss, total_loss
from .learning import Contents, Lesson, Recipe, teach
from .pairing import neutral_pair
from .styles import LearnedStyle, blended, prior_of

__all__ = [
    "Adapter",
    "Chain",
    "Contents",
    "LearnedStyle",
    "Lesson",
    "Recipe",
    "blended",
    "neutral_pair",
    "prior_of",
    "reconstruction_loss",
    "teach",
    "total_loss",
]
