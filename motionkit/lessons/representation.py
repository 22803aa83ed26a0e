"""Notebook 01: the ways between two rotations, a rotation's numbers over time, motions from the side; exercises."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import ipywidgets
import numpy as np
import torch
from torch import Tensor

from .. import rotations as rot
from ..errors import MotionKitError
from ..viewer import colours
from ..viewer.figure import StillWidget, draw_figure, draw_floor, figures, view_axes
from ..viewer.plots import INK, SOFT, StaticFigure, _axes, few_colours, style_axes
from . import Exercise, seeded_randn

_JUMP = 0.2  # a curve that steps further from one value to the next counts as broken


def plot_rotation_paths(paths: Mapping[str, Tensor], fps: float = 60.0) -> object:
    """How a fingertip at +X moves on its ball under each row of rotations, and how fast these turn.

    paths: name to unit quaternions [F, 4]; all begin alike and end alike. A dot for each tenth of the way; the start
    is a ring, the end a square. Returns the matplotlib Figure.

    >>> turn = rot.yaw_to_quaternion(torch.linspace(0, 1, 61))
    >>> picture = plot_rotation_paths({"about Y": turn})
    """
    picture = StaticFigure(figsize=(7.6, 3.4), dpi=110, layout="constrained")
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
    picture = StaticFigure(figsize=(7.6, 2.1 * rows), dpi=110, layout="constrained")
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
    picture = StaticFigure(figsize=(7.6, 1.55 * len(motions)), dpi=110, layout="constrained")
    panels = picture.subplots(len(motions), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for ax, (name, motion) in zip(panels, motions.items()):
        skeleton = motion.skeleton
        body = skeleton.descendants(skeleton.pelvis)  # what leads from a point on the ground to the hips is no bone
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
    axles = torch.eye(3)[[rot.AXES[letter] for letter in order.upper()]]
    return rot.quaternion_rotate(rot.euler_to_quaternion(torch.stack(before), order), axles)


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
        for end in (1.16 * radius * axles[n] @ view.T, -1.16 * radius * axles[n] @ view.T):
            over = 6 if end[2] > 0 else 2  # the axle's near half lies over the rings, its far half under them
            ax.plot([0, end[0]], [0, end[1]], color=AXIS_COLOURS[letter], lw=1.6, zorder=over)
        _name_axle(ax, axles[n] @ view.T, n, f"{letter}{'₁₂₃'[n]}", AXIS_COLOURS[letter])
    turned = rot.euler_to_quaternion(torch.deg2rad(torch.tensor(degrees, dtype=torch.float32)), order)
    _draw_dart(ax, view @ rot.quaternion_to_matrix(turned).numpy())
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
    letters = {"color": colour, "fontsize": 12, "weight": "bold", "ha": "center", "va": "center", "zorder": 9}
    ax.text(*place, name, path_effects=[withStroke(linewidth=3.5, foreground="white")], **letters)


def _draw_ring(ax: object, axle: np.ndarray, start: np.ndarray, angle: float, radius: float, colour: str) -> None:
    """A ring at right angles to `axle` with a knob at its angle; all directions as the viewer sees them, [3]."""
    from matplotlib.collections import LineCollection

    start = start - (start @ axle) * axle
    u, length = rot.perpendicular_to(torch.from_numpy(axle)).numpy(), np.linalg.norm(start)
    u = start / length if length > 1e-3 else u
    v = np.cross(axle, u)
    t = np.linspace(0, 2 * np.pi, 97)[:, None]
    points = radius * (np.cos(t) * u + np.sin(t) * v)
    segments = np.stack((points[:-1, :2], points[1:, :2]), 1)
    depth = (points[:-1, 2] + points[1:, 2]) / 2
    for near, zorder in ((False, 1), (True, 7)):
        chosen = (depth >= 0) == near
        shades = [colours.mix(colour, "#ffffff", float(np.clip(0.32 - 0.38 * d, 0, 0.7))) for d in depth[chosen]]
        look = {"linewidths": 4.2, "capstyle": "round", "zorder": zorder}
        ax.add_collection(LineCollection(segments[chosen], colors=shades, **look))
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
    edges, outlines = [colours.mix(fill, "#20262e", 0.4) for fill in fills], [corners[:, :2] for corners, _ in faces]
    ax.add_collection(PolyCollection(outlines, facecolors=fills, edgecolors=edges, linewidths=0.8, zorder=5))


def write_numbers(picture: object, order: str, degrees: Sequence[float]) -> None:
    """The same rotation as Euler angles, quaternion, matrix and 6D, and how free the gimbal is, at the right."""
    from matplotlib.patches import Rectangle

    angles = torch.deg2rad(torch.tensor(degrees, dtype=torch.float64))
    q = rot.quaternion_canonical(rot.euler_to_quaternion(angles, order))
    matrix, free = rot.quaternion_to_matrix(q).tolist(), gimbal_freedom(order, degrees)

    def row(y: float, values: Sequence[str], inks: Sequence[str] = (INK,) * 4) -> None:
        letters = {"fontsize": 11.5, "family": "monospace", "va": "center", "ha": "right"}
        for n, (value, ink) in enumerate(zip(values, inks)):
            picture.text(0.65 + 0.1 * n, y, value, color=ink, **letters)

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
        place = {"transform": picture.transFigure, "color": colour, "lw": 0}
        picture.add_artist(Rectangle((0.56, 0.175), 0.4 * width, 0.04, **place))
    for x, word, side in ((0.56, "empty: lock", "left"), (0.96, "full: all independent", "right")):
        picture.text(x, 0.145, word, fontsize=8.5, color=SOFT, va="center", ha=side)
    if locked:
        letters = {"fontsize": 10.5, "color": colours.CONTACT, "weight": "bold", "va": "center"}
        picture.text(0.56, 0.08, "gimbal lock: two axles fall together", **letters)


ORDERS = ("ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX", "ZXZ", "ZYZ", "XYX", "XZX", "YXY", "YZY")


class Explorer(StillWidget, ipywidgets.VBox):
    """A picture over the controls that change it.

    controls: name to widget; whole-number sliders stand at the right, all else at the left. draw: called with the
    controls' values, gives a matplotlib Figure. buttons: widgets shown with the controls that are no argument of
    `draw`. width: of the picture, pixels. in_one_column: all controls under each other, in their order.

    >>> slider = ipywidgets.IntSlider(value=2)
    >>> explorer = Explorer({"x": slider}, lambda x: _axes(None, (2, 1))[1])
    >>> before = explorer.png
    >>> slider.value = 5
    >>> explorer.values()
    {'x': 5}
    """

    about = "sliders"

    def __init__(
        self,
        controls: Mapping[str, ipywidgets.Widget],
        draw: Callable[..., object],
        buttons: Sequence[ipywidgets.Widget] = (),
        width: int = 760,
        *,
        in_one_column: bool = False,
    ) -> None:
        self.controls, self._draw = dict(controls), draw
        self._image = ipywidgets.Image(format="png", layout={"width": f"{width}px", "max_width": "100%"})
        sliders = [c for c in self.controls.values() if isinstance(c, ipywidgets.IntSlider)]
        choices = [c for c in self.controls.values() if c not in sliders]
        columns = [ipywidgets.VBox([*choices, *buttons], layout={"width": "240px"}), ipywidgets.VBox(sliders)]
        below = ipywidgets.HBox(columns, layout={"flex_flow": "row wrap"})
        if in_one_column:
            below = ipywidgets.VBox(list(self.controls.values()))
        super().__init__([self._image, below])
        for control in self.controls.values():
            control.observe(self._redraw, "value")
        self._redraw()

    def values(self) -> dict:
        """The controls' values by name."""
        return {name: control.value for name, control in self.controls.items()}

    def set(self, **values: object) -> None:
        """Move several controls and draw once."""
        for name, value in values.items():
            self.controls[name].unobserve(self._redraw, "value")
            self.controls[name].value = value
            self.controls[name].observe(self._redraw, "value")
        self._redraw()

    @property
    def png(self) -> bytes:
        """The picture as it is now."""
        return self._image.value

    def still(self) -> bytes:
        """The picture as it is now, in few colours."""
        return few_colours(io.BytesIO(self.png))

    def _redraw(self, _: object = None) -> None:
        raw = io.BytesIO()
        picture = self._draw(**self.values())
        picture.savefig(raw, format="png", facecolor="white", pil_kwargs={"compress_level": 1})
        self._image.value = raw.getvalue()


