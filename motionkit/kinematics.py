"""Forward kinematics: from local rotations and translations to places and rotations in the world, level by level."""

from __future__ import annotations

import torch
from torch import Tensor

from . import rotations as rot
from .errors import MotionKitError
from .skeleton import Skeleton

_CHUNK = 16384  # frames at a time, so that memory stays bounded however long the clip


def forward_kinematics(skeleton: Skeleton, rotations: Tensor, translations: Tensor) -> Tensor:
    """World positions of all joints.

    skeleton: J joints. rotations: [..., J, 4] unit quaternions w x y z, local to the parent. translations:
    [..., J, 3] metres, from the parent in the parent's frame; the root's is its place in the world. Returns
    [..., J, 3] metres. Differentiable. Raises MotionKitError if the joint counts do not fit.

    >>> s = Skeleton(("root", "tip"), (-1, 0), torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    >>> quarter = rot.axis_angle_to_quaternion(torch.tensor([1.0, 0.0, 0.0]), torch.tensor(torch.pi / 2))
    >>> q = torch.stack((quarter, rot.identity_quaternion()))
    >>> forward_kinematics(s, q, s.offsets)[1].round(decimals=3)
    tensor([0., 0., 1.])
    """
    joints = len(skeleton)
    if rotations.shape[-2:] != (joints, 4) or translations.shape[-2:] != (joints, 3):
        raise MotionKitError(
            f"expected rotations [..., {joints}, 4] and translations [..., {joints}, 3] for "
            f"{skeleton!r}; found {list(rotations.shape)} and {list(translations.shape)}"
        )
    batch = torch.broadcast_shapes(rotations.shape[:-2], translations.shape[:-2])
    dtype = torch.promote_types(rotations.dtype, translations.dtype)
    q = rotations.to(dtype).expand(*batch, joints, 4).reshape(-1, joints, 4)
    t = translations.to(dtype).expand(*batch, joints, 3).reshape(-1, joints, 3)
    chunks = zip(q.split(_CHUNK), t.split(_CHUNK), strict=True)
    flat = torch.cat([_positions_of_chunk(skeleton, a, b) for a, b in chunks])
    return flat.reshape(*batch, joints, 3)


def _positions_of_chunk(skeleton: Skeleton, q: Tensor, t: Tensor) -> Tensor:
    """[N, J, 4] and [N, J, 3] to [N, J, 3], joints in file order; inside, frames last, level order."""
    order, back = (x.to(q.device) for x in skeleton.level_order)
    joints, frames = len(skeleton), len(q)
    # a plain 2D transpose, then whole rows: much faster than one gather over the strided view
    q_rows = torch.cat([order * 4 + c for c in range(4)])
    t_rows = torch.cat([order * 3 + c for c in range(3)])
    q = q.flatten(1).t().contiguous().index_select(0, q_rows).reshape(4, joints, frames)
    t = t.flatten(1).t().contiguous().index_select(0, t_rows).reshape(3, joints, frames)
    return _positions(skeleton, q, t).index_select(1, back).permute(2, 1, 0)


def _positions(skeleton: Skeleton, q: Tensor, t: Tensor) -> Tensor:
    """Local quaternions [4, J, N] and translations [3, J, N] to places [3, J, N]; joints in level order."""
    local = _matrix_planes(q)
    turn, place = local[:, :, :1], t[:, :1]  # the root: [3, 3, 1, N] and [3, 1, N]
    places, start = [place], 1
    for above, inner in skeleton.level_plan:
        above = above.to(q.device)
        stop = start + len(above)
        up = turn if len(above) == turn.shape[2] == 1 else turn.index_select(2, above)
        move = t[:, start:stop]
        place = place if len(above) == place.shape[1] == 1 else place.index_select(1, above)
        for k in range(3):
            place = torch.addcmul(place, up[:, k], move[k])
        if inner:  # leaves turn nothing, so only the first `inner` joints of a level need their matrix
            up, down = up[:, :, :inner], local[:, :, start : start + inner]
            turn = up[:, 0, None] * down[0]
            for k in (1, 2):
                turn = torch.addcmul(turn, up[:, k, None], down[k])
        places.append(place)
        start = stop
    return torch.cat(places, 1)


def _matrix_planes(q: Tensor) -> Tensor:
    """Quaternions [4, J, N] to matrices [3, 3, J, N]; entries are contiguous planes: they vectorise."""
    w, x, y, z = q
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz, xy, xz, yz = x * x2, y * y2, z * z2, x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    entries = (
        1 - (yy + zz),
        xy - wz,
        xz + wy,
        xy + wz,
        1 - (xx + zz),
        yz - wx,
        xz - wy,
        yz + wx,
        1 - (xx + yy),
    )
    return torch.stack(entries).unflatten(0, (3, 3))


def world_rotations(skeleton: Skeleton, rotations: Tensor) -> Tensor:
    """Local unit quaternions [..., J, 4] to quaternions in the world [..., J, 4].

    >>> s = Skeleton(("root", "tip"), (-1, 0), torch.zeros(2, 3))
    >>> world_rotations(s, torch.tensor([[0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]))[1]
    tensor([-1.,  0.,  0.,  0.])
    """
    world: list[Tensor | None] = [None] * len(skeleton)
    world[0] = rotations[..., 0, :]
    for level in skeleton.levels[1:]:
        above = torch.stack([world[skeleton.parents[j]] for j in level], -2)
        turned = rot.quaternion_multiply(above, rotations[..., list(level), :])
        for n, joint in enumerate(level):
            world[joint] = turned[..., n, :]
    return torch.stack(world, -2)


def local_rotations(skeleton: Skeleton, world: Tensor) -> Tensor:
    """Quaternions in the world [..., J, 4] to local ones [..., J, 4]; the inverse of `world_rotations`.

    >>> s = Skeleton(("root", "tip"), (-1, 0), torch.zeros(2, 3))
    >>> q = torch.tensor([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    >>> local_rotations(s, world_rotations(s, q)).allclose(q)
    True
    """
    parents = list(skeleton.parents[1:])
    inner = rot.quaternion_multiply(rot.quaternion_inverse(world[..., parents, :]), world[..., 1:, :])
    return torch.cat((world[..., :1, :], inner), -2)
