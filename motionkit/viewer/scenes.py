"""Moving 3D figures that stay in a saved notebook: plotly, with a play button and a time slider."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from ..errors import MotionKitError
from .figure import Figure, as_list, figures, label_texts

MIME = "application/vnd.plotly.v1+json"
FRAMES = 48


class Scene(go.Figure):
    """A plotly figure that a notebook saves as data and a still, never with a copy of plotly's own 5 MB of JavaScript.

    JupyterLab draws it with the extension that plotly's package brings; a page that runs nothing shows the still.
    """

    def _repr_mimebundle_(
        self, include: object = None, exclude: object = None, validate: bool = True, **_: object
    ) -> dict:
        bundle = {MIME: self.to_plotly_json(), "text/plain": "Scene: press play in JupyterLab"}
        still = getattr(self, "_motionkit_still", None)
        if still is not None:
            # Not a PNG: plotly's extension for JupyterLab would show that in place of the moving figure.
            bundle["image/jpeg"] = base64.b64encode(still()).decode()
        return bundle

    def _ipython_display_(self) -> None:
        from IPython.display import display

        display(self._repr_mimebundle_(), raw=True)


def scene(
    motions: object,
    *,
    labels: Sequence[str] | None = None,
    roles: Sequence[str] | None = None,
    layout: str = "side",
    frames: int = FRAMES,
    stride: int | None = None,
    height: int = 460,
) -> Scene:
    """A plotly figure that plays motions; under 150 KB for one of 4 s and 22 joints.

    motions, labels, roles, layout: as for `Player`. frames: how many moments to keep, spread over the longest motion.
    stride: keep every stride-th frame of the first motion instead. height: pixels. Coordinates are rounded to
    millimetres; +Y of the motion points up, and plotly's x, y and z are the motion's Z, X and Y.

    >>> import motionkit as mk
    >>> len(mk.scene(mk.load("data/actor/walk_neutral.bvh"), frames=12).frames)
    12
    """
    if frames < 1 or (stride is not None and stride < 1):
        raise MotionKitError(f"scene: expected frames and stride of at least 1, found frames={frames}, stride={stride}")
    shown, texts = figures(motions, roles=roles, layout=layout), label_texts(motions, labels, roles)
    end = max(f.end for f in shown)
    times = np.linspace(0, end, min(frames, round(end * max(f.fps for f in shown)) + 1))
    if stride is not None:
        times = np.arange(0, end + 1e-6, stride / shown[0].fps)
    runs = [(f, *run) for f in shown for run in _runs(f)]
    picture = Scene(data=_traces(runs, shown, texts, times[0]), layout=_layout(shown, times, height))
    picture.frames = [
        go.Frame(data=_moment(runs, t), name=str(n), traces=list(range(len(runs)))) for n, t in enumerate(times)
    ]
    motions, frame = as_list(motions), round(end * shown[0].fps / 3)  # as they are now: a list may change

    def still() -> bytes:
        from .plots import still_jpeg

        return still_jpeg(motions, frame, labels=labels, roles=roles, layout=layout)

    picture.__dict__["_motionkit_still"] = still
    return picture


def _runs(figure: Figure) -> list[tuple[str, list[int | None]]]:
    """For each limb colour, joints to walk through with one line; None lifts the pen."""
    runs: dict[str, list[int | None]] = {}
    left = list(figure.bones)
    while left:
        parent, child = left.pop(0)
        colour, run = figure.colours[child], [parent, child]
        while onward := next((bone for bone in left if bone[0] == run[-1] and figure.colours[bone[1]] == colour), None):
            left.remove(onward)
            run.append(onward[1])
        runs.setdefault(colour, []).extend([*run, None])
    if not runs:
        runs[figure.colours[0]] = [*figure.drawn, None]
    return [(colour, run[:-1]) for colour, run in runs.items()]


def _moment(runs: Sequence[tuple], time: float) -> list[dict]:
    """The lines' coordinates at a time, one dict for each run."""
    lines = []
    for figure, _, run in runs:
        pose = [[round(float(v), 3) for v in place] for place in figure.at(time)]
        x, y, z = ([None if j is None else pose[j][k] for j in run] for k in (2, 0, 1))
        lines.append({"type": "scatter3d", "x": x, "y": y, "z": z})
    return lines


_UNNAMED = {"hoverinfo": "skip", "showlegend": False}


def _traces(runs: Sequence[tuple], shown: Sequence[Figure], texts: Sequence, time: float) -> list[dict]:
    """The lines of all bodies, a dot in the legend for each that has a text, and the floor."""
    traces = []
    for moment, (figure, colour, run) in zip(_moment(runs, time), runs):
        sizes = [0 if j is None else 11 if j == figure.head else 4 for j in run]
        marker = {"color": colour, "size": sizes, "line": {"width": 0}, "opacity": 1}
        line = {"color": colour, "width": 9}
        traces.append({**moment, "mode": "lines+markers", "line": line, "marker": marker, **_UNNAMED})
    nowhere = {"type": "scatter3d", "x": [None], "y": [None], "z": [None], "mode": "markers"}
    for figure, text in zip(shown, texts):
        if text:
            traces.append({**nowhere, "name": text, "marker": {"color": figure.role, "size": 9}})
    return [*traces, _floor(shown)]


