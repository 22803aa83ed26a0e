"""Who moves: a performer's height, build and habits, and the skeleton that follows from them."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import torch
from torch import Tensor

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


def get_performer(given: Performer | int | None, seed: int) -> Performer:
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


_OTHER_SIDE = (("Left", "Right"), ("left", "right"), ("_L", "_R"))
Bone = tuple  # name, parent's name, place at rest (x, y, z) in metres, and the bone end's place where there is one


@dataclass(frozen=True)
class Leg:
    """A leg of three bones. joints: hip, knee, ankle, and the joint on the ground (ball of the foot, or a claw's tip).

    lands: when in a cycle of two beats it lands, 0 to 1, walking and running. blade: the shoulder blade that swings
    along. fold: how far the foot folds back in the swing, radians.
    """

    joints: tuple[str, str, str, str]
    lands: tuple[float, float]
    blade: str | None = None
    fold: float = 0.5

    @property
    def side(self) -> int:
        """+1 left, -1 right."""
        return 1 if mirrored(self.joints[0], to_right=True) != self.joints[0] else -1

    @property
    def foot(self) -> str:
        """The joint on the ground."""
        return self.joints[3]


@dataclass(frozen=True)
class CreatureAction:
    """Something done in place. beats: how long. add: puts it on the curves, given (moment, curves, act, beats since its
    start, reach). steps: (leg's number, beat when it lifts, beat when it lands, metres ahead of where it stood).
    """

    beats: float
    add: Callable
    steps: tuple[tuple[int, float, float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Species:
    """A kind of creature, in metres, seconds and beats (half a cycle of the legs).

    bones: rest pose. chains: joints of `spine`, `neck`, `tail` and what else there is, from the trunk outwards, which
    share the curves of that name, follow one after the other and, but for the spine, keep off the floor. gaits: what
    travels, each with the way that `plan_route` knows. step, rate: metres and beats a second of the neutral walk. duty:
    share of a cycle in which a leg stands, walking and running. life: puts what is its own on the curves, given
    (moment, curves). facing: yaw of the body against where it goes. droop: how much a rounded back bends the neck.
    sway, waddle, roll: how much it has of a person's sway, of hips that turn, and of feet that roll. feet: joints that
    stand, where they are not just the last of each leg.
    """

    name: str
    bones: tuple[Bone, ...]
    legs: tuple[Leg, ...]
    chains: dict[str, tuple[str, ...]]
    gaits: dict[str, str]
    actions: dict[str, CreatureAction]
    step: float
    rate: float
    life: Callable
    duty: tuple[float, float] = (0.62, 0.45)
    facing: float = 0.0
    droop: float = 1.0
    sway: float = 1.0
    waddle: float = 1.0
    roll: float = 0.6
    feet: tuple[str, ...] = ()

    @property
    def contents(self) -> tuple[str, ...]:
        """All that it can do."""
        return (*self.gaits, "idle", *self.actions)


def mirrored(name: str, *, to_right: bool = True) -> str:
    """The name of the joint on the other side; the same name on the midline.

    >>> mirrored("LeftHock"), mirrored("hip_L"), mirrored("Chest")
    ('RightHock', 'hip_R', 'Chest')
    """
    for left, right in _OTHER_SIDE:
        mine, other = (left, right) if to_right else (right, left)
        if mine in name:
            return name.replace(mine, other)
    return name


def both_sides(bones: Sequence[Bone]) -> tuple[Bone, ...]:
    """Bones of the left and the midline, with the right ones put in: after each run of left bones its mirror image."""
    result, run = [], []
    for bone in (*bones, None):
        left = bone is not None and mirrored(bone[0]) != bone[0]
        if run and (not left or bone[1] not in [b[0] for b in run]):
            result += run + [_mirrored_bone(b) for b in run]
            run = []
        if left:
            run.append(bone)
        elif bone is not None:
            result.append(bone)
    return tuple(result)


def _mirrored_bone(bone: Bone) -> Bone:
    name, parent, *places = bone
    return (mirrored(name), mirrored(parent), *((-x, y, z) for x, y, z in places))


@dataclass(frozen=True, eq=False)
class Creature:
    """One creature of a species. seed: which one. size: x, against the usual. habits: as a `Performer`'s.

    >>> from motionkit.actor.performing import get_creature
    >>> dog = get_creature("dog", seed=2)
    >>> dog.name, 0.85 <= dog.size <= 1.15, len(dog.feet)
    ('dog', True, 4)
    """

    species: Species
    seed: int = 0
    size: float = 1.0
    habits: dict[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not 0.2 <= self.size <= 5.0:
            raise MotionKitError(f"a {self.name}'s size is 0.2 to 5 of the usual; found {self.size!r}")

    @classmethod
    def from_seed(cls, species: Species, seed: int) -> Creature:
        """The creature of a number; the same one on every machine."""
        size = random.Random(f"{species.name} {seed}").uniform(0.85, 1.15)
        return cls(species, int(seed), size, Performer.from_seed(seed).habits)

    @property
    def name(self) -> str:
        """Its species' name."""
        return self.species.name

    @cached_property
    def skeleton(self) -> Skeleton:
        """Joints in rest pose, facing +Z, float64."""
        return _species_skeleton(self.species.bones, self.size)

    @cached_property
    def rest(self) -> Tensor:
        """Where the joints are in rest pose, [J, 3] metres."""
        places = []
        for parent, offset in zip(self.skeleton.parents, self.skeleton.offsets):
            places.append(offset if parent < 0 else places[parent] + offset)
        return torch.stack(places)

    @property
    def height(self) -> float:
        """From the ground to the highest joint in rest pose, metres."""
        return float(self.rest[:, 1].max())

    @property
    def build(self) -> float:
        """0: creatures differ in size alone."""
        return 0.0

    @property
    def leg(self) -> float:
        """How high the hips of the first leg stand, metres."""
        return float(self.rest[self.skeleton.index(self.species.legs[0].joints[0]), 1])

    @property
    def feet(self) -> tuple[str, ...]:
        """Names of the joints that stand on the ground, in the order of a performance's contacts."""
        return self.species.feet or tuple(leg.foot for leg in self.species.legs)

    @property
    def contents(self) -> tuple[str, ...]:
        """All that it can do."""
        return self.species.contents

    def as_done_by(self, style: Style) -> Style:
        """The style as this creature does it: habits added to it, in their ranges."""
        return Performer(self.seed, habits=self.habits).as_done_by(style)


@lru_cache(maxsize=128)
def _species_skeleton(bones: tuple[Bone, ...], size: float) -> Skeleton:
    names = tuple(bone[0] for bone in bones)
    places = {bone[0]: torch.tensor(bone[2], dtype=torch.float64) * size for bone in bones}
    parents = tuple(names.index(bone[1]) if bone[1] else -1 for bone in bones)
    offsets = torch.stack([places[b[0]] - (places[b[1]] if b[1] else 0.0) for b in bones])
    ends = []
    for n, bone in enumerate(bones):
        if len(bone) > 3:
            ends.append((n, tuple((torch.tensor(bone[3], dtype=torch.float64) * size - places[bone[0]]).tolist())))
    return Skeleton(names, parents, offsets, end_sites=tuple(ends))
