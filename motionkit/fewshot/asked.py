"""What a user may give as a style: one that was learned, several with weights, a clip, or a word."""

from __future__ import annotations

import math
from collections.abc import Mapping

from .. import text
from ..actor import SEEN, UNSEEN, style_named
from ..errors import MotionKitError
from ..motion import Motion
from ..restyling import key_of
from .space import Point, StyleSpace
from .styles import LearnedStyle

_RUNNING = ("content", "keep", "every", "show", "title")
NAMELESS = "given"  # the style's word in the sentence for a clip of which nothing is said


def as_styles(method, style: object) -> dict[LearnedStyle, float]:
    """A style as `stylize` of the few-shot method takes it, with weights.

    method: a `methods.few_shot.FewShot`. style: None, for the one learned last; a LearnedStyle; a label or sentence,
    see `named_style`; a mapping from these to weights; a Motion, which is learned first. Raises MotionKitError for what
    is none of these, and for styles of another prior.
    """
    if style is None:
        style = method.last
    elif isinstance(style, Motion):
        prompt = method.prompt_for(style)
        style = method.learned.get(key_of(style), lambda: method.learn(style, prompt, title=""))
    elif isinstance(style, str):
        style = named_style(method.space, style)
    if style is None:
        raise MotionKitError("few-shot: no style was learned yet; first method.learn(clip, 'an old person walks')")
    mix = style if isinstance(style, Mapping) else {style: 1.0}
    styles = {named_style(method.space, one) if isinstance(one, str) else one: share for one, share in mix.items()}
    if not styles or not all(isinstance(one, LearnedStyle) for one in styles):
        raise MotionKitError(f"few-shot takes learned styles, a clip, or the name of a style; found {style!r:.80}")
    if any(one.prior.key != method.taught.key for one in styles):
        raise MotionKitError("few-shot: this style was learned with another prior; learn it with this one")
    for one, weight in styles.items():
        if isinstance(weight, bool) or not isinstance(weight, int | float) or not math.isfinite(weight):
            raise MotionKitError(f"few-shot: the weight of style {one.style!r} is a finite number; found {weight!r}")
    return styles


def check_learning(method, prompt: object, running: Mapping) -> None:
    """Raises MotionKitError where `learn` of the few-shot method was given what it does not take.

    prompt: a sentence; None only where the style is looked for in a space. running: of `_RUNNING`.
    """
    if not isinstance(prompt, str) and (prompt is not None or method.recipe.model != "space"):
        raise MotionKitError(
            "few-shot learns a style from a clip and a sentence: method.learn(clip, 'an old person walks'); found "
            f"{prompt!r:.80}"
        )
    for name in running:
        if name not in _RUNNING:
            hint = ": give it to mk.methods.load('few-shot', recipe=...), or method.having(...)" * (name == "recipe")
            raise MotionKitError(f"few-shot: learn takes {', '.join(_RUNNING)} beside the clip, not {name!r}{hint}")


def named_style(space: StyleSpace | None, words: str) -> LearnedStyle:
    """A style of the performer by its label, or by a sentence that speaks of it: its numbers are its place in a space.

    Raises MotionKitError for other styles, and where there is no space.

    >>> from motionkit.fewshot.space import load
    >>> named_style(load("actor"), "an old person walks")
    LearnedStyle('old', 37 numbers beside ...)
    """
    known = (*SEEN, *UNSEEN)
    label = words if words in known else text.style_in(words) if " " in words else words
    if space is None or label not in known:
        there = f"; by name there are {', '.join(known)}" if space is not None else ""
        raise MotionKitError(
            f"few-shot: {words!r} is no style that was learned here{there}; learn it from a clip: method.learn(clip, "
            "'an old person walks'), or on the command line, motionkit learn"
        )
    return LearnedStyle(space.prior, Point(space, style_named(label)), space.chain, words, label)
