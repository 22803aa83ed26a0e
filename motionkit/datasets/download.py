"""Getting published captures: one call downloads the archive, checks every file and unpacks it where `load` looks.

What a whole data set holds is written in `manifests/NAME.json.gz` (made by tools/make_manifest.py): size and SHA-256 of
each file. An archive is checked file by file, because the service that packs it may pack the same files differently.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import shutil
import stat
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path

from ..errors import MotionKitError
from ..files import write_atomic
from .sources import UNREADABLE, data_folder

MANIFESTS = Path(__file__).parent / "manifests"
_RECORD = "source.json"


@dataclass(frozen=True)
class Manifest:
    """What a published data set holds. files: for each path in `folder` its bytes and SHA-256 in hexadecimal.

    address: of the zip archive, whose one top folder has `folder` in it. about: what is shown and recorded beside the
    data: licence, owner, what to cite.
    """

    name: str
    address: str
    folder: str
    about: dict[str, str]
    files: dict[str, tuple[int, str]]


def read_manifest(name: str) -> Manifest:
    """The manifest of a data set; MotionKitError where there is none.

    >>> manifest = read_manifest("bandai-2")
    >>> len(manifest.files), manifest.about["licence"]
    (5807, 'CC BY-NC 4.0')
    >>> read_manifest("xia")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: cannot fetch 'xia'; this can be fetched: 'bandai-2'; ...
    """
    known = sorted(path.name.removesuffix(".json.gz") for path in MANIFESTS.glob("*.json.gz"))
    if name not in known:
        raise MotionKitError(
            f"cannot fetch {name!r}; this can be fetched: {', '.join(map(repr, known))}; load({name!r}) "
            "says where others are"
        )
    told = json.loads(gzip.decompress((MANIFESTS / f"{name}.json.gz").read_bytes()))
    told["files"] = {place: (size, digest) for place, (size, digest) in told["files"].items()}
    return Manifest(**told)


def fetch(name: str, folder: str | os.PathLike | None = None, *, address: str | None = None) -> Path:
    """Download a published data set once, check it, and unpack it; returns its folder, which `load(name)` finds.

    name: "bandai-2". folder: where its folder goes; left out, MOTIONKIT_DATA, or `captures` in the cache folder.
    address: of another copy of the archive, such as one in your own network. The licence is printed, and recorded
    beside the data. A download that was cut off goes on when `fetch` is called again; with the data there already,
    nothing is downloaded.

    Raises MotionKitError where the connection keeps breaking, a file is missing or another than the published one,
    the archive wants out of its folder, or the disk is full; under the data set's own name there is all or nothing.

    >>> fetch("my data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: cannot fetch 'my data'; this can be fetched: 'bandai-2'; ...
    """
    manifest = read_manifest(name)
    above = Path(folder).expanduser() if folder is not None else data_folder()
    target = above / name
    print(licence(manifest))
    if target.exists():
        _check_whole(target, manifest)
        print(f"{name} is in {target} already.")
        return target
    try:
        if above.exists() and not above.is_dir():
            raise MotionKitError(f"{above}: expected a folder to put {name} in; found a file; give fetch a folder=")
        above.mkdir(parents=True, exist_ok=True)
        archive = _download(address or manifest.address, above, name)
        _unpack(archive, target, manifest, address or manifest.address)
        archive.unlink()
    except OSError as error:
        raise MotionKitError(
            f"{error.filename or above}: cannot be written: {error.strerror or error}; is the folder yours, and has it "
            f"room for {_megabytes(manifest)} MB and the archive?"
        ) from None
    print(f"{name}: {len(manifest.files)} files, {_megabytes(manifest)} MB, all as published, in {target}")
    return target


def licence(manifest: Manifest) -> str:
    """What a person who gets the data must know, as lines to print.

    >>> print(licence(read_manifest("bandai-2")))
    bandai-2 is published under CC BY-NC 4.0: ...
    """
    about = manifest.about
    return (
        f"{manifest.name} is published under {about['licence']}: {about['terms']}\n"
        f"{about['owner']}; please cite {about['cite']}."
    )


def _megabytes(manifest: Manifest) -> int:
    return round(sum(size for size, _ in manifest.files.values()) / 1e6)


def _check_whole(target: Path, manifest: Manifest) -> None:
    """A MotionKitError unless each file is there with its size."""
    for place, (size, _) in manifest.files.items():
        path = target / place
        found = path.stat().st_size if path.is_file() else None
        if found != size:
            what = "no such file" if found is None else f"{found} bytes"
            raise MotionKitError(
                f"{path}: expected {size} bytes, as published; found {what}; move {target} "
                "out of the way and fetch again"
            )


def _download(address: str, above: Path, name: str) -> Path:
    """The archive as a hidden file in the folder; one that an earlier call left there whole is taken."""
    import logging

    import pooch

    archive = above / f".{name}.zip"
    log = pooch.get_logger()
    level = log.level
    log.setLevel(logging.WARNING)  # pooch would propose to pin the archive's hash, which changes
    try:
        pooch.retrieve(address, None, archive.name, above, downloader=Resuming(above / f".{name}.zip.part"))
    finally:
        log.setLevel(level)
    return archive


def _unpack(archive: Path, target: Path, manifest: Manifest, address: str) -> None:
    """All files of the manifest from the archive to `target`, or a MotionKitError and nothing there.

    What is in the way of a later try is removed: an archive that is not right, and a half-filled folder.
    """
    filling = target.with_name(f".{target.name}.unpacking")
    shutil.rmtree(filling, ignore_errors=True)
    try:
        _fill(archive, filling, manifest)
        record = {"name": manifest.name, "address": address, **manifest.about, "files": len(manifest.files)}
        write_atomic(filling / _RECORD, json.dumps(record, indent=1, ensure_ascii=False) + "\n")
        os.replace(filling, target)
    except MotionKitError:
        archive.unlink(missing_ok=True)
        raise
    finally:
        shutil.rmtree(filling, ignore_errors=True)


def _fill(archive: Path, folder: Path, manifest: Manifest) -> None:
    from tqdm.auto import tqdm

    try:
        with zipfile.ZipFile(archive) as opened:
            members = _members(opened, manifest)
            for place, member in tqdm(members, desc="checking and unpacking", unit="file", leave=False):
                path = folder / place
                path.parent.mkdir(parents=True, exist_ok=True)
                _copy(opened, member, path, *manifest.files[place])
    except MotionKitError as error:
        raise MotionKitError(f"{manifest.name}: {error}; fetch again, and nothing of this download is kept") from None
    except OSError:
        raise
    except UNREADABLE as error:
        raise MotionKitError(
            f"{manifest.name}: what was downloaded is no whole zip archive ({error}); fetch again, and nothing of this "
            "download is kept"
        ) from None


def _members(opened: zipfile.ZipFile, manifest: Manifest) -> list[tuple[str, zipfile.ZipInfo]]:
    """For each of the manifest's files its member; MotionKitError for one not there, and for an archive with tricks."""
    inside: dict[str, zipfile.ZipInfo] = {}
    for member in opened.infolist():
        parts = member.filename.replace("\\", "/").split("/")
        if ".." in parts or parts[0] == "" or ":" in parts[0]:
            raise MotionKitError(
                f"the archive has {member.filename!r}, which leads out of its folder; it is not the published one"
            )
        inside["/".join(parts[1:])] = member
    found = []
    for place, (size, _) in manifest.files.items():
        member = inside.get(f"{manifest.folder}/{place}")
        if member is None:
            raise MotionKitError(f"the archive has no {manifest.folder}/{place}")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise MotionKitError(f"{member.filename} is a link in the archive; expected a file")
        if member.file_size != size:
            raise MotionKitError(f"{member.filename} has {member.file_size} bytes in the archive; expected {size}")
        found.append((place, member))
    return found


def _copy(opened: zipfile.ZipFile, member: zipfile.ZipInfo, path: Path, size: int, digest: str) -> None:
    """One member to a file; MotionKitError if it is not what the manifest says. It never writes more than `size`."""
    with opened.open(member) as packed:
        data = packed.read(size + 1)
    if hashlib.sha256(data).hexdigest() != digest:
        raise MotionKitError(f"{member.filename} is not the published file: its SHA-256 is another")
    path.write_bytes(data)


_PIECE = 1 << 14  # bytes to write at once; so many may be lost when a connection breaks
_TRY_AGAIN = (408, 425, 429, 500, 502, 503, 504)  # answers that may be better a moment later


class _Broken(Exception):
    """The connection ended before the file did."""


@dataclass
class Resuming:
    """A downloader for `pooch.retrieve` that goes on where a broken connection stopped, also in another session.

    part: the file that holds what has come so far. tries: how often in a row nothing more may come before it gives up.
    pause: seconds before the second try; twice as many before each one after. patience: seconds to wait for an answer.

    >>> Resuming(Path("a.part"))("nowhere://a.zip", "a.zip", None)
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nowhere://a.zip: cannot be downloaded: No connection adapters ...
    """

    part: Path
    tries: int = 5
    pause: float = 1.0
    patience: float = 30.0

    def __call__(self, address: str, target: str | os.PathLike, _pooch: object) -> None:
        """Download to `target`; MotionKitError where the server refuses or the connection keeps breaking."""
        from requests import exceptions

        furthest, failures = self._size(), 0
        while True:
            try:
                self._go_on(address)
                break
            except exceptions.SSLError as error:
                raise MotionKitError(f"{address}: no safe connection to the server: {_reason(error)}") from None
            except (_Broken, exceptions.ConnectionError, exceptions.Timeout, exceptions.ChunkedEncodingError) as error:
                failures = 1 if self._size() > furthest else failures + 1
                furthest = max(furthest, self._size())
                self._wait(address, failures, error)
            except exceptions.RequestException as error:
                raise MotionKitError(f"{address}: cannot be downloaded: {_reason(error)}; mend the address") from None
        os.replace(self.part, target)

    def _wait(self, address: str, failures: int, error: Exception) -> None:
        have = f"{self._size() / 1e6:.1f} MB"
        if failures >= self.tries:
            raise MotionKitError(
                f"{address}: the download stopped after {have}, and {failures} tries in a row brought no more "
                f"({_reason(error)}); look at your connection and call fetch again: it goes on from {self.part}"
            ) from None
        seconds = self.pause * 2 ** (failures - 1)
        print(f"The connection broke after {have}; another try in {seconds:g} s.")
        time.sleep(seconds)

    def _size(self) -> int:
        return self.part.stat().st_size if self.part.exists() else 0

    def _go_on(self, address: str) -> None:
        """One request for what is missing; returns when the file is whole, raises _Broken where it ends before that."""
        import requests

        have = self._size()
        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
        with requests.get(address, headers=headers, stream=True, timeout=self.patience) as answer:
            if answer.status_code == 416:  # nothing is left after `have`: either it is whole, or it was another file
                if answer.headers.get("Content-Range", "").endswith(f"/{have}"):
                    return
                self.part.unlink()
                raise _Broken("what had come was no part of it")
            if answer.status_code in _TRY_AGAIN:
                raise _Broken(f"the server answered {answer.status_code} {answer.reason}")
            if answer.status_code not in (200, 206):
                raise MotionKitError(
                    f"{address}: the server answered {answer.status_code} {answer.reason}; open the address in a "
                    "browser, and if the data have moved, get them by hand"
                )
            if answer.status_code == 200:  # not every server sends parts
                have = 0
            elif not answer.headers.get("Content-Range", "").startswith(f"bytes {have}-"):
                self.part.unlink(missing_ok=True)
                raise _Broken("the server sent another part than was asked for")
            self._save(answer, have)

    def _save(self, answer, have: int) -> None:
        """Append what comes to the first `have` bytes."""
        from tqdm.auto import tqdm

        length = answer.headers.get("Content-Length", "")
        total = have + int(length) if length.isdigit() else None
        with (
            open(self.part, "ab" if have else "wb") as file,
            tqdm(total=total, initial=have, unit="B", unit_scale=True, desc="downloading", leave=False) as progress,
        ):
            for piece in answer.iter_content(_PIECE):
                progress.update(file.write(piece))
        if total is not None and self._size() != total:
            raise _Broken(f"{self._size()} of {total} bytes came")


def _reason(error: Exception) -> str:
    """The innermost message of an error, which says what happened."""
    while error.__cause__ or error.__context__:
        error = error.__cause__ or error.__context__
    return str(error) or type(error).__name__
