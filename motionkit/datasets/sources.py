"""Where a dataset's files lie: below a folder, in a zip, or in a zip in the folder. Nothing is unpacked or written."""

from __future__ import annotations

import os
import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol

from torch import Tensor

from ..bvh import parse
from ..errors import MotionKitError
from ..files import cache_folder, read_bytes
from ..motion import Motion

# What reading from a damaged, encrypted or exotic archive raises.
UNREADABLE = (OSError, ValueError, LookupError, RuntimeError, EOFError, zipfile.BadZipFile, zlib.error)
# Bytes of one table or label file, and of one clip: a guard against archives made to fill the memory.
_LARGEST_TEXT, _LARGEST_CLIP = 1 << 26, 1 << 28


@dataclass(frozen=True)
class File:
    """A file that was found. place: its path below the folder or in the zip, with `/` between the parts.

    path: the file on disk, or the zip in which it is the `member`. size: bytes. changed: a number that changes with the
    content (time of the last change, or a member's CRC).

    >>> file = File("data/actor/walk_old.bvh", "b2.zip", "data/actor/walk_old.bvh", 1000, 1)
    >>> file.name, file.stem, file.where
    ('walk_old.bvh', 'walk_old', 'b2.zip/data/actor/walk_old.bvh')
    """

    place: str
    path: str
    member: str | None
    size: int
    changed: int

    @classmethod
    def at(cls, path: str | os.PathLike) -> File:
        """A file on disk, whose place is the path as given; MotionKitError if there is none."""
        try:
            state = os.stat(path)
        except OSError as error:
            raise MotionKitError(f"{path}: cannot be read: {error.strerror}; check the path") from None
        return cls(Path(path).as_posix(), os.fspath(path), None, state.st_size, state.st_mtime_ns)

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.place.rsplit("/", 1)[-1]

    @property
    def stem(self) -> str:
        """The name without what follows its last dot."""
        return self.name.rsplit(".", 1)[0]

    @property
    def where(self) -> str:
        """The file as messages call it."""
        return self.path if self.member is None else f"{self.path}/{self.member}"

    def open(self) -> BinaryIO:
        """The file's bytes, to be read; raises any of UNREADABLE."""
        if self.member is None:
            return open(self.path, "rb")
        return _archive(self.path, os.stat(self.path).st_mtime_ns).open(self.member)

    def head(self, size: int) -> bytes:
        """The first `size` bytes; MotionKitError if they cannot be read."""
        try:
            with self.open() as opened:
                return opened.read(size)
        except UNREADABLE as error:
            raise MotionKitError(f"{self.where}: cannot be read ({error}); get the data again") from None

    def text(self) -> str:
        """What a small text file says; MotionKitError if it cannot be read, is no UTF-8 or too large to be a table.

        >>> File.at("data/actor/walk_old.bvh").text()[:9]
        'HIERARCHY'
        """
        if self.size > _LARGEST_TEXT:
            raise MotionKitError(f"{self.where}: {self.size} bytes, which is no table; get the data again")
        try:
            return self.head(_LARGEST_TEXT).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise MotionKitError(f"{self.where}: expected UTF-8 text; found {error}; save it as UTF-8") from None


@lru_cache(maxsize=1)  # listing the members of a large archive takes longer than reading one of them
def _archive(path: str, _changed: int) -> zipfile.ZipFile:
    return zipfile.ZipFile(path)


@dataclass(frozen=True)
class Wanted:
    """The files that make a dataset. clips: what a clip's file is called; shape: that in words.

    how: what a person does who has no such files, or too few. others: further files that belong to it.
    """

    name: str
    clips: re.Pattern
    shape: str
    how: str
    others: re.Pattern | None = None

    def takes(self, file: str) -> bool:
        """Whether a file of this name belongs to the dataset."""
        return bool(self.clips.fullmatch(file) or (self.others and self.others.fullmatch(file)))


def data_folder() -> Path:
    """Where data lie by default: MOTIONKIT_DATA, or else `captures` in the cache folder.

    >>> from unittest import mock
    >>> with mock.patch.dict(os.environ, {"MOTIONKIT_DATA": "my data"}):
    ...     print(data_folder())
    my data
    """
    folder = os.environ.get("MOTIONKIT_DATA")
    return Path(folder).expanduser() if folder else cache_folder() / "captures"


def find(wanted: Wanted, root: str | os.PathLike | None) -> tuple[list[File], list[File]]:
    """The dataset's clips and its other files, in the order of their places; what unpacking left over is passed over.

    root: a folder that has them somewhere below it, or whose zip has them, or a zip; left out, `data_folder()`. Files
    and folders with a dot in front count as hidden. Raises MotionKitError where no clip is found.

    >>> find(Wanted("walks", re.compile(r"walk_.*[.]bvh"), "walk_NNN.bvh", "record some"), "nowhere")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nowhere: no such file or folder; record some
    """
    place = _root(wanted, root)
    damage = None
    for part in [place, *sorted(place.glob("[!.]*.zip"))] if place.is_dir() else [place]:
        try:
            files = sorted(_in_folder(wanted, part) if part.is_dir() else _in_zip(wanted, part), key=lambda f: f.place)
        except MotionKitError as error:  # another zip may have the clips
            damage = damage or error
            continue
        clips = [file for file in files if wanted.clips.fullmatch(file.name)]
        if clips:
            return clips, sorted(set(files) - set(clips), key=lambda f: f.place)
    raise damage or MotionKitError(f"{place}: no clips of {wanted.name} here ({wanted.shape}); {wanted.how}")


