"""Transformers over time: paper 1's denoiser, its motion-semantic discriminator, and the embedding that they share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from ..errors import MotionKitError


@dataclass(frozen=True)
class TransformerConfig:
    """Sizes. width: of a token. frames_per_token: frames that share one. frames: the longest motion to learn from.

    `paper()` is paper 1, section 4: 8 layers, 512 wide, feed-forward 1024, a token for each frame; heads and dropout,
    which it does not give, are those of MDM (Tevet et al. 2023), from which it comes. `laptop()` has the same parts,
    but a token for four frames, so that it trains on two cores. Raises MotionKitError for sizes that do not fit.

    >>> TransformerConfig.paper().layers, TransformerConfig.laptop().frames_per_token
    (8, 4)
    """

    width: int
    layers: int
    heads: int
    feedforward: int
    frames_per_token: int = 1
    frames: int = 196
    dropout: float = 0.1

    def __post_init__(self) -> None:
        sizes = (self.width, self.layers, self.heads, self.feedforward, self.frames_per_token, self.frames)
        if not all(isinstance(size, int) and size >= 1 for size in sizes) or not 0 <= self.dropout < 1:
            raise MotionKitError(f"sizes are whole numbers from 1, dropout from 0 to below 1; found {self}")
        if self.width % 2 or self.width % self.heads:
            raise MotionKitError(
                f"width must be even, and the heads share it evenly; found width {self.width}, {self.heads} heads: "
                f"take width {2 * self.heads * max(self.width // (2 * self.heads), 1)}"
            )

    @classmethod
    def paper(cls) -> TransformerConfig:
        """As published."""
        return cls(512, 8, 4, 1024)

    @classmethod
    def laptop(cls) -> TransformerConfig:
        """A tenth of the numbers, a quarter of the tokens."""
        return cls(192, 4, 4, 384, frames_per_token=4, frames=160, dropout=0.0)

    @classmethod
    def tiny(cls) -> TransformerConfig:
        """For tests and for training in front of a class."""
        return cls(64, 2, 2, 128, frames_per_token=4, frames=64, dropout=0.0)


def sinusoids(length: int, width: int) -> Tensor:
    """Positions as waves, [length, width]: sines in even places, cosines in odd ones (Vaswani et al. 2017, 3.5).

    >>> sinusoids(2, 4)
    tensor([[0.0000, 1.0000, 0.0000, 1.0000],
            [0.8415, 0.5403, 0.0100, 0.9999]])
    """
    speed = torch.exp(torch.arange(0, width, 2) * (-math.log(10000.0) / width))
    angles = torch.arange(length)[:, None] * speed
    return torch.stack((angles.sin(), angles.cos()), -1).flatten(1)


class PoseEmbedding(nn.Module):
    """Motion features to tokens (paper 1, section 4: the shared embedding layer): [B, F, D] to [B, N, width].

    There is a token for every `frames_per_token` frames. Where that is more than one, a token sees twice as many, the
    ones around included, so that neighbours overlap. Beyond the ends of the motion there are zeros.

    >>> PoseEmbedding(10, TransformerConfig.tiny())(torch.zeros(2, 30, 10)).shape
    torch.Size([2, 8, 64])
    """

    def __init__(self, features: int, config: TransformerConfig) -> None:
        super().__init__()
        self.features, self.together = features, config.frames_per_token
        self.seen = 1 if self.together == 1 else 2 * self.together
        self.linear = nn.Linear(features * self.seen, config.width)

    def forward(self, x: Tensor) -> Tensor:
        short, around = -x.shape[1] % self.together, self.seen - self.together
        x = nn.functional.pad(x, (0, 0, around // 2, short + around - around // 2))
        return self.linear(x.unfold(1, self.seen, self.together).flatten(2))  # [B, N, D x seen]

    def hidden(self, mask: Tensor) -> Tensor:
        """Frames that count, bool [B, F], to tokens that do not, bool [B, N]: those without any such frame."""
        short = -mask.shape[1] % self.together
        return ~nn.functional.pad(mask, (0, short)).unflatten(1, (-1, self.together)).any(2)


class PoseOutput(nn.Module):
    """The inverse of `PoseEmbedding` (paper 1, section 4): tokens [B, N, width] to features [B, F, D].

    Where tokens overlap, each frame is a mean of two of them, which fades from one to the next: no jumps in between.

    >>> PoseOutput(10, TransformerConfig.tiny())(torch.zeros(2, 8, 64), frames=30).shape
    torch.Size([2, 30, 10])
    """

    def __init__(self, features: int, config: TransformerConfig) -> None:
        super().__init__()
        self.together = config.frames_per_token
        self.seen = 1 if self.together == 1 else 2 * self.together
        self.linear = nn.Linear(config.width, features * self.seen)
        fade = torch.sin((torch.arange(self.seen) + 0.5) * (math.pi / self.seen)) ** 2  # of neighbours it adds up to 1
        self.register_buffer("fade", fade[:, None], persistent=False)

    def forward(self, tokens: Tensor, frames: int) -> Tensor:
        each = self.linear(tokens).unflatten(2, (self.seen, -1))  # [B, N, seen, D]
        if self.together == 1:
            return each[:, :frames, 0]
        first = self.together // 2
        weight = self._overlapped(self.fade.expand(1, each.shape[1], -1, 1))
        return (self._overlapped(each * self.fade) / weight)[:, first : first + frames]

    def _overlapped(self, each: Tensor) -> Tensor:
        """The first halves of [B, N, seen, D] laid over the second halves of those before: [B, (N + 1) seen / 2, D]."""
        ahead, behind = each.split(self.together, 2)
        ahead, behind = (nn.functional.pad(x, (0, 0, 0, 0, *ends)) for x, ends in ((ahead, (0, 1)), (behind, (1, 0))))
        return (ahead + behind).flatten(1, 2)


def encoder(config: TransformerConfig) -> nn.TransformerEncoder:
    """The stack of self-attention layers that both networks have."""
    layer = nn.TransformerEncoderLayer(
        config.width, config.heads, config.feedforward, config.dropout, nn.functional.gelu, batch_first=True
    )
    return nn.TransformerEncoder(layer, config.layers, enable_nested_tensor=False)


class Denoiser(nn.Module):
    """The network of paper 1's prior (eqs. 3 and 4, figure 2a): from noisy motion, step and text to the clean motion.

    Text and step embedding, added, are one token in front of those of the motion. features: D. text_size: of the text's
    embedding. steps: T.

    >>> network = Denoiser(features=10, text_size=16, config=TransformerConfig.tiny())
    >>> network(torch.randn(2, 30, 10), torch.tensor([5, 900]), torch.zeros(2, 16)).shape
    torch.Size([2, 30, 10])
    """

    def __init__(self, features: int, text_size: int, config: TransformerConfig, steps: int = 1000) -> None:
        super().__init__()
        self.config, self.text_size, width = config, text_size, config.width
        self.embedding = PoseEmbedding(features, config)
        self.text = nn.Linear(text_size, width)
        self.step = nn.Sequential(nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))
        self.encoder = encoder(config)
        self.output = PoseOutput(features, config)
        self.register_buffer("waves", sinusoids(max(steps, config.frames) + 2, width), persistent=False)

    def forward(
        self, x: Tensor, t: Tensor, text: Tensor, mask: Tensor | None = None, more: Tensor | None = None
    ) -> Tensor:
        """x: [B, F, D] at step t, long [B]. text: [B, E]. mask: bool [B, F], which frames are there. Returns x0.

        more: [B, width], what every token is told beside. Raises MotionKitError for more frames than there are
        positions.
        """
        x = x if mask is None else x * mask[..., None]
        condition = self.text(text) + self.step(self.waves[t])
        tokens = torch.cat((condition[:, None], self.embedding(x)), 1)  # [B, 1 + N, width]
        if tokens.shape[1] > len(self.waves):
            most = (len(self.waves) - 1) * self.config.frames_per_token
            raise MotionKitError(f"this network has positions for {most} frames; found {x.shape[1]}: cut the motion")
        hidden = None if mask is None else nn.functional.pad(self.embedding.hidden(mask), (1, 0))
        if more is not None:
            tokens = tokens + more[:, None]
        seen = self.encoder(tokens + self.waves[: tokens.shape[1]], src_key_padding_mask=hidden)
        return self.output(seen[:, 1:], x.shape[1])


class SemanticEncoder(nn.Module):
    """Paper 1's motion-semantic discriminator (figure 3): a trainable token reads a motion and answers in text's space.

    features: D. text_size: E, of the text's embedding. embedding: the denoiser's, shared and not trained here; one of
    its own if left out.

    >>> network = SemanticEncoder(features=10, text_size=16, config=TransformerConfig.tiny())
    >>> network(torch.randn(2, 30, 10)).shape
    torch.Size([2, 16])
    """

    def __init__(
        self, features: int, text_size: int, config: TransformerConfig, embedding: PoseEmbedding | None = None
    ) -> None:
        super().__init__()
        self.config = config
        self.embedding = PoseEmbedding(features, config)
        if embedding is not None:
            self.embedding.load_state_dict(embedding.state_dict())
            self.embedding.requires_grad_(False)
        self.token = nn.Parameter(torch.randn(config.width) / config.width**0.5)
        self.encoder = encoder(config)
        self.output = nn.Linear(config.width, text_size)
        self.register_buffer("waves", sinusoids(config.frames + 2, config.width), persistent=False)

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        """x: clean features [B, F, D], F at most `config.frames`; mask: bool [B, F]. Returns H_token [B, E]."""
        poses = self.embedding(x if mask is None else x * mask[..., None])
        if poses.shape[1] + 1 > len(self.waves):
            raise MotionKitError(f"the longest motion for this network has {self.config.frames} frames; cut it first")
        tokens = torch.cat((self.token.expand(len(x), 1, -1), poses), 1)
        hidden = None if mask is None else nn.functional.pad(self.embedding.hidden(mask), (1, 0))
        return self.output(self.encoder(tokens + self.waves[: tokens.shape[1]], src_key_padding_mask=hidden)[:, 0])


def semantic_loss(motion: Tensor, text: Tensor, delta: float = 1e-6) -> Tensor:
    """One minus the cosine between H_token and the text's embedding, both [B, E], mean over B (paper 1, eqs. 6 and 11).

    >>> semantic_loss(torch.tensor([[2.0, 0.0]]), torch.tensor([[0.0, 3.0]]))
    tensor(1.)
    """
    lengths = motion.norm(dim=-1) * text.norm(dim=-1)
    return (1 - (motion * text).sum(-1) / lengths.clamp(min=delta)).mean()
