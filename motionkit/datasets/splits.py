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
_PARTS = {"train": 0, "training": 0, "validation": 1, "val": 1, "test": 2}
_T = TypeVar("_T")


class Labelled(Protocol):
    """What splitting needs of a `Clip`."""

    name: str
    take: str
    content: str
    style: str
    performer: str
    split: str


def split_clips(
    clips: Sequence[Labelled], name: str, by: str | None, shares: Sequence[float] | None, seed: int
) -> list[int]:
    """For each clip its part: 0 to train, 1 to validate, 2 to test; see `Dataset.split`. name: the dataset's."""
    if by is None:
        by = "given" if shares is None and clips and all(clip.split for clip in clips) else "take"
    if by not in _KINDS:
        raise MotionKitError(f"a dataset is split by {', '.join(map(repr, _KINDS))}; found by={by!r}")
    if by == "given":
        if shares is not None:
            raise MotionKitError(
                "the split of the dataset's makers has shares of its own; leave shares out, or by='take'"
            )
        _check_given(clips, name)
        return [_PARTS[clip.split] for clip in clips]
    shares = _check_shares((0.8, 0.1, 0.1) if shares is None else shares)
    groups = _take_groups(clips, seed) if by == "take" else _label_groups(clips, name, by, seed)
    parts = {clip: part for group, part in zip(groups, _deal(_counts(len(groups), shares, by))) for clip in group}
    return [parts[clip] for clip in clips]


def _check_shares(shares: Sequence[float]) -> tuple[float, ...]:
    """The shares as numbers; MotionKitError unless three that add up to 1."""
    try:
        numbers = tuple(map(float, shares))
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != 3 or not all(0 <= s <= 1 for s in numbers) or abs(sum(numbers) - 1) > 1e-6:
        raise MotionKitError(
            f"shares must be three numbers from 0 that add up to 1, for train, validation and test, as (0.8, 0.1, "
            f"0.1); found {shares!r}"
        )
    return numbers


def _check_given(clips: Sequence[Labelled], name: str) -> None:
    """A MotionKitError where a clip is in no part of its makers', or a take is in two."""
    takes: dict[str, Labelled] = {}
    for clip in clips:
        if clip.split not in _PARTS:
            fault = f"is in part {clip.split!r}; expected train, validation or test" if clip.split else "is in no part"
            raise MotionKitError(
                f"dataset {name!r} has no whole split by its makers: clip {clip.name!r} {fault}; split by='take'"
            )
        first = takes.setdefault(clip.take, clip)
        if _PARTS[first.split] != _PARTS[clip.split]:
            raise MotionKitError(
                f"dataset {name!r}: its makers put clips of take {clip.take!r} into two parts "
                f"({first.name!r} and {clip.name!r}), so the test would leak; split by='take'"
            )


def _mixed(seed: int, values: Iterable[_T]) -> list[_T]:
    """An order that depends on the seed alone, not on Python's version or the other values."""
    return sorted(values, key=lambda v: hashlib.sha256(f"{seed} {v}".encode()).digest())


def _grouped(pairs: Iterable[tuple[Hashable, _T]]) -> dict[Hashable, list[_T]]:
    """Values by their keys."""
    groups: dict[Hashable, list[_T]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return groups


def _take_groups(clips: Sequence[Labelled], seed: int) -> list[list[Labelled]]:
    """Clips of each take; takes of the same content and style stand together, so that dealing stratifies."""
    takes = _grouped((clip.take, clip) for clip in clips)
    kinds = _grouped((tuple(sorted({(c.content, c.style) for c in group})), take) for take, group in takes.items())
    return [takes[take] for kind in _mixed(seed, kinds) for take in _mixed(seed, kinds[kind])]


def _label_groups(clips: Sequence[Labelled], name: str, by: str, seed: int) -> list[list[Labelled]]:
    """Clips of each performer, content or style; those that a take ties together are one group."""
    for clip in clips:
        if by == "performer" and not clip.performer:
            raise MotionKitError(f"dataset {name!r} does not say who performs clip {clip.name!r}; split by='take'")
    ties: dict[str, set[str]] = {}
    for labels in _grouped((clip.take, getattr(clip, by)) for clip in clips).values():
        tied = set(labels).union(*(ties.get(label, ()) for label in labels))
        ties |= dict.fromkeys(tied, tied)
    if len(ties) > 1 and len(next(iter(ties.values()))) == len(ties):
        raise MotionKitError(
            f"dataset {name!r}: its takes tie all {len(ties)} {by}s together (a take holds several), so none can be "
            "kept apart; split by='take'"
        )
    groups = _grouped((min(ties[getattr(clip, by)]), clip) for clip in clips)
    return [groups[first] for first in _mixed(seed, groups)]


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
    """Parts 0, 1, 2 in `counts`, each spread evenly: any run of groups gets nearly the same shares."""
    dealt = [0] * len(counts)
    for n in range(1, sum(counts) + 1):
        wants = [c * n / sum(counts) - d if d < c else -1.0 for c, d in zip(counts, dealt)]
        part = wants.index(max(wants))
        dealt[part] += 1
        yield part
