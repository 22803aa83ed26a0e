"""From what was measured of each result to the figures of a row, each with its interval."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path

import torch
from torch import Tensor

from .. import metrics
from ..datasets import Clip, Dataset
from ..errors import MotionKitError
from ..files import read_bytes, write_atomic
from ..motion import Motion
from . import transfers
from .protocols import Transfer
from .transfers import REAL, Measured, one_thread

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
class EvalContext:
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
def scores_of(measured: Measured, setting: EvalContext, columns: tuple[str, ...]) -> dict[str, Cell]:
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
def scores_of_clips(clips: Measured, ids: dict[str, Tensor], train: Measured, setting: EvalContext) -> dict[str, Cell]:
    """The row of the test clips: what the judge makes of them, and how far as many training clips are from them."""
    alone = EvalContext(
        *[torch.arange(len(ids["content"]))] * 4, torch.zeros(len(ids["content"])), clips, setting.shrinkage
    )
    cells = {
        f"{label[0]}ra": _cell(torch.mean, (_recognised(clips.seen[f"{label}_scores"], ids[label]),), alone)
        for label in ids
    }
    for column, name in (("fmd", "content_features"), ("fmd_ae", "ae_features")):
        count = len(train.values["fsf"])
        sample = EvalContext(*[torch.arange(count)] * 4, torch.zeros(count), clips, setting.shrinkage)
        cells[column] = _distance(train.seen.get(name), clips.seen.get(name), None, sample)
    return {**cells, "fsf": _mean(clips.values["fsf"], alone, torch.mean)}


def _recognised(scores: Tensor, ids: Tensor) -> Tensor:
    """100 for each motion whose class is named, 0 for the others, [N]: `metrics.recognition_accuracy` is the mean."""
    return torch.tensor([metrics.recognition_accuracy(s[None], i[None]) for s, i in zip(scores, ids)]).double()


def _mean(values: Tensor, setting: EvalContext, statistic: Callable) -> Cell:
    there = torch.isfinite(values)
    if not there.any():
        return Cell(math.nan, missing=len(values), why="not defined for these results")
    return _cell(statistic, (values[there],), setting, there)


def _distance(results: Tensor | None, real: Tensor | None, pairs: Tensor | None, setting: EvalContext) -> Cell:
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
    statistic: Callable, samples: tuple, setting: EvalContext, there: Tensor | None = None, distance: bool = False
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


@dataclass(frozen=True, eq=False)
class Outcome:
    """One transfer and what came of it. problem: why there is no result, or none that could be judged; else empty."""

    content: Clip
    style: Clip
    values: dict[str, float]
    problem: str = ""
    path: Path | None = None

    @property
    def motion(self) -> Motion:
        """The result, read from disk; MotionKitError that says why where there is none."""
        if self.path is None:
            return self.content.motion
        if not self.path.exists():
            raise MotionKitError(f"{self.content.name} as {self.style.name}: no result: {self.problem}")
        return transfers.load_result(self.path, self.content.motion)[0]

    def __repr__(self) -> str:
        problem = f", {self.problem}" if self.problem else ""
        return f"Outcome({self.content.name!r} as {self.style.name!r}{problem})"


@dataclass(frozen=True, eq=False)
class Results(Sequence):
    """The outcomes of a method in the protocol's order: `results[3].motion`, `len(results)`, a loop.

    Tensors of all N at once, with rows of NaN where a transfer failed: `scores(label)` and `features(label)` of the
    judge, `ids(label)`, its classes that would have been right. label: "content" or "style"; features also has "ae".
    """

    method: str
    test: Dataset
    transfers: tuple[Transfer, ...]
    measured: Measured
    right: dict[str, Tensor]
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.transfers)

    def __getitem__(self, number: int) -> Outcome:
        if not hasattr(number, "__index__") or not -len(self) <= number < len(self):
            raise IndexError(f"results of {self.method!r} go from 0 to {len(self) - 1}; found [{number!r}]")
        number = int(number) % len(self)
        transfer = self.transfers[number]
        path = None if self.folder is None else transfers.result_path(self.folder, number)
        values = {name: float(x[number]) for name, x in self.measured.values.items()}
        problem = self.measured.problems.get(number, "")
        return Outcome(self.test[transfer.content], self.test[transfer.style], values, problem, path)

    def __iter__(self) -> Iterator[Outcome]:
        return (self[n] for n in range(len(self)))

    def __repr__(self) -> str:
        return f"Results({self.method!r}, {len(self)} transfers, {len(self.measured.problems)} failed)"

    def scores(self, label: str) -> Tensor:
        """The judge's log-probabilities [N, C] of `content` or `style`."""
        return self._seen(label, "scores")

    def features(self, label: str) -> Tensor:
        """The judge's features [N, D]: of its `content` or `style` classifier, or its autoencoder (`ae`)."""
        return self._seen(label, "features")

    def ids(self, label: str) -> Tensor:
        """The classes [N] that would be right: content of the content clips, or style of the style clips."""
        if label not in self.right:
            raise MotionKitError(f"labels are 'content' and 'style'; found {label!r}")
        return self.right[label]

    def _seen(self, label: str, what: str) -> Tensor:
        name = f"{label}_{what}"
        if name not in self.measured.seen:
            there = ", ".join(sorted(n.removesuffix(f"_{what}") for n in self.measured.seen if n.endswith(what)))
            raise MotionKitError(f"results of {self.method!r}: no {what} {label!r}; there are {there or 'none'}")
        return self.measured.seen[name]


