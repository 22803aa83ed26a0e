"""Tables of labels: plain text where they are printed, HTML where a notebook shows them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .dataset import Dataset

_SHOWN = 40  # lines; the others are in `rows`


@dataclass(frozen=True)
class Table:
    """Rows under a header; `rows` has all of them, printing shows the first 40.

    >>> print(Table(("content", "old", "proud"), (("walk", 3, 12), ("jump", 0, 4))))
    content  old  proud
    walk       3     12
    jump       0      4
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str | int, ...], ...]

    @property
    def _more(self) -> str:
        hidden = len(self.rows) - _SHOWN
        return f"... and {hidden} more lines in .rows" if hidden > 0 else ""

    def __str__(self) -> str:
        shown = (self.header, *self.rows[:_SHOWN])
        widths = [max(len(str(row[n])) for row in shown) for n in range(len(self.header))]
        right = [bool(self.rows) and all(isinstance(row[n], int) for row in self.rows) for n in range(len(widths))]
        lines = (
            "  ".join(f"{str(x):>{w}}" if r else f"{str(x):<{w}}" for x, w, r in zip(row, widths, right)).rstrip()
            for row in shown
        )
        return "\n".join([*lines, *filter(None, [self._more])])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{escape(str(x))}</th>" for x in self.header)
        body = "".join(
            "<tr>" + "".join(f'<td style="text-align:{_side(x)}">{escape(str(x))}</td>' for x in row) + "</tr>"
            for row in self.rows[:_SHOWN]
        )
        more = f"<p>{escape(self._more)}</p>" if self._more else ""
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def _side(value: str | int) -> str:
    return "right" if isinstance(value, int) else "left"


def count_table(dataset: Dataset) -> Table:
    """Clips of each content and style; the more numerous kind of label goes down the page, if it is a long one."""
    down, across = ("content", dataset.contents), ("style", dataset.styles)
    if len(across[1]) > max(len(down[1]), 12):
        down, across = across, down
    counts = Counter(
        (getattr(dataset.labels[n], down[0]), getattr(dataset.labels[n], across[0])) for n in dataset.numbers
    )
    rows = [(d, *(counts[d, a] for a in across[1])) for d in down[1]]
    rows = [(*row, sum(row[1:])) for row in rows]
    sums = tuple(sum(column) for column in list(zip(*rows))[1:]) if rows else (0,)
    return Table((f"{down[0]} \\ {across[0]}", *across[1], "all"), (*rows, ("all", *sums)))


def caption_table(dataset: Dataset) -> Table:
    """Every sentence of every clip."""
    rows = (
        (dataset.store.clips[n].name, label.content, label.style, text)
        for n, label in ((n, dataset.labels[n]) for n in dataset.numbers)
        for text in label.texts
    )
    return Table(("clip", "content", "style", "text"), tuple(rows))
