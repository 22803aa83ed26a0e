"""Does a classifier see in a result what it should: the content's action, the style's manner?"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..errors import MotionKitError
from .checks import needs_tensor
from .repeats import Spread, spread


def recognition_accuracy(scores: Tensor, labels: Tensor) -> float:
    """Per cent of motions whose label a classifier names (paper 1, paper 4: CRA, SRA; paper 3).

    scores: [N, C] of a classifier, one column a class. labels: [N] class numbers: of the content clip for the Content
    Recognition Accuracy, of the style for the Style Recognition Accuracy. A row of scores that is not finite counts as
    wrong, never as missing. Raises MotionKitError where they do not fit.

    >>> recognition_accuracy(torch.tensor([[0.9, 0.1], [0.2, 0.8], [0.6, 0.4], [0.5, 0.4]]), torch.tensor([0, 1, 1, 0]))
    75.0
    """
    needs_tensor("recognition accuracy", "scores [N, C]", scores)
    needs_tensor("recognition accuracy", "labels [N]", labels)
    if scores.ndim != 2 or labels.shape != scores.shape[:1] or not len(scores):
        raise MotionKitError(
            f"recognition accuracy: expected scores [N, C] and labels [N]; found {list(scores.shape)} and "
            f"{list(labels.shape)}"
        )
    if labels.is_floating_point() or labels.dtype == torch.bool:
        raise MotionKitError(
            f"recognition accuracy: labels are class numbers, whole ones; found {labels.dtype}. A classifier's "
            "ids(labels) turns names into them"
        )
    if int(labels.min()) < 0 or int(labels.max()) >= scores.shape[1]:
        raise MotionKitError(
            f"recognition accuracy: labels go from {int(labels.min())} to {int(labels.max())}, the classifier knows "
            f"{scores.shape[1]} classes: it was trained for other labels"
        )
    right = (scores.argmax(1) == labels) & torch.isfinite(scores).all(1)
    return 100 * float(right.double().mean())


def repeated_accuracy(scores: Sequence[Tensor], labels: Tensor | Sequence[Tensor]) -> Spread:
    """Recognition accuracy in per cent, mean and spread over repeats of an experiment (paper 3, table 2).

    scores: for each of R repeats [N, C], as for `recognition_accuracy`; N may differ. labels: [N] if all repeats share
    them, else one such tensor a repeat. Paper 3 does not say what it repeats; say it where you report the figure.

    >>> print(repeated_accuracy([torch.eye(4), torch.eye(4).roll(1, 0), torch.eye(4)], torch.arange(4)))
    66.67±57.74
    """
    for given in (scores, labels):
        if not isinstance(given, list | tuple | Tensor) or (isinstance(given, Tensor) and not given.ndim):
            raise MotionKitError(
                f"repeated accuracy: expected scores and labels of each repeat in a list; found {type(given).__name__}"
            )
    scores = list(scores)
    each = [labels] * len(scores) if isinstance(labels, Tensor) and labels.ndim == 1 else list(labels)
    if len(each) != len(scores):
        raise MotionKitError(f"repeated accuracy: {len(scores)} repeats of scores, {len(each)} of labels")
    return spread([recognition_accuracy(s, right) for s, right in zip(scores, each)])


def confusion(scores: Tensor, labels: Tensor) -> Tensor:
    """How often a motion of class i is taken for class j: counts [C, C], rows the truth.

    A row of scores that is not finite is taken for nothing, so it is missing from its class's sum and `finite_share`
    counts it.

    >>> confusion(torch.tensor([[0.9, 0.1], [0.2, 0.8], [0.6, 0.4]]), torch.tensor([0, 1, 1]))
    tensor([[1, 0],
            [1, 1]])
    """
    recognition_accuracy(scores, labels)  # checks both
    known = torch.isfinite(scores).all(1)
    classes = scores.shape[1]
    cells = labels[known] * classes + scores[known].argmax(1)
    return torch.bincount(cells, minlength=classes**2).reshape(classes, classes)
