"""Classifiers of content and of style: an ST-GCN over joints seen from the body (papers 1, 3 and 4 judge with one)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from .. import checkpoints
from ..errors import MotionKitError
from ..layers import StGcn, StGcnConfig
from ..metrics import recognition_accuracy
from ..motion import Motion
from ..skeleton import Skeleton
from .poses import WINDOW, fitting, joint_numbers, over_windows, several


@dataclass(eq=False)
class Classifier:
    """Tells the `content` or the `style` of motions on one skeleton (paper 1, section 5.2; paper 3; paper 4).

    label: which of the two. labels: the classes, in the order of the scores. skeleton, fps: of the motions it learned
    from; other frame rates are resampled. window: frames it sees at a time; a motion gets the mean over its windows.
    moving: whether it sees velocities. card: how it was made, see `checkpoints`.

    >>> import motionkit as mk
    >>> judge = mk.judges.load("actor").content
    >>> walk = mk.load("data/actor/walk_old.bvh")
    >>> judge.labels[int(judge.scores([walk]).argmax())]
    'walk'
    """

    network: StGcn
    label: str
    labels: tuple[str, ...]
    skeleton: Skeleton
    fps: float
    window: int = WINDOW
    moving: bool = True
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"Classifier({self.label}: {', '.join(self.labels)}; {self.skeleton!r}, {self.fps:g} fps)"

    def encode(self, motion: Motion) -> Tensor:
        """What the network sees of a motion, [F, J, 6], or 3 without velocities; MotionKitError on another skeleton."""
        x = joint_numbers(fitting(motion, self.skeleton, self.fps, f"this {self.label} classifier"))
        return x if self.moving else x[..., :3]

    def scores_and_features(self, motions: Sequence[Motion | None]) -> tuple[Tensor, Tensor]:
        """Log-probabilities [N, C], and the last pooling layer [N, D], of N motions; NaN for None.

        Raises MotionKitError for another skeleton, or where there is no motion at all.
        """
        motions = several(motions)
        self.network.eval()
        both = over_windows(motions, self.encode, self._see, self.window)
        return both[:, : len(self.labels)], both[:, len(self.labels) :]

    def _see(self, windows: Tensor) -> Tensor:
        pooled = self.network.pooled(windows.permute(0, 3, 1, 2))
        return torch.cat((self.network.classify(pooled).log_softmax(1), pooled), 1)

    def scores(self, motions: Sequence[Motion | None]) -> Tensor:
        """Log-probabilities of the classes, mean over windows: [N, C]; see `scores_and_features`."""
        return self.scores_and_features(motions)[0]

    def features(self, motions: Sequence[Motion | None]) -> Tensor:
        """The last pooling layer, mean over windows: [N, D], what FMD measures in (papers 1, 3 and 4)."""
        return self.scores_and_features(motions)[1]

    def ids(self, labels: Sequence[str]) -> Tensor:
        """Class numbers of labels, long [N]; MotionKitError names one that it was not trained for."""
        unknown = sorted(set(labels) - set(self.labels))
        if unknown:
            raise MotionKitError(
                f"this classifier knows the {self.label}s {', '.join(self.labels)}; {unknown[0]!r} is none of them: "
                "take the classifier of the same dataset, or train one with mk.judges.train_classifier"
            )
        return torch.tensor([self.labels.index(label) for label in labels], dtype=torch.long)

    def accuracy(self, clips: Sequence) -> float:
        """Per cent of labelled clips (a `Dataset`, for instance) whose label it names."""
        clips = list(clips)
        scores = self.scores([clip.motion for clip in clips])
        return recognition_accuracy(scores, self.ids([getattr(clip, self.label) for clip in clips]))

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`."""
        card = {"kind": "classifier", **self.card, "label": self.label, "labels": list(self.labels), "fps": self.fps}
        card |= {"window": self.window, "moving": self.moving, "skeleton": checkpoints.skeleton_card(self.skeleton)}
        return checkpoints.save(path, self.network.state_dict(), card | {"config": asdict(self.network.config)})

    @classmethod
    def load(cls, path: str | os.PathLike) -> Classifier:
        """From what `save` wrote; MotionKitError if the files are damaged or hold something else."""
        tensors, card = checkpoints.load(path, "classifier")
        config = StGcnConfig(**{k: tuple(v) if isinstance(v, list) else v for k, v in card["config"].items()})
        skeleton, labels = checkpoints.skeleton_of(card["skeleton"]), tuple(card["labels"])
        network = StGcn(6 if card["moving"] else 3, len(labels), skeleton, config).eval()
        checkpoints.load_into(network, tensors, path)
        return cls(network, card["label"], labels, skeleton, card["fps"], card["window"], card["moving"], card)
