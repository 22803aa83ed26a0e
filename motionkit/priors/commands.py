"""Priors, discriminators and the text encoder by command: `python -m motionkit train prior --data actor`."""

from __future__ import annotations

from pathlib import Path

from .. import checkpoints, text
from ..cards import place_for
from ..datasets import Dataset
from ..layers import TransformerConfig
from ..training import Schedule, in_main
from .prior import Prior
from .quality import grade
from .recipes import RATE, STEPS, train_discriminator, train_prior
from .text_recipe import STEPS as TEXT_STEPS
from .text_recipe import train_text


def train_part(
    part: str,
    data: Dataset,
    config: TransformerConfig,
    steps: int | None,
    seed: int,
    command: str,
    encoder: str = "mini",
    start: str | None = None,
    rate: float | None = None,
) -> Path:
    """Train a `prior`, `discriminator` or `text` and write it where `load` finds it; returns the weights' path.

    steps, rate: of the training; left out, the recipe's. encoder: of the sentences, see `text.load`. start: the name
    of a prior to go on from, the one trained before for instance. The state of the run is kept beside the weights, so a
    run that was broken off goes on. A discriminator needs the dataset's prior. Of several processes the first writes.
    """
    path = place_for(data.name, part) if part != "text" else checkpoints.folder() / "text-mini.safetensors"
    keep, split = path.with_suffix(".run"), data.split()
    if part == "text":
        schedule = Schedule(steps or TEXT_STEPS, rate=1e-3, decay=1e-2, seed=seed)
        made = train_text(split, None, schedule, keep=keep, title=path.stem)
    else:
        schedule = Schedule(steps or STEPS[part], rate=rate or RATE, decay=1e-2, seed=seed, average=0.999)
        if part == "prior":
            first = Prior.load(checkpoints.find(start)) if start else None
            made = train_prior(split, text.load(encoder), config, schedule, start=first, keep=keep, title=path.stem)
        else:
            prior = Prior.load(place_for(data.name, "prior"))
            made = train_discriminator(split, prior, schedule, keep=keep, title=path.stem)
    made.card = {"name": path.stem, "command": command, **made.card}
    in_main(lambda: made.save(path))
    if part == "prior":
        in_main(lambda: grade(path, split))
    return path
