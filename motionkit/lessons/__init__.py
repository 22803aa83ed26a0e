"""Checks for the notebooks' exercises: `mk.exercises.check("name", mine)` says in words what is wrong.

Each exercise has a reference, which is the kit's own function, and a few cases. A stub that returns None or
`NotImplemented` is taken as "not tried yet", so that a notebook runs as shipped.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .. import rotations as rot
from ..contacts import foot_sliding
from ..dtw import dtw_costs
from ..errors import MotionKitError
from ..features import HumanML3D
from ..methods.baselines import match_statistics
from ..motion import Motion
from ..skeleton import smpl
from ..text import similarity
from . import diffusion, few_shot, style_erd


@dataclass(frozen=True)
class Exercise:
    """reference: the right function. cases: argument tuples. hint: what to look at when the numbers differ."""

    reference: Callable
    cases: Callable[[], list[tuple]]
    hint: str


def _random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def _walkers() -> list[tuple]:
    """Motions and contacts: one stands, one slides 1 cm a frame, one flails on random feet, one never stands."""
    turns = rot.identity_quaternion(20, 22)
    still = torch.tensor([0.0, 0.96, 0.0]).expand(20, 3)
    slide = still + torch.arange(20)[:, None] * torch.tensor([0.0, 0.0, 0.01])
    every = torch.ones(20, 4, dtype=torch.bool)
    flailing = Motion.from_root(smpl(), rot.exp_map(0.2 * _random(20, 22, 3)), still + 0.1 * _random(20, 3), 30.0)
    known = [(Motion.from_root(smpl(), turns, root, 30.0), every) for root in (still, slide)]
    return [*known, (flailing, _random(20, 4) > 0), (flailing, ~every)]


def _turns() -> list[tuple]:
    """Pairs of rotations with a share of the way: random ones, equal ones, and one written with both signs."""
    pairs = [(rot.normalize(_random(5, 4)), rot.normalize(_random(5, 4, seed=1)), t) for t in (0.0, 0.3, 1.0)]
    same = rot.normalize(_random(3, 4))
    return [*pairs, (same, same, 0.5), (same, -same, 0.5)]


def _still_column() -> Tensor:
    """Features of which one hardly changes and one never does."""
    return _random(30, 5) * torch.tensor([1.0, 1.0, 1.0, 0.01, 0.0])


def _published_path(features: Tensor) -> Tensor:
    """Where the root stands on the ground, [F, 2], from HumanML3D features [F, 3 or more]."""
    return HumanML3D().path(features)[1]


def _takes() -> list[tuple]:
    """Takes of clips: one clip each, then several clips of a take that stand apart, then one take only."""
    shuffled = ["e", "b", "a", "e", "c", "b", "d", "a", "f", "e"]
    return [([f"take {n}" for n in range(12)],), (shuffled,), (["only"] * 4,)]


def _take_split(takes: list[str]) -> Tensor:
    """Which clips are for the test, bool [N]: all those of every fifth take, in alphabetical order."""
    chosen = set(sorted(set(takes))[::5])
    return torch.tensor([take in chosen for take in takes])


def _padded() -> list[tuple]:
    """Features and masks [B, F]: nothing padded, clips of several lengths, and what stands in the padding is large."""
    features, lengths = _random(4, 10, 3), torch.tensor([10, 7, 3, 1])
    mask = torch.arange(10) < lengths[:, None]
    return [
        (features, torch.ones(4, 10, dtype=torch.bool)),
        (features, mask),
        (features + 1e3 * ~mask[..., None], mask),
    ]


def _masked_mean(features: Tensor, mask: Tensor) -> Tensor:
    """The mean over each clip's own frames, [B, D], of features [B, F, D] with a mask [B, F]."""
    return (features * mask[..., None]).sum(1) / mask.sum(1, keepdim=True)


def _balanced_chances(labels: Tensor) -> Tensor:
    """For each sample the chance to be drawn, [N], such that every label that occurs is drawn equally often."""
    _, group, count = torch.unique(labels, return_inverse=True, return_counts=True)
    return 1 / (count[group] * len(count))


def _narrow() -> list[tuple]:
    """Features [N, D], [M, D] of two crowds: two clouds, one against itself, and one that is only wider."""
    a, b = _random(60, 4), 2 * _random(50, 4, seed=1) + torch.tensor([1.0, 0.0, -1.0, 0.0])
    return [(a, b), (a, a), (a - a.mean(0), 3 * (a - a.mean(0)))]


def _frechet_by_number(a: Tensor, b: Tensor) -> Tensor:
    """The Fréchet distance of two crowds whose numbers are taken one by one, as if none went with another."""
    return ((a.mean(0) - b.mean(0)) ** 2 + (a.std(0) - b.std(0)) ** 2).sum()


