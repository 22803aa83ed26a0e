"""Jump, kick, punch, wave, raised hands, bow: what each adds to the body's curves, beat by beat."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .clock import JUMP_FLIGHT, jump_height
from .layers import Curves, Moment, hold, ramp
from .score import Act
from .steps import SIDES, punch_step, stand_width


def gestures(at: Moment, curves: Curves) -> None:
    """All gestures of the score."""
    for act in at.score.acts:
        add = _GESTURES.get(act.name)
        if add is not None:
            size = 1 + 0.05 * at.style.variability * max(-2.0, min(2.0, act.size))
            add(at, curves, act, at.beats - act.start, at.style.reach * size)


def _sides(act: Act) -> tuple[str, str]:
    return ("left", "right") if act.side > 0 else ("right", "left")


def _arrive(b: Tensor, start: float, stop: float, low: float, high: float, speed: float) -> Tensor:
    """From `low` (at rest) to `high`, where it has the given speed a beat (cubic Hermite)."""
    x, span = ((b - start) / (stop - start)).clamp(0, 1), stop - start
    return low + (high - low) * (3 * x * x - 2 * x**3) + speed * span * (x**3 - x * x)


def _jump(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
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


def _kick(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
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


def kick_lift(at: Moment, b: Tensor) -> Tensor:
    """How far a kick's foot has left the ground for where the kick takes it, 0 to 1, at beats since its start."""
    return hold(at, b, (1.0, 1.75), (3.1, 3.95))


def kick_reach(at: Moment, b: Tensor) -> Tensor:
    """How far the kicking leg is stretched, 0 to 1."""
    return hold(at, b, (1.85, 2.35), (2.45, 3.0))


def kick_target(at: Moment, act: Act, hip: Tensor, forward: Tensor) -> tuple[Tensor, Tensor, Tensor]:
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


def _punch(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
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


def _wave(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
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


def _raise_hands(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
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


def _bow(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
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
