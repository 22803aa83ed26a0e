"""The exercises of notebook 08: for each its reference, its cases and its hint, as `lessons.Exercise` takes them."""

from __future__ import annotations

import torch
from torch import Tensor


def _slope_penalty(answers: Tensor, points: Tensor, weight: float) -> Tensor:
    """A critic's answers [B] to points [B, D], which ask for gradients: the weighted mean of its squared slopes."""
    slope = torch.autograd.grad(answers.sum(), points, create_graph=True)[0]
    return weight * slope.square().sum(1).mean()


def _residual_mix(neutral: Tensor, residuals: Tensor, shares: list[float]) -> Tensor:
    """What the neutral branch says [F, H], and so much of what each style [S, F, H] adds."""
    return neutral + torch.einsum("s,sfh->fh", torch.tensor(shares), residuals)


def _critics() -> list[tuple]:
    cases = []
    for weight in (1.0, 128.0):
        points = torch.randn(6, 3, generator=torch.Generator().manual_seed(0)).requires_grad_()
        cases.append(((points**2).sum(1) + points[:, 0], points, weight))
    return cases


def _branches() -> list[tuple]:
    chance = torch.Generator().manual_seed(0)
    neutral, residuals = torch.randn(5, 4, generator=chance), torch.randn(3, 5, 4, generator=chance)
    return [(neutral, residuals, shares) for shares in ([1.0, 0.0, 0.0], [0.5, 0.0, 0.5], [0.0, 1.5, 0.0], [0.0] * 3)]


EXERCISES = {
    "slope_penalty": (_slope_penalty, _critics, "square each point's slope, add over D, then take the mean over B"),
    "residual_mix": (_residual_mix, _branches, "the neutral branch counts once, each residual by its share"),
}
