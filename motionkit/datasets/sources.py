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
from typing import NamedTuple, Protocol

from torch import Tensor

from ..bvh import parse
from ..errors import MotionKitError
from ..files import cache_folder, read_bytes
from ..motion import Motion

# What reading from a damaged, encrypted or exotic archive raises.
UNREADABLE = (
    OSError,
    ValueError,
    KeyError,
    RuntimeError,
    NotImplementedError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
)
_LARGEST_TEXT = 1 << 26  # bytes of one table or label file; a guard against archives made to fill the memory


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

    def bvh(self, start: int = 0, stop: int | None = None) -> BvhSource:
        """The source of a clip that is this file, or its frames from `start` up to `stop` (not included)."""
        return BvhSource(self.path, self.member, self.size, self.changed, start, stop)


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
    given = os.environ.get("MOTIONKIT_DATA")
    return Path(given).expanduser() if given else cache_folder() / "captures"


def find(wanted: Wanted, root: str | os.PathLike | None) -> list[File]:
    """The dataset's files in the order of their places; what is left of archives for unpacking is passed over.

    root: a folder that has them somewhere below it, or whose zip has them, or a zip; left out, `data_folder()`. Files
    and folders with a dot in front count as hidden. Raises MotionKitError where no clip is found.

    >>> find(Wanted("walks", re.compile(r"walk_.*[.]bvh"), "walk_NNN.bvh", "record some"), "nowhere")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nowhere: no such file or folder; record some
    """
    place = _root(wanted, root)
    broken = None
    for part in [place, *sorted(place.glob("*.zip"))] if place.is_dir() else [place]:
        if part != place and part.name.startswith("."):
            continue
        try:
            found = sorted(_in_folder(wanted, part) if part.is_dir() else _in_zip(wanted, part), key=lambda f: f.place)
        except MotionKitError as error:  # another zip may have the clips
            broken = broken or error
            continue
        if any(wanted.clips.fullmatch(file.name) for file in found):
            return found
    raise broken or MotionKitError(f"{place}: no clips of {wanted.name} here ({wanted.shape}); {wanted.how}")


def _root(wanted: Wanted, root: str | os.PathLike | None) -> Path:
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
    found: dict[str, File] = {}
    for file in sorted(files, key=lambda f: (f.stem, f.place)):
        found.setdefault(file.stem, file)
    return list(found.values())


def read_texts(files: Iterable[File]) -> Iterator[tuple[File, str]]:
    """The small text files among those found, with what they say; each archive is opened once.

    Raises MotionKitError for a file that cannot be read, is no UTF-8 text or is too large to be a table.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "a.txt")
    ...     _ = path.write_text("hello")
    ...     [text for _, text in read_texts([File("a.txt", str(path), None, 5, 0)])]
    ['hello']
    """
    for file, data in read_heads(files, _LARGEST_TEXT):
        if file.size > _LARGEST_TEXT:
            raise MotionKitError(f"{file.where}: {file.size} bytes, which is no table; get the data again")
        try:
            yield file, data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise MotionKitError(f"{file.where}: expected UTF-8 text; found {error}; save it as UTF-8") from None


def read_heads(files: Iterable[File], size: int) -> Iterator[tuple[File, bytes]]:
    """The files, each with its first `size` bytes; each archive is opened once. MotionKitError for one not readable.

    >>> list(read_heads([], 10))
    []
    """
    archives: dict[str, zipfile.ZipFile] = {}
    try:
        for file in files:
            yield file, _head(file, size, archives)
    finally:
        for archive in archives.values():
            archive.close()


def _head(file: File, size: int, archives: dict[str, zipfile.ZipFile]) -> bytes:
    try:
        if file.member is None:
            with open(file.path, "rb") as opened:
                return opened.read(size)
        if file.path not in archives:
            archives[file.path] = zipfile.ZipFile(file.path)
        with archives[file.path].open(file.member) as opened:
            return opened.read(size)
    except UNREADABLE as error:
        raise MotionKitError(f"{file.where}: cannot be read ({error}); get the data again") from None


_LARGEST = 1 << 28  # bytes of one clip; a guard against archives made to fill the memory


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
