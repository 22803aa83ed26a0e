"""From curves and feet to a motion: the trunk and arms by angles, the legs by inverse kinematics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from .. import rotations as rot
from ..contacts import hann_smooth
from ..motion import Motion
from .bodies import Creature, Leg, Species
from .curves import Curves, PoseContext, delayed, kick_target
from .footsteps import SIDES, FootMotion, FootPath
from .score import jump_height, smooth

_STRETCH = 0.992  # of a leg's length: knees never quite lock


def assemble_pose(at: PoseContext, curves: Curves, feet: dict[str, FootMotion], fps: float) -> Motion:
    """The motion, float64. curves and feet: at the frames of `at`."""
    skeleton = at.performer.skeleton
    names = {name: n for n, name in enumerate(skeleton.names)}
    frames = len(at.beats)
    local = rot.identity_quaternion(frames, len(names), dtype=torch.float64)
    heading = at.route.at(at.beats, "heading")
    local[:, 0] = _euler(curves["pelvis.pitch"], heading + curves["pelvis.yaw"], curves["pelvis.roll"])
    _trunk(curves, local, names)
    for side, sign in SIDES.items():
        _arm(curves, local, names, side, sign)
    hips = _hips(skeleton, names, local[:, 0])
    root = _root(at, curves, heading)
    ankles, turns = _ankles(at, feet, root, hips, heading)
    root[:, 1] = _within_reach(at, root, hips, ankles, fps)
    swing = torch.stack([feet[side].swing for side in SIDES], 1)
    ankles = _at_ease(at, root[:, None] + hips, ankles, swing)
    _legs(at, local, names, root, hips, ankles, turns, {s: f.toe_bend for s, f in feet.items()})
    return Motion.from_root(skeleton, rot.quaternion_unroll(local), root, fps)


def _euler(pitch: Tensor, yaw: Tensor, roll: Tensor) -> Tensor:
    """Turn to the left by yaw, then forwards by pitch, then to the right by roll; [F, 4]."""
    return rot.euler_to_quaternion(torch.stack((yaw, pitch, roll), -1), "YXZ")


def _trunk(curves: Curves, local: Tensor, names: dict[str, int]) -> None:
    pitch, slump = curves["spine.pitch"], curves["spine.slump"]
    for joint, bend, curl in (("spine1", 0.4, 0.15), ("spine2", 0.35, 0.35), ("spine3", 0.25, 0.35)):
        turn = (pitch * bend + slump * curl, curves["spine.yaw"] / 3, curves["spine.roll"] / 3)
        local[:, names[joint]] = _euler(*turn)
    for joint, share, curl in (("neck", 0.45, 0.15), ("head", 0.55, 0.0)):
        turn = (curves[f"head.{part}"] * share for part in ("pitch", "yaw", "roll"))
        pitch, yaw, roll = turn
        local[:, names[joint]] = _euler(pitch + slump * curl, yaw, roll)


def _arm(curves: Curves, local: Tensor, names: dict[str, int], side: str, sign: int) -> None:
    part = {p: curves[f"{side}.{p}"] for p in "flex out turn elbow hand wag shrug round".split()}
    zero = curves.nothing
    high = 0.22 * (part["flex"] - 1.0).clamp(min=0)  # a raised arm takes the collar bone with it
    lift = part["shrug"] + high + 0.22 * (part["out"] - 1.0).clamp(min=0)
    local[:, names[f"{side}_collar"]] = _euler(zero, -sign * part["round"], sign * lift)
    # and is tilted by it, outwards where it hangs and inwards where it points up
    hangs = 1 - smooth((part["flex"] - 0.6) / 1.6) - smooth(part["out"] - 0.5)
    down = -sign * (math.pi / 2 - part["out"] - high + 0.7 * part["shrug"] * hangs)
    angles = torch.stack((-part["flex"], down, part["turn"]), -1)
    local[:, names[f"{side}_shoulder"]] = rot.euler_to_quaternion(angles, "XZX")
    elbow = part["elbow"].clamp(0.02, 2.5)
    local[:, names[f"{side}_elbow"]] = _euler(zero, -sign * elbow, zero)
    local[:, names[f"{side}_wrist"]] = _euler(zero, sign * part["wag"], -sign * part["hand"])


def _hips(skeleton: object, names: dict[str, int], pelvis: Tensor) -> Tensor:
    """From the pelvis to both hips in the world, [F, 2, 3]: left, right."""
    offsets = torch.stack([skeleton.offsets[names[f"{side}_hip"]] for side in SIDES])
    return rot.quaternion_rotate(pelvis[:, None], offsets.expand(len(pelvis), 2, 3))


def _root(at: PoseContext, curves: Curves, heading: Tensor) -> Tensor:
    place = at.route.at(at.beats, "place")
    side, ahead = curves["root.side"], curves["root.ahead"]
    x = place[:, 0] + side * torch.cos(heading) + ahead * torch.sin(heading)
    z = place[:, 1] - side * torch.sin(heading) + ahead * torch.cos(heading)
    return torch.stack((x, 0.558 * at.performer.height + curves["root.up"], z), 1)


def _ankles(
    at: PoseContext, feet: dict[str, FootMotion], root: Tensor, hips: Tensor, heading: Tensor
) -> tuple[Tensor, Tensor]:
    """Where the ankles go [F, 2, 3] and how the feet are turned [F, 2, 4]: as planned, in flight, or kicking."""
    ankles = torch.stack([feet[side].ankle for side in SIDES], 1)
    turns = torch.stack([feet[side].turn for side in SIDES], 1)
    forward = torch.stack((torch.sin(heading), torch.zeros_like(heading), torch.cos(heading)), 1)
    for act in at.score.acts:
        inside = (at.beats >= act.start) & (at.beats < act.stop)
        if act.name == "jump":
            height = jump_height(at.style, at.performer, act.size)
            for n, side in enumerate(SIDES):
                flight = feet[side].swing * feet[side].hop * inside
                ankles[:, n, 1] += 4 * height * flight * (1 - flight)
        if act.name == "kick":
            n = 0 if act.side > 0 else 1
            place, pitch, share = kick_target(at, act, root + hips[:, n], forward)
            turn = _euler(pitch, heading, torch.zeros_like(pitch))
            ankles[:, n] = torch.lerp(ankles[:, n], place, share[:, None])
            turns[:, n] = rot.slerp(turns[:, n], turn, share)
    return ankles, turns


def _within_reach(at: PoseContext, root: Tensor, hips: Tensor, ankles: Tensor, fps: float) -> Tensor:
    """The pelvis' height [F], lowered smoothly where a leg would be too short."""
    gap = root[:, None] + hips - ankles
    level = (gap[..., 0] ** 2 + gap[..., 2] ** 2).clamp(max=(0.95 * at.performer.leg) ** 2)
    allowed = torch.sqrt((_STRETCH * at.performer.leg) ** 2 - level)
    excess = (gap[..., 1] - allowed).amax(1)
    soft = 0.012 * at.performer.leg
    drop = torch.nn.functional.softplus((excess + 0.3 * soft) / soft) * soft
    return root[:, 1] - hann_smooth(drop[:, None], max(1, round(0.09 * fps)))[:, 0]


