"""Diffusion: how noise is added to motions, and what a network learns that takes it away.

Steps are counted as papers do: step 0 is clean, step T is noise. Every function takes a step for the whole batch, or
one for each sample, long [B].
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from .errors import MotionKitError


@dataclass(frozen=True, eq=False)
class NoiseSchedule:
    """How much of a motion is left after each step.

    alphas_bar: float64 [T + 1], the share of the variance that is signal (paper 1, below eq. 2); 1 at step 0, falling.

    >>> NoiseSchedule.linear(1000)
    NoiseSchedule(1000 steps; half of the variance is noise from step 260 on)
    >>> [round(float(NoiseSchedule.cosine(1000).alphas_bar[t]), 3) for t in (0, 250, 500, 1000)]
    [1.0, 0.847, 0.494, 0.0]
    """

    alphas_bar: Tensor

    def __post_init__(self) -> None:
        bar = self.alphas_bar
        if bar.ndim != 1 or len(bar) < 2 or bar[0] != 1 or not bool((bar[1:] < bar[:-1]).all() and bar[-1] > 0):
            raise MotionKitError("alphas_bar must start at 1 and fall at every step, and stay above 0; see .cosine()")

    @classmethod
    def of_betas(cls, betas: Tensor) -> NoiseSchedule:
        """From the variance of the noise that each step adds, [T]; a step keeps alpha = 1 - beta (paper 1, eq. 1)."""
        return cls(torch.cat((torch.ones(1, dtype=torch.float64), (1 - betas.double()).cumprod(0))))

    @classmethod
    def linear(cls, steps: int = 1000) -> NoiseSchedule:
        """Betas in a straight line, 0.0001 to 0.02 at 1000 steps, as much noise in all for others (Ho et al. 2020)."""
        _at_least_one(steps)
        return cls.of_betas(torch.linspace(0.1 / steps, min(20 / steps, 0.999), steps, dtype=torch.float64))

    @classmethod
    def cosine(cls, steps: int = 1000) -> NoiseSchedule:
        """The signal falls as a squared cosine, slowly at both ends (Nichol, Dhariwal 2021, eq. 17)."""
        _at_least_one(steps)
        at = torch.linspace(0, 1, steps + 1, dtype=torch.float64)
        bar = torch.cos((at + 0.008) / 1.008 * math.pi / 2) ** 2
        return cls.of_betas((1 - bar[1:] / bar[:-1]).clamp(max=0.999))

    def snr_shift(self, times: float) -> NoiseSchedule:
        """The same with a noise level `times` as high beside the signal at every step (Hoogeboom et al. 2023, shifted).

        What many numbers say together, such as how fast a walk is, shows through a lot of noise: at the plain cosine's
        step 950 of 1000 already. A schedule shifted to more noise gives the steps before that more room.

        >>> NoiseSchedule.cosine().snr_shift(6)
        NoiseSchedule(1000 steps; half of the variance is noise from step 99 on)
        """
        if not (math.isfinite(times) and times > 0):
            raise MotionKitError(f"a schedule is shifted by a factor above 0, 6 for instance; found {times}")
        bar = self.alphas_bar.double()
        return NoiseSchedule(bar / (bar + (1 - bar) * times**2))

    def matching_step(self, step: int, other: NoiseSchedule) -> int:
        """The step, of 1 to T, whose signal-to-noise ratio is nearest to that of a step of another schedule.

        Papers give steps of their own schedule; those of a shifted one (`snr_shift`) have other numbers.

        >>> plain = NoiseSchedule.cosine()
        >>> [plain.snr_shift(6).matching_step(step, plain) for step in (50, 300, 950)]
        [5, 48, 719]
        """
        wanted = other.at(other.log_snr, step, torch.zeros(1, dtype=torch.float64), least=1)
        return 1 + int((self.log_snr[1:] - wanted).abs().argmin())

    @property
    def steps(self) -> int:
        """T."""
        return len(self.alphas_bar) - 1

    @cached_property
    def signal(self) -> Tensor:
        """What x0 is multiplied by at each step, [T + 1]: the root of alphas_bar (paper 1, eq. 2)."""
        return self.alphas_bar.double().sqrt()

    @cached_property
    def noise(self) -> Tensor:
        """What the noise is multiplied by at each step, [T + 1]: the root of 1 - alphas_bar (paper 1, eq. 2)."""
        return (1 - self.alphas_bar.double()).sqrt()

    @cached_property
    def log_snr(self) -> Tensor:
        """The logarithm of `signal` over `noise`, [T + 1]: lambda of DPM-Solver; infinite at step 0."""
        return self.signal.log() - self.noise.log()

    def __repr__(self) -> str:
        half = int((self.alphas_bar < 0.5).nonzero()[0]) if self.alphas_bar[-1] < 0.5 else None
        noise = (
            "more signal than noise to the end"
            if half is None
            else f"half of the variance is noise from step {half} on"
        )
        return f"NoiseSchedule({self.steps} steps; {noise})"

    def at(self, values: Tensor, t: int | Tensor, like: Tensor, least: int = 0) -> Tensor:
        """Entries t of values [T + 1], with axes of size 1 so that they multiply `like` [B, ...].

        Raises MotionKitError for a step outside `least` to T, or one that is no whole number.
        """
        t = torch.as_tensor(t)
        if t.is_floating_point() or t.dtype == torch.bool:
            raise MotionKitError(f"steps are whole numbers from {least} to {self.steps}; found {t.dtype}: use t.long()")
        if t.numel() and not least <= int(t.min()) <= int(t.max()) <= self.steps:
            raise MotionKitError(f"steps go from {least} to {self.steps} here; found {int(t.min())} to {int(t.max())}")
        found = values[t.cpu()].to(like)
        return found.reshape(found.shape + (1,) * (like.ndim - 1)) if found.ndim else found


def _at_least_one(steps: int) -> None:
    if steps < 1:
        raise MotionKitError(f"a schedule has at least 1 step, 1000 as a rule; found {steps}")


def step_forward(x: Tensor, t: int | Tensor, schedule: NoiseSchedule, noise: Tensor | None = None) -> Tensor:
    """One step of the forward process, from step t - 1 to t (paper 1, eq. 1).

    x: [B, ...] at step t - 1. t: from 1 to T. noise: standard normal, like x; drawn if left out.

    >>> schedule = NoiseSchedule.cosine(10)
    >>> x = torch.ones(1, 2)
    >>> for t in range(1, 11):
    ...     x = step_forward(x, t, schedule, noise=torch.zeros(1, 2))
    >>> bool(torch.allclose(x, add_noise(torch.ones(1, 2), 10, schedule, noise=torch.zeros(1, 2))))
    True
    """
    noise = torch.randn_like(x) if noise is None else noise
    bar = schedule.alphas_bar.double()
    alphas = torch.cat((bar[:1], bar[1:] / bar[:-1]))  # what each step keeps, [T + 1]
    return schedule.at(alphas.sqrt(), t, x, least=1) * x + schedule.at((1 - alphas).sqrt(), t, x, least=1) * noise


def add_noise(x0: Tensor, t: int | Tensor, schedule: NoiseSchedule, noise: Tensor | None = None) -> Tensor:
    """Clean x0 [B, ...] straight to step t (paper 1, eq. 2). noise: standard normal, like x0; drawn if left out.

    >>> add_noise(torch.ones(1, 3), 0, NoiseSchedule.linear())
    tensor([[1., 1., 1.]])
    """
    noise = torch.randn_like(x0) if noise is None else noise
    return schedule.at(schedule.signal, t, x0) * x0 + schedule.at(schedule.noise, t, x0) * noise


def noise_from_x0(x: Tensor, x0: Tensor, t: int | Tensor, schedule: NoiseSchedule) -> Tensor:
    """The noise that makes x of x0 at step t of at least 1: paper 1, eq. 2, solved for epsilon. All are [B, ...].

    >>> schedule, x0, noise = NoiseSchedule.cosine(), torch.ones(2, 3), torch.full((2, 3), 0.5)
    >>> noise_from_x0(add_noise(x0, 400, schedule, noise), x0, 400, schedule)[0]
    tensor([0.5000, 0.5000, 0.5000])
    """
    return (x - schedule.at(schedule.signal, t, x, least=1) * x0) / schedule.at(schedule.noise, t, x)


def x0_from_noise(x: Tensor, noise: Tensor, t: int | Tensor, schedule: NoiseSchedule) -> Tensor:
    """The clean x0 behind x at step t, given its noise: paper 1, eq. 2, solved for m_0. All are [B, ...].

    >>> schedule, x0, noise = NoiseSchedule.cosine(), torch.ones(2, 3), torch.full((2, 3), 0.5)
    >>> x0_from_noise(add_noise(x0, 400, schedule, noise), noise, 400, schedule)[0]
    tensor([1., 1., 1.])
    """
    return (x - schedule.at(schedule.noise, t, x) * noise) / schedule.at(schedule.signal, t, x)


def posterior(x: Tensor, x0: Tensor, t: int, s: int, schedule: NoiseSchedule) -> tuple[Tensor, float]:
    """Mean [B, ...] and variance of x at an earlier step s, given x at step t and x0 (Ho et al. 2020, eqs. 6 and 7).

    Raises MotionKitError unless 0 <= s < t <= T.

    >>> mean, variance = posterior(torch.zeros(1, 2), torch.ones(1, 2), 500, 0, NoiseSchedule.cosine())
    >>> mean, variance
    (tensor([[1., 1.]]), 0.0)
    """
    if not 0 <= s < t <= schedule.steps:
        raise MotionKitError(f"s must be a step before t, both from 0 to {schedule.steps}; found s={s}, t={t}")
    bar_t, bar_s = (float(schedule.alphas_bar[n]) for n in (t, s))
    alpha = bar_t / bar_s  # what is kept from s to t
    mean = bar_s**0.5 * (1 - alpha) / (1 - bar_t) * x0 + alpha**0.5 * (1 - bar_s) / (1 - bar_t) * x
    return mean, (1 - alpha) * (1 - bar_s) / (1 - bar_t)


def from_noise(model: Callable[..., Tensor], schedule: NoiseSchedule) -> Callable[..., Tensor]:
    """A network that predicts noise, as one that predicts x0 (Ho et al. 2020 against paper 1, eq. 3).

    model: called as (x [B, ...], t [B], more); so is what is returned.

    >>> schedule = NoiseSchedule.cosine()
    >>> x0 = from_noise(lambda x, t: torch.zeros_like(x), schedule)(torch.ones(1, 2), torch.tensor([496]))
    >>> bool(torch.allclose(x0, 1 / schedule.alphas_bar[496].sqrt().float()))
    True
    """
    return lambda x, t, *more: x0_from_noise(x, model(x, t, *more), t, schedule)


def simple_loss(
    predict: Callable[[Tensor, Tensor], Tensor],
    x0: Tensor,
    schedule: NoiseSchedule,
    t: Tensor | None = None,
    mask: Tensor | None = None,
) -> Tensor:
    """How far a network is from x0, which it must find in x0 with noise (paper 1, eqs. 3 to 5); mean of squares.

    predict: (x_t [B, F, D], t long [B]) to x0, the network with its condition. x0: [B, F, D]. t: steps, drawn evenly
    from 1 to T if left out. mask: bool [B, F]; only these frames count.

    >>> simple_loss(lambda x, t: torch.zeros_like(x), torch.full((4, 8, 3), 2.0), NoiseSchedule.cosine())
    tensor(4.)
    """
    t = torch.randint(1, schedule.steps + 1, (len(x0),)).to(x0.device) if t is None else t
    miss = (predict(add_noise(x0, t, schedule), t) - x0) ** 2
    if mask is None:
        return miss.mean()
    kept = mask.to(miss)
    return (miss.flatten(2).mean(2) * kept).sum() / kept.sum().clamp(min=1)
