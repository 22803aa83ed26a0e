"""Pictures of judging: two clouds of features with their Gaussians, and what a classifier mistakes for what."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from ..errors import MotionKitError
from ..metrics.frechet import fmd, gaussian
from .plots import INK, SOFT, Print, style_axes

CLOUD_COLOURS = ("#2244aa", "#d3622b")
_CELLS = ("#ffffff", "#2b6ca8")
_SHOWN = 2000  # dots a cloud; more only make the picture larger


def plot_clouds(
    a: Tensor, b: Tensor, labels: Sequence[str] = ("real", "made"), *, parts: bool = False, ax: object = None
) -> object:
    """Two clouds of points, the Gaussians that stand for them, and the Fréchet distance between these (FMD).

    a: [N, 2], b: [M, 2], at least 3 rows each. A cloud has a cross at its mean, and ellipses at 1 and 2 standard
    deviations. parts: write also what of the distance comes from the means and what from the spreads. ax: matplotlib
    axes to draw into. Returns the matplotlib Figure. Raises MotionKitError where a covariance cannot be had.

    >>> cloud = torch.randn(200, 2, generator=torch.Generator().manual_seed(0))
    >>> plot_clouds(cloud, cloud + torch.tensor([3.0, 0.0]), parts=True).axes[0].get_title(loc="left")
    'FMD 9.00 = means 9.00 + spreads 0.00'
    """
    if len(labels) != 2:
        raise MotionKitError(f"plot_clouds: expected two labels, one a cloud; found {list(labels)}")
    clouds = [_flat(cloud, name) for cloud, name in zip((a, b), labels)]
    bells = [gaussian(cloud, str(name)) for cloud, name in zip(clouds, labels)]
    distance, means = fmd(*clouds), float(((bells[0][0] - bells[1][0]) ** 2).sum())
    picture = Print(figsize=(6.4, 4.2), dpi=110, layout="constrained") if ax is None else ax.figure
    ax = picture.add_subplot() if ax is None else ax
    for cloud, (mean, cov), name, ink in zip(clouds, bells, labels, CLOUD_COLOURS):
        shown = cloud[torch.linspace(0, len(cloud) - 1, min(len(cloud), _SHOWN)).long()]
        size = 8 if len(shown) < 100 else 5 if len(shown) < 1000 else 4
        ax.plot(*shown.T.tolist(), ".", color=ink, ms=size, alpha=0.55, mec="none", zorder=1)
        for deviations in (1, 2):
            ax.add_patch(_ellipse(mean, cov, deviations, ink))
        ax.plot(*mean.tolist(), "+", color=ink, ms=11, mew=2.2, zorder=4, label=f"{name}: {len(cloud):,}")
    title = f"FMD {distance:.2f}"
    if parts:
        title += f" = means {means:.2f} + spreads {max(distance - means, 0):.2f}"
    ax.set_title(title, fontsize=11, color=INK, loc="left")
    ax.set_aspect("equal", adjustable="datalim")
    style_axes(ax)
    ax.legend(frameon=False, fontsize=9, labelcolor=INK, loc="upper right")
    return picture


def _flat(cloud: object, name: object) -> Tensor:
    """Points [N, 2], or an error that says what came instead."""
    if not isinstance(cloud, Tensor) or cloud.ndim != 2 or cloud.shape[1] != 2:
        found = list(cloud.shape) if isinstance(cloud, Tensor) else f"a {type(cloud).__name__}"
        raise MotionKitError(
            f"plot_clouds: expected {name!r} as a tensor of points [N, 2]; found {found}. Draw two columns of features "
            "at a time, or lay them out first with mk.viewer.embed"
        )
    return cloud.detach().cpu().double()


def _ellipse(mean: Tensor, cov: Tensor, deviations: float, ink: str) -> object:
    """All points that lie `deviations` standard deviations from a Gaussian's mean."""
    from matplotlib.patches import Ellipse

    values, vectors = torch.linalg.eigh(cov)
    wide, high = (2 * deviations * values.clamp(min=0).sqrt()).tolist()
    turn = math.degrees(math.atan2(float(vectors[1, 0]), float(vectors[0, 0])))
    look = {"fill": False, "edgecolor": ink, "lw": 2.2 if deviations == 1 else 1.2, "zorder": 3}
    return Ellipse(mean.tolist(), wide, high, angle=turn, **look)


