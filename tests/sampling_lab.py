"""What tests of samplers share: both schedules, a stand-in for a network, a callback that keeps everything."""

import torch

from motionkit.diffusion import NoiseSchedule

SCHEDULES = {"linear": NoiseSchedule.linear(), "squaredcos_cap_v2": NoiseSchedule.cosine()}


def normal(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def bent(schedule: NoiseSchedule):
    """A stand-in for a network, bent in x and in t: x [B, 4] and t [B] to x0 [B, 4]."""
    mix = normal(4, 4, seed=9)

    def predict(x, t):
        assert t.dtype == torch.int64 and t.shape == (len(x),)
        return torch.tanh(schedule.at(schedule.signal, t, x) * x @ mix.to(x)) + torch.sin(t / 200)[:, None].to(x)

    return predict


class Trace(list):
    """A callback that keeps (step reached, x there, the x0 that led to it)."""

    def __call__(self, step: int, x: torch.Tensor, x0: torch.Tensor) -> None:
        self.append((step, x.clone(), x0.clone()))
