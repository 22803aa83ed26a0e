"""The clips of a dataset or a corpus on disk: one or many shards, memory-mapped.

What is in memory is what is looked at, so that a corpus larger than memory is read the same way as a small one.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from .. import contacts
from ..errors import MotionKitError
from ..files import MotionKitWarning, cache_folder, open_atomic, write_atomic
from ..motion import Motion
from ..skeleton import Skeleton
from .sources import Item, Labels, Recording, Source

_OPEN_SHARDS = 256  # systems let a process open about a thousand files


def make_folder(folder: Path, advice: str) -> Path:
    """A folder that can be written to; MotionKitError with advice if there can be none."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MotionKitError(f"{folder}: cannot make the cache folder: {error}; {advice}") from None
    if not os.access(folder, os.W_OK):
        raise MotionKitError(f"{folder}: the cache folder cannot be written; {advice}")
    return folder


@dataclass(eq=False)
class Store:
    """Opened shards. Clips have indices from 0, through all shards. remedy: what to do about a damaged one."""

    shards: tuple[Shard, ...] = field(repr=False)
    remedy: str = "load the dataset again to remake it"

    def __getstate__(self) -> dict:
        return {"shards": self.shards, "remedy": self.remedy}  # each process maps the files itself

    def __setstate__(self, state: dict) -> None:
        self.__init__(**state)

    @cached_property
    def clips(self) -> tuple[StoredClip, ...]:
        """All clips, shard after shard."""
        return tuple(clip for shard in self.shards for clip in shard.clips)

    @cached_property
    def frames(self) -> np.ndarray:
        """How many frames each clip has, [N]."""
        return np.array([clip.frames for clip in self.clips], dtype=np.int64)

    @cached_property
    def trees(self) -> tuple[dict, ...]:
        """The trees of all shards, one after the other."""
        return tuple(tree for shard in self.shards for tree in shard.trees)

    @cached_property
    def places(self) -> tuple[tuple[int, int], ...]:
        """For each clip its shard, and its tree among `trees`."""
        first = np.cumsum([0, *(len(shard.trees) for shard in self.shards)]).tolist()
        return tuple((n, first[n] + clip.tree) for n, shard in enumerate(self.shards) for clip in shard.clips)

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """How many numbers a row has, tree by tree."""
        return tuple(7 * len(tree["names"]) + sum(width for _, width in tree["tracks"]) for tree in self.trees)

    @cached_property
    def kinds(self) -> np.ndarray:
        """A number for each clip, [N]: the same where joints, tracks and frame rate are."""
        trees = [str((tree["names"], tree["parents"], tree["tracks"])) for tree in self.trees]
        kinds: dict[tuple, int] = {}
        pairs = zip(self.places, self.clips, strict=True)
        numbers = (kinds.setdefault((trees[tree], clip.fps), len(kinds)) for (_, tree), clip in pairs)
        return np.fromiter(numbers, np.int64, len(self.clips))

    def rows(self, index: int, start: int, stop: int) -> np.ndarray:
        """Frames `start` to `stop` of a clip, [F, W], where they lie in the mapped file: one read, no copy."""
        shard, tree = self.places[index]
        width = self.widths[tree]
        first = self.clips[index].start + start * width
        values = self._maps(shard)[first : first + (stop - start) * width]
        if len(values) != (stop - start) * width:
            raise self._damage(shard, f"the data end before clip {self.clips[index].name!r} does")
        return values.reshape(stop - start, width)

    @cached_property
    def _maps(self) -> Callable[[int], np.ndarray]:
        return lru_cache(_OPEN_SHARDS)(self._map)

    def _map(self, shard: int) -> np.ndarray:
        try:
            return np.asarray(np.memmap(self.shards[shard].path, "<f4", "r"))
        except (OSError, ValueError) as error:
            raise self._damage(shard, f"the data cannot be opened ({error})") from None

    def _damage(self, shard: int, fault: str) -> MotionKitError:
        path = self.shards[shard].path
        forget(path)
        return MotionKitError(f"{path}: {fault}; {self.remedy}")

    def tracks(self, index: int) -> dict[str, slice]:
        """Which columns of a clip's rows are which track."""
        tree = self.trees[self.places[index][1]]
        ends = np.cumsum([7 * len(tree["names"]), *(width for _, width in tree["tracks"])]).tolist()
        return {name: slice(*ends[n : n + 2]) for n, (name, _) in enumerate(tree["tracks"])}

    def skeleton(self, index: int) -> Skeleton:
        """A clip's skeleton; one object for all clips that share it."""
        return self._skeletons(self.places[index][1])

    @cached_property
    def _skeletons(self) -> Callable[[int], Skeleton]:
        return lru_cache(maxsize=256)(lambda tree: _skeleton_of(self.trees[tree]))

    def check(self, index: int) -> None:
        """Raises MotionKitError if a clip's numbers are not those that were written."""
        clip = self.clips[index]
        if zlib.crc32(np.ascontiguousarray(self.rows(index, 0, clip.frames))) != clip.checksum:
            raise self._damage(self.places[index][0], f"the cache is damaged at clip {clip.name!r}")

    def recording(self, index: int, start: int = 0, stop: int | None = None) -> Recording:
        """Frames of a clip with their tracks, copied into memory; a whole clip is checked for damage."""
        clip = self.clips[index]
        if stop is None:
            self.check(index)
            stop = clip.frames
        rows = np.array(self.rows(index, start, stop), np.float32)
        skeleton = self.skeleton(index)
        name = clip.name if (start, stop) == (0, clip.frames) else f"{clip.name}[{start}:{stop}]"
        motion = Motion(skeleton, *split_rows(rows, len(skeleton)), clip.fps, name, clip.metres_per_unit)
        tracks = {track: torch.from_numpy(rows[:, columns].copy()) for track, columns in self.tracks(index).items()}
        return Recording(motion, tracks)


