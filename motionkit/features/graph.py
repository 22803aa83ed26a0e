"""Paper 3's layout: a graph of joints, each with a position and a quaternion in the frame of the root on the ground."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import kinematics
from .. import rotations as rot
from ..errors import MotionKitError
from ..motion import Motion
from .canonical import canonicalize, motion_from_local, uncanonicalize
from .layout import Layout, Row


class Graph(Layout):
    """[F, J, 7]: position and unit quaternion of each joint, both relative to the root projected on the ground
    (paper 3, section 4). Here rotations are not local to the parent.

    The path is no part of it: the paper takes it from the source motion. `trajectory(motion)` reads it, [F, 3] with
    yaw, x and z, and `decode(x, trajectory)` puts it back; without one the character stays in place.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> layout = Graph()
    >>> x = layout.encode(walk)
    >>> x.shape, layout.decode(x, layout.trajectory(walk)).positions().allclose(walk.positions(), atol=1e-3)
    (torch.Size([120, 22, 7]), True)
    """

    components = {"joint": ("x", "y", "z", "quaternion w", "quaternion x", "quaternion y", "quaternion z")}
    units = {"joint": ("m", "m", "m", "", "", "", "")}

    @property
    def joints(self) -> dict[str, list[int]]:
        return {"joint": list(range(len(self.skeleton)))}

    def rows(self) -> list[Row]:
        return self._lay_out(("joint", "position, then unit quaternion w x y z, in the root's ground frame"))

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to a graph [F, J, 7]; MotionKitError if its skeleton or frame rate is another."""
        body = canonicalize(self._take(motion))
        turned = rot.quaternion_multiply(rot.yaw_to_quaternion(-body.yaw)[:, None], body.world)
        return torch.cat((body.local, rot.quaternion_unroll(turned)), -1)

    def trajectory(self, motion: Motion) -> Tensor:
        """The path of the root on the ground, [F, 3]: yaw in radians, x and z in metres."""
        body = canonicalize(motion)
        return torch.stack((body.yaw, body.root[:, 0], body.root[:, 2]), -1)

    def _check(self, x: Tensor) -> Tensor:
        x = torch.as_tensor(x)
        if x.ndim != 3 or x.shape[1:] != (len(self.skeleton), 7):
            raise MotionKitError(f"Graph expects [frames, {len(self.skeleton)}, 7]; found {list(x.shape)}")
        return x

    def positions(self, x: Tensor, trajectory: Tensor | None = None) -> Tensor:
        """A graph [F, J, 7] to joint places [F, J, 3], along `trajectory` [F, 3] or in place."""
        x = self._check(x)
        path = x.new_zeros(len(x), 3) if trajectory is None else trajectory
        return uncanonicalize(x[..., :3], path[:, 0], path[:, 1:])

    def decode(self, x: Tensor, trajectory: Tensor | None = None) -> Motion:
        """A graph [F, J, 7] to a motion from its quaternions, along `trajectory` [F, 3] or in place."""
        places = self.positions(x, trajectory)
        yaw = x.new_zeros(len(x)) if trajectory is None else trajectory[:, 0]
        world = rot.quaternion_multiply(rot.yaw_to_quaternion(yaw)[:, None], rot.normalize(x[..., 3:]))
        local = rot.quaternion_unroll(kinematics.local_rotations(self.skeleton, world))
        return motion_from_local(self.skeleton, local, places[:, self.skeleton.pelvis], places, self.fps)
