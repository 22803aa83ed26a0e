"""Pictures about feature rows: how layouts divide a row, paths over the floor, and a paddle that shows a twist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch

from .. import rotations as rot
from . import colours
from .body import figures
from .drawing import draw_figure, view_axes
from .plots import INK, Print, style_axes

PARTS = {
    "root": "#39424e",
    "translation": "#39424e",
    "positions": colours.ROLES["content"],
    "rotations": colours.ROLES["style"],
    "velocities": colours.ROLES["result"],
    "joint": "#7d5a44",
    "contacts": colours.CONTACT,
}
_DASHES = ("-", ":", "--", "-.")
_PADDLE = ((0, 0.02), (0.1, 0.02), (0.13, 0.1), (0.38, 0.1), (0.38, -0.1), (0.13, -0.1), (0.1, -0.02), (0, -0.02))


def plot_layouts(layouts: Sequence[object]) -> Print:
    """One bar a layout, as long as its row of numbers and divided into its parts; returns the matplotlib Figure.

    >>> from motionkit.features import FacingFree, HumanML3D
    >>> picture = plot_layouts([FacingFree(), HumanML3D()])
    """
    picture = Print(figsize=(9.5, 0.6 + 0.36 * len(layouts)), dpi=100, layout="constrained")
    ax = picture.add_subplot()
    for y, layout in enumerate(layouts):
        for row in layout.rows():
            colour = PARTS[row.name]
            ax.barh(-y, row.stop - row.start, left=row.start, color=colour, edgecolor="white")
            if row.stop - row.start > 30:
                text = "joint: place + quaternion" if row.name == "joint" else row.name
                place = {"ha": "center", "va": "center", "color": _readable(colour)}
                ax.text((row.start + row.stop) / 2, -y, text, **place)
    ax.set_yticks([-y for y in range(len(layouts))], [type(layout).__name__ for layout in layouts])
    ax.set_xlabel("number in the row (dark: the root's own numbers; pink: contacts)")
    style_axes(ax)
    return picture


def _readable(colour: str) -> str:
    """White on dark colours, ink on light ones."""
    return INK if float(np.dot(colours.rgb(colour), (0.3, 0.59, 0.11))) > 0.57 else "#ffffff"


def plot_paths(paths: Mapping[str, torch.Tensor], title: str = "") -> Print:
    """Named paths over the floor, [F, 2] of x and z, from above as in `plot_trajectory`; returns the matplotlib Figure.

    >>> picture = plot_paths({"there": torch.rand(9, 2), "back": torch.rand(9, 2)})
    """
    picture = Print(figsize=(7.5, 3.4), dpi=100, layout="constrained")
    ax = picture.add_subplot()
    tints = (colours.ROLES["content"], INK, colours.LEFT, colours.CONTACT, *colours.CYCLE)
    for n, (name, path) in enumerate(paths.items()):
        ax.plot(*np.asarray(path).T, _DASHES[min(n, 2)], color=tints[n % len(tints)], label=name, lw=2)
    ax.set(xlabel="x (m)", ylabel="z (m)", aspect="equal")
    ax.set_title(title, fontsize=10, color=INK, loc="left")
    ax.xaxis.set_inverted(True)
    style_axes(ax)
    ax.legend(frameon=False, fontsize=9, labelcolor=INK, loc="center left", bbox_to_anchor=(1.05, 0.5))
    return picture


def plot_paddle(motions: Mapping[str, object], frame: int) -> Print:
    """One frame of named motions side by side, a paddle fixed to each right wrist; returns the matplotlib Figure.

    A skeleton of bare lines does not show how a bone is turned about its own length; the paddle does.

    >>> import motionkit as mk
    >>> picture = plot_paddle({"walk": mk.load("data/actor/walk_neutral.bvh")}, frame=15)
    """
    picture = Print(figsize=(0.5 + 3 * len(motions), 3.9), dpi=100, layout="constrained")
    ax = picture.add_subplot()
    for n, (name, motion) in enumerate(motions.items()):
        figure, hand = figures(motion)[0], motion.skeleton.roles["right_wrist"]
        axes = view_axes(figure.left, turn=-0.7)
        pose = motion.positions()[frame] - motion.positions()[frame, 0] * torch.tensor([1.0, 0.0, 1.0])
        flat = torch.tensor([[-along, 0.0, across] for along, across in _PADDLE])  # the right hand points to -X
        corners = rot.quaternion_rotate(motion.world_rotations()[frame, hand], flat) + pose[hand]
        corners = corners.numpy() @ axes.T
        draw_figure(ax, figure, pose.numpy(), axes, shift=1.3 * n)
        edge = colours.mix(colours.CONTACT, "#20262e", 0.4)
        ax.fill(corners[:, 0] + 1.3 * n, corners[:, 1], fc=colours.CONTACT, ec=edge, zorder=5, lw=1)
        ax.text(1.3 * n, 1.82, name, ha="center", fontsize=10.5, color=INK, fontweight="bold")
    ax.set(xlim=(-0.6, 1.3 * len(motions) - 0.6), ylim=(0.35, 1.95), aspect="equal")
    ax.set_axis_off()
    return picture
