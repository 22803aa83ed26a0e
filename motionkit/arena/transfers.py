"""A key for anything that makes results: it changes when what is known of the thing does."""

from __future__ import annotations

import copy
import enum
import functools
import hashlib
import inspect
import json
import math
import os
import pickle
import random
import time
import types
import warnings
import zlib
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import local
from uuid import uuid4

import numpy as np
import safetensors
import torch
from safetensors.torch import load as tensors_of
from safetensors.torch import save as bytes_of
from torch import Tensor

from .. import actor, metrics
from .. import methods as kit
from ..actor import Performance, retell
from ..contacts import foot_contacts
from ..datasets import Clip, Dataset, Item, performed
from ..errors import MotionKitError, motion_inside
from ..files import read_bytes, write_atomic
from ..metrics import canonical_positions
from ..motion import Motion
from .protocols import Transfer

_PLAIN = (type(None), bool, int, float, complex, str, bytes, enum.Enum)
_CALLED = (type, types.FunctionType, types.MethodType, types.BuiltinFunctionType, types.ModuleType, functools.partial)


def cache_key(thing: object) -> str:
    """Sixteen hex digits that change with what a method is made of, and are the same in every process.

    A function: its code, constants, defaults, closure, and the plain values and functions of its own module that it
    names. What it calls in other modules is not looked at. An object: its class' code and all that it holds, or what
    its `__getstate__` says, so that caches can be kept out. The kit's own classes and functions count by their name
    and `version`, a number that is raised when their answers change.

    >>> def f(a, b, share=0.5):
    ...     return a
    >>> def g(a, b, share=0.7):
    ...     return a
    >>> cache_key(f) == cache_key(f), cache_key(f) == cache_key(g)
    (True, False)
    """
    digest = hashlib.sha256()
    try:
        for part in _parts(thing, {}):
            digest.update(part + b"\0")
    except RecursionError:
        raise _unknown(thing, "it holds too much that holds more") from None
    return digest.hexdigest()[:16]


def dataset_key(*datasets: Dataset) -> str:
    """Changes with the clips of data sets: their names, labels and numbers.

    >>> import motionkit as mk
    >>> item = mk.datasets.Item("a", mk.datasets.Labels("walk", "old", ()), mk.datasets.BvhSource.at(
    ...     "data/actor/walk_old.bvh"))
    >>> len(dataset_key(mk.datasets.from_items("mine", [item])))
    16
    """
    digest = hashlib.sha256()
    for dataset in datasets:
        for n in dataset.numbers:
            clip, labels = dataset.store.clips[n], dataset.labels[n]
            digest.update(f"{clip.name}\t{clip.checksum}\t{labels.content}\t{labels.style}\n".encode())
        digest.update(b"\n")
    return digest.hexdigest()[:16]


def _parts(thing: object, seen: dict[int, object]) -> Iterator[bytes]:
    """What a thing is made of, as bytes; `seen` keeps what was passed, so that circles end and addresses stay."""
    if isinstance(thing, _PLAIN):
        yield f"{type(thing).__name__} {thing!r}".encode()
    elif id(thing) in seen:
        yield b"again"
    else:
        seen[id(thing)] = thing
        yield type(thing).__qualname__.encode()
        yield from _inside(thing, seen)


def _inside(thing: object, seen: dict[int, object]) -> Iterator[bytes]:
    if isinstance(thing, torch.Tensor | np.ndarray):
        array = np.ascontiguousarray(torch.as_tensor(thing).detach().cpu().numpy())
        yield f"{array.dtype} {array.shape}".encode()
        yield array.tobytes()
    elif isinstance(thing, Mapping):
        for key in sorted(thing, key=repr):
            yield from _parts(key, seen)
            yield from _parts(thing[key], seen)
    elif isinstance(thing, set | frozenset):
        yield from map(str.encode, sorted(cache_key(x) for x in thing))
    elif isinstance(thing, list | tuple):
        for value in thing:
            yield from _parts(value, seen)
    elif isinstance(thing, Dataset):
        yield dataset_key(thing).encode()
    elif isinstance(thing, _CALLED):
        yield from _called(thing, seen)
    else:
        yield from _parts(type(thing), seen)
        yield from _state(thing, seen)


