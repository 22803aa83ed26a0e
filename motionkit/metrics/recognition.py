"""Does a classifier see in a result what it should: the content's action, the style's manner?"""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import MotionKitError


def recognition_accuracy(scores: Tensor, labels: Tensor) -> float:
    """Per cent of motions whose label a classifier names (paper 1, paper 4: CRA, SRA; paper 3).

    scores: [N, C] of a classifier, one column a class. labels: [N] class numbers: of the content clip for the Content
    Recognition Accuracy, of the style for the Style Recognition Accuracy. A row of scores that is not finite counts as
    wrong, never as missing. Raises MotionKitError where they do not fit.

    >>> recognition_accuracy(torch.tensor([[0.9, 0.1], [0.2, 0.8], [0.6, 0.4], [0.5, 0.4]]), torch.tensor([0, 1, 1, 0]))
    75.0
    """
    if scores.ndim != 2 or labels.shape != scores.shape[:1] or not len(scores):
        raise MotionKitError(
            f"recognition accuracy: expected scores [N, C] and labels [N]; found {list(scores.shape)} and "
            f"{list(labels.shape)}"
        )
    if int(labels.min()) < 0 or int(labels.max()) >= scores.shape[1]:
        raise MotionKitError(
            f"recognition accuracy: labels go from {int(labels.min())} to {int(labels.max())}, the classifier knows "
            f"{scores.shape[1]} classes: it was trained for other labels"
        )
    right = (scores.argmax(1) == labels) & torch.isfinite(scores).all(1)
    return 100 * float(right.double().mean())


def confusion(scores: Tensor, labels: Tensor) -> Tensor:
    """How often a motion of class i is taken for class j: counts [C, C], rows the truth.

    >>> confusion(torch.tensor([[0.9, 0.1], [0.2, 0.8], [0.6, 0.4]]), torch.tensor([0, 1, 1]))
    tensor([[1, 0],
            [1, 1]])
    """
    recognition_accuracy(scores, labels)  # checks both
    classes = scores.shape[1]
    return torch.bincount(labels * classes + scores.argmax(1), minlength=classes**2).reshape(classes, classes)
