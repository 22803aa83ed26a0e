"""Where the body goes: its place on the ground and its heading at every beat."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..files import MotionKitWarning
from .body import Performer
from .clock import FINE, interpolate
from .score import WALKS, Act, Score, smooth
from .style import Style

WALK_STEP, RUN_STEP, BACK_STEP = 0.8, 1.3, -0.5  # length of a step, in leg lengths
SHARPEST = 0.7  # radians that a walker turns in one step at most


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


def plan_route(score: Score, style: Style, performer: Performer, axis: Tensor) -> Route:
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
        place, heading, share = _follow(score.path, stride, float(axis[0]), score.first)
        return Route(axis, place, heading + drift, going * share, running, backing)
    heading = drift.clone()
    for act in score.acts:
        if act.turn:
            heading = heading + act.turn * smooth((axis - _turn_begin(act, score)) / _turn_beats(act, score))
    forward = torch.stack((torch.sin(heading), torch.cos(heading)), 1) * stride[:, None]
    place = torch.cat((forward.new_zeros(1, 2), torch.cumsum((forward[1:] + forward[:-1]) / (2 * FINE), 0)))
    start = interpolate(torch.tensor([score.first], dtype=axis.dtype), axis, place)
    return Route(axis, place - start, heading, going, running, backing)


def _turn_beats(act: Act, score: Score) -> float:
    shown = min(act.stop, score.last) - max(act.start, score.first)
    return min(0.6 * shown, 2.2 + 1.6 * abs(act.turn))


def _turn_begin(act: Act, score: Score) -> float:
    shown = min(act.stop, score.last) - max(act.start, score.first)
    free = shown - _turn_beats(act, score)
    return max(act.start, score.first) + free * (0.4 + 0.08 * max(-2, min(2, act.size)))


def checked_path(path: object) -> Tensor | None:
    """A path as [N, 2] float64; MotionKitError if it is not at least two different places of finite numbers."""
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


def _follow(path: Tensor, stride: Tensor, first_beat: float, shown_from: float) -> tuple[Tensor, Tensor, Tensor]:
    """Place, heading and share of the stride along a smooth curve through the path; slower where it bends sharply."""
    from scipy.interpolate import CubicSpline

    chord = torch.linalg.vector_norm(path[1:] - path[:-1], dim=1)
    knots = torch.cat((chord.new_zeros(1), torch.cumsum(chord, 0)))
    curve = CubicSpline(knots.numpy(), path.numpy(), bc_type="natural")
    grid = torch.linspace(0, float(knots[-1]), max(400, int(float(knots[-1]) * 50)), dtype=torch.float64)
    dense = torch.from_numpy(curve(grid.numpy()))
    tangent = torch.from_numpy(curve(grid.numpy(), 1))
    length = torch.cat((grid.new_zeros(1), torch.cumsum(torch.linalg.vector_norm(dense[1:] - dense[:-1], dim=1), 0)))
    yaw = torch.atan2(tangent[:, 0], tangent[:, 1])
    step = torch.remainder(yaw[1:] - yaw[:-1] + math.pi, 2 * math.pi) - math.pi
    yaw = torch.cat((yaw[:1], yaw[0] + torch.cumsum(step, 0)))
    bend = torch.nn.functional.pad(step.abs() / (length[1:] - length[:-1]).clamp(min=1e-9), (1, 0))
    travelled, shares = _travel(stride, length, bend, first_beat, shown_from)
    if shares.numel() and float(shares[travelled < 0.95 * float(length[-1])].amin().item() if (travelled < 0.95 * float(length[-1])).any() else 1.0) < 0.9:  # noqa: E501
        warnings.warn(
            "path: it bends more sharply than the stride allows; the walker takes shorter steps there",
            MotionKitWarning,
            stacklevel=5,
        )
    return interpolate(travelled, length, dense), interpolate(travelled, length, yaw), shares


def _travel(
    stride: Tensor, length: Tensor, bend: Tensor, first_beat: float, shown_from: float
) -> tuple[Tensor, Tensor]:
    """Metres travelled and share of the stride taken at each fine beat; the walk stops at the path's end."""
    end, spacing = float(length[-1]), float(length[1])
    window = 25  # points of the path looked ahead and behind
    worst = torch.nn.functional.max_pool1d(bend[None, None], 2 * window + 1, 1, window)[0, 0].tolist()
    now, places, shares = 0.0, [], []
    for n, step in enumerate(stride.tolist()):
        before = first_beat + n / FINE < shown_from
        sharp = worst[min(int(now / max(spacing, 1e-9)), len(worst) - 1)]
        share = min(1.0, SHARPEST / max(sharp * abs(step), 1e-9))
        share *= float(min(1.0, max(0.0, (end - now) / max(1.2 * abs(step), 1e-6))))
        places.append(now)
        shares.append(share)
        now += 0.0 if before else abs(step) * share / FINE
    return torch.tensor(places, dtype=torch.float64), torch.tensor(shares, dtype=torch.float64)
