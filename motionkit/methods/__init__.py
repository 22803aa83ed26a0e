"""Methods that restyle a motion, all behind `stylize(content, style) -> Motion`.

>>> import motionkit as mk
>>> mk.methods.names()
['statistics']
"""

from __future__ import annotations

import difflib
import importlib

from ..errors import MotionKitError

_METHODS = {"statistics": ("statistics", "Statistics")}


def names() -> list[str]:
    """The methods that `load` knows."""
    return sorted(_METHODS)


def load(name: str):
    """A method by name, ready to use; MotionKitError names the nearest ones if there is none of that name.

    >>> load("statistics").name
    'statistics'
    """
    if name not in _METHODS:
        near = difflib.get_close_matches(str(name), _METHODS, 1, 0.3)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise MotionKitError(f"no method {name!r}{hint or '.'} Known: {', '.join(names())}")
    module, cls = _METHODS[name]
    return getattr(importlib.import_module(f".{module}", __name__), cls)()
