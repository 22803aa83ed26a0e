"""Feet and the ground: when a foot stands, how much it slides, and how to hold it still."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from . import rotations as rot
from .errors import MotionKitError, check
from .motion import Motion

_STRETCH = 0.998  # of a leg's length: beyond it, a knee snaps straight within a frame


def feet_of(motion: Motion, feet: Sequence[str] | None = None) -> list[int]:
    """Numbers of the foot joints: by name, or those that the skeleton's names tell (`Skeleton.feet`).

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> [walk.skeleton.names[j] for j in feet_of(walk)]
    ['left_ankle', 'left_foot', 'right_ankle', 'right_foot']
    """
    skeleton = motion.skeleton
    return [skeleton.index(n) for n in feet] if feet is not None else list(skeleton.feet())


def foot_contacts(
    motion: Motion, feet: Sequence[str] | None = None, height: float = 0.03, speed: float = 0.25
) -> Tensor:
    """Which foot joints stand, frame by frame: bool [F, K], K as in `feet_of`.

    A joint stands while it is at most `height` metres above its own lowest level (the 2nd percentile over the clip, so
    an ankle is judged as an ankle) and moves at most `speed` metres a second. A single frame stands on height alone.

    >>> import motionkit as mk
    >>> foot_contacts(mk.load("data/actor/walk_neutral.bvh")).float().mean(0) > 0.3
    tensor([True, True, True, True])
    """
    joints = feet_of(motion, feet)
    if not len(motion):
        return torch.zeros(0, len(joints), dtype=torch.bool)
    places = motion.positions()[:, joints]
    level = torch.quantile(places[..., 1], 0.02, 0)
    low = places[..., 1] <= level + height
    if len(motion) == 1:
        return low
    steps = torch.linalg.vector_norm(places[1:] - places[:-1], dim=-1) * motion.fps
    # a frame's speed is the slower of the steps before and after it, so that first and last contact frames count
    before, after = torch.cat((steps[:1], steps)), torch.cat((steps, steps[-1:]))
    return low & (torch.minimum(before, after) <= speed)


def foot_sliding(motion: Motion, contacts: Tensor | None = None, feet: Sequence[str] | None = None) -> float:
    """How far planted feet move over the ground, in millimetres a frame; 0 where nothing stands.

    contacts: bool [F, K]; found by `foot_contacts` if left out, but give those of the source when you judge an edited
    clip, since a foot that slides fast no longer counts as standing. The mean is over all pairs of neighbouring frames
    in which a joint stands.

    >>> import motionkit as mk
    >>> foot_sliding(mk.load("data/actor/walk_neutral.bvh")) < 1.0
    True
    """
    joints = feet_of(motion, feet)
    contacts = _or_found(contacts, motion, joints, feet)
    places = motion.positions()[:, joints][..., [0, 2]]
    both = contacts[1:] & contacts[:-1]
    if not both.any():
        return 0.0
    return float(torch.linalg.vector_norm(places[1:] - places[:-1], dim=-1)[both].mean()) * 1000


def _or_found(contacts: Tensor | None, motion: Motion, joints: list[int], feet: Sequence[str] | None) -> Tensor:
    """Contacts as somebody gave them, of the shape that fits; found in the motion where nobody did."""
    if contacts is None:
        return foot_contacts(motion, feet)
    names = ", ".join(motion.skeleton.names[j] for j in joints)
    return check.shape("contacts", contacts, (len(motion), len(joints)), hint=f"; the feet are {names}").bool()


def two_bone_ik(motion: Motion, joints: tuple[int, int, int], target: Tensor) -> Motion:
    """Bend a limb so that its end reaches a place: hip, knee and ankle (or shoulder, elbow, wrist).

    joints: three joints, each the parent of the next. target: [F, 3] metres in the world; out of reach, the limb
    stretches towards it. The knee stays in its plane (a straight leg bends towards where the body faces); the end
    joint keeps its rotation in the world. Analytic, by the law of cosines. Returns the motion, nothing else changed.

    >>> import motionkit as mk
    >>> m = mk.load("data/actor/walk_neutral.bvh")
    >>> leg = tuple(m.skeleton.index(n) for n in ("left_hip", "left_knee", "left_ankle"))
    >>> there = m.positions()[:, leg[2]] + torch.tensor([0.0, 0.02, 0.0])
    >>> bool((two_bone_ik(m, leg, there).positions()[:, leg[2]] - there).abs().max() < 1e-3)
    True
    """
    hip, knee, ankle = joints
    skeleton = motion.skeleton
    if skeleton.parents[ankle] != knee or skeleton.parents[knee] != hip:
        names = ", ".join(skeleton.names[j] for j in joints)
        raise MotionKitError(f"two-bone IK needs three joints in a row; {names} are not parent and child")
    places, world = motion.positions(), motion.world_rotations()
    a, b, c = places[:, hip], places[:, knee], places[:, ankle]
    upper, lower = (b - a).norm(dim=-1), (c - b).norm(dim=-1)
    far = (target - a).norm(dim=-1).clamp(min=1e-6)
    reach = torch.minimum(torch.maximum(far, (upper - lower).abs() + 1e-4), upper + lower - 1e-6)
    axis = _bend_axis(motion, a, b, c)
    open_hip = _angle(upper, reach, lower) - _corner(c - a, b - a)
    open_knee = _angle(upper, lower, reach) - _corner(a - b, c - b)
    bend = rot.axis_angle_to_quaternion(axis, open_hip)
    swing = rot.rotation_between(c - a, target - a)
    turn_hip = rot.quaternion_multiply(swing, bend)
    turn_knee = rot.quaternion_multiply(turn_hip, rot.axis_angle_to_quaternion(axis, open_knee))
    changed = world.clone()
    changed[:, hip] = rot.quaternion_multiply(turn_hip, world[:, hip])
    changed[:, knee] = rot.quaternion_multiply(turn_knee, world[:, knee])
    return motion.replace(rotations=_relative(motion, joints, changed))


def _relative(motion: Motion, limb: tuple[int, int, int], world: Tensor) -> Tensor:
    """Local rotations [F, J, 4] with those of a limb, and of what branches off it, taken from `world` [F, J, 4]."""
    skeleton, local = motion.skeleton, motion.rotations.clone()
    for joint in {*limb, *skeleton.children[limb[0]], *skeleton.children[limb[1]]}:
        parent = skeleton.parents[joint]
        above = world[:, parent] if parent >= 0 else rot.identity_quaternion(len(motion), dtype=local.dtype)
        local[:, joint] = rot.quaternion_multiply(rot.quaternion_inverse(above), world[:, joint])
    return local


def _bend_axis(motion: Motion, a: Tensor, b: Tensor, c: Tensor) -> Tensor:
    """Unit axis [F, 3] at right angles to the limb's plane; a straight limb bends towards where the body faces."""
    axis = torch.linalg.cross(c - a, b - a)
    yaw = motion.facing()
    forward = torch.stack((torch.sin(yaw), torch.zeros_like(yaw), torch.cos(yaw)), -1)
    spare = torch.linalg.cross(c - a, forward)
    size = (c - a).norm(dim=-1, keepdim=True) * (b - a).norm(dim=-1, keepdim=True)
    return rot.normalize(torch.where(axis.norm(dim=-1, keepdim=True) > 1e-3 * size, axis, spare))