def split_rows(rows: np.ndarray, joints: int) -> tuple[Tensor, Tensor]:
    """Rows [..., W] to rotations [..., J, 4] and translations [..., J, 3], copied.

    NumPy copies, on one core: torch would share so small a job out to threads that wait longer than they work.

    >>> [tuple(part.shape) for part in split_rows(np.zeros((8, 16)), joints=2)]
    [(8, 2, 4), (8, 2, 3)]
    """
    rotations = np.ascontiguousarray(rows[..., : 4 * joints], np.float32)
    translations = np.ascontiguousarray(rows[..., 4 * joints : 7 * joints], np.float32)
    shape = (*rows.shape[:-1], joints)
    return torch.from_numpy(rotations.reshape(*shape, 4)), torch.from_numpy(translations.reshape(*shape, 3))


def _skeleton_of(tree: dict) -> Skeleton:
    return Skeleton(
        tuple(tree["names"]),
        tuple(tree["parents"]),
        torch.tensor(tree["offsets"]),
        tuple(map(tuple, tree["channels"])),
        tuple((joint, tuple(offset)) for joint, offset in tree["end_sites"]),
        None if tree["twins"] is None else tuple(tree["twins"]),
    )


def open_store(name: str, items: Sequence[Item]) -> Store:
    """The cache of these clips, one shard; made first if there is none, or if it is damaged."""
    path = cache_folder() / f"{name}-{items_key(items)}.f32"
    try:
        return Store((read_shard(path),))
    except MotionKitError:
        make_folder(path.parent, "set MOTIONKIT_CACHE to another folder")
        write_shards([(path, items)])
    try:
        return Store((read_shard(path),))
    except MotionKitError as error:
        raise MotionKitError(f"{error}, though it was just written; set MOTIONKIT_CACHE to another folder") from None


FORMAT = 2  # to be raised when the layout changes or a reader makes other numbers of the same files


@dataclass(frozen=True)
class StoredClip:
    """A line of the index. start: place of its first number in the data. tree: which of the index's trees."""

    name: str
    start: int
    frames: int
    tree: int
    fps: float
    metres_per_unit: float
    checksum: int


@dataclass(frozen=True)
class Shard:
    """What a shard's index says; `trees` hold skeletons, and the names and widths of the tracks."""

    path: Path
    key: str
    clips: tuple[StoredClip, ...]
    labels: tuple[Labels, ...]
    trees: tuple[dict, ...]


def items_key(items: Sequence[Item]) -> str:
    """Changes when the clips do, their order, or the layout of the files.

    >>> items_key([]) == items_key([]), len(items_key([]))
    (True, 16)
    """
    listing = "\n".join(f"{item.name}\t{item.source.state}" for item in items)
    return hashlib.sha256(f"format {FORMAT}\n{listing}".encode()).hexdigest()[:16]


