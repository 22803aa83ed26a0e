"""Styles from videos: keypoints of a pose estimator to a motion, MediaPipe (acted here), and what is refused."""

import contextlib
import math
from types import SimpleNamespace

import pytest
import torch

import motionkit as mk
from motionkit import rotations as rot
from motionkit import video
from motionkit.actor import perform
from motionkit.video import fill_gaps, lowpass, motion_from_keypoints

COCO = [f"{s}_{r}" for r in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for s in ("left", "right")]


@pytest.fixture(scope="module")
def walk() -> mk.Motion:
    return perform("walk", "old", seed=2, seconds=4.0).motion


def seen(motion: mk.Motion, names: list[str]) -> torch.Tensor:
    return motion.positions()[:, [motion.skeleton.names.index(name) for name in names]]


def gap(found: mk.Motion, motion: mk.Motion) -> float:
    """How far limbs stand from where they were, seen from the pelvis and the facing, per metre of leg; mean."""
    pairs = []
    for m in (found, motion):
        local = m.positions() - m.positions()[:, m.skeleton.pelvis, None]
        local = rot.quaternion_rotate(rot.yaw_to_quaternion(-m.facing())[:, None].expand(*local.shape[:2], 4), local)
        limbs = local[:, [m.skeleton.names.index(name) for name in COCO]]
        leg = m.skeleton.offsets[[m.skeleton.names.index(f"left_{j}") for j in ("knee", "ankle")]].norm(dim=-1).sum()
        pairs.append(limbs / leg)
    return float((pairs[0] - pairs[1]).norm(dim=-1).mean())


def test_limbs_come_back(walk):
    found = motion_from_keypoints(seen(walk, COCO), COCO, 30, cutoff=10)
    assert gap(found, walk) < 0.08
    assert found.skeleton.same_tree(mk.skeleton.smpl()) and len(found) == len(walk)
    assert float(found.root_path().abs().max()) < 1e-3  # no global translation
    assert -0.05 < float(found.positions()[..., 1].min()) < 0.1


