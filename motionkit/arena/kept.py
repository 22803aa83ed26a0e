"""What the arena keeps on disk: one safetensors file for each result, whole or not there."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path

import safetensors
from safetensors.torch import load as tensors_of
from safetensors.torch import save as bytes_of
from torch import Tensor

from ..errors import MotionKitError
from ..files import read_bytes, write_atomic
from ..motion import Motion

FORMAT = 1  # to be raised when files or what is measured become others


def save(path: Path, tensors: Mapping[str, Tensor], facts: Mapping) -> None:
    """Write tensors, and facts that JSON can hold, with a checksum of both.

    >>> import tempfile, torch
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(Path(folder, "a.safetensors"), {"x": torch.ones(2)}, {"seconds": 0.5})
    ...     load(Path(folder, "a.safetensors"))
    ({'x': tensor([1., 1.])}, {'seconds': 0.5})
    """
    plain, text = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, json.dumps(facts)
    write_atomic(path, bytes_of(plain, {"facts": text, "checksum": str(_checksum(plain, text))}))


def load(path: Path) -> tuple[dict[str, Tensor], dict]:
    """What `save` wrote; MotionKitError where the file is missing or not whole."""
    data = read_bytes(path)
    try:
        tensors = tensors_of(data)
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
        if int(header["checksum"]) != _checksum(tensors, header["facts"]):
            raise ValueError("its checksum is another")
        return tensors, json.loads(header["facts"])
    except (ValueError, KeyError, TypeError, safetensors.SafetensorError) as error:
        raise MotionKitError(f"{path}: damaged ({error}); run the arena again, which makes it anew") from None


def _checksum(tensors: Mapping[str, Tensor], text: str) -> int:
    found = zlib.crc32(text.encode())
    for name in sorted(tensors):
        found = zlib.crc32(tensors[name].numpy().tobytes(), found)
    return found


def result_path(folder: Path, number: int) -> Path:
    """Where the result of a transfer is kept."""
    return folder / f"{number:05d}.safetensors"


def save_result(path: Path, result: Motion, content: Motion, facts: Mapping) -> None:
    """Keep a method's result. Of the translations only those of joints that leave the skeleton's offsets."""
    moves = result.translations.float().cpu()
    moving = (moves != content.skeleton.offsets.float()).any(-1).any(0).nonzero()[:, 0]
    tensors = {"rotations": result.rotations.float(), "moving": moving, "translations": moves[:, moving]}
    save(path, tensors, {"name": result.name, **facts})


def load_result(path: Path, content: Motion) -> tuple[Motion, dict]:
    """A kept result, and the facts of its making; MotionKitError where it is missing or damaged."""
    tensors, facts = load(path)
    turns = tensors["rotations"]
    moves = content.skeleton.offsets.float().expand(len(turns), -1, -1).clone()
    moves[:, tensors["moving"]] = tensors["translations"]
    return Motion(content.skeleton, turns, moves, content.fps, facts["name"], content.metres_per_unit), facts


def state(path: Path) -> tuple[int, int] | None:
    """Size and time of a file, which change when it is written again; None where there is none."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns
