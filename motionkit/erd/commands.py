"""Style-ERD by command: `python -m motionkit train erd --data actor`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from ..cards import card_of, place_for
from ..datasets import Dataset
from ..restyling import body_of
from ..training import Schedule, in_main
from .frames import placed_positions, split
from .labels import FRAMES, hits, train_labels
from .model import ErdModel
from .pieces import Pieces
from .recipe import ErdRecipe, train_erd

_LABEL_STEPS = 1500


def train_model(
    data: Dataset, recipe: ErdRecipe | None = None, seed: int = 0, label_steps: int = _LABEL_STEPS, **running
) -> ErdModel:
    """A Style-ERD of a labelled dataset, with what guesses its labels; see `recipe.train_erd` for the arguments.

    label_steps: 0 for no such guesses. The card says how it was made.
    """
    recipe, skeleton = recipe or ErdRecipe.laptop(), body_of(data[0].motion).skeleton
    network, run, pieces = train_erd(data, recipe, seed, **running)
    model = ErdModel(network.requires_grad_(False), pieces.contents, pieces.styles, skeleton, recipe.fps)
    if label_steps:
        quiet = {"title": running.get("title", "") and "labels"}
        model.labeller = train_labels(Pieces.of(data, recipe.fps, FRAMES), len(skeleton), label_steps, seed, **quiet)
    model.card = card_of(data, Schedule(recipe.steps, recipe.rate, seed=seed), run, network)
    model.card |= {"batch": recipe.batch, "last_loss": round(sum(run.losses[-200:]) / len(run.losses[-200:]), 3)}
    return model


@torch.no_grad()
def measured(model: ErdModel, data: Dataset) -> dict[str, float]:
    """How far a model is right on clips that it has not learned from.

    `rebuilt_mm`: how far joints are from those of the input, from the pelvis, where the style that it has is asked for
    and nothing is put back, mean over windows of `labels.FRAMES` frames. The others are `labels.hits`.
    """
    pieces, joints = Pieces.of(data, model.fps, FRAMES), len(model.skeleton)
    network = model.network
    said = network.say(network.listen(pieces.x, pieces.content, pieces.style)[0], network.weights_of(pieces.style))
    places = []
    for turns in (split(said)[0], pieces.x[..., : 4 * joints].unflatten(-1, (joints, 4))):
        standing = placed_positions(model.skeleton, pieces.offsets[:, None], turns, torch.zeros(turns.shape[:2]))
        places.append(standing - standing[..., :1, :])
    found = {"rebuilt_mm": round(1000 * float((places[0] - places[1]).norm(dim=-1).mean()), 1)}
    return found | (hits(model.labeller, pieces) if model.labeller is not None else {})


def train_part(data: Dataset, steps: int | None, seed: int, command: str) -> Path:
    """Train the model of a dataset and write it where `methods.load("style-erd")` finds it; returns its path.

    The state of the run is kept beside the weights, so a run that was broken off goes on.
    """
    path, parts = place_for(data.name, "erd"), data.split()
    recipe = replace(ErdRecipe.laptop(), steps=steps) if steps else ErdRecipe.laptop()
    labels = _LABEL_STEPS if recipe.steps >= _LABEL_STEPS else recipe.steps
    model = train_model(parts.train, recipe, seed, labels, keep=path.with_suffix(".run"), title=path.stem)
    model.card = {"name": path.stem, "command": command, **model.card, "metrics": measured(model, parts.test)}
    in_main(lambda: model.save(path))
    return path
