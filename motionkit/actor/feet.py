"""How a foot moves: planted, rolling from heel to toe, and swinging to where it is planted next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .. import rotations as rot
from .body import HEEL, Performer
from .score import smooth
from .steps import Plant
from .style import Style

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
    yaw = here["yaw"] + rot.wrap(there["yaw"] - here["yaw"]) * eased
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
