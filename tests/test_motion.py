"""Motion: what it refuses, cutting, reading at other times, moving, joining, and facing."""

import math

import pytest
import torch

from motionkit import Motion, MotionKitError, Skeleton, concatenate
from motionkit import rotations as rot
from motionkit.motion import facing_of, left_right_pairs

PI = torch.pi
# hips, spine, hips left and right, shoulders left and right, head: one body under many names
RIGS = {
    "smpl": "pelvis spine1 left_hip right_hip left_shoulder right_shoulder head",
    "mixamo": "mixamorig:Hips mixamorig:Spine mixamorig:LeftUpLeg mixamorig:RightUpLeg mixamorig:LeftArm "
    "mixamorig:RightArm mixamorig:Head",
    "cmu": "root lowerback lfemur rfemur lhumerus rhumerus head",
    "bandai": "Hips Spine UpperLeg_L UpperLeg_R UpperArm_L UpperArm_R Head",
}
PARENTS = (-1, 0, 0, 0, 1, 1, 1)
OFFSETS = [
    [0, 0.9, 0],
    [0, 0.3, 0],
    [0.1, -0.1, 0],
    [-0.1, -0.1, 0],
    [0.2, 0.2, 0],
    [-0.2, 0.2, 0],
    [0, 0.4, 0],
]


def body(names: str = RIGS["smpl"]) -> Skeleton:
    return Skeleton(tuple(names.split()), PARENTS, torch.tensor(OFFSETS))


def spinning(frames: int = 60, fps: float = 30.0, speed: float = 2.0) -> Motion:
    """A body that walks along +x at 1 m/s and turns about a slanted axis at `speed` radians a second."""
    time = torch.arange(frames, dtype=torch.float64) / fps
    axis = rot.normalize(torch.tensor([0.1, 1.0, 0.2], dtype=torch.float64))
    rotations = rot.identity_quaternion(frames, 7, dtype=torch.float64)
    rotations[:, 0] = rot.exp_map(axis * time[:, None] * speed)
    rotations[:, 1] = rot.exp_map(torch.tensor([0.0, 0.0, 1.0]) * time[:, None].sin())
    root = torch.stack((time, torch.ones_like(time), torch.zeros_like(time)), -1)
    return Motion.from_root(body(), rotations, root, fps, name="spin")


def same(a: Motion, b: Motion, tolerance: float = 1e-9) -> bool:
    return len(a) == len(b) and torch.allclose(a.positions(), b.positions(), atol=tolerance)


# construction


@pytest.mark.parametrize("what, shape", [("rotations", (60, 6, 4)), ("rotations", (60, 7, 3)), ("rotations", (60, 7))])
def test_wrong_shapes_are_refused(what, shape):
    with pytest.raises(MotionKitError, match=rf"expected {what} \[60, 7, 4\].*found"):
        spinning().replace(**{what: torch.zeros(shape)})


def test_translations_of_another_length_are_refused():
    m = spinning()
    with pytest.raises(MotionKitError, match=r"expected translations \[60, 7, 3\].*found \[59, 7, 3\]"):
        m.replace(translations=m.translations[:59])


@pytest.mark.parametrize("rotations", [torch.tensor(1.0), None, [[1, 0, 0, 0]]])
def test_what_is_no_tensor_of_frames_is_refused(rotations):
    with pytest.raises(MotionKitError, match="rotations"):
        spinning().replace(rotations=rotations)


def test_arrays_are_refused_with_the_way_out():
    m = spinning()
    with pytest.raises(MotionKitError, match=r"found a ndarray; convert it with torch.as_tensor"):
        m.replace(rotations=m.rotations.numpy())


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("what", ["rotations", "translations"])
def test_numbers_that_are_not_finite_are_refused_by_joint_and_frame(what, value):
    numbers = getattr(spinning(), what).clone()
    numbers[41, 3, 2] = value
    with pytest.raises(MotionKitError, match=f"{what} of joint 'right_hip' in frame 41 is not a finite number"):
        spinning().replace(**{what: numbers})


@pytest.mark.parametrize("fps", [0, -30, math.nan, math.inf])
def test_impossible_frame_rates_are_refused(fps):
    with pytest.raises(MotionKitError, match="fps must be between 0 and a million"):
        spinning().replace(fps=fps)


def test_a_motion_says_what_it_is():
    assert repr(spinning()) == "Motion('spin', 60 frames at 30 fps, 2.0 s, 7 joints)"


# slicing


@pytest.mark.parametrize("cut", [slice(10, 20), slice(None, None, -1), slice(None, None, 3), slice(-5, None)])
def test_slices_take_the_frames_that_a_list_would(cut):
    m = spinning()
    expected = list(range(60))[cut]
    assert torch.equal(m[cut].rotations, m.rotations[expected])
    assert torch.equal(m[cut].translations, m.translations[expected])
    assert m[cut].fps == 30 / abs(cut.step or 1)
    assert m[cut].name == "spin"


