"""The table of an arena: printed as text, shown as HTML in a notebook, kept as JSON."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path

from ..errors import MotionKitError
from ..files import read_bytes, write_atomic
from .entrants import REAL
from .scoring import COLUMNS, Cell
from .views import Results

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