@pytest.mark.parametrize("up", [(0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
def test_any_axis_may_be_up(walk, up):
    points = seen(walk, COCO)
    turn = rot.rotation_between(torch.tensor([0.0, 1.0, 0.0]), torch.tensor(up))
    turned = 100 * rot.quaternion_rotate(turn.expand(*points.shape[:2], 4), points)  # and centimetres
    found, same = (motion_from_keypoints(p, COCO, 30) for p in (turned, points))
    assert gap(found, same) < 1e-3


def test_noise_is_taken_out(walk):
    points = seen(walk, COCO)
    noisy = points + 0.02 * torch.randn(points.shape, generator=torch.Generator().manual_seed(0))
    still = lowpass(noisy, 30)
    assert float((still - points).norm(dim=-1).mean()) < 0.75 * float((noisy - points).norm(dim=-1).mean())
    calm, raw = (mk.metrics.jitter(motion_from_keypoints(noisy, COCO, 30, cutoff=c)) for c in (3.0, 14.0))
    assert calm < 0.3 * raw


def test_butterworth_halves_the_power_at_its_cutoff_twice():
    """Each way lets half of the power through at the cut-off: forwards and back, half of the amplitude."""
    time = torch.arange(600) / 30
    for hertz, share in ((0.3, 1.0), (3.0, 0.5), (9.0, 0.0)):
        wave = torch.sin(2 * math.pi * hertz * time)[:, None]
        assert float(lowpass(wave, 30)[150:450].abs().max()) == pytest.approx(share, abs=0.03)


def test_short_gaps_are_filled_and_long_ones_refused(walk):
    points = seen(walk, COCO).clone()
    points[40:49, 2] = math.nan  # 0.3 s
    points[0, 3] = math.nan
    whole = fill_gaps(points, COCO, 30)
    assert whole.isfinite().all()
    assert torch.allclose(whole[44, 2], (5 * points[39, 2].double() + 5 * points[49, 2].double()) / 10, atol=1e-6)
    assert torch.equal(whole[0, 3], points[1, 3].double())
    assert gap(motion_from_keypoints(points, COCO, 30), motion_from_keypoints(seen(walk, COCO), COCO, 30)) < 0.02
    points[40:50, 2] = math.nan
    with pytest.raises(mk.MotionKitError, match=r"'left_knee' is missing from frame 40 to 49, 0.33 s"):
        motion_from_keypoints(points, COCO, 30)
    points[:, 2] = math.nan
    with pytest.raises(mk.MotionKitError, match="missing from frame 0"):
        motion_from_keypoints(points, COCO, 30)


@pytest.mark.parametrize(
    ("points", "names", "fps", "message"),
    [
        (torch.zeros(10, 12), COCO, 30, "expected keypoints"),
        (torch.zeros(10, 12, 2), COCO, 30, "expected keypoints"),
        (torch.zeros(2, 12, 3), COCO, 30, "3 frames or more"),
        (torch.zeros(10, 11, 3), COCO[:-1], 30, "no keypoint is called 'right_wrist'"),
        (torch.zeros(10, 12, 3), COCO, 5, "below half the frame rate"),
    ],
)
def test_bad_keypoints(points, names, fps, message):
    with pytest.raises(mk.MotionKitError, match=message):
        motion_from_keypoints(points, names, fps)


def test_a_style_from_keypoints(walk):
    """The whole way of paper 1, section 5.1: keypoints, motion, a style that is learned."""
    from motionkit.methods.few_shot import Config

    config = Config(steps=1, batch=1, pair_steps=5, loss_weights=(1.0, 0.0))
    method = mk.methods.load("few-shot", config=config)
    old = method.learn(motion_from_keypoints(seen(walk, COCO), COCO, 30), "an old person walks", title="")
    labels = mk.datasets.Labels(texts=("a person walks",))
    assert len(method.stylize(mk.load("data/actor/walk_neutral.bvh"), style=old, labels=labels)) == 120


class Film:
    """A video of so many pictures, as OpenCV opens it."""

    def __init__(self, frames, fps=30.0):
        self.left, self.fps = frames, fps

    def get(self, what):
        return self.fps

    def isOpened(self):  # noqa: N802
        return self.fps > 0

    def read(self):
        self.left -= 1
        return self.left >= 0, "picture"

    def release(self):
        self.left = 0


class Landmarker(contextlib.AbstractContextManager):
    """Sees a walk with Y downwards, as MediaPipe's world landmarks are; at some frames nobody, or not sure."""

    def __init__(self, motion, gone=(), unsure=()):
        at = [motion.skeleton.names.index(name) for name in COCO]
        self.points, self.gone, self.unsure, self.times = motion.positions()[:, at] * -1, gone, unsure, []

    def __exit__(self, *_):
        return None

    def detect_for_video(self, image, time):
        n = len(self.times)
        self.times.append(time)
        people = [[
            SimpleNamespace(x=float(p[0]), y=float(p[1]), z=float(p[2]), visibility=0.2 if n in self.unsure else 0.9)
            for p in self.points[n]
        ]]  # fmt: skip
        return SimpleNamespace(pose_world_landmarks=[] if n in self.gone else people)


@pytest.fixture
def act(monkeypatch, tmp_path):
    def play(landmarker, frames=60, fps=30.0, fails=None):
        def create(options):
            if fails:
                raise fails
            return landmarker

        vision = SimpleNamespace(
            PoseLandmarkerOptions=SimpleNamespace,
            RunningMode=SimpleNamespace(VIDEO="video"),
            PoseLandmarker=SimpleNamespace(create_from_options=create),
            PoseLandmark=[SimpleNamespace(name=name.upper()) for name in COCO],
        )
        images = SimpleNamespace(Image=lambda *a: a, ImageFormat=SimpleNamespace(SRGB=1))
        films = SimpleNamespace(
            VideoCapture=lambda path: Film(frames, fps), CAP_PROP_FPS=5, cvtColor=lambda p, how: p, COLOR_BGR2RGB=4
        )
        monkeypatch.setattr(
            video, "_import_packages", lambda: (vision, SimpleNamespace(BaseOptions=dict), images, films)
        )
        for name in ("walk.mp4", "model.task"):
            (tmp_path / name).write_bytes(b"x")
        return video.motion_from_video(tmp_path / "walk.mp4", tmp_path / "model.task")

    return play


@pytest.fixture(scope="module")
def short_walk():
    return perform("walk", "old", seed=2, seconds=2.0).motion


def test_what_it_sees_is_the_motion_of_its_points(act, short_walk):
    sees = Landmarker(short_walk)
    found = act(sees)
    at = [short_walk.skeleton.names.index(name) for name in COCO]
    wanted = motion_from_keypoints(-short_walk.positions()[:, at], COCO, 30.0)
    assert float((found.positions() - wanted.positions()).abs().max()) < 1e-4
    assert (found.name, found.fps, len(found)) == ("walk", 30.0, 60)
    assert sees.times[:4] == [0, 33, 67, 100] and found.positions()[:, found.skeleton.names.index("head"), 1].min() > 1


def test_short_gaps_are_filled_and_long_ones_told(act, short_walk):
    whole = act(Landmarker(short_walk))
    for gaps in ({"gone": range(20, 26)}, {"unsure": range(20, 26)}):
        assert float((act(Landmarker(short_walk, **gaps)).positions() - whole.positions()).abs().max()) < 0.1
    with pytest.raises(mk.MotionKitError, match=r"missing from frame 20 to 39, 0\.67 s"):
        act(Landmarker(short_walk, unsure=range(20, 40)))


def test_bad_files_are_told(act, short_walk, tmp_path):
    with pytest.raises(mk.MotionKitError, match="no video that OpenCV can read"):
        act(Landmarker(short_walk), fps=0.0)
    with pytest.raises(mk.MotionKitError, match="found 2 frames"):
        act(Landmarker(short_walk), frames=2)
    with pytest.raises(mk.MotionKitError, match="download it anew"):
        act(Landmarker(short_walk), fails=RuntimeError("Unable to open zip archive."))
    with pytest.raises(mk.MotionKitError, match="no such video"):
        video.motion_from_video(tmp_path / "none.mp4")
    with pytest.raises(mk.MotionKitError, match="no such model file; download one from https"):
        video.motion_from_video(tmp_path / "walk.mp4", tmp_path / "none.task")


def test_without_mediapipe_it_says_what_to_install(monkeypatch, tmp_path):
    def missing(name):
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(video.importlib, "import_module", missing)
    for name in ("walk.mp4", "model.task"):
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(mk.MotionKitError, match="pip install"):
        video.motion_from_video(tmp_path / "walk.mp4", tmp_path / "model.task")


def test_the_real_mediapipe_refuses_a_model_that_is_none(tmp_path):
    pytest.importorskip("mediapipe", reason="MediaPipe is not installed (pip install -e .[video])")
    cv2 = pytest.importorskip("cv2")
    film = cv2.VideoWriter(str(tmp_path / "v.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 30, (64, 64))
    for _ in range(10):
        film.write(__import__("numpy").zeros((64, 64, 3), "uint8"))
    film.release()
    (tmp_path / "m.task").write_bytes(b"hello" * 100)
    with pytest.raises(mk.MotionKitError, match="download it anew"):
        video.motion_from_video(tmp_path / "v.mp4", tmp_path / "m.task")
