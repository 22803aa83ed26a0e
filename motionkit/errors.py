"""The one error class of the kit."""

from __future__ import annotations


class MotionKitError(ValueError):
    """Anything that a user can put right: bad files, bad arguments, data that do not fit together.

    The message says where (file and line, or joint), what was expected, what was found, and what to do next.

    >>> raise MotionKitError("walk.bvh, line 3: ...")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: walk.bvh, line 3: ...
    """
