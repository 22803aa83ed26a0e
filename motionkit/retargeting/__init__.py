"""Retargeting: a motion brought from one human skeleton to another.

`matching` pairs the joints, `neutral` finds how each rig stands upright, `carry` turns one rig as the other turns from
there, and `ground` puts the feet back where the source's stand.
"""

from .carry import retarget
from .matching import match_joints

__all__ = ["match_joints", "retarget"]
