"""One training loop for everything that learns here: it shows progress, and a run broken off goes on where it was."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor, nn
from tqdm.auto import tqdm

from .checkpoints import load_into
from .errors import MotionKitError
from .files import write_atomic


@dataclass(frozen=True)
class Schedule:
    """How long and how fast: AdamW whose rate rises for a tenth of the steps, then falls as a cosine.

    steps: batches. rate: the highest. decay: of the weights. clip: the longest gradient. seed: says every batch.
    """

    steps: int
    rate: float = 2e-3
    decay: float = 1e-3
    clip: float = 1.0
    seed: int = 0

    def rate_at(self, step: int) -> float:
        """The learning rate of a step, from 0.

        >>> [round(Schedule(100, rate=1.0).rate_at(n), 2) for n in (0, 9, 54, 99)]
        [0.1, 1.0, 0.5, 0.0]
        """
        warm = max(self.steps // 10, 1)
        if step < warm:
            return self.rate * (step + 1) / warm
        return self.rate * 0.5 * (1 + math.cos(math.pi * (step - warm + 1) / max(self.steps - warm, 1)))


def fit(
    model: nn.Module,
    loss_of: Callable[[int], Tensor],
    schedule: Schedule,
    *,
    keep: str | os.PathLike | None = None,
    every: float = 30.0,
    title: str = "training",
    show: Callable[[int, float], object] | None = None,
) -> list[float]:
    """Train a model in place; returns the loss of every step.

    loss_of: the loss of step n. torch's random numbers are seeded anew for every step, so a resumed run gives the
    losses of an unbroken one. keep: a file for the state of the run, written every `every` seconds; if it is there
    already, the run goes on from it; it is removed at the end. show: called after each step with its number and loss.
    Raises MotionKitError for a loss that is not finite (what was kept is of before), or a kept state of another model.

    >>> line = nn.Linear(1, 1)
    >>> losses = fit(line, lambda n: ((line(torch.ones(4, 1)) - 3) ** 2).mean(), Schedule(200, rate=0.1), title="")
    >>> bool(losses[-1] < 1e-3 * losses[0])
    True
    """
    optimizer = torch.optim.AdamW(model.parameters(), schedule.rate, weight_decay=schedule.decay)
    kept = Path(keep) if keep is not None else None
    losses = _resume(kept, model, optimizer, schedule) if kept is not None and kept.exists() else []
    saved, first = time.monotonic(), len(losses)
    model.train()
    for step in (steps := tqdm(range(first, schedule.steps), title, schedule.steps, initial=first, disable=not title)):
        losses.append(_step(model, loss_of, optimizer, schedule, step))
        if show is not None:
            show(step, losses[-1])
        steps.set_postfix(loss=f"{losses[-1]:.3f}", refresh=False)
        if kept is not None and time.monotonic() - saved > every:
            _keep(kept, model, optimizer, schedule, losses)
            saved = time.monotonic()
    if kept is not None:
        kept.unlink(missing_ok=True)
    model.eval()
    return losses


def _step(
    model: nn.Module, loss_of: Callable[[int], Tensor], optimizer: torch.optim.AdamW, schedule: Schedule, step: int
) -> float:
    torch.manual_seed(schedule.seed * 1_000_003 + step)
    for group in optimizer.param_groups:
        group["lr"] = schedule.rate_at(step)
    optimizer.zero_grad()
    loss = loss_of(step)
    if not torch.isfinite(loss):
        raise MotionKitError(
            f"training: the loss of step {step} is {loss.item()}; look at that batch, or take a smaller rate"
        )
    loss.backward()
    nn.utils.clip_grad_norm_(model.parameters(), schedule.clip)
    optimizer.step()
    return loss.item()


def _keep(path: Path, model: nn.Module, optimizer: torch.optim.AdamW, schedule: Schedule, losses: list[float]) -> None:
    tensors = {f"model.{name}": value.contiguous() for name, value in model.state_dict().items()}
    for number, values in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": value.contiguous() for name, value in values.items()}
    tensors["losses"] = torch.tensor(losses, dtype=torch.float64)
    write_atomic(path, tensors_as_bytes(tensors, _begun(schedule)))


def _resume(path: Path, model: nn.Module, optimizer: torch.optim.AdamW, schedule: Schedule) -> list[float]:
    try:
        with safe_open(path, "pt") as file:
            tensors, same = {name: file.get_tensor(name) for name in file.keys()}, file.metadata() == _begun(schedule)  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise MotionKitError(f"{path}: the kept run cannot be read ({error}); remove it to start again") from None
    if not same:
        raise MotionKitError(f"{path}: this run was begun with another schedule; remove it to start again")
    weights = {k.removeprefix("model."): v for k, v in tensors.items() if k.startswith("model.")}
    load_into(model, weights, path)
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        if key.startswith("optimizer."):
            _, number, name = key.split(".", 2)
            state.setdefault(int(number), {})[name] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    return tensors["losses"].tolist()


def _begun(schedule: Schedule) -> dict[str, str]:
    return {"schedule": repr(schedule)}
