"""Training, validation and test: parts of a dataset that share no take.

Clips of one take resemble each other nearly frame by frame. Were some of them trained on and others tested on, the
test would measure memory; so whatever is dealt out, a take goes to one part as a whole.
"""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Iterable, Sequence
from typing import Protocol, TypeVar

from ..errors import MotionKitError

_KINDS = ("take", "performer", "content", "style", "given")
_T = TypeVar("_T")


class Labelled(Protocol):
    """What splitting needs of a `Dataset`."""

    name: str
    indices: Sequence[int]
    labels: Sequence
    store: object


def split_indices(
    dataset: Labelled, by: str | None, shares: Sequence[float] | None, seed: int
) -> tuple[list[int], list[int], list[int]]:
    """Indices of the clips of train, validation and test, in the dataset's order; see `Dataset.split`."""
    if by is None:
        given = shares is None and dataset.indices and all(dataset.labels[n].split for n in dataset.indices)
        by = "given" if given else "take"
    if by not in _KINDS:
        raise MotionKitError(f"a dataset is split by {', '.join(map(repr, _KINDS))}; found by={by!r}")
    if by == "given" and shares is not None:
        raise MotionKitError("the split of the dataset's makers has shares of its own; leave shares out, or by='take'")
    if by == "given":
        part_of = _given(dataset)
    else:
        shares = _checked((0.8, 0.1, 0.1) if shares is None else shares)
        groups = _take_groups(dataset, seed) if by == "take" else _label_groups(dataset, by, seed)
        counts = _counts(len(groups), shares, by)
        part_of = {n: part for group, part in zip(groups, _deal(counts)) for n in group}
    return tuple([n for n in dataset.indices if part_of[n] == part] for part in range(3))


def _checked(shares: Sequence[float]) -> tuple[float, ...]:
    try:
        found = tuple(map(float, shares))
    except (TypeError, ValueError):
        found = ()
    if len(found) != 3 or not all(0 <= s <= 1 for s in found) or abs(sum(found) - 1) > 1e-6:
        raise MotionKitError(
            f"shares must be three numbers from 0 that add up to 1, for train, validation and test, as (0.8, 0.1, "
            f"0.1); found {shares!r}"
        )
    return found


def _given(dataset: Labelled) -> dict[int, int]:
    """The makers' part of each clip; MotionKitError where there is none, or a take is in two."""
    names = {"train": 0, "training": 0, "validation": 1, "val": 1, "test": 2}
    found, takes = {}, {}
    for n in dataset.indices:
        name, said = dataset.store.clips[n].name, dataset.labels[n].split
        if said not in names:
            what = f"is in part {said!r}; expected train, validation or test" if said else "is in no part"
            raise MotionKitError(
                f"dataset {dataset.name!r} has no whole split by its makers: clip {name!r} {what}; split by='take'"
            )
        found[n] = names[said]
        first = takes.setdefault(_take(dataset, n), n)
        if found[first] != found[n]:
            raise MotionKitError(
                f"dataset {dataset.name!r}: its makers put clips of take {_take(dataset, n)!r} into two parts "
                f"({dataset.store.clips[first].name!r} and {name!r}), so the test would leak; split by='take'"
            )
    return found


def _take(dataset: Labelled, number: int) -> str:
    return dataset.labels[number].take or dataset.store.clips[number].name


def _mixed(seed: int, values: Iterable[_T]) -> list[_T]:
    """An order that depends on the seed alone, not on Python's version or the other values."""
    return sorted(values, key=lambda v: hashlib.sha256(f"{seed} {v}".encode()).digest())


def _grouped(pairs: Iterable[tuple[Hashable, _T]]) -> dict[Hashable, list[_T]]:
    found: dict[Hashable, list[_T]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


def _take_groups(dataset: Labelled, seed: int) -> list[list[int]]:
    """Clips of each take; takes of the same content and style stand together, so that dealing stratifies."""
    takes = _grouped((_take(dataset, n), n) for n in dataset.indices)
    kinds = _grouped((tuple(sorted({dataset.labels[n][:2] for n in clips})), take) for take, clips in takes.items())
    return [takes[take] for kind in _mixed(seed, kinds) for take in _mixed(seed, kinds[kind])]


def _label_groups(dataset: Labelled, by: str, seed: int) -> list[list[int]]:
    """Clips of each performer, content or style; those that a take ties together are one group."""
    if by == "performer" and not all(dataset.labels[n].performer for n in dataset.indices):
        nobody = next(n for n in dataset.indices if not dataset.labels[n].performer)
        raise MotionKitError(
            f"dataset {dataset.name!r} does not say who performs clip {dataset.store.clips[nobody].name!r}; "
            "split by='take'"
        )
    groups: dict[str, set[str]] = {}
    for values in _grouped((_take(dataset, n), getattr(dataset.labels[n], by)) for n in dataset.indices).values():
        tied = set(values).union(*(groups.get(v, ()) for v in values))
        groups |= dict.fromkeys(tied, tied)
    if len(groups) > 1 and len(next(iter(groups.values()))) == len(groups):
        raise MotionKitError(
            f"dataset {dataset.name!r}: its takes tie all {len(groups)} {by}s together (a take holds several), so "
            f"none can be kept apart; split by='take'"
        )
    clips = _grouped((min(groups[getattr(dataset.labels[n], by)]), n) for n in dataset.indices)
    return [clips[first] for first in _mixed(seed, clips)]


def _counts(total: int, shares: tuple[float, ...], by: str) -> list[int]:
    """How many of `total` groups each part gets: its share to the nearest, and at least one if its share is not 0."""
    needed = sum(s > 0 for s in shares)
    if total < needed:
        raise MotionKitError(
            f"{needed} parts need at least {needed} {by}s that share no take; found {total}: split by something of "
            "which there is more, or set a share to 0"
        )
    counts = [max(int(s * total + 1e-9), int(s > 0)) for s in shares]
    while sum(counts) != total:
        step = 1 if sum(counts) < total else -1
        wants = [step * (s * total - c) if s > 0 and c + step >= 1 else -total for s, c in zip(shares, counts)]
        counts[wants.index(max(wants))] += step
    return counts


def _deal(counts: Sequence[int]) -> Iterable[int]:
    """Parts 0, 1, 2 in `counts`, each spread evenly: any run of groups gets nearly the same shares.

    >>> list(_deal((4, 1, 1)))
    [0, 1, 0, 2, 0, 0]
    """
    dealt = [0] * len(counts)
    for n in range(1, sum(counts) + 1):
        wants = [c * n / sum(counts) - d if d < c else -1.0 for c, d in zip(counts, dealt)]
        part = wants.index(max(wants))
        dealt[part] += 1
        yield part
