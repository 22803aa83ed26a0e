"""How good a result is, in numbers that say what they measure; each has cases with a known answer in its test.

A wrong type, an empty clip or a number that is not finite is an error and never a score.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from . import rotations as rot
from .contacts import foot_contacts, foot_sliding
from .errors import MotionKitError, motion_inside
from .motion import Motion, facing_of
from .text import similarity

# Checks


def _motion(where: str, motion: object, frames: int = 1) -> Motion:
    """The argument, if it is a Motion with so many frames at least."""
    if isinstance(motion, str | Path):
        raise MotionKitError(f"{where}: expected a Motion; found {str(motion)!r}; load it with mk.load")
    if not isinstance(motion, Motion):
        hint = motion_inside(motion)
        raise MotionKitError(f"{where}: expected a Motion; found a {type(motion).__name__}{hint}")
    if len(motion) < frames:
        least = {1: "one is", 2: "two are", 4: "four are"}[frames]
        raise MotionKitError(f"{where}: {motion!r} has {len(motion)} frames; {least} the least")
    return motion


def _tensor(where: str, expected: str, tensor: object) -> Tensor:
    """The argument, if it is a tensor; expected: what it should hold, such as "scores [N, C]"."""
    if not isinstance(tensor, Tensor):
        hint = "; use torch.as_tensor(...)" if hasattr(tensor, "__len__") and not isinstance(tensor, str) else ""
        raise MotionKitError(f"{where}: expected {expected} as a torch tensor; found a {type(tensor).__name__}{hint}")
    return tensor


def _finite(where: str, what: str, rows: Tensor) -> Tensor:
    """The argument, if all its rows are finite."""
    broken = len(rows) - int(finite_rows(rows).sum())
    if broken:
        raise MotionKitError(f"{where}: {broken} of {len(rows)} rows of {what} are not finite; find those motions")
    return rows


# Fréchet distances


def fmd(
    a: Tensor | Sequence[Motion],
    b: Tensor | Sequence[Motion],
    encoder: Callable[[list[Motion]], Tensor] | object | None = None,
    *,
    shrinkage: float | None = None,
) -> float:
    """Fréchet distance between the Gaussians of two sets of features (paper 1, section 5.2; Heusel et al. 2017).

    a: [N, D], b: [M, D], one row a motion, such as a classifier's last pooling layer; no unit. Or two sequences of
    motions, with an `encoder` that turns each into a row: a judge's classifier (paper 1, paper 3, paper 4), its
    denoising autoencoder (paper 2, supplement A), anything with `.features(motions) -> [N, D]`, or such a function.

    The result is |mean_a - mean_b|^2 + trace(A + B - 2 (A B)^(1/2)), 0 for equal Gaussians. A covariance needs more
    rows than columns: with fewer, a MotionKitError says how many, unless `shrinkage` (0 to 1) mixes that share of a
    round covariance into both, which makes numbers comparable only with numbers of the same shrinkage. Numbers that are
    not finite are an error that counts the rows: they are never averaged away.

    >>> cloud = torch.randn(500, 4, generator=torch.Generator().manual_seed(0))
    >>> fmd(cloud, cloud) < 1e-6, round(fmd(cloud, cloud + 2.0), 6)
    (True, 16.0)
    """
    mean_a, cov_a = gaussian(_features(a, "a", encoder), "a", shrinkage)
    mean_b, cov_b = gaussian(_features(b, "b", encoder), "b", shrinkage)
    if len(mean_a) != len(mean_b):
        raise MotionKitError(f"fmd: features of {len(mean_a)} and of {len(mean_b)} numbers; use one encoder for both")
    values, vectors = torch.linalg.eigh(cov_a)
    root = (vectors * values.clamp(min=0).sqrt()) @ vectors.T
    inner = torch.linalg.eigvalsh(root @ cov_b @ root).clamp(min=0)
    distance = ((mean_a - mean_b) ** 2).sum() + cov_a.trace() + cov_b.trace() - 2 * inner.sqrt().sum()
    return max(float(distance), 0.0)


def content_fmd(
    results: Sequence[Motion], contents: Sequence[Motion], judge: object, *, shrinkage: float | None = None
) -> float:
    """FMD of results to the motions whose content they keep, seen by a judge's content classifier (paper 5, section 4).

    Paper 5 takes the features of its own trained style encoder; here they are those of `judge.content`. results and
    contents need not be of one length or order. Errors as in `fmd`. Smaller is better, 0 for the contents themselves.

    >>> from types import SimpleNamespace
    >>> from motionkit import actor
    >>> clips = [actor.perform("walk", seed=n, seconds=1).motion for n in range(4)]
    >>> heights = lambda motions: torch.stack([m.positions()[..., 1].mean().view(1) for m in motions])
    >>> content_fmd(clips, clips[::-1], SimpleNamespace(content=heights, style=heights)) < 1e-9
    True
    """
    return fmd(results, contents, _classifier(judge, "content"), shrinkage=shrinkage)


def style_fmd(
    results: Sequence[Motion], styles: Sequence[Motion], judge: object, *, shrinkage: float | None = None
) -> float:
    """FMD of results to motions in the style they should have, seen by a judge's style classifier (paper 5, section 4).

    As `content_fmd`, with the features of `judge.style`.

    >>> from types import SimpleNamespace
    >>> from motionkit import actor
    >>> old, proud = ([actor.perform("walk", s, seed=n, seconds=1).motion for n in range(4)] for s in ("old", "proud"))
    >>> heights = lambda motions: torch.stack([100 * m.positions()[..., 1].mean().view(1) for m in motions])
    >>> judge = SimpleNamespace(content=heights, style=heights)
    >>> style_fmd(old, old, judge) < 1e-9, style_fmd(old, proud, judge) > 1
    (True, True)
    """
    return fmd(results, styles, _classifier(judge, "style"), shrinkage=shrinkage)


def gaussian(features: Tensor, name: str = "features", shrinkage: float | None = None) -> tuple[Tensor, Tensor]:
    """Mean [D] and covariance [D, D] of features [N, D], float64; errors and shrinkage as in `fmd`.

    >>> mean, cov = gaussian(torch.tensor([[0.0, 0], [2, 0], [0, 2], [2, 2]]))
    >>> mean, cov.diag()
    (tensor([1., 1.], dtype=torch.float64), tensor([1.3333, 1.3333], dtype=torch.float64))
    """
    if features.ndim != 2 or not features.shape[1]:
        raise MotionKitError(f"fmd: expected {name} [N, D], one row a motion; found {list(features.shape)}")
    _finite("fmd", name, features)
    count, size = features.shape
    if shrinkage is not None and not (isinstance(shrinkage, int | float) and 0 < shrinkage <= 1):
        raise MotionKitError(f"fmd: shrinkage is a share above 0, at most 1; found {shrinkage!r}")
    if count < 2 or (count <= size and shrinkage is None):
        raise MotionKitError(
            f"fmd: {name} has {count} rows of {size} numbers; a covariance needs at least {size + 1} rows. Measure "
            "more motions, use features with fewer numbers, or say shrinkage=0.1 and report it"
        )
    x = features.detach().cpu().double()
    mean = x.mean(0)
    cov = (x - mean).T @ (x - mean) / (count - 1)
    if shrinkage is not None:
        cov = (1 - shrinkage) * cov + shrinkage * cov.trace() / size * torch.eye(size, dtype=cov.dtype)
    return mean, cov


def _features(data: Tensor | Iterable[Motion], name: str, encoder: object) -> Tensor:
    """Rows [N, D]: those that came, or the encoder's of the motions that came."""
    if isinstance(data, Tensor):
        if encoder is not None:
            raise MotionKitError(f"fmd: {name} holds features, and an encoder takes motions; leave one of the two out")
        return data
    if isinstance(data, Motion | str) or not isinstance(data, Iterable):
        raise MotionKitError(
            f"fmd: expected {name} as features [N, D] or as a list of Motions; found a {type(data).__name__}. "
            "The distance is between two sets of motions, not between two clips"
        )
    motions = [_motion(f"fmd: {name}[{n}]", motion) for n, motion in enumerate(data)]
    if encoder is None:
        raise MotionKitError(
            f"fmd: {name} holds motions, which are compared by what an encoder sees in them; say which: "
            'encoder=mk.judges.load("actor").content'
        )
    encode = getattr(encoder, "features", encoder)
    if not callable(encode):
        hint = "; a judge has several: give its .content" if hasattr(encoder, "content") else ""
        raise MotionKitError(
            f"fmd: an encoder has .features(motions) or is a function; found a {type(encoder).__name__}{hint}"
        )
    rows = _tensor("fmd", f"the encoder's features of {name}", encode(motions)) if motions else torch.empty(0, 1)
    if rows.ndim != 2 or len(rows) != len(motions):
        raise MotionKitError(
            f"fmd: the encoder gives {list(rows.shape)} for the {len(motions)} motions of {name}; expected one row each"
        )
    return rows


