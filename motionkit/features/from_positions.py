"""Rotations for joints of which only the places are known."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import kinematics
from .. import rotations as rot
from ..errors import MotionKitError
from ..motion import Motion
from ..skeleton import Skeleton


def motion_from_positions(
    positions: Tensor, skeleton: Skeleton, fps: float, keep_lengths: bool = True, name: str = ""
) -> Motion:
    """A motion whose joints stand at `positions` [F, J, 3] (metres, in the skeleton's order).

    A joint from which several bones leave is turned to fit all of them best; one with a single bone is turned with
    its parent and then the shortest way onto the bone: places alone do not tell the twist. With `keep_lengths` the
    bones are those of `skeleton`, else each gets its mean length and place in the data.

    >>> s = Skeleton(("root", "tip"), (-1, 0), torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    >>> motion_from_positions(torch.tensor([[[0.0, 0, 0], [0, 0, 1]]]), s, fps=30).positions()[0, 1].round(decimals=3)
    tensor([0., 0., 1.])
    """
    if positions.ndim != 3 or positions.shape[1:] != (len(skeleton), 3):
        raise MotionKitError(f"expected positions [frames, {len(skeleton)}, 3]; found {list(positions.shape)}")
    world = _world_rotations(positions, skeleton)
    parents = list(skeleton.parents[1:])
    bones = positions[:, 1:] - positions[:, parents]
    seen = rot.quaternion_rotate(rot.quaternion_inverse(world[:, parents]), bones)
    if not keep_lengths:
        offsets = torch.cat((skeleton.offsets[:1].to(seen), seen.mean(0)))
        skeleton = Skeleton(
            skeleton.names, skeleton.parents, offsets, skeleton.channels, skeleton.end_sites, skeleton.twins
        )
    translations = skeleton.offsets.to(positions).expand(len(positions), -1, -1).clone()
    translations[:, 0] = positions[:, 0]
    for joint in skeleton.chain(skeleton.pelvis)[1:]:  # below a helper joint the body may stand anywhere
        translations[:, joint] = seen[:, joint - 1]
    local = rot.unroll(kinematics.local_rotations(skeleton, world))
    return Motion(skeleton, local, translations, fps, name)


def _world_rotations(positions: Tensor, skeleton: Skeleton) -> Tensor:
    world: list[Tensor] = [rot.identity_quaternion(len(positions), dtype=positions.dtype)] * len(skeleton)
    body = set(skeleton.chain(skeleton.pelvis)[:-1])
    for level in skeleton.levels:
        for joint in level:
            above = world[skeleton.parents[joint]] if joint else world[0]
            children = [c for c in skeleton.children[joint] if float(skeleton.offsets[c].norm()) > 1e-6]
            if joint in body or not children:
                world[joint] = above
                continue
            rest = skeleton.offsets[children].to(positions)
            bones = positions[:, children] - positions[:, [joint]]
            world[joint] = _fit(rest, bones) if _spread(rest) else _swing(above, rest[0], bones[:, 0])
    return torch.stack(world, 1)


def _spread(rest: Tensor) -> bool:
    """Whether bones leave in different directions, so that together they tell the whole rotation."""
    return len(rest) > 1 and float(torch.linalg.svdvals(rot.normalize(rest))[1]) > 0.1


def _swing(above: Tensor, rest: Tensor, bone: Tensor) -> Tensor:
    """The parent's rotation, then the shortest way onto the bone."""
    return rot.quaternion_multiply(rot.between(rot.quaternion_rotate(above, rest), bone), above)


def _fit(rest: Tensor, bones: Tensor) -> Tensor:
    """The rotations [F, 4] that turn rest offsets [n, 3] best onto bones [F, n, 3], by SVD (Kabsch 1976)."""
    u, _, vh = torch.linalg.svd(bones.transpose(-1, -2).double() @ rest.double())
    sign = torch.det(u @ vh)
    u = torch.cat((u[..., :2], u[..., 2:] * sign[:, None, None]), -1)
    return rot.matrix_to_quaternion(u @ vh).to(bones.dtype)
