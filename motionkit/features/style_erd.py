"""Paper 2's layout: quaternions, positions and velocities, one row a joint, for a network that runs frame by frame."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import rotations as rot
from ..motion import Motion
from .canonical import forward_difference, integrate, motion_from_local
from .layout import Layout, Row


class StyleERD(Layout):
    """Unit quaternions 4J, positions 3J and velocities 3J (paper 2, section 3.1); 10J numbers a frame.

    The clip is first moved so that it starts above the origin, facing +Z; after that all directions are the world's,
    so that a frame can be encoded without seeing the next ones. Quaternions are local to the parent. Positions are
    offset by the root: relative to its place on the ground, so that y is the height and the root's own row keeps it.
    Velocities are those of the joints in the world, from this frame to the next, per frame.

    >>> import motionkit as mk
    >>> layout = StyleERD()
    >>> layout.encode(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 220])
    """

    components = {"rotations": ("w", "x", "y", "z"), "positions": ("x", "y", "z"), "velocities": ("x", "y", "z")}
    units = {"rotations": ("",), "positions": ("m",), "velocities": ("m/frame",)}

    @property
    def joints(self) -> dict[str, list[int]]:
        every = list(range(len(self.skeleton)))
        return {name: every for name in self.components}

    def rows(self) -> list[Row]:
        return self._lay_out(
            ("rotations", "unit quaternion w x y z, relative to the parent"),
            ("positions", "joint relative to the root's place on the ground"),
            ("velocities", "joint in the world, to the next frame"),
        )

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to features [F, 10J]; MotionKitError if its skeleton or frame rate is another."""
        motion = self._take(motion).at_origin()
        places = motion.positions()
        ground = places[:, self.skeleton.pelvis] * places.new_tensor([1.0, 0.0, 1.0])
        parts = (rot.quaternion_unroll(motion.rotations), places - ground[:, None], forward_difference(places))
        return torch.cat([p.flatten(1) for p in parts], -1)

    def _read(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Positions in the world [F, J, 3], and the pelvis among them [F, 3]."""
        local = x[:, self.slices["positions"]].unflatten(1, (-1, 3))
        velocity = x[:, self.slices["velocities"]].unflatten(1, (-1, 3))[:, self.skeleton.pelvis]
        ground = integrate(velocity) * x.new_tensor([1.0, 0.0, 1.0])
        places = local + ground[:, None]
        return places, places[:, self.skeleton.pelvis]

    def positions(self, x: Tensor) -> Tensor:
        """Features [F, 10J] to joint places [F, J, 3]; the root's path is its velocity, summed."""
        return self._read(self._check(x))[0]

    def decode(self, x: Tensor) -> Motion:
        """Features [F, 10J] to a motion from the quaternions; bones keep the skeleton's lengths."""
        x = self._check(x)
        places, pelvis = self._read(x)
        local = rot.normalize(x[:, self.slices["rotations"]].unflatten(1, (-1, 4)))
        return motion_from_local(self.skeleton, local, pelvis, places, self.fps)


SETTLE = 0.3  # how much of the way to where its feet stand a body rises or falls in a frame, beside its velocity


TENTH = 10.0  # velocities are in metres a tenth of a second: of about the size of positions
