"""Rotations: every conversion against scipy, and gradients that are finite and right."""

import itertools

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from motionkit import MotionKitError
from motionkit import rotations as rot

ORDERS = [a + b + c for a, b, c in itertools.product("XYZ", repeat=3) if a != b and b != c]
DTYPES = [torch.float32, torch.float64]
BATCHES = [(), (7,), (2, 3), (0,), (3, 0, 2)]
TOLERANCE = {torch.float32: 2e-6, torch.float64: 1e-12}
PI = torch.pi


def random_quaternions(*batch: int, dtype: torch.dtype = torch.float64, seed: int = 0) -> torch.Tensor:
    """Unit quaternions [*batch, 4] of either sign."""
    numbers = torch.randn(*batch, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return (numbers / numbers.norm(dim=-1, keepdim=True)).to(dtype)


def to_scipy(q: torch.Tensor) -> Rotation:
    """Quaternions [..., 4] w x y z to scipy's x y z w, [N]."""
    return Rotation.from_quat(q.detach().double().reshape(-1, 4)[:, [1, 2, 3, 0]].numpy())


def from_scipy(rotation: Rotation) -> torch.Tensor:
    return torch.from_numpy(rotation.as_quat())[..., [3, 0, 1, 2]]


def assert_same_rotation(a: torch.Tensor, b: torch.Tensor, tolerance: float) -> None:
    """Equal up to sign."""
    assert a.shape == b.shape
    a, b = a.double(), b.double()
    apart = torch.minimum((a - b).abs().amax(-1), (a + b).abs().amax(-1))
    assert not apart.numel() or apart.max() < tolerance, apart.max()


@pytest.fixture(params=DTYPES, ids=["float32", "float64"])
def dtype(request: pytest.FixtureRequest) -> torch.dtype:
    return request.param


# against scipy


def test_products_and_inverses_agree_with_scipy(dtype):
    a, b = random_quaternions(50, dtype=dtype), random_quaternions(50, dtype=dtype, seed=1)
    tolerance = TOLERANCE[dtype]
    product = rot.quaternion_multiply(a, b)
    assert_same_rotation(product, from_scipy(to_scipy(a) * to_scipy(b)), tolerance)
    assert_same_rotation(rot.quaternion_inverse(a), from_scipy(to_scipy(a).inv()), tolerance)
    angles = (to_scipy(a).inv() * to_scipy(b)).magnitude()
    assert np.allclose(rot.quaternion_angle(a, b).numpy(), angles, atol=10 * tolerance)


def test_rotated_vectors_agree_with_scipy(dtype):
    q = random_quaternions(50, dtype=dtype)
    v = torch.randn(50, 3, dtype=dtype, generator=torch.Generator().manual_seed(2))
    expected = to_scipy(q).apply(v.double().numpy())
    assert np.allclose(rot.quaternion_rotate(q, v).numpy(), expected, atol=5 * TOLERANCE[dtype])
    one = rot.quaternion_rotate(q[0], v)  # one rotation for many vectors
    assert np.allclose(one.numpy(), to_scipy(q[:1]).apply(v.double().numpy()), atol=5 * TOLERANCE[dtype])
    assert rot.quaternion_rotate(q, v[0]).shape == (50, 3)  # many rotations for one vector


def test_matrices_agree_with_scipy(dtype):
    q = random_quaternions(200, dtype=dtype)
    matrix = rot.quaternion_to_matrix(q)
    assert np.allclose(matrix.numpy(), to_scipy(q).as_matrix(), atol=TOLERANCE[dtype])
    again = rot.matrix_to_quaternion(matrix)
    assert_same_rotation(again, q, 2 * TOLERANCE[dtype])
    assert (again[:, 0] >= 0).all()


def test_matrices_of_half_turns_come_back(dtype):
    """Where w is 0 the usual formula divides by 0; each axis needs its own."""
    axes = torch.cat((torch.eye(3), torch.randn(20, 3, generator=torch.Generator().manual_seed(3)))).to(dtype)
    q = rot.axis_angle_to_quaternion(axes, torch.full((23,), PI, dtype=dtype))
    assert_same_rotation(rot.matrix_to_quaternion(rot.quaternion_to_matrix(q)), q, 2 * TOLERANCE[dtype])


def test_rotation_vectors_agree_with_scipy(dtype):
    q = random_quaternions(200, dtype=dtype)
    vector = rot.log_map(q)
    assert np.allclose(vector.numpy(), to_scipy(q).as_rotvec(), atol=5 * TOLERANCE[dtype])
    assert_same_rotation(rot.exp_map(vector), q, 2 * TOLERANCE[dtype])


@pytest.mark.parametrize("size", [0.0, 1e-30, 1e-9, 1e-6, 0.9e-4, 1.1e-4, 1e-2, 3.0, PI - 1e-3, PI, 5.0, 100.0])
def test_exponential_map_of_any_size_agrees_with_scipy(size, dtype):
    vector = rot.normalize(torch.tensor([[1.0, -2.0, 0.5], [0.0, 0.0, 1.0]], dtype=dtype)) * size
    expected = from_scipy(Rotation.from_rotvec(vector.double().numpy()))
    assert_same_rotation(rot.exp_map(vector), expected, TOLERANCE[dtype] * max(1.0, size))
    if size <= PI - 1e-3:
        back = rot.log_map(rot.exp_map(vector))
        assert torch.allclose(back, vector, rtol=50 * TOLERANCE[dtype], atol=50 * TOLERANCE[dtype] * size)


def test_axis_and_angle_come_back(dtype):
    q = random_quaternions(100, dtype=dtype)
    axis, angle = rot.quaternion_to_axis_angle(q)
    assert np.allclose(angle.numpy(), to_scipy(q).magnitude(), atol=5 * TOLERANCE[dtype])
    assert_same_rotation(rot.axis_angle_to_quaternion(3 * axis, angle), q, 5 * TOLERANCE[dtype])


def test_axis_and_angle_broadcast():
    many = torch.rand(5)
    x = torch.tensor([1.0, 0.0, 0.0])
    assert rot.axis_angle_to_quaternion(x, many).shape == (5, 4)
    assert rot.axis_angle_to_quaternion(x.expand(5, 3), many[0]).shape == (5, 4)


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_agree_with_scipy(order, dtype):
    angles = (torch.rand(100, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(4)) - 0.5) * 2 * PI
    q = rot.euler_to_quaternion(angles.to(dtype), order)
    assert_same_rotation(q, from_scipy(Rotation.from_euler(order, angles.numpy())), 2 * TOLERANCE[dtype])
    with_scipy = to_scipy(q).as_euler(order)
    apart = rot.wrap_angle(rot.quaternion_to_euler(q, order) - torch.from_numpy(with_scipy)).abs()
    assert apart.max() < 1e3 * TOLERANCE[dtype]  # angles are less exact close to gimbal lock


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_in_and_near_gimbal_lock_give_the_same_rotation(order, dtype):
    locks = (0.0, PI) if order[0] == order[2] else (PI / 2, -PI / 2)
    near = [0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3]
    middle = [lock + sign * n for lock in locks for sign in (1, -1) for n in near]
    grid = itertools.product((-2.5, 0.0, 0.7, PI), middle, (-1.3, 0.0, 3.0, -PI))
    q = rot.euler_to_quaternion(torch.tensor(list(grid), dtype=dtype), order)
    angles = rot.quaternion_to_euler(q, order)
    tolerance = 4e-6 if dtype == torch.float32 else 1e-11
    assert_same_rotation(rot.euler_to_quaternion(angles, order), q, tolerance)
    assert angles.abs().max() <= PI + 1e-6


def test_in_gimbal_lock_the_first_angle_is_zero():
    q = rot.euler_to_quaternion(torch.tensor([0.4, PI / 2, 0.3], dtype=torch.float64), "ZXY")
    first, middle, third = rot.quaternion_to_euler(q, "ZXY").tolist()
    assert (first, middle) == (0.0, pytest.approx(PI / 2))
    assert third == pytest.approx(0.7)  # Rz(a) Rx(90) Ry(c) turns by a + c about one axis


@pytest.mark.parametrize("order", ["", "XY", "XXY", "XYY", "XYZX", "ABC", "YXQ", None, 123])
def test_a_wrong_euler_order_is_refused(order):
    with pytest.raises(MotionKitError, match="Euler order .* is not one of the twelve"):
        rot.euler_to_quaternion(torch.zeros(3), order)
    with pytest.raises(MotionKitError, match="Euler order"):
        rot.quaternion_to_euler(rot.identity_quaternion(), order)


def test_slerp_agrees_with_scipy(dtype):
    a, b = random_quaternions(30, dtype=dtype), random_quaternions(30, dtype=dtype, seed=5)
    for n in range(30):
        times = torch.linspace(0, 1, 9, dtype=dtype)
        between = Slerp([0, 1], to_scipy(torch.stack((a[n], b[n]))))(times.double().numpy())
        assert_same_rotation(rot.slerp(a[n], b[n], times), from_scipy(between), 3 * TOLERANCE[dtype])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1.9e-4, 2.1e-4, 0.1, 3.0, PI - 1e-6, PI])