def rotation_explorer(order: str = "ZXY", degrees: Sequence[float] = (35, 50, -20)) -> Explorer:
    """Three sliders for the Euler angles of any of the twelve orders, the gimbal, and the rotation in other forms.

    >>> explorer = rotation_explorer()
    >>> explorer.controls["second"].value = 90
    """
    if order not in ORDERS:
        raise MotionKitError(f"Euler order {order!r}: expected one of {', '.join(ORDERS)}")

    def draw(order: str, first: float, second: float, third: float) -> object:
        picture = StaticFigure(figsize=(7.6, 3.9), dpi=115)
        plot_gimbal(order, (first, second, third), ax=picture.add_axes((0, 0, 0.53, 1)))
        write_numbers(picture, order, (first, second, third))
        return picture

    choose = ipywidgets.Dropdown(options=ORDERS, value=order, description="order", layout={"width": "180px"})
    names = ("first", "second", "third")
    sliders = {name: _angle_slider(value) for name, value in zip(names, degrees, strict=True)}
    lock = ipywidgets.Button(
        description="lock it",
        tooltip="Set the second angle so that the gimbal locks",
        layout={"width": "90px", "margin": "6px 0 0 90px"},
    )
    explorer = Explorer({"order": choose, **sliders}, draw, [lock])

    def label(_: object = None) -> None:
        for letter, place, slider in zip(choose.value, "₁₂₃", sliders.values()):
            slider.description = f"{letter}{place} (°)"

    label()
    choose.observe(label, "value")
    lock.on_click(lambda _: explorer.set(second=90 if len(set(choose.value)) == 3 else 0))
    return explorer


