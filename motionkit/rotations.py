"""Rotations: unit quaternions `w x y z`, matrices, 6D, rotation vectors and Euler angles, from each to the other.

`q` and `-q` are the same rotation. Angles are radians. Any batch dimensions, float32 and float64, and no NaN
in values or gradients at 0 and at pi.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .errors import MotionKitError


def _safe_sqrt(x: Tensor) -> Tensor:
    """Square root whose gradient at 0 is 0 instead of infinite."""
    positive = x > 0
    return torch.where(positive, torch.sqrt(torch.where(positive, x, torch.ones_like(x))), torch.zeros_like(x))


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


def perpendicular_to(u: Tensor) -> Tensor:
    """Some unit vector [..., 3] at right angles to each unit vector `u` [..., 3].

    >>> perpendicular_to(torch.tensor([1.0, 0.0, 0.0])).abs()
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


def quaternion_canonical(q: Tensor) -> Tensor:
    """Of `q` and `-q`, which are one rotation, the one with w >= 0; [..., 4].

    >>> quaternion_canonical(torch.tensor([-0.6, 0.8, 0.0, 0.0]))
    tensor([ 0.6000, -0.8000, -0.0000, -0.0000])
    """
    return torch.where(q[..., :1] < 0, -q, q)


def quaternion_unroll(q: Tensor) -> Tensor:
    """Choose signs along the first axis so that neighbouring quaternions [F, ..., 4] lie close together.

    >>> quaternion_unroll(torch.tensor([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]]))
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
    q = quaternion_canonical(q)
    w, xyz = q[..., :1], q[..., 1:]
    squared = (xyz**2).sum(-1, keepdim=True)
    small = squared < 1e-12
    sine = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    return xyz * torch.where(small, 2 / torch.where(small, w, torch.ones_like(w)), 2 * torch.atan2(sine, w) / sine)


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


AXES = {"X": 0, "Y": 1, "Z": 2}


def quaternion_to_matrix(q: Tensor) -> Tensor:
    """Unit quaternions [..., 4] to matrices [..., 3, 3].

    >>> quaternion_to_matrix(torch.tensor([0.0, 0.0, 1.0, 0.0]))
    tensor([[-1.,  0.,  0.],
            [ 0.,  1.,  0.],
            [ 0.,  0., -1.]])
    """
    w, x, y, z = q.unbind(-1)
    rows = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip
    return torch.stack(rows, -1).unflatten(-1, (3, 3))


def matrix_to_quaternion(matrix: Tensor) -> Tensor:
    """Rotation matrices [..., 3, 3] to unit quaternions [..., 4] with w >= 0.

    The products 4 q_i q_j are linear in the matrix; the row with the largest diagonal is at least as long as
    2, so that nothing is divided by zero (Bar-Itzhack 2000, the exact case).

    >>> matrix_to_quaternion(torch.eye(3))
    tensor([1., 0., 0., 0.])
    """
    m = matrix
    a, b, c = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    products = torch.stack(
        (
            1 + a + b + c, wx, wy, wz,
            wx, 1 + a - b - c, xy, xz,
            wy, xy, 1 - a + b - c, yz,
            wz, xz, yz, 1 - a - b + c,
        ),
        -1,
    ).unflatten(-1, (4, 4))  # fmt: skip
    best = products.diagonal(dim1=-2, dim2=-1).argmax(-1)[..., None, None].expand(*matrix.shape[:-2], 1, 4)
    return quaternion_canonical(normalize(products.gather(-2, best).squeeze(-2)))


def matrix_to_sixd(matrix: Tensor) -> Tensor:
    """Matrices [..., 3, 3] to 6D [..., 6]: first column, then second column.

    >>> matrix_to_sixd(torch.eye(3))
    tensor([1., 0., 0., 0., 1., 0.])
    """
    return matrix[..., :2].transpose(-1, -2).flatten(-2)


def sixd_to_matrix(sixd: Tensor) -> Tensor:
    """6D [..., 6] to matrices [..., 3, 3] by Gram-Schmidt (Zhou et al. 2019, eq. 15).

    Any six numbers will do: where the first three are 0 the x axis stands in for them; where the others are 0
    or parallel to the first, some axis at right angles does.

    >>> sixd_to_matrix(torch.tensor([2.0, 0.0, 0.0, 1.0, 1.0, 0.0]))
    tensor([[1., 0., 0.],
            [0., 1., 0.],
            [0., 0., 1.]])
    """
    first, second = normalize(sixd[..., :3]), normalize(sixd[..., 3:])
    nothing = (first == 0).all(-1, keepdim=True)
    first = torch.where(nothing, first.new_tensor([1.0, 0.0, 0.0]), first)
    aside = second - (first * second).sum(-1, keepdim=True) * first
    parallel = (aside**2).sum(-1, keepdim=True) < (1e-12 if sixd.dtype == torch.float32 else 1e-24)
    aside = normalize(torch.where(parallel, perpendicular_to(first), aside))
    # once more: what rounding left of `first` has grown where the two were almost parallel
    second = normalize(aside - (first * aside).sum(-1, keepdim=True) * first)
    return torch.stack((first, second, torch.linalg.cross(first, second)), -1)


def quaternion_to_sixd(q: Tensor) -> Tensor:
    """Unit quaternions [..., 4] to 6D [..., 6].

    >>> quaternion_to_sixd(torch.tensor([1.0, 0.0, 0.0, 0.0]))
    tensor([1., 0., 0., 0., 1., 0.])
    """
    return matrix_to_sixd(quaternion_to_matrix(q))


def sixd_to_quaternion(sixd: Tensor) -> Tensor:
    """6D [..., 6] to unit quaternions [..., 4].

    >>> sixd_to_quaternion(torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
    tensor([1., 0., 0., 0.])
    """
    return matrix_to_quaternion(sixd_to_matrix(sixd))


def rotation_between(u: Tensor, v: Tensor) -> Tensor:
    """The shortest rotation [..., 4] that turns direction `u` [..., 3] into direction `v` [..., 3].

    Opposite directions have many answers: some axis at right angles to `u` is taken. A zero vector gives no
    turn.

    >>> rotation_between(torch.tensor([0.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, 0.0]))
    tensor([0.7071, 0.0000, 0.7071, 0.0000])
    """
    u, v = torch.broadcast_tensors(normalize(u), normalize(v))
    halfway = u + v  # the sum of nearly opposite directions has few digits left, but they are exact
    nothing = ((u == 0).all(-1) | (v == 0).all(-1))[..., None]
    length = _safe_sqrt((halfway**2).sum(-1, keepdim=True))
    opposite = length < (1e-6 if u.dtype == torch.float32 else 1e-14)
    turn = torch.cat((length / 2, torch.linalg.cross(u, normalize(halfway))), -1)
    about = torch.cat((torch.zeros_like(length), perpendicular_to(u)), -1)
    result = normalize(torch.where(opposite, about, turn))
    return torch.where(nothing, result.new_tensor([1.0, 0.0, 0.0, 0.0]), result)


def yaw_to_quaternion(yaw: Tensor) -> Tensor:
    """Turns about the upward Y axis [...], radians, 0 facing +Z, to unit quaternions [..., 4].

    >>> yaw_to_quaternion(torch.tensor(0.0))
    tensor([1., 0., 0., 0.])
    """
    zero = torch.zeros_like(yaw)
    return torch.stack((torch.cos(yaw / 2), zero, torch.sin(yaw / 2), zero), -1)


def direction_to_yaw(direction: Tensor) -> Tensor:
    """Directions [..., 3] to the yaw [...] of their part on the ground: +Z is 0, +X pi/2, straight up 0.

    >>> direction_to_yaw(torch.tensor([1.0, 5.0, 0.0]))
    tensor(1.5708)
    """
    return _safe_atan2(direction[..., 0], direction[..., 2])


def swing_twist(q: Tensor, axis: Tensor) -> tuple[Tensor, Tensor]:
    """Split rotations [..., 4] into `swing * twist`, the twist turning about the unit `axis` [3] or [..., 3].

    >>> swing, twist = swing_twist(yaw_to_quaternion(torch.tensor(1.0)), torch.tensor([0.0, 1.0, 0.0]))
    >>> swing
    tensor([1., 0., 0., 0.])
    """
    along = (q[..., 1:] * axis).sum(-1, keepdim=True) * axis
    raw = torch.cat((q[..., :1], along), -1)
    empty = (raw**2).sum(-1, keepdim=True) < 1e-12
    twist = normalize(torch.where(empty, raw.new_tensor([1.0, 0.0, 0.0, 0.0]), raw))
    return quaternion_multiply(q, quaternion_inverse(twist)), twist


def quaternion_to_yaw(q: Tensor) -> Tensor:
    """The turn about Y [...] inside rotations [..., 4] (the twist of `swing_twist`), -pi to pi.

    >>> quaternion_to_yaw(yaw_to_quaternion(torch.tensor(0.5)))
    tensor(0.5000)
    """
    q = quaternion_canonical(q)
    return 2 * _safe_atan2(q[..., 2], q[..., 0])


def wrap_angle(angle: Tensor) -> Tensor:
    """Angles to the same angles between -pi and pi.

    >>> wrap_angle(torch.tensor(3 * torch.pi / 2))
    tensor(-1.5708)
    """
    return torch.atan2(torch.sin(angle), torch.cos(angle))


def _parse_order(order: str) -> tuple[int, int, int, float]:
    """Axis numbers of an Euler order and its handedness (+1 for X Y Z in cyclic order)."""
    letters = str(order).upper()
    if len(letters) != 3 or any(x not in AXES for x in letters) or letters[0] == letters[1] or letters[1] == letters[2]:
        raise MotionKitError(
            f"Euler order {order!r} is not one of the twelve: expected three of the letters X Y Z with no "
            'letter twice in a row, such as "ZXY"'
        )
    i, j, k = (AXES[x] for x in letters)
    return i, j, k, 1.0 if (j - i) % 3 == 1 else -1.0


def euler_to_quaternion(angles: Tensor, order: str) -> Tensor:
    """Euler angles [..., 3] in radians, in the order of `order`, to unit quaternions [..., 4].

    order: three letters, such as "ZXY" for Rz @ Rx @ Ry. Raises MotionKitError for an order that is none.

    >>> euler_to_quaternion(torch.tensor([0.0, 0.0, torch.pi]), "ZXY").round(decimals=3).abs()
    tensor([0., 0., 1., 0.])
    """
    numbers = _parse_order(order)[:3]
    half = angles / 2
    cosine, sine = torch.cos(half), torch.sin(half)
    zero = torch.zeros_like(cosine[..., 0])
    result = None
    for n, axis in enumerate(numbers):
        parts = [cosine[..., n], zero, zero, zero]
        parts[1 + axis] = sine[..., n]
        step = torch.stack(parts, -1)
        result = step if result is None else quaternion_multiply(result, step)
    return result


def matrix_to_euler(matrix: Tensor, order: str) -> Tensor:
    """Matrices [..., 3, 3] to Euler angles [..., 3] in radians for any of the twelve orders.

    In gimbal lock the first angle is 0 and the third takes the whole turn. Raises MotionKitError for an order
    that is none.

    >>> matrix_to_euler(quaternion_to_matrix(yaw_to_quaternion(torch.tensor(0.5))), "XYX").abs()
    tensor([0.0000, 0.5000, 0.0000])
    """
    i, j, last, sign = _parse_order(order)
    k = 3 - i - j
    m, lock = matrix, 1e-6 if matrix.dtype == torch.float32 else 1e-12
    if i == last:  # proper Euler angles, such as ZXZ
        middle = torch.atan2(_safe_sqrt(m[..., i, j] ** 2 + m[..., i, k] ** 2), m[..., i, i])
        first = _safe_atan2(m[..., j, i], -sign * m[..., k, i], lock)
    else:
        middle = torch.atan2(sign * m[..., i, k], _safe_sqrt(m[..., i, i] ** 2 + m[..., i, j] ** 2))
        first = _safe_atan2(-sign * m[..., j, k], m[..., k, k], lock)
    # undo the first turn, so that the third angle stays consistent with it even close to gimbal lock
    row = torch.cos(first)[..., None] * m[..., j, :] + sign * torch.sin(first)[..., None] * m[..., k, :]
    third = _safe_atan2(-sign * row[..., k] if i == last else sign * row[..., i], row[..., j])
    return torch.stack((first, middle, third), -1)


def quaternion_to_euler(q: Tensor, order: str) -> Tensor:
    """Unit quaternions [..., 4] to Euler angles [..., 3] in radians; see `matrix_to_euler`.

    >>> quaternion_to_euler(yaw_to_quaternion(torch.tensor(0.5)), "ZXY").abs()
    tensor([0.0000, 0.0000, 0.5000])
    """
    return matrix_to_euler(quaternion_to_matrix(q), order)