def test_slerp_has_constant_speed(angle, dtype):
    a = random_quaternions(dtype=dtype)
    b = rot.quaternion_multiply(a, rot.exp_map(torch.tensor([0.6, 0.0, 0.8], dtype=dtype) * angle))
    path = rot.slerp(a, -b, torch.linspace(0, 1, 11, dtype=dtype))
    steps = rot.quaternion_angle(path[:-1], path[1:])
    assert torch.allclose(steps, torch.full_like(steps, angle / 10), atol=TOLERANCE[dtype], rtol=1e-4)
    assert torch.allclose(path.norm(dim=-1), torch.ones(11, dtype=dtype))


def test_slerp_takes_times_of_any_shape_that_broadcasts():
    a, b = rot.identity_quaternion(1), rot.identity_quaternion(1)
    assert rot.slerp(a, b, torch.rand(5)).shape == (5, 4)
    assert rot.slerp(a[0], b[0], torch.rand(2, 5)).shape == (2, 5, 4)
    assert rot.slerp(a.expand(6, 3, 4), b, torch.rand(6, 1)).shape == (6, 3, 4)
    assert rot.slerp(a.double(), b.double(), 0.3).dtype == torch.float64


# directions


def test_between_turns_one_direction_into_the_other(dtype):
    u, v = torch.randn(2, 100, 3, dtype=dtype, generator=torch.Generator().manual_seed(6))
    q = rot.rotation_between(u, v)
    assert torch.allclose(rot.quaternion_rotate(q, rot.normalize(u)), rot.normalize(v), atol=4 * TOLERANCE[dtype])
    angle = torch.acos((rot.normalize(u) * rot.normalize(v)).sum(-1))
    assert torch.allclose(rot.quaternion_angle(rot.identity_quaternion(dtype=dtype), q), angle, atol=1e-3)


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_between_directions_that_are_opposite_or_nearly_so(apart, dtype):
    generator = torch.Generator().manual_seed(7)
    u = torch.cat((torch.eye(3), -torch.eye(3), torch.randn(20, 3, generator=generator))).to(dtype)
    v = -rot.normalize(u) + apart * torch.randn(26, 3, generator=generator).to(dtype)
    q = rot.rotation_between(u, v)
    assert torch.allclose(q.norm(dim=-1), torch.ones(26, dtype=dtype))
    turned = rot.quaternion_rotate(q, rot.normalize(u))
    assert torch.allclose(turned, rot.normalize(v), atol=4e-6 if dtype == torch.float32 else 1e-12)


