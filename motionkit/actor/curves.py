"""What moves besides the feet, as named curves: posture, gait and breath, one layer upon the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .bodies import Performer, mirrored
from .footsteps import RUN_DUTY, SIDES, WALK_DUTY, punch_step, stand_width
from .path import Route
from .score import JUMP_FLIGHT, Action, MotionPlan, interpolate, jump_height, smooth
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
class PoseContext:
    """All that layers look at. beats, seconds: [F]. going, running, backing: [F], see `Route`."""

    score: MotionPlan
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
        cls, score: MotionPlan, style: Style, performer: Performer, route: Route, beats: Tensor, seconds: Tensor
    ) -> PoseContext:
        """Reads the route at the frames' beats."""
        shares = (route.at(beats, what) for what in ("going", "running", "backing"))
        return cls(score, style, performer, route, beats, seconds, *shares)

    @property
    def duty(self) -> Tensor:
        """Share of a cycle in which a foot stands, [F]."""
        return WALK_DUTY + (RUN_DUTY - WALK_DUTY) * self.running

    def wave(self, late: float | Tensor = 0.0, *, double: bool = False) -> Tensor:
        """+1 where the left foot lands, -1 where the right does; double: +1 at every landing. late: beats behind."""
        return torch.cos((2 if double else 1) * math.pi * (self.beats - late))

    def noise(self, name: str, slow: float = 1.0) -> Tensor:
        """`MotionPlan.noise` at the frames."""
        return self.score.noise(name, self.beats, slow)


def posture(at: PoseContext, curves: Curves) -> None:
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


def breath(at: PoseContext, curves: Curves) -> None:
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


def _tremble(at: PoseContext, curves: Curves) -> None:
    if not at.style.tremor:
        return
    for n, part in enumerate(("left.hand", "left.elbow", "right.hand", "right.elbow", "head.yaw")):
        size = at.style.tremor * (1.0, 0.7, 1.0, 0.7, 0.4)[n]
        curves.add(part, size * torch.sin(2 * math.pi * (4.6 + 0.2 * n) * at.seconds + n))


def gait(at: PoseContext, curves: Curves) -> None:
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


def _limp(at: PoseContext, curves: Curves) -> None:
    weak = at.going * at.style.asymmetry * (0.5 + 0.5 * at.wave(at.duty))
    curves.add("root.up", -0.05 * at.performer.leg * weak.abs())
    curves.add("spine.roll", 0.3 * weak)


def _turning(at: PoseContext, curves: Curves) -> None:
    """Who turns leans in and looks ahead."""
    now, soon = at.route.at(at.beats, "heading"), at.route.at(at.beats + 1.2, "heading")
    turn = at.going * (soon - now).clamp(-1, 1)
    curves.add("head.yaw", 0.5 * turn)
    curves.add("spine.yaw", 0.2 * turn)
    curves.add("pelvis.roll", 0.07 * turn * (1 + at.running))


def _arm_swing(at: PoseContext, curves: Curves, go: Tensor, vary: Tensor) -> None:
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


def ramp(at: PoseContext, beats: Tensor, start: float, stop: float) -> Tensor:
    """0 to 1 between two beats; the sharper the style, the shorter the way in the middle of that time."""
    margin = 0.2 * (stop - start) * max(at.style.sharpness - 0.3, 0.0)
    return smooth((beats - start - margin) / (stop - start - 2 * margin))


def hold(at: PoseContext, beats: Tensor, rise: tuple[float, float], fall: tuple[float, float]) -> Tensor:
    """0, up to 1, held, and down to 0 again."""
    return ramp(at, beats, *rise) * (1 - ramp(at, beats, *fall))


def gestures(at: PoseContext, curves: Curves) -> None:
    """All gestures of the score."""
    for act in at.score.acts:
        add = _GESTURES.get(act.name)
        if add is not None:
            size = 1 + 0.05 * at.style.variability * max(-2.0, min(2.0, act.size))
            add(at, curves, act, at.beats - act.start, at.style.reach * size)


