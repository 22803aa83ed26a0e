"""What moves besides the feet, as named curves: posture, gait and breath, one layer upon the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .body import Performer
from .route import Route
from .score import Score, smooth
from .steps import RUN_DUTY, SIDES, WALK_DUTY
from .style import Style

# Fitted to captured walks: the pelvis' surge (leg lengths) and its asymmetry, the trunk's answer (radians), the bob and
# how far it sinks (leg lengths), how late the elbow is, and the arms' swing at every single step.
_SURGE, _KICK, _NOD, _BOB, _LOW, _RUN_BOB = 0.0324, 0.2512, 0.0204, 0.0155, 0.0083, 0.064
_ELBOW, _DOUBLE = 2.7309, 0.0614
TRAVEL = 0.8  # how much of the trunk's pitch the hanging arms and the gaze do not follow


class Curves(dict):
    """Curves [F] by name, 0 where nothing was said. Angles in radians, `root.*` in metres.

    `root.side`, `root.up`, `root.ahead` move the pelvis from where it stands straight; `pelvis.*`, `spine.*`, `head.*`
    have `pitch` (forwards), `yaw` (to the left) and `roll` (to the right); an arm has `flex` (forwards), `out`, `turn`
    (inwards), `elbow`, `hand`, `wag` (the hand from side to side) and `shrug`.
    """

    def __init__(self, frames: int) -> None:
        super().__init__()
        self.nothing = torch.zeros(frames, dtype=torch.float64)

    def __missing__(self, name: str) -> Tensor:
        return self.nothing

    def add(self, name: str, value: Tensor | float) -> None:
        """Put a curve on top."""
        self[name] = self[name] + value

    def blend(self, name: str, value: Tensor | float, share: Tensor) -> None:
        """Go over to another curve, share [F] of the way."""
        self[name] = self[name] + (value - self[name]) * share


@dataclass(frozen=True)
class Moment:
    """All that layers look at. beats, seconds: [F]. going, running, backing: [F], see `Route`."""

    score: Score
    style: Style
    performer: Performer
    route: Route
    beats: Tensor
    seconds: Tensor
    going: Tensor
    running: Tensor
    backing: Tensor

    @classmethod
    def of(
        cls, score: Score, style: Style, performer: Performer, route: Route, beats: Tensor, seconds: Tensor
    ) -> Moment:
        """Reads the route at the frames' beats."""
        shares = (route.at(beats, what) for what in ("going", "running", "backing"))
        return cls(score, style, performer, route, beats, seconds, *shares)

    @property
    def duty(self) -> Tensor:
        """Share of a cycle in which a foot stands, [F]."""
        return WALK_DUTY + (RUN_DUTY - WALK_DUTY) * self.running

    def wave(self, late: float | Tensor = 0.0, double: bool = False) -> Tensor:
        """+1 where the left foot lands, -1 where the right does; double: +1 at every landing. late: beats behind."""
        return torch.cos((2 if double else 1) * math.pi * (self.beats - late))

    def noise(self, name: str, slow: float = 1.0) -> Tensor:
        """`Score.noise` at the frames."""
        return self.score.noise(name, self.beats, slow)


def posture(at: Moment, curves: Curves) -> None:
    """How the body is held, standing or moving."""
    s = at.style
    curves.add("root.up", -s.crouch * at.performer.leg)
    curves.add("pelvis.pitch", s.pelvis_tilt + 0.35 * s.lean)
    curves.add("spine.pitch", 0.65 * s.lean - s.pelvis_tilt)
    curves.add("spine.slump", s.slump)
    curves.add("head.pitch", s.head_pitch - TRAVEL * (s.lean + s.slump))
    curves.add("head.roll", s.head_tilt)
    for side in SIDES:
        curves.add(f"{side}.flex", s.arm_forward + TRAVEL * (s.lean + 0.8 * s.slump))
        curves.add(f"{side}.out", s.arm_out)
        curves.add(f"{side}.turn", s.arm_turn)
        curves.add(f"{side}.elbow", s.elbow_bend)
        curves.add(f"{side}.hand", s.hand_bend)
        curves.add(f"{side}.shrug", s.shoulder_lift)
        curves.add(f"{side}.round", 0.45 * s.slump)


def breath(at: Moment, curves: Curves) -> None:
    """What never stops: breathing, shifting the weight, looking about, and what age or drink add."""
    s, leg = at.style, at.performer.leg
    breathing = torch.sin(2 * math.pi * at.beats / 6.5 + at.score.draw("breath")) * (s.variability > 0)
    standing, alive = 1 - at.going, min(s.variability, 1.5)
    curves.add("spine.slump", -0.018 * breathing)
    curves.add("root.side", standing * 0.018 * leg * (0.5 + 0.5 * s.sway) * alive * at.noise("shift", 1.6))
    curves.add("root.ahead", standing * 0.007 * leg * alive * at.noise("rock", 1.2))
    curves.add("pelvis.roll", standing * 0.022 * alive * at.noise("shift", 1.6))
    curves.add("spine.yaw", standing * 0.03 * alive * at.noise("twist", 1.6))
    curves.add("head.yaw", s.look * at.noise("look", 1.2))
    curves.add("head.pitch", 0.3 * s.look * at.noise("glance", 1.2))
    for side in SIDES:
        curves.add(f"{side}.shrug", 0.012 * breathing)
        curves.add(f"{side}.flex", 0.02 * alive * at.noise(f"{side} flex"))
        curves.add(f"{side}.elbow", 0.03 * alive * at.noise(f"{side} elbow"))
    for part, size in (("spine.roll", 0.14), ("spine.pitch", 0.1), ("pelvis.roll", 0.05), ("head.roll", 0.12)):
        curves.add(part, s.wander * size * at.noise(f"lost {part}", 0.8))
    curves.add("root.side", s.wander * 0.045 * leg * at.noise("lost side", 0.8))
    _tremble(at, curves)


