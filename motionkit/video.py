"""What a pose estimator sees in a video, places of a person's joints, as a motion to take a style from.

Paper 1, section 5.1, learns styles from videos so: the places are smoothed, and where the person goes is left out.
"""

from __future__ import annotations

import importlib
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from scipy.signal import butter, sosfiltfilt
from torch import Tensor

from . import rotations as rot
from .errors import MotionKitError
from .features.canonical import motion_from_positions
from .motion import Motion
from .skeleton import LEFT, RIGHT, Skeleton, find_roles, smpl, words

CUTOFF = 3.0  # Hz (paper 1, section 5.1)
SURE = 0.5  # how visible a joint must be to count as seen
MODEL = "pose_landmarker_full.task"
MODEL_PAGE = "https://ai.google.dev/edge/mediapipe/solutions/vision/pose_landmarker"
_LONGEST_GAP = 0.3  # seconds
SIDES = (LEFT, RIGHT)
_NEEDED = tuple(f"{s}_{r}" for r in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for s in SIDES)
_TOES = 0.12  # of the leg: how far in front of the ankle a toe stands where no estimator saw it


def motion_from_keypoints(
    points: Tensor, names: Sequence[str], fps: float, *, cutoff: float = CUTOFF, name: str = ""
) -> Motion:
    """A motion in place on SMPL's skeleton, from keypoints (paper 1, section 5.1).

    points: [F, J, 3] in any unit, any axis up; NaN where nothing was seen. names: of the J points, as the estimator
    calls them (`left_hip`, `LEFT_HIP`, `LHip`): hips, knees, ankles, shoulders, elbows and wrists must be there; toes
    and a nose or head help. fps: of the video. cutoff: of the Butterworth low-pass, Hz. Gaps of up to 0.3 s are filled
    in straight lines. The person is 1.75 m tall, stays above the origin and has a foot on the ground; at first they
    face +Z. Raises MotionKitError for other shapes, points that are missing, and longer gaps.

    >>> from motionkit.actor import perform
    >>> walk = perform("walk", "old", seed=1, seconds=2.0).motion
    >>> motion_from_keypoints(walk.positions(), walk.skeleton.names, fps=30, name="seen")
    Motion('seen', 60 frames at 30 fps, 2.0 s, 22 joints)
    """
    points, roles = _checked(points, names, fps, cutoff)
    points = lowpass(fill_gaps(points, names, fps), fps, cutoff)
    points = _upright(points, roles)
    skeleton = smpl()
    places = _as_smpl(points, roles, list(names), skeleton)
    motion = motion_from_positions(places.float(), skeleton, fps, name=name)
    return _standing(motion).at_origin()


def fill_gaps(points: Tensor, names: Sequence[str], fps: float) -> Tensor:
    """Keypoints [F, J, 3] with gaps (NaN) filled in straight lines, at the ends by the nearest frame; float64.

    Raises MotionKitError for a gap over 0.3 s, and names joint and frames.

    >>> seen = torch.tensor([[[0.0, 0, 0]], [[math.nan, 0, 0]], [[2.0, 0, 0]]])
    >>> fill_gaps(seen, ["nose"], fps=30)[1, 0]
    tensor([1., 0., 0.], dtype=torch.float64)
    """
    points = points.detach().double().clone()
    visible, frames = points.isfinite().all(-1).numpy(), np.arange(len(points))
    for joint in np.flatnonzero(~visible.all(0)):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], ~visible[:, joint], [0])).astype(int)))
        for start, stop in zip(edges[::2], edges[1::2]):
            if stop - start > _LONGEST_GAP * fps + 1e-6:
                seconds = (stop - start) / fps
                raise MotionKitError(
                    f"keypoint {names[joint]!r} is missing from frame {start} to {stop - 1}, {seconds:.2f} s; gaps "
                    f"of up to {_LONGEST_GAP:g} s are filled: cut the clip there"
                )
        known = visible[:, joint]
        for axis in range(3):
            row = np.interp(frames, frames[known], points[known, joint, axis].numpy())
            points[:, joint, axis] = torch.from_numpy(row)
    return points


def lowpass(points: Tensor, fps: float, cutoff: float = CUTOFF) -> Tensor:
    """Numbers over time [F, ...] through a second-order Butterworth low-pass, forwards and back (paper 1, section 5.1).

    cutoff: Hz, below half the frame rate. Nothing is delayed.

    >>> still = torch.ones(30, 1)
    >>> bool(torch.allclose(lowpass(still, fps=30), still.double()))
    True
    """
    sections = butter(2, cutoff, fs=fps, output="sos")
    pad = min(len(points) - 1, max(9, round(fps)))
    return torch.from_numpy(sosfiltfilt(sections, points.double().numpy(), axis=0, padlen=pad).copy())


def _checked(points: Tensor, names: Sequence[str], fps: float, cutoff: float) -> tuple[Tensor, dict[str, int]]:
    points = torch.as_tensor(points)
    if points.ndim != 3 or points.shape[1:] != (len(names), 3) or len(points) < 3:
        raise MotionKitError(f"expected keypoints [frames, {len(names)}, 3], 3 frames or more; found {[*points.shape]}")
    if not (isinstance(fps, int | float) and 0 < cutoff < fps / 2 < math.inf):
        raise MotionKitError(f"cutoff must be above 0 and below half the frame rate; found {cutoff} Hz at {fps} fps")
    roles = find_roles(names)
    missing = [role for role in _NEEDED if role not in roles]
    if missing:
        raise MotionKitError(
            f"no keypoint is called {missing[0]!r}, or by a name like it; found {', '.join(names)}: name the joints of "
            "legs and arms so"
        )
    return points, roles


