"""Error against the exact answer, which the performer knows and no capture does."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import rotations as rot
from ..actor import Performance
from ..errors import MotionKitError, motion_inside
from ..motion import Motion, facing_of


def truth_error(
    result: Motion, truth: Performance, content: Performance, *, beats: Tensor | None = None, world: bool = False
) -> Tensor:
    """How far a style transfer's result is from the exact answer: mm for each joint [J], the mean over frames.

    result: what a method made of `content.motion`; truth: `retell(content, style)`. Frame by frame they are compared at
    the same beat of the score. A method that keeps the content's timing needs no more; one with a timing of its own
    says with `beats` [F] at which beat each of its frames is. Each pose is seen from its own place on the ground and
    facing; world: compare places in the world instead. Joints are matched by name, in the truth's order.

    Raises MotionKitError if the two do not tell one score, frames and beats do not fit, or a joint is missing.

    >>> from motionkit import actor
    >>> walk = actor.perform("walk", seed=1, seconds=4)
    >>> old = actor.retell(walk, "old")
    >>> float(truth_error(old.along(walk), old, walk).max()), bool(truth_error(walk.motion, old, walk).mean() > 50)
    (0.0, True)
    """
    _check(result, truth, content)
    times = content.beats if beats is None else torch.as_tensor(beats)
    if times.shape != (len(result),):
        raise MotionKitError(
            f"truth_error: the result has {len(result)} frames and {len(times)} are known by their beats; a method "
            "with a timing of its own gives beats= [F]"
        )
    wanted = truth.motion.at(truth.frames_at(times))
    names = wanted.skeleton.names
    order = [result.skeleton.index(name) for name in names]
    places, answer = result.positions()[:, order], wanted.positions()
    if not world:
        places, answer = from_own_place(wanted, places), from_own_place(wanted, answer)
    return torch.linalg.vector_norm(places - answer, dim=-1).mean(0) * 1000


def _check(result: Motion, truth: Performance, content: Performance) -> None:
    kinds = (("result", result, Motion), ("truth", truth, Performance), ("content", content, Performance))
    for what, given, kind in kinds:
        if not isinstance(given, kind):
            hint = motion_inside(given) if kind is Motion else ""
            raise MotionKitError(f"truth_error: {what} must be a {kind.__name__}; found {given!r}{hint}")
    if truth.score is not content.score:
        raise MotionKitError(
            f"truth_error: {truth!r} is no retelling of {content!r}; make it with actor.retell(content, style)"
        )


def from_own_place(like: Motion, places: Tensor) -> Tensor:
    """Positions [F, J, 3] of `like`'s joints as seen from the pelvis' place on the ground, facing +Z."""
    yaw = facing_of(like.skeleton, places)
    pelvis = places[:, like.skeleton.pelvis] * places.new_tensor([1.0, 0.0, 1.0])
    back = rot.yaw_to_quaternion(-yaw)[:, None]
    return rot.quaternion_rotate(back, places - pelvis[:, None])
