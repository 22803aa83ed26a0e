"""A motion on another human skeleton: the same turns from T-pose, the other's bone lengths, feet on the ground.

`retarget` goes four ways: joints of both bodies are paired by the part they play (`match_joints`); each body is stood
into T-pose (`rest_pose`), whatever its rest pose is; turns since T-pose are carried over; and feet that stand in the
source are made to stand (`plant_feet`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from . import kinematics
from . import rotations as rot
from .contacts import foot_contacts, hann_smooth, reach_with_legs
from .errors import MotionKitError
from .motion import Motion
from .skeleton import LEFT, MIDDLE, RIGHT, Skeleton, split_sides

SIDES = (LEFT, RIGHT)
LEG = ("hip", "knee", "ankle")
NEEDED = tuple(f"{side}_{part}" for side in SIDES for part in (*LEG, "shoulder", "elbow"))

_LEG_LEAST, _ARM_LEAST = 0.5, -0.3  # cosine to its T-pose of a bone in a rest pose that is a body's: arms may hang
_LEAST_BEND = 0.05  # mean sine of a knee's or elbow's angle: straighter, it does not tell where it bends
_FLAT = (0.0, 60.0)  # degrees below level that a foot's bone may point at rest for the sole to be flat
_SLOPE = 30.0  # degrees, of a foot's bone where neither the rest pose nor a clip tells
_SOLE = 0.05  # of the height: a toe that is higher at rest does not stand on the ground there

Links = list[dict[int, float]]  # for each target joint the source joints it follows, with weights that sum to 1


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
    clip = skeleton.without_helper_joints() if isinstance(skeleton, Motion) else None
    whole = skeleton.skeleton if isinstance(skeleton, Motion) else skeleton
    if not isinstance(motion, Motion) or not isinstance(whole, Skeleton):
        raise MotionKitError(
            "retarget: expected a Motion and a Skeleton (or a Motion on it); "
            f"found {type(motion).__name__} and {type(whole).__name__}"
        )
    if scale is not None and not 0 < scale < float("inf"):
        raise MotionKitError(f"retarget: scale must be above 0, 1 to keep the way as long as it is; found {scale!r}")
    names, origin = dict(names or {}), motion.without_helper_joints()
    body = whole if whole.pelvis == 0 else whole.subtree(whole.descendants(whole.pelvis))
    roles = shared_roles(origin.skeleton, body, names)
    source = find_body(origin.skeleton, _bones(origin), roles[0])
    target = find_body(body, body.offsets if clip is None else _bones(clip), roles[1])
    links, stance = match_joints(source, target, names), rest_pose(source, origin)
    upright = stance, stance if _same_rig(source, target) else rest_pose(target, clip)
    if scale is None:
        legs = _leg_length(source), _leg_length(target)
        scale = legs[1] / legs[0] if min(legs) > 0 else 1.0
    result = _carry_turns(origin, source, target, links, upright, float(scale))
    if feet and len(motion):
        result = plant_feet(result, origin, target, source, links, float(scale))
    return _on_whole(result, whole).replace(name=motion.name, metres_per_unit=motion.metres_per_unit)


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


def _leg_length(body: Body) -> float:
    """Of both legs, hip to ankle, metres; 0 where a joint was left out."""
    if any(len(body.both(part)) < 2 for part in LEG):
        return 0.0
    ends = [(body.roles[f"{side}_{a}"], body.roles[f"{side}_{b}"]) for side in SIDES for a, b in zip(LEG, LEG[1:])]
    return sum(float((body.places[b] - body.places[a]).norm()) for a, b in ends)


def _carry_turns(
    origin: Motion, source: Body, target: Body, links: Links, upright: tuple[Tensor, Tensor], scale: float
) -> Motion:
    """The target's motion from turns alone, with the middle of its hips where the source's are, times the scale."""
    dtype = origin.rotations.dtype
    against = [rot.quaternion_inverse(upright[0]).to(dtype), upright[1].to(dtype)]
    turns = rot.quaternion_multiply(origin.world_rotations(), against[0])  # since T-pose, in the world: [F, Js, 4]
    carried: list[Tensor] = []
    for joint, link in enumerate(links):
        carried.append(_mean_turn(turns, link) if link else carried[target.skeleton.parents[joint]])
    world = rot.quaternion_multiply(torch.stack(carried, 1), against[1])
    local = kinematics.local_rotations(target.skeleton, world)
    hips = [_middle(body, body.both("hip")).to(dtype) for body in (source, target)]
    pelvis = origin.translations[:, 0] + rot.quaternion_rotate(origin.rotations[:, 0], hips[0])
    root = pelvis * scale - rot.quaternion_rotate(local[:, 0], hips[1])
    translations = _offsets(target).to(dtype).expand(len(root), -1, -1).clone()
    translations[:, 0] = root
    return Motion(target.skeleton, rot.quaternion_unroll(local), translations, origin.fps)


def _middle(body: Body, hips: list[int]) -> Tensor:
    """The middle between the hip joints [3], seen from the pelvis."""
    return body.places[hips].mean(0) if len(hips) == 2 else torch.zeros(3, dtype=torch.float64)


def _mean_turn(turns: Tensor, link: dict[int, float]) -> Tensor:
    """The weighted mean [F, 4] of some joints' turns [F, J, 4]; they are close to each other."""
    first = turns[:, next(iter(link))]
    if len(link) == 1:
        return first
    total = torch.zeros_like(first)
    for joint, weight in link.items():
        q = turns[:, joint]
        total = total + weight * torch.where((q * first).sum(-1, keepdim=True) < 0, -q, q)
    return rot.normalize(total)


