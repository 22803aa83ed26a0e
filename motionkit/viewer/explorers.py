"""Widgets to turn things by hand: three Euler angles with their gimbal, and one joint of a body.

Each is a picture with sliders under it. Matplotlib draws the picture anew at every move of a slider, and the last
one drawn is what a page without a kernel shows.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import ipywidgets
import numpy as np
import torch

from .. import rotations as rot
from ..errors import MotionKitError
from . import colours
from .body import figures
from .drawing import draw_figure, draw_floor, view_axes
from .gimbal import AXIS_COLOURS, plot_gimbal, write_numbers
from .plots import SOFT, _axes, few_colours

ORDERS = ("ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX", "ZXZ", "ZYZ", "XYX", "XZX", "YXY", "YZY")


class Explorer(ipywidgets.VBox):
    """A picture over the controls that change it.

    controls: name to widget; whole-number sliders stand at the right, all else at the left. draw: called with the
    controls' values, gives a matplotlib Figure. buttons: widgets shown with the controls that are no argument of
    `draw`. width: of the picture, pixels.

    >>> slider = ipywidgets.IntSlider(value=2)
    >>> explorer = Explorer({"x": slider}, lambda x: _axes(None, (2, 1))[1])
    >>> before = explorer.png
    >>> slider.value = 5
    >>> explorer.values()
    {'x': 5}
    """

    def __init__(
        self,
        controls: Mapping[str, ipywidgets.Widget],
        draw: Callable[..., object],
        buttons: Sequence[ipywidgets.Widget] = (),
        width: int = 760,
    ) -> None:
        self.controls, self._draw = dict(controls), draw
        self._image = ipywidgets.Image(format="png", layout={"width": f"{width}px", "max_width": "100%"})
        sliders = [c for c in self.controls.values() if isinstance(c, ipywidgets.IntSlider)]
        choices = [c for c in self.controls.values() if c not in sliders]
        columns = [ipywidgets.VBox([*choices, *buttons], layout={"width": "240px"}), ipywidgets.VBox(sliders)]
        super().__init__([self._image, ipywidgets.HBox(columns, layout={"flex_flow": "row wrap"})])
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

    def _redraw(self, _: object = None) -> None:
        self._image.value = _png(self._draw(**self.values()))

    def _repr_mimebundle_(self, **more: object) -> dict:
        """The live widget, and beside it the picture for pages that run nothing."""
        bundle = super()._repr_mimebundle_(**more) or {}
        return {
            **bundle,
            "image/png": base64.b64encode(few_colours(io.BytesIO(self.png))).decode(),
            "text/plain": "(sliders: run this cell)",
        }


def _png(picture: object) -> bytes:
    raw = io.BytesIO()
    picture.savefig(raw, format="png", facecolor="white", pil_kwargs={"compress_level": 1})
    return raw.getvalue()


def rotation_explorer(order: str = "ZXY", degrees: Sequence[float] = (35, 50, -20)) -> Explorer:
    """Three sliders for the Euler angles of any of the twelve orders, the gimbal, and the rotation in other forms.

    >>> explorer = rotation_explorer()
    >>> explorer.controls["second"].value = 90
    """
    if order not in ORDERS:
        raise MotionKitError(f"Euler order {order!r}: expected one of {', '.join(ORDERS)}")

    def draw(order: str, first: float, second: float, third: float) -> object:
        from matplotlib.figure import Figure

        picture = Figure(figsize=(7.6, 3.9), dpi=115)
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
    carried, chain = skeleton.below(number), skeleton.chain(number)
    before, after = figures([at, turn_joint(at, joint, axis, degrees)], layout="overlay")
    palette = [
        colours.ROLES["result"] if j in carried[1:] else "#56616e" if j in chain else "#b9c1cb"
        for j in range(len(skeleton))
    ]
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
        from matplotlib.figure import Figure

        picture = Figure(figsize=(7.6, 4.2), dpi=115)
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

    chain = [skeleton.names[j] for j in skeleton.chain(joint)]
    carried = [skeleton.names[j] for j in skeleton.below(joint)[1:]] or ["nothing: it is a leaf"]
    shown = carried if len(carried) <= 7 else [*carried[:6], f"and {len(carried) - 6} more"]
    deep = colours.mix(colours.ROLES["result"], "#5a3d00", 0.45)
    parts = (("the chain from the root", SOFT), (chain, "#56616e"), ("\nwhat it carries", SOFT), (shown, deep))
    texts = ["\n".join(text) if isinstance(text, list) else text for text, _ in parts]
    areas = [
        TextArea(text, textprops={"fontsize": 9.5, "color": c, "linespacing": 1.45})
        for text, (_, c) in zip(texts, parts)
    ]
    box = AnchoredOffsetbox("upper left", child=VPacker(children=areas, pad=0, sep=4), frameon=False, pad=0,
                            bbox_to_anchor=(0.68, 0.96), bbox_transform=picture.transFigure)  # fmt: skip
    picture.add_artist(box)
