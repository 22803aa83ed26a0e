"""Where clips come from: what a reader of a dataset finds, before anything is read.

A reader module (`bandai`, `xia`, ...) has one function, `items(name, root)`, that lists a dataset's `Item`s sorted by
name. Each knows its labels and a `source` that makes the motion when it is asked to, in whatever process.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple, Protocol

from torch import Tensor

from ..bvh import parse
from ..errors import MotionKitError
from ..files import read_bytes
from ..motion import Motion

_LARGEST = 1 << 28  # bytes of one clip; a guard against archives made to fill the memory


class Labels(NamedTuple):
    """What a clip shows.

    texts: sentences that describe it, the best one first. performer: who moves, where that is known. take: what was
    recorded in one go; clips of one take resemble each other, so a split keeps them together (empty: the clip's name).
    split: the part that the dataset's makers put it in (train, validation, test), where they did.
    """

    content: str
    style: str
    texts: tuple[str, ...]
    performer: str = ""
    take: str = ""
    split: str = ""


@dataclass(frozen=True)
class Recording:
    """What a source gives: a motion, and by name the other numbers that belong to its frames, [F, K] each."""

    motion: Motion
    tracks: dict[str, Tensor] = field(default_factory=dict)


class Source(Protocol):
    """Makes one clip, in any process (it can be pickled)."""

    @property
    def state(self) -> str:
        """Changes when the clip's content does."""

    def read(self) -> Recording:
        """The clip; MotionKitError names the file and what is wrong."""


@dataclass(frozen=True)
class Item:
    """One clip of a dataset, not read yet."""

    name: str
    labels: Labels
    source: Source


@dataclass(frozen=True)
class BvhSource:
    """A BVH file, or a member of a zip. start, stop: the frames of it that are the clip; all where left out.

    size: bytes. changed: a number that changes with the content (time of the last change, or a member's CRC).
    """

    path: str
    member: str | None
    size: int
    changed: int
    start: int = 0
    stop: int | None = None

    @classmethod
    def at(cls, path: str | os.PathLike, start: int = 0, stop: int | None = None) -> BvhSource:
        """The source of a file on disk; MotionKitError if there is none.

        >>> BvhSource.at("data/actor/walk_old.bvh", 10, 20).read().motion
        Motion('walk_old', 10 frames at 30 fps, 0.3 s, 22 joints)
        """
        try:
            state = os.stat(path)
        except OSError as error:
            raise MotionKitError(f"{path}: cannot be read: {error.strerror}; check the path") from None
        return cls(os.fspath(path), None, state.st_size, state.st_mtime_ns, start, stop)

    @property
    def state(self) -> str:
        """Size, date and cut."""
        return f"{self.size} {self.changed} {self.start}:{self.stop}"

    def read(self) -> Recording:
        """The clip's frames; MotionKitError where the file is broken or the cut reaches beyond its end."""
        where = self.path if self.member is None else f"{self.path}/{self.member}"
        motion = parse(self._bytes(), where)
        if self.stop is None and not self.start:
            return Recording(motion)
        stop = len(motion) if self.stop is None else self.stop
        if not 0 <= self.start < stop <= len(motion):
            raise MotionKitError(
                f"{where}: the table of cuts says frames {self.start} to {stop}; the file has {len(motion)}; "
                "take table and files from the same release"
            )
        return Recording(motion[self.start : stop])

    def _bytes(self) -> bytes:
        if self.size > _LARGEST:
            raise MotionKitError(f"{self.path}: {self.size} bytes, which is no clip; get the data again")
        if self.member is None:
            return read_bytes(self.path)
        try:
            return _archive(self.path).read(self.member)
        except (OSError, KeyError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
            raise MotionKitError(
                f"{self.path}: {self.member} cannot be read ({error}); get the archive again"
            ) from None


@lru_cache(maxsize=1)  # listing the members of a large archive takes longer than reading one of them
def _archive(path: str) -> zipfile.ZipFile:
    return zipfile.ZipFile(path)
