"""The exercises of notebook 07: for each its reference, its cases and its hint, as `exercises.Exercise` takes them."""

from __future__ import annotations

import torch
from torch import Tensor


def _low_rank(weight: Tensor, down: Tensor, up: Tensor, strength: float) -> Tensor:
    """A matrix [out, in] with a change of low rank: A = down [rank, in], B = up [out, rank]."""
    return weight + strength * up @ down


def _blend(predictions: list[Tensor], weights: list[float], base: Tensor) -> Tensor:
    """Predictions with their weights, and the rest of 1 from the base."""
    return sum((w * x for w, x in zip(weights, predictions)), (1 - sum(weights)) * base)


def _matrices() -> list[tuple]:
    chance = torch.Generator().manual_seed(0)
    weight, down, up = (torch.randn(shape, generator=chance) for shape in ((6, 5), (2, 5), (6, 2)))
    return [(weight, down, up, strength) for strength in (1.0, 0.5, 0.0)]


def _predictions() -> list[tuple]:
    a, b, base = torch.randn(3, 1, 8, 4, generator=torch.Generator().manual_seed(0))
    return [([a], [1.0], base), ([a, b], [0.5, 0.5], base), ([a, b], [1.5, -0.5], base), ([a], [0.3], base)]


EXERCISES = {
    "low_rank": (_low_rank, _matrices, "B A has the shape of the matrix: up comes first, and strength scales it all"),
    "blend": (_blend, _predictions, "the weights of all that is added up make 1: the base gets what they leave"),
}
