"""A great spider crab: eight legs, two claws, eyes on stalks. It goes sideways, and threatens with raised claws."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .bodies import CreatureAction, Leg, Species, both_sides
from .curves import Curves, PoseContext, delayed, hold, low, pair
from .score import Action

_CRAB_PARTS = ("hip", "knee", "ankle", "tip")
_ROWS = ((0.13, 0.33, 0.42), (0.05, 0.12, 0.16), (-0.04, -0.11, -0.13), (-0.12, -0.31, -0.4))  # z of hip, knee, tip


def _leg_bones() -> list:
    bones = []
    for n, (hip, knee, tip) in enumerate(_ROWS, 1):
        x = 1.0 if n in (2, 3) else 0.9
        ankle = knee + 0.75 * (tip - knee)
        spots = ((0.15, 0.25, hip), (0.36 * x, 0.44, knee), (0.53 * x, 0.22, ankle), (0.58 * x, 0.008, tip))
        for part, above, spot in zip(_CRAB_PARTS, ("body", *(f"left_leg{n}_{p}" for p in _CRAB_PARTS)), spots):
            end = ((0.585 * x, 0.0, 1.01 * tip),) if part == "tip" else ()
            bones.append((f"left_leg{n}_{part}", above, spot, *end))
    return bones


_CRAB_BONES = both_sides((
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


def _crab_legs() -> tuple[Leg, ...]:
    """Neighbours and opposites step in turn, in a wave that runs from the last pair to the first."""
    legs = []
    for n in range(4):
        for side, name in enumerate(("left", "right")):
            late = 0.5 * ((n + side) % 2) - 0.06 * n
            legs.append(Leg(tuple(f"{name}_leg{n + 1}_{p}" for p in _CRAB_PARTS), (late, late), fold=0.12))
    return tuple(legs)


def _crab_life(at: PoseContext, curves: Curves) -> None:
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


def _threat(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
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
    bones=_CRAB_BONES,
    legs=_crab_legs(),
    chains={"neck": ("face",), "tail": ("shell",), "left_claw": _claw("left"), "right_claw": _claw("right")},
    gaits={"walk": "walk", "walk_turn_left": "walk_turn_left", "walk_turn_right": "walk_turn_right"},
    actions={"threat": CreatureAction(7.5, _threat)},
    step=0.15,
    rate=2.7,
    life=_crab_life,
    duty=(0.6, 0.5),
    facing=math.pi / 2,
    droop=0.4,
    sway=0.25,
    waddle=0.4,
    roll=0.1,
)


_DOG_BONES = both_sides((
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


def _dog_life(at: PoseContext, curves: Curves) -> None:
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


def _sit(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
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


def _dog_legs() -> tuple[Leg, ...]:
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
    bones=_DOG_BONES,
    legs=_dog_legs(),
    chains={
        "spine": ("Spine", "Spine1", "Chest"),
        "neck": ("Neck", "Neck1", "Head"),
        "tail": ("Tail", "Tail1", "Tail2", "Tail3"),
    },
    gaits={
        "walk": "walk", "walk_turn_left": "walk_turn_left", "walk_turn_right": "walk_turn_right", "trot": "run",
    },
    actions={"sit": CreatureAction(7.0, _sit, _STEPS)},
    step=0.34,
    rate=2.4,
    life=_dog_life,
    duty=(0.64, 0.46),
    roll=0.7,
    droop=1.25,
)  # fmt: skip


_TAIL = tuple(f"TailBone{n}" for n in range(1, 8))
_TAIL_PLACES = ((0.66, -0.62), (0.6, -0.88), (0.52, -1.14), (0.43, -1.4), (0.35, -1.66), (0.29, -1.92), (0.26, -2.16))

_DRAGON_BONES = both_sides((
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


def _dragon_life(at: PoseContext, curves: Curves) -> None:
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


def _roar(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
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


def _dragon_legs() -> tuple[Leg, ...]:
    """Diagonal pairs, the hind foot a little before the fore foot."""
    hind, fore = ("HindThigh", "HindKnee", "HindAnkle", "HindFoot"), ("ForeArm", "ForeElbow", "ForeWrist", "ForeFoot")
    order = ((hind, "L", 0.0), (hind, "R", 0.5), (fore, "L", 0.42), (fore, "R", 0.92))
    return tuple(Leg(tuple(f"{p}_{side}" for p in parts), (when, when), fold=0.4) for parts, side, when in order)


DRAGON = Species(
    name="dragon",
    bones=_DRAGON_BONES,
    legs=_dragon_legs(),
    chains={
        "spine": ("SpineBone1", "SpineBone2", "ChestBone"),
        "neck": ("NeckBone1", "NeckBone2", "NeckBone3", "HeadBone"),
        "tail": _TAIL,
        **{f"wing_{side}": tuple(f"Wing{p}_{side}" for p in ("Arm", "Elbow", "Hand", "Tip")) for side in "LR"},
    },
    gaits={"walk": "walk", "walk_turn_left": "walk_turn_left", "walk_turn_right": "walk_turn_right"},
    actions={"roar": CreatureAction(4.5, _roar)},
    step=0.36,
    rate=1.5,
    life=_dragon_life,
    duty=(0.66, 0.5),
    waddle=0.6,
    sway=0.7,
    roll=0.6,
)


_OSTRICH_BONES = both_sides((
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


def _ostrich_life(at: PoseContext, curves: Curves) -> None:
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


def _peck(at: PoseContext, curves: Curves, act: Action, b: Tensor, reach: float) -> None:
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


_OSTRICH_PARTS = ("hip", "knee", "ankle", "toe")

OSTRICH = Species(
    name="ostrich",
    bones=_OSTRICH_BONES,
    legs=tuple(
        Leg(tuple(f"{part}_{side}" for part in _OSTRICH_PARTS), (when, when), fold=0.75)
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
    actions={"peck": CreatureAction(5.0, _peck)},
    step=0.62,
    rate=1.6,
    life=_ostrich_life,
    duty=(0.6, 0.4),
    sway=1.6,
    waddle=1.2,
    droop=1.2,
    roll=0.5,
)  # fmt: skip
