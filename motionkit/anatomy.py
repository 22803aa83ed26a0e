"""What joint names say: which side a joint is on, its mirror twin, and the part it plays in a body.

Names differ from studio to studio (`LeftUpLeg`, `l_hip`, `UpperLeg_L`, `mixamorig:LeftArm`, `lfemur`). They
are cut into words, the side word is taken out, and the rest is looked up in `ROLE_WORDS`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

LEFT, RIGHT, MIDDLE = "left", "right", "middle"
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


def find_twins(names: Sequence[str]) -> tuple[int, ...] | None:
    """For each joint the number of its mirror twin (itself on the midline), or None if a twin is missing.

    >>> find_twins(["Hips", "LeftFoot", "RightFoot"])
    (0, 2, 1)
    """
    return _find_twins(tuple(names))


@lru_cache(maxsize=256)
def _find_twins(names: tuple[str, ...]) -> tuple[int, ...] | None:
    sides, bare = _split_sides(names)
    place: dict[tuple[str, str], list[int]] = {}
    for n, key in enumerate(zip(sides, bare, strict=True)):
        place.setdefault(key, []).append(n)
    other = {LEFT: RIGHT, RIGHT: LEFT}
    twins = []
    for n, (side, name) in enumerate(zip(sides, bare, strict=True)):
        if side == MIDDLE:
            twins.append(n)
            continue
        here, there = place[side, name], place.get((other[side], name), [])
        if len(here) != len(there):
            return None
        twins.append(there[here.index(n)])
    return tuple(twins)


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
            found = next((mine[w] for w in candidates if w in mine and mine[w] not in taken), None)
            if found is not None:
                roles[f"{side}_{role}"] = found
                taken.add(found)
    return roles
