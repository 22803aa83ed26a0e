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
SEEDS = (0, 1, 2)  # one seed's figures differ from another's by a per cent or two


def answers(
    prior: Prior,
    clips: Dataset,
    sampler: Sampler = sampling.ddim,
    steps: int = 20,
    seed: int = 0,
    title: str = "",
    **more,
) -> list[Motion]:
    """A motion for the first sentence of each clip, as long as the clip, or as the prior's longest if that is less.

    seed: of all of them; another one, other answers. more: what `Prior.generate` takes beside, such as `scale`.
    """
    made = []
    for start in tqdm(range(0, len(clips), BATCH), title, disable=not title):
        part = list(clips[start : start + BATCH])
        seconds = [min(len(clip), prior.longest) / prior.fps for clip in part]
        prompts = [clip.text for clip in part]
        made += prior.generate(prompts, seconds, sampler=sampler, steps=steps, seed=seed * 1_000_003 + start, **more)
    return made


def quality(prior: Prior, split: Split, judge: Judge, title: str = "", **more) -> dict[str, float]:
    """Per cent of answers whose content and style the judges name, and Fréchet distances to the test clips.

    Means over answers from several seeds to the test part's sentences, by 20 DDIM steps. `fmd`: in the content
    classifier's features (paper 1, section 5.2), and beside it `fmd_real`, of as many training clips; the same with
    `_ae` in the autoencoder's (paper 2). `real_content` and `real_style` are what the judges name of the clips
    themselves. more: what `answers` takes beside, such as `scale`.
    """
    test = split.test
    few = torch.randperm(len(split.train), generator=torch.Generator().manual_seed(0))[: len(test)].tolist()
    real, others = [clip.motion for clip in test], [split.train[n].motion for n in few]
    made = [answers(prior, test, seed=seed, title=title, **more) for seed in SEEDS]
    found = {}
    for label, classifier in (("content", judge.content), ("style", judge.style)):
        ids = classifier.ids([getattr(clip, label) for clip in test])
        for name, crowds in ((label, made), (f"real_{label}", [real])):
            shares = [(classifier.scores(crowd).argmax(1) == ids).double().mean() for crowd in crowds]
            found[name] = 100 * float(torch.stack(shares).mean())
    for name, encoder in (("fmd", judge.content), ("fmd_ae", judge.autoencoder)):
        there = encoder.features(real)
        for key, crowds in ((name, made), (f"{name}_real", [others])):
            found[key] = sum(fmd(encoder.features(crowd), there) for crowd in crowds) / len(crowds)
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
