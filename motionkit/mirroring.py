"""Mirroring a motion on any rig, whatever way its joint frames are turned.

A mirrored body has at joint j the mirror image of the world rotation of its twin, `M R_twin S_j`. `M`
flips the world's x axis. `S_j` flips one axis (or all three) of the joint's own frame, and it differs
from rig to rig: where the bones of both arms run along +x, it is another one than where one runs along
+x, the other along -x. Local rotations then become `S_parent L_twin S_j`, and translations `S_parent
t_twin`.

The flips are found from the offsets, which a flip must map onto those of the twin, and, where they leave a
choice, from the local rotations: a mirrored arm is not twisted by half a turn against the arm whose place it
takes. Neither depends on where the body stands or faces.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from . import rotations as rot
from .errors import MotionKitError
from .motion import Motion
from .skeleton import Skeleton

_FLIPS = torch.tensor([[-1.0, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1]], dtype=torch.float64)
# What a flip costs. Half a turn of twist costs up to 8; an offset that comes out opposite must cost far
# more, and one that a measured, not quite even skeleton leaves a few per cent off far less. A helper
# joint above the pelvis need not follow the body's turns, so it keeps the flip of the world's x. The
# others break ties.
_OFFSET_COST, _HELPER_COST, _UPSIDE_DOWN_COST, _CHANGE_COST = 100.0, 20.0, 0.1, 1e-3


def mirror(motion: Motion, twins: Sequence[int] | None = None) -> Motion:
    """Left and right exchanged in the plane x = 0; mirroring twice gives the motion back.

    twins: for each joint the number of its mirror twin, itself on the midline; left out, the skeleton's
    own. Differentiable in rotations and translations. Raises MotionKitError if left and right cannot be
    told, or if a bone is no mirror image of its twin.

    >>> offsets = torch.tensor([[0.0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0]])
    >>> s = Skeleton(("hips", "l_hip", "r_hip"), (-1, 0, 0), offsets)
    >>> m = Motion.from_root(s, rot.identity_quaternion(1, 3), torch.tensor([[0.5, 1.0, 0.0]]), fps=30)
    >>> mirror(m).positions()[0, 0]
    tensor([-0.5000,  1.0000,  0.0000])
    """
    skeleton = motion.skeleton
    twins = _checked_twins(skeleton, twins)
    if not len(motion):
        return motion
    chosen = _choose_flips(motion, twins)
    _check_bones(motion, twins, chosen)
    flips = _FLIPS[chosen].to(motion.rotations)
    above = torch.cat((_FLIPS[:1].to(flips), flips[list(skeleton.parents[1:])]))  # [J, 3]
    return motion.replace(
        rotations=_mirror_rotations(motion.rotations[:, list(twins)], above, flips),
        translations=_mirror_translations(motion, twins, above),
    )


def _checked_twins(skeleton: Skeleton, given: Sequence[int] | None) -> tuple[int, ...]:
    """The twins, made sure of: they pair up, and so do their parents."""
    twins = tuple(int(t) for t in (given if given is not None else skeleton.twins or ()))
    nobody = given is None and set(skeleton.sides) == {"middle"} and max(map(len, skeleton.children)) > 1
    in_range = len(twins) == len(skeleton) and all(0 <= t < len(skeleton) for t in twins)
    if nobody or not in_range or any(twins[t] != n for n, t in enumerate(twins)):
        raise MotionKitError(
            f"cannot tell left from right on {', '.join(skeleton.names[:8])}, ...: give twins=[...], for "
            "each joint the number of its mirror twin (itself on the midline)"
        )
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0 and twins[parent] != skeleton.parents[twins[joint]]:
            names = skeleton.names
            raise MotionKitError(
                f"joints {names[joint]!r} and {names[twins[joint]]!r} are mirror twins, but their parents "
                f"{names[parent]!r} and {names[skeleton.parents[twins[joint]]]!r} are not: give other twins"
            )
    return twins


def _mirror_rotations(twin: Tensor, above: Tensor, flips: Tensor) -> Tensor:
    """`S_parent L S_j` for the twin's rotations L [F, J, 4] and flips [J, 3], as quaternions.

    A flip on both sides turns the axis of a rotation, as a pseudovector, by -S. What is left, `S_parent S_j`,
    is no turn or half a turn about one axis.
    """
    seen = torch.cat((twin[..., :1], -above * twin[..., 1:]), -1)
    half_turn = above * flips  # [J, 3]: all +1 for no turn, or +1 on the axis alone
    turns = (half_turn.sum(-1, keepdim=True) < 0) * torch.clamp(half_turn, min=0)
    rest = torch.cat((1 - turns.sum(-1, keepdim=True), turns), -1)
    return rot.unroll(rot.quaternion_multiply(seen, rest))


def _mirror_translations(motion: Motion, twins: tuple[int, ...], above: Tensor) -> Tensor:
    """The twin's translations [F, J, 3] in the mirror; joints without position channels keep their offset."""
    skeleton = motion.skeleton
    placed = [any(c.endswith("position") for c in channels) for channels in skeleton.channels]
    fixed = [n > 0 and not placed[n] and not placed[t] for n, t in enumerate(twins)]
    base = skeleton.offsets.to(motion.translations) * torch.tensor(fixed)[:, None]
    return base + above * (motion.translations - base)[:, list(twins)]


