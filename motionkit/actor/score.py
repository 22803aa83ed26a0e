"""When things happen: how many seconds each beat takes, and the beat of every frame."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ..errors import MotionKitError, check
from .bodies import Creature, Performer
from .style import Style

FINE = 128  # points of the fine axis for a beat
WALK_RATE, RUN_RATE = 1.8, 2.5  # steps a second of a person with legs of 0.86 m
GRAVITY = 9.81


def fine_axis(first: float, last: float) -> Tensor:
    """Beats from first to last in steps of 1 / FINE, float64."""
    return torch.arange(math.floor(first * FINE), math.ceil(last * FINE) + 1, dtype=torch.float64) / FINE


def beat_seconds(score: MotionPlan, style: Style, performer: Performer, beats: Tensor) -> Tensor:
    """Seconds that a beat takes, at each beat [F]: pace, limp, pauses and chance; a jump's flight obeys gravity."""
    pace = style.tempo * (0.86 / performer.leg) ** 0.5 * (1 + 0.02 * style.variability * score.draw("pace"))
    run = score.weight(beats, ("run",))
    hurried = max(style.tempo, 1.0) ** -0.6  # running steps are quick already
    duration = 1 / (pace * (WALK_RATE + (RUN_RATE * hurried - WALK_RATE) * run))
    limp = 1 - style.asymmetry * torch.cos(math.pi * (beats - 0.5))
    dwell = 1 + style.pauses * torch.cos(2 * math.pi * (beats - 0.08))
    varied = 1 + 0.025 * style.variability * score.noise("rhythm", beats).clamp(-2.5, 2.5)
    duration = duration * limp * dwell * varied
    for act in score.acts:
        if act.name == "jump":
            flight = 2 * math.sqrt(2 * jump_height(style, performer, act.size) / GRAVITY)
            rise = act.start + JUMP_FLIGHT[0]
            near = smooth((beats - rise + 0.5) / 0.45) * smooth((rise + 1.5 - beats) / 0.45)
            duration = torch.lerp(duration, torch.full_like(duration, flight), near)
    return duration


JUMP_FLIGHT = (2.0, 3.0)  # beats of a jump between which no foot touches the ground


def jump_height(style: Style, performer: Performer, size: float) -> float:
    """How far the pelvis rises in flight, metres."""
    return performer.leg * 0.3 * style.reach**1.5 * (1 + 0.06 * style.variability * max(-2, min(2, size)))


def seconds_of(axis: Tensor, durations: Tensor) -> Tensor:
    """The time [F] of each point of a fine axis of beats, 0 at its start (trapezoid rule)."""
    steps = (axis[1:] - axis[:-1]) * (durations[1:] + durations[:-1]) / 2
    return torch.cat((steps.new_zeros(1), torch.cumsum(steps, 0)))


def interpolate(x: Tensor, xs: Tensor, ys: Tensor) -> Tensor:
    """Values at x [F] of the line through points xs [N], ys [N] or [N, D]; xs rises. Held at its ends.

    >>> interpolate(torch.tensor([0.5, 9.0]), torch.tensor([0.0, 1.0]), torch.tensor([0.0, 10.0]))
    tensor([ 5., 10.])
    """
    high = torch.searchsorted(xs, x.contiguous()).clamp(1, len(xs) - 1)
    share = ((x - xs[high - 1]) / (xs[high] - xs[high - 1])).clamp(0, 1)
    share = share.reshape(share.shape + (1,) * (ys.ndim - 1))
    return torch.lerp(ys[high - 1], ys[high], share)


WALKS = ("walk", "walk_turn_left", "walk_turn_right", "walk_back", "run")
GESTURES = {"jump": 5.0, "kick": 5.0, "punch": 5.0, "wave": 7.0, "raise_hands": 6.0, "bow": 6.0, "idle": 4.0}  # beats
CONTENTS = (*WALKS, *GESTURES)
RAMP = 2.0  # beats in which a walk starts and stops


@dataclass(frozen=True)
class Action:
    """Something done from beat `start` on, for so many `beats`. side: +1 with the left limb, -1 with the right.

    size: how large, in standard deviations from the usual. turn: radians that the walker turns, left above 0.
    """

    name: str
    start: float
    beats: float
    side: int = -1
    size: float = 0.0
    turn: float = 0.0

    @property
    def stop(self) -> float:
        """The beat after its last."""
        return self.start + self.beats