def _angle(first: Tensor, second: Tensor, opposite: Tensor) -> Tensor:
    """The angle between two sides of a triangle, from its three lengths."""
    return torch.acos(((first**2 + second**2 - opposite**2) / (2 * first * second).clamp(min=1e-9)).clamp(-1, 1))


def _corner(u: Tensor, v: Tensor) -> Tensor:
    return torch.atan2(torch.linalg.cross(u, v).norm(dim=-1), (u * v).sum(-1))


def lock_feet(
    motion: Motion, contacts: Tensor | None = None, blend: int = 5, feet: Sequence[str] | None = None
) -> Motion:
    """Hold planted feet still: each leg is bent so that the joint that stands stays where it is, at one height.

    contacts: bool [F, K], as in `foot_contacts` (found if left out). blend: frames over which the correction fades in
    before a contact and out after it. Per contact the place is chosen so that the legs are moved as little as can be;
    the height is the joint's median height over all its contacts. Where a leg is too short the pelvis sinks. Joints
    of the upper body keep their rotations. Needs hips, knees and ankles by name.

    >>> import motionkit as mk
    >>> m = mk.load("data/actor/walk_neutral.bvh")
    >>> skating = m.replace(translations=m.translations * torch.tensor([1.0, 1.0, 1.1]))
    >>> foot_sliding(lock_feet(skating, foot_contacts(m)), foot_contacts(m)) < 1.0
    True
    """
    joints = feet_of(motion, feet)
    contacts = _or_found(contacts, motion, joints, feet)
    legs = _legs(motion)
    if not legs or not contacts.any():
        return motion
    places = motion.positions()
    targets = []
    for _, _, ankle in legs:
        mine = [k for k, j in enumerate(joints) if ankle in motion.skeleton.ancestors(j)]
        foot, stands = places[:, [joints[k] for k in mine]], contacts[:, mine]
        across = _corrections(foot[..., [0, 2]], stands, blend)
        up = _height_corrections(foot[..., 1], stands, blend)
        targets.append(places[:, ankle] + torch.stack((across[:, 0], up, across[:, 1]), -1))
    return reach_with_legs(motion, legs, targets)


