"""Notebook 05: clouds on their way into noise and out, poses at several steps, quality over time; its exercises."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import ipywidgets
import numpy as np
import torch
from torch import Tensor

from ..diffusion import NoiseSchedule
from ..errors import MotionKitError
from ..sampling import timesteps
from ..viewer import colours
from ..viewer.figure import as_list
from ..viewer.plots import INK, SOFT, StaticFigure, strip, style_axes
from . import Exercise, seeded_randn
from .representation import Explorer

SAMPLER_COLOURS = (colours.LEFT, colours.RIGHT, colours.ROLES["content"], colours.CYCLE[3])
_SHADOW = "#c9d0d9"
_SHOWN = 1500  # dots a cloud; more only make the picture larger
_MARKS = "osD^"


def plot_film(
    clouds: Mapping[str, Tensor],
    labels: Tensor | None = None,
    shadow: Tensor | None = None,
    reach: float = 4.0,
    names: Sequence[str] = (),
    inches: float = 1.9,
) -> object:
    """Clouds of points side by side at one scale, such as one cloud at several steps of its way into noise or out.

    clouds: title to points [N, 2]. labels: class of each point, long [N], for its colour; names: of the classes, for a
    legend. shadow: points [M, 2] that are drawn in grey under each cloud. reach: of the axes, both ways from 0. inches:
    the width of a panel. Returns the matplotlib Figure. Raises MotionKitError for points of another shape.

    >>> import torch
    >>> picture = plot_film({"step 0": torch.zeros(5, 2), "step 9": torch.randn(5, 2)})
    >>> [ax.get_title() for ax in picture.axes]
    ['step 0', 'step 9']
    """
    if not clouds:
        raise MotionKitError("plot_film: expected at least one named cloud of points [N, 2], found none")
    for name, cloud in clouds.items():
        if cloud.ndim != 2 or cloud.shape[1] != 2 or (labels is not None and len(labels) != len(cloud)):
            found = list(cloud.shape) + ([f"with {len(labels)} labels"] if labels is not None else [])
            raise MotionKitError(f"plot_film: {name!r} must be points [N, 2], a label for each; found {found}")
    picture = StaticFigure(figsize=(inches * len(clouds), inches + 0.3), dpi=105, layout="constrained")
    panels = picture.subplots(1, len(clouds), squeeze=False)[0]
    for ax, (name, cloud) in zip(panels, clouds.items()):
        if shadow is not None:
            ax.plot(*shadow[:_SHOWN].T.tolist(), ".", color=_SHADOW, ms=2, mec="none", zorder=1)
        _dots(ax, cloud, labels, names if ax is panels[0] else ())
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        ax.set_title(name, fontsize=9.5, color=INK)
        style_axes(ax)
        ax.tick_params(labelleft=False, labelbottom=False, length=0)
    return picture


def _dots(ax: object, cloud: Tensor, labels: Tensor | None, names: Sequence[str]) -> None:
    """The points of a cloud, each class in its colour, and a legend where the classes have names."""
    for n in [0] if labels is None else sorted(set(labels.tolist())):
        part = cloud if labels is None else cloud[labels == n]
        text = names[n] if n < len(names) else None
        ink = SAMPLER_COLOURS[(1, 0, 2, 3)[n % 4]]
        ax.plot(*part[:_SHOWN].detach().T.tolist(), ".", color=ink, ms=3, alpha=0.6, mec="none", zorder=2, label=text)
    if names:
        ax.legend(frameon=False, fontsize=8, labelcolor=INK, loc="lower left", handletextpad=0, markerscale=2.5,
                  borderpad=0, borderaxespad=0.2)  # fmt: skip


def plot_poses(
    rows: object, captions: Sequence[str] = (), labels: Sequence[str] | None = None, roles: Sequence[str] | None = None
) -> object:
    """Poses beside each other, one for each frame of a motion, such as one pose at several steps; a row a motion.

    rows: a Motion or a list of them, with as many frames each. captions: a text under each pose. labels, roles: as for
    `strip`. Returns the matplotlib Figure. Raises MotionKitError where numbers do not agree.

    >>> import motionkit as mk
    >>> picture = plot_poses(mk.load("data/actor/walk_neutral.bvh")[:40:10], ["a", "b", "c", "d"])
    >>> [text.get_text() for text in picture.axes[0].texts][-4:]
    ['a', 'b', 'c', 'd']
    """
    motions = as_list(rows)
    poses = len(motions[0])
    if {len(motion) for motion in motions} != {poses} or len(captions) not in (0, poses):
        raise MotionKitError(
            f"plot_poses: rows have {[len(m) for m in motions]} frames, and there are {len(captions)} captions; "
            "expected as many frames in each row, and a caption for each of them or none"
        )
    picture = strip([motion.replace(fps=1.0) for motion in motions], poses=poses, labels=labels, roles=roles)
    for place, text in zip(picture.axes[0].texts[-poses:], captions or [""] * poses):
        place.set_text(text)
    return picture


def plot_quality(
    runs: Mapping[str, Sequence[tuple[int, float, float]]], floor: float | None = None, ylabel: str = "distance"
) -> object:
    """What samplers reach in so many steps, and in so much time: two panels, a curve for each sampler.

    runs: name to (steps, seconds, distance) of several runs, all above 0. floor: the distance of two samples of real
    data, a dashed line. Returns the matplotlib Figure. Raises MotionKitError for a run that is not three such numbers.

    >>> picture = plot_quality({"ddim": [(5, 0.1, 2.0), (50, 1.0, 0.5)]}, floor=0.4)
    >>> [ax.get_xlabel() for ax in picture.axes]
    ['steps', 'seconds']
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    for name, points in runs.items():
        if not len(points) or not all(len(point) == 3 and min(point) > 0 for point in points):
            raise MotionKitError(
                f"plot_quality: {name!r} must be (steps, seconds, distance), all above 0; found {points}"
            )
    picture = StaticFigure(figsize=(8.6, 2.9), dpi=105, layout="constrained")
    panels = picture.subplots(1, 2, sharey=True)
    for column, (ax, xlabel) in enumerate(zip(panels, ("steps", "seconds"))):
        for n, (name, points) in enumerate(runs.items()):
            x, y = np.asarray(points)[:, column], np.asarray(points)[:, 2]
            ink, mark = SAMPLER_COLOURS[n % len(SAMPLER_COLOURS)], _MARKS[n % len(_MARKS)]
            ax.plot(x, y, "-", marker=mark, color=ink, lw=2, ms=5.5, label=name)
        if floor is not None:
            ax.axhline(floor, color=SOFT, lw=1.2, ls="--", label="real against real")
        ax.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel if column == 0 else "")
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        style_axes(ax)
    ticks = sorted({int(point[0]) for points in runs.values() for point in points})
    panels[0].set_xticks(ticks, [str(tick) for tick in ticks])
    panels[0].minorticks_off()
    panels[0].legend(frameon=False, fontsize=8.5, labelcolor=INK, loc="best")
    return picture


