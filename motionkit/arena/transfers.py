"""What a transfer is, and all that happens to it: a method makes a result, which is kept on disk, then measured.

Methods come as `MethodEntry`; `generate` makes their results, `save_result` keeps each as soon as it is there,
`evaluate` measures them, and `parallel` spreads all of it over processes.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
import os
import pickle
import random
import threading
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
import safetensors
import safetensors.torch
import torch
from joblib import Parallel, delayed, effective_n_jobs, wrap_non_picklable_objects
from torch import Tensor
from tqdm.auto import tqdm

from .. import actor, metrics
from .. import methods as kit
from ..actor import Performance, retell
from ..contacts import foot_contacts
from ..datasets import Clip, Dataset, Item, performed
from ..errors import MotionKitError, motion_inside
from ..files import read_bytes, write_atomic
from ..metrics import canonical_positions
from ..motion import Motion
from .cache_key import cache_key
from .protocols import Transfer

REAL = "real"  # the row of the test clips themselves

# Methods


@dataclass(frozen=True)
class MethodEntry:
    """A method under the name that its row has. key: changes when the method does, see `cache_key`."""

    name: str
    method: object
    key: str

    def fitted(self, train: Dataset) -> object:
        """The method, or where it learns from clips, a copy that has learned from these."""
        if not hasattr(self.method, "fit"):
            return self.method
        try:
            method = copy.deepcopy(self.method)
        except Exception:  # something in it cannot be copied: then it learns itself
            method = self.method
        result = method.fit(train)
        return method if result is None else result


def method_entries(methods: object) -> list[MethodEntry]:
    """The rows that a user named: a name, object or function, a list of such, or a dict from row name to such.

    Raises MotionKitError where a thing is no method, or two rows have one name.

    >>> [entry.name for entry in method_entries(["statistics", print])]
    ['statistics', 'print']
    """
    if isinstance(methods, Mapping):
        pairs = list(methods.items())
    else:
        several = isinstance(methods, Sequence | set) and not isinstance(methods, str)
        pairs = [(None, method) for method in (methods if several else [methods])]
    if not pairs:
        raise MotionKitError("the arena needs methods: names such as 'statistics', or {'mine': my_function}")
    entries = [_entry(name, method) for name, method in pairs]
    names = [entry.name for entry in entries]
    for name in names:
        if name == REAL or names.count(name) > 1:
            why = "is the row of the test clips" if name == REAL else "appears twice"
            raise MotionKitError(f"method name {name!r} {why}; give each a name of its own: {{'mine': method}}")
    return entries


def _entry(name: object, thing: object) -> MethodEntry:
    method = kit.load(thing) if isinstance(thing, str) else thing
    stylizes = any(callable(getattr(method, way, None)) for way in ("transfer", "stylize"))
    if isinstance(method, type) or not (stylizes or callable(method)):
        hint = f"; make one: {method.__name__}()" if isinstance(method, type) else ""
        raise MotionKitError(
            f"{thing!r} is no method{hint}. Give a name ({', '.join(kit.names())}), an object with "
            "stylize(content, style) or a function (content, style) -> Motion"
        )
    if not name and isinstance(thing, str):
        name = thing
    name = name or getattr(method, "name", None) or getattr(method, "__name__", None) or type(method).__name__
    if not isinstance(name, str):
        raise MotionKitError(f"methods are named by strings, {{'mine': my_function}}; found {name!r}")
    return MethodEntry(name, method, cache_key(method))


def restyle(method: object, content: Clip, style: Clip) -> object:
    """What a method makes of two clips: a `StyleTransfer` sees their labels, others and functions the motions alone.

    >>> from types import SimpleNamespace
    >>> restyle(lambda content, style: f"{content} as {style}", *(SimpleNamespace(motion=m) for m in ("walk", "old")))
    'walk as old'
    """
    if isinstance(method, kit.StyleTransfer):
        return method.stylize(content, style)
    if hasattr(method, "stylize"):
        return method.stylize(content.motion, style=style.motion)
    return method(content.motion, style.motion)


# Making results

_TASK = 64  # transfers, of one style clip


def generate(
    entry: MethodEntry, train: Dataset, test: Dataset, transfers: Sequence[Transfer], folder: Path, jobs: int | None
) -> dict[int, str]:
    """Make those results that are not in the folder yet, or are damaged; returns what failed, number to message."""
    missing = [n for n, transfer in enumerate(transfers) if not _is_whole(result_path(folder, n), transfer, test)]
    if not missing:
        return {}
    try:
        method = entry.fitted(train)
    except Exception as error:
        return dict.fromkeys(missing, f"fit: {_one_line(error)}")
    tasks = []
    for _, numbers in groupby(missing, key=lambda n: transfers[n][1:]):  # of one style clip and repeat
        numbered = [(n, transfers[n]) for n in numbers]
        tasks += [numbered[n : n + _TASK] for n in range(0, len(numbered), _TASK)]
    failures: dict[int, str] = {}
    for problems in parallel(_generate_task, (method, test, folder), tasks, jobs, entry.name, "transfer"):
        failures |= problems
    return failures


def _is_whole(path: Path, transfer: Transfer, test: Dataset) -> bool:
    """Whether a transfer's result is there; a damaged file is removed."""
    try:
        _, facts = load(path)
    except MotionKitError:
        path.unlink(missing_ok=True)
        return False
    return facts["clips"] == [test[transfer.content].name, test[transfer.style].name]


