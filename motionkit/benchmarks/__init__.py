"""Measurements that README, docs and notebooks quote: a module a benchmark, from which `results/NAME.json` is written.

    make bench NAME=few_shot                                 (or: python -m motionkit.benchmarks few_shot)
    make bench NAME=style_erd ONLY="network_ms whole_ms"     (these figures alone; the others stay as they were)

`@figure` and `@table` say what a function measures; `mk.results("few-shot")` reads what was measured. Some need the
captures of Bandai-2 (MOTIONKIT_DATA, or ../shared/datasets), and say so.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import torch

from .. import datasets
from ..arena import Protocol
from ..arena import run as run_arena
from ..errors import MotionKitError

ROOT = Path(__file__).resolve().parent.parent.parent
BASELINES = ("knn-dtw", "linear", "statistics")  # the methods to beat; the two copies only show the ends


@dataclass(frozen=True)
class Entry:
    """A figure or a table of a benchmark: its name, the function that measures it, and what makes its JSON."""

    name: str
    kind: str  # "figures" or "tables"
    measure: Callable[[], object]
    to_json: Callable[[object], object]  # from what `measure` returned; None where nothing was measured


_ENTRIES: dict[str, list[Entry]] = {}


def entries(module: str) -> list[Entry]:
    """Figures and tables that the functions of a module measure, in the order of its text."""
    return list(_ENTRIES.get(module, []))


def _register(name: str, kind: str, to_json: Callable[[object], object]) -> Callable:
    """A decorator that adds an entry; those of one function run from the last to the first, and go in front."""

    def decorate(measure: Callable[[], object]) -> Callable[[], object]:
        listed = _ENTRIES.setdefault(measure.__module__, [])
        if name in (entry.name for entry in listed):
            raise MotionKitError(f"{measure.__module__} measures {name!r} twice; give one another name")
        place = next((n for n, entry in enumerate(listed) if entry.measure is measure), len(listed))
        listed.insert(place, Entry(name, kind, measure, to_json))
        return measure

    return decorate


def figure(
    name: str, *, unit: str = "", note: str = "", at_least: float | None = None, at_most: float | None = None
) -> Callable:
    """The decorated function measures a figure, which should be at least, or at most, so much.

    It returns a number, or a number and a note that takes the place of `note`; or, under several decorators, a dict of
    what each is to get, by name (a name that is left out cannot be measured here). Raises MotionKitError unless one of
    both limits is given.

    >>> @figure("answer", unit="s", note="of two runs", at_most=50)
    ... def answer():
    ...     return 42.0
    >>> entries(answer.__module__)[-1].to_json(answer())
    {'value': 42.0, 'target': 50, 'met': True, 'unit': 's', 'note': 'of two runs'}
    """
    if (at_least is None) == (at_most is None):
        raise MotionKitError(f"figure {name!r}: say at_least or at_most; found {at_least} and {at_most}")

    def to_json(outcome: object) -> dict | None:
        outcome = outcome.get(name) if isinstance(outcome, dict) else outcome
        if outcome is None:
            return None
        value, about = outcome if isinstance(outcome, tuple) else (outcome, note)
        value = float(f"{value:.3g}")
        target, met = (at_most, value <= at_most) if at_least is None else (at_least, value >= at_least)
        return {"value": value, "target": target, "met": met, "unit": unit, "note": about}

    return _register(name, "figures", to_json)


def table(name: str, **columns: str) -> Callable:
    """The decorated function returns the rows of a table, dicts; under several decorators as `figure` says.

    columns: what is alike in all rows. Every row must name its method and its dataset, there or by itself;
    MotionKitError where one does not.

    >>> @table("sizes", method="kit", dataset="actor")
    ... def sizes():
    ...     return [{"size": 1}, {"size": 2, "method": "other"}]
    >>> entries(sizes.__module__)[-1].to_json(sizes())[1]
    {'method': 'other', 'dataset': 'actor', 'size': 2}
    """

    def to_json(outcome: Sequence[dict] | dict) -> list[dict] | None:
        rows = outcome.get(name) if isinstance(outcome, dict) else outcome
        if rows is None:
            return None
        for number, row in enumerate(rows):
            missing = {"method", "dataset"} - {*columns, *row}
            if missing:
                raise MotionKitError(f"table {name!r}: row {number} has no {' and no '.join(sorted(missing))}")
        return [{"method": None, "dataset": None} | columns | row for row in rows]

    return _register(name, "tables", to_json)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Torch computes on so many threads; also a decorator."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def median_seconds(call: Callable[[], object], times: int = 7, warm: int = 2) -> float:
    """The median time of a call, after some to warm up."""
    seconds = []
    for _ in range(warm + times):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[warm:])


def run_python(code: str, *arguments: str, cache_at: Path | None = None) -> tuple[list[float], float]:
    """A script in a process of its own: the numbers it prints, and the most memory of it and its children, GB."""
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "script.py"
        script.write_text(code)
        process = subprocess.Popen(
            [sys.executable, str(script), *arguments],
            env={**os.environ, "PYTHONPATH": str(ROOT), "MOTIONKIT_CACHE": str(cache_at or folder)},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        peak = 0.0
        while process.poll() is None:
            peak = max(peak, resident_bytes(process.pid) / 1e9)
            time.sleep(0.05)
        numbers = [float(word) for word in process.communicate()[0].split()]
    if process.returncode or not numbers:
        raise MotionKitError(f"a measured script ended with {process.returncode}, and printed {numbers}")
    return numbers, peak


def resident_bytes(process: int) -> int:
    """Memory of a process and all below it, pages that they share counted for each; 0 where there is no /proc."""
    parents, pages = {}, {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            pages[int(entry.name)] = int((entry / "statm").read_text().split()[1])
        except (OSError, ValueError, IndexError):
            continue  # it has just ended
    family = {process}
    while children := {child for child, parent in parents.items() if parent in family} - family:
        family |= children
    return sum(pages.get(member, 0) for member in family) * 4096


def captures_root() -> str:
    """The archive or the folder of the captures."""
    folder = os.environ.get("MOTIONKIT_DATA") or ROOT.parent / "shared" / "datasets"
    archives = sorted(Path(folder).glob("Bandai*.zip")) if Path(folder).is_dir() else []
    return str(archives[0] if archives else folder)


@cache
def captures() -> datasets.Dataset:
    """Bandai-2 whole; MotionKitError says what to do where it is not there."""
    return datasets.load("bandai-2", captures_root())


def compare(methods: Mapping, split: datasets.Split, protocol: Protocol, **more) -> dict[str, dict]:
    """The arena's rows by method, printed as a table; more: what `mk.arena.run` takes beside."""
    results = run_arena(methods, split, protocol, **more)
    print(results, flush=True)
    return {row["method"]: row for row in results.records()}