@dataclass(frozen=True)
class MotionPlan:
    """Acts in a row without gaps. first, last: the beats that are shown. path: [N, 2] metres to follow, or None."""

    acts: tuple[Action, ...]
    first: float
    last: float
    seed: int
    path: Tensor | None = None

    def weight(self, beats: Tensor, names: Sequence[str], ramp: float = RAMP) -> Tensor:
        """How much of the named acts there is at each beat [F], 0 to 1; ramps lie inside an act's ends.

        A neighbour of the same kind needs no ramp, nor does the beginning or end of the score.
        """
        result = torch.zeros_like(beats)
        for n, act in enumerate(self.acts):
            if act.name not in names:
                continue
            before = n > 0 and self.acts[n - 1].name not in names
            after = n + 1 < len(self.acts) and self.acts[n + 1].name not in names
            inside = torch.ones_like(beats)
            if before:
                inside = inside * smooth((beats - act.start) / ramp)
            elif n:
                inside = inside * (beats >= act.start)
            if after:
                inside = inside * smooth((act.stop - beats) / ramp)
            elif n + 1 < len(self.acts):
                inside = inside * (beats < act.stop)
            result = result + inside
        return result

    def noise(self, name: str, beats: Tensor, slow: float = 1.0) -> Tensor:
        """Smooth chance [F] of about standard deviation 1 that is the same in every style; slow: above 1 it lingers."""
        chance = random.Random(f"{self.seed} {name}")
        result = torch.zeros_like(beats)
        for _ in range(4):
            rate, phase = chance.uniform(0.04, 0.3) / slow, chance.uniform(0, 2 * math.pi)
            result = result + torch.sin(2 * math.pi * rate * beats + phase)
        return result * 0.5**0.5

    def draw(self, name: str) -> float:
        """One number of chance, standard deviation 1, at most 2.5."""
        return max(-2.5, min(2.5, random.Random(f"{self.seed} {name}").gauss(0, 1)))


def smooth(x: Tensor) -> Tensor:
    """0 to 1 with neither kink nor jerk at either end (minimum jerk, Flash and Hogan 1985, eq. 8).

    >>> smooth(torch.tensor([-1.0, 0.5, 2.0]))
    tensor([0.0000, 0.5000, 1.0000])
    """
    x = x.clamp(0, 1)
    return x * x * x * (x * (6 * x - 15) + 10)


def contents_of(content: str | Sequence[str], creature: Creature | None = None) -> tuple[str, ...]:
    """One content or several ("walk, jump, kick" or a list); MotionKitError names the nearest of an unknown one.

    creature: who is to do it; a person, if left out.

    >>> contents_of("walk, jump")
    ('walk', 'jump')
    """
    if not isinstance(content, str | Sequence):
        raise MotionKitError(f"content: expected a name or a list of names; found {content!r}")
    known, owner = (creature.contents, f"a {creature.name} has ") if creature else (CONTENTS, "")
    names = tuple(str(n).strip() for n in (content.split(",") if isinstance(content, str) else content))
    if not names:
        who = f"a {creature.name} can" if creature else "there are"
        raise MotionKitError(f"no content given; {who} {', '.join(known)}")
    return tuple(check.one_of("content", name, known, owner=owner) for name in names)


def plan_actions(
    contents: tuple[str, ...], seed: int, beats: float, path: Tensor | None = None, seconds: float | None = None
) -> MotionPlan:
    """A score of about so many beats. One gesture is done again and again with rests; of several each is done once.

    seconds: how long so many beats take, for messages. Raises MotionKitError if they do not hold what is asked for.
    """
    chance = random.Random(f"{seed} {' '.join(contents)}")
    least = _least(contents)
    if beats < least:
        rate, unit = (seconds / beats, "s") if seconds else (1.0, "beats")
        needed = f"{least * rate:.1f} {unit}; found {beats * rate:.1f}"
        raise MotionKitError(
            f"{', '.join(contents)}: in this style at least {needed}; give more seconds, or a quicker style"
        )
    if len(contents) > 1:
        acts = _sequence(contents, beats, chance)
        return MotionPlan(acts, 0.0, acts[-1].stop, seed, path)
    if contents[0] in WALKS:
        first = chance.uniform(0, 2)
        walk = _walk(contents[0], -4.0, first + beats + 8, chance)
        return MotionPlan((walk,), first, first + beats, seed, path)
    return MotionPlan(_gestures(contents[0], beats, chance), 0.0, beats, seed, path)


def _least(contents: tuple[str, ...]) -> float:
    """Beats that contents take at the least; one walk or idling takes any."""
    if len(contents) == 1:
        return 0.0 if contents[0] in (*WALKS, "idle") else GESTURES[contents[0]]
    walks = sum(c in WALKS for c in contents)
    return sum(GESTURES.get(c, 0.0) for c in contents) + walks * 2 * RAMP + (0 if walks else 0.5)


def _walk(name: str, start: float, length: float, chance: random.Random) -> Action:
    turn = 0.0
    if name.startswith("walk_turn"):
        turn = math.radians(chance.uniform(70, 200)) * (1 if name.endswith("left") else -1)
    return Action(name, start, length, 1, chance.gauss(0, 1), turn)


