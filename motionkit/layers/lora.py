"""Fine-tuning that leaves a network as it is: a few numbers beside each of its matrices, or as many as it has."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.func import functional_call

from ..errors import MotionKitError
from .transformer import Denoiser


class LoRA(nn.Module):
    """A denoiser with changed weights, of which only the changes are trained: theta to theta_s (paper 1, section 3.4).

    Every matrix W becomes W + B A with A [rank, in] and B [out, rank] (low-rank adaptation, Hu et al. 2022), every
    vector gets one to add; with rank 0 every matrix gets a whole matrix to add, as in paper 1. At first nothing is
    changed. network: stays as it is and belongs to all adapters alike. Raises MotionKitError for a rank below 0.

    >>> from motionkit.layers import TransformerConfig
    >>> network = Denoiser(features=10, text_size=16, config=TransformerConfig.tiny())
    >>> adapter = LoRA(network, rank=4)
    >>> x, t, text = torch.randn(2, 30, 10), torch.tensor([5, 900]), torch.zeros(2, 16)
    >>> bool(torch.allclose(adapter(x, t, text), network(x, t, text), atol=1e-5))
    True
    """

    def __init__(self, network: Denoiser, rank: int = 8, seed: int = 0) -> None:
        super().__init__()
        if not isinstance(rank, int) or isinstance(rank, bool) or rank < 0:
            raise MotionKitError(f"an adapter's rank is a whole number, 8 for instance, or 0 for all; found {rank!r}")
        self.rank, self.network = rank, network.requires_grad_(False)
        generator = torch.Generator().manual_seed(seed)
        self.changes = nn.ParameterDict()
        for name, weight in network.named_parameters():
            key = name.replace(".", "/")
            if rank and weight.ndim == 2:
                down = torch.randn(rank, weight.shape[1], generator=generator) / math.sqrt(weight.shape[1])
                self.changes[f"{key}/A"] = down
                self.changes[f"{key}/B"] = torch.zeros(weight.shape[0], rank)
            else:
                self.changes[key] = torch.zeros(weight.shape)

    def train(self, mode: bool = True) -> LoRA:
        """The network itself stays as it is in use, without dropout."""
        super().train(mode)
        self.network.eval()
        return self

    def weights(self) -> dict[str, Tensor]:
        """The changed weights by their names in the network."""
        weights = {}
        for name, weight in self.network.named_parameters():
            key = name.replace(".", "/")
            change = self.changes[key] if key in self.changes else self.changes[f"{key}/B"] @ self.changes[f"{key}/A"]
            weights[name] = weight + change
        return weights

    def forward(self, x: Tensor, t: Tensor, text: Tensor, mask: Tensor | None = None) -> Tensor:
        """As `layers.Denoiser.forward`."""
        return functional_call(self.network, self.weights(), (x, t, text, mask))

    def merged(self) -> Callable[..., Tensor]:
        """The changed denoiser as a function that works its weights out once: for use after training."""
        with torch.no_grad():
            weights = self.weights()
        return lambda x, t, text, mask=None: functional_call(self.network, weights, (x, t, text, mask))