def _generate_task(shared: tuple[object, Dataset, Path], task: Sequence[tuple[int, Transfer]]) -> dict[int, str]:
    """A worker's part. Clips are read anew for each transfer: a method may have changed those that it got."""
    method, test, folder = shared
    failures = {}
    for number, transfer in task:
        content, style = test[transfer.content], test[transfer.style]
        original = test[transfer.content].motion
        names = [content.name, style.name]
        start = time.perf_counter()
        try:
            with seeded(zlib.crc32(" ".join([*names, str(transfer.repeat)]).encode())):
                result = restyle(method, content, style)
            problem = find_problem(result, original)
        except Exception as error:
            problem = _one_line(error)
        if problem:
            failures[number] = problem
        else:
            facts = {"clips": names, "seconds": time.perf_counter() - start}
            save_result(result_path(folder, number), result, original, facts)
    return failures


def find_problem(result: object, content: Motion) -> str:
    """What is wrong with a method's result; empty where it can be judged.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> find_problem(walk, walk), find_problem(None, walk)
    ('', 'gives a NoneType instead of a Motion')
    """
    if not isinstance(result, Motion):
        return f"gives a {type(result).__name__} instead of a Motion{motion_inside(result)}"
    if not result.skeleton.same_tree(content.skeleton):
        return f"gives another skeleton: {result.skeleton!r} instead of the content's {content.skeleton!r}"
    if not len(result):
        return "gives a motion of no frames"
    if not (result.rotations.isfinite().all() and result.translations.isfinite().all()):
        return "gives numbers that are not finite"
    if float((result.rotations.norm(dim=-1) - 1).abs().max()) > 1e-2:
        return "gives rotations that are no unit quaternions"
    if abs(result.fps - content.fps) > 1e-3 * content.fps:
        return f"gives {result.fps:g} frames a second instead of the content's {content.fps:g}; resample the result"
    return ""


