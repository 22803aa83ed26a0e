"""What the inspectors leave on a page that runs nothing, drawn with matplotlib."""

from __future__ import annotations

import numpy as np

from . import colours
from .drawing import cone_outline
from .plots import INK, SOFT, style_axes


def draw_facing(picture: object, motion: object, points: np.ndarray, look: dict, frame: int) -> None:
    """Two views from above: the world's and the body's. points: [F, J, 3] metres."""
    x0, z0, size = look["box"]
    yaw, pelvis = look["yaw"][frame], points[:, look["pelvis"]][:, [0, 2]]
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.float32([[c, s], [-s, c]])  # (x, z) in the world to (x, z) seen from the body, rows times this
    left, right = picture.subplots(1, 2, width_ratios=(1.1, 1))
    for ax, to, box, title in (
        (left, lambda p: p, (x0, z0, size), "as the world sees it"),
        (right, lambda p: (p - pelvis[frame]) @ turn, (0, 0.12, 2.1), "as the body sees it"),
    ):
        _floor_from_above(ax, to, (x0, z0, size / 2 + 2))
        ax.plot(*to(pelvis).T, color=look["colour"], lw=1.5, ls=":")
        ax.plot(*to(pelvis[: frame + 1]).T, color=look["colour"], lw=3, solid_capstyle="round")
        _body(ax, look, to(points[frame][:, [0, 2]]), points[frame][:, 1])
        start, tip = to(pelvis[frame][None])[0], to((pelvis[frame] + 0.62 * np.float32([s, c]))[None])[0]
        ax.annotate("", tip, start, arrowprops={"arrowstyle": "-|>", "color": look["deep"], "lw": 2.6}, zorder=9)
        x, z, half = box[0], box[1], box[2] / 2
        ax.set(xlim=(x + half, x - half), ylim=(z - half, z + half), aspect="equal")
        ax.set_title(title, loc="left", fontsize=10.5, color=INK, fontweight="bold")
        ax.set_axis_off()
    go = [row[frame] for row in look["root"]]
    says = f"frame {frame}:  faces {np.degrees(yaw):.1f}°,  turns {np.degrees(go[0]):.1f}° a frame,  "
    says += f"goes {1000 * go[1]:.0f} mm left and {1000 * go[2]:.0f} mm ahead a frame,  pelvis at {go[3]:.2f} m"
    picture.supxlabel(says, fontsize=9.5, color=SOFT)


def _floor_from_above(ax: object, to: object, around: tuple[float, float, float]) -> None:
    x0, z0, reach = around
    for n in np.arange(-np.ceil(reach / 0.5), np.ceil(reach / 0.5) + 1) * 0.5:
        x, z = np.round(x0 * 2) / 2 + n, np.round(z0 * 2) / 2 + n
        for line in ([[x, z0 - reach], [x, z0 + reach]], [[x0 - reach, z], [x0 + reach, z]]):
            ax.plot(*to(np.float32(line)).T, color="#dde2e9", lw=0.8, zorder=0)


def _body(ax: object, look: dict, flat: np.ndarray, depth: np.ndarray) -> None:
    """Bones as filled shapes; flat: [J, 2] in the picture, depth: [J], the largest is nearest."""
    from matplotlib.collections import PolyCollection

    bones = sorted(look["bones"], key=lambda b: depth[b[0]] + depth[b[1]])
    radii = look["radii"]
    shapes, fills, edges = [], [], []
    for parent, child in bones:
        shapes.append(cone_outline(flat[parent], flat[child], radii[parent], radii[child]))
        fills.append(look["colours"][child])
        edges.append(look["edges"][child])
        if child == look["head"]:
            shapes.append(cone_outline(flat[child], flat[child], look["head_radius"], look["head_radius"]))
            fills.append(fills[-1])
            edges.append(edges[-1])
    ax.add_collection(PolyCollection(shapes, facecolors=fills, edgecolors=edges, linewidths=0.6, zorder=5))


