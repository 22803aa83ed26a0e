"""Measuring results: what a judge sees in each, and the figures that need no judge. In pieces, each kept on disk."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from .. import metrics
from ..contacts import foot_contacts
from ..datasets import Dataset
from ..errors import MotionKitError
from ..motion import Motion
from . import kept
from .fanning import fan_out, one_thread
from .making import message_of
from .protocols import Transfer
from .truths import Truths, error_against

SEEN = ("content_scores", "content_features", "style_scores", "style_features", "ae_features")
VALUES = ("tsi", "fsf", "fca", "jitter", "truth_error", "seconds")
_PIECE = 32  # motions a task: enough for the judge to be quick, few enough to keep all cores busy


@dataclass(frozen=True, eq=False)
class Measured:
    """Figures of N motions. seen: what the judge says, by the names in `SEEN`, [N, ...]; values: by those in `VALUES`,
    [N] float64. NaN where there is nothing. problems: number to message, of those that the judge could not see.
    """

    seen: dict[str, Tensor]
    values: dict[str, Tensor]
    problems: dict[int, str] = field(default_factory=dict)


@dataclass(eq=False)
class Bench:
    """What measuring needs; workers keep one, with what it has found out about content clips."""

    judge: object
    test: Dataset
    truths: Truths | None = None

    def __post_init__(self) -> None:
        self._known: dict[int, tuple] = {}

    def see(self, motions: Sequence[Motion]) -> dict[str, Tensor]:
        """What the judge sees, by the names in `SEEN`."""
        found = {}
        for label in ("content", "style"):
            both = getattr(self.judge, label).scores_and_features(motions)
            found |= {f"{label}_{what}": x.float() for what, x in zip(("scores", "features"), both)}
        if getattr(self.judge, "autoencoder", None) is not None:
            found["ae_features"] = self.judge.autoencoder.features(motions).float()
        return found

    def see_each(self, motions: Sequence[Motion]) -> tuple[dict[str, Tensor], list[int], dict[int, str]]:
        """As `see`, but where the judge cannot see a motion, the others' rows, their places, and the complaints."""
        if not motions:
            return {}, [], {}
        try:
            return self.see(motions), list(range(len(motions))), {}
        except Exception:
            rows, places, problems = [], [], {}
        for n, motion in enumerate(motions):
            try:
                rows.append(self.see([motion]))
                places.append(n)
            except Exception as error:
                problems[n] = f"judge: {message_of(error)}"
        return {name: torch.cat([row[name] for row in rows]) for name in (rows[0] if rows else ())}, places, problems

    def known(self, number: int) -> tuple[Motion, Tensor | None, Tensor | None, float]:
        """Of a content clip: motion, its contacts as given, as found by the kit, and its jitter."""
        if number not in self._known:
            clip, given = self.test[number], None
            found = _if_any(lambda: foot_contacts(clip.motion), None)
            if found is not None:
                given = clip.contacts if clip.contacts.shape == found.shape else found
            self._known[number] = clip.motion, given, found, _if_any(lambda: metrics.jitter(clip.motion))
        return self._known[number]

    def values(self, result: Motion, transfer: Transfer) -> dict[str, float]:
        """The figures of one result that need no judge, but the seconds."""
        content, given, found, tremble = self.known(transfer.content)
        same = len(result) == len(content)
        shares = torch.linspace(0, len(result) - 1, len(content), dtype=torch.float64)
        path = result if same else result.at(shares)  # at equal shares of either clip
        answer = None
        if self.truths is not None and same:
            answer = self.truths.answer(self.test[transfer.content], self.test[transfer.style].style)
        values = {
            "tsi": _if_any(lambda: metrics.trajectory_similarity(path, content)),
            "fsf": _if_any(lambda: metrics.foot_sliding_factor(result, given if same else None)),
            "jitter": _if_any(lambda: metrics.jitter(result)) / tremble if tremble > 0 else math.nan,
        }
        if same and found is not None:
            values["fca"] = _if_any(lambda: metrics.foot_contact_accuracy(result, found))
        if answer is not None:
            values["truth_error"] = _if_any(lambda: error_against(result, answer))
        return values


def _if_any(measure: Callable, otherwise: object = math.nan) -> object:
    """A figure, or nothing where it is not defined: for too few frames, or no feet."""
    try:
        return measure()
    except MotionKitError:
        return otherwise


@one_thread()
def judge_key(bench: Bench) -> str:
    """Changes when what the judge sees in the first clips does."""
    seen = bench.see([bench.test[n].motion for n in range(min(4, len(bench.test)))])
    text = [f"{name} {(x.double() * 100).round().long().tolist()}" for name, x in sorted(seen.items())]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:12]