def _one_line(error: BaseException) -> str:
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return text if len(text) <= 300 else text[:297] + "..."


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Chance as this seed has it, for torch, numpy and random; what chance was before goes on afterwards.

    >>> with seeded(3):
    ...     a = torch.rand(1)
    >>> with seeded(3):
    ...     a == torch.rand(1)
    tensor([True])
    """
    states = random.getstate(), np.random.get_state()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        np.random.seed(seed % 2**32)
        random.seed(seed)
        try:
            yield
        finally:
            random.setstate(states[0])
            np.random.set_state(states[1])


# Keeping them

FORMAT = 2  # to be raised when files or what is measured become others


def save(path: Path, tensors: Mapping[str, Tensor], facts: Mapping) -> None:
    """Write tensors, and facts that JSON can hold, with a checksum of both.

    >>> import tempfile, torch
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(Path(folder, "a.safetensors"), {"x": torch.ones(2)}, {"seconds": 0.5})
    ...     load(Path(folder, "a.safetensors"))
    ({'x': tensor([1., 1.])}, {'seconds': 0.5})
    """
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    text = json.dumps(facts)
    header = {"facts": text, "checksum": str(_checksum(tensors, text))}
    write_atomic(path, safetensors.torch.save(tensors, header))


def load(path: Path) -> tuple[dict[str, Tensor], dict]:
    """What `save` wrote; MotionKitError where the file is missing or not whole."""
    data = read_bytes(path)
    try:
        tensors = safetensors.torch.load(data)
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
        if int(header["checksum"]) != _checksum(tensors, header["facts"]):
            raise ValueError("its checksum is another")
        return tensors, json.loads(header["facts"])
    except (ValueError, KeyError, TypeError, safetensors.SafetensorError) as error:
        raise MotionKitError(f"{path}: damaged ({error}); run the arena again, which makes it anew") from None


def _checksum(tensors: Mapping[str, Tensor], text: str) -> int:
    checksum = zlib.crc32(text.encode())
    for name in sorted(tensors):
        checksum = zlib.crc32(tensors[name].numpy().tobytes(), checksum)
    return checksum


def result_path(folder: Path, number: int) -> Path:
    """Where the result of a transfer is kept."""
    return folder / f"{number:05d}.safetensors"


def save_result(path: Path, result: Motion, content: Motion, facts: Mapping) -> None:
    """Keep a method's result. Of the translations only those of joints that leave the skeleton's offsets."""
    translations = result.translations.float().cpu()
    moving = (translations != content.skeleton.offsets.float()).any(-1).any(0).nonzero()[:, 0]
    tensors = {"rotations": result.rotations.float(), "moving": moving, "translations": translations[:, moving]}
    save(path, tensors, {"name": result.name, **facts})


def load_result(path: Path, content: Motion) -> tuple[Motion, dict]:
    """A kept result, and the facts of its making; MotionKitError where it is missing or damaged."""
    tensors, facts = load(path)
    rotations = tensors["rotations"]
    translations = content.skeleton.offsets.float().expand(len(rotations), -1, -1).clone()
    translations[:, tensors["moving"]] = tensors["translations"]
    motion = Motion(content.skeleton, rotations, translations, content.fps, facts["name"], content.metres_per_unit)
    return motion, facts


# The exact answer


@dataclass(frozen=True)
class GroundTruth:
    """What the performer would have done. sources: clip name to what makes it. folder: where answers are kept."""

    sources: dict[str, performed.ActorSource]
    folder: Path

    @classmethod
    def for_dataset(cls, dataset: Dataset, folder: Path) -> GroundTruth | None:
        """The answers for a data set of the performer's, whole or in part; None for any other."""
        if dataset.name not in performed.TAKES:
            return None
        items, sources = _performed_items(dataset.name), {}
        for clip in dataset:
            item = items.get(clip.name)
            if item is None or (item.labels.content, item.labels.style) != (clip.content, clip.style):
                return None
            sources[clip.name] = item.source
        folder = folder / f"truths-{actor.VERSION}"
        folder.mkdir(parents=True, exist_ok=True)
        return cls(sources, folder)

    def answer(self, content: Clip, style: str) -> Motion | None:
        """The exact answer, frame by frame in the content's time; None where the performer knows no such style."""
        path = self.folder / f"{content.name}--{style}.safetensors"
        try:
            return load_result(path, content.motion)[0]
        except MotionKitError:
            pass  # not performed yet
        performance = _performance(self.sources[content.name])
        try:
            answer = retell(performance, style).time_aligned(performance)
        except MotionKitError:
            return None
        if len(answer) != len(content):
            return None
        save_result(path, answer, content.motion, {})
        return load_result(path, content.motion)[0]


@lru_cache(maxsize=4)
def _performed_items(name: str) -> dict[str, Item]:
    return {item.name: item for item in performed.items(name)}


@lru_cache(maxsize=128)
def _performance(source: performed.ActorSource) -> Performance:
    return source.perform()


def error_against(result: Motion, answer: Motion) -> float:
    """`metrics.truth_error`, the mean over joints, against an answer that is there already: mm.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> error_against(walk.transform(1.0, (2.0, 0.0, 0.0)), walk) < 0.01
    True
    """
    positions = [canonical_positions(answer, motion.positions()) for motion in (result, answer)]
    return 1000 * float(torch.linalg.vector_norm(positions[0] - positions[1], dim=-1).mean())


