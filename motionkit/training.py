"""One training loop for everything that learns here: it shows progress, and a run broken off goes on where it was.

It stands on `accelerate`, so the same call trains on a CPU, a GPU, several of them and several machines
(`accelerate launch -m motionkit train ...`).
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import torch
from accelerate import Accelerator
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel
from tqdm.auto import tqdm

from . import kept_runs
from .errors import MotionKitError


@dataclass(frozen=True)
class Schedule:
    """How long and how fast: AdamW whose rate rises for a tenth of the steps, then falls as a cosine.

    steps: batches. rate: the highest. decay: of the weights. clip: the longest gradient. seed: says every batch.
    average: how much of the running mean of the weights stays at each step (EMA), such as 0.999; the trained model gets
    that mean. 0 is none.
    """

    steps: int
    rate: float = 2e-3
    decay: float = 1e-3
    clip: float = 1.0
    seed: int = 0
    average: float = 0.0

    def rate_at(self, step: int) -> float:
        """The learning rate of a step, from 0.

        >>> [round(Schedule(100, rate=1.0).rate_at(n), 2) for n in (0, 9, 54, 99)]
        [0.1, 1.0, 0.5, 0.0]
        """
        warm = max(self.steps // 10, 1)
        if step < warm:
            return self.rate * (step + 1) / warm
        return self.rate * 0.5 * (1 + math.cos(math.pi * (step - warm + 1) / max(self.steps - warm, 1)))


@dataclass
class Run:
    """What a training left behind: the loss of every step, and the seconds it took, all its parts together."""

    losses: list[float] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def steps_per_second(self) -> float:
        """How fast it went."""
        return len(self.losses) / max(self.seconds, 1e-9)


@dataclass(eq=False)
class _Learner:
    """The parts of a run: the model as accelerate wraps it, its optimizer and its running mean."""

    accelerator: Accelerator
    model: nn.Module
    optimizer: torch.optim.Optimizer
    mean: AveragedModel | None

    @classmethod
    def of(cls, model: nn.Module, schedule: Schedule) -> _Learner:
        """On the device that there is; mixed precision (bfloat16) on a GPU."""
        accelerator = Accelerator(mixed_precision="bf16" if torch.cuda.is_available() else "no")
        optimizer = torch.optim.AdamW(model.parameters(), schedule.rate, weight_decay=schedule.decay)
        wrapped, optimizer = accelerator.prepare(model, optimizer)

        def keep_some(means: list[Tensor], now: list[Tensor], count: Tensor) -> None:
            n = int(count)  # the first steps count for less, or the mean would remember the beginning
            torch._foreach_lerp_(means, now, 1 - min(schedule.average, (1 + n) / (10 + n)))

        mean = AveragedModel(model, multi_avg_fn=keep_some) if schedule.average else None
        return cls(accelerator, wrapped, optimizer, mean)

    @property
    def bare(self) -> nn.Module:
        """The model itself."""
        return self.accelerator.unwrap_model(self.model)

    @property
    def raw_optimizer(self) -> torch.optim.Optimizer:
        """Torch's optimizer."""
        return getattr(self.optimizer, "optimizer", self.optimizer)


