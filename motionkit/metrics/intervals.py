"""Confidence intervals by bootstrap, for any metric."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ..errors import MotionKitError
from .checks import needs_tensor
from .repeats import finite_share


class Interval(NamedTuple):
    """A figure, and between which two it would lie in most repeats of the experiment."""

    value: float
    low: float
    high: float


def bootstrap(
    statistic: Callable[..., float | Tensor],
    *samples: Tensor,
    level: float = 0.95,
    repeats: int = 1000,
    seed: int = 0,
    groups: Tensor | Sequence[Tensor] = (),
    centred: bool = False,
) -> Interval:
    """A statistic of samples with its percentile interval (Efron 1979): rows are drawn again, with replacement.

    statistic: takes the samples, returns one number. samples: tensors of N rows each, drawn together. groups: one
    tensor of ids [N], or several, of what rows share, as the content clip and the style clip of each transfer. Whole
    groups are drawn again, and a row counts as often as the product of its groups' counts (the pigeonhole bootstrap,
    Owen 2007): 3,780 transfers made from 70 clips hold the luck of 70 clips. A draw of fewer than N rows is repeated.

    centred: for a statistic that repeated rows alone drive up, as they do with `fmd`: the draws are shifted by their
    median to the value, so that their spread lies around it. An end may then lie below what the statistic can reach.

    Raises MotionKitError for fewer than two rows, rows or groups that do not fit, a level that is no share, or a
    statistic that is not finite.

    >>> found = bootstrap(torch.mean, torch.arange(100.0))
    >>> found.value, found.low < 49.5 < found.high
    (49.5, True)
    >>> by_ten = bootstrap(torch.mean, torch.arange(100.0), groups=torch.arange(100) // 10)
    >>> by_ten.high - by_ten.low > 2 * (found.high - found.low)
    True
    """
    _check_options(statistic, level, repeats)
    count = _rows(samples)
    factors = _factors(groups, count) or [torch.arange(count)]
    value = float(statistic(*samples))
    again = _redrawn(statistic, samples, factors, repeats, seed)
    _check_finite(samples, torch.cat((again, again.new_tensor([value]))))
    if centred:
        again = again - again.median() + value
    edges = torch.quantile(again, torch.tensor([(1 - level) / 2, (1 + level) / 2], dtype=torch.float64))
    return Interval(value, *edges.tolist())


def _redrawn(
    statistic: Callable, samples: tuple[Tensor, ...], factors: list[Tensor], repeats: int, seed: int
) -> Tensor:
    """The statistic of each of the draws, [repeats]."""
    generator = torch.Generator().manual_seed(seed)
    drawn = (_drawn(factors, generator) for _ in range(repeats))
    return torch.tensor([float(statistic(*(s[rows] for s in samples))) for rows in drawn], dtype=torch.float64)


def _check_finite(samples: tuple[Tensor, ...], values: Tensor) -> None:
    if not torch.isfinite(values).all():
        worst = min(map(finite_share, samples))
        raise MotionKitError(
            f"bootstrap: the statistic is not finite for some of the draws; of the rows given to it "
            f"{worst.count - worst.finite} of {worst.count} are not"
        )


def _drawn(factors: list[Tensor], generator: torch.Generator) -> Tensor:
    """Row numbers of one draw: each factor's groups [N] drawn again, each row as often as its groups together."""
    rows = torch.empty(0, dtype=torch.long)
    while not len(rows):  # where few groups cross, a draw can miss every row
        times = torch.ones(len(factors[0]), dtype=torch.long)
        for ids in factors:
            sizes = int(ids.max()) + 1
            times = times * torch.bincount(torch.randint(sizes, (sizes,), generator=generator), minlength=sizes)[ids]
        rows = torch.repeat_interleave(times)
    return rows.repeat(-(-len(factors[0]) // len(rows)))


def _rows(samples: tuple[Tensor, ...]) -> int:
    for sample in samples:
        if needs_tensor("bootstrap", "samples", sample).ndim == 0:
            raise MotionKitError("bootstrap: expected samples with rows [N, ...]; found a single number")
    counts = {len(s) for s in samples}
    if len(counts) != 1 or min(counts) < 2:
        raise MotionKitError(f"bootstrap: expected samples of one length, two rows at least; found {sorted(counts)}")
    return counts.pop()


def _factors(groups: Tensor | Sequence[Tensor], count: int) -> list[Tensor]:
    """Each tensor of ids as group numbers from 0 up, [N]."""
    given = [groups] if isinstance(groups, Tensor) and groups.ndim == 1 else list(groups)
    for ids in given:
        needs_tensor("bootstrap", f"ids [{count}] in groups", ids)
        if tuple(ids.shape) != (count,):
            raise MotionKitError(
                f"bootstrap: expected in groups an id for each of {count} rows; found {list(ids.shape)}. Give one "
                "tensor of ids, or several in a tuple: groups=(content_ids, style_ids)"
            )
    factors = [torch.unique(ids.cpu(), return_inverse=True)[1] for ids in given]
    if factors and max(int(ids.max()) for ids in factors) < 1:
        raise MotionKitError("bootstrap: all rows are of one group, whose spread cannot be known; two are the least")
    return factors


def _check_options(statistic: object, level: float, repeats: int) -> None:
    if not callable(statistic):
        raise MotionKitError(
            f"bootstrap: expected a function of the samples first, like torch.mean; found {type(statistic).__name__}"
        )
    numbers = isinstance(level, int | float) and isinstance(repeats, int)
    if not numbers or not 0 < level < 1 or repeats < 10:
        raise MotionKitError(f"bootstrap: level between 0 and 1 and 10 repeats at least; found {level!r}, {repeats!r}")
