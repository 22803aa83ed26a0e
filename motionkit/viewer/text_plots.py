"""Pictures of meaning: how near sentences are to one another, and motions to sentences."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..errors import MotionKitError
from .plots import INK, SOFT, Print

_WRITTEN = 14  # rows and columns up to which numbers are written into the cells


def plot_similarity(
    near: Tensor,
    rows: Sequence[str],
    columns: Sequence[str] | None = None,
    *,
    title: str = "",
    marks: Sequence[tuple[int, int]] = (),
) -> Print:
    """A table of cosines as shades: white for 0 and below, dark blue for 1.

    near: [N, M], as `mk.text.similarity` gives. rows, columns: N and M texts; columns are the rows if left out. marks:
    cells (row, column) with a frame around them, such as the right answers. Small tables have their numbers in them.
    Returns the matplotlib Figure. Raises MotionKitError where there are not as many texts as rows or columns.

    >>> import torch
    >>> picture = plot_similarity(torch.eye(2), ["a person walks", "a person kicks"])
    >>> [text.get_text() for text in picture.axes[0].texts]
    ['1.00', '0.00', '0.00', '1.00']
    """
    columns = rows if columns is None else columns
    if near.ndim != 2 or tuple(near.shape) != (len(rows), len(columns)):
        raise MotionKitError(
            f"plot_similarity: expected a table [{len(rows)}, {len(columns)}], a text for each row and column; found "
            f"{list(near.shape)}"
        )
    small = max(near.shape) <= _WRITTEN
    picture = Print(figsize=_size(rows, columns, small), dpi=105, layout="constrained")
    ax = picture.add_subplot()
    ax.imshow(near.detach().cpu().numpy(), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    _name(ax, rows, columns, small)
    ax.set_title(title, fontsize=10, color=SOFT, loc="left")
    if small:
        _write(ax, near)
    for row, column in marks:
        ax.add_patch(_frame(row, column))
    return picture


def _size(rows: Sequence[str], columns: Sequence[str], small: bool) -> tuple[float, float]:
    """Of the picture, inches: room for the cells, and for the longest texts beside and under them."""
    cell, beside, under = (0.46, 0.085, 0.05) if small else (0.2, 0.065, 0.065)
    wide = cell * len(columns) + beside * max(map(len, rows)) + 0.4
    return wide, 0.85 * cell * len(rows) + under * max(map(len, columns)) + 0.5


def _name(ax: object, rows: Sequence[str], columns: Sequence[str], small: bool) -> None:
    slant = {"rotation": 35 if small else 90, "ha": "right", "va": "top" if small else "center"}
    letters = {"fontsize": 8.5 if small else 6.5, "color": INK}
    ax.set_yticks(range(len(rows)), rows, **letters)
    ax.set_xticks(range(len(columns)), columns, rotation_mode="anchor", **slant, **letters)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)


def _write(ax: object, near: Tensor) -> None:
    for row, values in enumerate(near.tolist()):
        for column, value in enumerate(values):
            ink = "white" if value > 0.6 else INK
            ax.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8, color=ink)


def _frame(row: int, column: int) -> object:
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, edgecolor="#d3622b", linewidth=1.2)
