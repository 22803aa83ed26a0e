"""The unit of length of a BVH file, which no file states: a guess from how tall the skeleton is."""

from __future__ import annotations

from .skeleton import Skeleton

# Sizes (as `Skeleton.height`, in file units) up to which a file is taken to be in that unit.
_UNIT_GUESSES = ((5.0, 1.0), (45.0, 0.056444), (450.0, 0.01), (float("inf"), 0.001))


def guess_metres_per_unit(skeleton: Skeleton, unit: float = 1.0) -> float:
    """Metres a unit, guessed for a skeleton written in units of `unit` metres; see `load` for the steps.

    >>> import torch
    >>> guess_metres_per_unit(Skeleton(("a", "b"), (-1, 0), torch.tensor([[0.0, 90, 0], [0.0, 80, 0]])))
    0.01
    """
    size = (skeleton.height or float(skeleton.offsets.norm(dim=-1).max())) / unit
    return next(metres for limit, metres in _UNIT_GUESSES if size <= limit) if size else 1.0
