"""Features of clips, worked out once each and then read like the clips themselves."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, RandomSampler, Sampler

from ..errors import MotionKitError
from ..features import Layout
from ..features.facing_free import OfBody
from ..features.layout import Normalizer
from ..motion import Motion
from .cache import split_rows
from .dataset import Clip, Dataset, Window, Windows, check_alike


class Encoder(Protocol):
    """What turns motions into numbers: a feature layout, or a judge's way of seeing."""

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to [F, ...]."""


class FeatureCache:
    """A dataset's clips in a feature layout. A clip is encoded as a whole when it is first asked for.

    What was encoded is kept in a temporary memory-mapped file (as many numbers as the clips have frames times D), so
    that later epochs only read, and memory stays small. Another process makes its own.

    >>> import motionkit as mk
    >>> source = mk.datasets.BvhSource.at("data/actor/walk_neutral.bvh")
    >>> item = mk.datasets.Item("walk_1", mk.datasets.Labels("walk", "neutral", ()), source)
    >>> FeatureCache(mk.datasets.from_items("mine", [item]), mk.features.SixD()).rows(0, 20, 30).shape
    (10, 135)
    """

    def __init__(self, dataset: Dataset, layout: Encoder) -> None:
        self.dataset, self.layout = dataset, layout
        self.shape: tuple[int, ...] = ()  # of a frame's features, once one clip is encoded
        ends = np.cumsum([0, *self.lengths.tolist()])
        self._starts = dict(zip(dataset.indices, ends.tolist()))
        self._frames, self._encoded, self._file = int(ends[-1]), set(), None

    def __getstate__(self) -> dict:
        return {"dataset": self.dataset, "layout": self.layout}

    def __setstate__(self, state: dict) -> None:
        self.__init__(**state)

    def rows(self, index: int, start: int, stop: int) -> np.ndarray:
        """Frames `start` to `stop` of a stored clip's features [F, D]; MotionKitError where the layout does not fit."""
        first = self._starts[index]
        if index not in self._encoded:
            x = self.layout.encode(self.dataset.store.recording(index).motion).detach().float()
            self.shape = tuple(x.shape[1:])
            rows = x.flatten(1).numpy()
            if self._file is None:
                shape = (self._frames, rows.shape[1])
                with tempfile.TemporaryFile() as file:  # lives on, nameless, as long as it is mapped
                    self._file = np.memmap(file, np.float32, "w+", shape=shape)
            self._file[first : first + len(rows)] = rows
            self._encoded.add(index)
        return np.asarray(self._file[first + start : first + stop])

    @property
    def lengths(self) -> Tensor:
        """Frames of each clip, long [C]."""
        return torch.from_numpy(self.dataset.store.frames[list(self.dataset.indices)].astype(np.int64))

    def sample(self, clips: Sequence[int] | Tensor, length: int) -> Tensor:
        """A window [len(clips), length, ...] from a random place of each of these clips, by torch's random numbers.

        clips: places in the dataset. Raises MotionKitError for a clip that has fewer frames.
        """
        clips = torch.as_tensor(clips)
        short = clips[self.lengths[clips] < length]
        if len(short):
            clip = self.dataset[int(short[0])]
            raise MotionKitError(f"a window of {length} frames does not fit into {clip}; leave short clips out")
        return self.sample_padded(clips, length)[0]

    def sample_padded(self, clips: Sequence[int] | Tensor, length: int) -> tuple[Tensor, Tensor]:
        """As `sample`, but short clips come whole, go on in their last row, and a mask, bool [B, length], says so."""
        clips = torch.as_tensor(clips)
        counts = self.lengths[clips].clamp(max=length)
        starts = (torch.rand(len(clips)) * (self.lengths[clips] - counts + 1)).long().tolist()
        indices = [self.dataset.indices[n] for n in clips.tolist()]
        return self.gather(indices, starts, counts.tolist(), length), torch.arange(length) < counts[:, None]

    def gather(self, indices: list[int], starts: list[int], counts: list[int], frames: int) -> Tensor:
        """Features [B, F, D] of samples, each going on in its last row ([B, F, J, 7] where the layout is a graph).

        indices: stored clips; starts, counts: where a sample starts and how many frames it has; frames: F.
        """
        places = zip(indices, starts, counts)
        pieces = [self.rows(n, start, start + count) if count else np.empty((0, 0)) for n, start, count in places]
        x = torch.from_numpy(_pad(pieces, frames))
        return x.unflatten(-1, self.shape) if len(self.shape) > 1 else x


def _pad(pieces: list[np.ndarray], frames: int) -> np.ndarray:
    """Rows [B, F, D] of pieces [up to F, D], each of which goes on in its last row; one without rows is zero."""
    rows = np.zeros((len(pieces), frames, max(piece.shape[1] for piece in pieces)), np.float32)
    for row, piece in zip(rows, pieces):
        if len(piece):
            row[: len(piece)], row[len(piece) :] = piece, piece[-1]
    return rows