def _classifier(judge: object, label: str) -> object:
    """A judge's content or style classifier."""
    classifier = getattr(judge, label, None)
    if classifier is None or isinstance(judge, Motion):
        raise MotionKitError(
            f'{label} FMD: expected a judge with a .{label} classifier, such as mk.judges.load("actor"); '
            f"found a {type(judge).__name__}"
        )
    return classifier


# Recognition


def recognition_accuracy(scores: Tensor, labels: Tensor) -> float:
    """Per cent of motions a classifier names right: CRA, SRA (paper 1, section 5.2; paper 4, section 4.2; paper 3).

    scores: [N, C] of a classifier, one column a class. labels: [N] class numbers: of the content clip for the Content
    Recognition Accuracy, of the style for the Style Recognition Accuracy. A row of scores that is not finite counts as
    wrong, never as missing. Raises MotionKitError where they do not fit.

    >>> recognition_accuracy(torch.tensor([[0.9, 0.1], [0.2, 0.8], [0.6, 0.4], [0.5, 0.4]]), torch.tensor([0, 1, 1, 0]))
    75.0
    """
    _tensor("recognition accuracy", "scores [N, C]", scores)
    _tensor("recognition accuracy", "labels [N]", labels)
    if scores.ndim != 2 or labels.shape != scores.shape[:1] or not len(scores):
        raise MotionKitError(
            f"recognition accuracy: expected scores [N, C] and labels [N]; found {list(scores.shape)} and "
            f"{list(labels.shape)}"
        )
    if labels.is_floating_point() or labels.dtype == torch.bool:
        raise MotionKitError(
            f"recognition accuracy: labels are class numbers, whole ones; found {labels.dtype}. A classifier's "
            "ids(labels) turns names into them"
        )
    if int(labels.min()) < 0 or int(labels.max()) >= scores.shape[1]:
        raise MotionKitError(
            f"recognition accuracy: labels go from {int(labels.min())} to {int(labels.max())}, the classifier knows "
            f"{scores.shape[1]} classes: it was trained for other labels"
        )
    correct = (scores.argmax(1) == labels) & torch.isfinite(scores).all(1)
    return 100 * float(correct.double().mean())