# Measuring them

JUDGE_OUTPUTS = ("content_scores", "content_features", "style_scores", "style_features", "ae_features")
VALUES = ("tsi", "fsf", "fca", "jitter", "truth_error", "seconds")
_PIECE = 32  # motions a task: enough for the judge to be quick, few enough to keep all cores busy


@dataclass(frozen=True, eq=False)
class Measures:
    """Figures of N motions, NaN where there is nothing.

    judge_outputs: by the names in `JUDGE_OUTPUTS`, [N, ...]; values: by those in `VALUES`, [N] float64. problems:
    number to message, of those that the judge could not see.
    """

    judge_outputs: dict[str, Tensor]
    values: dict[str, Tensor]
    problems: dict[int, str] = field(default_factory=dict)


class ContentClip(NamedTuple):
    """What results are compared with: a motion, its contacts as recorded and as detected (None: no feet), jitter."""

    motion: Motion
    contacts: Tensor | None
    detected: Tensor | None
    jitter: float


@dataclass(eq=False)
class Evaluator:
    """What measuring needs; workers keep one, with what it has worked out about content clips."""

    judge: object
    test: Dataset
    ground_truth: GroundTruth | None = None

    def __post_init__(self) -> None:
        self._contents: dict[int, ContentClip] = {}

    def judge_outputs(self, motions: Sequence[Motion]) -> dict[str, Tensor]:
        """What the judge says of motions, by the names in `JUDGE_OUTPUTS`."""
        outputs = {}
        for label in ("content", "style"):
            scores, features = getattr(self.judge, label).scores_and_features(motions)
            outputs |= {f"{label}_scores": scores.float(), f"{label}_features": features.float()}
        if getattr(self.judge, "autoencoder", None) is not None:
            outputs["ae_features"] = self.judge.autoencoder.features(motions).float()
        return outputs

    def judge_each(self, motions: Sequence[Motion]) -> tuple[dict[str, Tensor], list[int], dict[int, str]]:
        """As `judge_outputs`, of those motions that the judge can see; which these are; the others' complaints."""
        if not motions:
            return {}, [], {}
        try:
            return self.judge_outputs(motions), list(range(len(motions))), {}
        except Exception:
            rows, problems = {}, {}
        for n, motion in enumerate(motions):
            try:
                rows[n] = self.judge_outputs([motion])
            except Exception as error:
                problems[n] = f"judge: {_one_line(error)}"
        names = next(iter(rows.values()), ())
        return {name: torch.cat([row[name] for row in rows.values()]) for name in names}, list(rows), problems

    def content(self, number: int) -> ContentClip:
        """What results are compared with, of a content clip."""
        if number not in self._contents:
            clip = self.test[number]
            contacts = detected = _defined(lambda: foot_contacts(clip.motion), None)
            if detected is not None and clip.contacts.shape == detected.shape:
                contacts = clip.contacts
            jitter = _defined(lambda: metrics.jitter(clip.motion))
            self._contents[number] = ContentClip(clip.motion, contacts, detected, jitter)
        return self._contents[number]

    def values(self, result: Motion, transfer: Transfer) -> dict[str, float]:
        """The figures of one result that need no judge, but the seconds."""
        content = self.content(transfer.content)
        same_length = len(result) == len(content.motion)
        path, contacts = result, content.contacts
        if not same_length:  # then frames at equal shares of either clip
            shares = torch.linspace(0, len(result) - 1, len(content.motion), dtype=torch.float64)
            path, contacts = result.sample(shares), None
        values = {
            "tsi": _defined(lambda: metrics.trajectory_similarity(path, content.motion)),
            "fsf": _defined(lambda: metrics.foot_sliding_factor(result, contacts)),
            "jitter": _defined(lambda: metrics.jitter(result)) / content.jitter if content.jitter > 0 else math.nan,
        }
        if same_length and content.detected is not None:
            values["fca"] = _defined(lambda: metrics.foot_contact_accuracy(result, content.detected))
        if same_length and self.ground_truth is not None:
            answer = self.ground_truth.answer(self.test[transfer.content], self.test[transfer.style].style)
            if answer is not None:
                values["truth_error"] = _defined(lambda: error_against(result, answer))
        return values


