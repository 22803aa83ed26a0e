"""Datasets by name: what `load` knows, and a dataset of clips that you list yourself."""

from __future__ import annotations

import inspect
import os
from collections.abc import Sequence

from ..errors import MotionKitError
from . import captures, performed
from .cache import open_store, sort_items
from .dataset import Dataset
from .sources import Item

# dataset -> what lists its clips, called with its name, the root, and options
_READERS = {
    "100style": captures.style100_items,
    "actor": performed.items,
    "actor-held-back": performed.items,
    "actor-unseen": performed.items,
    "bandai-1": captures.bandai_items,
    "bandai-2": captures.bandai_items,
    "creatures": performed.items,
    "folder": captures.folder_items,
    "humanml3d": captures.humanml3d_items,
    "xia": captures.xia_items,
}


def names() -> list[str]:
    """The datasets that `load` knows.

    >>> names()
    ['100style', 'actor', 'actor-held-back', 'actor-unseen', 'bandai-1', 'bandai-2', 'creatures', 'folder', ...]
    """
    return sorted(_READERS)


def list_items(name: str, root: str | os.PathLike | None = None, **options) -> Sequence[Item]:
    """The clips of a dataset as they are found, nothing read yet; see `load`.

    >>> list_items("bandai")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: no dataset 'bandai'; there are '100style', 'actor', ...
    """
    if name not in _READERS:
        raise MotionKitError(f"no dataset {name!r}; there are {', '.join(map(repr, names()))}")
    read = _READERS[name]
    known = list(inspect.signature(read).parameters)[2:]
    if not set(options) <= set(known):
        unknown = min(set(options) - set(known))
        raise MotionKitError(f"dataset {name!r} has no option {unknown!r}; it has {', '.join(known) or 'none'}")
    items = read(name, root, **options)
    if not items:
        raise MotionKitError(f"{root}: no clips of {name} here; give the folder or zip that has them")
    return items


def load(name: str = "actor", root: str | os.PathLike | None = None, **options) -> Dataset:
    """A dataset by name.

    name: one of `names()`. root: a folder with the clips somewhere below it, or the archive's zip, which is
    read in place; left out, the environment variable MOTIONKIT_DATA says. options: what the dataset's reader takes
    beside these, as `pattern` for "folder". The first time all clips are read (about 10 s on two cores for
    Bandai-2) and kept in the cache folder (MOTIONKIT_CACHE, or the system's usual place); later it takes a moment.
    Raises MotionKitError that says how to get the data if they are not there; `fetch` gets Bandai-2.

    >>> load("bandai-2", root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of bandai-2 here (dataset-2_CONTENT_STYLE_NNN.bvh); ...
    """
    return from_items(name, list_items(name, root, **options))


def from_items(name: str, items: Sequence[Item]) -> Dataset:
    """A dataset of clips that you list yourself, cached as those of `load`; `name` is for messages and the cache.

    Each item has a name, labels, and a source that makes its motion. Raises MotionKitError if two have one name.

    >>> from motionkit.datasets import BvhSource, Labels
    >>> source = BvhSource.at("data/actor/walk_neutral.bvh")
    >>> from_items("mine", [Item("walk_1", Labels("walk", "neutral", ("a person walks",)), source)])
    Dataset('mine', 1 clips, 1 contents, 1 styles)
    """
    items = sort_items(name, items)
    return Dataset(name, open_store(name, items), tuple(item.labels for item in items))
