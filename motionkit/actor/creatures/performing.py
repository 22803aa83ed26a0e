"""Creatures perform as people do: a content in a style, with exact contacts, and told again in another style."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ...errors import MotionKitError
from ...motion import Motion
from ..captions import captions
from ..clock import fine_axis, interpolate, seconds_of
from ..layers import Curves, Moment
from ..paths import checked_path
from ..performing import Performance, check_numbers
from ..presets import style_named
from ..route import WALK_STEP, Route, plan_route
from ..score import Score
from ..style import Style, nearest
from . import humanoid
from .crab import CRAB
from .dog import DOG
from .dragon import DRAGON
from .footing import Footing, move_foot
from .life import breath, gait, posture
from .ostrich import OSTRICH
from .pose import assemble
from .scores import as_walked, compose, contents_for
from .species import Creature, Species

_KINDS: dict[str, Species] = {kind.name: kind for kind in (DOG, CRAB, OSTRICH, DRAGON, humanoid.HUMANOID)}
CREATURES = tuple(_KINDS)
_AROUND = 6.0  # beats planned before and after what is shown
_FASTER = 1.5  # how much quicker than a walk's the beats of a run or trot are
_STEADY = 0.5  # of a person's swerves: a long body swings far out in each


def creature_named(name: str | Creature, seed: int = 0) -> Creature:
    """A creature by its species' name and number (a `Creature` is passed on); MotionKitError names the nearest.

    >>> creature_named("crab").contents
    ('walk', 'walk_turn_left', 'walk_turn_right', 'idle', 'threat')
    """
    if isinstance(name, Creature):
        return name
    if name not in _KINDS:
        raise MotionKitError(f"no creature {name!r}; {nearest(name, _KINDS)}")
    return Creature.from_seed(_KINDS[name], seed)


def perform(
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

    >>> p = perform("trot", "proud", seed=1, seconds=4, creature="dog")
    >>> p.motion, p.contacts.shape
    (Motion('dog_trot_proud_1', 120 frames at 30 fps, 4.0 s, 33 joints), torch.Size([120, 4]))
    """
    who, style = creature_named(creature, seed), style_named(style)
    check_numbers(seconds, fps, intensity)
    names, wanted = contents_for(who, content), style.at(intensity) if intensity != 1 else style
    if who.name == humanoid.HUMANOID.name:
        return humanoid.perform(content, wanted, seed, who, seconds, fps, path)
    score = _fitting(names, int(seed), seconds, wanted, who, checked_path(path))
    return tell(score, ", ".join(names), wanted, who, fps, round(seconds * fps))


def tell(
    score: Score, content: str, style: Style, creature: Creature, fps: float, frames: int | None = None
) -> Performance:
    """A score as a performance in float32, with its name."""
    motion, contacts, beats = realise(score, style, creature, fps, frames)
    motion = replace(
        motion,
        skeleton=motion.skeleton.as_float(),
        rotations=motion.rotations.float(),
        translations=motion.translations.float(),
        name=f"{creature.name}_{content.replace(', ', '-')}_{style.name}_{score.seed}",
    )
    told = captions(content, style, score.seed, subject=f"a {creature.name}", acts=score.acts)
    return Performance(motion, contacts, beats, content, style, score.seed, creature, score, told)


def realise(
    score: Score, style: Style, creature: Creature, fps: float, frames: int | None = None
) -> tuple[Motion, Tensor, Tensor]:
    """The motion in float64, contacts [F, K] and beats [F] of a score. frames: F; left out, all that it holds."""
    if creature.name == humanoid.HUMANOID.name:
        return humanoid.realise(score, style, creature, fps, frames)
    own, walked = creature.as_done_by(style), as_walked(score, creature)
    axis = fine_axis(score.first - _AROUND, score.last + _AROUND)
    times = seconds_of(axis, _beat_seconds(walked, own, creature, axis))
    shown = interpolate(torch.tensor([score.first, score.last], dtype=axis.dtype), axis, times)
    count = frames or max(2, math.floor(float(shown[1] - shown[0]) * fps + 1e-6) + 1)
    seconds = torch.arange(count, dtype=torch.float64) / fps
    beats = interpolate(seconds + shown[0], times, axis)
    route = _route(walked, own, creature, axis)
    at = Moment.of(score, own, creature, route, beats, seconds)
    curves = Curves(count)
    for layer in (posture, breath, gait, creature.species.life, _deeds):
        layer(at, curves)
    for part in ("pitch", "yaw", "roll"):  # the head is the neck's last joint
        curves.add(f"{creature.species.chains['neck'][-1]}.{part}", curves[f"head.{part}"])
    plans = Footing(score, own, creature, route).plan()
    feet = [move_foot(stands, leg, beats, own, creature) for stands, leg in zip(plans, creature.species.legs)]
    return assemble(at, curves, feet, fps), torch.stack([f.stands for f in feet], 1), beats


def _deeds(at: Moment, curves: Curves) -> None:
    for act in at.score.acts:
        deed = at.performer.species.deeds.get(act.name)
        if deed:
            size = 1 + 0.05 * at.style.variability * max(-2.0, min(2.0, act.size))
            deed.add(at, curves, act, at.beats - act.start, at.style.reach * size)


def _beat_seconds(score: Score, style: Style, creature: Creature, beats: Tensor) -> Tensor:
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


def _route(walked: Score, style: Style, creature: Creature, axis: Tensor) -> Route:
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


def _fitting(
    names: tuple[str, ...], seed: int, seconds: float, style: Style, creature: Creature, path: Tensor | None
) -> Score:
    """The score whose performance takes so many seconds: beats and seconds depend on each other, so look again."""
    own = creature.as_done_by(style)
    beats = seconds * creature.species.rate * own.tempo
    for _ in range(8):
        score = compose(creature, names, seed, beats, path)
        axis = fine_axis(score.first, score.last)
        times = seconds_of(axis, _beat_seconds(as_walked(score, creature), own, creature, axis))
        ends = interpolate(torch.tensor([score.first, score.last], dtype=axis.dtype), axis, times)
        taken = float(ends[1] - ends[0])
        if abs(taken - seconds) < 1e-3:
            break
        beats *= seconds / taken
    return score