def _on_whole(body: Motion, whole: Skeleton) -> Motion:
    """The motion with the helper joints above the pelvis that the target has, still; one of them, or it, travels."""
    if whole.pelvis == 0:
        return body.replace(skeleton=whole)
    rest = rot.identity_quaternion(len(body), len(whole), dtype=body.rotations.dtype)
    still = Motion.from_root(whole, rest, whole.offsets[0].to(rest).expand(len(body), 3), body.fps)
    moved = still.with_helper_joints_of(body)
    if any(c.endswith("position") for c in whole.channels[whole.pelvis]):
        return moved
    above = list(whole.ancestors(whole.pelvis)[1:])  # the pelvis cannot be placed frame by frame: its root can
    root = body.translations[:, 0] - whole.offsets[above].sum(0).to(rest)
    translations = moved.translations.clone()
    translations[:, 0], translations[:, whole.pelvis] = root, whole.offsets[whole.pelvis].to(rest)
    return moved.replace(translations=translations)


@dataclass(frozen=True)
class Body:
    """A skeleton whose root is the pelvis, at rest: joints by the part they play, and where they are.

    places: [J, 3] metres, every joint unturned. spine: midline joints above the pelvis up to the chest, where the arms
    leave. neck: those above the chest, the head last. collars: for each side the joints between chest and shoulder.
    """

    skeleton: Skeleton
    places: Tensor
    roles: dict[str, int]
    spine: list[int]
    neck: list[int]
    collars: dict[str, list[int]]

    @property
    def chest(self) -> int:
        """The joint from which the arms leave."""
        return self.spine[-1] if self.spine else 0

    def both(self, part: str) -> list[int]:
        """The left and the right joint that play a part, those that there are."""
        return [self.roles[f"{side}_{part}"] for side in SIDES if f"{side}_{part}" in self.roles]

    def limb(self, side: str, *parts: str) -> list[int]:
        """The joints of a side that play these parts; none where one of them is missing."""
        roles = [f"{side}_{part}" for part in parts]
        return [self.roles[role] for role in roles] if all(role in self.roles for role in roles) else []


