"""Dynamic time warping: which moment of one clip is which moment of another.

>>> import motionkit as mk
>>> walk = mk.load("data/actor/walk_neutral.bvh")
>>> t = torch.linspace(0, 1, 120)
>>> uneven = 119 * (t + 0.08 * torch.sin(2 * torch.pi * t))  # first faster, then slower
>>> bool((align(walk.sample(uneven), walk) - uneven).abs().max() < 1)
True
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from . import rotations as rot
from .errors import MotionKitError, motion_inside
from .motion import Motion, facing_of

_PACE = 0.15  # seconds in which a speed counts as much as a place
_STEP_PENALTY = 0.1  # of the mean cost, for each frame in which one clip stands still and the other goes on
EVEN = 0.06  # seconds: standard deviation of the Gaussian that evens out how fast a warped clip runs


def dtw(costs: Tensor, *, step_penalty: float = 0.0, segment: bool = False) -> Tensor:
    """The cheapest path through a matrix of costs, by dynamic programming (as in Rabiner and Juang 1993).

    costs: [F, G], finite: how unlike frame i of one clip is to frame j of the other. The path steps on in one clip, in
    the other or in both. step_penalty: added for each step in which one of them stands still, so that a clip is
    stretched only where that pays. segment: the path may begin and end at any frame of the second clip, so that the
    best piece of it is found. Returns pairs [P, 2], long, none of them going back, from (0, 0) to (F - 1, G - 1).
    Raises MotionKitError for costs that are no matrix or not finite.

    >>> dtw(torch.tensor([[0.0, 1.0, 9.0], [9.0, 0.0, 0.0]])).tolist()
    [[0, 0], [1, 1], [1, 2]]
    """
    batch = _checked(torch.as_tensor(costs)[None], "[F, G]")
    totals = np.stack([d[0] for d in _diagonals(batch, step_penalty, segment)])
    return torch.from_numpy(_traced(totals, batch.shape[2], step_penalty, segment))


def dtw_costs(
    costs: Tensor, lengths: Tensor | None = None, *, step_penalty: float = 0.0, segment: bool = False
) -> Tensor:
    """What the cheapest path costs in each of N matrices, [N]: the sum over its pairs and step penalties (see `dtw`).

    costs: [N, F, G]. lengths: how many columns of each count, [N]; all if left out. All are searched at once, so that
    a search over thirty clips takes little longer than one alignment.

    >>> dtw_costs(torch.tensor([[[0.0, 1.0], [1.0, 0.0]], [[2.0, 2.0], [2.0, 3.0]]]))
    tensor([0., 5.])
    """
    batch = _checked(costs, "[N, F, G]")
    count, rows, columns = batch.shape
    ends = np.full(count, columns) if lengths is None else np.asarray(lengths)
    if ends.shape != (count,) or ends.min() < 1 or ends.max() > columns:
        raise MotionKitError(f"DTW: expected {count} lengths from 1 to {columns}; found {ends.tolist()}")
    last = np.stack(
        [d[:, -1].copy() for d in _diagonals(batch, step_penalty, segment)][rows - 1 :], 1
    )  # [N, G]: last rows
    if segment:
        return torch.from_numpy(np.where(np.arange(columns) < ends[:, None], last, np.inf).min(1))
    return torch.from_numpy(last[np.arange(count), ends - 1])


def _checked(costs: Tensor, shape: str) -> np.ndarray:
    batch = costs.detach().cpu().float().numpy()
    if batch.ndim != 3 or not batch.size:
        sizes = list(costs.shape[1:] if shape == "[F, G]" else costs.shape)
        raise MotionKitError(f"DTW: expected costs {shape}, one for each pair of frames; found shape {sizes}")
    if not np.isfinite(batch).all():
        raise MotionKitError("DTW: some costs are not finite; look at the features that they were made of")
    return batch


def _diagonals(batch: np.ndarray, step_penalty: float, segment: bool) -> Iterator[np.ndarray]:
    """Accumulated costs, one anti-diagonal after the other: the d-th is [N, F], its entry i that of cell (i, d - i).

    The cells of an anti-diagonal need only the two before it, so that numpy takes each as one step.
    """
    count, rows, columns = batch.shape
    wide = np.full((count, rows, columns + rows), np.inf, np.float32)
    wide[:, :, :columns] = batch
    skewed = wide.reshape(count, -1)[:, : rows * (columns + rows - 1)].reshape(count, rows, -1)
    skewed = np.ascontiguousarray(skewed.transpose(2, 0, 1))  # row i moved right by i: [F + G - 1, N, F]
    older = before = np.full((count, rows), np.inf, np.float32)
    for d, here in enumerate(skewed):
        now = before + step_penalty  # from (i, j - 1): the first clip stands still
        np.minimum(now[:, 1:], before[:, :-1] + step_penalty, out=now[:, 1:])  # from (i - 1, j): the second does
        np.minimum(now[:, 1:], older[:, :-1], out=now[:, 1:])  # from (i - 1, j - 1)
        if d == 0 or segment:
            now[:, 0] = 0.0  # a path begins here
        now += here
        older, before = before, now
        yield now


def _traced(totals: np.ndarray, columns: int, step_penalty: float, segment: bool) -> np.ndarray:
    """The path [P, 2], from its end back through the cells from which each was reached. totals: [F + G - 1, F]."""
    rows = totals.shape[1]
    i, j = rows - 1, columns - 1
    if segment:
        j = int(totals[rows - 1 :, rows - 1].argmin())
    path = [(i, j)]
    while i > 0 or (j > 0 and not segment):
        both = totals[i + j - 2, i - 1] if i > 0 and j > 0 else np.inf
        first = totals[i + j - 1, i - 1] + step_penalty if i > 0 else np.inf
        second = totals[i + j - 1, i] + step_penalty if j > 0 and (i > 0 or not segment) else np.inf
        if both <= min(first, second):
            i, j = i - 1, j - 1
        elif first <= second:
            i -= 1
        else:
            j -= 1
        path.append((i, j))
    return np.array(path[::-1], dtype=np.int64)


def warp(path: Tensor, even: float = 0.0) -> Tensor:
    """For each frame of the first clip the frame of the second that goes with it: fractional numbers [F].

    path: pairs [P, 2] of `dtw`. Where several go with one frame, it is their mean. even: standard deviation in frames
    of a Gaussian over the result, so that the second clip does not stop and start; it never runs backwards either way.
    `motion.sample(warp(path))` is the second clip in the time of the first.

    >>> warp(torch.tensor([[0, 0], [1, 1], [1, 2], [2, 3]]))
    tensor([0.0000, 1.5000, 3.0000])
    """
    counts = torch.bincount(path[:, 0])
    frames = torch.bincount(path[:, 0], weights=path[:, 1].double()) / counts
    return gaussian_smooth(frames[:, None], even)[:, 0].float()


def gaussian_smooth(curves: Tensor, sigma: float) -> Tensor:
    """Curves [F, C] under a Gaussian of `sigma` frames; a straight line stays one, to its ends.

    >>> gaussian_smooth(torch.arange(4.0)[:, None], 2.0)[:, 0].round(decimals=4).abs()
    tensor([0., 1., 2., 3.])
    """
    radius = min(int(3 * sigma + 0.5), len(curves) - 1)
    if radius < 1:
        return curves
    weights = torch.exp(-0.5 * (torch.arange(-radius, radius + 1, dtype=curves.dtype) / sigma) ** 2)
    before = 2 * curves[:1] - curves[1 : radius + 1].flip(0)  # reflected through the end point
    after = 2 * curves[-1:] - curves[-radius - 1 : -1].flip(0)
    padded = torch.cat((before, curves, after)).T[:, None]
    return torch.nn.functional.conv1d(padded, (weights / weights.sum())[None, None])[:, 0].T


def pose_velocity_features(motion: Motion, *, centred: bool = True) -> Tensor:
    """What frames are compared by, [F, 6J]: places and speeds of joints seen from the body, in shares of its height.

    centred: for alignment, each place is taken from its mean over the clip and all is scaled to mean square 1, since
    how somebody holds himself, and how large he moves, says nothing about when he does what.

    >>> import motionkit as mk
    >>> pose_velocity_features(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 132])
    """
    places = motion.positions()
    back = rot.yaw_to_quaternion(-facing_of(motion.skeleton, places, motion.world_rotations()))[:, None]
    root = places[:, motion.skeleton.pelvis] * places.new_tensor([1.0, 0.0, 1.0])
    pose = rot.quaternion_rotate(back, places - root[:, None]).flatten(1) / max(motion.skeleton.height, 1e-6)
    speed = torch.gradient(pose, dim=0)[0] if len(pose) > 1 else torch.zeros_like(pose)
    features = torch.cat((pose - pose.mean(0) if centred else pose, speed * (_PACE * motion.fps)), 1)
    return features / features.square().mean().sqrt().clamp(min=1e-4) if centred else features


def step_penalty_for(costs: Tensor) -> float:
    """What it is to cost to stand still for a frame, for `dtw`: a share of the mean of these costs.

    >>> round(step_penalty_for(torch.ones(3, 4)), 3)
    0.1
    """
    return _STEP_PENALTY * float(costs.mean())


def align(reference: Motion, other: Motion, *, segment: bool = False) -> Tensor:
    """For each frame of the reference the frame of another clip in which the same is done: fractional numbers [F].

    Both on one skeleton tree and at one frame rate. segment: the other clip holds more than the reference; the best
    piece of it is taken. `other.sample(align(reference, other))` is the other in the reference's time. Raises
    MotionKitError where the two cannot be compared.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> align(walk[20:60], walk, segment=True)[:4].round()
    tensor([20., 21., 22., 23.])
    """
    for motion in (reference, other):
        if not isinstance(motion, Motion):
            raise MotionKitError(f"align: expected two motions; found {motion!r}{motion_inside(motion)}")
    if not reference.skeleton.same_tree(other.skeleton) or abs(reference.fps - other.fps) > 1e-3:
        raise MotionKitError(
            f"align: {reference!r} and {other!r} differ in joints or frame rate; bring the other one to the first with "
            "mk.retarget and Motion.resample"
        )
    costs = torch.cdist(pose_velocity_features(reference), pose_velocity_features(other))
    return warp(dtw(costs, step_penalty=step_penalty_for(costs), segment=segment), EVEN * reference.fps)
