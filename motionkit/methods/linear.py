"""Linear style translation: one filter from neutral poses to styled ones, in the manner of Hsu, Pulli, Popovic 2005."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .. import rotations as rot
from ..alignment import smoothed
from ..datasets import Dataset
from ..errors import MotionKitError
from ..motion import Motion
from ..pairs import NEUTRAL, ByLabels, NeutralPairs, Pair, add_difference
from ..restyling import Memory, body_of, check_clips, in_step, key_of, named, on_the_ground, rest_key, same_rest

_TAPS = (-1 / 3, -1 / 6, 0.0, 1 / 6, 1 / 3)  # seconds from the frame that is predicted
_MEAN = 1500  # so many frames weigh for the mean difference alone: one clip's poses say little about others
_EASE = 0.03  # seconds: standard deviation of the Gaussian over what is predicted


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
    def learned(cls, pairs: list[Pair], back: bool, dims: int, ridge: float) -> Filter:
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
        return add_difference(motion, strength * smoothed(change, _EASE * motion.fps))


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


class Linear(ByLabels):
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
    >>> from motionkit.datasets import BvhSource, Item, Labels, of_items
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> step = Item("walk", Labels("walk", "neutral", ()), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> mk.methods.load("linear", library=of_items("mine", [step])).stylize(walk, style=style)
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
        self.pairs, self._filters = NeutralPairs(train), Memory(128)
        return self

    def stylize(
        self,
        content: Motion,
        style: Motion | str,
        strength: float = 1.0,
        lock: bool = True,
        *,
        content_label: str | None = None,
        content_style: str | None = None,
        style_content: str | None = None,
        style_label: str | None = None,
    ) -> Motion:
        """The content clip in the manner of a style.

        content: F frames. style: a label of the library, or a Motion; with a label or `style_label` that the library
        has, the filter is learned from its clips, else from the given clip and its pair. strength: 0 keeps the content,
        1 is the style, more exaggerates. lock: hold standing feet still. content_label, style_content: what is done in
        each clip, for the search of pairs. content_style: the content's own style; left out, it counts as neutral.
        Returns F frames at the content's rate, on its skeleton, starting where it starts. Raises MotionKitError for
        arguments that are none of these.
        """
        if isinstance(style, str):
            style_label = self._known(style)
        check_clips(self.name, content, content if isinstance(style, str) else style, strength)
        if strength == 0:
            return content.replace(name=named(content, style))
        given = body_of(content)
        body = given
        for clip, said, label, back in (
            (content, content_label, content_style or NEUTRAL[0], True),
            (style, style_content, style_label, False),
        ):
            if label not in NEUTRAL:
                body = self._filter(clip, said, label, back, given).apply(body, strength)
        body = in_step(body, given)
        if lock:
            body = on_the_ground(body, given)
        return content.with_body(body).replace(name=named(content, style))

    def _known(self, style: str) -> str:
        styles = self.pairs.library.styles
        if style not in styles:
            raise MotionKitError(
                f"linear: library {self.pairs.library.name!r} has no style {style!r}; it has {', '.join(styles)}. Or "
                "give a motion: style=mk.load('style.bvh')"
            )
        return style

    def _filter(self, clip: Motion | str, content: str | None, label: str | None, back: bool, body: Motion) -> Filter:
        """From a label's clips in the library, or from the clip itself where it has none."""
        if label in self.pairs.library.styles:
            key = (label, body.skeleton.names, body.skeleton.parents)
            pairs = self._filters.get(key, lambda: self._pairs_of(label, body))
        else:
            clip = clip.resample(body.fps)
            key = (key_of(clip), content)
            pairs = [self.pairs.pair(clip, content)]
        alike = same_rest(pairs[0].styled.skeleton, body.skeleton)  # then it serves bodies of all sizes
        key = (*key, back, None if alike else rest_key(body.skeleton))
        return self._filters.get(
            key, lambda: Filter.learned([p.like(body) for p in pairs], back, self.dims, self.ridge)
        )

    def _pairs_of(self, label: str, body: Motion) -> list[Pair]:
        """Pairs of the first takes of each content in a style, of bodies of the content's kind if there are such."""
        found: dict[str, list[int]] = {}
        library = self.pairs.library
        for number in library.numbers:
            if library.labels[number].style == label:
                found.setdefault(library.labels[number].content, []).append(number)
        chosen = [(self.pairs.clip(n), content) for content, ns in found.items() for n in ns[: self.takes]]
        alike = [(clip, content) for clip, content in chosen if clip.skeleton.same_tree(body.skeleton)]
        return [self.pairs.pair(clip, content) for clip, content in alike or chosen]
