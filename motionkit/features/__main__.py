"""What every number of every layout means, as Markdown: `python -m motionkit.features > docs/features.md`."""

from __future__ import annotations

import inspect

from .facing_free import FacingFree
from .graph import Graph
from .humanml3d import HumanML3D
from .layout import Layout
from .sixd import SixD
from .style_erd import StyleERD

LAYOUTS = {FacingFree: "paper 1", StyleERD: "paper 2", Graph: "paper 3", HumanML3D: "paper 4", SixD: "paper 5"}

_HEAD = """# What the numbers mean

Every layout of `mk.features`, number by number, for SMPL's 22 joints. A layout for another skeleton prints its own
table: `layout.table()`, and `layout.describe(n)` for one number. Numbers count from 0; `4-6` are 4, 5 and 6.
Directions seen from the body: x to its left, y up, z ahead. 6D rotations are the first two columns of the matrix,
column 1 first. Speeds are per frame, not per second.

Made by `python -m motionkit.features > docs/features.md`; a test holds it to the code.
"""


def markdown() -> str:
    """The whole document.

    >>> markdown().splitlines()[0]
    '# What the numbers mean'
    """
    return "\n".join([_HEAD, *(_section(make(), paper) for make, paper in LAYOUTS.items())])


def _section(layout: Layout, paper: str) -> str:
    rows = layout.rows()
    notes = inspect.getdoc(type(layout)).split(">>>")[0].strip()
    lines = [
        f"## {type(layout).__name__}: {layout.size} numbers a frame ({paper})",
        "",
        notes,
        "",
    ]
    lines += _table(
        ("numbers", "part", "for each joint", "unit", "meaning"),
        [(_span(r.start, r.stop), r.name, ", ".join(layout.components[r.name]), r.unit, r.meaning) for r in rows],
    )
    per_joint = [r for r in rows if layout.joints[r.name]]
    everywhere = [j for j in layout.order if any(j in layout.joints[r.name] for r in per_joint)]
    found = [(layout.skeleton.names[j], *(_where(layout, r, j) for r in per_joint)) for j in everywhere]
    return "\n".join([*lines, "", *_table(("joint", *(r.name for r in per_joint)), found), ""])


def _where(layout: Layout, row, joint: int) -> str:
    """The numbers of one joint in one part of the layout; empty where it has none."""
    joints, wide = layout.joints[row.name], len(layout.components[row.name])
    if joint not in joints:
        return ""
    start = row.start + wide * joints.index(joint)
    return _span(start, start + wide)


def _span(start: int, stop: int) -> str:
    return f"{start}-{stop - 1}" if stop - start > 1 else str(start)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (head, ("---",) * len(head), *rows)]


if __name__ == "__main__":
    print(markdown(), end="")