class Batch(dict):
    """Named tensors; `batch["rotations"]` and `batch.rotations` are the same.

    rotations: [B, F, J, 4] unit quaternions w x y z, local. translations: [B, F, J, 3] metres. mask: bool [B, F], true
    for frames that are the clip's own (those after them repeat its last pose). contacts: bool [B, F, K]; phase and
    other tracks [B, F, K] where the dataset has them. content, style: long [B], places in `dataset.vocabulary`. names,
    texts: for each sample its name, and all sentences. features: [B, F, D], where asked for.

    >>> batch = Batch(mask=torch.ones(2, 8).bool(), names=["a", "b"]).to("cpu")
    >>> batch, batch["names"]
    (Batch(mask [2, 8], 2 names), ['a', 'b'])
    """

    def __getattr__(self, name: str):
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"this batch has no {name!r}; it has {', '.join(self)}") from None

    def __repr__(self) -> str:
        parts = (f"{k} {list(v.shape)}" if isinstance(v, Tensor) else f"{len(v)} {k}" for k, v in self.items())
        return f"Batch({', '.join(parts)})"

    def to(self, *place, **more) -> Batch:
        """The batch with its tensors on another device, as `Tensor.to`; names and texts stay."""
        return Batch({k: v.to(*place, **more) if isinstance(v, Tensor) else v for k, v in self.items()})


def collate(samples: Sequence[Window | Clip], features: Layout | FeatureCache | None = None) -> Batch:
    """Windows or clips of one dataset together, read from the mapped file; short ones are padded and masked.

    features: a layout, or clips `FeatureCache` in one, which are quicker from the second epoch on. Clips are encoded as
    a whole, then cut, and padded with the last row. Give this function to torch as `DataLoader(windows, 64,
    collate_fn=mk.datasets.collate)`. Raises MotionKitError naming two samples of different joints, tracks or frame
    rates.

    >>> collate([])
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: no samples to put together; give some windows or clips of a dataset
    """
    if not samples:
        raise MotionKitError("no samples to put together; give some windows or clips of a dataset")
    clips = [getattr(sample, "clip", sample) for sample in samples]
    dataset, indices = clips[0].dataset, [clip.index for clip in clips]
    store = dataset.store
    if any(clip.dataset.store is not store for clip in clips):
        raise MotionKitError("the samples of a batch must come from one dataset; batch each dataset by itself")
    check_alike(store, indices, "batch")
    starts, frames = [sample.start for sample in samples], max(map(len, samples))
    counts = [getattr(sample, "frames", len(sample)) for sample in samples]
    rows = _pad([store.rows(n, start, start + count) for n, start, count in zip(indices, starts, counts)], frames)
    rotations, translations = split_rows(rows, len(store.skeleton(indices[0])))
    batch = Batch(rotations=rotations, translations=translations)
    batch["mask"] = torch.arange(frames) < torch.tensor(counts)[:, None]
    for track, columns in store.tracks(indices[0]).items():
        values = rows[..., columns]
        batch[track] = torch.from_numpy(values > 0.5 if track == "contacts" else values.copy())
    for label in ("content", "style"):
        batch[label] = dataset.ids(label)[indices]
    batch["names"] = [sample.name for sample in samples]
    batch["texts"] = [clip.texts for clip in clips]
    if features is not None:
        cache = features if isinstance(features, FeatureCache) else FeatureCache(dataset, features)
        batch["features"] = cache.gather(indices, starts, counts, frames)
    return batch


