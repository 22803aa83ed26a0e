"""How good a result is, in numbers that say what they measure. Each has cases with a known answer in its test."""

from .diversity import global_diversity, local_diversity
from .frechet import content_fmd, fmd, style_fmd
from .intervals import Interval, bootstrap
from .paths import foot_contact_accuracy, foot_sliding_factor, trajectory_similarity
from .recognition import confusion, recognition_accuracy, repeated_accuracy
from .repeats import FiniteShare, Spread, finite_rows, finite_share, spread
from .soundness import bone_length_error, jitter, penetration
from .spectra import speed_bands, within_spread
from .texts import pair_similarities, text_similarity
from .truth import truth_error

__all__ = [
    "FiniteShare",
    "Interval",
    "Spread",
    "bone_length_error",
    "bootstrap",
    "confusion",
    "content_fmd",
    "finite_rows",
    "finite_share",
    "fmd",
    "foot_contact_accuracy",
    "foot_sliding_factor",
    "global_diversity",
    "jitter",
    "local_diversity",
    "pair_similarities",
    "penetration",
    "recognition_accuracy",
    "repeated_accuracy",
    "speed_bands",
    "spread",
    "style_fmd",
    "text_similarity",
    "trajectory_similarity",
    "truth_error",
    "within_spread",
]
