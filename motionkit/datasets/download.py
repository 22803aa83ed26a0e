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
from .sources import UNREADABLE, data_folder

MANIFESTS = Path(__file__).parent / "manifests"


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
    fields = json.loads(gzip.decompress((MANIFESTS / f"{name}.json.gz").read_bytes()))
    return Manifest(**fields | {"files": {place: tuple(facts) for place, facts in fields["files"].items()}})


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
    megabytes = round(sum(size for size, _ in manifest.files.values()) / 1e6)
    above = Path(folder).expanduser() if folder is not None else data_folder()
    target, address, about = above / name, address or manifest.address, manifest.about
    print(f"{name} is published under {about['licence']}: {about['terms']}")
    print(f"{about['owner']}; please cite {about['cite']}.")
    if target.exists():
        _check_sizes(target, manifest)
        print(f"{name} is in {target} already.")
        return target
    try:
        if above.exists() and not above.is_dir():
            raise MotionKitError(f"{above}: expected a folder to put {name} in; found a file; give fetch a folder=")
        above.mkdir(parents=True, exist_ok=True)
        archive = above / f".{name}.zip"
        _download(address, archive)
        _unpack(archive, target, manifest, address)
        archive.unlink()
    except OSError as error:
        raise MotionKitError(
            f"{error.filename or above}: cannot be written: {error.strerror or error}; is the folder yours, and has it "
            f"room for {megabytes} MB and the archive?"
        ) from None
    print(f"{name}: {len(manifest.files)} files, {megabytes} MB, all as published, in {target}")
    return target


def _check_sizes(target: Path, manifest: Manifest) -> None:
    """A MotionKitError unless each file is there with its size."""
    for place, (size, _) in manifest.files.items():
        path = target / place
        found = f"{path.stat().st_size} bytes" if path.is_file() else "no such file"
        if found != f"{size} bytes":
            raise MotionKitError(
                f"{path}: expected {size} bytes, as published; found {found}; move {target} out of the way and fetch "
                "again"
            )


def _unpack(archive: Path, target: Path, manifest: Manifest, address: str) -> None:
    """All files of the manifest from the archive to `target`; or a MotionKitError, nothing there, and no archive."""
    from tqdm.auto import tqdm

    filling = target.with_name(f".{target.name}.unpacking")
    shutil.rmtree(filling, ignore_errors=True)
    try:
        with zipfile.ZipFile(archive) as opened:
            members = _members(opened, manifest)
            for place, member in tqdm(members.items(), desc="checking and unpacking", unit="file", leave=False):
                _copy(opened, member, filling / place, *manifest.files[place])
        record = {"name": manifest.name, "address": address, **manifest.about, "files": len(manifest.files)}
        (filling / "source.json").write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        os.replace(filling, target)
    except OSError:  # the disk's fault, not the archive's
        raise
    except UNREADABLE as error:
        archive.unlink()
        fault = error if isinstance(error, MotionKitError) else f"what was downloaded is no whole zip archive ({error})"
        raise MotionKitError(f"{manifest.name}: {fault}; fetch again, and nothing of this download is kept") from None
    finally:
        shutil.rmtree(filling, ignore_errors=True)


def _members(opened: zipfile.ZipFile, manifest: Manifest) -> dict[str, zipfile.ZipInfo]:
    """For each of the manifest's files its member; MotionKitError for one not there, and for an archive with tricks."""
    inside: dict[str, zipfile.ZipInfo] = {}
    for member in opened.infolist():
        parts = member.filename.replace("\\", "/").split("/")
        if ".." in parts or parts[0] == "" or ":" in parts[0]:
            raise MotionKitError(
                f"the archive has {member.filename!r}, which leads out of its folder; it is not the published one"
            )
        inside["/".join(parts[1:])] = member
    members = {place: inside.get(f"{manifest.folder}/{place}") for place in manifest.files}
    for place, member in members.items():
        if member is None:
            raise MotionKitError(f"the archive has no {manifest.folder}/{place}")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise MotionKitError(f"{member.filename} is a link in the archive; expected a file")
        if member.file_size != manifest.files[place][0]:
            raise MotionKitError(
                f"{member.filename} has {member.file_size} bytes in the archive; expected {manifest.files[place][0]}"
            )
    return members


