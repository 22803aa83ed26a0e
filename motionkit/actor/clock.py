"""When things happen: how many seconds each beat takes, and the beat of every frame."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .body import Performer
from .score import Score, smooth
from .style import Style

FINE = 128  # points of the fine axis for a beat
WALK_RATE, RUN_RATE = 1.8, 2.5  # steps a second of a person with legs of 0.86 m
GRAVITY = 9.81


def fine_axis(first: float, last: float) -> Tensor:
    """Beats from first to last in steps of 1 / FINE, float64."""
    return torch.arange(math.floor(first * FINE), math.ceil(last * FINE) + 1, dtype=torch.float64) / FINE


def beat_seconds(score: Score, style: Style, performer: Performer, beats: Tensor) -> Tensor:
    """Seconds that a beat takes, at each beat [F]: pace, limp, pauses and chance; a jump's flight obeys gravity."""
    pace = style.tempo * (0.86 / performer.leg) ** 0.5 * (1 + 0.02 * style.variability * score.draw("pace"))
    run = score.weight(beats, ("run",))
    hurried = max(style.tempo, 1.0) ** -0.6  # running steps are quick already
    duration = 1 / (pace * (WALK_RATE + (RUN_RATE * hurried - WALK_RATE) * run))
    limp = 1 - style.asymmetry * torch.cos(math.pi * (beats - 0.5))
    dwell = 1 + style.pauses * torch.cos(2 * math.pi * (beats - 0.08))
    varied = 1 + 0.025 * style.variability * score.noise("rhythm", beats).clamp(-2.5, 2.5)
    duration = duration * limp * dwell * varied
    for act in score.acts:
        if act.name == "jump":
            flight = 2 * math.sqrt(2 * jump_height(style, performer, act.size) / GRAVITY)
            rise = act.start + JUMP_FLIGHT[0]
            near = smooth((beats - rise + 0.5) / 0.45) * smooth((rise + 1.5 - beats) / 0.45)
            duration = torch.lerp(duration, torch.full_like(duration, flight), near)
    return duration


JUMP_FLIGHT = (2.0, 3.0)  # beats of a jump between which no foot touches the ground


def jump_height(style: Style, performer: Performer, size: float) -> float:
    """How far the pelvis rises in flight, metres."""
    return performer.leg * 0.3 * style.reach**1.5 * (1 + 0.06 * style.variability * max(-2, min(2, size)))


def seconds_of(axis: Tensor, durations: Tensor) -> Tensor:
    """The time [F] of each point of a fine axis of beats, 0 at its start (trapezoid rule)."""
    steps = (axis[1:] - axis[:-1]) * (durations[1:] + durations[:-1]) / 2
    return torch.cat((steps.new_zeros(1), torch.cumsum(steps, 0)))


def interpolate(x: Tensor, xs: Tensor, ys: Tensor) -> Tensor:
    """Values at x [F] of the line through points xs [N], ys [N] or [N, D]; xs rises. Held at its ends.

    >>> interpolate(torch.tensor([0.5, 9.0]), torch.tensor([0.0, 1.0]), torch.tensor([0.0, 10.0]))
    tensor([ 5., 10.])
    """
    high = torch.searchsorted(xs, x.contiguous()).clamp(1, len(xs) - 1)
    share = ((x - xs[high - 1]) / (xs[high] - xs[high - 1])).clamp(0, 1)
    share = share.reshape(share.shape + (1,) * (ys.ndim - 1))
    return torch.lerp(ys[high - 1], ys[high], share)
