"""Figures of several repeats, and figures that some motions do not have: both say how many they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion
from .checks import needs_finite


class Spread(NamedTuple):
    """Mean and standard deviation of a figure over `count` repeats; printed as papers do: 60.86±2.06.

    >>> found = Spread(60.864, 2.055, 5)
    >>> print(found, f"{found:.1f}")
    60.86±2.06 60.9±2.1
    """

    mean: float
    std: float
    count: int

    def __format__(self, spec: str) -> str:
        return f"{self.mean:{spec or '.2f'}}±{self.std:{spec or '.2f'}}"

    def __str__(self) -> str:
        return format(self)


def spread(values: Sequence[float] | Tensor) -> Spread:
    """Mean and spread of a figure that was measured in several repeats of an experiment (paper 3, table 2: 60.86±2.06).

    values: one number a repeat, in any unit. The spread is the standard deviation of a sample, with one repeat less in
    the denominator; paper 3 does not say which it takes. Raises MotionKitError for fewer than two repeats, or one that
    is not finite.

    >>> print(spread([58.0, 61.0, 64.0]))
    61.00±3.00
    """
    try:
        found = torch.as_tensor(values, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError):
        raise MotionKitError(f"spread: expected one number a repeat; found {values!r}") from None
    if found.ndim != 1 or len(found) < 2:
        raise MotionKitError(f"spread: expected one number for each of two repeats or more; found {list(found.shape)}")
    needs_finite("spread", "the repeats", found)
    return Spread(float(found.mean()), float(found.std()), len(found))


class FiniteShare(NamedTuple):
    """How many of `count` rows or motions are finite, and their share; printed as a footnote says it."""

    share: float
    finite: int
    count: int

    def __str__(self) -> str:
        missing = self.count - self.finite
        return f"without {missing} of {self.count}" if missing else f"all {self.count}"


def finite_rows(values: Tensor | Sequence[Motion | None]) -> Tensor:
    """Which rows [N, ...] of a tensor, or which of N motions, are finite numbers throughout: bool [N].

    A motion that a method never gave stands as None in the list and is not finite.

    >>> finite_rows(torch.tensor([[0.0, 1.0], [torch.nan, 1.0], [2.0, torch.inf]]))
    tensor([ True, False, False])
    """
    if isinstance(values, Tensor) and values.ndim:
        return torch.isfinite(values).reshape(len(values), -1).all(1) if len(values) else values.new_zeros(0).bool()
    if isinstance(values, list | tuple) and all(v is None or isinstance(v, Motion) for v in values):
        parts = [None if v is None else (v.rotations, v.translations) for v in values]
        return torch.tensor([p is not None and all(bool(torch.isfinite(x).all()) for x in p) for p in parts]).bool()
    raise MotionKitError(
        f"finite_rows: expected a tensor [N, ...] or a list of Motions (None where one is missing); found a "
        f"{type(values).__name__}"
    )


def finite_share(values: Tensor | Sequence[Motion | None]) -> FiniteShare:
    """How many of the rows or motions are finite (see `finite_rows`), so that a table can say what a mean leaves out.

    >>> errors = torch.tensor([12.0, torch.nan, 14.0])
    >>> print(errors[finite_rows(errors)].mean().item(), finite_share(errors))
    13.0 without 1 of 3
    """
    rows = finite_rows(values)
    finite, count = int(rows.sum()), len(rows)
    return FiniteShare(finite / count if count else 0.0, finite, count)
