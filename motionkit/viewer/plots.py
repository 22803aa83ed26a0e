"""Pictures for print, drawn with matplotlib: strips of poses, stills, paths from above, curves over time."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure as Picture

from ..errors import MotionKitError
from . import colours
from .figure import (
    TURN,
    Figure,
    as_list,
    draw_figure,
    draw_floor,
    figures,
    label_texts,
    left_mask,
    per_motion,
    view_axes,
)

INK, SOFT = "#39424e", "#7a8491"


class StaticFigure(Picture):
    """A matplotlib Figure that notebooks show by itself, without pyplot and the figures it keeps."""

    def png(self) -> bytes:
        """The bytes of a PNG with few colours."""
        return few_colours(self._raw())

    def jpeg(self) -> bytes:
        """The bytes of a JPEG."""
        from PIL import Image

        small = io.BytesIO()
        with Image.open(self._raw()) as image:
            image.convert("RGB").save(small, format="jpeg", quality=80, optimize=True)
        return small.getvalue()

    def _raw(self) -> io.BytesIO:
        raw = io.BytesIO()
        self.savefig(raw, format="png", facecolor="white")
        return raw

    def _repr_png_(self) -> bytes:
        return self.png()

    def _ipython_display_(self) -> None:
        """Goes before the way in which pyplot, once imported, shows figures: its pictures are ten times as large."""
        from IPython.display import display

        picture = base64.b64encode(self.png()).decode()
        display({"image/png": picture, "text/plain": repr(self)}, raw=True)


def strip(
    motions: object,
    *,
    poses: int = 8,
    labels: Sequence[str] | None = None,
    roles: Sequence[str] | None = None,
    ax: object = None,
) -> object:
    """A strip of poses at equal times from left to right, one row for each motion, as papers print them.

    motions: a Motion or a list. poses: how many in a row. labels, roles: as for `Player`. ax: matplotlib axes to draw
    into; None makes a figure. Returns the matplotlib Figure. Rows share the time scale: a shorter motion's row ends
    sooner.

    >>> import motionkit as mk
    >>> picture = mk.strip(mk.load("data/actor/walk_neutral.bvh"), poses=6)
    >>> picture.savefig("strip.pdf")  # doctest: +SKIP
    """
    if poses < 1:
        raise MotionKitError(f"strip: expected at least one pose, found poses={poses}")
    rows = figures(motions, roles=roles, layout="overlay")
    step, high = _spacing(rows)
    wide = min(1.25 * poses, 11.4)
    ax, figure = _axes(ax, (wide + 0.6, 0.35 + len(rows) * wide / (poses * step) * high))
    times = np.linspace(0, max(f.end for f in rows), poses)
    for row, character in enumerate(rows):
        _strip_row(ax, character, times, step, -row * high)
    _strip_texts(ax, label_texts(motions, labels, roles), [f.role if roles else None for f in rows], times, step, high)
    ax.set_xlim(-0.75 * step, (poses - 0.45) * step)
    ax.set_ylim(-(len(rows) - 1) * high - 0.2 * high, 0.97 * high)
    ax.set_aspect("equal")
    ax.set_axis_off()
    return figure


def _strip_texts(ax: object, labels: list, tints: list, times: np.ndarray, step: float, high: float) -> None:
    """Row labels at the left, times under the last row."""
    for row, (text, tint) in enumerate(zip(labels, tints)):
        colour = colours.mix(tint, "#000000", 0.3) if tint else INK
        place = {"ha": "center", "va": "center", "rotation": 90}
        ax.text(-0.62 * step, (0.45 - row) * high, text or "", fontsize=9.5, color=colour, fontweight="bold", **place)
    for n, time in enumerate(times):
        place = {"ha": "center", "va": "top"}
        ax.text(n * step, (0.91 - len(labels)) * high, f"{time:.1f} s", fontsize=8, color=SOFT, **place)


def _spacing(rows: Sequence[Figure]) -> tuple[float, float]:
    """The distance between poses and between rows, metres."""
    wide, high = 0.0, 0.0
    for f in rows:
        view = (f.points[:, f.drawn] - _middles(f)[:, None]) @ view_axes(f.left).T
        wide = max(wide, 2 * float(np.percentile(np.abs(view[..., 0]), 98)))
        high = max(high, float(view[..., 1].max()) + 2 * f.head_radius)
    size = max(f.size for f in rows)
    return max(1.05 * wide, 0.42 * size), max(1.18 * high, 0.3 * size)


def _middles(figure: Figure) -> np.ndarray:
    """Where the body is on the floor in each frame, [F, 3]."""
    return figure.points[:, figure.drawn].mean(axis=1) * np.float32([1, 0, 1])


def _strip_row(ax: object, figure: Figure, times: np.ndarray, step: float, base: float) -> None:
    ground = [-0.5 * step, (len(times) - 0.5) * step]
    ax.plot(ground, [base, base], color="#c5ccd5", lw=0.8, zorder=0, solid_capstyle="round")
    for n, time in enumerate(times[times <= figure.end + 1e-6]):
        pose = figure.at(time)
        middle = pose[list(figure.drawn)].mean(axis=0) * np.float32([1, 0, 1])
        draw_figure(_Lifted(ax, base), figure, pose - middle, view_axes(figure.left), n * step, zorder=2 + 0.01 * n)


class _Lifted:
    """Matplotlib axes that put what is drawn at another height: rows of a strip."""

    def __init__(self, ax: object, base: float) -> None:
        self.ax, self.base = ax, base

    def add_collection(self, shapes: object) -> None:
        from matplotlib.transforms import Affine2D

        shapes.set_transform(Affine2D().translate(0, self.base) + self.ax.transData)
        self.ax.add_collection(shapes, autolim=False)
        shapes.set_clip_on(False)  # the longest step of a turning body reaches past the axes, into the margin


def still(
    motions: object,
    frame: int = 0,
    *,
    labels: Sequence[str] | None = None,
    roles: Sequence[str] | None = None,
    layout: str = "side",
    ax: object = None,
) -> object:
    """A still picture of one motion or several at a frame of the first; returns the matplotlib Figure.

    It is what `Player` leaves on a page that runs nothing. A motion that ended before holds its last pose.
    """
    shown = figures(motions, roles=roles, layout=layout)
    texts = label_texts(motions, labels, roles)
    time = frame / shown[0].fps
    axes = view_axes(shown[0].left, TURN if len(shown) == 1 else 0.36)
    poses = [f.at(time) for f in shown]
    ax, picture = _axes(ax, (7.6, 3.8))
    everywhere = np.concatenate([p[list(f.drawn)] for p, f in zip(poses, shown)])
    size = max(f.size for f in shown)
    middle = (everywhere.max(axis=0) + everywhere.min(axis=0)) / 2 * np.float32([1, 0, 1])
    spread = float(np.ptp(everywhere @ axes[0])) + 3.2 * size
    draw_floor(ax, axes, middle, spread * 0.75, 0.5 if size > 0.5 else size / 3)
    order = sorted(range(len(shown)), key=lambda n: float((poses[n] @ axes[2]).mean()))
    for rank, n in enumerate(order):
        draw_figure(ax, shown[n], poses[n], axes, zorder=2 + rank)
        if texts[n]:
            view = poses[n][list(shown[n].drawn)] @ axes.T
            place = view[:, 0].mean(), view[:, 1].max() + 0.2 * size
            ax.text(*place, texts[n], ha="center", fontsize=9, color=INK, zorder=20)
    _frame_still(ax, everywhere @ axes.T, size)
    return picture


def _frame_still(ax: object, points: np.ndarray, size: float) -> None:
    """Fits the view around what is seen, [N, 3], and fills the picture's whole shape with it."""
    low, high = points.min(axis=0), points.max(axis=0)
    box = ax.get_window_extent()
    ratio = box.width / max(box.height, 1)
    tall = max(high[1] - low[1] + 0.42 * size, (high[0] - low[0] + 0.8 * size) / ratio)
    x, y = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2 + 0.06 * size
    ax.set_xlim(x - tall * ratio / 2, x + tall * ratio / 2)
    ax.set_ylim(y - tall / 2, y + tall / 2)
    ax.set_aspect("equal")
    ax.set_axis_off()


