"""The two ends of every table: the content as it is, with none of the style, and the style clip, with all of it."""

from __future__ import annotations

import torch

from ..errors import MotionKitError, motion_inside
from ..motion import Motion
from ..restyling import body_of, check_clips, named, on_body, placed


class CopyContent:
    """Returns the content: nothing of it is lost, and no style is there. Any method should beat it in style.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> mk.methods.load("copy-content").stylize(walk, style="old")
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "copy-content"

    def stylize(self, content: Motion, style: object) -> Motion:
        """The content clip under a new name. style: anything, it is not looked at. MotionKitError for no Motion."""
        if not isinstance(content, Motion):
            hint = motion_inside(content)
            raise MotionKitError(f"the content must be a Motion, such as mk.load('walk.bvh'); found {content!r}{hint}")
        return content.replace(name=named(content, style))


class CopyStyle:
    """Returns the style clip, on the content's skeleton: all of the style, and what is done is the style clip's.

    Any method should beat it in content.

    >>> import motionkit as mk
    >>> walk, old = (mk.load(f"data/actor/walk_{s}.bvh") for s in ("neutral", "old"))
    >>> mk.methods.load("copy-style").stylize(walk, style=old)
    Motion('walk_neutral as walk_old', 161 frames at 30 fps, 5.4 s, 22 joints)
    """

    name = "copy-style"

    def stylize(self, content: Motion, style: Motion) -> Motion:
        """The style clip with as many frames as it has itself, at the content's rate and on its skeleton.

        It starts where the content starts, facing the same way. Raises MotionKitError for what is no Motion, or a body
        that cannot do what the style's does.
        """
        check_clips(self.name, content, style)
        body = body_of(content)
        copied = placed(on_body(body_of(style.resample(content.fps)), body), body)
        around = content.at(torch.arange(len(copied)))  # helper joints above the pelvis, as the content has them
        return around.with_body(copied).replace(name=named(content, style))
