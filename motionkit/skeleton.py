"""Skeletons: joints with parents and offsets, what their names say, and SMPL's.

Names differ from studio to studio (`LeftUpLeg`, `l_hip`, `UpperLeg_L`, `mixamorig:LeftArm`, `lfemur`). They are cut
into words, the side word is taken out, and the rest is looked up in `ROLE_WORDS`: so a skeleton knows which joints are
left or right, which mirror each other, and which part each plays.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import torch
from torch import Tensor

from .errors import MotionKitError

LEFT, RIGHT, MIDDLE = "left", "right", "middle"
POSITION_CHANNELS = ("Xposition", "Yposition", "Zposition")


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints in the order of their file, each with a parent that comes before it.

    names: J unique names. parents: J numbers, -1 for the one root (joint 0). offsets: [J, 3] metres, from the parent in
    the parent's frame (the root's is where it stands at rest). channels: for each joint the BVH channel names in file
    order; left empty, the root gets positions and rotations and the others rotations in the order Z X Y. end_sites:
    (joint, offset in metres) for each bone end. mirror_joints: each joint's mirror twin; derived from the names if left
    out.

    >>> offsets = torch.tensor([[0, 0.9, 0], [0.1, 0, 0], [-0.1, 0, 0]])
    >>> s = Skeleton(("Hips", "LeftUpLeg", "RightUpLeg"), (-1, 0, 0), offsets)
    >>> s.sides, s.mirror_joints
    (('middle', 'left', 'right'), (0, 2, 1))
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Tensor
    channels: tuple[tuple[str, ...], ...] = ()
    end_sites: tuple[tuple[int, tuple[float, float, float]], ...] = ()
    mirror_joints: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if not self.channels:
            turns = ("Zrotation", "Xrotation", "Yrotation")
            channels = tuple((POSITION_CHANNELS if p < 0 else ()) + turns for p in self.parents)
            object.__setattr__(self, "channels", channels)
        if self.mirror_joints is None:
            object.__setattr__(self, "mirror_joints", find_mirror_joints(self.names))
        count = len(self.names)
        if not count:
            raise MotionKitError("a skeleton needs at least one joint; found none")
        sizes = {"parents": len(self.parents), "offsets": len(self.offsets), "channels": len(self.channels)}
        if self.mirror_joints is not None:
            sizes["mirror_joints"] = len(self.mirror_joints)
        for what, size in sizes.items():
            if size != count:
                raise MotionKitError(f"skeleton: expected {count} {what}, one for each joint name; found {size}")
        if len(set(self.names)) != count:
            double = next(n for n in self.names if self.names.count(n) > 1)
            raise MotionKitError(f"skeleton: joint {double!r} appears twice; give every joint a name of its own")
        for n, parent in enumerate(self.parents):
            if (n == 0) != (parent < 0) or parent >= n:
                raise MotionKitError(
                    f"skeleton: joint {self.names[n]!r} has parent {parent}; expected -1 for joint 0 alone and, for "
                    "the others, a joint that comes before it"
                )

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return f"Skeleton({len(self)} joints, root {self.names[0]!r}, height {self.height:.2f} m)"

    def index(self, name: str) -> int:
        """The number of a joint; MotionKitError names the nearest names if there is none of that name."""
        if name in self.names:
            return self.names.index(name)
        near = difflib.get_close_matches(name, self.names, 3, 0.3) or list(self.names[:5])
        raise MotionKitError(
            f"no joint {name!r}; did you mean {', '.join(map(repr, near))}? All: {', '.join(self.names)}"
        )

    def same_tree(self, other: Skeleton) -> bool:
        """Whether both have the same joint names with the same parents, in the same order."""
        return self is other or (self.names == other.names and self.parents == other.parents)

    @cached_property
    def sides(self) -> tuple[str, ...]:
        """For each joint `left`, `right` or `middle`, read from its name."""
        return tuple(split_sides(self.names)[0])

    @cached_property
    def roles(self) -> dict[str, int]:
        """Joint numbers by the part they play (`left_hip`, `right_wrist`, ...), see `skeleton.find_roles`."""
        return find_roles(self.names)

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """For each joint the numbers of its children."""
        children: list[list[int]] = [[] for _ in self.names]
        for n, parent in enumerate(self.parents[1:], 1):
            children[parent].append(n)
        return tuple(map(tuple, children))

    @cached_property
    def adjacency(self) -> Tensor:
        """Which joints a bone connects, bool [J, J], symmetric; a joint is no neighbour of itself.

        >>> smpl().adjacency.sum(1)[:4]
        tensor([3, 2, 2, 2])
        """
        adjacency = torch.zeros(len(self), len(self), dtype=torch.bool)
        for child, parent in enumerate(self.parents[1:], 1):
            adjacency[child, parent] = adjacency[parent, child] = True
        return adjacency

    @cached_property
    def levels(self) -> tuple[tuple[int, ...], ...]:
        """Joint numbers by depth: the root alone, then its children, ...; within a level, leaves come last."""
        levels, now = [], [0]
        while now:
            levels.append(tuple(sorted(now, key=lambda j: not self.children[j])))
            now = [c for j in levels[-1] for c in self.children[j]]
        return tuple(levels)

    @cached_property
    def level_order(self) -> tuple[Tensor, Tensor]:
        """Joint numbers in the order of `levels`, and the permutation that undoes it; [J] each."""
        order = torch.tensor([j for level in self.levels for j in level])
        return order, torch.argsort(order)

    @cached_property
    def level_plan(self) -> tuple[tuple[Tensor, int], ...]:
        """For each level below the root: the parents' places in the level above, and how many joints have children."""
        plan = []
        for above, level in zip(self.levels, self.levels[1:], strict=False):
            parents = torch.tensor([above.index(self.parents[j]) for j in level])
            plan.append((parents, sum(bool(self.children[j]) for j in level)))
        return tuple(plan)

    def ancestors(self, joint: int) -> tuple[int, ...]:
        """The joints from the root down to `joint`, both included."""
        path = [joint]
        while self.parents[path[-1]] >= 0:
            path.append(self.parents[path[-1]])
        return tuple(reversed(path))

    def descendants(self, joint: int) -> list[int]:
        """A joint and all joints that hang on it, in order."""
        joints = {joint}
        for n in range(joint + 1, len(self)):
            if self.parents[n] in joints:
                joints.add(n)
        return sorted(joints)

    def subtree(self, joints: list[int]) -> Skeleton:
        """The skeleton of some joints (as from `descendants`), the first of which becomes the root."""
        place = {j: n for n, j in enumerate(joints)}
        return Skeleton(
            tuple(self.names[j] for j in joints),
            tuple(place.get(self.parents[j], -1) for j in joints),
            self.offsets[joints],
            tuple(self.channels[j] for j in joints),
            tuple((place[j], offset) for j, offset in self.end_sites if j in place),
        )

    def as_float(self) -> Skeleton:
        """The same skeleton with float32 offsets."""
        return self if self.offsets.dtype == torch.float32 else replace(self, offsets=self.offsets.float())

    @cached_property
    def pelvis(self) -> int:
        """The joint that carries the body: where the legs meet, or else the first joint that branches.

        It is not always the root: many captures put a helper joint on the ground above the hips.
        """
        left, right = self.roles.get("left_hip"), self.roles.get("right_hip")
        if left is not None and right is not None:
            shared = [a for a, b in zip(self.ancestors(left), self.ancestors(right), strict=False) if a == b]
            return shared[-1] if shared else 0
        joint = 0
        while len(self.children[joint]) == 1:
            joint = self.children[joint][0]
        return joint if self.children[joint] else 0

    @cached_property
    def reach(self) -> tuple[float, ...]:
        """For each joint, the length in metres of the bones between it and the pelvis."""
        lengths = torch.linalg.vector_norm(self.offsets.double(), dim=-1).tolist()
        depth, shared = [0.0], [0.0]  # way from the root, and the part of it that the pelvis' way shares
        spine = set(self.ancestors(self.pelvis))
        for n, parent in enumerate(self.parents[1:], 1):
            depth.append(depth[parent] + lengths[n])
            shared.append(depth[n] if n in spine else shared[parent])
        return tuple(d + depth[self.pelvis] - 2 * s for d, s in zip(depth, shared, strict=True))

    @cached_property
    def height(self) -> float:
        """About how tall the character stands, metres: a leg down to the ankle, and the longest way along the midline.

        Without sides in the names it is the two longest ways from the pelvis together.
        """
        ends = list(self.reach)
        for joint, offset in self.end_sites:
            ends[joint] = max(ends[joint], self.reach[joint] + sum(x * x for x in offset) ** 0.5)
        branch = [-1] * len(self)  # the pelvis' child through which a joint hangs on it
        for n, parent in enumerate(self.parents[1:], 1):
            branch[n] = n if parent == self.pelvis else branch[parent]
        longest: dict[int, float] = {}
        for b, end in zip(branch, ends, strict=True):
            if b >= 0:
                longest[b] = max(longest.get(b, 0.0), end)
        ankles = [self.roles.get(f"{side}_ankle") for side in (LEFT, RIGHT)]
        legs = [ends[a] for a in ankles if a is not None and self.children[a]]  # a foot points ahead, not down
        legs = legs or [v for b, v in longest.items() if self.sides[b] != MIDDLE]
        trunk = [end for j, end in enumerate(ends) if branch[j] >= 0 and self.sides[j] == MIDDLE]
        return max(legs) + max(trunk) if legs and trunk else sum(sorted(longest.values())[-2:])

    @cached_property
    def body_parts(self) -> dict[str, tuple[int, ...]]:
        """Joints of the five parts torso, left_arm, right_arm, left_leg, right_leg (paper 5, section 3.3).

        A joint with a side belongs to a leg if the path down to it leaves the midline at the pelvis, else to an arm.
        """
        parts: dict[str, list[int]] = {p: [] for p in ("torso", "left_arm", "right_arm", "left_leg", "right_leg")}
        for j, side in enumerate(self.sides):
            if side == MIDDLE:
                parts["torso"].append(j)
                continue
            leaves = next(self.parents[a] for a in self.ancestors(j) if self.sides[a] != MIDDLE)
            parts[f"{side}_{'leg' if leaves in (self.pelvis, -1) else 'arm'}"].append(j)
        return {name: tuple(joints) for name, joints in parts.items()}

    def feet(self) -> tuple[int, ...]:
        """Joints that touch the ground: left and right ankle and toe where names tell, else every leg's last two.

        Raises MotionKitError if no joint can be taken for a foot.
        """
        named = [self.roles.get(f"{s}_{r}") for s in (LEFT, RIGHT) for r in ("ankle", "toe")]
        if all(n is not None for n in named[::2]):
            return tuple(n for n in named if n is not None)
        legs = self.body_parts["left_leg"] + self.body_parts["right_leg"]
        tips = [j for j in legs if not self.children[j]]
        if not tips:
            raise MotionKitError(f"cannot tell the feet among {', '.join(self.names)}; name them with feet=[...]")
        return tuple(sorted({j for t in tips for j in (self.parents[t], t) if j in legs}))


