"""Methods to beat, without a network: copies, statistics, KNN + DTW (paper 1, section 6.2), a linear filter."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .. import rotations as rot
from ..datasets import Dataset
from ..dtw import gaussian_smooth, pose_velocity_features
from ..errors import MotionKitError
from ..features import FacingFree
from ..motion import Motion
from .base import (
    NEUTRAL,
    Example,
    Labels,
    LRUCache,
    StyleTransfer,
    align_start,
    check_motion,
    clamp_ratio,
    liveliness,
    match_root_speed,
    motion_hash,
    rest_key,
    retarget_if_needed,
    retarget_to,
    same_rest,
    warp_velocity,
    without_helper_joints,
)
from .neutral_pairs import NeutralPairs, Pair, add_pose_difference


class CopyContent(StyleTransfer):
    """Returns the content: nothing of it is lost, and no style is there. Any method should beat it in style.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> mk.methods.load("copy-content").stylize(walk, style="old")
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "copy-content"
    plants_feet = False

    def read_style(self, style: object) -> object:
        """Anything: it is not looked at."""
        return style

    def transfer(self, body: Motion, style: object, strength: float, *, labels: Labels, seed: int) -> Motion:
        """The content."""
        return body


class CopyStyle(StyleTransfer):
    """Returns the style clip, on the content's skeleton: all of the style, and what is done is the style clip's.

    Any method should beat it in content. The result has as many frames as the style clip has at the content's rate.

    >>> import motionkit as mk
    >>> walk, old = (mk.load(f"data/actor/walk_{s}.bvh") for s in ("neutral", "old"))
    >>> mk.methods.load("copy-style").stylize(walk, style=old)
    Motion('walk_neutral as walk_old', 161 frames at 30 fps, 5.4 s, 22 joints)
    """

    name = "copy-style"
    plants_feet = False

    def transfer(self, body: Motion, style: Example, strength: float, *, labels: Labels, seed: int) -> Motion:
        """The style clip, starting where the content starts and facing the same way."""
        return align_start(retarget_to(without_helper_joints(style.motion.resample(body.fps)), body), body)


def match_statistics(content: Tensor, style: Tensor, most: float = 3.0) -> Tensor:
    """Content features [F, D] shifted and scaled to the mean and spread of style features [G, D], number by number.

    most: no spread grows more than so many times, since numbers that hardly move in the content only hold noise.
    This is AdaIN (Huang and Belongie 2017, eq. 8) on poses instead of network features.

    >>> match_statistics(torch.tensor([[0.0], [2.0]]), torch.tensor([[4.0], [8.0]]))
    tensor([[4.],
            [8.]])
    """
    spread, wanted = content.std(0, correction=0), style.std(0, correction=0)
    gain = (wanted / spread.clamp(min=1e-6)).clamp(max=most)
    return (content - content.mean(0)) * gain + style.mean(0)


class Statistics(StyleTransfer):
    """Statistics transfer: match mean and spread per feature, warp the speed (paper 1, eq. 13), lock the feet.

    It needs no training and one style clip. The features are paper 1's (`FacingFree`); a style on another rig is
    retargeted to the content's first. It carries postures well; timing, and whatever the style does in another order
    than the content, it cannot.

    >>> import motionkit as mk
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> old = mk.methods.load("statistics").stylize(walk, style=style)
    >>> len(old), old.name
    (120, 'walk_neutral as walk_old')
    """

    name = "statistics"

    def __init__(self) -> None:
        self._styles = LRUCache(32)

    def transfer(self, body: Motion, style: Example, strength: float, *, labels: Labels, seed: int) -> Motion:
        """Each feature with the style clip's mean and standard deviation; the root's speed warped (paper 1, eq. 13)."""
        layout = FacingFree(fps=body.fps)
        x = layout.encode(body)
        wanted, style_liveliness = self._statistics_of(style.motion, body)
        y = torch.lerp(x, match_statistics(x, wanted), strength)
        y[:, :3] = x[:, :3]  # the path is the content's; only its speed is warped
        factor = 1 + strength * (clamp_ratio(style_liveliness / liveliness(body)) - 1)
        start = body.translations[0, 0] * torch.tensor([1.0, 0.0, 1.0])
        return layout.decode(warp_velocity(y, factor)).transform(body[:1].facing()[0], start)

    def _statistics_of(self, style: Motion, content: Motion) -> tuple[Tensor, float]:
        """The style's features [G, D] on the content's kind of body, and how lively it is."""

        def work_out() -> tuple[Tensor, float]:
            motion = retarget_if_needed(without_helper_joints(style.resample(content.fps)), content)
            return FacingFree(motion.skeleton, content.fps).encode(motion), liveliness(motion)

        return self._styles.get((motion_hash(style), content.fps, rest_key(content.skeleton)), work_out)


