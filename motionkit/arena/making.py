"""Making results: every transfer of a protocol by one method, each on disk as soon as it is there."""

from __future__ import annotations

import time
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..datasets import Dataset
from ..errors import MotionKitError
from . import kept
from .entrants import Entrant, problem_of, restyle
from .fanning import fan_out, seeded
from .protocols import Transfer

_TASK = 64  # transfers, of one style clip


def make_results(
    entrant: Entrant, train: Dataset, test: Dataset, transfers: Sequence[Transfer], folder: Path, jobs: int | None
) -> dict[int, str]:
    """Make those results that are not in the folder yet, or are damaged; returns what failed, number to message."""
    missing = [n for n, transfer in enumerate(transfers) if not _is_whole(folder, n, transfer, test)]
    if not missing:
        return {}
    failed: dict[int, str] = {}
    try:
        method = entrant.ready(train)
    except Exception as error:
        return dict.fromkeys(missing, f"fit: {message_of(error)}")
    tasks = [[(n, transfers[n]) for n in part] for part in chunks(transfers, missing)]
    for found in fan_out(_make, (method, test, folder), tasks, jobs, entrant.name, "transfer"):
        failed |= found
    return failed


def chunks(transfers: Sequence[Transfer], numbers: Sequence[int]) -> Iterator[list[int]]:
    """Numbers of transfers in pieces, each of one style clip and repeat.

    >>> list(chunks([Transfer(0, 1), Transfer(2, 1), Transfer(1, 0)], range(3)))
    [[0, 1], [2]]
    """
    piece: list[int] = []
    for n in numbers:
        if piece and (len(piece) >= _TASK or transfers[n][1:] != transfers[piece[0]][1:]):
            yield piece
            piece = []
        piece.append(n)
    if piece:
        yield piece


def message_of(error: BaseException) -> str:
    """An error in one line.

    >>> message_of(KeyError("old"))
    "KeyError: 'old'"
    """
    text = " ".join(f"{type(error).__name__}: {error}".split())
    return text if len(text) <= 300 else text[:297] + "..."


def _is_whole(folder: Path, number: int, transfer: Transfer, test: Dataset) -> bool:
    path = kept.result_path(folder, number)
    try:
        _, facts = kept.load(path)
    except MotionKitError:
        path.unlink(missing_ok=True)
        return False
    return facts["clips"] == [test[transfer.content].name, test[transfer.style].name]


def _make(shared: tuple[object, Dataset, Path], task: Sequence[tuple[int, Transfer]]) -> dict[int, str]:
    """A worker's piece. Clips are read anew for each transfer: a method may have changed those that it got."""
    method, test, folder = shared
    failed = {}
    for number, transfer in task:
        content, style = test[transfer.content], test[transfer.style]
        original = test[transfer.content].motion
        clips = [content.name, style.name]
        start = time.perf_counter()
        try:
            with seeded(zlib.crc32(" ".join([*clips, str(transfer.repeat)]).encode())):
                result = restyle(method, content, style)
            problem = problem_of(result, original)
        except Exception as error:
            problem = message_of(error)
        if problem:
            failed[number] = problem
            continue
        facts = {"clips": clips, "seconds": time.perf_counter() - start}
        kept.save_result(kept.result_path(folder, number), result, original, facts)
    return failed
