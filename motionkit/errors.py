"""The one error class of the kit, and the checks of arguments that raise it."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Collection, Sequence


class MotionKitError(ValueError):
    """Anything that a user can put right: bad files, bad arguments, data that do not fit together.

    The message says where (file and line, or joint), what was expected, what was found, and what to do next.

    >>> raise MotionKitError("walk.bvh, line 3: ...")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: walk.bvh, line 3: ...
    """


class check:
    """Four checks of arguments; each returns what fits and raises a MotionKitError for what does not."""

    @staticmethod
    def number(
        what: str, value: object, low: float = -math.inf, high: float = math.inf, *, whole: bool = False, hint: str = ""
    ) -> float:
        """A finite number from `low` to `high`, both included. whole: no fraction either. hint: what to do next.

        >>> check.number("seconds", "long", 0.1)
        Traceback (most recent call last):
        ...
        motionkit.errors.MotionKitError: seconds: expected a number of at least 0.1; found 'long'
        """
        kind = int if whole else int | float
        if isinstance(value, kind) and not isinstance(value, bool) and math.isfinite(value) and low <= value <= high:
            return value
        bounds = [f" of at least {low:g}"] * (low > -math.inf) + [f" of at most {high:g}"] * (high < math.inf)
        if len(bounds) == 2:
            bounds = [f" from {low:g} to {high:g}"]
        noun = "whole number" if whole else "number"
        raise MotionKitError(f"{what}: expected a {noun}{''.join(bounds)}; found {value!r}{hint}")

    @staticmethod
    def one_of(what: str, value: object, known: Collection[str], *, owner: str = "", hint: str = "") -> str:
        """One of the known names. The message begins with the `owner`, who has them, and names the nearest.

        >>> check.one_of("style", "tird", ["tired", "old"])
        Traceback (most recent call last):
        ...
        motionkit.errors.MotionKitError: no style 'tird'; did you mean 'tired'? There are tired, old
        """
        if isinstance(value, str) and value in known:
            return value
        near = difflib.get_close_matches(str(value), list(known), 1, 0.4)
        nearest = f"did you mean {near[0]!r}? " if near else ""
        raise MotionKitError(f"{owner}no {what} {value!r}; {nearest}There are {', '.join(known)}{hint}")

    @staticmethod
    def motion(where: str, value: object, frames: int = 0) -> object:
        """A `Motion` with at least so many frames.

        >>> check.motion("jitter", "walk.bvh")
        Traceback (most recent call last):
        ...
        motionkit.errors.MotionKitError: jitter: expected a Motion; found 'walk.bvh'; load it with mk.load
        """
        if not all(hasattr(value, part) for part in ("skeleton", "rotations", "translations", "fps")):
            if isinstance(value, str | os.PathLike):
                raise MotionKitError(f"{where}: expected a Motion; found {os.fspath(value)!r}; load it with mk.load")
            raise MotionKitError(f"{where}: expected a Motion; found a {type(value).__name__}{motion_inside(value)}")
        if len(value) < frames:
            raise MotionKitError(f"{where}: {value!r} has {len(value)} frames; at least {frames} are needed")
        return value

    @staticmethod
    def shape(what: str, value: object, shape: Sequence[int | str], *, hint: str = "") -> object:
        """A tensor (or array) of a shape: numbers must agree, letters stand for any length.

        >>> import torch
        >>> check.shape("positions", torch.zeros(8, 3), ("F", 22, 3))
        Traceback (most recent call last):
        ...
        motionkit.errors.MotionKitError: expected positions [F, 22, 3]; found [8, 3]
        """
        sizes = list(getattr(value, "shape", ()))
        alike = len(sizes) == len(shape) and all(isinstance(s, str) or s == n for s, n in zip(shape, sizes))
        if alike and hasattr(value, "shape"):
            return value
        found = sizes if hasattr(value, "shape") else f"a {type(value).__name__}"
        raise MotionKitError(f"expected {what} [{', '.join(map(str, shape))}]; found {found}{hint}")


def motion_inside(value: object) -> str:
    """For messages about something that is no Motion but holds one, such as a clip: where it is; else nothing.

    >>> from types import SimpleNamespace
    >>> motion_inside(SimpleNamespace(motion=1)), motion_inside("walk.bvh")
    ('; it holds one: give its .motion', '')
    """
    return "; it holds one: give its .motion" if hasattr(value, "motion") else ""
