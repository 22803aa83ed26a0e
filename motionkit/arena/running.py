"""The arena's one call: make what is missing, measure it, and return the table."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

import motionkit

from .. import datasets
from ..datasets import Dataset, Split
from ..datasets.cache import make_folder
from ..errors import MotionKitError
from ..files import cache_folder
from . import transfers
from .protocols import Protocol, Transfer, get_protocol
from .table import ArenaTable, EvalContext, Results, Row, scores_of, scores_of_clips
from .transfers import (
    REAL,
    Evaluator,
    GroundTruth,
    Measured,
    MethodEntry,
    dataset_key,
    evaluate,
    evaluate_clips,
    generate,
    judge_key,
    method_entries,
)


def run(
    methods: object,
    dataset: str | Dataset | Split = "actor",
    protocol: str | Protocol = "small",
    seed: int = 0,
    resume: bool = True,
    *,
    judge: object = None,
    root: str | os.PathLike | None = None,
    folder: str | os.PathLike | None = None,
    jobs: int | None = None,
    shrinkage: float | None = None,
) -> ArenaTable:
    """Let methods restyle the same clips, and measure what they make. (`help(mk.arena)` says what is kept and when.)

    methods: a name, an object with `stylize(content, style)`, a function of two motions; a list of these, or a dict
    from row names to them: `mk.arena.run({"mine": my_function})`. dataset: a name, with `root` as in
    `mk.datasets.load`; a Dataset, of which `split()` is taken; or a Split. protocol: which clips are restyled after
    which, see `PROTOCOLS`. judge: what measures; `mk.judges.load(dataset)` if left out. folder: where results are kept.
    jobs: processes, one a core if left out. shrinkage: for Fréchet distances of few motions, see `mk.metrics.fmd`.
    Raises MotionKitError where these do not fit together; a method's failures it counts.

    >>> run("statistics", protocol="paper-7")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: no protocol 'paper-7'; there are 'paper-1', ...
    """
    entrants, protocol = method_entries(methods), get_protocol(protocol)
    if not isinstance(seed, int):
        raise MotionKitError(f"the arena's seed is a whole number; found {seed!r}")
    split = _split_of(dataset, root)
    judge = _judge_of(judge, split)
    base = Path(folder).expanduser() if folder is not None else cache_folder() / "arena"
    return _Work(split, judge, protocol, seed, base, jobs, shrinkage).table(entrants, resume)


@dataclass(frozen=True, eq=False)
class _Work:
    """What all methods of a table have in common."""

    split: Split
    judge: object
    protocol: Protocol
    seed: int
    base: Path
    jobs: int | None
    shrinkage: float | None

    def table(self, entrants: Sequence[MethodEntry], resume: bool) -> ArenaTable:
        """Make, measure, and put the figures together."""
        test, transfers = self.split.test, self.transfers
        bench = Evaluator(self.judge, test, GroundTruth.of(test, self.base))
        key, train = judge_key(bench), _sample(self.split.train, len(test), self.seed)
        clips = evaluate_clips(bench, test, self.clips_place, f"test-{key}", self.jobs)
        learned = evaluate_clips(bench, train, self.clips_place, f"train-{self.seed}-{key}", self.jobs)
        setting = self._setting(clips)
        rows, views = [], {}
        right = {"content": setting.content_ids, "style": setting.style_ids}
        for entrant in entrants:
            own, measured = self._play(entrant, bench, key, resume)
            failed = {n: f"{_names(test, transfers[n])}: {problem}" for n, problem in measured.problems.items()}
            rows.append(Row(entrant.name, scores_of(measured, setting, self.protocol.columns), len(transfers), failed))
            views[entrant.name] = Results(entrant.name, test, transfers, measured, right, own)
        ids = {label: self._ids(label) for label in ("content", "style")}
        rows.append(Row(REAL, scores_of_clips(clips, ids, learned, setting), len(test)))
        views[REAL] = Results(REAL, test, tuple(Transfer(n, n) for n in range(len(test))), clips, ids)
        return ArenaTable(tuple(rows), self._columns(rows), self._provenance(), views)

    def _columns(self, rows: list[Row]) -> tuple[str, ...]:
        """The protocol's columns but those that no row can have, as the truth's where nobody knows it."""
        known = [c for c in self.protocol.columns if any(row.cell(c).value == row.cell(c).value for row in rows)]
        return tuple(known) or self.protocol.columns

    @cached_property
    def transfers(self) -> tuple[Transfer, ...]:
        return self.protocol.transfers(self.split.test, self.seed)

    @cached_property
    def place(self) -> Path:
        """The folder of these clips, this protocol and seed."""
        return self._folder(f"{_plain(self.protocol.name)}-{self.seed}", f" {self.protocol!r} {self.seed}")

    @cached_property
    def clips_place(self) -> Path:
        """The folder of what the judge sees in the clips themselves, whatever the protocol."""
        return self._folder("clips")

    def _folder(self, what: str, more: str = "") -> Path:
        text = f"{transfers.FORMAT} {dataset_key(self.split.train, self.split.test)}{more}"
        name = f"{_plain(self.split.test.name)}-{what}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
        return make_folder(self.base / name, "give another one: run(..., folder=...)")

    def _play(self, entrant: MethodEntry, bench: Evaluator, key: str, resume: bool) -> tuple[Path, Measured]:
        """A method's folder, and the figures of its results, made first where they are missing."""
        own = self.place / f"{_plain(entrant.name)}-{entrant.key}"
        own.mkdir(exist_ok=True)
        if not resume:
            for n in range(len(self.transfers)):
                transfers.result_path(own, n).unlink(missing_ok=True)
        failed = generate(entrant, self.split.train, self.split.test, self.transfers, own, self.jobs)
        measured = evaluate(bench, self.transfers, own, key, self.jobs, entrant.name)
        return own, replace(measured, problems=dict(sorted({**measured.problems, **failed}.items())))

    def _ids(self, label: str) -> Tensor:
        """The judge's classes of all test clips."""
        return getattr(self.judge, label).ids([getattr(clip, label) for clip in self.split.test])

    def _setting(self, clips: Measured) -> EvalContext:
        contents, styles, repeats = (torch.tensor(numbers) for numbers in zip(*self.transfers))
        ids = (self._ids("content")[contents], self._ids("style")[styles])
        return EvalContext(contents, styles, *ids, repeats, clips, self.shrinkage, self.seed)

    def _provenance(self) -> dict:
        return {
            "dataset": self.split.test.name,
            "train_clips": len(self.split.train),
            "test_clips": len(self.split.test),
            "protocol": self.protocol.name,
            "repeats": self.protocol.repeats,
            "seed": self.seed,
            "transfers": len(self.transfers),
            "judge": getattr(self.judge, "name", type(self.judge).__name__),
            "shrinkage": self.shrinkage,
            "motionkit": motionkit.__version__,
        }


