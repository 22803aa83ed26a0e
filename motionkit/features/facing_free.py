"""Paper 1's layout: the root's velocities, joint positions and 6D rotations, all seen from the body."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from .. import kinematics
from .. import rotations as rot
from ..motion import Motion
from ..skeleton import Skeleton
from .canonical import canonicalize, forward_difference, integrate, motion_from_local, uncanonicalize
from .layout import Layout, Normalizer, Row


class FacingFree(Layout):
    """Poses that do not know where they stand or face (paper 1, section 3.1); 4 + 3(J-1) + 6J numbers a frame.

    The root vector o holds the turning speed about Y, the speed to the side and forward, and the height; positions p
    are relative to the root joint; rotations r are relative to the parent, the root's to the facing direction. The
    root joint is the skeleton's pelvis, and it comes first. Speeds are per frame, from this frame to the next.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> layout = FacingFree()
    >>> x = layout.encode(walk)
    >>> x.shape
    torch.Size([120, 199])
    >>> gap = layout.decode(x).positions() - walk.at_origin().positions()
    >>> bool(gap.abs().max() < 1e-3)
    True
    """

    components = {
        "root": ("yaw velocity", "x velocity", "z velocity", "height"),
        "positions": ("x", "y", "z"),
        "rotations": ("column 1 x", "column 1 y", "column 1 z", "column 2 x", "column 2 y", "column 2 z"),
    }
    units = {
        "root": ("rad/frame", "m/frame", "m/frame", "m"),
        "positions": ("m",),
        "rotations": ("",),
    }

    @property
    def joints(self) -> dict[str, list[int]]:
        return {"root": [], "positions": self.order[1:], "rotations": self.order}

    def rows(self) -> list[Row]:
        return self._lay_out(
            ("root", "turning about Y; moving left (x) and forward (z); height of the root"),
            ("positions", "joint relative to the root joint, facing +Z"),
            ("rotations", "6D, relative to the parent; the root's relative to the facing"),
        )

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to features [F, D]; MotionKitError if its skeleton or frame rate is another."""
        motion = self._take(motion)
        body = canonicalize(motion)
        turn = rot.wrap_angle(forward_difference(body.yaw)) if len(motion) > 1 else torch.zeros_like(body.yaw)
        against = rot.yaw_to_quaternion(-body.yaw)
        step = rot.quaternion_rotate(against, forward_difference(body.root))
        root = torch.stack((turn, step[:, 0], step[:, 2], body.root[:, 1]), -1)
        relative = (body.local - body.local[:, self.order[:1]])[:, self.order[1:]]
        rotations = rot.quaternion_to_sixd(self._against_facing(motion.rotations, body.world, against))[:, self.order]
        return torch.cat((root, relative.flatten(1), rotations.flatten(1)), -1)

    def _against_facing(self, local: Tensor, world: Tensor, turn: Tensor) -> Tensor:
        """Local rotations [F, J, 4], but those of the pelvis and of helper joints above it in the world, turned."""
        local = local.clone()
        for joint in self.skeleton.ancestors(self.skeleton.pelvis):
            local[:, joint] = rot.quaternion_multiply(turn, world[:, joint])
        return local

    def path(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Where the body faces [F] and where the root stands on the ground [F, 2], from features [F, D]."""
        yaw = integrate(x[:, 0])
        side, forward = x[:, 1], x[:, 2]
        step = torch.stack((side, torch.zeros_like(side), forward), -1)
        return yaw, integrate(rot.quaternion_rotate(rot.yaw_to_quaternion(yaw), step))[:, [0, 2]]

    def positions(self, x: Tensor) -> Tensor:
        """Features [F, D] to joint places [F, J, 3], read from the position slice without any rotation."""
        x = self._check(x)
        yaw, ground = self.path(x)
        relative = x[:, self.slices["positions"]].unflatten(1, (-1, 3))
        local = torch.cat((torch.zeros_like(relative[:, :1]), relative), 1)
        local = local + x[:, 3, None, None] * x.new_tensor([0.0, 1.0, 0.0])
        return uncanonicalize(local[:, self.file_order], yaw, ground)

    def decode(self, x: Tensor) -> Motion:
        """Features [F, D] to a motion from the rotation slice; bones keep the skeleton's lengths."""
        x = self._check(x)
        yaw, ground = self.path(x)
        found = rot.sixd_to_quaternion(x[:, self.slices["rotations"]].unflatten(1, (-1, 6)))[:, self.file_order]
        above = list(self.skeleton.ancestors(self.skeleton.pelvis))
        world = found.clone()
        world[:, above] = rot.quaternion_multiply(rot.yaw_to_quaternion(yaw)[:, None], found[:, above])
        local = found.clone()
        local[:, above] = kinematics.local_rotations(self.skeleton, world)[:, above]
        pelvis = torch.stack((ground[:, 0], x[:, 3], ground[:, 1]), -1)
        return motion_from_local(self.skeleton, rot.quaternion_unroll(local), pelvis, self.positions(x), self.fps)


class OfBody(FacingFree):
    """Facing-free features of the body alone: helper joints above the pelvis, whose place means little, are left out.

    >>> import motionkit as mk
    >>> OfBody().encode(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 199])
    """

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames, its joints in any order, to features [F, D]; MotionKitError as in `FacingFree`."""
        body = motion.without_helper_joints()
        return super().encode(body if self._skeleton is None else body.reorder(self._skeleton))


def encode_normalized(motion: Motion, layout: OfBody, normalizer: Normalizer) -> Tensor:
    """A motion of F frames, its joints in any order and at any frame rate, to normalised features [F, D].

    Raises MotionKitError for another skeleton.
    """
    motion = motion if abs(motion.fps - layout.fps) < 1e-3 else motion.resample(layout.fps)
    return normalizer.normalize(layout.encode(motion).float())


def scaled_skeleton(layout: FacingFree, x: Tensor) -> Skeleton:
    """The layout's skeleton, as large as the body whose joints' positions are among the features [F, D]."""
    skeleton, places = layout.skeleton, layout.positions(x)
    above_pelvis = skeleton.ancestors(skeleton.pelvis)  # helper joints, which may be anywhere
    below = [j for j in range(len(skeleton)) if j not in above_pelvis and skeleton.offsets[j].norm() > 0]
    above = [skeleton.parents[joint] for joint in below]
    lengths = (places[:, below] - places[:, above]).norm(dim=-1).mean(0)
    ratio = float(lengths.sum() / skeleton.offsets[below].norm(dim=-1).sum())
    ends = tuple((joint, tuple(ratio * n for n in place)) for joint, place in skeleton.end_sites)
    return replace(skeleton, offsets=skeleton.offsets * ratio, end_sites=ends)
