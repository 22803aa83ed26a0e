"""How a rig stands in T-pose: the common pose from which the turns of one rig mean the same on another.

Rest poses differ: T-pose, A-pose, arms down, or no standing body at all (in Bandai's captures every bone runs along its
own x axis, so that at rest one leg points up). So each joint is turned from the rest pose, the shortest way, until its
bone points where a T-pose has it. Where a rest pose is no standing body the shortest way leaves the twist about the
bone open by quarter turns; a clip tells them, by where knees and elbows bend and how the trunk stands on average.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .. import rotations as rot
from ..motion import Motion
from .matching import SIDES, Body

_LEG_LEAST, _ARM_LEAST = 0.5, -0.3  # cosine to its T-pose of a bone in a rest pose that is a body's: arms may hang
_LEAST_BEND = 0.05  # mean sine of a knee's or elbow's angle: straighter, it does not tell where it bends
_FLAT = (0.0, 60.0)  # degrees below level that a foot's bone may point at rest for the sole to be flat
_SLOPE = 30.0  # degrees, of a foot's bone where neither the rest pose nor a clip tells


def neutral(body: Body, motion: Motion | None = None) -> Tensor:
    """World rotations [J, 4] of a rig's joints when it stands in T-pose, upright, facing +Z, with flat soles.

    motion: a clip on the body's skeleton, needed only for rigs whose rest pose is no standing body.

    >>> from motionkit.retargeting.matching import body_of
    >>> from motionkit.skeleton import smpl
    >>> upright = neutral(body_of(smpl(), smpl().offsets, smpl().roles))
    >>> bool(rot.quaternion_angle(upright, rot.identity_quaternion(22, dtype=upright.dtype)).max() < 0.25)
    True
    """
    aims, arms, clip = _aims(body), {body.roles.get(f"{s}_shoulder") for s in SIDES}, None
    if motion is not None and len(motion) and not _stands(body, aims):
        clip = motion.positions().double(), motion.world_rotations().double()
    found = [_pelvis(body)]
    for joint in range(1, len(body.skeleton)):
        parent = body.skeleton.parents[joint]
        turn, axis = found[parent], _vector(0.0, 1.0, 0.0)
        if joint in aims:
            end, axis = aims[joint]
            turn = found[body.chest] if joint in arms else turn  # a sloping collar would twist the arm
            turn = _turned_to(turn, body.places[end] - body.places[joint], axis)
        elif joint in body.spine[:1]:
            turn = rot.quaternion_multiply(_quarter(axis, _shoulders_against_hips(body, turn)), turn)
        if clip is not None:
            twist = _hinge_twist(body, joint, turn, axis, *clip)
            twist = twist if twist is not None else _trunk_twist(body, joint, turn, axis, found[parent], clip[1])
            turn = rot.quaternion_multiply(_quarter(axis, twist), turn)
        found.append(turn)
        _lay_foot_flat(body, joint, found, clip)
    return torch.stack(found)


def _vector(*xyz: float) -> Tensor:
    return torch.tensor(xyz, dtype=torch.float64)


def _aims(body: Body) -> dict[int, tuple[int, Tensor]]:
    """For each joint of a limb the joint its bone leads to, and where that bone points in T-pose."""
    aims: dict[int, tuple[int, Tensor]] = {}
    roles = body.roles
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        down, out = _vector(0.0, -1.0, 0.0), _vector(sign, 0.0, 0.0)
        for start, end, axis in (
            ("hip", "knee", down),
            ("knee", "ankle", down),
            ("shoulder", "elbow", out),
            ("elbow", "wrist", out),
        ):
            if f"{side}_{start}" in roles and f"{side}_{end}" in roles:
                aims[roles[f"{side}_{start}"]] = roles[f"{side}_{end}"], axis
        chain = body.collars[side]
        for joint, after in zip(chain, [*chain[1:], roles.get(f"{side}_shoulder", -1)], strict=False):
            aims[joint] = after, out
    return aims


def _stands(body: Body, aims: dict[int, tuple[int, Tensor]]) -> bool:
    """Whether the rest pose is that of a standing body, whatever the arms do: then it tells all turns by itself."""
    upright = _pelvis(body)
    for joint, (end, aim) in aims.items():
        bone = rot.normalize(rot.quaternion_rotate(upright, body.places[end] - body.places[joint]))
        if float(bone @ aim) < (_LEG_LEAST if float(aim[1]) else _ARM_LEAST):
            return False
    return abs(_shoulders_against_hips(body, upright)) < math.pi / 4


def _pelvis(body: Body) -> Tensor:
    """The pelvis' turn [4] from rest: hips level along x, and the line up to the neck along y."""
    shoulders = [body.places[body.roles[f"{s}_shoulder"]] for s in SIDES if f"{s}_shoulder" in body.roles]
    top = torch.stack(shoulders).mean(0) if shoulders else _vector(0.0, 1.0, 0.0)
    if body.neck or body.spine:
        top = body.places[(body.neck or body.spine[-1:])[0]]
    across = _vector(1.0, 0.0, 0.0)
    if "left_hip" in body.roles and "right_hip" in body.roles:
        across = rot.normalize(body.places[body.roles["left_hip"]] - body.places[body.roles["right_hip"]])
    up = rot.normalize(top - across * (top @ across))
    return rot.matrix_to_quaternion(torch.stack((across, up, torch.linalg.cross(across, up))))