def sort_items(name: str, items: Iterable[Item]) -> list[Item]:
    """Items sorted by name; MotionKitError if there are none, or two of one name.

    >>> sort_items("mine", [])
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: dataset 'mine' has no clips; list at least one
    """
    items = sorted(items, key=lambda item: item.name)
    if not items:
        raise MotionKitError(f"dataset {name!r} has no clips; list at least one")
    for item, after in zip(items, items[1:]):
        if item.name == after.name:
            raise MotionKitError(f"dataset {name!r}: two clips are called {item.name!r}; give each a name of its own")
    return items


def forget(data: Path) -> None:
    """Take a shard's index away, so that it is made again the next time."""
    with suppress(OSError):  # a cache that only others may write is theirs to mend
        data.with_suffix(".json").unlink()


def read_shard(path: Path) -> Shard:
    """The index of a data file; MotionKitError if either is missing or damaged, or they do not fit together."""
    try:
        index = json.loads(path.with_suffix(".json").read_bytes())
        if index.pop("checksum") != _checksum(index) or index["format"] != FORMAT:
            raise ValueError("its checksum or its format is another")
        clips = tuple(StoredClip(*row) for row in index["clips"])
        labels = tuple(Labels(c, s, tuple(texts), *more) for c, s, texts, *more in index["labels"])
        size = path.stat().st_size
        if size != index["bytes"] or len(labels) != len(clips):
            raise ValueError(f"the data have {size} bytes, its index says {index['bytes']}")
        return Shard(path, index["key"], clips, labels, tuple(index["trees"]))
    except FileNotFoundError as error:
        raise MotionKitError(f"{path}: not a whole shard: {Path(error.filename).name} is missing") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MotionKitError(f"{path}: the shard or its index is damaged ({error})") from None