def _gestures(name: str, beats: float, chance: random.Random) -> tuple[Action, ...]:
    length = GESTURES[name]
    if name == "idle":
        return (Action("idle", -1.0, beats + 2),)
    count = max(1, int((beats - 0.5) // (length + 0.6)))
    rest = (beats - count * length) / (count + 1)
    acts, now, side = [], 0.0, chance.choice((1, -1))
    for _ in range(count):
        wait = min(rest, chance.uniform(0.3, 1.0) * rest + 0.2)
        acts += [Action("idle", now, wait), Action(name, now + wait, length, side, chance.gauss(0, 1))]
        now, side = now + wait + length, -side if name in ("kick", "punch") else side
    acts.append(Action("idle", now, max(beats - now, 0) + 2))
    return tuple(acts)


def _sequence(contents: tuple[str, ...], beats: float, chance: random.Random) -> tuple[Action, ...]:
    """Each once, in order: gestures take what they need, walks share the rest."""
    walks = sum(c in WALKS for c in contents)
    fixed = sum(GESTURES.get(c, 0.0) for c in contents)
    acts, now = [], 0.0
    for name in contents:
        length = GESTURES.get(name) or (beats - fixed) / walks
        if name in WALKS:
            acts.append(_walk(name, now, length, chance))
        else:
            acts.append(Action(name, now, length, chance.choice((1, -1)), chance.gauss(0, 1)))
        now += length
    if now < beats:
        acts.append(Action("idle", now, beats - now))
    return tuple(acts)


def plan_creature_actions(
    creature: Creature, contents: tuple[str, ...], seed: int, beats: float, path: Tensor | None
) -> MotionPlan:
    """A score of about so many beats. One action is done again and again with rests; of several each is done once.

    Raises MotionKitError if the beats do not hold what is asked for.
    """
    species = creature.species
    chance = random.Random(f"{seed} {species.name} {' '.join(contents)}")
    if len(contents) > 1:
        acts = _creature_sequence(creature, contents, beats, chance)
        return MotionPlan(acts, 0.0, acts[-1].stop, seed, path)
    name = contents[0]
    if name in species.gaits:
        first = chance.uniform(0, 2)
        return MotionPlan((_creature_walk(name, -4.0, first + beats + 8, chance),), first, first + beats, seed, path)
    if name == "idle":
        return MotionPlan((Action("idle", -1.0, beats + 2),), 0.0, beats, seed, path)
    return MotionPlan(_again(creature, name, beats, chance), 0.0, beats, seed, path)


def _creature_walk(name: str, start: float, length: float, chance: random.Random) -> Action:
    turn = 0.0
    if "turn" in name:
        turn = math.radians(chance.uniform(40, 95)) * (1 if name.endswith("left") else -1)
    return Action(name, start, length, 1, chance.gauss(0, 1), turn)


def _again(creature: Creature, name: str, beats: float, chance: random.Random) -> tuple[Action, ...]:
    length = creature.species.actions[name].beats
    if beats < length:
        raise MotionKitError(
            f"one {name} of a {creature.name} takes {length:g} beats and the clip holds {beats:.1f}; give more "
            "seconds, or a quicker style"
        )
    count = max(1, int((beats - 0.5) // (length + 0.8)))
    rest = (beats - count * length) / (count + 1)
    acts, now, side = [], 0.0, chance.choice((1, -1))
    for _ in range(count):
        wait = rest * chance.uniform(0.5, 1.0)
        acts += [Action("idle", now, wait), Action(name, now + wait, length, side, chance.gauss(0, 1))]
        now, side = now + wait + length, -side
    return (*acts, Action("idle", now, max(beats - now, 0) + 2))


def _creature_sequence(
    creature: Creature, contents: tuple[str, ...], beats: float, chance: random.Random
) -> tuple[Action, ...]:
    """Each once, in order: actions take what they need, walks and rests share what is left."""
    actions = creature.species.actions
    shared = [c for c in contents if c not in actions]
    fixed = sum(actions[c].beats for c in contents if c in actions)
    least = fixed + len(shared) * 2 * RAMP
    if beats < least:
        raise MotionKitError(
            f"{', '.join(contents)} of a {creature.name} take at least {least:g} beats and the clip holds "
            f"{beats:.1f}; give more seconds"
        )
    acts, now = [], 0.0
    for name in contents:
        if name in actions:
            act = Action(name, now, actions[name].beats, chance.choice((1, -1)), chance.gauss(0, 1))
        else:
            length = (beats - fixed) / len(shared)
            act = (
                _creature_walk(name, now, length, chance)
                if name in creature.species.gaits
                else Action(name, now, length)
            )
        acts.append(act)
        now = act.stop
    if now < beats:
        acts.append(Action("idle", now, beats - now))
    return tuple(acts)


def as_walked(score: MotionPlan, creature: Creature) -> MotionPlan:
    """The score in the words of `plan_route`: a dog's trot leads along as a person's run does."""
    ways = creature.species.gaits
    return replace(score, acts=tuple(replace(act, name=ways.get(act.name, "idle")) for act in score.acts))
