"""Forward kinematics and facing of single frames in NumPy: torch is slow for a handful of joints."""

from __future__ import annotations

from collections.abc import Iterable

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
        self.feet = np.array(skeleton.feet())
        self._all = _Tree(skeleton, range(len(skeleton)))
        self._place = np.argsort(self._all.order)
        self._legs = _Tree(skeleton, {joint for foot in skeleton.feet() for joint in skeleton.chain(foot)})
        self._soles = np.nonzero(np.isin(self._legs.order, self.feet))[0]
        left, right = zip(*left_right_pairs(skeleton))
        self.left, self.right = np.array(left), np.array(right)

    def places(self, turns: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """Local quaternions [B, J, 4] and translations [B, J, 3] to positions [B, J, 3]."""
        return self._all.places(turns, translations)[:, self._place]

    def lowest_of(self, turns: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """`lowest` of `places`, by the joints from the root to the feet alone."""
        return self._legs.places(turns, translations)[:, self._soles, 1].min(1)

    def facing(self, places: np.ndarray) -> np.ndarray:
        """Yaw [B] in radians, as `motion.facing_of`."""
        across = places[:, self.left] - places[:, self.right]
        across = (across / np.linalg.norm(across, axis=-1, keepdims=True)).mean(1)
        return np.arctan2(-across[:, 2], across[:, 0])  # across x up, seen from above

    def lowest(self, places: np.ndarray) -> np.ndarray:
        """The height of the lower foot, [B]."""
        return places[:, self.feet, 1].min(1)


class _Tree:
    """Some joints of a skeleton, the root among them, in an order in which those of one depth stand together."""

    def __init__(self, skeleton: Skeleton, joints: Iterable[int]) -> None:
        depth = {joint: len(skeleton.chain(joint)) for joint in joints}
        order = sorted(depth, key=lambda joint: (depth[joint], joint))
        self.order, self._levels = np.array(order), []
        for level in sorted({*depth.values()})[1:]:
            own = [n for n, joint in enumerate(order) if depth[joint] == level]
            parents = [order.index(skeleton.parents[order[n]]) for n in own]
            self._levels.append((slice(own[0], own[-1] + 1), np.array(parents)))

    def places(self, turns: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """Forward kinematics, level by level: positions in the order of this tree."""
        turns, translations = turns[:, self.order], translations[:, self.order]
        local = np.empty((*turns.shape[:2], 3, 4), turns.dtype)  # rotation, and where it stands
        local[..., :3], local[..., 3] = matrices(turns), translations
        world = np.empty_like(local)
        world[:, 0] = local[:, 0]
        for own, parents in self._levels:
            above = world[:, parents]
            np.matmul(above[..., :3], local[:, own], out=world[:, own])
            world[:, own, :, 3] += above[..., 3]
        return world[..., 3]


def _squares() -> np.ndarray:
    """Of a quaternion's products w w, w x, ... z z, [16], how much goes into each entry of its matrix: [16, 9]."""
    ww, xx, yy, zz = (np.eye(16, dtype=np.float32)[5 * k] for k in range(4))
    wx, wy, wz, xy, xz, yz = (2 * np.eye(16, dtype=np.float32)[k] for k in (1, 2, 3, 6, 7, 11))
    down = ww + xx - yy - zz, ww - xx + yy - zz, ww - xx - yy + zz
    return np.stack((down[0], xy - wz, xz + wy, xy + wz, down[1], yz - wx, xz - wy, yz + wx, down[2]), 1)


_TURN = _squares()


def matrices(q: np.ndarray) -> np.ndarray:
    """Unit quaternions [..., 4] to matrices [..., 3, 3].

    >>> matrices(np.array([0.0, 0.0, 1.0, 0.0])).tolist()
    [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]
    """
    return ((q[..., :, None] * q[..., None, :]).reshape(*q.shape[:-1], 16) @ _TURN).reshape(*q.shape[:-1], 3, 3)


def turned(yaw: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places [B, J, 3] turned about the vertical by yaw [B].

    >>> turned(np.array([np.pi / 2]), np.array([[[0.0, 1.0, 2.0]]])).round(6).tolist()
    [[[2.0, 1.0, 0.0]]]
    """
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, z, found = places[..., 0], places[..., 2], places.copy()
    found[..., 0], found[..., 2] = c * x + s * z, c * z - s * x
    return found


_ASIDE = np.float32([-1, 1, 1, -1])  # what a quaternion's y z w x count in its product with the vertical


def yawed(yaw: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternions [B, 4] turned about the vertical by yaw [B].

    >>> yawed(np.array([np.pi]), np.array([[1.0, 0.0, 0.0, 0.0]])).round(6).tolist()
    [[0.0, 0.0, 1.0, 0.0]]
    """
    c, s = np.cos(yaw / 2)[:, None], np.sin(yaw / 2)[:, None]
    return c * q + s * (q[:, [2, 3, 0, 1]] * _ASIDE)