def slide(draw: Callable[..., object], width: int = 760, **ranges: Sequence) -> Explorer:
    """A picture with sliders under it; a saved page shows it as it was last drawn.

    draw: called with the sliders' values by name, gives a matplotlib Figure. ranges: for each slider (values, first):
    the values it goes through, and the one it starts at. width: of the picture, pixels. Returns an `Explorer`. Raises
    MotionKitError where the first is none of the values.

    >>> picture = slide(lambda t: plot_quality({"a": [(t, 1.0, 1.0)]}), t=((1, 5, 10), 5))
    >>> picture.controls["t"].value = 10
    >>> picture.values()
    {'t': 10}
    """
    wide = {"layout": {"width": "520px"}, "style": {"description_width": "70px"}}
    controls = {}
    for name, (values, first) in ranges.items():
        values = list(values)
        if first not in values:
            raise MotionKitError(f"slide: {name} cannot start at {first}; its values are {values[:4]} to {values[-1:]}")
        controls[name] = ipywidgets.SelectionSlider(options=values, value=first, description=name, **wide)
    return Explorer(controls, draw, width=width, in_one_column=True)


def _x0_from_velocity(x: Tensor, v: Tensor, bar_t: float) -> Tensor:
    """The clean sample behind x, from the target between it and the noise (Salimans, Ho 2022, appendix D)."""
    return bar_t**0.5 * x - (1 - bar_t) ** 0.5 * v


