"""Pictures about feature rows: how layouts divide a row, paths over the floor, and a paddle that shows a twist."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import anywidget
import numpy as np
import torch
import traitlets
from torch import Tensor

from .. import rotations as rot
from ..contacts import foot_sliding
from ..errors import MotionKitError
from ..features import HumanML3D
from ..features.canonical import canonicalize, integrate
from ..features.facing_free import FacingFree
from ..methods.baselines import match_statistics
from ..motion import Motion
from ..skeleton import smpl
from ..viewer import colours
from ..viewer.figure import HiddenStill, as_list, cone_outline, draw_figure, figures, view_axes
from ..viewer.plots import INK, SOFT, StaticFigure, style_axes
from . import Exercise, seeded_randn

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


def plot_layouts(layouts: Sequence[object]) -> StaticFigure:
    """One bar a layout, as long as its row of numbers and divided into its parts; returns the matplotlib Figure.

    >>> from motionkit.features import FacingFree, HumanML3D
    >>> picture = plot_layouts([FacingFree(), HumanML3D()])
    """
    picture = StaticFigure(figsize=(9.5, 0.6 + 0.36 * len(layouts)), dpi=100, layout="constrained")
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


def plot_paths(paths: Mapping[str, torch.Tensor], title: str = "") -> StaticFigure:
    """Named paths over the floor, [F, 2] of x and z, from above as in `plot_trajectory`; returns the matplotlib Figure.

    >>> picture = plot_paths({"there": torch.rand(9, 2), "back": torch.rand(9, 2)})
    """
    picture = StaticFigure(figsize=(7.5, 3.4), dpi=100, layout="constrained")
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


def plot_paddle(motions: Mapping[str, object], frame: int) -> StaticFigure:
    """One frame of named motions side by side, a paddle fixed to each right wrist; returns the matplotlib Figure.

    A skeleton of bare lines does not show how a bone is turned about its own length; the paddle does.

    >>> import motionkit as mk
    >>> picture = plot_paddle({"walk": mk.load("data/actor/walk_neutral.bvh")}, frame=15)
    """
    picture = StaticFigure(figsize=(0.5 + 3 * len(motions), 3.9), dpi=100, layout="constrained")
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
    points = pose @ view.T
    _body(ax, look, points[:, :2], points[:, 2])
    joint, axis = look["joints_of"][number], look["axis_of"][number]
    lit = points[look["pelvis"] if joint is None else joint]
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


_JS = Path(__file__).parent / "js"


class _Inspector(HiddenStill, anywidget.AnyWidget):
    """What both share: a motion, the frame shown, and a still of it."""

    _esm = (_JS / "inspectors.js").read_text(encoding="utf-8")
    _css = (_JS / "inspectors.css").read_text(encoding="utf-8")
    _view = "mk-inspect"
    _kind = traitlets.Unicode().tag(sync=True)
    _look = traitlets.Unicode().tag(sync=True)
    _points = traitlets.Bytes().tag(sync=True)
    _still = traitlets.Unicode().tag(sync=True)
    frame = traitlets.Int(0).tag(sync=True)

    def __init__(self, motion: object, points: np.ndarray, look: dict, **traits: object) -> None:
        self._motion, self._shape, self._where = motion, look, points
        data = np.ascontiguousarray(points, np.float32).tobytes()
        text = json.dumps(look)
        name = f"mk-still-{zlib.crc32(data + text.encode()):08x}"  # the same in every run
        super().__init__(_look=text, _points=data, _still=name, **traits)

    @traitlets.validate("frame")
    def _check_frame(self, proposal: dict) -> int:
        return min(max(proposal["value"], 0), len(self._motion) - 1)

    def draw(self, picture: object) -> None:
        """Draw the still into a matplotlib figure."""
        raise NotImplementedError

    def still(self) -> bytes:
        """What the view shows now, as the bytes of a PNG."""
        picture = StaticFigure(figsize=(8.4, 4.1), dpi=100, layout="constrained")
        self.draw(picture)
        return picture.png()


class FacingView(_Inspector):
    """A motion from above, as the world sees it and as its own body sees it; see `facing_view`."""

    def draw(self, picture: object) -> None:
        draw_facing(picture, self._motion, self._where, self._shape, self.frame)

    def __repr__(self) -> str:
        return f"FacingView({self._motion.name}, frame {self.frame})"


class FeatureInspector(_Inspector):
    """The numbers of a layout as keys: one lights up its joint; see `feature_inspector`."""

    _values = traitlets.Bytes().tag(sync=True)
    number = traitlets.Int(0).tag(sync=True)

    def __init__(self, motion: object, points: np.ndarray, look: dict, values: np.ndarray, **traits: object) -> None:
        self._numbers = values
        super().__init__(motion, points, look, _values=values.astype(np.float32).tobytes(), **traits)

    @traitlets.validate("number")
    def _check_number(self, proposal: dict) -> int:
        return min(max(proposal["value"], 0), self._shape["size"] - 1)

    @property
    def joint(self) -> str | None:
        """The name of the joint that is lit, or None where the number speaks of the whole body."""
        number = self._shape["joints_of"][self.number]
        return None if number is None else self._shape["names"][number]

    @property
    def description(self) -> str:
        """What the chosen number means, in words."""
        return self._shape["describe"][self.number]

    def draw(self, picture: object) -> None:
        draw_features(picture, self._where, self._shape, self._numbers, self.frame, self.number)

    def __repr__(self) -> str:
        return f"FeatureInspector({self._motion.name}, number {self.number}: {self.description})"


def facing_view(motion: object, frame: int | None = None) -> FacingView:
    """A motion from above, frame by frame: in the world, and seen from the body, under which the floor moves.

    The arrow is where the body faces, the line its path; a line of text tells the root's numbers (paper 1, section
    3.1). frame: where to start, by default a third of the way. `frame` is a trait: set it and the picture follows.

    >>> import motionkit as mk
    >>> facing_view(mk.load("data/actor/walk_turn_left_neutral.bvh"), frame=30)
    FacingView(walk_turn_left_neutral, frame 30)
    """
    (motion,) = _one(motion)
    look = _look_of(motion)
    root = FacingFree().encode(motion)[:, :4]
    path = motion.root_path().numpy()
    low, high = path.min(0) - 0.75, path.max(0) + 0.75
    look |= {
        "box": [*((low + high) / 2).round(3).tolist(), round(float((high - low).max()), 3)],
        "yaw": rot.wrap_angle(motion.facing()).tolist(),
        "root": root.T.tolist(),
        "colour": colours.CYCLE[0],
        "deep": colours.CONTACT,
    }
    points = motion.positions().numpy()
    return FacingView(motion, points, look, _kind="facing", frame=len(motion) // 3 if frame is None else frame)


def feature_inspector(
    motion: object, layout: object = None, number: int = 0, frame: int | None = None
) -> FeatureInspector:
    """The feature vector of a motion as keys, one a number: hover over one and its joint lights up.

    Columns are joints, rows what is told of them; a key is orange above and blue below its mean over the clip, nearly
    white close to it, and grey if it never changes. Below stand the number's meaning and its curve. layout: of
    `mk.features`, HumanML3D if left out. number, frame: what to show first. `number` and `frame` are traits: set them
    and the picture follows.

    >>> import motionkit as mk
    >>> view = feature_inspector(mk.load("data/actor/walk_neutral.bvh"), mk.features.HumanML3D(), number=14)
    >>> view.joint, view.description
    ('left_knee', 'positions y of left_knee (m)')
    """
    (motion,) = _one(motion)
    layout = HumanML3D() if layout is None else layout
    values = layout.encode(motion).flatten(1).numpy()
    look = _look_of(motion) | _meaning(layout)
    spreads = values.std(0)
    axes = view_axes(np.float32([1, 0, 0]))
    points = canonicalize(motion).local.numpy()
    up = points @ axes[1]
    look |= {
        "means": values.mean(0).round(6).tolist(),
        "spreads": np.where(spreads < 1e-5, 0, spreads).round(7).tolist(),
        "view": axes.round(5).tolist(),
        "floor": round(float(up.min()), 3),
        "tall": round(float(up.max() - up.min()), 3),
        "mark": colours.CONTACT,
        "never": colours.NEVER,
    }
    frame = len(motion) // 3 if frame is None else frame
    return FeatureInspector(motion, points, look, values, _kind="features", frame=frame, number=number)


def _one(motion: object) -> list:
    motions = as_list(motion)
    if len(motions) > 1:
        raise MotionKitError(f"an inspector shows one motion; found {len(motions)}: choose one of them")
    return motions


def _look_of(motion: object) -> dict:
    """How to draw the body, as plain lists."""
    figure = figures(motion)[0]
    return {
        "frames": len(motion),
        "fps": motion.fps,
        "joints": len(figure.names),
        "names": list(figure.names),
        "bones": [list(b) for b in figure.bones],
        "radii": [round(float(r), 4) for r in figure.radii],
        "head": figure.head,
        "head_radius": round(figure.head_radius, 4),
        "colours": list(figure.colours),
        "edges": [colours.mix(c, "#20262e", 0.34) for c in figure.colours],
        "pelvis": motion.skeleton.pelvis,
    }


def _meaning(layout: object) -> dict:
    """What each number of a layout says, and of which joint."""
    parts = [
        {"name": r.name, "start": r.start, "stop": r.stop, "components": list(layout.components[r.name])}
        for r in layout.rows()
    ]
    describe = [layout.describe(n) for n in range(layout.size)]
    return {
        "size": layout.size,
        "parts": parts,
        "describe": describe,
        "axis_of": [_axis(text) for text in describe],
        "joints_of": [layout.joint_of(n) for n in range(layout.size)],
    }


def _axis(text: str) -> int | None:
    """The direction that a number measures along, 0 to 2 for x, y, z, from its description; None for turns and flags.

    >>> _axis("positions y of left_knee (m)"), _axis("root half yaw velocity (rad/frame)")
    (1, None)
    """
    if not text.endswith(("(m)", "(m/frame)")):
        return None
    return next((n for n, words in enumerate((" x ", " y ", " z ")) if words in text), 1)  # the height is along y


def _walkers() -> dict[str, tuple]:
    """Motions and contacts."""
    upright = rot.identity_quaternion(20, 22)
    still = torch.tensor([0.0, 0.96, 0.0]).expand(20, 3)
    slide = still + torch.arange(20)[:, None] * torch.tensor([0.0, 0.0, 0.01])
    stands = torch.ones(20, 4, dtype=torch.bool)
    swinging, swaying = rot.exp_map(0.2 * seeded_randn(20, 22, 3)), still + 0.1 * seeded_randn(20, 3)
    flailing = Motion.from_root(smpl(), swinging, swaying, 30.0)
    return {
        "a body that stands": (Motion.from_root(smpl(), upright, still, 30.0), stands),
        "one that slides 1 cm a frame": (Motion.from_root(smpl(), upright, slide, 30.0), stands),
        "one that flails, on random feet": (flailing, seeded_randn(20, 4) > 0),
        "no foot ever stands": (flailing, ~stands),
    }


def _slide(motion: Motion, chosen: Tensor, axes: Sequence[int] = (0, 2)) -> Tensor | float:
    """Millimetres a frame along some axes, over the chosen pairs [F-1, K]."""
    feet = motion.positions()[:, list(motion.skeleton.feet())][..., list(axes)]
    steps = 1000 * (feet[1:] - feet[:-1]).norm(dim=-1)
    return steps[chosen].mean() if chosen.any() else 0.0


def _published_path(features: Tensor) -> Tensor:
    """Where the root stands on the ground, [F, 2], from HumanML3D features [F, 3 or more]."""
    return HumanML3D().path(features)[1]


def _wrong_path(x: Tensor, turn: float = -2.0, *, seen_from: int = 1) -> Tensor:
    """The published path with another share of the turn, or with steps seen from another frame."""
    yaw = turn * integrate(x[:, 0])
    yaw = torch.cat((yaw[seen_from:], yaw[-1:].expand(seen_from)))
    step = torch.stack((x[:, 1], torch.zeros(len(x)), x[:, 2]), -1)
    return integrate(rot.quaternion_rotate(rot.yaw_to_quaternion(yaw), step))[:, [0, 2]]


EXERCISES = {
    "foot_sliding": Exercise(
        foot_sliding,
        cases=_walkers,
        hints=(
            "a standing foot should stay where it is: how far does it move from one frame to the next?",
            "the mean over pairs of neighbouring frames in which the same joint stands in both; x and z only, in "
            "millimetres; 0 where nothing stands.",
            "both = contacts[1:] & contacts[:-1] chooses among the lengths of the steps [F-1, K] on the ground.",
        ),
        mistakes={
            "Feet in the air may move: count pairs in which the joint stands.": lambda m, c: _slide(m, c[1:] | True),
            "It must stand in both frames of a pair (&), not in one of them (|).": lambda m, c: _slide(
                m, c[1:] | c[:-1]
            ),
            "Over the ground only: leave y out.": lambda m, c: _slide(m, c[1:] & c[:-1], axes=(0, 1, 2)),
            "A foot may slide sideways, too: x and z.": lambda m, c: _slide(m, c[1:] & c[:-1], axes=(2,)),
            "Positions are in metres; the answer is in millimetres.": lambda m, c: foot_sliding(m, c) / 1000,
        },
    ),
    "match_statistics": Exercise(
        match_statistics,
        cases=lambda: {
            "two clips": (seeded_randn(30, 5), 2 * seeded_randn(40, 5, seed=1) + 3),
            "numbers that hardly move, or never": (
                seeded_randn(30, 5) * torch.tensor([1.0, 1.0, 1.0, 0.01, 0.0]),
                seeded_randn(40, 5, seed=1),
            ),
        },
        hints=(
            "each of the D numbers has a mean and a spread over the frames: take the content's away, give the style's.",
            "mean and spread over dimension 0, with the population's spread (correction=0); no spread may grow to more "
            "than three times what it was, and none may be divided by 0.",
            "gain = (spread of the style / spread of the content.clamp(min=1e-6)).clamp(max=3).",
        ),
        mistakes={
            "No spread may grow to more than three times what it was: clamp the gain.": lambda x, y: match_statistics(
                x, y, most=1e9
            ),
            "One mean and spread for each of the D numbers, over dimension 0; not one for all.": lambda x, y: (
                (x - x.mean()) / x.std(correction=0) * y.std(correction=0) + y.mean()
            ),
            "The population's spread: correction=0.": lambda x, y: (
                (x - x.mean(0)) * (y.std(0) / x.std(0).clamp(min=1e-6)).clamp(max=3) + y.mean(0)
            ),
            "The mean is there; now the spread, too.": lambda x, y: x - x.mean(0) + y.mean(0),
        },
    ),
    "published_path": Exercise(
        _published_path,
        cases=lambda: {
            "three steps ahead": (torch.tensor([[0.0, 0, 1], [0, 0, 1], [0, 0, 1]]),),
            "a random walk": (0.1 * seeded_randn(30, 4),),
        },
        hints=(
            "first find where the body faces, then turn each step by it, then add up the steps.",
            "the first number is half the turn, and to the right; the step of frame t is seen from where the body "
            "faces in frame t + 1; the path starts at 0, 0.",
            "yaw = -2 * sum_before(x[:, 0]); turn (x[:, 1], 0, x[:, 2]) by the next frame's yaw; sum_before again.",
        ),
        mistakes={
            "The file holds half the turn of a frame.": lambda x: _wrong_path(x, turn=-1),
            "The file counts turns to the right, yaw_to_quaternion those to the left.": lambda x: _wrong_path(
                x, turn=2
            ),
            "Frame t's step is seen from where the body faces in frame t + 1.": lambda x: _wrong_path(x, seen_from=0),
            "The path starts at 0, 0: add up the steps before a frame, without its own.": lambda x: _published_path(
                torch.cat((x, x[-1:]))
            )[1:],
        },
    ),
}
