"""Who takes part: methods by name, methods as objects, and functions of a user, all asked in one way."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .. import methods as kit
from ..datasets import Clip, Dataset
from ..errors import MotionKitError, motion_inside
from ..motion import Motion
from .fingerprints import fingerprint

REAL = "real"  # the row of the test clips themselves


@dataclass(frozen=True)
class Entrant:
    """A method under the name that its row has. key: changes when the method does, see `fingerprint`."""

    name: str
    method: object
    key: str

    def ready(self, train: Dataset) -> object:
        """The method, or where it learns from clips, a copy that has learned from these."""
        if not hasattr(self.method, "fit"):
            return self.method
        try:
            own = copy.deepcopy(self.method)
        except Exception:  # something in it cannot be copied: then it is taught itself
            own = self.method
        fitted = own.fit(train)
        return own if fitted is None else fitted


def restyle(method: object, content: Clip, style: Clip) -> object:
    """What a method makes of two clips: `transfer` sees their labels, `stylize` and plain functions the motions.

    >>> from types import SimpleNamespace
    >>> restyle(lambda content, style: f"{content} as {style}", *(SimpleNamespace(motion=m) for m in ("walk", "old")))
    'walk as old'
    """
    if hasattr(method, "transfer"):
        return method.transfer(content, style)
    if hasattr(method, "stylize"):
        return method.stylize(content.motion, style=style.motion)
    return method(content.motion, style.motion)


def problem_of(result: object, content: Motion) -> str:
    """What is wrong with a method's result; empty where it can be judged.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> problem_of(walk, walk), problem_of(None, walk)
    ('', 'gives a NoneType instead of a Motion')
    """
    if not isinstance(result, Motion):
        return f"gives a {type(result).__name__} instead of a Motion{motion_inside(result)}"
    if not result.skeleton.same_tree(content.skeleton):
        return f"gives another skeleton: {result.skeleton!r} instead of the content's {content.skeleton!r}"
    if not len(result):
        return "gives a motion of no frames"
    if not (result.rotations.isfinite().all() and result.translations.isfinite().all()):
        return "gives numbers that are not finite"
    if float((result.rotations.norm(dim=-1) - 1).abs().max()) > 1e-2:
        return "gives rotations that are no unit quaternions"
    if abs(result.fps - content.fps) > 1e-3 * content.fps:
        return f"gives {result.fps:g} frames a second instead of the content's {content.fps:g}; resample the result"
    return ""


def entrants_of(methods: object) -> list[Entrant]:
    """The entrants that a user named: a name, object or function, a list of such, or a dict from row name to such.

    Raises MotionKitError where a thing is no method, or two rows have one name.

    >>> [entrant.name for entrant in entrants_of(["statistics", print])]
    ['statistics', 'print']
    """
    if isinstance(methods, Mapping):
        pairs = list(methods.items())
    else:
        several = isinstance(methods, Sequence | set) and not isinstance(methods, str)
        pairs = [(None, method) for method in (methods if several else [methods])]
    if not pairs:
        raise MotionKitError("the arena needs methods: names such as 'statistics', or {'mine': my_function}")
    found = [_entrant(name, method) for name, method in pairs]
    names = [entrant.name for entrant in found]
    for name in names:
        if name == REAL or names.count(name) > 1:
            why = "is the row of the test clips" if name == REAL else "appears twice"
            raise MotionKitError(f"method name {name!r} {why}; give each a name of its own: {{'mine': method}}")
    return found


def _entrant(name: object, given: object) -> Entrant:
    method = kit.load(given) if isinstance(given, str) else given
    asked = any(callable(getattr(method, way, None)) for way in ("transfer", "stylize"))
    if isinstance(method, type) or not (asked or callable(method)):
        hint = f"; make one: {method.__name__}()" if isinstance(method, type) else ""
        raise MotionKitError(
            f"{given!r} is no method{hint}. Give a name ({', '.join(kit.names())}), an object with "
            "stylize(content, style) or a function (content, style) -> Motion"
        )
    name = name or (given if isinstance(given, str) else _name_of(method))
    if not isinstance(name, str):
        raise MotionKitError(f"methods are named by strings, {{'mine': my_function}}; found {name!r}")
    return Entrant(name, method, fingerprint(method))


def _name_of(method: object) -> str:
    return getattr(method, "name", None) or getattr(method, "__name__", None) or type(method).__name__