def cloud_explorer(seed: int = 0) -> object:
    """Sliders that move, widen and turn one cloud against another: what the Fréchet distance sees, and what it costs.

    The second line of the picture is the distance between the two Gaussians that the points are drawn from: with few
    points the measured one lies above it. Returns an `Explorer`; its `controls` are "shift", "spread", "turn" and
    "points".

    >>> explorer = cloud_explorer()
    >>> before = explorer.png
    >>> explorer.controls["shift"].value = 2.0
    >>> explorer.png != before
    True
    """
    import ipywidgets

    from .explorers import Explorer

    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(2, 3000, 2, generator=generator, dtype=torch.float64)
    wide = {"layout": {"width": "520px"}, "style": {"description_width": "70px"}}
    controls = {
        "shift": ipywidgets.FloatSlider(value=1.5, min=0, max=4, step=0.1, description="shift", **wide),
        "spread": ipywidgets.FloatSlider(value=1.0, min=0.2, max=2.5, step=0.05, description="spread", **wide),
        "turn": ipywidgets.IntSlider(value=40, min=-90, max=90, description="turn (°)", **wide),
        "points": ipywidgets.SelectionSlider(
            value=300, options=(3, 5, 10, 20, 50, 100, 300, 1000, 3000), description="points", **wide
        ),
    }

    def draw(**values: float) -> object:
        return _draw_explored(noise, **values)

    explorer = Explorer(controls, draw, width=700)
    explorer.children = [explorer.children[0], ipywidgets.VBox(list(controls.values()))]
    return explorer


def _draw_explored(noise: Tensor, shift: float, spread: float, turn: float, points: int) -> object:
    angle = math.radians(turn)
    way = torch.tensor([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]], dtype=torch.float64)
    base = torch.diag(torch.tensor([1.0, 0.4], dtype=torch.float64))
    moved, offset = spread * base @ way, torch.tensor([shift, 0.0], dtype=torch.float64)
    picture = Print(figsize=(7.0, 4.0), dpi=105)
    ax = picture.add_axes((0.06, 0.08, 0.92, 0.76))
    plot_clouds(noise[0, :points] @ base, noise[1, :points] @ moved + offset, parts=True, ax=ax)
    ax.set_aspect("equal", adjustable="box", anchor="W")
    ax.set(xlim=(-4, 8), ylim=(-3, 3))
    ax.set_title(ax.get_title(loc="left"), loc="left", pad=22, fontsize=11, color=INK)
    truth = f"of the Gaussians they are drawn from: {_distance(base, moved, shift):.2f}"
    ax.text(0, 1.03, truth, transform=ax.transAxes, fontsize=9.5, color=SOFT)
    return picture


def _distance(a: Tensor, b: Tensor, shift: float) -> float:
    """FMD of the Gaussians of noise @ a and noise @ b + shift, all 2 x 2.

    >>> _distance(torch.eye(2), 3 * torch.eye(2), 2.0)
    12.0
    """
    # a 2 x 2 matrix M with positive eigenvalues has trace(M^(1/2)) = (trace(M) + 2 det(M)^(1/2))^(1/2)
    cov_a, cov_b = a.T @ a, b.T @ b
    inner = cov_a @ cov_b
    root = (inner.trace() + 2 * inner.det().clamp(min=0).sqrt()).sqrt()
    return float(shift**2 + max(float(cov_a.trace() + cov_b.trace() - 2 * root), 0.0))


