"""What all pictures share: which bones to draw, how thick, in which colour, and where each character stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MotionKitError, motion_inside
from . import colours

LAYOUTS = ("side", "treadmill", "overlay")


@dataclass(frozen=True, eq=False)
class Figure:
    """One character, ready to be drawn.

    points: [F, J, 3] float32, metres, where it stands in the picture. bones: pairs (parent, child). drawn: the joints
    that are seen, all but a root left on the ground. size: of the body, metres. radii: [J] metres. head: the joint
    that carries the head ball, or -1; head_radius: metres. colours: J `#rrggbb`. role: the colour of its label.
    left: [3] unit, the way its left hand points in the first frame, on the ground.
    """

    points: np.ndarray
    fps: float
    name: str
    names: tuple[str, ...]
    parents: tuple[int, ...]
    bones: tuple[tuple[int, int], ...]
    drawn: tuple[int, ...]
    size: float
    radii: np.ndarray
    head: int
    head_radius: float
    colours: tuple[str, ...]
    role: str
    left: np.ndarray

    def at(self, time: float) -> np.ndarray:
        """Joints [J, 3] at a time in seconds, between frames by straight lines, the ends held."""
        x = min(max(time * self.fps, 0.0), len(self.points) - 1.0)
        low = min(int(x), len(self.points) - 1)
        high = min(low + 1, len(self.points) - 1)
        return self.points[low] + (self.points[high] - self.points[low]) * np.float32(x - low)

    @property
    def end(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self.points) - 1) / self.fps


def as_list(motions: object) -> list:
    """One motion or several as a list; MotionKitError if there is nothing to show.

    >>> as_list([])
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nothing to show: expected a motion or a list of motions, found an empty list
    """
    found = list(motions) if isinstance(motions, (list, tuple)) else [motions]
    if not found:
        raise MotionKitError("nothing to show: expected a motion or a list of motions, found an empty list")
    for m in found:
        if not hasattr(m, "positions") or not hasattr(m, "skeleton"):
            hint = motion_inside(m) or "; read a file with motionkit.load(path)"
            raise MotionKitError(f"expected a Motion, found {type(m).__name__}{hint}")
        if len(m) == 0:
            raise MotionKitError(f"motion {m.name!r} has no frames; expected at least one to show")
    return found


def per_motion(values: Sequence | None, count: int, what: str) -> list:
    """`values` as a list with one entry for each motion, None for all where nothing is given.

    >>> per_motion(None, 2, "labels")
    [None, None]
    """
    if values is None:
        return [None] * count
    found = [values] if isinstance(values, str) else list(values)
    if len(found) != count:
        raise MotionKitError(f"{what}: expected {count}, one for each motion; found {len(found)}")
    return found


def figures(motions: object, *, roles: Sequence | None = None, layout: str = "side") -> list[Figure]:
    """Motions as figures: limbs by side, or shades of one colour where roles are given; placed by `layout`.

    layout: "side" stands them beside each other, from the right hand of the first one to its left; "treadmill" does,
    without their way over the floor, so that those who run do not run away; "overlay" leaves each where it is. The
    floor (y = 0) is left as it is.
    """
    found = as_list(motions)
    if layout not in LAYOUTS:
        raise MotionKitError(f"layout {layout!r}: expected one of {', '.join(LAYOUTS)}")
    roles = per_motion(roles, len(found), "roles")
    made = [_figure(m, role, n) for n, (m, role) in enumerate(zip(found, roles))]
    if layout == "treadmill":
        made = [_on_a_treadmill(figure) for figure in made]
    return _beside(made) if layout != "overlay" and len(made) > 1 else made


def _figure(motion: object, role: str | None, index: int) -> Figure:
    points = np.ascontiguousarray(motion.positions().detach().cpu().numpy(), dtype=np.float32)
    if not np.isfinite(points).all():
        frame = int(np.argwhere(~np.isfinite(points))[0][0])
        raise MotionKitError(f"motion {motion.name!r}: frame {frame} holds a position that is no number")
    skeleton = motion.skeleton
    parents, names = tuple(skeleton.parents), tuple(skeleton.names)
    bones = drawn_bones(points, parents)
    drawn = tuple(sorted({j for bone in bones for j in bone})) or tuple(range(len(parents)))
    height = size(points[:, drawn])
    head = _head(names, parents)
    colour = None if role is None else colours.role_colour(role)
    return Figure(
        points,
        float(motion.fps),
        motion.name,
        names,
        parents,
        bones,
        drawn,
        height,
        joint_radii(points, parents, bones, height),
        head,
        0.058 * height,
        tuple(colours.limb_colours(skeleton.sides, colour)),
        colours.role_colour(role, index),
        lefts(points[:1], skeleton.sides, parents)[0],
    )


def size(points: np.ndarray) -> float:
    """How large a body is, metres: its box's diagonal in a middling frame, 0.1 at the least. points: [F, J, 3]."""
    extent = points.max(axis=1) - points.min(axis=1)
    return max(float(np.median(np.linalg.norm(extent, axis=-1))) * 0.93, 0.1)


