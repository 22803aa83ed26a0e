"""A list of labelled clips, whose motions are read when asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import NamedTuple, overload

import numpy as np
import torch
from torch import Tensor

from ..contacts import foot_contacts
from ..errors import MotionKitError
from ..motion import Motion
from ..skeleton import Skeleton
from .cache import Store
from .sources import Labels, Recording
from .splits import split_clips


class _Labelled:
    """What a clip and a window of it have in common: the clip's labels, and a recording."""

    @property
    def content(self) -> str:
        """What is done: `walk`, `jump`, ..."""
        return self.labels.content

    @property
    def style(self) -> str:
        """How it is done: `old`, `proud`, ..."""
        return self.labels.style

    @property
    def texts(self) -> tuple[str, ...]:
        """Sentences that describe the clip, the best one first."""
        return self.labels.texts

    @property
    def text(self) -> str:
        """The best of the sentences; empty where there is none."""
        return self.texts[0] if self.texts else ""

    @property
    def performer(self) -> str:
        """Who moves; empty where that is not known."""
        return self.labels.performer

    @property
    def split(self) -> str:
        """The part that the dataset's makers put it in; empty where they did not."""
        return self.labels.split

    @property
    def motion(self) -> Motion:
        """The motion, in metres, where it stood in the clip's world; see `Motion`."""
        return self.recording.motion

    @property
    def phase(self) -> Tensor | None:
        """Where in the cycle of steps a frame is, [F, 1]; None where the dataset does not say."""
        return self.recording.tracks.get("phase")


@dataclass(frozen=True, eq=False)
class Clip(_Labelled):
    """One clip of a dataset: its labels, and its motion, which is read on first use. index: among the stored clips."""

    dataset: Dataset
    index: int
    start = 0  # a clip is its own window

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.dataset.store.clips[self.index].name

    @property
    def labels(self) -> Labels:
        """All labels together."""
        return self.dataset.labels[self.index]

    @property
    def take(self) -> str:
        """What was recorded in one go: clips of one take stay together when a dataset is split."""
        return self.labels.take or self.name

    @cached_property
    def recording(self) -> Recording:
        """Motion and tracks as stored; MotionKitError if the cache has been damaged since it was written."""
        return self.dataset.store.recording(self.index)

    @property
    def contacts(self) -> Tensor:
        """Which foot joints stand, bool [F, K]: the dataset's own where it has them, else `contacts.foot_contacts`."""
        stored = self.recording.tracks.get("contacts")
        return foot_contacts(self.motion) if stored is None else stored.bool()

    def __len__(self) -> int:
        return self.dataset.store.clips[self.index].frames

    def __repr__(self) -> str:
        return f"Clip({self.name!r}, {len(self)} frames, content {self.content!r}, style {self.style!r})"


class Split(NamedTuple):
    """The three parts; `train, validation, test = ds.split()`."""

    train: Dataset
    validation: Dataset
    test: Dataset


