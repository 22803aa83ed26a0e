"""The gimbal: three Euler angles as three rings, each carried by the one before, around a paper dart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from .. import rotations as rot
from . import colours
from .drawing import view_axes
from .plots import INK, SOFT, _axes

AXIS_COLOURS = {"X": "#d3622b", "Y": "#2f9e77", "Z": "#5b5ea6"}
_RINGS = (1.0, 0.85, 0.7)  # radii of the first, second and third ring
_LOCKED = 0.08  # below this much freedom the picture says so
_NAMES_AT = ((1.36, 1.3), (1.2, 1.2), (1.02, 0.78))  # how far out an axle's name stands, and at least in the picture
# A paper dart that flies along +Z with its fin up: its faces' greys (orange and blue are limbs) and corners.
_DART = (
    ("#aab4c0", ((0, 0, 0.6), (0.36, 0.05, -0.36), (0.03, 0, -0.3))),
    ("#6b7785", ((0, 0, 0.6), (-0.36, 0.05, -0.36), (-0.03, 0, -0.3))),
    ("#dde2e8", ((0, 0, 0.45), (0, 0.24, -0.38), (0, 0, -0.3))),
)


def gimbal_axles(order: str, degrees: Sequence[float]) -> Tensor:
    """The directions [3, 3] in the world, one a row, about which the three Euler angles of `order` turn.

    The first axle stands still; the second is carried by the first turn, the third by the first two. Where two are
    parallel the gimbal is locked.

    >>> gimbal_axles("ZXY", (0, 90, 0)).round(decimals=3) + 0.0
    tensor([[0., 0., 1.],
            [1., 0., 0.],
            [0., 0., 1.]])
    """
    turned = torch.deg2rad(torch.as_tensor(degrees, dtype=torch.float32))
    before = [turned * torch.tensor([float(k < n) for k in range(3)]) for n in range(3)]
    own = torch.eye(3)[[rot.AXES[letter] for letter in order.upper()]]
    return rot.quaternion_rotate(rot.euler_to_quaternion(torch.stack(before), order), own)


def gimbal_freedom(order: str, degrees: Sequence[float]) -> float:
    """How independent the three axles are: 1 where all stand at right angles, 0 in gimbal lock.

    >>> round(gimbal_freedom("ZXY", (20, 60, 10)), 3)
    0.5
    """
    return float(torch.linalg.det(gimbal_axles(order, degrees)).abs())


def plot_gimbal(order: str = "ZXY", degrees: Sequence[float] = (30, 40, -20), *, ax: object = None) -> object:
    """A paper dart in three rings, one for each Euler angle: outside the first turn, inside the last.

    Every ring turns about its axle, at right angles to it, and carries all that is inside. degrees: the three angles.
    Returns the matplotlib Figure.
    """
    ax, picture = _axes(ax, (3.6, 3.6))
    axles = gimbal_axles(order, degrees).numpy()
    view = view_axes(np.float32([1, 0, 0]), turn=-0.5, rise=0.34)
    for n, (letter, angle, radius) in enumerate(zip(order.upper(), degrees, _RINGS)):
        _draw_ring(ax, axles[n] @ view.T, axles[(n + 1) % 3] @ view.T, float(angle), radius, AXIS_COLOURS[letter])
        end = 1.16 * radius * axles[n] @ view.T
        for sign in (1, -1):  # the axle's near half lies over the rings, its far half under them
            ax.plot(
                [0, sign * end[0]],
                [0, sign * end[1]],
                color=AXIS_COLOURS[letter],
                lw=1.6,
                zorder=6 if sign * end[2] > 0 else 2,
            )
        _name_axle(ax, axles[n] @ view.T, n, f"{letter}{'₁₂₃'[n]}", AXIS_COLOURS[letter])
    turn = rot.quaternion_to_matrix(
        rot.euler_to_quaternion(torch.deg2rad(torch.tensor(degrees, dtype=torch.float32)), order)
    )
    _draw_dart(ax, view @ turn.numpy())
    ax.set(xlim=(-1.45, 1.45), ylim=(-1.45, 1.45), aspect="equal")
    ax.set_axis_off()
    return picture


def _name_axle(ax: object, axle: np.ndarray, n: int, name: str, colour: str) -> None:
    """The name of the n-th axle, clear of the dart; dots lead to it from an axle that points at the viewer."""
    from matplotlib.patheffects import withStroke

    far, least = _NAMES_AT[n]
    flat = float(np.linalg.norm(axle[:2]))
    place = axle[:2] / max(flat, 1e-6) * max(far * flat, least)
    if least > far * flat:
        ends = np.stack((1.16 * _RINGS[n] * axle[:2], place))
        ax.plot(*ends.T, ":", color=colour, lw=1.4, zorder=8)
    halo = [withStroke(linewidth=3.5, foreground="white")]
    ax.text(
        *place,
        name,
        color=colour,
        fontsize=12,
        weight="bold",
        ha="center",
        va="center",
        zorder=9,
        path_effects=halo,
    )


def _draw_ring(ax: object, axle: np.ndarray, start: np.ndarray, angle: float, radius: float, colour: str) -> None:
    """A ring at right angles to `axle` with a knob at its angle; all directions as the viewer sees them, [3]."""
    from matplotlib.collections import LineCollection

    start = start - (start @ axle) * axle
    u = (
        start / np.linalg.norm(start)
        if np.linalg.norm(start) > 1e-3
        else rot.perpendicular(torch.from_numpy(axle)).numpy()
    )
    v = np.cross(axle, u)
    t = np.linspace(0, 2 * np.pi, 97)[:, None]
    points = radius * (np.cos(t) * u + np.sin(t) * v)
    segments = np.stack((points[:-1, :2], points[1:, :2]), 1)
    depth = (points[:-1, 2] + points[1:, 2]) / 2
    for near, zorder in ((False, 1), (True, 7)):
        chosen = (depth >= 0) == near
        shades = [colours.mix(colour, "#ffffff", float(np.clip(0.32 - 0.38 * d, 0, 0.7))) for d in depth[chosen]]
        ax.add_collection(
            LineCollection(segments[chosen], colors=shades, linewidths=4.2, capstyle="round", zorder=zorder)
        )
    knob = points[0]
    ax.plot(*knob[:2], "o", ms=8.5, color=colour, mec="white", mew=1.4, zorder=8 if knob[2] >= 0 else 3)


def _draw_dart(ax: object, turn: np.ndarray) -> None:
    """The paper dart, turned by a matrix from its own axes to the viewer's."""
    from matplotlib.collections import PolyCollection

    faces = [(np.float32(corners) @ turn.T, grey) for grey, corners in _DART]
    faces.sort(key=lambda face: face[0][:, 2].mean())
    fills = []
    for corners, colour in faces:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        fills.append(colours.mix(colour, "#ffffff", 0.4 * float(1 - abs(normal[2]) / np.linalg.norm(normal))))
    edges = [colours.mix(fill, "#20262e", 0.4) for fill in fills]
    ax.add_collection(
        PolyCollection([f[:, :2] for f, _ in faces], facecolors=fills, edgecolors=edges, linewidths=0.8, zorder=5)
    )


