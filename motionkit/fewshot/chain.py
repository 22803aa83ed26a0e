"""The road from a neutral motion to a styled one: a little noise forwards, and a prior that takes it away again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .. import sampling
from ..diffusion import NoiseSchedule
from ..sampling import Predict

PAPER_SCHEDULE = NoiseSchedule.cosine(1000)  # whose steps paper 1's G, K and S are
NOISE, CHANGE, STEPS = 950, 300, 20  # G, K and S (paper 1, section 4)


@dataclass(frozen=True)
class Chain:
    """The few steps between a motion and its noised self (paper 1, eq. 9 and section 4: K = 300, S = 20).

    schedule: of the prior. stops: its steps, noisiest first.

    >>> Chain.like_paper(PAPER_SCHEDULE).stops
    (300, 250, 200, 150, 100, 50)
    >>> Chain.like_paper(PAPER_SCHEDULE.louder(6)).stops
    (48, 38, 29, 20, 12, 5)
    """

    schedule: NoiseSchedule
    stops: tuple[int, ...]

    @classmethod
    def like_paper(cls, schedule: NoiseSchedule, change: int = CHANGE, steps: int = STEPS) -> Chain:
        """Starts with the noise of K = `change` of 1000 steps, S = `steps` in all (paper 1, section 4).

        Steps of another schedule are those with the same noise (`NoiseSchedule.step_like`). Raises MotionKitError for
        numbers out of range.
        """
        paper = sampling.timesteps(PAPER_SCHEDULE, steps, change)
        stops = [schedule.step_like(step, PAPER_SCHEDULE) for step in paper]
        return cls(schedule, tuple(dict.fromkeys(stops)))

    def forward(self, predict: Predict, x: Tensor) -> Tensor:
        """Clean x [B, F, D] to its noised self, m_K: deterministic DDIM forwards (paper 1, section 4)."""
        return sampling.ddim_invert(predict, x, self.schedule, self.stops)

    def reverse(self, predict: Predict, noised: Tensor) -> Tensor:
        """The predictions of the clean motion on the way back, [N, B, F, D], the last one last (paper 1, eq. 9).

        Gradients go through all steps. Step 0, where DDIM ends, is the last prediction itself.

        >>> chain = Chain.like_paper(PAPER_SCHEDULE)
        >>> chain.reverse(lambda x, t: torch.full_like(x, 3.0), torch.randn(1, 4, 2)).shape
        torch.Size([6, 1, 4, 2])
        """
        seen: list[Tensor] = []
        sampling.ddim(predict, noised, self.schedule, self.stops, callback=lambda s, x, x0: seen.append(x0))
        return torch.stack(seen)


def reconstruction_loss(predictions: Tensor, style: Tensor) -> Tensor:
    """How far the predictions of every step of the chain are from the style example (paper 1, eq. 10); mean of squares.

    predictions: [N, B, F, D], of `Chain.reverse` from the noised neutral motion. style: [B, F, D].

    >>> reconstruction_loss(torch.zeros(6, 1, 4, 2), torch.full((1, 4, 2), 2.0))
    tensor(4.)
    """
    return ((predictions - style) ** 2).mean()


def total_loss(example: Tensor, meaning: Tensor, weights: Sequence[float] = (1.0, 0.1)) -> Tensor:
    """Both losses together, lambda_sr L_sr + lambda_s L_s (paper 1, eq. 12; 1 and 0.1 in section 4).

    example: of `reconstruction_loss`. meaning: of `layers.semantic_loss` (eq. 11).

    >>> total_loss(torch.tensor(2.0), torch.tensor(0.5))
    tensor(2.0500)
    """
    return weights[0] * example + weights[1] * meaning
