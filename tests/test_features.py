"""Layouts: there and back, meaning of the numbers, HumanML3D against a decoder written from the published format."""

import numpy as np
import pytest
import torch

import motionkit as mk
from motionkit import rotations as rot
from motionkit.features import FacingFree, Graph, HumanML3D, Normalizer, SixD, StyleERD, motion_from_positions
from motionkit.features.canonical import canonicalize, forward_difference, integrate
from motionkit.skeleton import Skeleton, smpl

INVARIANT = [FacingFree, HumanML3D, StyleERD]
ALL = [*INVARIANT, SixD]


@pytest.fixture(scope="module")
def walk():
    return mk.load("data/actor/walk_turn_left_neutral.bvh")


@pytest.fixture(scope="module")
def long_walk(walk):
    """Ten seconds, turning all the time: three walks joined end to end."""
    parts = [walk]
    for _ in range(2):
        last = parts[-1][-1]
        place = last.root_path()[0]
        parts.append(walk.at_origin().transform(last.facing()[0], (float(place[0]), 0.0, float(place[1]))))
    return mk.concatenate(parts)[:300]


def aligned(motion, layout):
    """The motion as it stands after decoding: above the origin, facing +Z by the layout's own facing direction."""
    if isinstance(layout, HumanML3D):
        motion = motion.transform(-canonicalize(motion, 20.0).yaw[0])
        place = motion.root_path()[0]
        return motion.transform(offset=(-float(place[0]), 0.0, -float(place[1])))
    return motion if isinstance(layout, SixD) else motion.at_origin()


@pytest.mark.parametrize("make", ALL)
def test_ten_seconds_there_and_back_within_a_millimetre(long_walk, make, record_property):
    layout = make()
    x = layout.encode(long_walk)
    wanted = aligned(long_walk, layout).positions()
    drift = (layout.decode(x).positions() - wanted).norm(dim=-1).amax(1) * 1000
    direct = (layout.positions(x) - wanted).norm(dim=-1).amax(1) * 1000
    record_property("drift_mm", float(drift.max()))
    print(f"{make.__name__}: worst drift {float(drift.max()):.4f} mm, without rotations {float(direct.max()):.4f} mm")
    assert x.dtype == torch.float32 and x.shape == (300, layout.size)
    assert drift.max() < 1.0 and direct.max() < 1.0


def test_graph_there_and_back(long_walk):
    layout = Graph()
    x, path = layout.encode(long_walk), layout.trajectory(long_walk)
    assert x.shape == (300, 22, 7)
    assert (layout.decode(x, path).positions() - long_walk.positions()).abs().max() < 1e-3
    assert (layout.positions(x, path) - long_walk.positions()).abs().max() < 1e-3
    in_place = layout.decode(x)
    assert in_place.root_path().abs().max() < 1e-4 and in_place.facing().abs().max() < 1e-3


@pytest.mark.captures
@pytest.mark.parametrize("make", [*ALL, Graph])
def test_captures_there_and_back(captures_dir, make):
    for path in sorted(captures_dir.glob("*.bvh"))[::4]:
        motion = mk.load(path)
        layout = make()
        x = layout.encode(motion)
        back = layout.decode(x, layout.trajectory(motion)) if make is Graph else layout.decode(x)
        wanted = motion if make is Graph else aligned(motion, layout)
        assert (back.positions() - wanted.positions()).norm(dim=-1).max() < 1e-3, path.name


@pytest.mark.parametrize("make", INVARIANT)
def test_where_a_clip_stands_and_faces_does_not_matter(walk, make):
    moved = walk.transform(1.9, (4.0, 0.0, -7.0))
    assert torch.allclose(make().encode(walk), make().encode(moved), atol=2e-4)


def test_facing_free_numbers_mean_what_the_table_says(walk):
    layout = FacingFree()
    x = layout.encode(walk)
    assert layout.size == 4 + 21 * 3 + 22 * 6 == 199
    root = walk.positions()[:, 0]
    assert torch.allclose(x[:, 3], root[:, 1])
    yaw = walk.facing()
    assert torch.allclose(x[:-1, 0], rot.wrap_angle(yaw[1:] - yaw[:-1]), atol=1e-6)
    step = root[1:] - root[:-1]
    forward = step[:, 0] * torch.sin(yaw[:-1]) + step[:, 2] * torch.cos(yaw[:-1])
    assert torch.allclose(x[:-1, 2], forward, atol=1e-6) and (x[:, 2] > 0.01).all()
    head = walk.skeleton.index("head")
    number = next(n for n in range(199) if layout.joint_of(n) == head and "positions y" in layout.describe(n))
    assert torch.allclose(x[:, number], walk.positions()[:, head, 1] - root[:, 1], atol=1e-6)
    assert layout.describe(0) == "root yaw velocity (rad/frame)" and layout.describe(3) == "root height (m)"
    assert layout.describe(198) == f"rotations column 2 z of {walk.skeleton.names[-1]}"
    with pytest.raises(mk.MotionKitError, match="0 to 198"):
        layout.describe(199)