def reach_with_legs(motion: Motion, legs: list[tuple[int, int, int]], targets: list[Tensor]) -> Motion:
    """The motion with each leg's ankle where it is to be, by inverse kinematics; the pelvis sinks where legs are short.

    legs: (hip, knee, ankle) joints of each; targets: for each, where its ankle is to be, [F, 3] metres.

    >>> import motionkit as mk
    >>> m = mk.load("data/actor/walk_neutral.bvh")
    >>> leg = tuple(m.skeleton.index(f"left_{n}") for n in ("hip", "knee", "ankle"))
    >>> aside = m.positions()[:, leg[2]] + torch.tensor([0.05, 0.0, 0.0])
    >>> bool((reach_with_legs(m, [leg], [aside]).positions()[:, leg[2]] - aside).abs().max() < 1e-3)
    True
    """
    motion = lower_pelvis(motion, pelvis_drop(motion, legs, targets, motion.positions()))
    for leg, target in zip(legs, targets, strict=True):
        motion = two_bone_ik(motion, leg, target)
    return motion


def lower_pelvis(motion: Motion, drop: Tensor) -> Motion:
    """The motion with its pelvis, and all that hangs on it, `drop` [F] metres lower in the world.

    >>> import motionkit as mk
    >>> m = mk.load("data/actor/walk_neutral.bvh")
    >>> round(float((m.positions() - lower_pelvis(m, torch.full((len(m),), 0.1)).positions())[..., 1].mean()), 3)
    0.1
    """
    pelvis, translations = motion.skeleton.pelvis, motion.translations.clone()
    down = torch.stack((torch.zeros_like(drop), -drop, torch.zeros_like(drop)), -1)
    parent = motion.skeleton.parents[pelvis]
    if parent >= 0:
        down = rot.quaternion_rotate(rot.quaternion_inverse(motion.world_rotations()[:, parent]), down)
    translations[:, pelvis] = translations[:, pelvis] + down
    return motion.replace(translations=translations)


def _legs(motion: Motion) -> list[tuple[int, int, int]]:
    roles, parents = motion.skeleton.roles, motion.skeleton.parents
    legs = []
    for side in ("left", "right"):
        leg = tuple(roles.get(f"{side}_{r}", -1) for r in ("hip", "knee", "ankle"))
        if min(leg) >= 0 and parents[leg[2]] == leg[1] and parents[leg[1]] == leg[0]:
            legs.append(leg)
    return legs


def _corrections(places: Tensor, stands: Tensor, blend: int) -> Tensor:
    """How far to shift a leg's end, [F, 2], so that whichever of its joints stands does not move.

    places: [F, k, 2] of the leg's foot joints, from the ankle outwards; stands: bool [F, k]. While the foot rolls from
    one joint to the next, the shift goes on from where it was. Each contact's shift has mean 0, so it moves least.
    """
    frames = len(places)
    shift = places.new_zeros(frames, 2)
    weight = places.new_zeros(frames)
    steps = places[1:] - places[:-1]
    both = stands[1:] & stands[:-1]
    any_stands = stands.any(1)
    intervals = _intervals(any_stands)
    for start, stop in intervals:
        walk = places.new_zeros(stop - start, 2)
        for t in range(start + 1, stop):
            planted = both[t - 1].nonzero()[:, 0]
            move = steps[t - 1, planted[-1]] if len(planted) else places.new_zeros(2)  # the outermost: toes roll last
            walk[t - start] = walk[t - start - 1] - move
        shift[start:stop] = walk - walk.mean(0)
        weight[start:stop] = 1
    return _fade(shift, intervals, weight, blend)