def _copy(opened: zipfile.ZipFile, member: zipfile.ZipInfo, path: Path, size: int, digest: str) -> None:
    """One member to a file; MotionKitError if it is not what the manifest says. It never reads more than `size` + 1."""
    with opened.open(member) as packed:
        data = packed.read(size + 1)
    if hashlib.sha256(data).hexdigest() != digest:
        raise MotionKitError(f"{member.filename} is not the published file: its SHA-256 is another")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


_PIECE = 1 << 14  # bytes to write at once; so many may be lost when a connection breaks
_PATIENCE = 30.0  # seconds to wait for an answer
_TRIES = 5  # how often in a row nothing more may come before it is given up
_TRY_AGAIN = (408, 425, 429, 500, 502, 503, 504)  # answers that may be better a moment later


class _Broken(Exception):
    """The connection ended before the file did."""


def _download(address: str, archive: Path) -> None:
    """Get the archive, if no earlier call has; what came before a connection broke is kept in a file beside it.

    MotionKitError where the server refuses or the connection keeps breaking; the next call goes on from there.
    """
    from requests import exceptions

    part = archive.with_name(f"{archive.name}.part")
    size, failures = _size(part), 0
    while not archive.exists():
        try:
            _continue(address, part)
            os.replace(part, archive)
        except exceptions.SSLError as error:
            raise MotionKitError(f"{address}: no safe connection to the server: {_reason(error)}") from None
        except (_Broken, exceptions.ConnectionError, exceptions.Timeout, exceptions.ChunkedEncodingError) as error:
            failures = 1 if _size(part) > size else failures + 1
            size = max(size, _size(part))
            came = f"{_size(part) / 1e6:.1f} MB"
            if failures == _TRIES:
                raise MotionKitError(
                    f"{address}: the download stopped after {came}, and {failures} tries in a row brought no more "
                    f"({_reason(error)}); look at your connection and call fetch again: it goes on from {part}"
                ) from None
            print(f"The connection broke after {came}; another try in {2 ** (failures - 1)} s.")
            time.sleep(2 ** (failures - 1))
        except exceptions.RequestException as error:
            raise MotionKitError(f"{address}: cannot be downloaded: {_reason(error)}; mend the address") from None
        finally:
            if part.exists() and not _size(part):
                part.unlink()


def _continue(address: str, part: Path) -> None:
    """One request for what is missing of `part`; returns when that is whole, raises _Broken where less came.

    pooch writes what comes. Before that, a look at the answer makes it go on at the right place.
    """
    import pooch
    from tqdm.auto import tqdm

    with open(part, "ab") as file, tqdm(total=1, desc="downloading", unit="B", unit_scale=True, leave=False) as bar:
        have, whole = file.tell(), None

        def begin(answer, **_) -> None:
            nonlocal whole
            said = f"the server answered {answer.status_code} {answer.reason}"
            if answer.status_code in _TRY_AGAIN:
                raise _Broken(said)
            if answer.status_code >= 400 and answer.status_code != 416:
                raise MotionKitError(
                    f"{address}: {said}; open the address in a browser, and if the data have moved, get them by hand"
                )
            if answer.is_redirect:
                return
            if not answer.headers.get("Content-Range", "").startswith(f"bytes {have}-"):
                file.truncate(0)  # not every server sends parts: then all comes again
                if answer.status_code != 200:
                    raise _Broken("the server has another file, or sent another part than was asked for")
            length = answer.headers.get("Content-Length", "")
            whole = file.seek(0, os.SEEK_END) + int(length) if length.isdigit() else None

        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
        request = {"headers": headers, "hooks": {"response": begin}, "timeout": _PATIENCE}
        pooch.HTTPDownloader(bar, _PIECE, **request)(address, file, None)
        if whole is not None and file.tell() != whole:
            raise _Broken(f"{file.tell()} of {whole} bytes came")


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _reason(error: Exception) -> str:
    """The innermost message of an error, which says what happened."""
    while error.__cause__ or error.__context__:
        error = error.__cause__ or error.__context__
    return str(error) or type(error).__name__