def plot_confusion(
    counts: Tensor | Sequence[Tensor],
    labels: Sequence[str] | Sequence[Sequence[str]],
    title: str | Sequence[str] = "",
) -> Print:
    """What a classifier takes each class for: rows are the truth, columns what it found, cells per cent of the row.

    counts: [C, C], as `mk.metrics.confusion` gives; or a list of them, drawn side by side, with a list of labels and of
    titles for each. labels: the C classes. Cells without a clip stay empty; the title ends with the share of all clips
    that are right. Returns the matplotlib Figure.

    >>> picture = plot_confusion(torch.tensor([[3, 1], [0, 4]]), ["walk", "run"], "content")
    >>> picture.axes[0].get_title(loc="left"), [text.get_text() for text in picture.axes[0].texts]
    ('content: 88 % right', ['75', '25', '100'])
    """
    if not isinstance(counts, list | tuple):
        counts, labels, title = [counts], [labels], [title]
    titles = [title] * len(counts) if isinstance(title, str) else list(title)
    if not counts or len(labels) != len(counts) or len(titles) != len(counts):
        raise MotionKitError(
            f"plot_confusion: {len(counts)} tables of counts, {len(labels)} lists of labels and {len(titles)} titles; "
            "expected one of each for every picture"
        )
    tables = [_table(given, names) for given, names in zip(counts, labels)]
    sizes = [len(table) for table in tables]
    wide = min(1.9 * len(tables) + 0.42 * sum(sizes), 11.0)
    picture = Print(figsize=(wide, min(1.5 + 0.42 * max(sizes), 5.6)), dpi=105, layout="constrained")
    panels = picture.subplots(1, len(tables), squeeze=False, width_ratios=[size + 2 for size in sizes])[0]
    for ax, table, names, text in zip(panels, tables, labels, titles):
        _draw_table(ax, table, list(names))
        share = 100 * np.trace(table) / table.sum() if table.sum() else math.nan
        ax.set_title(f"{text}: {share:.0f} % right".removeprefix(": "), fontsize=10.5, color=INK, loc="left")
    panels[0].set_ylabel("truth", color=SOFT, fontsize=9.5)
    return picture


def _table(counts: object, labels: Sequence[str]) -> np.ndarray:
    """Counts [C, C] as numbers, or an error that says what is wrong with them."""
    table = counts.detach().cpu().double().numpy() if isinstance(counts, Tensor) else None
    if table is None or table.ndim != 2 or table.shape[0] != table.shape[1] or not table.size:
        found = list(counts.shape) if isinstance(counts, Tensor) else f"a {type(counts).__name__}"
        raise MotionKitError(
            f"plot_confusion: expected counts [C, C], as mk.metrics.confusion(scores, labels) gives; found {found}"
        )
    if isinstance(labels, str) or len(labels) != len(table):
        found = repr(labels) if isinstance(labels, str) else len(labels)
        raise MotionKitError(f"plot_confusion: expected a label for each of {len(table)} classes; found {found}")
    if not np.isfinite(table).all() or (table < 0).any():
        raise MotionKitError("plot_confusion: expected counts of 0 and more; some are negative or not finite")
    return table


def _draw_table(ax: object, table: np.ndarray, labels: list[str]) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    share = 100 * table / np.maximum(table.sum(1, keepdims=True), 1e-12)
    blues = LinearSegmentedColormap.from_list("cells", _CELLS)
    ax.imshow(share, cmap=blues, vmin=0, vmax=100, aspect="equal")
    small = 8.5 if len(table) < 10 else 7.5
    for row, column in zip(*np.nonzero(table)):
        value = share[row, column]
        text, ink = f"{value:.0f}" if value >= 0.5 else "<1", "white" if value > 55 else INK
        ax.text(column, row, text, ha="center", va="center", fontsize=small, color=ink)
    places = range(len(labels))
    ax.set_xticks(places, labels, rotation=45, ha="right", rotation_mode="anchor", fontsize=small + 0.5, color=INK)
    ax.set_yticks(places, labels, fontsize=small + 0.5, color=INK)
    ax.set_xlabel("found", color=SOFT, fontsize=9.5)
    ax.tick_params(length=0)
    ax.set_xticks(np.arange(len(labels) + 1) - 0.5, minor=True)
    ax.set_yticks(np.arange(len(labels) + 1) - 0.5, minor=True)
    ax.grid(which="minor", color="#dfe4eb", lw=0.8)
    ax.tick_params(which="minor", length=0)
    for spine in ax.spines.values():
        spine.set_color("#dfe4eb")