def drawn_bones(points: np.ndarray, parents: Sequence[int]) -> tuple[tuple[int, int], ...]:
    """Pairs (parent, child) to draw. points: [F, J, 3].

    A root on the ground, under the body or where the capture began, is a mark and no bone. It has one child, that child
    branches, and the root stays down while its child is well above it.
    """
    parents = list(parents)
    pairs = [(p, j) for j, p in enumerate(parents) if p >= 0]
    if parents.count(0) == 1:
        child = parents.index(0)
        height = size(points[:, 1:])
        low = points[:, 0, 1] - points[:, 1:, 1].min(axis=1)
        gap = points[:, child, 1] - points[:, 0, 1]
        if parents.count(child) > 1 and np.median(low) < 0.1 * height and np.median(gap) > 0.25 * height:
            pairs.remove((0, child))
    return tuple(pairs)


def joint_radii(
    points: np.ndarray, parents: Sequence[int], bones: Sequence[tuple[int, int]], height: float
) -> np.ndarray:
    """How thick the body is at each joint, [J] metres: thicker the more hangs on it, never more than half its bones."""
    count = len(parents)
    below = np.zeros(count)
    for j in range(count - 1, 0, -1):
        below[parents[j]] += below[j] + 1
    longest = np.zeros(count)
    for parent, child in bones:
        length = float(np.median(np.linalg.norm(points[:, child] - points[:, parent], axis=-1)))
        longest[[parent, child]] = np.maximum(longest[[parent, child]], length)
    radii = height * (0.015 + 0.0105 * np.log2(1 + below))
    radii = np.minimum(radii, np.where(longest > 0, 0.42 * longest, radii))
    return np.clip(radii, 0.006 * height, 0.065 * height).astype(np.float32)


def _head(names: Sequence[str], parents: Sequence[int]) -> int:
    """The joint that carries the head: named so, and nothing but a bone end (a crown, eyes, a jaw) beyond it."""
    found = [j for j, n in enumerate(names) if "head" in n.lower() and parents[j] >= 0]
    return found[0] if found else -1


def lefts(points: np.ndarray, sides: Sequence[str], parents: Sequence[int]) -> np.ndarray:
    """[F, 3] unit vectors on the floor to the body's left, frame by frame; +X without sides. points: [F, J, 3].

    Only joints where a limb meets the midline count: hands and feet swing back and forth.
    """
    met = [s != "middle" and (p < 0 or sides[p] == "middle") for s, p in zip(sides, parents)]
    is_left, is_right = (np.array([m and s == side for s, m in zip(sides, met)]) for side in ("left", "right"))
    across = np.tile(np.float32([1, 0, 0]), (len(points), 1))
    if is_left.any() and is_right.any():
        found = points[:, is_left].mean(axis=1) - points[:, is_right].mean(axis=1)
        found[:, 1] = 0
        length = np.linalg.norm(found, axis=-1, keepdims=True)
        across = np.where(length > 1e-4, found / np.maximum(length, 1e-4), across)
    return across.astype(np.float32)


def _on_a_treadmill(figure: Figure) -> Figure:
    """A figure without its way over the floor; what it sways within a second stays."""
    way = figure.points[:, figure.drawn].mean(axis=1) * np.float32([1, 0, 1])
    half = min(round(figure.fps / 2), len(way) - 1)
    longer = np.pad(way, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")  # goes on as it came
    sums = np.cumsum(np.concatenate((np.zeros_like(longer[:1]), longer)), axis=0, dtype=np.float64)
    smooth = (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
    return replace(figure, points=(figure.points - smooth[:, None]).astype(np.float32))


def _beside(made: list[Figure]) -> list[Figure]:
    """Figures moved so that they start on one line, a distance apart that follows from how wide they move."""
    across = made[0].left
    widths = []
    for f in made:
        sideways = f.points[:, f.drawn] @ across
        widths.append(float(np.clip(sideways.max() - sideways.min(), 0.62 * f.size, 1.15 * f.size)))
    step = 1.12 * max(widths)
    moved = []
    for n, f in enumerate(made):
        start = f.points[0, f.drawn].mean(axis=0) * np.float32([1, 0, 1])
        # The first stands at the left of a viewer who faces it, which is at its own right hand.
        place = across * np.float32(step * (n - (len(made) - 1) / 2))
        moved.append(replace(f, points=f.points - start + place))
    return moved
