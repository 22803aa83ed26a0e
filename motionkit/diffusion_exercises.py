"""The exercises of notebook 05: for each its reference, its cases and its hint, as `exercises.Exercise` takes them."""

from __future__ import annotations

import torch
from torch import Tensor

from .diffusion import NoiseSchedule
from .sampling import timesteps


def _x0_from_velocity(x: Tensor, v: Tensor, bar_t: float) -> Tensor:
    """The clean sample behind x, from the target between it and the noise (Salimans, Ho 2022, appendix D)."""
    return bar_t**0.5 * x - (1 - bar_t) ** 0.5 * v


def _noised() -> list[tuple]:
    """Samples with noise, their v, and the share of the variance that is signal: nearly all, half, hardly any."""
    chance = torch.Generator().manual_seed(0)
    x0, noise = torch.randn(2, 5, 3, generator=chance)
    mixed = [(share**0.5, (1 - share) ** 0.5, share) for share in (0.99, 0.5, 0.001)]
    return [(a * x0 + b * noise, a * noise - b * x0, share) for a, b, share in mixed]


def _sampler_steps(most: int, count: int, start: int) -> list[int]:
    """The steps that a sampler stops at, the noisiest first."""
    return timesteps(NoiseSchedule.linear(most), count, start)


def _key_frames(frames: int, numbers: int, keys: list[int]) -> Tensor:
    """Which numbers of which frames are given, bool [frames, numbers]."""
    where = torch.zeros(frames, numbers, dtype=torch.bool)
    where[keys] = True
    return where


EXERCISES = {
    "x0_from_velocity": (
        _x0_from_velocity,
        _noised,
        "write x and v as sums of m_0 and noise, multiply one by the root of bar_t, the other by that of 1 - bar_t: "
        "the noise drops out of their difference",
    ),
    "sampler_steps": (
        _sampler_steps,
        lambda: [(1000, 20, 300), (1000, 50, 1000), (100, 4, 60), (10, 10, 10)],
        "the distance is most / count, from start down; 0 itself is not a step that the network is asked at",
    ),
    "key_frames": (
        _key_frames,
        lambda: [(8, 3, [0, -1]), (6, 2, [2]), (5, 4, [])],
        "True in all numbers of the frames in keys, False in all others",
    ),
}
