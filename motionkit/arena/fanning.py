"""Spreading work over cores, or over a cluster, with joblib."""

from __future__ import annotations

import pickle
import random
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from threading import local
from uuid import uuid4

import numpy as np
import torch

from ..errors import MotionKitError

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


def fan_out(
    function: Callable, shared: object, tasks: Sequence[Sequence], jobs: int | None, says: str, unit: str
) -> Iterator:
    """What function(shared, task) returns for each task, in order, with a progress bar that counts their pieces.

    jobs: processes; all cores if left out. joblib's settings count: under `joblib.parallel_config("dask")` a cluster
    works. Raises MotionKitError where a worker dies, or `shared` cannot be sent.

    >>> list(fan_out(lambda shared, task: shared + sum(task), 10, [[1, 2], [3]], 1, "adding", "number"))
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
    calls = [delayed(_called)(function, sent, task) for task in tasks]
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


def _called(function: Callable, sent: Shared, task: Sequence) -> object:
    return _alone(function, sent.value, task)


def _alone(function: Callable, shared: object, task: Sequence) -> object:
    with one_thread():  # one process a core
        return function(shared, task)


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
