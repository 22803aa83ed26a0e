"""Performing: a content in a style with all that is known of it, and the same intention told in another style."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion
from .body import Performer, performer_of
from .captions import captions
from .clock import beat_seconds, fine_axis, interpolate, seconds_of
from .feet import move_foot
from .gestures import gestures
from .layers import Curves, Moment, breath, gait, posture
from .paths import checked_path
from .pose import assemble
from .presets import style_named
from .route import plan_route
from .score import Score, compose, contents_of
from .steps import SIDES, Planner
from .style import Style

if TYPE_CHECKING:
    from .creatures import Creature

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
    score: Score
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

    def along(self, other: Performance) -> Motion:
        """This motion in the other's time: in each frame it is at the same beat as the other is.

        For a `retell`ing of the other, that is the exact answer of a style transfer that keeps the other's timing.
        Raises MotionKitError if the two do not tell the same score.
        """
        if other.score is not self.score:
            raise MotionKitError(
                f"{self!r} and {other!r} are not tellings of one score; make one with retell(other, style)"
            )
        return self.motion.at(self.frames_at(other.beats)).replace(fps=other.motion.fps)


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
        from . import creatures

        return creatures.perform(
            content, style, seed, seconds=seconds, fps=fps, intensity=intensity, creature=performer, path=path
        )
    names, style = contents_of(content), style_named(style)
    check_numbers(seconds, fps, intensity)
    person, wanted = performer_of(performer, seed), style.at(intensity) if intensity != 1 else style
    score = _fitting(names, int(seed), seconds, wanted, person, checked_path(path))
    return _tell(score, ", ".join(names), wanted, person, fps, round(seconds * fps))


def retell(performance: Performance, style: str | Style, intensity: float = 1.0) -> Performance:
    """The same intention in another style: same acts, same chance, same person; what differs is the style alone.

    The result agrees with the original beat by beat (`along` brings it to the original's frames). It takes the time
    that the style takes.

    >>> p = perform("walk", "neutral", seed=1, seconds=4)
    >>> old = retell(p, "old")
    >>> len(old) > len(p), len(old.along(p)) == len(p)
    (True, True)
    """
    if not isinstance(performance, Performance):
        raise MotionKitError(
            f"retell: only what the performer did can be told again, as of perform('walk'); found {performance!r}. "
            "For a motion from a file take a method: methods.load('statistics').stylize(...)"
        )
    wanted = style_named(style).at(intensity) if intensity != 1 else style_named(style)
    told = performance.score, performance.content, wanted, performance.performer, performance.motion.fps
    if isinstance(performance.performer, Performer):
        return _tell(*told)
    from .creatures import tell

    return tell(*told)


def check_numbers(seconds: float, fps: float, intensity: float) -> None:
    """MotionKitError for a length, frame rate or intensity that cannot be performed."""
    for what, value, least in (("seconds", seconds, 0.1), ("fps", fps, 1.0), ("intensity", intensity, -10.0)):
        if not isinstance(value, int | float) or not math.isfinite(value) or value < least:
            raise MotionKitError(f"{what}: expected a number of at least {least:g}; found {value!r}")
    if fps > 1000:
        raise MotionKitError(f"fps: at most 1000; found {fps!r}")
    if seconds > 3600:
        raise MotionKitError(f"seconds: at most 3600 in one performance; found {seconds!r}")


def _fitting(
    names: tuple[str, ...], seed: int, seconds: float, style: Style, person: Performer, path: Tensor | None
) -> Score:
    """The score whose performance takes so many seconds: beats and seconds depend on each other, so look twice."""
    own = person.as_done_by(style)
    beats = seconds * 1.85 * own.tempo
    for _ in range(8):
        score = compose(names, seed, beats, path, seconds)
        taken = _length(score, own, person)
        if abs(taken - seconds) < 1e-3:
            break
        beats *= seconds / taken
    return score


def _length(score: Score, own: Style, person: Performer) -> float:
    axis = fine_axis(score.first, score.last)
    times = seconds_of(axis, beat_seconds(score, own, person, axis))
    ends = interpolate(torch.tensor([score.first, score.last], dtype=axis.dtype), axis, times)
    return float(ends[1] - ends[0])


def _tell(
    score: Score, content: str, style: Style, person: Performer, fps: float, frames: int | None = None
) -> Performance:
    motion, contacts, beats = realise(score, style, person, fps, frames)
    name = f"{content.replace(', ', '-')}_{style.name}_{score.seed}"
    motion = replace(
        motion,
        skeleton=motion.skeleton.as_float(),
        rotations=motion.rotations.float(),
        translations=motion.translations.float(),
        name=name,
    )
    told = captions(content, style, score.seed, acts=score.acts)
    return Performance(motion, contacts, beats, content, style, score.seed, person, score, told)


def realise(
    score: Score, style: Style, person: Performer, fps: float, frames: int | None = None
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
    at = Moment.of(score, own, person, route, beats, seconds)
    curves = Curves(count)
    for layer in (posture, breath, gait, gestures):
        layer(at, curves)
    plants = Planner(score, own, person, route).plan()
    feet = {side: move_foot(plants[side], beats, own, person) for side in SIDES}
    contacts = torch.cat([feet[side].stands for side in SIDES], 1)
    return assemble(at, curves, feet, fps), contacts, beats
