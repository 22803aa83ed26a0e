"""What the benchmarks share: lines of results files, measured processes, and where the captures are."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from motionkit import datasets
from motionkit.checkpoints import hardware
from motionkit.datasets import Dataset
from motionkit.errors import MotionKitError

ROOT = Path(__file__).resolve().parent.parent


def figure(value: float, target: float, unit: str, note: str, more_is_better: bool = True) -> dict:
    """One line of a results file."""
    value = float(f"{value:.3g}")
    met = value >= target if more_is_better else value <= target
    return {"value": value, "target": target, "met": met, "unit": unit, "note": note}


def run_python(code: str, *arguments: str, cache: Path | None = None) -> tuple[list[float], float]:
    """A script in a process of its own: the numbers it prints, and the most memory of it and its children, GB."""
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "script.py"
        script.write_text(code)
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "MOTIONKIT_CACHE": str(cache or folder)}
        process = subprocess.Popen(
            [sys.executable, str(script), *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        peak = 0.0
        while process.poll() is None:
            peak = max(peak, resident_bytes(process.pid) / 1e9)
            time.sleep(0.05)
        numbers = [float(word) for word in process.stdout.read().split()]
    assert process.returncode == 0 and numbers, f"a measured script ended with {process.returncode}"
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
    while more := {child for child, parent in parents.items() if parent in family} - family:
        family |= more
    return sum(pages.get(member, 0) for member in family) * 4096


def find_root() -> str:
    """The archive or the folder of the captures."""
    given = os.environ.get("MOTIONKIT_DATA") or ROOT.parent / "shared" / "datasets"
    archives = sorted(Path(given).glob("Bandai*.zip")) if Path(given).is_dir() else []
    return str(archives[0] if archives else given)


def captures() -> Dataset:
    """Bandai-2 whole; where it is not there the benchmark ends, and says what to do."""
    try:
        return datasets.load("bandai-2", find_root())
    except MotionKitError as error:
        sys.exit(str(error))


def write_result(path: Path, command: str, start: float, figures: dict, tables: dict | None = None) -> None:
    """Write a results file, and print its figures. start: `time.perf_counter()` when the measuring began."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True
    ).stdout.strip()
    result = {
        "command": command,
        "commit": commit or "unknown",
        "hardware": hardware(),
        "seed": 0,
        "seconds": round(time.perf_counter() - start, 1),
        "figures": figures,
    }
    if tables:
        result["tables"] = tables
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(result, indent=2) + "\n")
    for key, line in figures.items():
        sign = "met   " if line["met"] else "MISSED"
        print(f"{sign} {key:26s} {line['value']:>12,g} {line['unit']} (target {line['target']:,}; {line['note']})")
