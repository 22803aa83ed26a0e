"""Makes the example clips in data/: one parametric walk in several moods.

    python tools/make_clips.py [FOLDER]

A gait is planned in footsteps: each foot is planted, rolls over its toes, and swings to its next place; pelvis, spine
and arms follow the phase of the steps; the legs are bent to the planned places by two-bone IK. The clips are the same
on every machine.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

import motionkit as mk
from motionkit import kinematics
from motionkit import rotations as rot
from motionkit.contacts import two_bone_ik
from motionkit.skeleton import smpl

FPS, FRAMES, SWING = 30.0, 120, 0.4
ANKLE, TOE = 0.08, (0.0, -0.06, 0.13)  # metres: height of the ankle, and the toe joint from the ankle


@dataclass(frozen=True)
class Gait:
    """How somebody walks. Lengths in metres, angles in radians, rates in 1/s."""

    steps_per_second: float = 1.8
    step: float = 0.62
    width: float = 0.075
    lift: float = 0.05
    roll: float = 0.6
    crouch: float = 0.042
    bob: float = 0.022
    sway: float = 0.018
    hip_turn: float = 0.1
    shoulder_turn: float = 0.12
    lean: float = 0.05
    slump: float = 0.0
    head: float = 0.0
    arm_swing: float = 0.45
    arm_out: float = 0.16
    elbow: float = 0.3
    elbow_swing: float = 0.2
    side_bend: float = 0.02
    turn: float = 0.0


CLIPS = {
    "walk_neutral": Gait(),
    "walk_turning": Gait(turn=0.45),
    "walk_proud": Gait(
        1.7, 0.65, lift=0.07, roll=0.75, crouch=0.04, bob=0.03, hip_turn=0.14, shoulder_turn=0.2, lean=-0.07,
        slump=-0.12, head=-0.1, arm_swing=0.6, arm_out=0.3, elbow=0.35, elbow_swing=0.3,
    ),
    "walk_old": Gait(
        1.25, 0.34, width=0.11, lift=0.02, roll=0.2, crouch=0.07, bob=0.01, sway=0.035, hip_turn=0.04,
        shoulder_turn=0.04, lean=0.3, slump=0.3, head=-0.25, arm_swing=0.12, arm_out=0.22, elbow=0.95,
        elbow_swing=0.05, side_bend=0.05,
    ),
    "walk_childlike": Gait(
        2.2, 0.5, width=0.06, lift=0.1, roll=0.75, crouch=0.03, bob=0.04, sway=0.03, hip_turn=0.12,
        shoulder_turn=0.25, lean=0.0, slump=-0.05, head=-0.12, arm_swing=0.8, arm_out=0.55, elbow=0.6,
        elbow_swing=0.5, side_bend=0.09,
    ),
}  # fmt: skip


def smooth(u: Tensor) -> Tensor:
    """0 to 1 without a kink at either end."""
    u = u.clamp(0, 1)
    return u * u * u * (u * (6 * u - 15) + 10)


def along(gait: Gait, distance: Tensor, aside: float = 0.0) -> tuple[Tensor, Tensor]:
    """A place on the path, [F, 3], `aside` metres to its left, and the heading there, [F]."""
    speed = gait.step * gait.steps_per_second
    yaw = distance * (gait.turn / speed)
    if gait.turn:
        x, z = (1 - torch.cos(yaw)) * speed / gait.turn, torch.sin(yaw) * speed / gait.turn
    else:
        x, z = torch.zeros_like(distance), distance
    return torch.stack((x + aside * torch.cos(yaw), torch.zeros_like(x), z - aside * torch.sin(yaw)), -1), yaw


def foot(gait: Gait, cycles: Tensor, side: int) -> tuple[Tensor, Tensor]:
    """Ankle places [F, 3] and foot rotations [F, 4] in the world; side +1 is left, -1 right.

    A cycle is two steps; it begins with the swing of this foot. In the last part of its stance the foot rolls over
    the toes, which stay where they are; it lands on the heel.
    """
    cycles = cycles + (0.0 if side > 0 else 0.5)
    number, phase = torch.floor(cycles), cycles % 1.0
    stance = ((phase - SWING) / (1 - SWING)).clamp(0, 1)
    swing = (phase / SWING).clamp(0, 1)
    middle = number + (SWING + 1) / 2 - (0.5 if side < 0 else 0.0)  # of the stance: the body passes over the foot
    before, yaw0 = along(gait, (middle - 1) * 2 * gait.step, side * gait.width)
    after, yaw1 = along(gait, middle * 2 * gait.step, side * gait.width)
    rolled = gait.roll * smooth((stance - 0.55) / 0.45)
    landed = -0.5 * gait.roll * (1 - smooth(stance / 0.2))
    in_air = gait.roll * (1 - smooth(swing * 1.6)) - 0.5 * gait.roll * smooth(swing * 1.6 - 0.6)
    air = phase < SWING
    pitch = torch.where(air, in_air, rolled + landed)
    yaw = torch.where(air, torch.lerp(yaw0, yaw1, smooth(swing)), yaw1)
    turn = rot.quaternion_multiply(rot.yaw_to_quaternion(yaw), rot.exp_map(pitch[:, None] * torch.tensor([1.0, 0, 0])))
    planted = after + on_toes(rot.yaw_to_quaternion(yaw1), turn, (rolled + landed).clamp(min=0))
    leaving = rot.quaternion_multiply(
        rot.yaw_to_quaternion(yaw0), rot.exp_map(torch.tensor([gait.roll, 0, 0]).expand(len(yaw0), 3))
    )
    left = before + on_toes(rot.yaw_to_quaternion(yaw0), leaving, torch.full_like(pitch, gait.roll))
    landing = after + torch.tensor([0.0, ANKLE, 0.0])
    flying = torch.lerp(left, landing, smooth(swing)[:, None])
    flying[:, 1] += gait.lift * torch.sin(math.pi * swing) ** 2
    return torch.where(air[:, None], flying, planted), turn


def on_toes(flat: Tensor, turned: Tensor, pitch: Tensor) -> Tensor:
    """Where the ankle is, from its place on the ground, when the foot turns about the toe joint."""
    toe = torch.tensor(TOE)
    lifted = rot.quaternion_rotate(flat, toe) - rot.quaternion_rotate(turned, toe)
    raised = torch.where((pitch > 1e-6)[:, None], lifted, torch.zeros_like(lifted))
    return raised + torch.tensor([0.0, ANKLE, 0.0])


def about(axis: str, angle: Tensor | float, frames: int = FRAMES) -> Tensor:
    """A turn about one axis for every frame, [F, 4]."""
    angle = torch.as_tensor(angle, dtype=torch.float32).expand(frames)
    return rot.exp_map(angle[:, None] * torch.eye(3)["XYZ".index(axis)])


def chain(*turns: Tensor) -> Tensor:
    """Several turns, the last applied first."""
    result = turns[0]
    for turn in turns[1:]:
        result = rot.quaternion_multiply(result, turn)
    return result


def upper_body(gait: Gait, phase: Tensor, local: dict[str, Tensor]) -> None:
    """Pelvis, spine, head and arms from the phase of the steps (radians, one turn a cycle)."""
    beat = torch.cos(phase)  # +1 where the left leg swings through its middle
    forward = torch.sin(phase - 0.3)
    for n, joint in enumerate(("spine1", "spine2", "spine3")):
        bend = gait.lean / 3 + gait.slump * (0.15, 0.35, 0.5)[n]
        twist = (gait.shoulder_turn + gait.hip_turn) / 3 * forward
        local[joint] = chain(about("Y", twist), about("X", bend), about("Z", gait.side_bend * beat / 3))
    local["neck"] = about("X", gait.slump * 0.3 + gait.head * 0.5 - gait.lean * 0.3)
    local["head"] = chain(
        about("Y", -gait.shoulder_turn * 0.7 * forward), about("X", gait.head - gait.slump * 0.6 - gait.lean * 0.4)
    )
    for side, name in ((1, "left"), (-1, "right")):
        swing = side * gait.arm_swing * forward
        late = side * torch.sin(phase - 0.9)
        local[f"{name}_collar"] = about("Z", -side * (0.05 + 0.2 * max(gait.slump, 0)))
        local[f"{name}_shoulder"] = chain(
            about("X", swing - 0.05 - gait.lean * 0.6), about("Z", -side * (math.pi / 2 - gait.arm_out))
        )
        local[f"{name}_elbow"] = about("Y", -side * (gait.elbow + gait.elbow_swing * (0.5 - 0.5 * late)))
        local[f"{name}_wrist"] = about("Y", -side * 0.1)


def walk(gait: Gait, name: str) -> mk.Motion:
    """The clip of a gait, on SMPL's 22 joints."""
    skeleton = smpl()
    time = torch.arange(FRAMES) / FPS
    cycles = time * gait.steps_per_second / 2 + 0.1
    phase = 2 * math.pi * (cycles - SWING / 2)
    place, yaw = along(gait, cycles * 2 * gait.step)
    side = torch.stack((torch.cos(yaw), torch.zeros_like(yaw), -torch.sin(yaw)), -1)
    height = 0.96 - gait.crouch - gait.bob + gait.bob * torch.cos(2 * phase)
    root = place - side * (gait.sway * torch.cos(phase))[:, None] + height[:, None] * torch.tensor([0.0, 1.0, 0.0])
    local = {n: rot.identity_quaternion(FRAMES) for n in skeleton.names}
    local["pelvis"] = chain(
        rot.yaw_to_quaternion(yaw),
        about("Y", -gait.hip_turn * torch.sin(phase - 0.3)),
        about("X", 0.3 * gait.lean),
        about("Z", 0.5 * gait.side_bend * torch.cos(phase)),
    )
    upper_body(gait, phase, local)
    motion = mk.Motion.from_root(skeleton, torch.stack([local[n] for n in skeleton.names], 1), root, FPS, name=name)
    return plant_feet(motion, gait, cycles)


def plant_feet(motion: mk.Motion, gait: Gait, cycles: Tensor) -> mk.Motion:
    """Bend the legs so that the ankles are where `foot` puts them, and turn the feet as it says."""
    skeleton = motion.skeleton
    for side, name in ((1, "left"), (-1, "right")):
        leg = tuple(skeleton.index(f"{name}_{j}") for j in ("hip", "knee", "ankle"))
        target, turn = foot(gait, cycles, side)
        motion = two_bone_ik(motion, leg, target)
        world = motion.world_rotations()
        world[:, leg[2]] = turn
        world[:, skeleton.index(f"{name}_foot")] = turn
        motion = motion.replace(rotations=kinematics.local_rotations(skeleton, world))
    return motion.replace(rotations=rot.unroll(motion.rotations))


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent.parent / "data")
    folder.mkdir(exist_ok=True)
    for name, gait in CLIPS.items():
        print(mk.save(walk(gait, name), folder / f"{name}.bvh"))


if __name__ == "__main__":
    main()
