"""How fast joints move, by frequency: whether made motion is as lively as captured motion, and in the same rhythms."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..motion import Motion
from .checks import needs_motion, needs_tensor

EDGES = (0.3, 1.3, 2.6, 5.2, 10.0)  # Hz: about the cycle of a walk, its steps, and the octaves above


def bands(curves: Tensor, fps: float) -> Tensor:
    """The mean of each curve [F, ...] and the strength of its swings in each band of `EDGES`: [..., 5].

    Strength is the root mean square, in the curve's unit, of what a Hann-windowed Fourier transform puts between two
    edges. Raises MotionKitError for curves shorter than a period of the lowest edge or too coarse for the highest.

    >>> t = torch.arange(300) / 30
    >>> bands(2 + torch.sin(2 * torch.pi * 2.0 * t), 30).round(decimals=2)
    tensor([2.0000, 0.0000, 0.7100, 0.0000, 0.0000])
    """
    if needs_tensor("bands", "curves [F, ...]", curves).ndim == 0:
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
    found = [mean.reshape(-1)]
    for low, high in zip(EDGES, EDGES[1:]):
        found.append(power[(rates >= low) & (rates < high)].sum(0).sqrt())
    return torch.stack(found, -1).reshape(*mean.shape, len(EDGES))


def speed_bands(motion: Motion, joints: Sequence[str] | None = None) -> Tensor:
    """`bands` of the speeds of joints (all, if left out), in m/s: [J, 5].

    >>> from motionkit import actor
    >>> speed_bands(actor.perform("walk", seed=1, seconds=4).motion, ["pelvis", "left_ankle"]).shape
    torch.Size([2, 5])
    """
    needs_motion("speed bands", motion)
    chosen = range(len(motion.skeleton)) if joints is None else [motion.skeleton.index(j) for j in joints]
    places = motion.positions()[:, list(chosen)]
    return bands(torch.linalg.vector_norm(places[1:] - places[:-1], dim=-1) * motion.fps, motion.fps)


def within_spread(found: Tensor, reference: Tensor, outside: float = 0.05) -> Tensor:
    """Whether numbers [...] lie where all but a share `outside` of the reference's clips [N, ...] do: bool [...].

    Raises MotionKitError where the shapes do not fit or there is no clip to compare with.

    >>> within_spread(torch.tensor([1.0, 9.0]), torch.arange(100.0)[:, None].expand(100, 2) / 50)
    tensor([ True, False])
    """
    needs_tensor("within_spread", "numbers [...]", found)
    needs_tensor("within_spread", "reference [N, ...]", reference)
    if not reference.ndim or not len(reference) or found.shape != reference.shape[1:]:
        raise MotionKitError(
            f"within_spread: expected numbers [...] and those of N clips, [N, ...]; found {list(found.shape)} and "
            f"{list(reference.shape)}"
        )
    low, high = (torch.quantile(reference, q, 0) for q in (outside / 2, 1 - outside / 2))
    return (found >= low) & (found <= high)
