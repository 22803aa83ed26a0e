"""Fréchet Motion Distance: how far apart two clouds of features are, as two Gaussians."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import MotionKitError


def fmd(a: Tensor, b: Tensor, *, shrinkage: float | None = None) -> float:
    """Fréchet distance between the Gaussians of two sets of features (paper 1, section 5.2; Heusel et al. 2017).

    a: [N, D], b: [M, D], one row a motion, such as a classifier's last pooling layer; no unit. The result is
    |mean_a - mean_b|^2 + trace(A + B - 2 (A B)^(1/2)), 0 for equal Gaussians. A covariance needs more rows than
    columns: with fewer, a MotionKitError says how many, unless `shrinkage` (0 to 1) mixes that share of a round
    covariance into both, which makes numbers comparable only with numbers of the same shrinkage. Numbers that are not
    finite are an error that counts the rows: they are never averaged away.

    >>> cloud = torch.randn(500, 4, generator=torch.Generator().manual_seed(0))
    >>> fmd(cloud, cloud) < 1e-6, round(fmd(cloud, cloud + 2.0), 6)
    (True, 16.0)
    """
    (mean_a, cov_a), (mean_b, cov_b) = (gaussian(x, name, shrinkage) for x, name in ((a, "a"), (b, "b")))
    if len(mean_a) != len(mean_b):
        raise MotionKitError(f"fmd: features of {len(mean_a)} and of {len(mean_b)} numbers; use one encoder for both")
    root = _square_root(cov_a)
    inner = torch.linalg.eigvalsh(root @ cov_b @ root).clamp(min=0)
    distance = ((mean_a - mean_b) ** 2).sum() + cov_a.trace() + cov_b.trace() - 2 * inner.sqrt().sum()
    return max(float(distance), 0.0)


def gaussian(features: Tensor, name: str = "features", shrinkage: float | None = None) -> tuple[Tensor, Tensor]:
    """Mean [D] and covariance [D, D] of features [N, D], float64; errors and shrinkage as in `fmd`.

    >>> mean, cov = gaussian(torch.tensor([[0.0, 0], [2, 0], [0, 2], [2, 2]]))
    >>> mean, cov.diag()
    (tensor([1., 1.], dtype=torch.float64), tensor([1.3333, 1.3333], dtype=torch.float64))
    """
    if features.ndim != 2:
        raise MotionKitError(f"fmd: expected {name} [N, D], one row a motion; found {list(features.shape)}")
    bad = int((~torch.isfinite(features)).any(1).sum())
    if bad:
        raise MotionKitError(f"fmd: {bad} of {len(features)} rows of {name} are not finite; find those motions")
    count, size = features.shape
    if shrinkage is not None and not 0 < shrinkage <= 1:
        raise MotionKitError(f"fmd: shrinkage is a share above 0, at most 1; found {shrinkage!r}")
    if count < 2 or (count <= size and shrinkage is None):
        raise MotionKitError(
            f"fmd: {name} has {count} rows of {size} numbers; a covariance needs at least {size + 1} rows. Measure "
            "more motions, use features with fewer numbers, or say shrinkage=0.1 and report it"
        )
    x = features.double()
    mean = x.mean(0)
    cov = (x - mean).T @ (x - mean) / (count - 1)
    if shrinkage is not None:
        cov = (1 - shrinkage) * cov + shrinkage * cov.trace() / size * torch.eye(size, dtype=cov.dtype)
    return mean, cov


def _square_root(matrix: Tensor) -> Tensor:
    values, vectors = torch.linalg.eigh(matrix)
    return (vectors * values.clamp(min=0).sqrt()) @ vectors.T
