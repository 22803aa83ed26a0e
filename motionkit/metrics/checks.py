"""What every metric asks of what it is given, so that a wrong type or an empty clip is an error and never a score."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from ..errors import MotionKitError, motion_inside
from ..motion import Motion

_LEAST = {1: "one is", 2: "two are", 4: "four are"}


def needs_motion(where: str, found: object, frames: int = 1) -> Motion:
    """`found`, if it is a Motion with at least `frames` frames; else a MotionKitError that says what it is instead.

    >>> needs_motion("jitter", "walk.bvh")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: jitter: expected a Motion; found 'walk.bvh'; load it with mk.load
    """
    if not isinstance(found, Motion):
        if isinstance(found, str | Path):
            raise MotionKitError(f"{where}: expected a Motion; found {str(found)!r}; load it with mk.load")
        hint = motion_inside(found)
        raise MotionKitError(f"{where}: expected a Motion; found a {type(found).__name__}{hint}")
    if len(found) < frames:
        raise MotionKitError(f"{where}: {found!r} has {len(found)} frames; {_LEAST[frames]} the least")
    return found


def needs_tensor(where: str, expected: str, found: object) -> Tensor:
    """`found`, if it is a tensor; else a MotionKitError that says what was `expected`, such as "scores [N, C]".

    >>> needs_tensor("bands", "curves", [1.0])
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: bands: expected curves as a torch tensor; found a list; use torch.as_tensor(...)
    """
    if not isinstance(found, Tensor):
        hint = "; use torch.as_tensor(...)" if hasattr(found, "__len__") and not isinstance(found, str) else ""
        raise MotionKitError(f"{where}: expected {expected} as a torch tensor; found a {type(found).__name__}{hint}")
    return found


def needs_finite(where: str, what: str, found: Tensor) -> Tensor:
    """A tensor whose numbers are all finite; else a MotionKitError that counts the rows that are not.

    >>> needs_finite("fmd", "a", torch.tensor([[0.0], [torch.nan]]))
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: fmd: 1 of 2 rows of a are not finite; find those motions
    """
    bad = int((~torch.isfinite(found)).reshape(len(found), -1).any(1).sum()) if len(found) else 0
    if bad:
        raise MotionKitError(f"{where}: {bad} of {len(found)} rows of {what} are not finite; find those motions")
    return found
