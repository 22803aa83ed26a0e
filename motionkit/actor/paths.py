"""Paths on the ground that walkers follow."""

from __future__ import annotations

import math
import warnings

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..files import MotionKitWarning
from .clock import FINE, interpolate

SHARPEST = 0.7  # radians that a walker turns in one step at most
_SPACING, _MOST = 0.02, 20_000  # metres between the points that a path is read at, and how many at the most
_SHORTEST = 0.12  # of a step: who turns on the spot still gets round


def checked_path(path: object) -> Tensor | None:
    """A path as [N, 2] float64; MotionKitError if it is not at least two different places of finite numbers.

    >>> checked_path([[0, 0], [0, 3]]).shape
    torch.Size([2, 2])
    """
    if path is None:
        return None
    try:
        points = torch.as_tensor(path, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError):
        raise MotionKitError(f"path: expected places on the ground [N, 2], x and z in metres; found {path!r}") from None
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not torch.isfinite(points).all():
        raise MotionKitError(
            f"path: expected at least two places [N, 2], x and z in metres, all finite; found {list(points.shape)}"
        )
    apart = torch.linalg.vector_norm(points[1:] - points[:-1], dim=1)
    points = torch.cat((points[:1], points[1:][apart > 1e-6]))
    if len(points) < 2:
        raise MotionKitError("path: all places are the same one; give at least two that differ")
    return points


def follow(path: Tensor, stride: Tensor, first_beat: float, shown_from: float) -> tuple[Tensor, Tensor, Tensor]:
    """Along a smooth curve through a path: place [N, 2], heading [N], and the share of the stride that is taken [N].

    path: [M, 2] metres. stride: [N] metres a beat, on the fine axis of beats that begins at `first_beat`. The walk
    begins at the beat `shown_from` and stops at the path's end; where the path bends sharply steps are shorter, with a
    MotionKitWarning.
    """
    length, dense, yaw = _curve(path)
    bend = torch.nn.functional.pad((yaw[1:] - yaw[:-1]).abs() / (length[1:] - length[:-1]).clamp(min=1e-9), (1, 0))
    near = max(1, round(0.4 / float(length[-1] / (len(length) - 1))))  # a step looks so far ahead and behind
    worst = torch.nn.functional.max_pool1d(bend[None, None], 2 * near + 1, 1, near)[0, 0]
    travelled, shares, slowest = _travel(stride.tolist(), length, worst.tolist(), first_beat, shown_from)
    if slowest < 0.9:
        warnings.warn(
            "path: it bends more sharply than the stride allows; the walker slows down there, to "
            f"{slowest:.0%} of a step",
            MotionKitWarning,
            stacklevel=2,
        )
    return interpolate(travelled, length, dense), interpolate(travelled, length, yaw), shares


def _curve(path: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Lengths along a smooth curve [K], its points [K, 2] and the heading there [K], unwrapped."""
    from scipy.interpolate import CubicSpline

    chord = torch.linalg.vector_norm(path[1:] - path[:-1], dim=1)
    knots = torch.cat((chord.new_zeros(1), torch.cumsum(chord, 0)))
    curve = CubicSpline(knots.numpy(), path.numpy(), bc_type="natural")
    count = min(max(50, int(float(knots[-1]) / _SPACING)), _MOST)
    grid = torch.linspace(0, float(knots[-1]), count, dtype=torch.float64)
    points, tangent = (torch.from_numpy(curve(grid.numpy(), n)) for n in (0, 1))
    steps = torch.linalg.vector_norm(points[1:] - points[:-1], dim=1)
    yaw = torch.atan2(tangent[:, 0], tangent[:, 1])
    turns = torch.remainder(yaw[1:] - yaw[:-1] + math.pi, 2 * math.pi) - math.pi
    return (
        torch.cat((steps.new_zeros(1), torch.cumsum(steps, 0))),
        points,
        torch.cat((yaw[:1], yaw[0] + torch.cumsum(turns, 0))),
    )


def _travel(
    stride: list[float], length: Tensor, worst: list[float], first_beat: float, shown_from: float
) -> tuple[Tensor, Tensor, float]:
    """Metres travelled and share of the stride at each fine beat, and the smallest share that a bend left."""
    end = float(length[-1])
    spacing = end / (len(length) - 1)
    now, places, shares, slowest = 0.0, [], [], 1.0
    for n, step in enumerate(stride):
        step = abs(step)
        sharp = worst[min(int(now / spacing), len(worst) - 1)]
        share = min(1.0, max(SHARPEST / max(sharp * step, 1e-9), _SHORTEST))
        slowest = min(slowest, share if now < end - 0.3 else 1.0)
        share *= min(1.0, max(0.0, (end - now) / max(1.2 * step, 1e-6)))
        places.append(now)
        shares.append(share)
        if first_beat + n / FINE >= shown_from:
            now += step * share / FINE
    return torch.tensor(places, dtype=torch.float64), torch.tensor(shares, dtype=torch.float64), slowest
