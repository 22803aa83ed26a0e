"""Pictures of judging: two clouds of features with their Gaussians, and what a classifier mistakes for what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle

import ipywidgets
import numpy as np
import plotly.graph_objects as go
import torch
from torch import Tensor

from ..arena.table import ARROWS, COLUMNS, ArenaTable, Cell
from ..arena.transfers import REAL
from ..dtw import dtw_costs
from ..errors import MotionKitError
from ..metrics import fmd, gaussian
from ..viewer import colours
from ..viewer.figure import StillWidget
from ..viewer.player import Player
from ..viewer.plots import INK, SOFT, StaticFigure, style_axes
from ..viewer.scenes import Scene
from . import Exercise, seeded_randn
from .representation import Explorer

CLOUD_COLOURS = ("#2244aa", "#d3622b")
_CELLS = ("#ffffff", "#2b6ca8")
_SHOWN = 2000  # dots a cloud; more only make the picture larger


def plot_clouds(
    a: Tensor, b: Tensor, labels: Sequence[str] = ("real", "generated"), *, parts: bool = False, ax: object = None
) -> object:
    """Two clouds of points, the Gaussians that stand for them, and the Fréchet distance between these (FMD).

    a: [N, 2], b: [M, 2], at least 3 rows each. A cloud has a cross at its mean, and ellipses at 1 and 2 standard
    deviations. parts: write also how much comes from the means and how much from the covariances. ax: matplotlib
    axes to draw into. Returns the matplotlib Figure. Raises MotionKitError where a covariance cannot be had.

    >>> cloud = torch.randn(200, 2, generator=torch.Generator().manual_seed(0))
    >>> plot_clouds(cloud, cloud + torch.tensor([3.0, 0.0]), parts=True).axes[0].get_title(loc="left")
    'FMD 9.00 = means 9.00 + covariances 0.00'
    """
    if len(labels) != 2:
        raise MotionKitError(f"plot_clouds: expected two labels, one a cloud; found {list(labels)}")
    clouds = [_flat(cloud, name) for cloud, name in zip((a, b), labels)]
    bells = [gaussian(cloud, str(name)) for cloud, name in zip(clouds, labels)]
    distance, means = fmd(*clouds), float(((bells[0][0] - bells[1][0]) ** 2).sum())
    picture = StaticFigure(figsize=(6.4, 4.2), dpi=110, layout="constrained") if ax is None else ax.figure
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
        title += f" = means {means:.2f} + covariances {max(distance - means, 0):.2f}"
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
            "at a time, or lay them out first with mk.lessons.judging.embed"
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

    return Explorer(controls, partial(_draw_explored, noise), width=700, in_one_column=True)


def _draw_explored(noise: Tensor, shift: float, spread: float, turn: float, points: int) -> object:
    angle = math.radians(turn)
    way = torch.tensor([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]], dtype=torch.float64)
    base = torch.diag(torch.tensor([1.0, 0.4], dtype=torch.float64))
    moved, offset = spread * base @ way, torch.tensor([shift, 0.0], dtype=torch.float64)
    picture = StaticFigure(figsize=(7.0, 4.0), dpi=105)
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
    counts: Tensor | Sequence[Tensor], labels: Sequence[str] | Sequence[Sequence[str]], title: str | Sequence[str] = ""
) -> StaticFigure:
    """A confusion matrix: rows are the true class, columns the predicted one, cells per cent of the row.

    counts: [C, C], as `mk.metrics.confusion` gives; or a list of them, drawn side by side, with a list of labels and of
    titles for each. labels: the C classes. Cells without a clip stay empty; the title ends with the share of all clips
    that are right. Returns the matplotlib Figure.

    >>> picture = plot_confusion(torch.tensor([[3, 1], [0, 4]]), ["walk", "run"], "content")
    >>> picture.axes[0].get_title(loc="left"), [text.get_text() for text in picture.axes[0].texts]
    ('content: accuracy 88 %', ['75', '25', '100'])
    """
    if not isinstance(counts, list | tuple):
        counts, labels, title = [counts], [labels], [title]
    titles = [title] * len(counts) if isinstance(title, str) else list(title)
    if not counts or len(labels) != len(counts) or len(titles) != len(counts):
        raise MotionKitError(
            f"plot_confusion: {len(counts)} tables of counts, {len(labels)} lists of labels and {len(titles)} titles; "
            "expected one of each for every picture"
        )
    tables = [_table(count, names) for count, names in zip(counts, labels)]
    sizes = [len(table) for table in tables]
    wide = min(1.9 * len(tables) + 0.42 * sum(sizes), 11.0)
    picture = StaticFigure(figsize=(wide, min(1.5 + 0.42 * max(sizes), 5.6)), dpi=105, layout="constrained")
    panels = picture.subplots(1, len(tables), squeeze=False, width_ratios=[size + 2 for size in sizes])[0]
    for ax, table, names, text in zip(panels, tables, labels, titles):
        _draw_table(ax, table, list(names))
        share = 100 * np.trace(table) / table.sum() if table.sum() else math.nan
        ax.set_title(f"{text}: accuracy {share:.0f} %".removeprefix(": "), fontsize=10.5, color=INK, loc="left")
    panels[0].set_ylabel("true class", color=SOFT, fontsize=9.5)
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
    ax.set_xlabel("predicted class", color=SOFT, fontsize=9.5)
    ax.tick_params(length=0)
    ax.set_xticks(np.arange(len(labels) + 1) - 0.5, minor=True)
    ax.set_yticks(np.arange(len(labels) + 1) - 0.5, minor=True)
    ax.grid(which="minor", color="#dfe4eb", lw=0.8)
    ax.tick_params(which="minor", length=0)
    for spine in ax.spines.values():
        spine.set_color("#dfe4eb")


_ACROSS = 4  # panels in a row
_GOOD = {"down": "less is better", "up": "more is better", "one": "1 is like the content"}


def plot_arena(table: ArenaTable, *columns: str) -> StaticFigure:
    """The table of `mk.arena.run`, drawn: for each figure a panel, for each method a dot on the line of its interval.

    columns: which figures; all of the table's, if left out. The test clips themselves are a dashed line. A hollow dot
    is a figure that some results do not have; a method without any has a dash. Returns the matplotlib Figure. Raises
    MotionKitError for anything but a table, and for figures that there are not.

    >>> import motionkit as mk
    >>> rows = [{"method": m, "transfers": 9, "cra": c, "sra": s} for m, c, s in (("a", 90.0, 20.0), ("b", 60.0, 70.0))]
    >>> picture = plot_arena(mk.arena.ArenaTable.from_records(rows))
    """
    if not hasattr(table, "rows") or not hasattr(table, "only"):
        raise MotionKitError(f"plot_arena draws the table of mk.arena.run(...); found a {type(table).__name__}")
    table = table.only(*columns) if columns else table
    methods = sum(row.method != REAL for row in table.rows)
    across = min(_ACROSS, len(table.columns))
    down = -(-len(table.columns) // across)
    size = (1.1 + 2.3 * across, down * (0.75 + 0.28 * max(methods, 2)))
    picture = StaticFigure(figsize=size, dpi=110, layout="constrained")
    panels = list(picture.subplots(down, across, squeeze=False, sharey=True).flat)
    for ax, column in zip(panels, table.columns):
        _panel(ax, column, {row.method: row.cell(column) for row in table.rows})
    for ax in panels[len(table.columns) :]:
        ax.set_visible(False)
    if table.caption():
        real = "; dashed: the test clips" if any(row.method == REAL for row in table.rows) else ""
        picture.supxlabel(table.caption() + real, fontsize=7.5, color=SOFT, x=0.01, ha="left")
    return picture


def _panel(ax: object, column: str, cells: dict[str, Cell]) -> None:
    """One figure, of all methods."""
    about, real = COLUMNS[column], cells.pop(REAL, Cell(math.nan)).value
    if real == real:
        ax.axvline(real, color=SOFT, lw=1.2, ls=(0, (4, 3)), zorder=1)
    for y, (cell, colour) in enumerate(zip(cells.values(), cycle(colours.CYCLE))):
        _draw(ax, y, cell, colour)
    ax.set_title(f"{about.title} {ARROWS[about.better]}", fontsize=9.5, loc="left", color=INK)
    ax.set_yticks(range(len(cells)), list(cells))
    ax.set_ylim(len(cells) - 0.4, -0.6)
    _limits(ax, [*cells.values(), Cell(real)])
    style_axes(ax)
    ax.grid(visible=False, axis="y")
    ax.tick_params(labelsize=8, length=0)
    ax.set_xlabel(_GOOD[about.better], fontsize=7.5, color=SOFT)


def _draw(ax: object, y: int, cell: Cell, colour: str) -> None:
    if cell.value != cell.value:
        place = {"transform": ax.get_yaxis_transform(), "ha": "left", "va": "center"}
        ax.text(0.02, y, "–", color=SOFT, fontsize=11, **place)
        return
    if cell.low == cell.low:
        ax.plot([cell.low, cell.high], [y, y], color=colour, lw=3.5, alpha=0.55, solid_capstyle="round", zorder=2)
    face = "white" if cell.missing else colour
    ax.plot(cell.value, y, "o", ms=7.5, mfc=face, mec=colours.mix(colour, "#10202c", 0.35), mew=1.1, zorder=3)


def _limits(ax: object, cells: list[Cell]) -> None:
    """Room on both sides; from 0 where the figures are not far from it."""
    values = [x for c in cells for x in (c.value, c.low, c.high) if x == x]
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    low = 0.0 if 0 <= low < 0.5 * high else low
    room = 0.06 * (high - low or 1.0)
    ax.set_xlim(low - room, high + room)


# Twelve that keep apart with the common forms of colour blindness, and each with a mark of its own besides.
MAP_COLOURS = (
    *(colours.ROLES["style"], colours.ROLES["result"], colours.ROLES["content"], "#d3622b", "#2244aa", "#996699"),
    *("#223355", "#99dd88", "#991100", "#ffbbcc", "#6688ff", "#662222"),
)
_MARKS = {  # plotly's name to matplotlib's
    "circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "cross": "P", "x": "X",
    "triangle-down": "v", "star": "*", "pentagon": "p", "hexagon": "h", "triangle-left": "<", "triangle-right": ">",
}  # fmt: skip
_SIZES = {"star": 1.35, "cross": 1.2, "x": 1.2, "diamond": 0.87}  # so that all marks have as much ink
_TOOLS = ("toImage", "select2d", "lasso2d", "zoomIn2d", "zoomOut2d", "autoScale2d")  # of plotly, not needed here
MOST = 2000


def embed(features: Tensor, seed: int = 0) -> Tensor:
    """Features laid out in the plane so that neighbours stay neighbours: t-SNE (van der Maaten and Hinton 2008).

    features: [N, D]. Returns [N, 2], float32, without a unit; rows that are not finite come back as NaN. scikit-learn's
    `TSNE`, begun at the two main directions, with a perplexity of 30 or, for few rows, (N - 1) / 3. Distances between
    groups and their sizes mean nothing. Raises MotionKitError for fewer than 4 finite rows, or where all are alike.

    >>> embed(torch.randn(20, 8, generator=torch.Generator().manual_seed(0))).shape
    torch.Size([20, 2])
    """
    from sklearn.manifold import TSNE
    from threadpoolctl import threadpool_limits  # scikit-learn's own, always there beside it

    x = _rows(features)
    known = np.isfinite(x).all(1)
    count, wide = int(known.sum()), x.shape[1]
    if count < 4 or wide < 2:
        raise MotionKitError(f"embed: expected at least 4 finite rows of at least 2 numbers, found {count} of {wide}")
    centred = x[known] - x[known].mean(0)
    spread = np.abs(centred).max()
    if not spread > 1e-9 * np.abs(x[known]).max():
        raise MotionKitError(f"embed: all {count} rows are alike, so there is nothing to lay out; look at the encoder")
    machine = TSNE(2, perplexity=min(30.0, (count - 1) / 3), init="pca", random_state=seed)
    places = np.full((len(x), 2), np.nan, np.float32)
    with threadpool_limits(1):  # more threads wait for each other longer than they work, and round differently
        places[known] = machine.fit_transform((centred / spread).astype(np.float32))
    return torch.from_numpy(places)


def feature_map(
    features: Tensor,
    labels: Sequence[str],
    motions: Sequence[object] | None = None,
    *,
    by: str = "content",
    names: Sequence[str] | None = None,
    seed: int = 0,
    most: int = MOST,
    size: tuple[int, int] | None = None,
) -> Scene | FeatureMap:
    """Clips as dots that lie together where their features are alike, coloured and marked by label.

    features: [N, D], laid out by `embed`; points [N, 2] that `embed` gave before are drawn as they are, so that one
    layout serves several colourings. labels: N words; by: what they say. motions: N Motions; then the dot under the
    mouse plays its clip in a player beside the map. names: N texts shown there, else the motions' names. Rows that
    are not finite are left out, and above `most` rows a choice by `seed` is drawn; the caption says so. size: of the
    map, pixels. Returns a plotly figure, or a widget where there are motions; both leave a still picture.

    >>> cloud = torch.randn(40, 6, generator=torch.Generator().manual_seed(0))
    >>> feature_map(cloud, ["walk", "run"] * 20)
    Map(40 dots by content: run, walk)
    """
    drawn = _lay_out(features, labels, motions, names, by, seed, most)
    if motions is None:
        return _figure(drawn, size or (720, 440))
    return FeatureMap(drawn, [motions[row] for row in drawn.rows], size or (430, 480))


@dataclass(frozen=True, eq=False)
class _Drawn:
    """What a map shows: points [K, 2], and for each its row in the features given, its label and its name."""

    points: np.ndarray
    rows: list[int]
    labels: list[str]
    names: list[str]
    by: str
    caption: str

    def groups(self) -> dict[str, list[int]]:
        """Which of the points have each label, labels in order."""
        return {label: [n for n, own in enumerate(self.labels) if own == label] for label in sorted(set(self.labels))}

    def __repr__(self) -> str:
        return f"Map({len(self.rows)} dots by {self.by}: {', '.join(self.groups())})"


def _lay_out(
    features: Tensor, labels: Sequence, motions: object, names: object, by: str, seed: int, most: int
) -> _Drawn:
    x = _rows(features)
    for what, given in (("labels", labels), ("motions", motions), ("names", names)):
        if given is not None and (isinstance(given, str) or len(given) != len(x)):
            found = repr(given) if isinstance(given, str) else len(given)
            raise MotionKitError(f"feature_map: expected {len(x)} {what}, one for each row of features; found {found}")
    if most < 4:
        raise MotionKitError(f"feature_map: expected most=4 rows or more, found {most}")
    known = np.flatnonzero(np.isfinite(x).all(1))
    if not len(known):
        raise MotionKitError(f"feature_map: none of the {len(x)} rows of features is finite")
    rows = known
    if len(known) > most:
        rows = np.sort(np.random.default_rng(seed).choice(known, most, replace=False))
    points = x[rows] if x.shape[1] == 2 else embed(torch.from_numpy(x[rows]), seed).numpy()
    caption = [f"{len(rows):,} of {len(known):,} clips, chosen by chance"] if len(rows) < len(known) else []
    if len(known) < len(x):
        caption += [f"{len(x) - len(known):,} left out: features not finite"]
    if names is None:
        names = [str(n) for n in range(len(x))] if motions is None else [m.name for m in motions]
    return _Drawn(
        points, rows.tolist(), [str(labels[n]) for n in rows], [str(names[n]) for n in rows], by, "; ".join(caption)
    )


def _rows(features: Tensor) -> np.ndarray:
    """Features as numbers [N, D], float64."""
    if not isinstance(features, Tensor) or features.ndim != 2 or features.shape[1] < 2:
        found = list(features.shape) if isinstance(features, Tensor) else f"a {type(features).__name__}"
        raise MotionKitError(
            f"feature map: expected features as a tensor [N, D], one row a clip, D at least 2; found {found}. A judge "
            "gives them: judge.content.features(motions)"
        )
    return features.detach().cpu().double().numpy()


class MapFigure(Scene):
    """A plotly scatter that a notebook saves as data and a still, as `Scene` does."""

    def __repr__(self) -> str:
        return repr(self.__dict__["_motionkit_drawn"])

    def _repr_mimebundle_(self, *given: object, **more: object) -> dict:
        return {**super()._repr_mimebundle_(*given, **more), "text/plain": repr(self)}


def _figure(drawn: _Drawn, size: tuple[int, int]) -> MapFigure:
    figure = MapFigure(_traces(drawn), _layout(drawn, size))
    figure.__dict__["_motionkit_drawn"] = drawn
    figure.__dict__["_motionkit_still"] = lambda: draw_map(drawn).jpeg()
    return figure


def _looks(drawn: _Drawn) -> list[tuple[str, list[int], str, str]]:
    """For each label the points, the colour and the mark, as plotly calls it."""
    marks = list(_MARKS)
    return [
        (label, own, MAP_COLOURS[n % 12], marks[(n + n // 12) % 12])
        for n, (label, own) in enumerate(drawn.groups().items())
    ]


def _traces(drawn: _Drawn) -> list[dict]:
    """A plotly scatter for each label."""
    edge = {"opacity": 0.9, "line": {"width": 0.5, "color": "white"}}
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "name": label,
            "x": drawn.points[own, 0].round(3).tolist(),
            "y": drawn.points[own, 1].round(3).tolist(),
            "text": [drawn.names[n] for n in own],
            "hovertemplate": f"%{{text}}<extra>{label}</extra>",
            "marker": {**edge, "color": ink, "symbol": mark, "size": round(8 * _SIZES.get(mark, 1))},
        }
        for label, own, ink, mark in _looks(drawn)
    ]


def _layout(drawn: _Drawn, size: tuple[int, int], *, below: bool = False) -> dict:
    """How plotly shows a map; `below` puts the legend under it, else it stands at the right."""
    hidden = {"visible": False}
    caption = {"text": drawn.caption, "showarrow": False, "font": {"color": SOFT, "size": 11}}
    caption |= {"x": 0, "y": 1, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
    low, high = drawn.points.min(0), drawn.points.max(0)
    room = 0.04 * np.maximum(high - low, 1e-6)
    ranges = [[round(float(v), 3) for v in pair] for pair in zip(low - room, high + room)]
    legend = {"title": {"text": drawn.by}, "font": {"color": SOFT}, "itemsizing": "constant"}
    if below:
        place = {"orientation": "h", "x": 0, "y": -0.01, "yanchor": "top"}
        legend |= {**place, "title": {"text": ""}, "entrywidth": 92, "font": {"color": SOFT, "size": 11}}
    return {
        "template": None,
        "width": size[0],
        "height": size[1],
        "margin": {"l": 4, "r": 4, "t": 24 if drawn.caption else 8, "b": 8},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "#f5f6f8",
        "xaxis": {**hidden, "range": ranges[0]},
        "yaxis": {**hidden, "range": ranges[1]},
        "hovermode": "closest",
        "legend": legend,
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": SOFT, "activecolor": colours.CONTACT, "remove": list(_TOOLS)},
        "annotations": [caption] if drawn.caption else [],
    }


def draw_map(drawn: _Drawn) -> StaticFigure:
    """The map as a matplotlib Figure."""
    picture = StaticFigure(figsize=(7.4, 4.6), dpi=100)
    ax = picture.add_axes((0.01, 0.05, 0.77, 0.93))
    wide = 6 if len(drawn.rows) < 1000 else 5
    for label, own, ink, mark in _looks(drawn):
        look = {"color": ink, "ms": wide * _SIZES.get(mark, 1), "mew": 0.4, "mec": "white", "alpha": 0.9, "ls": ""}
        ax.plot(*drawn.points[own].T, marker=_MARKS[mark], label=label, **look)
    ax.set(xticks=(), yticks=())
    for spine in ax.spines.values():
        spine.set_color("#dfe4eb")
    key = {"title": drawn.by, "title_fontsize": 9.5, "fontsize": 9, "alignment": "left", "labelcolor": INK}
    ax.legend(
        frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0), markerscale=7 / wide, handletextpad=0.2, **key
    )
    ax.text(0, -0.012, drawn.caption, transform=ax.transAxes, va="top", fontsize=8.5, color=SOFT)
    return picture


class FeatureMap(StillWidget, ipywidgets.Box):
    """A map of clips beside a player; see `feature_map`.

    `figure` is plotly's widget, `player` shows the clip of the dot last pointed at, `shown` is the row given that it
    stands in. `show(row)` does by hand what the mouse does.
    """

    def __init__(self, drawn: _Drawn, motions: list, size: tuple[int, int]) -> None:
        self._drawn, self._motions = drawn, motions
        self.figure, self.shown = go.FigureWidget(_traces(drawn), _layout(drawn, size, below=True)), drawn.rows[0]
        ring = {"symbol": "circle-open", "size": 17, "color": INK, "line": {"width": 2.5}}
        self.figure.add_scatter(mode="markers", marker=ring, hoverinfo="skip", showlegend=False)
        self.player = Player(motions[0].at_origin(), labels=[drawn.names[0]], height=size[1] - 100)
        self._ring(0)
        for trace, (_, own, _, _) in zip(self.figure.data, _looks(drawn)):
            for listen in (trace.on_hover, trace.on_click):
                listen(lambda _trace, points, _state, own=own: self._point([own[n] for n in points.point_inds]))
        beside = ipywidgets.VBox([self.player], layout={"flex": "1 1 280px", "min_width": "240px"})
        beside.add_class("mk-map-player")
        super().__init__([self.figure, beside], layout={"flex_flow": "row wrap", "align_items": "flex-start"})

    def show(self, row: int) -> None:
        """Play the clip of a row of the features given; MotionKitError where the map does not show it."""
        if row not in self._drawn.rows:
            raise MotionKitError(f"row {row} is not on this map: it was left out, or there is none")
        self._point([self._drawn.rows.index(row)])

    def _point(self, numbers: list[int]) -> None:
        if not numbers or self._drawn.rows[numbers[0]] == self.shown:
            return
        self.shown = self._drawn.rows[numbers[0]]
        self._ring(numbers[0])
        self.player.set_motions(self._motions[numbers[0]].at_origin(), labels=[self._drawn.names[numbers[0]]])
        self.player.frame, self.player.playing = 0, True

    def _ring(self, number: int) -> None:
        x, y = self._drawn.points[number].tolist()
        self.figure.data[-1].update(x=[x], y=[y])

    def still(self) -> bytes:
        """The map as the bytes of a PNG."""
        return draw_map(self._drawn).png()

    def __repr__(self) -> str:
        return repr(self._drawn)

    def _repr_mimebundle_(self, **more: object) -> dict:
        return {**super()._repr_mimebundle_(**more), "text/plain": repr(self)}


def _crowds() -> dict[str, tuple]:
    """Features [N, D] and [M, D]."""
    a, b = seeded_randn(60, 4), 2 * seeded_randn(50, 4, seed=1) + torch.tensor([1.0, 0.0, -1.0, 0.0])
    centred = a - a.mean(0)
    return {"two crowds": (a, b), "a crowd and itself": (a, a), "one only wider": (centred, 3 * centred)}


def _frechet_by_number(a: Tensor, b: Tensor) -> Tensor:
    """The Fréchet distance of two crowds whose numbers are taken one by one, as if none went with another."""
    return _squares(a.mean(0) - b.mean(0), a.std(0) - b.std(0))


def _squares(*differences: Tensor) -> Tensor:
    """The sum of all squares."""
    return torch.stack(differences).square().sum()


def _judged() -> dict[str, tuple]:
    """Found and true labels."""
    return {
        "as many of each class": (torch.tensor([0, 1, 1, 0]), torch.tensor([0, 0, 1, 1])),
        "one class far larger": (torch.tensor([0] * 6 + [1] * 2 + [0, 1]), torch.tensor([0] * 8 + [1] * 2)),
        "always the larger class": (torch.zeros(10).long(), torch.tensor([0] * 8 + [1] * 2)),
        "a class that is never right": (torch.tensor([4, 4, 7, 7, 4]), torch.tensor([4, 4, 7, 4, 9])),
    }


def _fair_accuracy(found: Tensor, wanted: Tensor) -> Tensor:
    """The mean over the classes that occur of the share of each that was found, 0 to 1."""
    return torch.stack([(found[wanted == c] == c).double().mean() for c in wanted.unique()]).mean()


def _warp_cost(costs: Tensor) -> Tensor:
    """What the cheapest path costs, from the first pair of frames to the last."""
    return dtw_costs(costs[None])[0]


def _greedy_cost(costs: Tensor) -> Tensor:
    """What a path costs that always takes the cheapest next pair."""
    at, total, end = (0, 0), costs[0, 0], (costs.shape[0] - 1, costs.shape[1] - 1)
    while at != end:
        onward = [(at[0] + i, at[1] + k) for i, k in ((1, 1), (1, 0), (0, 1))]
        at = min((pair for pair in onward if pair[0] <= end[0] and pair[1] <= end[1]), key=lambda pair: costs[pair])
        total = total + costs[at]
    return total


EXERCISES = {
    "fair_accuracy": Exercise(
        _fair_accuracy,
        cases=_judged,
        hints=(
            "how often is each class right, taken by itself?",
            "first the share of each class that was found, then the mean over the classes that occur in `wanted`; each "
            "class counts the same, however large it is; a share from 0 to 1.",
            "for each c in wanted.unique(): the mean of found[wanted == c] == c; then the mean of these.",
        ),
        mistakes={
            "That is the share of all clips: a large class outweighs the others.": lambda x, y: (
                (x == y).double().mean()
            ),
            "Group the clips by what they are (wanted), not by what was found.": lambda x, y: _fair_accuracy(y, x),
            "Only classes that occur in `wanted` count.": lambda x, y: (
                _fair_accuracy(x, y) * len(y.unique()) / (1 + y.max())
            ),
            "A share from 0 to 1, not per cent.": lambda x, y: 100 * _fair_accuracy(x, y),
        },
    ),
    "frechet_by_number": Exercise(
        _frechet_by_number,
        cases=_crowds,
        hints=(
            "a mean and a standard deviation for each of the D numbers of both crowds: where do they differ?",
            "for each number the difference of the means, squared, plus the difference of the standard deviations (not "
            "of the variances), squared; torch's std divides by N - 1; then the sum over all numbers.",
            "the sum of (a.mean(0) - b.mean(0)) ** 2 + (a.std(0) - b.std(0)) ** 2.",
        ),
        mistakes={
            "Standard deviations, not variances.": lambda a, b: _squares(a.mean(0) - b.mean(0), a.var(0) - b.var(0)),
            "The sum over all numbers, not their mean.": lambda a, b: _frechet_by_number(a, b) / a.shape[1],
            "A sample's deviation divides by N - 1, as torch's does.": lambda a, b: _squares(
                a.mean(0) - b.mean(0), a.std(0, correction=0) - b.std(0, correction=0)
            ),
            "Each number by itself: over dimension 0.": lambda a, b: _squares(a.mean() - b.mean(), a.std() - b.std()),
        },
    ),
    "warp_cost": Exercise(
        _warp_cost,
        cases=lambda: {
            "the diagonal is free": (1 - torch.eye(5),),
            "random costs": (seeded_randn(6, 6).abs(),),
            "clips of different length": (seeded_randn(4, 9, seed=1).abs(),),
        },
        hints=(
            "if you knew what it costs to come to the three pairs before [i, j], what would [i, j] cost?",
            "best[i, j] = costs[i, j] + the least of best[i - 1, j], best[i, j - 1] and best[i - 1, j - 1]; the first "
            "row and column have one way only.",
            "give `best` a border of infinite costs above and at the left, with 0 in its corner: no special cases.",
        ),
        mistakes={
            "The path may leave the diagonal, where that is cheaper.": lambda costs: costs.diagonal().sum(),
            "The cheapest next step can lead into expensive places: keep the best for every pair.": _greedy_cost,
            "The cheapest pair in each row is no path: it jumps.": lambda costs: costs.min(1).values.sum(),
            "The path has to pay for both of its ends.": lambda costs: _warp_cost(costs) - costs[0, 0],
        },
    ),
}
