"""What the networks here see of a motion: paper 1's facing-free features, normalised part by part."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ..datasets import Dataset, Encoded
from ..features import FacingFree, Normalizer
from ..motion import Motion
from ..ordering import in_order
from ..skeleton import Skeleton

LEAST = 0.25  # of a part's spread: numbers that hardly move are not blown up to the size of others
ROOT = 3.0  # how much larger the root's four numbers are made: all else follows from where the body goes


class OfBody(FacingFree):
    """Facing-free features of the body alone: helper joints above the pelvis, whose place means little, are left out.

    >>> import motionkit as mk
    >>> OfBody().encode(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 199])
    """

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames, its joints in any order, to features [F, D]; MotionKitError as in `FacingFree`."""
        body = motion.body()
        return super().encode(body if self._skeleton is None else in_order(body, self._skeleton))


def fitted(data: Dataset) -> tuple[Encoded, Normalizer]:
    """A dataset's clips in facing-free features of the body, and the normalizer for them.

    Spreads are those of the numbers, but at least a quarter of the root mean square of their part (root velocity,
    height, positions, rotations); the root's four numbers weigh three times as much, since the loss counts numbers.
    """
    layout = OfBody()
    encoded = Encoded(data, layout)
    rows = [torch.from_numpy(encoded.rows(n, 0, int(data.store.frames[n]))) for n in data.numbers]
    found = Normalizer.fit(rows, "FacingFree")
    std = torch.cat(rows).std(0, correction=0)
    parts = {**layout.slices, "turn": slice(0, 1), "speed": slice(1, 3), "height": slice(3, 4)}
    for name, part in parts.items():
        if name != "root":
            std[part] = torch.maximum(std[part], LEAST * std[part].square().mean().sqrt())
    std[layout.slices["root"]] /= ROOT
    return encoded, Normalizer(found.mean, std.clamp(min=1e-5), found.layout, found.data_hash)


def encoded(motion: Motion, layout: OfBody, normalizer: Normalizer) -> Tensor:
    """A motion of F frames, its joints in any order and at any frame rate, to normalised features [F, D].

    Raises MotionKitError for another skeleton.
    """
    motion = motion if abs(motion.fps - layout.fps) < 1e-3 else motion.resample(layout.fps)
    return normalizer.normalize(layout.encode(motion).float())


def of_size(layout: FacingFree, x: Tensor) -> Skeleton:
    """The layout's skeleton, as large as the body whose joints' positions are among the features [F, D]."""
    skeleton, places = layout.skeleton, layout.positions(x)
    above_pelvis = skeleton.chain(skeleton.pelvis)  # helper joints, which may be anywhere
    below = [j for j in range(len(skeleton)) if j not in above_pelvis and skeleton.offsets[j].norm() > 0]
    above = [skeleton.parents[joint] for joint in below]
    lengths = (places[:, below] - places[:, above]).norm(dim=-1).mean(0)
    ratio = float(lengths.sum() / skeleton.offsets[below].norm(dim=-1).sum())
    ends = tuple((joint, tuple(ratio * n for n in place)) for joint, place in skeleton.end_sites)
    return replace(skeleton, offsets=skeleton.offsets * ratio, end_sites=ends)