def _called(thing: object, seen: dict[int, object]) -> Iterator[bytes]:
    """Functions and classes."""
    module = getattr(thing, "__module__", None) or ""
    yield f"{module} {getattr(thing, '__qualname__', '')}".encode()
    if isinstance(thing, types.MethodType):
        yield from _parts(thing.__func__, seen)
        yield from _parts(thing.__self__, seen)
    elif isinstance(thing, functools.partial):
        yield from _parts((thing.func, thing.args, thing.keywords), seen)
    elif module.split(".")[0] == "motionkit":
        yield str(getattr(thing, "version", "")).encode()
    elif isinstance(thing, type) and _is_users(module):
        for name, value in sorted(vars(thing).items()):
            if isinstance(value, staticmethod | classmethod | property | functools.cached_property):
                value = getattr(value, "__func__", None) or getattr(value, "fget", None) or getattr(value, "func", None)
            if isinstance(value, (types.FunctionType, *_PLAIN, tuple, list, dict)) and name not in _NAMES:
                yield name.encode()
                yield from _parts(value, seen)
        for base in thing.__bases__:
            yield from _parts(base, seen)
    elif isinstance(thing, types.FunctionType) and _is_users(module):
        yield from _function(thing, seen)


_NAMES = ("__module__", "__qualname__", "__doc__", "__firstlineno__", "__static_attributes__", "__annotations__")
_LIBRARIES = ("builtins", "torch", "numpy", "scipy", "functools", "abc", "typing", "collections", "dataclasses")


def _is_users(module: str) -> bool:
    """Whether somebody may be working on it right now."""
    return module.split(".")[0] not in _LIBRARIES


def _function(function: types.FunctionType, seen: dict[int, object]) -> Iterator[bytes]:
    yield from _code(function.__code__, seen)
    yield from _parts((function.__defaults__, function.__kwdefaults__), seen)
    for cell in function.__closure__ or ():
        try:
            yield from _parts(cell.cell_contents, seen)
        except ValueError:  # a name that has no value yet
            yield b"empty"
    for name in sorted(_names_in(function.__code__)):
        value = function.__globals__.get(name)
        own = isinstance(value, type | types.FunctionType) and value.__module__ == function.__module__
        if value is not None and (own or not (callable(value) or isinstance(value, types.ModuleType))):
            yield name.encode()
            yield from _parts(value, seen)


def _code(code: types.CodeType, seen: dict[int, object]) -> Iterator[bytes]:
    yield code.co_code
    yield repr(code.co_names).encode()
    for constant in code.co_consts:
        yield from _code(constant, seen) if isinstance(constant, types.CodeType) else _parts(constant, {})


def _names_in(code: types.CodeType) -> set[str]:
    found = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            found |= _names_in(constant)
    return found


def _state(thing: object, seen: dict[int, object]) -> Iterator[bytes]:
    """What an object holds."""
    own = getattr(type(thing), "__getstate__", None)
    if own is not None and own is not getattr(object, "__getstate__", None):
        yield from _parts(own(thing), seen)
        return
    if isinstance(thing, torch.nn.Module):
        yield from _parts({**thing.state_dict(), "training": thing.training, "text": repr(thing)}, seen)
    held = dict(getattr(thing, "__dict__", {}))
    for cls in type(thing).__mro__:
        slots = vars(cls).get("__slots__", ())
        for name in (slots,) if isinstance(slots, str) else slots:
            if inspect.ismemberdescriptor(vars(cls).get(name)) and hasattr(thing, name):
                held[name] = getattr(thing, name)
    if isinstance(thing, torch.nn.Module):
        held = {k: v for k, v in held.items() if not k.startswith("_")}
    if not held and not hasattr(thing, "__dict__"):
        yield _pickled(thing)
    yield from _parts(held, seen)


def _pickled(thing: object) -> bytes:
    """Of an object that shows nothing of itself, what a copy would need."""
    try:
        return pickle.dumps(thing)
    except Exception as error:
        raise _unknown(thing, error) from None


