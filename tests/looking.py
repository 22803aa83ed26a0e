"""What tests of pictures share: pixels, how much of a colour there is, and clouds of points to draw."""

import io

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