def _angle_slider(value: float, limit: int = 180, text: str = "") -> ipywidgets.IntSlider:
    return ipywidgets.IntSlider(value=round(value), min=-limit, max=limit, description=text, layout={"width": "500px"})


def turn_joint(motion: object, joint: str, axis: str, degrees: float) -> object:
    """The motion with one joint turned further, about an axis X, Y or Z of its own frame, in every frame.

    >>> import motionkit as mk
    >>> m = mk.load("data/actor/walk_neutral.bvh")
    >>> moved = (turn_joint(m, "left_elbow", "Z", 40).positions() - m.positions()).norm(dim=-1).amax(0) > 1e-4
    >>> [name for name, it in zip(m.skeleton.names, moved) if it]
    ['left_wrist']
    """
    number = motion.skeleton.index(joint)
    turn = rot.axis_angle_to_quaternion(torch.eye(3)[rot.AXES[axis]], torch.deg2rad(torch.tensor(float(degrees))))
    rotations = motion.rotations.clone()
    rotations[:, number] = rot.quaternion_multiply(rotations[:, number], turn.to(rotations))
    return motion.replace(rotations=rotations)


def plot_turned(
    motion: object, joint: str, axis: str = "Z", degrees: float = 40.0, frame: int = 0, *, ax: object = None
) -> object:
    """A pose before (pale) and after one joint is turned: the chain down to the joint, and in yellow what it carries.

    A line shows the path on which the farthest joint got there. Returns the matplotlib Figure.
    """
    ax, picture = _axes(ax, (5.4, 4.6))
    at, skeleton = motion[frame].at_origin(), motion.skeleton
    number, size = skeleton.index(joint), skeleton.height or 1.0
    carried, chain = skeleton.descendants(number), skeleton.ancestors(number)
    before, after = figures([at, turn_joint(at, joint, axis, degrees)], layout="overlay")
    palette = ["#56616e" if j in chain else "#b9c1cb" for j in range(len(skeleton))]
    for j in carried[1:]:
        palette[j] = colours.ROLES["result"]
    palette[number] = palette[number] if number else "#56616e"
    view = view_axes(before.left)
    draw_floor(ax, view, np.float32([0, 0, 0]), 1.1 * size, 0.28 * size)
    draw_figure(ax, replace(before, colours=("#e3e7ec",) * len(skeleton)), before.points[0], view, zorder=2)
    draw_figure(ax, replace(after, colours=tuple(palette)), after.points[0], view, zorder=4)
    centre = before.points[0, number]
    axle = rot.quaternion_rotate(at.world_rotations()[0, number], torch.eye(3)[rot.AXES[axis]])
    arm = torch.from_numpy(max((before.points[0, j] - centre for j in carried), key=np.linalg.norm))
    sweep = rot.axis_angle_to_quaternion(axle, torch.deg2rad(torch.linspace(0, degrees, 25)))
    path = centre + rot.quaternion_rotate(sweep, arm).numpy()
    ax.plot(*(path @ view.T)[:, :2].T, color=colours.CONTACT, lw=1.8, zorder=8)
    ends = (centre + np.float32([[-1], [1]]) * 0.16 * size * axle.numpy()) @ view.T
    ax.plot(*ends[:, :2].T, color=AXIS_COLOURS[axis], lw=2.4, solid_capstyle="round", zorder=9)
    ax.plot(*(centre @ view.T)[:2], "o", ms=7, color="white", mec=AXIS_COLOURS[axis], mew=2, zorder=10)
    ax.set(xlim=(-0.68 * size, 0.68 * size), ylim=(-0.12 * size, 1.12 * size), aspect="equal")
    ax.set_axis_off()
    return picture


