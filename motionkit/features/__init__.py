"""The papers' feature layouts: each turns a `Motion` into rows of numbers and back.

| layout | paper | numbers a frame |
| --- | --- | --- |
| `FacingFree` | 1 | root 4, positions 3(J-1), 6D rotations 6J |
| `HumanML3D` | 4, and most text-to-motion work | 12J - 1 (263 for 22 joints) |
| `StyleERD` | 2 | quaternions 4J, positions 3J, velocities 3J |
| `Graph` | 3 | [F, J, 7]: position and quaternion of each joint |
| `SixD` | 5 | 6D rotations 6J, translation 3 |

Print `layout.table()` for what every number means, `layout.describe(n)` for one of them.

>>> import motionkit as mk
>>> layout = mk.features.HumanML3D()
>>> print(layout.describe(7))
positions x of right_hip (m)
"""

from __future__ import annotations

from .canonical import motion_from_positions
from .facing_free import FacingFree
from .graph import Graph
from .humanml3d import HumanML3D
from .layout import Layout, Normalizer, Row
from .sixd import SixD
from .style_erd import StyleERD

__all__ = [
    "FacingFree",
    "Graph",
    "HumanML3D",
    "Layout",
    "Normalizer",
    "Row",
    "SixD",
    "StyleERD",
    "motion_from_positions",
]
