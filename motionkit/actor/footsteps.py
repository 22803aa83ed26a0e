"""Where and when each foot stands: footsteps planned on the route, and those that gestures need."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .. import rotations as rot
from .bodies import HEEL, Creature, Leg, Performer
from .path import Route
from .score import JUMP_FLIGHT, MotionPlan, smooth
from .style import Style

WALK_DUTY, RUN_DUTY = 0.4965, 0.233  # share of a cycle of two beats in which a foot stands
_AHEAD, _EARLY = 0.0122, 0.355  # beats that a foot lands ahead of the body, and when in its swing it is highest
_RUN_BACK, _RUN_LIFT = 0.1807, 0.215  # in a run it lands less far ahead (beats), and is lifted higher (leg lengths)
SIDES = {"left": 1, "right": -1}


@dataclass
class Plant:
    """A foot on the ground. land, lift: beats. x, z: under the ankle, metres. yaw: radians.

    pitch_land, pitch_lift: of the foot as it comes and goes, radians, above 0 heel up. raised: how high the ball of the
    foot is lifted in the swing that brought it here, metres; early: where in that swing (0.5 the middle).
    """

    land: float
    x: float
    z: float
    yaw: float
    begin: float = -math.inf
    pitch_land: float = 0.0
    pitch_lift: float = 0.0
    raised: float = 0.0
    early: float = 0.5
    hop: float = 0.0
    lift: float = math.inf


def stand_width(style: Style, performer: Performer) -> float:
    """Between the ankles of somebody who stands, metres."""
    return max(style.step_width, 0.2) * performer.leg


class Planner:
    """Plans the footsteps of one performance; `plan()` gives the plants of both feet in order of time."""

    def __init__(self, score: MotionPlan, style: Style, performer: Performer, route: Route) -> None:
        self.score, self.style, self.performer, self.route = score, style, performer, route
        self.feet: dict[str, list[Plant]] = {"left": [], "right": []}

    def plan(self) -> dict[str, list[Plant]]:
        """Walk steps first, then what gestures need; each foot's plants in order of time."""
        start = float(self.route.axis[0])
        for side in SIDES:
            self.feet[side].append(self._plant(side, start - 1, start))
        self._walk_steps()
        for act in self.score.acts:
            place = getattr(self, f"_for_{act.name}", None)
            if place:
                place(act)
        for plants in self.feet.values():
            plants.sort(key=lambda p: p.land)
            for now, after in zip(plants, plants[1:]):
                now.lift = after.begin
        return self.feet

    def _read(self, what: str, beat: float) -> Tensor:
        return self.route.at(torch.tensor([beat], dtype=torch.float64), what)[0]

    def _plant(self, side: str, land: float, middle: float, **more: float) -> Plant:
        """A foot beside the body as it will be at beat `middle`."""
        (x, z), yaw = self._read("place", middle).tolist(), float(self._read("heading", middle))
        going, run = float(self._read("going", middle)), float(self._read("running", middle))
        walking = self.style.step_width * (1 - 0.6 * run) * self.performer.leg
        width = stand_width(self.style, self.performer) * (1 - going) + walking * going
        name = f"{side} {round(land)}"
        vary = self.style.variability * going * self.performer.leg
        out = SIDES[side] * (width / 2 + 0.012 * vary * self.score.draw(f"aside {name}"))
        ahead = 0.012 * vary * self.score.draw(f"ahead {name}")
        x, z = x + out * math.cos(yaw) + ahead * math.sin(yaw), z - out * math.sin(yaw) + ahead * math.cos(yaw)
        toe = SIDES[side] * (self.style.toe_out + 0.02 * self.style.variability * self.score.draw(f"toe {name}"))
        return Plant(land, x, z, yaw + toe, **more)

    def _walk_steps(self) -> None:
        axis = self.route.axis
        closing = 0
        for beat in range(math.ceil(float(axis[0])) + 1, math.floor(float(axis[-1])) - 1):
            going = float(self._read("going", beat - 0.5))
            side = "left" if beat % 2 == 0 else "right"
            if going > 0.03:
                self.feet[side].append(self._step(side, beat, going))
                closing = 2
            elif closing:
                closing -= 1
                self._close(side, beat)

    def _step(self, side: str, beat: int, going: float) -> Plant:
        run, back = float(self._read("running", beat - 0.5)), float(self._read("backing", beat - 0.5))
        duty, style, leg = WALK_DUTY + (RUN_DUTY - WALK_DUTY) * run, self.style, self.performer.leg
        land = style.heel_strike * going * (1 - run) * (1 - back) - 0.35 * back
        vary = 1 + 0.08 * style.variability * self.score.draw(f"clear {beat}")
        quick = max(style.tempo / 1.05, 1.0) ** -2  # who runs with quick steps has no time to lift the feet high
        lift = (_RUN_LIFT + 0.15 * style.foot_roll) * quick + min(style.clearance, 0.11) - style.clearance
        raised = (style.clearance + 0.012 + lift * run) * leg * max(vary, 0.3)
        return self._plant(
            side, float(beat), beat + duty + _AHEAD - _RUN_BACK * run, begin=beat - 2 * (1 - duty), pitch_land=-land,
            early=_EARLY, raised=raised * max(going, 0.4),
            pitch_lift=going * (style.foot_roll * (1 + 0.15 * run) * (1 - back) - 0.1 * back),
        )  # fmt: skip

    def _close(self, side: str, beat: int) -> None:
        """Bring a foot beside the other one after a walk, if it is not there yet."""
        last = self.feet[side][-1]
        closed = self._plant(side, float(beat), beat + 1.0, begin=beat - 0.7, raised=0.03 * self.performer.leg,
                             pitch_lift=0.25)  # fmt: skip
        if math.hypot(closed.x - last.x, closed.z - last.z) > 0.02:
            self.feet[side].append(closed)

    def _again(self, side: str, begin: float, land: float, ahead: float = 0.0, **more: float) -> None:
        """Lift a foot and put it down, `ahead` metres further to the front than where it is."""
        now = max((p for p in self.feet[side] if p.land <= begin), key=lambda p: p.land)
        yaw = float(self._read("heading", begin))
        x, z = now.x + ahead * math.sin(yaw), now.z + ahead * math.cos(yaw)
        self.feet[side].append(Plant(land, x, z, now.yaw, begin=begin, **more))

    def _for_jump(self, act: object) -> None:
        for side in SIDES:
            flight = (act.start + t for t in JUMP_FLIGHT)
            self._again(side, *flight, pitch_land=0.35, pitch_lift=0.8, hop=1.0, raised=0.05 * self.performer.leg)

    def _for_kick(self, act: object) -> None:
        self._again("left" if act.side > 0 else "right", act.start + 1.0, act.start + 4.0, pitch_lift=0.5)

    def _for_punch(self, act: object) -> None:
        front, step = "left" if act.side < 0 else "right", punch_step(self.performer)
        raised = 0.05 * self.performer.leg
        self._again(front, act.start + 0.1, act.start + 0.75, step, raised=raised, pitch_lift=0.2)
        self._again(front, act.stop - 0.8, act.stop - 0.1, -step, raised=raised, pitch_lift=0.2)


