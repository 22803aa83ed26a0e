"""From a motion in the world to poses seen from the body, and back: the step that all layouts share."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .. import kinematics
from .. import rotations as rot
from ..motion import Motion, facing_of
from ..skeleton import Skeleton


@dataclass(frozen=True)
class BodyFrames:
    """A clip as the body sees it.

    yaw: [F] radians, where the body faces. root: [F, 3] metres, the pelvis in the world. local: [F, J, 3] metres, all
    joints relative to the pelvis' place on the ground, turned so that the body faces +Z (y stays the height above the
    ground). world: [F, J, 4] rotations in the world.
    """

    yaw: Tensor
    root: Tensor
    local: Tensor
    world: Tensor


def body_frames(motion: Motion, smooth: float = 0.0) -> BodyFrames:
    """Split a motion into path, facing and pose.

    smooth: standard deviation in frames of a Gaussian over the facing direction (HumanML3D smooths by 20).

    >>> s = Skeleton(("hips", "l_hip", "r_hip"), (-1, 0, 0), torch.tensor([[0.0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0]]))
    >>> m = Motion.from_root(s, rot.identity_quaternion(1, 3), torch.tensor([[5.0, 1.0, 0.0]]), fps=30)
    >>> body_frames(m).local[0]
    tensor([[ 0.0000,  1.0000,  0.0000],
            [ 0.1000,  1.0000,  0.0000],
            [-0.1000,  1.0000,  0.0000]])
    """
    positions, world = motion.positions(), motion.world_rotations()
    yaw = facing_of(motion.skeleton, positions, world)
    if smooth > 0 and len(motion):
        yaw = smooth_yaw(yaw, smooth)
    root = positions[:, motion.skeleton.pelvis]
    ground = root * root.new_tensor([1.0, 0.0, 1.0])
    local = rot.quaternion_rotate(rot.yaw_to_quaternion(-yaw)[:, None], positions - ground[:, None])
    return BodyFrames(yaw, root, local, world)


def smooth_yaw(yaw: Tensor, sigma: float) -> Tensor:
    """A Gaussian of `sigma` frames over facing directions given as yaw [F]; ends repeat; cut at 4 sigma.

    >>> smooth_yaw(torch.zeros(5), 20.0)
    tensor([0., 0., 0., 0., 0.])
    """
    radius = int(4 * sigma + 0.5)
    weights = torch.exp(-0.5 * (torch.arange(-radius, radius + 1, dtype=torch.float64) / sigma) ** 2)
    direction = torch.stack((torch.sin(yaw), torch.cos(yaw))).double()  # [2, F]
    padded = torch.nn.functional.pad(direction[:, None], (radius, radius), mode="replicate")
    sine, cosine = torch.nn.functional.conv1d(padded, (weights / weights.sum())[None, None])[:, 0]
    return torch.atan2(sine, cosine).to(yaw.dtype)


def forward_difference(x: Tensor) -> Tensor:
    """x[t + 1] - x[t] for every frame of [F, ...]; the last frame repeats the one before (0 for a single frame).

    >>> forward_difference(torch.tensor([1.0, 2.0, 4.0]))
    tensor([1., 2., 2.])
    """
    if len(x) < 2:
        return torch.zeros_like(x)
    steps = x[1:] - x[:-1]
    return torch.cat((steps, steps[-1:]))


def integrate(steps: Tensor) -> Tensor:
    """From steps [F, ...] to places [F, ...] that start at 0; summed in double precision. Undoes `forward_difference`.

    >>> integrate(torch.tensor([1.0, 2.0, 2.0]))
    tensor([0., 1., 3.])
    """
    total = torch.cumsum(steps.double(), 0)
    return torch.cat((torch.zeros_like(total[:1]), total[:-1]))[: len(steps)].to(steps.dtype)


def place(local: Tensor, yaw: Tensor, ground: Tensor) -> Tensor:
    """Poses as the body sees them back into the world: [F, J, 3] with yaw [F] and ground [F, 2] (x, z), metres.

    >>> place(torch.tensor([[[0.0, 1.0, 0.5]]]), torch.zeros(1), torch.tensor([[2.0, 0.0]]))
    tensor([[[2.0000, 1.0000, 0.5000]]])
    """
    shift = torch.stack((ground[:, 0], torch.zeros_like(yaw), ground[:, 1]), -1)
    return rot.quaternion_rotate(rot.yaw_to_quaternion(yaw)[:, None], local) + shift[:, None]


def assemble(skeleton: Skeleton, local: Tensor, pelvis: Tensor, positions: Tensor, fps: float, **more) -> Motion:
    """A motion from local rotations [F, J, 4] and the pelvis' place [F, 3]; bones keep their length.

    positions: [F, J, 3], read only for helper joints above the pelvis, which may stand anywhere.
    """
    world = kinematics.world_rotations(skeleton, local)
    translations = skeleton.offsets.to(local).expand(len(local), -1, -1).clone()
    for joint in skeleton.chain(skeleton.pelvis):
        here = pelvis if joint == skeleton.pelvis else positions[:, joint]
        parent = skeleton.parents[joint]
        if parent >= 0:
            here = rot.quaternion_rotate(rot.quaternion_inverse(world[:, parent]), here - positions[:, parent])
        translations[:, joint] = here
    return Motion(skeleton, local, translations, fps, **more)
