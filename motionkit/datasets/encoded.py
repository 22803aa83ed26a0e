"""Features of clips, worked out once each and then read like the clips themselves."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion
from .dataset import Dataset


class Encoder(Protocol):
    """What turns motions into numbers: a feature layout, or a judge's way of seeing."""

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to [F, ...]."""


class Encoded:
    """A dataset's clips in a feature layout. A clip is encoded as a whole when it is first asked for.

    What was encoded is kept in a temporary memory-mapped file (as many numbers as the clips have frames times D), so
    that later epochs only read, and memory stays small. Another process makes its own.

    >>> import motionkit as mk
    >>> source = mk.datasets.BvhSource.at("data/actor/walk_neutral.bvh")
    >>> item = mk.datasets.Item("walk_1", mk.datasets.Labels("walk", "neutral", ()), source)
    >>> Encoded(mk.datasets.of_items("mine", [item]), mk.features.SixD()).rows(0, 20, 30).shape
    (10, 135)
    """

    def __init__(self, dataset: Dataset, layout: Encoder) -> None:
        self.dataset, self.layout = dataset, layout
        self.shape: tuple[int, ...] = ()  # of a frame's features, once one clip is encoded
        ends = np.cumsum([0, *dataset.store.frames[list(dataset.numbers)].tolist()])
        self._starts = dict(zip(dataset.numbers, ends.tolist()))
        self._frames, self._done, self._kept = int(ends[-1]), set(), None

    def __getstate__(self) -> dict:
        return {"dataset": self.dataset, "layout": self.layout}

    def __setstate__(self, state: dict) -> None:
        self.__init__(**state)

    def rows(self, number: int, start: int, stop: int) -> np.ndarray:
        """Frames `start` to `stop` of a stored clip's features [F, D]; MotionKitError where the layout does not fit."""
        first = self._starts[number]
        if number not in self._done:
            x = self.layout.encode(self.dataset.store.recording(number).motion).detach().float()
            self.shape = tuple(x.shape[1:])
            rows = x.flatten(1).numpy()
            if self._kept is None:
                shape = (self._frames, rows.shape[1])
                with tempfile.TemporaryFile() as file:  # lives on, nameless, as long as it is mapped
                    self._kept = np.memmap(file, np.float32, "w+", shape=shape)
            self._kept[first : first + len(rows)] = rows
            self._done.add(number)
        return np.asarray(self._kept[first + start : first + stop])

    @property
    def lengths(self) -> Tensor:
        """Frames of each clip, long [C]."""
        return torch.from_numpy(self.dataset.store.frames[list(self.dataset.numbers)].astype(np.int64))

    def draw(self, clips: Sequence[int] | Tensor, length: int) -> Tensor:
        """A window [len(clips), length, ...] from a random place of each of these clips, by torch's random numbers.

        clips: places in the dataset. Raises MotionKitError for a clip that has fewer frames.
        """
        clips = torch.as_tensor(clips)
        room = self.lengths[clips] - length + 1
        if (room < 1).any():
            short = self.dataset[int(clips[int((room < 1).nonzero()[0])])]
            raise MotionKitError(f"a window of {length} frames does not fit into {short}; leave short clips out")
        starts = (torch.rand(len(clips)) * room).long().tolist()
        numbers = [self.dataset.numbers[n] for n in clips.tolist()]
        return gather(self, numbers, starts, [length] * len(numbers), length)

    def draw_masked(self, clips: Sequence[int] | Tensor, length: int) -> tuple[Tensor, Tensor]:
        """As `draw`, but short clips come whole, go on in their last row, and a mask, bool [B, length], says so."""
        clips = torch.as_tensor(clips)
        own = self.lengths[clips].clamp(max=length)
        starts = (torch.rand(len(clips)) * (self.lengths[clips] - own + 1)).long().tolist()
        numbers = [self.dataset.numbers[n] for n in clips.tolist()]
        return gather(self, numbers, starts, own.tolist(), length), torch.arange(length) < own[:, None]


def gather(source: Encoded, numbers: list[int], starts: list[int], own: list[int], frames: int) -> Tensor:
    """Features [B, F, D] of samples: own frames, then the last one again ([B, F, J, 7] where the layout is a graph).

    numbers: stored clips; starts, own: where a sample starts and how many frames it has; frames: F.
    """
    found = [source.rows(n, start, start + count) if count else None for n, start, count in zip(numbers, starts, own)]
    width = next((rows.shape[1] for rows in found if rows is not None), 0)
    x = np.zeros((len(numbers), frames, width), np.float32)
    for into, rows in zip(x, found):
        if rows is not None:
            into[: len(rows)] = rows
            into[len(rows) :] = rows[-1]
    return torch.from_numpy(x).unflatten(-1, source.shape) if len(source.shape) > 1 else torch.from_numpy(x)