def recover_from_published_format(data, joints=22):
    """Joint places from HumanML3D vectors, in numpy, from the description of the published format."""
    half = np.concatenate(([0.0], np.cumsum(data[:-1, 0].astype(np.float64))))  # half the angle, world to body

    def to_world(v, angle):
        c, s = np.cos(2 * angle), np.sin(2 * angle)
        return np.stack((c * v[..., 0] - s * v[..., 2], v[..., 1], s * v[..., 0] + c * v[..., 2]), -1)

    step = np.zeros((len(data), 3))
    step[1:, [0, 2]] = data[:-1, 1:3]
    root = np.cumsum(to_world(step, half), 0)
    root[:, 1] = data[:, 3]
    local = data[:, 4 : 4 + 3 * (joints - 1)].reshape(len(data), joints - 1, 3)
    places = to_world(local, half[:, None])
    places[..., [0, 2]] += root[:, None, [0, 2]]
    return np.concatenate((root[:, None], places), 1)


def smpl_order(motion):
    return [motion.skeleton.names.index(n) for n in smpl().names]


def test_humanml3d_decodes_with_the_published_formulas(walk):
    slow = walk.resample(20)
    layout = HumanML3D()
    x = layout.encode(slow)
    assert x.shape[1] == 263 and [layout.slices[n].start for n in layout.slices] == [0, 4, 67, 193, 259]
    published = recover_from_published_format(x.numpy())
    ours = layout.positions(x)[:, smpl_order(slow)]
    assert np.abs(published - ours.numpy()).max() < 1e-4
    joints = slow.positions()[:, smpl_order(slow)].numpy()
    assert (
        np.abs(
            np.linalg.norm(np.diff(published, axis=0), axis=-1) - np.linalg.norm(np.diff(joints, axis=0), axis=-1)
        ).max()
        < 1e-4
    )


def test_humanml3d_file_from_elsewhere_decodes_without_a_skeleton(walk):
    """A vector as the published pipeline makes it (one frame less, SMPL's order), with nothing else at hand."""
    x = HumanML3D().encode(walk.resample(20))[:-1]
    fresh = HumanML3D()
    motion = fresh.decode(x)
    assert motion.fps == 20 and motion.skeleton.names == smpl().names
    gap = motion.positions().numpy() - recover_from_published_format(x.numpy())
    assert np.abs(gap).max() < 2e-3


def test_humanml3d_velocities_contacts_and_turning_sign(walk):
    slow = walk.resample(20)
    layout = HumanML3D()
    x = layout.encode(slow)
    speed = x[:-1, layout.slices["velocities"]].unflatten(1, (-1, 3)).norm(dim=-1)
    wanted = (slow.positions()[1:] - slow.positions()[:-1]).norm(dim=-1)[:, smpl_order(slow)]
    assert torch.allclose(speed, wanted, atol=1e-5)
    feet = [slow.skeleton.index(n) for n in ("left_ankle", "left_foot", "right_ankle", "right_foot")]
    still = (slow.positions()[1:, feet] - slow.positions()[:-1, feet]).square().sum(-1) < 0.002
    assert torch.equal(x[:-1, layout.slices["contacts"]].bool(), still) and still.any() and not still.all()
    assert x[:, 0].mean() < 0  # this clip turns left, and the format counts turns to the right
    assert (
        abs(float(-2 * x[:-1, 0].sum()) - float(canonicalize(slow, 20.0).yaw[-1] - canonicalize(slow, 20.0).yaw[0]))
        < 1e-4
    )


def test_humanml3d_rotations_rebuild_the_pose_from_the_root(walk):
    """Bone rotations, multiplied down a chain that starts at the root, point along the bones."""
    layout = HumanML3D()
    slow = walk.resample(20).at_origin()
    x = layout.encode(slow)
    turns = dict(
        zip(
            layout.order[1:],
            rot.sixd_to_quaternion(x[:, layout.slices["rotations"]].unflatten(1, (-1, 6))).unbind(1),
            strict=True,
        )
    )
    index = slow.skeleton.index
    yaw = canonicalize(slow, 20.0).yaw
    whole = rot.yaw_to_quaternion(-yaw)
    for name in ("left_hip", "left_knee", "left_ankle"):
        whole = rot.quaternion_multiply(whole, turns[index(name)])
    places = slow.positions()
    bone = rot.normalize(places[:, index("left_ankle")] - places[:, index("left_knee")])
    assert torch.allclose(rot.quaternion_rotate(whole, torch.tensor([0.0, -1.0, 0.0])), bone, atol=1e-4)


