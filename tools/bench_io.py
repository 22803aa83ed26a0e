"""Measure reading, forward kinematics, import and datasets, beside pymotion, into results/io.json.

    make bench-io        (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

Every time is the least of several runs, ours and pymotion's in turn, so that a busy machine harms both alike.
pymotion is installed into a temporary folder for this run only.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import torch

import motionkit as mk
from bench import ROOT, figure, find_root, run_python, write_result

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
    items = mk.datasets.list_items("bandai-2", root)
    chosen = items[:: len(items) // CLIPS]
    ours = theirs = size = 0.0
    for item in chosen:
        path = folder / f"{item.name}.bvh"
        path.write_bytes(item.source.data())
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
    skeleton = mk.load(ROOT / "data" / "actor" / "walk_neutral.bvh").skeleton
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


def main() -> int:
    """Measure everything, print it and write results/io.json."""
    start, root = time.perf_counter(), find_root()
    try:
        mk.datasets.list_items("bandai-2", root)
    except mk.MotionKitError as error:
        print(error)
        return 1
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
    write_result(RESULT, "make bench-io", start, figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