def _unknown(thing: object, why: object) -> MotionKitError:
    return MotionKitError(
        f"{type(thing).__name__}: cannot tell whether it is the same as at the last run ({why}); give its class a "
        "__getstate__ that returns what results depend on"
    )


REAL = "real"  # the row of the test clips themselves


@dataclass(frozen=True)
class MethodEntry:
    """A method under the name that its row has. key: changes when the method does, see `cache_key`."""

    name: str
    method: object
    key: str

    def ready(self, train: Dataset) -> object:
        """The method, or where it learns from clips, a copy that has learned from these."""
        if not hasattr(self.method, "fit"):
            return self.method
        try:
            own = copy.deepcopy(self.method)
        except Exception:  # something in it cannot be copied: then it is taught itself
            own = self.method
        fitted = own.fit(train)
        return own if fitted is None else fitted


def restyle(method: object, content: Clip, style: Clip) -> object:
    """What a method makes of two clips: `transfer` sees their labels, `stylize` and plain functions the motions.

    >>> from types import SimpleNamespace
    >>> restyle(lambda content, style: f"{content} as {style}", *(SimpleNamespace(motion=m) for m in ("walk", "old")))
    'walk as old'
    """
    if hasattr(method, "transfer"):
        return method.transfer(content, style)
    if hasattr(method, "stylize"):
        return method.stylize(content.motion, style=style.motion)
    return method(content.motion, style.motion)


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


def method_entries(methods: object) -> list[MethodEntry]:
    """The entrants that a user named: a name, object or function, a list of such, or a dict from row name to such.

    Raises MotionKitError where a thing is no method, or two rows have one name.

    >>> [entrant.name for entrant in method_entries(["statistics", print])]
    ['statistics', 'print']
    """
    if isinstance(methods, Mapping):
        pairs = list(methods.items())
    else:
        several = isinstance(methods, Sequence | set) and not isinstance(methods, str)
        pairs = [(None, method) for method in (methods if several else [methods])]
    if not pairs:
        raise MotionKitError("the arena needs methods: names such as 'statistics', or {'mine': my_function}")
    found = [_entrant(name, method) for name, method in pairs]
    names = [entrant.name for entrant in found]
    for name in names:
        if name == REAL or names.count(name) > 1:
            why = "is the row of the test clips" if name == REAL else "appears twice"
            raise MotionKitError(f"method name {name!r} {why}; give each a name of its own: {{'mine': method}}")
    return found


def _entrant(name: object, given: object) -> MethodEntry:
    method = kit.load(given) if isinstance(given, str) else given
    asked = any(callable(getattr(method, way, None)) for way in ("transfer", "stylize"))
    if isinstance(method, type) or not (asked or callable(method)):
        hint = f"; make one: {method.__name__}()" if isinstance(method, type) else ""
        raise MotionKitError(
            f"{given!r} is no method{hint}. Give a name ({', '.join(kit.names())}), an object with "
            "stylize(content, style) or a function (content, style) -> Motion"
        )
    name = name or (given if isinstance(given, str) else _name_of(method))
    if not isinstance(name, str):
        raise MotionKitError(f"methods are named by strings, {{'mine': my_function}}; found {name!r}")
    return MethodEntry(name, method, cache_key(method))


def _name_of(method: object) -> str:
    return getattr(method, "name", None) or getattr(method, "__name__", None) or type(method).__name__


