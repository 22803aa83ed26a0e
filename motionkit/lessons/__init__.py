"""The notebooks' exercises: `mk.exercises.check("slerp", my_slerp)` says in words what is wrong, and gives a hint.

An exercise stands in the lesson file of its notebook, beside that notebook's pictures: `lessons/layouts.py` for 02.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion

_LESSONS = {  # a lesson file is imported when one of its exercises is named
    "representation": ("sixd_to_matrix", "slerp", "swing_angle"),
    "layouts": ("foot_sliding", "match_statistics", "published_path"),
    "data": ("balanced_chances", "masked_mean", "take_split"),
    "judging": ("fair_accuracy", "frechet_by_number", "warp_cost"),
    "diffusion": ("key_frames", "sampler_steps", "x0_from_velocity"),
    "text": ("contrastive_loss", "masked_attention", "recall_at"),
    "few_shot": ("blend", "low_rank"),
    "style_erd": ("residual_mix", "slope_penalty"),
}
_FACTORS = {0.5: "half", 2.0: "twice", -1.0: "minus", 180 / math.pi: "57.3 times (degrees?)", 0.001: "a thousandth of"}


@dataclass(frozen=True)
class Exercise:
    """One exercise.

    reference: the right function. cases: called anew for every answer; gives what is special about a case -> arguments.
    Where an argument asks for gradients (`requires_grad`), those of the answer are compared, too. hints: from a gentle
    one to all but the answer. mistakes: what to tell somebody -> the typical wrong answer that this helps with.
    """

    reference: Callable
    cases: Callable[[], dict[str, tuple]]
    hints: tuple[str, ...]
    mistakes: dict[str, Callable]


class _Answer(NamedTuple):
    """What a function gave: its values, and the gradients that flow back from them; None where none do."""

    values: Tensor
    gradients: tuple[Tensor, ...] | None


class _NotTried(Exception):
    """Nothing is written yet."""


class _Wrong(Exception):
    """In words, what is wrong."""


def names() -> list[str]:
    """The exercises there are.

    >>> "slerp" in names()
    True
    """
    return sorted(name for exercises in _LESSONS.values() for name in exercises)


def reference(name: str) -> Callable:
    """The function that `check` compares with, for cells that go on where an exercise may not be solved yet.

    >>> reference("take_split")(["b", "a", "b"])
    tensor([False,  True, False])
    """
    return _exercise(name).reference


def check(name: str, mine: Callable, *, hint: int | None = None) -> bool:
    """Compare a function with the kit's on a few cases, print what is wrong and a hint, return whether it is right.

    mine: any right way will do: a tensor, a number or a list, on any device, of any precision. hint: which hint to
    print; left out, the first as long as nothing is written, and the second after a wrong answer. Raises MotionKitError
    only for an exercise that there is not.

    >>> def my_slerp(a, b, t): ...
    >>> check("slerp", my_slerp)
    slerp: not tried yet, nothing is returned.
    Hint 1 of 3: which of two arcs is the shorter one, and what if there is none? (hint=2 tells more)
    False
    >>> check("slerp", lambda a, b, t: (1 - t) * a + t * b)
    slerp: not yet. In case 2 (3/10 of the way), the largest difference is 0.523.
    A straight line cuts through the sphere: weigh a and b with sines.
    Hint 2 of 3: flip b where its product with a is negative, and think of sin Ω = 0. (hint=3 tells more)
    False
    >>> check("slerp", reference("slerp"))
    slerp: right.
    True
    """
    exercise = _exercise(name)
    try:
        _compare(exercise, mine)
    except _NotTried as state:
        print(f"{name}: {state}\n{_hint(exercise, hint or 1)}")
        return False
    except _Wrong as problem:
        print(f"{name}: not yet. {problem}\n{_hint(exercise, hint or 2)}")
        return False
    print(f"{name}: right.")
    return True


def seeded_randn(*shape: int, seed: int = 0) -> Tensor:
    """`torch.randn` that gives the same numbers at every call: for cases."""
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def _exercise(name: str) -> Exercise:
    for lesson, exercises in _LESSONS.items():
        if name in exercises:
            return importlib.import_module(f".{lesson}", __name__).EXERCISES[name]
    near = difflib.get_close_matches(str(name), names(), 1, 0.3)
    did_you_mean = f"did you mean {near[0]!r}? " if near else ""
    raise MotionKitError(f"no exercise {name!r}; {did_you_mean}all: {', '.join(names())}")


def _hint(exercise: Exercise, stage: int) -> str:
    stage, last = min(max(stage, 1), len(exercise.hints)), len(exercise.hints)
    more = f" (hint={stage + 1} tells more)" if stage < last else ""
    return f"Hint {stage} of {last}: {exercise.hints[stage - 1]}{more}"


def _compare(exercise: Exercise, mine: Callable) -> None:
    """Raise `_NotTried` or `_Wrong` unless a function gives the reference's answers."""
    if not callable(mine):
        raise _Wrong(f"Give the function itself, as in check(name, my_function); found a {type(mine).__name__}.")
    answers = []
    for number, words in enumerate(exercise.cases()):
        case, wanted = exercise.cases()[words], _answer(exercise.reference, exercise.cases()[words])
        where = f"In case {number + 1} ({words}), "
        try:
            answers.append(_answer(mine, case))
        except _NotTried:
            if number:
                raise _Wrong(f"{where}nothing is returned: is there a way through without `return`?") from None
            raise
        except _Wrong as problem:
            raise _Wrong(f"{where}{problem}") from None
        except (Exception, SystemExit) as error:
            raise _Wrong(f"{where}it stops with {type(error).__name__}: {error}") from None
        if not _unchanged(case, exercise.cases()[words]):
            raise _Wrong(f"{where}it changes what it was given, which others still need: work on a copy.")
        difference = _difference(answers[-1], wanted)
        if difference:
            raise _Wrong(f"{where}{difference}{_sentence(exercise, answers)}")


