"""Motions as figures ready to be drawn: bones, sizes and places; drawn with matplotlib, or packed for the browser."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MotionKitError, motion_inside
from .colours import CONTACT, ROLES, limb_colours, mix, role_colour

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
    shown = list(motions) if isinstance(motions, (list, tuple)) else [motions]
    if not shown:
        raise MotionKitError("nothing to show: expected a motion or a list of motions, found an empty list")
    for m in shown:
        if not hasattr(m, "positions") or not hasattr(m, "skeleton"):
            hint = motion_inside(m) or "; read a file with motionkit.load(path)"
            raise MotionKitError(f"expected a Motion, found {type(m).__name__}{hint}")
        if len(m) == 0:
            raise MotionKitError(f"motion {m.name!r} has no frames; expected at least one to show")
    return shown


def per_motion(values: Sequence | None, count: int, what: str) -> list:
    """`values` as a list with one entry for each motion, None for all where nothing is given.

    >>> per_motion(None, 2, "labels")
    [None, None]
    """
    if values is None:
        return [None] * count
    entries = [values] if isinstance(values, str) else list(values)
    if len(entries) != count:
        raise MotionKitError(f"{what}: expected {count}, one for each motion; found {len(entries)}")
    return entries


def label_texts(motions: object, labels: Sequence | None, roles: Sequence | None) -> list:
    """A text or None for each motion: the labels given; left out, the role or name where there are several."""
    shown = as_list(motions)
    texts = per_motion(labels, len(shown), "labels")
    if labels is not None or len(shown) == 1:
        return texts
    return [role if role in ROLES else m.name for m, role in zip(shown, per_motion(roles, len(shown), "roles"))]


def figures(motions: object, *, roles: Sequence | None = None, layout: str = "side") -> list[Figure]:
    """Motions as figures: limbs by side, or shades of one colour where roles are given; placed by `layout`.

    layout: "side" stands them beside each other, from the right hand of the first one to its left; "treadmill" does,
    without their way over the floor, so that those who run do not run away; "overlay" leaves each where it is. The
    floor (y = 0) is left as it is.
    """
    shown = as_list(motions)
    if layout not in LAYOUTS:
        raise MotionKitError(f"layout {layout!r}: expected one of {', '.join(LAYOUTS)}")
    roles = per_motion(roles, len(shown), "roles")
    bodies = [_figure(m, role, n) for n, (m, role) in enumerate(zip(shown, roles))]
    if layout == "treadmill":
        bodies = [_on_a_treadmill(figure) for figure in bodies]
    return _beside(bodies) if layout != "overlay" and len(bodies) > 1 else bodies


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
    colour = None if role is None else role_colour(role)
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
        tuple(limb_colours(skeleton.sides, colour)),
        role_colour(role, index),
        left_mask(points[:1], skeleton.sides, parents)[0],
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
    heads = [j for j, n in enumerate(names) if "head" in n.lower() and parents[j] >= 0]
    return heads[0] if heads else -1


def left_mask(points: np.ndarray, sides: Sequence[str], parents: Sequence[int]) -> np.ndarray:
    """[F, 3] unit vectors on the floor to the body's left, frame by frame; +X without sides. points: [F, J, 3].

    Only joints where a limb meets the midline count: hands and feet swing back and forth.
    """
    met = [s != "middle" and (p < 0 or sides[p] == "middle") for s, p in zip(sides, parents)]
    is_left, is_right = (np.array([m and s == side for s, m in zip(sides, met)]) for side in ("left", "right"))
    across = np.tile(np.float32([1, 0, 0]), (len(points), 1))
    if is_left.any() and is_right.any():
        across_body = points[:, is_left].mean(axis=1) - points[:, is_right].mean(axis=1)
        across_body[:, 1] = 0
        length = np.linalg.norm(across_body, axis=-1, keepdims=True)
        across = np.where(length > 1e-4, across_body / np.maximum(length, 1e-4), across)
    return across.astype(np.float32)


def _on_a_treadmill(figure: Figure) -> Figure:
    """A figure without its way over the floor; what it sways within a second stays."""
    way = figure.points[:, figure.drawn].mean(axis=1) * np.float32([1, 0, 1])
    half = min(round(figure.fps / 2), len(way) - 1)
    longer = np.pad(way, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")  # goes on as it came
    sums = np.cumsum(np.concatenate((np.zeros_like(longer[:1]), longer)), axis=0, dtype=np.float64)
    smooth = (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
    return replace(figure, points=(figure.points - smooth[:, None]).astype(np.float32))


def _beside(bodies: list[Figure]) -> list[Figure]:
    """Figures moved so that they start on one line, a distance apart that follows from how wide they move."""
    across = bodies[0].left
    widths = []
    for f in bodies:
        sideways = f.points[:, f.drawn] @ across
        widths.append(float(np.clip(sideways.max() - sideways.min(), 0.62 * f.size, 1.15 * f.size)))
    step = 1.12 * max(widths)
    moved = []
    for n, f in enumerate(bodies):
        start = f.points[0, f.drawn].mean(axis=0) * np.float32([1, 0, 1])
        # The first stands at the left of a viewer who faces it, which is at its own right hand.
        place = across * np.float32(step * (n - (len(bodies) - 1) / 2))
        moved.append(replace(f, points=f.points - start + place))
    return moved


# Seen from this far round the character's front (radians, towards its left) and this far above.
TURN, RISE = 0.62, 0.16


def view_axes(left: np.ndarray, turn: float = TURN, rise: float = RISE) -> np.ndarray:
    """[3, 3]: the picture's right, up and towards-the-viewer directions, for a character whose left is `left`."""
    front = np.array([-left[2], 0.0, left[0]])
    back = np.cos(turn) * front + np.sin(turn) * left
    right = np.cos(turn) * left - np.sin(turn) * front
    up = np.array([0.0, 1.0, 0.0])
    rows = [right, np.cos(rise) * up - np.sin(rise) * back, np.cos(rise) * back + np.sin(rise) * up]
    return np.stack(rows).astype(np.float32)


