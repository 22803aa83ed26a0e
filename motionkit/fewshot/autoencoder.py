"""What paper 1 compares diffusion with (section 6.3, table 3, "with AE"): an autoencoder in the denoiser's place."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import torch
from torch import Tensor, nn

from ..datasets import Dataset, Encoded
from ..errors import MotionKitError
from ..priors import Prior
from ..training import Schedule, fit

STEPS, BATCH, RATE, FRAMES = 1500, 48, 1e-3, 64
_WIDTHS = (128, 192)


class ConvAutoencoder(nn.Module):
    """The autoencoder of unpaired motion style transfer (Aberman et al. 2020), its normalisations left out.

    Two convolutions over time, each halving the frames, and a residual block; then the same backwards. Paper 1's table
    3 takes it so, "while omitting the Instance Normalization and AdaIN layers". It is called like `layers.Denoiser`,
    but hears no step and no sentence. features: D.

    >>> network = ConvAutoencoder(features=10)
    >>> network(torch.randn(2, 30, 10)).shape
    torch.Size([2, 30, 10])
    """

    def __init__(self, features: int, longest: int = 160) -> None:
        super().__init__()
        near, far = _WIDTHS
        self.config = SimpleNamespace(frames=longest, frames_per_token=4)
        self.down = nn.ModuleList((_strided(features, near), _strided(near, far)))
        self.middle = nn.ModuleList((_residual(far), _residual(far)))
        self.up = nn.ModuleList((_smooth(far, near), _smooth(near, features)))

    def forward(self, x: Tensor, t: Tensor | None = None, text: Tensor | None = None, mask: Tensor | None = None):
        """x: clean [B, F, D]; the rest is not looked at. Returns [B, F, D]."""
        frames = x.shape[1]
        y = nn.functional.pad(x.transpose(1, 2), (0, -frames % 4), mode="replicate")  # [B, D, F]
        for layer in self.down:
            y = nn.functional.leaky_relu(layer(y), 0.2)
        for block in self.middle:
            y = y + block(y)
        for n, layer in enumerate(self.up):
            y = nn.functional.interpolate(y, scale_factor=2, mode="nearest")
            y = layer(y if n == 0 else nn.functional.leaky_relu(y, 0.2))
        return y.transpose(1, 2)[:, :frames]


def _strided(inside: int, outside: int) -> nn.Conv1d:
    return nn.Conv1d(inside, outside, 8, stride=2, padding=3, padding_mode="replicate")


def _smooth(inside: int, outside: int) -> nn.Conv1d:
    return nn.Conv1d(inside, outside, 5, padding=2, padding_mode="replicate")


def _residual(width: int) -> nn.Sequential:
    first, second = (nn.Conv1d(width, width, 3, padding=1) for _ in range(2))
    return nn.Sequential(first, nn.LeakyReLU(0.2), second)


class Direct:
    """In place of a `Chain`: no noise, one call, so that eqs. 10 to 12 of paper 1 teach an autoencoder (table 3).

    >>> Direct().reverse(lambda x, t: 2 * x, torch.ones(1, 4, 2)).shape
    torch.Size([1, 1, 4, 2])
    """

    stops: tuple[int, ...] = ()

    def forward(self, predict, x: Tensor) -> Tensor:
        """x [B, F, D] as it is."""
        return x

    def reverse(self, predict, noised: Tensor) -> Tensor:
        """What the network makes of it, [1, B, F, D]."""
        return predict(noised, torch.zeros(len(noised), dtype=torch.long))[None]


def with_autoencoder(prior: Prior, library: Dataset, steps: int = STEPS, seed: int = 0, **running) -> Prior:
    """A prior whose network is an autoencoder that learned to give a library's motions back (paper 1, table 3).

    It has the prior's features, sentences and card; it cannot make motions. running: as in `training.fit`. Raises
    MotionKitError where no clip of the library is as long as a window.
    """
    encoded = Encoded(library, prior.layout)
    long = (encoded.lengths >= FRAMES).nonzero()[:, 0]
    if not len(long):
        raise MotionKitError(f"no clip of the library has {FRAMES} frames for the autoencoder to learn from")
    torch.manual_seed(seed)
    network = ConvAutoencoder(prior.layout.size, prior.longest)

    def loss_of(model: nn.Module, step: int) -> Tensor:
        x = prior.normalizer.normalize(encoded.draw(long[torch.randint(len(long), (BATCH,))], FRAMES))
        return ((model(x) - x) ** 2).mean()

    running.setdefault("title", "an autoencoder")
    fit(network, loss_of, Schedule(steps, RATE, seed=seed), **running)
    return replace(prior, network=network)