def find_body(skeleton: Skeleton, offsets: Tensor, roles: dict[str, int]) -> Body:
    """The `Body` of a skeleton with its pelvis as root; offsets [J, 3] metres from the parents, roles by number."""
    places = [torch.zeros(3, dtype=torch.float64)]
    for joint, parent in enumerate(skeleton.parents[1:], 1):
        places.append(places[parent] + offsets[joint].double())
    spine, neck = _find_trunk(skeleton, roles)
    chest, collars = spine[-1] if spine else 0, {}
    for side in SIDES:
        path = skeleton.ancestors(roles[f"{side}_shoulder"]) if f"{side}_shoulder" in roles else ()
        collars[side] = list(path[path.index(chest) + 1 : -1]) if chest in path else []
    return Body(skeleton, torch.stack(places), roles, spine, neck, collars)


def _find_trunk(skeleton: Skeleton, roles: dict[str, int]) -> tuple[list[int], list[int]]:
    """Midline joints above the pelvis up to the chest, where the arms leave, and those above it (neck, head)."""
    left, right = roles.get("left_shoulder"), roles.get("right_shoulder")
    if left is None or right is None:
        return [], []
    shared = [a for a, b in zip(skeleton.ancestors(left), skeleton.ancestors(right), strict=False) if a == b]
    if skeleton.pelvis not in shared:
        return [], []
    spine = shared[shared.index(skeleton.pelvis) + 1 :]
    above, joint = [], shared[-1]
    arms = {*skeleton.ancestors(left), *skeleton.ancestors(right)}
    while ahead := [c for c in skeleton.children[joint] if skeleton.sides[c] == MIDDLE and c not in arms]:
        joint = ahead[0]
        above.append(joint)
    return spine, above


def shared_roles(
    source: Skeleton, target: Skeleton, names: Mapping[str, str | None]
) -> tuple[dict[str, int], dict[str, int]]:
    """Joint numbers by role on both skeletons; where the table pairs two joints, the known one names the other."""
    mine, theirs = dict(source.roles), dict(target.roles)
    for to, wanted in names.items():
        joint = target.index(to)
        if wanted is None:
            continue
        other = source.index(wanted)
        theirs = {r: j for r, j in theirs.items() if j != joint or mine.get(r) == other or r not in mine}
        role = next((r for r, j in mine.items() if j == other), None) or next(
            (r for r, j in theirs.items() if j == joint), None
        )
        if role is not None:
            mine[role], theirs[role] = other, joint
    return mine, theirs


def match_joints(source: Body, target: Body, names: Mapping[str, str | None]) -> Links:
    """For each target joint the source joints it follows, with their weights; none: it follows the joint it hangs on.

    The table goes first, then the parts that names tell (`skeleton.find_roles`), then spine, neck and collars by their
    place along the chain, then joints that share side and name. Raises MotionKitError where arms or legs are missing.

    >>> from motionkit.skeleton import smpl
    >>> person = find_body(smpl(), smpl().offsets, smpl().roles)
    >>> match_joints(person, person, {"head": None})[12:16]
    [{12: 1.0}, {13: 1.0}, {14: 1.0}, {}]
    """
    links: Links = [{} for _ in target.skeleton.names]
    links[0] = {0: 1.0}
    for role, joint in target.roles.items():
        if role in source.roles:
            links[joint] = {source.roles[role]: 1.0}
    for (joints, lengths), (followed, other_lengths) in zip(_chains(target), _chains(source), strict=True):
        for joint, weights in zip(joints, _shares(lengths, other_lengths), strict=True):
            links[joint] = {followed[n]: w for n, w in weights.items()}
    used = {j for link in links for j in link}
    alike = {key: j for j, key in enumerate(zip(*split_sides(source.skeleton.names), strict=True))}
    for joint, key in enumerate(zip(*split_sides(target.skeleton.names), strict=True)):
        if not links[joint] and alike.get(key, 0) not in {0, *used}:
            links[joint] = {alike[key]: 1.0}
    for to, wanted in names.items():
        links[target.skeleton.index(to)] = {} if wanted is None else {source.skeleton.index(wanted): 1.0}
    _check_match(source, target, names)
    return links


