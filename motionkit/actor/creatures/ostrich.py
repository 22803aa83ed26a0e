"""A bird that walks like an ostrich: its "knees" bend backwards, for they are its ankles. It walks, runs and pecks."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..layers import Curves, Moment, hold
from ..score import Act
from .life import delayed, low, pair
from .species import Deed, Leg, Species, both_sides

_BONES = both_sides((
    ("body", "", (0.0, 1.22, 0.0)),
    ("chest", "body", (0.0, 1.27, 0.26)),
    ("neck1", "chest", (0.0, 1.3, 0.4)),
    ("neck2", "neck1", (0.0, 1.4, 0.51)),
    ("neck3", "neck2", (0.0, 1.56, 0.54)),
    ("neck4", "neck3", (0.0, 1.73, 0.52)),
    ("neck5", "neck4", (0.0, 1.9, 0.5)),
    ("head", "neck5", (0.0, 2.05, 0.52)),
    ("beak", "head", (0.0, 2.03, 0.66), (0.0, 2.01, 0.74)),
    ("wing_L", "chest", (0.17, 1.33, 0.14)),
    ("wing_elbow_L", "wing_L", (0.25, 1.2, -0.08)),
    ("wing_hand_L", "wing_elbow_L", (0.24, 1.17, -0.28), (0.2, 1.13, -0.5)),
    ("rump", "body", (0.0, 1.25, -0.22)),
    ("tail1", "rump", (0.0, 1.29, -0.36)),
    ("tail2", "tail1", (0.0, 1.27, -0.5), (0.0, 1.2, -0.66)),
    ("hip_L", "body", (0.11, 1.14, -0.02)),
    ("knee_L", "hip_L", (0.15, 0.93, 0.22)),
    ("ankle_L", "knee_L", (0.13, 0.5, -0.1)),
    ("toe_L", "ankle_L", (0.12, 0.035, 0.03), (0.12, 0.0, 0.2)),
))  # fmt: skip


def _life(at: Moment, curves: Curves) -> None:
    """The head stays behind and jerks after, the wings hang or lift, running carries them spread."""
    s, down, go, late = at.style, low(at), at.going, at.style.follow_through
    pride = max(-down, 0.0)
    curves.add("trunk.pitch", 0.25 * max(down, 0.0) - 0.18 * pride)
    curves.add("neck.pitch", 0.5 * max(down, 0.0) - 0.1 * pride + 0.3 * at.running)
    curves.add("head.pitch", -0.28 * max(down, 0.0) - 0.3 * at.running)
    thrust = go * (0.1 + 0.08 * s.bob) * at.wave(0.15 + 0.4 * late, double=True)
    curves.add("neck2.pitch", 1.3 * thrust)
    curves.add("neck4.pitch", -1.6 * delayed(thrust, at.beats, 0.08))
    curves.add("head.pitch", 0.3 * thrust)
    open_wing = 0.25 * (s.arm_out - 0.13) + 0.5 * pride + 0.35 * max(s.sharpness - 0.5, 0.0) + 0.35 * at.running
    flap = go * 0.25 * s.arm_swing * at.wave(0.3 + late, double=True)
    pair(curves, "wing_L", roll=1.1 * open_wing + 0.3 * flap, yaw=-0.9 * open_wing, pitch=-0.2 * max(down, 0.0))
    pair(curves, "wing_elbow_L", yaw=-0.6 * open_wing + 0.3 * delayed(flap, at.beats, late))
    curves.add("tail.yaw", 0.25 * s.arm_swing * torch.sin(2 * math.pi * 2.0 * at.beats) * (at.noise("wag", 0.4) > 0.9))
    curves.add("spine.yaw", -go * 0.05 * at.wave(0.2))


def _peck(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
    """The long neck goes down to the ground, the beak picks three times, and up it comes with a swallow."""
    down = hold(at, b, (0.0, 1.7), (3.1, 4.9))
    deep = min(0.55 + 0.45 * reach, 1.05)
    late = delayed(down, at.beats, 0.12 + 0.5 * at.style.follow_through)
    pick = hold(at, b, (1.5, 1.9), (2.8, 3.2)) * (0.4 - 0.6 * torch.cos(2 * math.pi * (b - 1.6) / 0.75))
    size = at.performer.leg / 1.14
    curves.add("trunk.pitch", 0.55 * deep * down)
    curves.add("root.up", -0.22 * size * deep * down)
    curves.add("root.ahead", -0.1 * size * down)
    for joint, turn in (("neck1", 1.25), ("neck2", 1.0), ("neck3", 0.3), ("neck4", -0.1), ("neck5", -0.25)):
        curves.add(f"{joint}.pitch", turn * deep * (down if joint < "neck3" else late))
    curves.add("neck4.pitch", 0.16 * pick)
    curves.add("head.pitch", -1.25 * deep * late + 0.16 * pick)
    curves.add("neck.yaw", act.side * 0.2 * down)
    curves.add("tail.pitch", 0.45 * late)
    swallow = hold(at, b, (4.0, 4.4), (4.5, 4.9))
    curves.add("head.pitch", -0.35 * swallow)


_PARTS = ("hip", "knee", "ankle", "toe")

OSTRICH = Species(
    name="ostrich",
    bones=_BONES,
    legs=tuple(
        Leg(tuple(f"{part}_{side}" for part in _PARTS), (when, when), fold=0.75)
        for side, when in (("L", 0.0), ("R", 0.5))
    ),
    chains={
        "spine": ("chest",),
        "neck": ("neck1", "neck2", "neck3", "neck4", "neck5", "head"),
        "tail": ("rump", "tail1", "tail2"),
    },
    gaits={
        "walk": "walk", "walk_turn_left": "walk_turn_left", "walk_turn_right": "walk_turn_right", "run": "run",
    },
    deeds={"peck": Deed(5.0, _peck)},
    step=0.62,
    rate=1.6,
    life=_life,
    duty=(0.6, 0.4),
    sway=1.6,
    waddle=1.2,
    droop=1.2,
    roll=0.5,
)  # fmt: skip
