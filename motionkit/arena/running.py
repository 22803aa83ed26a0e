"""The arena's one call: make what is missing, measure it, and return the table."""

from __future__ import annotations

import hashlib
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import torch

import motionkit

from .. import datasets, judges
from ..datasets import Dataset, Split
from ..datasets.cache import make_folder
from ..errors import MotionKitError
from ..files import cache_folder
from .cache_key import dataset_key
from .protocols import Protocol, Transfer, get_protocol
from .table import ArenaTable, EvalContext, Results, Row, figures
from .transfers import (
    FORMAT,
    REAL,
    Evaluator,
    GroundTruth,
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
    test, judge = split.test, _judge_of(judge, split.test)
    transfers = protocol.transfers(test, seed)
    base = Path(folder).expanduser() if folder is not None else cache_folder() / "arena"
    evaluator = Evaluator(judge, test, GroundTruth.for_dataset(test, base))
    key = judge_key(evaluator)

    # What the judge sees in the clips themselves, whatever the protocol, and in as many training clips
    train, clips_folder = _sample(split.train, len(test), seed), _folder(base, split, "clips")
    clips = evaluate_clips(evaluator, test, clips_folder / f"clips-test-{key}.safetensors", jobs)
    train_clips = evaluate_clips(evaluator, train, clips_folder / f"clips-train-{seed}-{key}.safetensors", jobs)
    ids = {label: getattr(judge, label).ids([getattr(clip, label) for clip in test]) for label in ("content", "style")}

    # A row for each method: its results, made first where they are missing, and their figures
    contents, styles, repeats = map(torch.tensor, zip(*transfers))
    right_ids = {"content": ids["content"][contents], "style": ids["style"][styles]}
    context = EvalContext(contents, styles, repeats, right_ids, clips, shrinkage, seed)
    protocol_folder = _folder(base, split, f"{_plain(protocol.name)}-{seed}", f" {protocol!r} {seed}")
    rows, results = [], {}
    for entry in entries:
        place = protocol_folder / f"{_plain(entry.name)}-{entry.key}"
        place.mkdir(exist_ok=True)
        if not resume:
            for n in range(len(transfers)):
                result_path(place, n).unlink(missing_ok=True)
        failed = generate(entry, split.train, test, transfers, place, jobs)
        measures = evaluate(evaluator, transfers, place, key, jobs, entry.name)
        measures = replace(measures, problems=dict(sorted({**measures.problems, **failed}.items())))
        failed = {
            n: f"{test[transfers[n].content].name} as {test[transfers[n].style].name}: {problem}"
            for n, problem in measures.problems.items()
        }
        cells = figures(measures, context, protocol.columns)
        rows.append(Row(entry.name, cells, len(transfers), failed, test.name))
        results[entry.name] = Results(entry.name, test, transfers, measures, right_ids, place)

    # The row of the test clips: what the judge names of them, and how far as many training clips are from them
    alone, sample = (EvalContext.of_clips(len(part), ids, clips, shrinkage) for part in (test, train))
    cells = figures(clips, alone, ("cra", "sra", "fsf")) | figures(train_clips, sample, ("fmd", "fmd_ae"))
    rows.append(Row(REAL, cells, len(test), dataset=test.name))
    results[REAL] = Results(REAL, test, tuple(Transfer(n, n) for n in range(len(test))), clips, ids)

    # The protocol's columns but those that no row can have, as the truth's where nobody knows it
    columns = [c for c in protocol.columns if any(not math.isnan(row.cell(c).value) for row in rows)]
    provenance = {
        "dataset": test.name,
        "train_clips": len(split.train),
        "test_clips": len(test),
        "protocol": protocol.name,
        "repeats": protocol.repeats,
        "seed": seed,
        "transfers": len(transfers),
        "judge": getattr(judge, "name", type(judge).__name__),
        "shrinkage": shrinkage,
        "motionkit": motionkit.__version__,
    }
    return ArenaTable(tuple(rows), tuple(columns) or protocol.columns, provenance, results)


def _folder(base: Path, split: Split, name: str, about: str = "") -> Path:
    """A folder of these clips, and of what else it is about."""
    text = f"{FORMAT} {dataset_key(split.train, split.test)}{about}"
    place = base / f"{_plain(split.test.name)}-{name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    return make_folder(place, "give another one: run(..., folder=...)")


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
    return train._some([train.numbers[n] for n in sorted(mixed[:count])])


def _plain(name: str) -> str:
    """A name that every system takes for a folder."""
    return re.sub(r"[^\w.=-]+", "_", name)[:60].strip(".") or "_"
