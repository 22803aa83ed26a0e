"""From what was measured of each result to the figures of a row, each with its interval."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .. import metrics
from ..errors import MotionKitError
from .fanning import one_thread
from .measuring import Measured

_DRAWS = {True: 200, False: 1000}  # of the bootstrap: a Fréchet distance takes a hundred times as long as a mean


@dataclass(frozen=True)
class Column:
    """A figure of the table. better: `down`, `up`, or `one` where results should be like the content."""

    title: str
    better: str
    digits: int
    about: str


COLUMNS = {
    "fmd": Column("FMD", "down", 2, "content classifier's features, results against test clips (paper 1)"),
    "fmd_ae": Column("FMD (ae)", "down", 3, "denoising autoencoder's features, against test clips (paper 2)"),
    "fmd_content": Column("content FMD", "down", 2, "content features, against the content clips (paper 5)"),
    "fmd_style": Column("style FMD", "down", 2, "style features, against the style clips (paper 5)"),
    "cra": Column("CRA %", "up", 1, "results whose content is recognised (papers 1, 3, 4)"),
    "sra": Column("SRA %", "up", 1, "results whose style is recognised (papers 1, 4)"),
    "truth_error": Column("truth error mm", "down", 1, "joints' distance from what the performer would have done"),
    "tsi": Column("TSI m", "down", 3, "distance of the paths over the ground (paper 4)"),
    "fsf": Column("FSF mm", "down", 2, "a frame's sliding of standing feet (paper 4)"),
    "fca": Column("FCA %", "up", 1, "frames and feet that stand, or not, as the content's do (paper 1)"),
    "jitter": Column("jitter x", "one", 2, "mean jerk, as a multiple of the content's"),
    "seconds": Column("seconds", "down", 3, "of a transfer, the median; differs from run to run"),
}


@dataclass(frozen=True)
class Cell:
    """A figure: value, and between which two it lies. deviation: low and high are a standard deviation away, over
    repeats, instead of the ends of a 95 % interval. missing: of how many results there is no such figure; NaN and why,
    where there is none at all.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    deviation: bool = False
    missing: int = 0
    why: str = ""


@dataclass(frozen=True, eq=False)
class Setting:
    """What scores depend on beside a method's results. All [N], a number for each transfer.

    contents, styles: which of the test clips. content_ids, style_ids: the judge's classes. repeats: of which draw.
    """

    contents: Tensor
    styles: Tensor
    content_ids: Tensor
    style_ids: Tensor
    repeats: Tensor
    clips: Measured  # all test clips
    shrinkage: float | None = None
    seed: int = 0


@one_thread()
def scores_of(measured: Measured, setting: Setting, columns: tuple[str, ...]) -> dict[str, Cell]:
    """A method's figures."""
    clips, seen = setting.clips.seen, measured.seen
    cells = {}
    for column in columns:
        if column in ("cra", "sra"):
            label = {"cra": "content", "sra": "style"}[column]
            ids = getattr(setting, f"{label}_ids")
            scores = seen.get(f"{label}_scores", torch.full((len(ids), int(ids.max()) + 1), math.nan))
            cells[column] = _cell(torch.mean, (_recognised(scores, ids),), setting)
        elif column.startswith("fmd"):
            label = {"fmd": "content", "fmd_ae": "ae", "fmd_content": "content", "fmd_style": "style"}[column]
            real, results = clips.get(f"{label}_features"), seen.get(f"{label}_features")
            pairs = {"fmd_content": setting.contents, "fmd_style": setting.styles}.get(column)
            cells[column] = _distance(results, real, pairs, setting)
        else:
            values = measured.values[column]
            cells[column] = _mean(values, setting, torch.median if column == "seconds" else torch.mean)
    return cells


