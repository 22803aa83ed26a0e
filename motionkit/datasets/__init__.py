"""Labelled clips to learn from: `load` reads a dataset once, then keeps it in one memory-mapped file.

>>> load("bandai-2", root="nowhere")
Traceback (most recent call last):
...
motionkit.errors.MotionKitError: nowhere: no such file or folder; ...
"""

from __future__ import annotations

import os

from ..errors import MotionKitError
from . import bandai
from .dataset import Clip, Dataset
from .store import open_store

__all__ = ["Clip", "Dataset", "load", "names"]


def names() -> list[str]:
    """The datasets that `load` knows.

    >>> names()
    ['bandai-1', 'bandai-2']
    """
    return sorted(bandai.FILE_PREFIXES)


def load(name: str, root: str | os.PathLike | None = None) -> Dataset:
    """A dataset by name.

    name: one of `names()`. root: a folder with the clips somewhere below it, or the archive's zip, which is
    read in place; left out, the environment variable MOTIONKIT_DATA says. The first time all clips are read
    (about 10 s on two cores) and kept in the cache folder (MOTIONKIT_CACHE, or the system's usual place);
    later it takes a moment. Raises MotionKitError that says how to get the data if they are not there.

    >>> load("bandai-2", root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of bandai-2 here (dataset-2_CONTENT_STYLE_NNN.bvh); ...
    """
    if name not in names():
        raise MotionKitError(f"no dataset {name!r}; there are {', '.join(map(repr, names()))}")
    sources = bandai.find(name, root)
    store = open_store(name, sources)
    return Dataset(name, store, tuple(bandai.labels(clip.name) for clip in store.clips))
