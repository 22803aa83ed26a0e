"""An arena's table as a picture: a panel for each figure, in it a dot and an interval for each method."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ..arena.entrants import REAL
from ..arena.scoring import COLUMNS, Cell
from ..arena.table import ARROWS
from ..errors import MotionKitError
from . import colours
from .plots import INK, SOFT, Print, style_axes

if TYPE_CHECKING:
    from ..arena import ArenaTable

_ACROSS = 4  # panels in a row
_GOOD = {"down": "less is better", "up": "more is better", "one": "1 is like the content"}


def plot_arena(table: ArenaTable, *columns: str) -> Print:
    """The table of `mk.arena.run`, drawn: for each figure a panel, for each method a dot on the line of its interval.

    columns: which figures; all of the table's, if left out. The test clips themselves are a dashed line. A hollow dot
    is a figure that some results do not have; a method without any has a dash. Returns the matplotlib Figure. Raises
    MotionKitError for anything but a table, and for figures that there are not.

    >>> import motionkit as mk
    >>> rows = [{"method": m, "transfers": 9, "cra": c, "sra": s} for m, c, s in (("a", 90.0, 20.0), ("b", 60.0, 70.0))]
    >>> picture = plot_arena(mk.arena.ArenaTable.from_records(rows))
    """
    if not hasattr(table, "rows") or not hasattr(table, "only"):
        raise MotionKitError(f"plot_arena draws the table of mk.arena.run(...); found a {type(table).__name__}")
    table = table.only(*columns) if columns else table
    methods = sum(row.method != REAL for row in table.rows)
    across = min(_ACROSS, len(table.columns))
    down = -(-len(table.columns) // across)
    size = (1.1 + 2.3 * across, down * (0.75 + 0.28 * max(methods, 2)))
    picture = Print(figsize=size, dpi=110, layout="constrained")
    panels = list(picture.subplots(down, across, squeeze=False, sharey=True).flat)
    for ax, column in zip(panels, table.columns):
        _panel(ax, column, {row.method: row.cell(column) for row in table.rows})
    for ax in panels[len(table.columns) :]:
        ax.set_visible(False)
    if table.caption():
        real = "; dashed: the test clips" if any(row.method == REAL for row in table.rows) else ""
        picture.supxlabel(table.caption() + real, fontsize=7.5, color=SOFT, x=0.01, ha="left")
    return picture


def _panel(ax: object, column: str, cells: dict[str, Cell]) -> None:
    """One figure, of all methods."""
    about, real = COLUMNS[column], cells.pop(REAL, Cell(math.nan)).value
    if real == real:
        ax.axvline(real, color=SOFT, lw=1.2, ls=(0, (4, 3)), zorder=1)
    for y, (cell, colour) in enumerate(zip(cells.values(), _cycle())):
        _draw(ax, y, cell, colour)
    ax.set_title(f"{about.title} {ARROWS[about.better]}", fontsize=9.5, loc="left", color=INK)
    ax.set_yticks(range(len(cells)), list(cells))
    ax.set_ylim(len(cells) - 0.4, -0.6)
    _limits(ax, [*cells.values(), Cell(real)])
    style_axes(ax)
    ax.grid(visible=False, axis="y")
    ax.tick_params(labelsize=8, length=0)
    ax.set_xlabel(_GOOD[about.better], fontsize=7.5, color=SOFT)


def _cycle() -> list[str]:
    return list(colours.CYCLE) * 20


def _draw(ax: object, y: int, cell: Cell, colour: str) -> None:
    if cell.value != cell.value:
        place = {"transform": ax.get_yaxis_transform(), "ha": "left", "va": "center"}
        ax.text(0.02, y, "–", color=SOFT, fontsize=11, **place)
        return
    if cell.low == cell.low:
        ax.plot([cell.low, cell.high], [y, y], color=colour, lw=3.5, alpha=0.55, solid_capstyle="round", zorder=2)
    face = "white" if cell.missing else colour
    ax.plot(cell.value, y, "o", ms=7.5, mfc=face, mec=colours.mix(colour, "#10202c", 0.35), mew=1.1, zorder=3)


def _limits(ax: object, cells: list[Cell]) -> None:
    """Room on both sides; from 0 where the figures are not far from it."""
    seen = [x for c in cells for x in (c.value, c.low, c.high) if x == x]
    low, high = (min(seen), max(seen)) if seen else (0.0, 1.0)
    low = 0.0 if 0 <= low < 0.5 * high else low
    room = 0.06 * (high - low or 1.0)
    ax.set_xlim(low - room, high + room)
