"""What moves besides a creature's feet: posture, breath and gait as named curves, the same for all species.

`root.*` moves the trunk (metres), `trunk.*`, `spine.*`, `neck.*` and `tail.*` turn it and its chains, and a joint's own
name (`Jaw.pitch`) turns that joint. pitch is forwards and down (of a tail: up), yaw to the left, roll to the right.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..clock import interpolate
from ..layers import Curves, Moment
from .species import mirrored


def pair(curves: Curves, left: str, *, pitch: float | Tensor = 0.0, yaw: float | Tensor = 0.0,
         roll: float | Tensor = 0.0) -> None:  # fmt: skip
    """Turn a left joint and, as in a mirror, its right twin."""
    for name, sign in ((left, 1), (mirrored(left), -1)):
        for part, value in (("pitch", pitch), ("yaw", sign * yaw), ("roll", sign * roll)):
            if not isinstance(value, float | int) or value:
                curves.add(f"{name}.{part}", value)


def delayed(curve: Tensor, beats: Tensor, late: float) -> Tensor:
    """A curve [F] as it was some beats before; held at its beginning.

    >>> delayed(torch.tensor([0.0, 1.0, 2.0]), torch.tensor([0.0, 1.0, 2.0]), 0.5)
    tensor([0.0000, 0.5000, 1.5000])
    """
    return interpolate(beats - late, beats, curve) if late > 0 and len(beats) > 1 else curve


def low(at: Moment) -> float:
    """How low a creature carries itself: 0 neutral, about 1 for the tired, about -0.6 for the proud."""
    s = at.style
    return (s.slump - 0.05) + 0.6 * (s.lean - 0.03) + 0.7 * (s.head_pitch - 0.04)


def posture(at: Moment, curves: Curves) -> None:
    """How the body is held, standing or moving."""
    s, size, kind = at.style, at.performer.leg, at.performer.species
    curves.add("root.up", -0.65 * s.crouch * size - 0.06 * size * max(low(at), 0.0))
    curves.add("trunk.pitch", 0.2 * (s.lean - 0.03) + 0.1 * (s.pelvis_tilt - 0.08) + 0.05 * s.slump)
    curves.add("neck.pitch", kind.droop * (0.95 * (s.slump - 0.05) + 0.5 * (s.lean - 0.03)) - 0.5 * s.shoulder_lift)
    curves.add("head.pitch", (s.head_pitch - 0.04) - 0.45 * kind.droop * (s.slump - 0.05) + 0.3 * s.shoulder_lift)
    curves.add("head.roll", s.head_tilt)
    curves.add("tail.pitch", -0.9 * low(at) + 0.5 * max(s.sharpness - 0.4, 0.0))


def breath(at: Moment, curves: Curves) -> None:
    """What never stops: breathing, shifting the weight, looking about, a tail that plays, and what age or drink add."""
    s, size = at.style, at.performer.leg
    breathing = torch.sin(2 * math.pi * at.beats / 5.0 + at.score.draw("breath")) * (s.variability > 0)
    standing, alive = 1 - at.going, min(s.variability, 1.5)
    curves.add("root.up", 0.006 * size * breathing * standing)
    curves.add("neck.pitch", -0.025 * breathing + 0.09 * alive * standing * at.noise("nod", 0.9))
    curves.add("root.side", standing * 0.02 * size * alive * (0.5 + 0.5 * s.sway) * at.noise("shift", 1.6))
    curves.add("trunk.roll", standing * 0.015 * alive * at.noise("shift", 1.6))
    curves.add("root.ahead", standing * 0.014 * size * alive * at.noise("rock", 1.3))
    look = 0.6 * torch.tanh((0.6 + 2.4 * standing) * s.look / 0.6 * at.noise("look", 0.6))
    curves.add("neck.yaw", 1.6 * look)
    curves.add("head.yaw", 1.2 * delayed(look, at.beats, s.follow_through))
    curves.add("head.pitch", 0.5 * s.look * at.noise("glance", 0.9))
    curves.add("tail.yaw", 0.16 * alive * at.noise("tail", 0.6))
    curves.add("tail.pitch", 0.06 * alive * at.noise("tail up", 0.8))
    for part, amount in (("trunk.roll", 0.08), ("spine.yaw", 0.14), ("neck.yaw", 0.2), ("neck.roll", 0.1)):
        curves.add(part, s.wander * amount * at.noise(f"lost {part}", 0.8))
    curves.add("root.side", s.wander * 0.05 * size * at.noise("lost side", 0.8))
    for n, part in enumerate(("head.yaw", "head.pitch", "tail.yaw", "neck.roll")):
        tremble = torch.sin(2 * math.pi * (4.6 + 0.3 * n) * at.seconds + n)
        curves.add(part, s.tremor * (1.0, 0.8, 1.5, 0.7)[n] * tremble)


def gait(at: Moment, curves: Curves) -> None:
    """What goes with the steps: the trunk over the feet, the spine against the hips, neck and tail after them."""
    s, size, go, kind = at.style, at.performer.leg, at.going, at.performer.species
    vary, run = 1 + 0.1 * s.variability * at.noise("amplitude"), at.running
    duty = kind.duty[0] + (kind.duty[1] - kind.duty[0]) * run
    lag, stride = 0.5 * s.follow_through, (s.step_length * go).clamp(max=1.3)
    bob = (0.02 + 0.035 * run) * s.bob * size * stride
    rise = at.wave(duty - 0.5 * run, double=True)  # highest over a standing leg, or between two leaps
    curves.add("root.up", bob * rise - bob)
    middle = at.wave(duty)  # +1 in the middle of the first left leg's stance
    curves.add("root.side", go * middle * kind.sway * 0.02 * size * s.sway * vary)
    curves.add("trunk.roll", -go * kind.sway * (0.8 * s.hip_list * at.wave(duty + 0.05) - 0.5 * s.side_bend * middle))
    turn = kind.waddle * s.hip_turn * go
    curves.add("trunk.yaw", -turn * at.wave())
    curves.add("spine.yaw", turn * (1.5 * at.wave(lag) + 0.6 * at.wave()) * vary)
    curves.add("spine.roll", go * kind.sway * s.hip_list * at.wave(duty + 0.3))
    curves.add("neck.yaw", -go * 0.7 * kind.waddle * s.hip_turn * at.wave(2 * lag))
    nod = go * 0.06 * (0.4 + 0.6 * s.bob)
    curves.add("neck.pitch", nod * at.wave(0.2 + lag, double=True))
    curves.add("head.pitch", -0.8 * nod * at.wave(0.2 + 2 * lag, double=True))
    curves.add("tail.yaw", go * (0.12 + 0.5 * s.arm_swing * kind.waddle) * at.wave(0.3 + lag) * vary)
    curves.add("tail.pitch", go * 0.06 * s.bob * at.wave(0.5 + lag, double=True))
    weak = go * s.asymmetry * (0.5 + 0.5 * middle)
    curves.add("root.up", -0.06 * size * weak.abs())
    curves.add("head.pitch", 0.4 * weak)
    _turning(at, curves)


def _turning(at: Moment, curves: Curves) -> None:
    """Who turns bends into the turn, nose first, and the tail comes after."""
    before, now, soon = (at.route.at(at.beats + b, "heading") for b in (-0.8, 0.0, 1.0))
    ahead, behind = at.going * (soon - now).clamp(-1, 1), at.going * (now - before).clamp(-1, 1)
    curves.add("spine.yaw", 0.5 * ahead)
    curves.add("neck.yaw", 0.7 * ahead)
    curves.add("trunk.roll", 0.1 * ahead)
    curves.add("tail.yaw", -1.1 * behind)