def write_shards(plan: Sequence[tuple[Path, Sequence[Item]]], bad: str = "stop") -> None:
    """Read clips on all cores and write shard after shard, each whole or not at all.

    plan: for each shard its data file and its items. bad: `stop` raises the MotionKitError of the first clip that
    cannot be read; `skip` warns and leaves it out.
    """
    with closing(read_all([item for _, items in plan for item in items], bad)) as read:
        for path, items in plan:
            forget(path)
            trees: dict[str, int] = {}
            clips, labels, size = [], [], 0
            with open_atomic(path) as file:
                for item, clip in zip(items, read):
                    if clip is None:
                        continue
                    tree, checksum = trees.setdefault(clip.tree, len(trees)), zlib.crc32(clip.rows)
                    place = [size // 4, len(clip.rows), tree, clip.fps, clip.metres_per_unit, checksum]
                    clips.append([item.name, *place])
                    labels.append(item.labels)
                    size += file.write(clip.rows.data)
            index = {"format": FORMAT, "key": items_key(items), "bytes": size, "trees": list(map(json.loads, trees))}
            _write_index(path, {**index, "clips": clips, "labels": labels})


def relabel(shard: Shard, items: Iterable[Item]) -> None:
    """Give a shard's clips the labels that their items have now; the data stay as they are."""
    by_name = {item.name: item.labels for item in items}
    labels = tuple(by_name[clip.name] for clip in shard.clips)
    if labels != shard.labels:
        index = json.loads(shard.path.with_suffix(".json").read_bytes())
        del index["checksum"]
        _write_index(shard.path, {**index, "labels": labels})


def _write_index(path: Path, index: dict) -> None:
    write_atomic(path.with_suffix(".json"), json.dumps({"checksum": _checksum(index), **index}))


def _checksum(index: dict) -> int:
    return zlib.crc32(json.dumps(index).encode())


_BATCH = 32  # clips a task: few enough to keep all cores busy to the end, enough to make sending them cheap
_LARGE = 1 << 24  # bytes of files a task, so that long clips do not fill the memory
_FEW = 100  # up to so many clips, starting other processes takes longer than reading
_MOST_JOBS = 8  # each takes a third of a gigabyte, most of it torch


class Read(NamedTuple):
    """A clip that was read. tree: skeleton and track widths as JSON. rows: float32 [F, 7J + tracks]."""

    tree: str
    fps: float
    metres_per_unit: float
    rows: np.ndarray


def read_all(items: Sequence[Item], bad: str = "stop") -> Iterator[Read | None]:
    """The clips, in order. Raises MotionKitError naming one that cannot be read, or (`bad="skip"`) gives None for it.

    joblib's settings count: under `joblib.parallel_config("dask")` a cluster reads.
    """
    from tqdm.auto import tqdm

    with tqdm(total=len(items), desc="reading clips (once)", unit="clip", leave=False) as progress:
        for clips, messages in _in_parallel(_batches(items), len(items), bad):
            for message, category in messages:
                warnings.warn(message, category, stacklevel=2)
            yield from clips
            progress.update(len(clips))


def _batches(items: Sequence[Item]) -> list[list[tuple[str, Source]]]:
    batches, size = [], 0
    for item in items:
        weight = getattr(item.source, "size", 0)
        if not batches or len(batches[-1]) >= _BATCH or size + weight > _LARGE:
            batches.append([])
            size = 0
        batches[-1].append((item.name, item.source))
        size += weight
    return batches


def _in_parallel(batches: list, count: int, bad: str) -> Iterator[tuple[list[Read | None], list[tuple]]]:
    if count <= _FEW:
        return (_read_batch(batch, bad) for batch in batches)
    from joblib import Parallel, cpu_count, delayed, effective_n_jobs

    jobs, tasks = min(cpu_count(), _MOST_JOBS), [delayed(_read_batch)(batch, bad, threads=1) for batch in batches]
    try:
        parallel = Parallel(jobs, return_as="generator", pre_dispatch="2*n_jobs")
    except ValueError:  # Dask hands results over together: a few rounds, so that they fit in memory
        parallel, size = Parallel(jobs), 4 * effective_n_jobs(jobs)
        return (read for n in range(0, len(tasks), size) for read in parallel(tasks[n : n + size]))
    return parallel(tasks)


def _read_batch(batch: list[tuple[str, Source]], bad: str, threads: int = 0) -> tuple[list[Read | None], list[tuple]]:
    """The clips, and the warnings that came with them. threads: of torch; 1 where each core has a process."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads or before)
    try:
        with warnings.catch_warnings(record=True) as records:
            warnings.simplefilter("always")
            clips = [_read(name, source, bad) for name, source in batch]
    finally:
        torch.set_num_threads(before)
    return clips, [(str(w.message), w.category) for w in records]


def _read(name: str, source: Source, bad: str) -> Read | None:
    try:
        return recording_rows(name, source.read())
    except MotionKitError as error:
        if bad == "stop":
            raise
        warnings.warn(f"left out {name!r}: {error}", MotionKitWarning, stacklevel=2)
        return None


def recording_rows(name: str, recording: Recording) -> Read:
    """A recording as rows; contacts are found where it brings none and the skeleton's names tell its feet.

    Raises MotionKitError if a track has not one row for each frame.

    >>> import motionkit as mk
    >>> read = recording_rows("walk", Recording(mk.load("data/actor/walk_neutral.bvh")))
    >>> read.rows.shape, json.loads(read.tree)["tracks"]
    ((120, 158), [['contacts', 4]])
    """
    motion, skeleton = recording.motion, recording.motion.skeleton
    tree = {
        "names": skeleton.names,
        "parents": skeleton.parents,
        "offsets": skeleton.offsets.tolist(),
        "channels": skeleton.channels,
        "end_sites": skeleton.end_sites,
        "twins": skeleton.mirror_joints,
    }
    tracks = dict(recording.tracks)
    if "contacts" not in tracks:
        with suppress(MotionKitError):  # no feet by name: there is no such track then
            tracks["contacts"] = contacts.foot_contacts(motion.replace(skeleton=_shared(json.dumps(tree), skeleton)))
    for track, values in tracks.items():
        if values.ndim != 2 or len(values) != len(motion):
            raise MotionKitError(
                f"clip {name!r}: expected track {track!r} as [{len(motion)}, K], a row for each frame; found "
                f"{list(values.shape)}"
            )
    tree["tracks"] = [[track, values.shape[1]] for track, values in tracks.items()]
    parts = (motion.rotations.flatten(1), motion.translations.flatten(1), *tracks.values())
    rows = torch.cat([part.detach().cpu().float() for part in parts], 1)
    return Read(json.dumps(tree), motion.fps, motion.metres_per_unit, rows.numpy().astype("<f4", copy=False))


_skeletons: dict[str, Skeleton] = {}


def _shared(tree: str, skeleton: Skeleton) -> Skeleton:
    """One object for skeletons that are the same: what it knows of its joints is worked out once."""
    if len(_skeletons) > 64:
        _skeletons.clear()
    return _skeletons.setdefault(tree, skeleton)
