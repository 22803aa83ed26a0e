"""How good a prior is: what it makes of the test part's sentences, seen by the judges of the same dataset."""

from __future__ import annotations

import os

import torch
from tqdm.auto import tqdm

from .. import checkpoints, judges, sampling
from ..datasets import Dataset, Split
from ..judges import Judge
from ..metrics import fmd
from ..motion import Motion
from .prior import Prior, Sampler

BATCH = 48


def answers(
    prior: Prior, clips: Dataset, sampler: Sampler = sampling.ddim, steps: int = 20, title: str = "", **more
) -> list[Motion]:
    """A motion for the first sentence of each clip, as long as the clip, or as the prior's longest if that is less.

    more: what `Prior.generate` takes beside, such as `scale`.
    """
    made = []
    for start in tqdm(range(0, len(clips), BATCH), title, disable=not title):
        part = list(clips[start : start + BATCH])
        seconds = [min(len(clip), prior.longest) / prior.fps for clip in part]
        prompts = [clip.text for clip in part]
        made += prior.generate(prompts, seconds, sampler=sampler, steps=steps, seed=start, **more)
    return made


def quality(prior: Prior, split: Split, judge: Judge, made: list[Motion] | None = None) -> dict[str, float]:
    """Per cent of answers whose content and style the judges name, and Fréchet distances to the test clips.

    made: `answers` to the test part's sentences; made here with 20 DDIM steps if left out. `fmd`: in the content
    classifier's features (paper 1, section 5.2), and beside it `fmd_real`, of as many training clips; the same with
    `_ae` in the autoencoder's (paper 2). `real_content` and `real_style` are what the judges name of the clips
    themselves.
    """
    test = split.test
    made = answers(prior, test) if made is None else made
    few = torch.randperm(len(split.train), generator=torch.Generator().manual_seed(0))[: len(test)].tolist()
    real, others = [clip.motion for clip in test], [split.train[n].motion for n in few]
    found = {}
    for label, classifier in (("content", judge.content), ("style", judge.style)):
        ids = classifier.ids([getattr(clip, label) for clip in test])
        for name, motions in ((label, made), (f"real_{label}", real)):
            found[name] = 100 * float((classifier.scores(motions).argmax(1) == ids).double().mean())
    for name, encoder in (("fmd", judge.content), ("fmd_ae", judge.autoencoder)):
        there = encoder.features(real)
        found[name] = fmd(encoder.features(made), there)
        found[f"{name}_real"] = fmd(encoder.features(others), there)
    return {name: round(value, 3) for name, value in found.items()}


def grade(path: str | os.PathLike, split: Split) -> dict[str, float]:
    """Write the `quality` of weights into their card; nothing where no judge was trained on the dataset."""
    name = split.train.name
    if name not in judges.names() or not len(split.test):
        return {}
    tensors, card = checkpoints.load(path, "prior")
    card["metrics"] = quality(Prior.load(path), split, judges.load(name))
    checkpoints.save(path, tensors, card)
    return card["metrics"]