def repeated_accuracy(scores: Sequence[Tensor], labels: Tensor | Sequence[Tensor]) -> Spread:
    """Recognition accuracy in per cent, mean and spread over repeats of an experiment (paper 3, table 2).

    scores: for each of R repeats [N, C], as for `recognition_accuracy`; N may differ. labels: [N] if all repeats share
    them, else one such tensor a repeat. Paper 3 does not say what it repeats; say it where you report the figure.

    >>> print(repeated_accuracy([torch.eye(4), torch.eye(4).roll(1, 0), torch.eye(4)], torch.arange(4)))
    66.67±57.74
    """
    for values in (scores, labels):
        if not isinstance(values, list | tuple | Tensor) or (isinstance(values, Tensor) and not values.ndim):
            raise MotionKitError(
                f"repeated accuracy: expected scores and labels of each repeat in a list; found {type(values).__name__}"
            )
    scores = list(scores)
    labels = [labels] * len(scores) if isinstance(labels, Tensor) and labels.ndim == 1 else list(labels)
    if len(labels) != len(scores):
        raise MotionKitError(f"repeated accuracy: {len(scores)} repeats of scores, {len(labels)} of labels")
    return spread([recognition_accuracy(*repeat) for repeat in zip(scores, labels)])


def confusion(scores: Tensor, labels: Tensor) -> Tensor:
    """How often a motion of class i is taken for class j: counts [C, C], rows the truth.

    A row of scores that is not finite is taken for nothing, so it is missing from its class's sum and `finite_share`
    counts it.

    >>> confusion(torch.tensor([[0.9, 0.1], [0.2, 0.8], [0.6, 0.4]]), torch.tensor([0, 1, 1]))
    tensor([[1, 0],
            [1, 1]])
    """
    recognition_accuracy(scores, labels)  # checks both
    known = torch.isfinite(scores).all(1)
    classes = scores.shape[1]
    cells = labels[known] * classes + scores[known].argmax(1)
    return torch.bincount(cells, minlength=classes**2).reshape(classes, classes)


# Paths and feet


def trajectory_similarity(result: Motion, content: Motion) -> float:
    """Trajectory Similarity Index (paper 4, section 4.2): metres between both paths over the ground, mean over frames.

    Both start at the origin facing +Z, as paper 4's data do; smaller is more alike. Raises MotionKitError where the
    numbers of frames differ: bring a result with a timing of its own to the content's frames first (`Motion.sample`).

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> trajectory_similarity(walk.transform(1.0, (3.0, 0.0, 1.0)), walk) < 1e-5
    True
    """
    for motion in (result, content):
        _motion("trajectory similarity", motion)
    if len(result) != len(content):
        raise MotionKitError(
            f"trajectory similarity: the result has {len(result)} frames and the content {len(content)}; compare "
            "frames of the same moments, as result.sample(times) gives them"
        )
    paths = [motion.at_origin().root_path() for motion in (result, content)]
    return float(torch.linalg.vector_norm(paths[0] - paths[1], dim=-1).mean())


def foot_sliding_factor(result: Motion, contacts: Tensor | None = None) -> float:
    """Foot Sliding Factor (paper 4, section 4.2): millimetres a frame that feet slide while they touch the ground.

    The paper's text leaves open how it is summed (its supplement is not at hand); here it is `contacts.foot_sliding`.
    contacts: bool [F, K], those of the content where they should stay; left out, the result's own. A body that floats
    never stands and scores 0, so read it beside `foot_contact_accuracy`. Raises MotionKitError for fewer than two
    frames or contacts that do not fit.

    >>> import motionkit as mk
    >>> foot_sliding_factor(mk.load("data/actor/walk_neutral.bvh")) < 1.0
    True
    """
    _motion("foot sliding factor", result, frames=2)
    if contacts is not None:
        _tensor("foot sliding factor", "contacts [F, K]", contacts)
    return foot_sliding(result, contacts)


