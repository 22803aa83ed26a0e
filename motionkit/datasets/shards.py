"""A shard: the frames of some clips in one file of float32, with an index in JSON beside it.

A row is a frame: rotations [J, 4] (w x y z), translations [J, 3] in metres, then the tracks that belong to the clip
(contacts, phase, ...). The rows of a clip stand one after the other, so that a window is read in one go. Index and
data appear whole or not at all, and the index says what it was made of.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from ..errors import MotionKitError
from ..files import open_atomic, write_atomic
from .sources import Item, Labels

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


def key_of(items: Sequence[Item]) -> str:
    """Changes when the clips do, their order, or the layout of the files.

    >>> key_of([]) == key_of([]), len(key_of([]))
    (True, 16)
    """
    listing = "\n".join(f"{item.name}\t{item.source.state}" for item in items)
    return hashlib.sha256(f"format {FORMAT}\n{listing}".encode()).hexdigest()[:16]


def index_path(data: Path) -> Path:
    """Where the index of a data file stands."""
    return data.with_suffix(".json")


def in_order(name: str, items: Iterable[Item]) -> list[Item]:
    """Items sorted by name; MotionKitError if there are none, or two of one name.

    >>> in_order("mine", [])
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: dataset 'mine' has no clips; list at least one
    """
    found = sorted(items, key=lambda item: item.name)
    if not found:
        raise MotionKitError(f"dataset {name!r} has no clips; list at least one")
    for item, after in zip(found, found[1:]):
        if item.name == after.name:
            raise MotionKitError(f"dataset {name!r}: two clips are called {item.name!r}; give each a name of its own")
    return found


def forget(data: Path) -> None:
    """Take a shard's index away, so that it is made again the next time."""
    with suppress(OSError):  # a cache that only others may write is theirs to mend
        index_path(data).unlink()


def read_shard(path: Path) -> Shard:
    """The index of a data file; MotionKitError if either is missing or damaged, or they do not fit together."""
    try:
        index = json.loads(index_path(path).read_bytes())
        if index.pop("checksum") != _checksum(index) or index["format"] != FORMAT:
            raise ValueError("its checksum or its format is another")
        clips = tuple(StoredClip(*row) for row in index["clips"])
        labels = tuple(Labels(c, s, tuple(texts), *more) for c, s, texts, *more in index["labels"])
        found = path.stat().st_size
        if found != index["bytes"] or len(labels) != len(clips):
            raise ValueError(f"the data have {found} bytes, its index says {index['bytes']}")
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
    from .reading import read_all

    with closing(read_all([item for _, items in plan for item in items], bad)) as read:
        for path, items in plan:
            forget(path)
            trees: dict[str, int] = {}
            with open_atomic(path) as file:
                clips, labels, size = _write_clips(file, zip(items, read), trees)
            index = {"format": FORMAT, "key": key_of(items), "bytes": size, "trees": list(map(json.loads, trees))}
            _write_index(path, {**index, "clips": clips, "labels": labels})


def relabel(shard: Shard, items: Iterable[Item]) -> None:
    """Give a shard's clips the labels that their items have now; the data stay as they are."""
    labels = {item.name: item.labels for item in items}
    now = tuple(labels[clip.name] for clip in shard.clips)
    if now != shard.labels:
        index = json.loads(index_path(shard.path).read_bytes())
        del index["checksum"]
        _write_index(shard.path, {**index, "labels": now})


def _write_index(path: Path, index: dict) -> None:
    write_atomic(index_path(path), json.dumps({"checksum": _checksum(index), **index}))


def _write_clips(file, read: Iterable[tuple], trees: dict[str, int]) -> tuple[list[list], list[Labels], int]:
    clips, labels, size = [], [], 0
    for item, clip in read:
        if clip is None:
            continue
        tree = trees.setdefault(clip.tree, len(trees))
        row = [item.name, size // 4, len(clip.rows), tree, clip.fps, clip.metres_per_unit, zlib.crc32(clip.rows)]
        clips.append(row)
        labels.append(item.labels)
        size += file.write(clip.rows.data)
    return clips, labels, size


def _checksum(index: dict) -> int:
    return zlib.crc32(json.dumps(index).encode())


def cut_into(items: Sequence[Item], size: int) -> Iterator[Sequence[Item]]:
    """Runs of at most `size` items.

    >>> [len(part) for part in cut_into(range(5), 2)]
    [2, 2, 1]
    """
    return (items[n : n + size] for n in range(0, len(items), size))
