"""One training loop for everything that learns here: `fit`, and `fit_adversarial` for a generator and its critic.

Both show progress, and a run that was broken off goes on exactly where it was. They stand on `accelerate`, so the same
call trains on a CPU, a GPU, several of them and several machines: `accelerate launch -m motionkit train ...` on a GPU,
and with `--multi_gpu --num_processes 2` on two. Without a GPU those are two processes on the CPU, as they are anywhere
with ACCELERATE_USE_CPU=true in the environment.
"""

from __future__ import annotations

import glob
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from accelerate import Accelerator, PartialState
from accelerate.utils import broadcast, parse_flag_from_env
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel
from tqdm.auto import tqdm

from .checkpoints import load_into
from .errors import MotionKitError
from .files import write_atomic

Draw = Callable[[int], object]  # the batch of a step: tensors, or a dict, tuple or dataclass of them, on the CPU


@dataclass(frozen=True)
class TrainConfig:
    """How long and how fast: AdamW whose learning rate rises for a tenth of the steps, then falls as a cosine.

    steps: batches. lr: the highest learning rate. weight_decay, grad_clip: as in torch. seed: says every batch. ema:
    how much of the running mean of the weights stays at each step, such as 0.999; the trained model gets that mean; 0
    is none. critic_lr_ratio: a critic's learning rate over that of its generator. signature: what else must be the same
    where a kept run goes on, such as a method's own config. save_every: seconds between two writings of the run's
    state. Raises MotionKitError for numbers out of range.
    """

    steps: int
    lr: float = 2e-3
    weight_decay: float = 1e-3
    grad_clip: float = 1.0
    seed: int = 0
    ema: float = 0.0
    critic_lr_ratio: float = 1.0
    signature: str = ""
    save_every: float = field(default=30.0, repr=False)  # no part of what a kept run must agree in

    def __post_init__(self) -> None:
        if not (self.steps >= 1 and self.lr > 0 and self.grad_clip > 0 and 0 <= self.ema < 1):
            raise MotionKitError(
                "training takes at least 1 step, a learning rate and a gradient clip above 0, and an ema from 0 to "
                f"below 1; found {self}"
            )

    def lr_at(self, step: int) -> float:
        """The learning rate of a step, from 0.

        >>> [round(TrainConfig(100, lr=1.0).lr_at(n), 2) for n in (0, 9, 54, 99)]
        [0.1, 1.0, 0.5, 0.0]
        """
        warm = max(self.steps // 10, 1)
        if step < warm:
            return self.lr * (step + 1) / warm
        return self.lr * 0.5 * (1 + math.cos(math.pi * (step - warm + 1) / max(self.steps - warm, 1)))


@dataclass(frozen=True)
class TrainOrder:
    """What the command line asks of a trainer: a function from a TrainOrder to a `checkpoints.Checkpoint`.

    data: the Dataset. size: "tiny", "laptop" or "paper". steps, lr: left out, the method's own. start: the name of a
    checkpoint to go on from. text: the text encoder. resume: the file of the run's state. title: of the progress bar.
    """

    data: object
    size: str = "laptop"
    steps: int | None = None
    lr: float | None = None
    seed: int = 0
    start: str | None = None
    text: str = "mini"
    resume: Path | None = None
    title: str = "training"

    def config(self, steps: int, lr: float, **more) -> TrainConfig:
        """The method's own numbers, where nothing else was asked for."""
        return TrainConfig(self.steps or steps, self.lr or lr, seed=self.seed, **more)

    @property
    def running(self) -> dict:
        """For `fit`."""
        return {"resume": self.resume, "title": self.title}


@dataclass
class Run:
    """What a training left behind: the loss of every step, and the seconds it took, all its parts together."""

    losses: list[float] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def steps_per_second(self) -> float:
        """How fast it went."""
        return len(self.losses) / max(self.seconds, 1e-9)

    @property
    def last_loss(self) -> float:
        """The mean over the last 200 steps."""
        return sum(self.losses[-200:]) / max(len(self.losses[-200:]), 1)


def fit(
    model: nn.Module,
    draw: Draw,
    loss_fn: Callable[[nn.Module, object], Tensor],
    config: TrainConfig,
    *,
    resume: str | os.PathLike | None = None,
    title: str = "training",
    callback: Callable[[int, float], object] | None = None,
) -> Run:
    """Train a model in place; returns its `Run`. What is on a GPU while it trains comes back to where it was.

    draw: gives the batch of step n, on the CPU. loss_fn: the loss of the model that it is given on a batch (call that
    model: several processes find each other's gradients through it); where it is a module, such as one that holds a
    frozen network, it is moved as well. torch's random numbers are seeded anew for every step and process, so a resumed
    run gives the losses of an unbroken one, and n processes see n batches a step. resume: a file for the state of the
    run; if it is there already, the run goes on from it; it is removed at the end. callback: called after each step
    with its number and loss. Raises MotionKitError for a loss or gradient that is not finite (naming the clips of its
    batch where `batch.names` or `batch["names"]` says them; the state before that step is kept, as when Ctrl-C stops
    it), and for a kept state of another model.

    >>> line = nn.Linear(1, 1)
    >>> def draw(step):
    ...     return torch.ones(4, 1)
    >>> def loss_fn(model, x):
    ...     return ((model(x) - 3) ** 2).mean()
    >>> run = fit(line, draw, loss_fn, TrainConfig(200, lr=0.1), title="")
    >>> len(run.losses), bool(run.losses[-1] < 1e-3 * run.losses[0])
    (200, True)
    """
    with _Training((model,), (loss_fn,), config, resume, title, callback) as training:
        (model,) = training.models
        for step in training.steps():
            batch = training.batch(draw, step)
            with training.autocast():
                loss = loss_fn(model, batch)
            training.backward(loss)
            training.update()
    return training.run


def fit_adversarial(
    models: tuple[nn.Module, nn.Module],
    draw: Draw,
    losses: tuple[Callable, Callable],
    config: TrainConfig,
    *,
    resume: str | os.PathLike | None = None,
    title: str = "training",
    callback: Callable[[int, float], object] | None = None,
) -> Run:
    """Train a generator against its critic, each with an optimizer of its own; as `fit`.

    models: the generator and its critic. losses: of each. The first, (generator, critic, batch), gives the generator's
    loss, and what it generated as a tensor or a tuple of tensors; the critic's weights get no gradient from it. The
    second, (critic, generated, batch), gives the critic's loss, through which no gradient reaches the generator. Both
    are updated together. The run's losses are the sums of both.

    >>> generator, critic = nn.Linear(1, 1), nn.Linear(1, 1)
    >>> def generator_loss(generator, critic, real):
    ...     fake = generator(torch.rand(8, 1))
    ...     return -critic(fake).mean(), fake
    >>> def critic_loss(critic, fake, real):
    ...     return critic(fake).mean() - critic(real).mean()
    >>> models, losses = (generator, critic), (generator_loss, critic_loss)
    >>> run = fit_adversarial(models, lambda step: 3 + torch.rand(8, 1), losses, TrainConfig(20), title="")
    >>> len(run.losses)
    20
    """
    generator_loss, critic_loss = losses
    with _Training(models, losses, config, resume, title, callback) as training:
        generator, critic = training.models
        for step in training.steps():
            batch = training.batch(draw, step)
            with _without_gradients(critic):
                with training.autocast():
                    loss, generated = generator_loss(generator, critic, batch)
                training.backward(loss, 0)
            with training.autocast():
                loss = critic_loss(critic, _detached(generated), batch)
            training.backward(loss, 1)
            training.update()
    return training.run


@contextmanager
def _without_gradients(model: nn.Module) -> Iterator[None]:
    """A model whose weights get none; afterwards those that were trained are so again, whatever happened."""
    trained = [weight for weight in model.parameters() if weight.requires_grad]
    for weight in trained:
        weight.requires_grad_(False)
    try:
        yield
    finally:
        for weight in trained:
            weight.requires_grad_(True)


def _detached(generated: object) -> object:
    return generated.detach() if isinstance(generated, Tensor) else tuple(map(_detached, generated))


def to_device(batch: object, device: torch.device | str) -> object:
    """A batch with all its tensors on a device: the one place where data move.

    Tensors in dicts, lists, tuples and dataclasses are found; what has a `to` of its own, such as `datasets.Batch`,
    goes by that; anything else stays as it is.

    >>> to_device({"x": torch.ones(2), "names": ["walk"]}, "cpu")
    {'x': tensor([1., 1.]), 'names': ['walk']}
    """
    if hasattr(batch, "to"):
        return batch.to(device)
    if isinstance(batch, Mapping):
        return {name: to_device(value, device) for name, value in batch.items()}
    if isinstance(batch, tuple) and hasattr(batch, "_fields"):
        return type(batch)(*(to_device(value, device) for value in batch))
    if isinstance(batch, list | tuple):
        return type(batch)(to_device(value, device) for value in batch)
    if hasattr(batch, "__dataclass_fields__"):
        fields = {name: to_device(getattr(batch, name), device) for name in batch.__dataclass_fields__}
        return replace(batch, **fields)
    return batch


class _NotFinite(Exception):
    """What is not finite, and whether this process's batch may be at fault."""


class _Training:
    """The models of a run with their optimizers, as `accelerate` wraps them, and the state that makes it resumable."""

    def __init__(self, models, losses, config, resume, title, callback) -> None:
        self.config, self.title, self.callback = config, title, callback
        self.file = Path(resume) if resume is not None else None
        self.run, self._batch = Run(), None
        self._whole, self._undo = True, []  # whether no step is half done; the buffers before the present step
        self._own, self._homes = models, [device_of(model) for model in models]
        owners = [getattr(loss, "__self__", loss) for loss in losses]  # of a module, or of a method of one
        self._frozen = [owner for owner in owners if isinstance(owner, nn.Module)]
        cpu = _on_cpu()
        precision = "no" if cpu or not torch.cuda.is_available() else "bf16"
        self._accelerator = Accelerator(mixed_precision=precision, cpu=cpu)
        self.autocast = self._accelerator.autocast
        self.models, self._optimizers, self._means = [], [], []
        for model in models:
            trained = [weight for weight in model.parameters() if weight.requires_grad]
            optimizer = torch.optim.AdamW(trained, config.lr, weight_decay=config.weight_decay)
            # "evaluation": without torch's DistributedDataParallel, through which a loss cannot call a model's methods
            self.models.append(self._accelerator.prepare_model(model, evaluation_mode=True))
            self._optimizers.append(self._accelerator.prepare_optimizer(optimizer))
            self._means.append(_running_mean(model, config.ema) if config.ema else None)
        self._values: list[float] = []
        self._kept_buffers: list[Tensor] | None = None

    # -- the steps ---------------------------------------------------------------------------------------------------

    def __enter__(self) -> _Training:
        for part in self._frozen:
            part.to(self._accelerator.device)
        for model in self.models:
            for value in (*model.parameters(), *model.buffers()):
                broadcast(value.data)
        if self.file is not None and self.file.exists():
            self._read()
        steps = torch.tensor([len(self.run.losses)], device=self._accelerator.device)
        if len(set(self._accelerator.gather(steps).tolist())) > 1:
            raise MotionKitError(f"{self.file}: not all processes find this kept run; put it where all machines see it")
        for model in self.models:
            model.train()
        return self

    def steps(self) -> Iterator[int]:
        """The numbers of the steps that are left; writes the state of the run now and then."""
        first, total, before = len(self.run.losses), self.config.steps, self.run.seconds
        saved = begun = time.monotonic()
        hidden = not self.title or not self._main
        with tqdm(range(first, total), self.title, total, initial=first, disable=hidden) as bar:
            for step in bar:
                yield step
                self.run.seconds = before + time.monotonic() - begun
                bar.set_postfix(loss=f"{self.run.losses[-1]:.3f}", refresh=False)
                if self.callback is not None and self._main:
                    self.callback(step, self.run.losses[-1])
                if time.monotonic() - saved > self.config.save_every:
                    self._write()
                    saved = time.monotonic()

    def batch(self, draw: Draw, step: int) -> object:
        """The batch of a step, on the device that the models are on."""
        self._undo = [value.clone() for value in self._buffers()]
        self._values = []
        seed_batch(self.config, step, self._accelerator.process_index)
        self._batch = draw(step)
        for n, optimizer in enumerate(self._optimizers):
            for group in optimizer.param_groups:
                group["lr"] = self.config.lr_at(step) * (self.config.critic_lr_ratio if n else 1.0)
        return to_device(self._batch, self._accelerator.device)

    def backward(self, loss: Tensor, n: int = 0) -> None:
        """The gradients of a loss in the weights of model n; _NotFinite before any harm is done to them."""
        self._optimizers[n].zero_grad()
        self._accelerator.backward(loss)
        self._average([weight for weight in self.models[n].parameters() if weight.requires_grad])
        norm = nn.utils.clip_grad_norm_(self.models[n].parameters(), self.config.grad_clip)
        own = torch.stack((loss.detach().float(), norm.detach().float()))
        value, norm = self._accelerator.reduce(own.clone(), "mean").tolist()
        if not math.isfinite(value) or not math.isfinite(norm):
            what = f"the loss of step {len(self.run.losses)} is {value}, the norm of its gradient {norm}"
            raise _NotFinite(what, math.isfinite(value) or not math.isfinite(float(own[0])))
        self._values.append(value)

    def _average(self, weights: list[Tensor]) -> None:
        """The mean of the gradients of all processes; None where no process has one."""
        if self._accelerator.num_processes == 1:
            return
        there = torch.tensor([weight.grad is not None for weight in weights], device=self._accelerator.device)
        for weight, anywhere in zip(weights, self._accelerator.reduce(there.float(), "sum").tolist()):
            if anywhere:
                own = torch.zeros_like(weight) if weight.grad is None else weight.grad
                weight.grad = self._accelerator.reduce(own, "mean")

    def update(self) -> None:
        """One step of every optimizer, by the gradients that `backward` left."""
        self._whole = False
        for n, optimizer in enumerate(self._optimizers):
            optimizer.step()
            if self._means[n] is not None:
                self._means[n].update_parameters(self._bare(n))
        self.run.losses.append(sum(self._values))
        self._undo, self._whole = [], True

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        try:
            if kind is None:
                self._finish()
            elif issubclass(kind, KeyboardInterrupt | _NotFinite):
                self._write()
        finally:
            for model, own, home in zip(self.models, self._own, self._homes):
                self._accelerator.unwrap_model(model, keep_fp32_wrapper=False)  # or it would stay in mixed precision
                own.to(home).eval()
                vars(own).pop("_is_accelerate_prepared", None)  # or a second training would leave it where it is
            for part in self._frozen:
                part.to(self._homes[0])
        if kind is not None and issubclass(kind, _NotFinite):
            raise MotionKitError(self._not_finite(error)) from None

    def _finish(self) -> None:
        """The running means into the models, the same numbers in all processes, and no file left."""
        for n, mean in enumerate(self._means):
            if mean is not None:
                self._bare(n).load_state_dict(mean.module.state_dict())
        for value in self._buffers():
            broadcast(value)
        if self.file is not None and self._main:
            self.file.unlink(missing_ok=True)
            for left in self.file.parent.glob(f".{glob.escape(self.file.name[:40])}.*"):  # a process killed in writing
                left.unlink(missing_ok=True)
        self._accelerator.wait_for_everyone()

    def _not_finite(self, error: _NotFinite) -> str:
        what, here = error.args
        batch = self._batch
        names = batch.get("names") if isinstance(batch, Mapping) else getattr(batch, "names", None)
        if not here:
            where = "its batch is named by another process"
        elif names and not isinstance(batch, Tensor):  # whose names are those of its dimensions
            where = f"its batch: {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"
        else:
            where = f"its batch is that of seed {self.config.seed}"
        kept = f"; the state before that step is in {self.file}" if self.file is not None else ""
        return f"training: {what}; {where}{kept}. Look for bad numbers in those clips, or take a smaller learning rate"

    # -- the state on disk -------------------------------------------------------------------------------------------

    @property
    def _main(self) -> bool:
        return self._accelerator.is_main_process

    def _bare(self, n: int) -> nn.Module:
        return self._accelerator.unwrap_model(self.models[n])

    def _buffers(self) -> list[Tensor]:
        """What the states hold beside parameters, such as the running means of a batch norm."""
        if self._kept_buffers is None:
            bare = [self._bare(n) for n in range(len(self.models))]
            kept = [(one, one.state_dict().keys()) for one in bare]
            self._kept_buffers = [value for one, names in kept for name, value in one.named_buffers() if name in names]
        return self._kept_buffers

    def _parts(self) -> Iterator[tuple[str, nn.Module]]:
        """Everything whose weights are kept, by a prefix for their names."""
        for n in range(len(self.models)):
            yield f"{n}.model.", self._bare(n)
            if self._means[n] is not None:
                yield f"{n}.mean.", self._means[n]

    def _write(self) -> None:
        """Write the state before the present step, if it is whole; the main process does."""
        if self.file is None or not self._main or not self._whole:
            return
        for value, old in zip(self._buffers(), self._undo):
            value.copy_(old)
        tensors = {prefix + name: value for prefix, part in self._parts() for name, value in part.state_dict().items()}
        for n, optimizer in enumerate(self._optimizers):
            for number, values in _torchs(optimizer).state_dict()["state"].items():
                tensors |= {f"{n}.optimizer.{number}.{name}": value for name, value in values.items()}
        tensors["losses"] = torch.tensor(self.run.losses, dtype=torch.float64)
        tensors["seconds"] = torch.tensor(self.run.seconds, dtype=torch.float64)
        plain = {name: value.detach().cpu().clone().contiguous() for name, value in tensors.items()}
        write_atomic(self.file, tensors_as_bytes(plain, {"config": repr(self.config)}))

    def _read(self) -> None:
        """Put a kept state back in place; MotionKitError if it is damaged, or of another config or model."""
        try:
            with safe_open(self.file, "pt") as file:
                tensors, told = {name: file.get_tensor(name) for name in file.keys()}, file.metadata()  # noqa: SIM118
        except (SafetensorError, OSError) as error:
            raise MotionKitError(
                f"{self.file}: the kept run cannot be read ({error}); remove it to start again"
            ) from None
        if told != {"config": repr(self.config)}:
            raise MotionKitError(f"{self.file}: this run was begun with another config; remove it to start again")

        def part(prefix: str) -> dict[str, Tensor]:
            return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}

        for prefix, module in self._parts():
            load_into(module, part(prefix), self.file)
        for n, optimizer in enumerate(self._optimizers):
            state: dict[int, dict[str, Tensor]] = {}
            for key, value in part(f"{n}.optimizer.").items():
                number, name = key.split(".", 1)
                state.setdefault(int(number), {})[name] = value
            own = _torchs(optimizer)
            own.load_state_dict({"state": state, "param_groups": own.state_dict()["param_groups"]})
        self.run = Run(tensors["losses"].tolist(), float(tensors["seconds"]))


def _torchs(optimizer: object) -> torch.optim.Optimizer:
    return getattr(optimizer, "optimizer", optimizer)


def _running_mean(model: nn.Module, ema: float) -> AveragedModel:
    def update(means: list[Tensor], now: list[Tensor], count: Tensor) -> None:
        n = int(count)  # the first steps count for less, or the mean would remember the beginning
        torch._foreach_lerp_(means, now, 1 - min(ema, (1 + n) / (10 + n)))

    return AveragedModel(model, multi_avg_fn=update)


def seed_batch(config: TrainConfig, step: int, rank: int | None = None) -> None:
    """Seed torch's random numbers as `fit` does before step n of a process (this one if left out), to draw it again."""
    if rank is None:
        rank = torch.distributed.get_rank() if torch.distributed.is_initialized() else 0
    torch.manual_seed(config.seed * 1_000_003 + step + rank * 2_038_074_743)


def device_of(model: nn.Module) -> torch.device:
    """Where a model's weights are."""
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