def foot_contact_accuracy(result: Motion, contacts: Tensor) -> float:
    """Foot Contact Accuracy (paper 1, section 6.1): per cent of frames and feet in which standing or not agrees.

    contacts: bool [F, K] of the motion that it should agree with, from `foot_contacts` or exact. Raises MotionKitError
    where the shapes do not fit.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> foot_contact_accuracy(walk, foot_contacts(walk))
    100.0
    """
    standing = foot_contacts(_motion("foot contact accuracy", result))
    _tensor("foot contact accuracy", "contacts [F, K]", contacts)
    if standing.shape != contacts.shape:
        raise MotionKitError(
            f"foot contact accuracy: contacts {list(contacts.shape)} for a result whose feet give "
            f"{list(standing.shape)}; compare motions of one length on one skeleton"
        )
    return 100 * float((standing == contacts.bool()).double().mean())


# The exact answer


def truth_error(
    result: Motion, truth: object, content: object, *, beats: Tensor | None = None, world: bool = False
) -> Tensor:
    """How far a style transfer's result is from the exact answer: mm for each joint [J], the mean over frames.

    truth, content: of the performer, `actor.retell(content, style)` and `actor.perform`; result: what a method made of
    `content.motion`. Frame by frame they are compared at
    the same beat of the score. A method that keeps the content's timing needs no more; one with a timing of its own
    says with `beats` [F] at which beat each of its frames is. Each pose is seen from its own place on the ground and
    facing; world: compare places in the world instead. Joints are matched by name, in the truth's order.

    Raises MotionKitError if the two do not tell one score, frames and beats do not fit, or a joint is missing.

    >>> from motionkit import actor
    >>> walk = actor.perform("walk", seed=1, seconds=4)
    >>> old = actor.retell(walk, "old")
    >>> aligned = old.time_aligned(walk)
    >>> float(truth_error(aligned, old, walk).max()), bool(truth_error(walk.motion, old, walk).mean() > 50)
    (0.0, True)
    """
    for what, value, kind in (
        ("result", result, "Motion"),
        ("truth", truth, "Performance"),
        ("content", content, "Performance"),
    ):
        if not (isinstance(value, Motion) if kind == "Motion" else hasattr(value, "frames_at")):
            hint = motion_inside(value) if kind == "Motion" else ""
            raise MotionKitError(f"truth_error: {what} must be a {kind}; found {value!r}{hint}")
    if truth.score is not content.score:
        raise MotionKitError(
            f"truth_error: {truth!r} is no retelling of {content!r}; make it with actor.retell(content, style)"
        )
    times = content.beats if beats is None else torch.as_tensor(beats)
    if times.shape != (len(result),):
        raise MotionKitError(
            f"truth_error: the result has {len(result)} frames and {len(times)} are known by their beats; a method "
            "with a timing of its own gives beats= [F]"
        )
    answer = truth.motion.sample(truth.frames_at(times))
    order = [result.skeleton.index(name) for name in answer.skeleton.names]
    positions = [result.positions()[:, order], answer.positions()]
    if not world:
        positions = [canonical_positions(answer, joints) for joints in positions]
    return torch.linalg.vector_norm(positions[0] - positions[1], dim=-1).mean(0) * 1000


def canonical_positions(like: Motion, positions: Tensor) -> Tensor:
    """Positions [F, J, 3] of `like`'s joints as seen from the pelvis' place on the ground, facing +Z."""
    yaw = facing_of(like.skeleton, positions)
    pelvis = positions[:, like.skeleton.pelvis] * positions.new_tensor([1.0, 0.0, 1.0])
    back = rot.yaw_to_quaternion(-yaw)[:, None]
    return rot.quaternion_rotate(back, positions - pelvis[:, None])


# Diversity


def local_diversity(result: Tensor, source: Tensor, length: int = 15) -> float:
    """How far each short window of a motion is from the source's nearest: 0 for a copy (paper 5, section 4: Loc-D).

    result: [F, D], source: [G, D], features of frames on one scale, such as normalised rotations. length: frames of a
    window. The distance of two windows is the root of the mean square over their numbers; the mean over all windows of
    the result is returned, in the features' unit. Raises MotionKitError for motions shorter than a window.

    >>> clip = torch.randn(60, 8, generator=torch.Generator().manual_seed(0))
    >>> local_diversity(clip[10:40], clip), local_diversity(clip + 1, clip) > 0.5
    (0.0, True)
    """
    diagonal = _diagonal_sums(_frame_costs(result, source, length))
    sums = diagonal[length:, length:] - diagonal[:-length, :-length]  # [F - length + 1, G - length + 1]
    return float((sums.amin(1) / length).clamp(min=0).sqrt().mean())