def _middle(points: Tensor, roles: dict[str, int], role: str) -> Tensor:
    return (points[:, roles[f"left_{role}"]] + points[:, roles[f"right_{role}"]]) / 2


def _upright(points: Tensor, roles: dict[str, int]) -> Tensor:
    """Turned so that the axis which the trunk is nearest to is +Y: cameras have Y downwards, some files Z up."""
    trunk = (_middle(points, roles, "shoulder") - _middle(points, roles, "ankle")).mean(0)
    axis = int(trunk.abs().argmax())
    up = torch.zeros(3, dtype=points.dtype)
    up[axis] = trunk[axis].sign()
    turn = rot.rotation_between(up, torch.tensor([0.0, 1.0, 0.0], dtype=points.dtype))
    return rot.quaternion_rotate(turn.expand(*points.shape[:2], 4), points)


def _as_smpl(points: Tensor, roles: dict[str, int], names: list[str], skeleton: Skeleton) -> Tensor:
    """Places of SMPL's joints [F, 22, 3], as large as its skeleton, the pelvis at the origin."""
    leg = sum((points[:, roles[f"{s}_{a}"]] - points[:, roles[f"{s}_{b}"]]).norm(dim=-1).mean()
              for s in SIDES for a, b in (("hip", "knee"), ("knee", "ankle")))  # fmt: skip
    number = {name: n for n, name in enumerate(skeleton.names)}
    smpl_leg = sum(skeleton.offsets[number[f"{s}_{j}"]].norm() for s in SIDES for j in ("knee", "ankle"))
    pelvis, neck = _middle(points, roles, "hip"), _middle(points, roles, "shoulder")
    scale = float(smpl_leg / leg)
    scaled = scale * (points - pelvis[:, None])
    up, across = scale * (neck - pelvis), scaled[:, roles["left_hip"]] - scaled[:, roles["right_hip"]]
    ahead = rot.normalize(torch.linalg.cross(across, up))
    places = torch.zeros(len(points), len(skeleton), 3, dtype=points.dtype)
    rest = skeleton.offsets.double()

    def height(joint: str) -> float:  # above the pelvis at rest
        return float(sum(rest[j, 1] for j in skeleton.ancestors(number[joint])[:-1]))

    for joint in ("spine1", "spine2", "spine3", "neck"):  # as shares of the way from hips to shoulders
        places[:, number[joint]] = up * min(height(joint) / height("left_shoulder"), 1.1)
    for side in SIDES:
        for role in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"):
            places[:, number[f"{side}_{role}"]] = scaled[:, roles[f"{side}_{role}"]]
        ankle, toe = roles[f"{side}_ankle"], roles.get(f"{side}_toe")
        if toe in (None, ankle):
            places[:, number[f"{side}_foot"]] = scaled[:, ankle] + _TOES * ahead - 0.06 * rot.normalize(up)
        else:
            places[:, number[f"{side}_foot"]] = scaled[:, toe]
        collar = 0.3 * scaled[:, roles[f"{side}_shoulder"]] + 0.7 * places[:, number["neck"]]
        places[:, number[f"{side}_collar"]] = collar
    skull = next((n for n, name in enumerate(names) if words(name) in (["head"], ["nose"])), None)
    above_neck = places[:, number["neck"]] + 0.25 * up
    places[:, number["head"]] = above_neck if skull is None else scaled[:, skull]
    return places


def _standing(motion: Motion) -> Motion:
    """The motion in place: the pelvis above the origin, as high as the lower foot needs it to stand on the ground."""
    local = motion.positions() - motion.positions()[:, :1]
    feet = [j for j, name in enumerate(motion.skeleton.names) if name.endswith("foot")]
    root = torch.zeros(len(motion), 3)
    root[:, 1] = -local[:, feet, 1].amin(1) + 0.02
    return Motion.from_root(motion.skeleton, motion.rotations, root, motion.fps, name=motion.name)


def motion_from_video(
    path: str | os.PathLike, model: str | os.PathLike = MODEL, *, cutoff: float = CUTOFF, sure: float = SURE
) -> Motion:
    """The person in a video file as a motion in place, see `video.motion_from_keypoints` (paper 1, section 5.1).

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
    points, names, fps = _landmarks(Path(path), Path(model), sure)
    return motion_from_keypoints(points, names, fps, cutoff=cutoff, name=Path(path).stem)


def _landmarks(path: Path, model: Path, sure: float) -> tuple[Tensor, list[str], float]:
    """Points [F, 33, 3] in metres, their names, and the frame rate."""
    vision, tasks, mediapipe, cv2 = _import_packages()
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
                result = landmarker.detect_for_video(image, round(1000 * len(frames) / fps))
                frames.append(points_of(result.pose_world_landmarks, len(vision.PoseLandmark), sure))
    except (RuntimeError, ValueError) as error:
        raise MotionKitError(f"{model}: MediaPipe cannot use this model; download it anew ({error})") from error
    finally:
        film.release()
    if len(frames) < 3:
        raise MotionKitError(f"{path}: found {len(frames)} frames; a video of a second or more is needed")
    return torch.stack(frames), [landmark.name.lower() for landmark in vision.PoseLandmark], fps


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


def _import_packages() -> tuple:
    names = ("mediapipe.tasks.python.vision", "mediapipe.tasks.python", "mediapipe", "cv2")
    try:
        return tuple(importlib.import_module(name) for name in names)
    except ImportError as error:
        raise MotionKitError(f"a video needs MediaPipe: pip install -e .[video] ({error})") from error
