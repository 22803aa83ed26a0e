"""The performer: makes motion of which everything is known, in any style, on any way.

>>> walk = perform("walk", "tired", seed=1, seconds=4)
>>> walk.motion
Motion('walk_tired_1', 120 frames at 30 fps, 4.0 s, 22 joints)
"""

from .body import Performer
from .performing import Performance, perform, retell
from .presets import SEEN, UNSEEN, style_named
from .score import CONTENTS
from .style import Style, mix, parameters

__all__ = [
    "CONTENTS",
    "SEEN",
    "UNSEEN",
    "Performance",
    "Performer",
    "Style",
    "mix",
    "parameters",
    "perform",
    "retell",
    "style_named",
]
