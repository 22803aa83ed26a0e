"""Exact answers, where the performer made the clips: the content clip's own performance told in the style asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch

from ..actor import Performance, retell
from ..datasets import Clip, Dataset, Item, made
from ..errors import MotionKitError
from ..metrics.truth import from_own_place
from ..motion import Motion
from . import kept


@dataclass(frozen=True)
class Truths:
    """What the performer would have done. sources: clip name to what makes it. folder: where answers are kept."""

    sources: dict[str, made.ActorSource]
    folder: Path

    @classmethod
    def of(cls, dataset: Dataset, folder: Path) -> Truths | None:
        """The answers for a data set of the performer's, whole or in part; None for any other."""
        if dataset.name not in made.TAKES:
            return None
        known, found = _items(dataset.name), {}
        for clip in dataset:
            item = known.get(clip.name)
            if item is None or (item.labels.content, item.labels.style) != (clip.content, clip.style):
                return None
            found[clip.name] = item.source
        folder = folder / f"truths-{made.version()}"
        folder.mkdir(parents=True, exist_ok=True)
        return cls(found, folder)

    def answer(self, content: Clip, style: str) -> Motion | None:
        """The exact answer, frame by frame in the content's time; None where the performer knows no such style."""
        path = self.folder / f"{content.name}--{style}.safetensors"
        try:
            return kept.load_result(path, content.motion)[0]
        except MotionKitError:
            pass  # not told yet
        performance = _performance(self.sources[content.name])
        try:
            told = retell(performance, style).along(performance)
        except MotionKitError:
            return None
        if len(told) != len(content):
            return None
        kept.save_result(path, told, content.motion, {})
        return kept.load_result(path, content.motion)[0]


@lru_cache(maxsize=4)
def _items(name: str) -> dict[str, Item]:
    return {item.name: item for item in made.items(name)}


@lru_cache(maxsize=128)
def _performance(source: made.ActorSource) -> Performance:
    return source.perform()


def error_against(result: Motion, answer: Motion) -> float:
    """`metrics.truth_error`, the mean over joints, against an answer that is told already: mm.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> error_against(walk.moved(1.0, (2.0, 0.0, 0.0)), walk) < 0.01
    True
    """
    places = (from_own_place(answer, motion.positions()) for motion in (result, answer))
    return 1000 * float(torch.linalg.vector_norm(torch.sub(*places), dim=-1).mean())
