"""The table: from measures of each result to the figures of a row, each with its interval, and to print."""

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
from .protocols import Transfer
from .transfers import REAL, Measures, load_result, one_thread, result_path

ARROWS = {"down": "↓", "up": "↑", "one": "→ 1"}
_WIDTH = 120  # characters of a printed line
_FAILURES = 3  # that are shown
_DIGITS = 5  # that records keep


@dataclass(frozen=True)
class Cell:
    """A figure: value, and between which two it lies. missing: of how many results there is no such figure; NaN and
    why, where there is none at all. deviation: low and high are a standard deviation away, over repeats, instead of the
    ends of a 95 % interval.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    missing: int = 0
    why: str = ""
    deviation: bool = field(default=False, kw_only=True)


@dataclass(frozen=True)
class Column:
    """A figure of the table. better: `down`, `up`, or `one` where results should be like the content."""

    title: str
    better: str
    digits: int
    about: str

    @property
    def heading(self) -> str:
        """Title and arrow."""
        return f"{self.title} {ARROWS[self.better]}"

    def value(self, cell: Cell) -> str:
        """A figure as printed; a dash where there is none."""
        return "–" if math.isnan(cell.value) else f"{cell.value:.{self.digits}f}"

    def spread(self, cell: Cell) -> str:
        """Its interval or deviation as printed; empty where there is none."""
        if math.isnan(cell.value) or math.isnan(cell.low):
            return ""
        if cell.deviation:
            return f"±{cell.value - cell.low:.{self.digits}f}"
        return f" [{cell.low:.{self.digits}f}, {cell.high:.{self.digits}f}]"


COLUMNS = {
    "fmd": Column("FMD", "down", 2, "content classifier's features, results against test clips (paper 1)"),
    "fmd_ae": Column("FMD (ae)", "down", 3, "denoising autoencoder's features, against test clips (paper 2)"),
    "fmd_content": Column("content FMD", "down", 2, "content features, against the content clips (paper 5)"),
    "fmd_style": Column("style FMD", "down", 2, "style features, against the style clips (paper 5)"),
    "cra": Column("CRA %", "up", 1, "results whose content is recognised (papers 1, 3, 4)"),
    "sra": Column("SRA %", "up", 1, "results whose style is recognised (papers 1, 4)"),
    "truth_error": Column("ground-truth error mm", "down", 1, "joints' distance from what the performer would do"),
    "tsi": Column("TSI m", "down", 3, "distance of the paths over the ground (paper 4)"),
    "fsf": Column("FSF mm", "down", 2, "a frame's sliding of planted feet (paper 4)"),
    "fca": Column("FCA %", "up", 1, "frames and feet that stand, or not, as the content's do (paper 1)"),
    "jitter": Column("jitter x", "one", 2, "mean jerk, as a multiple of the content's"),
    "seconds": Column("seconds", "down", 3, "of a transfer, the median; differs from run to run"),
}


@dataclass(frozen=True, eq=False)
class EvalContext:
    """What figures depend on beside a method's results; tensors have a number for each of N transfers.

    contents, styles: which of the clips, [N]. repeats: of which draw, [N]. ids: the judge's classes of `content` and
    `style` that would be right, [N]. clips: measures of all test clips.
    """

    contents: Tensor
    styles: Tensor
    repeats: Tensor
    ids: dict[str, Tensor]
    clips: Measures
    shrinkage: float | None = None
    seed: int = 0

    @classmethod
    def of_clips(cls, count: int, ids: dict[str, Tensor], clips: Measures, shrinkage: float | None) -> EvalContext:
        """Of clips themselves, each of which is its own content and style."""
        numbers = torch.arange(count)
        return cls(numbers, numbers, torch.zeros(count), ids, clips, shrinkage)


_LABELS = {  # whose scores or features a column takes
    "cra": "content",
    "sra": "style",
    "fmd": "content",
    "fmd_ae": "ae",
    "fmd_content": "content",
    "fmd_style": "style",
}


@one_thread()
def figures(measures: Measures, context: EvalContext, columns: Sequence[str]) -> dict[str, Cell]:
    """The cells of a row."""
    cells = {}
    for column in columns:
        if column in ("cra", "sra"):
            cells[column] = _accuracy(measures, context, _LABELS[column])
        elif column.startswith("fmd"):
            clips = {"fmd_content": context.contents, "fmd_style": context.styles}.get(column)
            cells[column] = _distance(measures, context, f"{_LABELS[column]}_features", clips)
        else:
            cells[column] = _mean(measures, context, column)
    return cells


def _accuracy(measures: Measures, context: EvalContext, label: str) -> Cell:
    """`metrics.recognition_accuracy`, the mean of 100 for each motion whose class is named, and of 0 for the others."""
    ids = context.ids[label]
    nothing = torch.full((len(ids), int(ids.max()) + 1), math.nan)
    scores = measures.judge_outputs.get(f"{label}_scores", nothing)
    right = [metrics.recognition_accuracy(score[None], n[None]) for score, n in zip(scores, ids)]
    return _cell(torch.mean, (torch.tensor(right).double(),), context)


def _mean(measures: Measures, context: EvalContext, column: str) -> Cell:
    values = measures.values[column]
    defined = torch.isfinite(values)
    if not defined.any():
        return Cell(math.nan, missing=len(values), why="not defined for these results")
    return _cell(torch.median if column == "seconds" else torch.mean, (values[defined],), context, defined)


def _distance(measures: Measures, context: EvalContext, name: str, numbers: Tensor | None) -> Cell:
    """A Fréchet distance, from all test clips or (numbers) from those of the transfers."""
    real, features = context.clips.judge_outputs.get(name), measures.judge_outputs.get(name)
    if real is None:
        return Cell(math.nan, why="the judge has no such features")
    if features is None:
        return Cell(math.nan, missing=len(context.contents), why="no result could be judged")
    defined = torch.isfinite(features).all(1)
    size, count = features.shape[1], int(defined.sum())
    if numbers is None:
        few, samples = min(count, len(real)), (features[defined],)
    else:
        few, samples = count, (features[defined], real[numbers[defined]])
    if few <= (size if context.shrinkage is None else 1):
        why = f"{few} motions; a covariance of {size} numbers needs at least {size + 1}, or run(..., shrinkage=0.1)"
        return Cell(math.nan, missing=len(defined) - count, why=why)

    def fmd(results: Tensor, clips: Tensor = real) -> float:
        return metrics.fmd(results, clips, shrinkage=context.shrinkage)

    return _cell(fmd, samples, context, defined, distance=True)


def _cell(
    statistic: Callable,
    samples: tuple[Tensor, ...],
    context: EvalContext,
    defined: Tensor | None = None,
    *,
    distance: bool = False,
) -> Cell:
    """A statistic of the results that have it (all, if `defined` is left out), with its interval or deviation."""
    if defined is None:
        defined = torch.ones(len(samples[0]), dtype=torch.bool)
    missing, repeats = int((~defined).sum()), context.repeats[defined]
    if len(context.repeats.unique()) > 1:
        try:
            values = [float(statistic(*(x[repeats == repeat] for x in samples))) for repeat in repeats.unique()]
            mean, deviation, _ = metrics.spread(values)
        except MotionKitError as error:
            return Cell(math.nan, missing=missing, why=f"a single repeat has too few results ({error})")
        return Cell(mean, mean - deviation, mean + deviation, missing, deviation=True)
    clips = [context.contents] if torch.equal(context.contents, context.styles) else [context.contents, context.styles]
    draws = 200 if distance else 1000  # a Fréchet distance takes a hundred times as long as a mean
    options = {"repeats": draws, "seed": context.seed, "centred": distance}
    try:
        value, low, high = metrics.bootstrap(statistic, *samples, groups=[ids[defined] for ids in clips], **options)
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
        return load_result(self.path, self.content.motion)[0]

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
    measures: Measures
    right_ids: dict[str, Tensor]
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.transfers)

    def __getitem__(self, number: int) -> Outcome:
        if not hasattr(number, "__index__") or not -len(self) <= number < len(self):
            raise IndexError(f"results of {self.method!r} go from 0 to {len(self) - 1}; found [{number!r}]")
        number = int(number) % len(self)
        transfer = self.transfers[number]
        path = None if self.folder is None else result_path(self.folder, number)
        values = {name: float(x[number]) for name, x in self.measures.values.items()}
        problem = self.measures.problems.get(number, "")
        return Outcome(self.test[transfer.content], self.test[transfer.style], values, problem, path)

    def __iter__(self) -> Iterator[Outcome]:
        return (self[n] for n in range(len(self)))

    def __repr__(self) -> str:
        return f"Results({self.method!r}, {len(self)} transfers, {len(self.measures.problems)} failed)"

    def scores(self, label: str) -> Tensor:
        """The judge's log-probabilities [N, C] of `content` or `style`."""
        return self._judge_outputs(label, "scores")

    def features(self, label: str) -> Tensor:
        """The judge's features [N, D]: of its `content` or `style` classifier, or its autoencoder (`ae`)."""
        return self._judge_outputs(label, "features")

    def ids(self, label: str) -> Tensor:
        """The classes [N] that would be right: content of the content clips, or style of the style clips."""
        if label not in self.right_ids:
            raise MotionKitError(f"labels are 'content' and 'style'; found {label!r}")
        return self.right_ids[label]

    def _judge_outputs(self, label: str, what: str) -> Tensor:
        outputs = self.measures.judge_outputs
        if f"{label}_{what}" not in outputs:
            known = sorted(name.removesuffix(f"_{what}") for name in outputs if name.endswith(what))
            raise MotionKitError(
                f"results of {self.method!r}: no {what} {label!r}; there are {', '.join(known) or 'none'}"
            )
        return outputs[f"{label}_{what}"]