def _chains(body: Body) -> list[tuple[list[int], list[float]]]:
    """Spine, neck and both collars, each with the lengths of its bones in metres, the last one to where it ends."""
    collars = [(body.collars[side], [body.roles.get(f"{side}_shoulder", 0)]) for side in SIDES]
    chains = []
    for chain, end in [(body.spine, body.both("shoulder")), (body.neck, body.neck[-1:]), *collars]:
        places = torch.cat((body.places[chain], body.places[end].mean(0, True))) if chain else body.places[:0]
        chains.append((chain, torch.linalg.vector_norm(places[1:] - places[:-1], dim=-1).tolist()))
    return chains


def _shares(target: Sequence[float], source: Sequence[float]) -> Links:
    """For each bone of one chain the bones of the other beside it, weighted by the length they share.

    The last bone follows the last one alone: chest, head and the collar's end keep their own turn.
    """
    if not source:
        return [{} for _ in target]
    ends, others = _ends(target), _ends(source)
    links: Links = []
    for start, stop in zip(ends, ends[1:]):
        both = [min(stop, b) - max(start, a) for a, b in zip(others, others[1:])]
        weights = {n: w / (stop - start) for n, w in enumerate(both) if w > 1e-4 * (stop - start)}
        links.append({n: w / sum(weights.values()) for n, w in weights.items()})
    return links[:-1] + [{len(source) - 1: 1.0}] if links else []


def _ends(lengths: Sequence[float]) -> list[float]:
    """Where along a chain, from 0 to 1, its bones begin and end; a bone of no length gets a sliver."""
    least = 1e-3 * max(sum(lengths), 1e-6)
    total, ends = sum(max(x, least) for x in lengths), [0.0]
    for x in lengths:
        ends.append(ends[-1] + max(x, least) / total)
    return ends


def _check_match(source: Body, target: Body, names: Mapping[str, str | None]) -> None:
    """Refuse what would come out as another body than the one that moved, and show the table that would help."""
    left_out = {target.skeleton.index(to) for to, wanted in names.items() if wanted is None}
    missing = [
        role
        for role in NEEDED
        if not (role in source.roles and role in target.roles) and target.roles.get(role) not in left_out
    ]
    if not missing:
        return
    free = []
    for body in (source, target):
        if any(role not in body.roles for role in missing):
            rest = [name for n, name in enumerate(body.skeleton.names) if n not in body.roles.values()]
            more = f" and {len(rest) - 8} more" if len(rest) > 8 else ""  # a creature may have dozens
            free.append(", ".join(rest[:8]) + more)

    def name(body: Body, role: str, what: str) -> str:
        return repr(body.skeleton.names[body.roles[role]] if role in body.roles else f"{what} joint for {role}")

    table = ", ".join(f"{name(target, r, 'target')}: {name(source, r, 'source')}" for r in missing)
    raise MotionKitError(
        f"retarget: expected hips, knees, ankles, shoulders and elbows of both sides on both skeletons; "
        f"not found: {', '.join(missing)}. Say which joints they are with mk.retarget(clip, to, names={{{table}}}), or "
        f"give None for a joint to leave out. Joints that play no part yet: {'; '.join(free)}"
    )


