"""Paper 1's figure 8: how much noise? What G does to the neutral pair, and K to the result."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .. import text
from ..contacts import foot_contacts
from ..datasets import Clip
from ..errors import MotionKitError
from ..metrics import foot_contact_accuracy
from ..motion import Motion

PAPER_NOISE = (700, 800, 900, 950, 1000)
PAPER_CHANGE = (100, 200, 300, 400, 500, 600)


def sweep_noise(method, examples: Sequence[Clip], values: Iterable[int] = PAPER_NOISE) -> list[dict]:
    """What G does to the neutral motion of a pair (paper 1, figure 8, left).

    method: of `methods.load("few-shot")`. examples: styled clips with captions. values: of G. For each value a row:
    `g`; `fca`, how well the feet of pair and example agree, per cent; `similarity`, the cosine between the pair and the
    neutral sentence as the discriminator sees them. Raises MotionKitError for no examples, and values out of range.
    """
    _some("examples", examples)
    rows = []
    for value in values:
        own = method.having(noise=value)
        made = [own.neutral_motion(clip.motion, clip.text) for clip in examples]
        prompts = [text.to_neutral(clip.text) for clip in examples]
        rows.append({"g": value} | _agreement(method, made, [clip.motion for clip in examples], prompts))
    return rows


def sweep_change(
    method, examples: Sequence[Clip], contents: Sequence[Clip], values: Iterable[int] = PAPER_CHANGE
) -> list[dict]:
    """What K does to the result (paper 1, figure 8, right): every style is learned anew with each K.

    examples, contents: styled and neutral clips with captions; every content is told in every style. values: of K. For
    each value a row: `k`; `fca`, how well the feet of result and content agree, per cent; `similarity`, the cosine
    between the result and the content's sentence in the style. Raises MotionKitError as `sweep_noise`.
    """
    _some("examples", examples)
    _some("contents", contents)
    rows = []
    for value in values:
        own, made, prompts = method.having(change=value), [], []
        for example in examples:
            learned = own.learn(example.motion, example.text, content=example.content, title="")
            made += [own.stylize(clip.motion, learned, caption=clip.text) for clip in contents]
            prompts += [text.to_style(clip.text, learned.style) for clip in contents]
        given = [clip.motion for clip in contents] * len(examples)
        rows.append({"k": value} | _agreement(method, made, given, prompts))
    return rows


def _agreement(method, made: list[Motion], given: list[Motion], prompts: list[str]) -> dict:
    feet = [foot_contact_accuracy(one, foot_contacts(other)) for one, other in zip(made, given)]
    similar = method.discriminator.similarity(made, prompts).diagonal()
    return {"fca": round(sum(feet) / len(feet), 2), "similarity": round(float(similar.mean()), 4)}


def _some(what: str, clips: Sequence[Clip]) -> None:
    mute = next((clip.name for clip in clips if not clip.text), None)
    if not clips or mute is not None:
        found = "none" if not clips else f"{mute!r} without one"
        raise MotionKitError(f"a sweep needs {what}, clips with captions; found {found}")