@dataclass(frozen=True, eq=False)
class Row:
    """A method's figures. count: how many transfers. failed: of those that did, number to what happened, which begins
    with the names of its clips. dataset: whose clips these were.
    """

    method: str
    cells: dict[str, Cell]
    count: int
    failed: dict[int, str] = field(default_factory=dict)
    dataset: str = ""

    @property
    def failures(self) -> list[str]:
        """What failed, the first three of different kinds."""
        kinds = {message.partition(": ")[2]: message for message in reversed(self.failed.values())}
        return list(kinds.values())[: -_FAILURES - 1 : -1]

    def cell(self, column: str) -> Cell:
        """The figure of a column; one without a value where the row has none."""
        return self.cells.get(column, Cell(math.nan))

    def record(self, columns: Sequence[str], dataset: str) -> dict:
        """The row as a dict, see `ArenaTable.records`. dataset: whose clips, where the row does not say so itself."""
        record = {"method": self.method, "dataset": self.dataset or dataset}
        record |= {"transfers": self.count, "failed": len(self.failed)}
        if self.failed:
            record["failures"] = self.failures
        for column in columns:
            cell = self.cell(column)
            record[column] = _rounded(cell.value)
            if cell.deviation:
                record[f"{column}_std"] = _rounded(cell.value - cell.low)
            elif not math.isnan(cell.low):
                record[f"{column}_ci"] = [_rounded(cell.low), _rounded(cell.high)]
            if cell.missing:
                record[f"{column}_missing"] = cell.missing
            if cell.why:
                record[f"{column}_why"] = cell.why
        return record

    @classmethod
    def from_record(cls, record: Mapping, columns: Sequence[str], dataset: str) -> Row:
        """The row that such a dict describes."""
        cells = {}
        for column in columns:
            value, std = record.get(column), record.get(f"{column}_std")
            value = math.nan if value is None else value
            low, high = record.get(f"{column}_ci", (math.nan, math.nan)) if std is None else (value - std, value + std)
            missing, why = record.get(f"{column}_missing", 0), record.get(f"{column}_why", "")
            cells[column] = Cell(value, low, high, missing, why, deviation=std is not None)
        failures = record.get("failures") or [""]
        failed = {n: failures[min(n, len(failures) - 1)] for n in range(record.get("failed", 0))}
        return cls(record["method"], cells, record.get("transfers", 0), failed, record.get("dataset") or dataset)


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else float(f"{value:.{_DIGITS}g}")


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
    results_by_method: dict[str, Results] = field(default_factory=dict, repr=False)

    def __getitem__(self, method: str) -> Row:
        """A method's row; MotionKitError names those that there are."""
        for row in self.rows:
            if row.method == method:
                return row
        raise MotionKitError(f"no row {method!r}; there are {', '.join(row.method for row in self.rows)}")

    def results(self, method: str) -> Results:
        """A method's transfers: clips, result, scores and features of each; of "real" the test clips."""
        self[method]
        if method not in self.results_by_method:
            raise MotionKitError(
                f"this table was read from a file, without results; mk.arena.run gives {method!r} some"
            )
        return self.results_by_method[method]

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
        notes = []
        for row in self.rows:
            if row.failed:
                notes.append(
                    f"{row.method}: {len(row.failed)} of {row.count} transfers failed, counted as not recognised: "
                    + "; ".join(row.failures)
                )
            reasons: dict[str, list[str]] = {}
            missing: dict[int, list[str]] = {}
            for column in self.columns:
                cell, title = row.cell(column), COLUMNS[column].title
                if cell.why and cell.missing < row.count:
                    reasons.setdefault(cell.why, []).append(title)
                if cell.missing:
                    missing.setdefault(cell.missing, []).append(title)
            notes += [f"{row.method}: no {', '.join(titles)}: {why}" for why, titles in reasons.items()]
            notes += [
                f"* {row.method}: {', '.join(titles)} without {n} of {row.count}" for n, titles in missing.items()
            ]
        return notes

    def records(self) -> list[dict]:
        """A dict for each row, for JSON and data frames: method, dataset, transfers, failed; FIGURE, and FIGURE_ci
        [low, high] or FIGURE_std.
        """
        return [row.record(self.columns, self.provenance.get("dataset", "")) for row in self.rows]

    def to_json(self, path: str | os.PathLike) -> Path:
        """Write provenance and records; `ArenaTable.from_json` reads them. Returns the path."""
        return write_atomic(path, json.dumps({"provenance": self.provenance, "rows": self.records()}, indent=2) + "\n")

    @classmethod
    def from_json(cls, path: str | os.PathLike) -> ArenaTable:
        """The table that `to_json` wrote, without the results; MotionKitError if it is none."""
        try:
            table = json.loads(read_bytes(path))
            return cls.from_records(table["rows"], table["provenance"])
        except (ValueError, KeyError, TypeError) as error:
            raise MotionKitError(f"{path}: not a table of the arena ({error})") from None

    @classmethod
    def from_records(cls, records: Sequence[Mapping], provenance: Mapping | None = None) -> ArenaTable:
        """The table of such records as `records` gives."""
        columns = tuple(c for c in COLUMNS if any(record.get(c) is not None for record in records))
        provenance = dict(provenance or {})
        rows = (Row.from_record(record, columns, provenance.get("dataset", "")) for record in records)
        return cls(tuple(rows), columns, provenance)

    def caption(self) -> str:
        """One line that says what the table was measured on."""
        about = self.provenance
        if not about:
            return ""
        spread = "± a standard deviation over repeats" if about.get("repeats", 1) > 1 else "[95 % interval]"
        shrinkage = f", shrinkage {about['shrinkage']:g}" if about.get("shrinkage") is not None else ""
        what = f"{about['dataset']}, protocol {about['protocol']}, seed {about['seed']}: {about['transfers']} transfers"
        return f"{what}, judge {about['judge']}{shrinkage}; {spread}"

    def __str__(self) -> str:
        names = ["method", *(row.method for row in self.rows)]
        blocks = [[names]]  # of columns of texts, no block wider than a line
        for name in self.columns:
            column, texts = COLUMNS[name], [COLUMNS[name].heading]
            for cell in (row.cell(name) for row in self.rows):
                texts.append(f"{column.value(cell)}{'*' if cell.missing else ''}{column.spread(cell)}")
            if sum(max(map(len, t)) + 2 for t in [*blocks[-1], texts]) > _WIDTH + 2 and len(blocks[-1]) > 1:
                blocks.append([names])
            blocks[-1].append(texts)
        return "\n".join([*filter(None, [self.caption()]), "\n\n".join(map(_aligned, blocks)), *self.notes()])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        head = '<th style="text-align:left">method</th>'
        for column in (COLUMNS[name] for name in self.columns):
            title = f'title="{escape(column.about)}"'
            head += f'<th style="text-align:right" {title}>{escape(column.heading)}</th>'
        body = ""
        for row in self.rows:
            shade = ' style="opacity:0.65"' if row.method == REAL else ""
            cells = "".join(self._html_cell(row, name) for name in self.columns)
            body += f'<tr{shade}><td style="text-align:left">{escape(row.method)}</td>{cells}</tr>'
        notes = "".join(f"<br>{escape(note)}" for note in self.notes())
        foot = f'<p style="font-size:smaller">{escape(self.caption())}{notes}</p>'
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{foot}"

    def _html_cell(self, row: Row, name: str) -> str:
        """A cell, bold where it prints as the best of its column does."""
        column, cell, best = COLUMNS[name], row.cell(name), self.best(name)
        value, spread = column.value(cell), column.spread(cell).strip()
        if best and row.method != REAL and not cell.missing and value == column.value(self[best].cell(name)):
            value = f"<b>{value}</b>"
        small = f'<br><span style="opacity:0.6;font-size:smaller">{spread}</span>' if spread else ""
        return f'<td style="text-align:right;white-space:nowrap">{value}{"*" if cell.missing else ""}{small}</td>'


def _aligned(block: Sequence[Sequence[str]]) -> str:
    """Columns of texts as lines."""
    widths = [max(map(len, texts)) for texts in block]
    return "\n".join("  ".join(f"{t:<{w}}" for t, w in zip(line, widths)).rstrip() for line in zip(*block))