class BalancedSampler(Sampler[int]):
    """Indices of windows or clips such that every style (or content, or pair) comes equally often.

    by: `style`, `content` or `("content", "style")`. It draws rounds: in each, one sample of every label in random
    order, so that a batch is balanced too; a label's samples all come before one comes again. As many samples as
    `source` has. seed: says all orders; each pass has another one.

    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walks = {style: BvhSource.at(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old")}
    >>> ds = from_items("walks", [Item(s, Labels("walk", s, ()), walk) for s, walk in walks.items()])
    >>> sorted(ds[n].style for n in BalancedSampler(ds))
    ['neutral', 'old']
    """

    def __init__(self, source: Windows | Dataset, by: str | tuple[str, ...] = "style", seed: int = 0) -> None:
        labels = (by,) if isinstance(by, str) else tuple(by)
        if not labels or not set(labels) <= {"content", "style"}:
            raise MotionKitError(f"balanced must be 'style', 'content' or ('content', 'style'); found {by!r}")
        dataset, clips = _clips_of(source)
        values = torch.stack([dataset.ids(label)[clips] for label in labels])
        group = torch.unique(values, dim=1, return_inverse=True)[1]
        sizes = torch.bincount(group).tolist()
        self.groups = torch.argsort(group, stable=True).split(sizes)
        self._count, self._generator = len(clips), torch.Generator().manual_seed(seed)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        rounds = -(-self._count // len(self.groups))
        samples = torch.stack([self._sample(group, rounds) for group in self.groups], 1)  # [rounds, groups]
        orders = torch.rand(samples.shape, generator=self._generator).argsort(1)
        return iter(samples.gather(1, orders).flatten()[: self._count].tolist())

    def _sample(self, group: Tensor, count: int) -> Tensor:
        """All of a group in random order, again and again, until there are `count`."""
        times = -(-count // len(group))
        return torch.cat([group[torch.randperm(len(group), generator=self._generator)] for _ in range(times)])[:count]


def _clips_of(source: Windows | Dataset) -> tuple[Dataset, Tensor]:
    """The dataset, and the index of the stored clip of each sample, long [N]."""
    if isinstance(source, Windows):
        return source.dataset, source.clip_indices()
    if isinstance(source, Dataset):
        return source, torch.tensor(source.indices, dtype=torch.long)
    raise MotionKitError(f"batches are made of a dataset or of its windows(...); found {type(source).__name__}")


def batches(
    source: Windows | Dataset,
    size: int,
    seed: int = 0,
    balanced: str | tuple[str, ...] | None = None,
    features: Layout | None = None,
    workers: int = 0,
) -> DataLoader:
    """A torch `DataLoader` of `Batch`es in random order; going through it once is one epoch, each in another order.

    source: windows, or whole clips (padded to the longest of their batch). size: B; the last batch has what is left.
    balanced: see `BalancedSampler`; left out, each sample comes once an epoch. features: a layout; adds `features`
    [B, F, D] of clips encoded as a whole, once each, so the first epoch is the slow one. workers: processes that read
    ahead; 0 reads in this one, which is enough. Raises MotionKitError where samples cannot share a batch, before the
    first is read.

    >>> import motionkit as mk
    >>> source = mk.datasets.BvhSource.at("data/actor/walk_neutral.bvh")
    >>> item = mk.datasets.Item("walk_1", mk.datasets.Labels("walk", "neutral", ()), source)
    >>> windows = mk.datasets.from_items("mine", [item]).windows(64, stride=8)
    >>> [tuple(batch.rotations.shape) for batch in batches(windows, 6)]
    [(6, 64, 22, 4), (2, 64, 22, 4)]
    """
    dataset, clips = _clips_of(source)
    if not isinstance(size, int) or size < 1:
        raise MotionKitError(f"batches: size is a number of samples from 1; found {size!r}")
    check_alike(dataset.store, torch.unique(clips).numpy(), f"dataset {dataset.name!r}")
    generator = torch.Generator().manual_seed(seed)
    sampler = BalancedSampler(source, balanced, seed) if balanced else RandomSampler(source, generator=generator)
    together = partial(collate, features=None if features is None else FeatureCache(dataset, features))
    return DataLoader(source, size, sampler=sampler, collate_fn=together, generator=generator, num_workers=workers)


_LEAST_SPREAD = 0.25  # of a part's spread: numbers that hardly move are not blown up to the size of others
_ROOT_WEIGHT = 3.0  # how much larger the root's four numbers are made: all else follows from where the body goes


def fit_normalizer(data: Dataset) -> tuple[FeatureCache, Normalizer]:
    """A dataset's clips in facing-free features of the body, and the normalizer for them.

    Spreads are those of the numbers, but at least a quarter of the root mean square of their part (root velocity,
    height, positions, rotations); the root's four numbers weigh three times as much, since the loss counts numbers.
    """
    layout = OfBody()
    cache = FeatureCache(data, layout)
    rows = [torch.from_numpy(cache.rows(n, 0, int(data.store.frames[n]))) for n in data.indices]
    plain = Normalizer.fit(rows, "FacingFree")
    std = torch.cat(rows).std(0, correction=0)
    parts = {**layout.slices, "turn": slice(0, 1), "speed": slice(1, 3), "height": slice(3, 4)}
    for name, part in parts.items():
        if name != "root":
            std[part] = torch.maximum(std[part], _LEAST_SPREAD * std[part].square().mean().sqrt())
    std[layout.slices["root"]] /= _ROOT_WEIGHT
    return cache, Normalizer(plain.mean, std.clamp(min=1e-5), plain.layout, plain.data_hash)


class WindowSampler:
    """Random windows of a dataset's clips, as trainings see them: `sample` gives a batch by torch's random numbers.

    features: of the dataset. normalizer: of these features. size: windows a batch. frames: the shortest and the longest
    window, multiples of 4; all of one batch have one length, which is drawn.
    """

    def __init__(
        self, features: FeatureCache, normalizer: Normalizer, size: int, frames: tuple[int, int] = (40, 160)
    ) -> None:
        self.features, self.normalizer, self.size = features, normalizer, size
        self.frames = min(frames), max(frames)

    def sample(self) -> dict:
        """A batch: `x`, normalised features [B, F, D]; `mask`, bool [B, F], frames that are there, None where all are;
        `clips`, long [B], their numbers in the dataset; `names` of the clips."""
        clips = torch.randint(len(self.features.dataset), (self.size,))
        shortest, longest = (frames // 4 for frames in self.frames)
        length = int(torch.randint(shortest, longest + 1, ())) * 4
        x, mask = self.features.sample_padded(clips, length)
        names = [self.features.dataset[n].name for n in clips.tolist()]
        return {
            "x": self.normalizer.normalize(x),
            "mask": None if mask.all() else mask,
            "clips": clips,
            "names": names,
        }
