"""Paper 2, Style-ERD: online style transfer between labelled styles, one frame in, one frame out."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from .. import checkpoints
from ..datasets import Clip
from ..erd.frames import frames_of
from ..erd.labels import Guesses
from ..erd.model import ErdModel
from ..erd.stream import ErdStream
from ..errors import MotionKitError
from ..motion import Motion
from ..restyling import body_of, check_clips, named, on_body, on_the_ground

_LATE = 0.5  # seconds that a guessed content comes late


@lru_cache(maxsize=4)
def shipped(data: str) -> ErdModel:
    """The shipped model of a dataset; MotionKitError if there is none."""
    return ErdModel.load(checkpoints.find(f"{data}-erd"))


class StyleErdMethod:
    """Style-ERD (paper 2): an encoder, recurrent branches whose sum is the style, a decoder, all causal.

    model: by the name of the dataset that it learned from, or an `erd.model.ErdModel`. It knows the styles of that
    dataset and no others. The shipped ones learned by `erd.ErdRecipe.laptop`, beyond the paper: they also saw
    neutral clips in step with styled ones, and what is lost on the way through the network is put back.

    >>> import motionkit as mk
    >>> method, walk = mk.methods.load("style-erd"), mk.load("data/actor/walk_neutral.bvh")
    >>> method.stylize(walk, style="old")
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    >>> stream, frames = method.stream(style="old"), method.seen(walk)
    >>> for n in range(60):
    ...     made = stream(frames[n : n + 1])
    >>> len(made), made.fps
    (1, 60.0)
    >>> stream.labels[0][1]
    'neutral'
    """

    name = "style-erd"

    def __init__(self, model: str | ErdModel = "actor") -> None:
        self.model = shipped(model) if isinstance(model, str) else model

    @property
    def styles(self) -> tuple[str, ...]:
        """What it can be asked for."""
        return self.model.styles

    def stream(self, style: object = "neutral", strength: object = 1.0, **labels) -> ErdStream:
        """A live stream: call it with one frame, at the model's rate, for one frame back; see `erd.stream.ErdStream`.

        style: a name or a mix such as {"old": 0.5, "proud": 0.5}; it may be changed at any frame. labels: `content`,
        `own_style`, `count` and `fade`, as there.
        """
        return ErdStream(self.model, style, strength, **labels)

    def stylize(
        self,
        content: Motion,
        style: str | Mapping[str, float] | Motion = "neutral",
        strength: float = 1.0,
        lock: bool = True,
        *,
        content_label: str | None = None,
        content_style: str | None = None,
    ) -> Motion:
        """The content clip in a style, streamed frame by frame.

        content: F frames of a human body, at any rate. style: a name, a mix of several (paper 2, section 4.4), or a
        clip, whose style is then recognised. strength: 0 is neutral, 1 the style, more exaggerates. lock: hold standing
        feet still, which looks ahead; a live stream does not. content_label, content_style: of what comes in; left out,
        the style is what most of the clip looks like, the content what each part of it does. Returns F frames at the
        content's rate, on its skeleton. Raises MotionKitError for styles that the model does not know, and bodies that
        cannot be brought to its own.
        """
        check_clips(self.name, content, content, strength)
        given, seen, what = body_of(content), self.seen(content), style
        if isinstance(style, Motion):
            style = self.recognised(style)[1]
        labels, own = self._labelled(seen, content_label, content_style)
        body = self._back(self._run(seen, style, strength, labels, own), given)
        if lock:
            body = on_the_ground(body, given)
        return content.with_body(body).replace(name=named(content, _words(what)))

    def seen(self, motion: Motion) -> Motion:
        """A motion as the model sees it: its skeleton and rate. MotionKitError where it cannot be."""
        if not isinstance(motion, Motion):
            raise MotionKitError(f"style-erd takes a Motion, such as mk.load('walk.bvh'); found {motion!r:.80}")
        body, skeleton, fps = body_of(motion), self.model.skeleton, self.model.fps
        if not body.skeleton.same_tree(skeleton):
            still = Motion.from_root(skeleton, torch.eye(4)[:1].expand(1, len(skeleton), 4), torch.zeros(1, 3), fps)
            body = on_body(body, still)
        return body if abs(body.fps - fps) < 1e-3 else body.resample(fps, smooth=True)

    def transfer(self, content: Clip, style: Clip) -> Motion:
        """`stylize` for labelled clips, as the arena asks."""
        return self.stylize(content.motion, style.style, content_label=content.content, content_style=content.style)

    def recognised(self, motion: Motion) -> tuple[str, str]:
        """Content and style that most frames of a motion look like, after those before them.

        Raises MotionKitError where the model guesses no labels.
        """
        contents, styles = self._guessed(self.seen(motion))
        return max(contents, key=contents.count), max(styles, key=styles.count)

    def _guessed(self, seen: Motion) -> tuple[list[str], list[str]]:
        """What every frame looks like, after those before it."""
        if self.model.labeller is None:
            raise MotionKitError("style-erd: this model guesses no labels; give content_label and content_style")
        guesses, found = Guesses(self.model.labeller), ([], [])
        for frame in frames_of(seen).x.numpy():
            guesses.hear(frame[None])
            found[0].append(self.model.contents[guesses.content[0]])
            found[1].append(self.styles[guesses.style[0]])
        return found

    def _run(self, seen: Motion, style: object, strength: float, contents: list[str], own: str) -> Motion:
        """A motion of the model's skeleton and rate through a stream of its own; contents: of every frame."""
        stream, made = ErdStream(self.model, style, strength, content=contents[0], own_style=own), []
        for turns, places, content in zip(seen.rotations.numpy(), seen.translations.numpy(), contents):
            if content != stream.content:
                stream.content = content
            made.append(stream.push(turns[None], places[None]))
        rotations, roots = (torch.from_numpy(np.concatenate(part)) for part in zip(*made))
        return seen.replace(rotations=rotations, translations=_rooted(seen.translations, roots))

    def _labelled(self, seen: Motion, content: str | None, style: str | None) -> tuple[list[str], str]:
        """The content of every frame and the style of the clip: as given, the others recognised.

        A guess comes late, since it rests on what was; but here the whole clip is known, and it is taken earlier.
        """
        if content is not None and style is not None:
            return [content] * len(seen), style
        contents, styles = self._guessed(seen)
        late = round(_LATE * seen.fps)
        contents = [*contents[late:], *[contents[-1]] * min(late, len(contents))]
        given = [content] * len(seen) if content is not None else contents
        return given, max(styles, key=styles.count) if style is None else style

    def _back(self, body: Motion, given: Motion) -> Motion:
        """What the model made, on the content's body and in its frames."""
        if body.skeleton is not given.skeleton:
            body = on_body(body, given)
        if len(body) != len(given) or abs(body.fps - given.fps) > 1e-3:
            times = torch.arange(len(given), dtype=torch.float64) * (self.model.fps / given.fps)
            body = body.at(times.clamp(max=len(body) - 1), smooth=True).replace(fps=given.fps)
        gap = given.root_path()[0] - body.root_path()[0]
        return body.moved(offset=(float(gap[0]), 0.0, float(gap[1])))


def _rooted(translations: Tensor, roots: Tensor) -> Tensor:
    """Bones as they are, the root elsewhere."""
    translations = translations.clone()
    translations[:, 0] = roots
    return translations


def _words(style: object) -> str:
    """What a style is called."""
    if isinstance(style, Mapping):
        return " + ".join(style)
    return getattr(style, "name", style)