def _at_ease(at: PoseContext, hip: Tensor, ankles: Tensor, swing: Tensor) -> Tensor:
    """Draws swinging ankles [F, 2, 3] towards the hips where a leg would snap straight, and away where it would fold.

    swing: [F, 2], 0 where a foot stands. The pull fades out towards both ends of the swing.
    """
    way = ankles - hip
    far = torch.linalg.vector_norm(way, dim=-1)
    soft = 0.014 * at.performer.leg
    pull = torch.nn.functional.softplus((far - 0.972 * at.performer.leg) / soft) * soft
    pull = pull - torch.nn.functional.softplus((0.46 * at.performer.leg - far) / (3 * soft)) * 3 * soft
    share = (7 * torch.minimum(swing, 1 - swing)).clamp(0, 1) * (swing > 0)
    return ankles - way * (share * pull / far)[..., None]


def _legs(
    at: PoseContext, local: Tensor, names: dict[str, int], root: Tensor, hips: Tensor, ankles: Tensor, turns: Tensor,
    toe_bend: dict[str, Tensor],
) -> None:  # fmt: skip
    """Thighs, shins and feet from where hips and ankles are; knees are hinges that point where the feet do."""
    pelvis = local[:, 0]
    hip = root[:, None] + hips
    upper, lower = 0.245 * at.performer.height, 0.246 * at.performer.height
    out = hip.new_tensor([s * (at.style.knee_out + 0.5 * at.style.toe_out) for s in SIDES.values()])
    axis = torch.stack((torch.ones_like(out), torch.zeros_like(out), -out), -1)
    axis = rot.quaternion_rotate(pelvis[:, None], axis.expand(len(pelvis), 2, 3))
    thigh, shin = bend_leg(hip, ankles, axis, upper, lower)
    inverse = rot.quaternion_inverse
    for n, side in enumerate(SIDES):
        local[:, names[f"{side}_hip"]] = rot.quaternion_multiply(inverse(pelvis), thigh[:, n])
        local[:, names[f"{side}_knee"]] = rot.quaternion_multiply(inverse(thigh[:, n]), shin[:, n])
        local[:, names[f"{side}_ankle"]] = rot.quaternion_multiply(inverse(shin[:, n]), turns[:, n])
        local[:, names[f"{side}_foot"]] = rot.exp_map(toe_bend[side][:, None] * hip.new_tensor([1.0, 0.0, 0.0]))