_SIDE_WORDS = {"left": LEFT, "l": LEFT, "right": RIGHT, "r": RIGHT}
_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")

# For each role the words that may name it, best first: "leg" is a knee only where nobody says "knee".
ROLE_WORDS = {
    "hip": ("upleg", "upperleg", "thigh", "femur", "hip"),
    "knee": ("lowerleg", "lowleg", "knee", "shin", "calf", "tibia", "leg"),
    "ankle": ("ankle", "foot"),
    "toe": ("toebase", "toes", "toe", "ball", "foot"),
    "shoulder": ("upperarm", "uparm", "arm", "humerus", "shoulder"),
    "elbow": ("lowerarm", "lowarm", "forearm", "elbow", "radius"),
    "wrist": ("hand", "wrist"),
}


def words(name: str) -> list[str]:
    """A joint name cut into lower-case words, without a namespace such as `mixamorig:`.

    >>> words("mixamorig:LeftUpLeg"), words("UpperLeg_L")
    (['left', 'up', 'leg'], ['upper', 'leg', 'l'])
    """
    return [w.lower() for w in _WORD.findall(name.rsplit(":", 1)[-1])]


def split_sides(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """For each name its side and the name without the side word.

    A leading `l` or `r` inside a word (`lfemur`) counts only where the twin (`rfemur`) exists.

    >>> split_sides(["Hips", "LeftFoot", "lfemur", "rfemur", "lowerback"])
    (['middle', 'left', 'left', 'right', 'middle'], ['hips', 'foot', 'femur', 'femur', 'lowerback'])
    """
    sides, bare = _split_sides(tuple(names))
    return list(sides), list(bare)


@lru_cache(maxsize=256)  # every clip of a dataset has the same names
def _split_sides(names: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    sides, bare = [], []
    everything = {"".join(words(n)) for n in names}
    for name in names:
        parts = words(name)
        marks = [w for w in parts if w in _SIDE_WORDS]
        joined = "".join(parts)
        twin = {"l": "r", "r": "l"}.get(joined[:1], "") + joined[1:]
        if marks:
            sides.append(_SIDE_WORDS[marks[0]])
            parts.remove(marks[0])
            bare.append("".join(parts))
        elif joined[:1] in ("l", "r") and len(joined) > 1 and twin in everything:
            sides.append(_SIDE_WORDS[joined[0]])
            bare.append(joined[1:])
        else:
            sides.append(MIDDLE)
            bare.append(joined)
    return tuple(sides), tuple(bare)


def find_mirror_joints(names: Sequence[str]) -> tuple[int, ...] | None:
    """For each joint the number of its mirror twin (itself on the midline), or None if a twin is missing.

    >>> find_mirror_joints(["Hips", "LeftFoot", "RightFoot"])
    (0, 2, 1)
    """
    return _find_mirror_joints(tuple(names))


@lru_cache(maxsize=256)
def _find_mirror_joints(names: tuple[str, ...]) -> tuple[int, ...] | None:
    sides, bare = _split_sides(names)
    place: dict[tuple[str, str], list[int]] = {}
    for n, key in enumerate(zip(sides, bare, strict=True)):
        place.setdefault(key, []).append(n)
    other = {LEFT: RIGHT, RIGHT: LEFT}
    mirror_joints = []
    for n, (side, name) in enumerate(zip(sides, bare, strict=True)):
        if side == MIDDLE:
            mirror_joints.append(n)
            continue
        same_side, other_side = place[side, name], place.get((other[side], name), [])
        if len(same_side) != len(other_side):
            return None
        mirror_joints.append(other_side[same_side.index(n)])
    return tuple(mirror_joints)


def find_roles(names: Sequence[str]) -> dict[str, int]:
    """Which joint plays which part: `left_hip`, `left_knee`, ... `right_wrist`; parts not found are left out.

    >>> names = "Hips LHipJoint LeftUpLeg LeftLeg LeftFoot LeftToeBase LeftShoulder LeftArm"
    >>> roles = find_roles(names.split())
    >>> roles["left_hip"], roles["left_knee"], roles["left_shoulder"]
    (2, 3, 7)
    """
    sides, bare = _split_sides(tuple(names))
    roles: dict[str, int] = {}
    for side in (LEFT, RIGHT):
        mine = {b: n for n, (s, b) in enumerate(zip(sides, bare, strict=True)) if s == side}
        taken: set[int] = set()
        for role, candidates in ROLE_WORDS.items():
            joint = next((mine[w] for w in candidates if w in mine and mine[w] not in taken), None)
            if joint is not None:
                roles[f"{side}_{role}"] = joint
                taken.add(joint)
    return roles


# SMPL's 22 body joints in their usual order: name, parent, offset in shares of the body's height, in T-pose. Lengths
# are those of Drillis and Contini 1966 (as in Winter 2009, fig. 4.1): ankle 0.039, knee 0.285, hip 0.530, shoulder
# 0.818 above the ground; upper arm 0.186, forearm 0.146, hand 0.108, foot 0.152 long. The spine's joints, which they
# do not have, divide hip to neck evenly. Right limbs mirror the left ones.
_SMPL = (
    ("pelvis", -1, (0.0, 0.558, 0.0)),
    ("left_hip", 0, (0.052, -0.028, 0.0)),
    ("right_hip", 0, None),
    ("spine1", 0, (0.0, 0.066, -0.006)),
    ("left_knee", 1, (0.0, -0.245, 0.0)),
    ("right_knee", 2, None),
    ("spine2", 3, (0.0, 0.074, 0.004)),
    ("left_ankle", 4, (0.0, -0.246, 0.0)),
    ("right_ankle", 5, None),
    ("spine3", 6, (0.0, 0.05, 0.002)),
    ("left_foot", 7, (0.0, -0.027, 0.068)),
    ("right_foot", 8, None),
    ("neck", 9, (0.0, 0.1, -0.008)),
    ("left_collar", 9, (0.036, 0.062, 0.0)),
    ("right_collar", 9, None),
    ("head", 12, (0.0, 0.062, 0.012)),
    ("left_shoulder", 13, (0.082, 0.008, -0.006)),
    ("right_shoulder", 14, None),
    ("left_elbow", 16, (0.186, 0.0, 0.0)),
    ("right_elbow", 17, None),
    ("left_wrist", 18, (0.146, 0.0, 0.0)),
    ("right_wrist", 19, None),
)
_SMPL_ENDS = {
    "left_foot": (0.0, 0.0, 0.046),
    "right_foot": None,
    "head": (0.0, 0.09, 0.01),
    "left_wrist": (0.108, 0.0, 0.0),
    "right_wrist": None,
}
_WIDER = ("hip", "collar", "shoulder")  # the joints that stand further out in a broader body


def smpl(height: float = 1.75, broad: float = 0.0, dtype: torch.dtype = torch.float32) -> Skeleton:
    """A person with SMPL's 22 body joints, names and order, in T-pose facing +Z.

    height: metres. broad: how much wider than usual hips and shoulders are, as a share. The order is that of
    HumanML3D's data; the proportions are published averages (see the table), since SMPL's are not free to copy.

    >>> smpl()
    Skeleton(22 joints, root 'pelvis', height 1.74 m)
    """
    names = tuple(name for name, _, _ in _SMPL)
    shares = {name: share for name, _, share in _SMPL if share}
    offsets = [_offset(name, shares, height, broad) for name in names]
    ends = tuple((names.index(name), tuple(_offset(name, _SMPL_ENDS, height))) for name in _SMPL_ENDS)
    return Skeleton(names, tuple(p for _, p, _ in _SMPL), torch.tensor(offsets, dtype=dtype), end_sites=ends)


def _offset(name: str, shares: dict, height: float, broad: float = 0.0) -> list[float]:
    """A joint's offset in metres; a right one's mirrors the left one's."""
    x, y, z = shares[name.replace("right_", "left_")]
    width = (1 + broad) if name.endswith(_WIDER) else 1.0
    return [height * share for share in (-x * width if name.startswith("right") else x * width, y, z)]