def _height_corrections(heights: Tensor, stands: Tensor, blend: int) -> Tensor:
    """How far to lift a leg's end, [F] metres, so that whichever of its joints stands keeps one level.

    heights: [F, k] of the leg's foot joints, from the ankle outwards; stands: bool [F, k]. A joint's level is its
    median height while it stands, over the whole clip: the floor is flat.
    """
    lift, planted = heights.new_zeros(len(heights)), torch.zeros(len(heights))
    for k in range(heights.shape[1]):  # the outermost joint that stands has the last word
        here = stands[:, k]
        if here.any():
            lift[here] = heights[here, k].median() - heights[here, k]
            planted[here] = k + 1.0
    inside = stands.any(1)
    faded = _fade(lift[:, None], _intervals(inside), inside.to(heights.dtype), blend)[:, 0]
    weights = heights.new_tensor([1.0, 4.0, 6.0, 4.0, 1.0]) / 16
    padded = torch.nn.functional.pad(faded[None, None], (2, 2), mode="replicate")
    soft = torch.nn.functional.conv1d(padded, weights[None, None])[0, 0]
    changes = torch.nn.functional.pad((planted[1:] != planted[:-1]).float(), (1, 0))
    rolling = torch.nn.functional.max_pool1d(changes[None, None], 5, 1, 2)[0, 0] > 0  # from ankle to toe, or off it
    return torch.where(rolling, soft, faded)


def _intervals(flags: Tensor) -> list[tuple[int, int]]:
    """Runs of True in [F] as (first frame, first frame after)."""
    edges = torch.diff(torch.cat((flags.new_zeros(1), flags, flags.new_zeros(1))).int())
    return list(zip((edges == 1).nonzero()[:, 0].tolist(), (edges == -1).nonzero()[:, 0].tolist(), strict=True))


def _fade(shift: Tensor, intervals: list[tuple[int, int]], inside: Tensor, blend: int) -> Tensor:
    """Carry each interval's first and last shift into the frames around it, fading smoothly over `blend` frames."""
    result, frames = shift.clone(), len(shift)
    steps = torch.arange(1, blend + 1, dtype=shift.dtype) / (blend + 1)
    ease = 1 - steps * steps * (3 - 2 * steps)
    for start, stop in intervals:
        for edge, sign in ((start, -1), (stop - 1, 1)):
            for k in range(blend):
                t = edge + sign * (k + 1)
                if 0 <= t < frames and not inside[t]:
                    result[t] += ease[k] * shift[edge]
    return result


def pelvis_drop(motion: Motion, legs: list, targets: list[Tensor], places: Tensor) -> Tensor:
    """How far the pelvis must sink, [F] metres from 0 up, for both legs to reach; smoothed over a few frames.

    legs: (hip, knee, ankle) joints of each; targets: for each, where its ankle is to be, [F, 3] metres. places: the
    motion's positions [F, J, 3].

    >>> import motionkit as mk
    >>> m = mk.load("data/actor/walk_neutral.bvh")
    >>> leg, places = tuple(m.skeleton.index(f"left_{n}") for n in ("hip", "knee", "ankle")), m.positions()
    >>> deeper = places[:, leg[2]] - torch.tensor([0.0, 0.2, 0.0])
    >>> bool(pelvis_drop(m, [leg], [deeper], places).mean() > 0.1)
    True
    """
    drop = places.new_zeros(len(motion))
    for (hip, knee, ankle), target in zip(legs, targets, strict=True):
        length = (places[:, knee] - places[:, hip]).norm(dim=-1) + (places[:, ankle] - places[:, knee]).norm(dim=-1)
        gap = places[:, hip] - target
        level = (gap[:, 0] ** 2 + gap[:, 2] ** 2).clamp(max=0.81 * length**2)
        straight = (places[:, ankle] - places[:, hip]).norm(dim=-1)  # a leg that was straighter may stay so
        most = torch.maximum(_STRETCH * length, straight).minimum(0.99999 * length)
        allowed = torch.sqrt(most**2 - level)
        drop = torch.maximum(drop, (gap[:, 1] - allowed).clamp(min=0))
    if float(drop.max()) <= 0:
        return drop
    radius = max(1, round(motion.fps * 0.1))
    padded = torch.nn.functional.pad(drop[None, None], (radius, radius), mode="replicate")
    return hann_smooth(torch.nn.functional.max_pool1d(padded, 2 * radius + 1, 1)[0].T, radius)[:, 0]


def hann_smooth(curves: Tensor, radius: int) -> Tensor:
    """A running mean over time of curves [F, C], `radius` frames to either side under a Hann window; the ends hold.

    >>> hann_smooth(torch.tensor([[0.0], [0.0], [4.0], [0.0], [0.0]]), 1)[:, 0]
    tensor([0., 1., 2., 1., 0.])
    """
    weights = torch.hann_window(2 * radius + 3, periodic=False, dtype=curves.dtype)[1:-1]
    padded = torch.nn.functional.pad(curves.T[:, None], (radius, radius), mode="replicate")
    return torch.nn.functional.conv1d(padded, (weights / weights.sum())[None, None])[:, 0].T
