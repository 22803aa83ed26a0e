"""How judges are trained: `python -m motionkit train content-classifier --data actor`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor, nn

from ..cards import card_of, place_for
from ..datasets import Dataset, Encoded, Split
from ..errors import MotionKitError
from ..layers import StGcn, StGcnConfig
from ..training import Schedule, device_of, fit, in_main
from .autoencoder import DenoisingAutoencoder, MotionAutoencoder, denoising_loss
from .classifier import Classifier
from .poses import WINDOW

BATCH = 64
PARTS = ("content", "style", "autoencoder")
STEPS = {"content": 800, "style": 2000, "autoencoder": 2500, "frame": 600}
_LENGTHS = (24, 32, 48, WINDOW, WINDOW, WINDOW)  # of the windows of a batch: captures have clips shorter than 64 frames


def train_classifier(
    label: str,
    data: Dataset | Split,
    config: StGcnConfig | None = None,
    schedule: Schedule | None = None,
    *,
    window: int = WINDOW,
    moving: bool = True,
    **running,
) -> Classifier:
    """A classifier of the `content` or the `style` of a dataset's clips, trained on its training part.

    data: a dataset (its `split()` is used) or the three parts. window: frames it sees at a time; 1 shows what a single
    pose gives away, best with `moving` off. running: `keep`, `title`, `show` of `training.fit`. Every class comes
    equally often. The card holds the accuracy on the test part. Raises MotionKitError for a label that is neither, or
    only one class.

    >>> import motionkit as mk
    >>> train_classifier("mood", mk.datasets.Split([], [], []))
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: a classifier is trained for 'content' or 'style'; found 'mood'
    """
    if label not in ("content", "style"):
        raise MotionKitError(f"a classifier is trained for 'content' or 'style'; found {label!r}")
    split = data.split() if isinstance(data, Dataset) else data
    schedule = schedule or Schedule(STEPS[label])
    torch.manual_seed(schedule.seed)
    judge = _fresh(label, split, config, window, moving)
    frames = Encoded(split.train, judge)
    classes = judge.ids([getattr(clip, label) for clip in split.train])
    run = fit(judge.network, _loss(frames, classes, window), schedule, **running)
    judge.card = {**card_of(split.train, schedule, run, judge.network), "metrics": {}}
    for part in ("validation", "test"):
        if len(getattr(split, part)):
            judge.card["metrics"][f"{part}_accuracy"] = round(judge.accuracy(getattr(split, part)), 2)
    return judge


def _fresh(label: str, split: Split, config: StGcnConfig | None, window: int, moving: bool) -> Classifier:
    """A classifier that has learned nothing yet, for the labels, skeleton and frame rate of a training part."""
    train = split.train
    labels = train.vocabulary[label]
    if len(train.contents if label == "content" else train.styles) < 2:
        raise MotionKitError(f"dataset {train.name!r} has one {label} only; there is nothing to tell apart")
    motion = train[0].motion.body()
    network = StGcn(6 if moving else 3, len(labels), motion.skeleton, config)
    return Classifier(network, label, labels, motion.skeleton, motion.fps, window, moving)


def _loss(frames: Encoded, classes: Tensor, window: int) -> Callable[[nn.Module, int], Tensor]:
    """Cross-entropy on windows of a random length; of each class a random clip that has frames enough."""
    lengths = (1,) if window == 1 else tuple(n for n in _LENGTHS if n <= window)
    usable = {n: frames.lengths >= min(n, int(frames.lengths.max())) for n in lengths}
    members = {n: [torch.nonzero((classes == c) & ok)[:, 0] for c in classes.unique()] for n, ok in usable.items()}

    def loss_of(network: nn.Module, step: int) -> Tensor:
        length = lengths[int(torch.randint(len(lengths), ()))]
        groups = [group for group in members[length] if len(group)]
        chosen = torch.arange(BATCH) % len(groups)
        clips = torch.stack([groups[g][int(torch.rand(()) * len(groups[g]))] for g in chosen.tolist()])
        x = frames.draw(clips, min(length, int(frames.lengths.max())))
        here = device_of(network)
        return nn.functional.cross_entropy(network(x.permute(0, 3, 1, 2).to(here)), classes[clips].to(here))

    return loss_of


def train_autoencoder(data: Dataset | Split, schedule: Schedule | None = None, **running) -> MotionAutoencoder:
    """Paper 2's denoising autoencoder (supplement A) on a dataset's training part; its labels are not looked at.

    The card holds the mean angle, in degrees, by which it misses clean rotations of the test part, and how far the
    noise had turned them.
    """
    split = data.split() if isinstance(data, Dataset) else data
    schedule = schedule or Schedule(STEPS["autoencoder"])
    skeleton, fps = split.train[0].motion.body().skeleton, split.train[0].motion.fps
    torch.manual_seed(schedule.seed)
    network = DenoisingAutoencoder(len(skeleton))
    encoder = MotionAutoencoder(network, skeleton, fps)
    frames = Encoded(split.train, encoder)
    enough = torch.nonzero(frames.lengths >= min(WINDOW, int(frames.lengths.max())))[:, 0]

    def loss_of(model: nn.Module, step: int) -> Tensor:
        clips = enough[torch.randint(len(enough), (BATCH,))]
        return denoising_loss(model, frames.draw(clips, min(WINDOW, int(frames.lengths.max()))).to(device_of(model)))

    run = fit(network, loss_of, schedule, **running)
    unseen = Encoded(split.test, encoder)
    there = torch.nonzero(unseen.lengths >= WINDOW)[:, 0]
    with torch.no_grad():
        torch.manual_seed(schedule.seed)
        turns = unseen.draw(there, WINDOW)
        found = {"test_degrees": denoising_loss(network, turns), "noise_degrees": denoising_loss(nn.Identity(), turns)}
    metrics = {name: round(float(value.rad2deg()), 3) for name, value in found.items()}
    encoder.card = {**card_of(split.train, schedule, run, network), "metrics": metrics}
    return encoder


def single_frame_accuracy(label: str, split: Split, schedule: Schedule | None = None, **running) -> float:
    """Per cent of single frames of unseen clips whose label a classifier names that sees poses and no movement.

    Every fifth frame of the test part counts; what it misses is in the timing.
    """
    judge = train_classifier(
        label, split, None, schedule or Schedule(STEPS["frame"]), window=1, moving=False, **running
    )
    frames = [(clip.motion[n], getattr(clip, label)) for clip in split.test for n in range(0, len(clip), 5)]
    scores = judge.scores([frame for frame, _ in frames])
    return 100 * float((scores.argmax(1) == judge.ids([name for _, name in frames])).double().mean())


def train_part(part: str, data: Dataset, config: StGcnConfig, steps: int | None, seed: int, command: str) -> Path:
    """Train `content`, `style` or `autoencoder` for a dataset and write it where `judges.load` finds it.

    steps: of the training; left out, the recipe's. The state of the run is kept beside the weights, so a run that was
    broken off goes on. A classifier's card also says what single frames give away. Returns the path of the weights.
    """
    path, split = place_for(data.name, part), data.split()
    schedule, keep = Schedule(steps or STEPS[part], seed=seed), path.with_suffix(".run")
    if part == "autoencoder":
        made = train_autoencoder(split, schedule, keep=keep, title=path.stem)
    else:
        made = train_classifier(part, split, config, schedule, keep=keep, title=path.stem)
        still = Schedule(min(schedule.steps, STEPS["frame"]), seed=seed)
        share = single_frame_accuracy(part, split, still, title=f"{path.stem}, single frames")
        made.card["metrics"]["single_frame_accuracy"] = round(share, 2)
    made.card = {"name": path.stem, "command": command, **made.card}
    in_main(lambda: made.save(path))
    return path