def test_between_a_direction_and_nothing_does_not_turn():
    zero, x = torch.zeros(3), torch.tensor([1.0, 0.0, 0.0])
    for u, v in ((zero, x), (x, zero), (zero, zero)):
        assert torch.equal(rot.rotation_between(u, v), rot.identity_quaternion())


@pytest.mark.parametrize("size", [1e-37, 1e-25, 1.0, 1e25, 1e37])
def test_normalize_works_at_any_size(size):
    v = torch.tensor([[3.0, 0.0, 4.0], [0.0, -1.0, 0.0]]) * size
    assert torch.allclose(rot.normalize(v), torch.tensor([[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]]))


def test_swing_and_twist_make_up_the_rotation(dtype):
    q = random_quaternions(100, dtype=dtype)
    axis = rot.normalize(torch.tensor([1.0, 2.0, -1.0], dtype=dtype))
    swing, twist = rot.swing_twist(q, axis)
    assert_same_rotation(rot.quaternion_multiply(swing, twist), q, 3 * TOLERANCE[dtype])
    turned = torch.linalg.cross(twist[:, 1:], axis.expand(100, 3))
    assert turned.abs().max() < 3 * TOLERANCE[dtype]  # the twist turns about the axis
    assert (swing[:, 1:] * axis).sum(-1).abs().max() < 3 * TOLERANCE[dtype]  # and the swing not at all


