"""Paper 2's layout: quaternions, positions and velocities, one row a joint, for a network that runs frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .. import rotations as rot
from ..errors import MotionKitError
from ..kinematics import forward_kinematics
from ..motion import Motion, facing_of
from ..skeleton import Skeleton
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


@dataclass(frozen=True, eq=False)
class Frames:
    """A motion as the network sees it, every frame from its own place on the ground and facing.

    rotations: unit quaternions [F, J, 4], local, the root's without the facing. positions: [F, J, 3] metres above the
    root's place on the ground. velocities: [F, J, 3], since the frame before, metres a tenth of a second; 0 in the
    first frame, before which nothing is known. yaw: [F] radians and ground: [F, 2] metres, where each frame stands.
    """

    rotations: Tensor
    positions: Tensor
    velocities: Tensor
    yaw: Tensor
    ground: Tensor

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def x(self) -> Tensor:
        """All that the network is given of a frame (paper 2, section 3.1), [F, 10J]."""
        return torch.cat([part.flatten(1) for part in (self.rotations, self.positions, self.velocities)], 1)


def frames_of(motion: Motion) -> Frames:
    """A motion of F frames, its root the pelvis, as `Frames` (paper 2, section 3.1).

    Unlike the paper's, directions are the facing's and not the world's: one who walks in a circle for an hour looks the
    same all the time. Frame n needs frame n - 1 and no other.

    >>> import motionkit as mk
    >>> frames_of(mk.load("data/actor/walk_neutral.bvh")).x.shape
    torch.Size([120, 220])
    """
    body = motion.without_helper_joints()
    if not len(body):
        raise MotionKitError(f"motion {motion.name!r} has no frames")
    places, world = body.positions(), body.rotations
    yaw = facing_of(body.skeleton, places, world)
    back = rot.yaw_to_quaternion(-yaw)
    ground = places[:, 0] * places.new_tensor([1.0, 0.0, 1.0])
    turned = torch.cat((rot.quaternion_multiply(back, world[:, 0])[:, None], world[:, 1:]), 1)
    turned = turned * torch.where(turned[..., :1] < 0, -1.0, 1.0)  # q and -q are one rotation; the nearer half to rest
    moved = torch.cat((torch.zeros_like(places[:1]), places.diff(dim=0))) * (body.fps / TENTH)
    local, speed = (rot.quaternion_rotate(back[:, None], one) for one in (places - ground[:, None], moved))
    return Frames(turned, local, speed, yaw, ground[:, [0, 2]])


def zero_first_velocity(x: Tensor, joints: int) -> Tensor:
    """Windows of frames [N, F, 10J] as a stream sees them at its start: of the first one no velocity is known.

    >>> zero_first_velocity(torch.ones(1, 2, 10), joints=1)[0, :, -4:]
    tensor([[1., 0., 0., 0.],
            [1., 1., 1., 1.]])
    """
    x = x.clone()
    x[:, 0, -3 * joints :] = 0
    return x


def split(y: Tensor) -> tuple[Tensor, Tensor]:
    """The network's answer [..., 7J] as unit quaternions [..., J, 4] and velocities [..., J, 3].

    >>> rotations, velocities = split(torch.ones(2, 14))
    >>> rotations.shape, velocities.shape
    (torch.Size([2, 2, 4]), torch.Size([2, 2, 3]))
    """
    joints = y.shape[-1] // 7
    turns, speeds = y[..., : 4 * joints], y[..., 4 * joints :]
    return rot.normalize(turns.unflatten(-1, (joints, 4))), speeds.unflatten(-1, (joints, 3))


def split_frames(x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What the network is given [..., 10J] as quaternions [..., J, 4], positions and velocities [..., J, 3] each.

    >>> [part.shape[-2:] for part in split_frames(torch.ones(2, 20))]
    [torch.Size([2, 4]), torch.Size([2, 3]), torch.Size([2, 3])]
    """
    joints = x.shape[-1] // 10
    return tuple(part.unflatten(-1, (joints, -1)) for part in x.split((4 * joints, 3 * joints, 3 * joints), -1))


def placed_positions(skeleton: Skeleton, offsets: Tensor, rotations: Tensor, lowest: Tensor) -> Tensor:
    """Positions [..., J, 3] by forward kinematics, as high as the lowest foot is to be, [...] (paper 2, section 3.1).

    offsets: [..., J, 3], of each body. The network says nothing of the root's height: whoever bends his knees comes
    down, and one whose feet are off the ground stays in the air.
    """
    lying = offsets.clone()
    lying[..., 0, :] = 0
    places = forward_kinematics(skeleton, rotations, lying.expand(*rotations.shape[:-1], 3))
    up = lowest - places[..., list(skeleton.feet()), 1].amin(-1)
    return places + torch.stack((torch.zeros_like(up), up, torch.zeros_like(up)), -1)[..., None, :]


def lowest_foot(skeleton: Skeleton, positions: Tensor) -> Tensor:
    """The height of the lower foot, [...], from positions [..., J, 3]."""
    return positions[..., list(skeleton.feet()), 1].amin(-1)


def motion_from(content: Motion, frames: Frames, rotations: Tensor, velocities: Tensor) -> Motion:
    """The network's answers for all frames as a motion on the content's body, which starts where the content does.

    rotations, velocities: of `split`, [F, J, 4] and [F, J, 3]. Facing is the content's; the path is the root's velocity
    added up (paper 2, section 3.1, leaves the path open). Its height is, too, and drawn to where the lower foot is as
    high as the content's: that height alone would jump a little whenever the other foot becomes the lower one.
    """
    body = content.without_helper_joints()
    skeleton, offsets = body.skeleton, body.translations
    low = lowest_foot(skeleton, frames.positions)
    height = filter_height(placed_positions(skeleton, offsets, rotations, low)[:, 0, 1], velocities[:, 0, 1], body.fps)
    facing = rot.yaw_to_quaternion(frames.yaw)
    step = velocities[:, 0] * velocities.new_tensor([1.0, 0.0, 1.0]) * (TENTH / body.fps)
    step[0] = 0
    path = rot.quaternion_rotate(facing, step).cumsum(0)[:, [0, 2]] + frames.ground[:1]
    root = torch.stack((path[:, 0], height, path[:, 1]), 1)
    turned = torch.cat((rot.quaternion_multiply(facing, rotations[:, 0])[:, None], rotations[:, 1:]), 1)
    translations = torch.cat((root[:, None], offsets[:, 1:]), 1)
    return content.with_helper_joints_of(body.replace(rotations=turned, translations=translations))


def filter_height(heights: Tensor, speeds: Tensor, fps: float) -> Tensor:
    """The root's heights [F] from those by the lower foot [F] and its vertical velocities [F], metres a tenth second.

    >>> filter_height(torch.tensor([1.0, 2.0, 2.0]), torch.zeros(3), 60.0)
    tensor([1.0000, 1.3000, 1.5100])
    """
    found = [heights[0]]
    for height, up in zip(heights[1:], speeds[1:] * (TENTH / fps)):
        found.append(torch.lerp(found[-1] + up, height, SETTLE))
    return torch.stack(found)