def _sides(act: Action) -> tuple[str, str]:
    return ("left", "right") if act.side > 0 else ("right", "left")


def _arrive(b: Tensor, start: float, stop: float, low: float, high: float, speed: float) -> Tensor:
    """From `low` (at rest) to `high`, where it has the given speed a beat (cubic Hermite)."""
    x, span = ((b - start) / (stop - start)).clamp(0, 1), stop - start
    return low + (high - low) * (3 * x * x - 2 * x**3) + speed * span * (x**3 - x * x)


def _jump(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
    leg, height = at.performer.leg, jump_height(at.style, at.performer, act.size)
    up, down = JUMP_FLIGHT
    deep, toes = min(0.24, 0.14 + 0.1 * reach) * leg, 0.05 * leg
    flight = ((b - up) / (down - up)).clamp(0, 1)
    sink = -deep * ramp(at, b, 0.3, 1.4)
    rise = torch.where(b < 1.4, sink, _arrive(b, 1.4, up, -deep, toes, 4 * height))
    absorb = _arrive(2 * down - b, down - 0.55, down, -0.75 * deep, toes, 4 * height)
    landed = torch.where(b < down + 0.55, absorb, -0.75 * deep * (1 - _settled(b, down + 0.55, 4.7)))
    path = torch.where(b < up, rise, torch.where(b > down, landed, toes + 4 * height * flight * (1 - flight)))
    curves.add("root.up", torch.where((b > 0) & (b < 4.8), path, torch.zeros_like(b)))
    bend = hold(at, b, (0.3, 1.4), (1.5, 2.05)) + 0.7 * hold(at, b, (2.9, 3.45), (3.6, 4.7))
    curves.add("pelvis.pitch", 0.3 * bend)
    curves.add("spine.pitch", 0.35 * bend)
    curves.add("head.pitch", -0.45 * bend)
    curves.add("root.ahead", -0.06 * leg * bend)
    back = hold(at, b, (0.3, 1.35), (1.4, 2.2))
    forward = hold(at, b, (1.4, 2.5), (2.6, 3.7))
    for side in SIDES:
        curves.add(f"{side}.flex", -0.65 * back + (2.1 * reach) * forward)
        curves.blend(f"{side}.elbow", 0.35, forward)
        curves.add(f"{side}.out", 0.15 * forward)


def _settled(b: Tensor, start: float, stop: float) -> Tensor:
    """0 to 1 between two beats whatever the style."""
    x = ((b - start) / (stop - start)).clamp(0, 1)
    return x * x * (3 - 2 * x)


def _kick(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
    mine, other = _sides(act)
    up = hold(at, b, (0.2, 1.1), (3.7, 4.7))
    lifted = kick_lift(at, b)
    out = kick_reach(at, b)
    curves.add("root.side", -act.side * 0.46 * stand_width(at.style, at.performer) * up)
    curves.add("root.up", -0.02 * at.performer.leg * up)
    curves.add("pelvis.pitch", -0.16 * lifted - 0.1 * out)
    curves.add("spine.pitch", -0.05 * lifted - 0.16 * out * reach)
    curves.add("head.pitch", 0.2 * lifted + 0.15 * out)
    curves.add("pelvis.yaw", -act.side * 0.22 * out)
    curves.add("spine.yaw", act.side * (0.12 * lifted + 0.35 * out))
    for side, flex, wide in ((other, 0.75, 0.25), (mine, -0.25, 0.55)):
        curves.blend(f"{side}.flex", flex, lifted)
        curves.add(f"{side}.out", wide * lifted)
        curves.blend(f"{side}.elbow", 1.15, lifted)


def kick_lift(at: PoseContext, b: Tensor) -> Tensor:
    """How far a kick's foot has left the ground for where the kick takes it, 0 to 1, at beats since its start."""
    return hold(at, b, (1.0, 1.75), (3.1, 3.95))


def kick_reach(at: PoseContext, b: Tensor) -> Tensor:
    """How far the kicking leg is stretched, 0 to 1."""
    return hold(at, b, (1.85, 2.35), (2.45, 3.0))


def kick_target(at: PoseContext, act: Action, hip: Tensor, forward: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Ankle of the kicking foot: place [F, 3], pitch of the foot [F], and the share [F] in which both hold.

    hip: [F, 3] metres. forward: unit vectors [F, 3] on the ground.
    """
    b, leg = at.beats - act.start, at.performer.leg
    size = 1 + 0.05 * at.style.variability * max(-2.0, min(2.0, act.size))
    high = min(1.5 * at.style.reach * size, 1.8)
    out = kick_reach(at, b)[:, None]
    up = hip.new_tensor([0.0, 1.0, 0.0])
    chamber = (0.42 * forward - (0.66 - 0.12 * at.style.reach) * up) * leg
    stretched = (math.sin(high) * forward - math.cos(high) * up) * 0.97 * leg
    pitch = 0.25 + (-high + 0.45 - 0.25) * out[:, 0]
    return hip + chamber + (stretched - chamber) * out, pitch, kick_lift(at, b)


def _punch(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
    rear, front = _sides(act)  # the rear hand is the strong one
    leg = at.performer.leg
    guard = hold(at, b, (0.1, 0.95), (4.0, 4.9))
    curves.add("root.ahead", 0.5 * punch_step(at.performer) * hold(at, b, (0.1, 0.85), (4.15, 4.95)))
    curves.add("root.up", -0.06 * leg * guard)
    curves.add("spine.pitch", 0.08 * guard)
    curves.add("spine.yaw", -act.side * 0.25 * guard)
    curves.add("head.yaw", act.side * 0.2 * guard)
    for side in SIDES:
        for part, value in (("flex", 0.75), ("out", 0.22), ("turn", 0.45), ("elbow", 2.15), ("hand", 0.0)):
            curves.blend(f"{side}.{part}", value, guard)
    hits = ((front, hold(at, b, (1.2, 1.65), (1.7, 2.15))), (rear, hold(at, b, (2.2, 2.7), (2.78, 3.3))))
    for side, hit in hits:
        strong = 1.0 if side == rear else 0.5
        for part, value in (("flex", 1.5 * min(reach, 1.1)), ("out", 0.02), ("turn", 0.5), ("elbow", 0.1)):
            curves.blend(f"{side}.{part}", value, hit)
        curves.add(f"{side}.round", 0.3 * hit)
        curves.add("spine.yaw", -SIDES[side] * 0.5 * strong * reach * hit)
        curves.add("pelvis.yaw", -SIDES[side] * 0.3 * strong * hit)
        curves.add("head.yaw", SIDES[side] * 0.6 * strong * hit)
        curves.add("root.ahead", 0.05 * leg * strong * hit)


def _wave(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
    side, _ = _sides(act)
    late = at.style.follow_through
    up = hold(at, b, (0.3, 1.5), (5.5, 6.8))
    elbow = hold(at, b, (0.3 + late, 1.6 + late), (5.3, 6.7))
    inner = hold(at, b, (1.1, 1.9), (5.0, 5.7))
    for part, value in (("flex", 0.3), ("out", 0.95 + 0.75 * reach), ("turn", -1.35)):
        curves.blend(f"{side}.{part}", value, up)
    curves.blend(f"{side}.elbow", 1.3, elbow)
    curves.blend(f"{side}.hand", 0.0, elbow)
    to_and_fro = torch.sin(2 * math.pi * 1.0 * (b - 1.4))
    curves.add(f"{side}.elbow", 0.42 * reach * inner * to_and_fro)
    curves.add(f"{side}.out", 0.07 * inner * to_and_fro)
    curves.add(f"{side}.wag", -0.4 * inner * torch.sin(2 * math.pi * 1.0 * (b - 1.4 - late)))
    curves.add(f"{side}.shrug", 0.12 * up)
    curves.add("spine.roll", act.side * 0.05 * up)
    curves.add("head.roll", act.side * 0.05 * up)


def _raise_hands(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
    late = at.style.follow_through
    up = hold(at, b, (0.4, 1.9), (3.4, 5.2))
    elbow = hold(at, b, (0.4 + late, 1.9 + late), (3.3, 5.0 + late))
    for side in SIDES:
        curves.blend(f"{side}.flex", min(2.75 * reach, 2.95), up)
        curves.blend(f"{side}.out", 0.22, up)
        curves.blend(f"{side}.turn", 0.0, up)
        curves.blend(f"{side}.elbow", max(0.15, 0.9 * (1 - reach)), elbow)
        curves.blend(f"{side}.hand", -0.1, elbow)
        curves.add(f"{side}.shrug", 0.3 * min(reach, 1.1) * up)
    curves.add("spine.pitch", -0.12 * reach * up)
    curves.add("head.pitch", -0.25 * reach * up)
    curves.add("root.ahead", -0.02 * at.performer.leg * up)


def _bow(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
    down = hold(at, b, (0.4, 2.0), (3.2, 5.2))
    late = hold(at, b, (0.4 + at.style.follow_through, 2.2), (3.2, 5.2))
    curves.add("pelvis.pitch", 0.62 * reach * down)
    curves.add("spine.pitch", 0.3 * reach * down)
    curves.add("spine.slump", 0.2 * reach * late)
    curves.add("head.pitch", 0.12 * reach * late)
    curves.add("root.ahead", -0.15 * at.performer.leg * reach * down)
    curves.add("root.up", -0.015 * at.performer.leg * down)
    for side in SIDES:
        curves.add(f"{side}.flex", 0.3 * reach * down)


_GESTURES = {"jump": _jump, "kick": _kick, "punch": _punch, "wave": _wave, "raise_hands": _raise_hands, "bow": _bow}


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


def low(at: PoseContext) -> float:
    """How low a creature carries itself: 0 neutral, about 1 for the tired, about -0.6 for the proud."""
    s = at.style
    return (s.slump - 0.05) + 0.6 * (s.lean - 0.03) + 0.7 * (s.head_pitch - 0.04)


def creature_posture(at: PoseContext, curves: Curves) -> None:
    """How the body is held, standing or moving."""
    s, size, kind = at.style, at.performer.leg, at.performer.species
    curves.add("root.up", -0.65 * s.crouch * size - 0.06 * size * max(low(at), 0.0))
    curves.add("trunk.pitch", 0.2 * (s.lean - 0.03) + 0.1 * (s.pelvis_tilt - 0.08) + 0.05 * s.slump)
    curves.add("neck.pitch", kind.droop * (0.95 * (s.slump - 0.05) + 0.5 * (s.lean - 0.03)) - 0.5 * s.shoulder_lift)
    curves.add("head.pitch", (s.head_pitch - 0.04) - 0.45 * kind.droop * (s.slump - 0.05) + 0.3 * s.shoulder_lift)
    curves.add("head.roll", s.head_tilt)
    curves.add("tail.pitch", -0.9 * low(at) + 0.5 * max(s.sharpness - 0.4, 0.0))


def creature_breath(at: PoseContext, curves: Curves) -> None:
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


def creature_gait(at: PoseContext, curves: Curves) -> None:
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
    _creature_turning(at, curves)


def _creature_turning(at: PoseContext, curves: Curves) -> None:
    """Who turns bends into the turn, nose first, and the tail comes after."""
    before, now, soon = (at.route.at(at.beats + b, "heading") for b in (-0.8, 0.0, 1.0))
    ahead, behind = at.going * (soon - now).clamp(-1, 1), at.going * (now - before).clamp(-1, 1)
    curves.add("spine.yaw", 0.5 * ahead)
    curves.add("neck.yaw", 0.7 * ahead)
    curves.add("trunk.roll", 0.1 * ahead)
    curves.add("tail.yaw", -1.1 * behind)
