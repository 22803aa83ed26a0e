"""A character who is restyled while you watch: frames go through a stream one by one, sixty a second."""

from __future__ import annotations

import asyncio
import io
import time
from collections.abc import Mapping

import anywidget
import numpy as np
import torch
import traitlets

from ..erd.quick_body import turned, yawed
from ..errors import MotionKitError
from ..motion import Motion
from .body import figures
from .pack import pack
from .pictured import Pictured
from .player import _JS, script
from .plots import Print, few_colours, strip

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
        turns[0] = yawed(self._turn, turns[None, 0])[0]
        root = turned(self._turn, (places[None, :1] - self._start).astype(np.float32))[0, 0] + self._to
        places[0] = root
        self._frame += 1
        if self._frame == len(self._turns):
            self._again(root)
        return turns, places

    def _again(self, root: np.ndarray) -> None:
        """Begin anew, facing the way that it faces."""
        gain = self._yaw[-1] - self._yaw[0]
        self._from = self._turns[-1].copy()
        self._from[0] = yawed(np.float32([-gain]), self._from[None, 0])[0]  # as seen from the beginning
        self._turn, self._frame, self._to = np.float32(self._turn + gain), 0, root * [1, 0, 1]


def _between(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """Quaternions [J, 4] from a to b."""
    if share >= 1:
        return b
    b = np.where((a * b).sum(1, keepdims=True) < 0, -b, b)
    mixed = a + np.float32(share) * (b - a)
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


class Live(Pictured, anywidget.AnyWidget):
    """A content and the same content in a style, live: every frame is restyled alone and drawn at once.

    At the right a dial of all styles; a pad on which left and right mix two of them and up is more; and how much of it
    all, where above 1 is beyond what was learned from. Wishes fade in from the next frame on.

    method: `mk.methods.load("style-erd")`, or anything with its `stream`, `seen` and `model`. content: a motion, which
    is played again and again. label, own_style: what it does, and in which style; left out, the method guesses frame by
    frame. left, right: two styles to begin with. height: pixels. Raises MotionKitError for a content that the method
    cannot take, and unknown styles.

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
        if not all(hasattr(method, name) for name in ("stream", "seen", "model")):
            raise MotionKitError(f"Live needs a method that streams, such as 'style-erd'; found {method!r:.80}")
        seen = method.seen(content)
        model, made = method.model, figures([seen, seen], roles=["content", "result"])
        for style in (left, right):
            model.number("style", style)
        self._model, self._stream = model, method.stream(left, content=label, own_style=own_style)
        self._source, self._kept, self.times = Endless(seen), [], {"ms": 0.0, "trip": 0.0}
        before = seen.positions()[0, 0].numpy()
        self._beside, self._like = [np.float32(f.points[0, 0] - before) * [1, 0, 1] for f in made], seen
        self._drawn_at, self._sent, self._seen, self._clock, self._task = np.zeros(3), 0, 0, {}, None
        data = pack(made, labels=["content", left])
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
        made, root = self._stream.push(turns[None], places[None])
        self._timed("ms", 1000 * (time.perf_counter() - begun))
        moved = places.copy()
        moved[0] = root[0]
        self._kept = [*self._kept[-2 * round(self._model.fps) + 1 :], (turns, places, made[0], moved)]
        points = self._model.body.places(np.stack((turns, made[0])), np.float32(np.stack((places, moved))))
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
        picture, raw = Print(figsize=(8.6, 3.8), dpi=100), io.BytesIO()
        labels = ["content", self.left if self.mix <= 0.5 else self.right]
        axes = picture.add_axes((0, 0.02, 1, 0.96))
        strip([self.content, self.result], poses=9, labels=labels, roles=["content", "result"], ax=axes)
        picture.savefig(raw, format="png", facecolor="white")
        return few_colours(raw)