ARROWS = {"down": "↓", "up": "↑", "one": "→ 1"}
_WIDTH = 120  # characters of a printed line
_TOLD = 3  # failures that are shown
_DIGITS = 5  # that records keep


@dataclass(frozen=True, eq=False)
class Row:
    """A method's figures. count: how many transfers. failed: of those that did, number to what happened, which begins
    with the names of its clips.
    """

    method: str
    cells: dict[str, Cell]
    count: int
    failed: dict[int, str] = field(default_factory=dict)

    @property
    def told(self) -> list[str]:
        """What failed, the first three of different kinds."""
        kinds = {message.partition(": ")[2]: message for message in reversed(self.failed.values())}
        return list(kinds.values())[: -_TOLD - 1 : -1]

    def cell(self, column: str) -> Cell:
        """The figure of a column; one without a value where the row has none."""
        return self.cells.get(column, Cell(math.nan))


@dataclass(frozen=True, eq=False)
class ArenaTable:
    """Rows of figures, one a method, and last the `real` clips, which bound them. Print it, or show it in a notebook.

    provenance: what it was measured on, and with what. `table.results(method)` are the transfers themselves.

    >>> table = ArenaTable.from_records([{"method": "mine", "transfers": 9, "sra": 50.0, "sra_ci": [40.0, 60.0]}])
    >>> print(table)
    method  SRA % ↑
    mine    50.0 [40.0, 60.0]
    """

    rows: tuple[Row, ...]
    columns: tuple[str, ...]
    provenance: dict[str, object] = field(default_factory=dict)
    views: dict[str, Results] = field(default_factory=dict, repr=False)

    def __getitem__(self, method: str) -> Row:
        """A method's row; MotionKitError names those that there are."""
        for row in self.rows:
            if row.method == method:
                return row
        raise MotionKitError(f"no row {method!r}; there are {', '.join(row.method for row in self.rows)}")

    def results(self, method: str) -> Results:
        """A method's transfers: clips, result, scores and features of each; of "real" the test clips."""
        self[method]
        if method not in self.views:
            raise MotionKitError(
                f"this table was read from a file, without results; mk.arena.run gives {method!r} some"
            )
        return self.views[method]

    def only(self, *columns: str) -> ArenaTable:
        """The table with some of its columns, such as "cra", "sra"; MotionKitError names all."""
        unknown = [column for column in columns if column not in COLUMNS]
        if unknown or not columns:
            raise MotionKitError(f"no column {unknown[0] if unknown else ''!r}; there are {', '.join(COLUMNS)}")
        return replace(self, columns=columns)

    def best(self, column: str) -> str:
        """The method whose figure in a column is best, among those that have it for all transfers; or empty."""
        better = COLUMNS[column].better
        rank = {"down": lambda x: x, "up": lambda x: -x, "one": lambda x: abs(math.log(max(x, 1e-9)))}[better]
        cells = {row.method: row.cell(column) for row in self.rows if row.method != REAL and not row.failed}
        sound = {method: rank(c.value) for method, c in cells.items() if c.value == c.value and not c.missing}
        return min(sound, key=sound.get) if sound else ""

    def notes(self) -> list[str]:
        """What must be said beside the figures: failures, and figures that some results do not have."""
        found = []
        for row in self.rows:
            if row.failed:
                found.append(
                    f"{row.method}: {len(row.failed)} of {row.count} transfers failed, counted as not recognised: "
                    + "; ".join(row.told)
                )
            starred: dict[int, list[str]] = {}
            without: dict[str, list[str]] = {}
            for column in self.columns:
                cell = row.cell(column)
                if cell.missing:
                    starred.setdefault(cell.missing, []).append(_title(column))
                if cell.why and cell.missing < row.count:
                    without.setdefault(cell.why, []).append(_title(column))
            found += [f"{row.method}: no {', '.join(c)}: {why}" for why, c in without.items()]
            found += [f"* {row.method}: {', '.join(c)} without {n} of {row.count}" for n, c in starred.items()]
        return found

    def records(self) -> list[dict]:
        """A dict for each row, for JSON and data frames: FIGURE, and FIGURE_ci [low, high] or FIGURE_std."""
        return [_record(row, self.columns) for row in self.rows]

    def to_json(self, path: str | os.PathLike) -> Path:
        """Write provenance and records; `ArenaTable.from_json` reads them. Returns the path."""
        return write_atomic(path, json.dumps({"provenance": self.provenance, "rows": self.records()}, indent=2) + "\n")

    @classmethod
    def from_json(cls, path: str | os.PathLike) -> ArenaTable:
        """The table that `to_json` wrote, without the results; MotionKitError if it is none."""
        try:
            found = json.loads(read_bytes(path))
            return cls.from_records(found["rows"], found["provenance"])
        except (ValueError, KeyError, TypeError) as error:
            raise MotionKitError(f"{path}: not a table of the arena ({error})") from None

    @classmethod
    def from_records(cls, records: Sequence[Mapping], provenance: Mapping | None = None) -> ArenaTable:
        """The table of such records as `records` gives."""
        columns = tuple(c for c in COLUMNS if any(record.get(c) is not None for record in records))
        return cls(tuple(_row(record, columns) for record in records), columns, dict(provenance or {}))

    def caption(self) -> str:
        """One line that says what the table was measured on."""
        known = self.provenance
        if not known:
            return ""
        spread = "± a standard deviation over repeats" if known.get("repeats", 1) > 1 else "[95 % interval]"
        shrunk = f", shrinkage {known['shrinkage']:g}" if known.get("shrinkage") is not None else ""
        what = f"{known['dataset']}, protocol {known['protocol']}, seed {known['seed']}: {known['transfers']} transfers"
        return f"{what}, judge {known['judge']}{shrunk}; {spread}"

    def __str__(self) -> str:
        names = ["method", *(row.method for row in self.rows)]
        blocks = [[names]]
        for column in self.columns:
            texts = [f"{_title(column)} {ARROWS[COLUMNS[column].better]}"]
            texts += [_text(row.cell(column), column) for row in self.rows]
            if sum(max(map(len, t)) + 2 for t in [*blocks[-1], texts]) > _WIDTH + 2 and len(blocks[-1]) > 1:
                blocks.append([names])
            blocks[-1].append(texts)
        return "\n".join([*filter(None, [self.caption()]), "\n\n".join(map(_aligned, blocks)), *self.notes()])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        best = {column: self.best(column) for column in self.columns}
        bold = {column: _value(self[row].cell(column), column) for column, row in best.items() if row}
        head = "".join(
            f'<th style="text-align:right" title="{escape(COLUMNS[c].about)}">'
            f"{escape(_title(c))} {ARROWS[COLUMNS[c].better]}</th>"
            for c in self.columns
        )
        body = ""
        for row in self.rows:
            cells = "".join(_html(row.cell(c), c, "" if row.method == REAL else bold.get(c, "")) for c in self.columns)
            shade = ' style="opacity:0.65"' if row.method == REAL else ""
            body += f'<tr{shade}><td style="text-align:left">{escape(row.method)}</td>{cells}</tr>'
        notes = "".join(f"<br>{escape(note)}" for note in self.notes())
        foot = f'<p style="font-size:smaller">{escape(self.caption())}{notes}</p>'
        head = f'<thead><tr><th style="text-align:left">method</th>{head}</tr></thead>'
        return f"<table>{head}<tbody>{body}</tbody></table>{foot}"


