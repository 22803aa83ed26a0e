"""Which joint of one human body plays the part of which joint of another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .. import anatomy
from ..errors import MotionKitError
from ..skeleton import Skeleton

SIDES = (anatomy.LEFT, anatomy.RIGHT)
NEEDED = tuple(f"{s}_{r}" for s in SIDES for r in ("hip", "knee", "ankle", "shoulder", "elbow"))

Links = list[dict[int, float]]  # for each target joint the source joints it follows, with weights that sum to 1


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
        return self.spine[-1] if self.spine else 0

    def bone(self, start: str, end: str) -> float:
        """The length in metres between the joints of two roles."""
        return float((self.places[self.roles[end]] - self.places[self.roles[start]]).norm())


def trunk(skeleton: Skeleton, roles: Mapping[str, int] | None = None) -> tuple[list[int], list[int]]:
    """Midline joints above the pelvis up to the chest, where the arms leave, and those above it (neck, head).

    roles: joint numbers by part; the skeleton's own if left out.

    >>> from motionkit.skeleton import smpl
    >>> spine, above = trunk(smpl())
    >>> [smpl().names[j] for j in spine + above]
    ['spine1', 'spine2', 'spine3', 'neck', 'head']
    """
    roles = skeleton.roles if roles is None else roles
    left, right = roles.get("left_shoulder"), roles.get("right_shoulder")
    if left is None or right is None:
        return [], []
    shared = [a for a, b in zip(skeleton.chain(left), skeleton.chain(right), strict=False) if a == b]
    if skeleton.pelvis not in shared:
        return [], []
    spine = shared[shared.index(skeleton.pelvis) + 1 :]
    above, joint = [], shared[-1]
    arms = {*skeleton.chain(left), *skeleton.chain(right)}
    while True:
        ahead = [c for c in skeleton.children[joint] if skeleton.sides[c] == anatomy.MIDDLE and c not in arms]
        if not ahead:
            return spine, above
        joint = ahead[0]
        above.append(joint)


def body_of(skeleton: Skeleton, offsets: Tensor, roles: dict[str, int]) -> Body:
    """The `Body` of a skeleton with its pelvis as root; offsets [J, 3] metres from the parents, roles by number."""
    places = [torch.zeros(3, dtype=torch.float64)]
    for joint, parent in enumerate(skeleton.parents[1:], 1):
        places.append(places[parent] + offsets[joint].double())
    spine, neck = trunk(skeleton, roles)
    chest, collars = spine[-1] if spine else 0, {}
    for side in SIDES:
        path = skeleton.chain(roles[f"{side}_shoulder"]) if f"{side}_shoulder" in roles else ()
        collars[side] = list(path[path.index(chest) + 1 : -1]) if chest in path else []
    return Body(skeleton, torch.stack(places), roles, spine, neck, collars)


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

    The table goes first, then the parts that names tell (`anatomy.find_roles`), then spine, neck and collars by their
    place along the chain, then joints that share side and name. Raises MotionKitError where arms or legs are missing.

    >>> from motionkit.skeleton import smpl
    >>> person = body_of(smpl(), smpl().offsets, smpl().roles)
    >>> match_joints(person, person, {"head": None})[12:16]
    [{12: 1.0}, {13: 1.0}, {14: 1.0}, {}]
    """
    links: Links = [{} for _ in target.skeleton.names]
    links[0] = {0: 1.0}
    for role, joint in target.roles.items():
        if role in source.roles:
            links[joint] = {source.roles[role]: 1.0}
    for (to, ends), (since, begins) in zip(_chains(target), _chains(source), strict=True):
        for joint, weights in zip(to, _shares(_lengths(ends), _lengths(begins)), strict=True):
            links[joint] = {since[n]: w for n, w in weights.items()}
    used = {j for link in links for j in link}
    alike = {key: j for j, key in enumerate(zip(*anatomy.split_sides(source.skeleton.names), strict=True))}
    for joint, key in enumerate(zip(*anatomy.split_sides(target.skeleton.names), strict=True)):
        if not links[joint] and alike.get(key, 0) not in {0, *used}:
            links[joint] = {alike[key]: 1.0}
    for to, wanted in names.items():
        links[target.skeleton.index(to)] = {} if wanted is None else {source.skeleton.index(wanted): 1.0}
    _check(source, target, names)
    return links


def _chains(body: Body) -> list[tuple[list[int], Tensor]]:
    """Spine, neck and both collars, each with the places [n + 1, 3] where their bones begin and the last one ends."""
    roles, chains = body.roles, []
    shoulders = [roles[f"{s}_shoulder"] for s in SIDES if f"{s}_shoulder" in roles]
    collars = [(body.collars[s], [roles.get(f"{s}_shoulder", 0)]) for s in SIDES]
    for chain, end in [(body.spine, shoulders), (body.neck, body.neck[-1:]), *collars]:
        chains.append(
            (chain, torch.cat((body.places[chain], body.places[end].mean(0, True))) if chain else body.places[:0])
        )
    return chains


def _lengths(places: Tensor) -> list[float]:
    """Lengths in metres of the bones between neighbouring places [n, 3]."""
    return torch.linalg.vector_norm(places[1:] - places[:-1], dim=-1).tolist()


def _shares(target: Sequence[float], source: Sequence[float]) -> Links:
    """For each bone of one chain the bones of the other beside it, weighted by the length they share.

    The last bone follows the last one alone: chest, head and the collar's end keep their own turn.

    >>> _shares([1.0, 1.0, 1.0], [1.0, 2.0])
    [{0: 1.0}, {1: 1.0}, {1: 1.0}]
    """
    if not source:
        return [{} for _ in target]
    ends = [_ends(target), _ends(source)]
    links: Links = []
    for start, stop in zip(ends[0], ends[0][1:], strict=False):
        both = [min(stop, b) - max(start, a) for a, b in zip(ends[1], ends[1][1:], strict=False)]
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


def _check(source: Body, target: Body, names: Mapping[str, str | None]) -> None:
    """Refuse what would come out as another body than the one that moved, and show the table that would help."""
    left_out = {target.skeleton.index(to) for to, wanted in names.items() if wanted is None}
    missing = [
        role
        for role in NEEDED
        if not (role in source.roles and role in target.roles) and target.roles.get(role) not in left_out
    ]
    if not missing:
        return
    free = [
        _some([name for n, name in enumerate(body.skeleton.names) if n not in body.roles.values()])
        for body in (source, target)
        if any(role not in body.roles for role in missing)
    ]

    def name(body: Body, role: str, what: str) -> str:
        return repr(body.skeleton.names[body.roles[role]] if role in body.roles else f"{what} joint for {role}")

    table = ", ".join(f"{name(target, r, 'target')}: {name(source, r, 'source')}" for r in missing)
    raise MotionKitError(
        f"retarget: expected hips, knees, ankles, shoulders and elbows of both sides on both skeletons; "
        f"not found: {', '.join(missing)}. Say which joints they are with mk.retarget(clip, to, names={{{table}}}), or "
        f"give None for a joint to leave out. Joints that play no part yet: {'; '.join(free)}"
    )


def _some(names: list[str]) -> str:
    """The first few of them; a creature may have dozens."""
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