@dataclass(frozen=True, eq=False)
class Dataset(Sequence):
    """Clips in the order of their names; `ds[0]` is a `Clip`, `ds[:10]` and `ds.filter(style="old")` datasets.

    labels: of all stored clips. indices: which of the stored clips are in this dataset; all where left out.

    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walks = {style: BvhSource.at(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old")}
    >>> ds = from_items("walks", [Item(s, Labels("walk", s, ()), walk) for s, walk in walks.items()])
    >>> ds, ds[0]
    (Dataset('walks', 2 clips, 1 contents, 2 styles), Clip('neutral', 120 frames, content 'walk', style 'neutral'))
    >>> ds.filter(style="old")[0].motion
    Motion('old', 161 frames at 30 fps, 5.4 s, 22 joints)
    """

    name: str
    store: Store
    labels: tuple[Labels, ...]
    indices: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if self.indices is None:
            object.__setattr__(self, "indices", tuple(range(len(self.labels))))

    @cached_property
    def contents(self) -> tuple[str, ...]:
        """The contents that occur, sorted."""
        return self._values("content")

    @cached_property
    def styles(self) -> tuple[str, ...]:
        """The styles that occur, sorted."""
        return self._values("style")

    @cached_property
    def performers(self) -> tuple[str, ...]:
        """The performers that occur, sorted; an empty one where somebody is not known."""
        return self._values("performer")

    def _values(self, label: str) -> tuple[str, ...]:
        return tuple(sorted({getattr(self.labels[n], label) for n in self.indices}))

    @cached_property
    def vocabulary(self) -> dict[str, tuple[str, ...]]:
        """All contents and styles of the whole dataset: a label's id is its place here, in every part of a split."""
        return {label: tuple(sorted({getattr(x, label) for x in self.labels})) for label in ("content", "style")}

    def ids(self, label: str) -> Tensor:
        """For each stored clip the place of its `content` or `style` in `vocabulary`, long [N]."""
        return self._ids[label]

    @cached_property
    def _ids(self) -> dict[str, Tensor]:
        return {
            label: torch.from_numpy(np.searchsorted(words, [getattr(x, label) for x in self.labels]))
            for label, words in self.vocabulary.items()
        }

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton of the first clip, once it is sure that all clips have its joints and frame rate.

        Raises MotionKitError naming two clips that differ. Bone lengths may differ: they are in the translations.
        """
        check_alike(self.store, self.indices, f"dataset {self.name!r}")
        return self.store.skeleton(self.indices[0])

    def __len__(self) -> int:
        return len(self.indices)

    def __repr__(self) -> str:
        labels = f"{len(self.contents)} contents, {len(self.styles)} styles"
        return f"{type(self).__name__}({self.name!r}, {len(self)} clips, {labels})"

    @overload
    def __getitem__(self, number: int) -> Clip: ...
    @overload
    def __getitem__(self, number: slice) -> Dataset: ...
    def __getitem__(self, number):
        return self.subset(self.indices[number]) if isinstance(number, slice) else Clip(self, self.indices[number])

    def subset(self, indices: Collection[int]) -> Dataset:
        """The clips of these stored indices; see `indices`."""
        return Dataset(self.name, self.store, self.labels, tuple(indices))

    def filter(
        self,
        content: str | Collection[str] | None = None,
        style: str | Collection[str] | None = None,
        performer: str | Collection[str] | None = None,
        split: str | Collection[str] | None = None,
    ) -> Dataset:
        """The clips of one or several contents, styles, performers and makers' parts.

        Raises MotionKitError for a label that does not occur.
        """
        indices = self.indices
        for label, wanted in (("content", content), ("style", style), ("performer", performer), ("split", split)):
            if wanted is None:
                continue
            there, wanted = self._values(label), {wanted} if isinstance(wanted, str) else set(wanted)
            if not wanted <= set(there):
                unknown = min(wanted - set(there))
                raise MotionKitError(f"no clip has the {label} {unknown!r}; there are {', '.join(there)}")
            indices = tuple(n for n in indices if getattr(self.labels[n], label) in wanted)
        return self.subset(indices)

    def split(self, by: str | None = None, shares: tuple[float, float, float] | None = None, seed: int = 0) -> Split:
        """Three datasets, `train`, `validation` and `test`, no take in two of them.

        by: `take` deals out takes so that every part has its share of each content x style; `performer`, `content` or
        `style` deal those out, so that test and validation hold some that training never saw; `given` is the split of
        the dataset's makers, and the default where every clip has one (else, or with shares, `take`). shares: of the
        takes, performers, ...; they add up to 1 (0.8, 0.1 and 0.1 if left out). seed: another one gives another split,
        the same on every machine. Raises MotionKitError where it cannot be done, and says why.
        """
        parts = split_clips(list(self), self.name, by, shares, seed)
        return Split(*(self.subset([n for n, part in zip(self.indices, parts) if part == which]) for which in range(3)))

    def windows(self, length: int, stride: int | None = None, short: str = "skip") -> Windows:
        """Pieces of `length` frames, one every `stride` frames (left out: end to end); see `Windows`.

        short: what becomes of frames that fill no window. `skip` leaves them out; `pad` gives a last window that goes
        on in the last pose, with a mask that says so.
        """
        return Windows(self, length, length if stride is None else stride, short)

    def table(self) -> Table:
        """How many clips there are of each content and style; prints well, in a notebook too."""
        down, across = ("content", self.contents), ("style", self.styles)
        if len(across[1]) > max(len(down[1]), 12):  # the longer kind of label goes down the page
            down, across = across, down
        counts = Counter((getattr(self.labels[n], down[0]), getattr(self.labels[n], across[0])) for n in self.indices)
        rows = [(d, *(counts[d, a] for a in across[1])) for d in down[1]]
        rows = [(*row, sum(row[1:])) for row in rows]
        sums = tuple(sum(column) for column in list(zip(*rows))[1:]) if rows else (0,)
        return Table((f"{down[0]} \\ {across[0]}", *across[1], "all"), (*rows, ("all", *sums)))

    def captions(self) -> Table:
        """All sentences, a line each, with clip, content and style."""
        rows = ((clip.name, clip.content, clip.style, text) for clip in self for text in clip.texts)
        return Table(("clip", "content", "style", "text"), tuple(rows))

    def check(self) -> None:
        """Read every clip once; MotionKitError names the first whose numbers are not those that were written."""
        for index in self.indices:
            self.store.check(index)


def check_alike(store: Store, indices: Collection[int], where: str) -> None:
    """Raises MotionKitError unless these clips share joints, tracks and frame rate, as one batch needs."""
    indices = np.asarray(indices, dtype=np.int64)
    if not len(indices):
        raise MotionKitError(f"{where} has no clips, so no skeleton; check the filter, or the folder it was read from")
    kinds = store.kinds[indices]
    others = np.flatnonzero(kinds != kinds[0])
    if not len(others):
        return
    two = []
    for index in (indices[0], indices[others[0]]):
        clip, tracks = store.clips[index], ", ".join(store.tracks(index)) or "no tracks"
        two.append(f"{clip.name!r} has {store.skeleton(index)!r}, {clip.fps:g} fps, {tracks}")
    raise MotionKitError(
        f"{where}: one skeleton and frame rate are needed here, but {', and '.join(two)}; take clips of one "
        "kind, or bring them to one with mk.retarget and Motion.resample first"
    )


_SHOWN = 40  # lines; the others are in `rows`


@dataclass(frozen=True)
class Table:
    """Rows under a header; `rows` has all of them, printing shows the first 40.

    >>> print(Table(("content", "old", "proud"), (("walk", 3, 12), ("jump", 0, 4))))
    content  old  proud
    walk       3     12
    jump       0      4
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str | int, ...], ...]

    @property
    def _more(self) -> str:
        hidden = len(self.rows) - _SHOWN
        return f"... and {hidden} more lines in .rows" if hidden > 0 else ""

    def __str__(self) -> str:
        shown = (self.header, *self.rows[:_SHOWN])
        widths = [max(len(str(row[n])) for row in shown) for n in range(len(self.header))]
        right = [bool(self.rows) and all(isinstance(row[n], int) for row in self.rows) for n in range(len(widths))]
        lines = (
            "  ".join(f"{str(x):>{w}}" if r else f"{str(x):<{w}}" for x, w, r in zip(row, widths, right)).rstrip()
            for row in shown
        )
        return "\n".join([*lines, *filter(None, [self._more])])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(str(x))}</th>" for x in self.header)
        body = "".join(
            "<tr>" + "".join(f'<td style="text-align:{_side(x)}">{escape(str(x))}</td>' for x in row) + "</tr>"
            for row in self.rows[:_SHOWN]
        )
        more = f"<p>{escape(self._more)}</p>" if self._more else ""
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def _side(value: str | int) -> str:
    return "right" if isinstance(value, int) else "left"