def global_diversity(result: Tensor, source: Tensor, shortest: int = 30) -> float:
    """How far a motion is from the best patchwork of pieces of the source: 0 if it is one (paper 5, section 4: Glo-D).

    result: [F, D], source: [G, D] as for `local_diversity`. Every piece has at least `shortest` frames, in the source's
    order; the best cut is found by dynamic programming. Returns the root of the mean square distance.

    >>> clip = torch.randn(80, 8, generator=torch.Generator().manual_seed(0))
    >>> global_diversity(torch.cat((clip[40:75], clip[:35])), clip)
    0.0
    """
    diagonal = _diagonal_sums(_frame_costs(result, source, shortest))
    frames, source_frames = len(result), len(source)
    best = torch.full((frames + 1,), torch.inf, dtype=diagonal.dtype)
    best[0] = 0
    for stop in range(shortest, frames + 1):
        for start in range(max(0, stop - source_frames), stop - shortest + 1):
            if torch.isfinite(best[start]):
                length = stop - start
                piece = (diagonal[stop, length:] - diagonal[start, : source_frames + 1 - length]).amin()
                best[stop] = torch.minimum(best[stop], best[start] + piece)
    return float((best[frames] / frames).clamp(min=0).sqrt())


def _frame_costs(result: Tensor, source: Tensor, length: int) -> Tensor:
    """Mean square distance of every frame to every frame, [F, G] float64; length: frames that both must have."""
    for name, features in (("result", result), ("source", source)):
        _tensor("diversity", f"features of the {name} [F, D]", features)
    if result.ndim != 2 or source.ndim != 2 or result.shape[1] != source.shape[1]:
        raise MotionKitError(
            f"diversity: expected features [F, D] and [G, D]; found {list(result.shape)} and {list(source.shape)}"
        )
    if not 0 < length <= min(len(result), len(source)):
        raise MotionKitError(
            f"diversity: windows of {length} frames need motions as long; found {len(result)} and {len(source)} frames"
        )
    _finite("diversity", "the result", result)
    _finite("diversity", "the source", source)
    return ((result.double()[:, None] - source.double()) ** 2).mean(-1)


def _diagonal_sums(costs: Tensor) -> Tensor:
    """Sums along the diagonals, [F + 1, G + 1]: entry (i, j) is cost(i-1, j-1) + cost(i-2, j-2) + ..."""
    sums = costs.new_zeros(len(costs) + 1, costs.shape[1] + 1)
    for row in range(len(costs)):
        sums[row + 1, 1:] = sums[row, :-1] + costs[row]
    return sums


# Motion and text


def text_similarity(motions: Tensor, texts: Tensor) -> float:
    """Mean cosine between motions and the sentences that describe them (paper 1, section 6.1, figure 8: CLIP score).

    motions, texts: [N, D], paired, as for `pair_similarities`, which gives the values behind the mean. 1 where every
    motion points where its sentence does, about 0 where they have nothing in common; how far above 0 is good depends on
    the encoders, so compare with shuffled pairs. Paper 1 takes its motion-semantic discriminator and CLIP.

    >>> x = torch.eye(3)
    >>> text_similarity(5 * x, x), text_similarity(x, x.roll(1, 0)), text_similarity(x, -x)
    (1.0, 0.0, -1.0)
    """
    return float(pair_similarities(motions, texts).mean())


def pair_similarities(motions: Tensor, texts: Tensor) -> Tensor:
    """The cosine between each motion's embedding and its own sentence's: [N], from -1 to 1.

    motions, texts: [N, D] from any two encoders into one space, row n of both belonging together. Raises MotionKitError
    for shapes that do not fit, rows that are not finite, and rows of zeros, which point nowhere.

    >>> pair_similarities(torch.tensor([[2.0, 0.0], [1.0, 1.0]]), torch.tensor([[1.0, 0.0], [-3.0, 3.0]]))
    tensor([1., 0.], dtype=torch.float64)
    """
    sides = (("motions", motions), ("texts", texts))
    for name, rows in sides:
        _tensor("text similarity", f"{name} [N, D]", rows)
    if motions.ndim != 2 or motions.shape != texts.shape or not motions.numel():
        raise MotionKitError(
            f"text similarity: expected embeddings [N, D] of motions and of their texts, one pair a row; found "
            f"{list(motions.shape)} and {list(texts.shape)}"
        )
    units = []
    for name, rows in sides:
        x = _finite("text similarity", name, rows).detach().cpu().double()
        length = torch.linalg.vector_norm(x, dim=1, keepdim=True)
        if not (length > 0).all():
            raise MotionKitError(
                f"text similarity: {int((length == 0).sum())} of {len(x)} rows of {name} are all zeros and have no "
                "direction; look at what the encoder was given"
            )
        units.append(x / length)
    return (units[0] * units[1]).sum(1).clamp(-1, 1)


AMONG = 32  # sentences, of which one is right


