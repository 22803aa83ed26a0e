"""Widgets that move while something runs: a loss that is drawn as a network learns, and restyling live."""

from __future__ import annotations

import asyncio
import base64
import io
import time
import uuid
from collections.abc import Mapping

import anywidget
import numpy as np
import torch
import traitlets

from ..errors import MotionKitError
from ..methods.style_erd_numpy import rotate_quaternion_y, rotate_y
from ..motion import Motion
from .figure import StillWidget, encode_scene, figures
from .player import _JS, script
from .plots import INK, StaticFigure, strip, style_axes

_RAW, _SMOOTH = "#b9cfe4", "#2b6ca8"
_SHARE = 0.05  # of the time that a training run may spend on pictures
_DRAWN = 2000  # points of a line; more cannot be told apart


class LossCurve:
    """A curve of the loss that grows in the notebook while a network learns: `fit(..., callback=curve)`.

    Call it with the number of each step and its loss. In a notebook it shows itself at the first step and is drawn
    anew every `every` seconds at most, less often where drawing would take more than a twentieth of the time; when the
    cell ends, also by an error, the whole curve is left as a picture. `done()` draws it sooner. Outside of notebooks
    nothing is shown; `png` and `figure()` are there all the same. A step that is not above the last begins a new curve.

    smooth: 0 to below 1, how much of the past is in the strong line; the pale one is the loss itself.

    >>> curve = LossCurve("a lesson")
    >>> for step in range(100):
    ...     curve(step, 1 / (1 + step))
    >>> curve
    LossCurve('a lesson': step 99, smoothed loss 0.0112)
    """

    def __init__(self, title: str = "", smooth: float = 0.9, every: float = 0.5) -> None:
        for name, value, fits in (("smooth", smooth, "from 0 to below 1"), ("every", every, "of 0 seconds or more")):
            if not isinstance(value, int | float) or not value >= 0 or (name == "smooth" and value >= 1):
                raise MotionKitError(f"LossCurve: expected {name} {fits}; found {value!r}")
        self.title, self.smooth, self.every = title, smooth, every
        self.steps: list[int] = []
        self.losses: list[float] = []
        self._idle, self._due, self._image = True, 0.0, None
        self._id, self._shown_in = "", None

    def __call__(self, step: int, loss: float) -> None:
        """Note the loss of a step, and draw if it is time."""
        try:
            step, loss = int(step), float(loss)
        except (TypeError, ValueError, RuntimeError):
            raise MotionKitError(
                f"LossCurve: expected the number of a step and its loss, one number each; found {step!r} and {loss!r}"
            ) from None
        begins = self._idle or step <= self.steps[-1]
        if begins:
            self._begin(step)
        self.steps.append(step)
        self.losses.append(loss)
        if self._image is not None and (begins or time.monotonic() >= self._due):
            start = time.monotonic()
            self._image.value = self.png
            now = time.monotonic()
            self._due = now + max(self.every, (now - start) / _SHARE)

    def _begin(self, step: int) -> None:
        """Begin a curve, or go on with one; in a notebook, show it in the cell that trains."""
        again, self._idle = bool(self.steps), False
        if again and step <= self.steps[-1]:
            self.steps, self.losses = [], []
        shell = _notebook()
        if shell is None:
            return
        if self._image is None:
            import ipywidgets

            self._image = ipywidgets.Image(format="png", layout={"width": "640px", "max_width": "100%"})
            shell.events.register("post_run_cell", self.done)
        if self._shown_in is None or (again and self._shown_in != shell.execution_count):
            self._display(shell)
        else:
            self._update()

    def done(self, _: object = None) -> None:
        """Leave the whole curve as a picture, which is what the saved notebook keeps. A cell's end calls it too."""
        self._idle = True
        if self._image is not None:
            image, self._image = self._image, None
            _notebook().events.unregister("post_run_cell", self.done)
            self._update()
            image.close()

    def smoothed(self) -> np.ndarray:
        """The strong line: for each step the mean of the losses up to there, recent ones counting most.

        >>> curve = LossCurve(smooth=0.5)
        >>> for step, loss in enumerate([2.0, 4.0, 4.0]):
        ...     curve(step, loss)
        >>> curve.smoothed().round(3).tolist()
        [2.0, 3.333, 3.714]
        """
        from scipy.signal import lfilter

        losses = np.asarray(self.losses, dtype=float)
        known = np.isfinite(losses)
        sums, weights = (
            lfilter([1.0], [1.0, -self.smooth], x) for x in (np.where(known, losses, 0.0), known.astype(float))
        )
        return np.divide(sums, weights, out=np.full(len(losses), np.nan), where=weights > 0)

    def figure(self) -> StaticFigure:
        """The curve so far as a matplotlib Figure."""
        picture = StaticFigure(figsize=(6.4, 2.7), dpi=100)
        ax = picture.add_axes((0.09, 0.17, 0.89, 0.72))
        losses, smoothed = np.asarray(self.losses, dtype=float), self.smoothed()
        drawn = np.unique(np.linspace(0, max(len(losses) - 1, 0), min(len(losses), _DRAWN)).astype(int))
        steps = np.asarray(self.steps)[drawn] if len(drawn) else []
        ax.plot(steps, losses[drawn], color=_RAW, lw=1, label="loss")
        ax.plot(steps, smoothed[drawn], color=_SMOOTH, lw=2.2, label=f"smoothed: {_last(smoothed)}")
        finite = losses[np.isfinite(losses)]
        if len(finite):
            low, high = min(finite.min(), 0.0), max(finite.max(), 0.0)
            ax.set_ylim(low, high + 0.06 * max(high - low, 1e-9))
        ax.set_xlabel("step")
        ax.set_title(self.title, fontsize=10, color=INK, loc="left")
        style_axes(ax)
        ax.legend(frameon=False, fontsize=8.5, labelcolor=INK, loc="upper right")
        return picture

    @property
    def png(self) -> bytes:
        """The curve so far as a picture."""
        raw = io.BytesIO()
        self.figure().savefig(raw, format="png", facecolor="white", pil_kwargs={"compress_level": 1})
        return raw.getvalue()

    def __repr__(self) -> str:
        if not self.steps:
            return f"LossCurve({self.title!r}: no step yet)"
        return f"LossCurve({self.title!r}: step {self.steps[-1]}, smoothed loss {_last(self.smoothed())})"

    def _repr_png_(self) -> bytes:
        return self.figure().png()

    def _bundle(self) -> dict:
        """The living picture while it lives, then the still one."""
        if self._image is not None:
            return self._image._repr_mimebundle_()
        return {"image/png": base64.b64encode(self._repr_png_()).decode(), "text/plain": repr(self)}

    def _display(self, shell: object) -> None:
        from IPython.display import display

        # a name of its own in each cell: what an earlier run left in another cell stays
        self._id, self._shown_in = f"mk-loss-{uuid.uuid4()}", shell.execution_count
        display(self._bundle(), raw=True, display_id=self._id)

    def _update(self) -> None:
        """Draw anew wherever the curve was shown."""
        from IPython.display import update_display

        update_display(self._bundle(), raw=True, display_id=self._id)

    def _ipython_display_(self) -> None:
        """Show the curve; where this cell has shown it already, only finish it."""
        shell = _notebook()
        self.done()
        if shell is None:
            print(repr(self))
        elif self._shown_in != shell.execution_count:
            self._display(shell)