@dataclass(frozen=True)
class GroundTruth:
    """What the performer would have done. sources: clip name to what makes it. folder: where answers are kept."""

    sources: dict[str, performed.ActorSource]
    folder: Path

    @classmethod
    def of(cls, dataset: Dataset, folder: Path) -> GroundTruth | None:
        """The answers for a data set of the performer's, whole or in part; None for any other."""
        if dataset.name not in performed.TAKES:
            return None
        known, found = _items(dataset.name), {}
        for clip in dataset:
            item = known.get(clip.name)
            if item is None or (item.labels.content, item.labels.style) != (clip.content, clip.style):
                return None
            found[clip.name] = item.source
        folder = folder / f"truths-{actor.VERSION}"
        folder.mkdir(parents=True, exist_ok=True)
        return cls(found, folder)

    def answer(self, content: Clip, style: str) -> Motion | None:
        """The exact answer, frame by frame in the content's time; None where the performer knows no such style."""
        path = self.folder / f"{content.name}--{style}.safetensors"
        try:
            return load_result(path, content.motion)[0]
        except MotionKitError:
            pass  # not told yet
        performance = _performance(self.sources[content.name])
        try:
            told = retell(performance, style).time_aligned(performance)
        except MotionKitError:
            return None
        if len(told) != len(content):
            return None
        save_result(path, told, content.motion, {})
        return load_result(path, content.motion)[0]


@lru_cache(maxsize=4)
def _items(name: str) -> dict[str, Item]:
    return {item.name: item for item in performed.items(name)}


@lru_cache(maxsize=128)
def _performance(source: performed.ActorSource) -> Performance:
    return source.perform()


def error_against(result: Motion, answer: Motion) -> float:
    """`metrics.truth_error`, the mean over joints, against an answer that is told already: mm.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> error_against(walk.transform(1.0, (2.0, 0.0, 0.0)), walk) < 0.01
    True
    """
    places = (canonical_positions(answer, motion.positions()) for motion in (result, answer))
    return 1000 * float(torch.linalg.vector_norm(torch.sub(*places), dim=-1).mean())


FORMAT = 1  # to be raised when files or what is measured become others


def save(path: Path, tensors: Mapping[str, Tensor], facts: Mapping) -> None:
    """Write tensors, and facts that JSON can hold, with a checksum of both.

    >>> import tempfile, torch
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(Path(folder, "a.safetensors"), {"x": torch.ones(2)}, {"seconds": 0.5})
    ...     load(Path(folder, "a.safetensors"))
    ({'x': tensor([1., 1.])}, {'seconds': 0.5})
    """
    plain, text = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, json.dumps(facts)
    write_atomic(path, bytes_of(plain, {"facts": text, "checksum": str(_checksum(plain, text))}))


def load(path: Path) -> tuple[dict[str, Tensor], dict]:
    """What `save` wrote; MotionKitError where the file is missing or not whole."""
    data = read_bytes(path)
    try:
        tensors = tensors_of(data)
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
        if int(header["checksum"]) != _checksum(tensors, header["facts"]):
            raise ValueError("its checksum is another")
        return tensors, json.loads(header["facts"])
    except (ValueError, KeyError, TypeError, safetensors.SafetensorError) as error:
        raise MotionKitError(f"{path}: damaged ({error}); run the arena again, which makes it anew") from None


def _checksum(tensors: Mapping[str, Tensor], text: str) -> int:
    found = zlib.crc32(text.encode())
    for name in sorted(tensors):
        found = zlib.crc32(tensors[name].numpy().tobytes(), found)
    return found


def result_path(folder: Path, number: int) -> Path:
    """Where the result of a transfer is kept."""
    return folder / f"{number:05d}.safetensors"


def save_result(path: Path, result: Motion, content: Motion, facts: Mapping) -> None:
    """Keep a method's result. Of the translations only those of joints that leave the skeleton's offsets."""
    moves = result.translations.float().cpu()
    moving = (moves != content.skeleton.offsets.float()).any(-1).any(0).nonzero()[:, 0]
    tensors = {"rotations": result.rotations.float(), "moving": moving, "translations": moves[:, moving]}
    save(path, tensors, {"name": result.name, **facts})


def load_result(path: Path, content: Motion) -> tuple[Motion, dict]:
    """A kept result, and the facts of its making; MotionKitError where it is missing or damaged."""
    tensors, facts = load(path)
    turns = tensors["rotations"]
    moves = content.skeleton.offsets.float().expand(len(turns), -1, -1).clone()
    moves[:, tensors["moving"]] = tensors["translations"]
    return Motion(content.skeleton, turns, moves, content.fps, facts["name"], content.metres_per_unit), facts


