"""The arena's speed, and the methods to beat on two data sets: `make bench NAME=arena`.

The tables are those of `mk.arena.run(mk.methods.BASELINES, "actor", "paper-1")` and the same on bandai-2 (which needs
the captures); a run that is stopped goes on where it was.
"""

from __future__ import annotations

import tempfile

import motionkit as mk

from ..arena import PROTOCOLS
from ..files import cache_folder
from . import captures, figure, run_python, table

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
    clips = from_items("cut", [Item(c.name, c.labels, Cut(c)) for c in clips])
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


@figure("measuring_seconds", at_most=120, unit="s")
@figure("measuring_peak_gb", at_most=2, unit="GB", note="all processes, shared pages counted for each")
def measuring() -> dict:
    """Seconds and memory of measuring so many results."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = (folder, str(COUNT), str(FRAMES))
        run_python(MEASURE, *arguments, "make", cache_at=cache_folder())
        (seconds, count, failed), peak = run_python(MEASURE, *arguments, "measure", cache_at=cache_folder())
    assert (count, failed) == (COUNT, 0), f"{count:.0f} results, {failed:.0f} failed"
    note = f"{COUNT:,} results of {FRAMES} frames, all figures with intervals, and the test and training clips"
    return {"measuring_seconds": (seconds, note)} | ({"measuring_peak_gb": peak} if peak else {})


@figure("small_seconds", at_most=60, unit="s")
def small() -> tuple[float, str]:
    """Seconds of the small protocol with all methods, no results at hand."""
    with tempfile.TemporaryDirectory() as folder:
        (seconds, methods, failed), _ = run_python(SMALL, folder, cache_at=cache_folder())
    return seconds, f"{methods:.0f} methods, made and measured from nothing, {failed:.0f} transfers failed"


@figure("bandai_transfers", at_least=3780, unit="transfers", note="paper 1, section 5.2, names this number")
def bandai_transfers() -> int:
    """How many transfers paper 1's protocol makes of the test part of Bandai-2."""
    return len(PROTOCOLS["paper-1"].transfers(captures().split().test))


@table("actor", dataset="actor")
@table("bandai-2", dataset="bandai-2")
@table("provenance", method="all")
def baselines() -> dict:
    """The methods to beat, on both data sets; and clips, protocol, seed and judge of both tables."""
    datasets = {"actor": "actor", "bandai-2": captures().split()}
    tables = {name: mk.arena.run(mk.methods.BASELINES, data, "paper-1") for name, data in datasets.items()}
    print(*tables.values(), sep="\n\n")
    rows = {name: result.records() for name, result in tables.items()}
    return rows | {"provenance": [result.provenance for result in tables.values()]}
