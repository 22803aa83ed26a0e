"""How good a result is, in numbers that say what they measure."""

from .spectra import speed_bands, within_spread
from .truth import truth_error

__all__ = ["speed_bands", "truth_error", "within_spread"]
