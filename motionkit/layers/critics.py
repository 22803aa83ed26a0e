"""What watches over paper 2's generator while it learns: critics of style, and a network of contents."""

from __future__ import annotations

import torch
from torch import Tensor, nn

WINDOW = 24  # frames (paper 2, section 4.1)
WIDTHS = (64, 64)  # channels of the convolutions, which the paper does not give


def _convolutions(inside: int, norm: bool) -> nn.ModuleList:
    """1D convolutions over time that halve it, each with LeakyReLU, and instance normalisation where asked for."""
    parts = nn.ModuleList()
    for outside in WIDTHS:
        own = [nn.Conv1d(inside, outside, 5, stride=2, padding=2)]
        own += [nn.InstanceNorm1d(outside)] if norm else []
        parts.append(nn.Sequential(*own, nn.LeakyReLU(0.2)))
        inside = outside
    return parts


def _told(style: Tensor, content: Tensor, styles: int, contents: int) -> Tensor:
    one_hot = nn.functional.one_hot
    return torch.cat((one_hot(style, styles), one_hot(content, contents)), 1).float()


class FtAttCritic(nn.Module):
    """The FT-Att discriminator of paper 2 (section 3.1, figure 3): what it sees counts by style and content.

    joints: J; it sees positions and velocities, 6J numbers a frame. contents, styles: how many labels. frames: of a
    window.

    >>> critic = FtAttCritic(joints=5, contents=3, styles=4)
    >>> critic(torch.randn(2, 24, 30), torch.tensor([0, 3]), torch.tensor([2, 0])).shape
    torch.Size([2])
    """

    def __init__(self, joints: int, contents: int, styles: int, frames: int = WINDOW) -> None:
        super().__init__()
        self.contents, self.styles = contents, styles
        self.convolutions = _convolutions(6 * joints, norm=False)
        self.feature, self.time = (
            nn.Sequential(nn.Linear(styles + contents, 64), nn.LeakyReLU(0.2), nn.Linear(64, size))
            for size in (WIDTHS[-1], -(-frames // 4))
        )

    def weights(self, style: Tensor, content: Tensor) -> tuple[Tensor, Tensor]:
        """w_f [B, C'] and w_t [B, T'], the attention to features and to moments."""
        told = _told(style, content, self.styles, self.contents)
        return self.feature(told), self.time(told)

    def forward(self, x: Tensor, style: Tensor, content: Tensor) -> Tensor:
        """x: [B, F, 6J]; labels long [B]. Returns [B], high where it looks real (paper 2, eq. 1)."""
        seen = x.mT
        for part in self.convolutions:
            seen = part(seen)
        return attended(seen, *self.weights(style, content))


def attended(features: Tensor, over_features: Tensor, over_time: Tensor) -> Tensor:
    """The sum of features [B, C', T'] weighed by the outer product of [B, C'] and [B, T'] (paper 2, eq. 1), [B].

    >>> attended(torch.ones(1, 2, 3), torch.tensor([[1.0, 2.0]]), torch.tensor([[1.0, 0.0, 1.0]]))
    tensor([6.])
    """
    return (features * (over_features[:, :, None] * over_time[:, None])).sum((1, 2))


class MultiClassCritic(nn.Module):
    """A discriminator with one head for each style (paper 2, section 5: the ablation without attention).

    >>> MultiClassCritic(5, 3, 4)(torch.randn(2, 24, 30), torch.tensor([0, 3]), torch.tensor([2, 0])).shape
    torch.Size([2])
    """

    def __init__(self, joints: int, contents: int, styles: int, frames: int = WINDOW) -> None:
        super().__init__()
        self.convolutions = _convolutions(6 * joints, norm=False)
        self.heads = nn.Conv1d(WIDTHS[-1], styles, -(-frames // 4))

    def forward(self, x: Tensor, style: Tensor, content: Tensor) -> Tensor:
        """As `FtAttCritic.forward`; the content is not looked at."""
        seen = x.mT
        for part in self.convolutions:
            seen = part(seen)
        return self.heads(seen).mean(2).gather(1, style[:, None])[:, 0]


class ContentNet(nn.Module):
    """Paper 2's content supervision (section 3.1): a classifier whose layers forget style by instance normalisation.

    >>> net = ContentNet(joints=5, contents=3)
    >>> scores, features = net(torch.randn(2, 24, 50))
    >>> scores.shape, [one.shape for one in features]
    (torch.Size([2, 3]), [torch.Size([2, 64, 12]), torch.Size([2, 64, 6])])
    """

    def __init__(self, joints: int, contents: int) -> None:
        super().__init__()
        self.convolutions = _convolutions(10 * joints, norm=True)
        self.head = nn.Linear(WIDTHS[-1], contents)

    def forward(self, x: Tensor) -> tuple[Tensor, list[Tensor]]:
        """x: [B, F, 10J] to scores [B, C], and phi, the maps of every convolution [B, C', F / 2, 4]."""
        seen, features = x.mT, []
        for part in self.convolutions:
            seen = part(seen)
            features.append(seen)
        return self.head(seen.amax(2)), features
