"""Reading, forward kinematics, import and datasets, beside pymotion: `make bench NAME=io`.

Every time is the least of several runs, ours and pymotion's in turn, so that a busy machine harms both alike. pymotion
is installed into a temporary folder for this run only. Needs the captures.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import torch

import motionkit as mk

from . import ROOT, captures_root, figure, run_python, threads

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


@cache
def install_pymotion() -> None:
    """pymotion, where Python finds it until this process ends."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", folder.name, PYMOTION], check=True
    )
    sys.path.insert(0, folder.name)


def least_seconds(*functions: Callable[[], object], rounds: int = ROUNDS) -> list[float]:
    """The least time of each function, taken in turn."""
    least = [float("inf")] * len(functions)
    for _ in range(rounds):
        for n, function in enumerate(functions):
            start = time.perf_counter()
            function()
            least[n] = min(least[n], time.perf_counter() - start)
    return least


@figure("bvh_read_mb_per_s", at_least=40, unit="MB/s")
@figure("bvh_read_times_pymotion", at_least=3, unit="times")
@threads(1)
def reading() -> dict:
    """BVH files to motions, one thread: megabytes a second, ours and pymotion's."""
    items = mk.datasets.list_items("bandai-2", captures_root())
    install_pymotion()
    from pymotion.io.bvh import BVH

    chosen = items[:: len(items) // CLIPS]
    ours = theirs = megabytes = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for item in chosen:
            path = Path(folder, f"{item.name}.bvh")
            path.write_bytes(item.source.data())
            least = least_seconds(lambda p=path: mk.load(p), lambda p=path: BVH().load(str(p)))
            ours, theirs, megabytes = ours + least[0], theirs + least[1], megabytes + path.stat().st_size / 1e6
    note = f"pymotion {megabytes / theirs:.3g} in the same run; {len(chosen)} clips of {megabytes:.1f} MB in all"
    return {
        "bvh_read_mb_per_s": (megabytes / ours, f"{note}, one thread"),
        "bvh_read_times_pymotion": (theirs / ours, note),
    }


@figure("fk_frames_per_s", at_least=1_000_000, unit="frames/s")
@figure("fk_times_pymotion", at_least=2.46, unit="times")  # 1,000,000 / 406,000
@threads(2)
def kinematics() -> dict:
    """Local rotations to positions, float32, two threads: frames a second, ours and pymotion's."""
    install_pymotion()
    from pymotion.ops.skeleton_torch import fk

    skeleton = mk.load(ROOT / "data" / "actor" / "walk_neutral.bvh").skeleton
    generator = torch.Generator().manual_seed(0)
    rotations = torch.randn(FRAMES, len(skeleton), 4, generator=generator)
    rotations = torch.nn.functional.normalize(rotations, dim=-1)
    root = torch.randn(FRAMES, 3, generator=generator)
    motion = mk.Motion.from_root(skeleton, rotations, root, fps=30)
    parents = torch.tensor([max(p, 0) for p in skeleton.parents])  # pymotion's root is its own parent
    offsets = skeleton.offsets.clone()
    offsets[0] = 0  # pymotion adds it to the root's position
    difference = (fk(rotations, root, offsets, parents)[0] - motion.positions()).abs().max()
    assert difference < 1e-4, f"the two disagree by {difference} m"
    ours, theirs = least_seconds(motion.positions, lambda: fk(rotations, root, offsets, parents), rounds=30)
    note = f"pymotion's torch version {FRAMES / theirs:,.0f} in the same run; {FRAMES} frames x {len(skeleton)} joints"
    return {
        "fk_frames_per_s": (FRAMES / ours, f"{note}, float32, 2 threads"),
        "fk_times_pymotion": (theirs / ours, note),
    }


@figure(
    "import_seconds",
    at_most=0.3,
    unit="s",
    note="import motionkit, beyond torch's own import; least of 7 processes",
)
def importing() -> float:
    """Seconds that `import motionkit` takes."""
    return min(run_python(IMPORT)[0][0] for _ in range(7))


@figure("all_clips_seconds", at_most=12, unit="s")
@figure("cached_load_seconds", at_most=1, unit="s", note="the same, from the memory-mapped cache")
@figure("all_clips_peak_gb", at_most=1.5, unit="GB", note="all processes together, shared pages counted for each")
def loading() -> dict:
    """All clips read, then read again from the cache; and the memory that took."""
    root = captures_root()
    mk.datasets.list_items("bandai-2", root)  # says what to do where there are none
    with tempfile.TemporaryDirectory() as folder:
        caches = [Path(folder, f"cache{n}") for n in range(2)]
        runs = [run_python(LOAD, root, cache_at=place) for place in caches]
        again = [run_python(LOAD, root, cache_at=caches[-1])[0][0] for _ in range(3)]
    source = "the zip" if root.endswith(".zip") else "files"
    note = f"{runs[0][0][1]:.0f} clips from {source}, joblib, {os.cpu_count()} cores, written to the cache"
    figures = {
        "all_clips_seconds": (min(numbers[0] for numbers, _ in runs), note),
        "cached_load_seconds": min(again),
    }
    peak = max(gigabytes for _, gigabytes in runs)
    return figures | ({"all_clips_peak_gb": peak} if peak else {})
