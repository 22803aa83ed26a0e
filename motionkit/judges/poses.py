"""What judges look at: joints seen from the body, in windows of one length."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from .. import rotations as rot
from ..errors import MotionKitError, motion_inside
from ..features.frames import body_frames, forward_difference
from ..motion import Motion
from ..ordering import in_order
from ..skeleton import Skeleton

WINDOW, STRIDE = 64, 32  # frames


def fitting(motion: Motion, skeleton: Skeleton, fps: float, who: str) -> Motion:
    """The motion's body at a judge's frame rate, its joints in the judge's order (a BVH file has one of its own).

    Raises MotionKitError if it is no motion, or its joints or their parents are others.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> len(fitting(walk, walk.skeleton, 15.0, "a judge"))
    60
    """
    if not isinstance(motion, Motion):
        raise MotionKitError(f"{who} judges motions; found {motion!r}{motion_inside(motion)}")
    body = in_order(motion.body(), skeleton)
    if not body.skeleton.same_tree(skeleton):
        odd = sorted(set(body.skeleton.names) ^ set(skeleton.names)) or ["the joints' parents"]
        raise MotionKitError(
            f"{who} was trained on a skeleton of {len(skeleton)} joints; {motion.name!r} has {len(body.skeleton)}, and "
            f"they differ in {', '.join(odd[:4])}: retarget it with mk.retarget(motion, judge.skeleton), or train a "
            "classifier for this skeleton with mk.judges.train_classifier"
        )
    if not len(body):
        raise MotionKitError(f"{who}: {motion.name!r} has no frames")
    return body if body.fps == fps else body.resample(fps)


def several(motions: Sequence[Motion | None]) -> list[Motion | None]:
    """The motions as a list; MotionKitError for a single one, or none."""
    if isinstance(motions, Motion):
        raise MotionKitError("a judge takes several motions: give a list, [motion] for one")
    found = list(motions)
    if not found:
        raise MotionKitError("a judge was given no motions")
    return found


def joint_numbers(motion: Motion) -> Tensor:
    """Where each joint is and how fast it moves, seen from the body: [F, J, 6], metres and metres a second.

    Places are relative to the pelvis' spot on the ground, velocities relative to the ground; both turned so that the
    body faces +Z in every frame.

    >>> import motionkit as mk
    >>> joint_numbers(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 22, 6])
    """
    body = body_frames(motion)
    moved = forward_difference(motion.positions()) * motion.fps
    return torch.cat((body.local, rot.quaternion_rotate(rot.yaw_to_quaternion(-body.yaw)[:, None], moved)), -1).float()


def joint_turns(motion: Motion) -> Tensor:
    """Joint rotations for paper 2's autoencoder: unit quaternions [F, J, 4], w >= 0, the pelvis' without its facing.

    >>> import motionkit as mk
    >>> joint_turns(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 22, 4])
    """
    body, turns = body_frames(motion), motion.rotations.clone()
    for joint in motion.skeleton.chain(motion.skeleton.pelvis):
        turns[:, joint] = rot.quaternion_multiply(rot.yaw_to_quaternion(-body.yaw), body.world[:, joint])
    return rot.positive(turns).float()


def cut(frames: int, length: int = WINDOW, stride: int = STRIDE) -> list[int]:
    """Where windows start so that they cover all frames; one window, as long as the clip, if that is shorter.

    >>> cut(120), cut(40)
    ([0, 32, 56], [0])
    """
    return sorted({*range(0, max(frames - length, 0) + 1, stride), max(frames - length, 0)})


@torch.no_grad()
def over_windows(
    motions: Sequence[Motion | None],
    numbers: Callable[[Motion], Tensor],
    network: Callable[[Tensor], Tensor],
    length: int,
) -> Tensor:
    """What a network says of motions, the mean over each one's windows: [N, D].

    numbers: a motion to [F, ...]; network: windows [B, F, ...] to [B, D]. None, a result that is
    missing, gets NaN.
    """
    found: list[Tensor | None] = []
    for start in range(0, len(motions), 64):
        found += _chunk(motions[start : start + 64], numbers, network, length)
    there = next((x for x in found if x is not None), None)
    if there is None:
        raise MotionKitError(f"all {len(motions)} motions given to a judge are None; there is nothing to see")
    return torch.stack([torch.full_like(there, torch.nan) if x is None else x for x in found])


def _chunk(
    motions: Sequence[Motion | None],
    numbers: Callable[[Motion], Tensor],
    network: Callable[[Tensor], Tensor],
    length: int,
) -> list[Tensor | None]:
    windows: dict[int, list[tuple[int, Tensor]]] = {}  # by their length
    for n, motion in enumerate(motions):
        if motion is None:
            continue
        x = numbers(motion)
        for start in cut(len(x), length):
            piece = x[start : start + length]
            windows.setdefault(len(piece), []).append((n, piece))
    sums: list[Tensor | None] = [None] * len(motions)
    counts = [0] * len(motions)
    for pieces in windows.values():
        for some in (pieces[n : n + 64] for n in range(0, len(pieces), 64)):
            for (n, _), value in zip(some, network(torch.stack([piece for _, piece in some]))):
                sums[n] = value if sums[n] is None else sums[n] + value
                counts[n] += 1
    return [None if total is None else total / count for total, count in zip(sums, counts)]