def _aligned(block: Sequence[Sequence[str]]) -> str:
    """Columns of texts as lines."""
    widths = [max(map(len, texts)) for texts in block]
    return "\n".join("  ".join(f"{t:<{w}}" for t, w in zip(line, widths)).rstrip() for line in zip(*block))


def _title(column: str) -> str:
    return COLUMNS[column].title


def _spread(cell: Cell, digits: int) -> str:
    if cell.value != cell.value or cell.low != cell.low:
        return ""
    if cell.deviation:
        return f"±{cell.value - cell.low:.{digits}f}"
    return f" [{cell.low:.{digits}f}, {cell.high:.{digits}f}]"


def _value(cell: Cell, column: str) -> str:
    return "–" if cell.value != cell.value else f"{cell.value:.{COLUMNS[column].digits}f}"


def _text(cell: Cell, column: str) -> str:
    return f"{_value(cell, column)}{'*' if cell.missing else ''}{_spread(cell, COLUMNS[column].digits)}"


def _html(cell: Cell, column: str, best: str) -> str:
    value, star = _value(cell, column), "*" if cell.missing else ""
    value = f"<b>{value}</b>" if value == best and not star else value
    spread = _spread(cell, COLUMNS[column].digits).strip()
    small = f'<br><span style="opacity:0.6;font-size:smaller">{spread}</span>' if spread else ""
    return f'<td style="text-align:right;white-space:nowrap">{value}{star}{small}</td>'