def _tremble(at: Moment, curves: Curves) -> None:
    if not at.style.tremor:
        return
    for n, part in enumerate(("left.hand", "left.elbow", "right.hand", "right.elbow", "head.yaw")):
        size = at.style.tremor * (1.0, 0.7, 1.0, 0.7, 0.4)[n]
        curves.add(part, size * torch.sin(2 * math.pi * (4.6 + 0.2 * n) * at.seconds + n))


def gait(at: Moment, curves: Curves) -> None:
    """What goes with the steps: the pelvis over the feet, shoulders against hips, arms against legs."""
    s, leg, go = at.style, at.performer.leg, at.going
    run = at.running
    ahead = 1 - 2 * at.backing
    vary = 1 + 0.1 * s.variability * at.noise("amplitude")
    middle = at.wave(at.duty)  # +1 in the middle of the left foot's stance
    stride = (s.step_length * go).clamp(max=1.3)
    bob = (_BOB * s.bob**0.8 + _RUN_BOB * run * s.bob**0.2) * leg * stride
    curves.add("root.up", bob * at.wave(at.duty, double=True) * (1 - 2 * run) - bob - _LOW * leg * stride)
    turn = 2 * math.pi * (at.beats - at.duty)
    surge = (torch.sin(turn + _KICK * torch.sin(turn)) + 0.03 * torch.sin(4 * turn)) * stride
    curves.add("root.ahead", -ahead * (_SURGE - 0.016 * run) * leg * surge)
    width = s.step_width * leg * (1 - 0.6 * run)
    curves.add("root.side", go * middle * (0.13 * width + 0.013 * leg * s.sway) * vary)
    curves.add("pelvis.yaw", -go * ahead * s.hip_turn * at.wave())
    curves.add("pelvis.roll", -go * s.hip_list * at.wave(at.duty + 0.05))
    curves.add("pelvis.pitch", (_NOD - 0.028 * run) * surge)  # the head surges less than the hips
    lag = 0.5 * s.follow_through
    curves.add("spine.yaw", go * ahead * (s.hip_turn * at.wave() + s.shoulder_turn * at.wave(lag) * vary))
    curves.add("spine.roll", go * (1.05 * s.hip_list * at.wave(at.duty + 0.05) + s.side_bend * at.wave(at.duty + lag)))
    curves.add("spine.pitch", 0.11 * run)
    curves.add("head.yaw", -go * ahead * 0.85 * s.shoulder_turn * at.wave(lag))
    curves.add("head.roll", -go * 0.6 * s.side_bend * at.wave(at.duty + lag))
    curves.add("head.pitch", -0.08 * run + go * 0.012 * s.bob * at.wave(0.25 + s.follow_through, double=True))
    _limp(at, curves)
    _turning(at, curves)
    _arm_swing(at, curves, go * ahead, vary)


def _limp(at: Moment, curves: Curves) -> None:
    weak = at.going * at.style.asymmetry * (0.5 + 0.5 * at.wave(at.duty))
    curves.add("root.up", -0.05 * at.performer.leg * weak.abs())
    curves.add("spine.roll", 0.3 * weak)


def _turning(at: Moment, curves: Curves) -> None:
    """Who turns leans in and looks ahead."""
    now, soon = at.route.at(at.beats, "heading"), at.route.at(at.beats + 1.2, "heading")
    turn = at.going * (soon - now).clamp(-1, 1)
    curves.add("head.yaw", 0.5 * turn)
    curves.add("spine.yaw", 0.2 * turn)
    curves.add("pelvis.roll", 0.07 * turn * (1 + at.running))


def _arm_swing(at: Moment, curves: Curves, go: Tensor, vary: Tensor) -> None:
    s, run, lag = at.style, at.running, at.style.follow_through
    for side, sign in SIDES.items():
        size = (s.arm_swing * (1 + 0.25 * run) + 0.12 * run) * vary * (1 + 0.06 * s.variability * at.noise(side))
        swing = -sign * at.wave(0.5 * lag)
        late = -sign * at.wave(_ELBOW * lag)
        curves.add(f"{side}.flex", go * size * (swing + 0.12 + _DOUBLE * at.wave(double=True)))
        curves.add(f"{side}.out", go.abs() * 0.03 * size * at.wave(lag, double=True))
        bend = (1.35 - s.elbow_bend) * run * (s.elbow_bend < 1.35)
        curves.add(f"{side}.elbow", bend + go.abs() * s.elbow_swing * (0.6 + 0.6 * late) * (1 + 0.3 * run))
        curves.add(f"{side}.hand", go.abs() * 0.25 * s.arm_swing * -sign * at.wave(2 * lag))
        curves.add(f"{side}.shrug", go.abs() * 0.02 * s.bob * at.wave(lag + 0.1, double=True))


def ramp(at: Moment, beats: Tensor, start: float, stop: float) -> Tensor:
    """0 to 1 between two beats; the sharper the style, the shorter the way in the middle of that time."""
    margin = 0.2 * (stop - start) * max(at.style.sharpness - 0.3, 0.0)
    return smooth((beats - start - margin) / (stop - start - 2 * margin))


def hold(at: Moment, beats: Tensor, rise: tuple[float, float], fall: tuple[float, float]) -> Tensor:
    """0, up to 1, held, and down to 0 again."""
    return ramp(at, beats, *rise) * (1 - ramp(at, beats, *fall))
