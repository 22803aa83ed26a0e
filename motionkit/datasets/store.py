"""The clips of a dataset or a corpus on disk: one or many shards, memory-mapped.

What is in memory is what is looked at, so that a corpus larger than memory is read the same way as a small one.
"""

from __future__ import annotations

import os
import sys
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion
from ..skeleton import Skeleton
from .shards import Shard, StoredClip, forget, key_of, read_shard, write_shards
from .sources import Item, Recording

_OPEN_SHARDS = 256  # systems let a process open about a thousand files


def cache_folder() -> Path:
    """Where caches go: the environment variable MOTIONKIT_CACHE, or the system's usual place.

    >>> cache_folder().is_absolute()
    True
    """
    given = os.environ.get("MOTIONKIT_CACHE")
    if given:
        return Path(given).expanduser()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "motionkit"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "motionkit"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "motionkit"


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
    """Opened shards. Clips have numbers from 0, through all shards. remedy: what to do about a damaged one."""

    shards: tuple[Shard, ...] = field(repr=False)
    remedy: str = "load the dataset again to remake it"

    def __post_init__(self) -> None:
        self._maps: dict[int, np.ndarray] = {}

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
        found, before = [], 0
        for n, shard in enumerate(self.shards):
            found += [(n, before + clip.tree) for clip in shard.clips]
            before += len(shard.trees)
        return tuple(found)

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """How many numbers a row has, tree by tree."""
        return tuple(7 * len(tree["names"]) + sum(width for _, width in tree["tracks"]) for tree in self.trees)

    @cached_property
    def kinds(self) -> np.ndarray:
        """A number for each clip, [N]: the same where joints, tracks and frame rate are."""
        kinds: dict[tuple, int] = {}
        trees = [str((tree["names"], tree["parents"], tree["tracks"])) for tree in self.trees]
        pairs = zip(self.places, self.clips, strict=True)
        found = (kinds.setdefault((trees[tree], clip.fps), len(kinds)) for (_, tree), clip in pairs)
        return np.fromiter(found, np.int64, len(self.clips))

    def rows(self, number: int, start: int, stop: int) -> np.ndarray:
        """Frames `start` to `stop` of a clip, [F, W], where they lie in the mapped file: one read, no copy."""
        shard, tree = self.places[number]
        width = self.widths[tree]
        first = self.clips[number].start + start * width
        found = self._map(shard)[first : first + (stop - start) * width]
        if len(found) != (stop - start) * width:
            raise self._damage(shard, f"the data end before clip {self.clips[number].name!r} does")
        return found.reshape(stop - start, width)

    def _map(self, shard: int) -> np.ndarray:
        found = self._maps.get(shard)
        if found is None:
            if len(self._maps) >= _OPEN_SHARDS:
                self._maps.pop(next(iter(self._maps)))
            try:
                found = self._maps[shard] = np.asarray(np.memmap(self.shards[shard].path, "<f4", "r"))
            except (OSError, ValueError) as error:
                raise self._damage(shard, f"the data cannot be opened ({error})") from None
        return found

    def _damage(self, shard: int, what: str) -> MotionKitError:
        path = self.shards[shard].path
        forget(path)
        return MotionKitError(f"{path}: {what}; {self.remedy}")

    def tracks(self, number: int) -> dict[str, slice]:
        """Which columns of a clip's rows are which track."""
        tree = self.trees[self.places[number][1]]
        found, start = {}, 7 * len(tree["names"])
        for name, width in tree["tracks"]:
            found[name] = slice(start, start + width)
            start += width
        return found

    def skeleton(self, number: int) -> Skeleton:
        """A clip's skeleton; one object for all clips that share it."""
        return self._skeletons(self.places[number][1])

    @cached_property
    def _skeletons(self) -> Callable[[int], Skeleton]:
        return lru_cache(maxsize=256)(lambda tree: _skeleton_of(self.trees[tree]))

    def check(self, number: int) -> None:
        """Raises MotionKitError if a clip's numbers are not those that were written."""
        clip, shard = self.clips[number], self.places[number][0]
        if zlib.crc32(np.ascontiguousarray(self.rows(number, 0, clip.frames))) != clip.checksum:
            raise self._damage(shard, f"the cache is damaged at clip {clip.name!r}")

    def recording(self, number: int, start: int = 0, stop: int | None = None) -> Recording:
        """Frames of a clip with their tracks, copied into memory; a whole clip is checked for damage."""
        clip = self.clips[number]
        if stop is None:
            self.check(number)
            stop = clip.frames
        rows = np.array(self.rows(number, start, stop), np.float32)
        skeleton = self.skeleton(number)
        turns, moves = split_rows(rows, len(skeleton))
        name = clip.name if (start, stop) == (0, clip.frames) else f"{clip.name}[{start}:{stop}]"
        motion = Motion(skeleton, turns, moves, clip.fps, name, clip.metres_per_unit)
        tracks = {track: torch.from_numpy(rows[:, columns].copy()) for track, columns in self.tracks(number).items()}
        return Recording(motion, tracks)


def split_rows(rows: np.ndarray, joints: int) -> tuple[Tensor, Tensor]:
    """Rows [..., W] to rotations [..., J, 4] and translations [..., J, 3], copied.

    NumPy copies, on one core: torch would share so small a job out to threads that wait longer than they work.

    >>> [tuple(part.shape) for part in split_rows(np.zeros((8, 16)), joints=2)]
    [(8, 2, 4), (8, 2, 3)]
    """
    turns = np.ascontiguousarray(rows[..., : 4 * joints], np.float32)
    moves = np.ascontiguousarray(rows[..., 4 * joints : 7 * joints], np.float32)
    shape = (*rows.shape[:-1], joints)
    return torch.from_numpy(turns.reshape(*shape, 4)), torch.from_numpy(moves.reshape(*shape, 3))


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
    path = cache_folder() / f"{name}-{key_of(items)}.f32"
    try:
        return Store((read_shard(path),))
    except MotionKitError:
        make_folder(path.parent, "set MOTIONKIT_CACHE to another folder")
        write_shards([(path, items)])
    try:
        return Store((read_shard(path),))
    except MotionKitError as error:
        raise MotionKitError(f"{error}, though it was just written; set MOTIONKIT_CACHE to another folder") from None
