"""A person in a video as a motion to take a style from, by MediaPipe (`pip install -e .[video]`; an extra).

Paper 1, section 5.1, learns styles from videos; how places of joints become a motion is in `keypoints`.
"""

from __future__ import annotations

import importlib
import math
import os
from pathlib import Path

import torch
from torch import Tensor

from .errors import MotionKitError
from .keypoints import CUTOFF, motion_from_keypoints
from .motion import Motion

SURE = 0.5  # how visible a joint must be to count as seen
MODEL = "pose_landmarker_full.task"
MODEL_PAGE = "https://ai.google.dev/edge/mediapipe/solutions/vision/pose_landmarker"


def motion_from_video(
    path: str | os.PathLike, model: str | os.PathLike = MODEL, *, cutoff: float = CUTOFF, sure: float = SURE
) -> Motion:
    """The person in a video file as a motion in place, see `keypoints.motion_from_keypoints` (paper 1, section 5.1).

    model: MediaPipe's pose landmarker, a file with the suffix .task from its makers' page. cutoff: of the low-pass, Hz.
    sure: joints that are less visible than this, 0 to 1, count as not seen, and gaps of up to 0.3 s are filled. Raises
    MotionKitError without MediaPipe, for files that are not there or cannot be read, and for longer gaps.

    >>> motion_from_video("dance.mp4")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: ...
    """
    for name, file in (("video", Path(path)), ("model", Path(model))):
        if not file.is_file():
            hint = f"; download one from {MODEL_PAGE}" if name == "model" else ""
            raise MotionKitError(f"{file}: there is no such {name} file{hint}")
    points, names, fps = _seen(Path(path), Path(model), sure)
    return motion_from_keypoints(points, names, fps, cutoff=cutoff, name=Path(path).stem)


def _seen(path: Path, model: Path, sure: float) -> tuple[Tensor, list[str], float]:
    """Points [F, 33, 3] in metres, their names, and the frame rate."""
    vision, tasks, mediapipe, cv2 = _parts()
    film = cv2.VideoCapture(str(path))
    fps = float(film.get(cv2.CAP_PROP_FPS) or 0)
    if not film.isOpened() or not fps > 0:
        raise MotionKitError(f"{path}: this is no video that OpenCV can read; write it anew as MP4 (H.264)")
    options = vision.PoseLandmarkerOptions(
        base_options=tasks.BaseOptions(model_asset_path=str(model)), running_mode=vision.RunningMode.VIDEO
    )
    frames = []
    try:
        with vision.PoseLandmarker.create_from_options(options) as landmarker:
            while (read := film.read())[0]:
                image = mediapipe.Image(mediapipe.ImageFormat.SRGB, cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
                found = landmarker.detect_for_video(image, round(1000 * len(frames) / fps))
                frames.append(points_of(found.pose_world_landmarks, len(vision.PoseLandmark), sure))
    except (RuntimeError, ValueError) as error:
        raise MotionKitError(f"{model}: MediaPipe cannot use this model; download it anew ({error})") from error
    finally:
        film.release()
    if len(frames) < 3:
        raise MotionKitError(f"{path}: found {len(frames)} frames; a video of a second or more is needed")
    return torch.stack(frames), [one.name.lower() for one in vision.PoseLandmark], fps


def points_of(people: list, count: int, sure: float = SURE) -> Tensor:
    """The first person's places [count, 3], metres, NaN where less visible than `sure`; all NaN where nobody is.

    people: for each person a list of MediaPipe's landmarks, with x, y, z and visibility.

    >>> from types import SimpleNamespace
    >>> points_of([[SimpleNamespace(x=0.1, y=0.2, z=0.3, visibility=0.9)]], 1)
    tensor([[0.1000, 0.2000, 0.3000]])
    """
    if not people:
        return torch.full((count, 3), math.nan)
    rows = [(p.x, p.y, p.z) if (p.visibility or 0.0) >= sure else (math.nan,) * 3 for p in people[0]]
    return torch.tensor(rows, dtype=torch.float32)


def _parts() -> tuple:
    names = ("mediapipe.tasks.python.vision", "mediapipe.tasks.python", "mediapipe", "cv2")
    try:
        return tuple(importlib.import_module(name) for name in names)
    except ImportError as error:
        raise MotionKitError(f"a video needs MediaPipe: pip install -e .[video] ({error})") from error
