"""Style-neutral pairs: a clip beside somebody's neutral clip of the same action, brought to its time.

Such pairs are what style transfer was learned from before networks (Hsu et al. 2005; Xia et al. 2015), and what paper 1
compares its own neutral motions with (section 6.2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from .. import rotations as rot
from ..datasets import Dataset
from ..datasets.loading import load as load_dataset
from ..dtw import EVEN, dtw, dtw_costs, pose_velocity_features, step_penalty_for, warp
from ..errors import MotionKitError
from ..motion import Motion
from .base import (
    NEUTRAL,
    LRUCache,
    align_start,
    motion_hash,
    rest_key,
    retarget_if_needed,
    retarget_to,
    same_rest,
    without_helper_joints,
)

_COARSE, _FINE = 4, 12  # many clips are first compared in every fourth frame; so many are then looked at closely


@dataclass(frozen=True, eq=False)
class Pair:
    """A styled motion and a neutral one that does the same in each frame, on one kind of body, no helper joints."""

    styled: Motion
    neutral: Motion

    @cached_property
    def difference(self) -> Tensor:
        """What to add to the neutral motion to get the styled one, [F, 3J + 1]; see `pose_difference`."""
        return pose_difference(self.styled, self.neutral)

    @cached_property
    def features(self) -> tuple[Tensor, Tensor]:
        """`pose_velocity_features` of the styled and of the neutral motion, [F, 6J] each: by what frames are found."""
        return pose_velocity_features(self.styled, centred=False), pose_velocity_features(self.neutral, centred=False)

    def fits(self, motion: Motion) -> bool:
        """Whether poses of the pair mean what they mean for a motion's body."""
        return all(same_rest(m.skeleton, motion.skeleton) for m in (self.styled, self.neutral))

    def like(self, motion: Motion) -> Pair:
        """The pair on a body like that of a motion; itself if it fits. MotionKitError if it cannot be."""
        return (
            self
            if self.fits(motion)
            else Pair(retarget_if_needed(self.styled, motion), retarget_if_needed(self.neutral, motion))
        )


def pose_difference(a: Motion, b: Motion) -> Tensor:
    """What to add to the poses of `b` to get those of `a`, frame by frame: [F, 3J + 1].

    Rotation vectors in radians, each seen from the joint's parent, the pelvis' from where the body faces; and how much
    higher the pelvis is, in shares of the body's height. Where the body goes and faces is no part of it.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> pose_difference(walk, walk).abs().max() < 1e-3
    tensor(True)
    """
    (_, turned, high), (_, rest, low) = _posture(a), _posture(b)
    turns = rot.log_map(rot.quaternion_canonical(rot.quaternion_multiply(turned, rot.quaternion_inverse(rest))))
    return torch.cat((turns.flatten(1), (high - low)[:, None]), 1)


def add_pose_difference(motion: Motion, change: Tensor) -> Motion:
    """A motion with `pose_difference`s [F, 3J + 1] added to its poses; it goes and faces where it did.

    >>> import motionkit as mk
    >>> walk, old = (mk.load(f"data/actor/walk_{s}.bvh")[:100] for s in ("neutral", "old"))
    >>> bent = add_pose_difference(walk, pose_difference(old, walk))
    >>> bool(pose_difference(bent, old).abs().mean() < 0.02)
    True
    """
    yaw, turned, _ = _posture(motion)
    rotations = rot.quaternion_multiply(rot.exp_map(change[:, :-1].unflatten(1, (-1, 3))), turned)
    rotations[:, 0] = rot.quaternion_multiply(rot.yaw_to_quaternion(yaw), rotations[:, 0])
    translations = motion.translations.clone()
    translations[:, 0, 1] += change[:, -1] * motion.skeleton.height
    return motion.replace(rotations=rot.quaternion_unroll(rotations), translations=translations)


def _posture(motion: Motion) -> tuple[Tensor, Tensor, Tensor]:
    """Where a body faces [F], its rotations [F, J, 4] with the pelvis' seen from there, its height [F] in its own."""
    yaw, turned = motion.facing(), motion.rotations.clone()
    turned[:, 0] = rot.quaternion_multiply(rot.yaw_to_quaternion(-yaw), turned[:, 0])
    return yaw, turned, motion.translations[:, 0, 1] / max(motion.skeleton.height, 1e-6)