def _choose_flips(motion: Motion, twins: tuple[int, ...]) -> Tensor:
    """For each joint the number of its flip [J]: the labelling of the tree that costs least, found exactly.

    Costs add up from the leaves to the root; then each joint takes the flip that is best under its parent's.
    """
    skeleton = motion.skeleton
    local = rot.quaternion_to_matrix(motion.rotations.detach().double())
    cost = _OFFSET_COST * _offset_misfit(skeleton, twins) ** 2  # [J, 4]
    up = local[:, 0, 1]  # the world's up as the root sees it, [F, 3]; a mirror leaves it up
    cost[0] += _UPSIDE_DOWN_COST * ((up[:, None] * _FLIPS - up[:, None]) ** 2).sum(-1).mean(0)
    cost[0, 1:] += _CHANGE_COST
    cost[list(skeleton.chain(skeleton.pelvis)[:-1]), 1:] += _HELPER_COST
    alike = (local * local[:, list(twins)]).mean(0)  # [J, 3, 3]
    # mean |S_p L_twin S_c - L|^2 over frames, for each flip above and own flip: [J, 4, 4]
    links = 6 - 2 * torch.einsum("pk,jki,ci->jpc", _FLIPS, alike, _FLIPS)
    links = links + _CHANGE_COST * (1 - torch.eye(4, dtype=links.dtype))
    for joint in range(len(skeleton) - 1, 0, -1):
        cost[skeleton.parents[joint]] += (links[joint] + cost[joint]).amin(-1)
    chosen = [int(cost[0].argmin())]
    for joint in range(1, len(skeleton)):
        best = int((links[joint, chosen[skeleton.parents[joint]]] + cost[joint]).argmin())
        # twins must agree, or mirroring twice would not give the motion back
        chosen.append(chosen[twins[joint]] if twins[joint] < joint else best)
    return torch.tensor(chosen)


def _bone_pairs(skeleton: Skeleton, twins: tuple[int, ...], joint: int) -> list[tuple[Tensor, Tensor]]:
    """The bones [3] that leave a joint, each with the bone of its twin."""
    offsets = skeleton.offsets.double()
    pairs = [(offsets[c], offsets[twins[c]]) for c in skeleton.children[joint]]
    mine, other = ([o for j, o in skeleton.end_sites if j == n] for n in (joint, twins[joint]))
    if len(mine) == len(other) == 1:
        pairs.append((offsets.new_tensor(mine[0]), offsets.new_tensor(other[0])))
    return pairs


def _offset_misfit(skeleton: Skeleton, twins: tuple[int, ...]) -> Tensor:
    """How badly each flip maps a joint's bones onto those of its twin, [J, 4], 0 (well) to 1 (opposite)."""
    misfit = torch.zeros(len(skeleton), len(_FLIPS), dtype=torch.float64)
    for joint in range(len(skeleton)):
        pairs = _bone_pairs(skeleton, twins, joint)
        size = float(sum(a.norm() + b.norm() for a, b in pairs))
        if size > 1e-4:  # metres; shorter bones say nothing
            misfit[joint] = sum((a * _FLIPS - b).norm(dim=-1) for a, b in pairs) / size
    return misfit


def _check_bones(motion: Motion, twins: tuple[int, ...], chosen: Tensor) -> None:
    """Refuse a rig whose bones no flip maps onto their twins, rather than tear the body apart."""
    skeleton = motion.skeleton
    offsets = skeleton.offsets.double()
    for joint, parent in enumerate(skeleton.parents):
        if parent < 0 or any(c.endswith("position") for c in skeleton.channels[joint]):
            continue
        off = float((offsets[twins[joint]] * _FLIPS[chosen[parent]] - offsets[joint]).norm())
        if off > 0.1 * skeleton.height:
            raise MotionKitError(
                f"cannot mirror {skeleton!r}: the bone to {skeleton.names[joint]!r} is no mirror image of "
                f"the bone to {skeleton.names[twins[joint]]!r} ({off:.2f} m off); check the twins, or write "
                "the file with a rest pose that is alike on both sides"
            )
