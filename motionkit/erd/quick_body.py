"""Forward kinematics and facing of single frames in NumPy: torch is slow for a handful of joints."""

from __future__ import annotations

import numpy as np

from ..motion import left_right_pairs
from ..skeleton import Skeleton


class QuickBody:
    """A skeleton for B frames at once; all arrays are float32, quaternions w x y z.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> body = QuickBody(walk.skeleton)
    >>> places = body.places(walk.rotations.numpy(), walk.translations.numpy())
    >>> bool(abs(places - walk.positions().numpy()).max() < 1e-5)
    True
    """

    def __init__(self, skeleton: Skeleton) -> None:
        depth = [len(skeleton.chain(j)) for j in range(len(skeleton))]
        self.levels = []
        for level in range(2, max(depth) + 1):
            joints = [j for j in range(len(skeleton)) if depth[j] == level]
            self.levels.append((np.array(joints), np.array([skeleton.parents[j] for j in joints])))
        self.feet = np.array(skeleton.feet())
        left, right = zip(*left_right_pairs(skeleton))
        self.left, self.right = np.array(left), np.array(right)

    def places(self, turns: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """Local quaternions [B, J, 4] and translations [B, J, 3] to positions [B, J, 3]."""
        local = matrices(turns)
        world, places = np.empty_like(local), np.empty_like(translations)
        world[:, 0], places[:, 0] = local[:, 0], translations[:, 0]
        for joints, parents in self.levels:
            above = world[:, parents]
            world[:, joints] = above @ local[:, joints]
            places[:, joints] = places[:, parents] + (above @ translations[:, joints, :, None])[..., 0]
        return places

    def facing(self, places: np.ndarray) -> np.ndarray:
        """Yaw [B] in radians, as `motion.facing_of`."""
        across = places[:, self.left] - places[:, self.right]
        across = (across / np.linalg.norm(across, axis=-1, keepdims=True)).mean(1)
        return np.arctan2(-across[:, 2], across[:, 0])  # across x up, seen from above

    def lowest(self, places: np.ndarray) -> np.ndarray:
        """The height of the lower foot, [B]."""
        return places[:, self.feet, 1].min(1)


def matrices(q: np.ndarray) -> np.ndarray:
    """Unit quaternions [..., 4] to matrices [..., 3, 3].

    >>> matrices(np.array([0.0, 0.0, 1.0, 0.0])).tolist()
    [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]
    """
    double = 2 * q
    xx, yy, zz = (q[..., k] * double[..., k] for k in (1, 2, 3))
    xy, xz, yz = q[..., 1] * double[..., 2], q[..., 1] * double[..., 3], q[..., 2] * double[..., 3]
    wx, wy, wz = (q[..., 0] * double[..., k] for k in (1, 2, 3))
    rows = (1 - yy - zz, xy - wz, xz + wy, xy + wz, 1 - xx - zz, yz - wx, xz - wy, yz + wx, 1 - xx - yy)
    return np.stack(rows, -1).reshape(*q.shape[:-1], 3, 3)


def turned(yaw: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places [B, J, 3] turned about the vertical by yaw [B].

    >>> turned(np.array([np.pi / 2]), np.array([[[0.0, 1.0, 2.0]]])).round(6).tolist()
    [[[2.0, 1.0, 0.0]]]
    """
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y, z = places[..., 0], places[..., 1], places[..., 2]
    return np.stack((c * x + s * z, y, c * z - s * x), -1)


def yawed(yaw: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternions [B, 4] turned about the vertical by yaw [B].

    >>> yawed(np.array([np.pi]), np.array([[1.0, 0.0, 0.0, 0.0]])).round(6).tolist()
    [[0.0, 0.0, 1.0, 0.0]]
    """
    c, s = np.cos(yaw / 2), np.sin(yaw / 2)
    w, x, y, z = q[:, 0], q[:, 1], q[:, 2], q[:, 3]
    return np.stack((c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x), -1)
