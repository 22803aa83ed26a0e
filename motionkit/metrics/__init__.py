"""How good a result is, in numbers that say what they measure."""

from .truth import truth_error

__all__ = ["truth_error"]
