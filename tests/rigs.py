"""Rigs for tests: other names, orders, rest poses and joint counts, with the same motion on them."""

import torch

import motionkit as mk
from motionkit import Motion, Skeleton
from motionkit import rotations as rot
from motionkit.skeleton import smpl

SIDES = ("left", "right")
LIMBS = {"knee": ("hip", "knee", "ankle"), "elbow": ("shoulder", "elbow", "wrist")}
# name, parent, offset in units of a file as the CMU captures have them: T-pose with legs apart
CMU = [
    ("Hips", None, (0, 0, 0)),
    ("LHipJoint", "Hips", (0, 0, 0)),
    ("LeftUpLeg", "LHipJoint", (1.65, -1.8, 0.62)),
    ("LeftLeg", "LeftUpLeg", (2.6, -7.13, 0)),
    ("LeftFoot", "LeftLeg", (2.47, -6.78, 0)),
    ("LeftToeBase", "LeftFoot", (0.2, -0.56, 2.1)),
    ("RHipJoint", "Hips", (0, 0, 0)),
    ("RightUpLeg", "RHipJoint", (-1.65, -1.8, 0.62)),
    ("RightLeg", "RightUpLeg", (-2.6, -7.13, 0)),
    ("RightFoot", "RightLeg", (-2.47, -6.78, 0)),
    ("RightToeBase", "RightFoot", (-0.2, -0.56, 2.1)),
    ("LowerBack", "Hips", (0, 0, 0)),
    ("Spine", "LowerBack", (0.02, 2.03, -0.19)),
    ("Spine1", "Spine", (0.03, 2.03, 0.02)),
    ("Neck", "Spine1", (0, 0, 0)),
    ("Neck1", "Neck", (0, 1.6, 0.2)),
    ("Head", "Neck1", (0, 1.7, -0.1)),
    ("LeftShoulder", "Spine1", (0, 0, 0)),
    ("LeftArm", "LeftShoulder", (3.3, 1.2, -0.1)),
    ("LeftForeArm", "LeftArm", (4.9, 0, 0)),
    ("LeftHand", "LeftForeArm", (3.5, 0, 0)),
    ("LeftFingerBase", "LeftHand", (0, 0, 0)),
    ("LeftHandIndex1", "LeftFingerBase", (0.7, 0, 0)),
    ("LThumb", "LeftHand", (0.6, 0, 0.6)),
    ("RightShoulder", "Spine1", (0, 0, 0)),
    ("RightArm", "RightShoulder", (-3.3, 1.2, -0.1)),
    ("RightForeArm", "RightArm", (-4.9, 0, 0)),
    ("RightHand", "RightForeArm", (-3.5, 0, 0)),
    ("RightFingerBase", "RightHand", (0, 0, 0)),
    ("RightHandIndex1", "RightFingerBase", (-0.7, 0, 0)),
    ("RThumb", "RightHand", (-0.6, 0, 0.6)),
]
OTHER_NAMES = {
    "pelvis": "Hips",
    "spine1": "Spine",
    "spine2": "Chest",
    "spine3": "UpperChest",
    "neck": "Neck",
    "head": "Head",
    "hip": "Thigh",
    "knee": "Shin",
    "ankle": "Foot",
    "foot": "Toe",
    "collar": "Clavicle",
    "shoulder": "UpperArm",
    "elbow": "Forearm",
    "wrist": "Hand",
}


def cmu() -> Skeleton:
    names = [name for name, _, _ in CMU]
    parents = tuple(names.index(p) if p else -1 for _, p, _ in CMU)
    return Skeleton(tuple(names), parents, torch.tensor([o for _, _, o in CMU], dtype=torch.float32) * 0.056444)


def rerigged(motion: Motion, rest: torch.Tensor, rename=None) -> Motion:
    """The very same motion on a rig whose rest pose is the T-pose turned by `rest` [J, 4], joints in another order."""
    skeleton, order, todo = motion.skeleton, [], [0]
    while todo:
        order.append(todo.pop())
        todo += skeleton.children[order[-1]]
    above = [max(p, 0) for p in skeleton.parents]
    offsets = rot.quaternion_rotate(rest[above], skeleton.offsets.double())
    places = mk.kinematics.forward_kinematics(skeleton, rot.identity_quaternion(22), offsets)
    still = mk.kinematics.forward_kinematics(skeleton, rot.identity_quaternion(22), skeleton.offsets.double())
    offsets[0, 1] += still[:, 1].min() - places[:, 1].min()  # with its toes as high as in T-pose
    world = rot.quaternion_multiply(motion.world_rotations(), rot.quaternion_inverse(rest))
    parents = tuple(order.index(skeleton.parents[j]) if j else -1 for j in order)
    rig = Skeleton(tuple((rename or str)(skeleton.names[j]) for j in order), parents, offsets[order])
    local = mk.kinematics.local_rotations(rig, world[:, order])
    return Motion.from_root(rig, local, motion.translations[:, 0], motion.fps)


def other_name(name: str) -> str:
    side, _, bare = name.rpartition("_")
    return side.capitalize() + OTHER_NAMES[bare]


def rest_pose(kind: str) -> torch.Tensor:
    """World turns [22, 4] from the T-pose to a rest pose."""
    skeleton, rest = smpl(), rot.identity_quaternion(22, dtype=torch.float64)
    x, y, z = torch.eye(3, dtype=torch.float64)
    arms = {"T-pose": 0.0, "A-pose": 0.8, "arms-down": 1.45, "faces-x": 0.8}[kind]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint in skeleton.descendants(skeleton.index(f"{side}_shoulder")):
            rest[joint] = rot.axis_angle_to_quaternion(z, torch.tensor(-arms * sign).double())
        for joint in skeleton.descendants(skeleton.index(f"{side}_hip")):
            rest[joint] = rot.axis_angle_to_quaternion(z, torch.tensor(0.3 * sign * (kind == "A-pose")).double())
    if kind == "faces-x":
        rest = rot.quaternion_multiply(rot.axis_angle_to_quaternion(y, torch.tensor(torch.pi / 2).double()), rest)
    return rest


def along_x() -> torch.Tensor:
    """World turns [22, 4] after which every bone of the T-pose runs along x, those on the right along -x."""
    skeleton, left, up = smpl(), torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 1.0, 0.0])
    turns = []
    for side, name in zip(skeleton.sides, skeleton.names, strict=True):
        arm = any(w in name for w in ("collar", "shoulder", "elbow", "wrist"))
        bone, second = (up, -left) if side == "middle" else (left, up) if arm else (-up, left)
        if side == "right" and not arm:
            bone = -bone
        rows = torch.stack((bone, second, torch.linalg.cross(bone, second)))
        turns.append(rot.matrix_to_quaternion(rows.double()))
    return torch.stack(turns)


def flexion(motion: Motion, joint: str) -> torch.Tensor:
    """Degrees [F, 2] by which left and right knee or elbow are bent."""
    places, found = motion.positions(), []
    for side in SIDES:
        a, b, c = (places[:, motion.skeleton.roles[f"{side}_{r}"]] for r in LIMBS[joint])
        u, v = rot.normalize(b - a), rot.normalize(c - b)
        found.append(torch.atan2(torch.linalg.cross(u, v).norm(dim=-1), (u * v).sum(-1)))
    return torch.rad2deg(torch.stack(found, -1))
