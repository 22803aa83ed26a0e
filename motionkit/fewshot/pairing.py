"""The neutral motion that goes with a style example, frame by frame: the prior makes it (paper 1, section 3.4)."""

from __future__ import annotations

import torch

from .. import sampling, text
from ..diffusion import add_noise
from ..motion import Motion
from ..priors import Prior
from .chain import NOISE, PAPER_SCHEDULE

KEPT = ("root x velocity", "root z velocity")  # O_hori of paper 1, eq. 8
GUIDANCE = 2.0


@torch.no_grad()
def neutral_pair(
    prior: Prior,
    style: Motion,
    prompt: str,
    *,
    noise: int = NOISE,
    steps: int | None = None,
    scale: float = GUIDANCE,
    seed: int = 0,
    **more,
) -> torch.Tensor:
    """A neutral motion aligned with a style example, as features [F, D] of the prior (paper 1, eqs. 7 and 8).

    The example is noised to step G = `noise` of the paper's 1000, which leaves its timing and little else, and brought
    back by DDPM with its prompt made neutral (`text.to_neutral`); at every step, the root's velocity over the ground is
    that of the example. steps: of the sampler; left out, every one, as in the paper. scale: of guidance. more: what
    `sampling.ddpm` takes beside, such as `callback`. Raises MotionKitError as `Prior.predict` does.
    """
    x = prior.encode(style)[None]
    start = prior.schedule.step_like(noise, PAPER_SCHEDULE)
    chance = torch.Generator().manual_seed(seed)
    noised = add_noise(x, start, prior.schedule, torch.randn(x.shape, generator=chance))
    keep = sampling.inpainting(x[0], sampling.named(prior.layout, *KEPT))
    predict = sampling.windowed(prior.predict([text.to_neutral(prompt)], scale), prior.longest, round(prior.fps))
    return sampling.ddpm(predict, noised, prior.schedule, steps, start, keep, generator=chance, **more)[0]
