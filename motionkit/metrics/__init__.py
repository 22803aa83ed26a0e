"""How good a result is, in numbers that say what they measure. Each has cases with a known answer in its test."""

from .diversity import global_diversity, local_diversity
from .frechet import fmd
from .intervals import Interval, bootstrap
from .paths import foot_contact_accuracy, foot_sliding_factor, trajectory_similarity
from .recognition import confusion, recognition_accuracy
from .soundness import bone_length_error, jitter, penetration
from .spectra import speed_bands, within_spread
from .truth import truth_error

__all__ = [
    "Interval",
    "bone_length_error",
    "bootstrap",
    "confusion",
    "fmd",
    "foot_contact_accuracy",
    "foot_sliding_factor",
    "global_diversity",
    "jitter",
    "local_diversity",
    "penetration",
    "recognition_accuracy",
    "speed_bands",
    "trajectory_similarity",
    "truth_error",
    "within_spread",
]
