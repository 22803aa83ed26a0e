"""Paper 2, Style-ERD: online style transfer, one frame in, one frame out. Method and weights are still to come."""

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

__all__ = [
    "adversarial_loss",
    "critic_loss",
    "critic_total",
    "generator_total",
    "gradient_penalty",
    "perceptual_loss",
    "quaternion_loss",
    "rebuilding_loss",
]