@one_thread()
def scores_of_clips(clips: Measured, ids: dict[str, Tensor], train: Measured, setting: Setting) -> dict[str, Cell]:
    """The row of the test clips: what the judge makes of them, and how far as many training clips are from them."""
    alone = Setting(
        *[torch.arange(len(ids["content"]))] * 4, torch.zeros(len(ids["content"])), clips, setting.shrinkage
    )
    cells = {
        f"{label[0]}ra": _cell(torch.mean, (_recognised(clips.seen[f"{label}_scores"], ids[label]),), alone)
        for label in ids
    }
    for column, name in (("fmd", "content_features"), ("fmd_ae", "ae_features")):
        count = len(train.values["fsf"])
        sample = Setting(*[torch.arange(count)] * 4, torch.zeros(count), clips, setting.shrinkage)
        cells[column] = _distance(train.seen.get(name), clips.seen.get(name), None, sample)
    return {**cells, "fsf": _mean(clips.values["fsf"], alone, torch.mean)}


def _recognised(scores: Tensor, ids: Tensor) -> Tensor:
    """100 for each motion whose class is named, 0 for the others, [N]: `metrics.recognition_accuracy` is the mean."""
    return torch.tensor([metrics.recognition_accuracy(s[None], i[None]) for s, i in zip(scores, ids)]).double()


def _mean(values: Tensor, setting: Setting, statistic: Callable) -> Cell:
    there = torch.isfinite(values)
    if not there.any():
        return Cell(math.nan, missing=len(values), why="not defined for these results")
    return _cell(statistic, (values[there],), setting, there)


def _distance(results: Tensor | None, real: Tensor | None, pairs: Tensor | None, setting: Setting) -> Cell:
    """A Fréchet distance, from all real clips or (pairs) from the transfers' own."""
    if real is None:
        return Cell(math.nan, why="the judge has no such features")
    if results is None:
        return Cell(math.nan, missing=len(setting.contents), why="no result could be judged")
    there = torch.isfinite(results).all(1)
    size, count = results.shape[1], int(there.sum())
    if pairs is None:
        samples, statistic = (results[there],), lambda x: metrics.fmd(x, real, shrinkage=setting.shrinkage)
        few = min(count, len(real))
    else:
        samples = results[there], real[pairs[there]]
        few, statistic = count, lambda x, y: metrics.fmd(x, y, shrinkage=setting.shrinkage)
    if few <= (size if setting.shrinkage is None else 1):
        return Cell(
            math.nan,
            missing=len(there) - count,
            why=f"{few} motions; a covariance of {size} numbers needs at least {size + 1}, or run(..., shrinkage=0.1)",
        )
    return _cell(statistic, samples, setting, there, distance=True)


def _cell(
    statistic: Callable, samples: tuple, setting: Setting, there: Tensor | None = None, distance: bool = False
) -> Cell:
    """A statistic of the results that have it (all, if `there` is left out), with its interval or deviation."""
    there = torch.ones(len(samples[0]), dtype=torch.bool) if there is None else there
    missing, repeats = int((~there).sum()), setting.repeats[there]
    if len(setting.repeats.unique()) > 1:
        try:
            found = metrics.spread([float(statistic(*(s[repeats == r] for s in samples))) for r in repeats.unique()])
        except MotionKitError as error:
            return Cell(math.nan, missing=missing, why=f"a single repeat has too few results ({error})")
        return Cell(found.mean, found.mean - found.std, found.mean + found.std, True, missing)
    clips = (setting.contents,) if torch.equal(setting.contents, setting.styles) else (setting.contents, setting.styles)
    groups = tuple(ids[there] for ids in clips)
    try:
        options = {"repeats": _DRAWS[distance], "seed": setting.seed, "groups": groups, "centred": distance}
        value, low, high = metrics.bootstrap(statistic, *samples, **options)
    except MotionKitError:  # a single row, or all rows of one clip: a value without a known spread
        return Cell(float(statistic(*samples)), missing=missing)
    return Cell(value, max(low, 0.0) if distance else low, high, missing=missing)