def test_every_second_frame_lasts_as_long():
    m = spinning()
    assert m[::2].duration == m.duration
    assert m[::-1].fps == m.fps
    assert same(m[::-1][::-1], m)


def test_slices_may_reach_beyond_the_ends():
    m = spinning()
    assert len(m[50:1000]) == 10
    assert len(m[100:]) == 0 and m[100:].positions().shape == (0, 7, 3)


def test_one_frame_by_number():
    m = spinning()
    for number in (5, -1, torch.tensor(3)):
        assert torch.equal(m[number].rotations, m.rotations[number][None])
    assert [len(frame) for frame in m[:4]] == [1, 1, 1, 1]


@pytest.mark.parametrize("frame", [60, -61, 1000])
def test_a_frame_that_is_not_there_is_refused(frame):
    with pytest.raises(MotionKitError, match=f"no frame {frame}; they go from 0 to 59"):
        spinning()[frame]


@pytest.mark.parametrize("cut", ["walk", 1.5, (1, 2), slice(None, None, 0)])
def test_other_cuts_are_refused(cut):
    with pytest.raises(MotionKitError, match="cut by frames"):
        spinning()[cut]


# reading at other times


@pytest.mark.parametrize("fps", [7, 24, 29.97, 60, 90, 120, 1000])
def test_resampled_rotations_keep_their_speed_and_times(fps):
    m = spinning()
    r = m.resample(fps)
    assert r.fps == fps
    assert len(r) == math.floor(59 / 30 * fps + 1e-6) + 1  # as many as fit between the first and last frame
    steps = rot.quaternion_angle(r.rotations[1:, 0], r.rotations[:-1, 0])
    axis_size = 1.0
    assert torch.allclose(steps, torch.full_like(steps, 2.0 * axis_size / fps), atol=1e-9)
    assert torch.allclose(r.translations[:, 0, 0], torch.arange(len(r)).double() / fps, atol=1e-9)


def test_there_and_back_is_the_same():
    m = spinning()
    assert same(m.resample(60).resample(30), m)
    assert same(m.resample(90)[::3], m)
    assert same(m.resample(30), m)


def test_resampling_takes_the_short_way_across_a_change_of_sign():
    m = spinning()
    flipped = m.rotations.clone()
    flipped[1::2] *= -1
    assert same(m.replace(rotations=flipped).resample(50), m.resample(50))


def test_resampling_the_shortest_motions():
    m = spinning()
    assert len(m[:1].resample(100)) == 1 and m[:1].resample(100).fps == 100
    assert len(m[:0].resample(100)) == 0 and m[:0].resample(100).fps == 100


def test_a_smooth_rate_goes_through_every_frame_and_has_no_corners():
    m = spinning()
    assert same(m.resample(60, smooth=True)[::2], m) and same(m.sample(torch.arange(60), smooth=True), m)
    assert same(m.sample(torch.tensor([-5.0, 99.0]), smooth=True), concatenate([m[0], m[-1]]))
    bend = torch.linspace(0, 3, 31, dtype=torch.float64)[:, None, None] ** 2 * torch.tensor([1.0, 0.0, 0.0])
    arc = m[:31].replace(translations=bend.expand(-1, m.translations.shape[1], -1))
    gap = (arc.resample(300, smooth=True).translations[:, 0, 0].sqrt() - torch.linspace(0, 3, 301).double()).abs()
    assert gap.max() < 1e-6 < (arc.resample(300).translations[:, 0, 0].sqrt() - torch.linspace(0, 3, 301)).abs().max()
    flipped = m.rotations.clone()
    flipped[1::2] *= -1
    assert same(m.replace(rotations=flipped).resample(50, smooth=True), m.resample(50, smooth=True))
    assert len(m[:1].resample(100, smooth=True)) == 1 and len(m[:2].resample(90, smooth=True)) == 4


@pytest.mark.parametrize("fps", [0, -1, math.nan])
def test_resampling_to_no_frame_rate_is_refused(fps):
    with pytest.raises(MotionKitError, match="cannot resample"):
        spinning().resample(fps)


def test_frames_between_frames():
    m = spinning()
    between = m.sample(torch.tensor([0.5, 10.0, 58.75]))
    assert torch.allclose(between.translations[:, 0, 0] * 30, torch.tensor([0.5, 10.0, 58.75], dtype=torch.float64))
    assert same(m.sample(torch.tensor([-5.0, 99.0])), concatenate([m[0], m[-1]]))
    with pytest.raises(MotionKitError, match="no frames to read"):
        m[:0].sample(torch.tensor([0.0]))


# moving


