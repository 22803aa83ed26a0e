"""Gradients of rotations: finite where formulas usually break, and right everywhere else."""

import itertools

import pytest
import torch

from motionkit import rotations as rot

ORDERS = [a + b + c for a, b, c in itertools.product("XYZ", repeat=3) if a != b and b != c]
DTYPES = [torch.float32, torch.float64]
PI = torch.pi

IDENTITY = [1.0, 0.0, 0.0, 0.0]
HARD_QUATERNIONS = [
    IDENTITY,
    [-1.0, 0.0, 0.0, 0.0],  # no turn, other sign
    [0.0, 1.0, 0.0, 0.0],  # half turns
    [0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, -1.0],
    [0.0, 0.6, 0.0, 0.8],
    [1.0, 1e-20, 0.0, 0.0],  # hardly a turn
    [0.5**0.5, 0.5**0.5, 0.0, 0.0],  # quarter turn: gimbal lock
    [0.5, 0.5, 0.5, 0.5],
]
HARD_VECTORS = [[0.0, 0, 0], [1e-30, 0, 0], [1e-40, 0, 0], [PI, 0, 0], [0, 2 * PI, 0], [1e-4, 0, 0]]


def axis_and_angle(q: torch.Tensor) -> torch.Tensor:
    axis, angle = rot.quaternion_to_axis_angle(q)
    return torch.cat((axis, angle[..., None]), -1)


OF_QUATERNIONS = {
    "matrix": rot.quaternion_to_matrix,
    "matrix and back": lambda q: rot.matrix_to_quaternion(rot.quaternion_to_matrix(q)),
    "6D and back": lambda q: rot.sixd_to_quaternion(rot.quaternion_to_sixd(q)),
    "log": rot.log_map,
    "log and back": lambda q: rot.exp_map(rot.log_map(q)),
    "axis and angle": lambda q: axis_and_angle(q),
    "angle to itself": lambda q: rot.quaternion_angle(q, q.detach()),
    "angle to the identity": lambda q: rot.quaternion_angle(q, torch.tensor(IDENTITY, dtype=q.dtype)),
    "slerp to itself": lambda q: rot.slerp(q, q.detach(), 0.3),
    "slerp to its opposite sign": lambda q: rot.slerp(q, -q.detach(), 0.3),
    "slerp to the identity": lambda q: rot.slerp(q, torch.tensor(IDENTITY, dtype=q.dtype), 0.3),
    "swing and twist": lambda q: torch.cat(rot.swing_twist(q, torch.tensor([0, 1, 0], dtype=q.dtype)), -1),
    "yaw": rot.quaternion_to_yaw,
    "normalize": rot.normalize,
    "unroll": lambda q: rot.quaternion_unroll(torch.stack((q, -q, q))),
    "rotate": lambda q: rot.quaternion_rotate(q, torch.tensor([1, 2, 3], dtype=q.dtype)),
    **{order: lambda q, order=order: rot.quaternion_to_euler(q, order) for order in ORDERS},
}


def assert_finite_gradients(result: torch.Tensor, x: torch.Tensor) -> None:
    """result [N, ...] made from x [N, D] row by row; each output by itself: a sum may hide what cancels."""
    assert torch.isfinite(result).all(), result
    for output in result.flatten(1).unbind(-1):
        (gradient,) = torch.autograd.grad(output.sum(), x, retain_graph=True)
        assert torch.isfinite(gradient).all(), gradient


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", OF_QUATERNIONS)
def test_gradients_are_finite_at_no_turn_and_at_half_turns(name, dtype):
    q = torch.tensor(HARD_QUATERNIONS, dtype=dtype, requires_grad=True)
    assert_finite_gradients(OF_QUATERNIONS[name](q).reshape(len(q), -1), q)


OF_VECTORS = {
    "exp": rot.exp_map,
    "exp and back": lambda x: rot.log_map(rot.exp_map(x)),
    "normalize": rot.normalize,
    "perpendicular": rot.perpendicular_to,
    "direction to yaw": rot.direction_to_yaw,
    "between equals": lambda x: rot.rotation_between(x, x.detach()),
    "between opposites": lambda x: rot.rotation_between(x, -x.detach()),
    "axis and angle": lambda x: rot.axis_angle_to_quaternion(x, x[..., 0]),
    "6D, equal columns": lambda x: rot.sixd_to_matrix(torch.cat((x, x), -1)),
    "6D, second column": lambda x: rot.sixd_to_matrix(torch.cat((torch.ones_like(x), x), -1)),
    "wrap": rot.wrap_angle,
    **{order: lambda x, order=order: rot.euler_to_quaternion(x, order) for order in ORDERS},
}


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", OF_VECTORS)
def test_gradients_of_vectors_are_finite(name, dtype):
    x = torch.tensor(HARD_VECTORS, dtype=dtype, requires_grad=True)
    assert_finite_gradients(OF_VECTORS[name](x).reshape(len(x), -1), x)


def test_the_gradient_of_the_logarithm_at_no_turn_is_right():
    """A training loss that starts at the identity must not lose its gradient there."""
    x = torch.zeros(3, dtype=torch.float64)
    back = torch.autograd.functional.jacobian(lambda v: rot.log_map(rot.exp_map(v)), x)
    assert torch.allclose(back, torch.eye(3, dtype=torch.float64))


@pytest.mark.parametrize("name", [n for n in OF_QUATERNIONS if " its" not in n])  # those hold a part fixed
def test_gradients_are_right_at_generic_points(name):
    generator = torch.Generator().manual_seed(11)
    q = torch.randn(3, 4, dtype=torch.float64, generator=generator, requires_grad=True)
    # normalised inside, so that finite differences stay among rotations
    assert torch.autograd.gradcheck(lambda x: OF_QUATERNIONS[name](rot.normalize(x)), q)


def test_gradients_of_the_others_are_right_at_generic_points():
    generator = torch.Generator().manual_seed(12)
    x, y = torch.randn(2, 4, 3, dtype=torch.float64, generator=generator)
    x.requires_grad_(), y.requires_grad_()
    check = torch.autograd.gradcheck
    assert check(rot.exp_map, x)
    assert check(rot.rotation_between, (x, y))
    assert check(lambda a, b: rot.sixd_to_matrix(torch.cat((a, b), -1)), (x, y))
    assert check(lambda a: rot.axis_angle_to_quaternion(a, a[..., 0]), x)
    assert check(rot.direction_to_yaw, x)
    assert check(lambda a: rot.slerp(rot.exp_map(a[0]), rot.exp_map(a[1]), 0.3), x)
    assert check(lambda a, b: rot.quaternion_angle(rot.exp_map(a), rot.exp_map(b)), (x, y))