def fk_explorer(motion: object, joint: str | None = None, axis: str = "Z", degrees: float = 50.0) -> Explorer:
    """Choose a joint and drag its angle: all that hangs on it moves as one piece, all else stays.

    motion: a Motion. joint: where to begin; left out, the left shoulder or, where no name tells, the second joint.
    """
    if not len(motion):
        raise MotionKitError(f"{motion!r} has no frame to show")
    names = motion.skeleton.names
    first = names[motion.skeleton.roles.get("left_shoulder", min(1, len(names) - 1))]
    chosen = names[motion.skeleton.index(joint)] if joint else first

    def draw(joint: str, axis: str, angle: float, frame: int) -> object:
        picture = StaticFigure(figsize=(7.6, 4.2), dpi=115)
        ax = picture.add_axes((0, 0, 1, 1))
        plot_turned(motion, joint, axis, angle, frame, ax=ax)
        ax.set_xlim(*(x * motion.skeleton.height for x in (-0.74, 1.5)))  # leave room for the names
        _write_chain(picture, motion.skeleton, motion.skeleton.index(joint))
        return picture

    controls = {
        "joint": ipywidgets.Dropdown(options=names, value=chosen, description="joint", layout={"width": "230px"}),
        "axis": ipywidgets.ToggleButtons(
            options=list("XYZ"), value=axis, style={"button_width": "40px"}, layout={"margin": "6px 0 0 90px"}
        ),
        "angle": _angle_slider(degrees, 150, "angle (°)"),
        "frame": ipywidgets.IntSlider(value=0, max=len(motion) - 1, description="frame", layout={"width": "500px"}),
    }
    return Explorer(controls, draw)


def _write_chain(picture: object, skeleton: object, joint: int) -> None:
    """At the right, the joints from the root down to the one turned, and those that it carries."""
    from matplotlib.offsetbox import AnchoredOffsetbox, TextArea, VPacker

    chain = [skeleton.names[j] for j in skeleton.ancestors(joint)]
    carried = [skeleton.names[j] for j in skeleton.descendants(joint)[1:]] or ["nothing: it is a leaf"]
    shown = carried if len(carried) <= 7 else [*carried[:6], f"and {len(carried) - 6} more"]
    deep = colours.mix(colours.ROLES["result"], "#5a3d00", 0.45)
    parts = (("the chain from the root", SOFT), (chain, "#56616e"), ("\nwhat it carries", SOFT), (shown, deep))
    texts = ["\n".join(text) if isinstance(text, list) else text for text, _ in parts]
    letters = {"fontsize": 9.5, "linespacing": 1.45}
    areas = [TextArea(text, textprops={**letters, "color": ink}) for text, (_, ink) in zip(texts, parts)]
    box = AnchoredOffsetbox("upper left", child=VPacker(children=areas, pad=0, sep=4), frameon=False, pad=0,
                            bbox_to_anchor=(0.68, 0.96), bbox_transform=picture.transFigure)  # fmt: skip
    picture.add_artist(box)


_unit = rot.normalize


def _frame(b1: Tensor, b2: Tensor) -> Tensor:
    """The matrix [..., 3, 3] with these two columns and their cross product."""
    return torch.stack((b1, b2, torch.linalg.cross(b1, b2)), -1)


def _unscaled_frame(sixd: Tensor) -> Tensor:
    """Gram-Schmidt that measures the second column along the first before that has length 1."""
    c1, c2 = sixd.unflatten(-1, (2, 3)).unbind(-2)
    return _frame(_unit(c1), _unit(c2 - (c1 * c2).sum(-1, keepdim=True) * c1))