def state(path: Path) -> tuple[int, int] | None:
    """Size and time of a file, which change when it is written again; None where there is none."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns


_TASK = 64  # transfers, of one style clip


def generate(
    entrant: MethodEntry, train: Dataset, test: Dataset, transfers: Sequence[Transfer], folder: Path, jobs: int | None
) -> dict[int, str]:
    """Make those results that are not in the folder yet, or are damaged; returns what failed, number to message."""
    missing = [n for n, transfer in enumerate(transfers) if not _is_whole(folder, n, transfer, test)]
    if not missing:
        return {}
    failed: dict[int, str] = {}
    try:
        method = entrant.ready(train)
    except Exception as error:
        return dict.fromkeys(missing, f"fit: {message_of(error)}")
    tasks = [[(n, transfers[n]) for n in part] for part in chunks(transfers, missing)]
    for found in parallel(_make, (method, test, folder), tasks, jobs, entrant.name, "transfer"):
        failed |= found
    return failed


def chunks(transfers: Sequence[Transfer], numbers: Sequence[int]) -> Iterator[list[int]]:
    """Numbers of transfers in pieces, each of one style clip and repeat.

    >>> list(chunks([Transfer(0, 1), Transfer(2, 1), Transfer(1, 0)], range(3)))
    [[0, 1], [2]]
    """
    piece: list[int] = []
    for n in numbers:
        if piece and (len(piece) >= _TASK or transfers[n][1:] != transfers[piece[0]][1:]):
            yield piece
            piece = []
        piece.append(n)
    if piece:
        yield piece


def message_of(error: BaseException) -> str:
    """An error in one line.

    >>> message_of(KeyError("old"))
    "KeyError: 'old'"
    """
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return text if len(text) <= 300 else text[:297] + "..."


def _is_whole(folder: Path, number: int, transfer: Transfer, test: Dataset) -> bool:
    path = result_path(folder, number)
    try:
        _, facts = load(path)
    except MotionKitError:
        path.unlink(missing_ok=True)
        return False
    return facts["clips"] == [test[transfer.content].name, test[transfer.style].name]


def _make(shared: tuple[object, Dataset, Path], task: Sequence[tuple[int, Transfer]]) -> dict[int, str]:
    """A worker's piece. Clips are read anew for each transfer: a method may have changed those that it got."""
    method, test, folder = shared
    failed = {}
    for number, transfer in task:
        content, style = test[transfer.content], test[transfer.style]
        original = test[transfer.content].motion
        clips = [content.name, style.name]
        start = time.perf_counter()
        try:
            with seeded(zlib.crc32(" ".join([*clips, str(transfer.repeat)]).encode())):
                result = restyle(method, content, style)
            problem = find_problem(result, original)
        except Exception as error:
            problem = message_of(error)
        if problem:
            failed[number] = problem
            continue
        facts = {"clips": clips, "seconds": time.perf_counter() - start}
        save_result(result_path(folder, number), result, original, facts)
    return failed


SEEN = ("content_scores", "content_features", "style_scores", "style_features", "ae_features")
VALUES = ("tsi", "fsf", "fca", "jitter", "truth_error", "seconds")
_PIECE = 32  # motions a task: enough for the judge to be quick, few enough to keep all cores busy


@dataclass(frozen=True, eq=False)
class Measured:
    """Figures of N motions. seen: what the judge says, by the names in `SEEN`, [N, ...]; values: by those in `VALUES`,
    [N] float64. NaN where there is nothing. problems: number to message, of those that the judge could not see.
    """

    seen: dict[str, Tensor]
    values: dict[str, Tensor]
    problems: dict[int, str] = field(default_factory=dict)