def write_numbers(picture: object, order: str, degrees: Sequence[float]) -> None:
    """The same rotation as Euler angles, quaternion, matrix and 6D, and how free the gimbal is, at the right."""
    from matplotlib.patches import Rectangle

    q = rot.positive(rot.euler_to_quaternion(torch.deg2rad(torch.tensor(degrees, dtype=torch.float64)), order))
    matrix, free = rot.quaternion_to_matrix(q).tolist(), gimbal_freedom(order, degrees)

    def row(y: float, values: Sequence[str], inks: Sequence[str] = (INK,) * 4) -> None:
        for n, (value, ink) in enumerate(zip(values, inks)):
            picture.text(
                0.65 + 0.1 * n, y, value, fontsize=11.5, color=ink, family="monospace", va="center", ha="right"
            )

    titles = (f"Euler angles, R = {' '.join(f'R{letter.lower()}' for letter in order)}", "unit quaternion  w x y z",
              "matrix: its first two columns are the 6D", "freedom of the three axles")  # fmt: skip
    for y, title in zip((0.92, 0.745, 0.57, 0.255), titles):
        picture.text(0.56, y, title, fontsize=8.5, color=SOFT, va="center")
    row(0.85, [f"{angle:.0f}°" for angle in degrees], [AXIS_COLOURS[letter] for letter in order])
    row(0.675, [f"{value + 0.0:.2f}" for value in q.tolist()])
    for n in range(3):
        row(0.5 - 0.07 * n, [f"{value:.2f}".replace("-0.00", "0.00") for value in matrix[n]], (INK, INK, "#aab2bc"))
    locked = free < _LOCKED
    for width, colour in ((1, "#e9ecf1"), (free, colours.CONTACT if locked else colours.ROLES["content"])):
        picture.add_artist(
            Rectangle((0.56, 0.175), 0.4 * width, 0.04, transform=picture.transFigure, color=colour, lw=0)
        )
    for x, word, side in ((0.56, "empty: lock", "left"), (0.96, "full: all independent", "right")):
        picture.text(x, 0.145, word, fontsize=8.5, color=SOFT, va="center", ha=side)
    if locked:
        picture.text(
            0.56,
            0.08,
            "gimbal lock: two axles fall together",
            fontsize=10.5,
            color=colours.CONTACT,
            weight="bold",
            va="center",
        )
