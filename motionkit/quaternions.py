"""Unit quaternions `w x y z`: the algebra that `rotations` builds on, and hands on under its own name.

`q` and `-q` are the same rotation. Angles are radians. Any batch dimensions, float32 and float64, and no NaN
in values or gradients at 0 and at pi.
"""

from __future__ import annotations

import torch
from torch import Tensor


def _safe_sqrt(x: Tensor) -> Tensor:
    """Square root whose gradient at 0 is 0 instead of infinite."""
    positive = x > 0
    return torch.where(
        positive, torch.sqrt(torch.where(positive, x, torch.ones_like(x))), torch.zeros_like(x)
    )


def _safe_atan2(y: Tensor, x: Tensor, tiny: float = 0.0) -> Tensor:
    """atan2 that is 0, with gradient 0, where both arguments are at most `tiny`."""
    fine = (y.abs() > tiny) | (x.abs() > tiny)
    angle = torch.atan2(torch.where(fine, y, torch.zeros_like(y)), torch.where(fine, x, torch.ones_like(x)))
    return torch.where(fine, angle, torch.zeros_like(angle))


def normalize(v: Tensor) -> Tensor:
    """Scale vectors (or quaternions) [..., D] to length 1; a zero vector stays zero.

    >>> normalize(torch.tensor([3.0, 0.0, 4.0]))
    tensor([0.6000, 0.0000, 0.8000])
    """
    # first to about 1, so that the squares of very short or long vectors stay within the numbers there are;
    # the result does not depend on that size, so its gradient need not either
    size = v.detach().abs().amax(-1, keepdim=True)
    enough = size >= torch.finfo(v.dtype).tiny  # below it, numbers have too few digits left to tell a direction
    v = torch.where(enough, v / torch.where(enough, size, torch.ones_like(size)), torch.zeros_like(v))
    length = _safe_sqrt((v * v).sum(-1, keepdim=True))
    return v / torch.where(length > 0, length, torch.ones_like(length))


def perpendicular(u: Tensor) -> Tensor:
    """Some unit vector [..., 3] at right angles to each unit vector `u` [..., 3].

    >>> perpendicular(torch.tensor([1.0, 0.0, 0.0])).abs()
    tensor([0., 0., 1.])
    """
    far = u[..., :1].abs() > 0.7
    helper = torch.where(far, u.new_tensor([0.0, 1.0, 0.0]), u.new_tensor([1.0, 0.0, 0.0]))
    return normalize(torch.linalg.cross(u, helper))


def identity_quaternion(*batch: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """The rotation that does nothing, shape [*batch, 4].

    >>> identity_quaternion(2)
    tensor([[1., 0., 0., 0.],
            [1., 0., 0., 0.]])
    """
    return torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=dtype).expand(*batch, 4).clone()


def quaternion_multiply(a: Tensor, b: Tensor) -> Tensor:
    """Rotate by `b`, then by `a`: [..., 4] x [..., 4] -> [..., 4].

    >>> half_turn = torch.tensor([0.0, 0.0, 1.0, 0.0])
    >>> quaternion_multiply(half_turn, half_turn)
    tensor([-1.,  0.,  0.,  0.])
    """
    aw, ax, ay, az = a.unbind(-1)
    bw, bx, by, bz = b.unbind(-1)
    return torch.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        -1,
    )


def quaternion_inverse(q: Tensor) -> Tensor:
    """The opposite rotation of unit quaternions [..., 4].

    >>> quaternion_inverse(torch.tensor([0.6, 0.8, 0.0, 0.0]))
    tensor([ 0.6000, -0.8000, -0.0000, -0.0000])
    """
    return q * q.new_tensor([1.0, -1.0, -1.0, -1.0])


def quaternion_rotate(q: Tensor, v: Tensor) -> Tensor:
    """Rotate vectors [..., 3] by unit quaternions [..., 4].

    >>> half_turn = torch.tensor([0.0, 0.0, 1.0, 0.0])
    >>> quaternion_rotate(half_turn, torch.tensor([1.0, 2.0, 3.0]))
    tensor([-1.,  2., -3.])
    """
    xyz = q[..., 1:].expand(*torch.broadcast_shapes(q.shape[:-1], v.shape[:-1]), 3)
    v = v.expand_as(xyz)
    turned = 2 * torch.linalg.cross(xyz, v)
    return v + q[..., :1] * turned + torch.linalg.cross(xyz, turned)


def quaternion_angle(a: Tensor, b: Tensor) -> Tensor:
    """Angle in radians, 0 to pi, between rotations [..., 4] and [..., 4] (paper 2, supplement: L_quat).

    >>> quaternion_angle(identity_quaternion(), torch.tensor([0.0, 1.0, 0.0, 0.0]))
    tensor(3.1416)
    """
    difference = quaternion_multiply(quaternion_inverse(a), b)
    sine = _safe_sqrt((difference[..., 1:] ** 2).sum(-1))
    return 2 * _safe_atan2(sine, difference[..., 0].abs())


