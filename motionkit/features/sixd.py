"""Paper 5's layout: 6D rotations and the root's translation, for any skeleton."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import rotations as rot
from ..motion import Motion
from .canonical import motion_from_local
from .layout import Layout, Row


class SixD(Layout):
    """6D rotations 6J, local to the parent, and the root's translation in the world (paper 5, section 3); 6J + 3.

    The layout keeps where the clip stands and faces, so that decoding gives the motion back where it was. The root
    joint is the skeleton's pelvis; helper joints above it are taken to stand at the origin.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> layout = SixD()
    >>> x = layout.encode(walk)
    >>> x.shape, layout.positions(x).allclose(walk.positions(), atol=1e-3)
    (torch.Size([120, 135]), True)
    """

    components = {
        "rotations": ("column 1 x", "column 1 y", "column 1 z", "column 2 x", "column 2 y", "column 2 z"),
        "translation": ("x", "y", "z"),
    }
    units = {"rotations": ("",), "translation": ("m",)}

    @property
    def joints(self) -> dict[str, list[int]]:
        return {"rotations": list(range(len(self.skeleton))), "translation": []}

    def rows(self) -> list[Row]:
        return self._lay_out(("rotations", "6D, relative to the parent"), ("translation", "the root in the world"))

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to features [F, 6J + 3]; MotionKitError if its skeleton or frame rate is another."""
        motion = self._take(motion)
        sixd = rot.quaternion_to_sixd(motion.rotations).flatten(1)
        return torch.cat((sixd, motion.positions()[:, self.skeleton.pelvis]), -1)

    def decode(self, x: Tensor) -> Motion:
        """Features [F, 6J + 3] to a motion in the world; bones keep the skeleton's lengths."""
        x = self._check(x)
        local = rot.sixd_to_quaternion(x[:, self.slices["rotations"]].unflatten(1, (-1, 6)))
        pelvis = x[:, self.slices["translation"]]
        helpers = torch.zeros(len(x), len(self.skeleton), 3, dtype=x.dtype)
        return motion_from_local(self.skeleton, rot.quaternion_unroll(local), pelvis, helpers, self.fps)

    def positions(self, x: Tensor) -> Tensor:
        """Features [F, 6J + 3] to joint places [F, J, 3], by forward kinematics: this layout stores none."""
        return self.decode(x).positions()
