"""Notebook 07: a style learned from a BVH file, and played; its exercises."""

from __future__ import annotations

from collections.abc import Mapping

import ipywidgets
import torch
from torch import Tensor

from .. import bvh
from ..datasets import Labels
from ..errors import MotionKitError
from ..motion import Motion
from ..viewer.player import Player
from ..viewer.plots import INK, StaticFigure, strip
from . import Exercise, seeded_randn
from .text import MessageBox

ALL = "all of them"
_STRENGTHS = (0.0, 0.5, 0.75, 1.0, 1.25, 1.5)


class StyleLesson(MessageBox):
    """Controls on the left: a BVH file, a sentence that says what it does and how, *learn*; then what is to be played.

    On the right a player with a content and the same content in the style that was learned last, or with all contents
    in that style, each on the spot. What is wrong with a clip or a sentence is told under the controls, and what was
    learned before stays.

    method: of `methods.load("few-shot")` or "style-code", or anything with their `learn` and `stylize`. contents: by
    their captions, neutral motions. style, prompt: a clip and its sentence to begin with; left out, nothing is learned
    yet. Raises MotionKitError if there are no contents, or if the first clip cannot be learned from.

    controls: "file", "prompt", "content" and "strength", name to widget; set their values and it follows; `learn()` is
    what the button does. `results` are the restyled motions shown, `learned` the style, `message` what stands under the
    controls.

    >>> import motionkit as mk
    >>> walk, old = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old"))
    >>> lesson = StyleLesson(mk.methods.load("few-shot"), {"a person walks": walk})
    >>> lesson.message
    'give a BVH file of a second or more, and say what it does and how'
    """

    about = "a style lesson"

    def __init__(
        self, method: object, contents: Mapping[str, Motion], style: Motion | None = None, prompt: str = ""
    ) -> None:
        if not contents or not all(isinstance(motion, Motion) for motion in contents.values()):
            raise MotionKitError(f"StyleLesson: expected contents by their captions; found {contents!r:.80}")
        self._method, self._contents, self._clip = method, dict(contents), style
        self.learned, self.results = None, []
        controls = _controls(list(self._contents), prompt)
        file, sentence, *playing = controls.values()
        self.button = ipywidgets.Button(description="learn", button_style="primary", layout={"width": "110px"})
        player = Player(next(iter(self._contents.values())), height=360, roles=["content"], labels=["content"])
        super().__init__(player, controls, [file, sentence, self.button, *playing])
        self._tell("said", "give a BVH file of a second or more, and say what it does and how")
        if style is not None:
            self._learn()
        self.controls["file"].observe(lambda _: self._read(), "value")
        for name in ("content", "strength"):
            self.controls[name].observe(lambda _: self._play(), "value")
        self.button.on_click(lambda _: self.learn())

    @property
    def captions(self) -> list[str]:
        """Of the motions that are to be restyled."""
        caption = self.controls["content"].value
        return list(self._contents) if caption == ALL else [caption]

    @property
    def _names(self) -> list[str]:
        return [caption.removeprefix("a person ") for caption in self.captions]

    @property
    def chosen(self) -> list[Motion]:
        """The motions that are to be restyled."""
        return [self._contents[caption] for caption in self.captions]

    def learn(self) -> None:
        """Learn the style of the clip that was given, and play it."""
        self.button.disabled, self.button.description = True, "learning ..."
        try:
            self._learn()
        except MotionKitError as error:
            self._tell("error", str(error))
        finally:
            self.button.disabled, self.button.description = False, "learn"

    def _learn(self) -> None:
        if self._clip is None:
            raise MotionKitError("no clip was given yet: choose a BVH file first")
        self.learned = self._method.learn(self._clip, self.controls["prompt"].value, title="")
        self._tell("said", f"learned {self.learned.name!r} from {self._clip.name!r}, {self._clip.duration:.1f} s")
        self._play()

    def _read(self) -> None:
        """Take the file that was chosen."""
        for file in self.controls["file"].value:
            try:
                self._clip = bvh.parse(bytes(file["content"]), file["name"])
                self._tell("said", f"{self._clip.name}: {self._clip.duration:.1f} s; now say what it does, and how")
            except MotionKitError as error:
                self._tell("error", str(error))

    def _play(self) -> None:
        plain, captions, style = self.chosen, self.captions, self.learned
        several = len(plain) > 1
        layout = "treadmill" if several else "side"
        if style is None:
            self.player.set_motions(plain, labels=self._names, roles=["content"] * len(plain), layout=layout)
            return
        strength = self.controls["strength"].value
        try:
            results = [
                self._method.stylize(content, style, strength, labels=Labels(texts=(caption,)))
                for content, caption in zip(plain, captions)
            ]
        except MotionKitError as error:
            self._tell("error", str(error))
            return
        self.results = results
        shown, names, roles = [*plain, *results], ["content", style.name], ["content", "result"]
        if several:
            shown, names, roles = results, self._names, ["result"] * len(results)
        self.player.set_motions(shown, labels=names, roles=roles, layout=layout)

    def still(self) -> bytes:
        """Content, result and message, as the bytes of a PNG."""
        results, plain = self.results, self.chosen
        plain = [] if len(results) > 1 else plain
        rows, roles = [*plain, *results], ["content"] * len(plain) + ["result"] * len(results)
        picture = StaticFigure(figsize=(8.6, 1.0 + 1.7 * len(rows)), dpi=100)
        labels = ["content", self.learned.name] if len(results) == 1 else self._names
        strip(rows, poses=9, labels=labels, roles=roles, ax=picture.add_axes((0, 0.12, 1, 0.85)))
        self._write_message(picture, INK)
        return picture.png()


