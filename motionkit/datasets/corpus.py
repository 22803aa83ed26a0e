"""A corpus: clips in many shards, read once, trained on without ever being in memory as a whole."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ..errors import MotionKitError
from ..files import write_atomic
from .cache import FORMAT, Shard, Store, forget, items_key, make_folder, read_shard, relabel, sort_items, write_shards
from .dataset import Dataset
from .loading import list_items
from .sources import Item

_PLAN = "corpus.json"
_SHARD = re.compile(r"shard-\d{5,}\.(f32|json)")
_LEFT = re.compile(r"\.(shard-\d{5,}\.(f32|json)|corpus\.json)\..+")  # a writer that was killed leaves these
_ABANDONED = 3600  # seconds after which nobody writes to such a file any more


class Corpus(Dataset):
    """A dataset in a folder of shards, made by `build_cache`: windows, batches and splits work as for any other."""

    @classmethod
    def open(cls, folder: str | os.PathLike) -> Corpus:
        """The corpus in a folder; only its indices are read.

        Raises MotionKitError naming the file where a shard is missing, half-written or damaged.

        >>> Corpus.open("data")
        Traceback (most recent call last):
        ...
        motionkit.errors.MotionKitError: data: no corpus here (no corpus.json); make one with datasets.build_cache(...)
        """
        folder = Path(folder).expanduser()
        name, plan = _read_plan(folder)
        remedy = "run datasets.build_cache(...) on this folder again: it makes only what is missing"
        shards, missing = [], 0
        for path, key in plan:
            if not path.exists():
                missing += 1
                continue
            try:
                shards.append(read_shard(path))
            except MotionKitError as error:
                raise MotionKitError(f"{error}; {remedy}") from None
            missing += shards[-1].key != key
        if missing:
            raise MotionKitError(f"{folder}: {missing} of {len(plan)} shards are not made yet; {remedy}")
        return cls(name, Store(tuple(shards), remedy), tuple(labels for shard in shards for labels in shard.labels))


def _read_plan(folder: Path) -> tuple[str, list[tuple[Path, str]]]:
    try:
        plan = json.loads((folder / _PLAN).read_bytes())
        if plan["format"] != FORMAT:
            raise ValueError(f"format {plan['format']}, not {FORMAT}")
        return str(plan["name"]), [(folder / _name(n), str(key)) for n, key in enumerate(plan["keys"])]
    except (FileNotFoundError, NotADirectoryError):
        raise MotionKitError(
            f"{folder}: no corpus here (no {_PLAN}); make one with datasets.build_cache(...)"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise MotionKitError(
            f"{folder / _PLAN}: the corpus' plan is damaged or old ({error}); run datasets.build_cache(...) again"
        ) from None


def _name(number: int) -> str:
    return f"shard-{number:05d}.f32"


def build_cache(
    root: str | os.PathLike | Sequence[Item],
    out: str | os.PathLike,
    dataset: str = "folder",
    shard_clips: int = 512,
    bad: str = "stop",
    **options,
) -> Corpus:
    """Read any number of clips into a folder of shards, on all cores; memory stays small however many there are.

    root: a folder of BVH files or a zip, read as dataset `dataset` with `options`, as in `load` (files of a "folder"
    may be called anything; `pattern` or `table` gives them labels); or a list of items. out: the folder to write.
    shard_clips: clips a file. bad: `stop` at the first clip that cannot be read, or `skip` it with a warning. It may be
    stopped at any moment (Ctrl-C); called again, it goes on after the last whole shard, and makes again what is damaged
    or whose clips have changed. Under `joblib.parallel_config("dask")` a cluster reads. Returns the opened `Corpus`;
    MotionKitError says what is wrong and where.

    >>> import tempfile
    >>> from motionkit.datasets import BvhSource, Labels
    >>> walk = Item("walk_1", Labels("walk", "neutral", ()), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> with tempfile.TemporaryDirectory() as out:
    ...     corpus = build_cache([walk], out)
    ...     len(corpus.windows(64, stride=8))
    8
    """
    if bad not in ("stop", "skip") or not isinstance(shard_clips, int) or shard_clips < 1:
        raise MotionKitError(
            f"build_cache: bad is 'stop' or 'skip', shard_clips a number from 1; found {bad!r}, {shard_clips!r}"
        )
    if isinstance(root, str | os.PathLike):
        root = list_items(dataset, root, **options or ({"pattern": "{}"} if dataset == "folder" else {}))
    items, out = sort_items(dataset, root), Path(out).expanduser()
    make_folder(out, "choose another folder for the corpus")
    parts = [items[n : n + shard_clips] for n in range(0, len(items), shard_clips)]
    paths, keys = [out / _name(n) for n in range(len(parts))], [items_key(part) for part in parts]
    write_atomic(out / _PLAN, json.dumps({"format": FORMAT, "name": dataset, "keys": keys}))
    missing = []
    for path, key, part in zip(paths, keys, parts, strict=True):
        shard = _whole(path, key)
        if shard is None:
            missing.append((path, part))
        else:
            relabel(shard, part)
    write_shards(missing, bad)
    _tidy(out, len(parts))
    return Corpus.open(out)


def _whole(path: Path, key: str) -> Shard | None:
    """The shard that is there, if it is whole and made of the clips that it should be."""
    try:
        shard = read_shard(path)
    except MotionKitError:
        return None
    return shard if shard.key == key else None


def _tidy(folder: Path, count: int) -> None:
    """Take away shards of an earlier, longer plan, and what a killed writer left behind."""
    wanted = {Path(_name(n)).stem for n in range(count)}
    for path in folder.iterdir():
        left = _LEFT.fullmatch(path.name) and time.time() - path.stat().st_mtime > _ABANDONED
        if left or (_SHARD.fullmatch(path.name) and path.stem not in wanted):
            forget(path)
            with suppress(OSError):
                path.unlink()