_NEAR = 0.3  # frames less unlike than this, in the unit of `pose_velocity_features`, count as the same
_CARRY_EASE = 0.07  # seconds: standard deviation of the Gaussian over differences that are carried over


class KnnDtw(StyleTransfer):
    """KNN + DTW style transfer (paper 1, section 6.2, tables 2 and 3): pairs from a library, no training.

    The style clip's pair is the nearest segment of a neutral clip of the same content, aligned by dynamic time warping.
    In each frame of the content, the result is the content plus the pair's difference in those frames whose neutral
    pose and speed are most like the content's; so a kick can be as old as the walk it is taken from. A content that is
    styled itself is made neutral in the same way first. The content's timing stays; the root's speed goes with the size
    of the movements (`base.match_root_speed`, after paper 1, eq. 13). library: a labelled Dataset; left out, `actor`'s
    training part.

    >>> import motionkit as mk
    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> jump = Item("jump", Labels("jump", "neutral"), BvhSource.at("data/actor/jump_neutral.bvh"))
    >>> step = Item("walk", Labels("walk", "neutral"), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> method = mk.methods.load("knn-dtw", library=from_items("mine", [jump, step]))
    >>> method.stylize(walk, style=Example(style, Labels("walk")))
    Motion('walk_neutral as walk_old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "knn-dtw"

    def __init__(self, library: Dataset | None = None) -> None:
        self.pairs = NeutralPairs(library)

    def fit(self, train: Dataset) -> KnnDtw:
        """Take pairs from this dataset from now on; its clips are read when they are first needed."""
        self.pairs = NeutralPairs(train)
        return self

    def neutral_pair(self, style: Motion, content: str | None = None) -> Motion:
        """The neutral motion that goes with a styled one, frame by frame, on its skeleton (paper 1, table 2).

        content: what the clip does, a label of the library; left out, neutral clips of all contents are searched.
        """
        check_motion("style", style)
        return self.pairs.neutral_of(style, content)

    def transfer(self, body: Motion, style: Example, strength: float, *, labels: Labels, seed: int) -> Motion:
        """The content plus the differences of the style's pair; a styled content is made neutral first.

        Labels of both clips, where known, say among which contents their pairs are looked for.
        """
        result = body
        if labels.style and labels.style not in NEUTRAL:
            own = self.pairs.pair(body, labels.content or None, body)
            features, difference = own.features[0], own.difference
            result = add_pose_difference(result, -strength * carry_difference(result, features, difference))
        if style.labels.style not in NEUTRAL:
            pair = self.pairs.pair(style.motion.resample(body.fps), style.labels.content or None, body)
            features, difference = pair.features[1], pair.difference
            result = add_pose_difference(result, strength * carry_difference(result, features, difference))
        return match_root_speed(result, body)


def carry_difference(motion: Motion, known: Tensor, differences: Tensor) -> Tensor:
    """For each frame of a motion the differences of those of another's frames that are most like it, [F, D].

    known: `pose_velocity_features` of the other, [G, 6J], not centred. differences: [G, D], one for each of its frames.
    Frames count by a Gaussian of how unlike they are, which is as wide as the nearest one is far: where nothing is
    near, it becomes their mean. Eased over neighbouring frames.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> carry_difference(walk[:50], pose_velocity_features(walk, centred=False), torch.ones(120, 1)).mean()
    tensor(1.)
    """
    unlike = torch.cdist(pose_velocity_features(motion, centred=False), known)
    width = unlike.amin(1, keepdim=True).clamp(min=_NEAR)
    weights = torch.softmax(-0.5 * (unlike / width) ** 2, 1)
    return gaussian_smooth(weights @ differences, _CARRY_EASE * motion.fps)


_TAPS = (-1 / 3, -1 / 6, 0.0, 1 / 6, 1 / 3)  # seconds from the frame that is predicted
_MEAN = 1500  # so many frames weigh for the mean difference alone: one clip's poses say little about others
_PREDICT_EASE = 0.03  # seconds: standard deviation of the Gaussian over what is predicted


@dataclass(frozen=True, eq=False)
class Filter:
    """A linear time-invariant filter from poses to what is to be added to them.

    mean: [P] of the poses; axes: [P, K] their principal directions; weights: [5K, D] over five moments around each
    frame; bias: [D].
    """

    mean: Tensor
    axes: Tensor
    weights: Tensor
    bias: Tensor

    @classmethod
    def learned(cls, pairs: list[Pair], dims: int, ridge: float, *, back: bool) -> Filter:
        """By ridge regression from aligned pairs; back: from styled to neutral.

        ridge: the penalty on weights, as a share of the variance of what goes in. The bias has none, so with an
        infinite penalty the mean difference is added.
        """
        poses = [_poses(p.styled if back else p.neutral) for p in pairs]
        changes = torch.cat([-p.difference if back else p.difference for p in pairs])
        together = torch.cat(poses)
        mean = together.mean(0)
        axes = torch.linalg.eigh((together - mean).T @ (together - mean))[1].flip(1)[:, :dims]
        moments = [_moments((x - mean) @ axes, p.styled.fps) for x, p in zip(poses, pairs)]
        x, bias = torch.cat(moments).double(), changes.mean(0)
        penalty = ridge * (len(x) + _MEAN) * float((x**2).mean()) + 1e-9
        gram = x.T @ x + penalty * torch.eye(x.shape[1], dtype=x.dtype)
        weights = torch.linalg.solve(gram, x.T @ (changes - bias).double()).float()
        return cls(mean, axes, weights, bias)

    def apply(self, motion: Motion, strength: float) -> Motion:
        """The motion with what the filter predicts added to its poses."""
        change = _moments((_poses(motion) - self.mean) @ self.axes, motion.fps) @ self.weights + self.bias
        return add_pose_difference(motion, strength * gaussian_smooth(change, _PREDICT_EASE * motion.fps))


def _poses(motion: Motion) -> Tensor:
    """Poses [F, 6J + 1]: 6D rotations, the pelvis' seen from where the body faces, and its height in the body's own."""
    turned = motion.rotations.clone()
    turned[:, 0] = rot.quaternion_multiply(rot.yaw_to_quaternion(-motion.facing()), turned[:, 0])
    height = motion.translations[:, 0, 1:2] / max(motion.skeleton.height, 1e-6)
    return torch.cat((rot.quaternion_to_sixd(turned).flatten(1), height), 1)


def _moments(x: Tensor, fps: float) -> Tensor:
    """For each frame of [F, K] those around it, at `_TAPS`: [F, 5K]; beyond the ends, the end frames stand."""
    frames = torch.arange(len(x))
    return torch.cat([x[(frames + round(t * fps)).clamp(0, len(x) - 1)] for t in _TAPS], 1)


class Linear(StyleTransfer):
    """Linear time-invariant style translation, in the manner of Hsu, Pulli and Popovic 2005.

    Theirs: neutral and styled performances of the same are aligned by time warping, and a linear time-invariant system
    learned from the pairs turns neutral motion into styled motion; the path and the feet are seen to afterwards. Not
    theirs: the pairs are found in a library (as for KNN + DTW); one filter serves all actions of a style; it is a
    finite one over two thirds of a second of principal components, learned by ridge regression, where theirs is a
    state-space model found by subspace identification (N4SID); it predicts the difference, not the pose; and the
    content keeps its timing, which theirs translates too.

    library: a labelled Dataset; left out, `actor`'s training part. takes: clips of each content learned from; dims:
    principal components; ridge: how strongly weights are held small. A filter is learned when a style is first asked
    for.

    >>> import motionkit as mk
    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> step = Item("walk", Labels("walk", "neutral"), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> mk.methods.load("linear", library=from_items("mine", [step])).stylize(walk, style=style)
    Motion('walk_neutral as walk_old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "linear"

    def __init__(self, library: Dataset | None = None, takes: int = 3, dims: int = 20, ridge: float = 0.3) -> None:
        for what, value, least in (("takes", takes, 1), ("dims", dims, 1), ("ridge", ridge, 0)):
            if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < float("inf"):
                raise MotionKitError(f"linear: {what} must be a number from {least} up; found {value!r}")
        self.takes, self.dims, self.ridge = int(takes), int(dims), float(ridge)
        self.fit(library)

    def fit(self, train: Dataset | None) -> Linear:
        """Learn from this dataset from now on; its clips are read when their style is first asked for."""
        self.pairs, self._filters = NeutralPairs(train), LRUCache(128)
        return self

    def read_style(self, style: object) -> Example | str:
        """A label of the library, or a clip."""
        if not isinstance(style, str):
            return super().read_style(style)
        styles = self.pairs.library.styles
        if style not in styles:
            raise MotionKitError(
                f"linear: library {self.pairs.library.name!r} has no style {style!r}; it has {', '.join(styles)}. Or "
                "give a motion: style=mk.load('style.bvh')"
            )
        return style

    def transfer(self, body: Motion, style: Example | str, strength: float, *, labels: Labels, seed: int) -> Motion:
        """The content with what its filters predict: first to neutral where it is styled, then to the style.

        With a label that the library has, the filter is learned from its clips, else from the given clip and its pair.
        """
        example = Example(body, Labels(style=style)) if isinstance(style, str) else style
        own_style = labels.style or NEUTRAL[0]
        result = body
        if own_style not in NEUTRAL:
            result = self._filter(body, Labels(labels.content, own_style), True, body).apply(result, strength)
        if example.labels.style not in NEUTRAL:
            result = self._filter(example.motion, example.labels, False, body).apply(result, strength)
        return match_root_speed(result, body)

    def _filter(self, clip: Motion, labels: Labels, back: bool, body: Motion) -> Filter:
        """From a label's clips in the library, or from the clip itself where the library has none."""
        if labels.style in self.pairs.library.styles:
            key = (labels.style, body.skeleton.names, body.skeleton.parents)
            pairs = self._filters.get(key, lambda: self._pairs_of(labels.style, body))
        else:
            clip = clip.resample(body.fps)
            key = (motion_hash(clip), labels.content or None)
            pairs = [self.pairs.pair(clip, labels.content or None)]
        alike = same_rest(pairs[0].styled.skeleton, body.skeleton)  # then it serves bodies of all sizes
        key = (*key, back, None if alike else rest_key(body.skeleton))
        return self._filters.get(
            key, lambda: Filter.learned([p.like(body) for p in pairs], self.dims, self.ridge, back=back)
        )

    def _pairs_of(self, label: str, body: Motion) -> list[Pair]:
        """Pairs of the first takes of each content in a style, of bodies of the content's kind if there are such."""
        found: dict[str, list[int]] = {}
        library = self.pairs.library
        for number in library.indices:
            if library.labels[number].style == label:
                found.setdefault(library.labels[number].content, []).append(number)
        chosen = [(self.pairs.clip(n), content) for content, ns in found.items() for n in ns[: self.takes]]
        alike = [(clip, content) for clip, content in chosen if clip.skeleton.same_tree(body.skeleton)]
        return [self.pairs.pair(clip, content) for clip, content in alike or chosen]