def fit(
    model: nn.Module,
    loss_of: Callable[[nn.Module, int], Tensor],
    schedule: Schedule,
    *,
    keep: str | os.PathLike | None = None,
    every: float = 30.0,
    title: str = "training",
    show: Callable[[int, float], object] | None = None,
    batch_of: Callable[[int], str] | None = None,
) -> Run:
    """Train a model in place; returns its `Run`. What is on a GPU while it trains comes back to where it was.

    loss_of: the loss of step n, of the model that it is given (call that one: several processes find each other's
    gradients through it). torch's random numbers are seeded anew for every step and process, so a resumed run gives the
    losses of an unbroken one, and n processes see n batches a step. keep: a file for the state of the run, written
    every `every` seconds; if it is there already, the run goes on from it; it is removed at the end. show: called after
    each step with its number and loss. batch_of: says what is in the batch of a step, for messages. Raises
    MotionKitError for a loss or gradient that is not finite (the state before that step is kept), or a kept state of
    another model.

    >>> line = nn.Linear(1, 1)
    >>> def miss(model, step):
    ...     return ((model(torch.ones(4, 1)) - 3) ** 2).mean()
    >>> run = fit(line, miss, Schedule(200, rate=0.1), title="")
    >>> len(run.losses), bool(run.losses[-1] < 1e-3 * run.losses[0])
    (200, True)
    """
    home = next(model.parameters()).device
    learner, kept, run = _Learner.of(model, schedule), Path(keep) if keep is not None else None, Run()
    if kept is not None and kept.exists():
        run.losses, run.seconds = kept_runs.read(kept, learner.bare, learner.raw_optimizer, learner.mean, schedule)
    learner.model.train()
    try:
        _go(learner, loss_of, schedule, run, kept, every, title, show, batch_of)
    finally:
        model.to(home)
    if learner.mean is not None:
        model.load_state_dict(learner.mean.module.state_dict())
    if kept is not None and learner.accelerator.is_main_process:
        kept.unlink(missing_ok=True)
    model.eval()
    return run


def _go(learner, loss_of, schedule, run, kept, every, title, show, batch_of) -> None:
    """All steps that are left; keeps the state now and then, and before it stops at a loss that is not finite."""
    main, first, saved, before = learner.accelerator.is_main_process, len(run.losses), time.monotonic(), run.seconds
    begun = saved

    def keep_now() -> None:
        if kept is not None and main:
            kept_runs.write(kept, learner.bare, learner.raw_optimizer, learner.mean, schedule, run.losses, run.seconds)

    quiet = not title or not main
    for step in (steps := tqdm(range(first, schedule.steps), title, schedule.steps, initial=first, disable=quiet)):
        try:
            run.losses.append(_step(learner, loss_of, schedule, step))
        except FloatingPointError as error:
            keep_now()
            raise MotionKitError(_not_finite(step, schedule, str(error), batch_of, kept)) from None
        run.seconds = before + time.monotonic() - begun
        steps.set_postfix(loss=f"{run.losses[-1]:.3f}", refresh=False)
        if show is not None and main:
            show(step, run.losses[-1])
        if time.monotonic() - saved > every:
            keep_now()
            saved = time.monotonic()


def _step(learner: _Learner, loss_of: Callable, schedule: Schedule, step: int) -> float:
    """One step of the optimizer; the mean loss of all processes. FloatingPointError before any harm is done."""
    seed_batch(schedule, step, learner.accelerator.process_index)
    for group in learner.optimizer.param_groups:
        group["lr"] = schedule.rate_at(step)
    learner.optimizer.zero_grad()
    with learner.accelerator.autocast():
        loss = loss_of(learner.model, step)
    learner.accelerator.backward(loss)
    length = nn.utils.clip_grad_norm_(learner.model.parameters(), schedule.clip)
    everyone = learner.accelerator.reduce(torch.stack((loss.detach().float(), length.detach().float())), "mean")
    value, length = everyone.tolist()
    if not math.isfinite(value) or not math.isfinite(length):
        raise FloatingPointError(f"the loss of step {step} is {value}, the length of its gradient {length}")
    learner.optimizer.step()
    if learner.mean is not None:
        learner.mean.update_parameters(learner.bare)
    return value


def _not_finite(step: int, schedule: Schedule, what: str, batch_of: Callable | None, kept: Path | None) -> str:
    batch = f"; its batch: {batch_of(step)}" if batch_of is not None else f"; its batch is that of seed {schedule.seed}"
    state = f"; the state before that step is in {kept}" if kept is not None else ""
    return f"training: {what}{batch}{state}. Look for bad numbers in those clips, or take a smaller rate"


def seed_batch(schedule: Schedule, step: int, rank: int = 0) -> None:
    """Seed torch's random numbers as `fit` does before step n of a process, to draw that batch again."""
    torch.manual_seed(schedule.seed * 1_000_003 + step + rank * 2_038_074_743)


def device_of(model: nn.Module) -> torch.device:
    """Where a model's weights are, and so where its batches must be."""
    return next(model.parameters()).device
