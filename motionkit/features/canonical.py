"""From a motion in the world to poses seen from the body, and back: the step that all layouts share."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .. import kinematics
from .. import rotations as rot
from ..errors import MotionKitError
from ..motion import Motion, facing_of
from ..skeleton import Skeleton


@dataclass(frozen=True)
class CanonicalPose:
    """A clip as the body sees it.

    yaw: [F] radians, where the body faces. root: [F, 3] metres, the pelvis in the world. local: [F, J, 3] metres, all
    joints relative to the pelvis' place on the ground, turned so that the body faces +Z (y stays the height above the
    ground). world: [F, J, 4] rotations in the world.
    """

    yaw: Tensor
    root: Tensor
    local: Tensor
    world: Tensor


def canonicalize(motion: Motion, smooth: float = 0.0) -> CanonicalPose:
    """Split a motion into path, facing and pose.

    smooth: standard deviation in frames of a Gaussian over the facing direction (HumanML3D smooths by 20).

    >>> s = Skeleton(("hips", "l_hip", "r_hip"), (-1, 0, 0), torch.tensor([[0.0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0]]))
    >>> m = Motion.from_root(s, rot.identity_quaternion(1, 3), torch.tensor([[5.0, 1.0, 0.0]]), fps=30)
    >>> canonicalize(m).local[0]
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
    return CanonicalPose(yaw, root, local, world)


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


def uncanonicalize(local: Tensor, yaw: Tensor, ground: Tensor) -> Tensor:
    """Poses as the body sees them back into the world: [F, J, 3] with yaw [F] and ground [F, 2] (x, z), metres.

    >>> uncanonicalize(torch.tensor([[[0.0, 1.0, 0.5]]]), torch.zeros(1), torch.tensor([[2.0, 0.0]]))
    tensor([[[2.0000, 1.0000, 0.5000]]])
    """
    shift = torch.stack((ground[:, 0], torch.zeros_like(yaw), ground[:, 1]), -1)
    return rot.quaternion_rotate(rot.yaw_to_quaternion(yaw)[:, None], local) + shift[:, None]


def motion_from_local(
    skeleton: Skeleton, local: Tensor, pelvis: Tensor, positions: Tensor, fps: float, **more
) -> Motion:
    """A motion from local rotations [F, J, 4] and the pelvis' place [F, 3]; bones keep their length.

    positions: [F, J, 3], read only for helper joints above the pelvis, which may stand anywhere.
    """
    world = kinematics.world_rotations(skeleton, local)
    translations = skeleton.offsets.to(local).expand(len(local), -1, -1).clone()
    for joint in skeleton.ancestors(skeleton.pelvis):
        here = pelvis if joint == skeleton.pelvis else positions[:, joint]
        parent = skeleton.parents[joint]
        if parent >= 0:
            here = rot.quaternion_rotate(rot.quaternion_inverse(world[:, parent]), here - positions[:, parent])
        translations[:, joint] = here
    return Motion(skeleton, local, translations, fps, **more)


def motion_from_positions(
    positions: Tensor, skeleton: Skeleton, fps: float, *, keep_lengths: bool = True, name: str = ""
) -> Motion:
    """A motion whose joints stand at `positions` [F, J, 3] (metres, in the skeleton's order).

    A joint from which several bones leave is turned to fit all of them best; one with a single bone is turned with
    its parent and then the shortest way onto the bone: places alone do not tell the twist. With `keep_lengths` the
    bones are those of `skeleton`, else each gets its mean length and place in the data.

    >>> s = Skeleton(("root", "tip"), (-1, 0), torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    >>> motion_from_positions(torch.tensor([[[0.0, 0, 0], [0, 0, 1]]]), s, fps=30).positions()[0, 1].round(decimals=3)
    tensor([0., 0., 1.])
    """
    if positions.ndim != 3 or positions.shape[1:] != (len(skeleton), 3):
        raise MotionKitError(f"expected positions [frames, {len(skeleton)}, 3]; found {list(positions.shape)}")
    world = _world_rotations(positions, skeleton)
    parents = list(skeleton.parents[1:])
    bones = positions[:, 1:] - positions[:, parents]
    seen = rot.quaternion_rotate(rot.quaternion_inverse(world[:, parents]), bones)
    if not keep_lengths:
        offsets = torch.cat((skeleton.offsets[:1].to(seen), seen.mean(0)))
        skeleton = Skeleton(
            skeleton.names, skeleton.parents, offsets, skeleton.channels, skeleton.end_sites, skeleton.mirror_joints
        )
    translations = skeleton.offsets.to(positions).expand(len(positions), -1, -1).clone()
    translations[:, 0] = positions[:, 0]
    for joint in skeleton.ancestors(skeleton.pelvis)[1:]:  # below a helper joint the body may stand anywhere
        translations[:, joint] = seen[:, joint - 1]
    local = rot.quaternion_unroll(kinematics.local_rotations(skeleton, world))
    return Motion(skeleton, local, translations, fps, name)


def _world_rotations(positions: Tensor, skeleton: Skeleton) -> Tensor:
    world: list[Tensor] = [rot.identity_quaternion(len(positions), dtype=positions.dtype)] * len(skeleton)
    body = set(skeleton.ancestors(skeleton.pelvis)[:-1])
    for level in skeleton.levels:
        for joint in level:
            above = world[skeleton.parents[joint]] if joint else world[0]
            children = [c for c in skeleton.children[joint] if float(skeleton.offsets[c].norm()) > 1e-6]
            if joint in body or not children:
                world[joint] = above
                continue
            rest = skeleton.offsets[children].to(positions)
            bones = positions[:, children] - positions[:, [joint]]
            world[joint] = _fit(rest, bones) if _spread(rest) else _swing(above, rest[0], bones[:, 0])
    return torch.stack(world, 1)


def _spread(rest: Tensor) -> bool:
    """Whether bones leave in different directions, so that together they tell the whole rotation."""
    return len(rest) > 1 and float(torch.linalg.svdvals(rot.normalize(rest))[1]) > 0.1


def _swing(above: Tensor, rest: Tensor, bone: Tensor) -> Tensor:
    """The parent's rotation, then the shortest way onto the bone."""
    return rot.quaternion_multiply(rot.rotation_between(rot.quaternion_rotate(above, rest), bone), above)


def _fit(rest: Tensor, bones: Tensor) -> Tensor:
    """The rotations [F, 4] that turn rest offsets [n, 3] best onto bones [F, n, 3], by SVD (Kabsch 1976)."""
    u, _, vh = torch.linalg.svd(bones.transpose(-1, -2).double() @ rest.double())
    sign = torch.det(u @ vh)
    u = torch.cat((u[..., :2], u[..., 2:] * sign[:, None, None]), -1)
    return rot.matrix_to_quaternion(u @ vh).to(bones.dtype)
