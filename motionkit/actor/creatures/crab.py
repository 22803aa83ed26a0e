"""A great spider crab: eight legs, two claws, eyes on stalks. It goes sideways, and threatens with raised claws."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..layers import Curves, Moment, hold
from ..score import Act
from .life import delayed, low, pair
from .species import Deed, Leg, Species, both_sides

_PARTS = ("hip", "knee", "ankle", "tip")
_ROWS = ((0.13, 0.33, 0.42), (0.05, 0.12, 0.16), (-0.04, -0.11, -0.13), (-0.12, -0.31, -0.4))  # z of hip, knee, tip


def _leg_bones() -> list:
    bones = []
    for n, (hip, knee, tip) in enumerate(_ROWS, 1):
        x = 1.0 if n in (2, 3) else 0.9
        ankle = knee + 0.75 * (tip - knee)
        spots = ((0.15, 0.25, hip), (0.36 * x, 0.44, knee), (0.53 * x, 0.22, ankle), (0.58 * x, 0.008, tip))
        for part, above, spot in zip(_PARTS, ("body", *(f"left_leg{n}_{p}" for p in _PARTS)), spots):
            end = ((0.585 * x, 0.0, 1.01 * tip),) if part == "tip" else ()
            bones.append((f"left_leg{n}_{part}", above, spot, *end))
    return bones


_BONES = both_sides((
    ("body", "", (0.0, 0.26, 0.0)),
    ("shell", "body", (0.0, 0.29, -0.12), (0.0, 0.27, -0.2)),
    ("face", "body", (0.0, 0.28, 0.15), (0.0, 0.27, 0.19)),
    ("left_eye", "face", (0.05, 0.31, 0.17), (0.06, 0.38, 0.19)),
    ("left_claw_shoulder", "body", (0.12, 0.25, 0.17)),
    ("left_claw_elbow", "left_claw_shoulder", (0.31, 0.31, 0.3)),
    ("left_claw_wrist", "left_claw_elbow", (0.25, 0.25, 0.5)),
    ("left_claw_palm", "left_claw_wrist", (0.14, 0.2, 0.58)),
    ("left_claw_thumb", "left_claw_palm", (0.03, 0.19, 0.63), (-0.01, 0.2, 0.64)),
    ("left_claw_finger", "left_claw_palm", (0.1, 0.25, 0.61), (-0.01, 0.24, 0.65)),
    *_leg_bones(),
))  # fmt: skip


def _claw(side: str) -> tuple[str, ...]:
    return tuple(f"{side}_claw_{part}" for part in ("shoulder", "elbow", "wrist", "palm"))


def _legs() -> tuple[Leg, ...]:
    """Neighbours and opposites step in turn, in a wave that runs from the last pair to the first."""
    legs = []
    for n in range(4):
        for side, name in enumerate(("left", "right")):
            late = 0.5 * ((n + side) % 2) - 0.06 * n
            legs.append(Leg(tuple(f"{name}_leg{n + 1}_{p}" for p in _PARTS), (late, late), fold=0.12))
    return tuple(legs)


def _life(at: Moment, curves: Curves) -> None:
    """Claws held ready, that row with the steps; eyes that turn; a body that hangs between its legs."""
    s, down, go, late = at.style, low(at), at.going, at.style.follow_through
    angry = max(s.sharpness - 0.4, 0.0) + max(s.shoulder_lift, 0.0)
    pride = max(-down, 0.0)
    lift = 0.75 * angry + 1.0 * pride - 0.4 * max(down, 0.0)
    pair(curves, "left_claw_shoulder", pitch=-lift, yaw=0.3 * (s.arm_out - 0.13) + 0.35 * angry)
    pair(curves, "left_claw_elbow", yaw=-0.5 * (s.elbow_bend - 0.3) * 0.5 + 0.3 * pride)
    for side, sign in (("left", 1), ("right", -1)):
        row = go * s.arm_swing * 0.6 * sign * at.wave(late) + 0.07 * at.noise(f"{side} claw", 0.7)
        curves.add(f"{side}_claw_shoulder.pitch", 0.6 * row)
        curves.add(f"{side}_claw_shoulder.yaw", sign * row)
        curves.add(f"{side}_claw_wrist.pitch", 0.5 * delayed(row, at.beats, late))
        snap = torch.clamp(at.noise(f"{side} snap", 0.35) - 0.6, 0, 1)
        curves.add(f"{side}_claw_finger.pitch", -0.7 * snap - 0.5 * angry)
        curves.add(f"{side}_eye.yaw", 2.5 * s.look * at.noise(f"{side} eye", 0.5))
    pair(curves, "left_eye", pitch=0.8 * max(down, 0.0) - 0.3 * pride + 0.1 * at.noise("eyes", 0.7),
         roll=-0.3 * max(down, 0.0))  # fmt: skip
    curves.add("trunk.pitch", -0.35 * pride - 0.25 * angry + 0.1 * max(down, 0.0))
    curves.add("root.up", 0.2 * at.performer.leg * (pride + 0.4 * angry) - 0.14 * at.performer.leg * max(down, 0.0))
    curves.add("trunk.roll", go * 0.05 * s.bob * at.wave(0.4, double=True))
    curves.add("left_claw_wrist.yaw", 1.5 * s.tremor * torch.sin(2 * math.pi * 5.0 * at.seconds))
    curves.add("right_claw_wrist.yaw", 1.5 * s.tremor * torch.sin(2 * math.pi * 4.7 * at.seconds))


def _threat(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
    """Up on its legs, claws wide and high; they beat twice, then sink."""
    up = hold(at, b, (0.3, 1.8), (5.4, 7.2))
    beat = hold(at, b, (1.8, 2.2), (4.8, 5.3)) * torch.sin(2 * math.pi * (b - 1.8) / 1.5)
    size, late = at.performer.leg, at.style.follow_through
    curves.add("root.up", 0.26 * size * reach * up + 0.06 * size * beat)
    curves.add("trunk.pitch", -0.42 * reach * up - 0.08 * beat)
    curves.add("root.ahead", -0.12 * size * up)
    pair(curves, "left_claw_shoulder", pitch=-(0.75 * reach * up + 0.28 * beat), yaw=0.55 * up + 0.2 * beat)
    unfolded = delayed(up, at.beats, 0.5 * late)
    pair(curves, "left_claw_elbow", pitch=-0.55 * reach * unfolded, yaw=0.5 * unfolded)
    pair(curves, "left_claw_wrist", pitch=-0.3 * reach * unfolded, yaw=0.45 * unfolded)
    pair(curves, "left_claw_finger", pitch=-0.8 * up - 0.5 * delayed(beat, at.beats, late))
    pair(curves, "left_eye", pitch=-0.3 * up)
    curves.add("trunk.yaw", act.side * 0.12 * beat)


CRAB = Species(
    name="crab",
    bones=_BONES,
    legs=_legs(),
    chains={"neck": ("face",), "tail": ("shell",), "left_claw": _claw("left"), "right_claw": _claw("right")},
    gaits={"walk": "walk", "walk_turn_left": "walk_turn_left", "walk_turn_right": "walk_turn_right"},
    deeds={"threat": Deed(7.5, _threat)},
    step=0.15,
    rate=2.7,
    life=_life,
    duty=(0.6, 0.5),
    facing=math.pi / 2,
    droop=0.4,
    sway=0.25,
    waddle=0.4,
    roll=0.1,
)
