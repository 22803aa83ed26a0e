"""The arena's one call: make what is missing, measure it, and return the table."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch

import motionkit

from .. import datasets
from ..datasets import Dataset, Split
from ..datasets.store import cache_folder, make_folder
from ..errors import MotionKitError
from . import kept
from .entrants import REAL, Entrant, entrants_of
from .fingerprints import dataset_key
from .making import make_results
from .measuring import Bench, Measured, judge_key, measure_clips, measure_results
from .protocols import Protocol, Transfer, protocol_named
from .scoring import Setting, scores_of, scores_of_clips
from .table import ArenaTable, Row
from .truths import Truths
from .views import Results


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
    """Let methods restyle the same clips, and measure what they make.

    methods: a name that `mk.methods.load` knows, an object with `stylize(content, style)`, a function of two motions
    that returns one; a list of these, or a dict from a row's name to one: `mk.arena.run({"mine": my_function})`. One
    with `fit` learns from the data set's training clips first (a copy of it); one with `transfer(content, style)` gets
    clips, with their labels. dataset: a name, with `root` as in `mk.datasets.load`; a Dataset, which is split as
    `Dataset.split` does; or a Split. protocol: which clips are restyled after which, see `PROTOCOLS`. judge: what
    measures, by default `mk.judges.load` of the data set's name; it must know the data set's labels and skeleton.
    shrinkage: for Fréchet distances of too few motions, see `mk.metrics.fmd`.

    Every result goes to disk as soon as it is there, below `folder` (by default in the cache, see MOTIONKIT_CACHE): a
    run that is stopped, or killed, goes on where it was, and results that are there are not made again until the data,
    the protocol, the seed or the method change. Of a function that is its code, constants, defaults and closure, and
    what it names of its own module or notebook; what it calls elsewhere is not looked at: `resume=False` makes all
    again. Chance is seeded for each transfer, so that one seed gives one table (all but the seconds), however many
    jobs. jobs: processes; a core each if left out. Under `joblib.parallel_config("dask")` a cluster works, whose
    machines must see the folder and the cache.

    A transfer that fails (an error, no Motion, another skeleton, no frames, numbers that are not finite) is counted,
    shown below the table, and tried again by the next run; accuracies count it as wrong. Raises MotionKitError where
    methods, data set, protocol and judge do not fit together.

    >>> import motionkit as mk
    >>> mk.arena.run("statistics", protocol="paper-7")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: no protocol 'paper-7'; there are 'paper-1', ...
    """
    entrants, protocol = entrants_of(methods), protocol_named(protocol)
    if not isinstance(seed, int):
        raise MotionKitError(f"the arena's seed is a whole number; found {seed!r}")
    split = _split_of(dataset, root)
    judge = _judge_of(judge, split)
    transfers = protocol.transfers(split.test, seed)
    base = Path(folder).expanduser() if folder is not None else cache_folder() / "arena"
    place = make_folder(base / _place_name(split, protocol, seed), "give another one: run(..., folder=...)")
    bench = Bench(judge, split.test, Truths.of(split.test, base))
    key = judge_key(bench)
    train = _sample(split.train, len(split.test), seed)
    clips = measure_clips(bench, split.test, place, f"test-{key}", jobs)
    learned = measure_clips(bench, train, place, f"train-{key}", jobs)
    setting = _setting(transfers, split.test, judge, clips, shrinkage, seed)
    rows, views, right = [], {}, {"content": setting.content_ids, "style": setting.style_ids}
    for entrant in entrants:
        own, measured = _played(entrant, split, transfers, place, bench, key, jobs, resume)
        rows.append(
            Row(entrant.name, scores_of(measured, setting, protocol.columns), len(transfers), measured.problems)
        )
        views[entrant.name] = Results(entrant.name, split.test, transfers, measured, right, own)
    ids = {label: _ids(judge, split.test, label) for label in ("content", "style")}
    if len(train):
        rows.append(Row(REAL, scores_of_clips(clips, ids, learned, setting), len(split.test)))
    views[REAL] = Results(REAL, split.test, tuple(Transfer(n, n) for n in range(len(split.test))), clips, ids)
    return ArenaTable(
        tuple(rows), protocol.columns, _provenance(split, protocol, seed, transfers, judge, shrinkage), views
    )


def _played(
    entrant: Entrant,
    split: Split,
    transfers: Sequence[Transfer],
    place: Path,
    bench: Bench,
    key: str,
    jobs: int | None,
    resume: bool,
) -> tuple[Path, Measured]:
    """A method's folder, and the figures of its results, made first where they are missing."""
    own = place / f"{_plain(entrant.name)}-{entrant.key}"
    own.mkdir(exist_ok=True)
    if not resume:
        for n in range(len(transfers)):
            kept.result_path(own, n).unlink(missing_ok=True)
    failed = make_results(entrant, split.train, split.test, transfers, own, jobs)
    measured = measure_results(bench, transfers, own, key, jobs, entrant.name)
    return own, replace(measured, problems=dict(sorted({**measured.problems, **failed}.items())))


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
        body = split.test[0].motion.body().skeleton
        if not classifier.skeleton.same_tree(body):
            raise MotionKitError(
                f"data set {name!r} has {body!r}, and this judge's {label} classifier was trained on "
                f"{classifier.skeleton!r} with other joints; give a judge of this data set, or retarget the clips"
            )
    return judge


def _ids(judge: object, clips: Dataset, label: str) -> torch.Tensor:
    return getattr(judge, label).ids([getattr(clip, label) for clip in clips])


def _setting(
    transfers: Sequence[Transfer], test: Dataset, judge: object, clips: Measured, shrinkage: float | None, seed: int
) -> Setting:
    contents, styles, repeats = (torch.tensor(numbers) for numbers in zip(*transfers))
    ids = [_ids(judge, test, label)[which] for label, which in (("content", contents), ("style", styles))]
    return Setting(contents, styles, *ids, repeats, clips, shrinkage, seed)


def _sample(train: Dataset, count: int, seed: int) -> Dataset:
    """As many training clips as there are test clips, drawn by their names."""
    names = {n: f"{seed} {train[n].name}" for n in range(len(train))}
    mixed = sorted(names, key=lambda n: hashlib.sha256(names[n].encode()).digest())
    return train._some([train.numbers[n] for n in sorted(mixed[:count])])


def _place_name(split: Split, protocol: Protocol, seed: int) -> str:
    text = f"{kept.FORMAT} {dataset_key(split.train, split.test)} {protocol!r} {seed}"
    key = hashlib.sha256(text.encode()).hexdigest()[:12]
    return f"{_plain(split.test.name)}-{_plain(protocol.name)}-{seed}-{key}"


def _plain(name: str) -> str:
    """A name that every system takes for a folder."""
    return re.sub(r"[^\w.=-]+", "_", name)[:60].strip(".") or "_"


def _provenance(
    split: Split, protocol: Protocol, seed: int, transfers: Sequence[Transfer], judge: object, shrinkage: float | None
) -> dict:
    return {
        "dataset": split.test.name,
        "train_clips": len(split.train),
        "test_clips": len(split.test),
        "protocol": protocol.name,
        "repeats": protocol.repeats,
        "seed": seed,
        "transfers": len(transfers),
        "judge": getattr(judge, "name", type(judge).__name__),
        "shrinkage": shrinkage,
        "motionkit": motionkit.__version__,
    }
