"""The state of a training that was broken off, in one file: written whole or not at all, read back exactly."""

from __future__ import annotations

import glob
import hashlib
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import torch
from accelerate import Accelerator, PartialState
from accelerate.utils import broadcast, parse_flag_from_env
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel
from tqdm.auto import tqdm

from . import checkpoints
from .checkpoints import load_into
from .datasets import Dataset
from .errors import MotionKitError
from .files import write_atomic


def write_run_state(
    path: Path,
    model: nn.Module,
    optimizer: torch.optim.Optimizer,
    mean: nn.Module | None,
    schedule: object,
    losses: list[float],
    seconds: float,
) -> None:
    """Everything that `read_run_state` needs to go on as if nothing had happened."""
    tensors = {f"model.{name}": value for name, value in model.state_dict().items()}
    for number, values in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": value for name, value in values.items()}
    if mean is not None:
        tensors |= {f"mean.{name}": value for name, value in mean.state_dict().items()}
    tensors |= {
        "losses": torch.tensor(losses, dtype=torch.float64),
        "seconds": torch.tensor(seconds, dtype=torch.float64),
    }
    plain = {name: value.detach().cpu().clone().contiguous() for name, value in tensors.items()}
    write_atomic(path, tensors_as_bytes(plain, _begun(schedule)))


def read_run_state(
    path: Path, model: nn.Module, optimizer: torch.optim.Optimizer, mean: nn.Module | None, schedule: object
) -> tuple[list[float], float]:
    """Puts a kept state back in place; returns the losses so far and the seconds they took.

    Raises MotionKitError if the file is damaged, or is of another schedule, recipe or model.
    """
    try:
        with safe_open(path, "pt") as file:
            tensors, same = {name: file.get_tensor(name) for name in file.keys()}, file.metadata() == _begun(schedule)  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise MotionKitError(f"{path}: the kept run cannot be read ({error}); remove it to start again") from None
    if not same:
        raise MotionKitError(f"{path}: this run was begun with another schedule or recipe; remove it to start again")
    load_into(model, _part(tensors, "model."), path)
    if mean is not None:
        load_into(mean, _part(tensors, "mean."), path)
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in _part(tensors, "optimizer.").items():
        number, name = key.split(".", 1)
        state.setdefault(int(number), {})[name] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    return tensors["losses"].tolist(), float(tensors["seconds"])


def remove_run_state(path: Path) -> None:
    """The file, and what was left of it where a process was killed while it wrote."""
    path.unlink(missing_ok=True)
    for left in path.parent.glob(f".{glob.escape(path.name[:40])}.*"):
        left.unlink(missing_ok=True)


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def _begun(schedule: object) -> dict[str, str]:
    return {"schedule": repr(schedule)}


