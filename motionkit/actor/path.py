"""Paths on the ground that walkers follow."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..files import MotionKitWarning
from .bodies import Performer
from .score import FINE, WALKS, Action, MotionPlan, interpolate, smooth
from .style import Style

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


WALK_STEP, RUN_STEP, BACK_STEP = 0.75, 1.28, -0.48  # length of a step, in leg lengths


@dataclass(frozen=True)
class Route:
    """axis: fine beats [N]. place: [N, 2] metres, x and z. heading: yaw [N] radians. going: 0 standing to 1 walking.

    running, backing: shares of running and of walking backwards, [N].
    """

    axis: Tensor
    place: Tensor
    heading: Tensor
    going: Tensor
    running: Tensor
    backing: Tensor

    def at(self, beats: Tensor, what: str) -> Tensor:
        """One of its columns, read at beats [F]."""
        return interpolate(beats, self.axis, getattr(self, what))


def plan_route(score: MotionPlan, style: Style, performer: Performer, axis: Tensor) -> Route:
    """Follow the score's path, or walk ahead and turn where it says."""
    going = score.weight(axis, WALKS)
    running, backing = score.weight(axis, ("run",)), score.weight(axis, ("walk_back",))
    length = (WALK_STEP + (RUN_STEP - WALK_STEP) * running + (BACK_STEP - WALK_STEP) * backing) * performer.leg
    chance = 1 + style.variability * (0.02 * score.draw("stride") + 0.03 * score.noise("stride", axis))
    stride = length * style.step_length * chance.clamp(0.5, 1.5) * going
    limp = 1 - style.asymmetry * torch.cos(math.pi * (axis - 0.5))
    stride = stride * limp
    lost = style.wander * 0.3 * score.noise("lost", axis, 1.3)
    drift = going * (0.02 * style.variability * score.noise("drift", axis, 2.0) + lost)
    if score.path is not None:
        place, heading, share = follow(score.path, stride, float(axis[0]), score.first)
        return Route(axis, place, heading + drift, going * share, running, backing)
    heading = drift.clone()
    for act in score.acts:
        if act.turn:
            heading = heading + act.turn * smooth((axis - _turn_begin(act, score)) / _turn_beats(act, score))
    forward = torch.stack((torch.sin(heading), torch.cos(heading)), 1) * stride[:, None]
    place = torch.cat((forward.new_zeros(1, 2), torch.cumsum((forward[1:] + forward[:-1]) / (2 * FINE), 0)))
    start = interpolate(torch.tensor([score.first], dtype=axis.dtype), axis, place)
    return Route(axis, place - start, heading, going, running, backing)


def _turn_beats(act: Action, score: MotionPlan) -> float:
    shown = min(act.stop, score.last) - max(act.start, score.first)
    return min(0.6 * shown, 2.2 + 1.6 * abs(act.turn))


def _turn_begin(act: Action, score: MotionPlan) -> float:
    shown = min(act.stop, score.last) - max(act.start, score.first)
    free = shown - _turn_beats(act, score)
    return max(act.start, score.first) + free * (0.4 + 0.08 * max(-2, min(2, act.size)))