def _last(values: np.ndarray) -> str:
    return f"{values[-1]:.3g}" if len(values) else "none yet"


def _notebook() -> object:
    """The IPython shell of a notebook's kernel, None anywhere else."""
    from IPython import get_ipython

    shell = get_ipython()
    return shell if hasattr(shell, "kernel") else None


_SEAM = 0.3  # seconds over which the end of a clip becomes its beginning
_LEASH = 0.6  # metres that the two may walk apart before the content is drawn along
_WAITING = 60  # frames that the browser may be behind before none are sent
_ABSENT = 600  # frames without an answer after which nobody seems to look
_CALM = 0.05  # how much of the times shown a new frame changes


class Endless:
    """A motion that never ends: after its last frame it begins again, from where it stands by then.

    >>> import motionkit as mk
    >>> endless = Endless(mk.load("data/actor/walk_neutral.bvh"))
    >>> for _ in range(500):
    ...     turns, places = next(endless)
    >>> turns.shape, bool(abs(places[0, [0, 2]]).max() > 5)
    ((22, 4), True)
    """

    def __init__(self, motion: Motion) -> None:
        self._frame, self._seam = 0, max(1, round(_SEAM * motion.fps))
        self._turns, self._places = motion.rotations.numpy(), motion.translations.numpy()
        self._yaw = motion.facing().numpy()
        self._turn, self._start, self._from = np.float32([0]), self._places[0, 0] * [1, 0, 1], self._turns[0]
        self._to = self._start

    def __iter__(self) -> Endless:
        return self

    def __next__(self) -> tuple[np.ndarray, np.ndarray]:
        """The next frame: local quaternions [J, 4] and translations [J, 3], the root's in the world."""
        n = self._frame
        share = 1.0 if self._to is self._start else min(1.0, (n + 1) / self._seam)
        turns, places = _between(self._from, self._turns[n], share * share * (3 - 2 * share)), self._places[n].copy()
        turns = turns.copy()
        turns[0] = rotate_quaternion_y(self._turn, turns[None, 0])[0]
        root = rotate_y(self._turn, (places[None, :1] - self._start).astype(np.float32))[0, 0] + self._to
        places[0] = root
        self._frame += 1
        if self._frame == len(self._turns):
            self._again(root)
        return turns, places

    def _again(self, root: np.ndarray) -> None:
        """Begin anew, facing the way that it faces."""
        gain = self._yaw[-1] - self._yaw[0]
        self._from = self._turns[-1].copy()
        self._from[0] = rotate_quaternion_y(np.float32([-gain]), self._from[None, 0])[0]  # as seen from the beginning
        self._turn, self._frame, self._to = np.float32(self._turn + gain), 0, root * [1, 0, 1]