def _rotation_pairs() -> dict[str, tuple]:
    a, b = (_unit(seeded_randn(5, 4, seed=seed)) for seed in (0, 1))
    same = _unit(seeded_randn(3, 4))
    return {
        "at the start": (a, b, 0.0),
        "3/10 of the way": (a, b, 0.3),
        "at the end": (a, b, 1.0),
        "equal rotations": (same, same, 0.5),
        "one rotation, written with both signs": (same, -same, 0.5),
    }


def _arc(a: Tensor, b: Tensor, t: float) -> Tensor:
    """The formula of slerp as it stands: the long way where the product is negative, 0/0 where both are equal."""
    angle = torch.acos((a * b).sum(-1, keepdim=True))
    return (torch.sin((1 - t) * angle) * a + torch.sin(t * angle) * b) / torch.sin(angle)


def _flip(a: Tensor, b: Tensor) -> Tensor:
    return torch.where((a * b).sum(-1, keepdim=True) < 0, -b, b)


EXERCISES = {
    "sixd_to_matrix": Exercise(
        rot.sixd_to_matrix,
        cases=lambda: {
            "random numbers": (seeded_randn(7, 6),),
            "2, 0, 0 and 1, 1, 0": (torch.tensor([[2.0, 0, 0, 1, 1, 0]]),),
        },
        hints=(
            "three columns of length 1 at right angles: which of the two given ones keeps its direction?",
            "scale the first, take its part out of the second, scale that, and cross them; columns, not rows.",
            "b1 = c1 / |c1|, then b2 from c2 - (b1 · c2) b1, and torch.stack((b1, b2, cross(b1, b2)), -1).",
        ),
        mistakes={
            "The three vectors are the columns: stack them along the last dimension, -1.": lambda x: (
                rot.sixd_to_matrix(x).mT
            ),
            "Take out of c2 its part along b1 before you scale it.": lambda x: _frame(
                _unit(x[..., :3]), _unit(x[..., 3:])
            ),
            "Scale c1 to length 1 before you measure c2 along it.": _unscaled_frame,
            "b1 × b2, in this order: the other is a mirror image.": lambda x: (
                rot.sixd_to_matrix(x) * torch.tensor([1, 1, -1])
            ),
        },
    ),
    "slerp": Exercise(
        rot.slerp,
        cases=_rotation_pairs,
        hints=(
            "which of two arcs is the shorter one, and what if there is none?",
            "flip b where its product with a is negative, and think of sin Ω = 0.",
            "torch.where(sin Ω is nearly 0, a straight line, the formula), with the product clamped to at most 1.",
        ),
        mistakes={
            "That is the long way round: use -b where the product of a and b is negative.": _arc,
            "Where both are equal, sin Ω is 0: go straight there.": lambda a, b, t: _arc(a, _flip(a, b), t),
            "A straight line cuts through the sphere: weigh a and b with sines.": lambda a, b, t: (1 - t) * a + t * b,
            "A straight line brought back to length 1 does not turn at constant speed: weigh a and b with sines.": (
                lambda a, b, t: _unit((1 - t) * a + t * _flip(a, b))
            ),
        },
    ),
    "swing_angle": Exercise(
        rot.quaternion_angle,
        cases=lambda: {
            "random rotations": _rotation_pairs()["at the start"][:2],
            "q and -q": (torch.eye(4)[:1], -torch.eye(4)[:1]),
        },
        hints=(
            "which of the four numbers of a quaternion tells how far it turns?",
            "w is the cosine of half the angle; q and -q are one rotation, so use the absolute value of w.",
            "2 * acos(|a · b|), or better 2 * atan2(length of x, y, z; |w|) of the product of a's inverse and b.",
        ),
        mistakes={
            "q and -q are one rotation: take |w|.": lambda a, b: 2 * torch.acos((a * b).sum(-1).clamp(-1, 1)),
            "The arccosine of w is only half of the angle.": lambda a, b: rot.quaternion_angle(a, b) / 2,
            "In radians, please.": lambda a, b: torch.rad2deg(rot.quaternion_angle(a, b)),
            "The distance of the four numbers is no angle: q and -q are 2 apart.": lambda a, b: (a - b).norm(dim=-1),
        },
    ),
}
