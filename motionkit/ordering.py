"""Joints in another order: a BVH file writes them depth first, a dataset may count them otherwise."""

from __future__ import annotations

from .motion import Motion
from .skeleton import Skeleton


def in_order(motion: Motion, like: Skeleton) -> Motion:
    """The motion with its joints in another skeleton's order, if they are the same ones; else as it is.

    >>> import motionkit as mk
    >>> walk, like = mk.load("data/actor/walk_neutral.bvh"), mk.skeleton.smpl()
    >>> walk.skeleton.names[4], in_order(walk, like).skeleton.names[4]
    ('left_foot', 'left_knee')
    """
    own = motion.skeleton
    if own.names == like.names or sorted(own.names) != sorted(like.names):
        return motion
    order = [own.index(name) for name in like.names]
    parents = tuple(-1 if own.parents[j] < 0 else like.names.index(own.names[own.parents[j]]) for j in order)
    if parents != like.parents:
        return motion
    skeleton = Skeleton(like.names, parents, own.offsets[order])
    return motion.replace(
        skeleton=skeleton, rotations=motion.rotations[:, order], translations=motion.translations[:, order]
    )
