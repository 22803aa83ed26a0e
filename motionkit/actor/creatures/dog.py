"""A dog of a retriever's size: walks, trots, sits and looks about."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..layers import Curves, Moment, hold
from ..score import Act
from .life import delayed, low, pair
from .species import Deed, Leg, Species, both_sides

_BONES = both_sides((
    ("Hips", "", (0.0, 0.56, -0.27)),
    ("LeftThigh", "Hips", (0.07, 0.53, -0.27)),
    ("LeftShin", "LeftThigh", (0.085, 0.36, -0.17)),
    ("LeftHock", "LeftShin", (0.08, 0.18, -0.36)),
    ("LeftHindPaw", "LeftHock", (0.08, 0.025, -0.3), (0.08, 0.0, -0.235)),
    ("Tail", "Hips", (0.0, 0.575, -0.34)),
    ("Tail1", "Tail", (0.0, 0.55, -0.43)),
    ("Tail2", "Tail1", (0.0, 0.545, -0.52)),
    ("Tail3", "Tail2", (0.0, 0.57, -0.6), (0.0, 0.61, -0.67)),
    ("Spine", "Hips", (0.0, 0.585, -0.13)),
    ("Spine1", "Spine", (0.0, 0.58, 0.01)),
    ("Chest", "Spine1", (0.0, 0.57, 0.14)),
    ("LeftScapula", "Chest", (0.055, 0.62, 0.2)),
    ("LeftUpperArm", "LeftScapula", (0.085, 0.46, 0.3)),
    ("LeftForearm", "LeftUpperArm", (0.085, 0.32, 0.17)),
    ("LeftCarpus", "LeftForearm", (0.08, 0.13, 0.225)),
    ("LeftForePaw", "LeftCarpus", (0.08, 0.025, 0.25), (0.08, 0.0, 0.315)),
    ("Neck", "Chest", (0.0, 0.63, 0.27)),
    ("Neck1", "Neck", (0.0, 0.72, 0.35)),
    ("Head", "Neck1", (0.0, 0.81, 0.42)),
    ("Nose", "Head", (0.0, 0.775, 0.6), (0.0, 0.77, 0.63)),
    ("Jaw", "Head", (0.0, 0.775, 0.46), (0.0, 0.735, 0.6)),
    ("LeftEar", "Head", (0.055, 0.85, 0.42), (0.1, 0.77, 0.42)),
))  # fmt: skip

_SIT, _STAND = (0.3, 2.4), (4.6, 6.4)  # beats


def _life(at: Moment, curves: Curves) -> None:
    """Ears that fall and swing, a tail that wags, and a trot that lifts the back."""
    s, down = at.style, low(at)
    wag = (0.1 + 0.5 * s.arm_swing) * max(0.15, 1 - 1.1 * max(down, 0)) * (1 - 0.5 * s.sharpness)
    curves.add("tail.yaw", (1 - 0.6 * at.going) * wag * torch.sin(2 * math.pi * 1.3 * at.beats))
    curves.add("tail.pitch", 0.12 - 0.4 * max(down, 0))
    curves.add("neck.pitch", 0.12 * at.going - 0.12 * at.running)
    nod = torch.sin(2 * math.pi * (at.beats - 0.45 - s.follow_through))
    flap = at.going * 0.14 * s.bob * (1 + at.running) * nod
    pair(curves, "LeftEar", pitch=0.4 * s.sharpness - 0.16 + 0.06 * at.noise("ears", 0.6), roll=flap - 0.25 * down)
    curves.add("Jaw.pitch", 0.12 + 0.4 * max(s.sharpness - 0.5, 0.0) + 0.05 * torch.sin(2 * math.pi * 2.6 * at.seconds))
    curves.add("spine.pitch", -0.06 * at.going * at.wave(0.5, double=True))


def _sit(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
    down, deep = hold(at, b, _SIT, _STAND), min(0.62 + 0.38 * reach, 1.06)
    size = at.performer.leg / 0.53
    curves.blend("root.up", -0.33 * size * deep, down)
    curves.add("root.ahead", 0.185 * size * deep * down)
    curves.blend("trunk.pitch", -0.98 * deep, down)
    curves.add("spine.pitch", 0.42 * deep * down)
    curves.add("neck.pitch", 0.22 * delayed(down, at.beats, at.style.follow_through))
    curves.add("head.pitch", 0.2 * down - 0.15 * hold(at, b, (2.2, 2.8), (4.6, 5.4)))
    curves.add("tail.pitch", 0.75 * delayed(down, at.beats, 0.2))
    look = torch.sin(math.pi * (b - 2.2) / 1.5) * hold(at, b, (2.2, 2.8), (4.6, 5.2))
    curves.add("head.yaw", act.side * 0.3 * look)
    for side in ("Left", "Right"):
        curves.add(f"{side}Hock.fold", -0.95 * deep * down)


_STEPS = ((0, 0.6, 1.3, 0.34), (1, 1.0, 1.7, 0.34), (1, 5.5, 6.2, -0.34), (0, 6.0, 6.8, -0.34))


def _legs() -> tuple[Leg, ...]:
    """A walk puts left hind, left fore, right hind, right fore down in turn; a trot diagonal pairs at once."""
    hind, fore = ("Thigh", "Shin", "Hock", "HindPaw"), ("UpperArm", "Forearm", "Carpus", "ForePaw")
    legs = []
    for parts, lands in ((hind, ((0.0, 0.0), (0.5, 0.5))), (fore, ((0.25, 0.5), (0.75, 1.0)))):
        for side, when in zip(("Left", "Right"), lands):
            blade = f"{side}Scapula" if parts is fore else None
            legs.append(Leg(tuple(side + p for p in parts), when, blade, fold=0.9 if parts is fore else 0.5))
    return tuple(legs)


DOG = Species(
    name="dog",
    bones=_BONES,
    legs=_legs(),
    chains={
        "spine": ("Spine", "Spine1", "Chest"),
        "neck": ("Neck", "Neck1", "Head"),
        "tail": ("Tail", "Tail1", "Tail2", "Tail3"),
    },
    gaits={
        "walk": "walk", "walk_turn_left": "walk_turn_left", "walk_turn_right": "walk_turn_right", "trot": "run",
    },
    deeds={"sit": Deed(7.0, _sit, _STEPS)},
    step=0.34,
    rate=2.4,
    life=_life,
    duty=(0.64, 0.46),
    roll=0.7,
    droop=1.25,
)  # fmt: skip
