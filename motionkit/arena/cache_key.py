"""The key of a method's kept results: it changes when the method does, and is the same in every process."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from functools import cached_property
from types import CodeType, FunctionType, MappingProxyType, ModuleType

import torch
from joblib.hashing import NumpyHasher

from ..checkpoints import data_hash
from ..datasets import Dataset
from ..errors import MotionKitError

_LIBRARIES = {*sys.stdlib_module_names, "joblib", "numpy", "scipy", "sklearn", "torch"}


def cache_key(method: object) -> str:
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
    try:
        return _Hasher("sha1").hash(method)[:16]
    except RecursionError:
        why = "it holds too much that holds more"
    except Exception as error:  # pickle knows many, such as a TypeError for a lock
        why = str(error)
    raise MotionKitError(
        f"{type(method).__name__}: cannot tell whether it is the same as at the last run ({why}); give its class a "
        "__getstate__ that returns what results depend on"
    )


class _Hasher(NumpyHasher):
    """`joblib.hash` walks through all that an object holds; here functions and classes count by what they do."""

    def reducer_override(self, thing: object) -> object:
        """What stands for a thing in the hash: a callable, its arguments, and, where it may hold itself, a state."""
        if isinstance(thing, torch.Tensor):
            return torch.as_tensor, (thing.detach().cpu().numpy(),)
        if isinstance(thing, dict | MappingProxyType):
            return dict, (sorted(thing.items(), key=lambda item: repr(item[0])),)
        if isinstance(thing, set | frozenset):
            return set, (sorted(map(cache_key, thing)),)
        if isinstance(thing, Dataset):
            return str, (data_hash(thing),)
        if isinstance(thing, ModuleType):
            return str, (thing.__name__,)
        if isinstance(thing, CodeType):
            return str, (thing.co_code, thing.co_names, thing.co_consts)
        if isinstance(thing, type | FunctionType):
            package = (thing.__module__ or "").split(".")[0]
            name = (thing.__module__, thing.__qualname__)
            if package == "builtins":
                return NotImplemented  # joblib knows them by name
            if package == "motionkit":
                return str, (*name, getattr(thing, "version", ""))
            if package in _LIBRARIES:
                return str, name
            return str, name, list(_class_parts(thing) if isinstance(thing, type) else _function_parts(thing))
        return NotImplemented


def _class_parts(cls: type) -> Iterator[object]:
    """The methods and plain values of a class, with their names, and its bases."""
    for name, value in sorted(vars(cls).items()):
        if isinstance(value, staticmethod | classmethod | property | cached_property):
            value = getattr(value, "__func__", None) or getattr(value, "fget", None) or getattr(value, "func", None)
        plain = isinstance(value, bool | int | float | complex | str | bytes | tuple | list | dict | None)
        if isinstance(value, FunctionType) or (plain and not name.startswith("__")):
            yield name, value
    yield cls.__bases__


def _function_parts(function: FunctionType) -> Iterator[object]:
    """Code, defaults, closure, and the plain values, classes and functions of its own module that a function names."""
    yield function.__code__, function.__defaults__, function.__kwdefaults__
    for cell in function.__closure__ or ():
        try:
            yield cell.cell_contents
        except ValueError:  # a name that has no value yet
            yield "empty"
    for name in sorted(_names(function.__code__)):
        value = function.__globals__.get(name)
        if isinstance(value, type | FunctionType):
            named = value.__module__ == function.__module__
        else:
            named = value is not None and not callable(value) and not isinstance(value, ModuleType)
        if named:
            yield name, value


def _names(code: CodeType) -> set[str]:
    """The names that a function's code uses, and that of the functions in it."""
    return set(code.co_names).union(*(_names(inner) for inner in code.co_consts if inspect.iscode(inner)))
