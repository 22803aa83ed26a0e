"""Characters on paper: a three-quarter view without perspective, as filled shapes that matplotlib draws."""

from __future__ import annotations

import numpy as np

from . import colours
from .body import Figure

# Seen from this far round the character's front (radians, towards its left) and this far above.
TURN, RISE = 0.62, 0.16


def view_axes(left: np.ndarray, turn: float = TURN, rise: float = RISE) -> np.ndarray:
    """[3, 3]: the picture's right, up and towards-the-viewer directions, for a character whose left is `left`."""
    front = np.array([-left[2], 0.0, left[0]])
    back = np.cos(turn) * front + np.sin(turn) * left
    right = np.cos(turn) * left - np.sin(turn) * front
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([right, np.cos(rise) * up - np.sin(rise) * back, np.cos(rise) * back + np.sin(rise) * up]).astype(
        np.float32
    )


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

    seen = pose @ axes.T + np.float32([shift, 0, 0])
    _shadow(ax, figure, pose, axes, shift, zorder - 0.5)
    parts = [(seen[p], seen[c], figure.radii[p], figure.radii[c], figure.colours[c]) for p, c in figure.bones]
    if not parts:
        parts = [(seen[j], seen[j], figure.radii[j], figure.radii[j], figure.colours[j]) for j in figure.drawn]
    if figure.head >= 0:
        neck = seen[figure.parents[figure.head]]
        along = seen[figure.head] - neck
        along = along / max(float(np.linalg.norm(along)), 1e-6) * figure.head_radius
        at, r = seen[figure.head], figure.head_radius
        parts.append((at + 0.55 * along, at + 1.15 * along, 0.86 * r, r, figure.colours[figure.head]))
    parts.sort(key=lambda part: part[0][2] + part[1][2])
    middle = float(np.mean([part[0][2] + part[1][2] for part in parts])) / 2
    shapes, fills, edges = [], [], []
    for a, b, ra, rb, colour in parts:
        away = np.clip((middle - (a[2] + b[2]) / 2) / (0.35 * figure.size) + 0.2, 0, 1)
        fill = colours.mix(colour, "#ffffff", 0.42 * float(away))
        # A shape with a lighter sliver towards the light at the upper left reads as round.
        offset = np.array([-0.22, 0.22])
        shapes += [
            cone_outline(a[:2], b[:2], ra, rb),
            cone_outline(a[:2] + offset * ra, b[:2] + offset * rb, 0.6 * ra, 0.6 * rb),
        ]
        fills += [fill, colours.mix(fill, "#ffffff", 0.16)]
        edges += [colours.mix(fill, "#20262e", 0.34), "none"]
    ax.add_collection(PolyCollection(shapes, facecolors=fills, edgecolors=edges, linewidths=0.45, zorder=zorder))


def _shadow(ax: object, figure: Figure, pose: np.ndarray, axes: np.ndarray, shift: float, zorder: float) -> None:
    from matplotlib.collections import PolyCollection

    flat = pose.copy()
    flat[:, 1] = 0.0
    seen = flat @ axes.T + np.float32([shift, 0, 0])
    pairs = figure.bones or tuple((j, j) for j in figure.drawn)
    shapes = [cone_outline(seen[p, :2], seen[c, :2], 0.7 * figure.radii[p], 0.7 * figure.radii[c]) for p, c in pairs]
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
            corners = np.array(
                [[x, 0, z], [x + tile, 0, z], [x + tile, 0, z + tile], [x, 0, z + tile]], dtype=np.float32
            )
            far = np.hypot(x + tile / 2 - middle[0], z + tile / 2 - middle[2]) / reach
            if far < 1:
                tone = "#dfe4eb" if (x0 + i + z0 + k) % 2 else "#eef1f5"
                shapes.append((corners @ axes.T)[:, :2])
                fills.append(colours.mix(tone, "#ffffff", float(np.clip(far * 1.5 - 0.5, 0, 1))))
    ax.add_collection(PolyCollection(shapes, facecolors=fills, edgecolors="none", zorder=0))