def draw_features(picture: object, points: np.ndarray, look: dict, values: np.ndarray, frame: int, number: int) -> None:
    """The skeleton with one joint lit, all numbers as keys, and the chosen one's curve. values: [F, D]."""
    left, right = picture.subfigures(1, 2, width_ratios=(1, 2.3))
    _skeleton(left.add_subplot(), points[frame], look, number)
    keys, curve = right.subplots(2, 1, height_ratios=(3.4, 1))
    _keys(keys, look, values[frame], number)
    curve.plot(np.arange(len(values)) / look["fps"], values[:, number], color=INK, lw=1.6)
    curve.plot(frame / look["fps"], values[frame, number], "o", color=look["mark"], ms=6)
    curve.axvline(frame / look["fps"], color=look["mark"], lw=0.9)
    curve.set_xlabel("time (s)")
    style_axes(curve)
    text = f"number {number}: {look['describe'][number]} = {values[frame, number]:.3f}"
    curve.set_title(text, loc="left", fontsize=9.5, color=look["mark"], fontweight="bold")


def _skeleton(ax: object, pose: np.ndarray, look: dict, number: int) -> None:
    view = np.float32(look["view"])
    seen = pose @ view.T
    _body(ax, look, seen[:, :2], seen[:, 2])
    joint, axis = look["joints_of"][number], look["axis_of"][number]
    lit = seen[look["pelvis"] if joint is None else joint]
    if axis is not None:
        along = view[:, axis][:2]
        tip, back = lit[:2] + 0.36 * along, lit[:2] - 0.12 * along
        ax.annotate("", tip, back, arrowprops={"arrowstyle": "-|>", "color": look["mark"], "lw": 2}, zorder=9)
        at = {"ha": "center", "va": "center", "zorder": 9}
        ax.text(*(lit[:2] + 0.46 * along), "xyz"[axis], color=look["mark"], fontweight="bold", **at)
    ax.plot(*lit[:2], "o", ms=11, mfc="#ffffffbb", mec=look["mark"], mew=2.4, zorder=8)
    ax.set(xlim=(-0.75, 0.75), ylim=(look["floor"] - 0.1, look["floor"] + look["tall"] + 0.25), aspect="equal")
    name = "the whole body" if joint is None else look["names"][joint]
    ax.set_title(name, y=-0.06, fontsize=10.5, color=look["mark"], fontweight="bold")
    ax.set_axis_off()


def _keys(ax: object, look: dict, now: np.ndarray, number: int) -> None:
    """Columns are the body and its joints, named at the top in their side's colour; rows are components."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import LinearSegmentedColormap

    blend = LinearSegmentedColormap.from_list("mk", (colours.RIGHT, "#f7f7f7", colours.LEFT))
    boxes, fills, top, ticks = np.zeros((look["size"], 2)), [], 0.0, []
    for part in look["parts"]:
        many = len(part["components"])
        ax.text(-7.2, top + 0.75, part["name"], fontsize=8.5, color=INK, fontweight="bold")
        ticks += [(top + n + 0.5, c) for n, c in enumerate(part["components"])]
        for n in range(part["start"], part["stop"]):
            joint = look["joints_of"][n]
            boxes[n] = 0 if joint is None else joint + 1, top + (n - part["start"]) % many
        top += many + 0.5
    for z, spread in zip(now - np.array(look["means"]), look["spreads"]):
        fills.append(blend(0.5 + np.clip(z / spread / 4, -0.5, 0.5)) if spread else colours.NEVER)
    square = np.array([[0.05, 0.06], [0.95, 0.06], [0.95, 0.94], [0.05, 0.94]])
    ax.add_collection(PolyCollection(boxes[:, None] + square, facecolors=fills))
    chosen = {"facecolors": "none", "edgecolors": look["mark"], "linewidths": 2, "zorder": 4}
    ax.add_collection(PolyCollection([boxes[number] + square], **chosen))
    for n, (name, colour) in enumerate(zip(("body", *look["names"]), (INK, *look["colours"]))):
        said = name.removeprefix("left_").removeprefix("right_")  # the colour tells the side
        ax.text(n + 0.5, -0.3, said, ha="center", va="bottom", rotation=90, fontsize=6.5, color=colour)
    for y, text in ticks:
        ax.text(-0.2, y, text, ha="right", va="center", fontsize=6, color=SOFT)
    ax.set(xlim=(-7.3, look["joints"] + 1.2), ylim=(top, -4.6))
    ax.set_axis_off()
