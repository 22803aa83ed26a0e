"""Mean and spread of features, saved with a hash of the data they came from."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..files import read_bytes, write_atomic


@dataclass(frozen=True, eq=False)
class Normalizer:
    """Features to mean 0 and spread 1, number by number, and back.

    mean, std: [D]. A number that never changes gets std 1, so that nothing is divided by zero. layout: the name of the
    feature layout. data_hash: SHA-256 of the features it was fitted on.

    >>> n = Normalizer.fit([torch.tensor([[0.0, 5.0], [2.0, 5.0]])], layout="toy")
    >>> n.normalize(torch.tensor([[2.0, 5.0]])), n.denormalize(torch.tensor([[0.0, 0.0]]))
    (tensor([[1., 0.]]), tensor([[1., 5.]]))
    """

    mean: Tensor
    std: Tensor
    layout: str
    data_hash: str

    @classmethod
    def fit(cls, features: Sequence[Tensor], layout: str) -> Normalizer:
        """From clips of features [F, D], all frames counting the same; MotionKitError if there are none."""
        if not len(features):
            raise MotionKitError("a normalizer needs at least one clip of features; found none")
        if len({f.shape[1] for f in features}) != 1:
            sizes = sorted({f.shape[1] for f in features})
            raise MotionKitError(f"clips to normalize must have the same numbers a frame; found {sizes}")
        digest = hashlib.sha256()
        for f in features:
            digest.update(str(tuple(f.shape)).encode() + f.detach().cpu().contiguous().numpy().tobytes())
        frames = torch.cat(list(features)).double()
        std = frames.std(0, correction=0)
        std = torch.where(std < 1e-5, torch.ones_like(std), std)
        return cls(frames.mean(0).float(), std.float(), layout, digest.hexdigest())

    def normalize(self, x: Tensor) -> Tensor:
        """Features [..., D] to mean 0 and spread 1."""
        return (x - self.mean) / self.std

    def denormalize(self, x: Tensor) -> Tensor:
        """The inverse of `normalize`."""
        return x * self.std + self.mean

    def save(self, path: str | os.PathLike) -> Path:
        """Write a safetensors file, whole or not at all."""
        from safetensors.torch import save

        tensors = {"mean": self.mean.contiguous(), "std": self.std.contiguous()}
        return write_atomic(path, save(tensors, {"layout": self.layout, "data_hash": self.data_hash}))

    @classmethod
    def load(cls, path: str | os.PathLike, layout: str | None = None) -> Normalizer:
        """Read what `save` wrote; MotionKitError if it is damaged or for another layout than `layout`."""
        from safetensors import SafetensorError, safe_open

        read_bytes(path)  # says what is wrong with the path in words
        try:
            with safe_open(path, "pt") as file:
                meta = file.metadata() or {}
                found = cls(file.get_tensor("mean"), file.get_tensor("std"), meta["layout"], meta["data_hash"])
        except (SafetensorError, KeyError) as error:
            raise MotionKitError(f"{path}: this is no whole normalizer file ({error}); fit and save it again") from None
        if layout is not None and found.layout != layout:
            raise MotionKitError(f"{path}: made for layout {found.layout!r}; expected {layout!r}: fit one for it")
        return found
