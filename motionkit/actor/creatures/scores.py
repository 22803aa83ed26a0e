"""What a creature is meant to do, on an axis of beats."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from ...errors import MotionKitError
from ..score import RAMP, Act, Score
from ..style import nearest
from .species import Creature


def contents_for(creature: Creature, content: str | Sequence[str]) -> tuple[str, ...]:
    """One content or several; MotionKitError names the nearest of what this creature cannot do.

    >>> from motionkit.actor.creatures import creature_named
    >>> contents_for(creature_named("dog"), "walk, sit")
    ('walk', 'sit')
    """
    names = content.split(",") if isinstance(content, str) else list(content)
    names = tuple(str(n).strip() for n in names)
    for name in names:
        if name not in creature.contents:
            raise MotionKitError(f"a {creature.name} has no content {name!r}; {nearest(name, list(creature.contents))}")
    if not names:
        raise MotionKitError(f"no content given; a {creature.name} can {', '.join(creature.contents)}")
    return names


def compose(creature: Creature, contents: tuple[str, ...], seed: int, beats: float, path: Tensor | None) -> Score:
    """A score of about so many beats. One deed is done again and again with rests; of several each is done once.

    Raises MotionKitError if the beats do not hold what is asked for.
    """
    species = creature.species
    chance = random.Random(f"{seed} {species.name} {' '.join(contents)}")
    if len(contents) > 1:
        acts = _sequence(creature, contents, beats, chance)
        return Score(acts, 0.0, acts[-1].stop, seed, path)
    name = contents[0]
    if name in species.gaits:
        first = chance.uniform(0, 2)
        return Score((_walk(name, -4.0, first + beats + 8, chance),), first, first + beats, seed, path)
    if name == "idle":
        return Score((Act("idle", -1.0, beats + 2),), 0.0, beats, seed, path)
    return Score(_again(creature, name, beats, chance), 0.0, beats, seed, path)


def _walk(name: str, start: float, length: float, chance: random.Random) -> Act:
    turn = 0.0
    if "turn" in name:
        turn = math.radians(chance.uniform(40, 95)) * (1 if name.endswith("left") else -1)
    return Act(name, start, length, 1, chance.gauss(0, 1), turn)


def _again(creature: Creature, name: str, beats: float, chance: random.Random) -> tuple[Act, ...]:
    length = creature.species.deeds[name].beats
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
        acts += [Act("idle", now, wait), Act(name, now + wait, length, side, chance.gauss(0, 1))]
        now, side = now + wait + length, -side
    return (*acts, Act("idle", now, max(beats - now, 0) + 2))


def _sequence(
    creature: Creature, contents: tuple[str, ...], beats: float, chance: random.Random
) -> tuple[Act, ...]:
    """Each once, in order: deeds take what they need, walks and rests share what is left."""
    deeds = creature.species.deeds
    shared = [c for c in contents if c not in deeds]
    fixed = sum(deeds[c].beats for c in contents if c in deeds)
    least = fixed + len(shared) * 2 * RAMP
    if beats < least:
        raise MotionKitError(
            f"{', '.join(contents)} of a {creature.name} take at least {least:g} beats and the clip holds "
            f"{beats:.1f}; give more seconds"
        )
    acts, now = [], 0.0
    for name in contents:
        if name in deeds:
            act = Act(name, now, deeds[name].beats, chance.choice((1, -1)), chance.gauss(0, 1))
        else:
            length = (beats - fixed) / len(shared)
            act = _walk(name, now, length, chance) if name in creature.species.gaits else Act(name, now, length)
        acts.append(act)
        now = act.stop
    if now < beats:
        acts.append(Act("idle", now, beats - now))
    return tuple(acts)


def as_walked(score: Score, creature: Creature) -> Score:
    """The score in the words of `plan_route`: a dog's trot leads along as a person's run does."""
    ways = creature.species.gaits
    return replace(score, acts=tuple(replace(act, name=ways.get(act.name, "idle")) for act in score.acts))