def _controls(captions: list[str], prompt: str) -> dict[str, ipywidgets.Widget]:
    wide = {"layout": {"width": "300px"}}
    return {
        "file": ipywidgets.FileUpload(accept=".bvh", description="a BVH file", layout={"width": "200px"}),
        "prompt": ipywidgets.Text(value=prompt, placeholder="a person walks like a king", **wide),
        "content": ipywidgets.Dropdown(options=[*captions, *[ALL][: len(captions) > 1]], description="play", **wide),
        "strength": ipywidgets.SelectionSlider(
            options=_STRENGTHS, value=1.0, description="strength", continuous_update=False, **wide
        ),
    }


def _low_rank(weight: Tensor, down: Tensor, up: Tensor, strength: float) -> Tensor:
    """A matrix [out, in] with a change of low rank: A = down [rank, in], B = up [out, rank]."""
    return weight + strength * up @ down


def _matrices() -> dict[str, tuple]:
    weight, down, up = seeded_randn(6, 5), seeded_randn(2, 5, seed=1), seeded_randn(6, 2, seed=2)
    return {f"strength {strength}": (weight, down, up, strength) for strength in (1.0, 0.5, 0.0)}


def _blend(predictions: list[Tensor], weights: list[float], base: Tensor) -> Tensor:
    """Predictions with their weights, and the rest of 1 from the base."""
    return _weighted(predictions, weights) + (1 - sum(weights)) * base


def _weighted(predictions: list[Tensor], weights: list[float]) -> Tensor:
    return sum(w * x for w, x in zip(weights, predictions))


def _predictions() -> dict[str, tuple]:
    a, b, base = seeded_randn(3, 1, 8, 4)
    return {
        "one style": ([a], [1.0], base),
        "half of each of two": ([a, b], [0.5, 0.5], base),
        "more of one, less of another": ([a, b], [1.5, -0.5], base),
        "a little of one": ([a], [0.3], base),
    }


EXERCISES = {
    "blend": Exercise(
        _blend,
        cases=_predictions,
        hints=(
            "with one style and the weight 0.3, what are the other 0.7?",
            "the weights of all that is added up make 1: the base gets what they leave.",
            "the sum of weight * prediction, plus (1 - sum(weights)) * base.",
        ),
        mistakes={
            "What the weights leave of 1 belongs to the base.": lambda xs, weights, base: _weighted(xs, weights),
            "The base gets only what the weights leave of 1.": lambda xs, weights, base: base + _weighted(xs, weights),
            "Each prediction has its own weight: this is the plain mean.": lambda xs, *_: torch.stack(xs).mean(0),
            "Do not scale the weights to 1 among themselves.": lambda xs, w, base: _weighted(xs, w) / sum(w),
        },
    ),
    "low_rank": Exercise(
        _low_rank,
        cases=_matrices,
        hints=(
            "which product of `up` and `down` has the shape of the matrix?",
            "up comes first: [out, rank] @ [rank, in]; strength scales the change, and the matrix itself stays.",
            "weight + strength * (up @ down).",
        ),
        mistakes={
            "That is the change; add it to the matrix.": lambda weight, down, up, strength: strength * up @ down,
            "The matrix stays as it is; only the change counts by strength.": lambda weight, down, up, strength: (
                strength * (weight + up @ down)
            ),
            "The strength counts once, not for each factor.": lambda w, down, up, strength: w + strength**2 * up @ down,
            "The strength is missing.": lambda weight, down, up, strength: weight + up @ down,
        },
    ),
}
