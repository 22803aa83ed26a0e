"""Legs of three bones by inverse kinematics, and chains that follow through and do not pass the floor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from ... import rotations as rot
from .species import Creature, Leg, Species

STRETCH = 0.995  # of a leg's length: knees never quite lock
_FOLDED = 0.42  # and a knee folds no further than to this share of it
_LOWEST = 0.12  # of a foot's length: an ankle that lies down stays this far above its toes
_FOLLOW = 0.5  # how much of its lean a foot takes over from the leg


@dataclass(frozen=True)
class RestLegs:
    """What the rest pose says of L legs. joints: [L, 4] numbers. above: [L] the joint each hangs on.

    upper, lower, foot: [L] lengths, metres. knee: [L, 3] where it points. ankle: [L, 3] unit, from the joint on the
    ground to the ankle. lean: [L] radians of the hip ahead of the foot. frames: [L, 3, 3, 3] of the three bones.
    """

    joints: tuple[tuple[int, ...], ...]
    above: tuple[int, ...]
    upper: Tensor
    lower: Tensor
    foot: Tensor
    knee: Tensor
    ankle: Tensor
    lean: Tensor
    frames: Tensor


@lru_cache(maxsize=128)
def rest_legs(species: Species, size: float) -> RestLegs:
    """Measured on the rest pose."""
    creature = Creature(species, size=size)
    skeleton, rest = creature.skeleton, creature.rest
    joints = tuple(tuple(skeleton.index(j) for j in leg.joints) for leg in species.legs)
    hip, knee, ankle, toe = (rest[[j[n] for j in joints]] for n in range(4))
    lengths = [torch.linalg.vector_norm(b - a, dim=-1) for a, b in ((hip, knee), (knee, ankle), (ankle, toe))]
    along = rot.normalize(ankle - hip)
    out = knee - hip
    pole = rot.normalize(out - (out * along).sum(-1, keepdim=True) * along)
    normal = torch.linalg.cross(along, pole)
    bones = torch.stack((knee - hip, ankle - knee, toe - ankle), 1)
    above = tuple(skeleton.parents[j[0]] for j in joints)
    lean = torch.atan2((hip - toe)[:, 2], (hip - toe)[:, 1])
    frames = frame(bones, normal[:, None].expand(-1, 3, -1))
    return RestLegs(joints, above, *lengths, pole, rot.normalize(ankle - toe), lean, frames)


def frame(along: Tensor, normal: Tensor) -> Tensor:
    """Matrices [..., 3, 3]: columns are a bone's direction, its plane's normal made square to it, and the third."""
    x = rot.normalize(along)
    y = rot.normalize(normal - (normal * x).sum(-1, keepdim=True) * x)
    return torch.stack((x, y, torch.linalg.cross(x, y)), -1)


def ankles(rest: RestLegs, hip: Tensor, toe: Tensor, yaw: Tensor, pitch: Tensor) -> Tensor:
    """Where the ankles are, [F, L, 3]: the foot stands as it does at rest, leaning with the leg, and gives way where
    thigh and shin would be too short or could not fold so far.

    hip, toe: [F, L, 3] metres. yaw, pitch: of the feet, [F, L] radians.
    """
    way = hip - toe
    ahead = way[..., 0] * torch.sin(yaw) + way[..., 2] * torch.cos(yaw)
    lean = torch.atan2(ahead, way[..., 1].clamp(min=1e-3)) - rest.lean
    turn = torch.stack((yaw, pitch + _FOLLOW * lean, torch.zeros_like(yaw)), -1)
    up = rot.quaternion_rotate(rot.euler_to_quaternion(turn, "YXZ"), rest.ankle.expand_as(way))
    far = torch.linalg.vector_norm(way, dim=-1).clamp(min=1e-6)
    along = way / far[..., None]
    cosine = (up * along).sum(-1).clamp(-1, 1)
    aside = rot.normalize(up - cosine[..., None] * along)
    angle = torch.acos(cosine.clamp(-1 + 1e-9, 1 - 1e-9))

    def leaves(reach: Tensor) -> Tensor:  # the angle at which hip and ankle are this far from each other
        return torch.acos(((far**2 + rest.foot**2 - reach**2) / (2 * far * rest.foot)).clamp(-1, 1))

    least = leaves(_FOLDED * (rest.upper + rest.lower))
    angle = least + _soft(angle - least)
    most = leaves(STRETCH * (rest.upper + rest.lower))
    angle = (most - _soft(most - angle)).clamp(min=0.0)
    direction = torch.cos(angle)[..., None] * along + torch.sin(angle)[..., None] * aside
    height = _LOWEST + _soft(direction[..., 1:2] - _LOWEST)
    level = rot.normalize(direction * direction.new_tensor([1.0, 0.0, 1.0]))
    raised = level * torch.sqrt((1 - height**2).clamp(min=0))
    direction = torch.cat((raised[..., :1], height.clamp(max=1.0), raised[..., 2:]), -1)
    return toe + rest.foot[:, None] * direction


def _soft(x: Tensor, width: float = 0.03) -> Tensor:
    """Never below 0; x itself where that is well above."""
    return torch.nn.functional.softplus(x / width) * width


def leg_turns(rest: RestLegs, hip: Tensor, ankle: Tensor, toe: Tensor, pole: Tensor) -> Tensor:
    """World rotations [F, L, 3, 4] of thigh, shin and foot. All places [F, L, 3]; pole: where the knees point."""
    way = ankle - hip
    far = torch.linalg.vector_norm(way, dim=-1, keepdim=True)
    upper, lower = rest.upper[:, None], rest.lower[:, None]
    reach = torch.minimum(torch.maximum(far, (upper - lower).abs() + 1e-4), (upper + lower) * (1 - 1e-9))
    along = way / far.clamp(min=1e-9)
    normal = rot.normalize(torch.linalg.cross(along, pole))
    out = torch.linalg.cross(normal, along)
    cosine = ((upper**2 + reach**2 - lower**2) / (2 * upper * reach)).clamp(-1, 1)
    knee = upper * (cosine * along + torch.sqrt(1 - cosine**2) * out)
    bones = torch.stack((knee, along * reach - knee, toe - ankle), -2)
    posed = frame(bones, normal[..., None, :].expand_as(bones))
    return rot.matrix_to_quaternion(posed @ rest.frames.transpose(-1, -2))


def lowered(rest: RestLegs, hip: Tensor, toe: Tensor, fps: float) -> Tensor:
    """How far the body sinks [F], metres and smoothly, where a leg would be too short. hip, toe: [F, L, 3]."""
    length = STRETCH * (rest.upper + rest.lower) + 0.97 * rest.foot
    gap = hip - toe
    level = torch.minimum(gap[..., 0] ** 2 + gap[..., 2] ** 2, (0.95 * length) ** 2)
    excess = ((gap[..., 1] - torch.sqrt(length**2 - level)) / length).amax(1)
    soft = 0.012
    drop = torch.nn.functional.softplus((excess + 0.3 * soft) / soft) * soft * float(length.max())
    width = 2 * max(1, round(0.05 * fps)) + 1
    window = torch.hann_window(width + 2, periodic=False, dtype=drop.dtype)[1:-1]
    padded = torch.nn.functional.pad(drop[None, None], (width // 2, width // 2), mode="replicate")
    return torch.nn.functional.conv1d(padded, (window / window.sum())[None, None])[0, 0]


def blade_swing(leg: Leg, creature: Creature, ahead: Tensor) -> Tensor:
    """The pitch [F] of a shoulder blade whose foot is so far ahead [F] of where it stands at rest, metres."""
    return -0.55 * torch.tanh(ahead / creature.leg)


def off_the_floor(place: Tensor, turn: Tensor, bone: Tensor, floor: float) -> Tensor:
    """The turn [F, 4] of a bone [3] that starts at place [F, 3], raised where its end would be below `floor`, metres.

    >>> place, down = torch.tensor([[0.0, 0.5, 0.0]]), torch.tensor([0.0, -1.0, 0.1])
    >>> turn = off_the_floor(place, rot.identity_quaternion(1), down, 0.02)
    >>> (place + rot.quaternion_rotate(turn, down[None]))[0, 1].round(decimals=2)
    tensor(0.0200)
    """
    way = rot.quaternion_rotate(turn, bone.expand_as(place))
    length = float(torch.linalg.vector_norm(bone))
    least = (floor - place[:, 1]).clamp(max=0.98 * length)
    height = (least + _soft(way[:, 1] - least, 0.03 * length)).clamp(max=length)
    if bool((height - way[:, 1]).amax() < 1e-4 * length):
        return turn
    level = way * way.new_tensor([1.0, 0.0, 1.0])
    level = rot.normalize(level) * torch.sqrt((length**2 - height**2).clamp(min=0))[:, None]
    wanted = torch.cat((level[:, :1], height[:, None], level[:, 2:]), 1)
    return rot.quaternion_multiply(rot.between(way, wanted), turn)