def still_png(motions: object, frame: int = 0, *, pixels: tuple[int, int] = (760, 380), **shown: object) -> bytes:
    """`still` as the bytes of a PNG with 128 colours, 10 to 30 KB. pixels: width and height."""
    return _still_figure(motions, frame, pixels, shown).png()


def still_jpeg(motions: object, frame: int = 0, *, pixels: tuple[int, int] = (760, 380), **shown: object) -> bytes:
    """`still` as the bytes of a JPEG, about 20 KB. pixels: width and height."""
    return _still_figure(motions, frame, pixels, shown).jpeg()


def _still_figure(motions: object, frame: int, pixels: tuple[int, int], shown: dict) -> StaticFigure:
    picture = StaticFigure(figsize=(pixels[0] / 100, pixels[1] / 100), dpi=100)
    still(motions, frame, ax=picture.add_axes((0, 0, 1, 1)), **shown)
    return picture


def few_colours(raw: io.BytesIO) -> bytes:
    """A PNG with a palette: a quarter of the size, and no difference to the eye in drawings like these."""
    from PIL import Image

    small = io.BytesIO()
    with Image.open(raw) as image:
        flat = image.convert("RGB").quantize(128, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    flat.save(small, format="png", optimize=True)
    return small.getvalue()


def plot_trajectory(
    motions: object,
    *,
    labels: Sequence[str] | None = None,
    roles: Sequence[str] | None = None,
    every: float = 0.5,
    ax: object = None,
) -> object:
    """The paths of motions over the floor, seen from above, arrows for where the body faces every `every` seconds.

    +Z points up the page and +X to the left, so that a character walking +Z has its left hand at the left. Returns the
    matplotlib Figure; axes in metres.
    """
    if every <= 0:
        raise MotionKitError(f"plot_trajectory: expected every > 0 seconds, found {every}")
    ax, picture = _axes(ax, (4.2, 4.2))
    texts = label_texts(motions, labels, roles)
    for motion, figure, text in zip(as_list(motions), figures(motions, roles=roles, layout="overlay"), texts):
        _path(ax, figure, left_mask(figure.points, motion.skeleton.sides, figure.parents), text, every)
    ax.set_xlabel("x (m)")
    ax.set_ylabel("z (m)")
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.15)
    ax.xaxis.set_inverted(True)
    style_axes(ax, legend=any(texts))
    return picture