def _names(test: Dataset, transfer: Transfer) -> str:
    return f"{test[transfer.content].name} as {test[transfer.style].name}"


def _split_of(dataset: str | Dataset | Split, root: str | os.PathLike | None) -> Split:
    if isinstance(dataset, str):
        return datasets.load(dataset, root).split()
    if root is not None:
        raise MotionKitError(f"root says where the clips of a data set by name are; {dataset!r} is read already")
    if isinstance(dataset, Dataset):
        return dataset.split()
    if not isinstance(dataset, Split):
        raise MotionKitError(f"the arena takes a data set by name, a Dataset or a Split; found {dataset!r}")
    return dataset


def _judge_of(judge: object, split: Split) -> object:
    """The judge, once it is sure that it knows these clips."""
    name, _ = split.test.name, split.test.skeleton  # an error if its clips have several
    if judge is None or isinstance(judge, str):
        from .. import judges

        judge = judges.load(judge or name)
    for label in ("content", "style"):
        classifier = getattr(judge, label, None)
        if classifier is None:
            raise MotionKitError(
                f"a judge has classifiers .content and .style, as mk.judges.load gives; found {judge!r}"
            )
        words = split.test.contents if label == "content" else split.test.styles
        unknown = [word for word in words if word not in classifier.labels]
        if unknown:
            raise MotionKitError(
                f"data set {name!r} has {label} {unknown[0]!r}, for which this judge was not trained; it knows "
                f"{', '.join(classifier.labels)}. Give a judge of this data set: run(..., judge=...)"
            )
        body = split.test[0].motion.without_helper_joints().skeleton
        if not classifier.skeleton.same_tree(body):
            raise MotionKitError(
                f"data set {name!r} has {body!r}, and this judge's {label} classifier was trained on "
                f"{classifier.skeleton!r} with other joints; give a judge of this data set, or retarget the clips"
            )
    return judge


def _sample(train: Dataset, count: int, seed: int) -> Dataset:
    """As many training clips as there are test clips, drawn by their names."""
    names = {n: f"{seed} {train[n].name}" for n in range(len(train))}
    mixed = sorted(names, key=lambda n: hashlib.sha256(names[n].encode()).digest())
    return train.subset([train.indices[n] for n in sorted(mixed[:count])])


def _plain(name: str) -> str:
    """A name that every system takes for a folder."""
    return re.sub(r"[^\w.=-]+", "_", name)[:60].strip(".") or "_"