def cone_outline(a: np.ndarray, b: np.ndarray, ra: float, rb: float) -> np.ndarray:
    """Outline [N, 2] of two discs and the band that touches both.

    >>> cone_outline(np.zeros(2), np.array([0.0, 2.0]), 1.0, 1.0).max(axis=0).round(2).tolist()
    [1.0, 3.0]
    """
    d = b - a
    length = float(np.hypot(*d))
    if length <= abs(ra - rb) or length < 1e-9:
        centre, r = (a, ra) if ra >= rb else (b, rb)
        t = np.linspace(0, 2 * np.pi, 33)
        return centre + r * np.stack([np.cos(t), np.sin(t)], -1)
    heading, lean = np.arctan2(d[1], d[0]), np.arccos((ra - rb) / length)
    far = np.linspace(heading - lean, heading + lean, 15)
    near = np.linspace(heading + lean, heading + 2 * np.pi - lean, 15)
    ends = [(b, rb, far), (a, ra, near)]
    return np.concatenate([c + r * np.stack([np.cos(t), np.sin(t)], -1) for c, r, t in ends])


def draw_figure(
    ax: object, figure: Figure, pose: np.ndarray, axes: np.ndarray, shift: float = 0.0, zorder: float = 2
) -> None:
    """Draws one pose [J, 3] into matplotlib axes, moved `shift` to the right; far limbs first, and paler."""
    from matplotlib.collections import PolyCollection

    view = pose @ axes.T + np.float32([shift, 0, 0])
    _shadow(ax, figure, pose, axes, shift, zorder - 0.5)
    parts = [(view[p], view[c], figure.radii[p], figure.radii[c], figure.colours[c]) for p, c in figure.bones]
    if not parts:
        parts = [(view[j], view[j], figure.radii[j], figure.radii[j], figure.colours[j]) for j in figure.drawn]
    if figure.head >= 0:
        neck = view[figure.parents[figure.head]]
        along = view[figure.head] - neck
        along = along / max(float(np.linalg.norm(along)), 1e-6) * figure.head_radius
        at, r = view[figure.head], figure.head_radius
        parts.append((at + 0.55 * along, at + 1.15 * along, 0.86 * r, r, figure.colours[figure.head]))
    parts.sort(key=lambda part: part[0][2] + part[1][2])
    middle = float(np.mean([part[0][2] + part[1][2] for part in parts])) / 2
    shapes, fills, edges = [], [], []
    for a, b, ra, rb, colour in parts:
        away = np.clip((middle - (a[2] + b[2]) / 2) / (0.35 * figure.size) + 0.2, 0, 1)
        fill = mix(colour, "#ffffff", 0.42 * float(away))
        # A shape with a lighter sliver towards the light at the upper left reads as round.
        offset = np.array([-0.22, 0.22])
        shapes += [
            cone_outline(a[:2], b[:2], ra, rb),
            cone_outline(a[:2] + offset * ra, b[:2] + offset * rb, 0.6 * ra, 0.6 * rb),
        ]
        fills += [fill, mix(fill, "#ffffff", 0.16)]
        edges += [mix(fill, "#20262e", 0.34), "none"]
    ax.add_collection(PolyCollection(shapes, facecolors=fills, edgecolors=edges, linewidths=0.45, zorder=zorder))


