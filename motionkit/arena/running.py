"""The arena's one call: make what is missing, measure it, and return the table."""

from __future__ import annotations

import hashlib
import math
import os
import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

import motionkit

from .. import datasets, judges
from ..checkpoints import data_hash
from ..datasets import Dataset, Split
from ..datasets.cache import make_folder
from ..errors import MotionKitError
from ..files import cache_folder
from .protocols import Protocol, Transfer, get_protocol
from .table import ArenaTable, EvalContext, Results, Row, figures
from .transfers import (
    FORMAT,
    REAL,
    Evaluator,
    GroundTruth,
    Measures,
    MethodEntry,
    evaluate,
    evaluate_clips,
    generate,
    judge_key,
    method_entries,
    result_path,
)


def run(
    methods: object,
    dataset: str | Dataset | Split = "actor",
    protocol: str | Protocol = "small",
    seed: int = 0,
    *,
    resume: bool = True,
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
    entries, protocol = method_entries(methods), get_protocol(protocol)
    if not isinstance(seed, int):
        raise MotionKitError(f"the arena's seed is a whole number; found {seed!r}")
    split = _split_of(dataset, root)
    base = Path(folder).expanduser() if folder is not None else cache_folder() / "arena"
    work = _Work(split, _judge_of(judge, split.test), protocol, seed, base, jobs, shrinkage)
    results = {entry.name: work.results(entry, resume=resume) for entry in entries}
    rows = [work.row(one) for one in results.values()] + [work.real_row()]
    results[REAL] = work.real_results()
    # the protocol's columns but those that no row can have, as the truth's where nobody knows it
    columns = [c for c in protocol.columns if any(not math.isnan(row.cell(c).value) for row in rows)]
    return ArenaTable(tuple(rows), tuple(columns) or protocol.columns, work.provenance(), results)


@dataclass(frozen=True, eq=False)
class _Work:
    """What all rows of a table have in common, worked out when first needed."""

    split: Split
    judge: object
    protocol: Protocol
    seed: int
    base: Path
    jobs: int | None
    shrinkage: float | None

    @cached_property
    def transfers(self) -> tuple[Transfer, ...]:
        return self.protocol.transfers(self.split.test, self.seed)

    @cached_property
    def evaluator(self) -> Evaluator:
        return Evaluator(self.judge, self.split.test, GroundTruth.for_dataset(self.split.test, self.base))

    @cached_property
    def key(self) -> str:
        return judge_key(self.evaluator)

    @cached_property
    def ids(self) -> dict[str, Tensor]:
        """The judge's classes of all test clips."""
        labels = {label: [getattr(clip, label) for clip in self.split.test] for label in ("content", "style")}
        return {label: getattr(self.judge, label).ids(names) for label, names in labels.items()}

    @cached_property
    def clips(self) -> Measures:
        """What the judge says of the test clips, whatever the protocol."""
        path = self.folder("clips") / f"clips-test-{self.key}.safetensors"
        return evaluate_clips(self.evaluator, self.split.test, path, self.jobs)

    @cached_property
    def context(self) -> EvalContext:
        contents, styles, repeats = map(torch.tensor, zip(*self.transfers))
        ids = {"content": self.ids["content"][contents], "style": self.ids["style"][styles]}
        return EvalContext(contents, styles, repeats, ids, self.clips, self.shrinkage, self.seed)

    def folder(self, name: str, about: str = "") -> Path:
        """A folder of these clips, and of what else it is about."""
        text = f"{FORMAT} {data_hash(self.split.train)} {data_hash(self.split.test)}{about}"
        digest = hashlib.sha256(text.encode()).hexdigest()[:12]
        folder = self.base / f"{_plain(self.split.test.name)}-{name}-{digest}"
        return make_folder(folder, "give another one: run(..., folder=...)")

    def results(self, entry: MethodEntry, *, resume: bool) -> Results:
        """A method's results, measured; made first where they are missing."""
        name = f"{_plain(self.protocol.name)}-{self.seed}"
        folder = self.folder(name, f" {self.protocol!r} {self.seed}") / f"{_plain(entry.name)}-{entry.key}"
        folder.mkdir(exist_ok=True)
        if not resume:
            for n in range(len(self.transfers)):
                result_path(folder, n).unlink(missing_ok=True)
        failed = generate(entry, self.split.train, self.split.test, self.transfers, folder, self.jobs)
        measures = evaluate(self.evaluator, self.transfers, folder, self.key, self.jobs, entry.name)
        measures = replace(measures, problems=dict(sorted({**measures.problems, **failed}.items())))
        return Results(entry.name, self.split.test, self.transfers, measures, self.context.ids, folder)

    def row(self, results: Results) -> Row:
        """The figures of a method's results."""
        failed = {n: f"{o.content.name} as {o.style.name}: {o.problem}" for n, o in enumerate(results) if o.problem}
        cells = figures(results.measures, self.context, self.protocol.columns)
        return Row(results.method, cells, len(results), failed, self.split.test.name)

    def real_results(self) -> Results:
        """The test clips themselves."""
        itself = tuple(Transfer(n, n) for n in range(len(self.split.test)))
        return Results(REAL, self.split.test, itself, self.clips, self.ids)

    def real_row(self) -> Row:
        """What the judge names of the test clips, and how far as many training clips are from them."""
        test, train = self.split.test, _sample(self.split.train, len(self.split.test), self.seed)
        path = self.folder("clips") / f"clips-train-{self.seed}-{self.key}.safetensors"
        train_measures = evaluate_clips(self.evaluator, train, path, self.jobs)
        of_test, of_train = (EvalContext.of_clips(len(x), self.ids, self.clips, self.shrinkage) for x in (test, train))
        cells = figures(self.clips, of_test, ("cra", "sra", "fsf")) | figures(
            train_measures, of_train, ("fmd", "fmd_ae")
        )
        return Row(REAL, cells, len(test), dataset=test.name)

    def provenance(self) -> dict:
        """What a table says of itself."""
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


def _judge_of(judge: object, test: Dataset) -> object:
    """The judge, once it is sure that it knows these clips."""
    name, _ = test.name, test.skeleton  # an error if its clips have several
    if judge is None or isinstance(judge, str):
        judge = judges.load(judge or name)
    for label in ("content", "style"):
        classifier = getattr(judge, label, None)
        if classifier is None:
            raise MotionKitError(
                f"a judge has classifiers .content and .style, as mk.judges.load gives; found {judge!r}"
            )
        words = test.contents if label == "content" else test.styles
        unknown = [word for word in words if word not in classifier.labels]
        if unknown:
            raise MotionKitError(
                f"data set {name!r} has {label} {unknown[0]!r}, for which this judge was not trained; it knows "
                f"{', '.join(classifier.labels)}. Give a judge of this data set: run(..., judge=...)"
            )
        body = test[0].motion.without_helper_joints().skeleton
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