def rest_pose(body: Body, motion: Motion | None = None) -> Tensor:
    """World rotations [J, 4] of a rig's joints when it stands in T-pose, upright, facing +Z, with flat soles.

    motion: a clip on the body's skeleton, needed only for rigs whose rest pose is no standing body.

    >>> from motionkit.skeleton import smpl
    >>> upright = rest_pose(find_body(smpl(), smpl().offsets, smpl().roles))
    >>> bool(rot.quaternion_angle(upright, rot.identity_quaternion(22, dtype=upright.dtype)).max() < 0.25)
    True
    """
    aims, arms, clip = _aims(body), body.both("shoulder"), None
    if motion is not None and len(motion) and not _stands(body, aims):
        clip = motion.positions().double(), motion.world_rotations().double()
    turns = [_pelvis(body)]
    for joint in range(1, len(body.skeleton)):
        parent = body.skeleton.parents[joint]
        turn, axis = turns[parent], _vector(0.0, 1.0, 0.0)
        if joint in aims:
            end, axis = aims[joint]
            turn = turns[body.chest] if joint in arms else turn  # a sloping collar would twist the arm
            turn = _turn_to(turn, body.places[end] - body.places[joint], axis)
        elif joint in body.spine[:1]:
            turn = rot.quaternion_multiply(_quarter(axis, _shoulders_against_hips(body, turn)), turn)
        if clip is not None:
            twist = _hinge_twist(body, joint, turn, axis, *clip)
            twist = twist if twist is not None else _trunk_twist(body, joint, turn, axis, turns[parent], clip[1])
            turn = rot.quaternion_multiply(_quarter(axis, twist), turn)
        turns.append(turn)
        _lay_foot_flat(body, joint, turns, clip)
    return torch.stack(turns)


def _vector(*xyz: float) -> Tensor:
    return torch.tensor(xyz, dtype=torch.float64)


def _aims(body: Body) -> dict[int, tuple[int, Tensor]]:
    """For each joint of a limb the joint its bone leads to, and where that bone points in T-pose."""
    aims: dict[int, tuple[int, Tensor]] = {}
    arm = ("shoulder", "elbow", "wrist")
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        out = _vector(sign, 0.0, 0.0)
        for parts, axis in ((LEG, _vector(0.0, -1.0, 0.0)), (arm, out)):
            for bone in zip(parts, parts[1:]):
                if ends := body.limb(side, *bone):
                    aims[ends[0]] = ends[1], axis
        chain = body.collars[side]
        for joint, after in zip(chain, [*chain[1:], body.roles.get(f"{side}_shoulder", -1)]):
            aims[joint] = after, out
    return aims


def _stands(body: Body, aims: dict[int, tuple[int, Tensor]]) -> bool:
    """Whether the rest pose is that of a standing body, whatever the arms do: then it tells all turns by itself."""
    upright = _pelvis(body)
    for joint, (end, aim) in aims.items():
        bone = rot.normalize(rot.quaternion_rotate(upright, body.places[end] - body.places[joint]))
        if float(bone @ aim) < (_LEG_LEAST if float(aim[1]) else _ARM_LEAST):
            return False
    return abs(_shoulders_against_hips(body, upright)) < math.pi / 4


def _pelvis(body: Body) -> Tensor:
    """The pelvis' turn [4] from rest: hips level along x, and the line up to the neck along y."""
    shoulders, hips = body.both("shoulder"), body.both("hip")
    top = body.places[shoulders].mean(0) if shoulders else _vector(0.0, 1.0, 0.0)
    if body.neck or body.spine:
        top = body.places[(body.neck or body.spine[-1:])[0]]
    across = _vector(1.0, 0.0, 0.0)
    if len(hips) == 2:
        across = rot.normalize(body.places[hips[0]] - body.places[hips[1]])
    up = rot.normalize(top - across * (top @ across))
    return rot.matrix_to_quaternion(torch.stack((across, up, torch.linalg.cross(across, up))))


def _turn_to(turn: Tensor, bone: Tensor, aim: Tensor) -> Tensor:
    """The turn [4] with the shortest one added that brings a bone [3] to its aim [3]; half a turn goes sideways."""
    now = rot.normalize(rot.quaternion_rotate(turn, bone))
    if float(now @ aim) < -0.99:
        turn = rot.quaternion_multiply(turn.new_tensor([0.0, 0.0, 0.0, 1.0]), turn)
        now = rot.normalize(rot.quaternion_rotate(turn, bone))
    if float(now.norm()) == 0:
        return turn
    return rot.quaternion_multiply(rot.rotation_between(now, aim), turn)


