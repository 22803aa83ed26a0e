"""The state of a training that was broken off, in one file: written whole or not at all, read back exactly."""

from __future__ import annotations

import glob
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor, nn

from .checkpoints import load_into
from .errors import MotionKitError
from .files import write_atomic


def write(
    path: Path,
    model: nn.Module,
    optimizer: torch.optim.Optimizer,
    mean: nn.Module | None,
    schedule: object,
    losses: list[float],
    seconds: float,
) -> None:
    """Everything that `read` needs to go on as if nothing had happened."""
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


def read(
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


def remove(path: Path) -> None:
    """The file, and what was left of it where a process was killed while it wrote."""
    path.unlink(missing_ok=True)
    for left in path.parent.glob(f".{glob.escape(path.name[:40])}.*"):
        left.unlink(missing_ok=True)


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def _begun(schedule: object) -> dict[str, str]:
    return {"schedule": repr(schedule)}
