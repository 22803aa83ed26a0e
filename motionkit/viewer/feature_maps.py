"""Features of many clips laid out in the plane (t-SNE), coloured by label; with motions, every dot plays its clip."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import ipywidgets
import numpy as np
import plotly.graph_objects as go
import torch
from torch import Tensor

from ..errors import MotionKitError
from . import colours
from .player import Player
from .plots import INK, SOFT, Print, few_colours
from .scenes import Scene

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
    found = x[known] - x[known].mean(0)
    spread = np.abs(found).max()
    if not spread > 1e-9 * np.abs(x[known]).max():
        raise MotionKitError(f"embed: all {count} rows are alike, so there is nothing to lay out; look at the encoder")
    machine = TSNE(2, perplexity=min(30.0, (count - 1) / 3), init="pca", random_state=seed)
    places = np.full((len(x), 2), np.nan, np.float32)
    with threadpool_limits(1):  # more threads wait for each other longer than they work, and round differently
        places[known] = machine.fit_transform((found / spread).astype(np.float32))
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
    figure.__dict__["_motionkit_still"] = lambda: _still(drawn, "jpeg")
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
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "name": label,
            "x": drawn.points[own, 0].round(3).tolist(),
            "y": drawn.points[own, 1].round(3).tolist(),
            "text": [drawn.names[n] for n in own],
            "hovertemplate": f"%{{text}}<extra>{label}</extra>",
            "marker": {
                "color": ink,
                "symbol": mark,
                "size": round(8 * _SIZES.get(mark, 1)),
                "opacity": 0.9,
                "line": {"width": 0.5, "color": "white"},
            },
        }
        for label, own, ink, mark in _looks(drawn)
    ]


def _layout(drawn: _Drawn, size: tuple[int, int], *, below: bool = False) -> dict:
    """How plotly shows a map; `below` puts the legend under it, else it stands at the right."""
    hidden = {"visible": False}
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
        "annotations": [_caption(drawn.caption)] if drawn.caption else [],
    }


def _caption(text: str) -> dict:
    place = {"x": 0, "y": 1, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
    return {"text": text, **place, "showarrow": False, "font": {"color": SOFT, "size": 11}}


def draw_map(drawn: _Drawn) -> Print:
    """The map as a matplotlib Figure."""
    picture = Print(figsize=(7.4, 4.6), dpi=100)
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


def _still(drawn: _Drawn, kind: str) -> bytes:
    from PIL import Image

    raw, small = io.BytesIO(), io.BytesIO()
    draw_map(drawn).savefig(raw, format="png", facecolor="white")
    if kind == "png":
        return few_colours(raw)
    with Image.open(raw) as image:
        image.convert("RGB").save(small, format="jpeg", quality=80, optimize=True)
    return small.getvalue()


class FeatureMap(ipywidgets.Box):
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
        return _still(self._drawn, "png")

    def __repr__(self) -> str:
        return repr(self._drawn)

    def _repr_mimebundle_(self, **more: object) -> dict:
        """The live widget, and beside it the picture for pages that run nothing."""
        bundle = super()._repr_mimebundle_(**more) or {}
        return {**bundle, "image/png": base64.b64encode(self.still()).decode(), "text/plain": repr(self)}
