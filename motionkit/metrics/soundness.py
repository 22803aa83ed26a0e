"""Is a motion sound at all: does it tremble, do bones stretch, does anything go through the floor?"""

from __future__ import annotations

import torch

from ..motion import Motion
from .checks import needs_motion


def jitter(motion: Motion) -> float:
    """Mean size of the joints' jerk, the change of acceleration, in m/s^3; 0 for a body that stands or glides.

    Raises MotionKitError for fewer than four frames.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> jitter(walk.replace(rotations=walk.rotations[:1].expand_as(walk.rotations))) < jitter(walk)
    True
    """
    places = needs_motion("jitter", motion, frames=4).positions().double()
    jerk = (places[3:] - 3 * places[2:-1] + 3 * places[1:-2] - places[:-3]) * motion.fps**3
    return float(torch.linalg.vector_norm(jerk, dim=-1).mean())


def bone_length_error(motion: Motion) -> float:
    """The largest difference of a bone's length from the skeleton's, millimetres, over all bones and frames.

    Helper joints above the pelvis, from which it moves freely, are no bones. Raises MotionKitError for a motion without
    frames.

    >>> import motionkit as mk
    >>> bone_length_error(mk.load("data/actor/walk_neutral.bvh")) < 0.01
    True
    """
    motion = needs_motion("bone length error", motion).body()
    if len(motion.skeleton) < 2:
        return 0.0
    places, parents = motion.positions().double(), list(motion.skeleton.parents[1:])
    lengths = torch.linalg.vector_norm(places[:, 1:] - places[:, parents], dim=-1)
    usual = torch.linalg.vector_norm(motion.skeleton.offsets[1:].double(), dim=-1)
    return 1000 * float((lengths - usual).abs().max())


def penetration(motion: Motion, ground: float = 0.0) -> float:
    """How deep the lowest joint of any frame is under the ground, millimetres; 0 where all stay above.

    ground: its height, metres. Raises MotionKitError for a motion without frames.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> penetration(walk), round(penetration(walk, ground=walk.positions()[..., 1].min().item() + 0.05))
    (0.0, 50)
    """
    lowest = float(needs_motion("penetration", motion).positions()[..., 1].min())
    return 1000 * max(0.0, ground - lowest)
