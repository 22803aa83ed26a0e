"""Two live views of the numbers behind a motion: where it faces, and one feature at a time.

Both draw in the browser, so that a slider follows the hand; both leave a still picture for pages without a kernel.
"""

from __future__ import annotations

import base64
import html
import io
import json
import zlib
from pathlib import Path

import anywidget
import numpy as np
import traitlets

from .. import rotations as rot
from ..errors import MotionKitError
from . import colours, inspector_stills
from .body import as_list, figures
from .drawing import view_axes

_JS = Path(__file__).parent / "js"


class _Inspector(anywidget.AnyWidget):
    """What both share: a motion, the frame shown, and a still of it."""

    _esm = (_JS / "inspectors.js").read_text(encoding="utf-8")
    _css = (_JS / "inspectors.css").read_text(encoding="utf-8")
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
        from matplotlib.figure import Figure as Picture
        from PIL import Image

        picture = Picture(figsize=(8.4, 4.1), dpi=100, layout="constrained")
        self.draw(picture)
        raw, small = io.BytesIO(), io.BytesIO()
        picture.savefig(raw, format="png", facecolor="white")
        image = Image.open(raw).convert("RGB").quantize(128, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        image.save(small, format="png", optimize=True)
        return small.getvalue()

    def _repr_mimebundle_(self, **_: object) -> dict:
        view = {"version_major": 2, "version_minor": 0, "model_id": self.model_id}
        return {"application/vnd.jupyter.widget-view+json": view, "text/plain": repr(self)}

    def _ipython_display_(self, **_: object) -> None:
        """Show the live view, and after it a still that the live view hides."""
        from IPython.display import display

        # without a kernel JupyterLab complains in the view's place; where HTML is trusted, the rule takes that away
        rule = f".jp-OutputArea-child:not(:has(.mk-inspect)):has(+ .jp-OutputArea-child .{self._still})"
        source = base64.b64encode(self.still()).decode()
        image = f'<img alt="{html.escape(repr(self))}" src="data:image/png;base64,{source}" style="max-width: 100%">'
        still = f'<style>{rule} {{ display: none; }}</style><div class="{self._still}">{image}</div>'
        display(self._repr_mimebundle_(), raw=True)
        display({"text/html": still, "text/plain": "(still picture)"}, raw=True)


class FacingView(_Inspector):
    """A motion from above, as the world sees it and as its own body sees it; see `facing_view`."""

    def draw(self, picture: object) -> None:
        inspector_stills.draw_facing(picture, self._motion, self._where, self._shape, self.frame)

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
        found = self._shape["joints_of"][self.number]
        return None if found is None else self._shape["names"][found]

    @property
    def description(self) -> str:
        """What the chosen number means, in words."""
        return self._shape["describe"][self.number]

    def draw(self, picture: object) -> None:
        inspector_stills.draw_features(picture, self._where, self._shape, self._numbers, self.frame, self.number)

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
    from ..features.facing_free import FacingFree

    (motion,) = _one(motion)
    look = _look_of(motion)
    root = FacingFree().encode(motion)[:, :4]
    path = motion.root_path().numpy()
    low, high = path.min(0) - 0.75, path.max(0) + 0.75
    look |= {
        "box": [*((low + high) / 2).round(3).tolist(), round(float((high - low).max()), 3)],
        "yaw": rot.wrap(motion.facing()).tolist(),
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
    from ..features import HumanML3D
    from ..features.frames import body_frames

    (motion,) = _one(motion)
    layout = HumanML3D() if layout is None else layout
    values = layout.encode(motion).flatten(1).numpy()
    look = _look_of(motion) | _meaning(layout)
    spreads = values.std(0)
    axes = view_axes(np.float32([1, 0, 0]))
    points = body_frames(motion).local.numpy()
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
    found = as_list(motion)
    if len(found) > 1:
        raise MotionKitError(f"an inspector shows one motion; found {len(found)}: choose one of them")
    return found


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
