"""What a feature layout is: named slices of a vector, with encode and decode."""

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
from ..motion import Motion
from ..skeleton import Skeleton, smpl


@dataclass(frozen=True)
class Row:
    """One line of a layout's table: what the numbers from `start` up to `stop` (not included) mean."""

    start: int
    stop: int
    name: str
    meaning: str
    unit: str


class Layout:
    """Base of the layouts. A layout knows its skeleton and frame rate, because a row of numbers does not.

    skeleton: left out, it is that of the first motion that is encoded, or SMPL's 22 joints if it decodes first.
    fps: likewise; `default_fps` if it decodes first.
    """

    default_fps = 30.0

    def __init__(self, skeleton: Skeleton | None = None, fps: float | None = None) -> None:
        self._skeleton, self._fps = skeleton, fps

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton whose joints the numbers speak of."""
        return self._skeleton or smpl()

    @property
    def fps(self) -> float:
        """Frames a second, for velocities and for decoded motions."""
        return self._fps or self.default_fps

    @property
    def order(self) -> list[int]:
        """Joint numbers in the layout's order: the pelvis first, then the others as in the file."""
        pelvis = self.skeleton.pelvis
        return [pelvis] + [j for j in range(len(self.skeleton)) if j != pelvis]

    @property
    def file_order(self) -> list[int]:
        """The permutation that undoes `order`."""
        return torch.tensor(self.order).argsort().tolist()

    def rows(self) -> list[Row]:
        """The layout's table, from the first number to the last."""
        raise NotImplementedError

    @property
    def slices(self) -> dict[str, slice]:
        """Where each named part of the vector lies, such as `slices["positions"]`."""
        return {r.name: slice(r.start, r.stop) for r in self.rows()}

    @property
    def size(self) -> int:
        """D, how many numbers a frame has."""
        return self.rows()[-1].stop

    def table(self) -> str:
        """The table as text, for printing."""
        lines = [f"{'numbers':>9}  {'part':<12} {'unit':<20} meaning"]
        lines += [f"{f'{r.start}-{r.stop - 1}':>9}  {r.name:<12} {r.unit:<20} {r.meaning}" for r in self.rows()]
        return "\n".join(lines)

    def describe(self, number: int) -> str:
        """What one number of the vector means, in words; its joint, if it has one, is `joint_of(number)`."""
        row = self._row(number)
        which = (number - row.start) % len(self.components[row.name])
        joint = self.joint_of(number)
        where = f" of {self.skeleton.names[joint]}" if joint is not None else ""
        unit = self._units(row.name)[which]
        return f"{row.name} {self.components[row.name][which]}{where}" + (f" ({unit})" if unit else "")

    def joint_of(self, number: int) -> int | None:
        """The joint that one number of the vector speaks of, or None where it speaks of the whole body."""
        row = self._row(number)
        joints = self.joints[row.name]
        return joints[(number - row.start) // len(self.components[row.name])] if joints else None

    def _row(self, number: int) -> Row:
        if not 0 <= number < self.size:
            raise MotionKitError(f"this layout has numbers 0 to {self.size - 1}; found {number}")
        return next(r for r in self.rows() if r.start <= number < r.stop)

    # what `describe` needs: for each part the names of its components, their units (one for all, or one each; empty
    # for a pure number), and its joints (empty: the whole body)
    components: dict[str, tuple[str, ...]] = {}
    units: dict[str, tuple[str, ...]] = {}

    @property
    def joints(self) -> dict[str, list[int]]:
        """For each part, the joints it runs through, in order; empty for parts about the whole body."""
        raise NotImplementedError

    def _units(self, part: str) -> tuple[str, ...]:
        """The unit of each of a part's components."""
        units = self.units[part]
        return units * len(self.components[part]) if len(units) == 1 else units

    def _lay_out(self, *parts: tuple[str, str]) -> list[Row]:
        """Rows from (name, meaning), sized by `components` and `joints`."""
        rows, start = [], 0
        for name, meaning in parts:
            stop = start + len(self.components[name]) * max(len(self.joints[name]), 1)
            unit = ", ".join(dict.fromkeys(u or "none" for u in self._units(name)))
            rows.append(Row(start, stop, name, meaning, unit))
            start = stop
        return rows

    def _take(self, motion: Motion) -> Motion:
        """Check a motion against the layout, or make the layout fit the first one."""
        if self._skeleton is None:
            self._skeleton = motion.skeleton
        if self._fps is None:
            self._fps = motion.fps
        if not motion.skeleton.same_tree(self.skeleton):
            raise MotionKitError(
                f"this {type(self).__name__} is for {self.skeleton!r}; found {motion.skeleton!r}: make a layout "
                f"for it, {type(self).__name__}(motion.skeleton)"
            )
        if abs(motion.fps - self.fps) > 1e-3:
            raise MotionKitError(f"this layout counts {self.fps:g} frames a second: use motion.resample({self.fps:g})")
        if not len(motion):
            raise MotionKitError(f"motion {motion.name!r} has no frames to encode")
        return motion

    def _check(self, x: Tensor) -> Tensor:
        """Check the shape of features before they are decoded."""
        x = torch.as_tensor(x)
        if x.ndim != 2 or x.shape[1] != self.size:
            raise MotionKitError(
                f"{type(self).__name__} for {len(self.skeleton)} joints expects [frames, {self.size}]; found "
                f"{list(x.shape)}"
            )
        return x if x.is_floating_point() else x.float()

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to features [F, D]."""
        raise NotImplementedError

    def decode(self, x: Tensor) -> Motion:
        """Features [F, D] to a motion that starts above the origin, facing +Z."""
        raise NotImplementedError

    def positions(self, x: Tensor) -> Tensor:
        """Features [F, D] to places of joints in the world, [F, J, 3] metres in the skeleton's order."""
        raise NotImplementedError


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
