"""Trajectory and feet: what a style transfer should leave as it is."""

from __future__ import annotations

import torch
from torch import Tensor

from ..contacts import foot_contacts, foot_sliding
from ..errors import MotionKitError
from ..motion import Motion
from .checks import needs_motion, needs_tensor


def trajectory_similarity(result: Motion, content: Motion) -> float:
    """Trajectory Similarity Index (paper 4, section 4.2): metres between both paths over the ground, mean over frames.

    Both start at the origin facing +Z, as paper 4's data do; smaller is more alike. Raises MotionKitError where the
    numbers of frames differ: bring a result with a timing of its own to the content's frames first (`Motion.at`).

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> trajectory_similarity(walk.moved(1.0, (3.0, 0.0, 1.0)), walk) < 1e-5
    True
    """
    for motion in (result, content):
        needs_motion("trajectory similarity", motion)
    if len(result) != len(content):
        raise MotionKitError(
            f"trajectory similarity: the result has {len(result)} frames and the content {len(content)}; compare "
            "frames of the same moments, as result.at(times) gives them"
        )
    paths = [motion.at_origin().root_path() for motion in (result, content)]
    return float(torch.linalg.vector_norm(paths[0] - paths[1], dim=-1).mean())


def foot_sliding_factor(result: Motion, contacts: Tensor | None = None) -> float:
    """Foot Sliding Factor (paper 4, section 4.2): millimetres a frame that feet slide while they touch the ground.

    The paper's text leaves open how it is summed (its supplement is not at hand); here it is `contacts.foot_sliding`.
    contacts: bool [F, K], those of the content where they should stay; left out, the result's own. A body that floats
    never stands and scores 0, so read it beside `foot_contact_accuracy`. Raises MotionKitError for fewer than two
    frames or contacts that do not fit.

    >>> import motionkit as mk
    >>> foot_sliding_factor(mk.load("data/actor/walk_neutral.bvh")) < 1.0
    True
    """
    needs_motion("foot sliding factor", result, frames=2)
    if contacts is not None:
        needs_tensor("foot sliding factor", "contacts [F, K]", contacts)
    return foot_sliding(result, contacts)


def foot_contact_accuracy(result: Motion, contacts: Tensor) -> float:
    """Foot Contact Accuracy (paper 1, section 6.1): per cent of frames and feet in which standing or not agrees.

    contacts: bool [F, K] of the motion that it should agree with, from `foot_contacts` or exact. Raises MotionKitError
    where the shapes do not fit.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> foot_contact_accuracy(walk, foot_contacts(walk))
    100.0
    """
    found = foot_contacts(needs_motion("foot contact accuracy", result))
    needs_tensor("foot contact accuracy", "contacts [F, K]", contacts)
    if found.shape != contacts.shape:
        raise MotionKitError(
            f"foot contact accuracy: contacts {list(contacts.shape)} for a result whose feet give {list(found.shape)}; "
            "compare motions of one length on one skeleton"
        )
    return 100 * float((found == contacts.bool()).double().mean())