def _defined(measure: Callable, otherwise: object = math.nan) -> object:
    """A figure, or nothing where it is not defined: for too few frames, or no feet."""
    try:
        return measure()
    except MotionKitError:
        return otherwise


def evaluate(
    evaluator: Evaluator, transfers: Sequence[Transfer], folder: Path, key: str, jobs: int | None, name: str
) -> Measures:
    """Figures of all results in a folder; what was measured before, and not made again since, is read."""
    pieces = folder / f"measures-{key}"
    pieces.mkdir(exist_ok=True)
    tasks = [list(enumerate(transfers[n : n + _PIECE], n)) for n in range(0, len(transfers), _PIECE)]
    missing = [task for task in tasks if _load_piece(pieces, folder, task) is None]
    for _ in parallel(_evaluate_task, (evaluator, folder, pieces), missing, jobs, f"measuring {name}", "result"):
        pass
    values = torch.full((len(transfers), len(VALUES)), math.nan, dtype=torch.float64)
    outputs: dict[str, Tensor] = {}
    problems = {}
    for task in tasks:
        tensors, facts = _load_piece(pieces, folder, task)
        values[tensors["numbers"]] = tensors["values"]
        problems |= {int(n): problem for n, problem in facts["problems"].items()}
        for output in JUDGE_OUTPUTS:
            if output in tensors:
                rows = outputs.setdefault(output, torch.full((len(transfers), tensors[output].shape[1]), math.nan))
                rows[tensors["judged"]] = tensors[output]
    return Measures(outputs, dict(zip(VALUES, values.T)), problems)


def _evaluate_task(shared: tuple[Evaluator, Path, Path], task: Sequence[tuple[int, Transfer]]) -> None:
    """A worker's part: figures of a few results, written as one piece."""
    evaluator, folder, pieces = shared
    states, results, rows = _file_states(folder, task), {}, []
    for number, transfer in task:
        try:
            results[number], facts = load_result(
                result_path(folder, number), evaluator.content(transfer.content).motion
            )
        except MotionKitError:
            continue  # it failed, and is counted
        values = {**evaluator.values(results[number], transfer), "seconds": facts["seconds"]}
        rows.append([values.get(name, math.nan) for name in VALUES])
    numbers = list(results)
    outputs, places, problems = evaluator.judge_each(list(results.values()))
    tensors = {
        "numbers": torch.tensor(numbers, dtype=torch.long),
        "values": torch.tensor(rows, dtype=torch.float64).reshape(-1, len(VALUES)),
        "judged": torch.tensor([numbers[place] for place in places], dtype=torch.long),
        **outputs,
    }
    facts = {"states": states, "problems": {numbers[place]: problem for place, problem in problems.items()}}
    save(_piece_path(pieces, task), tensors, facts)


def _piece_path(pieces: Path, task: Sequence[tuple[int, Transfer]]) -> Path:
    return pieces / f"{task[0][0]:05d}.safetensors"


def _load_piece(pieces: Path, folder: Path, task: Sequence) -> tuple[dict[str, Tensor], dict] | None:
    """A measured piece; None where it is not there, or of other results."""
    try:
        tensors, facts = load(_piece_path(pieces, task))
    except MotionKitError:
        return None
    return (tensors, facts) if facts["states"] == _file_states(folder, task) else None


def _file_states(folder: Path, task: Sequence[tuple[int, Transfer]]) -> list:
    """Size and time of each result's file, which change when it is written again; None where there is none."""
    states = []
    for number, _ in task:
        try:
            status = os.stat(result_path(folder, number))
            states.append([status.st_size, status.st_mtime_ns])
        except OSError:
            states.append(None)
    return states


def evaluate_clips(evaluator: Evaluator, clips: Dataset, path: Path, jobs: int | None) -> Measures:
    """What the judge says of captured or performed clips, and how much their own feet slide; kept in a file."""
    if not len(clips):
        return Measures({}, {"fsf": torch.zeros(0, dtype=torch.float64)})
    try:
        outputs, _ = load(path)
    except MotionKitError:
        numbers = list(range(len(clips)))
        tasks = [numbers[n : n + _PIECE] for n in range(0, len(numbers), _PIECE)]
        parts = list(parallel(_evaluate_clips_task, (evaluator, clips), tasks, jobs, "measuring clips", "clip"))
        outputs = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
        save(path, outputs, {})
    undefined = torch.full((len(clips),), math.nan, dtype=torch.float64)
    values = {**dict.fromkeys(VALUES, undefined), "fsf": outputs.pop("fsf")}
    return Measures(outputs, values)