def _judged() -> list[tuple]:
    """Found and true labels: as many of each, one class far larger, and a class that is never right."""
    wanted = torch.tensor([0] * 8 + [1] * 2)
    return [
        (torch.tensor([0, 1, 1, 0]), torch.tensor([0, 0, 1, 1])),
        (torch.zeros(10).long(), wanted),
        (torch.tensor([4, 4, 7, 7, 4]), torch.tensor([4, 4, 7, 4, 9])),
    ]


def _fair_accuracy(found: Tensor, wanted: Tensor) -> Tensor:
    """The mean over the classes that occur of the share of each that was found, 0 to 1."""
    return torch.stack([(found[wanted == c] == c).double().mean() for c in wanted.unique()]).mean()


def _costs() -> list[tuple]:
    """Costs [F, G]: one way for free, and random ones, square and not."""
    return [(1 - torch.eye(5),), (_random(6, 6).abs(),), (_random(4, 9, seed=1).abs(),)]


def _warp_cost(costs: Tensor) -> Tensor:
    """What the cheapest path costs, from the first pair of frames to the last."""
    return dtw_costs(costs[None])[0]


def _listening() -> list[tuple]:
    """Queries, keys, values [N, D] and which tokens are there: all, some, and hidden ones that are large."""
    q, k, v = (_random(6, 4, seed=n) for n in range(3))
    there = torch.arange(6) < 4
    return [(q, k, v, there | True), (q, k, v, there), (q, k + 30 * ~there[:, None], v + 1e3 * ~there[:, None], there)]


def _masked_attention(q: Tensor, k: Tensor, v: Tensor, there: Tensor) -> Tensor:
    """What each token hears, [N, D], from the tokens that are there."""
    return torch.nn.functional.scaled_dot_product_attention(q, k, v, there.expand(len(q), -1))


def _recall_at(near: Tensor, k: int) -> Tensor:
    """In which share of the rows of a similarity [N, N] the own column is among the k largest, 0 to 1."""
    return ((near > near.diagonal()[:, None]).sum(1) < k).double().mean()


def _contrastive_loss(motions: Tensor, texts: Tensor, temperature: float) -> Tensor:
    """Cross-entropy of telling each motion's own sentence from the others of the batch."""
    return torch.nn.functional.cross_entropy(similarity(motions, texts) / temperature, torch.arange(len(motions)))


_EXERCISES = {
    "swing_angle": Exercise(
        rot.quaternion_angle,
        lambda: [
            (rot.normalize(_random(5, 4)), rot.normalize(_random(5, 4, seed=1))),
            (torch.eye(4)[:1], -torch.eye(4)[:1]),
        ],
        "q and -q are the same rotation, so the angle between them is 0: use the absolute value of w",
    ),
    "sixd_to_matrix": Exercise(
        rot.sixd_to_matrix,
        lambda: [(_random(7, 6),), (torch.tensor([[2.0, 0, 0, 1, 1, 0]]),)],
        "scale the first column, take its part out of the second, scale that, and cross them; columns, not rows",
    ),
    "slerp": Exercise(
        rot.slerp,
        _turns,
        "go the short way (flip one quaternion when their product is negative) and keep the result at length 1",
    ),
    "match_statistics": Exercise(
        match_statistics,
        lambda: [(_random(30, 5), 2 * _random(40, 5, seed=1) + 3), (_still_column(), _random(40, 5, seed=1))],
        "take mean and spread over frames (dimension 0), with the population's spread (correction=0); let no spread "
        "grow to more than three times what it was",
    ),
    "published_path": Exercise(
        _published_path,
        lambda: [(torch.tensor([[0.0, 0, 1], [0, 0, 1], [0, 0, 1]]),), (0.1 * _random(30, 4),)],
        "the first number is half the turn, and to the right; the step of frame t is seen from where the body faces in "
        "frame t + 1; the path starts at 0, 0",
    ),
    "foot_sliding": Exercise(
        foot_sliding,
        _walkers,
        "the mean over pairs of neighbouring frames in which the same joint stands in both; x and z only, in "
        "millimetres; 0 where nothing stands",
    ),
    "take_split": Exercise(
        _take_split,
        _takes,
        "deal out takes, not clips: every fifth of the different takes in alphabetical order, from the first on; "
        "then a clip goes where its take goes",
    ),
    "masked_mean": Exercise(
        _masked_mean,
        _padded,
        "padded frames must count neither in the sum nor in what you divide by",
    ),
    "balanced_chances": Exercise(
        _balanced_chances,
        lambda: [(torch.tensor([0, 0, 0, 1]),), (torch.tensor([2, 5, 5, 2, 2, 9]),), (torch.tensor([3]),)],
        "every label that occurs gets the same share, and its samples divide that among them; all add up to 1, and "
        "labels need not be 0, 1, 2",
    ),
    "frechet_by_number": Exercise(
        _frechet_by_number,
        _narrow,
        "for each number the difference of the means, squared, plus the difference of the standard deviations (not of "
        "the variances), squared; torch's std divides by N - 1; then the sum over all numbers",
    ),
    "fair_accuracy": Exercise(
        _fair_accuracy,
        _judged,
        "first the share of each class that was found, then the mean over the classes that occur in `wanted`; each "
        "class counts the same, however large it is; a share from 0 to 1",
    ),
    "warp_cost": Exercise(
        _warp_cost,
        _costs,
        "best[i, j] = costs[i, j] + the least of best[i - 1, j], best[i, j - 1] and best[i - 1, j - 1]; the first row "
        "and column have one way only",
    ),
    "masked_attention": Exercise(
        _masked_attention,
        _listening,
        "scores are q @ k.T divided by the root of D; those of tokens that are not there become minus infinity before "
        "the softmax, not zero after it",
    ),
    "recall_at": Exercise(
        _recall_at,
        lambda: [(torch.eye(5), 1), (_random(12, 12), 1), (_random(12, 12), 3), (_random(12, 12).T, 3)],
        "row n is motion n, and its own sentence is column n; count how many in the row are nearer than that, and see "
        "whether they are fewer than k; the answer is a share from 0 to 1",
    ),
    "contrastive_loss": Exercise(
        _contrastive_loss,
        lambda: [(torch.eye(4), torch.eye(4), 0.1), (_random(6, 8), 3 * _random(6, 8, seed=1), 0.5)],
        "first vectors of length 1, then all products [N, N] divided by the temperature; row n is a question with N "
        "answers, of which n is right: minus the logarithm of its share after softmax, and the mean of that",
    ),
}
_EXERCISES |= {
    name: Exercise(*parts) for module in (diffusion, few_shot, style_erd) for name, parts in module.EXERCISES.items()
}


