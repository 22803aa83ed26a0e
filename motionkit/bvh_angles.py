"""Rotation channels to quaternions and back, for joints that turn about zero, one, two or three axes."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from . import rotations as rot


def compose(angles: Tensor, axes: list[str]) -> Tensor:
    """Zero to three turns about different axes, in turn: radians [..., n] to unit quaternions [..., 4].

    >>> compose(torch.tensor([torch.pi]), ["Y"]).abs().round(decimals=3)
    tensor([0., 0., 1., 0.])
    """
    half = (angles / 2).movedim(-1, 0).contiguous()  # one plane an angle
    cosine, sine = torch.cos(half), torch.sin(half)
    w = torch.ones_like(angles[..., :1].sum(-1))
    planes = [w, torch.zeros_like(w), torch.zeros_like(w), torch.zeros_like(w)]
    for c, s, axis in zip(cosine, sine, axes, strict=True):
        k = 1 + rot.AXES[axis]
        i, j = k % 3 + 1, (k + 1) % 3 + 1  # the axes that follow k in the cycle x y z
        w, qi, qj, qk = (planes[n] for n in (0, i, j, k))
        planes[0], planes[k] = w * c - qk * s, qk * c + w * s
        planes[i], planes[j] = qi * c + qj * s, qj * c - qi * s
    return torch.stack(planes, -1)


def decompose(q: Tensor, axes: list[str]) -> Tensor:
    """The turns about zero to three axes that give, or come close to, rotations [..., 4]; radians [..., n].

    >>> decompose(rot.yaw_to_quaternion(torch.tensor([0.5])), ["Y"])
    tensor([[0.5000]])
    """
    if len(axes) == 3:
        return rot.quaternion_to_euler(q, "".join(axes))
    if not axes:
        return q[..., :0]
    # Without a third turn there is no gimbal lock: each angle shows on a vector that the other leaves alone.
    i = rot.AXES[axes[0]]
    j = rot.AXES[axes[1]] if len(axes) == 2 else (i + 1) % 3
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = rot.quaternion_to_matrix(q)
    first = torch.atan2(sign * m[..., k, j], m[..., j, j])
    second = torch.atan2(sign * m[..., i, k], m[..., i, i])
    return torch.stack((first, second), -1)[..., : len(axes)]


def layouts(channels: Sequence[tuple[str, ...]]) -> dict[tuple[str, ...], tuple[list[int], list[int]]]:
    """For each different list of channels the joints that have it, and their columns.

    >>> layouts([("Xrotation",), ("Zrotation", "Xrotation"), ("Xrotation",)])
    {('Xrotation',): ([0, 2], [0, 3]), ('Zrotation', 'Xrotation'): ([1], [1, 2])}
    """
    found: dict[tuple[str, ...], tuple[list[int], list[int]]] = {}
    first = 0
    for joint, layout in enumerate(channels):
        joints, columns = found.setdefault(layout, ([], []))
        joints.append(joint)
        columns.extend(range(first, first + len(layout)))
        first += len(layout)
    return found
