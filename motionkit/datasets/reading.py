"""Reading clips on all cores: what their sources give, as rows of numbers for `shards`."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from .. import contacts
from ..errors import MotionKitError
from ..files import MotionKitWarning
from ..motion import Motion
from ..skeleton import Skeleton
from .sources import Item, Recording, Source

_BATCH = 32  # clips a task: few enough to keep all cores busy to the end, enough to make sending them cheap
_LARGE = 1 << 24  # bytes of files a task, so that long clips do not fill the memory
_FEW = 100  # up to so many clips, starting other processes takes longer than reading
_MOST_JOBS = 8  # each takes a third of a gigabyte, most of it torch


class Read(NamedTuple):
    """A clip that was read. tree: skeleton and track widths as JSON. rows: float32 [F, 7J + tracks]."""

    tree: str
    fps: float
    metres_per_unit: float
    rows: np.ndarray


def read_all(items: Sequence[Item], bad: str = "stop") -> Iterator[Read | None]:
    """The clips, in order. Raises MotionKitError naming one that cannot be read, or (`bad="skip"`) gives None for it.

    joblib's settings count: under `joblib.parallel_config("dask")` a cluster reads.
    """
    from tqdm.auto import tqdm

    with tqdm(total=len(items), desc="reading clips (once)", unit="clip", leave=False) as progress:
        for clips, told in _in_parallel(_batches(items), len(items), bad):
            for message, category in told:
                warnings.warn(message, category, stacklevel=2)
            yield from clips
            progress.update(len(clips))


def _batches(items: Sequence[Item]) -> list[list[tuple[str, Source]]]:
    batches, size = [], 0
    for item in items:
        weight = getattr(item.source, "size", 0)
        if not batches or len(batches[-1]) >= _BATCH or size + weight > _LARGE:
            batches.append([])
            size = 0
        batches[-1].append((item.name, item.source))
        size += weight
    return batches


def _in_parallel(batches: list, count: int, bad: str) -> Iterator[tuple[list[Read | None], list[tuple]]]:
    if count <= _FEW:
        return (_read_batch(batch, bad) for batch in batches)
    from joblib import Parallel, cpu_count, delayed, effective_n_jobs

    jobs, tasks = min(cpu_count(), _MOST_JOBS), [delayed(_read_alone)(batch, bad) for batch in batches]
    try:
        parallel = Parallel(jobs, return_as="generator", pre_dispatch="2*n_jobs")
    except ValueError:  # Dask hands results over together: a few rounds, so that they fit in memory
        parallel, size = Parallel(jobs), 4 * effective_n_jobs(jobs)
        return (read for n in range(0, len(tasks), size) for read in parallel(tasks[n : n + size]))
    return parallel(tasks)


def _read_alone(batch: list[tuple[str, Source]], bad: str) -> tuple[list[Read | None], list[tuple]]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # one process a core is enough
    try:
        return _read_batch(batch, bad)
    finally:
        torch.set_num_threads(threads)


def _read_batch(batch: list[tuple[str, Source]], bad: str) -> tuple[list[Read | None], list[tuple]]:
    """The clips, and the warnings that came with them."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        clips = [_read(name, source, bad) for name, source in batch]
    return clips, [(str(w.message), w.category) for w in told]


def _read(name: str, source: Source, bad: str) -> Read | None:
    try:
        return rows_of(name, source.read())
    except MotionKitError as error:
        if bad == "stop":
            raise
        warnings.warn(f"left out {name!r}: {error}", MotionKitWarning, stacklevel=2)
        return None


def rows_of(name: str, recording: Recording) -> Read:
    """A recording as rows; contacts are found where it brings none and the skeleton's names tell its feet.

    Raises MotionKitError if a track has not one row for each frame.

    >>> import motionkit as mk
    >>> read = rows_of("walk", Recording(mk.load("data/actor/walk_neutral.bvh")))
    >>> read.rows.shape, json.loads(read.tree)["tracks"]
    ((120, 158), [['contacts', 4]])
    """
    motion = recording.motion
    s = motion.skeleton
    tree = {"names": s.names, "parents": s.parents, "offsets": s.offsets.tolist(), "channels": s.channels}
    tree |= {"end_sites": s.end_sites, "twins": s.twins}
    tracks = dict(recording.tracks)
    if "contacts" not in tracks:
        tracks |= _contacts(motion.replace(skeleton=_shared(json.dumps(tree), s)))
    for track, numbers in tracks.items():
        if numbers.ndim != 2 or len(numbers) != len(motion):
            raise MotionKitError(
                f"clip {name!r}: expected track {track!r} as [{len(motion)}, K], a row for each frame; found "
                f"{list(numbers.shape)}"
            )
    tree["tracks"] = [[track, numbers.shape[1]] for track, numbers in tracks.items()]
    parts = (motion.rotations.flatten(1), motion.translations.flatten(1), *tracks.values())
    rows = torch.cat([part.detach().cpu().float() for part in parts], 1)
    return Read(json.dumps(tree), motion.fps, motion.metres_per_unit, rows.numpy().astype("<f4", copy=False))


def _contacts(motion: Motion) -> dict[str, Tensor]:
    try:
        return {"contacts": contacts.foot_contacts(motion)}
    except MotionKitError:  # no feet by name: there is no such track then
        return {}


_kept: dict[str, Skeleton] = {}


def _shared(tree: str, skeleton: Skeleton) -> Skeleton:
    """One object for skeletons that are the same: what it knows of its joints is worked out once."""
    if len(_kept) > 64:
        _kept.clear()
    return _kept.setdefault(tree, skeleton)
