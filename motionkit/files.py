"""Reading and writing files so that nothing is ever left half-written."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import MotionKitError


class MotionKitWarning(UserWarning):
    """Something in a file that was read or written, but that its owner should know of."""


def read_bytes(path: str | os.PathLike) -> bytes:
    """The bytes of a file; a MotionKitError that says what is wrong if it cannot be read.

    >>> read_bytes("nowhere.bvh")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nowhere.bvh: no such file; check the path (working folder and spelling)
    """
    if not isinstance(path, str | os.PathLike) or not str(path):
        raise MotionKitError(f"expected the path of a file; found {path!r}")
    try:
        return Path(path).expanduser().read_bytes()
    except FileNotFoundError:
        raise MotionKitError(f"{path}: no such file; check the path (working folder and spelling)") from None
    except IsADirectoryError:
        raise MotionKitError(f"{path}: this is a folder; give one file in it") from None
    except (OSError, ValueError) as error:
        raise MotionKitError(f"{path}: cannot be read: {error}") from None


@contextmanager
def open_atomic(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """A binary file to write to, which takes the place of `path` once all is written, or leaves nothing.

    Raises MotionKitError if the folder does not exist or cannot be written.

    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open_atomic(Path(folder) / "a.bin") as file:
    ...         written = file.write(b"12345")
    ...     (Path(folder) / "a.bin").stat().st_size
    5
    """
    path = target(path)
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name[:40]}.", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            yield file
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)  # mkstemp makes private files; a result should be readable as usual
        os.replace(temporary, path)
    except OSError as error:
        message = f"{path}: cannot be written: {error.strerror or error}; is the folder yours, and has it room?"
        raise MotionKitError(message) from None
    finally:
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)


def target(path: str | os.PathLike) -> Path:
    """A path that a file can be written to; MotionKitError says why not."""
    if not isinstance(path, str | os.PathLike) or not str(path):
        raise MotionKitError(f"expected the path of a file to write; found {path!r}")
    path = Path(path)
    if path.is_dir():
        raise MotionKitError(f"{path}: cannot be written: this is a folder; give a file in it")
    if not path.parent.is_dir():
        raise MotionKitError(f"{path}: cannot be written: there is no folder {path.parent}; make it first")
    return path


def write_atomic(path: str | os.PathLike, content: str | bytes) -> Path:
    """Write a whole file or nothing: to a temporary file beside it, then renamed. Returns the path.

    Raises MotionKitError if the folder does not exist or cannot be written.

    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_atomic(Path(folder) / "a.txt", "hello").read_text()
    'hello'
    """
    with open_atomic(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)
    return Path(path)


def cache_folder() -> Path:
    """Where caches go: the environment variable MOTIONKIT_CACHE, or the system's usual place.

    >>> cache_folder().is_absolute()
    True
    """
    folder = os.environ.get("MOTIONKIT_CACHE")
    if folder:
        return Path(folder).expanduser()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "motionkit"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "motionkit"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "motionkit"