def _quarter(axis: Tensor, angle: float) -> Tensor:
    """The rotation [4] about an axis by the number of quarter turns nearest to an angle in radians."""
    nearest = round(angle / (math.pi / 2)) * (math.pi / 2)
    return rot.axis_angle_to_quaternion(axis, axis.new_tensor(nearest))


def _angle_about(axis: Tensor, start: Tensor, end: Tensor) -> float:
    """Signed angle in radians about an axis [3] from one direction [3] to another."""
    return math.atan2(float(torch.linalg.cross(start, end) @ axis), float(start @ end - (start @ axis) * (end @ axis)))


def _shoulders_against_hips(body: Body, turn: Tensor) -> float:
    """The angle about the trunk that brings the shoulders, at rest, in line with the hips."""
    ends = [(body.collars[s] or [body.roles.get(f"{s}_shoulder", -1)])[0] for s in SIDES]
    if min(ends) < 0:
        return 0.0
    across = rot.quaternion_rotate(turn, body.places[ends[0]] - body.places[ends[1]])
    return _angle_about(_vector(0.0, 1.0, 0.0), across, _vector(1.0, 0.0, 0.0))


def _hinge_twist(body: Body, joint: int, turn: Tensor, axis: Tensor, places: Tensor, world: Tensor) -> float | None:
    """The angle about its bone by which a thigh's, shin's or upper arm's turn is off, from where knee or elbow bends.

    0 where the clip holds the limb straight; None for other joints. places [F, J, 3], world [F, J, 4]: the clip.
    """
    role = next((r for r, j in body.roles.items() if j == joint), "")
    side, _, part = role.partition("_")
    limb = body.limb(side, *(("shoulder", "elbow", "wrist") if part == "shoulder" else LEG))
    if part not in ("hip", "knee", "shoulder") or not limb:
        return None
    a, b, c = (places[:, joint] for joint in limb)
    hinge = torch.linalg.cross(rot.normalize(b - a), rot.normalize(c - b))
    mean = rot.quaternion_rotate(rot.quaternion_inverse(world[:, joint]), hinge).mean(0)
    if float(mean.norm()) < _LEAST_BEND:
        return 0.0
    expected = _vector(1.0, 0.0, 0.0)
    if part == "shoulder":  # in T-pose a forearm bends ahead, about the vertical
        expected = _vector(0.0, -1.0 if side == SIDES[0] else 1.0, 0.0)
    return _angle_about(axis, rot.quaternion_rotate(turn, mean), expected)


def _trunk_twist(body: Body, joint: int, turn: Tensor, axis: Tensor, above: Tensor, world: Tensor) -> float:
    """The angle about its bone by which a midline joint's or a collar's turn is off, from how it stands on average.

    above: the T-pose [4] of the joint it hangs on. world: [F, J, 4] of the clip. 0 for other joints.
    """
    if joint not in (*body.spine, *body.neck, *body.collars[SIDES[0]], *body.collars[SIDES[1]]):
        return 0.0
    parent = world[:, body.skeleton.parents[joint]]
    parent = rot.quaternion_multiply(parent, rot.quaternion_inverse(above))
    mine = rot.quaternion_multiply(world[:, joint], rot.quaternion_inverse(turn))
    relative = rot.quaternion_multiply(rot.quaternion_inverse(parent), mine)
    ahead = _vector(0.0, 0.0, 1.0)
    return _angle_about(axis, ahead, rot.quaternion_rotate(relative, ahead.expand(len(world), 3)).mean(0))