def _shadow(ax: object, figure: Figure, pose: np.ndarray, axes: np.ndarray, shift: float, zorder: float) -> None:
    from matplotlib.collections import PolyCollection

    flat = pose.copy()
    flat[:, 1] = 0.0
    view = flat @ axes.T + np.float32([shift, 0, 0])
    pairs = figure.bones or tuple((j, j) for j in figure.drawn)
    shapes = [cone_outline(view[p, :2], view[c, :2], 0.7 * figure.radii[p], 0.7 * figure.radii[c]) for p, c in pairs]
    squash = [s * [1, 0.35] + [0, 0.65 * s[:, 1].mean()] for s in shapes]
    ax.add_collection(PolyCollection(squash, facecolors="#dde1e7", edgecolors="none", zorder=zorder))


def draw_floor(ax: object, axes: np.ndarray, middle: np.ndarray, reach: float, tile: float) -> None:
    """Draws a tiled floor around a point [3] that fades towards its rim."""
    from matplotlib.collections import PolyCollection

    count = int(np.ceil(reach / tile))
    x0, z0 = np.floor(middle[[0, 2]] / tile)
    shapes, fills = [], []
    for i in range(-count, count + 1):
        for k in range(-count, count + 1):
            x, z = (x0 + i) * tile, (z0 + k) * tile
            corners = np.float32([[x, 0, z], [x + tile, 0, z], [x + tile, 0, z + tile], [x, 0, z + tile]])
            far = np.hypot(x + tile / 2 - middle[0], z + tile / 2 - middle[2]) / reach
            if far < 1:
                tone = "#dfe4eb" if (x0 + i + z0 + k) % 2 else "#eef1f5"
                shapes.append((corners @ axes.T)[:, :2])
                fills.append(mix(tone, "#ffffff", float(np.clip(far * 1.5 - 0.5, 0, 1))))
    ax.add_collection(PolyCollection(shapes, facecolors=fills, edgecolors="none", zorder=0))


class StillWidget:
    """To be named before a widget's class: beside the live widget stands `still()`, the bytes of a PNG.

    about: what a terminal is told, a noun.
    """

    about = "a widget"

    def _repr_mimebundle_(self, **more: object) -> dict:
        """The live widget, and beside it the picture."""
        bundle = super()._repr_mimebundle_(**more) or {}
        bundle = bundle[0] if isinstance(bundle, tuple) else bundle  # anywidget gives its metadata too
        png, told = base64.b64encode(self.still()).decode(), f"({self.about}: run this cell)"
        return {**bundle, "image/png": png, "text/plain": told}


class HiddenStill:
    """To be named before a widget's class: after the live view comes a picture that it hides, `still()`.

    The widget gives `_still`, a name, and `_view`, the CSS class of its live view.
    """

    def _repr_mimebundle_(self, **_: object) -> dict:
        view = {"version_major": 2, "version_minor": 0, "model_id": self.model_id}
        return {"application/vnd.jupyter.widget-view+json": view, "text/plain": repr(self)}

    def _ipython_display_(self, **_: object) -> None:
        """Shows the live view and a still that it hides: the still is what a page without a kernel shows."""
        from IPython.display import display

        # JupyterLab without a kernel puts a line of complaint in the view's place. In a notebook that was run here, and
        # is trusted, this rule takes it away; as long as a live view is there, its own rule hides this still instead.
        place = f".jp-OutputArea-child:not(:has(.{self._view})):has(+ .jp-OutputArea-child .{self._still})"
        source, text = base64.b64encode(self.still()).decode(), html.escape(repr(self))
        image = f'<img alt="{text}" src="data:image/png;base64,{source}" style="max-width: 100%">'
        still = f'<style>{place} {{ display: none; }}</style><div class="{self._still}">{image}</div>'
        display(self._repr_mimebundle_(), raw=True)
        display({"text/html": still, "text/plain": "(still picture)"}, raw=True)


_STEPS = 32767  # what a 16-bit number holds