@dataclass(eq=False)
class Evaluator:
    """What measuring needs; workers keep one, with what it has found out about content clips."""

    judge: object
    test: Dataset
    truths: GroundTruth | None = None

    def __post_init__(self) -> None:
        self._known: dict[int, tuple] = {}

    def see(self, motions: Sequence[Motion]) -> dict[str, Tensor]:
        """What the judge sees, by the names in `SEEN`."""
        found = {}
        for label in ("content", "style"):
            both = getattr(self.judge, label).scores_and_features(motions)
            found |= {f"{label}_{what}": x.float() for what, x in zip(("scores", "features"), both)}
        if getattr(self.judge, "autoencoder", None) is not None:
            found["ae_features"] = self.judge.autoencoder.features(motions).float()
        return found

    def see_each(self, motions: Sequence[Motion]) -> tuple[dict[str, Tensor], list[int], dict[int, str]]:
        """As `see`, but where the judge cannot see a motion, the others' rows, their places, and the complaints."""
        if not motions:
            return {}, [], {}
        try:
            return self.see(motions), list(range(len(motions))), {}
        except Exception:
            rows, places, problems = [], [], {}
        for n, motion in enumerate(motions):
            try:
                rows.append(self.see([motion]))
                places.append(n)
            except Exception as error:
                problems[n] = f"judge: {message_of(error)}"
        return {name: torch.cat([row[name] for row in rows]) for name in (rows[0] if rows else ())}, places, problems

    def known(self, number: int) -> tuple[Motion, Tensor | None, Tensor | None, float]:
        """Of a content clip: motion, its contacts as given, as found by the kit, and its jitter."""
        if number not in self._known:
            clip, given = self.test[number], None
            found = _if_any(lambda: foot_contacts(clip.motion), None)
            if found is not None:
                given = clip.contacts if clip.contacts.shape == found.shape else found
            self._known[number] = clip.motion, given, found, _if_any(lambda: metrics.jitter(clip.motion))
        return self._known[number]

    def values(self, result: Motion, transfer: Transfer) -> dict[str, float]:
        """The figures of one result that need no judge, but the seconds."""
        content, given, found, tremble = self.known(transfer.content)
        same = len(result) == len(content)
        shares = torch.linspace(0, len(result) - 1, len(content), dtype=torch.float64)
        path = result if same else result.sample(shares)  # at equal shares of either clip
        answer = None
        if self.truths is not None and same:
            answer = self.truths.answer(self.test[transfer.content], self.test[transfer.style].style)
        values = {
            "tsi": _if_any(lambda: metrics.trajectory_similarity(path, content)),
            "fsf": _if_any(lambda: metrics.foot_sliding_factor(result, given if same else None)),
            "jitter": _if_any(lambda: metrics.jitter(result)) / tremble if tremble > 0 else math.nan,
        }
        if same and found is not None:
            values["fca"] = _if_any(lambda: metrics.foot_contact_accuracy(result, found))
        if answer is not None:
            values["truth_error"] = _if_any(lambda: error_against(result, answer))
        return values


def _if_any(measure: Callable, otherwise: object = math.nan) -> object:
    """A figure, or nothing where it is not defined: for too few frames, or no feet."""
    try:
        return measure()
    except MotionKitError:
        return otherwise


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
def judge_key(bench: Evaluator) -> str:
    """Changes when what the judge sees in the first clips does."""
    seen = bench.see([bench.test[n].motion for n in range(min(4, len(bench.test)))])
    text = [f"{name} {(x.double() * 100).round().long().tolist()}" for name, x in sorted(seen.items())]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:12]


def evaluate(
    bench: Evaluator, transfers: Sequence[Transfer], folder: Path, key: str, jobs: int | None, says: str
) -> Measured:
    """Figures of all results in a folder; what was measured before, and not made again since, is read."""
    place = folder / f"measures-{key}"
    place.mkdir(exist_ok=True)
    tasks = [list(enumerate(transfers[n : n + _PIECE], n)) for n in range(0, len(transfers), _PIECE)]
    todo = [task for task in tasks if _read_piece(place, folder, task) is None]
    for _ in parallel(_measure, (bench, folder, place), todo, jobs, f"measuring {says}", "result"):
        pass
    return _joined([_read_piece(place, folder, task) for task in tasks], len(transfers))


def _piece_path(place: Path, task: Sequence[tuple[int, Transfer]]) -> Path:
    return place / f"{task[0][0]:05d}.safetensors"