class NeutralPairs:
    """The neutral clips of a data set, and for any clip its pair among them (paper 1, section 6.2, "KNN+DTW").

    library: a Dataset with contents and styles, one of them `neutral` or `normal`; left out, the training part of
    `actor`, made when it is first needed. smooth: between its frames, a clip follows splines. What was found is
    remembered, so that each clip is searched for once. Raises MotionKitError if the library is no dataset or has no
    neutral clips.

    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walk = Item("walk", Labels("walk", "neutral", ()), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> import motionkit as mk
    >>> old = mk.load("data/actor/walk_old.bvh")
    >>> NeutralPairs(from_items("mine", [walk])).neutral_of(old)
    Motion('walk, for walk_old', 161 frames at 30 fps, 5.4 s, 22 joints)
    """

    def __init__(self, library: Dataset | None = None, smooth: bool = False) -> None:
        self._library, self._smooth = library, smooth
        self._clips, self._movements, self._pairs = LRUCache(4096), LRUCache(4096), LRUCache()
        if library is not None:
            self._check(library)

    def _check(self, library: Dataset) -> None:
        if not isinstance(library, Dataset):
            raise MotionKitError(
                f"a library is a dataset, as mk.datasets.load('actor') gives it; found {library!r}"
                + ("; give one part of a split, such as .train" if hasattr(library, "train") else "")
            )
        if not set(NEUTRAL) & set(library.styles):
            raise MotionKitError(
                f"{library!r} has no neutral clips to compare with: none of its styles ({', '.join(library.styles)}) "
                f"is called {' or '.join(NEUTRAL)}"
            )

    @cached_property
    def library(self) -> Dataset:
        """The dataset."""
        return load_dataset("actor").split().train if self._library is None else self._library

    def numbers(self, content: str | None = None) -> list[int]:
        """Which of the library's stored clips are neutral and of this content; of all, if none of it is.

        Raises MotionKitError for a content that the whole dataset does not have.
        """
        labels = self.library.labels
        found = [n for n in self.library.indices if labels[n].style in NEUTRAL]
        if content is not None and content not in self.library.vocabulary["content"]:
            known = ", ".join(self.library.vocabulary["content"])
            raise MotionKitError(f"library {self.library.name!r} knows no content {content!r}; it has {known}")
        return [n for n in found if labels[n].content == content] or found

    def clip(self, number: int) -> Motion:
        """A stored clip without helper joints."""
        return self._clips.get(number, lambda: without_helper_joints(self.library.store.recording(number).motion))

    def pair(self, motion: Motion, content: str | None = None, like: Motion | None = None) -> Pair:
        """The nearest neutral clip of the same content, or the nearest segment of it, in the time of a motion.

        content: what the motion does; left out, clips of all contents are searched. Where the library's bodies are of
        another kind, the motion is retargeted to be compared and paired; like: a motion on whose kind of body the pair
        is then wanted. Raises MotionKitError where that cannot be.
        """
        key = motion_hash(motion), content
        found = self._pairs.get(key, lambda: self._found(without_helper_joints(motion), content))
        if like is None or found.fits(like):
            return found
        return self._pairs.get((*key, rest_key(like.skeleton)), lambda: found.like(like))

    def neutral_of(self, motion: Motion, content: str | None = None) -> Motion:
        """The neutral clip of `pair` on the motion's own skeleton: as many frames, starting where the motion starts."""
        found, body = self.pair(motion, content).neutral, without_helper_joints(motion)
        return motion.with_helper_joints_of(align_start(retarget_to(found, body), body)).replace(
            name=f"{found.name}, for {motion.name}"
        )

    def _found(self, motion: Motion, content: str | None) -> Pair:
        numbers = self.numbers(content)
        alike = [n for n in numbers if self.clip(n).skeleton.same_tree(motion.skeleton)]
        numbers = alike or [n for n in numbers if self.clip(n).skeleton.same_tree(self.clip(numbers[0]).skeleton)]
        try:
            seen = retarget_if_needed(motion, self.clip(numbers[0]))
        except MotionKitError as error:
            raise MotionKitError(
                f"{motion.name!r} cannot be compared with the clips of library {self.library.name!r} ({error}); give a "
                "library of such bodies, as mk.methods.load('knn-dtw', library=dataset)"
            ) from None
        number, frames = self._nearest(pose_velocity_features(seen), numbers, motion.fps)
        return Pair(seen, self._at_rate(number, motion.fps).sample(frames, smooth=self._smooth))

    def _at_rate(self, number: int, fps: float) -> Motion:
        return self.clip(number).resample(fps, smooth=self._smooth)

    def _nearest(self, wanted: Tensor, numbers: list[int], fps: float) -> tuple[int, Tensor]:
        """The clip that a motion's movement [F, 6J] goes through most cheaply, and its frames [F]."""
        if len(numbers) > _FINE:
            costs, _ = self._costs(wanted[::_COARSE], numbers, fps, _COARSE)
            numbers = [numbers[n] for n in costs.argsort(stable=True)[:_FINE].tolist()]
        costs, penalty = self._costs(wanted, numbers, fps, 1)
        number = numbers[int(costs.argmin())]
        path = dtw(torch.cdist(wanted, self._movement(number, fps)), step_penalty=penalty, segment=True)
        return number, warp(path, EVEN * fps)

    def _costs(self, wanted: Tensor, numbers: list[int], fps: float, step: int) -> tuple[Tensor, float]:
        """What the best path through a segment of each clip costs, [N], and the step penalty that was taken."""
        theirs = [self._movement(n, fps)[::step] for n in numbers]
        costs = torch.cdist(wanted, torch.nn.utils.rnn.pad_sequence(theirs, batch_first=True))
        penalty = step_penalty_for(costs[0, :, : len(theirs[0])])
        return dtw_costs(costs, torch.tensor([len(t) for t in theirs]), step_penalty=penalty, segment=True), penalty

    def _movement(self, number: int, fps: float) -> Tensor:
        return self._movements.get((number, fps), lambda: pose_velocity_features(self._at_rate(number, fps)))
