"""Pictures of notebook 01: the ways between two rotations, a rotation's numbers over time, motions from the side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from .. import rotations as rot
from . import colours
from .plots import INK, SOFT, Print, style_axes

_JUMP = 0.2  # a curve that steps further from one value to the next counts as broken


def plot_rotation_paths(paths: Mapping[str, Tensor], fps: float = 60.0) -> object:
    """How a fingertip at +X moves on its ball under each row of rotations, and how fast these turn.

    paths: name to unit quaternions [F, 4]; all begin alike and end alike. A dot for each tenth of the way; the start
    is a ring, the end a square. Returns the matplotlib Figure.

    >>> turn = rot.yaw_to_quaternion(torch.linspace(0, 1, 61))
    >>> picture = plot_rotation_paths({"about Y": turn})
    """
    picture = Print(figsize=(7.6, 3.4), dpi=110, layout="constrained")
    ball, speed = picture.add_subplot(1, 2, 1, projection="3d"), picture.add_subplot(1, 2, 2)
    _draw_ball(ball)
    inks = (colours.CONTACT, colours.ROLES["content"], *colours.CYCLE)
    for (name, q), ink in zip(paths.items(), inks):
        x, y, z = rot.quaternion_rotate(q, q.new_tensor([1.0, 0.0, 0.0])).T
        step = torch.rad2deg(rot.quaternion_angle(q[:-1], q[1:])) * fps
        ball.plot(z, x, y, color=ink, lw=2.5, marker="o", markevery=max((len(q) - 1) // 10, 1), ms=4)
        seconds = torch.arange(1, len(q)) / fps
        speed.plot(seconds, step, color=ink, lw=2, label=f"{name}: {step.sum() / fps:.0f}° in all")
        for word, n, mark, high in (("start", 0, "o", 0.17), ("end", -1, "s", 0.17)):
            ball.plot(z[n], x[n], y[n], mark, ms=8, color="white", mec=INK, mew=1.8, zorder=10)
            ball.text(z[n], x[n], y[n] + high, word, color=INK, fontsize=9.5, ha="center", zorder=11)
    speed.set(xlabel="time (s)", ylabel="degrees a second", ylim=(0, 1.25 * speed.get_ylim()[1]))
    style_axes(speed, legend=True)
    return picture


def _draw_ball(ax: object) -> None:
    u, v = torch.linspace(0, 2 * torch.pi, 25)[:, None], torch.linspace(0, torch.pi, 13)
    ax.plot_wireframe(u.cos() * v.sin(), u.sin() * v.sin(), v.cos() + 0 * u, color="#dfe4eb", lw=0.6)
    ax.set_axis_off()
    ax.set_box_aspect((1, 1, 1), zoom=1.35)
    ax.view_init(elev=15, azim=64)
    ax.computed_zorder = False


def plot_numbers(
    ways: Mapping[str, Tensor], letters: Mapping[str, Sequence[str]], along: Tensor, xlabel: str = ""
) -> object:
    """Every number of each way to write a motion down, one panel for each way, with the largest step in its title.

    ways: name to values [F, N]. letters: name to what its N numbers are called. along: F values of the x axis. A title
    is pink where a number jumps. Returns the matplotlib Figure.

    >>> angle = torch.linspace(0, 6, 61)
    >>> picture = plot_numbers({"circle": torch.stack((angle.cos(), angle.sin()), 1)}, {"circle": "xy"}, angle)
    """
    rows = (len(ways) + 1) // 2
    picture = Print(figsize=(7.6, 2.1 * rows), dpi=110, layout="constrained")
    panels = picture.subplots(rows, 2, sharex=True, squeeze=False).flat
    for ax, (name, values) in zip(panels, ways.items()):
        for n, (letter, column) in enumerate(zip(letters[name], values.T)):
            ax.plot(along, column, color=colours.CYCLE[n], lw=1.8, label=letter)
        jump = (values[1:] - values[:-1]).abs().max()
        ink = colours.CONTACT if jump > _JUMP else INK
        ax.set_title(f"{name}: largest step {jump:.2f}", fontsize=9.5, loc="left", color=ink)
        style_axes(ax)
        ax.legend(frameon=False, fontsize=8.5, labelcolor=INK, loc="center left", bbox_to_anchor=(1, 0.5),
                  handlelength=1.1, handletextpad=0.5, borderpad=0)  # fmt: skip
    picture.supxlabel(xlabel, fontsize=9.5, color=INK)
    return picture


def plot_from_side(motions: Mapping[str, object], right: str) -> object:
    """Every frame of each motion seen from its right, z along and y up: one row for each, all at one scale.

    motions: name to Motion. right: the name of the one that is as it should be; the other titles are pink. Returns the
    matplotlib Figure.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")[::20]
    >>> picture = plot_from_side({"a walk": walk}, right="a walk")
    """
    picture = Print(figsize=(7.6, 1.55 * len(motions)), dpi=110, layout="constrained")
    panels = picture.subplots(len(motions), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for ax, (name, motion) in zip(panels, motions.items()):
        skeleton = motion.skeleton
        body = skeleton.below(skeleton.pelvis)  # what leads from a point on the ground to the hips is no bone
        for p in motion.positions():
            for j, parent in enumerate(skeleton.parents):
                if parent in body:
                    ink = colours.SIDES[skeleton.sides[j]]
                    ax.plot(*p[[parent, j]][:, [2, 1]].T, "-o", color=ink, lw=2.5, ms=4)
        ax.axhline(0, color="#c5ccd5", lw=1)
        ax.set(aspect="equal", ylabel="y (m)")
        ax.set_title(name, fontsize=9.5, loc="left", color=INK if name == right else colours.CONTACT)
        style_axes(ax)
    panels[-1].set_xlabel("z (m), seen from the side", color=SOFT)
    return picture