@dataclass(frozen=True, eq=False)
class Window(_Labelled):
    """Frames `start` to `start + length` of a clip; the last of them may lie beyond its end (see `valid`)."""

    clip: Clip
    start: int
    length: int

    @property
    def labels(self) -> Labels:
        """All labels of the clip."""
        return self.clip.labels

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
        stored = self.clip.dataset.store.recording(self.clip.index, self.start, self.start + self.frames)
        motion, tracks = stored.motion.replace(name=self.name), stored.tracks
        if self.frames < self.length:
            at = torch.arange(self.length).clamp(max=self.frames - 1)
            motion = motion.replace(rotations=motion.rotations[at], translations=motion.translations[at])
            tracks = {name: track[at] for name, track in tracks.items()}
        return Recording(motion, tracks)

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

    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walks = {style: BvhSource.at(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old")}
    >>> ds = from_items("walks", [Item(s, Labels("walk", s, ()), walk) for s, walk in walks.items()])
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
        if self.short not in ("skip", "pad"):
            raise MotionKitError(f"windows: short is 'skip' or 'pad'; found {self.short!r}")
        if len(self.dataset) and not len(self):
            raise MotionKitError(
                f"dataset {self.dataset.name!r}: no clip has {self.length} frames; the longest has "
                f'{self._frames.max()}: choose a smaller length, or short="pad"'
            )

    @cached_property
    def _indices(self) -> np.ndarray:
        return np.array(self.dataset.indices, dtype=np.int64)

    @cached_property
    def _frames(self) -> np.ndarray:
        return self.dataset.store.frames[self._indices]

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
        number = range(len(self))[number]
        clip = int(np.searchsorted(self._ends, number, "right"))
        start = (number - int(self._ends[clip] - self._counts[clip])) * self.stride
        return Window(self.dataset[clip], start, self.length)

    @property
    def skeleton(self) -> Skeleton:
        """As `Dataset.skeleton`."""
        return self.dataset.skeleton

    def clip_indices(self) -> Tensor:
        """For each window the stored index of its clip, long [N]."""
        return torch.from_numpy(np.repeat(self._indices, self._counts))

    def split(self, *_, **__) -> None:
        """Always a MotionKitError: windows of one clip share frames, or nearly, so a test on some would leak."""
        raise MotionKitError(
            "windows are not split, since neighbours resemble each other and a test would leak; split the dataset "
            "first: train, validation, test = dataset.split(), then train.windows(...)"
        )