def _answer(function: Callable, case: tuple) -> _Answer:
    """Call a function; raises `_NotTried` and `_Wrong`, and whatever the function raises."""
    try:
        result = function(*case)
    except NotImplementedError as error:
        if error.args:  # torch says so, too, of types that it has no code for
            raise
        result = None
    if result is None or result is NotImplemented or result is ...:
        raise _NotTried("not tried yet, nothing is returned.")
    if isinstance(result, tuple):
        raise _Wrong(f"return one tensor or number, not a tuple of {len(result)}.")
    try:
        values = torch.as_tensor(result)
        plain = values.detach().cpu().to_dense()
        plain.reshape(-1).to(torch.complex128)
    except Exception:
        raise _Wrong(f"return a tensor or a number; found a {type(result).__name__} that cannot be read.") from None
    inputs = [x for x in case if isinstance(x, Tensor) and x.requires_grad and x.is_leaf]
    gradients = None
    if inputs and values.requires_grad:
        gradients = torch.autograd.grad(values.sum(), inputs, allow_unused=True, materialize_grads=True)
    return _Answer(plain, gradients)


def _difference(answer: _Answer, wanted: _Answer) -> str | None:
    """In words, what is wrong with an answer; None where nothing is."""
    values, right = answer.values, wanted.values
    if values.shape != right.shape:
        return f"the shape is {list(values.shape)}; expected {list(right.shape)}."
    if values.is_complex() or (right.dtype == torch.bool and values.dtype != torch.bool):
        return f"the numbers are of type {values.dtype}; expected {right.dtype}."
    gap = _gap(values, right)
    if gap is None:
        return _gradient_difference(answer.gradients, wanted.gradients)
    if not torch.isfinite(values).all():
        return "some numbers are not finite: where do you divide by 0, or take the root of less than 0?"
    for factor, text in _FACTORS.items():
        if _gap(values / factor, right) is None:
            return f"your numbers are {text} the right ones."
    return f"the largest difference is {gap:.3g}."


def _gap(values: Tensor, right: Tensor) -> float | None:
    """The largest difference, or None where it is but rounding; NaN is like NaN, to tell one mistake from another."""
    values, right = values.double(), right.double()
    near = 1e-4 * max(1.0, float(right.abs().nan_to_num().max()))
    return None if torch.allclose(values, right, 0, near, equal_nan=True) else float((values - right).abs().max())


def _gradient_difference(gradients: tuple[Tensor, ...] | None, right: tuple[Tensor, ...] | None) -> str | None:
    if gradients is None or right is None:
        cut_off = "the numbers are right, but no gradient flows back through them: nobody could learn from this."
        return None if gradients is right else cut_off
    if any(_gap(*pair) is not None for pair in zip(gradients, right)):
        return "the numbers are right, but not the gradients that flow back through them."
    return None


def _sentence(exercise: Exercise, answers: list[_Answer]) -> str:
    """What helps with the typical mistake that gives the same answers, on a line of its own; nothing if none does."""
    for sentence, mistake in exercise.mistakes.items():
        cases = exercise.cases().values()
        if all(_difference(answer, _answer(mistake, case)) is None for answer, case in zip(answers, cases)):
            return f"\n{sentence}"
    return ""


def _unchanged(case: object, before: object) -> bool:
    if isinstance(case, Tensor):
        return torch.equal(case, before)
    if isinstance(case, Motion):
        return _unchanged((case.rotations, case.translations), (before.rotations, before.translations))
    if isinstance(case, list | tuple):
        return len(case) == len(before) and all(map(_unchanged, case, before))
    return case == before


def __getattr__(name: str):
    """What one notebook shows, such as `mk.lessons.judging`, imported when first named."""
    if importlib.util.find_spec(f"{__name__}.{name}") is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return importlib.import_module(f".{name}", __name__)
