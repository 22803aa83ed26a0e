"""Paper 2, Style-ERD: online style transfer, one frame in, one frame out.

`mk.methods.load("style-erd")` is the method; here are its parts: frames (`frames_of`), losses (eqs. 2 to 9), training
(`ErdRecipe`, `train_erd`), the trained model (`ErdModel`), live streams (`ErdStream`), a style more (`learn_style`).
"""

from .frames import frames_of, motion_from
from .losses import (
    adversarial_loss,
    critic_loss,
    critic_total,
    generator_total,
    gradient_penalty,
    perceptual_loss,
    quaternion_loss,
    rebuilding_loss,
)
from .model import ErdModel
from .new_style import learn_style
from .recipe import ABLATIONS, ErdRecipe, train_erd
from .stream import ErdStream

__all__ = [
    "ABLATIONS",
    "ErdModel",
    "ErdRecipe",
    "ErdStream",
    "adversarial_loss",
    "critic_loss",
    "critic_total",
    "frames_of",
    "generator_total",
    "gradient_penalty",
    "learn_style",
    "motion_from",
    "perceptual_loss",
    "quaternion_loss",
    "rebuilding_loss",
    "train_erd",
]
