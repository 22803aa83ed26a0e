"""A key for anything that makes results: it changes when what is known of the thing does."""

from __future__ import annotations

import enum
import functools
import hashlib
import inspect
import pickle
import types
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

import motionkit

from ..datasets import Dataset
from ..errors import MotionKitError

_ASIDE = ("viewer", "arena", "judges", "metrics", "exercises.py", "__main__.py")  # what no method's result depends on
_PLAIN = (type(None), bool, int, float, complex, str, bytes, enum.Enum)
_CALLED = (type, types.FunctionType, types.MethodType, types.BuiltinFunctionType, types.ModuleType, functools.partial)


def fingerprint(thing: object) -> str:
    """Sixteen hex digits that change with what a method is made of, and are the same in every process.

    A function: its code, constants, defaults, closure, and the plain values and functions of its own module that it
    names. What it calls in other modules is not looked at. An object: its class' code and all that it holds, or what
    its `__getstate__` says, so that caches can be kept out. Of the kit's own classes and functions: all of the kit's
    code below the judges.

    >>> def f(a, b, share=0.5):
    ...     return a
    >>> def g(a, b, share=0.7):
    ...     return a
    >>> fingerprint(f) == fingerprint(f), fingerprint(f) == fingerprint(g)
    (True, False)
    """
    digest = hashlib.sha256()
    try:
        for part in _parts(thing, {}):
            digest.update(part + b"\0")
    except RecursionError:
        raise _unknown(thing, "it holds too much that holds more") from None
    return digest.hexdigest()[:16]


@lru_cache(maxsize=1)
def kit_code() -> str:
    """Changes when code of the kit does that a method's results may depend on.

    >>> len(kit_code())
    16
    """
    folder, found = Path(motionkit.__file__).parent, hashlib.sha256()
    for path in sorted(folder.rglob("*.py"), key=lambda p: p.relative_to(folder).as_posix()):
        place = path.relative_to(folder)
        if place.parts[0] not in _ASIDE:
            found.update(place.as_posix().encode() + b"\n" + path.read_bytes().replace(b"\r\n", b"\n"))
    return found.hexdigest()[:16]


def dataset_key(*datasets: Dataset) -> str:
    """Changes with the clips of data sets: their names, labels and numbers.

    >>> import motionkit as mk
    >>> item = mk.datasets.Item("a", mk.datasets.Labels("walk", "old", ()), mk.datasets.BvhSource.at(
    ...     "data/actor/walk_old.bvh"))
    >>> len(dataset_key(mk.datasets.of_items("mine", [item])))
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
        yield from map(str.encode, sorted(fingerprint(x) for x in thing))
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
        yield kit_code().encode()
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
