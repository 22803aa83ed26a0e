"""A method's results to look at: play them, count who was taken for what, map their features."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from ..datasets import Clip, Dataset
from ..errors import MotionKitError
from ..motion import Motion
from . import kept
from .measuring import Measured
from .protocols import Transfer


@dataclass(frozen=True, eq=False)
class Outcome:
    """One transfer and what came of it. problem: why there is no result, or none that could be judged; else empty."""

    content: Clip
    style: Clip
    values: dict[str, float]
    problem: str = ""
    path: Path | None = None

    @property
    def motion(self) -> Motion:
        """The result, read from disk; MotionKitError that says why where there is none."""
        if self.path is None:
            return self.content.motion
        if not self.path.exists():
            raise MotionKitError(f"{self.content.name} as {self.style.name}: no result: {self.problem}")
        return kept.load_result(self.path, self.content.motion)[0]

    def __repr__(self) -> str:
        problem = f", {self.problem}" if self.problem else ""
        return f"Outcome({self.content.name!r} as {self.style.name!r}{problem})"


@dataclass(frozen=True, eq=False)
class Results(Sequence):
    """The outcomes of a method in the protocol's order: `results[3].motion`, `len(results)`, a loop.

    Tensors of all N at once, with rows of NaN where a transfer failed: `scores(label)` and `features(label)` of the
    judge, `ids(label)`, its classes that would have been right. label: "content" or "style"; features also has "ae".
    """

    method: str
    test: Dataset
    transfers: tuple[Transfer, ...]
    measured: Measured
    right: dict[str, Tensor]
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.transfers)

    def __getitem__(self, number: int) -> Outcome:
        if not hasattr(number, "__index__") or not -len(self) <= number < len(self):
            raise IndexError(f"results of {self.method!r} go from 0 to {len(self) - 1}; found [{number!r}]")
        number = int(number) % len(self)
        transfer = self.transfers[number]
        path = None if self.folder is None else kept.result_path(self.folder, number)
        values = {name: float(x[number]) for name, x in self.measured.values.items()}
        problem = self.measured.problems.get(number, "")
        return Outcome(self.test[transfer.content], self.test[transfer.style], values, problem, path)

    def __iter__(self) -> Iterator[Outcome]:
        return (self[n] for n in range(len(self)))

    def __repr__(self) -> str:
        return f"Results({self.method!r}, {len(self)} transfers, {len(self.measured.problems)} failed)"

    def scores(self, label: str) -> Tensor:
        """The judge's log-probabilities [N, C] of `content` or `style`."""
        return self._seen(label, "scores")

    def features(self, label: str) -> Tensor:
        """The judge's features [N, D]: of its `content` or `style` classifier, or its autoencoder (`ae`)."""
        return self._seen(label, "features")

    def ids(self, label: str) -> Tensor:
        """The classes [N] that would be right: content of the content clips, or style of the style clips."""
        if label not in self.right:
            raise MotionKitError(f"labels are 'content' and 'style'; found {label!r}")
        return self.right[label]

    def _seen(self, label: str, what: str) -> Tensor:
        name = f"{label}_{what}"
        if name not in self.measured.seen:
            there = ", ".join(sorted(n.removesuffix(f"_{what}") for n in self.measured.seen if n.endswith(what)))
            raise MotionKitError(f"results of {self.method!r}: no {what} {label!r}; there are {there or 'none'}")
        return self.measured.seen[name]