def punch_step(performer: Performer) -> float:
    """How far the front foot steps ahead of a punch, metres."""
    return 0.42 * performer.leg


# Fitted to captured walks: beats in which a foot rolls flat after landing and over its ball before leaving, how late it
# rolls, how fast it goes on rolling in the air, and the shares of a swing in which it gathers speed and stops.
_LANDING, _LEAVING, _LATE, _ON, _RISE, _FALL = 0.28, 0.291, 2.264, 4.323, 0.419, 0.344

_ANKLE = 0.039  # how high a standing ankle is, shares of the height
_FLAT = 0.02  # radians of pitch at which a foot still counts as flat: its ankle is within a millimetre or two


@dataclass(frozen=True)
class FootMotion:
    """ankle: [F, 3] metres. turn: the foot in the world [F, 4]. toe_bend: [F] radians. stands: ankle and ball, [F, 2].

    swing: 0 on the ground, else how far the swing is (0 to 1), [F]. hop: 1 in a jump's flight, [F].
    """

    ankle: Tensor
    turn: Tensor
    toe_bend: Tensor
    stands: Tensor
    swing: Tensor
    hop: Tensor


def move_foot(plants: list[Plant], beats: Tensor, style: Style, performer: Performer) -> FootMotion:
    """The motion of one foot at beats [F] through its plants."""
    names = Plant.__annotations__
    table = {name: torch.tensor([getattr(p, name) for p in plants], dtype=beats.dtype) for name in names}
    now = (torch.searchsorted(table["land"], beats, right=True) - 1).clamp(0)
    after = (now + 1).clamp(max=len(plants) - 1)
    here = {name: column[now] for name, column in table.items()}
    there = {name: column[after] for name, column in table.items()}
    planted = beats < here["lift"]
    span = (there["land"] - here["lift"]).clamp(min=1e-6).nan_to_num(1.0, 1.0, 1.0)
    v = torch.where(planted, torch.zeros_like(beats), ((beats - here["lift"]) / span).clamp(0, 1).nan_to_num(0.0))
    pitch = torch.where(planted, _stance_pitch(beats, here, there), _swing_pitch(v, here, there))
    stance = _planted_ankle(here, pitch, performer)
    eased = _eased(v, style.sharpness)
    yaw = here["yaw"] + rot.wrap_angle(there["yaw"] - here["yaw"]) * eased
    flying = _flying_ankle(v, eased, yaw, pitch, here, there, performer)
    ankle = torch.where(planted[:, None], stance, flying)
    turn = _turn(torch.where(planted, here["yaw"], yaw), pitch)
    rolling = planted & (pitch > _FLAT)
    flat = planted & (pitch.abs() <= _FLAT)
    stands = torch.stack((flat, flat | rolling), 1)
    toe_bend = pitch.clamp(min=0) * _toes_down(v)
    return FootMotion(ankle, turn, -toe_bend, stands, v, torch.where(planted, torch.zeros_like(v), there["hop"]))