def _between(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """Quaternions [J, 4] from a to b."""
    if share >= 1:
        return b
    b = np.where((a * b).sum(1, keepdims=True) < 0, -b, b)
    mixed = a + np.float32(share) * (b - a)
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


class Live(StillWidget, anywidget.AnyWidget):
    """A content and the same content in a style, live: every frame is restyled alone and drawn at once.

    At the right a dial of all styles; a pad on which left and right mix two of them and up is more; and how much of it
    all, where above 1 is beyond what was learned from. Wishes fade in from the next frame on.

    method: `mk.methods.load("style-erd")`, or anything with its `stream`, `onto_model` and `model`. content: a motion,
    which is played again and again. label, own_style: what it does, and in which style; left out, the method guesses
    frame by frame. left, right: two styles to begin with. height: pixels. Raises MotionKitError for a content that the
    method cannot take, and unknown styles.

    `left`, `right`, `mix` (0 to 1), `strength` and `playing` are traits. `result` are the last two seconds, `times`
    milliseconds: of a frame through the stream, and from here to the browser and back.

    >>> import motionkit as mk
    >>> live = Live(mk.methods.load("style-erd"), mk.load("data/actor/walk_neutral.bvh"), left="old")
    >>> for _ in range(30):
    ...     live.step()
    >>> len(live.result)
    30
    """

    about = "a character that is restyled live"
    _esm = script("live.js")
    _css = (_JS / "player.css").read_text(encoding="utf-8") + (_JS / "live.css").read_text(encoding="utf-8")
    _data = traitlets.Bytes().tag(sync=True)
    styles = traitlets.List(traitlets.Unicode()).tag(sync=True)
    left, right = traitlets.Unicode().tag(sync=True), traitlets.Unicode().tag(sync=True)
    mix, strength = traitlets.Float(0.0).tag(sync=True), traitlets.Float(1.0).tag(sync=True)
    playing = traitlets.Bool(True).tag(sync=True)
    height = traitlets.Int(400).tag(sync=True)

    def __init__(
        self,
        method: object,
        content: Motion,
        *,
        label: str | None = None,
        own_style: str | None = None,
        left: str = "old",
        right: str = "proud",
        height: int = 400,
    ) -> None:
        if not all(hasattr(method, name) for name in ("stream", "onto_model", "model")):
            raise MotionKitError(f"Live needs a method that streams, such as 'style-erd'; found {method!r:.80}")
        on_model = method.onto_model(content)
        model, characters = method.model, figures([on_model, on_model], roles=["content", "result"])
        for style in (left, right):
            model.label_id("style", style)
        self._model, self._stream = model, method.stream(left, content=label, own_style=own_style)
        self._source, self._kept, self.times = Endless(on_model), [], {"ms": 0.0, "trip": 0.0}
        before = on_model.positions()[0, 0].numpy()
        self._beside, self._like = [np.float32(f.points[0, 0] - before) * [1, 0, 1] for f in characters], on_model
        self._drawn_at, self._sent, self._seen, self._clock, self._task = np.zeros(3), 0, 0, {}, None
        data = encode_scene(characters, labels=["content", left])
        super().__init__(_data=data, styles=list(model.styles), left=left, right=right, height=height)
        self.observe(self._wish, ["left", "right", "mix", "strength"])
        self.on_msg(self._heard)

    def _wish(self, _: object = None) -> None:
        """What the controls say, from the next frame on."""
        mix = {self.left: 1 - self.mix}
        mix[self.right] = mix.get(self.right, 0.0) + self.mix
        self._stream.style, self._stream.strength = mix, self.strength

    def step(self) -> None:
        """One frame more, sent to whoever looks."""
        turns, places = next(self._source)
        begun = time.perf_counter()
        turned, root = self._stream.push(turns[None], places[None])
        self._timed("ms", 1000 * (time.perf_counter() - begun))
        moved = places.copy()
        moved[0] = root[0]
        self._kept = [*self._kept[-2 * round(self._model.fps) + 1 :], (turns, places, turned[0], moved)]
        points = self._model.body.places(np.stack((turns, turned[0])), np.float32(np.stack((places, moved))))
        self._show(points)

    def _show(self, points: np.ndarray) -> None:
        """Both characters' joints [2, J, 3], the content never far from where the result stands."""
        gap = (points[0, 0] + self._drawn_at - points[1, 0]) * [1, 0, 1]
        far = float(np.linalg.norm(gap))
        if far > _LEASH:
            self._drawn_at = self._drawn_at - gap * (1 - _LEASH / far)
        shown = points + np.stack((self._drawn_at + self._beside[0], self._beside[1]))[:, None]
        self._sent += 1
        if self._sent - self._seen > _WAITING or not self._seen and self._sent > _WAITING:
            return
        self._clock[self._sent] = time.perf_counter()
        label = ", ".join(self._stream.labels[0])
        self.send({"n": self._sent, "label": label, **self.times}, [np.float32(shown).tobytes()])

    def _heard(self, _: object, message: Mapping, __: object) -> None:
        """What the browser says: that it is there, which frame it has, that it goes."""
        if "seen" in message:
            number = int(message["seen"])
            self._seen = max(self._seen, number)
            sent = self._clock.pop(number, None)
            if sent is not None:
                self._timed("trip", 1000 * (time.perf_counter() - sent))
            if len(self._clock) > 4 * _WAITING:
                self._clock.clear()
        elif "hello" in message:
            self._seen = self._sent
            self._go()

    def _go(self) -> None:
        """Let frames come as long as somebody looks; where no event loop runs, `step` is for whoever likes."""
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            return
        if self._task is None or self._task.done():
            self._task = loop.create_task(self._run())

    async def _run(self) -> None:
        clock, begun, count = time.perf_counter, time.perf_counter(), 0
        while self.playing and self._sent - self._seen < _ABSENT:
            self.step()
            count += 1
            left = begun + count / self._model.fps - clock()
            if left < -0.2:  # something else kept the kernel busy; what was missed is not made up for
                begun, count = clock(), 0
            await asyncio.sleep(max(left, 0))

    def _timed(self, what: str, milliseconds: float) -> None:
        old = self.times[what]
        self.times[what] = old + _CALM * (milliseconds - old) if old else milliseconds

    @property
    def content(self) -> Motion:
        """The last two seconds of what went in."""
        return self._motion(0, "content")

    @property
    def result(self) -> Motion:
        """The last two seconds of what came out."""
        return self._motion(2, "result")

    def _motion(self, first: int, name: str) -> Motion:
        turns, places = (torch.from_numpy(np.float32(np.stack(part))) for part in list(zip(*self._kept))[first:][:2])
        return self._like[:1].replace(rotations=turns, translations=places, name=name)

    def still(self) -> bytes:
        """Content and result of the last two seconds, as the bytes of a PNG."""
        while len(self._kept) < round(1.5 * self._model.fps):
            self.step()
        picture = StaticFigure(figsize=(8.6, 3.8), dpi=100)
        labels = ["content", self.left if self.mix <= 0.5 else self.right]
        axes = picture.add_axes((0, 0.02, 1, 0.96))
        strip([self.content, self.result], poses=9, labels=labels, roles=["content", "result"], ax=axes)
        return picture.png()
