"""Reading and writing files so that nothing is ever left half-written; `results`, what the benchmarks measured."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
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


@dataclass(frozen=True, repr=False)
class Results:
    """What a benchmark measured, from `results/NAME.json`.

    run: command, commit, hardware, seed and seconds of the measurement; `other_runs` lists what was measured by others.
    figures: by name, each a dict with value, target, met, unit and note. tables: by name, lists of rows, each a dict
    that names its method and its dataset. Accuracies are in per cent.

    >>> from motionkit import results
    >>> results("io")
    Results('io', measured at ..., 8 figures, 0 tables)
    """

    name: str
    run: dict
    figures: dict[str, dict]
    tables: dict[str, list[dict]]

    def figure(self, name: str) -> float:
        """The value of a figure, in the unit that `figures` gives; MotionKitError names the figures that there are."""
        return self._entry("figure", self.figures, name)["value"]

    def table(self, name: str) -> list[dict]:
        """The rows of a table; MotionKitError names the tables that there are."""
        return self._entry("table", self.tables, name)

    def run_of(self, name: str) -> dict:
        """Command, commit, hardware, seed and seconds of the run that measured a figure or a table.

        Raises MotionKitError for names that are none.
        """
        self._entry("figure or table", self.figures | self.tables, name)
        return next((run for run in self.run.get("other_runs", []) if name in run["entries"]), self.run)

    def _entry(self, kind: str, entries: dict, name: str):
        if name not in entries:
            raise MotionKitError(
                f"results {self.name!r} have no {kind} {name!r}; they have {', '.join(entries) or 'none'}"
            )
        return entries[name]

    def __repr__(self) -> str:
        counts = f"{len(self.figures)} figures, {len(self.tables)} tables"
        return f"Results({self.name!r}, measured at {self.run['commit']}, {counts})"

    def _repr_html_(self) -> str:
        rows = ""
        for name, figure in self.figures.items():
            sign, unit = "✓" if figure["met"] else "✗", escape(figure["unit"])
            cells = (escape(name), f"{figure['value']:,g} {unit}", f"{sign} {figure['target']:,g} {unit}")
            rows += f"<tr>{''.join(f'<td>{cell}</td>' for cell in (*cells, escape(figure['note'])))}</tr>"
        head = "<tr><th>figure</th><th>value</th><th>target</th><th>what</th></tr>"
        foot = f"{self.run['command']}, commit {self.run['commit']}, {self.run['hardware']}"
        tables = f"; tables: {', '.join(self.tables)}" if self.tables else ""
        return f"<table>{head}{rows}</table><p>{escape(foot + tables)}</p>"


def results(name: str, folder: str | os.PathLike | None = None) -> Results:
    """What a benchmark measured: the numbers that README, docs and notebooks quote.

    name: such as "few-shot". folder: of the JSON files; left out, `results/` beside the package. Raises MotionKitError
    for a benchmark without results, and for a file that holds none.

    >>> results("io").figure("import_seconds") < 0.3
    True
    """
    folder = Path(__file__).resolve().parent.parent / "results" if folder is None else Path(folder)
    names = sorted(path.stem for path in folder.glob("*.json"))
    if name not in names:
        hint = "They come with the repository, and `make bench NAME=io` measures"
        raise MotionKitError(f"no results {name!r} in {folder}; there are: {', '.join(names) or 'none'}. {hint}")
    try:
        run = json.loads(read_bytes(folder / f"{name}.json"))
        return Results(name, figures=run.pop("figures"), tables=run.pop("tables"), run=run)
    except (ValueError, KeyError, TypeError) as error:
        raise MotionKitError(f"{folder / name}.json: not the results of a benchmark ({error!r})") from None
