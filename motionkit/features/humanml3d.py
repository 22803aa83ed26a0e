"""HumanML3D's layout: the 263 numbers that most text-to-motion work is trained on."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import rotations as rot
from ..errors import MotionKitError
from ..motion import Motion
from ..skeleton import Skeleton, smpl
from .canonical import canonicalize, forward_difference, integrate, motion_from_positions, uncanonicalize
from .layout import Layout, Row

FACING_SMOOTHED_BY = 20.0  # frames, standard deviation, as the data were made
CONTACT_SPEED_SQUARED = 0.002  # (metres a frame) squared; a foot slower than this stands

# Which way each bone points in the published rest pose (arms and legs hang down), for SMPL's joints by name.
_REST = {
    "left_hip": (1, 0, 0), "right_hip": (-1, 0, 0), "spine1": (0, 1, 0), "spine2": (0, 1, 0), "spine3": (0, 1, 0),
    "left_foot": (0, 0, 1), "right_foot": (0, 0, 1), "neck": (0, 1, 0), "head": (0, 0, 1),
    "left_collar": (1, 0, 0), "right_collar": (-1, 0, 0),
}  # fmt: skip


class HumanML3D(Layout):
    """Guo et al. 2022: root 4, positions 3(J-1), rotations 6(J-1), velocities 3J, contacts 4; 263 for 22 joints.

    What the published files leave unsaid, kept here to the letter:

    - the turning speed is **half** the angle (it is read off a quaternion), and positive to the character's right;
    - the speed of frame t is seen from where the body faces in frame t + 1;
    - the facing direction is smoothed by a Gaussian of 20 frames; positions keep their height (y is not relative);
    - rotations are found from positions alone, bone by bone, so they say nothing of the twist about a bone; each
      belongs to the joint at the bone's **end**, and both arms start again from the root;
    - contacts are left ankle, left toe, right ankle, right toe; 1 where the joint moves less than 4.5 cm a frame.

    Files in this format have one frame less than the clip, because the last has no speed; `encode` repeats the last
    speed and keeps all frames. The published data run at 20 frames a second.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh").resample(20)
    >>> layout = HumanML3D()
    >>> x = layout.encode(walk)
    >>> x.shape, layout.positions(x).shape
    (torch.Size([80, 263]), torch.Size([80, 22, 3]))
    """

    default_fps = 20.0
    components = {
        "root": ("half yaw velocity", "x velocity", "z velocity", "height"),
        "positions": ("x", "y", "z"),
        "rotations": ("column 1 x", "column 1 y", "column 1 z", "column 2 x", "column 2 y", "column 2 z"),
        "velocities": ("x", "y", "z"),
        "contacts": ("stands",),
    }
    units = {
        "root": ("rad/frame", "m/frame", "m/frame", "m"),
        "positions": ("m",),
        "rotations": ("",),
        "velocities": ("m/frame",),
        "contacts": ("",),
    }

    @property
    def order(self) -> list[int]:
        """SMPL's joints in the published order, however the file lists them; other bodies as in every layout."""
        names = self.skeleton.names
        return [names.index(n) for n in smpl().names] if set(names) == set(smpl().names) else super().order

    @property
    def joints(self) -> dict[str, list[int]]:
        return {
            "root": [],
            "positions": self.order[1:],
            "rotations": self.order[1:],
            "velocities": self.order,
            "contacts": self._feet(),
        }

    def rows(self) -> list[Row]:
        return self._lay_out(
            ("root", "half the turn to the right; speed left (x) and forward (z); height"),
            ("positions", "joint relative to the root's place on the ground, facing +Z"),
            ("rotations", "6D of the bone that ends at the joint, from positions, no twist"),
            ("velocities", "joint, seen from the body"),
            ("contacts", "1 where the foot joint stands"),
        )

    def _feet(self) -> list[int]:
        roles = self.skeleton.roles
        names = ("left_ankle", "left_toe", "right_ankle", "right_toe")
        missing = [n for n in names if n not in roles]
        if missing:
            raise MotionKitError(
                f"HumanML3D's layout needs a person's feet; {self.skeleton!r} has no joint that is its "
                f"{missing[0].replace('_', ' ')}: use FacingFree or SixD for other bodies"
            )
        return [roles[n] for n in names]

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to features [F, 12J - 1]; MotionKitError if its skeleton or frame rate is another."""
        # bones are turned from the rest pose in the world's directions, so the published data depend on the heading:
        # there, as here, the first frame faces +Z
        motion = self._take(motion).at_origin()
        body = canonicalize(motion, FACING_SMOOTHED_BY)
        places = motion.positions()
        against = rot.yaw_to_quaternion(-body.yaw)
        next_against = torch.cat((against[1:], against[-1:]))
        turn = rot.wrap_angle(forward_difference(body.yaw)) / -2
        step = rot.quaternion_rotate(next_against, forward_difference(body.root))
        root = torch.stack((turn, step[:, 0], step[:, 2], body.root[:, 1]), -1)
        moved = forward_difference(places)[:, self.order]
        velocities = rot.quaternion_rotate(against[:, None], moved)
        stands = (forward_difference(places)[:, self._feet()] ** 2).sum(-1) < CONTACT_SPEED_SQUARED
        parts = (
            root,
            body.local[:, self.order[1:]],
            rot.quaternion_to_sixd(self._bone_rotations(places, against))[:, self.order[1:]],
            velocities,
            stands.to(root.dtype),
        )
        return torch.cat([p.flatten(1) for p in parts], -1)

    def _bone_rotations(self, places: Tensor, against: Tensor) -> Tensor:
        """For each joint the turn of the bone that ends there, relative to the bone before, [F, J, 4].

        Down each chain the rest direction is turned the shortest way onto the bone. Every chain starts from the
        rotation that faces the body forward, also the arms, which do not start at the root.
        """
        skeleton = self.skeleton
        result = rot.identity_quaternion(len(places), len(skeleton), dtype=places.dtype)
        for chain in _chains(skeleton):
            before = against
            for parent, joint in zip(chain, chain[1:], strict=False):
                bone = places[:, joint] - places[:, parent]
                whole = rot.rotation_between(places.new_tensor(_rest_direction(skeleton, joint)).expand_as(bone), bone)
                result[:, joint] = rot.quaternion_multiply(rot.quaternion_inverse(before), whole)
                before = whole
        return result

    def path(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Where the body faces [F] and where the root stands on the ground [F, 2], from features [F, D]."""
        yaw = -2 * integrate(x[:, 0])
        after = torch.cat((yaw[1:], yaw[-1:]))
        step = torch.stack((x[:, 1], torch.zeros_like(yaw), x[:, 2]), -1)
        return yaw, integrate(rot.quaternion_rotate(rot.yaw_to_quaternion(after), step))[:, [0, 2]]

    def positions(self, x: Tensor) -> Tensor:
        """Features [F, D] to joint places [F, J, 3], read from the position slice without any rotation."""
        x = self._check(x)
        yaw, ground = self.path(x)
        local = x[:, self.slices["positions"]].unflatten(1, (-1, 3))
        root = x[:, 3, None, None] * x.new_tensor([0.0, 1.0, 0.0])
        return uncanonicalize(torch.cat((root, local), 1)[:, self.file_order], yaw, ground)

    def decode(self, x: Tensor) -> Motion:
        """Features [F, D] to a motion whose joints stand where the position slice says.

        Rotations are found from the positions (the rotation slice holds no twist and is not needed). Bones keep the
        skeleton's lengths; without a skeleton of its own, the layout takes SMPL's tree with lengths from the data.
        """
        return motion_from_positions(
            self.positions(x), self.skeleton, self.fps, keep_lengths=self._skeleton is not None
        )


def _chains(skeleton: Skeleton) -> list[list[int]]:
    """The bones as chains: from the pelvis to a tip, then from each joint on the way to its other tips."""
    chains = []

    def follow(start: list[int]) -> None:
        path = start
        branches: list[list[int]] = []
        while skeleton.children[path[-1]]:
            first, *others = skeleton.children[path[-1]]
            branches += [[path[-1], other] for other in others]
            path.append(first)
        if len(path) > 1:
            chains.append(path)
        for branch in branches:
            follow(branch)

    follow([skeleton.pelvis])
    return chains


def _rest_direction(skeleton: Skeleton, joint: int) -> tuple[float, ...]:
    """The published direction for SMPL's joints (those not listed hang down); the rest offset's for all others."""
    if set(skeleton.names) == set(smpl().names):
        return _REST.get(skeleton.names[joint], (0, -1, 0))
    return tuple(rot.normalize(skeleton.offsets[joint]).tolist())
