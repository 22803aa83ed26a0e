"""What tests of pictures share: pixels, how much of a colour there is, clouds of points, and skeletons to draw."""

import io
from types import SimpleNamespace

import numpy as np
import torch
from PIL import Image


def pixels(png: bytes) -> np.ndarray:
    """The pixels of a picture, [height, width, 3], 0 to 255."""
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def near(picture: np.ndarray, colour: str, within: int = 40) -> int:
    """How many pixels are about of a colour."""
    wanted = np.array([int(colour[n : n + 2], 16) for n in (1, 3, 5)])
    return int((abs(picture - wanted).max(-1) < within).sum())


def cloud(rows: int, columns: int = 2, seed: int = 0) -> torch.Tensor:
    """Normal points."""
    return torch.randn(rows, columns, generator=torch.Generator().manual_seed(seed))


class Clip(SimpleNamespace):
    """The least that the viewer asks of a motion."""

    def __len__(self) -> int:
        return len(self.points)

    def positions(self) -> torch.Tensor:
        return self.points


def clip(points, parents, names=None, sides=None, fps=30.0, name="clip") -> Clip:
    """A clip of points [F, J, 3]."""
    names = tuple(names or [f"joint{j}" for j in range(len(parents))])
    skeleton = SimpleNamespace(names=names, parents=tuple(parents), sides=tuple(sides or ["middle"] * len(parents)))
    return Clip(points=torch.as_tensor(np.asarray(points), dtype=torch.float32), skeleton=skeleton, fps=fps, name=name)


def dog() -> Clip:
    """Root on the ground where it began, a spine, four legs and a tail; runs away from its root."""
    rest = [(0, 0, 0), (0, 0.5, 0), (0, 0.5, 0.5), (0, 0.7, 0.7), (0, 0.5, -0.3)]
    names, parents, sides = ["root", "hips", "chest", "Head", "tail"], [-1, 0, 1, 2, 1], ["middle"] * 5
    for side, x in (("left", 0.1), ("right", -0.1)):
        for end, z, top in (("front", 0.5, 2), ("back", 0.0, 1)):
            names += [f"{side}_{end}_knee", f"{side}_{end}_paw"]
            parents += [top, len(names) - 2]
            sides += [side] * 2
            rest += [(x, 0.25, z), (x, 0.0, z)]
    points = np.tile(np.asarray(rest, dtype=float), (20, 1, 1))
    points[:, 1:, 2] += np.linspace(0, 3, 20)[:, None]
    return clip(points, parents, names, sides, name="dog")