def _states(folder: Path, task: Sequence[tuple[int, Transfer]]) -> list:
    return [[*found] if (found := state(result_path(folder, n))) else None for n, _ in task]


def _read_piece(place: Path, folder: Path, task: Sequence) -> tuple[dict[str, Tensor], dict] | None:
    """A measured piece; None where it is not there, or of other results."""
    try:
        tensors, facts = load(_piece_path(place, task))
    except MotionKitError:
        return None
    return (tensors, facts) if facts["states"] == _states(folder, task) else None


def _measure(shared: tuple[Evaluator, Path, Path], task: Sequence[tuple[int, Transfer]]) -> None:
    """A worker's piece."""
    bench, folder, place = shared
    states, results, numbers, rows = _states(folder, task), [], [], []
    for number, transfer in task:
        content = bench.known(transfer.content)[0]
        try:
            result, facts = load_result(result_path(folder, number), content)
        except MotionKitError:
            continue  # it failed, and is counted
        found = {**bench.values(result, transfer), "seconds": facts["seconds"]}
        rows.append([found.get(name, math.nan) for name in VALUES])
        results.append(result)
        numbers.append(number)
    seen, places, problems = bench.see_each(results)
    tensors = {
        "numbers": torch.tensor(numbers, dtype=torch.long),
        "values": torch.tensor(rows, dtype=torch.float64).reshape(-1, len(VALUES)),
        "seen": torch.tensor([numbers[p] for p in places], dtype=torch.long),
        **seen,
    }
    save(
        _piece_path(place, task), tensors, {"states": states, "problems": {numbers[n]: p for n, p in problems.items()}}
    )


def _joined(pieces: Sequence[tuple[dict[str, Tensor], dict]], count: int) -> Measured:
    values = torch.full((count, len(VALUES)), math.nan, dtype=torch.float64)
    seen: dict[str, Tensor] = {}
    problems = {}
    for tensors, facts in pieces:
        values[tensors["numbers"]] = tensors["values"]
        problems |= {int(n): problem for n, problem in facts["problems"].items()}
        for name in SEEN:
            if name in tensors:
                rows = seen.setdefault(name, torch.full((count, tensors[name].shape[1]), math.nan))
                rows[tensors["seen"]] = tensors[name]
    return Measured(seen, dict(zip(VALUES, values.T)), problems)


def evaluate_clips(bench: Evaluator, clips: Dataset, folder: Path, key: str, jobs: int | None) -> Measured:
    """What the judge sees in captured or performed clips, and how much their own feet slide."""
    if not len(clips):
        return Measured({}, {"fsf": torch.zeros(0, dtype=torch.float64)})
    path = folder / f"clips-{key}.safetensors"
    try:
        tensors, _ = load(path)
    except MotionKitError:
        numbers = list(range(len(clips)))
        tasks = [numbers[n : n + _PIECE] for n in range(0, len(numbers), _PIECE)]
        parts = list(parallel(_measure_clips, (bench, clips), tasks, jobs, "measuring clips", "clip"))
        tensors = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
        save(path, tensors, {})
    nothing = torch.full((len(clips),), math.nan, dtype=torch.float64)
    values = {name: tensors["fsf"] if name == "fsf" else nothing for name in VALUES}
    return Measured({name: x for name, x in tensors.items() if name != "fsf"}, values)


def _measure_clips(shared: tuple[Evaluator, Dataset], numbers: Sequence[int]) -> dict[str, Tensor]:
    bench, clips = shared
    found = bench.see([clips[n].motion for n in numbers])
    sliding = [_if_any(lambda n=n: metrics.foot_sliding_factor(clips[n].motion, clips[n].contacts)) for n in numbers]
    return {**found, "fsf": torch.tensor(sliding, dtype=torch.float64)}


_FEW = 24  # up to so many pieces, starting other processes takes longer than doing them


