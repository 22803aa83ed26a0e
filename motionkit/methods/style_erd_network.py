"""Paper 2's networks, in the order of section 3.1: the generator, the discriminator (eq. 1), the content classifier.

They stand apart from `style_erd`, which trains them: live streams compute in NumPy what the generator does
(`style_erd_numpy`), and `style_erd_new_style` adds a branch to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .. import rotations as rot
from ..errors import MotionKitError
from .style_erd_data import WINDOW

CHANNELS = (64, 64)  # of the convolutions, which the paper does not give


@dataclass(frozen=True)
class Sizes:
    """Of the generator. encoder, decoder: hidden layers; latent: of z and of every LSTM; neutral, style: LSTM layers.

    input_residual: whether what comes in goes around the network, too (beyond the paper, see `input_residual`).

    `paper()` is paper 2, supplement A: an encoder of (64, 32), 6 LSTM layers for the neutral branch and 4 for each
    style, a decoder of (58, 86, 128, 184), ReLU after each, z included. The paper does not say how the last of these
    becomes quaternions and velocities; here a linear layer follows. Raises MotionKitError for sizes below 1.

    >>> Sizes.paper().neutral
    6
    """

    encoder: tuple[int, ...] = (64,)
    latent: int = 32
    neutral: int = 6
    style: int = 4
    decoder: tuple[int, ...] = (58, 86, 128, 184)
    input_residual: bool = False

    def __post_init__(self) -> None:
        sizes = (*self.encoder, self.latent, self.neutral, self.style, *self.decoder)
        if not all(isinstance(size, int) and size >= 1 for size in sizes) or self.style > self.neutral:
            raise MotionKitError(f"sizes are whole numbers from 1, and no style branch is deeper than neutral; {self}")

    @classmethod
    def paper(cls) -> Sizes:
        """As published (paper 2, supplement A)."""
        return cls()

    @classmethod
    def tiny(cls) -> Sizes:
        """For tests."""
        return cls((8,), 6, 2, 1, (8, 8))


# -- the generator ---------------------------------------------------------------------------------------------------

State = tuple[Tensor, Tensor]  # hidden and cell states, [B, N, L, H] each


class LSTMBank(nn.Module):
    """N stacks of LSTM layers side by side, each with weights and learned initial states of its own.

    initial_states: how many each stack has to choose from, such as one for each content.

    >>> stacks = LSTMBank(count=3, layers=2, size=4, initial_states=1)
    >>> z = torch.randn(2, 5, 4)
    >>> out, state = stacks(z, stacks.initial_state(torch.zeros(2, dtype=torch.long)))
    >>> out.shape, state[0].shape
    (torch.Size([2, 5, 3, 4]), torch.Size([2, 3, 2, 4]))
    """

    def __init__(self, count: int, layers: int, size: int, initial_states: int) -> None:
        super().__init__()
        bound = 1 / math.sqrt(size)  # PyTorch's default for LSTMs, as in paper 2, supplement A
        shape = (layers, count, 4 * size)  # the gates are i, f, g, o
        self.w_ih = nn.Parameter(torch.empty(*shape, size).uniform_(-bound, bound))
        self.w_hh = nn.Parameter(torch.empty(*shape, size).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(*shape).uniform_(-bound, bound))
        self.hidden, self.cell = (nn.Parameter(torch.zeros(initial_states, count, layers, size)) for _ in range(2))

    def initial_state(self, chosen: Tensor) -> State:
        """The learned initial states, [B, N, L, H] each (paper 2, section 3.1); chosen: long [B], which."""
        return self.hidden[chosen], self.cell[chosen]

    def forward(self, z: Tensor, state: State) -> tuple[Tensor, State]:
        """z: [B, F, H], the same for all stacks. Returns [B, F, N, H] and the state after the last frame."""
        parts = [self.stack(n, z, (state[0][:, n], state[1][:, n])) for n in range(self.w_ih.shape[1])]
        x, hidden, cell = (torch.stack([part[k] for part in parts], 2 - (k > 0)) for k in range(3))
        return x, (hidden, cell)

    def stack(self, n: int, z: Tensor, state: State) -> tuple[Tensor, Tensor, Tensor]:
        """The stack with number n on z [B, F, H]; its state, and the one after the last frame, are [B, L, H] each."""
        layers, weights, zero = len(self.w_ih), [], torch.zeros_like(self.bias[0, 0])
        for layer in range(layers):
            weights += [self.w_ih[layer, n], self.w_hh[layer, n], self.bias[layer, n], zero]
        first = [part.transpose(0, 1).contiguous() for part in state]
        x, h, c = torch.lstm(z, first, weights, True, layers, 0.0, self.training, False, True)  # what nn.LSTM calls
        return x, h.transpose(0, 1), c.transpose(0, 1)


class StyleErd(nn.Module):
    """Paper 2's generator (section 3.1): encoder, neutral branch plus the target style's residual, decoder.

    joints: J. contents, styles: how many labels there are, n_C and n_S + 1: style 0 is neutral. learned: whether the
    initial states are learned (table 1's last row has zeros). gate_bias: is added to the first biases of the input and
    output gates; 0 is PyTorch's default, as in the paper.

    >>> net = StyleErd(joints=5, contents=3, styles=4, sizes=Sizes.tiny())
    >>> x, content, style = torch.randn(2, 24, 50), torch.tensor([0, 2]), torch.tensor([0, 1])
    >>> out, state = net(x, content, style, net.one_hot(torch.tensor([3, 1])))
    >>> out.shape
    torch.Size([2, 24, 35])
    """

    def __init__(
        self,
        joints: int,
        contents: int,
        styles: int,
        sizes: Sizes | None = None,
        *,
        learned: bool = True,
        gate_bias: float = 0.0,
    ) -> None:
        super().__init__()
        self.config = sizes = sizes or Sizes.paper()
        self.joints, self.contents, self.styles = joints, contents, styles
        self.encoder = _mlp(10 * joints + styles + contents, *sizes.encoder, sizes.latent)
        self.encoder.append(nn.ReLU())
        self.neutral = LSTMBank(1, sizes.neutral, sizes.latent, contents)
        self.residual = LSTMBank(styles - 1, sizes.style, sizes.latent, 1)
        self.decoder = _mlp(sizes.latent + styles, *sizes.decoder, 7 * joints)
        for branch in (self.neutral, self.residual):
            i, _, _, o = branch.bias.detach().chunk(4, -1)
            i += gate_bias
            o += gate_bias
            branch.hidden.requires_grad_(learned)
            branch.cell.requires_grad_(learned)

    def one_hot(self, style: Tensor) -> Tensor:
        """Style weights [B, S] that are all of one style, long [B]."""
        return nn.functional.one_hot(style, self.styles).float()

    def initial_states(self, content: Tensor) -> tuple[State, State]:
        """Of the neutral branch and of all style branches, before the first frame; content: long [B]."""
        return self.neutral.initial_state(content), self.residual.initial_state(torch.zeros_like(content))

    def forward(
        self, x: Tensor, content: Tensor, style: Tensor, style_weights: Tensor, states: tuple | None = None
    ) -> tuple[Tensor, tuple[State, State]]:
        """Frames x [B, F, 10J] with labels content and style to [B, F, 7J] in the styles that the weights say.

        content: long [B], or [B, F] where it changes; style: long [B]. style_weights: [B, S] or [B, F, S], how much of
        each style, 1 together; one 1 is that style, less of it and the rest neutral a weaker one, two styles a mix:
        z' = r_0(z) + sum alpha r_s(z) (paper 2, section 4.4). states: after earlier frames; left out, the learned ones.
        Returns quaternions, not yet of length 1, and velocities; and the states after the last frame.
        """
        features, states = self.branch_features(x, content, style, states=states)
        output = self.decode(features, style_weights)
        if self.config.input_residual:
            output = input_residual(x, output, self.decode(features, self.one_hot(style)))
        return output, states

    def encode(self, x: Tensor, content: Tensor, style: Tensor) -> Tensor:
        """z [B, F, H] of frames [B, F, 10J] with labels content, long [B] or [B, F], and style, long [B]."""
        content = (content[:, None] if content.ndim == 1 else content).expand(-1, x.shape[1])
        style = style[:, None].expand(-1, x.shape[1])
        one_hot = nn.functional.one_hot
        return self.encoder(torch.cat((x, one_hot(style, self.styles), one_hot(content, self.contents)), 2))

    def branch_features(
        self,
        x: Tensor,
        content: Tensor,
        style: Tensor,
        *,
        active: Tensor | None = None,
        states: tuple[State, State] | None = None,
    ) -> tuple[Tensor, tuple[State, State]]:
        """The outputs of all branches, [B, F, S, H], neutral first, and their states after the last frame.

        All style branches run on, so that another style, or a mix, can be chosen at any frame without a jump. active:
        bool [B, S], the only ones that are needed; the features of the others are 0. Training asks for one or two of
        them: neither the output nor any gradient depends on the others.
        """
        first = content if content.ndim == 1 else content[:, 0]
        neutral_state, style_state = self.initial_states(first) if states is None else states
        z = self.encode(x, content, style)
        neutral, neutral_state = self.neutral(z, neutral_state)
        if active is None:
            styled, style_state = self.residual(z, style_state)
            return torch.cat((neutral, styled), 2), (neutral_state, style_state)
        styled, style_state = neutral.new_zeros(len(z), self.styles - 1, *z.shape[1:]), list(style_state)
        for n in range(self.styles - 1):
            rows = torch.nonzero(active[:, n + 1])[:, 0]
            if len(rows):
                parts = self.residual.stack(n, z[rows], tuple(part[rows, n] for part in style_state))
                place = rows, torch.tensor(n, device=rows.device)
                styled, *style_state = (a.index_put(place, b) for a, b in zip((styled, *style_state), parts))
        return torch.cat((neutral, styled.transpose(1, 2)), 2), (neutral_state, tuple(style_state))

    def decode(self, features: Tensor, style_weights: Tensor) -> Tensor:
        """The decoder's output in the styles wanted, [B, F, 7J]; features: of `branch_features`.

        Where several are mixed, the root's velocity is mixed from that of each style alone: unlike poses, what the
        decoder makes of it between two styles may be faster or slower than both (beyond paper 2, section 4.4).
        """
        weights = style_weights if style_weights.ndim == 3 else style_weights[:, None].expand(-1, features.shape[1], -1)
        output = self._decode(features, weights)
        if bool(((weights == 0) | (weights == 1)).all()):
            return output
        alone = [self._decode(features, one.expand_as(weights)) for one in torch.eye(self.styles).to(weights)]
        start = 4 * self.joints
        root = sum(weights[..., s, None] * one[..., start : start + 3] for s, one in enumerate(alone))
        return torch.cat((output[..., :start], root, output[..., start + 3 :]), 2)

    def _decode(self, features: Tensor, weights: Tensor) -> Tensor:
        """z' = r_0 + the weighted residuals of styles, decoded; neutral is r_0 alone (paper 2, sections 3.1, 4.4)."""
        mixed = features[:, :, 0] + torch.einsum("bfs,bfsh->bfh", weights[..., 1:], features[:, :, 1:])
        return self.decoder(torch.cat((mixed, weights), 2))


def input_residual(x: Tensor, output: Tensor, rebuilt: Tensor) -> Tensor:
    """What a network loses of frames when it reconstructs them, put back into its output: a skip connection.

    x: frames [..., 10J]; output, rebuilt: [..., 7J] in the style wanted and in the frames' own. Each joint gets the
    rotation from the reconstructed one to that which came in, and the velocity that is missing. Where the style wanted
    is the frames' own, they come back as they were. Beyond paper 2, where all must go through 32 numbers.

    >>> x, output = torch.nn.functional.normalize(torch.ones(2, 10), dim=0), torch.ones(2, 7)
    >>> bool(torch.allclose(input_residual(x, output, output)[:, 4:], x[:, 7:], atol=1e-6))
    True
    """
    joints = x.shape[-1] // 10
    source, styled, own = (part[..., : 4 * joints].unflatten(-1, (joints, 4)) for part in (x, output, rebuilt))
    lost = rot.quaternion_multiply(rot.quaternion_inverse(own), source)
    rotations = rot.quaternion_multiply(styled, rot.quaternion_canonical(lost))
    velocities = output[..., 4 * joints :] + x[..., 7 * joints :] - rebuilt[..., 4 * joints :]
    return torch.cat((rotations.flatten(-2), velocities), -1)


def _mlp(*sizes: int) -> nn.Sequential:
    """Linear layers with ReLU between."""
    layers = [nn.Linear(a, b) for a, b in zip(sizes, sizes[1:])]
    return nn.Sequential(*[part for layer in layers for part in (nn.ReLU(), layer)][1:])


# -- the supervision modules -----------------------------------------------------------------------------------------


def _convolutions(channels: int, *, norm: bool) -> nn.Sequential:
    """1D convolutions over time that halve it, each with LeakyReLU, and instance normalisation where asked for."""
    layers = nn.Sequential()
    for before, after in zip((channels, *CHANNELS), CHANNELS):
        convolution = nn.Conv1d(before, after, 5, stride=2, padding=2)
        normalisation = [nn.InstanceNorm1d(after)] if norm else []
        layers.append(nn.Sequential(convolution, *normalisation, nn.LeakyReLU(0.2)))
    return layers


class FTAttDiscriminator(nn.Module):
    """The FT-Att discriminator of paper 2 (section 3.1, figure 3): what it sees counts by style and content.

    joints: J; it sees positions and velocities, 6J numbers a frame. contents, styles: how many labels. frames: of a
    window.

    >>> critic = FTAttDiscriminator(joints=5, contents=3, styles=4)
    >>> critic(torch.randn(2, 24, 30), torch.tensor([0, 3]), torch.tensor([2, 0])).shape
    torch.Size([2])
    """

    def __init__(self, joints: int, contents: int, styles: int, frames: int = WINDOW) -> None:
        super().__init__()
        self.contents, self.styles = contents, styles
        self.convolutions = _convolutions(6 * joints, norm=False)
        self.feature, self.time = (
            nn.Sequential(nn.Linear(styles + contents, 64), nn.LeakyReLU(0.2), nn.Linear(64, size))
            for size in (CHANNELS[-1], -(-frames // 4))
        )

    def weights(self, style: Tensor, content: Tensor) -> tuple[Tensor, Tensor]:
        """w_f [B, C'] and w_t [B, T'], the attention to features and to moments."""
        one_hot = nn.functional.one_hot
        labels = torch.cat((one_hot(style, self.styles), one_hot(content, self.contents)), 1).float()
        return self.feature(labels), self.time(labels)

    def forward(self, x: Tensor, style: Tensor, content: Tensor) -> Tensor:
        """x: [B, F, 6J]; labels long [B]. Returns [B], high where it looks real (paper 2, eq. 1)."""
        return attention_score(self.convolutions(x.mT), *self.weights(style, content))


def attention_score(features: Tensor, over_features: Tensor, over_time: Tensor) -> Tensor:
    """The sum of features [B, C', T'] weighed by the outer product of [B, C'] and [B, T'] (paper 2, eq. 1), [B].

    >>> attention_score(torch.ones(1, 2, 3), torch.tensor([[1.0, 2.0]]), torch.tensor([[1.0, 0.0, 1.0]]))
    tensor([6.])
    """
    return (features * (over_features[:, :, None] * over_time[:, None])).sum((1, 2))


class MultiClassDiscriminator(nn.Module):
    """A discriminator with one head for each style (paper 2, section 5: the ablation without attention).

    >>> MultiClassDiscriminator(5, 3, 4)(torch.randn(2, 24, 30), torch.tensor([0, 3]), torch.tensor([2, 0])).shape
    torch.Size([2])
    """

    def __init__(self, joints: int, contents: int, styles: int, frames: int = WINDOW) -> None:
        super().__init__()
        self.convolutions = _convolutions(6 * joints, norm=False)
        self.heads = nn.Conv1d(CHANNELS[-1], styles, -(-frames // 4))

    def forward(self, x: Tensor, style: Tensor, content: Tensor) -> Tensor:
        """As `FTAttDiscriminator.forward`; the content is not looked at."""
        return self.heads(self.convolutions(x.mT)).mean(2).gather(1, style[:, None])[:, 0]


class ContentClassifier(nn.Module):
    """Paper 2's content supervision (section 3.1): a classifier whose layers forget style by instance normalisation.

    >>> net = ContentClassifier(joints=5, contents=3)
    >>> scores, features = net(torch.randn(2, 24, 50))
    >>> scores.shape, [one.shape for one in features]
    (torch.Size([2, 3]), [torch.Size([2, 64, 12]), torch.Size([2, 64, 6])])
    """

    def __init__(self, joints: int, contents: int) -> None:
        super().__init__()
        self.convolutions = _convolutions(10 * joints, norm=True)
        self.head = nn.Linear(CHANNELS[-1], contents)

    def forward(self, x: Tensor) -> tuple[Tensor, list[Tensor]]:
        """x: [B, F, 10J] to scores [B, C], and phi, the maps of both convolutions, [B, C', F/2] and [B, C', F/4]."""
        x, features = x.mT, []
        for layer in self.convolutions:
            x = layer(x)
            features.append(x)
        return self.head(x.amax(2)), features