def test_swing_and_twist_of_a_half_turn_aside():
    swing, twist = rot.swing_twist(torch.tensor([0.0, 1.0, 0.0, 0.0]), torch.tensor([0.0, 1.0, 0.0]))
    assert twist.tolist() == [1, 0, 0, 0]
    assert swing.tolist() == [0, 1, 0, 0]


def test_yaw_goes_there_and_back(dtype):
    yaw = torch.linspace(-3.14, 3.14, 41, dtype=dtype)
    q = rot.yaw_to_quaternion(yaw)
    assert_same_rotation(q, from_scipy(Rotation.from_euler("Y", yaw.double().numpy()[:, None])), TOLERANCE[dtype])
    assert torch.allclose(rot.quaternion_to_yaw(q), yaw, atol=3 * TOLERANCE[dtype])
    assert torch.allclose(rot.quaternion_to_yaw(-q), yaw, atol=3 * TOLERANCE[dtype])
    forward = rot.quaternion_rotate(q, torch.tensor([0.0, 0.0, 1.0], dtype=dtype))
    assert torch.allclose(rot.direction_to_yaw(forward), yaw, atol=3 * TOLERANCE[dtype])
    swing, twist = rot.swing_twist(random_quaternions(41, dtype=dtype), torch.tensor([0, 1, 0], dtype=dtype))
    whole = rot.quaternion_multiply(swing, twist)
    assert torch.allclose(rot.quaternion_to_yaw(whole), rot.quaternion_to_yaw(twist), atol=1e-4)


def test_wrapped_angles_are_the_same_angles():
    angles = torch.linspace(-20, 20, 101, dtype=torch.float64)
    wrapped = rot.wrap_angle(angles)
    assert wrapped.abs().max() <= PI
    turns = (angles - wrapped) / (2 * PI)
    assert torch.allclose(turns, turns.round())


# 6D


def test_6d_is_the_first_two_columns():
    q = random_quaternions(5)
    matrix = torch.from_numpy(to_scipy(q).as_matrix())
    expected = torch.cat((matrix[:, :, 0], matrix[:, :, 1]), -1)
    assert torch.allclose(rot.quaternion_to_sixd(q), expected)
    assert torch.allclose(rot.matrix_to_sixd(matrix), expected)
    assert_same_rotation(rot.sixd_to_quaternion(expected), q, 1e-12)


def assert_rotation_matrix(matrix: torch.Tensor, tolerance: float) -> None:
    eye = torch.eye(3, dtype=matrix.dtype).expand_as(matrix)
    assert torch.allclose(matrix @ matrix.mT, eye, atol=tolerance), matrix
    assert torch.allclose(torch.linalg.det(matrix), torch.ones((), dtype=matrix.dtype), atol=tolerance)


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=6, max_size=6))
@example([0.0, 0.0, 1e-45, 0.0, 0.0, 0.0])
def test_any_six_numbers_make_a_rotation(numbers):
    for dtype in DTYPES:
        matrix = rot.sixd_to_matrix(torch.tensor(numbers, dtype=dtype))
        assert_rotation_matrix(matrix, 1e-5 if dtype == torch.float32 else 1e-12)


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-7, 2e-6, 1e-5, 1e-3])
def test_six_numbers_of_two_almost_parallel_columns_make_a_rotation(apart, dtype):
    first, aside = torch.randn(2, 50, 3, dtype=dtype, generator=torch.Generator().manual_seed(8))
    matrix = rot.sixd_to_matrix(torch.cat((first, -2 * first + apart * aside), -1))
    assert_rotation_matrix(matrix, 1e-5 if dtype == torch.float32 else 1e-12)
    assert torch.allclose(matrix[..., 0], rot.normalize(first))