def _root(wanted: Wanted, root: str | os.PathLike | None) -> Path:
    """Where to look; MotionKitError if that is nowhere."""
    if root is not None:
        place = Path(root).expanduser()
    else:
        place = data_folder()
        if (place / wanted.name).is_dir():
            place = place / wanted.name  # where `fetch` puts it
        elif not place.exists() and not os.environ.get("MOTIONKIT_DATA"):
            raise MotionKitError(
                f"where is {wanted.name}? No root is given and MOTIONKIT_DATA is not set; {wanted.how}"
            )
    if not place.exists():
        raise MotionKitError(f"{place}: no such file or folder; {wanted.how}")
    return place


def _in_folder(wanted: Wanted, folder: Path) -> Iterator[File]:
    for above, folders, files in os.walk(folder):
        folders[:] = [f for f in folders if not f.startswith(".")]
        for name in files:
            path = Path(above, name)
            if not name.startswith(".") and wanted.takes(name) and path.is_file():
                state = path.stat()
                yield File(path.relative_to(folder).as_posix(), str(path), None, state.st_size, state.st_mtime_ns)


def _in_zip(wanted: Wanted, path: Path) -> Iterator[File]:
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except UNREADABLE as error:
        raise MotionKitError(f"{path}: neither a folder nor a whole zip archive ({error}); {wanted.how}") from None
    for member in members:
        parts = member.filename.split("/")
        if wanted.takes(parts[-1]) and not any(p.startswith(".") and p.strip(".") for p in parts):
            yield File(member.filename, str(path), member.filename, member.file_size, member.CRC)


def unique(files: Iterable[File]) -> list[File]:
    """One of each name (the data may lie there twice), in the order of names.

    >>> twice = [File(f"{folder}/a.bvh", "", None, 1, 1) for folder in ("copy", "data")]
    >>> [file.place for file in unique(twice)]
    ['copy/a.bvh']
    """
    first: dict[str, File] = {}
    for file in sorted(files, key=lambda f: (f.stem, f.place)):
        first.setdefault(file.stem, file)
    return list(first.values())


class Labels(NamedTuple):
    """What a clip shows; what is empty is not known.

    content: what is done, such as "walk". style: how, such as "neutral". texts: sentences that describe it, the best
    one first. performer: who moves, where that is known. take: what was recorded in one go; clips of one take resemble
    each other, so a split keeps them together (empty: the clip's name). split: the part that the dataset's makers put
    it in (train, validation, test), where they did.
    """

    content: str = ""
    style: str = ""
    texts: tuple[str, ...] = ()
    performer: str = ""
    take: str = ""
    split: str = ""

    @property
    def caption(self) -> str:
        """The best of the sentences; empty where there is none."""
        return self.texts[0] if self.texts else ""


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
    """A BVH file, on disk or in a zip. start, stop: the frames of it that are the clip; all where left out."""

    file: File
    start: int = 0
    stop: int | None = None

    @classmethod
    def at(cls, path: str | os.PathLike, start: int = 0, stop: int | None = None) -> BvhSource:
        """The source of a file on disk; MotionKitError if there is none.

        >>> BvhSource.at("data/actor/walk_old.bvh", 10, 20).read().motion
        Motion('walk_old', 10 frames at 30 fps, 0.3 s, 22 joints)
        """
        return cls(File.at(path), start, stop)

    @property
    def size(self) -> int:
        """Bytes to read."""
        return self.file.size

    @property
    def state(self) -> str:
        """Size, date and cut."""
        return f"{self.file.size} {self.file.changed} {self.start}:{self.stop}"

    def read(self) -> Recording:
        """The clip's frames; MotionKitError where the file is broken or the cut reaches beyond its end."""
        motion = parse(self.data(), self.file.where)
        if self.stop is None and not self.start:
            return Recording(motion)
        stop = len(motion) if self.stop is None else self.stop
        if not 0 <= self.start < stop <= len(motion):
            raise MotionKitError(
                f"{self.file.where}: the table of cuts says frames {self.start} to {stop}; the file has {len(motion)}; "
                "take table and files from the same release"
            )
        return Recording(motion[self.start : stop])

    def data(self) -> bytes:
        """The whole file; MotionKitError if it cannot be read, or is too large to be a clip."""
        if self.size > _LARGEST_CLIP:
            raise MotionKitError(f"{self.file.path}: {self.size} bytes, which is no clip; get the data again")
        if self.file.member is None:
            return read_bytes(self.file.path)
        try:
            with self.file.open() as member:
                return member.read()
        except UNREADABLE as error:
            raise MotionKitError(
                f"{self.file.path}: {self.file.member} cannot be read ({error}); get the archive again"
            ) from None
