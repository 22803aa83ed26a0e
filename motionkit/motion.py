"""A clip of motion: frames on a skeleton, cut, resampled, moved about, reordered, mirrored and joined."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from . import kinematics
from . import rotations as rot
from .errors import MotionKitError
from .skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Motion:
    """A clip of F frames on J joints. Metres, radians, Y up, facing +Z.

    rotations: [F, J, 4] unit quaternions w x y z, local to the parent. translations: [F, J, 3] metres
    from the parent, in the parent's frame; for most joints that is the skeleton's offset in every frame,
    for the root its place in the world, and for joints with position channels whatever was captured. fps:
    frames a second. metres_per_unit: the unit of the file it came from, used again when it is written.
    Raises MotionKitError if shapes do not fit the skeleton, a number is not finite (it names joint and
    frame), or fps is not above 0.

    >>> s = Skeleton(("root", "tip"), (-1, 0), torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    >>> m = Motion.from_root(s, rot.identity_quaternion(60, 2), torch.zeros(60, 3), fps=30)
    >>> m, m.positions().shape
    (Motion(60 frames at 30 fps, 2.0 s, 2 joints), torch.Size([60, 2, 3]))
    """

    skeleton: Skeleton
    rotations: Tensor
    translations: Tensor
    fps: float
    name: str = ""
    metres_per_unit: float = 1.0

    def __post_init__(self) -> None:
        joints = len(self.skeleton)
        frames = len(self.rotations) if getattr(self.rotations, "ndim", 0) else "F"
        for what, tensor, size in (("rotations", self.rotations, 4), ("translations", self.translations, 3)):
            if not isinstance(tensor, Tensor):
                raise MotionKitError(
                    f"motion {self.name!r}: {what} must be a torch tensor; found a {type(tensor).__name__}; "
                    "convert it with torch.as_tensor(...)"
                )
            if tuple(tensor.shape) != (frames, joints, size):
                raise MotionKitError(
                    f"motion {self.name!r}: expected {what} [{frames}, {joints}, {size}] for "
                    f"{self.skeleton!r}; found {list(tensor.shape)}"
                )
            if not torch.isfinite(tensor).all():
                frame, joint = (int(x) for x in (~torch.isfinite(tensor)).nonzero()[0][:2])
                raise MotionKitError(
                    f"motion {self.name!r}: {what} of joint {self.skeleton.names[joint]!r} in frame {frame} "
                    "is not a finite number; cut the frame out or fill it from its neighbours"
                )
        if not 0 < self.fps < 1e6:
            raise MotionKitError(f"motion {self.name!r}: fps must be between 0 and a million; found {self.fps}")

    @classmethod
    def from_root(cls, skeleton: Skeleton, rotations: Tensor, root: Tensor, fps: float, **more) -> Motion:
        """A motion in which only the root moves through space: rotations [F, J, 4], root [F, 3] metres."""
        translations = skeleton.offsets.to(root).expand(len(root), -1, -1).clone()
        translations[:, 0] = root
        return cls(skeleton, rotations, translations, fps, **more)

    def __len__(self) -> int:
        return len(self.rotations)

    def __repr__(self) -> str:
        name = f"{self.name!r}, " if self.name else ""
        length = f"{len(self)} frame{'s' * (len(self) != 1)} at {self.fps:g} fps, {self.duration:.1f} s"
        return f"Motion({name}{length}, {len(self.skeleton)} joints)"

    def __getitem__(self, frames: slice | int) -> Motion:
        """Some of the frames; `m[::2]` halves the frame rate, `m[::-1]` plays backwards, `m[5]` is one frame.

        A slice may reach beyond the ends, as with lists. Raises MotionKitError for a frame that is not there.
        """
        if hasattr(frames, "__index__"):
            number = operator.index(frames)
            if not -len(self) <= number < len(self):
                raise MotionKitError(f"{self!r} has no frame {number}; they go from 0 to {len(self) - 1}")
            number %= len(self)
            frames = slice(number, number + 1)
        if not isinstance(frames, slice) or frames.step == 0:
            raise MotionKitError(f"a motion is cut by frames, m[10:60] or m[5]; found m[{frames!r}]")
        chosen = list(range(len(self))[frames])
        return replace(
            self,
            rotations=self.rotations[chosen],
            translations=self.translations[chosen],
            fps=self.fps / abs(frames.step or 1),
        )

    def __iter__(self) -> Iterator[Motion]:
        """Its frames, one after the other, as motions of one frame."""
        return (self[n] for n in range(len(self)))

    @property
    def duration(self) -> float:
        """Seconds: frames divided by frame rate."""
        return len(self) / self.fps

    def replace(self, **changes) -> Motion:
        """The same motion with some of its fields changed."""
        return replace(self, **changes)

    def positions(self) -> Tensor:
        """Where the joints are in the world: [F, J, 3] metres, joints in the skeleton's order."""
        return kinematics.forward_kinematics(self.skeleton, self.rotations, self.translations)

    def world_rotations(self) -> Tensor:
        """How the joints are turned in the world: unit quaternions [F, J, 4]."""
        return kinematics.world_rotations(self.skeleton, self.rotations)

    def root_path(self) -> Tensor:
        """The path of the body on the ground, [F, 2]: x and z of the pelvis, metres."""
        return self.positions()[:, self.skeleton.pelvis][:, [0, 2]]

    def facing(self) -> Tensor:
        """Where the body faces, yaw [F] in radians, 0 along +Z (see `facing_of`)."""
        return facing_of(self.skeleton, self.positions(), self.world_rotations())

    def resample(self, fps: float, *, smooth: bool = False) -> Motion:
        """The same motion at another frame rate: slerp for rotations, straight lines for translations.

        The first frame stays; the last one is the last time that both rates share or precede. Straight lines have a
        corner at every frame they go through, which a higher rate shows; smooth: as in `sample`, without.
        """
        if not isinstance(fps, int | float) or not fps > 0:
            raise MotionKitError(f"cannot resample to {fps!r} fps; give a number above 0")
        if not len(self) or fps == self.fps:
            return self.replace(fps=float(fps))
        count = int((len(self) - 1) / self.fps * fps + 1e-6) + 1
        times = torch.arange(count, dtype=torch.float64) * (self.fps / fps)
        return self.sample(times, smooth=smooth).replace(fps=float(fps))

    def sample(self, frames: Tensor, *, smooth: bool = False) -> Motion:
        """The motion read at fractional frame numbers [N], clamped to its ends; slerp in between.

        smooth: by cubic splines through all frames instead (of quaternions, made unit again).

        >>> import motionkit as mk
        >>> walk = mk.load("data/actor/walk_neutral.bvh")
        >>> lines, curves = (mk.metrics.jitter(walk.resample(60, smooth=smooth)) for smooth in (False, True))
        >>> curves < lines / 3
        True
        """
        if not len(self):
            raise MotionKitError(f"motion {self.name!r} has no frames to read from")
        frames, last = torch.as_tensor(frames), len(self) - 1
        if smooth and last:
            times = frames.double().clamp(0, last)
            turned = _splined(rot.quaternion_unroll(self.rotations), times)
            turned = turned / turned.norm(dim=-1, keepdim=True)
            return self.replace(rotations=turned, translations=_splined(self.translations, times))
        low = frames.floor().long().clamp(0, max(last - 1, 0))
        high = (low + 1).clamp(max=last)
        t = (frames - low).clamp(0, 1).to(self.rotations.dtype)[:, None]
        turned = rot.slerp(self.rotations[low], self.rotations[high], t)
        moved = torch.lerp(self.translations[low], self.translations[high], t[..., None])
        return self.replace(rotations=turned, translations=moved)

    def transform(self, yaw: Tensor | float = 0.0, offset: Sequence[float] | Tensor = (0.0, 0.0, 0.0)) -> Motion:
        """The motion turned about the world's Y axis by `yaw` radians, then shifted by `offset` metres."""
        turn = rot.yaw_to_quaternion(torch.as_tensor(yaw, dtype=self.rotations.dtype))
        rotations, translations = self.rotations.clone(), self.translations.clone()
        rotations[:, 0] = rot.quaternion_multiply(turn, self.rotations[:, 0])
        shift = torch.as_tensor(offset, dtype=translations.dtype)
        translations[:, 0] = rot.quaternion_rotate(turn, self.translations[:, 0]) + shift
        return self.replace(rotations=rotations, translations=translations)

    def at_origin(self) -> Motion:
        """The motion moved so that it starts above the origin, facing +Z."""
        if not len(self):
            return self
        turned = self.transform(-self[:1].facing()[0])
        start = turned[:1].root_path()[0]
        return turned.transform(offset=(-float(start[0]), 0.0, -float(start[1])))

    def without_helper_joints(self) -> Motion:
        """The motion without helper joints above the pelvis (say, one on the ground)."""
        pelvis = self.skeleton.pelvis
        if pelvis == 0:
            return self
        keep = self.skeleton.descendants(pelvis)
        rotations, translations = self.rotations[:, keep].clone(), self.translations[:, keep].clone()
        rotations[:, 0] = self.world_rotations()[:, pelvis]
        translations[:, 0] = self.positions()[:, pelvis]
        return self.replace(skeleton=self.skeleton.subtree(keep), rotations=rotations, translations=translations)

    def with_helper_joints_of(self, body: Motion) -> Motion:
        """The inverse of `body`: helper joints as they are here, the rest from `body`, frame by frame."""
        pelvis = self.skeleton.pelvis
        if pelvis == 0:
            return body.replace(name=self.name, metres_per_unit=self.metres_per_unit)
        above = self.skeleton.parents[pelvis]
        back = rot.quaternion_inverse(self.world_rotations()[:, above])
        rotations, translations = self.rotations.clone(), self.translations.clone()
        keep = self.skeleton.descendants(pelvis)
        rotations[:, keep], translations[:, keep] = body.rotations, body.translations
        rotations[:, pelvis] = rot.quaternion_multiply(back, body.rotations[:, 0])
        from_above = body.translations[:, 0] - self.positions()[:, above]
        translations[:, pelvis] = rot.quaternion_rotate(back, from_above)
        return self.replace(rotations=rotations, translations=translations)

    def reorder(self, skeleton: Skeleton) -> Motion:
        """The motion with its joints in another skeleton's order, if they are the same ones; else as it is.

        A BVH file lists joints branch by branch, a dataset may count them otherwise.

        >>> import motionkit as mk
        >>> walk = mk.load("data/actor/walk_neutral.bvh")
        >>> walk.skeleton.names[4], walk.reorder(mk.skeleton.smpl()).skeleton.names[4]
        ('left_foot', 'left_knee')
        """
        names, parents = self.skeleton.names, self.skeleton.parents
        if names == skeleton.names or sorted(names) != sorted(skeleton.names):
            return self
        order = [self.skeleton.index(name) for name in skeleton.names]
        if skeleton.parents != tuple(-1 if parents[j] < 0 else order.index(parents[j]) for j in order):
            return self
        return self.replace(
            skeleton=Skeleton(skeleton.names, skeleton.parents, self.skeleton.offsets[order]),
            rotations=self.rotations[:, order],
            translations=self.translations[:, order],
        )

    def mirror(self, mirror_joints: Sequence[int] | None = None) -> Motion:
        """Left and right exchanged in the plane x = 0; mirroring twice gives the motion back.

        mirror_joints: for each joint the number of its mirror twin, itself on the midline; left out, the skeleton's
        own. Differentiable in rotations and translations. Raises MotionKitError if left and right cannot be told, or if
        a bone is no mirror image of its twin.

        >>> offsets = torch.tensor([[0.0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0]])
        >>> s = Skeleton(("hips", "l_hip", "r_hip"), (-1, 0, 0), offsets)
        >>> m = Motion.from_root(s, rot.identity_quaternion(1, 3), torch.tensor([[0.5, 1.0, 0.0]]), fps=30)
        >>> m.mirror().positions()[0, 0]
        tensor([-0.5000,  1.0000,  0.0000])
        """
        mirror_joints = _checked_mirror_joints(self.skeleton, mirror_joints)
        if not len(self):
            return self
        chosen = _choose_flips(self, mirror_joints)
        _check_bones(self, mirror_joints, chosen)
        flips = _FLIPS[chosen].to(self.rotations)
        above = torch.cat((_FLIPS[:1].to(flips), flips[list(self.skeleton.parents[1:])]))  # [J, 3]
        return self.replace(
            rotations=_mirror_rotations(self.rotations[:, list(mirror_joints)], above, flips),
            translations=_mirror_translations(self, mirror_joints, above),
        )


def _splined(rows: Tensor, times: Tensor) -> Tensor:
    """Rows [F, ...] of at least two frames, read at times [N] by cubic splines."""
    from scipy.interpolate import CubicSpline  # a third of a second, which `import motionkit` need not take

    return torch.from_numpy(CubicSpline(range(len(rows)), rows.detach().double().cpu())(times.cpu())).to(rows)


def facing_of(skeleton: Skeleton, positions: Tensor, world: Tensor | None = None) -> Tensor:
    """Where the body faces, yaw [F] in radians: hips and shoulders averaged, crossed with up.

    positions: [F, J, 3] metres. Where the skeleton has no hips and shoulders by name, all its left-right
    pairs are averaged; where it has no pairs, the yaw of the pelvis in `world` [F, J, 4] is taken, or 0
    (paper 1, section 3.1).

    >>> offsets = torch.tensor([[0.0, 1, 0], [0.1, 0, 0], [-0.1, 0, 0]])
    >>> s = Skeleton(("hips", "l_hip", "r_hip"), (-1, 0, 0), offsets)
    >>> facing_of(s, s.offsets[None])
    tensor([0.])
    """
    pairs = left_right_pairs(skeleton)
    if pairs:
        left, right = (list(side) for side in zip(*pairs, strict=True))
        across = rot.normalize(positions[:, left] - positions[:, right]).mean(1)
        return rot.direction_to_yaw(torch.linalg.cross(across, across.new_tensor([0.0, 1.0, 0.0]).expand_as(across)))
    if world is None:
        return positions.new_zeros(len(positions))
    return rot.quaternion_to_yaw(world[:, skeleton.pelvis])


def left_right_pairs(skeleton: Skeleton) -> list[tuple[int, int]]:
    """The (left, right) joints that tell where a body faces: hips and shoulders, or else every pair of mirror joints.

    >>> left_right_pairs(Skeleton(("a", "LeftHip", "RightHip"), (-1, 0, 0), torch.zeros(3, 3)))
    [(1, 2)]
    """
    roles = skeleton.roles
    pairs = [(roles[f"left_{r}"], roles[f"right_{r}"]) for r in ("hip", "shoulder")
             if f"left_{r}" in roles and f"right_{r}" in roles]  # fmt: skip
    if pairs or skeleton.mirror_joints is None:
        return pairs
    return [(n, t) for n, t in enumerate(skeleton.mirror_joints) if skeleton.sides[n] == "left"]


def concatenate(motions: Sequence[Motion]) -> Motion:
    """Clips one after the other, as they are (no blending); same skeleton and frame rate.

    >>> s = Skeleton(("root",), (-1,), torch.zeros(1, 3))
    >>> m = Motion.from_root(s, rot.identity_quaternion(10, 1), torch.zeros(10, 3), fps=30)
    >>> len(concatenate([m, m]))
    20
    """
    if not motions:
        raise MotionKitError("nothing to concatenate: give at least one motion")
    odd = next((m for m in motions if not isinstance(m, Motion)), None)
    if odd is not None:
        raise MotionKitError(f"concatenate takes a list of Motions; found {odd!r:.60} in it")
    first = motions[0]
    for m in motions[1:]:
        if not m.skeleton.same_tree(first.skeleton):
            raise MotionKitError(f"cannot join {m!r} to {first!r}: their skeletons differ")
        if abs(m.fps - first.fps) > 1e-6:
            raise MotionKitError(f"cannot join {m.fps:g} fps to {first.fps:g} fps: resample({first.fps:g}) first")
    return first.replace(
        rotations=torch.cat([m.rotations for m in motions]),
        translations=torch.cat([m.translations for m in motions]),
    )


_FLIPS = torch.tensor([[-1.0, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1]], dtype=torch.float64)
# What a flip costs. Half a turn of twist costs up to 8; an offset that comes out opposite must cost far
# more, and one that a measured, not quite even skeleton leaves a few per cent off far less. A helper
# joint above the pelvis need not follow the body's turns, so it keeps the flip of the world's x. The
# others break ties.
_OFFSET_COST, _HELPER_COST, _UPSIDE_DOWN_COST, _CHANGE_COST = 100.0, 20.0, 0.1, 1e-3


def _checked_mirror_joints(skeleton: Skeleton, wanted: Sequence[int] | None) -> tuple[int, ...]:
    """The mirror joints, made sure of: they pair up, and so do their parents."""
    mirror_joints = tuple(int(t) for t in (wanted if wanted is not None else skeleton.mirror_joints or ()))
    nobody = wanted is None and set(skeleton.sides) == {"middle"} and max(map(len, skeleton.children)) > 1
    in_range = len(mirror_joints) == len(skeleton) and all(0 <= t < len(skeleton) for t in mirror_joints)
    if nobody or not in_range or any(mirror_joints[t] != n for n, t in enumerate(mirror_joints)):
        raise MotionKitError(
            f"cannot tell left from right on {', '.join(skeleton.names[:8])}, ...: give mirror_joints=[...], for "
            "each joint the number of its mirror twin (itself on the midline)"
        )
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0 and mirror_joints[parent] != skeleton.parents[mirror_joints[joint]]:
            names = skeleton.names
            raise MotionKitError(
                f"joints {names[joint]!r} and {names[mirror_joints[joint]]!r} mirror each other, but their parents "
                f"{names[parent]!r} and {names[skeleton.parents[mirror_joints[joint]]]!r} do not: give other "
                "mirror_joints"
            )
    return mirror_joints


def _mirror_rotations(twin: Tensor, above: Tensor, flips: Tensor) -> Tensor:
    """`S_parent L S_j` for the twin's rotations L [F, J, 4] and flips [J, 3], as quaternions.

    A flip on both sides turns the axis of a rotation, as a pseudovector, by -S. What is left, `S_parent S_j`,
    is no turn or half a turn about one axis.
    """
    seen = torch.cat((twin[..., :1], -above * twin[..., 1:]), -1)
    half_turn = above * flips  # [J, 3]: all +1 for no turn, or +1 on the axis alone
    turns = (half_turn.sum(-1, keepdim=True) < 0) * torch.clamp(half_turn, min=0)
    rest = torch.cat((1 - turns.sum(-1, keepdim=True), turns), -1)
    return rot.quaternion_unroll(rot.quaternion_multiply(seen, rest))


def _mirror_translations(motion: Motion, mirror_joints: tuple[int, ...], above: Tensor) -> Tensor:
    """The twin's translations [F, J, 3] in the mirror; joints without position channels keep their offset."""
    skeleton = motion.skeleton
    placed = [any(c.endswith("position") for c in channels) for channels in skeleton.channels]
    fixed = [n > 0 and not placed[n] and not placed[t] for n, t in enumerate(mirror_joints)]
    base = skeleton.offsets.to(motion.translations) * torch.tensor(fixed)[:, None]
    return base + above * (motion.translations - base)[:, list(mirror_joints)]


def _choose_flips(motion: Motion, mirror_joints: tuple[int, ...]) -> Tensor:
    """For each joint the number of its flip [J]: the labelling of the tree that costs least, found exactly.

    Costs add up from the leaves to the root; then each joint takes the flip that is best under its parent's.
    """
    skeleton = motion.skeleton
    local = rot.quaternion_to_matrix(motion.rotations.detach().double())
    cost = _OFFSET_COST * _offset_misfit(skeleton, mirror_joints) ** 2  # [J, 4]
    up = local[:, 0, 1]  # the world's up as the root sees it, [F, 3]; a mirror leaves it up
    cost[0] += _UPSIDE_DOWN_COST * ((up[:, None] * _FLIPS - up[:, None]) ** 2).sum(-1).mean(0)
    cost[0, 1:] += _CHANGE_COST
    cost[list(skeleton.ancestors(skeleton.pelvis)[:-1]), 1:] += _HELPER_COST
    alike = (local * local[:, list(mirror_joints)]).mean(0)  # [J, 3, 3]
    # mean |S_p L_twin S_c - L|^2 over frames, for each flip above and own flip: [J, 4, 4]
    links = 6 - 2 * torch.einsum("pk,jki,ci->jpc", _FLIPS, alike, _FLIPS)
    links = links + _CHANGE_COST * (1 - torch.eye(4, dtype=links.dtype))
    for joint in range(len(skeleton) - 1, 0, -1):
        cost[skeleton.parents[joint]] += (links[joint] + cost[joint]).amin(-1)
    chosen = [int(cost[0].argmin())]
    for joint in range(1, len(skeleton)):
        best = int((links[joint, chosen[skeleton.parents[joint]]] + cost[joint]).argmin())
        # mirror joints must agree, or mirroring twice would not give the motion back
        chosen.append(chosen[mirror_joints[joint]] if mirror_joints[joint] < joint else best)
    return torch.tensor(chosen)


def _bone_pairs(skeleton: Skeleton, mirror_joints: tuple[int, ...], joint: int) -> list[tuple[Tensor, Tensor]]:
    """The bones [3] that leave a joint, each with the bone of its twin."""
    offsets = skeleton.offsets.double()
    pairs = [(offsets[c], offsets[mirror_joints[c]]) for c in skeleton.children[joint]]
    mine, other = ([o for j, o in skeleton.end_sites if j == n] for n in (joint, mirror_joints[joint]))
    if len(mine) == len(other) == 1:
        pairs.append((offsets.new_tensor(mine[0]), offsets.new_tensor(other[0])))
    return pairs


def _offset_misfit(skeleton: Skeleton, mirror_joints: tuple[int, ...]) -> Tensor:
    """How badly each flip maps a joint's bones onto those of its twin, [J, 4], 0 (well) to 1 (opposite)."""
    misfit = torch.zeros(len(skeleton), len(_FLIPS), dtype=torch.float64)
    for joint in range(len(skeleton)):
        pairs = _bone_pairs(skeleton, mirror_joints, joint)
        size = float(sum(a.norm() + b.norm() for a, b in pairs))
        if size > 1e-4:  # metres; shorter bones say nothing
            misfit[joint] = sum((a * _FLIPS - b).norm(dim=-1) for a, b in pairs) / size
    return misfit


def _check_bones(motion: Motion, mirror_joints: tuple[int, ...], chosen: Tensor) -> None:
    """Refuse a rig whose bones no flip maps onto their mirror images, rather than tear the body apart."""
    skeleton = motion.skeleton
    offsets = skeleton.offsets.double()
    for joint, parent in enumerate(skeleton.parents):
        if parent < 0 or any(c.endswith("position") for c in skeleton.channels[joint]):
            continue
        off = float((offsets[mirror_joints[joint]] * _FLIPS[chosen[parent]] - offsets[joint]).norm())
        if off > 0.1 * skeleton.height:
            raise MotionKitError(
                f"cannot mirror {skeleton!r}: the bone to {skeleton.names[joint]!r} is no mirror image of the bone to "
                f"{skeleton.names[mirror_joints[joint]]!r} ({off:.2f} m off); check the mirror_joints, or write the "
                "file with a rest pose that is alike on both sides"
            )