# signs, shapes, dtypes


def test_signs_are_chosen_without_changing_the_rotation():
    q = random_quaternions(40)
    assert_same_rotation(rot.quaternion_canonical(q), q, 1e-15)
    assert (rot.quaternion_canonical(q)[:, 0] >= 0).all()
    steps = rot.exp_map(torch.tensor([[0.1, 0.0, 0.02]]) * torch.arange(100)[:, None])[:, None].expand(100, 3, 4)
    signs = torch.where(torch.rand(100, 3, 1, generator=torch.Generator().manual_seed(9)) < 0.5, -1.0, 1.0)
    smooth = rot.quaternion_unroll(steps * signs)
    assert ((smooth[1:] * smooth[:-1]).sum(-1) > 0.99).all()
    assert_same_rotation(smooth, steps, 1e-6)
    assert torch.equal(smooth[0], (steps * signs)[0])


UNARY = {  # function, size of its last dimension, shape that it makes of it
    "normalize": (rot.normalize, 4, (4,)),
    "positive": (rot.quaternion_canonical, 4, (4,)),
    "quaternion_inverse": (rot.quaternion_inverse, 4, (4,)),
    "quaternion_to_matrix": (rot.quaternion_to_matrix, 4, (3, 3)),
    "quaternion_to_sixd": (rot.quaternion_to_sixd, 4, (6,)),
    "sixd_to_quaternion": (rot.sixd_to_quaternion, 6, (4,)),
    "exp_map": (rot.exp_map, 3, (4,)),
    "log_map": (rot.log_map, 4, (3,)),
    "quaternion_to_yaw": (rot.quaternion_to_yaw, 4, ()),
    "direction_to_yaw": (rot.direction_to_yaw, 3, ()),
    "euler_to_quaternion": (lambda x: rot.euler_to_quaternion(x, "ZYX"), 3, (4,)),
    "quaternion_to_euler": (lambda x: rot.quaternion_to_euler(x, "ZYX"), 4, (3,)),
    "quaternion_to_axis_angle": (lambda q: rot.quaternion_to_axis_angle(q)[0], 4, (3,)),
    "swing_twist": (lambda q: rot.swing_twist(q, torch.eye(3).to(q)[1])[1], 4, (4,)),
    "multiply": (lambda q: rot.quaternion_multiply(q, q), 4, (4,)),
    "angle": (lambda q: rot.quaternion_angle(q, q), 4, ()),
    "rotate": (lambda q: rot.quaternion_rotate(q, q[..., 1:]), 4, (3,)),
    "slerp": (lambda q: rot.slerp(q, q, 0.5), 4, (4,)),
    "between": (lambda v: rot.rotation_between(v, v), 3, (4,)),
    "perpendicular": (rot.perpendicular_to, 3, (3,)),
    "yaw_to_quaternion": (lambda v: rot.yaw_to_quaternion(v[..., 0]), 1, (4,)),
}


@pytest.mark.parametrize("name", UNARY)
def test_any_batch_dimensions_and_dtypes(name, dtype):
    function, size, shape = UNARY[name]
    whole = rot.normalize(torch.randn(2, 3, size, dtype=dtype, generator=torch.Generator().manual_seed(10)))
    for batch in BATCHES:
        result = function(whole[0, 0].expand(*batch, size))
        assert result.shape == (*batch, *shape)
        assert result.dtype == dtype
    together = function(whole)
    apart = torch.stack([torch.stack([function(v) for v in row]) for row in whole])
    assert torch.allclose(together, apart, atol=TOLERANCE[dtype])


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
