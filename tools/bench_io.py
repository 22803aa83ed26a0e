"""Measure reading, forward kinematics, import and datasets, beside pymotion, into results/io.json.

    make bench-io        (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

Every time is the least of several runs, ours and pymotion's in turn, so that a busy machine harms both alike.
pymotion is installed into a temporary folder for this run only.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import torch

import motionkit as mk

ROOT = Path(__file__).resolve().parent.parent
RESULT = ROOT / "results" / "io.json"
PYMOTION = "upc-pymotion==0.3.4"
CLIPS, ROUNDS, FRAMES = 50, 5, 10_000

IMPORT = "import time, torch; t = time.perf_counter(); import motionkit; print(time.perf_counter() - t)"
LOAD = """
import sys, time, motionkit as mk
if __name__ == "__main__":
    t = time.perf_counter()
    ds = mk.datasets.load("bandai-2", sys.argv[1])
    frames = len(ds[0].motion)
    print(time.perf_counter() - t, len(ds), frames)
"""


def figure(value: float, target: float, unit: str, note: str, more_is_better: bool = True) -> dict:
    """One line of the results file."""
    value = float(f"{value:.3g}")
    met = value >= target if more_is_better else value <= target
    return {"value": value, "target": target, "met": met, "unit": unit, "note": note}


def least_seconds(*functions: Callable[[], object], rounds: int = ROUNDS) -> list[float]:
    """The least time of each function, taken in turn."""
    least = [float("inf")] * len(functions)
    for _ in range(rounds):
        for n, function in enumerate(functions):
            start = time.perf_counter()
            function()
            least[n] = min(least[n], time.perf_counter() - start)
    return least


def reading(root: str, folder: Path) -> dict:
    """BVH files to motions, one thread: megabytes a second, ours and pymotion's."""
    from pymotion.io.bvh import BVH

    torch.set_num_threads(1)
    items = mk.datasets.items_of("bandai-2", root)
    chosen = items[:: len(items) // CLIPS]
    ours = theirs = size = 0.0
    for item in chosen:
        path, source = folder / f"{item.name}.bvh", item.source
        if source.member is None:
            path.write_bytes(Path(source.path).read_bytes())
        else:
            with zipfile.ZipFile(source.path) as archive:
                path.write_bytes(archive.read(source.member))
        least = least_seconds(lambda p=path: mk.load(p), lambda p=path: BVH().load(str(p)))
        ours, theirs, size = ours + least[0], theirs + least[1], size + path.stat().st_size / 1e6
    note = f"pymotion {size / theirs:.3g} in the same run; {len(chosen)} clips of {size:.1f} MB in all"
    return {
        "bvh_read_mb_per_s": figure(size / ours, 40, "MB/s", note + ", one thread"),
        "bvh_read_times_pymotion": figure(theirs / ours, 3, "times", note),
    }


def kinematics() -> dict:
    """Local rotations to places, float32, two threads: frames a second, ours and pymotion's."""
    from pymotion.ops.skeleton_torch import fk

    torch.set_num_threads(2)
    skeleton = mk.load(ROOT / "data" / "walk_neutral.bvh").skeleton
    joints = len(skeleton)
    chance = torch.Generator().manual_seed(0)
    turns = torch.nn.functional.normalize(torch.randn(FRAMES, joints, 4, generator=chance), dim=-1)
    root = torch.randn(FRAMES, 3, generator=chance)
    motion = mk.Motion.from_root(skeleton, turns, root, fps=30)
    parents = torch.tensor([max(p, 0) for p in skeleton.parents])  # pymotion's root is its own parent
    offsets = skeleton.offsets.clone()
    offsets[0] = 0  # pymotion adds it to the root's place
    difference = (fk(turns, root, offsets, parents)[0] - motion.positions()).abs().max()
    assert difference < 1e-4, f"the two disagree by {difference} m"
    ours, theirs = least_seconds(motion.positions, lambda: fk(turns, root, offsets, parents), rounds=30)
    note = f"pymotion's torch version {FRAMES / theirs:,.0f} in the same run; {FRAMES} frames x {joints} joints"
    return {
        "fk_frames_per_s": figure(FRAMES / ours, 1_000_000, "frames/s", note + ", float32, 2 threads"),
        "fk_times_pymotion": figure(theirs / ours, 2.46, "times", note),  # 1,000,000 / 406,000,
    }


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


def datasets(root: str, folder: Path) -> dict:
    """All clips read, then read again from the cache; and the memory that took."""
    read = []
    for n in range(2):
        cache = folder / f"cache{n}"
        numbers, peak = run_python(LOAD, root, cache=cache)
        read.append((numbers[0], peak, int(numbers[1])))
    again = [run_python(LOAD, root, cache=cache)[0][0] for _ in range(3)]
    seconds, clips = min(r[0] for r in read), read[0][2]
    peak = max(r[1] for r in read)
    note = f"{clips} clips from {'the zip' if root.endswith('.zip') else 'files'}, joblib, {os.cpu_count()} cores"
    found = {
        "all_clips_seconds": figure(seconds, 12, "s", note + ", written to the cache", False),
        "cached_load_seconds": figure(min(again), 1, "s", "the same, from the memory-mapped cache", False),
    }
    if peak:
        memory = "all processes together, shared pages counted for each"
        found["all_clips_peak_gb"] = figure(peak, 1.5, "GB", memory, False)
    return found


def find_root() -> str:
    """The archive or the folder of the captures."""
    given = os.environ.get("MOTIONKIT_DATA") or ROOT.parent / "shared" / "datasets"
    archives = sorted(Path(given).glob("Bandai*.zip")) if Path(given).is_dir() else []
    return str(archives[0] if archives else given)


def main() -> int:
    """Measure everything, print it and write results/io.json."""
    start, root = time.perf_counter(), find_root()
    try:
        mk.datasets.items_of("bandai-2", root)
    except mk.MotionKitError as error:
        print(error)
        return 1
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True
    ).stdout.strip()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        target = folder / "pymotion"
        install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(target), PYMOTION]
        subprocess.run(install, check=True)
        sys.path.insert(0, str(target))
        figures = {**reading(root, folder), **kinematics()}
        imports = min(run_python(IMPORT)[0][0] for _ in range(7))
        note = "import motionkit, beyond torch's own import; least of 7 processes"
        figures["import_seconds"] = figure(imports, 0.3, "s", note, False)
        figures.update(datasets(root, folder))
    result = {
        "command": "make bench-io",
        "commit": commit or "unknown",
        "hardware": f"{os.cpu_count()} cores, {platform.machine()} CPU, torch {torch.__version__.split('+')[0]}",
        "seed": 0,
        "seconds": round(time.perf_counter() - start, 1),
        "figures": figures,
    }
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(result, indent=2) + "\n")
    for key, line in figures.items():
        sign = "met   " if line["met"] else "MISSED"
        print(f"{sign} {key:26s} {line['value']:>12,g} {line['unit']} (target {line['target']:,}; {line['note']})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
