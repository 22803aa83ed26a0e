"""Reading windows from a corpus of a million frames: batches a second, and the memory they take.

`benchmarks.actor` writes the speed into its results; a million frames take 0.7 GB of disk for a moment.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import torch

from .. import datasets
from ..datasets import Item, Labels, Recording
from ..motion import Motion
from ..skeleton import smpl

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
        rotations = torch.randn(self.frames, len(skeleton), 4, generator=generator)
        rotations = torch.nn.functional.normalize(rotations, dim=-1)
        path = torch.randn(self.frames, 3, generator=generator).cumsum(0)
        contacts = torch.rand(self.frames, 4, generator=generator) > 0.5
        return Recording(Motion.from_root(skeleton, rotations, path, 30.0), {"contacts": contacts})


def private_mb() -> float:
    """Megabytes that this process holds beyond files it has mapped; not a number where the system does not tell."""
    try:
        lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("Anonymous:")) / 1024
    except (OSError, StopIteration):
        return float("nan")


def corpus_speed(folder: str | Path, frames: int = 1_000_000, batches: int = BATCHES) -> dict[str, float]:
    """Make a corpus of `frames` frames in `folder`, read it in batches of 64 windows of 64 frames.

    Returns batches_per_s, memory_growth_mb (private memory at the end over that after the first 20 batches) and frames.
    """
    items = [Item(f"clip_{n:06d}", Labels("walk", f"style {n % 8}", ()), Noise(n)) for n in range(frames // CLIP)]
    corpus = datasets.build_cache(items, folder)
    loader = datasets.batches(corpus.windows(WINDOW, stride=WINDOW // 4), BATCH, balanced="style")
    start, batches_read, total, memory = 0.0, 0, 0.0, 0.0
    while batches_read < WARM + batches:
        for batch in loader:
            if batches_read == WARM:
                start, memory = time.perf_counter(), private_mb()
            total += float(batch["rotations"][0, 0, 0, 0])
            batches_read += 1
            if batches_read == WARM + batches:
                break
    seconds = time.perf_counter() - start
    assert total == total, "a number that was read is not finite"
    return {
        "batches_per_s": batches / seconds,
        "memory_growth_mb": private_mb() - memory,
        "frames": float(int(corpus.store.frames.sum())),
    }
