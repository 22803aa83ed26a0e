"""Where and when each of any number of feet stands, and how it swings from one place to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ... import rotations as rot
from ..route import Route
from ..score import Score, smooth
from ..style import Style
from .species import Creature, Leg

_HIGHEST = 0.25  # of the leg: no swing goes higher


@dataclass
class Stand:
    """A foot on the ground from beat `land` to `lift`; its swing there begins at `begin`. x, z: metres. yaw: radians.

    raised: how high the swing goes, metres. pitch_land, pitch_lift: of the foot as it comes and goes, radians, above 0
    the heel up.
    """

    land: float
    begin: float
    x: float
    z: float
    yaw: float
    raised: float = 0.0
    pitch_land: float = 0.0
    pitch_lift: float = 0.0
    lift: float = math.inf


@dataclass(frozen=True)
class FootPath:
    """place: the joint on the ground, [F, 3] metres. yaw, pitch, droop: of foot and toes, [F]. stands: bool [F]."""

    place: Tensor
    yaw: Tensor
    pitch: Tensor
    droop: Tensor
    stands: Tensor


class Footing:
    """Plans the stands of every leg; `plan()` gives them in order of time, one list a leg."""

    def __init__(self, score: Score, style: Style, creature: Creature, route: Route) -> None:
        self.score, self.style, self.creature, self.route = score, style, creature, route
        self.duty = creature.species.duty

    def plan(self) -> list[list[Stand]]:
        """Steps of the walks first, then those of deeds."""
        plans = [self._walk(n, leg) for n, leg in enumerate(self.creature.species.legs)]
        for act in self.score.acts:
            deed = self.creature.species.deeds.get(act.name)
            for n, up, down, ahead in deed.steps if deed else ():
                self._again(plans[n], act.start + up, act.start + down, ahead * self.creature.size)
        for stands in plans:
            stands.sort(key=lambda s: s.land)
            for now, after in zip(stands, stands[1:]):
                after.begin = max(after.begin, now.land + 0.1)
                now.lift = after.begin
        return plans

    def _slots(self, leg: Leg) -> tuple[Tensor, dict[str, Tensor]]:
        """The beats [N] at which a leg would land, and what the route says there."""
        axis = self.route.axis
        cycle = torch.arange(math.floor(float(axis[0]) / 2) + 1, math.ceil(float(axis[-1]) / 2) - 1).double()
        walk, run = leg.lands
        fast = self.route.at(2 * cycle + walk + run, "running")
        land = 2 * (cycle + walk + (run - walk) * fast)
        fast = self.route.at(land, "running")
        duty = self.duty[0] + (self.duty[1] - self.duty[0]) * fast
        read = {what: self.route.at(land + duty, what) for what in ("place", "heading")}
        read |= {"duty": duty, "running": fast, "going": self.route.at(land - 0.5, "going")}
        return land, read

    def _walk(self, n: int, leg: Leg) -> list[Stand]:
        land, read = self._slots(leg)
        homes = self._homes(leg, read["place"], read["heading"])
        start = torch.full((1,), float(self.route.axis[0]), dtype=torch.float64)
        first = self._homes(leg, self.route.at(start, "place"), self.route.at(start, "heading"))[0]
        stands = [Stand(float(start) - 1, -math.inf, *first)]
        rows = zip(land.tolist(), read["duty"].tolist(), read["running"].tolist(), read["going"].tolist(), homes)
        walking = False
        for cycle, (beat, duty, fast, going, (x, z, yaw)) in enumerate(rows):
            if going > 0.03:
                stands.append(self._step(leg, f"{n} {cycle}", (beat, duty, fast, going), (x, z, yaw)))
                walking = True
            elif walking:
                walking = False
                if math.hypot(x - stands[-1].x, z - stands[-1].z) > 0.015 * self.creature.leg:
                    stands.append(Stand(beat, beat - 0.6, x, z, yaw, 0.08 * self.creature.leg, 0.0, 0.2))
        return stands

    def _step(self, leg: Leg, name: str, when: tuple, where: tuple) -> Stand:
        (beat, duty, fast, going), (x, z, yaw), style, size = when, where, self.style, self.creature.leg
        vary = style.variability * going * size
        x, z = x + 0.012 * vary * self.score.draw(f"x {name}"), z + 0.012 * vary * self.score.draw(f"z {name}")
        yaw += leg.side * style.toe_out * 0.6 + 0.02 * style.variability * self.score.draw(f"toe {name}")
        high = 0.05 + 0.9 * style.clearance + 0.06 * fast
        high = _HIGHEST * math.tanh(high / _HIGHEST)
        raised = high * size * max(0.3, 1 + 0.08 * style.variability * self.score.draw(f"clear {name}"))
        roll = self.creature.species.roll
        return Stand(
            beat, beat - 2 * (1 - duty), x, z, yaw, raised * max(going, 0.4),
            -0.5 * roll * style.heel_strike * going, roll * style.foot_roll * going,
        )  # fmt: skip

    def _homes(self, leg: Leg, place: Tensor, heading: Tensor) -> list[tuple[float, float, float]]:
        """(x, z, yaw) of the foot under a body that is at place [N, 2] with a heading [N]."""
        x, _, z = _rest_of(self.creature, leg.foot).tolist()
        x += leg.side * max(-0.75 * abs(x), 0.5 * (self.style.step_width - 0.13) * self.creature.leg)
        yaw = heading + self.creature.species.facing
        sine, cosine = torch.sin(yaw), torch.cos(yaw)
        spots = (place[:, 0] + x * cosine + z * sine, place[:, 1] - x * sine + z * cosine, yaw)
        return list(zip(*(s.tolist() for s in spots)))

    def _again(self, stands: list[Stand], begin: float, land: float, ahead: float) -> None:
        """Lift a foot and put it down further to the front."""
        now = max((s for s in stands if s.land <= begin), key=lambda s: s.land)
        yaw = float(self.route.at(torch.tensor([begin], dtype=torch.float64), "heading"))
        yaw += self.creature.species.facing
        x, z = now.x + ahead * math.sin(yaw), now.z + ahead * math.cos(yaw)
        stands.append(Stand(land, begin, x, z, now.yaw, 0.1 * self.creature.leg, 0.0, 0.2))


def _rest_of(creature: Creature, joint: str) -> Tensor:
    return creature.rest[creature.skeleton.index(joint)]


def move_foot(stands: list[Stand], leg: Leg, beats: Tensor, style: Style, creature: Creature) -> FootPath:
    """The way of one foot at beats [F] through its stands."""
    names = Stand.__annotations__
    table = {name: torch.tensor([getattr(s, name) for s in stands], dtype=beats.dtype) for name in names}
    now = (torch.searchsorted(table["land"], beats, right=True) - 1).clamp(0)
    after = (now + 1).clamp(max=len(stands) - 1)
    here = {name: column[now] for name, column in table.items()}
    there = {name: column[after] for name, column in table.items()}
    planted = beats < here["lift"]
    span = (there["land"] - here["lift"]).clamp(min=1e-6).nan_to_num(1.0, 1.0, 1.0)
    v = torch.where(planted, 0.0, ((beats - here["lift"]) / span).nan_to_num(0.0).clamp(0, 1))
    margin = 0.25 * max(style.sharpness - 0.4, 0.0) * (1 - style.pauses)  # a pause is sharp enough
    eased = smooth((v - margin) / (1 - 2 * margin))
    pitch = torch.where(planted, _stance_pitch(beats, here, there), _swing_pitch(v, span, here, there, leg.fold))
    level, toes = float(_rest_of(creature, leg.foot)[1]), _toe_length(creature, leg)
    height = level + there["raised"] * torch.sin(math.pi * v**0.9) ** 2
    flat = torch.stack([torch.lerp(here[c], there[c], eased) for c in "xz"])
    place = torch.stack((flat[0], height, flat[1]), 1)
    yaw = here["yaw"] + rot.wrap(there["yaw"] - here["yaw"]) * eased
    droop = torch.where(planted, 0.0, (0.25 + leg.fold) * torch.sin(math.pi * v) ** 2)
    room = torch.asin((level + 0.8 * (height - level)).clamp(max=0.99 * toes) / toes) - math.asin(level / toes)
    droop = droop * room / (droop + room + 1e-9)  # toes do not dip into the floor
    return FootPath(place, yaw, pitch, droop, planted)


def _toe_length(creature: Creature, leg: Leg) -> float:
    joint = creature.skeleton.index(leg.foot)
    return math.hypot(*next(offset for j, offset in creature.skeleton.end_sites if j == joint))


def _stance_pitch(beats: Tensor, here: dict, there: dict) -> Tensor:
    """The foot settles after landing and rolls over its ball before leaving."""
    stay = (here["lift"] - here["land"]).clamp(max=4.0)
    left = ((here["lift"] - beats).clamp(max=9.0) / (0.5 * stay)).clamp(0, 1)
    came = here["pitch_land"] * (1 - smooth((beats - here["land"]) / (0.4 * stay)))
    return came + there["pitch_lift"] * (1 - left) ** 2


def _swing_pitch(v: Tensor, span: Tensor, here: dict, there: dict, fold: float) -> Tensor:
    """From the pitch of leaving to that of landing, going on at the rate at which it left (cubic Hermite)."""
    stay = (here["lift"] - here["land"]).clamp(0.1, 4.0)
    start, end, rate = there["pitch_lift"], there["pitch_land"], 4 * there["pitch_lift"] / stay * span
    v2, v3 = v * v, v * v * v
    curve = (2 * v3 - 3 * v2 + 1) * start + (v3 - 2 * v2 + v) * rate.clamp(max=2.0) + (3 * v2 - 2 * v3) * end
    return curve + fold * torch.sin(math.pi * v**0.8) ** 2
