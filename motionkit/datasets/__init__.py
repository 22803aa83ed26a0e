"""Labelled motion to learn from: `load` reads a dataset once, then keeps it in one memory-mapped file.

>>> load("bandai-2", root="nowhere")
Traceback (most recent call last):
...
motionkit.errors.MotionKitError: nowhere: no such file or folder; ...
"""

from __future__ import annotations

from .batches import BalancedSampler, Batch, FeatureCache, batches, collate
from .corpus import Corpus, build_cache
from .dataset import Clip, Dataset, Split, Table, Window, Windows
from .download import fetch
from .loading import from_items, list_items, load, names
from .sources import BvhSource, Item, Labels, Recording

__all__ = [
    "BalancedSampler",
    "Batch",
    "BvhSource",
    "Clip",
    "Corpus",
    "Dataset",
    "FeatureCache",
    "Item",
    "Labels",
    "Recording",
    "Split",
    "Table",
    "Window",
    "Windows",
    "batches",
    "build_cache",
    "collate",
    "fetch",
    "list_items",
    "load",
    "names",
    "from_items",
]