def _path(ax: object, figure: Figure, across: np.ndarray, text: str | None, every: float) -> None:
    path, dark = _middles(figure)[:, [0, 2]], colours.mix(figure.role, "#000000", 0.35)
    ax.plot(*path.T, color=figure.role, lw=2.2, label=text, solid_capstyle="round")
    at = np.arange(0, len(path), max(1, round(every * figure.fps)))
    facing = (-across[at, 2], across[at, 0])
    size = {"scale_units": "inches", "scale": 3.2, "units": "inches", "width": 0.028}  # the same on axes of any width
    ax.quiver(*path[at].T, *facing, color=dark, angles="xy", zorder=3, **size)
    ax.plot(*path[0], "o", color="white", mec=figure.role, mew=1.6, ms=7, zorder=4)


def plot_curves(
    curves: Mapping[str, object],
    *,
    fps: float | None = None,
    xlabel: str | None = None,
    ylabel: str = "",
    title: str = "",
    roles: Sequence[str] | None = None,
    ax: object = None,
) -> object:
    """Named curves over time (or over steps, without `fps`) in the kit's style; returns the matplotlib Figure.

    curves: name to F values. A name that begins with "left" or "right" takes that side's colour; roles: for each curve
    a role, a colour or None.

    >>> picture = plot_curves({"left foot": [0.0, 0.1], "right foot": [0.1, 0.0]}, fps=30, ylabel="height (m)")
    """
    if not curves:
        raise MotionKitError("plot_curves: expected at least one named curve, found none")
    ax, picture = _axes(ax, (6.4, 2.6))
    for n, ((name, values), role) in enumerate(zip(curves.items(), per_motion(roles, len(curves), "roles"))):
        values = values.detach().cpu().numpy() if hasattr(values, "detach") else np.asarray(values)
        side = next((s for s in ("left", "right") if name.lower().startswith(s)), None)
        colour = colours.SIDES[side] if side and role is None else colours.role_colour(role, n)
        ax.plot(np.arange(len(values)) / (fps or 1), values, color=colour, lw=1.8, label=name)
    ax.set_xlabel(xlabel if xlabel is not None else ("time (s)" if fps else "step"))
    ax.set_ylabel(ylabel)
    ax.set_title(title, fontsize=10, color=INK, loc="left")
    style_axes(ax, legend=len(curves) > 1)
    return picture


def style_axes(ax: object, *, legend: bool = False) -> None:
    """Gives matplotlib axes the kit's look: light grid, no box, soft ink."""
    ax.grid(True, color="#e6e9ee", lw=0.8)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("bottom", "left"):
        ax.spines[side].set_color("#c5ccd5")
    ax.tick_params(colors=SOFT, labelsize=8.5, length=3)
    for label in (ax.xaxis.label, ax.yaxis.label):
        label.set(color=INK, fontsize=9.5)
    if legend:
        longest = max((len(text) for text in ax.get_legend_handles_labels()[1]), default=0)
        columns = int(0.85 * ax.figure.get_figwidth() / (0.5 + 0.07 * longest))  # inches of a key and its text
        look = {"frameon": False, "fontsize": 8.5, "labelcolor": INK, "ncols": min(max(columns, 1), 4)}
        ax.legend(loc="lower right", bbox_to_anchor=(1, 0.99), **look)


def _axes(ax: object, inches: tuple[float, float]) -> tuple[object, object]:
    """Given axes, or those of a new figure."""
    if ax is not None:
        return ax, ax.figure
    picture = StaticFigure(figsize=inches, dpi=110, layout="constrained")
    return picture.add_subplot(), picture