def test_style_erd_numbers(walk):
    layout = StyleERD()
    x = layout.encode(walk)
    assert x.shape[1] == 220
    q = x[:, layout.slices["rotations"]].unflatten(1, (-1, 4))
    assert torch.allclose(q.norm(dim=-1), torch.ones(len(walk), 22), atol=1e-5)
    places = walk.at_origin().positions()
    assert torch.allclose(
        integrate(x[:, layout.slices["velocities"]].unflatten(1, (-1, 3))[:, 0]), places[:, 0] - places[0, 0], atol=1e-4
    )


def test_layouts_refuse_what_does_not_fit(walk):
    layout = FacingFree()
    layout.encode(walk)
    with pytest.raises(mk.MotionKitError, match="resample"):
        layout.encode(walk.resample(60))
    with pytest.raises(mk.MotionKitError, match="make a layout for it"):
        layout.encode(mk.Motion.from_root(smpl().subtree([0]), rot.identity_quaternion(2, 1), torch.zeros(2, 3), 30))
    with pytest.raises(mk.MotionKitError, match=r"expects \[frames, 199\]"):
        layout.decode(torch.zeros(5, 263))
    with pytest.raises(mk.MotionKitError, match="no frames"):
        layout.encode(walk[:0])
    tail = Skeleton(("body", "tail"), (-1, 0), torch.tensor([[0.0, 0, 0], [0, 0, -1.0]]))
    snake = mk.Motion.from_root(tail, rot.identity_quaternion(5, 2), torch.zeros(5, 3), 30)
    with pytest.raises(mk.MotionKitError, match="person's feet"):
        HumanML3D().encode(snake)
    assert FacingFree().encode(snake).shape == (5, 4 + 3 + 12)


@pytest.mark.parametrize("make", [*ALL, Graph])
def test_single_frames_encode(walk, make):
    layout = make()
    x = layout.encode(walk[:1])
    assert len(layout.decode(x)) == 1 and torch.isfinite(x).all()


def test_motion_from_positions_keeps_lengths_and_places(walk):
    found = motion_from_positions(walk.positions(), walk.skeleton, 30)
    assert (found.positions() - walk.positions()).norm(dim=-1).max() < 1e-3
    bones = found.translations[:, 1:].norm(dim=-1)
    assert torch.allclose(bones, walk.skeleton.offsets[1:].norm(dim=-1).expand_as(bones), atol=1e-6)


def test_features_can_be_learnt_through(walk):
    x = FacingFree().encode(walk).requires_grad_()
    layout = FacingFree(walk.skeleton, 30)
    layout.decode(x).positions().square().mean().backward()
    assert torch.isfinite(x.grad).all() and x.grad.abs().sum() > 0


def test_forward_difference_and_integrate_undo_each_other():
    x = torch.randn(50, 3, generator=torch.Generator().manual_seed(0))
    assert torch.allclose(integrate(forward_difference(x)) + x[0], x, atol=1e-5)


def test_normalizer_saves_with_its_data_hash(walk, tmp_path):
    clips = [FacingFree().encode(walk), FacingFree().encode(walk.mirror())]
    n = Normalizer.fit(clips, "FacingFree")
    x = n.normalize(torch.cat(clips))
    assert x.mean(0).abs().max() < 1e-3 and (x.std(0, correction=0) - 1).abs()[n.std != 1].max() < 2e-2
    assert torch.allclose(n.denormalize(x), torch.cat(clips), atol=1e-5)
    again = Normalizer.load(n.save(tmp_path / "n.safetensors"), "FacingFree")
    assert torch.equal(again.mean, n.mean) and again.data_hash == n.data_hash
    assert Normalizer.fit(clips[:1], "FacingFree").data_hash != n.data_hash
    with pytest.raises(mk.MotionKitError, match="expected 'SixD'"):
        Normalizer.load(tmp_path / "n.safetensors", "SixD")
    (tmp_path / "cut").write_bytes((tmp_path / "n.safetensors").read_bytes()[:100])
    with pytest.raises(mk.MotionKitError, match="no whole normalizer"):
        Normalizer.load(tmp_path / "cut")
    with pytest.raises(mk.MotionKitError, match="at least one clip"):
        Normalizer.fit([], "x")


@pytest.mark.parametrize("make", [*ALL, Graph])
def test_tables_cover_every_number(walk, make):
    layout = make(walk.skeleton)
    rows = layout.rows()
    assert rows[0].start == 0 and all(a.stop == b.start for a, b in zip(rows, rows[1:], strict=False))
    assert all(layout.describe(n) for n in range(layout.size))
    assert all(r.name in layout.table() for r in rows)
