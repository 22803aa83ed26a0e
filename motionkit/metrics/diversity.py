"""How far a made motion departs from the one it was learnt from (Li et al. 2022, GANimator; used by paper 5)."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import MotionKitError
from .checks import needs_finite, needs_tensor


def local_diversity(result: Tensor, source: Tensor, length: int = 15) -> float:
    """How far each short window of a motion is from the nearest one of the source: 0 for a copy (paper 5: Loc-D).

    result: [F, D], source: [G, D], features of frames on one scale, such as normalised rotations. length: frames of a
    window. The distance of two windows is the root of the mean square over their numbers; the mean over all windows of
    the result is returned, in the features' unit. Raises MotionKitError for motions shorter than a window.

    >>> clip = torch.randn(60, 8, generator=torch.Generator().manual_seed(0))
    >>> local_diversity(clip[10:40], clip), local_diversity(clip + 1, clip) > 0.5
    (0.0, True)
    """
    costs = _costs(result, source, length)
    diagonal = _along_diagonals(costs)
    sums = diagonal[length:, length:] - diagonal[:-length, :-length]  # [F - length + 1, G - length + 1]
    return float((sums.amin(1) / length).clamp(min=0).sqrt().mean())


def global_diversity(result: Tensor, source: Tensor, shortest: int = 30) -> float:
    """How far a motion is from the best patchwork of pieces of the source: 0 if it is one (paper 5: Glo-D).

    result: [F, D], source: [G, D] as for `local_diversity`. Every piece has at least `shortest` frames, in the source's
    order; the best cut is found by dynamic programming. Returns the root of the mean square distance.

    >>> clip = torch.randn(80, 8, generator=torch.Generator().manual_seed(0))
    >>> global_diversity(torch.cat((clip[40:75], clip[:35])), clip)
    0.0
    """
    costs = _costs(result, source, shortest)
    diagonal = _along_diagonals(costs)
    frames, known = costs.shape
    best = torch.full((frames + 1,), torch.inf, dtype=costs.dtype)
    best[0] = 0
    for stop in range(shortest, frames + 1):
        for start in range(max(0, stop - known), stop - shortest + 1):
            if torch.isfinite(best[start]):
                length = stop - start
                piece = (diagonal[stop, length:] - diagonal[start, : known + 1 - length]).amin()
                best[stop] = torch.minimum(best[stop], best[start] + piece)
    return float((best[frames] / frames).clamp(min=0).sqrt())


def _costs(result: Tensor, source: Tensor, length: int) -> Tensor:
    """Mean square distance of every frame to every frame, [F, G] float64."""
    for name, features in (("result", result), ("source", source)):
        needs_tensor("diversity", f"features of the {name} [F, D]", features)
    if result.ndim != 2 or source.ndim != 2 or result.shape[1] != source.shape[1]:
        raise MotionKitError(
            f"diversity: expected features [F, D] and [G, D]; found {list(result.shape)} and {list(source.shape)}"
        )
    if not 0 < length <= min(len(result), len(source)):
        raise MotionKitError(
            f"diversity: windows of {length} frames need motions as long; found {len(result)} and {len(source)} frames"
        )
    needs_finite("diversity", "the result", result)
    needs_finite("diversity", "the source", source)
    return ((result.double()[:, None] - source.double()) ** 2).mean(-1)


def _along_diagonals(costs: Tensor) -> Tensor:
    """Sums along the diagonals, [F + 1, G + 1]: entry (i, j) is cost(i-1, j-1) + cost(i-2, j-2) + ..."""
    sums = costs.new_zeros(len(costs) + 1, costs.shape[1] + 1)
    for row in range(len(costs)):
        sums[row + 1, 1:] = sums[row, :-1] + costs[row]
    return sums
