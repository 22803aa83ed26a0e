"""Paper 2's network, Style-ERD: an encoder, residual recurrent branches with learned beginnings, a decoder."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .. import rotations as rot
from ..errors import MotionKitError


@dataclass(frozen=True)
class ErdConfig:
    """Sizes. encoder, decoder: of the hidden layers; latent: of z and of every LSTM; neutral, style: LSTMs in a branch.

    skip: whether what comes in goes around the network, too (beyond the paper, see `put_back`).

    `paper()` is paper 2, supplement A: an encoder of (64, 32), 6 LSTM layers for the neutral branch and 4 for each
    style, a decoder of (58, 86, 128, 184), ReLU between. The paper does not say how the last of these becomes
    quaternions and velocities; here a linear layer follows. Raises MotionKitError for sizes below 1.

    >>> ErdConfig.paper().neutral
    6
    """

    encoder: tuple[int, ...] = (64,)
    latent: int = 32
    neutral: int = 6
    style: int = 4
    decoder: tuple[int, ...] = (58, 86, 128, 184)
    skip: bool = False

    def __post_init__(self) -> None:
        sizes = (*self.encoder, self.latent, self.neutral, self.style, *self.decoder)
        if not all(isinstance(size, int) and size >= 1 for size in sizes) or self.style > self.neutral:
            raise MotionKitError(f"sizes are whole numbers from 1, and no style branch is deeper than neutral; {self}")

    @classmethod
    def paper(cls) -> ErdConfig:
        """As published (paper 2, supplement A)."""
        return cls()

    @classmethod
    def tiny(cls) -> ErdConfig:
        """For tests."""
        return cls((8,), 6, 2, 1, (8, 8))


@dataclass(frozen=True, eq=False)
class ErdState:
    """What a stream remembers: hidden and cell states of neutral [B, 1, L, H] and of styles [B, S - 1, M, H].

    All style branches go on listening, so that another style, or a mix, can be chosen at any frame without a jump.
    """

    neutral: tuple[Tensor, Tensor]
    styles: tuple[Tensor, Tensor]


class Branches(nn.Module):
    """N stacks of LSTM layers side by side, each with weights and a learned beginning of its own.

    beginnings: how many each stack has to choose from, such as one for each content.

    >>> stacks = Branches(count=3, layers=2, size=4, beginnings=1)
    >>> z = torch.randn(2, 5, 4)
    >>> out, state = stacks(z, stacks.begin(torch.zeros(2, dtype=torch.long)))
    >>> out.shape, state[0].shape
    (torch.Size([2, 5, 3, 4]), torch.Size([2, 3, 2, 4]))
    """

    def __init__(self, count: int, layers: int, size: int, beginnings: int) -> None:
        super().__init__()
        reach = 1 / math.sqrt(size)  # PyTorch's default for LSTMs, as in paper 2, supplement A
        shape = (layers, count, 4 * size)
        self.into = nn.Parameter(torch.empty(*shape, size).uniform_(-reach, reach))
        self.over = nn.Parameter(torch.empty(*shape, size).uniform_(-reach, reach))
        self.bias = nn.Parameter(torch.empty(*shape).uniform_(-reach, reach))
        self.hidden, self.cell = (nn.Parameter(torch.zeros(beginnings, count, layers, size)) for _ in range(2))

    def begin(self, chosen: Tensor) -> tuple[Tensor, Tensor]:
        """The learned states to begin with, [B, N, L, H] each; chosen: long [B], which beginning."""
        return self.hidden[chosen], self.cell[chosen]

    def forward(self, z: Tensor, state: tuple[Tensor, Tensor]) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """z: [B, F, H], the same for all stacks. Returns [B, F, N, H] and the state after the last frame."""
        found = [self.alone(n, z, (state[0][:, n], state[1][:, n])) for n in range(self.into.shape[1])]
        x, hidden, cell = (torch.stack([one[k] for one in found], 2 - (k > 0)) for k in range(3))
        return x, (hidden, cell)

    def alone(self, n: int, z: Tensor, state: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
        """The stack with number n on z [B, F, H]; its state, and the one after the last frame, are [B, L, H] each."""
        layers, weights, none = len(self.into), [], torch.zeros_like(self.bias[0, 0])
        for layer in range(layers):
            weights += [self.into[layer, n], self.over[layer, n], self.bias[layer, n], none]
        begun = [part.transpose(0, 1).contiguous() for part in state]
        x, h, c = torch.lstm(z, begun, weights, True, layers, 0.0, self.training, False, True)  # what nn.LSTM calls
        return x, h.transpose(0, 1), c.transpose(0, 1)


class StyleErd(nn.Module):
    """Paper 2's generator (section 3.1): encoder, neutral branch plus the target style's residual, decoder.

    joints: J. contents, styles: how many labels there are, n_C and n_S, the neutral style with the number 0. learned:
    whether the branches' beginnings are learned (table 1's last row has zeros). opened: is added to the first biases of
    the gates that take and give; 0 is PyTorch's default, as in the paper.

    >>> net = StyleErd(joints=5, contents=3, styles=4, config=ErdConfig.tiny())
    >>> x, content, style = torch.randn(2, 24, 50), torch.tensor([0, 2]), torch.tensor([0, 1])
    >>> out, state = net(x, content, style, net.weights_of(torch.tensor([3, 1])))
    >>> out.shape
    torch.Size([2, 24, 35])
    """

    def __init__(
        self,
        joints: int,
        contents: int,
        styles: int,
        config: ErdConfig | None = None,
        learned: bool = True,
        opened: float = 0.0,
    ) -> None:
        super().__init__()
        self.config = config = config or ErdConfig.paper()
        self.joints, self.contents, self.styles = joints, contents, styles
        self.encoder = _mlp(10 * joints + styles + contents, config.encoder, config.latent, last=True)
        self.neutral = Branches(1, config.neutral, config.latent, contents)
        self.residual = Branches(styles - 1, config.style, config.latent, 1)
        self.decoder = _mlp(config.latent + styles, config.decoder, 7 * joints)
        for branch in (self.neutral, self.residual):
            take, _, _, give = branch.bias.detach().chunk(4, -1)
            take += opened
            give += opened
            for beginning in (branch.hidden, branch.cell):
                beginning.requires_grad_(learned)

    def weights_of(self, style: Tensor, strength: float = 1.0) -> Tensor:
        """How much of each style `forward` is to add [B, S], for one style each, long [B] (paper 2, section 4.4)."""
        plain = nn.functional.one_hot(torch.zeros_like(style), self.styles).float()
        return torch.lerp(plain, nn.functional.one_hot(style, self.styles).float(), strength)

    def begin(self, content: Tensor) -> ErdState:
        """The states before the first frame, of learned beginnings (paper 2, section 3.1); content: long [B]."""
        return ErdState(self.neutral.begin(content), self.residual.begin(torch.zeros_like(content)))

    def forward(
        self, x: Tensor, content: Tensor, style: Tensor, wanted: Tensor, state: ErdState | None = None
    ) -> tuple[Tensor, ErdState]:
        """Frames x [B, F, 10J] whose labels are content and style, long [B], to [B, F, 7J] in the styles wanted.

        wanted: [B, S] or [B, F, S], how much of each style, 1 together; one 1 is that style, less of it and the rest
        neutral a weaker one, two styles a mix: z' = r_0(z) + sum alpha r_s(z) (paper 2, section 4.4). Of the neutral
        style nothing is added; but the decoder is told all shares.
        state: after earlier frames; left out, the learned beginning. Returns quaternions, not yet of length 1, and
        velocities; and the state after the last frame.
        """
        heard, state = self.listen(x, content, style, state)
        said = self.say(heard, wanted)
        if self.config.skip:
            said = put_back(x, said, self.say(heard, self.weights_of(style).to(wanted)))
        return said, state

    def encode(self, x: Tensor, content: Tensor, style: Tensor) -> Tensor:
        """z [B, F, H] of frames [B, F, 10J] whose labels are content and style, long [B] (paper 2, section 3.1)."""
        one_hot = nn.functional.one_hot
        told = torch.cat((one_hot(style, self.styles), one_hot(content, self.contents)), 1).to(x)
        return self.encoder(torch.cat((x, told[:, None].expand(-1, x.shape[1], -1)), 2))

    def listen(
        self, x: Tensor, content: Tensor, style: Tensor, state: ErdState | None = None
    ) -> tuple[Tensor, ErdState]:
        """What all branches make of the frames, [B, F, S, H], neutral first; whatever style is wanted later."""
        state = self.begin(content) if state is None else state
        z = self.encode(x, content, style)
        base, neutral = self.neutral(z, state.neutral)
        extra, styles = self.residual(z, state.styles)
        return torch.cat((base, extra), 2), ErdState(neutral, styles)

    def hear(
        self, x: Tensor, content: Tensor, style: Tensor, needed: Tensor, state: ErdState | None = None
    ) -> tuple[Tensor, ErdState]:
        """As `listen`, but only by the branches needed, bool [B, S]; what the others make of it is 0.

        Training asks for one or two of them: neither what it says nor any gradient is another for it.
        """
        state, z = self.begin(content) if state is None else state, self.encode(x, content, style)
        base, neutral = self.neutral(z, state.neutral)
        extra, styles = base.new_zeros(len(z), self.styles - 1, *z.shape[1:]), list(state.styles)
        for n in range(self.styles - 1):
            rows = torch.nonzero(needed[:, n + 1])[:, 0]
            if len(rows):
                own = self.residual.alone(n, z[rows], tuple(part[rows, n] for part in state.styles))
                place = rows, torch.tensor(n, device=rows.device)
                extra, *styles = (part.index_put(place, new) for part, new in zip((extra, *styles), own))
        return torch.cat((base, extra.transpose(1, 2)), 2), ErdState(neutral, tuple(styles))

    def say(self, heard: Tensor, wanted: Tensor) -> Tensor:
        """The decoder's answer in the styles wanted, [B, F, 7J]; heard: of `listen`.

        Where several are mixed, the root's velocity is mixed from what each says alone: unlike poses, what the decoder
        makes of it between two styles may be faster or slower than both (beyond paper 2, section 4.4).
        """
        wanted = wanted if wanted.ndim == 3 else wanted[:, None].expand(-1, heard.shape[1], -1)
        said = self._decoded(heard, wanted)
        if bool(((wanted == 0) | (wanted == 1)).all()):
            return said
        alone = [self._decoded(heard, one.expand_as(wanted)) for one in torch.eye(self.styles).to(wanted)]
        start = 4 * self.joints
        root = sum(wanted[..., s, None] * one[..., start : start + 3] for s, one in enumerate(alone))
        return torch.cat((said[..., :start], root, said[..., start + 3 :]), 2)

    def _decoded(self, heard: Tensor, wanted: Tensor) -> Tensor:
        mixed = heard[:, :, 0] + torch.einsum("bfs,bfsh->bfh", wanted[..., 1:], heard[:, :, 1:])
        return self.decoder(torch.cat((mixed, wanted), 2))


def put_back(x: Tensor, told: Tensor, rebuilt: Tensor) -> Tensor:
    """What a network loses of frames when it rebuilds them, put back into what it told: a skip connection.

    x: frames [..., 10J]; told, rebuilt: answers [..., 7J] in the style wanted and in the frames' own. Each joint gets
    the rotation from the rebuilt one to that which came in, and the velocity that is missing. Where the style wanted
    is the frames' own, they come back as they were. Beyond paper 2, where all must go through 32 numbers.

    >>> x, told = torch.nn.functional.normalize(torch.ones(2, 10), dim=0), torch.ones(2, 7)
    >>> bool(torch.allclose(put_back(x, told, told)[:, 4:], x[:, 7:], atol=1e-6))
    True
    """
    joints = x.shape[-1] // 10
    came, other, own = (part[..., : 4 * joints].unflatten(-1, (joints, 4)) for part in (x, told, rebuilt))
    lost = rot.quaternion_multiply(rot.quaternion_inverse(own), came)
    found = rot.quaternion_multiply(other, rot.positive(lost))
    speeds = told[..., 4 * joints :] + x[..., 7 * joints :] - rebuilt[..., 4 * joints :]
    return torch.cat((found.flatten(-2), speeds), -1)


def _mlp(inside: int, hidden: tuple[int, ...], outside: int, last: bool = False) -> nn.Sequential:
    """Linear layers with ReLU between, and after the last one if asked for."""
    sizes, parts = (inside, *hidden, outside), []
    for a, b in zip(sizes, sizes[1:]):
        parts += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*(parts if last else parts[:-1]))
