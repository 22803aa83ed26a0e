"""Rotations as batched torch functions named `a_to_b`.

Conventions, the same everywhere in the kit:

- quaternions are unit, `w x y z`; `q` and `-q` are the same rotation;
- matrices act on column vectors: `v_world = R @ v_local`;
- 6D is the first two **columns** of the matrix, one after the other (Zhou et al. 2019; paper 1, section 3.1);
- Euler orders are written as a BVH file lists its channels: `"ZXY"` means `R = Rz @ Rx @ Ry` (intrinsic);
- angles are radians.

Any batch dimensions, float32 and float64, and no NaN in values or gradients at 0 and at pi.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .errors import MotionKitError
from .quaternions import (  # noqa: F401 - the algebra of quaternions is handed on from here
    _safe_atan2,
    _safe_sqrt,
    axis_angle_to_quaternion,
    exp_map,
    identity_quaternion,
    log_map,
    normalize,
    perpendicular,
    positive,
    quaternion_angle,
    quaternion_inverse,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_axis_angle,
    slerp,
    unroll,
)

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
    return positive(normalize(products.gather(-2, best).squeeze(-2)))


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
    aside = normalize(torch.where(parallel, perpendicular(first), aside))
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


def between(u: Tensor, v: Tensor) -> Tensor:
    """The shortest rotation [..., 4] that turns direction `u` [..., 3] into direction `v` [..., 3].

    Opposite directions have many answers: some axis at right angles to `u` is taken. A zero vector gives no
    turn.

    >>> between(torch.tensor([0.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, 0.0]))
    tensor([0.7071, 0.0000, 0.7071, 0.0000])
    """
    u, v = torch.broadcast_tensors(normalize(u), normalize(v))
    halfway = u + v  # the sum of nearly opposite directions has few digits left, but they are exact
    nothing = ((u == 0).all(-1) | (v == 0).all(-1))[..., None]
    length = _safe_sqrt((halfway**2).sum(-1, keepdim=True))
    opposite = length < (1e-6 if u.dtype == torch.float32 else 1e-14)
    turn = torch.cat((length / 2, torch.linalg.cross(u, normalize(halfway))), -1)
    about = torch.cat((torch.zeros_like(length), perpendicular(u)), -1)
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
    q = positive(q)
    return 2 * _safe_atan2(q[..., 2], q[..., 0])


def wrap(angle: Tensor) -> Tensor:
    """Angles to the same angles between -pi and pi.

    >>> wrap(torch.tensor(3 * torch.pi / 2))
    tensor(-1.5708)
    """
    return torch.atan2(torch.sin(angle), torch.cos(angle))


def _parse_order(order: str) -> tuple[int, int, int, float]:
    """Axis numbers of an Euler order and its handedness (+1 for X Y Z in cyclic order)."""
    letters = str(order).upper()
    if (
        len(letters) != 3
        or any(x not in AXES for x in letters)
        or letters[0] == letters[1]
        or letters[1] == letters[2]
    ):
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
