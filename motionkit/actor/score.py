"""What is meant to happen, before anybody performs it: acts on an axis of beats, and where they lead.

A beat is one step of a walk. The same score in two styles gives two motions that agree beat by beat, and so the exact
answer of a style transfer is known.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..errors import MotionKitError
from .style import nearest

WALKS = ("walk", "walk_turn_left", "walk_turn_right", "walk_back", "run")
GESTURES = {"jump": 5.0, "kick": 5.0, "punch": 5.0, "wave": 7.0, "raise_hands": 6.0, "bow": 6.0, "idle": 4.0}  # beats
CONTENTS = (*WALKS, *GESTURES)
RAMP = 2.0  # beats in which a walk starts and stops


@dataclass(frozen=True)
class Act:
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
class Score:
    """Acts in a row without gaps. first, last: the beats that are shown. path: [N, 2] metres to follow, or None."""

    acts: tuple[Act, ...]
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


def contents_of(content: str | Sequence[str]) -> tuple[str, ...]:
    """One content or several ("walk, jump, kick" or a list); MotionKitError names the nearest of an unknown one.

    >>> contents_of("walk, jump")
    ('walk', 'jump')
    """
    if not isinstance(content, str | Sequence):
        raise MotionKitError(f"content: expected a name or a list of names; found {content!r}")
    names = content.split(",") if isinstance(content, str) else list(content)
    names = tuple(str(n).strip() for n in names)
    for name in names:
        if name not in CONTENTS:
            raise MotionKitError(f"no content {name!r}; {nearest(name, CONTENTS)}")
    if not names:
        raise MotionKitError(f"no content given; there are {', '.join(CONTENTS)}")
    return names


def compose(
    contents: tuple[str, ...], seed: int, beats: float, path: Tensor | None = None, seconds: float | None = None
) -> Score:
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
        return Score(acts, 0.0, acts[-1].stop, seed, path)
    if contents[0] in WALKS:
        first = chance.uniform(0, 2)
        walk = _walk(contents[0], -4.0, first + beats + 8, chance)
        return Score((walk,), first, first + beats, seed, path)
    return Score(_gestures(contents[0], beats, chance), 0.0, beats, seed, path)


def _least(contents: tuple[str, ...]) -> float:
    """Beats that contents take at the least; one walk or idling takes any."""
    if len(contents) == 1:
        return 0.0 if contents[0] in (*WALKS, "idle") else GESTURES[contents[0]]
    walks = sum(c in WALKS for c in contents)
    return sum(GESTURES.get(c, 0.0) for c in contents) + walks * 2 * RAMP + (0 if walks else 0.5)


def _walk(name: str, start: float, length: float, chance: random.Random) -> Act:
    turn = 0.0
    if name.startswith("walk_turn"):
        turn = math.radians(chance.uniform(70, 200)) * (1 if name.endswith("left") else -1)
    return Act(name, start, length, 1, chance.gauss(0, 1), turn)


def _gestures(name: str, beats: float, chance: random.Random) -> tuple[Act, ...]:
    length = GESTURES[name]
    if name == "idle":
        return (Act("idle", -1.0, beats + 2),)
    count = max(1, int((beats - 0.5) // (length + 0.6)))
    rest = (beats - count * length) / (count + 1)
    acts, now, side = [], 0.0, chance.choice((1, -1))
    for _ in range(count):
        wait = min(rest, chance.uniform(0.3, 1.0) * rest + 0.2)
        acts += [Act("idle", now, wait), Act(name, now + wait, length, side, chance.gauss(0, 1))]
        now, side = now + wait + length, -side if name in ("kick", "punch") else side
    acts.append(Act("idle", now, max(beats - now, 0) + 2))
    return tuple(acts)


def _sequence(contents: tuple[str, ...], beats: float, chance: random.Random) -> tuple[Act, ...]:
    """Each once, in order: gestures take what they need, walks share the rest."""
    walks = sum(c in WALKS for c in contents)
    fixed = sum(GESTURES.get(c, 0.0) for c in contents)
    acts, now = [], 0.0
    for name in contents:
        length = GESTURES.get(name) or (beats - fixed) / walks
        if name in WALKS:
            acts.append(_walk(name, now, length, chance))
        else:
            acts.append(Act(name, now, length, chance.choice((1, -1)), chance.gauss(0, 1)))
        now += length
    if now < beats:
        acts.append(Act("idle", now, beats - now))
    return tuple(acts)
