"""From curves and feet to a motion: the trunk and arms by angles, the legs by inverse kinematics."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .. import rotations as rot
from ..motion import Motion
from .clock import jump_height
from .feet import FootMotion
from .gestures import kick_target
from .layers import Curves, Moment
from .score import smooth
from .steps import SIDES

_STRETCH = 0.992  # of a leg's length: knees never quite lock


def assemble(at: Moment, curves: Curves, feet: dict[str, FootMotion], fps: float) -> Motion:
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
    return Motion.from_root(skeleton, rot.unroll(local), root, fps)


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


def _root(at: Moment, curves: Curves, heading: Tensor) -> Tensor:
    place = at.route.at(at.beats, "place")
    side, ahead = curves["root.side"], curves["root.ahead"]
    x = place[:, 0] + side * torch.cos(heading) + ahead * torch.sin(heading)
    z = place[:, 1] - side * torch.sin(heading) + ahead * torch.cos(heading)
    return torch.stack((x, 0.558 * at.performer.height + curves["root.up"], z), 1)


def _ankles(
    at: Moment, feet: dict[str, FootMotion], root: Tensor, hips: Tensor, heading: Tensor
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


def _within_reach(at: Moment, root: Tensor, hips: Tensor, ankles: Tensor, fps: float) -> Tensor:
    """The pelvis' height [F], lowered smoothly where a leg would be too short."""
    gap = root[:, None] + hips - ankles
    level = (gap[..., 0] ** 2 + gap[..., 2] ** 2).clamp(max=(0.95 * at.performer.leg) ** 2)
    allowed = torch.sqrt((_STRETCH * at.performer.leg) ** 2 - level)
    excess = (gap[..., 1] - allowed).amax(1)
    soft = 0.012 * at.performer.leg
    drop = torch.nn.functional.softplus((excess + 0.3 * soft) / soft) * soft
    width = 2 * max(1, round(0.09 * fps)) + 1
    window = torch.hann_window(width + 2, periodic=False, dtype=drop.dtype)[1:-1]
    padded = torch.nn.functional.pad(drop[None, None], (width // 2, width // 2), mode="replicate")
    return root[:, 1] - torch.nn.functional.conv1d(padded, (window / window.sum())[None, None])[0, 0]


def _at_ease(at: Moment, hip: Tensor, ankles: Tensor, swing: Tensor) -> Tensor:
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
    at: Moment, local: Tensor, names: dict[str, int], root: Tensor, hips: Tensor, ankles: Tensor, turns: Tensor,
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
