"""Measure the arena, and the methods to beat on two data sets, into results/arena-baselines.json.

make bench-arena        (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

The tables are those of `mk.arena.run(mk.methods.BASELINES, "actor", "paper-1")` and the same on bandai-2; a run that is
stopped goes on where it was.
"""

import sys
import tempfile
import time
from pathlib import Path

import motionkit as mk
from bench import ROOT, captures, figure, run_python, write_result
from motionkit.arena import PROTOCOLS
from motionkit.files import cache_folder

RESULT = ROOT / "results" / "arena-baselines.json"
COUNT, FRAMES = 3780, 120
# Noise over the content, on clips cut to one length: made in one process, measured in another, whose time counts.
MEASURE = """
import shutil, sys, time
from dataclasses import dataclass
from pathlib import Path
import torch, motionkit as mk
from motionkit.datasets import Item, Recording, from_items

folder, count, frames, measured = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4] == "measure"

@dataclass(frozen=True)
class Cut:
    clip: mk.datasets.Clip
    state: str = "cut"
    def read(self):
        return Recording(self.clip.motion[:frames])

def noisy(content, style):
    moves = content.translations.clone()
    moves[:, 0] += 0.002 * torch.randn(len(content), 3)
    return content.replace(translations=moves)

if __name__ == "__main__":
    clips = [c for c in mk.datasets.load("actor") if c.split != "validation"]
    clips = of_items("cut", [Item(c.name, c.labels, Cut(c)) for c in clips])
    if measured:
        for place in Path(folder).rglob("measures-*"):
            shutil.rmtree(place)
        for path in Path(folder).rglob("clips-*"):
            path.unlink()
    start = time.perf_counter()
    split = clips.split("given")
    table = mk.arena.run([noisy], split, mk.arena.Protocol("bench", most=count), folder=folder, judge="actor")
    print(time.perf_counter() - start, len(table.results("noisy")), len(table["noisy"].failed))
"""
SMALL = """
import sys, time, motionkit as mk
if __name__ == "__main__":
    mk.datasets.load("actor")
    start = time.perf_counter()
    table = mk.arena.run(mk.methods.BASELINES, "actor", "small", folder=sys.argv[1])
    print(time.perf_counter() - start, len(table.rows) - 1, sum(len(row.failed) for row in table.rows))
"""


def measuring(folder: Path) -> dict:
    """Seconds and memory of measuring so many results."""
    arguments = (str(folder), str(COUNT), str(FRAMES))
    run_python(MEASURE, *arguments, "make", cache=cache_folder())
    (seconds, count, failed), peak = run_python(MEASURE, *arguments, "measure", cache=cache_folder())
    assert (count, failed) == (COUNT, 0), f"{count:.0f} results, {failed:.0f} failed"
    note = f"{COUNT:,} results of {FRAMES} frames, all figures with intervals, and the test and training clips"
    figures = {"measuring_seconds": figure(seconds, 120, "s", note, False)}
    if peak:
        figures["measuring_peak_gb"] = figure(peak, 2, "GB", "all processes, shared pages counted for each", False)
    return figures


def small(folder: Path) -> dict:
    """Seconds of the small protocol with all methods, nothing kept from before."""
    (seconds, methods, failed), _ = run_python(SMALL, str(folder), cache=cache_folder())
    note = f"{methods:.0f} methods, made and measured from nothing, {failed:.0f} transfers failed"
    return {"small_seconds": figure(seconds, 60, "s", note, False)}


def main() -> int:
    """Measure everything and write results/arena-baselines.json."""
    start, captured = time.perf_counter(), captures().split()
    with tempfile.TemporaryDirectory() as folder:
        figures = measuring(Path(folder, "measuring")) | small(Path(folder, "small"))
    count = len(PROTOCOLS["paper-1"].transfers(captured.test))
    figures["bandai_transfers"] = figure(count, 3780, "transfers", "paper 1, section 5.2, names this number")
    tables = [mk.arena.run(mk.methods.BASELINES, data, "paper-1") for data in ("actor", captured)]
    for table in tables:
        print(table, end="\n\n")
    kept = {table.provenance["dataset"]: table.records() for table in tables}
    write_result(RESULT, "make bench-arena", start, figures, {**kept, "provenance": [t.provenance for t in tables]})
    return 0


if __name__ == "__main__":
    sys.exit(main())
