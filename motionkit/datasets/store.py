"""The cache of a dataset: all clips in one memory-mapped file of float32, with an index in JSON beside it.

A clip's numbers stand together: offsets [J, 3], rotations [F, J, 4], translations [F, J, 3]; metres, w x y z.
What is in memory is what is looked at, so that a corpus larger than memory is read the same way.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from ..errors import MotionKitError
from ..files import open_atomic, write_atomic
from ..motion import Motion
from ..skeleton import Skeleton

FORMAT = 1  # to be raised when the layout changes or the reader makes other numbers of the same files


class Source(NamedTuple):
    """Where a clip is read from: a file, or a member of a zip. state: what changes when the content does."""

    name: str
    path: str
    member: str | None
    size: int
    state: int


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


def cache_folder() -> Path:
    """Where caches go: the environment variable MOTIONKIT_CACHE, or the system's usual place."""
    given = os.environ.get("MOTIONKIT_CACHE")
    if given:
        return Path(given).expanduser()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "motionkit"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "motionkit"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "motionkit"


@dataclass(eq=False)
class Store:
    """An opened cache; `motion(n)` builds the n-th clip."""

    path: Path
    clips: tuple[StoredClip, ...]
    trees: tuple[dict, ...] = field(repr=False)

    @cached_property
    def numbers(self) -> np.ndarray:
        """The whole data file, memory-mapped, float32 [N]."""
        return np.memmap(self.path, "<f4", "r")

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k != "numbers"}  # each process maps the file itself

    def motion(self, number: int) -> Motion:
        """A clip as a `Motion`. Raises MotionKitError if the cache has been damaged since it was written."""
        clip, tree = self.clips[number], self.trees[self.clips[number].tree]
        joints = len(tree["names"])
        parts = (joints * 3, clip.frames * joints * 4, clip.frames * joints * 3)
        block = np.array(self.numbers[clip.start : clip.start + sum(parts)])
        if len(block) != sum(parts) or zlib.crc32(block) != clip.checksum:
            _index_path(self.path).unlink(missing_ok=True)
            raise MotionKitError(
                f"{self.path}: the cache is damaged at clip {clip.name!r}; load the dataset again to remake it"
            )
        offsets, rotations, translations = torch.from_numpy(block).split(parts)
        skeleton = Skeleton(
            tuple(tree["names"]),
            tuple(tree["parents"]),
            offsets.view(joints, 3),
            tuple(map(tuple, tree["channels"])),
            tuple((joint, tuple(offset)) for joint, offset in tree["end_sites"]),
        )
        turns, moves = rotations.view(clip.frames, joints, 4), translations.view(clip.frames, joints, 3)
        return Motion(skeleton, turns, moves, clip.fps, clip.name, clip.metres_per_unit)


def open_store(name: str, sources: list[Source]) -> Store:
    """The cache of these clips; made first if there is none, or if it is damaged."""
    listing = "\n".join(f"{s.name} {s.size} {s.state}" for s in sources)
    key = hashlib.sha256(f"format {FORMAT}\n{listing}".encode()).hexdigest()[:16]
    path = cache_folder() / f"{name}-{key}.f32"
    store = _read_index(path, len(sources))
    if store is None:
        _build(path, sources)
        store = _read_index(path, len(sources))
        if store is None:
            raise MotionKitError(
                f"{path}: the cache cannot be read after writing it; set MOTIONKIT_CACHE to another folder"
            )
    return store


def _index_path(data: Path) -> Path:
    return data.with_suffix(".json")


def _read_index(path: Path, count: int) -> Store | None:
    """The store, or None if index or data are missing or do not fit together."""
    try:
        index = json.loads(_index_path(path).read_bytes())
        clips = tuple(StoredClip(*row) for row in index["clips"])
        fits = index["bytes"] == path.stat().st_size and len(clips) == count
        return Store(path, clips, tuple(index["trees"])) if fits else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _build(path: Path, sources: list[Source]) -> None:
    from .reading import read_all

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MotionKitError(f"{path.parent}: cannot make the cache folder: {error}; set MOTIONKIT_CACHE") from None
    _index_path(path).unlink(missing_ok=True)
    trees: dict[str, int] = {}
    with open_atomic(path) as file:
        clips, size = _write_clips(file, read_all(sources), trees)
    index = {"format": FORMAT, "bytes": size, "trees": list(map(json.loads, trees)), "clips": clips}
    write_atomic(_index_path(path), json.dumps(index))


def _write_clips(file, read: Iterable[tuple], trees: dict[str, int]) -> tuple[list[list], int]:
    clips, size = [], 0
    for name, tree, fps, unit, frames, block in read:
        number = trees.setdefault(json.dumps(tree), len(trees))
        clip = StoredClip(name, size // 4, frames, number, fps, unit, zlib.crc32(block))
        clips.append(list(asdict(clip).values()))
        size += file.write(block)
    return clips, size