def _eased(v: Tensor, sharpness: float) -> Tensor:
    """Where on its way a swinging foot is: quickly up to speed, a little slower to land."""
    margin = 0.25 * max(sharpness - 0.4, 0.0)
    x, rise, fall = ((v - margin) / (1 - 2 * margin)).clamp(0, 1), _RISE, _FALL
    gather, stop = (x / rise).clamp(max=1), ((1 - x) / fall).clamp(max=1)
    way = rise * (gather**3 - gather**4 / 2) + (x - rise).clamp(0, 1 - rise - fall)
    return (way + fall * (0.5 - stop**3 + stop**4 / 2)) / (1 - (rise + fall) / 2)


def _toes_down(v: Tensor) -> Tensor:
    """How much the toes stay level when the foot pitches: wholly on the ground, less and less in the swing."""
    return 1 - smooth(1.8 * v)


def _stance_pitch(beats: Tensor, here: dict, there: dict) -> Tensor:
    """Rolls flat after landing and over the ball before leaving; flat in between."""
    stay = (here["lift"] - here["land"]).clamp(max=4.0)
    landing = (0.32 * stay).clamp(max=_LANDING)
    leaving = (0.45 * stay).clamp(max=_LEAVING)
    left = ((here["lift"] - beats).clamp(max=9.0) / leaving).clamp(0, 1)
    came = here["pitch_land"] * (1 - smooth((beats - here["land"]) / landing))
    return came + there["pitch_lift"] * (1 - left) ** _LATE


def _swing_pitch(v: Tensor, here: dict, there: dict) -> Tensor:
    """From the pitch of leaving to that of landing; the rate goes on where the stance left it."""
    start, end = there["pitch_lift"], there["pitch_land"]
    rate = _ON * start  # a share of the stance's rate: the toes catch up quickly
    v2, v3 = v * v, v * v * v
    lifted = torch.where(there["hop"] > 0, 0.0, -0.12 * torch.sin(math.pi * v) ** 2 * (v > 0.5))
    return (2 * v3 - 3 * v2 + 1) * start + (v3 - 2 * v2 + v) * rate + (3 * v2 - 2 * v3) * end + lifted


def _arms(performer: Performer) -> tuple[Tensor, Tensor]:
    """From the ankle to the ball of the foot and to the heel on the ground, [3] metres each."""
    ball = performer.skeleton.offsets[performer.skeleton.index("left_foot")] * torch.tensor([0.0, 1.0, 1.0])
    return ball, torch.tensor([0.0, -_ANKLE, -HEEL]) * performer.height


def _turn(yaw: Tensor, pitch: Tensor) -> Tensor:
    zero = torch.zeros_like(yaw)
    return rot.euler_to_quaternion(torch.stack((yaw, pitch, zero), 1), "YXZ")


def _pivoted(ground: Tensor, yaw: Tensor, pitch: Tensor, arm: Tensor) -> Tensor:
    """The ankle when the foot, flat above `ground` [F, 3], is pitched about the end of `arm` [3] (from the ankle)."""
    flat, turned = _turn(yaw, torch.zeros_like(pitch)), _turn(yaw, pitch)
    arm = arm.to(ground).expand_as(ground)
    return ground + rot.quaternion_rotate(flat, arm) - rot.quaternion_rotate(turned, arm)


def _level(x: Tensor, z: Tensor, performer: Performer) -> Tensor:
    return torch.stack((x, torch.full_like(x, _ANKLE * performer.height), z), 1)


def _planted_ankle(here: dict, pitch: Tensor, performer: Performer) -> Tensor:
    ball, heel = _arms(performer)
    flat = _level(here["x"], here["z"], performer)
    over_ball = _pivoted(flat, here["yaw"], pitch, ball)
    over_heel = _pivoted(flat, here["yaw"], pitch, heel)
    return torch.where((pitch >= 0)[:, None], over_ball, over_heel)