def recall_at_k(
    motions: Tensor, texts: Tensor, groups: Sequence[Hashable], among: int = AMONG, rounds: int = 100, seed: int = 0
) -> dict[str, float]:
    """R@1 and R@3 in per cent: in how many cases the own sentence is the nearest, or one of the three nearest.

    motions, texts: [N, E], pairs. groups: what each pair means, such as (content, style): in each round `among` pairs
    of different groups are drawn, so that no wrong sentence would be right too. Among sentences that are equally near
    each is as likely to be taken, so a network that says the same of all finds one in 32. Raises MotionKitError for
    fewer groups.

    >>> recalls = recall_at_k(torch.eye(40), torch.eye(40), range(40))
    >>> recalls["r1"], recalls["r3"]
    (100.0, 100.0)
    """
    members: dict[Hashable, list[int]] = {}
    for number, group in enumerate(groups):
        members.setdefault(group, []).append(number)
    if len(members) < among:
        raise MotionKitError(f"retrieval among {among} needs pairs of as many groups; found {len(members)}")
    generator, nearer, as_near = torch.Generator().manual_seed(seed), [], []
    groups = list(members.values())
    for _ in range(rounds):
        drawn = torch.randperm(len(groups), generator=generator)[:among].tolist()
        pairs = [groups[n][int(torch.randint(len(groups[n]), (), generator=generator))] for n in drawn]
        similarities = similarity(motions[pairs], texts[pairs])
        right = similarities.diagonal()[:, None]
        nearer.append((similarities > right).sum(1))
        as_near.append((similarities == right).sum(1))  # the right one at least
    nearer, as_near = torch.cat(nearer).double(), torch.cat(as_near).double()
    return {f"r{k}": round(100 * float(((k - nearer) / as_near).clamp(0, 1).mean()), 2) for k in (1, 3)}


# Physical plausibility


def jitter(motion: Motion) -> float:
    """Mean size of the joints' jerk, the change of acceleration, in m/s^3; 0 for a body that stands or glides.

    Raises MotionKitError for fewer than four frames.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> jitter(walk.replace(rotations=walk.rotations[:1].expand_as(walk.rotations))) < jitter(walk)
    True
    """
    positions = _motion("jitter", motion, frames=4).positions().double()
    jerk = (positions[3:] - 3 * positions[2:-1] + 3 * positions[1:-2] - positions[:-3]) * motion.fps**3
    return float(torch.linalg.vector_norm(jerk, dim=-1).mean())


def bone_length_error(motion: Motion) -> float:
    """The largest difference of a bone's length from the skeleton's, millimetres, over all bones and frames.

    Helper joints above the pelvis, from which it moves freely, are no bones. Raises MotionKitError for a motion without
    frames.

    >>> import motionkit as mk
    >>> bone_length_error(mk.load("data/actor/walk_neutral.bvh")) < 0.01
    True
    """
    motion = _motion("bone length error", motion).without_helper_joints()
    if len(motion.skeleton) < 2:
        return 0.0
    positions, parents = motion.positions().double(), list(motion.skeleton.parents[1:])
    lengths = torch.linalg.vector_norm(positions[:, 1:] - positions[:, parents], dim=-1)
    usual = torch.linalg.vector_norm(motion.skeleton.offsets[1:].double(), dim=-1)
    return 1000 * float((lengths - usual).abs().max())


def penetration(motion: Motion, ground: float = 0.0) -> float:
    """How deep the lowest joint of any frame is under the ground, millimetres; 0 where all stay above.

    ground: its height, metres. Raises MotionKitError for a motion without frames.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> penetration(walk), round(penetration(walk, ground=walk.positions()[..., 1].min().item() + 0.05))
    (0.0, 50)
    """
    lowest = float(_motion("penetration", motion).positions()[..., 1].min())
    return 1000 * max(0.0, ground - lowest)


# Spectrum


EDGES = (0.3, 1.3, 2.6, 5.2, 10.0)  # Hz: about the cycle of a walk, its steps, and the octaves above


def bands(curves: Tensor, fps: float) -> Tensor:
    """The mean of each curve [F, ...] and the strength of its swings in each band of `EDGES`: [..., 5].

    Strength is the root mean square, in the curve's unit, of what a Hann-windowed Fourier transform puts between two
    edges. Raises MotionKitError for curves shorter than a period of the lowest edge or too coarse for the highest.

    >>> t = torch.arange(300) / 30
    >>> bands(2 + torch.sin(2 * torch.pi * 2.0 * t), 30).round(decimals=2)
    tensor([2.0000, 0.0000, 0.7100, 0.0000, 0.0000])
    """
    if _tensor("bands", "curves [F, ...]", curves).ndim == 0:
        raise MotionKitError("bands: expected curves [F, ...]; found a single number")
    if len(curves) < fps / EDGES[0] / 2 or fps < 2 * EDGES[-1]:
        raise MotionKitError(
            f"bands: {len(curves)} frames at {fps:g} fps do not tell swings of {EDGES[0]} to {EDGES[-1]} Hz; give at "
            f"least {EDGES[0] ** -1 / 2:.1f} s at {2 * EDGES[-1]:g} fps or more"
        )
    window = torch.hann_window(len(curves), periodic=False, dtype=curves.dtype)
    mean = curves.mean(0)
    flat = (curves - mean).flatten(1) if curves.ndim > 1 else (curves - mean)[:, None]
    power = torch.fft.rfft(flat * window[:, None], dim=0).abs() ** 2 * (2 / (window**2).sum() / len(curves))
    rates = torch.fft.rfftfreq(len(curves), 1 / fps)
    strengths = [power[(rates >= low) & (rates < high)].sum(0).sqrt() for low, high in zip(EDGES, EDGES[1:])]
    return torch.stack([mean.reshape(-1), *strengths], -1).reshape(*mean.shape, len(EDGES))


