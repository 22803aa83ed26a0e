"""One skeleton turned as another turns, from the T-pose of both."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from .. import kinematics
from .. import rotations as rot
from ..errors import MotionKitError
from ..motion import Motion
from ..skeleton import Skeleton
from .ground import stand
from .matching import SIDES, Body, Links, body_of, match_joints, shared_roles
from .neutral import neutral


def retarget(
    motion: Motion,
    skeleton: Skeleton | Motion,
    names: Mapping[str, str | None] | None = None,
    *,
    scale: float | None = None,
    feet: bool = True,
) -> Motion:
    """The motion on another human skeleton: same turns from T-pose, the other's bone lengths, feet on the ground.

    skeleton: the target's; or a Motion on it, which also tells how its joints are turned where its rest pose is no
    standing body (Bandai's is not). Joints are paired by their names and their place in the body; names, a table
    {"target joint": "source joint" or None}, goes before that, and a joint with None keeps still against the joint it
    hangs on. scale: of the way travelled; left out, how much longer the target's legs are. feet: keep feet that stand
    in the source standing, at the height of the target's soles, by small moves of pelvis and legs; False leaves all
    joint angles alone. Returns a Motion of as many frames on the target skeleton, metres. Raises MotionKitError where
    hips, knees, ankles, shoulders or elbows are not found, and shows how the table would name them.

    >>> import motionkit as mk
    >>> from motionkit.skeleton import smpl
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> mk.retarget(walk, smpl()).skeleton
    Skeleton(22 joints, root 'pelvis', height 1.74 m)
    """
    clip, whole = (skeleton.body(), skeleton.skeleton) if isinstance(skeleton, Motion) else (None, skeleton)
    _check(motion, whole, scale)
    names, origin = dict(names or {}), motion.body()
    hollow = whole if whole.pelvis == 0 else whole.part(whole.below(whole.pelvis))
    roles = shared_roles(origin.skeleton, hollow, names)
    source = body_of(origin.skeleton, _bones(origin), roles[0])
    target = body_of(hollow, _bones(clip) if clip else hollow.offsets, roles[1])
    links, stance = match_joints(source, target, names), neutral(source, origin)
    upright = stance, stance if _same_rig(source, target) else neutral(target, clip)
    scale = _leg_ratio(source, target) if scale is None else float(scale)
    result = _posed(origin, source, target, links, upright, scale)
    if feet and len(motion):
        result = stand(result, origin, target, source, links, scale)
    return _on_whole(result, whole).replace(name=motion.name, metres_per_unit=motion.metres_per_unit)


def _check(motion: Motion, whole: Skeleton, scale: float | None) -> None:
    if not isinstance(motion, Motion) or not isinstance(whole, Skeleton):
        raise MotionKitError(
            "retarget: expected a Motion and a Skeleton (or a Motion on it); "
            f"found {type(motion).__name__} and {type(whole).__name__}"
        )
    if scale is not None and not 0 < scale < float("inf"):
        raise MotionKitError(f"retarget: scale must be above 0, 1 to keep the way as long as it is; found {scale!r}")


def _bones(motion: Motion) -> Tensor:
    """Offsets [J, 3] in metres as the clip has them: a captured joint may be placed frame by frame."""
    return motion.translations.median(0).values if len(motion) else motion.skeleton.offsets


def _same_rig(source: Body, target: Body) -> bool:
    """Whether both have the same joints and every bone at rest points the same way, whatever its length."""
    if not source.skeleton.same_tree(target.skeleton):
        return False
    a, b = (rot.normalize(_offsets(body)) for body in (source, target))
    return bool(torch.linalg.vector_norm(a - b, dim=-1).max() < 1e-3)


def _offsets(body: Body) -> Tensor:
    """Every joint's place [J, 3] from its parent at rest, metres; the pelvis' is 0."""
    parents = [max(p, 0) for p in body.skeleton.parents]
    return body.places - body.places[parents]


def _leg_ratio(source: Body, target: Body) -> float:
    """How much longer the target's legs are, hip to ankle; 1 where a leg was left out."""
    legs = [
        sum(body.bone(f"{s}_{a}", f"{s}_{b}") for s in SIDES for a, b in (("hip", "knee"), ("knee", "ankle")))
        if all(f"{s}_{r}" in body.roles for s in SIDES for r in ("hip", "knee", "ankle"))
        else 0.0
        for body in (source, target)
    ]
    return legs[1] / legs[0] if min(legs) > 0 else 1.0


def _posed(
    origin: Motion, source: Body, target: Body, links: Links, upright: tuple[Tensor, Tensor], scale: float
) -> Motion:
    """The target's motion from turns alone, with the middle of its hips where the source's are, times the scale."""
    dtype = origin.rotations.dtype
    against = [rot.quaternion_inverse(upright[0]).to(dtype), upright[1].to(dtype)]
    turned = rot.quaternion_multiply(origin.world_rotations(), against[0])  # since T-pose, in the world: [F, Js, 4]
    since: list[Tensor] = []
    for joint, link in enumerate(links):
        since.append(_mean_turn(turned, link) if link else since[target.skeleton.parents[joint]])
    world = rot.quaternion_multiply(torch.stack(since, 1), against[1])
    local = kinematics.local_rotations(target.skeleton, world)
    hips = [_hips(body).to(dtype) for body in (source, target)]
    pelvis = origin.translations[:, 0] + rot.quaternion_rotate(origin.rotations[:, 0], hips[0])
    root = pelvis * scale - rot.quaternion_rotate(local[:, 0], hips[1])
    translations = _offsets(target).to(dtype).expand(len(root), -1, -1).clone()
    translations[:, 0] = root
    return Motion(target.skeleton, rot.unroll(local), translations, origin.fps)


def _hips(body: Body) -> Tensor:
    """The middle between the hip joints [3], seen from the pelvis."""
    hips = [body.places[body.roles[f"{s}_hip"]] for s in SIDES if f"{s}_hip" in body.roles]
    return torch.stack(hips).mean(0) if len(hips) == 2 else torch.zeros(3, dtype=torch.float64)


def _mean_turn(turned: Tensor, link: dict[int, float]) -> Tensor:
    """The weighted mean [F, 4] of some joints' turns [F, J, 4]; they are close to each other."""
    first = turned[:, next(iter(link))]
    if len(link) == 1:
        return first
    total = torch.zeros_like(first)
    for joint, weight in link.items():
        q = turned[:, joint]
        total = total + weight * torch.where((q * first).sum(-1, keepdim=True) < 0, -q, q)
    return rot.normalize(total)


def _on_whole(body: Motion, whole: Skeleton) -> Motion:
    """The motion with the helper joints above the pelvis that the target has, still; one of them, or it, travels."""
    if whole.pelvis == 0:
        return body.replace(skeleton=whole)
    rest = rot.identity_quaternion(len(body), len(whole), dtype=body.rotations.dtype)
    still = Motion.from_root(whole, rest, whole.offsets[0].to(rest).expand(len(body), 3), body.fps)
    moved = still.with_body(body)
    if any(c.endswith("position") for c in whole.channels[whole.pelvis]):
        return moved
    above = list(whole.chain(whole.pelvis)[1:])  # the pelvis cannot be placed frame by frame: its root can
    root = body.translations[:, 0] - whole.offsets[above].sum(0).to(rest)
    translations = moved.translations.clone()
    translations[:, 0], translations[:, whole.pelvis] = root, whole.offsets[whole.pelvis].to(rest)
    return moved.replace(translations=translations)