def _lay_foot_flat(body: Body, joint: int, turns: list[Tensor], clip: tuple[Tensor, Tensor] | None) -> None:
    """Turn an ankle, or a toe, whose rest pose has no flat foot (say, one that goes on down the shin)."""
    for side in SIDES:
        foot = body.limb(side, "ankle", "toe")
        if joint not in foot:
            continue
        ankle, toe = foot
        bone = body.places[toe] - body.places[ankle]
        at_rest = rot.quaternion_rotate(turns[body.skeleton.parents[ankle]], bone)
        slope = math.degrees(math.atan2(-float(at_rest[1]), float(at_rest[2])))
        if _FLAT[0] <= slope <= _FLAT[1]:
            continue
        down = math.radians(_SLOPE if joint == ankle else 0.0)
        if clip is not None:
            down = _stance_slope(clip[0][:, foot, 1], rot.quaternion_rotate(clip[1][:, joint], bone))
        turns[joint] = _turn_to(turns[joint], bone, _vector(0.0, -math.sin(down), math.cos(down)))


def _stance_slope(heights: Tensor, bone: Tensor) -> float:
    """The angle below level, radians, of a bone [F, 3] while ankle and toe, at heights [F, 2], are at their lowest."""
    low = heights <= torch.quantile(heights, 0.02, 0) + 0.01
    flat = low.all(1) if bool(low.all(1).any()) else low[:, 1]
    return float(torch.asin((-bone[flat, 1] / bone[flat].norm(dim=-1)).clamp(-1, 1)).median())


def plant_feet(result: Motion, origin: Motion, target: Body, source: Body, links: Links, scale: float) -> Motion:
    """The result with planted feet moved as the source's move, times `scale`: mostly not at all.

    result, origin: motions on the two bodies' skeletons, the pelvis as root. Between contacts the correction passes
    smoothly from one to the next. The pelvis takes what both legs share, IK the rest. Where no leg has feet on both
    bodies, the motion is returned as it is.
    """
    pairs = _foot_pairs(target, source, links)
    if not pairs:
        return result
    flat = [p for foot in pairs for p in foot]
    contacts = foot_contacts(origin, [source.skeleton.names[s] for _, s in flat])
    before = origin.positions()[:, [s for _, s in flat]] * scale
    gaps = result.positions()[:, [t for t, _ in flat]] - before  # [F, K, 3]: constant while a foot does not slide
    columns = torch.arange(len(flat)).split([len(foot) for foot in pairs])
    outer = [int(c[-1]) for c in columns]
    heights, stands = before[:, outer, 1], contacts[:, outer]
    ground = float(torch.quantile(heights[stands] if bool(stands.any()) else heights.flatten(), 0.02))
    sole, other_sole = _sole(target, [foot[-1][0] for foot in pairs]), _sole(source, [foot[-1][1] for foot in pairs])
    # outer foot joints stand as much higher as at rest, or else as high as the source's
    level = 0.0 if sole is None else sole - (ground if other_sole is None else other_sole * scale)
    shifts = [_correction(gaps[:, c], contacts[:, c], level) for c in columns]
    for n, shift in enumerate(shifts):  # a longer foot dips deeper as it swings: no deeper than to the ground
        under = heights[:, n].clamp(max=ground) + level - (heights[:, n] + gaps[:, outer[n], 1] + shift[:, 1])
        shift[:, 1] += under.clamp(min=0)
    legs = [tuple(target.skeleton.ancestors(foot[0][0])[-3:]) for foot in pairs]
    return _move_legs(result, legs, shifts, [contacts[:, c].any(1) for c in columns])


def _foot_pairs(target: Body, source: Body, links: Links) -> list[list[tuple[int, int]]]:
    """For each leg its (target, source) joints that touch the ground, from the ankle outwards."""
    feet = []
    for side in SIDES:
        roles = [f"{side}_{r}" for r in ("ankle", "toe")]
        both = [(target.roles[r], source.roles[r]) for r in roles if r in target.roles and r in source.roles]
        leg = target.limb(side, *LEG)
        in_a_row = min(leg, default=0) > 0 and [target.skeleton.parents[j] for j in leg[1:]] == leg[:2]
        if both and in_a_row and all(links[j] for j in leg):
            feet.append(both)
    return feet


