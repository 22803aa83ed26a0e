"""What a user may give as a style: one that was learned, several with weights, a clip, or a word."""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from .. import text
from ..actor import SEEN, UNSEEN, style_named
from ..errors import MotionKitError, motion_inside
from ..motion import Motion
from ..restyling import check_share, key_of
from .learning import Recipe
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
    if isinstance(style, list | tuple | set):
        raise MotionKitError("few-shot: several styles are mixed with weights, {old: 0.5, proud: 0.5}; found a list")
    if style is None:
        style = method.last
    elif isinstance(style, Motion):
        prompt = method.prompt_for(style)
        style = method.learned.get(key_of(style), lambda: method.learn(style, prompt, title=""))
    elif isinstance(style, str):
        style = named_style(method.space, style)
    if style is None:
        raise MotionKitError("few-shot: no style was learned yet; first method.learn(clip, 'an old person walks')")
    mix = style if isinstance(style, Mapping) else {style: 1.0} if isinstance(style, LearnedStyle) else {}
    styles = {named_style(method.space, one) if isinstance(one, str) else one: share for one, share in mix.items()}
    if not styles or not all(isinstance(one, LearnedStyle) for one in styles):
        raise MotionKitError(f"few-shot takes learned styles, a clip, or the name of a style; found {style!r:.80}")
    if any(one.prior.key != method.taught.key for one in styles):
        raise MotionKitError("few-shot: this style was learned with another prior; learn it with this one")
    for one, weight in styles.items():
        check_share(f"few-shot: the weight of style {one.style!r}", weight)
    return styles


def check_made(recipe: object, space: object, seed: object) -> None:
    """Raises MotionKitError where the few-shot method was made with what is no recipe, space or seed."""
    if recipe is not None and not isinstance(recipe, Recipe):
        raise MotionKitError(f"few-shot: a recipe is mk.fewshot.Recipe.laptop(), for instance; found {recipe!r:.80}")
    if space is not None and not isinstance(space, StyleSpace):
        raise MotionKitError(f"few-shot: space is a StyleSpace, or left out for the prior's own; found {space!r:.80}")
    if not isinstance(seed, int):
        raise MotionKitError(f"few-shot: a seed is a whole number; found {seed!r}")


def check_learning(method, clip: object, prompt: object, running: Mapping) -> None:
    """Raises MotionKitError where `learn` of the few-shot method was given what it does not take.

    prompt: a sentence; None only where the style is looked for in a space. running: of `_RUNNING`.
    """
    if not isinstance(clip, Motion):
        hint = motion_inside(clip) or "; read a file with mk.load"
        raise MotionKitError(f"few-shot learns a style from a Motion; found {clip!r:.80}{hint}")
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
    known, label = (*SEEN, *UNSEEN), words.lower()
    label = label if label in known else text.style_in(words) if " " in words else label
    if words.endswith((".safetensors", ".bvh")):
        how = "method.load_style" if words.endswith(".safetensors") else "mk.load"
        raise MotionKitError(f"few-shot: {words!r} is a file; read it first: {how}({words!r})")
    if space is None or label not in known:
        near = difflib.get_close_matches(label, known, 1, 0.5) if space is not None else []
        hint = f" Did you mean {near[0]!r}?" if near else ""
        there = f": {', '.join(known)}" if space is not None else ", since this prior has no space of styles"
        raise MotionKitError(
            f"few-shot: {words!r} is no style that it knows by name{there}.{hint} "
            "Any other is learned from a clip, style = method.learn(clip, 'an old person walks'), and given as it comes"
        )
    return LearnedStyle(space.prior, Point(space, style_named(label)), space.chain, words, label)