@dataclass(frozen=True)
class TrainConfig:
    """How long and how fast: AdamW whose rate rises for a tenth of the steps, then falls as a cosine.

    steps: batches. rate: the highest. decay: of the weights. clip: the longest gradient. seed: says every batch.
    average: how much of the running mean of the weights stays at each step (EMA), such as 0.999; the trained model gets
    that mean. 0 is none. recipe: what else is to be the same where a kept run goes on, such as a recipe. Raises
    MotionKitError for numbers out of range.
    """

    steps: int
    rate: float = 2e-3
    decay: float = 1e-3
    clip: float = 1.0
    seed: int = 0
    average: float = 0.0
    recipe: str = ""

    def __post_init__(self) -> None:
        if not (self.steps >= 1 and self.rate > 0 and self.clip > 0 and 0 <= self.average < 1):
            raise MotionKitError(
                f"a schedule has at least 1 step, a rate and a clip above 0, and an average from 0 to below 1; "
                f"found {self}"
            )

    def rate_at(self, step: int) -> float:
        """The learning rate of a step, from 0.

        >>> [round(TrainConfig(100, rate=1.0).rate_at(n), 2) for n in (0, 9, 54, 99)]
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
    """The parts of a run: the model as accelerate wraps it, its optimizer, its running mean, the file of its state."""

    accelerator: Accelerator
    model: nn.Module
    optimizer: torch.optim.Optimizer
    mean: AveragedModel | None
    schedule: TrainConfig
    kept: Path | None
    whole: bool = True  # false while a step changes the weights
    undo: list[Tensor] = field(default_factory=list)  # the buffers before a step, which its forward pass changes

    @classmethod
    def of(cls, model: nn.Module, schedule: TrainConfig, kept: Path | None) -> _Learner:
        """On the device that there is; mixed precision (bfloat16) on a GPU."""
        cpu = _on_cpu()
        accelerator = Accelerator(mixed_precision="no" if cpu or not torch.cuda.is_available() else "bf16", cpu=cpu)
        groups = getattr(model, "parameter_groups", model.parameters)()
        optimizer = torch.optim.AdamW(groups, schedule.rate, weight_decay=schedule.decay)
        wrapped, optimizer = accelerator.prepare(model, optimizer)

        def keep_some(means: list[Tensor], now: list[Tensor], count: Tensor) -> None:
            n = int(count)  # the first steps count for less, or the mean would remember the beginning
            torch._foreach_lerp_(means, now, 1 - min(schedule.average, (1 + n) / (10 + n)))

        mean = AveragedModel(model, multi_avg_fn=keep_some) if schedule.average else None
        return cls(accelerator, wrapped, optimizer, mean, schedule, kept)

    @property
    def main(self) -> bool:
        """Whether this process is the one that writes and shows."""
        return self.accelerator.is_main_process

    @cached_property
    def bare(self) -> nn.Module:
        """The model itself."""
        return self.accelerator.unwrap_model(self.model)

    @property
    def raw_optimizer(self) -> torch.optim.Optimizer:
        """Torch's optimizer."""
        return getattr(self.optimizer, "optimizer", self.optimizer)

    @cached_property
    def buffer_names(self) -> list[str]:
        """What the state holds beside parameters, such as the running means of a batch norm."""
        kept = self.bare.state_dict().keys()
        return [name for name, _ in self.bare.named_buffers() if name in kept]

    def buffers(self) -> list[Tensor]:
        """The numbers of these, as they are now."""
        return [self.bare.get_buffer(name) for name in self.buffer_names]

    def resume(self) -> Run:
        """The run so far, its state put back; all processes must have found the same."""
        run = Run()
        if self.kept is not None and self.kept.exists():
            found = read_run_state(self.kept, self.bare, self.raw_optimizer, self.mean, self.schedule)
            run = Run(*found)
        steps = torch.tensor([len(run.losses)], device=self.accelerator.device)
        if len(set(self.accelerator.gather(steps).tolist())) > 1:
            raise MotionKitError(f"{self.kept}: not all processes find this kept run; put it where all machines see it")
        return run

    def keep(self, run: Run) -> None:
        """Write the state before the present step, if it is whole; the main process does."""
        if self.kept is None or not self.main or not self.whole:
            return
        for value, old in zip(self.buffers(), self.undo):
            value.copy_(old)
        write_run_state(self.kept, self.bare, self.raw_optimizer, self.mean, self.schedule, run.losses, run.seconds)

    def finish(self) -> None:
        """The mean into the model, the same numbers in all processes, and no file left."""
        if self.mean is not None:
            self.bare.load_state_dict(self.mean.module.state_dict())
        for value in self.buffers():
            broadcast(value)
        if self.kept is not None and self.main:
            remove_run_state(self.kept)
        self.accelerator.wait_for_everyone()


def fit(
    model: nn.Module,
    loss_fn: Callable[[nn.Module, int], Tensor],
    schedule: TrainConfig,
    *,
    keep: str | os.PathLike | None = None,
    every: float = 30.0,
    title: str = "training",
    show: Callable[[int, float], object] | None = None,
    batch_of: Callable[[int], str] | None = None,
) -> Run:
    """Train a model in place; returns its `Run`. What is on a GPU while it trains comes back to where it was.

    model: its `parameter_groups()`, if any, says what is trained, each with its `share` of the rate. loss_fn: the loss
    of step n, of the model that it is given (call that one: several processes find each other's gradients through it).
    torch's random numbers are seeded anew for every step and process, so a resumed run gives the losses of an unbroken
    one, and n processes see n batches a step. keep: a file for the state of the run, written every `every` seconds; if
    it is there already, the run goes on from it; it is removed at the end. show: called after each step with its number
    and loss. batch_of: says what is in the batch of a step, for messages. Raises MotionKitError for a loss or gradient
    that is not finite (the state before that step is kept, as when Ctrl-C stops it), or a kept state of another model.

    >>> line = nn.Linear(1, 1)
    >>> def miss(model, step):
    ...     return ((model(torch.ones(4, 1)) - 3) ** 2).mean()
    >>> run = fit(line, miss, TrainConfig(200, rate=0.1), title="")
    >>> len(run.losses), bool(run.losses[-1] < 1e-3 * run.losses[0])
    (200, True)
    """
    home, kept = device_of(model), Path(keep) if keep is not None else None
    learner = _Learner.of(model, schedule, kept)
    try:
        run = learner.resume()
        learner.model.train()
        _go(learner, loss_fn, run, every, title, show, batch_of)
        learner.finish()
    finally:
        learner.accelerator.unwrap_model(learner.model, keep_fp32_wrapper=False)  # or it would go on in mixed precision
        model.to(home).eval()
    return run


def _go(learner, loss_fn, run, every, title, show, batch_of) -> None:
    """All steps that are left; keeps the state now and then, and where it is stopped."""
    first, total, before = len(run.losses), learner.schedule.steps, run.seconds
    saved = begun = time.monotonic()
    with tqdm(range(first, total), title, total, initial=first, disable=not title or not learner.main) as steps:
        try:
            for step in steps:
                run.losses.append(_step(learner, loss_fn, step))
                learner.undo, learner.whole = [], True
                run.seconds = before + time.monotonic() - begun
                steps.set_postfix(loss=f"{run.losses[-1]:.3f}", refresh=False)
                if show is not None and learner.main:
                    show(step, run.losses[-1])
                if time.monotonic() - saved > every:
                    learner.keep(run)
                    saved = time.monotonic()
        except KeyboardInterrupt:
            learner.keep(run)
            raise
        except _NotFinite as error:
            learner.keep(run)
            raise MotionKitError(_not_finite(learner, step, error, batch_of)) from None