def _sole(body: Body, outer: list[int]) -> float | None:
    """How high above the ground a body's outer foot joints are in the rest pose; None if that stands elsewhere."""
    heights = body.places[:, 1] + float(body.skeleton.offsets[0, 1])
    sole = float(heights[outer].mean())
    return sole if float(heights.min()) > -1e-3 and sole < _SOLE * body.skeleton.height else None


def _correction(gaps: Tensor, stands: Tensor, level: float) -> Tensor:
    """How far to shift a leg's end, [F, 3], so that its gap to the source's stays as it is while the foot stands.

    gaps: [F, k, 3] of its foot joints, from the ankle outwards; stands: bool [F, k]; level: the gap in height that the
    outermost is to have. In each contact the shift is 0 on average over the ground. The outermost joint alone tells the
    height: where the ankle is over the ground changes as the foot rolls. Before the first and after the last it holds.
    """
    planted, up = stands.any(1), level - gaps[:, -1, 1]
    both = stands[1:] & stands[:-1]
    last = both.shape[1] - 1 - both.flip(1).int().argmax(1)  # toes roll last
    steps = torch.zeros_like(gaps[:, 0])
    steps[1:] = (gaps[1:] - gaps[:-1])[torch.arange(len(both)), last] * both.any(1)[:, None]
    walk = -steps.cumsum(0)
    shift = torch.zeros_like(walk)
    number = (torch.diff(planted.int(), prepend=planted.new_zeros(1).int()) == 1).cumsum(0)
    for n in range(1, int(number.max()) + 1):
        mine = planted & (number == n)
        shift[mine] = walk[mine] - walk[mine].mean(0)
    shift, tells = _bridge(shift, planted), stands[:, -1]
    shift[:, 1] = _bridge(up[:, None], tells)[:, 0] if bool(tells.any()) else up.median()
    return shift


def _bridge(shift: Tensor, planted: Tensor) -> Tensor:
    """Frames [F, C] that are not planted filled in from those around them, easing from one to the next."""
    if not bool(planted.any()):
        return shift
    known = planted.nonzero()[:, 0]
    rows = torch.arange(len(shift))
    after = torch.searchsorted(known, rows).clamp(max=len(known) - 1)
    before = (torch.searchsorted(known, rows, right=True) - 1).clamp(min=0)
    a, b = known[before], known[after]
    t = ((rows - a) / (b - a).clamp(min=1)).clamp(0, 1).to(shift)[:, None]
    return torch.lerp(shift[a], shift[b], t * t * (3 - 2 * t))


def _move_legs(result: Motion, legs: list[tuple], shifts: list[Tensor], planted: list[Tensor]) -> Motion:
    """The result with its pelvis moved by what the legs' shifts [F, 3] share, and the legs bent for the rest.

    A straight knee opens or closes by many degrees for a centimetre, a bent one by few: the straighter leg counts more.
    """
    places, radius = result.positions(), max(1, round(result.fps * 0.1))
    weights = []
    for leg, stands in zip(legs, planted, strict=True):
        a, b, c = (places[:, j] for j in leg)
        bent = (1 - (rot.normalize(b - a) * rot.normalize(c - b)).sum(-1, keepdim=True)).clamp(min=0)
        weights.append(hann_smooth((stands[:, None] + 1.0) / (bent + 0.02), radius))
    common = hann_smooth(sum(w * s for w, s in zip(weights, shifts, strict=True)) / sum(weights), radius)
    translations = result.translations.clone()
    translations[:, 0] = translations[:, 0] + common
    result = result.replace(translations=translations)
    if max(float((s - common).abs().max()) for s in shifts) < 1e-6:
        return result
    return reach_with_legs(result, legs, [places[:, leg[2]] + shift for leg, shift in zip(legs, shifts, strict=True)])
