"""The one error class of the kit."""

from __future__ import annotations


def motion_inside(found: object) -> str:
    """For messages about something that is no Motion but holds one, such as a clip: where it is; else nothing.

    >>> from types import SimpleNamespace
    >>> motion_inside(SimpleNamespace(motion=1)), motion_inside("walk.bvh")
    ('; it holds one: give its .motion', '')
    """
    return "; it holds one: give its .motion" if hasattr(found, "motion") else ""


class MotionKitError(ValueError):
    """Anything that a user can put right: bad files, bad arguments, data that do not fit together.

    The message says where (file and line, or joint), what was expected, what was found, and what to do next.

    >>> raise MotionKitError("walk.bvh, line 3: ...")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: walk.bvh, line 3: ...
    """
