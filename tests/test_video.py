"""A video through a pose estimator: MediaPipe's answers (acted here) become a motion; what is refused."""

import contextlib
from types import SimpleNamespace

import pytest

import motionkit as mk
from motionkit import video
from motionkit.actor import perform
from motionkit.video import motion_from_keypoints

NAMES = [f"{s}_{r}" for r in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for s in ("left", "right")]


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
        at = [motion.skeleton.names.index(name) for name in NAMES]
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
            PoseLandmark=[SimpleNamespace(name=name.upper()) for name in NAMES],
        )
        images = SimpleNamespace(Image=lambda *a: a, ImageFormat=SimpleNamespace(SRGB=1))
        films = SimpleNamespace(
            VideoCapture=lambda path: Film(frames, fps), CAP_PROP_FPS=5, cvtColor=lambda p, how: p, COLOR_BGR2RGB=4
        )
        monkeypatch.setattr(video, "_parts", lambda: (vision, SimpleNamespace(BaseOptions=dict), images, films))
        for name in ("walk.mp4", "model.task"):
            (tmp_path / name).write_bytes(b"x")
        return video.motion_from_video(tmp_path / "walk.mp4", tmp_path / "model.task")

    return play


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "old", seed=2, seconds=2.0).motion


def test_what_it_sees_is_the_motion_of_its_points(act, walk):
    sees = Landmarker(walk)
    found = act(sees)
    at = [walk.skeleton.names.index(name) for name in NAMES]
    wanted = motion_from_keypoints(-walk.positions()[:, at], NAMES, 30.0)
    assert float((found.positions() - wanted.positions()).abs().max()) < 1e-4
    assert (found.name, found.fps, len(found)) == ("walk", 30.0, 60)
    assert sees.times[:4] == [0, 33, 67, 100] and found.positions()[:, found.skeleton.names.index("head"), 1].min() > 1


def test_short_gaps_are_filled_and_long_ones_told(act, walk):
    whole = act(Landmarker(walk))
    for gaps in ({"gone": range(20, 26)}, {"unsure": range(20, 26)}):
        assert float((act(Landmarker(walk, **gaps)).positions() - whole.positions()).abs().max()) < 0.1
    with pytest.raises(mk.MotionKitError, match=r"missing from frame 20 to 39, 0\.67 s"):
        act(Landmarker(walk, unsure=range(20, 40)))


def test_bad_files_are_told(act, walk, tmp_path):
    with pytest.raises(mk.MotionKitError, match="no video that OpenCV can read"):
        act(Landmarker(walk), fps=0.0)
    with pytest.raises(mk.MotionKitError, match="found 2 frames"):
        act(Landmarker(walk), frames=2)
    with pytest.raises(mk.MotionKitError, match="download it anew"):
        act(Landmarker(walk), fails=RuntimeError("Unable to open zip archive."))
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
