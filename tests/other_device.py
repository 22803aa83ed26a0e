"""A device that is none: `with other_device():` parts this machine's memory in two, so a CPU shows what a GPU would.

Tensors are marked by their storage. What is computed from marked tensors is marked, so is what is moved or made with
`device=OTHER`; `training` moves there what it moves to an accelerator. As on a GPU, a marked and an unmarked tensor do
not meet in an operation, unless the unmarked one is a single number or an index.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import torch
from accelerate import Accelerator
from torch import Tensor
from torch.overrides import TorchFunctionMode

CPU, OTHER = torch.device("cpu"), torch.device("cpu", 1)  # torch has no second CPU: nobody else asks for it
_DEVICE = Tensor.device.__get__
_MOVES = {Tensor.to, Tensor.cpu}
_COPIES = {Tensor.copy_, Tensor.data.__set__, torch._has_compatible_shallow_copy_type}  # from one device to the other


@contextmanager
def other_device() -> Iterator[Marks]:
    """While it lasts, `training` has another device than the data."""
    with pytest.MonkeyPatch.context() as patch, Marks() as marks:
        patch.setattr(Accelerator, "device", OTHER)
        yield marks


class Marks(TorchFunctionMode):
    """Which tensors are on the other device. ops: how many operations were done there."""

    def __init__(self) -> None:
        super().__init__()
        self.ops = 0
        self._storages: dict[int, object] = {}  # kept alive, or their place in memory would get another meaning

    def __torch_function__(self, func, types, args=(), kwargs=None):
        kwargs = dict(kwargs or {})
        inputs = list(
            _tensors(args[:1] if func is Tensor.__deepcopy__ else (args, kwargs))
        )  # not what was copied before
        marked = [self.marked(x) for x in inputs]
        if func == _DEVICE:
            return OTHER if marked[0] else CPU
        if func in _MOVES:
            return self._moved(func, args, kwargs)
        if func is Tensor.numpy and marked[0]:
            raise TypeError("a tensor of the other device cannot become a NumPy array; copy it with .cpu() first")
        goal = kwargs.get("device")
        if goal is not None:
            kwargs["device"] = CPU
            return self._mark(func(*args, **kwargs), torch.device(goal) == OTHER)
        if func not in _COPIES:
            self._check(func, args, kwargs, inputs, marked)
        there = marked[0] if func in _COPIES and marked else any(marked)
        self.ops += there
        return self._mark(func(*args, **kwargs), there)

    def marked(self, x: Tensor) -> bool:
        """Whether it is on the other device."""
        return x.numel() > 0 and x.untyped_storage().data_ptr() in self._storages

    def _mark(self, result: object, there: bool) -> object:
        for x in _tensors(result) if there else ():
            storage = x.untyped_storage()
            self._storages[storage.data_ptr()] = storage
        return result

    def _moved(self, func, args: tuple, kwargs: dict) -> Tensor:
        x, *others = args
        goal = CPU if func is Tensor.cpu else None
        plain = []
        for value in [*others, *kwargs.values()]:
            if isinstance(value, Tensor):
                goal = OTHER if self.marked(value) else CPU
                plain.append(value.dtype)
            elif isinstance(value, str | torch.device):
                goal = torch.device(value)
            elif isinstance(value, torch.dtype):
                plain.append(value)
        there = self.marked(x)
        result = x.to(plain[0]) if plain else x
        if goal is None or (goal == OTHER) == there:
            return self._mark(result, there)
        return self._mark(result.clone(), goal == OTHER)

    def _check(self, func, args: tuple, kwargs: dict, inputs: list[Tensor], marked: list[bool]) -> None:
        if func in (Tensor.__getitem__, Tensor.__setitem__):
            x, index = args[0], list(_tensors(args[1]))
            if not self.marked(x) and any(map(self.marked, index)):
                raise RuntimeError("indices on the other device, of a tensor that is here")
            if func is Tensor.__getitem__ or not index:  # a slice is written by a copy, which may cross
                return
            inputs = [x, *_tensors(args[2])]
            marked = [self.marked(one) for one in inputs]
        if func in (torch.index_put, Tensor.index_put, Tensor.index_put_):
            inputs = [args[0], *_tensors(args[2:])]
            marked = [self.marked(one) for one in inputs]
        here = [x for x, there in zip(inputs, marked) if not there and x.ndim and x.numel()]
        if any(marked) and here:
            name = getattr(func, "__name__", func)
            shapes = [(tuple(x.shape), "there" if there else "here") for x, there in zip(inputs, marked)]
            raise RuntimeError(f"{name}: expected all tensors to be on the same device, but found {shapes}")


def _tensors(value: object) -> Iterator[Tensor]:
    """All tensors in nested arguments."""
    if isinstance(value, Tensor):
        yield value
    elif isinstance(value, dict):
        yield from _tensors(list(value.values()))
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _tensors(part)
