"""Confidence intervals by bootstrap, for any metric."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from ..errors import MotionKitError


class Interval(NamedTuple):
    """A figure, and between which two it would lie in most repeats of the experiment."""

    value: float
    low: float
    high: float


def bootstrap(
    statistic: Callable[..., float | Tensor], *samples: Tensor, level: float = 0.95, repeats: int = 1000, seed: int = 0
) -> Interval:
    """A statistic of samples with its percentile interval (Efron 1979): rows are drawn again, with replacement.

    statistic: takes the samples, returns one number. samples: tensors of the same number of rows N, drawn together (a
    prediction stays with its label). Raises MotionKitError for fewer than two rows, rows that do not fit, a level that
    is no share, or a statistic that is not finite.

    >>> found = bootstrap(torch.mean, torch.arange(100.0))
    >>> found.value, found.low < 49.5 < found.high
    (49.5, True)
    """
    counts = {len(s) for s in samples}
    if len(counts) != 1 or min(counts) < 2:
        raise MotionKitError(f"bootstrap: expected samples of one length, two rows at least; found {sorted(counts)}")
    if not 0 < level < 1 or repeats < 10:
        raise MotionKitError(f"bootstrap: level between 0 and 1 and 10 repeats at least; found {level!r}, {repeats!r}")
    generator, count = torch.Generator().manual_seed(seed), counts.pop()
    value = float(statistic(*samples))
    drawn = (torch.randint(count, (count,), generator=generator) for _ in range(repeats))
    again = torch.tensor([float(statistic(*(s[rows] for s in samples))) for rows in drawn], dtype=torch.float64)
    if not torch.isfinite(again).all() or value != value:
        raise MotionKitError("bootstrap: the statistic is not finite for some of the draws; look at its samples")
    edges = torch.quantile(again, torch.tensor([(1 - level) / 2, (1 + level) / 2], dtype=torch.float64))
    return Interval(value, *edges.tolist())
