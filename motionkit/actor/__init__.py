"""The performer: makes motion of which everything is known, in any style, on any way.

>>> walk = perform("walk", "tired", seed=1, seconds=4)
>>> walk.motion
Motion('walk_tired_1', 120 frames at 30 fps, 4.0 s, 22 joints)
"""

from __future__ import annotations

from .bodies import Performer
from .performing import Performance, perform, retell
from .score import CONTENTS
from .style import HELD_OUT_STYLES, TRAIN_STYLES, Style, get_style, mix, parameters

VERSION = 1  # raised when what is performed changes: caches and kept results go by it

__all__ = [
    "CONTENTS",
    "TRAIN_STYLES",
    "HELD_OUT_STYLES",
    "VERSION",
    "Performance",
    "Performer",
    "Style",
    "mix",
    "parameters",
    "perform",
    "retell",
    "get_style",
]