def _number(value: float) -> float | None:
    return None if value != value else float(f"{value:.{_DIGITS}g}")


def _record(row: Row, columns: Sequence[str]) -> dict:
    record: dict = {"method": row.method, "transfers": row.count, "failed": len(row.failed)}
    if row.failed:
        record["failures"] = row.told
    for column in columns:
        cell = row.cell(column)
        record[column] = _number(cell.value)
        if cell.deviation:
            record[f"{column}_std"] = _number(cell.value - cell.low)
        elif cell.low == cell.low:
            record[f"{column}_ci"] = [_number(cell.low), _number(cell.high)]
        if cell.missing:
            record[f"{column}_missing"] = cell.missing
        if cell.why:
            record[f"{column}_why"] = cell.why
    return record


def _row(record: Mapping, columns: Sequence[str]) -> Row:
    cells = {}
    for column in columns:
        value = record.get(column)
        value, std = math.nan if value is None else value, record.get(f"{column}_std")
        low, high = (value - std, value + std) if std is not None else record.get(f"{column}_ci", (math.nan, math.nan))
        missing, why = record.get(f"{column}_missing", 0), record.get(f"{column}_why", "")
        cells[column] = Cell(value, low, high, std is not None, missing, why)
    told = record.get("failures") or [""]
    failed = {n: told[min(n, len(told) - 1)] for n in range(record.get("failed", 0))}
    return Row(record["method"], cells, record.get("transfers", 0), failed)
