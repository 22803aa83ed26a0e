"""Measure reading windows from a corpus of a million frames: batches a second, and the memory they take.

    python tools/bench_corpus.py [FRAMES]        (needs 0.7 GB of disk for a moment)

`corpus_speed` returns the figures, for other benchmarks to write into their results.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import torch

import motionkit as mk
from motionkit.datasets import Item, Labels, Recording
from motionkit.skeleton import smpl

CLIP, WINDOW, BATCH, WARM, BATCHES = 1000, 64, 64, 20, 600


@dataclass(frozen=True)
class Noise:
    """A clip of random poses: reading does not care what the numbers are."""

    seed: int
    frames: int = CLIP

    @property
    def state(self) -> str:
        """Seed and size."""
        return f"{self.seed} {self.frames}"

    def read(self) -> Recording:
        """The clip, with contacts, so that none are looked for."""
        generator = torch.Generator().manual_seed(self.seed)
        skeleton = smpl()
        turns = torch.randn(self.frames, len(skeleton), 4, generator=generator)
        turns = torch.nn.functional.normalize(turns, dim=-1)
        path = torch.randn(self.frames, 3, generator=generator).cumsum(0)
        stands = torch.rand(self.frames, 4, generator=generator) > 0.5
        return Recording(mk.Motion.from_root(skeleton, turns, path, 30.0), {"contacts": stands})


def private_mb() -> float:
    """Megabytes that this process holds beyond files it has mapped; not a number where the system does not tell."""
    try:
        lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("Anonymous:")) / 1024
    except (OSError, StopIteration):
        return float("nan")


def corpus_speed(folder: str | Path, frames: int = 1_000_000, batches: int = BATCHES) -> dict[str, float]:
    """Make a corpus of `frames` frames in `folder`, read it in batches of 64 windows of 64 frames.

    Returns batches_per_s, memory_growth_mb (private memory at the end over that after the first 20 batches), frames,
    corpus_mb and making_frames_per_s.
    """
    items = [Item(f"clip_{n:06d}", Labels("walk", f"style {n % 8}", ()), Noise(n)) for n in range(frames // CLIP)]
    start = time.perf_counter()
    corpus = mk.datasets.build_cache(items, folder)
    making = time.perf_counter() - start
    windows = corpus.windows(WINDOW, stride=WINDOW // 4)
    loader = mk.datasets.batches(windows, BATCH, balanced="style")
    read, total, memory = 0, 0.0, 0.0
    while read < WARM + batches:
        for batch in loader:
            if read == WARM:
                start, memory = time.perf_counter(), private_mb()
            total += float(batch["rotations"][0, 0, 0, 0])
            read += 1
            if read == WARM + batches:
                break
    seconds = time.perf_counter() - start
    assert total == total, "a number that was read is not finite"
    return {
        "batches_per_s": batches / seconds,
        "memory_growth_mb": private_mb() - memory,
        "frames": float(int(corpus.store.frames.sum())),
        "corpus_mb": sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e6,
        "making_frames_per_s": len(items) * CLIP / making,
    }


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        found = corpus_speed(place, int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
    for name, value in found.items():
        print(f"{name:20} {value:,.1f}")
