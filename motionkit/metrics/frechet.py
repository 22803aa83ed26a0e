"""Fréchet Motion Distance: how far apart two clouds of features are, as two Gaussians."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion
from .checks import needs_finite, needs_motion, needs_tensor


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
    (mean_a, cov_a), (mean_b, cov_b) = (
        gaussian(_features(x, name, encoder), name, shrinkage) for x, name in ((a, "a"), (b, "b"))
    )
    if len(mean_a) != len(mean_b):
        raise MotionKitError(f"fmd: features of {len(mean_a)} and of {len(mean_b)} numbers; use one encoder for both")
    root = _square_root(cov_a)
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
    return fmd(results, contents, _half(judge, "content"), shrinkage=shrinkage)


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
    return fmd(results, styles, _half(judge, "style"), shrinkage=shrinkage)


def gaussian(features: Tensor, name: str = "features", shrinkage: float | None = None) -> tuple[Tensor, Tensor]:
    """Mean [D] and covariance [D, D] of features [N, D], float64; errors and shrinkage as in `fmd`.

    >>> mean, cov = gaussian(torch.tensor([[0.0, 0], [2, 0], [0, 2], [2, 2]]))
    >>> mean, cov.diag()
    (tensor([1., 1.], dtype=torch.float64), tensor([1.3333, 1.3333], dtype=torch.float64))
    """
    if features.ndim != 2 or not features.shape[1]:
        raise MotionKitError(f"fmd: expected {name} [N, D], one row a motion; found {list(features.shape)}")
    needs_finite("fmd", name, features)
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


def _features(given: Tensor | Iterable[Motion], name: str, encoder: object) -> Tensor:
    """Rows [N, D]: those given, or the encoder's of the motions given."""
    if isinstance(given, Tensor):
        if encoder is not None:
            raise MotionKitError(f"fmd: {name} holds features, and an encoder takes motions; leave one of the two out")
        return given
    if isinstance(given, Motion | str) or not isinstance(given, Iterable):
        raise MotionKitError(
            f"fmd: expected {name} as features [N, D] or as a list of Motions; found a {type(given).__name__}. "
            "The distance is between two sets of motions, not between two clips"
        )
    motions = [needs_motion(f"fmd: {name}[{n}]", motion) for n, motion in enumerate(given)]
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
    rows = needs_tensor("fmd", f"the encoder's features of {name}", encode(motions)) if motions else torch.empty(0, 1)
    if rows.ndim != 2 or len(rows) != len(motions):
        raise MotionKitError(
            f"fmd: the encoder gives {list(rows.shape)} for the {len(motions)} motions of {name}; expected one row each"
        )
    return rows


def _half(judge: object, which: str) -> object:
    """A judge's content or style classifier."""
    found = getattr(judge, which, None)
    if found is None or isinstance(judge, Motion):
        raise MotionKitError(
            f'{which} FMD: expected a judge with a .{which} classifier, such as mk.judges.load("actor"); '
            f"found a {type(judge).__name__}"
        )
    return found


def _square_root(matrix: Tensor) -> Tensor:
    values, vectors = torch.linalg.eigh(matrix)
    return (vectors * values.clamp(min=0).sqrt()) @ vectors.T