def _noised() -> dict[str, tuple]:
    """Samples with noise, their v, and the share of the variance that is signal."""
    x0, noise = seeded_randn(2, 5, 3)
    shares = {"nearly clean": 0.99, "half noise": 0.5, "nearly noise": 0.001}
    mixed = [(words, share, share**0.5, (1 - share) ** 0.5) for words, share in shares.items()]
    return {words: (a * x0 + b * noise, a * noise - b * x0, share) for words, share, a, b in mixed}


def _sampler_steps(most: int, count: int, start: int) -> list[int]:
    """The steps that a sampler stops at, the noisiest first."""
    return timesteps(NoiseSchedule.linear(most), count, start)


def _key_frames(frames: int, numbers: int, keys: list[int]) -> Tensor:
    """Which numbers of which frames are given, bool [frames, numbers]."""
    where = torch.zeros(frames, numbers, dtype=torch.bool)
    where[keys] = True
    return where


EXERCISES = {
    "key_frames": Exercise(
        _key_frames,
        cases=lambda: {"the first and the last": (8, 3, [0, -1]), "one in the middle": (6, 2, [2]), "none": (5, 4, [])},
        hints=(
            "begin with a mask in which nothing is given.",
            "True in all numbers of the frames in keys, False in all others.",
            "torch.zeros(frames, numbers, dtype=torch.bool), and a list of frames is an index into it.",
        ),
        mistakes={
            "True is for what is given, False for what the network fills in.": lambda *case: ~_key_frames(*case),
            "-1 is the last frame, as in Python: `in keys` does not see it.": lambda frames, numbers, keys: _key_frames(
                frames, numbers, [key for key in keys if key >= 0]
            ),
            "One for every number of a frame, not one for the frame.": lambda *case: _key_frames(*case)[:, 0],
            "A mask is of dtype torch.bool.": lambda *case: _key_frames(*case).float(),
        },
    ),
    "sampler_steps": Exercise(
        _sampler_steps,
        cases=lambda: {
            "1000, 20, 300: paper 1": (1000, 20, 300),
            "1000, 50, 1000: from the noisiest": (1000, 50, 1000),
            "100, 4, 60: start is not on the grid": (100, 4, 60),
            "10, 10, 10: every step": (10, 10, 10),
        },
        hints=(
            "how far apart would the steps be from `most` on? `start` changes nothing about that.",
            "the distance is most / count, from start down; 0 itself is not a step that the network is asked at.",
            "start, start - most / count, start - 2 * most / count and so on, as long as they are above 0.",
        ),
        mistakes={
            "Started later, it keeps the distance most / count, and so takes fewer steps.": lambda most, count, start: (
                _sampler_steps(start, count, start)
            ),
            "At 0 there is no noise left to take away: the last step is above it.": lambda *case: [
                *_sampler_steps(*case),
                0,
            ],
            "The noisiest first.": lambda *case: _sampler_steps(*case)[::-1],
            "The grid begins at `start`, also where that is not a step from `most` on.": lambda most, count, start: (
                [step for step in _sampler_steps(most, count, most) if step <= start]
            ),
        },
    ),
    "x0_from_velocity": Exercise(
        _x0_from_velocity,
        cases=_noised,
        hints=(
            "m_t and v are two sums of the same two things: which combination of them has no noise in it?",
            "write x and v as sums of m_0 and noise, multiply one by the root of bar_t, the other by that of "
            "1 - bar_t: the noise drops out of their difference.",
            "the squares of the two roots add up to 1, so what is left is m_0 itself: root * x - other root * v.",
        ),
        mistakes={
            "Minus: the noise is to drop out.": lambda x, v, bar_t: bar_t**0.5 * x + (1 - bar_t) ** 0.5 * v,
            "The roots belong to the other one each.": lambda x, v, bar_t: (1 - bar_t) ** 0.5 * x - bar_t**0.5 * v,
            "Take the roots of bar_t and of 1 - bar_t.": lambda x, v, bar_t: bar_t * x - (1 - bar_t) * v,
            "That is the noise; m_0 is asked for.": lambda x, v, bar_t: (1 - bar_t) ** 0.5 * x + bar_t**0.5 * v,
        },
    ),
}
