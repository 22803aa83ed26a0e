"""Where the body goes: its place on the ground and its heading at every beat."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .body import Performer
from .clock import FINE, interpolate
from .paths import follow
from .score import WALKS, Act, Score, smooth
from .style import Style

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


def _turn_beats(act: Act, score: Score) -> float:
    shown = min(act.stop, score.last) - max(act.start, score.first)
    return min(0.6 * shown, 2.2 + 1.6 * abs(act.turn))


def _turn_begin(act: Act, score: Score) -> float:
    shown = min(act.stop, score.last) - max(act.start, score.first)
    free = shown - _turn_beats(act, score)
    return max(act.start, score.first) + free * (0.4 + 0.08 * max(-2, min(2, act.size)))