def _evaluate_clips_task(shared: tuple[Evaluator, Dataset], numbers: Sequence[int]) -> dict[str, Tensor]:
    evaluator, clips = shared
    sliding = [_defined(lambda n=n: metrics.foot_sliding_factor(clips[n].motion, clips[n].contacts)) for n in numbers]
    outputs = evaluator.judge_outputs([clips[n].motion for n in numbers])
    return {**outputs, "fsf": torch.tensor(sliding, dtype=torch.float64)}


# Fanning out

_FEW = 24  # up to so many pieces, starting other processes takes longer than doing them


def parallel(
    function: Callable, shared: object, tasks: Sequence[Sequence], jobs: int | None, title: str, unit: str
) -> Iterator:
    """What function(shared, task) returns for each task, in order, with a progress bar that counts their pieces.

    jobs: processes; all cores if left out. joblib's settings count: under `joblib.parallel_config("dask")` a cluster
    works. Raises MotionKitError where a worker dies, or `shared` cannot be sent.

    >>> list(parallel(lambda shared, task: shared + sum(task), 10, [[1, 2], [3]], 1, "adding", "number"))
    [13, 13]
    """
    if jobs is not None and (not isinstance(jobs, int) or isinstance(jobs, bool) or jobs == 0):
        raise MotionKitError(f"jobs: expected a number of processes, or None for one a core; found {jobs!r}")
    jobs, pieces = effective_n_jobs(-1 if jobs is None else jobs), sum(map(len, tasks))
    if jobs == 1 or len(tasks) < 2 or pieces <= _FEW:
        results = (one_thread()(function)(shared, task) for task in tasks)
    else:
        results = _in_processes(function, shared, tasks, jobs)
    with tqdm(total=pieces, desc=title, unit=unit, leave=False) as progress, warnings.catch_warnings():
        # loky replaces a worker whose caches have grown, as they are meant to; nothing is lost by it
        warnings.filterwarnings("ignore", "A worker stopped while some jobs were given")
        for task, result in zip(tasks, results):
            progress.update(len(task))
            yield result


def _in_processes(function: Callable, shared: object, tasks: Sequence[Sequence], jobs: int) -> Iterator:
    try:  # cloudpickle, for what a notebook defines; once, not for each task
        data = pickle.dumps(wrap_non_picklable_objects(shared, keep_wrapper=False))
    except Exception as error:
        raise MotionKitError(f"cannot be sent to other processes ({error}); run the arena with jobs=1") from None
    try:
        workers = Parallel(jobs, return_as="generator", pre_dispatch="2*n_jobs", batch_size=1)
    except ValueError:  # a backend that hands all results over together
        workers = Parallel(jobs)
    try:
        yield from workers(delayed(_in_worker)(function, data, task) for task in tasks)
    except BrokenProcessPool as error:
        raise MotionKitError(
            f"a worker process died ({type(error).__name__}), often because memory ran out. What was done is kept: run "
            "again, with jobs=1 to use less"
        ) from None


_worker = threading.local()  # what the tasks of a worker share, unpacked once, with the caches that it fills


def _in_worker(function: Callable, data: bytes, task: Sequence) -> object:
    if getattr(_worker, "data", None) != data:
        _worker.data, _worker.shared = data, pickle.loads(data)
    return one_thread()(function)(_worker.shared, task)


@contextmanager
def one_thread() -> Iterator[None]:
    """Torch computes on one thread: sums come out the same to the last digit, and small ones sooner.

    >>> with one_thread():
    ...     torch.get_num_threads()
    1
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@one_thread()
def judge_key(evaluator: Evaluator) -> str:
    """Changes when what the judge says of the first clips does."""
    outputs = evaluator.judge_outputs([evaluator.test[n].motion for n in range(min(4, len(evaluator.test)))])
    text = [f"{name} {(x.double() * 100).round().long().tolist()}" for name, x in sorted(outputs.items())]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:12]
