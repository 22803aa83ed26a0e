"""A dragon the size of a pony: sprawling legs, folded wings, a long neck and a longer tail. It walks and roars."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..layers import Curves, Moment, hold
from ..score import Act
from .life import delayed, low, pair
from .species import Deed, Leg, Species, both_sides

_TAIL = tuple(f"TailBone{n}" for n in range(1, 8))
_TAIL_PLACES = ((0.66, -0.62), (0.6, -0.88), (0.52, -1.14), (0.43, -1.4), (0.35, -1.66), (0.29, -1.92), (0.26, -2.16))

_BONES = both_sides((
    ("Root", "", (0.0, 0.68, -0.4)),
    ("SpineBone1", "Root", (0.0, 0.72, -0.15)),
    ("SpineBone2", "SpineBone1", (0.0, 0.73, 0.1)),
    ("ChestBone", "SpineBone2", (0.0, 0.72, 0.33)),
    ("NeckBone1", "ChestBone", (0.0, 0.79, 0.52)),
    ("NeckBone2", "NeckBone1", (0.0, 0.93, 0.68)),
    ("NeckBone3", "NeckBone2", (0.0, 1.11, 0.79)),
    ("HeadBone", "NeckBone3", (0.0, 1.27, 0.89)),
    ("SnoutBone", "HeadBone", (0.0, 1.21, 1.17), (0.0, 1.19, 1.24)),
    ("JawBone", "HeadBone", (0.0, 1.2, 0.93), (0.0, 1.14, 1.17)),
    ("WingArm_L", "ChestBone", (0.12, 0.86, 0.24)),
    ("WingElbow_L", "WingArm_L", (0.4, 1.12, 0.1)),
    ("WingHand_L", "WingElbow_L", (0.36, 1.06, -0.42)),
    ("WingTip_L", "WingHand_L", (0.24, 0.98, -0.92), (0.2, 0.93, -1.16)),
    ("ForeArm_L", "ChestBone", (0.16, 0.64, 0.36)),
    ("ForeElbow_L", "ForeArm_L", (0.4, 0.58, 0.2)),
    ("ForeWrist_L", "ForeElbow_L", (0.42, 0.17, 0.32)),
    ("ForeFoot_L", "ForeWrist_L", (0.44, 0.035, 0.42), (0.46, 0.0, 0.56)),
    ("HindThigh_L", "Root", (0.15, 0.64, -0.42)),
    ("HindKnee_L", "HindThigh_L", (0.42, 0.6, -0.24)),
    ("HindAnkle_L", "HindKnee_L", (0.44, 0.2, -0.5)),
    ("HindFoot_L", "HindAnkle_L", (0.46, 0.035, -0.37), (0.48, 0.0, -0.22)),
    *((name, above, (0.0, *place), *(((0.0, 0.26, -2.38),) if name == _TAIL[-1] else ()))
      for name, above, place in zip(_TAIL, ("Root", *_TAIL), _TAIL_PLACES)),
))  # fmt: skip


def _wings(curves: Curves, spread: Tensor | float, raised: Tensor | float) -> None:
    """Unfold the wings: 0 folded, 1 spread; raised: radians up."""
    pair(curves, "WingArm_L", roll=0.15 * spread + raised, yaw=-0.25 * spread)
    pair(curves, "WingElbow_L", yaw=-1.55 * spread, roll=0.2 * spread)
    pair(curves, "WingHand_L", yaw=0.55 * spread)
    pair(curves, "WingTip_L", yaw=0.25 * spread)


def _life(at: Moment, curves: Curves) -> None:
    """The body winds from side to side between its legs; neck, wings and tail come after."""
    s, down, go, late = at.style, low(at), at.going, at.style.follow_through
    pride = max(-down, 0.0)
    wind = go * (0.14 + 0.5 * s.hip_turn)
    curves.add("trunk.yaw", -0.7 * wind * at.wave(0.1))
    curves.add("spine.yaw", 1.5 * wind * at.wave(0.2))
    curves.add("neck.yaw", -0.8 * wind * at.wave(0.35 + late))
    curves.add("tail.yaw", 2.0 * wind * at.wave(0.35) + 0.25 * at.noise("lash", 0.5) * (0.5 + s.sharpness))
    curves.add("tail.pitch", 0.1 - 0.15 * max(down, 0.0))
    curves.add("neck.pitch", 0.1 * go - 0.2 * pride)
    curves.add("spine.pitch", -0.15 * pride + 0.1 * max(down, 0.0))
    breathing = torch.sin(2 * math.pi * at.beats / 5.0 + at.score.draw("breath"))
    curves.add("JawBone.pitch", 0.1 + 0.05 * breathing + 0.4 * max(s.sharpness - 0.4, 0.0))
    bounce = go * 0.1 * s.bob * at.wave(0.4 + late, double=True)
    opened = 0.28 * pride + 0.25 * max(s.sharpness - 0.4, 0.0) + 0.2 * max(s.arm_out - 0.3, 0.0)
    _wings(curves, opened + 0.03 * breathing, 0.3 * pride + 0.05 * breathing - 0.4 * max(down, 0.0) + 0.4 * bounce)
    pair(curves, "WingElbow_L", pitch=-0.4 * max(down, 0.0))
    pair(curves, "WingHand_L", roll=delayed(bounce, at.beats, late))


def _roar(at: Moment, curves: Curves, act: Act, b: Tensor, reach: float) -> None:
    """It draws back, throws its head forward with open jaws, beats its wings and folds them again."""
    draw, roar = hold(at, b, (0.1, 1.0), (1.05, 1.6)), hold(at, b, (1.15, 1.65), (3.1, 3.9))
    spread = hold(at, b, (0.3, 1.5), (3.2, 4.3))
    shake = roar * torch.sin(2 * math.pi * 3.2 * (b - 1.2))
    size, late = at.performer.leg / 0.64, at.style.follow_through
    curves.add("trunk.pitch", -0.12 * reach * draw - 0.16 * reach * roar)
    curves.add("spine.pitch", -0.2 * reach * draw - 0.14 * reach * roar)
    curves.add("root.up", -0.05 * size * draw + 0.02 * size * roar)
    curves.add("root.ahead", -0.1 * size * draw + 0.05 * size * roar)
    curves.add("neck.pitch", -0.85 * reach * draw + 0.45 * reach * roar)
    curves.add("head.pitch", 0.6 * draw - 0.5 * roar)
    curves.add("neck.yaw", act.side * 0.3 * roar * torch.sin(2 * math.pi * (b - 1.2) / 2.4))
    curves.add("head.roll", 0.06 * shake)
    curves.add("JawBone.pitch", 0.75 * reach * roar + 0.05 * shake)
    beat = roar * torch.sin(2 * math.pi * (b - 1.3) / 1.2)
    _wings(curves, min(reach, 1.15) * spread, 0.35 * reach * spread + 0.3 * beat)
    pair(curves, "WingHand_L", roll=0.35 * delayed(beat, at.beats, 0.15 + late))
    pair(curves, "WingTip_L", roll=0.35 * delayed(beat, at.beats, 0.3 + late))
    curves.add("tail.pitch", 0.35 * reach * spread)
    curves.add("tail.yaw", act.side * 0.9 * delayed(roar, at.beats, 0.1) * torch.sin(2 * math.pi * (b - 1.2) / 1.8))


def _legs() -> tuple[Leg, ...]:
    """Diagonal pairs, the hind foot a little before the fore foot."""
    hind, fore = ("HindThigh", "HindKnee", "HindAnkle", "HindFoot"), ("ForeArm", "ForeElbow", "ForeWrist", "ForeFoot")
    order = ((hind, "L", 0.0), (hind, "R", 0.5), (fore, "L", 0.42), (fore, "R", 0.92))
    return tuple(Leg(tuple(f"{p}_{side}" for p in parts), (when, when), fold=0.4) for parts, side, when in order)


DRAGON = Species(
    name="dragon",
    bones=_BONES,
    legs=_legs(),
    chains={
        "spine": ("SpineBone1", "SpineBone2", "ChestBone"),
        "neck": ("NeckBone1", "NeckBone2", "NeckBone3", "HeadBone"),
        "tail": _TAIL,
        **{f"wing_{side}": tuple(f"Wing{p}_{side}" for p in ("Arm", "Elbow", "Hand", "Tip")) for side in "LR"},
    },
    gaits={"walk": "walk", "walk_turn_left": "walk_turn_left", "walk_turn_right": "walk_turn_right"},
    deeds={"roar": Deed(4.5, _roar)},
    step=0.36,
    rate=1.5,
    life=_life,
    duty=(0.66, 0.5),
    waddle=0.6,
    sway=0.7,
    roll=0.6,
)
