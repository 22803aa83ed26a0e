"""Who moves: a performer's height, build and habits, and the skeleton that follows from them."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from functools import lru_cache

import torch

from ..errors import MotionKitError
from ..skeleton import Skeleton, smpl
from .style import Style, parameters

HEEL = 0.038  # from the ankle back to the heel, shares of the height

# What differs from person to person, as one standard deviation, and whether it scales the number or adds to it.
_HABITS = {
    "tempo": ("x", 0.03), "step_length": ("x", 0.04), "arm_swing": ("x", 0.12), "bob": ("x", 0.12),
    "sway": ("x", 0.12), "hip_turn": ("x", 0.15), "shoulder_turn": ("x", 0.15), "reach": ("x", 0.03),
    "step_width": ("+", 0.015), "toe_out": ("+", 0.04), "lean": ("+", 0.02), "slump": ("+", 0.03),
    "head_pitch": ("+", 0.03), "arm_out": ("+", 0.025), "elbow_bend": ("+", 0.05), "arm_turn": ("+", 0.06),
}  # fmt: skip


@dataclass(frozen=True)
class Performer:
    """A person. seed: which one. height: metres, 1.5 to 1.95. build: -1 slender to 1 broad. habits: see `as_done_by`.

    >>> person = Performer.from_seed(3)
    >>> 1.5 <= person.height <= 1.95
    True
    """

    seed: int = 0
    height: float = 1.75
    build: float = 0.0
    habits: dict[str, float] = field(default_factory=dict, hash=False)

    @classmethod
    def from_seed(cls, seed: int) -> Performer:
        """The person of a number; the same one on every machine."""
        chance = random.Random(f"performer {seed}")
        height, build = chance.uniform(1.5, 1.95), chance.uniform(-1, 1)
        habits = {name: max(-2.0, min(2.0, chance.gauss(0, 1))) * size for name, (_, size) in _HABITS.items()}
        return cls(int(seed), height, build, habits)

    def __post_init__(self) -> None:
        unknown = set(self.habits) - set(_HABITS)
        if unknown:
            raise MotionKitError(f"habits: no {sorted(unknown)[0]!r}; a person differs in {', '.join(_HABITS)}")
        if not isinstance(self.height, int | float) or not 0.4 <= self.height <= 3.0 or not -1.5 <= self.build <= 1.5:
            raise MotionKitError(
                f"a performer is 0.4 to 3 m tall with a build of -1.5 to 1.5; found height {self.height!r}, build "
                f"{self.build!r}"
            )

    @property
    def leg(self) -> float:
        """Hip to ankle, metres."""
        return self.height * (0.245 + 0.246)

    @property
    def skeleton(self) -> Skeleton:
        """22 joints with SMPL's names and order, in T-pose facing +Z."""
        return _skeleton(self.height, self.build)

    def as_done_by(self, style: Style) -> Style:
        """The style as this person does it: habits added to it, in their ranges."""
        changes = {}
        for name, amount in self.habits.items():
            about, value = parameters()[name], getattr(style, name)
            value = value * (1 + amount) if _HABITS[name][0] == "x" else value + amount
            changes[name] = min(max(value, about.low), about.high)
        return style.replace(**changes)


def performer_of(given: Performer | int | None, seed: int) -> Performer:
    """A performer as users name one: a number, a `Performer`, or none (then the clip's seed decides)."""
    if not isinstance(seed, int):
        raise MotionKitError(f"seed: expected a whole number; found {seed!r}")
    if isinstance(given, Performer):
        return given
    if given is None:
        return Performer.from_seed(seed)
    if isinstance(given, int):
        return Performer.from_seed(given)
    raise MotionKitError(f"performer: expected a number, a Performer or None; found {given!r}")


@lru_cache(maxsize=256)
def _skeleton(height: float, build: float) -> Skeleton:
    return smpl(height, 0.1 * build, torch.float64)