def speed_bands(motion: Motion, joints: Sequence[str] | None = None) -> Tensor:
    """`bands` of the speeds of joints (all, if left out), in m/s: [J, 5].

    >>> from motionkit import actor
    >>> speed_bands(actor.perform("walk", seed=1, seconds=4).motion, ["pelvis", "left_ankle"]).shape
    torch.Size([2, 5])
    """
    skeleton = _motion("speed bands", motion).skeleton
    joints = skeleton.names if joints is None else joints
    positions = motion.positions()[:, [skeleton.index(joint) for joint in joints]]
    return bands(torch.linalg.vector_norm(positions[1:] - positions[:-1], dim=-1) * motion.fps, motion.fps)


def within_spread(values: Tensor, reference: Tensor, outside: float = 0.05) -> Tensor:
    """Whether numbers [...] lie where all but a share `outside` of the reference's clips [N, ...] do: bool [...].

    Raises MotionKitError where the shapes do not fit or there is no clip to compare with.

    >>> within_spread(torch.tensor([1.0, 9.0]), torch.arange(100.0)[:, None].expand(100, 2) / 50)
    tensor([ True, False])
    """
    _tensor("within_spread", "numbers [...]", values)
    _tensor("within_spread", "reference [N, ...]", reference)
    if not reference.ndim or not len(reference) or values.shape != reference.shape[1:]:
        raise MotionKitError(
            f"within_spread: expected numbers [...] and those of N clips, [N, ...]; found {list(values.shape)} and "
            f"{list(reference.shape)}"
        )
    low, high = (torch.quantile(reference, q, 0) for q in (outside / 2, 1 - outside / 2))
    return (values >= low) & (values <= high)


# Repeated runs and intervals


class Spread(NamedTuple):
    """Mean and standard deviation of a figure over `count` repeats; printed as papers do: 60.86±2.06.

    >>> figure = Spread(60.864, 2.055, 5)
    >>> print(figure, f"{figure:.1f}")
    60.86±2.06 60.9±2.1
    """

    mean: float
    std: float
    count: int

    def __format__(self, spec: str) -> str:
        return f"{self.mean:{spec or '.2f'}}±{self.std:{spec or '.2f'}}"

    def __str__(self) -> str:
        return format(self)


def spread(values: Sequence[float] | Tensor) -> Spread:
    """Mean and spread of a figure that was measured in several repeats of an experiment (paper 3, table 2: 60.86±2.06).

    values: one number a repeat, in any unit. The spread is the standard deviation of a sample, with one repeat less in
    the denominator; paper 3 does not say which it takes. Raises MotionKitError for fewer than two repeats, or one that
    is not finite.

    >>> print(spread([58.0, 61.0, 64.0]))
    61.00±3.00
    """
    try:
        figures = torch.as_tensor(values, dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError):
        raise MotionKitError(f"spread: expected one number a repeat; found {values!r}") from None
    if figures.ndim != 1 or len(figures) < 2:
        raise MotionKitError(
            f"spread: expected one number for each of two repeats or more; found {list(figures.shape)}"
        )
    _finite("spread", "the repeats", figures)
    return Spread(float(figures.mean()), float(figures.std()), len(figures))


class Interval(NamedTuple):
    """A figure, and between which two it would lie in most repeats of the experiment."""

    value: float
    low: float
    high: float


def bootstrap(
    statistic: Callable[..., float | Tensor],
    *samples: Tensor,
    level: float = 0.95,
    repeats: int = 1000,
    seed: int = 0,
    groups: Tensor | Sequence[Tensor] = (),
    centred: bool = False,
) -> Interval:
    """A statistic of samples with its percentile interval (Efron 1979): rows are drawn again, with replacement.

    statistic: takes the samples, returns one number. samples: tensors of N rows each, drawn together. groups: one
    tensor of ids [N], or several, of what rows share, as the content clip and the style clip of each transfer. Whole
    groups are drawn again, and a row counts as often as the product of its groups' counts (the pigeonhole bootstrap,
    Owen 2007): 3,780 transfers made from 70 clips hold the luck of 70 clips. A draw of fewer than N rows is repeated.

    centred: for a statistic that repeated rows alone drive up, as they do with `fmd`: the draws are shifted by their
    median to the value, so that their spread lies around it. An end may then lie below what the statistic can reach.

    Raises MotionKitError for fewer than two rows, rows or groups that do not fit, a level that is no share, or a
    statistic that is not finite.

    >>> mean = bootstrap(torch.mean, torch.arange(100.0))
    >>> mean.value, mean.low < 49.5 < mean.high
    (49.5, True)
    >>> by_ten = bootstrap(torch.mean, torch.arange(100.0), groups=torch.arange(100) // 10)
    >>> by_ten.high - by_ten.low > 2 * (mean.high - mean.low)
    True
    """
    if not callable(statistic):
        raise MotionKitError(
            f"bootstrap: expected a function of the samples first, like torch.mean; found {type(statistic).__name__}"
        )
    numbers = isinstance(level, int | float) and isinstance(repeats, int)
    if not numbers or not 0 < level < 1 or repeats < 10:
        raise MotionKitError(f"bootstrap: level between 0 and 1 and 10 repeats at least; found {level!r}, {repeats!r}")
    count = _row_count(samples)
    factors = _factors(groups, count) or [torch.arange(count)]
    generator = torch.Generator().manual_seed(seed)
    value, drawn = float(statistic(*samples)), []
    for _ in range(repeats):
        rows = _draw_rows(factors, generator)
        drawn.append(float(statistic(*(sample[rows] for sample in samples))))
    draws = torch.tensor(drawn, dtype=torch.float64)
    if not (math.isfinite(value) and torch.isfinite(draws).all()):
        worst = min(map(finite_share, samples))
        raise MotionKitError(
            f"bootstrap: the statistic is not finite for some of the draws; of the rows given to it "
            f"{worst.count - worst.finite} of {worst.count} are not"
        )
    if centred:
        draws = draws - draws.median() + value
    ends = torch.quantile(draws, torch.tensor([(1 - level) / 2, (1 + level) / 2], dtype=torch.float64))
    return Interval(value, *ends.tolist())