def measure_results(
    bench: Bench, transfers: Sequence[Transfer], folder: Path, key: str, jobs: int | None, says: str
) -> Measured:
    """Figures of all results in a folder; what was measured before, and not made again since, is read."""
    place = folder / f"measures-{key}"
    place.mkdir(exist_ok=True)
    tasks = [list(enumerate(transfers[n : n + _PIECE], n)) for n in range(0, len(transfers), _PIECE)]
    todo = [task for task in tasks if _read_piece(place, folder, task) is None]
    for _ in fan_out(_measure, (bench, folder, place), todo, jobs, f"measuring {says}", "result"):
        pass
    return _joined([_read_piece(place, folder, task) for task in tasks], len(transfers))


def _piece_path(place: Path, task: Sequence[tuple[int, Transfer]]) -> Path:
    return place / f"{task[0][0]:05d}.safetensors"


def _states(folder: Path, task: Sequence[tuple[int, Transfer]]) -> list:
    return [[*found] if (found := kept.state(kept.result_path(folder, n))) else None for n, _ in task]


def _read_piece(place: Path, folder: Path, task: Sequence) -> tuple[dict[str, Tensor], dict] | None:
    """A measured piece; None where it is not there, or of other results."""
    try:
        tensors, facts = kept.load(_piece_path(place, task))
    except MotionKitError:
        return None
    return (tensors, facts) if facts["states"] == _states(folder, task) else None


def _measure(shared: tuple[Bench, Path, Path], task: Sequence[tuple[int, Transfer]]) -> None:
    """A worker's piece."""
    bench, folder, place = shared
    states, results, numbers, rows = _states(folder, task), [], [], []
    for number, transfer in task:
        content = bench.known(transfer.content)[0]
        try:
            result, facts = kept.load_result(kept.result_path(folder, number), content)
        except MotionKitError:
            continue  # it failed, and is counted
        found = {**bench.values(result, transfer), "seconds": facts["seconds"]}
        rows.append([found.get(name, math.nan) for name in VALUES])
        results.append(result)
        numbers.append(number)
    seen, places, problems = bench.see_each(results)
    tensors = {
        "numbers": torch.tensor(numbers, dtype=torch.long),
        "values": torch.tensor(rows, dtype=torch.float64).reshape(-1, len(VALUES)),
        "seen": torch.tensor([numbers[p] for p in places], dtype=torch.long),
        **seen,
    }
    kept.save(
        _piece_path(place, task), tensors, {"states": states, "problems": {numbers[n]: p for n, p in problems.items()}}
    )


def _joined(pieces: Sequence[tuple[dict[str, Tensor], dict]], count: int) -> Measured:
    values = torch.full((count, len(VALUES)), math.nan, dtype=torch.float64)
    seen: dict[str, Tensor] = {}
    problems = {}
    for tensors, facts in pieces:
        values[tensors["numbers"]] = tensors["values"]
        problems |= {int(n): problem for n, problem in facts["problems"].items()}
        for name in SEEN:
            if name in tensors:
                rows = seen.setdefault(name, torch.full((count, tensors[name].shape[1]), math.nan))
                rows[tensors["seen"]] = tensors[name]
    return Measured(seen, dict(zip(VALUES, values.T)), problems)


def measure_clips(bench: Bench, clips: Dataset, folder: Path, key: str, jobs: int | None) -> Measured:
    """What the judge sees in captured or performed clips, and how much their own feet slide."""
    if not len(clips):
        return Measured({}, {"fsf": torch.zeros(0, dtype=torch.float64)})
    path = folder / f"clips-{key}.safetensors"
    try:
        tensors, _ = kept.load(path)
    except MotionKitError:
        numbers = list(range(len(clips)))
        tasks = [numbers[n : n + _PIECE] for n in range(0, len(numbers), _PIECE)]
        parts = list(fan_out(_measure_clips, (bench, clips), tasks, jobs, "measuring clips", "clip"))
        tensors = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
        kept.save(path, tensors, {})
    nothing = torch.full((len(clips),), math.nan, dtype=torch.float64)
    values = {name: tensors["fsf"] if name == "fsf" else nothing for name in VALUES}
    return Measured({name: x for name, x in tensors.items() if name != "fsf"}, values)


def _measure_clips(shared: tuple[Bench, Dataset], numbers: Sequence[int]) -> dict[str, Tensor]:
    bench, clips = shared
    found = bench.see([clips[n].motion for n in numbers])
    sliding = [_if_any(lambda n=n: metrics.foot_sliding_factor(clips[n].motion, clips[n].contacts)) for n in numbers]
    return {**found, "fsf": torch.tensor(sliding, dtype=torch.float64)}
