"""From curves and foot paths to a motion: trunk and chains by angles, legs by inverse kinematics."""

from __future__ import annotations

import torch
from torch import Tensor

from ... import rotations as rot
from ...motion import Motion
from ..layers import Curves, Moment
from .footing import FootPath
from .life import delayed
from .limbs import RestLegs, ankles, blade_swing, leg_turns, lowered, off_the_floor, rest_legs
from .species import Creature

_PARTS = ("yaw", "pitch", "roll")


class _Body:
    """World turns and places, joint by joint. turn: [F, 4], place: [F, 3] for each joint."""

    def __init__(self, creature: Creature, local: Tensor, root: Tensor) -> None:
        self.skeleton, self.local = creature.skeleton, local
        legs = {self.skeleton.index(j) for leg in creature.species.legs for j in leg.joints[1:]}
        self.turn: list[Tensor | None] = [None] * len(self.skeleton)
        self.place: list[Tensor | None] = [None] * len(self.skeleton)
        self.turn[0], self.place[0] = local[:, 0], root
        for joint in range(1, len(self.skeleton)):
            if joint not in legs:
                self.follow(joint)

    def follow(self, joint: int) -> None:
        """Put a joint where its parent and its own turn say."""
        above = self.skeleton.parents[joint]
        offset = self.skeleton.offsets[joint].expand_as(self.place[0])
        self.place[joint] = self.place[above] + rot.quaternion_rotate(self.turn[above], offset)
        self.turn[joint] = rot.quaternion_multiply(self.turn[above], self.local[:, joint])

    def sink(self, drop: Tensor) -> None:
        """Lower everything by drop [F] metres."""
        down = torch.stack((torch.zeros_like(drop), drop, torch.zeros_like(drop)), 1)
        self.place = [None if place is None else place - down for place in self.place]

    def keep_off_the_floor(self, joint: int, bone: Tensor, floor: float) -> None:
        """Raise a joint's bone [3] where its end would be below the floor."""
        turn = off_the_floor(self.place[joint], self.turn[joint], bone, floor)
        if turn is not self.turn[joint]:
            above = rot.quaternion_inverse(self.turn[self.skeleton.parents[joint]])
            self.local[:, joint], self.turn[joint] = rot.quaternion_multiply(above, turn), turn


def _bones(creature: Creature, joint: int, after: int | None) -> list[Tensor]:
    """From a chain's joint to the one after it, [3] metres; from its last joint to all bone ends that hang on it."""
    skeleton, rest = creature.skeleton, creature.rest
    if after is not None:
        return [skeleton.offsets[after]]
    hanging = skeleton.below(joint)
    return [rest[j] + rest.new_tensor(end) - rest[joint] for j, end in skeleton.end_sites if j in hanging]


def assemble(at: Moment, curves: Curves, feet: list[FootPath], fps: float) -> Motion:
    """The motion, float64. curves and feet: at the frames of `at`."""
    creature: Creature = at.performer
    skeleton, rest = creature.skeleton, rest_legs(creature.species, creature.size)
    heading = at.route.at(at.beats, "heading") + creature.species.facing
    place = at.route.at(at.beats, "place")
    _blades(curves, creature, feet, place, heading)
    angles = _angles(at, curves)
    angles[:, 0, 0] += heading
    local = rot.euler_to_quaternion(angles, "YXZ")
    body = _Body(creature, local, _root(curves, creature, place, heading))
    toes = torch.stack([f.place for f in feet], 1)
    hips = torch.stack([body.place[j[0]] for j in rest.joints], 1)
    drop = lowered(rest, hips, toes, fps)
    body.sink(drop)
    for name, joints in creature.species.chains.items():
        chain = [skeleton.index(j) for j in joints] if name != "spine" else []
        for joint, after in zip(chain, (*chain[1:], None)):
            body.follow(joint)
            for bone in _bones(creature, joint, after):
                body.keep_off_the_floor(joint, bone, 0.03 * creature.leg)
    hips = hips - torch.stack((torch.zeros_like(drop), drop, torch.zeros_like(drop)), 1)[:, None]
    _legs(at, curves, body, rest, feet, hips, toes, heading)
    return Motion.from_root(skeleton, rot.unroll(local), body.place[0], fps)


