"""What every card of trained weights says, and where the weights go."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from torch import nn

from . import checkpoints
from .datasets import Dataset
from .training import Run, Schedule

# Licences of captures that forbid what MIT allows; weights that learned from them are under the same licence.
LICENCES = {"bandai-1": "CC-BY-NC-4.0", "bandai-2": "CC-BY-NC-4.0"}


def card_of(data: Dataset, schedule: Schedule, run: Run, network: nn.Module) -> dict:
    """What every card says of how weights were made from these clips."""
    name = data.name
    return {
        "data": name,
        "data_sha256": data_hash(data),
        "training_clips": len(data),
        "seed": schedule.seed,
        "steps": schedule.steps,
        "seconds": round(run.seconds),
        "steps_per_second": round(run.steps_per_second, 2),
        "hardware": checkpoints.hardware(),
        "parameters": sum(p.numel() for p in network.parameters()),
        "licence": LICENCES.get(name, "MIT"),
    }


def data_hash(dataset: Dataset) -> str:
    """Changes when clips, their labels or their numbers do: 16 hexadecimal digits."""
    clips = (
        f"{dataset.store.clips[n].name} {dataset.store.clips[n].checksum} {dataset.labels[n][:2]}"
        for n in dataset.numbers
    )
    return hashlib.sha256("\n".join(clips).encode()).hexdigest()[:16]


def place_for(data: str, what: str) -> Path:
    """Where the weights of a judge go: `NAME-content.safetensors` and so on, in the folder of their licence."""
    folder = checkpoints.folder() / LICENCES.get(data, "").lower()
    os.makedirs(folder, exist_ok=True)
    return folder / f"{data}-{what}.safetensors"