def _turned_to(turn: Tensor, bone: Tensor, aim: Tensor) -> Tensor:
    """The turn [4] with the shortest one added that brings a bone [3] to its aim [3]; half a turn goes sideways."""
    now = rot.normalize(rot.quaternion_rotate(turn, bone))
    if float(now @ aim) < -0.99:
        turn = rot.quaternion_multiply(turn.new_tensor([0.0, 0.0, 0.0, 1.0]), turn)
        now = rot.normalize(rot.quaternion_rotate(turn, bone))
    if float(now.norm()) == 0:
        return turn
    return rot.quaternion_multiply(rot.between(now, aim), turn)


def _quarter(axis: Tensor, angle: float) -> Tensor:
    """The rotation [4] about an axis by the number of quarter turns nearest to an angle in radians."""
    nearest = round(angle / (math.pi / 2)) * (math.pi / 2)
    return rot.axis_angle_to_quaternion(axis, axis.new_tensor(nearest))


def _angle_about(axis: Tensor, start: Tensor, end: Tensor) -> float:
    """Signed angle in radians about an axis [3] from one direction [3] to another."""
    return math.atan2(float(torch.linalg.cross(start, end) @ axis), float(start @ end - (start @ axis) * (end @ axis)))


def _shoulders_against_hips(body: Body, turn: Tensor) -> float:
    """The angle about the trunk that brings the shoulders, at rest, in line with the hips."""
    ends = [(body.collars[s] or [body.roles.get(f"{s}_shoulder", -1)])[0] for s in SIDES]
    if min(ends) < 0:
        return 0.0
    across = rot.quaternion_rotate(turn, body.places[ends[0]] - body.places[ends[1]])
    return _angle_about(_vector(0.0, 1.0, 0.0), across, _vector(1.0, 0.0, 0.0))


def _hinge_twist(body: Body, joint: int, turn: Tensor, axis: Tensor, places: Tensor, world: Tensor) -> float | None:
    """The angle about its bone by which a thigh's, shin's or upper arm's turn is off, from where knee or elbow bends.

    0 where the clip holds the limb straight; None for other joints. places [F, J, 3], world [F, J, 4]: the clip.
    """
    role = next((r for r, j in body.roles.items() if j == joint), "")
    side, _, part = role.partition("_")
    limb = ("shoulder", "elbow", "wrist") if part == "shoulder" else ("hip", "knee", "ankle")
    if part not in ("hip", "knee", "shoulder") or not all(f"{side}_{p}" in body.roles for p in limb):
        return None
    a, b, c = (places[:, body.roles[f"{side}_{p}"]] for p in limb)
    hinge = torch.linalg.cross(rot.normalize(b - a), rot.normalize(c - b))
    mean = rot.quaternion_rotate(rot.quaternion_inverse(world[:, joint]), hinge).mean(0)
    if float(mean.norm()) < _LEAST_BEND:
        return 0.0
    expected = _vector(1.0, 0.0, 0.0)
    if part == "shoulder":  # in T-pose a forearm bends ahead, about the vertical
        expected = _vector(0.0, -1.0 if side == SIDES[0] else 1.0, 0.0)
    return _angle_about(axis, rot.quaternion_rotate(turn, mean), expected)


def _trunk_twist(body: Body, joint: int, turn: Tensor, axis: Tensor, above: Tensor, world: Tensor) -> float:
    """The angle about its bone by which a midline joint's or a collar's turn is off, from how it stands on average.

    above: the T-pose [4] of the joint it hangs on. world: [F, J, 4] of the clip. 0 for other joints.
    """
    if joint not in (*body.spine, *body.neck, *body.collars[SIDES[0]], *body.collars[SIDES[1]]):
        return 0.0
    parent = world[:, body.skeleton.parents[joint]]
    parent = rot.quaternion_multiply(parent, rot.quaternion_inverse(above))
    mine = rot.quaternion_multiply(world[:, joint], rot.quaternion_inverse(turn))
    relative = rot.quaternion_multiply(rot.quaternion_inverse(parent), mine)
    ahead = _vector(0.0, 0.0, 1.0)
    return _angle_about(axis, ahead, rot.quaternion_rotate(relative, ahead.expand(len(world), 3)).mean(0))


def _lay_foot_flat(body: Body, joint: int, found: list[Tensor], clip: tuple[Tensor, Tensor] | None) -> None:
    """Turn an ankle, or a toe, whose rest pose has no flat foot (say, one that goes on down the shin)."""
    for side in SIDES:
        ankle, toe = (body.roles.get(f"{side}_{r}", -1) for r in ("ankle", "toe"))
        if joint not in (ankle, toe) or min(ankle, toe) < 0:
            continue
        bone = body.places[toe] - body.places[ankle]
        at_rest = rot.quaternion_rotate(found[body.skeleton.parents[ankle]], bone)
        slope = math.degrees(math.atan2(-float(at_rest[1]), float(at_rest[2])))
        if _FLAT[0] <= slope <= _FLAT[1]:
            continue
        down = math.radians(_SLOPE if joint == ankle else 0.0)
        if clip is not None:
            down = _stance_slope(clip[0][:, [ankle, toe], 1], rot.quaternion_rotate(clip[1][:, joint], bone))
        found[joint] = _turned_to(found[joint], bone, _vector(0.0, -math.sin(down), math.cos(down)))


def _stance_slope(heights: Tensor, bone: Tensor) -> float:
    """The angle below level, radians, of a bone [F, 3] while ankle and toe, at heights [F, 2], are at their lowest."""
    low = heights <= torch.quantile(heights, 0.02, 0) + 0.01
    flat = low.all(1) if bool(low.all(1).any()) else low[:, 1]
    return float(torch.asin((-bone[flat, 1] / bone[flat].norm(dim=-1)).clamp(-1, 1)).median())