def _blades(curves: Curves, creature: Creature, feet: list[FootPath], place: Tensor, heading: Tensor) -> None:
    """Shoulder blades swing with their feet."""
    for leg, foot in zip(creature.species.legs, feet):
        if leg.blade:
            way = foot.place[:, [0, 2]] - place
            ahead = way[:, 0] * torch.sin(heading) + way[:, 1] * torch.cos(heading)
            home = creature.rest[creature.skeleton.index(leg.foot), 2]
            curves.add(f"{leg.blade}.pitch", blade_swing(leg, creature, ahead - home))


def _angles(at: Moment, curves: Curves) -> Tensor:
    """Yaw, pitch and roll of every joint, [F, J, 3]; the joints of a chain share its curves, one after the other."""
    creature: Creature = at.performer
    skeleton = creature.skeleton
    angles = torch.zeros(len(at.beats), len(skeleton), 3, dtype=torch.float64)
    for n, part in enumerate(_PARTS):
        angles[:, 0, n] += curves[f"trunk.{part}"]
    for name, chain in creature.species.chains.items():
        late = (0.25 + at.style.follow_through) * (0.35 if name == "tail" else 0.12)
        for link, joint in enumerate(chain):
            for n, part in enumerate(_PARTS):
                if f"{name}.{part}" in curves:
                    turn = delayed(curves[f"{name}.{part}"], at.beats, late * link)
                    angles[:, skeleton.index(joint), n] += turn / len(chain)
    for joint, own in enumerate(skeleton.names):
        for n, part in enumerate(_PARTS):
            if f"{own}.{part}" in curves:
                angles[:, joint, n] += curves[f"{own}.{part}"]
    return angles


def _root(curves: Curves, creature: Creature, place: Tensor, heading: Tensor) -> Tensor:
    x, y, z = creature.skeleton.offsets[0].tolist()
    side, ahead = curves["root.side"] + x, curves["root.ahead"] + z
    across = place[:, 0] + side * torch.cos(heading) + ahead * torch.sin(heading)
    along = place[:, 1] - side * torch.sin(heading) + ahead * torch.cos(heading)
    return torch.stack((across, y + curves["root.up"], along), 1)


def _legs(
    at: Moment, curves: Curves, body: _Body, rest: RestLegs, feet: list[FootPath], hips: Tensor, toes: Tensor,
    heading: Tensor,
) -> None:  # fmt: skip
    """Thighs, shins, feet and toes from where hips and toes are."""
    legs = at.performer.species.legs
    yaw, droop = (torch.stack([getattr(f, what) for f in feet], 1) for what in ("yaw", "droop"))
    pitch = torch.stack([f.pitch + curves[f"{leg.joints[2]}.fold"] for f, leg in zip(feet, legs)], 1)
    above = torch.stack([body.turn[j] for j in rest.above], 1)
    out = rest.knee.new_tensor([[leg.side * (at.style.knee_out - 0.08), 0.0, 0.0] for leg in legs])
    facing = rot.yaw_to_quaternion(heading)[:, None]
    points = (rest.knee + out).expand_as(hips)
    # a knee that went all the way with a trunk that rears up would come to lie along its leg
    pole = 0.5 * rot.quaternion_rotate(above, points) + 0.5 * rot.quaternion_rotate(facing, points)
    ankle = ankles(rest, hips, toes, yaw, pitch)
    turns = leg_turns(rest, hips, ankle, toes, pole)
    toe = rot.euler_to_quaternion(torch.stack((yaw, droop, torch.zeros_like(yaw)), -1), "YXZ")
    chain = torch.cat((above[:, :, None], turns, toe[:, :, None]), 2)  # [F, L, 5, 4]
    local = rot.quaternion_multiply(rot.quaternion_inverse(chain[:, :, :-1]), chain[:, :, 1:])
    for n, joints in enumerate(rest.joints):
        body.local[:, list(joints)] = local[:, n]