def encode_scene(
    figures: Sequence[Figure],
    *,
    labels: Sequence[str | None],
    trails: Sequence[str] = (),
    contacts: Sequence | None = None,
) -> bytes:
    """Figures as the bytes that `player.js` reads.

    labels: one text or None for each figure. trails: joint names. contacts: for each figure None, or pairs of joint
    number and bool array [F].
    """
    blocks: list[bytes] = []
    head = {"motions": [], "follow": True, "contact": CONTACT}
    for figure, label, marks in zip(figures, labels, contacts or [None] * len(figures)):
        head["motions"].append(_describe(figure, label, trails, marks or [], blocks))
    text = json.dumps(head, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return len(text).to_bytes(4, "little") + text + b"".join(blocks)


def _describe(figure: Figure, label: str | None, trails: Sequence[str], marks: Sequence, blocks: list[bytes]) -> dict:
    root = figure.points[:, 0]
    around = figure.points - root[:, None]
    scale = max(float(np.abs(around).max()), 1e-6) / _STEPS
    trailing = [figure.names.index(n) for n in trails if n in figure.names]
    return {
        "label": label or "",
        "name": figure.name,
        "fps": figure.fps,
        "frames": len(figure.points),
        "joints": len(figure.parents),
        "bones": figure.bones,
        "scale": scale,
        "height": round(figure.size, 4),
        "drawn": figure.drawn,
        "radii": [round(float(r), 4) for r in figure.radii],
        "colours": figure.colours,
        "role": figure.role,
        "head": figure.head,
        "headParent": figure.parents[figure.head] if figure.head >= 0 else -1,
        "headRadius": round(figure.head_radius, 4),
        "left": [round(float(x), 4) for x in figure.left],
        "trails": trailing,
        "marks": [j for j, _ in marks],
        "root": _add(blocks, root.astype("<f4")),
        "around": _add(blocks, np.rint(around / scale).astype("<i2")),
        "touch": _add(blocks, np.stack([t for _, t in marks], 1).astype("u1")) if marks else -1,
    }


def _add(blocks: list[bytes], array: np.ndarray) -> int:
    """Appends an array, padded to four bytes; returns its place after the header."""
    place = sum(map(len, blocks))
    raw = np.ascontiguousarray(array).tobytes()
    blocks.append(raw + bytes(-len(raw) % 4))
    return place


def decode_scene(data: bytes) -> tuple[dict, list[np.ndarray]]:
    """The header and each motion's positions [F, J, 3]: what the browser reads, for tests and tools."""
    length = int.from_bytes(data[:4], "little")
    head = json.loads(data[4 : 4 + length])
    body, points = data[4 + length :], []
    for m in head["motions"]:
        frames, joints = m["frames"], m["joints"]
        root = np.frombuffer(body, "<f4", frames * 3, m["root"]).reshape(frames, 1, 3)
        around = np.frombuffer(body, "<i2", frames * joints * 3, m["around"]).reshape(frames, joints, 3)
        points.append(root + around * np.float32(m["scale"]))
    return head, points


def contact_marks(figure: Figure, contacts: object) -> list[tuple[int, np.ndarray]]:
    """Contacts as pairs (joint number, bool [F]).

    contacts: None; a dict from joint name to bool [F]; a pair (joint names or numbers, bool [F, K]); or, where every
    joint has a column, a bool [F, J] alone.
    """
    if contacts is None:
        return []
    if isinstance(contacts, dict):
        return [(_joint(figure, n), _column(figure, v)) for n, v in contacts.items()]
    paired = isinstance(contacts, (tuple, list)) and len(contacts) == 2
    names, table = contacts if paired else (range(len(figure.names)), contacts)
    table = _array(table)
    names = list(names)
    if table.ndim != 2 or table.shape != (len(figure.points), len(names)):
        raise MotionKitError(
            f"contacts of {figure.name!r}: expected [{len(figure.points)}, {len(names)}] (frames, joints), found "
            f"{list(table.shape)}; give (joint names, bool tensor [F, K]) or {{joint name: bool tensor [F]}}"
        )
    return [(_joint(figure, n), table[:, k].astype(bool)) for k, n in enumerate(names)]


def _array(values: object) -> np.ndarray:
    return values.detach().cpu().numpy() if hasattr(values, "detach") else np.asarray(values)


def _joint(figure: Figure, name: object) -> int:
    if isinstance(name, str) and name in figure.names:
        return figure.names.index(name)
    if not isinstance(name, str) and 0 <= int(name) < len(figure.names):
        return int(name)
    raise MotionKitError(f"{figure.name!r} has no joint {name!r}; joints: {', '.join(figure.names)}")


def _column(figure: Figure, values: object) -> np.ndarray:
    column = _array(values).astype(bool).reshape(-1)
    if len(column) != len(figure.points):
        raise MotionKitError(f"contacts of {figure.name!r}: expected {len(figure.points)} frames, found {len(column)}")
    return column
