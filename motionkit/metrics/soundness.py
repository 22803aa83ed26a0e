"""Is a motion sound at all: does it tremble, do bones stretch, does anything go through the floor?"""

from __future__ import annotations

import torch

from ..errors import MotionKitError
from ..motion import Motion


def jitter(motion: Motion) -> float:
    """Mean size of the joints' jerk, the change of acceleration, in m/s^3; 0 for a body that stands or glides.

    Raises MotionKitError for fewer than four frames.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> jitter(walk.replace(rotations=walk.rotations[:1].expand_as(walk.rotations))) < jitter(walk)
    True
    """
    if len(motion) < 4:
        raise MotionKitError(f"jitter: {motion!r} has {len(motion)} frames; four are the least")
    places = motion.positions().double()
    jerk = (places[3:] - 3 * places[2:-1] + 3 * places[1:-2] - places[:-3]) * motion.fps**3
    return float(torch.linalg.vector_norm(jerk, dim=-1).mean())


def bone_length_error(motion: Motion) -> float:
    """The largest difference of a bone's length from the skeleton's, millimetres, over all bones and frames.

    Helper joints above the pelvis, from which it moves freely, are no bones.

    >>> import motionkit as mk
    >>> bone_length_error(mk.load("data/actor/walk_neutral.bvh")) < 0.01
    True
    """
    motion = motion.body()
    if len(motion.skeleton) < 2 or not len(motion):
        return 0.0
    places, parents = motion.positions().double(), list(motion.skeleton.parents[1:])
    lengths = torch.linalg.vector_norm(places[:, 1:] - places[:, parents], dim=-1)
    usual = torch.linalg.vector_norm(motion.skeleton.offsets[1:].double(), dim=-1)
    return 1000 * float((lengths - usual).abs().max())


def penetration(motion: Motion, ground: float = 0.0) -> float:
    """How deep the lowest joint of any frame is under the ground, millimetres; 0 where all stay above.

    ground: its height, metres.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> penetration(walk), round(penetration(walk, ground=walk.positions()[..., 1].min().item() + 0.05))
    (0.0, 50)
    """
    if not len(motion):
        return 0.0
    return 1000 * max(0.0, ground - float(motion.positions()[..., 1].min()))