def bend_leg(hip: Tensor, ankle: Tensor, axis: Tensor, upper: float, lower: float) -> tuple[Tensor, Tensor]:
    """World rotations [..., 4] of thigh and shin that bring the ankle to its place; at rest both point down -Y.

    hip, ankle: [..., 3] metres. axis: [..., 3], of the knee's hinge, towards the body's left; of it counts what is at
    right angles to the leg. upper, lower: lengths, metres. Out of reach, the leg is stretched towards the place.

    >>> down, left = torch.tensor([0.0, -2.0, 0.0]), torch.tensor([1.0, 0.0, 0.0])
    >>> thigh, shin = bend_leg(torch.zeros(3), down, left, 1.0, 1.0)
    >>> thigh.abs().round(decimals=2)
    tensor([1., 0., 0., 0.])
    """
    way = ankle - hip
    far = torch.linalg.vector_norm(way, dim=-1, keepdim=True)
    reach = far.clamp(abs(upper - lower) + 1e-4, (upper + lower) * (1 - 1e-9))
    along = way / far.clamp(min=1e-9)
    side = rot.normalize(axis - (axis * along).sum(-1, keepdim=True) * along)
    ahead = torch.linalg.cross(along, side)
    cosine = ((upper**2 + reach**2 - lower**2) / (2 * upper * reach)).clamp(-1, 1)
    knee = upper * (cosine * along + torch.sqrt(1 - cosine**2) * ahead)
    thigh_down = rot.normalize(knee)
    shin_down = rot.normalize(along * reach - knee)
    return tuple(_pointing(d, side) for d in (thigh_down, shin_down))


def _pointing(down: Tensor, side: Tensor) -> Tensor:
    """The rotation whose -Y is `down` and whose X is `side`."""
    x, y = side, -down
    return rot.matrix_to_quaternion(torch.stack((x, y, torch.linalg.cross(x, y)), -1))


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
    hanging = skeleton.descendants(joint)
    return [rest[j] + rest.new_tensor(end) - rest[joint] for j, end in skeleton.end_sites if j in hanging]


def assemble_creature(at: PoseContext, curves: Curves, feet: list[FootPath], fps: float) -> Motion:
    """The motion, float64. curves and feet: at the frames of `at`."""
    creature: Creature = at.performer
    skeleton, rest = creature.skeleton, rest_legs(creature.species, creature.size)
    heading = at.route.at(at.beats, "heading") + creature.species.facing
    place = at.route.at(at.beats, "place")
    _blades(curves, creature, feet, place, heading)
    angles = _angles(at, curves)
    angles[:, 0, 0] += heading
    local = rot.euler_to_quaternion(angles, "YXZ")
    body = _Body(creature, local, _creature_root(curves, creature, place, heading))
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
    _creature_legs(at, curves, body, rest, feet, hips, toes, heading)
    return Motion.from_root(skeleton, rot.quaternion_unroll(local), body.place[0], fps)


def _blades(curves: Curves, creature: Creature, feet: list[FootPath], place: Tensor, heading: Tensor) -> None:
    """Shoulder blades swing with their feet."""
    for leg, foot in zip(creature.species.legs, feet):
        if leg.blade:
            way = foot.place[:, [0, 2]] - place
            ahead = way[:, 0] * torch.sin(heading) + way[:, 1] * torch.cos(heading)
            home = creature.rest[creature.skeleton.index(leg.foot), 2]
            curves.add(f"{leg.blade}.pitch", blade_swing(leg, creature, ahead - home))


def _angles(at: PoseContext, curves: Curves) -> Tensor:
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


def _creature_root(curves: Curves, creature: Creature, place: Tensor, heading: Tensor) -> Tensor:
    x, y, z = creature.skeleton.offsets[0].tolist()
    side, ahead = curves["root.side"] + x, curves["root.ahead"] + z
    across = place[:, 0] + side * torch.cos(heading) + ahead * torch.sin(heading)
    along = place[:, 1] - side * torch.sin(heading) + ahead * torch.cos(heading)
    return torch.stack((across, y + curves["root.up"], along), 1)