def _flying_ankle(
    v: Tensor, eased: Tensor, yaw: Tensor, pitch: Tensor, here: dict, there: dict, performer: Performer
) -> Tensor:
    """The ball of the foot goes from where it left to where it lands; the ankle follows from the pitch."""
    ball, _ = _arms(performer)
    ball = ball.to(v)
    leave = _planted_ankle(here, there["pitch_lift"], performer)
    leave = leave + rot.quaternion_rotate(_turn(here["yaw"], there["pitch_lift"]), ball.expand(len(v), 3))
    land = _planted_ankle(there, there["pitch_land"], performer)
    land = land + rot.quaternion_rotate(_turn(there["yaw"], there["pitch_land"]), ball.expand(len(v), 3))
    path = torch.lerp(leave, land, eased[:, None])
    path[:, 1] += there["raised"] * _bump(v, there["early"])
    dip = 0.046 * performer.height * torch.sin(pitch.clamp(min=0) * (1 - _toes_down(v)))  # toe tips below the ball
    path[:, 1] += (dip + 0.012 * performer.height - path[:, 1]).clamp(min=0)
    return path - rot.quaternion_rotate(_turn(yaw, pitch), ball.expand(len(v), 3))


def _bump(v: Tensor, early: Tensor) -> Tensor:
    """0 at both ends, with no speed there, 1 at `early`."""
    power = torch.log(torch.tensor(0.5).to(v)) / torch.log(early.clamp(0.1, 0.9))
    return torch.sin(math.pi * v.clamp(0, 1) ** power) ** 2


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

    def __init__(self, score: MotionPlan, style: Style, creature: Creature, route: Route) -> None:
        self.score, self.style, self.creature, self.route = score, style, creature, route
        self.duty = creature.species.duty

    def plan(self) -> list[list[Stand]]:
        """Steps of the walks first, then those of actions."""
        plans = [self._walk(n, leg) for n, leg in enumerate(self.creature.species.legs)]
        for act in self.score.acts:
            action = self.creature.species.actions.get(act.name)
            for n, up, down, ahead in action.steps if action else ():
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


def move_creature_foot(stands: list[Stand], leg: Leg, beats: Tensor, style: Style, creature: Creature) -> FootPath:
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
    pitch = torch.where(
        planted, _creature_stance_pitch(beats, here, there), _creature_swing_pitch(v, span, here, there, leg.fold)
    )
    level, toes = float(_rest_of(creature, leg.foot)[1]), _toe_length(creature, leg)
    height = level + there["raised"] * torch.sin(math.pi * v**0.9) ** 2
    flat = torch.stack([torch.lerp(here[c], there[c], eased) for c in "xz"])
    place = torch.stack((flat[0], height, flat[1]), 1)
    yaw = here["yaw"] + rot.wrap_angle(there["yaw"] - here["yaw"]) * eased
    droop = torch.where(planted, 0.0, (0.25 + leg.fold) * torch.sin(math.pi * v) ** 2)
    room = torch.asin((level + 0.8 * (height - level)).clamp(max=0.99 * toes) / toes) - math.asin(level / toes)
    droop = droop * room / (droop + room + 1e-9)  # toes do not dip into the floor
    return FootPath(place, yaw, pitch, droop, planted)


def _toe_length(creature: Creature, leg: Leg) -> float:
    joint = creature.skeleton.index(leg.foot)
    return math.hypot(*next(offset for j, offset in creature.skeleton.end_sites if j == joint))


def _creature_stance_pitch(beats: Tensor, here: dict, there: dict) -> Tensor:
    """The foot settles after landing and rolls over its ball before leaving."""
    stay = (here["lift"] - here["land"]).clamp(max=4.0)
    left = ((here["lift"] - beats).clamp(max=9.0) / (0.5 * stay)).clamp(0, 1)
    came = here["pitch_land"] * (1 - smooth((beats - here["land"]) / (0.4 * stay)))
    return came + there["pitch_lift"] * (1 - left) ** 2


def _creature_swing_pitch(v: Tensor, span: Tensor, here: dict, there: dict, fold: float) -> Tensor:
    """From the pitch of leaving to that of landing, going on at the rate at which it left (cubic Hermite)."""
    stay = (here["lift"] - here["land"]).clamp(0.1, 4.0)
    start, end, rate = there["pitch_lift"], there["pitch_land"], 4 * there["pitch_lift"] / stay * span
    v2, v3 = v * v, v * v * v
    curve = (2 * v3 - 3 * v2 + 1) * start + (v3 - 2 * v2 + v) * rate.clamp(max=2.0) + (3 * v2 - 2 * v3) * end
    return curve + fold * torch.sin(math.pi * v**0.8) ** 2
