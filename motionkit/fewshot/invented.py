"""Styles that nobody has named, and what the performer makes of them: lessons for a space of styles."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from joblib import Parallel, delayed
from torch import Tensor
from tqdm.auto import tqdm

from ..actor import CONTENTS, SEEN, Style, parameters, perform, retell
from ..actor.presets import style_named
from ..datasets.made import FPS, PERFORMERS
from ..features import Normalizer
from ..priors import Prior
from ..priors.features import OfBody, encoded

FRAMES = 144  # of a lesson
_FIRST_SEED = 500_000  # of performances; data sets have others
_ROOM = 15  # frames that a performance is longer


def invented(chance: random.Random) -> Style:
    """A style drawn by chance: most of its numbers near neutral, as far as the eight styles of `actor` go, some far.

    Of the styles held back nothing is known here. Two in three numbers are normal with half the largest distance from
    neutral that any style of `actor` has, one in three lies anywhere within its range, near neutral more often.

    >>> a, b = (invented(random.Random(seed)) for seed in (0, 1))
    >>> a.lean != b.lean
    True
    """
    numbers = {}
    for key, about in parameters().items():
        reach = max(abs(getattr(style_named(style), key) - about.neutral) for style in SEEN)
        if chance.random() < 2 / 3:
            value = about.neutral + 0.5 * reach * chance.gauss(0, 1) * (chance.random() < 0.7)
        else:
            bound = about.high if chance.random() < 0.7 else about.low
            value = about.neutral + 0.85 * chance.random() ** 1.5 * (bound - about.neutral)
        numbers[key] = min(max(value, about.low), about.high)
    return Style("invented", **numbers)


def code_of(style: Style) -> Tensor:
    """A style's numbers [C], each from neutral in halves of its range: what a space of styles is told.

    >>> bool((code_of(Style()) == 0).all())
    True
    """
    halves = {key: 0.5 * (about.high - about.low) for key, about in parameters().items()}
    return torch.tensor([(getattr(style, key) - parameters()[key].neutral) / half for key, half in halves.items()])


@dataclass(frozen=True, eq=False)
class Lessons:
    """Performances told neutrally and in invented styles, frame by frame at the same beat.

    neutral, styled: features [N, F, D], half precision. codes: [N, C], see `code_of`. captions: N neutral sentences.
    """

    neutral: Tensor
    styled: Tensor
    codes: Tensor
    captions: tuple[str, ...]


def lessons(prior: Prior, count: int, each: int = 3, seed: int = 0, jobs: int | None = None) -> Lessons:
    """`count` performances by people of `actor`'s training part, each in `each` invented styles, in a prior's features.

    All contents come equally often. Half of the lessons are in the time of the neutral motion, as a content is, half in
    the style's own, as a style example is. jobs: processes, one a core if left out.
    """
    work = (delayed(_lesson)(prior.layout, prior.normalizer, n, each, seed) for n in range(count))
    found = Parallel(n_jobs=jobs or -1, batch_size=16, return_as="generator")(work)
    rows = list(tqdm(found, "performing", count))
    neutral, styled, codes = (torch.cat([row[n] for row in rows]) for n in range(3))
    return Lessons(neutral, styled, codes, tuple(row[3] for row in rows for _ in range(each)))


def _lesson(layout: OfBody, normalizer: Normalizer, number: int, each: int, seed: int) -> tuple:
    torch.set_num_threads(1)
    chance = random.Random(f"lesson {seed} {number}")
    content, who = CONTENTS[number % len(CONTENTS)], chance.choice(PERFORMERS["train"])
    take = _FIRST_SEED * (1 + seed) + number
    played = perform(content, "neutral", take, seconds=(FRAMES + _ROOM) / FPS, fps=FPS, performer=who)
    styles, pairs = [invented(chance) for _ in range(each)], []
    for style in styles:
        told = retell(played, style)
        if chance.random() < 0.5 and len(told) >= FRAMES:
            pairs.append((played.along(told), told.motion))
        else:
            pairs.append((played.motion, told.along(played)))
    starts = [chance.randrange(min(len(pair[0]) - FRAMES + 1, _ROOM)) for pair in pairs]
    neutral, styled = (
        torch.stack(
            [encoded(pair[n][k : k + FRAMES], layout, normalizer).half() for pair, k in zip(pairs, starts)]
        )
        for n in range(2)
    )
    return neutral, styled, torch.stack([code_of(style) for style in styles]), played.captions[0]


def batches_of(count: int, size: int) -> Iterator[slice]:
    """Slices of at most `size` that cover `count`.

    >>> list(batches_of(5, 3))
    [slice(0, 3, None), slice(3, 5, None)]
    """
    return (slice(n, min(n + size, count)) for n in range(0, count, size))