def _creature_legs(
    at: PoseContext, curves: Curves, body: _Body, rest: RestLegs, feet: list[FootPath], hips: Tensor, toes: Tensor,
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


STRETCH = 0.995  # of a leg's length: knees never quite lock
_FOLDED = 0.42  # and a knee folds no further than to this share of it
_LOWEST = 0.12  # of a foot's length: an ankle that lies down stays this far above its toes
_FOLLOW = 0.5  # how much of its lean a foot takes over from the leg


@dataclass(frozen=True)
class RestLegs:
    """What the rest pose says of L legs. joints: [L, 4] numbers. above: [L] the joint each hangs on.

    upper, lower, foot: [L] lengths, metres. knee: [L, 3] where it points. ankle: [L, 3] unit, from the joint on the
    ground to the ankle. lean: [L] radians of the hip ahead of the foot. frames: [L, 3, 3, 3] of the three bones.
    """

    joints: tuple[tuple[int, ...], ...]
    above: tuple[int, ...]
    upper: Tensor
    lower: Tensor
    foot: Tensor
    knee: Tensor
    ankle: Tensor
    lean: Tensor
    frames: Tensor


@lru_cache(maxsize=128)
def rest_legs(species: Species, size: float) -> RestLegs:
    """Measured on the rest pose."""
    creature = Creature(species, size=size)
    skeleton, rest = creature.skeleton, creature.rest
    joints = tuple(tuple(skeleton.index(j) for j in leg.joints) for leg in species.legs)
    hip, knee, ankle, toe = (rest[[j[n] for j in joints]] for n in range(4))
    lengths = [torch.linalg.vector_norm(b - a, dim=-1) for a, b in ((hip, knee), (knee, ankle), (ankle, toe))]
    along = rot.normalize(ankle - hip)
    out = knee - hip
    pole = rot.normalize(out - (out * along).sum(-1, keepdim=True) * along)
    normal = torch.linalg.cross(along, pole)
    bones = torch.stack((knee - hip, ankle - knee, toe - ankle), 1)
    above = tuple(skeleton.parents[j[0]] for j in joints)
    lean = torch.atan2((hip - toe)[:, 2], (hip - toe)[:, 1])
    frames = frame(bones, normal[:, None].expand(-1, 3, -1))
    return RestLegs(joints, above, *lengths, pole, rot.normalize(ankle - toe), lean, frames)


def frame(along: Tensor, normal: Tensor) -> Tensor:
    """Matrices [..., 3, 3]: columns are a bone's direction, its plane's normal made square to it, and the third."""
    x = rot.normalize(along)
    y = rot.normalize(normal - (normal * x).sum(-1, keepdim=True) * x)
    return torch.stack((x, y, torch.linalg.cross(x, y)), -1)


def ankles(rest: RestLegs, hip: Tensor, toe: Tensor, yaw: Tensor, pitch: Tensor) -> Tensor:
    """Where the ankles are, [F, L, 3]: the foot stands as it does at rest, leaning with the leg, and gives way where
    thigh and shin would be too short or could not fold so far.

    hip, toe: [F, L, 3] metres. yaw, pitch: of the feet, [F, L] radians.
    """
    way = hip - toe
    ahead = way[..., 0] * torch.sin(yaw) + way[..., 2] * torch.cos(yaw)
    lean = torch.atan2(ahead, way[..., 1].clamp(min=1e-3)) - rest.lean
    turn = torch.stack((yaw, pitch + _FOLLOW * lean, torch.zeros_like(yaw)), -1)
    up = rot.quaternion_rotate(rot.euler_to_quaternion(turn, "YXZ"), rest.ankle.expand_as(way))
    far = torch.linalg.vector_norm(way, dim=-1).clamp(min=1e-6)
    along = way / far[..., None]
    cosine = (up * along).sum(-1).clamp(-1, 1)
    aside = rot.normalize(up - cosine[..., None] * along)
    angle = torch.acos(cosine.clamp(-1 + 1e-9, 1 - 1e-9))

    def leaves(reach: Tensor) -> Tensor:  # the angle at which hip and ankle are this far from each other
        return torch.acos(((far**2 + rest.foot**2 - reach**2) / (2 * far * rest.foot)).clamp(-1, 1))

    least = leaves(_FOLDED * (rest.upper + rest.lower))
    angle = least + _soft(angle - least)
    most = leaves(STRETCH * (rest.upper + rest.lower))
    angle = (most - _soft(most - angle)).clamp(min=0.0)
    direction = torch.cos(angle)[..., None] * along + torch.sin(angle)[..., None] * aside
    height = _LOWEST + _soft(direction[..., 1:2] - _LOWEST)
    level = rot.normalize(direction * direction.new_tensor([1.0, 0.0, 1.0]))
    raised = level * torch.sqrt((1 - height**2).clamp(min=0))
    direction = torch.cat((raised[..., :1], height.clamp(max=1.0), raised[..., 2:]), -1)
    return toe + rest.foot[:, None] * direction


def _soft(x: Tensor, width: float = 0.03) -> Tensor:
    """Never below 0; x itself where that is well above."""
    return torch.nn.functional.softplus(x / width) * width


def leg_turns(rest: RestLegs, hip: Tensor, ankle: Tensor, toe: Tensor, pole: Tensor) -> Tensor:
    """World rotations [F, L, 3, 4] of thigh, shin and foot. All places [F, L, 3]; pole: where the knees point."""
    way = ankle - hip
    far = torch.linalg.vector_norm(way, dim=-1, keepdim=True)
    upper, lower = rest.upper[:, None], rest.lower[:, None]
    reach = torch.minimum(torch.maximum(far, (upper - lower).abs() + 1e-4), (upper + lower) * (1 - 1e-9))
    along = way / far.clamp(min=1e-9)
    normal = rot.normalize(torch.linalg.cross(along, pole))
    out = torch.linalg.cross(normal, along)
    cosine = ((upper**2 + reach**2 - lower**2) / (2 * upper * reach)).clamp(-1, 1)
    knee = upper * (cosine * along + torch.sqrt(1 - cosine**2) * out)
    bones = torch.stack((knee, along * reach - knee, toe - ankle), -2)
    posed = frame(bones, normal[..., None, :].expand_as(bones))
    return rot.matrix_to_quaternion(posed @ rest.frames.transpose(-1, -2))


def lowered(rest: RestLegs, hip: Tensor, toe: Tensor, fps: float) -> Tensor:
    """How far the body sinks [F], metres and smoothly, where a leg would be too short. hip, toe: [F, L, 3]."""
    length = STRETCH * (rest.upper + rest.lower) + 0.97 * rest.foot
    gap = hip - toe
    level = torch.minimum(gap[..., 0] ** 2 + gap[..., 2] ** 2, (0.95 * length) ** 2)
    excess = ((gap[..., 1] - torch.sqrt(length**2 - level)) / length).amax(1)
    soft = 0.012
    drop = torch.nn.functional.softplus((excess + 0.3 * soft) / soft) * soft * float(length.max())
    return hann_smooth(drop[:, None], max(1, round(0.05 * fps)))[:, 0]


def blade_swing(leg: Leg, creature: Creature, ahead: Tensor) -> Tensor:
    """The pitch [F] of a shoulder blade whose foot is so far ahead [F] of where it stands at rest, metres."""
    return -0.55 * torch.tanh(ahead / creature.leg)


def off_the_floor(place: Tensor, turn: Tensor, bone: Tensor, floor: float) -> Tensor:
    """The turn [F, 4] of a bone [3] that starts at place [F, 3], raised where its end would be below `floor`, metres.

    >>> place, down = torch.tensor([[0.0, 0.5, 0.0]]), torch.tensor([0.0, -1.0, 0.1])
    >>> turn = off_the_floor(place, rot.identity_quaternion(1), down, 0.02)
    >>> (place + rot.quaternion_rotate(turn, down[None]))[0, 1].round(decimals=2)
    tensor(0.0200)
    """
    way = rot.quaternion_rotate(turn, bone.expand_as(place))
    length = float(torch.linalg.vector_norm(bone))
    least = (floor - place[:, 1]).clamp(max=0.98 * length)
    height = (least + _soft(way[:, 1] - least, 0.03 * length)).clamp(max=length)
    if bool((height - way[:, 1]).amax() < 1e-4 * length):
        return turn
    level = way * way.new_tensor([1.0, 0.0, 1.0])
    level = rot.normalize(level) * torch.sqrt((length**2 - height**2).clamp(min=0))[:, None]
    wanted = torch.cat((level[:, :1], height[:, None], level[:, 2:]), 1)
    return rot.quaternion_multiply(rot.rotation_between(way, wanted), turn)
