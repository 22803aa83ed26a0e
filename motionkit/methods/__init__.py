"""Methods that restyle a motion, all behind `stylize(content, style) -> Motion`.

>>> import motionkit as mk
>>> mk.methods.names()
['copy-content', 'copy-style', 'few-shot', 'knn-dtw', 'linear', 'statistics', 'style-code',
     'style-erd']
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import inspect

from ..errors import MotionKitError
from .base import Example, Labels, StyleTransfer

_METHODS = {
    "copy-content": ("baselines", "CopyContent"),
    "copy-style": ("baselines", "CopyStyle"),
    "few-shot": ("few_shot", "FewShot"),
    "style-code": ("style_code", "StyleCodeTransfer"),
    "knn-dtw": ("baselines", "KnnDtw"),
    "linear": ("baselines", "Linear"),
    "statistics": ("baselines", "Statistics"),
    "style-erd": ("style_erd", "StyleErdTransfer"),
}

__all__ = ["BASELINES", "Example", "Labels", "StyleTransfer", "load", "names"]
BASELINES = ("copy-content", "copy-style", "knn-dtw", "linear", "statistics")  # to be beaten: no network learns in them


def names() -> list[str]:
    """The methods that `load` knows."""
    return sorted(_METHODS)


def load(name: str, **options):
    """A method by name, ready to use. options: what the method's class takes, such as `library=` of `knn-dtw`.

    Raises MotionKitError that names the nearest ones if there is none of that name, and for options it does not take.

    >>> load("statistics").name
    'statistics'
    """
    if not isinstance(name, str):
        hint = "; several are [mk.methods.load(n) for n in names]" if isinstance(name, list | tuple | set) else ""
        raise MotionKitError(f"a method is loaded by its name, one of {', '.join(names())}; found {name!r}{hint}")
    if name not in _METHODS:
        near = difflib.get_close_matches(name, _METHODS, 1, 0.3)
        hint = f"; did you mean {near[0]!r}?" if near else "."
        raise MotionKitError(f"no method {name!r}{hint} Known: {', '.join(names())}")
    module, cls = _METHODS[name]
    method = getattr(importlib.import_module(f".{module}", __name__), cls)
    takes = list(inspect.signature(method).parameters)
    for option in options:
        if option not in takes:
            raise MotionKitError(
                f"method {name!r} has no option {option!r}; it takes {', '.join(takes) or 'none'}. What concerns one "
                "transfer, such as strength, goes to stylize"
            )
    return method(**options)


def __getattr__(name: str):
    """A method's module, such as `mk.methods.few_shot`, imported when first named."""
    if importlib.util.find_spec(f"{__name__}.{name}") is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return importlib.import_module(f".{name}", __name__)
