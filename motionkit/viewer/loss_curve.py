"""A loss that is drawn while a network learns."""

from __future__ import annotations

import base64
import io
import time
import uuid

import numpy as np

from ..errors import MotionKitError
from .plots import INK, Print, few_colours, style_axes

_RAW, _SMOOTH = "#b9cfe4", "#2b6ca8"
_SHARE = 0.05  # of the time that a training run may spend on pictures
_DRAWN = 2000  # points of a line; more cannot be told apart


class LossCurve:
    """A curve of the loss that grows in the notebook while a network learns: `fit(..., show=curve)`.

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

    def figure(self) -> Print:
        """The curve so far as a matplotlib Figure."""
        picture = Print(figsize=(6.4, 2.7), dpi=100)
        ax = picture.add_axes((0.09, 0.17, 0.89, 0.72))
        losses, smoothed = np.asarray(self.losses, dtype=float), self.smoothed()
        kept = np.unique(np.linspace(0, max(len(losses) - 1, 0), min(len(losses), _DRAWN)).astype(int))
        steps = np.asarray(self.steps)[kept] if len(kept) else []
        ax.plot(steps, losses[kept], color=_RAW, lw=1, label="loss")
        ax.plot(steps, smoothed[kept], color=_SMOOTH, lw=2.2, label=f"smoothed: {_last(smoothed)}")
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
        return few_colours(io.BytesIO(self.png))

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
