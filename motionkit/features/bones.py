"""Bone directions: what two rigs with other joints, names and rest poses have in common."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import kinematics
from .. import rotations as rot
from ..motion import Motion
from ..retargeting.matching import trunk
from ..skeleton import Skeleton

_LIMBS = {
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
    "foot": ("ankle", "toe"),
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}

_PASSES = 4  # the torso turns above the pelvis, which it starts from: each pass leaves about a third of the error


def bone_names(skeleton: Skeleton) -> list[str]:
    """The bones that the joint names of a skeleton tell: torso, head, and both sides' limbs.

    >>> from motionkit.skeleton import smpl
    >>> bone_names(smpl())[:4]
    ['torso', 'head', 'left_thigh', 'left_shank']
    """
    spine, above = trunk(skeleton)
    names = ["torso"] * bool(spine) + ["head"] * (len(above) > 1)
    for side in ("left", "right"):
        for bone, ends in _LIMBS.items():
            if all(f"{side}_{e}" in skeleton.roles for e in ends):
                names.append(f"{side}_{bone}")
    return names


def bone_directions(motion: Motion, names: list[str]) -> Tensor:
    """Unit vectors along bones, seen from where the body faces: [F, B, 3], in the order of `names`.

    The torso runs from the pelvis to between the shoulders, the head from the neck to the last joint above it.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> bool(bone_directions(walk, ["torso"])[..., 1].min() > 0.9)  # upright
    True
    """
    skeleton, places = motion.skeleton, motion.positions()
    roles, (_, above) = skeleton.roles, trunk(skeleton)
    found = []
    for name in names:
        if name == "torso":
            top = (places[:, roles["left_shoulder"]] + places[:, roles["right_shoulder"]]) / 2
            found.append(top - places[:, skeleton.pelvis])
        elif name == "head":
            found.append(places[:, above[-1]] - places[:, above[0]])
        else:
            side, _, bone = name.partition("_")
            start, end = (roles[f"{side}_{e}"] for e in _LIMBS[bone])
            found.append(places[:, end] - places[:, start])
    against = rot.yaw_to_quaternion(-motion.facing())
    return rot.normalize(rot.quaternion_rotate(against[:, None], torch.stack(found, 1)))


def turn_bones(motion: Motion, names: list[str], wanted: Tensor) -> Motion:
    """The motion with its bones turned, the shortest way, along `wanted` [F, B, 3] (seen from where the body faces).

    Each bone keeps its twist. Joints that belong to no named bone turn with the one they hang on.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> same = turn_bones(walk, ["left_forearm"], bone_directions(walk, ["left_forearm"]))
    >>> bool((same.positions() - walk.positions()).abs().max() < 1e-5)
    True
    """
    yaw = rot.yaw_to_quaternion(motion.facing())[:, None]
    target = rot.quaternion_rotate(yaw, wanted)
    for _ in range(_PASSES if "torso" in names else 1):
        now = rot.quaternion_rotate(rot.yaw_to_quaternion(motion.facing())[:, None], bone_directions(motion, names))
        motion = _turned(motion, names, rot.between(now, target))
    return motion


def _turned(motion: Motion, names: list[str], turns: Tensor) -> Motion:
    """Every joint turned in the world by its bone's rotation in `turns` [F, B, 4], or by that of the joint above it."""
    skeleton = motion.skeleton
    spine, above = trunk(skeleton)
    mover: dict[int, int] = {}
    for n, name in enumerate(names):
        side, _, bone = name.partition("_")
        joints = {"torso": spine, "head": above[:1]}.get(name) or [skeleton.roles[f"{side}_{_LIMBS[bone][0]}"]]
        mover.update(dict.fromkeys(joints, n))
    delta: list[Tensor] = []
    for joint, parent in enumerate(skeleton.parents):
        still = rot.identity_quaternion(len(motion), dtype=turns.dtype)
        inherited = delta[parent] if parent >= 0 else still
        delta.append(turns[:, mover[joint]] if joint in mover else inherited)
    world = rot.quaternion_multiply(torch.stack(delta, 1), motion.world_rotations())
    return motion.replace(rotations=rot.unroll(kinematics.local_rotations(skeleton, world)))