# slips that are common enough to be told by name
_FACTORS = {0.5: "half", 2.0: "twice", -1.0: "minus", 180 / math.pi: "57.3 times (degrees?)", 0.001: "a thousandth of"}


def names() -> list[str]:
    """The exercises there are.

    >>> "slerp" in names()
    True
    """
    return sorted(_EXERCISES)


def reference(name: str) -> Callable:
    """The function that `check` compares with: what a stub in a notebook falls back to.

    >>> reference("take_split")(["b", "a", "b"])
    tensor([False,  True, False])
    """
    return _exercise(name).reference


def check(name: str, mine: Callable) -> bool:
    """Compare a function with the kit's on a few cases, print a sentence, and return whether it is right.

    >>> check("slerp", lambda a, b, t: a)
    slerp: not yet. In case 2 the largest difference is 0.384. Hint: go the short way (flip one quaternion when their \
product is negative) and keep the result at length 1
    False
    >>> check("slerp", rot.slerp)
    slerp: right.
    True
    """
    problem = _first_problem(_exercise(name), mine)
    print(f"{name}: {problem or 'right.'}")
    return problem is None


def _exercise(name: str) -> Exercise:
    if name not in _EXERCISES:
        near = difflib.get_close_matches(name, _EXERCISES, 1, 0.3)
        raise MotionKitError(
            f"no exercise {name!r}; {'did you mean ' + repr(near[0]) + '? ' if near else ''}all: {', '.join(names())}"
        )
    return _EXERCISES[name]


def _first_problem(exercise: Exercise, mine: Callable) -> str | None:
    for number, case in enumerate(exercise.cases(), 1):
        wanted = torch.as_tensor(exercise.reference(*case))
        try:
            got = mine(*case)
        except Exception as error:
            return f"not yet. Case {number} stops with {type(error).__name__}: {error}"
        if got is None or got is NotImplemented:
            return "not tried yet: write the function, then run this cell again."
        if isinstance(got, tuple):
            return f"not yet. Return one tensor or number, not a tuple of {len(got)}."
        problem = _difference(torch.as_tensor(got), wanted)
        if problem:
            return f"not yet. In case {number} {problem}" + (f" Hint: {exercise.hint}" if "largest" in problem else "")
    return None


def _difference(got: Tensor, wanted: Tensor) -> str | None:
    """In words, what is wrong with an answer; None where nothing is."""
    if got.shape != wanted.shape:
        return f"the shape is {list(got.shape)}; expected {list(wanted.shape)}."
    got, wanted = got.detach().double(), wanted.detach().double()
    if not torch.isfinite(got).all():
        return "some numbers are not finite: where do you divide by 0, or take the root of less than 0?"
    near = 1e-4 * max(1.0, float(wanted.abs().max()))
    gap = float((got - wanted).abs().max())
    if gap <= near:
        return None
    for factor, text in _FACTORS.items():
        if float((got - factor * wanted).abs().max()) <= near * abs(factor):
            return f"your numbers are {text} the right ones."
    return f"the largest difference is {gap:.3g}."


def __getattr__(name: str):
    """What one notebook shows, such as `mk.lessons.judging`, imported when first named."""
    if importlib.util.find_spec(f"{__name__}.{name}") is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return importlib.import_module(f".{name}", __name__)
