"""A person on another rig: 31 joints in a studio's names and order, with more joints in spine, neck and toes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import torch
from torch import Tensor

from ... import rotations as rot
from ...motion import Motion
from ...skeleton import Skeleton
from .. import performing as people
from ..body import Performer
from ..score import GESTURES, WALKS, Score
from ..style import Style
from .species import Creature, Deed, Leg, Species

# Each joint: its parent, and the joint of the 22 whose bone and turn it has, with its share of both.
_RIG = (
    ("Hips", "", "pelvis", 1.0),
    ("LHipJoint", "Hips", "left_hip", 0.4), ("LeftUpLeg", "LHipJoint", "left_hip", 0.6),
    ("LeftLeg", "LeftUpLeg", "left_knee", 1.0), ("LeftFoot", "LeftLeg", "left_ankle", 1.0),
    ("LeftToeBase", "LeftFoot", "left_foot", 1.0), ("LeftToe", "LeftToeBase", "left_foot_end", 0.5),
    ("RHipJoint", "Hips", "right_hip", 0.4), ("RightUpLeg", "RHipJoint", "right_hip", 0.6),
    ("RightLeg", "RightUpLeg", "right_knee", 1.0), ("RightFoot", "RightLeg", "right_ankle", 1.0),
    ("RightToeBase", "RightFoot", "right_foot", 1.0), ("RightToe", "RightToeBase", "right_foot_end", 0.5),
    ("LowerBack", "Hips", "spine1", 1.0), ("Spine", "LowerBack", "spine2", 0.5), ("Spine1", "Spine", "spine2", 0.5),
    ("Spine2", "Spine1", "spine3", 0.5), ("Spine3", "Spine2", "spine3", 0.5),
    ("Neck", "Spine3", "neck", 1.0), ("Neck1", "Neck", "head", 0.5), ("Head", "Neck1", "head", 0.5),
    ("LeftShoulder", "Spine3", "left_collar", 1.0), ("LeftArm", "LeftShoulder", "left_shoulder", 1.0),
    ("LeftForeArm", "LeftArm", "left_elbow", 1.0), ("LeftHand", "LeftForeArm", "left_wrist", 1.0),
    ("LeftHandIndex1", "LeftHand", "left_wrist_end", 0.6),
    ("RightShoulder", "Spine3", "right_collar", 1.0), ("RightArm", "RightShoulder", "right_shoulder", 1.0),
    ("RightForeArm", "RightArm", "right_elbow", 1.0), ("RightHand", "RightForeArm", "right_wrist", 1.0),
    ("RightHandIndex1", "RightHand", "right_wrist_end", 0.6),
)  # fmt: skip
_PLAIN = {"left_hip", "right_hip"}  # a hip's turn is all its own; its helper joint keeps still


def perform(
    content: str | Sequence[str], style: Style, seed: int, who: Creature, seconds: float, fps: float, path: object
) -> people.Performance:
    """As `motionkit.actor.perform`, on this rig."""
    person = _person(who)
    told = people.perform(content, style, seed, seconds=seconds, fps=fps, performer=person, path=path)
    motion = on_the_rig(told.motion, person).replace(name=f"{who.name}_{told.motion.name}")
    return replace(told, motion=replace(motion, skeleton=motion.skeleton.as_float()), performer=who)


def realise(
    score: Score, style: Style, who: Creature, fps: float, frames: int | None = None
) -> tuple[Motion, Tensor, Tensor]:
    """As `motionkit.actor.performing.realise`, on this rig."""
    motion, contacts, beats = people.realise(score, style, _person(who), fps, frames)
    return on_the_rig(motion, _person(who)), contacts, beats


def on_the_rig(motion: Motion, person: Performer) -> Motion:
    """A motion of the 22 joints as one of the 31: hips, knees, ankles and toes stay exactly where they are."""
    skeleton, names = _skeleton(person.height, person.build), motion.skeleton.names
    turns = rot.identity_quaternion(len(motion), len(skeleton), dtype=motion.rotations.dtype)
    for joint, (_, _, source, share) in enumerate(_RIG):
        if source in names:
            turn = motion.rotations[:, names.index(source)]
            if source in _PLAIN:
                share = 1.0 if "UpLeg" in skeleton.names[joint] else 0.0
            turns[:, joint] = turn if share == 1 else rot.slerp(rot.identity_quaternion().to(turn), turn, share)
    return Motion.from_root(skeleton, turns, motion.translations[:, 0], motion.fps, name=motion.name)


def _person(who: Creature) -> Performer:
    person = Performer.from_seed(who.seed)
    return replace(person, height=1.75 * who.size, build=0.0, habits=dict(who.habits))


@lru_cache(maxsize=128)
def _skeleton(height: float, build: float) -> Skeleton:
    shape = Performer(height=height, build=build).skeleton
    bones = {name: shape.offsets[n] for n, name in enumerate(shape.names)}
    bones |= {f"{shape.names[n]}_end": torch.tensor(o, dtype=torch.float64) for n, o in shape.end_sites}
    names = tuple(row[0] for row in _RIG)
    offsets, ends = [], []
    for n, (name, _, source, share) in enumerate(_RIG):
        offsets.append(bones[source] * share)
        rest = {"Head": bones["head_end"]}.get(name)
        if source.endswith("_end"):
            rest = bones[source] * (1 - share)
        if rest is not None:
            ends.append((n, tuple(rest.tolist())))
    parents = tuple(names.index(row[1]) if row[1] else -1 for row in _RIG)
    return Skeleton(names, parents, torch.stack(offsets), end_sites=tuple(ends))


def _bones() -> tuple:
    skeleton, places = _skeleton(1.75, 0.0), []
    for parent, offset in zip(skeleton.parents, skeleton.offsets):
        places.append(offset if parent < 0 else places[parent] + offset)
    ends = {joint: places[joint] + torch.tensor(o, dtype=torch.float64) for joint, o in skeleton.end_sites}
    rows = []
    for n, place in enumerate(places):
        end = (tuple(ends[n].tolist()),) if n in ends else ()
        rows.append((skeleton.names[n], _RIG[n][1], tuple(place.tolist()), *end))
    return tuple(rows)


def _nothing(*_: object) -> None:
    """The person's own layers have put everything in place."""


HUMANOID = Species(
    name="humanoid",
    bones=_bones(),
    legs=tuple(Leg((f"{s}UpLeg", f"{s}Leg", f"{s}Foot", f"{s}ToeBase"), (0.0, 0.0)) for s in ("Left", "Right")),
    chains={"neck": ("Neck", "Neck1", "Head")},
    gaits={walk: walk for walk in WALKS},
    deeds={name: Deed(beats, _nothing) for name, beats in GESTURES.items() if name != "idle"},
    step=0.7,
    rate=1.85,
    life=_nothing,
    feet=("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase"),
)