def _row_count(samples: tuple[Tensor, ...]) -> int:
    """How many rows the samples have, all as many."""
    for sample in samples:
        if _tensor("bootstrap", "samples", sample).ndim == 0:
            raise MotionKitError("bootstrap: expected samples with rows [N, ...]; found a single number")
    counts = {len(sample) for sample in samples}
    if len(counts) != 1 or min(counts) < 2:
        raise MotionKitError(f"bootstrap: expected samples of one length, two rows at least; found {sorted(counts)}")
    return counts.pop()


def _factors(groups: Tensor | Sequence[Tensor], count: int) -> list[Tensor]:
    """Each tensor of ids as group numbers from 0 up, [N]."""
    several = [groups] if isinstance(groups, Tensor) and groups.ndim == 1 else list(groups)
    for ids in several:
        if tuple(_tensor("bootstrap", f"ids [{count}] in groups", ids).shape) != (count,):
            raise MotionKitError(
                f"bootstrap: expected in groups an id for each of {count} rows; found {list(ids.shape)}. Give one "
                "tensor of ids, or several in a tuple: groups=(content_ids, style_ids)"
            )
    factors = [torch.unique(ids.cpu(), return_inverse=True)[1] for ids in several]
    if factors and max(int(ids.max()) for ids in factors) < 1:
        raise MotionKitError("bootstrap: all rows are of one group, whose spread cannot be known; two are the least")
    return factors


def _draw_rows(factors: list[Tensor], generator: torch.Generator) -> Tensor:
    """Row numbers of one draw: each factor's groups [N] drawn again, each row as often as its groups together."""
    rows = torch.empty(0, dtype=torch.long)
    while not len(rows):  # where few groups cross, a draw can miss every row
        times = torch.ones(len(factors[0]), dtype=torch.long)
        for ids in factors:
            sizes = int(ids.max()) + 1
            times = times * torch.bincount(torch.randint(sizes, (sizes,), generator=generator), minlength=sizes)[ids]
        rows = torch.repeat_interleave(times)
    return rows.repeat(-(-len(factors[0]) // len(rows)))


class FiniteShare(NamedTuple):
    """How many of `count` rows or motions are finite, and their share; printed as a footnote says it."""

    share: float
    finite: int
    count: int

    def __str__(self) -> str:
        missing = self.count - self.finite
        return f"without {missing} of {self.count}" if missing else f"all {self.count}"


def finite_rows(values: Tensor | Sequence[Motion | None]) -> Tensor:
    """Which rows [N, ...] of a tensor, or which of N motions, are finite numbers throughout: bool [N].

    A motion that a method never gave stands as None in the list and is not finite.

    >>> finite_rows(torch.tensor([[0.0, 1.0], [torch.nan, 1.0], [2.0, torch.inf]]))
    tensor([ True, False, False])
    """
    if isinstance(values, Tensor) and values.ndim:
        return torch.isfinite(values).reshape(len(values), -1).all(1) if len(values) else values.new_zeros(0).bool()
    if isinstance(values, list | tuple) and all(v is None or isinstance(v, Motion) for v in values):
        parts = [None if v is None else (v.rotations, v.translations) for v in values]
        return torch.tensor([p is not None and all(bool(torch.isfinite(x).all()) for x in p) for p in parts]).bool()
    raise MotionKitError(
        f"finite_rows: expected a tensor [N, ...] or a list of Motions (None where one is missing); found a "
        f"{type(values).__name__}"
    )


def finite_share(values: Tensor | Sequence[Motion | None]) -> FiniteShare:
    """How many of the rows or motions are finite (see `finite_rows`), so that a table can say what a mean leaves out.

    >>> errors = torch.tensor([12.0, torch.nan, 14.0])
    >>> print(errors[finite_rows(errors)].mean().item(), finite_share(errors))
    13.0 without 1 of 3
    """
    rows = finite_rows(values)
    finite, count = int(rows.sum()), len(rows)
    return FiniteShare(finite / count if count else 0.0, finite, count)