class _NotFinite(Exception):
    """What is not finite, and whether this process's batch may be at fault."""


def _step(learner: _Learner, loss_fn: Callable, step: int) -> float:
    """One step of the optimizer; the mean loss of all processes. _NotFinite before any harm is done to the weights."""
    learner.undo = [value.clone() for value in learner.buffers()]
    seed_batch(learner.schedule, step, learner.accelerator.process_index)
    for group in learner.optimizer.param_groups:
        group["lr"] = learner.schedule.rate_at(step) * group.get("share", 1.0)
    learner.optimizer.zero_grad()
    with learner.accelerator.autocast():
        loss = loss_fn(learner.model, step)
    learner.accelerator.backward(loss)
    length = nn.utils.clip_grad_norm_(learner.model.parameters(), learner.schedule.clip)
    own = torch.stack((loss.detach().float(), length.detach().float()))
    value, length = learner.accelerator.reduce(own.clone(), "mean").tolist()
    if not math.isfinite(value) or not math.isfinite(length):
        what = f"the loss of step {step} is {value}, the length of its gradient {length}"
        raise _NotFinite(what, math.isfinite(value) or not math.isfinite(float(own[0])))
    learner.whole = False
    learner.optimizer.step()
    if learner.mean is not None:
        learner.mean.update_parameters(learner.bare)
    return value


def _not_finite(learner: _Learner, step: int, error: _NotFinite, batch_of: Callable | None) -> str:
    what, here = error.args
    batch = batch_of(step) if batch_of is not None else f"that of seed {learner.schedule.seed}"
    batch = f"; its batch: {batch}" if here else "; its batch is named by another process"
    state = f"; the state before that step is in {learner.kept}" if learner.kept is not None else ""
    return f"training: {what}{batch}{state}. Look for bad numbers in those clips, or take a smaller rate"


def seed_batch(schedule: TrainConfig, step: int, rank: int | None = None) -> None:
    """Seed torch's random numbers as `fit` does before step n of a process (this one if left out), to draw it again."""
    if rank is None:
        rank = torch.distributed.get_rank() if torch.distributed.is_initialized() else 0
    torch.manual_seed(schedule.seed * 1_000_003 + step + rank * 2_038_074_743)


def device_of(model: nn.Module) -> torch.device:
    """Where a model's weights are, and so where its batches must be."""
    return next(model.parameters()).device


def _on_cpu() -> bool:
    """Whether accelerate must be told to stay on the CPU: several processes would not find each other there else."""
    there = (torch.cuda.is_available(), torch.backends.mps.is_available(), torch.xpu.is_available())
    return parse_flag_from_env("ACCELERATE_USE_CPU") or not any(there)


def is_main() -> bool:
    """Whether this process writes and prints: the only one, or the first of those that `accelerate launch` started.

    >>> is_main()
    True
    """
    return PartialState(cpu=_on_cpu()).is_main_process


def main_process_first(write: Callable[[], object]) -> None:
    """Do this in the main process only; the others wait until it is done.

    >>> main_process_first(lambda: print("written"))
    written
    """
    if is_main():
        write()
    PartialState().wait_for_everyone()


# Licences of captures that forbid what MIT allows; weights that learned from them are under the same licence.
LICENCES = {"bandai-1": "CC-BY-NC-4.0", "bandai-2": "CC-BY-NC-4.0"}


def training_card(data: Dataset, schedule: TrainConfig, run: Run, network: nn.Module) -> dict:
    """What every card says of how weights were made from these clips."""
    name = data.name
    return {
        "data": name,
        "data_sha256": data_hash(data),
        "training_clips": len(data),
        "seed": schedule.seed,
        "steps": schedule.steps,
        "seconds": round(run.seconds),
        "steps_per_second": round(run.steps_per_second, 2),
        "hardware": checkpoints.hardware(),
        "parameters": sum(p.numel() for p in network.parameters()),
        "licence": LICENCES.get(name, "MIT"),
    }


def data_hash(dataset: Dataset) -> str:
    """Changes when clips, their labels or their numbers do: 16 hexadecimal digits."""
    clips = (
        f"{dataset.store.clips[n].name} {dataset.store.clips[n].checksum} {dataset.labels[n][:2]}"
        for n in dataset.indices
    )
    return hashlib.sha256("\n".join(clips).encode()).hexdigest()[:16]


def default_path(data: str, what: str) -> Path:
    """Where the weights of a judge go: `NAME-content.safetensors` and so on, in the folder of their licence."""
    folder = checkpoints.folder() / LICENCES.get(data, "").lower()
    os.makedirs(folder, exist_ok=True)
    return folder / f"{data}-{what}.safetensors"
