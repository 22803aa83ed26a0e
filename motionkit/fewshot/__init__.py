"""Paper 1's second stage: one clip teaches a style to a prior (section 3.4). `mk.methods.load("few-shot")` uses it."""

from .adapters import Adapter
from .autoencoder import ConvAutoencoder, Direct, with_autoencoder
from .chain import Chain, reconstruction_loss, total_loss
from .learning import ABLATIONS, Contents, Lesson, Recipe, teach
from .pairing import neutral_pair
from .space import Point, StyleSpace
from .styles import LearnedStyle, blended, prior_of
from .sweeps import sweep_change, sweep_noise

__all__ = [
    "ABLATIONS",
    "Adapter",
    "Chain",
    "ConvAutoencoder",
    "Contents",
    "Direct",
    "LearnedStyle",
    "Lesson",
    "Point",
    "Recipe",
    "StyleSpace",
    "blended",
    "neutral_pair",
    "prior_of",
    "reconstruction_loss",
    "sweep_change",
    "sweep_noise",
    "teach",
    "total_loss",
    "with_autoencoder",
]
