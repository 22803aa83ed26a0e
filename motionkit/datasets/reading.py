"""Reading all clips of a dataset, on all cores."""

from __future__ import annotations

import warnings
import zipfile
import zlib
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import torch

from ..bvh import parse
from ..errors import MotionKitError
from ..files import read_bytes
from .store import Source

_BATCH = 32  # clips a task: few enough to keep all cores busy to the end, enough to make sending them cheap
_FEW = 100  # up to so many clips, starting other processes takes longer than reading
_MOST_JOBS = 8  # each takes a third of a gigabyte, most of it torch
_LARGEST = 1 << 28  # bytes of one clip; a guard against archives made to fill the memory


def read_all(sources: list[Source]) -> Iterator[tuple]:
    """For each clip, in order: name, tree (as for JSON), fps, metres a unit, frames, and its numbers.

    The numbers are float32 [N] as in `store`. Raises MotionKitError naming the clip that cannot be read.
    """
    from tqdm.auto import tqdm

    batches = [sources[n : n + _BATCH] for n in range(0, len(sources), _BATCH)]
    with tqdm(total=len(sources), desc="reading clips (once)", unit="clip", leave=False) as progress:
        for clips, told in _in_parallel(batches, len(sources)):
            for message, category in told:
                warnings.warn(message, category, stacklevel=2)
            yield from clips
            progress.update(len(clips))


def _in_parallel(batches: list[list[Source]], count: int) -> Iterator[tuple[list[tuple], list[tuple]]]:
    if count <= _FEW:
        return map(_read_batch, batches)
    from joblib import Parallel, cpu_count, delayed

    jobs = Parallel(min(cpu_count(), _MOST_JOBS), return_as="generator", pre_dispatch="2*n_jobs")
    return jobs(delayed(_read_alone)(batch) for batch in batches)


def _read_alone(batch: list[Source]) -> tuple[list[tuple], list[tuple]]:
    torch.set_num_threads(1)  # one process a core is enough
    return _read_batch(batch)


def _read_batch(batch: list[Source]) -> tuple[list[tuple], list[tuple]]:
    """The clips, and the warnings that came with them."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        clips = [_read(source) for source in batch]
    return clips, [(str(w.message), w.category) for w in told]


def _read(source: Source) -> tuple:
    where = source.path if source.member is None else f"{source.path}/{source.member}"
    motion = parse(_bytes_of(source), where)
    s = motion.skeleton
    tree = {"names": s.names, "parents": s.parents, "channels": s.channels, "end_sites": s.end_sites}
    parts = (s.offsets, motion.rotations, motion.translations)
    block = np.concatenate([t.numpy().reshape(-1) for t in parts]).astype("<f4", copy=False)
    return source.name, tree, motion.fps, motion.metres_per_unit, len(motion), block


def _bytes_of(source: Source) -> bytes:
    if source.size > _LARGEST:
        raise MotionKitError(
            f"{source.path}: {source.name!r} has {source.size} bytes, which is no clip; get the data again"
        )
    if source.member is None:
        return read_bytes(source.path)
    try:
        return _archive(source.path).read(source.member)
    except (OSError, KeyError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
        raise MotionKitError(
            f"{source.path}: {source.member} cannot be read ({error}); get the archive again"
        ) from None


@lru_cache(maxsize=1)  # listing the members of a large archive takes longer than reading one of them
def _archive(path: str) -> zipfile.ZipFile:
    return zipfile.ZipFile(path)