class Shared:
    """Something that many tasks need. A worker unpacks it once and keeps it, with the caches that it fills.

    >>> import pickle
    >>> both = pickle.loads(pickle.dumps(Shared([1]))), pickle.loads(pickle.dumps(Shared([2])))
    >>> [shared.value for shared in both]
    [[1], [2]]
    """

    def __init__(self, value: object) -> None:
        self.value, self._token, self._data = value, uuid4().hex, None

    def __reduce__(self) -> tuple:
        from joblib import wrap_non_picklable_objects  # cloudpickle, for what a notebook defines

        if self._data is None:
            try:
                self._data = pickle.dumps(wrap_non_picklable_objects(self.value, keep_wrapper=False))
            except Exception as error:
                raise MotionKitError(
                    f"cannot be sent to other processes ({error}); run the arena with jobs=1"
                ) from None
        return _unpack, (self._token, self._data)


_here = local()  # of each thread of a worker


def _unpack(token: str, data: bytes) -> Shared:
    kept = _here.__dict__.setdefault("kept", OrderedDict())
    if token not in kept:
        while len(kept) >= 2:
            kept.popitem(last=False)
        kept[token] = Shared(pickle.loads(data))
    return kept[token]


def parallel(
    function: Callable, shared: object, tasks: Sequence[Sequence], jobs: int | None, says: str, unit: str
) -> Iterator:
    """What function(shared, task) returns for each task, in order, with a progress bar that counts their pieces.

    jobs: processes; all cores if left out. joblib's settings count: under `joblib.parallel_config("dask")` a cluster
    works. Raises MotionKitError where a worker dies, or `shared` cannot be sent.

    >>> list(parallel(lambda shared, task: shared + sum(task), 10, [[1, 2], [3]], 1, "adding", "number"))
    [13, 13]
    """
    from joblib import cpu_count, effective_n_jobs
    from tqdm.auto import tqdm

    if jobs is not None and (not isinstance(jobs, int) or isinstance(jobs, bool) or jobs == 0):
        raise MotionKitError(f"jobs: expected a number of processes, or None for one a core; found {jobs!r}")
    pieces = sum(map(len, tasks))
    jobs = cpu_count() if jobs is None else jobs
    alone = len(tasks) < 2 or pieces <= _FEW or effective_n_jobs(jobs) == 1
    done = (_alone(function, shared, task) for task in tasks) if alone else _parallel(function, shared, tasks, jobs)
    with tqdm(total=pieces, desc=says, unit=unit, leave=False) as progress, warnings.catch_warnings():
        # loky replaces a worker whose caches have grown, as they are meant to; nothing is lost by it
        warnings.filterwarnings("ignore", "A worker stopped while some jobs were given")
        for task, found in zip(tasks, done):
            progress.update(len(task))
            yield found


def _parallel(function: Callable, shared: object, tasks: Sequence, jobs: int) -> Iterator:
    from joblib import Parallel, delayed, effective_n_jobs

    sent = Shared(shared)
    calls = [delayed(_call)(function, sent, task) for task in tasks]
    try:
        try:
            parallel = Parallel(jobs, return_as="generator", pre_dispatch="2*n_jobs", batch_size=1)
        except ValueError:  # Dask hands results over together: a few rounds, so that progress shows
            parallel, size = Parallel(jobs), 4 * effective_n_jobs(jobs)
            for n in range(0, len(calls), size):
                yield from parallel(calls[n : n + size])
            return
        yield from parallel(calls)
    except BrokenProcessPool as error:
        raise MotionKitError(
            f"a worker process died ({type(error).__name__}), often because memory ran out. What was done is kept: run "
            "again, with jobs=1 to use less"
        ) from None


def _call(function: Callable, sent: Shared, task: Sequence) -> object:
    return _alone(function, sent.value, task)


def _alone(function: Callable, shared: object, task: Sequence) -> object:
    with one_thread():  # one process a core
        return function(shared, task)


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Chance as this seed has it, for torch, numpy and random; what chance was before goes on afterwards.

    >>> with seeded(3):
    ...     a = torch.rand(1)
    >>> with seeded(3):
    ...     a == torch.rand(1)
    tensor([True])
    """
    before = random.getstate(), np.random.get_state()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        np.random.seed(seed % 2**32)
        random.seed(seed)
        try:
            yield
        finally:
            random.setstate(before[0])
            np.random.set_state(before[1])
