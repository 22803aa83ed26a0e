"""Performing: a content in a style with all that is known of it, and the same intention told in another style.

First people, then a person on a rig of 31 joints (`HUMANOID`), then creatures. From a plan to a motion each goes the
same way: the beats get their seconds, the route and the footsteps are planned, layers add curves, and pose and feet are
put together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import torch
from torch import Tensor

from .. import rotations as rot
from ..errors import MotionKitError, check
from ..motion import Motion
from ..skeleton import Skeleton
from ..text.captions import performed_captions
from .bodies import Creature, CreatureAction, Leg, Performer, Species, get_performer
from .creatures import CRAB, DOG, DRAGON, OSTRICH
from .curves import (
    Curves,
    PoseContext,
    breath,
    creature_breath,
    creature_gait,
    creature_posture,
    gait,
    gestures,
    posture,
)
from .footsteps import SIDES, Footing, Planner, move_creature_foot, move_foot
from .path import WALK_STEP, Route, checked_path, plan_route
from .pose import assemble_creature, assemble_pose
from .score import (
    GESTURES,
    WALKS,
    MotionPlan,
    as_walked,
    beat_seconds,
    contents_of,
    fine_axis,
    interpolate,
    plan_actions,
    plan_creature_actions,
    seconds_of,
)
from .style import Style, get_style

_AROUND = 6.0  # beats planned before and after what is shown


@dataclass(frozen=True, eq=False)
class Performance:
    """A motion and the truth about it.

    motion: F frames. contacts: bool [F, 4], left ankle, left ball of the foot, right ankle, right ball: exactly when
    each stands. beats: [F] where in the score each frame is. content: what was asked for. style: with intensity, before
    the performer's habits. captions: sentences, see `captions`.
    """

    motion: Motion
    contacts: Tensor
    beats: Tensor
    content: str
    style: Style
    seed: int
    performer: Performer | Creature
    score: MotionPlan
    captions: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.motion)

    def __repr__(self) -> str:
        return f"Performance({self.content!r}, style {self.style.name!r}, {self.motion!r})"

    @property
    def phase(self) -> Tensor:
        """Where in a cycle of two steps each frame is, [F], 0 to 1; the left foot lands at 0."""
        return (self.beats / 2) % 1.0

    @property
    def parameters(self) -> dict[str, object]:
        """All numbers that made it: the style's, the performer's height, build and habits, and the acts."""
        person = {"height": self.performer.height, "build": self.performer.build, "habits": dict(self.performer.habits)}
        acts = [vars(act) for act in self.score.acts]
        return {"style": self.style.values(), "performer": person, "acts": acts, "seed": self.seed}

    def frames_at(self, beats: Tensor) -> Tensor:
        """The fractional frames [N] in which it reaches beats [N]."""
        frames = torch.arange(len(self.beats), dtype=self.beats.dtype)
        return interpolate(beats.to(self.beats), self.beats, frames)

    def time_aligned(self, other: Performance) -> Motion:
        """This motion in the other's time: in each frame it is at the same beat as the other is.

        For a `retell`ing of the other, that is the exact answer of a style transfer that keeps the other's timing.
        Raises MotionKitError if the two do not tell the same score.
        """
        if other.score is not self.score:
            raise MotionKitError(
                f"{self!r} and {other!r} are not tellings of one score; make one with retell(other, style)"
            )
        return self.motion.sample(self.frames_at(other.beats)).replace(fps=other.motion.fps)


def perform(
    content: str | Sequence[str],
    style: str | Style = "neutral",
    seed: int = 0,
    *,
    seconds: float = 6.0,
    fps: float = 30.0,
    intensity: float = 1.0,
    performer: Performer | Creature | int | str | None = None,
    path: object = None,
) -> Performance:
    """Somebody does something in some style.

    content: one of `CONTENTS`, or several ("walk, jump, kick" or a list), each done once in that order. style: a name
    or a `Style`; intensity as in `Style.at`. seed: another take of the same. performer: who, a number or a `Performer`
    (left out, the seed says), or a creature such as "dog", which does what its kind does (`creatures`). path: places on
    the ground [N, 2], x and z in metres, that walks follow. Returns a `Performance` of about `seconds`. Raises
    MotionKitError for unknown names, numbers that are not finite, and times that do not hold what is asked for.

    >>> p = perform("walk", "old", seed=1, seconds=4)
    >>> p.motion, p.contacts.shape
    (Motion('walk_old_1', 120 frames at 30 fps, 4.0 s, 22 joints), torch.Size([120, 4]))
    """
    if not isinstance(performer, Performer | int | None):
        return perform_creature(
            content, style, seed, seconds=seconds, fps=fps, intensity=intensity, creature=performer, path=path
        )
    names, style = contents_of(content), get_style(style)
    check_numbers(seconds, fps, intensity)
    person, wanted = get_performer(performer, seed), style.at(intensity) if intensity != 1 else style
    places, own = checked_path(path), person.as_done_by(wanted)
    score = _plan_seconds(
        seconds,
        seconds * 1.85 * own.tempo,
        lambda beats: plan_actions(names, int(seed), beats, places, seconds),
        lambda plan, axis: beat_seconds(plan, own, person, axis),
    )
    return perform_plan(score, ", ".join(names), wanted, person, fps, round(seconds * fps))


def retell(performance: Performance, style: str | Style, intensity: float = 1.0) -> Performance:
    """The same intention in another style: same acts, same chance, same person; what differs is the style alone.

    The result agrees with the original beat by beat (`time_aligned` brings it to the original's frames). It takes the
    time that the style takes.

    >>> p = perform("walk", "neutral", seed=1, seconds=4)
    >>> old = retell(p, "old")
    >>> len(old) > len(p), len(old.time_aligned(p)) == len(p)
    (True, True)
    """
    if not isinstance(performance, Performance):
        raise MotionKitError(
            f"retell: only what the performer did can be told again, as of perform('walk'); found {performance!r}. "
            "For a motion from a file take a method: methods.load('statistics').stylize(...)"
        )
    wanted = get_style(style).at(intensity) if intensity != 1 else get_style(style)
    return perform_plan(performance.score, performance.content, wanted, performance.performer, performance.motion.fps)


def check_numbers(seconds: float, fps: float, intensity: float) -> None:
    """MotionKitError for a length, frame rate or intensity that cannot be performed."""
    for what, value, least in (("seconds", seconds, 0.1), ("fps", fps, 1.0), ("intensity", intensity, -10.0)):
        check.number(what, value, least)
    if fps > 1000:
        raise MotionKitError(f"fps: at most 1000; found {fps!r}")
    if seconds > 3600:
        raise MotionKitError(f"seconds: at most 3600 in one performance; found {seconds!r}")


def _plan_seconds(
    seconds: float,
    beats: float,
    plan: Callable[[float], MotionPlan],
    durations: Callable[[MotionPlan, Tensor], Tensor],
) -> MotionPlan:
    """The score whose performance takes so many seconds: beats and seconds depend on each other, so look again.

    beats: about how many. plan: beats to a score. durations: of its beats on a fine axis, in seconds.
    """
    for _ in range(8):
        score = plan(beats)
        axis = fine_axis(score.first, score.last)
        times = seconds_of(axis, durations(score, axis))
        ends = interpolate(torch.tensor([score.first, score.last], dtype=axis.dtype), axis, times)
        taken = float(ends[1] - ends[0])
        if abs(taken - seconds) < 1e-3:
            break
        beats *= seconds / taken
    return score


def perform_plan(
    score: MotionPlan, content: str, style: Style, who: Performer | Creature, fps: float, frames: int | None = None
) -> Performance:
    """A score as a performance in float32, with its name and captions. frames: left out, all that it holds."""
    kind = who.name if isinstance(who, Creature) else "person"
    motion, contacts, beats = (synthesize if kind == "person" else synthesize_creature)(score, style, who, fps, frames)
    motion = replace(
        motion,
        skeleton=motion.skeleton.as_float(),
        rotations=motion.rotations.float(),
        translations=motion.translations.float(),
        name=f"{'' if kind == 'person' else f'{kind}_'}{content.replace(', ', '-')}_{style.name}_{score.seed}",
    )
    captions = performed_captions(content, style, score.seed, subject=f"a {kind}", acts=score.acts)
    return Performance(motion, contacts, beats, content, style, score.seed, who, score, captions)


def synthesize(
    score: MotionPlan, style: Style, person: Performer, fps: float, frames: int | None = None
) -> tuple[Motion, Tensor, Tensor]:
    """The motion in float64, contacts [F, 4] and beats [F] of a score. frames: F; left out, all that it holds."""
    own = person.as_done_by(style)
    axis = fine_axis(score.first - _AROUND, score.last + _AROUND)
    times = seconds_of(axis, beat_seconds(score, own, person, axis))
    shown = interpolate(torch.tensor([score.first, score.last], dtype=axis.dtype), axis, times)
    count = frames or max(2, round(float(shown[1] - shown[0]) * fps))
    seconds = torch.arange(count, dtype=torch.float64) / fps
    beats = interpolate(seconds + shown[0], times, axis)
    route = plan_route(score, own, person, axis)
    at = PoseContext.of(score, own, person, route, beats, seconds)
    curves = Curves(count)
    for layer in (posture, breath, gait, gestures):
        layer(at, curves)
    plants = Planner(score, own, person, route).plan()
    feet = {side: move_foot(plants[side], beats, own, person) for side in SIDES}
    contacts = torch.cat([feet[side].stands for side in SIDES], 1)
    return assemble_pose(at, curves, feet, fps), contacts, beats


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


def _perform_humanoid(
    content: str | Sequence[str], style: Style, seed: int, who: Creature, seconds: float, fps: float, path: object
) -> Performance:
    """As `motionkit.actor.perform`, on this rig."""
    person = _person_inside(who)
    performance = perform(content, style, seed, seconds=seconds, fps=fps, performer=person, path=path)
    motion = on_the_rig(performance.motion, person).replace(name=f"{who.name}_{performance.motion.name}")
    return replace(performance, motion=replace(motion, skeleton=motion.skeleton.as_float()), performer=who)


def _synthesize_humanoid(
    score: MotionPlan, style: Style, who: Creature, fps: float, frames: int | None = None
) -> tuple[Motion, Tensor, Tensor]:
    """As `motionkit.actor.performing.synthesize`, on this rig."""
    motion, contacts, beats = synthesize(score, style, _person_inside(who), fps, frames)
    return on_the_rig(motion, _person_inside(who)), contacts, beats


def on_the_rig(motion: Motion, person: Performer) -> Motion:
    """A motion of the 22 joints as one of the 31: hips, knees, ankles and toes stay exactly where they are."""
    skeleton, names = _humanoid_skeleton(person.height, person.build), motion.skeleton.names
    turns = rot.identity_quaternion(len(motion), len(skeleton), dtype=motion.rotations.dtype)
    for joint, (_, _, source, share) in enumerate(_RIG):
        if source in names:
            turn = motion.rotations[:, names.index(source)]
            if source in _PLAIN:
                share = 1.0 if "UpLeg" in skeleton.names[joint] else 0.0
            turns[:, joint] = turn if share == 1 else rot.slerp(rot.identity_quaternion().to(turn), turn, share)
    return Motion.from_root(skeleton, turns, motion.translations[:, 0], motion.fps, name=motion.name)


def _person_inside(who: Creature) -> Performer:
    person = Performer.from_seed(who.seed)
    return replace(person, height=1.75 * who.size, build=0.0, habits=dict(who.habits))


@lru_cache(maxsize=128)
def _humanoid_skeleton(height: float, build: float) -> Skeleton:
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


def _humanoid_bones() -> tuple:
    skeleton, places = _humanoid_skeleton(1.75, 0.0), []
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
    bones=_humanoid_bones(),
    legs=tuple(Leg((f"{s}UpLeg", f"{s}Leg", f"{s}Foot", f"{s}ToeBase"), (0.0, 0.0)) for s in ("Left", "Right")),
    chains={"neck": ("Neck", "Neck1", "Head")},
    gaits={walk: walk for walk in WALKS},
    actions={name: CreatureAction(beats, _nothing) for name, beats in GESTURES.items() if name != "idle"},
    step=0.7,
    rate=1.85,
    life=_nothing,
    feet=("LeftFoot", "LeftToeBase", "RightFoot", "RightToeBase"),
)


_KINDS: dict[str, Species] = {kind.name: kind for kind in (DOG, CRAB, OSTRICH, DRAGON, HUMANOID)}
CREATURES = tuple(_KINDS)
_AROUND_CREATURE = 6.0  # beats planned before and after what is shown
_FASTER = 1.5  # how much quicker than a walk's the beats of a run or trot are
_STEADY = 0.5  # of a person's swerves: a long body swings far out in each


def get_creature(name: str | Creature, seed: int = 0) -> Creature:
    """A creature by its species' name and number (a `Creature` is passed on); MotionKitError names the nearest.

    >>> get_creature("crab").contents
    ('walk', 'walk_turn_left', 'walk_turn_right', 'idle', 'threat')
    """
    if isinstance(name, Creature):
        return name
    return Creature.from_seed(_KINDS[check.one_of("creature", name, _KINDS)], seed)


def perform_creature(
    content: str | Sequence[str] = "walk",
    style: str | Style = "neutral",
    seed: int = 0,
    *,
    seconds: float = 6.0,
    fps: float = 30.0,
    intensity: float = 1.0,
    creature: str | Creature = "dog",
    path: object = None,
) -> Performance:
    """A creature does something in some style.

    content: one of the creature's `contents`, or several ("walk, sit" or a list), each done once in that order. The
    rest as in `motionkit.actor.perform`. Returns a `Performance` of about `seconds`, whose performer is a `Creature`
    and whose contacts are [F, K], one for each of `Creature.feet`. Raises MotionKitError for unknown names, numbers
    that are not finite, and times that do not hold what is asked for.

    >>> p = perform_creature("trot", "proud", seed=1, seconds=4, creature="dog")
    >>> p.motion, p.contacts.shape
    (Motion('dog_trot_proud_1', 120 frames at 30 fps, 4.0 s, 33 joints), torch.Size([120, 4]))
    """
    who, style = get_creature(creature, seed), get_style(style)
    check_numbers(seconds, fps, intensity)
    names, wanted = contents_of(content, who), style.at(intensity) if intensity != 1 else style
    if who.name == HUMANOID.name:
        return _perform_humanoid(content, wanted, seed, who, seconds, fps, path)
    places, own = checked_path(path), who.as_done_by(wanted)
    score = _plan_seconds(
        seconds,
        seconds * who.species.rate * own.tempo,
        lambda beats: plan_creature_actions(who, names, int(seed), beats, places),
        lambda plan, axis: _beat_seconds(as_walked(plan, who), own, who, axis),
    )
    return perform_plan(score, ", ".join(names), wanted, who, fps, round(seconds * fps))


def synthesize_creature(
    score: MotionPlan, style: Style, creature: Creature, fps: float, frames: int | None = None
) -> tuple[Motion, Tensor, Tensor]:
    """The motion in float64, contacts [F, K] and beats [F] of a score. frames: F; left out, all that it holds."""
    if creature.name == HUMANOID.name:
        return _synthesize_humanoid(score, style, creature, fps, frames)
    own, walked = creature.as_done_by(style), as_walked(score, creature)
    axis = fine_axis(score.first - _AROUND_CREATURE, score.last + _AROUND_CREATURE)
    times = seconds_of(axis, _beat_seconds(walked, own, creature, axis))
    shown = interpolate(torch.tensor([score.first, score.last], dtype=axis.dtype), axis, times)
    count = frames or max(2, math.floor(float(shown[1] - shown[0]) * fps + 1e-6) + 1)
    seconds = torch.arange(count, dtype=torch.float64) / fps
    beats = interpolate(seconds + shown[0], times, axis)
    route = _creature_route(walked, own, creature, axis)
    at = PoseContext.of(score, own, creature, route, beats, seconds)
    curves = Curves(count)
    for layer in (creature_posture, creature_breath, creature_gait, creature.species.life, _creature_actions):
        layer(at, curves)
    for part in ("pitch", "yaw", "roll"):  # the head is the neck's last joint
        curves.add(f"{creature.species.chains['neck'][-1]}.{part}", curves[f"head.{part}"])
    plans = Footing(score, own, creature, route).plan()
    feet = [move_creature_foot(stands, leg, beats, own, creature) for stands, leg in zip(plans, creature.species.legs)]
    return assemble_creature(at, curves, feet, fps), torch.stack([f.stands for f in feet], 1), beats


def _creature_actions(at: PoseContext, curves: Curves) -> None:
    for act in at.score.acts:
        action = at.performer.species.actions.get(act.name)
        if action:
            size = 1 + 0.05 * at.style.variability * max(-2.0, min(2.0, act.size))
            action.add(at, curves, act, at.beats - act.start, at.style.reach * size)


def _beat_seconds(score: MotionPlan, style: Style, creature: Creature, beats: Tensor) -> Tensor:
    """Seconds that a beat takes, at each beat [F], as a person's; the larger the creature, the slower."""
    pace = creature.species.rate * creature.size**-0.5 * style.tempo
    pace = pace * (1 + 0.02 * style.variability * score.draw("pace"))
    duration = 1 / (pace * (1 + (_FASTER - 1) * score.weight(beats, ("run",))))
    limp = 1 - style.asymmetry * torch.cos(math.pi * (beats - 0.5))
    dwell = 1 + style.pauses * torch.cos(2 * math.pi * (beats - 0.08))
    varied = 1 + 0.025 * style.variability * score.noise("rhythm", beats).clamp(-2.5, 2.5)
    return duration * limp * dwell * varied


class _Stride:
    """What `plan_route` asks of a walker: the leg whose steps are as long as this creature's."""

    def __init__(self, creature: Creature) -> None:
        self.leg = creature.species.step * creature.size / WALK_STEP


def _creature_route(walked: MotionPlan, style: Style, creature: Creature, axis: Tensor) -> Route:
    steady = style.replace(wander=_STEADY * style.wander)
    route = plan_route(walked, steady, _Stride(creature), axis)
    facing = creature.species.facing
    if not facing or walked.path is not None:
        return route
    # who walks sideways starts facing +Z, as all do
    sine, cosine = math.sin(-facing), math.cos(facing)
    x, z = route.place[:, 0], route.place[:, 1]
    place = torch.stack((x * cosine + z * sine, z * cosine - x * sine), 1)
    return replace(route, place=place, heading=route.heading - facing)