def test_moving_turns_about_the_origin_then_shifts():
    m = spinning()
    moved = m.transform(yaw=PI / 2, offset=(0.0, 0.5, 3.0))
    x, y, z = m.positions().unbind(-1)
    assert torch.allclose(moved.positions(), torch.stack((z, y + 0.5, -x + 3.0), -1), atol=1e-6)
    assert torch.allclose(
        rot.wrap_angle(moved.facing() - m.facing() - PI / 2), torch.zeros(60, dtype=torch.float64), atol=1e-6
    )


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_a_motion_at_the_origin_starts_above_it_facing_z(yaw):
    m = spinning().transform(yaw, (3.0, 0.0, -2.0))
    start = m.at_origin()
    assert start.facing()[0].abs() < 1e-6
    assert start.root_path()[0].abs().max() < 1e-6
    assert torch.allclose(start.positions()[..., 1], m.positions()[..., 1])  # height stays
    assert same(start, spinning().at_origin(), 1e-6)
    assert len(m[:0].at_origin()) == 0


def test_the_root_path_is_that_of_the_pelvis():
    names = ("Reference", "Hips", "LeftUpLeg", "RightUpLeg")
    s = Skeleton(names, (-1, 0, 1, 1), torch.tensor([[0.0, 0, 0], [0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0]]))
    m = Motion.from_root(s, rot.identity_quaternion(3, 4), torch.zeros(3, 3), 30)
    places = m.translations.clone()
    places[:, 1] = torch.tensor([[0.0, 1, 0], [0.5, 1, 1], [1, 1, 2]])
    assert m.replace(translations=places).root_path().tolist() == [[0, 0], [0.5, 1], [1, 2]]


def test_helper_joints_can_be_taken_off_and_put_back():
    names = ("Reference", "Hips", "LeftUpLeg", "RightUpLeg")
    s = Skeleton(names, (-1, 0, 1, 1), torch.tensor([[0.0, 0, 0], [0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0]]))
    generator = torch.Generator().manual_seed(0)
    q = rot.normalize(torch.randn(5, 4, 4, generator=generator))
    m = Motion(s, q, torch.randn(5, 4, 3, generator=generator), 30)
    alone = m.without_helper_joints()
    assert alone.skeleton.names == names[1:]
    assert torch.allclose(alone.positions(), m.positions()[:, 1:], atol=1e-5)
    assert same(m.with_helper_joints_of(alone), m, 1e-5)


# joining


def test_joined_clips_follow_each_other():
    m = spinning()
    assert same(concatenate([m[:20], m[20:50], m[50:]]), m)


def test_clips_that_do_not_fit_are_not_joined():
    m = spinning()
    with pytest.raises(MotionKitError, match="nothing to concatenate"):
        concatenate([])
    with pytest.raises(MotionKitError, match=r"resample\(30\) first"):
        concatenate([m, m.resample(60)])
    other = m.replace(skeleton=body(RIGS["cmu"]))
    with pytest.raises(MotionKitError, match="their skeletons differ"):
        concatenate([m, other])


# facing


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("yaw", [0.0, PI / 2, -3.0, 2.0])
def test_a_body_faces_where_it_was_turned_to(rig, yaw):
    s = body(RIGS[rig])
    assert left_right_pairs(s) == [(2, 3), (4, 5)]
    m = Motion.from_root(s, rot.identity_quaternion(4, 7), torch.zeros(4, 3), 30).transform(yaw)
    assert torch.allclose(m.facing(), torch.full((4,), yaw), atol=1e-5)


def test_facing_averages_hips_and_shoulders():
    m = Motion.from_root(body(), rot.identity_quaternion(1, 7), torch.zeros(1, 3), 30)
    twisted = m.rotations.clone()
    twisted[:, 1] = rot.yaw_to_quaternion(torch.tensor(0.6))  # the spine turns the shoulders, not the hips
    assert torch.allclose(m.replace(rotations=twisted).facing(), torch.tensor([0.3]), atol=1e-5)


def test_without_hips_and_shoulders_all_pairs_count():
    s = Skeleton(("body", "wing_l", "wing_r"), (-1, 0, 0), torch.tensor([[0.0, 1, 0], [1, 0, 0], [-1, 0, 0]]))
    m = Motion.from_root(s, rot.identity_quaternion(1, 3), torch.zeros(1, 3), 30).transform(1.2)
    assert torch.allclose(m.facing(), torch.tensor([1.2]))


def test_without_pairs_the_pelvis_tells():
    s = body("a b c d e f g")
    assert left_right_pairs(s) == []
    m = Motion.from_root(s, rot.identity_quaternion(2, 7), torch.zeros(2, 3), 30).transform(-1.2)
    assert torch.allclose(m.facing(), torch.tensor([-1.2, -1.2]))
    assert facing_of(s, m.positions()).tolist() == [0, 0]