def _floor(shown: Sequence[Figure]) -> dict:
    """A thin grid on the floor, 0.5 m wide, under everything that moves."""
    low, high, size = _box(shown)
    tile = 0.5 if size > 0.5 else size / 3
    tile *= max(1, np.ceil(max(high[0] - low[0], high[2] - low[2]) / tile / 24))
    (x0, _, z0), (x1, _, z1) = (np.floor(low / tile) * tile).tolist(), (np.ceil(high / tile) * tile).tolist()
    xs, zs = [], []
    for x in np.arange(x0, x1 + tile / 2, tile):
        xs += [round(float(x), 3)] * 2 + [None]
        zs += [z0, z1, None]
    for z in np.arange(z0, z1 + tile / 2, tile):
        xs += [x0, x1, None]
        zs += [round(float(z), 3)] * 2 + [None]
    ys = [None if x is None else 0 for x in xs]
    line = {"color": "rgba(130,140,155,0.45)", "width": 2}
    return {"type": "scatter3d", "x": zs, "y": xs, "z": ys, "mode": "lines", "line": line, **_UNNAMED}


def _box(shown: Sequence[Figure]) -> tuple[np.ndarray, np.ndarray, float]:
    points = [f.points[:, f.drawn].reshape(-1, 3) for f in shown]
    size = max(f.size for f in shown)
    low = np.min([p.min(axis=0) for p in points], axis=0) - 0.3 * size
    high = np.max([p.max(axis=0) for p in points], axis=0) + 0.3 * size
    return low, high, size


def _camera(shown: Sequence[Figure], ratio: dict) -> dict:
    """From the front, three quarters; further to the side of those who walk, so that their path runs across."""
    left = shown[0].left
    points = np.concatenate([f.points[:, f.drawn].reshape(-1, 3) for f in shown])
    along = [float(np.ptp(points @ d)) for d in (np.array([-left[2], 0, left[0]]), left)]
    turn = np.radians(32 + 32 * np.clip((along[0] / max(along[1], 1e-6) - 1) / 2, 0, 1))
    across, up = np.hypot(ratio["x"], ratio["y"]), ratio["z"]
    away = 0.12 * across + max(0.6 * across, 1.05 * up)
    x, y = np.cos(turn) * left[0] + np.sin(turn) * left[2], np.sin(turn) * left[0] - np.cos(turn) * left[2]
    eye = {"x": round(float(away * x), 3), "y": round(float(away * y), 3), "z": round(0.22 * away, 3)}
    return {"eye": eye, "center": {"x": 0, "y": 0, "z": round(-0.04 * up, 3)}, "projection": {"type": "perspective"}}


def _controls(times: np.ndarray) -> dict:
    """Play and pause buttons and the time slider."""
    step = 1000 * float(times[1] - times[0]) if len(times) > 1 else 1000
    still = {"transition": {"duration": 0}, "mode": "immediate"}
    play = {"frame": {"duration": round(step, 1), "redraw": True}, "fromcurrent": True, **still}
    halt = {"frame": {"duration": 0, "redraw": True}, "mode": "immediate"}
    steps = [{"args": [[str(n)], halt], "label": f"{t:.2f}", "method": "animate"} for n, t in enumerate(times)]
    clear, ink = "rgba(0,0,0,0)", "#7a8491"
    menu = {"type": "buttons", "direction": "left", "showactive": False, "pad": {"t": 18}, "font": {"color": ink}}
    menu |= {"x": 0.02, "y": 0, "xanchor": "left", "yanchor": "top"}
    menu |= {"bgcolor": "rgba(122,132,145,0.15)", "bordercolor": clear}
    menu["buttons"] = [
        {"label": "▶", "method": "animate", "args": [None, play]},
        {"label": "❚❚", "method": "animate", "args": [[None], halt]},
    ]
    slider = {"x": 0.14, "len": 0.84, "y": 0, "pad": {"t": 8}, "steps": steps, "font": {"color": clear}}
    slider |= {"tickcolor": clear, "minorticklen": 0, "ticklen": 0}
    slider["currentvalue"] = {"suffix": " s", "font": {"color": ink, "size": 12}, "xanchor": "right"}
    return {"updatemenus": [menu], "sliders": [slider]}


def _layout(shown: Sequence[Figure], times: np.ndarray, height: int) -> dict:
    low, high, size = _box(shown)
    # Plotly's x, y and z are the motion's Z, X and Y: a turn in a circle, so that left stays left.
    ranges = [
        [float(low[2]), float(high[2])],
        [float(low[0]), float(high[0])],
        [min(float(low[1]) + 0.3 * size, -0.02), float(high[1])],
    ]
    extent = [b - a for a, b in ranges]
    ratio = {n: round(1.7 * e / max(extent), 3) for n, e in zip("xyz", extent)}
    axes = {
        f"{n}axis": {"visible": False, "showspikes": False, "range": [round(v, 3) for v in r]}
        for n, r in zip("xyz", ranges)
    }
    clear = "rgba(0,0,0,0)"
    return {
        "template": None,
        "height": height,
        "margin": {"l": 0, "r": 0, "t": 8, "b": 8},
        "paper_bgcolor": clear,
        "legend": {"x": 0.01, "y": 0.98, "font": {"color": "#7a8491"}},
        **_controls(times),
        "scene": {
            **axes,
            "aspectmode": "manual",
            "aspectratio": ratio,
            "camera": _camera(shown, ratio),
            "bgcolor": clear,
        },
    }
