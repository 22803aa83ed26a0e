"""Windows: pieces of one length, read from the mapped file when they are looked at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np
import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion
from ..skeleton import Skeleton
from .dataset import Clip, Dataset
from .sources import Recording

_SHORT = ("skip", "pad")


@dataclass(frozen=True, eq=False)
class Window:
    """Frames `start` to `start + length` of a clip; the last of them may lie beyond its end (see `valid`)."""

    clip: Clip
    start: int
    length: int

    @property
    def content(self) -> str:
        """The clip's content."""
        return self.clip.content

    @property
    def style(self) -> str:
        """The clip's style."""
        return self.clip.style

    @property
    def text(self) -> str:
        """The clip's best sentence."""
        return self.clip.text

    @property
    def name(self) -> str:
        """The clip's name with the frames, as `walk_old_001[64:128]`."""
        return f"{self.clip.name}[{self.start}:{self.start + self.length}]"

    @property
    def frames(self) -> int:
        """How many frames are the clip's own; those after them repeat its last pose."""
        return min(self.length, len(self.clip) - self.start)

    @property
    def valid(self) -> Tensor:
        """Which frames are the clip's own, bool [F]."""
        return torch.arange(self.length) < self.frames

    @cached_property
    def recording(self) -> Recording:
        """Motion and tracks of these frames, padded; nothing else of the clip is read."""
        found = self.clip.dataset.store.recording(self.clip.number, self.start, self.start + self.frames)
        if self.frames < self.length:
            at = torch.arange(self.length).clamp(max=self.frames - 1)
            motion = found.motion
            held = motion.replace(rotations=motion.rotations[at], translations=motion.translations[at])
            found = Recording(held, {name: track[at] for name, track in found.tracks.items()})
        return Recording(found.motion.replace(name=self.name), found.tracks)

    @property
    def motion(self) -> Motion:
        """The frames as a motion, in metres, where they stood in the clip's world."""
        return self.recording.motion

    @property
    def contacts(self) -> Tensor:
        """Which foot joints stand, bool [F, K], judged over the whole clip."""
        stored = self.recording.tracks.get("contacts")
        if stored is not None:
            return stored.bool()
        at = torch.arange(self.start, self.start + self.length).clamp(max=len(self.clip) - 1)
        return self.clip.contacts[at]

    def __len__(self) -> int:
        return self.length

    def __repr__(self) -> str:
        padded = f", {self.frames} of them its own" if self.frames < self.length else ""
        return f"Window({self.name!r}, {self.length} frames{padded})"


@dataclass(frozen=True, eq=False)
class Windows(Sequence):
    """All windows of a dataset, clip after clip; `dataset.windows(64, stride=32)` makes it, `[i]` is a `Window`.

    length, stride: frames. Nothing is read before a window is looked at. It is a torch `Dataset` as well. Windows
    cannot be split: neighbours share frames, so split the dataset first.

    >>> from motionkit.datasets import BvhSource, Item, Labels, of_items
    >>> walks = {style: BvhSource.at(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old")}
    >>> ds = of_items("walks", [Item(s, Labels("walk", s, ()), walk) for s, walk in walks.items()])
    >>> windows = ds.windows(50, stride=25, short="pad")
    >>> len(windows), windows[3]
    (10, Window('neutral[75:125]', 50 frames, 45 of them its own))
    """

    dataset: Dataset
    length: int
    stride: int
    short: str = "skip"

    def __post_init__(self) -> None:
        for what, value in (("length", self.length), ("stride", self.stride)):
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise MotionKitError(f"windows: {what} is a number of frames from 1; found {value!r}")
        if self.short not in _SHORT:
            raise MotionKitError(f"windows: short is {' or '.join(map(repr, _SHORT))}; found {self.short!r}")
        if len(self.dataset) and not len(self):
            longest = self._frames.max()
            raise MotionKitError(
                f"dataset {self.dataset.name!r}: no clip has {self.length} frames; the longest has {longest}: choose "
                'a smaller length, or short="pad"'
            )

    @cached_property
    def _numbers(self) -> np.ndarray:
        return np.array(self.dataset.numbers, dtype=np.int64)

    @cached_property
    def _frames(self) -> np.ndarray:
        return self.dataset.store.frames[self._numbers]

    @cached_property
    def _counts(self) -> np.ndarray:
        """How many windows each clip has: those that fit, and with `pad` one more for what is left over."""
        beyond = self._frames - self.length
        if self.short == "skip":
            return np.where(beyond >= 0, beyond // self.stride + 1, 0)
        return np.minimum(-(-np.maximum(beyond, 0) // self.stride) + 1, -(-self._frames // self.stride))

    @cached_property
    def _ends(self) -> np.ndarray:
        return np.cumsum(self._counts)

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __repr__(self) -> str:
        return f"Windows({len(self)} of {self.length} frames, every {self.stride}, from {self.dataset!r})"

    @overload
    def __getitem__(self, number: int) -> Window: ...
    @overload
    def __getitem__(self, number: slice) -> list[Window]: ...
    def __getitem__(self, number):
        if isinstance(number, slice):
            return [self[n] for n in range(len(self))[number]]
        found = range(len(self))[number]
        clip = int(np.searchsorted(self._ends, found, "right"))
        start = (found - int(self._ends[clip] - self._counts[clip])) * self.stride
        return Window(self.dataset[clip], start, self.length)

    def __iter__(self) -> Iterator[Window]:
        return (self[n] for n in range(len(self)))

    @property
    def skeleton(self) -> Skeleton:
        """As `Dataset.skeleton`."""
        return self.dataset.skeleton

    def clip_numbers(self) -> Tensor:
        """For each window the stored number of its clip, long [N]."""
        return torch.from_numpy(np.repeat(self._numbers, self._counts))

    def split(self, *_, **__) -> None:
        """Always a MotionKitError: windows of one clip share frames, or nearly, so a test on some would leak."""
        raise MotionKitError(
            "windows are not split, since neighbours resemble each other and a test would leak; split the dataset "
            "first: train, validation, test = dataset.split(), then train.windows(...)"
        )
