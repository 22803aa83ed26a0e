"""Forward kinematics: a chain done by hand, random trees against a plain loop, and the edges."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motionkit import MotionKitError, Skeleton, kinematics
from motionkit import rotations as rot

PI = torch.pi


def random_skeleton(joints: int, seed: int) -> Skeleton:
    """A random tree; parents come before their children, in no other order."""
    generator = torch.Generator().manual_seed(seed)
    parents = [-1] + [int(torch.randint(n, (), generator=generator)) for n in range(1, joints)]
    names = tuple(f"joint{n}" for n in range(joints))
    return Skeleton(names, tuple(parents), torch.randn(joints, 3, generator=generator))


def random_pose(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> tuple:
    """Rotations [*shape, 4] and translations [*shape, 3]."""
    generator = torch.Generator().manual_seed(seed)
    q = rot.normalize(torch.randn(*shape, 4, dtype=dtype, generator=generator))
    return q, torch.randn(*shape, 3, dtype=dtype, generator=generator)


def by_loop(skeleton: Skeleton, q: torch.Tensor, t: torch.Tensor) -> torch.Tensor:
    """One pose [J, 4] and [J, 3] with scipy's rotations, joint by joint."""
    turns, places = [], []
    for joint, parent in enumerate(skeleton.parents):
        turn = Rotation.from_quat(q[joint, [1, 2, 3, 0]].numpy())
        move = t[joint].numpy()
        places.append(move if parent < 0 else places[parent] + turns[parent].apply(move))
        turns.append(turn if parent < 0 else turns[parent] * turn)
    return torch.stack([torch.as_tensor(p) for p in places])


@pytest.fixture
def chain() -> Skeleton:
    """Root, elbow 2 m above it, hand 1 m above that."""
    offsets = torch.tensor([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 1.0, 0.0]])
    return Skeleton(("root", "elbow", "hand"), (-1, 0, 1), offsets)


def test_a_chain_of_three_by_hand(chain):
    z, x = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, 0.0])
    quarter = torch.tensor(PI / 2)
    q = torch.stack(
        (  # up turns to -x; then the forearm, about the x axis that now points up, to the world's z
            rot.axis_angle_to_quaternion(z, quarter),
            rot.axis_angle_to_quaternion(x, quarter),
            rot.identity_quaternion(),
        )
    )
    translations = chain.offsets.clone()
    translations[0] = torch.tensor([10.0, 0.0, 0.0])
    places = kinematics.forward_kinematics(chain, q, translations)
    assert torch.allclose(places, torch.tensor([[10.0, 0, 0], [8.0, 0, 0], [8.0, 0, 1.0]]), atol=1e-6)


@given(st.integers(1, 25), st.integers(0, 10**6))
@settings(max_examples=30)
def test_random_trees_agree_with_a_plain_loop(joints, seed):
    skeleton = random_skeleton(joints, seed)
    q, t = random_pose(3, joints, seed=seed)
    places = kinematics.forward_kinematics(skeleton, q, t)
    for n in range(3):
        assert torch.allclose(places[n], by_loop(skeleton, q[n], t[n]), atol=1e-12)


def test_float32_agrees_with_float64():
    skeleton = random_skeleton(22, 1)
    q, t = random_pose(50, 22)
    exact = kinematics.forward_kinematics(skeleton, q, t)
    single = kinematics.forward_kinematics(skeleton, q.float(), t.float())
    assert single.dtype == torch.float32
    assert torch.allclose(single.double(), exact, atol=2e-5)
    assert kinematics.forward_kinematics(skeleton, q.float(), t).dtype == torch.float64


@pytest.mark.parametrize("batch", [(), (4,), (2, 3), (0,), (2, 0), (2, 1, 3)])
def test_any_batch_dimensions(batch):
    skeleton = random_skeleton(6, 2)
    q, t = random_pose(*batch, 6)
    places = kinematics.forward_kinematics(skeleton, q, t)
    assert places.shape == (*batch, 6, 3)
    flat = kinematics.forward_kinematics(skeleton, q.reshape(-1, 6, 4), t.reshape(-1, 6, 3))
    assert torch.equal(places.reshape(-1, 6, 3), flat)
    world = kinematics.world_rotations(skeleton, q)
    assert world.shape == kinematics.local_rotations(skeleton, world).shape == q.shape


def test_one_set_of_offsets_serves_a_whole_batch():
    skeleton = random_skeleton(6, 3)
    q, _ = random_pose(2, 5, 6)
    offsets = skeleton.offsets.double()
    shared = kinematics.forward_kinematics(skeleton, q, offsets)
    assert torch.equal(shared, kinematics.forward_kinematics(skeleton, q, offsets.expand(2, 5, 6, 3)))


@pytest.mark.parametrize("frames", [0, 1, 6, 7, 8, 14, 15])
def test_chunks_change_nothing(frames, monkeypatch):
    skeleton = random_skeleton(9, 4)
    q, t = random_pose(frames, 9)
    whole = kinematics.forward_kinematics(skeleton, q, t)
    monkeypatch.setattr(kinematics, "_CHUNK", 7)
    assert torch.equal(kinematics.forward_kinematics(skeleton, q, t), whole)


def test_a_skeleton_of_one_joint_stands_where_its_root_is():
    skeleton = Skeleton(("root",), (-1,), torch.zeros(1, 3))
    q, t = random_pose(5, 1)
    assert torch.equal(kinematics.forward_kinematics(skeleton, q, t), t)
    assert torch.equal(kinematics.world_rotations(skeleton, q), q)


@given(st.integers(1, 25), st.integers(0, 10**6))
@settings(max_examples=30)
def test_rotations_in_the_world_go_there_and_back(joints, seed):
    skeleton = random_skeleton(joints, seed)
    q, t = random_pose(3, joints, seed=seed)
    world = kinematics.world_rotations(skeleton, q)
    assert torch.allclose(kinematics.local_rotations(skeleton, world), q, atol=1e-12)
    places = kinematics.forward_kinematics(skeleton, q, t)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:  # a joint lies where its parent's world rotation puts it
            bone = rot.quaternion_rotate(world[:, parent], t[:, joint])
            assert torch.allclose(places[:, joint] - places[:, parent], bone, atol=1e-12)


def test_gradients_are_right():
    skeleton = random_skeleton(7, 5)
    q, t = random_pose(2, 7)
    q.requires_grad_(), t.requires_grad_()

    def places(q, t):
        return kinematics.forward_kinematics(skeleton, rot.normalize(q), t)

    assert torch.autograd.gradcheck(places, (q, t))


def test_gradients_pass_through_chunks(monkeypatch):
    monkeypatch.setattr(kinematics, "_CHUNK", 2)
    skeleton = random_skeleton(4, 6)
    q, t = random_pose(5, 4)
    t.requires_grad_()
    kinematics.forward_kinematics(skeleton, q, t).sum().backward()
    assert (t.grad[:, 0] == 4).all()  # every joint moves along with the root


@pytest.mark.parametrize(
    "q, t", [((5, 3, 4), (5, 4, 3)), ((5, 4, 4), (5, 3, 3)), ((5, 4, 3), (5, 4, 3)), ((5, 4, 4), (5, 4, 4))]
)
def test_shapes_that_do_not_fit_are_refused(q, t):
    with pytest.raises(MotionKitError, match=r"expected rotations \[\.\.\., 4, 4\] and translations"):
        kinematics.forward_kinematics(random_skeleton(4, 7), torch.zeros(q), torch.zeros(t))
