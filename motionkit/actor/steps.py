"""Where and when each foot stands: footsteps planned on the route, and those that gestures need."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .body import Performer
from .clock import JUMP_FLIGHT
from .route import Route
from .score import Score
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

    def __init__(self, score: Score, style: Style, performer: Performer, route: Route) -> None:
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
