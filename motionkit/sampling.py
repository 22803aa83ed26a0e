"""Samplers: from noise to a motion, in many steps or few.

Each is a plain function of `predict`, a callable (x [B, ...], t long [B]) to the clean x0 that it sees in x at step t.
Those who have a network that predicts noise wrap it in `diffusion.from_noise`; text comes in with
`classifier_free_guidance`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .diffusion import NoiseSchedule, noise_from_x0, posterior, x0_from_noise
from .errors import MotionKitError
from .features import Layout

Denoise = Callable[[Tensor, Tensor], Tensor]
Inpaint = Callable[[Tensor], Tensor]
Callback = Callable[[int, Tensor, Tensor], object]
Steps = int | Sequence[int] | None


def timesteps(
    schedule: NoiseSchedule, steps: Steps = None, start: int | None = None, spacing: float = 1.0
) -> list[int]:
    """The steps that a sampler stops at on its way to 0, noisiest first.

    steps: how many there would be from T on; left out, all; or the very steps. start: where it begins; T if left out.
    Paper 1 (section 4): with S = 20 of T = 1000, a start at K = 300 leaves 6. spacing: the power that even steps are
    raised to; above 1 they crowd towards 0, which suits a shifted schedule. Raises MotionKitError for numbers out of
    range, and for very steps that do not fall.

    >>> timesteps(NoiseSchedule.cosine(1000), steps=20, start=300)
    [300, 250, 200, 150, 100, 50]
    >>> timesteps(NoiseSchedule.cosine(1000), steps=5, spacing=2.0)
    [1000, 640, 360, 160, 40]
    >>> timesteps(NoiseSchedule.cosine(1000), steps=[48, 20, 5])
    [48, 20, 5]
    """
    most = schedule.steps
    if isinstance(steps, Sequence):
        return _very_steps(steps, most, start, spacing)
    steps, start = most if steps is None else steps, most if start is None else start
    if not 1 <= steps <= most or not 1 <= start <= most:
        raise MotionKitError(f"steps and start must be from 1 to {most}; found steps={steps}, start={start}")
    if not (math.isfinite(spacing) and spacing > 0):
        raise MotionKitError(f"spacing must be a number above 0, 1 for even steps; found {spacing}")
    first = start if spacing == 1 else most * (start / most) ** (1 / spacing)
    even = [max(first - n * most / steps, 0.0) for n in range(steps)]
    found = [round(t if spacing == 1 else most * (t / most) ** spacing) for t in even]
    return [t for t, before in zip(found, [most + 1, *found]) if 0 < t < before]


def _very_steps(steps: Sequence[int], most: int, start: int | None, spacing: float) -> list[int]:
    if start is not None or spacing != 1:
        raise MotionKitError("the very steps say where sampling starts and how they lie; leave start and spacing out")
    if not steps or not all(isinstance(t, int) and after < t for t, after in zip(steps, [*steps[1:], 0])):
        raise MotionKitError(f"the very steps are whole numbers from {most} down to 1, each once; found {list(steps)}")
    if steps[0] > most:
        raise MotionKitError(f"the schedule has {most} steps; found step {steps[0]}")
    return list(steps)


def ddpm(
    predict: Denoise,
    x: Tensor,
    schedule: NoiseSchedule,
    steps: Steps = None,
    inpaint: Inpaint | None = None,
    callback: Callback | None = None,
    generator: torch.Generator | None = None,
) -> Tensor:
    """Ancestral sampling (Ho et al. 2020, algorithm 2): some noise goes at every step, and a little fresh noise comes.

    x: [B, ...] at the first step, standard normal if that is T. steps: how many there are from T on, None for all; or
    the very steps, such as `timesteps(schedule, 20, start=300)`. inpaint: changes every prediction of x0, see
    `inpainting`. callback: called after each step with the step reached, x there, and the
    x0 that led to it. generator: of the fresh noise. Returns x at step 0.

    >>> ddpm(lambda x, t: torch.full_like(x, 3.0), torch.randn(1, 2), NoiseSchedule.cosine(), steps=5)
    tensor([[3., 3.]])
    """
    stops = timesteps(schedule, steps)
    for t, s in zip(stops, [*stops[1:], 0]):
        x0 = _predicted(predict, x, t, inpaint)
        x, variance = posterior(x, x0, t, s, schedule)
        if s > 0:
            x = x + variance**0.5 * _normal(x, generator)
        if callback is not None:
            callback(s, x, x0)
    return x


def ddim(
    predict: Denoise,
    x: Tensor,
    schedule: NoiseSchedule,
    steps: Steps = 50,
    inpaint: Inpaint | None = None,
    callback: Callback | None = None,
    generator: torch.Generator | None = None,
    eta: float = 0.0,
) -> Tensor:
    """DDIM (Song, Meng, Ermon 2021, eq. 12): without fresh noise, so the same x gives the same answer, in few steps.

    eta: how much fresh noise there is after all, from 0 to 1, which is `ddpm`. Other arguments as there. Raises
    MotionKitError for another eta.

    >>> x, schedule = torch.randn(1, 2), NoiseSchedule.cosine()
    >>> bool(torch.equal(ddim(lambda x, t: x / 2, x, schedule, 5), ddim(lambda x, t: x / 2, x, schedule, 5)))
    True
    """
    if not 0 <= eta <= 1:
        raise MotionKitError(f"eta must be from 0 (no fresh noise) to 1 (as much as ddpm); found {eta}")
    stops = timesteps(schedule, steps)
    for t, s in zip(stops, [*stops[1:], 0]):
        x0 = _predicted(predict, x, t, inpaint)
        fresh = eta * posterior(x, x0, t, s, schedule)[1] ** 0.5
        bar = float(schedule.alphas_bar[s])
        x = bar**0.5 * x0 + max(1 - bar - fresh**2, 0.0) ** 0.5 * noise_from_x0(x, x0, t, schedule)
        if fresh > 0:
            x = x + fresh * _normal(x, generator)
        if callback is not None:
            callback(s, x, x0)
    return x


def ddim_invert(
    predict: Denoise,
    x: Tensor,
    schedule: NoiseSchedule,
    steps: Steps = 50,
    callback: Callback | None = None,
) -> Tensor:
    """DDIM backwards: the noise at the first of `steps` from which `ddim` makes this clean x [B, ...] again, nearly.

    The prediction at the step ahead stands in for the one here, which is exact as steps become many (Song, Meng, Ermon
    2021, section 4.3; paper 1, section 4, runs its forward process so). Other arguments as in `ddim`.

    >>> schedule, predict = NoiseSchedule.cosine(), lambda x, t: torch.full_like(x, 3.0)
    >>> steps = timesteps(schedule, 20, start=300)
    >>> x = ddim_invert(predict, torch.full((1, 2), 3.0), schedule, steps)
    >>> bool(torch.allclose(ddim(predict, x, schedule, steps), torch.full((1, 2), 3.0)))
    True
    """
    stops = timesteps(schedule, steps)[::-1]
    for s, t in zip([0, *stops[:-1]], stops):
        x0 = _predicted(predict, x, t, None)
        noise = noise_from_x0(x, x0, t, schedule)
        bar = float(schedule.alphas_bar[t])
        x = bar**0.5 * x0_from_noise(x, noise, s, schedule) + (1 - bar) ** 0.5 * noise
        if callback is not None:
            callback(t, x, x0)
    return x


def dpm_solver(
    predict: Denoise,
    x: Tensor,
    schedule: NoiseSchedule,
    steps: Steps = 10,
    inpaint: Inpaint | None = None,
    callback: Callback | None = None,
) -> Tensor:
    """DPM-Solver++ (2M) of Lu et al. 2022, algorithm 2: it uses the step before too; ten steps do the work of fifty.

    No fresh noise; arguments as in `ddim`. The last step, to 0, is the prediction of x0 itself. Where the schedule is
    shifted (`snr_shift`), few steps do better with `timesteps(schedule, 10, spacing=2)`: even ones leave
    much noise for the last.

    >>> dpm_solver(lambda x, t: torch.full_like(x, 3.0), torch.randn(1, 2), NoiseSchedule.cosine(), steps=5)
    tensor([[3., 3.]])
    """
    stops, before, length_before = timesteps(schedule, steps), None, 0.0
    for t, s in zip(stops, [*stops[1:], 0]):
        x0 = _predicted(predict, x, t, inpaint)
        bar_t, bar_s = (float(schedule.alphas_bar[n]) for n in (t, s))
        length = float(schedule.log_snr[s] - schedule.log_snr[t])  # h of the paper; infinite on the last step
        ahead = x0
        if before is not None and s > 0:
            ahead = x0 + 0.5 * length / length_before * (x0 - before)
        shrink = ((1 - bar_s) / (1 - bar_t)) ** 0.5
        x = shrink * x + (bar_s**0.5 - shrink * bar_t**0.5) * ahead
        before, length_before = x0, length
        if callback is not None:
            callback(s, x, x0)
    return x


def _predicted(predict: Denoise, x: Tensor, t: int, inpaint: Inpaint | None) -> Tensor:
    x0 = predict(x, torch.full((len(x),), t, device=x.device))
    return x0 if inpaint is None else inpaint(x0)


def _normal(like: Tensor, generator: torch.Generator | None) -> Tensor:
    """Standard normal numbers, drawn on the CPU so that a seed means the same on every machine."""
    return torch.randn(like.shape, generator=generator).to(like)


def guidance(conditioned: Tensor, unconditioned: Tensor, scale: float) -> Tensor:
    """Classifier-free guidance: scale x conditioned + (1 - scale) x unconditioned (paper 4, eq. 5).

    Predictions with and without the condition, [B, ...]; 1 is the condition as it is, more exaggerates it.

    >>> guidance(torch.tensor([3.0]), torch.tensor([1.0]), scale=2.0)
    tensor([5.])
    """
    return scale * conditioned + (1 - scale) * unconditioned


def classifier_free_guidance(
    model: Callable[..., Tensor], condition: Tensor, nothing: Tensor, scale: float = 2.5, **more: Tensor
) -> Denoise:
    """A network with a condition as `predict`, both of its predictions made in one call (paper 4, eq. 5).

    model: called as (x [B, ...], t [B], condition [B, D], more). nothing: the condition that says nothing, [D]. scale:
    see `guidance`; at 1 the network is asked once. more: tensors [B, ...] that it gets beside, such as a mask.

    >>> three, one = torch.tensor([[3.0]]), torch.tensor([1.0])
    >>> predict = classifier_free_guidance(lambda x, t, c: x * 0 + c, three, one, scale=2.0)
    >>> predict(torch.zeros(1, 1), torch.tensor([5]))
    tensor([[5.]])
    """
    if scale == 1:
        return lambda x, t: model(x, t, condition, **more)
    both = torch.cat((condition, nothing.expand_as(condition)))
    twice = {name: torch.cat((value, value)) for name, value in more.items()}

    def predict(x: Tensor, t: Tensor) -> Tensor:
        return guidance(*model(torch.cat((x, x)), torch.cat((t, t)), both, **twice).chunk(2), scale)

    return predict


def sliding_window(predict: Denoise, most: int, overlap: int) -> Denoise:
    """A network that was taught motions of `most` frames, for longer ones: it sees windows, which fade into each other.

    What it predicts for windows that share at least `overlap` frames is laid together at every step of a sampler, so
    that they agree more and more and no seam is left. Shorter motions pass as they are. Raises MotionKitError where the
    overlap does not fit into a window.

    >>> predict = sliding_window(lambda x, t: x[:, :1].expand_as(x), most=4, overlap=2)
    >>> predict(torch.arange(6.0)[None, :, None], torch.tensor([5])).flatten()
    tensor([0.0000, 0.0000, 0.2929, 1.7071, 2.0000, 2.0000])
    """
    if not 0 < overlap < most:
        raise MotionKitError(f"windows of {most} frames overlap by 1 to {most - 1}; found {overlap}")

    def whole(x: Tensor, t: Tensor) -> Tensor:
        frames = x.shape[1]
        if frames <= most:
            return predict(x, t)
        count = -(-(frames - overlap) // (most - overlap))
        starts = torch.linspace(0, frames - most, count).round().long().tolist()
        total, weights = torch.zeros_like(x), x.new_zeros(frames, 1)
        for start in starts:
            ahead = torch.arange(most, device=x.device) + 0.5  # frames from either end of the window
            fade_in = (ahead / overlap).clamp(max=1) if start else torch.ones_like(ahead)
            fade_out = (ahead.flip(0) / overlap).clamp(max=1) if start < frames - most else torch.ones_like(ahead)
            weight = torch.sin(torch.minimum(fade_in, fade_out) * (math.pi / 2))[:, None] ** 2
            total[:, start : start + most] += weight * predict(x[:, start : start + most], t)
            weights[start : start + most] += weight
        return total / weights

    return whole


def inpainting(known: Tensor, where: Tensor) -> Inpaint:
    """Puts what is known in the place of what was predicted, at every step (paper 1, eq. 8).

    known: clean features [F, D] or [B, F, D]. where: bool that broadcasts against them, see `feature_mask`.

    >>> inpainting(torch.zeros(2, 3), torch.tensor([True, False, False]))(torch.ones(1, 2, 3))[0, 0]
    tensor([0., 1., 1.])
    """
    return lambda x0: torch.where(where.to(x0.device), known.to(x0), x0)


def feature_mask(layout: Layout, *names: str) -> Tensor:
    """Which numbers of a pose have one of these names, bool [D]: a part ("root") or a component of it.

    Paper 1 (eq. 8) keeps `named(layout, "root x velocity", "root z velocity")`. A component is written as
    `layout.describe` writes it, from its start on. Raises MotionKitError if nothing has a name.

    >>> import motionkit as mk
    >>> layout = mk.features.FacingFree(mk.skeleton.smpl(), 30)
    >>> feature_mask(layout, "root x velocity", "root z velocity").nonzero().flatten().tolist()
    [1, 2]
    """
    words = [layout.describe(n) for n in range(layout.size)]
    found = torch.zeros(layout.size, dtype=torch.bool)
    for name in names:
        hits = torch.tensor([f"{w} ".startswith(f"{name} ") for w in words])
        if not bool(hits.any()):
            raise MotionKitError(
                f"no number of {type(layout).__name__} is called {name!r}; the first are {words[:4]}, and its parts "
                f"are {', '.join(layout.slices)}"
            )
        found |= hits
    return found


PAPER_SCHEDULE = NoiseSchedule.cosine(1000)  # whose steps paper 1's G, K and S are
PAPER_G, PAPER_K, PAPER_S = 950, 300, 20  # G, K and S (paper 1, section 4)


@dataclass(frozen=True)
class PartialDiffusion:
    """The few steps between a motion and its noised self (paper 1, eq. 9 and section 4: K = 300, S = 20).

    schedule: of the prior. timesteps: its steps, noisiest first.

    >>> PartialDiffusion.from_paper(PAPER_SCHEDULE).timesteps
    (300, 250, 200, 150, 100, 50)
    >>> PartialDiffusion.from_paper(PAPER_SCHEDULE.snr_shift(6)).timesteps
    (48, 38, 29, 20, 12, 5)
    """

    schedule: NoiseSchedule
    timesteps: tuple[int, ...]

    @classmethod
    def from_paper(cls, schedule: NoiseSchedule, K: int = PAPER_K, S: int = PAPER_S) -> PartialDiffusion:
        """Starts with the noise of step K of 1000, S steps in all (paper 1, section 4).

        Steps of another schedule are those with the same noise (`NoiseSchedule.matching_step`). Raises MotionKitError
        for numbers out of range.
        """
        paper = timesteps(PAPER_SCHEDULE, S, K)
        steps = [schedule.matching_step(step, PAPER_SCHEDULE) for step in paper]
        return cls(schedule, tuple(dict.fromkeys(steps)))

    def forward(self, predict: Denoise, x: Tensor) -> Tensor:
        """Clean x [B, F, D] to its noised self, m_K: deterministic DDIM forwards (paper 1, section 4)."""
        return ddim_invert(predict, x, self.schedule, self.timesteps)

    def reverse(self, predict: Denoise, noised: Tensor) -> Tensor:
        """The predictions of the clean motion on the way back, [N, B, F, D], the last one last (paper 1, eq. 9).

        Gradients go through all steps. Step 0, where DDIM ends, is the last prediction itself.

        >>> partial = PartialDiffusion.from_paper(PAPER_SCHEDULE)
        >>> partial.reverse(lambda x, t: torch.full_like(x, 3.0), torch.randn(1, 4, 2)).shape
        torch.Size([6, 1, 4, 2])
        """
        predictions: list[Tensor] = []
        ddim(predict, noised, self.schedule, self.timesteps, callback=lambda s, x, x0: predictions.append(x0))
        return torch.stack(predictions)


def reconstruction_loss(predictions: Tensor, style: Tensor) -> Tensor:
    """How far the predictions of every step of the chain are from the style example (paper 1, eq. 10); mean of squares.

    predictions: [N, B, F, D], of `PartialDiffusion.reverse` from the noised neutral motion. style: [B, F, D].

    >>> reconstruction_loss(torch.zeros(6, 1, 4, 2), torch.full((1, 4, 2), 2.0))
    tensor(4.)
    """
    return ((predictions - style) ** 2).mean()


def total_loss(example: Tensor, meaning: Tensor, weights: Sequence[float] = (1.0, 0.1)) -> Tensor:
    """Both losses together, lambda_sr L_sr + lambda_s L_s (paper 1, eq. 12; 1 and 0.1 in section 4).

    example: of `reconstruction_loss`. meaning: of `layers.semantic_loss` (eq. 11).

    >>> total_loss(torch.tensor(2.0), torch.tensor(0.5))
    tensor(2.0500)
    """
    return weights[0] * example + weights[1] * meaning