def positive(q: Tensor) -> Tensor:
    """Of `q` and `-q`, which are one rotation, the one with w >= 0; [..., 4].

    >>> positive(torch.tensor([-0.6, 0.8, 0.0, 0.0]))
    tensor([ 0.6000, -0.8000, -0.0000, -0.0000])
    """
    return torch.where(q[..., :1] < 0, -q, q)


def unroll(q: Tensor) -> Tensor:
    """Choose signs along the first axis so that neighbouring quaternions [F, ..., 4] lie close together.

    >>> unroll(torch.tensor([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]]))
    tensor([[1., 0., 0., 0.],
            [1., -0., -0., -0.]])
    """
    flips = torch.where((q[1:] * q[:-1]).sum(-1, keepdim=True) < 0, -1.0, 1.0).to(q.dtype)
    return torch.cat((q[:1], q[1:] * torch.cumprod(flips, 0)))


def exp_map(rotation_vector: Tensor) -> Tensor:
    """Rotation vectors (axis times angle) [..., 3] to unit quaternions [..., 4].

    >>> exp_map(torch.zeros(3))
    tensor([1., 0., 0., 0.])
    """
    squared = (rotation_vector**2).sum(-1, keepdim=True)
    small = squared < 1e-8
    angle = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    factor = torch.where(small, 0.5 - squared / 48, torch.sin(angle / 2) / angle)
    w = torch.where(small, 1 - squared / 8, torch.cos(angle / 2))
    return torch.cat((w, rotation_vector * factor), -1)


def log_map(q: Tensor) -> Tensor:
    """Unit quaternions [..., 4] to rotation vectors [..., 3] of length 0 to pi; the inverse of `exp_map`.

    >>> log_map(torch.tensor([0.0, 0.0, 1.0, 0.0]))
    tensor([0.0000, 3.1416, 0.0000])
    """
    q = positive(q)
    w, xyz = q[..., :1], q[..., 1:]
    squared = (xyz**2).sum(-1, keepdim=True)
    small = squared < 1e-12
    sine = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    return xyz * torch.where(
        small, 2 / torch.where(small, w, torch.ones_like(w)), 2 * torch.atan2(sine, w) / sine
    )


def axis_angle_to_quaternion(axis: Tensor, angle: Tensor) -> Tensor:
    """Axes [..., 3] (any length but 0) and angles [...] to unit quaternions [..., 4].

    >>> axis_angle_to_quaternion(torch.tensor([0.0, 2.0, 0.0]), torch.tensor(torch.pi))[2]
    tensor(1.)
    """
    half = angle[..., None] / 2
    xyz = normalize(axis) * torch.sin(half)
    return torch.cat((torch.cos(half).expand(*xyz.shape[:-1], 1), xyz), -1)


def quaternion_to_axis_angle(q: Tensor) -> tuple[Tensor, Tensor]:
    """Unit quaternions [..., 4] to unit axes [..., 3] and angles [...] from 0 to pi (no turn: axis zero).

    >>> axis, angle = quaternion_to_axis_angle(torch.tensor([0.0, 0.0, 1.0, 0.0])); axis, angle
    (tensor([0., 1., 0.]), tensor(3.1416))
    """
    vector = log_map(q)
    return normalize(vector), _safe_sqrt((vector**2).sum(-1))


def slerp(a: Tensor, b: Tensor, t: Tensor | float) -> Tensor:
    """From `a` (t = 0) to `b` (t = 1), [..., 4], the short way at constant speed; t is [...] or a number.

    >>> slerp(identity_quaternion(), torch.tensor([0.0, 0.0, 1.0, 0.0]), 0.5)
    tensor([0.7071, 0.0000, 0.7071, 0.0000])
    """
    t = torch.as_tensor(t, dtype=a.dtype, device=a.device)[..., None]
    b = torch.where((a * b).sum(-1, keepdim=True) < 0, -b, b)
    far, near = ((a - b) ** 2).sum(-1, keepdim=True), ((a + b) ** 2).sum(-1, keepdim=True)
    angle = 2 * _safe_atan2(_safe_sqrt(far), _safe_sqrt(near))
    small = angle < 1e-4
    sine = torch.where(small, torch.ones_like(angle), torch.sin(angle))
    wa = torch.where(small, 1 - t, torch.sin((1 - t) * angle) / sine)
    wb = torch.where(small, t, torch.sin(t * angle) / sine)
    return normalize(wa * a + wb * b)
