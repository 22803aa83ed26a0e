"""The exercises of notebook 08: a critic's gradient penalty, and the residuals of styles."""

from __future__ import annotations

import torch
from torch import Tensor

from . import Exercise, seeded_randn


def _slopes(answers: Tensor, points: Tensor) -> Tensor:
    return torch.autograd.grad(answers.sum(), points, create_graph=True)[0]


def _slope_penalty(answers: Tensor, points: Tensor, weight: float) -> Tensor:
    """A critic's answers [B] to points [B, D], which ask for gradients: the weighted mean of its squared slopes."""
    return weight * _slopes(answers, points).square().sum(1).mean()


def _critic() -> dict[str, tuple]:
    """A critic's answers, the points, and the weight."""
    cases = {}
    for weight in (1.0, 128.0):
        points = seeded_randn(6, 3).requires_grad_()
        cases[f"weight {weight:g}"] = ((points**2).sum(1) + points[:, 0], points, weight)
    return cases


def _residual_mix(neutral: Tensor, residuals: Tensor, shares: list[float]) -> Tensor:
    """What the neutral branch says [F, H], and so much of what each style [S, F, H] adds."""
    return neutral + torch.einsum("s,sfh->fh", torch.tensor(shares), residuals)


def _branches() -> dict[str, tuple]:
    neutral, residuals = seeded_randn(5, 4), seeded_randn(3, 5, 4, seed=1)
    shares = {
        "half of one style": [0.5, 0.0, 0.0],
        "half of each of two": [0.5, 0.0, 0.5],
        "all of one": [1.0, 0.0, 0.0],
        "more than all of one": [0.0, 1.5, 0.0],
        "no style": [0.0, 0.0, 0.0],
    }
    return {words: (neutral, residuals, values) for words, values in shares.items()}


EXERCISES = {
    "residual_mix": Exercise(
        _residual_mix,
        cases=_branches,
        hints=(
            "what is left where all shares are 0?",
            "the neutral branch counts once, each residual by its share.",
            "z' = neutral + the sum over s of shares[s] * residuals[s].",
        ),
        mistakes={
            "The neutral branch counts in full, whatever the shares are.": lambda x, residuals, shares: _residual_mix(
                (1 - sum(shares)) * x, residuals, shares
            ),
            "The neutral branch is missing.": lambda x, residuals, shares: _residual_mix(0 * x, residuals, shares),
            "A sum, not a mean: do not divide by S.": lambda x, residuals, shares: _residual_mix(
                x, residuals / 3, shares
            ),
            "Each residual counts by its own share.": lambda x, residuals, shares: x + sum(shares) * residuals.mean(0),
        },
    ),
    "slope_penalty": Exercise(
        _slope_penalty,
        cases=_critic,
        hints=(
            "the critic is to learn from this number: what must still be possible after torch.autograd.grad?",
            "square each point's slope, add over D, take the mean over B; and keep the way back through the slope.",
            "torch.autograd.grad(answers.sum(), points, create_graph=True) gives the slopes [B, D], in a tuple of one.",
        ),
        mistakes={
            "With create_graph=True the slope itself can be differentiated; without it the critic learns nothing.": (
                lambda *case: _slope_penalty(*case).detach()
            ),
            "The length of the slope is to be squared.": lambda a, x, weight: weight * _slopes(a, x).norm(dim=1).mean(),
            "Add the squares over D; the mean is over points only.": lambda a, x, weight: (
                weight * (_slopes(a, x) ** 2).mean()
            ),
            "Derive the sum of the answers: their mean makes each point's slope B times too small.": (
                lambda a, x, weight: _slope_penalty(a / len(x), x, weight)
            ),
            "The weight is missing.": lambda a, x, weight: _slope_penalty(a, x, 1.0),
        },
    ),
}
