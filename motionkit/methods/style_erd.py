"""Paper 2's network, Style-ERD: an encoder, residual recurrent branches with learned beginnings, a decoder."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.func import functional_call

from .. import checkpoints
from .. import rotations as rot
from ..datasets import Clip, Dataset
from ..errors import MotionKitError
from ..features.style_erd import SETTLE, TENTH
from ..kinematics import forward_kinematics
from ..motion import Motion, facing_of
from ..skeleton import Skeleton
from ..training import Run, TrainConfig, default_path, fit, main_process_first, training_card
from .base import check_motions, check_strength, clean_up_feet, result_name, retarget_to, without_helper_joints
from .neutral_pairs import NEUTRAL, NeutralPairs
from .style_erd_stream import (
    FRAMES,
    ErdStream,
    FrameClassifier,
    LabelTracker,
    NumpyKinematics,
    NumpyStep,
    label_accuracy,
    train_frame_classifier,
)


@dataclass(frozen=True)
class ErdConfig:
    """Sizes. encoder, decoder: of the hidden layers; latent: of z and of every LSTM; neutral, style: LSTMs in a branch.

    skip: whether what comes in goes around the network, too (beyond the paper, see `input_residual`).

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


class LSTMBank(nn.Module):
    """N stacks of LSTM layers side by side, each with weights and a learned beginning of its own.

    beginnings: how many each stack has to choose from, such as one for each content.

    >>> stacks = LSTMBank(count=3, layers=2, size=4, beginnings=1)
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
        self.neutral = LSTMBank(1, config.neutral, config.latent, contents)
        self.residual = LSTMBank(styles - 1, config.style, config.latent, 1)
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
            said = input_residual(x, said, self.say(heard, self.weights_of(style).to(wanted)))
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


def input_residual(x: Tensor, told: Tensor, rebuilt: Tensor) -> Tensor:
    """What a network loses of frames when it rebuilds them, put back into what it told: a skip connection.

    x: frames [..., 10J]; told, rebuilt: answers [..., 7J] in the style wanted and in the frames' own. Each joint gets
    the rotation from the rebuilt one to that which came in, and the velocity that is missing. Where the style wanted
    is the frames' own, they come back as they were. Beyond paper 2, where all must go through 32 numbers.

    >>> x, told = torch.nn.functional.normalize(torch.ones(2, 10), dim=0), torch.ones(2, 7)
    >>> bool(torch.allclose(input_residual(x, told, told)[:, 4:], x[:, 7:], atol=1e-6))
    True
    """
    joints = x.shape[-1] // 10
    came, other, own = (part[..., : 4 * joints].unflatten(-1, (joints, 4)) for part in (x, told, rebuilt))
    lost = rot.quaternion_multiply(rot.quaternion_inverse(own), came)
    found = rot.quaternion_multiply(other, rot.quaternion_canonical(lost))
    speeds = told[..., 4 * joints :] + x[..., 7 * joints :] - rebuilt[..., 4 * joints :]
    return torch.cat((found.flatten(-2), speeds), -1)


def _mlp(inside: int, hidden: tuple[int, ...], outside: int, last: bool = False) -> nn.Sequential:
    """Linear layers with ReLU between, and after the last one if asked for."""
    sizes, parts = (inside, *hidden, outside), []
    for a, b in zip(sizes, sizes[1:]):
        parts += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*(parts if last else parts[:-1]))


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
        return attention_score(seen, *self.weights(style, content))


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
        self.heads = nn.Conv1d(WIDTHS[-1], styles, -(-frames // 4))

    def forward(self, x: Tensor, style: Tensor, content: Tensor) -> Tensor:
        """As `FTAttDiscriminator.forward`; the content is not looked at."""
        seen = x.mT
        for part in self.convolutions:
            seen = part(seen)
        return self.heads(seen).mean(2).gather(1, style[:, None])[:, 0]


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
        self.head = nn.Linear(WIDTHS[-1], contents)

    def forward(self, x: Tensor) -> tuple[Tensor, list[Tensor]]:
        """x: [B, F, 10J] to scores [B, C], and phi, the maps of every convolution [B, C', F / 2, 4]."""
        seen, features = x.mT, []
        for part in self.convolutions:
            seen = part(seen)
            features.append(seen)
        return self.head(seen.amax(2)), features


ADVERSARIAL, PERCEPTUAL, PENALTY = 1.0, 0.1, 128.0  # w_adv, w_per and w_gp (paper 2, below eq. 9)


def quaternion_loss(a: Tensor, b: Tensor) -> Tensor:
    """The squared angles between unit quaternions [..., J, 4] (paper 2, eq. 2), summed over joints, [...].

    The arc cosine of |a . b|, half the angle of the rotation from one to the other. Near equal ones its gradient has no
    end; the same angle by the arc tangent is gentle there.

    >>> turned = torch.tensor([[0.5, 0.5, 0.5, 0.5]])
    >>> quaternion_loss(torch.tensor([[1.0, 0.0, 0.0, 0.0]]), -turned)  # (pi / 3) squared: both signs are one rotation
    tensor(1.0966)
    """
    w, *v = rot.quaternion_multiply(rot.quaternion_inverse(a), b).unbind(-1)
    across = sum(x * x for x in v).clamp(min=1e-12).sqrt()
    return (torch.atan2(across, w.abs()) ** 2).sum(-1)


def reconstruction_loss(
    rotations: tuple[Tensor, Tensor], positions: tuple[Tensor, Tensor], velocities: tuple[Tensor, Tensor]
) -> Tensor:
    """How far rebuilt frames are from those that came in (paper 2, eq. 3), [B, F].

    Each a pair, came in and rebuilt: unit quaternions [B, F, J, 4], positions and velocities [B, F, J, 3].

    >>> still = (rot.identity_quaternion(1, 2, 5), rot.identity_quaternion(1, 2, 5))
    >>> there, here = torch.zeros(1, 2, 5, 3), torch.ones(1, 2, 5, 3)
    >>> reconstruction_loss(still, (there, here), (there, there))
    tensor([[7.5000, 7.5000]])
    """
    turned = quaternion_loss(*rotations)
    places, speeds = (((a - b) ** 2).sum((-2, -1)) for a, b in (positions, velocities))
    return turned + 0.5 * places + speeds


def adversarial_loss(fake: Tensor) -> Tensor:
    """What the generator wants of the critic's answers [B] to its motions: 0 (paper 2, eq. 4, as written).

    >>> adversarial_loss(torch.tensor([-1.0, 0.0]))
    tensor(0.5000)
    """
    return (fake**2).mean()


def discriminator_loss(real: Tensor, fake: Tensor) -> Tensor:
    """What the critic wants: 1 of real motions, -1 of made ones, both [B] (paper 2, eq. 5).

    >>> discriminator_loss(torch.tensor([1.0]), torch.tensor([0.0]))
    tensor(1.)
    """
    return ((real - 1) ** 2).mean() + ((fake + 1) ** 2).mean()


def gradient_penalty(answers: Tensor, real: Tensor) -> Tensor:
    """The squared gradient of the critic at real motions (paper 2, eq. 6; Mescheder et al. 2018).

    answers: [B], the critic's; real: [B, ...], what it saw, which must ask for gradients.

    >>> x = torch.ones(2, 3, requires_grad=True)
    >>> gradient_penalty((2 * x).sum(1), x)
    tensor(12.)
    """
    slope = torch.autograd.grad(answers.sum(), real, create_graph=True)[0]
    return slope.flatten(1).square().sum(1).mean()


def perceptual_loss(before: Sequence[Tensor], after: Sequence[Tensor]) -> Tensor:
    """How far the content network's maps are apart, before and after the transfer (paper 2, eq. 7).

    Maps [B, C', T'] of every layer; the mean of squares of each, summed over layers.

    >>> perceptual_loss([torch.zeros(1, 2, 3)], [torch.full((1, 2, 3), 2.0)])
    tensor(4.)
    """
    return sum(((a - b) ** 2).mean() for a, b in zip(before, after, strict=True))


def generator_objective(rebuilt: Tensor, adversarial: Tensor, perceptual: Tensor) -> Tensor:
    """The generator's loss (paper 2, eq. 8): rebuilding of all frames [B, F], and what both supervisors say.

    >>> generator_objective(torch.ones(2, 24), torch.tensor(0.5), torch.tensor(2.0))
    tensor(24.7000)
    """
    return rebuilt.sum(1).mean() + ADVERSARIAL * adversarial + PERCEPTUAL * perceptual


def discriminator_objective(critic: Tensor, penalty: Tensor) -> Tensor:
    """The critic's loss (paper 2, eq. 9).

    >>> discriminator_objective(torch.tensor(2.0), torch.tensor(0.5))
    tensor(66.)
    """
    return critic + PENALTY * penalty


@dataclass(frozen=True, eq=False)
class Frames:
    """A motion as the network sees it, every frame from its own place on the ground and facing.

    rotations: unit quaternions [F, J, 4], local, the root's without the facing. positions: [F, J, 3] metres above the
    root's place on the ground. velocities: [F, J, 3], since the frame before, metres a tenth of a second; 0 in the
    first frame, before which nothing is known. yaw: [F] radians and ground: [F, 2] metres, where each frame stands.
    """

    rotations: Tensor
    positions: Tensor
    velocities: Tensor
    yaw: Tensor
    ground: Tensor

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def x(self) -> Tensor:
        """All that the network is given of a frame (paper 2, section 3.1), [F, 10J]."""
        return torch.cat([part.flatten(1) for part in (self.rotations, self.positions, self.velocities)], 1)

    @property
    def seen(self) -> Tensor:
        """What the critic sees, positions and velocities (paper 2, section 3.1), [F, 6J]."""
        return torch.cat((self.positions.flatten(1), self.velocities.flatten(1)), 1)


def frames_of(motion: Motion) -> Frames:
    """A motion of F frames, its root the pelvis, as `Frames` (paper 2, section 3.1).

    Unlike the paper's, directions are the facing's and not the world's: one who walks in a circle for an hour looks the
    same all the time. Frame n needs frame n - 1 and no other.

    >>> import motionkit as mk
    >>> frames_of(mk.load("data/actor/walk_neutral.bvh")).x.shape
    torch.Size([120, 220])
    """
    body = without_helper_joints(motion)
    if not len(body):
        raise MotionKitError(f"motion {motion.name!r} has no frames")
    places, world = body.positions(), body.rotations
    yaw = facing_of(body.skeleton, places, world)
    back = rot.yaw_to_quaternion(-yaw)
    ground = places[:, 0] * places.new_tensor([1.0, 0.0, 1.0])
    turned = torch.cat((rot.quaternion_multiply(back, world[:, 0])[:, None], world[:, 1:]), 1)
    turned = turned * torch.where(turned[..., :1] < 0, -1.0, 1.0)  # q and -q are one rotation; the nearer half to rest
    moved = torch.cat((torch.zeros_like(places[:1]), places.diff(dim=0))) * (body.fps / TENTH)
    local, speed = (rot.quaternion_rotate(back[:, None], one) for one in (places - ground[:, None], moved))
    return Frames(turned, local, speed, yaw, ground[:, [0, 2]])


def zero_first_velocity(x: Tensor, joints: int) -> Tensor:
    """Windows of frames [N, F, 10J] as a stream sees them at its start: of the first one no velocity is known.

    >>> zero_first_velocity(torch.ones(1, 2, 10), joints=1)[0, :, -4:]
    tensor([[1., 0., 0., 0.],
            [1., 1., 1., 1.]])
    """
    x = x.clone()
    x[:, 0, -3 * joints :] = 0
    return x


def split(y: Tensor) -> tuple[Tensor, Tensor]:
    """The network's answer [..., 7J] as unit quaternions [..., J, 4] and velocities [..., J, 3].

    >>> rotations, velocities = split(torch.ones(2, 14))
    >>> rotations.shape, velocities.shape
    (torch.Size([2, 2, 4]), torch.Size([2, 2, 3]))
    """
    joints = y.shape[-1] // 7
    turns, speeds = y[..., : 4 * joints], y[..., 4 * joints :]
    return rot.normalize(turns.unflatten(-1, (joints, 4))), speeds.unflatten(-1, (joints, 3))


def placed_positions(skeleton: Skeleton, offsets: Tensor, rotations: Tensor, lowest: Tensor) -> Tensor:
    """Positions [..., J, 3] by forward kinematics, as high as the lowest foot is to be, [...] (paper 2, section 3.1).

    offsets: [..., J, 3], of each body. The network says nothing of the root's height: whoever bends his knees comes
    down, and one whose feet are off the ground stays in the air.
    """
    lying = offsets.clone()
    lying[..., 0, :] = 0
    places = forward_kinematics(skeleton, rotations, lying.expand(*rotations.shape[:-1], 3))
    up = lowest - places[..., list(skeleton.feet()), 1].amin(-1)
    return places + torch.stack((torch.zeros_like(up), up, torch.zeros_like(up)), -1)[..., None, :]


def lowest_foot(skeleton: Skeleton, positions: Tensor) -> Tensor:
    """The height of the lower foot, [...], from positions [..., J, 3]."""
    return positions[..., list(skeleton.feet()), 1].amin(-1)


def motion_from(content: Motion, frames: Frames, rotations: Tensor, velocities: Tensor) -> Motion:
    """The network's answers for all frames as a motion on the content's body, which starts where the content does.

    rotations, velocities: of `split`, [F, J, 4] and [F, J, 3]. Facing is the content's; the path is the root's velocity
    added up (paper 2, section 3.1, leaves the path open). Its height is, too, and drawn to where the lower foot is as
    high as the content's: that height alone would jump a little whenever the other foot becomes the lower one.
    """
    body = without_helper_joints(content)
    skeleton, offsets = body.skeleton, body.translations
    low = lowest_foot(skeleton, frames.positions)
    height = filter_height(placed_positions(skeleton, offsets, rotations, low)[:, 0, 1], velocities[:, 0, 1], body.fps)
    facing = rot.yaw_to_quaternion(frames.yaw)
    step = velocities[:, 0] * velocities.new_tensor([1.0, 0.0, 1.0]) * (TENTH / body.fps)
    step[0] = 0
    path = rot.quaternion_rotate(facing, step).cumsum(0)[:, [0, 2]] + frames.ground[:1]
    root = torch.stack((path[:, 0], height, path[:, 1]), 1)
    turned = torch.cat((rot.quaternion_multiply(facing, rotations[:, 0])[:, None], rotations[:, 1:]), 1)
    translations = torch.cat((root[:, None], offsets[:, 1:]), 1)
    return content.with_helper_joints_of(body.replace(rotations=turned, translations=translations))


def filter_height(heights: Tensor, speeds: Tensor, fps: float) -> Tensor:
    """The root's heights [F] from those by the lower foot [F] and its vertical velocities [F], metres a tenth second.

    >>> filter_height(torch.tensor([1.0, 2.0, 2.0]), torch.zeros(3), 60.0)
    tensor([1.0000, 1.3000, 1.5100])
    """
    found = [heights[0]]
    for height, up in zip(heights[1:], speeds[1:] * (TENTH / fps)):
        found.append(torch.lerp(found[-1] + up, height, SETTLE))
    return torch.stack(found)


OVERLAP = 4  # frames of two windows (paper 2, section 4.1)


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of a labelled dataset, of WINDOW frames each if nothing else is asked for.

    x: [N, F, 10J], each as the beginning of a stream, see `style_erd.zero_first_velocity`. going: [N, 3J], the
    velocities of the first frame, where it is none. earlier: long [N], how many windows of the same clip come before
    it. offsets: [N, J, 3] of each body; content, style: long [N], the neutral style 0. twin: long [N], the window that
    does the same in step, in a style or in none; -1: there is none. recorded: how many, the first, are of clips as they
    are; the others are of neutral clips warped to the time of styled ones.
    """

    x: Tensor
    going: Tensor
    earlier: Tensor
    offsets: Tensor
    content: Tensor
    style: Tensor
    contents: tuple[str, ...]
    styles: tuple[str, ...]
    twin: Tensor
    recorded: int

    @classmethod
    def of(cls, data: Dataset, fps: float, frames: int = WINDOW, registered: bool = False) -> Windows:
        """All windows of all clips; MotionKitError where no style is neutral, or no clip is long enough.

        registered: and windows of the neutral clip that comes nearest to each styled one, in its time.
        """
        plain = [style for style in data.styles if style in NEUTRAL]
        if not plain:
            raise MotionKitError(f"Style-ERD needs a neutral style; dataset {data.name!r} has {', '.join(data.styles)}")
        styles = (*plain[:1], *(style for style in data.styles if style not in plain))
        rows: list[tuple] = []
        warped: list[tuple] = []
        pairs = _Partners(data) if registered else None
        for clip in data:
            labels = data.contents.index(clip.content), styles.index(clip.style)
            found = _windows(without_helper_joints(clip.motion), fps, frames, *labels)
            partner = pairs.of(clip) if pairs and labels[1] else None
            if partner is not None:
                twins = _windows(partner, fps, frames, labels[0], 0)
                warped += [(len(rows) + k, row) for k, row in enumerate(twins)]
            rows += found
        if not rows:
            raise MotionKitError(f"no clip of {data.name!r} has {frames} frames at {fps:g} a second")
        recorded, twin = len(rows), torch.full((len(rows) + len(warped),), -1)
        for n, (number, row) in enumerate(warped, recorded):
            twin[n], twin[number] = number, n
            rows.append(row)
        x, earlier, offsets, content, style = zip(*rows)
        x, joints = torch.stack(x), len(offsets[0])
        earlier, content, style = map(torch.tensor, (earlier, content, style))
        going = x[torch.arange(len(x)), (earlier == 0).long(), -3 * joints :]  # a clip's first frame knows none
        known = tuple(data.contents), styles, twin, recorded
        return cls(zero_first_velocity(x, joints), going, earlier, torch.stack(offsets), content, style, *known)

    def amid(self, rows: Tensor) -> Tensor:
        """Windows [..., F, 10J] as they are in the middle of a stream, by their numbers, long [...]."""
        x = self.x[rows].clone()
        x[..., 0, -self.going.shape[1] :] = self.going[rows]
        return x

    def run_up(self, chosen: Tensor, back: int) -> Tensor:
        """The frames before windows, long [B], from the beginning of the `back`-th window before: [B, R, 10J]."""
        rows = chosen[:, None] - torch.arange(back, 0, -1)
        x = self.amid(rows)[:, :, :-OVERLAP].flatten(1, 2)
        return zero_first_velocity(x, x.shape[2] // 10)

    def members(self) -> dict[tuple[int, int], Tensor]:
        """The recorded windows of every content and style."""
        found: dict[tuple[int, int], list[int]] = {}
        for n, kind in enumerate(zip(self.content[: self.recorded].tolist(), self.style.tolist())):
            found.setdefault(kind, []).append(n)
        return {kind: torch.tensor(own) for kind, own in found.items()}


class _Partners:
    """For styled clips of a dataset its neutral clips, each the nearest of its content, in the styled clip's time."""

    def __init__(self, data: Dataset) -> None:
        self.pairs = NeutralPairs(data, smooth=True)
        self.able = {clip.content for clip in data.filter(style=next(s for s in data.styles if s in NEUTRAL))}

    def of(self, clip: Clip) -> Motion | None:
        """The neutral motion; None where nobody does this neutrally."""
        body = without_helper_joints(clip.motion)
        return self.pairs.pair(body, clip.content, like=body).neutral if clip.content in self.able else None


def _windows(motion: Motion, fps: float, frames: int, content: int, style: int) -> list[tuple]:
    """A clip's windows: frames, how many come before, offsets of the body, labels."""
    x = frames_of(motion if abs(motion.fps - fps) < 1e-3 else motion.resample(fps, smooth=True)).x
    starts = range(0, len(x) - frames + 1, frames - OVERLAP)
    return [(x[n : n + frames], k, motion.translations[0], content, style) for k, n in enumerate(starts)]


@dataclass(frozen=True)
class Config:
    """How it is trained (paper 2, section 3.2 and supplement A).

    steps, batch, rate: of the generator; slower: the critic's rate over it. adversarial, perceptual, attention,
    beginnings: false leaves that part out (table 1). fps: of the windows. cycle: above 0, styles need not have been
    seen doing the same (beyond the paper, its section C.1): the critic is shown whatever there is of a style,
    and what was told in another style must come back as it was, which counts so much. run_up: half of the batches are
    not the beginning of a stream; their memory comes from up to so many earlier windows (beyond the paper, where each
    window begins anew). opened: added to the biases of the gates that take and give before training, so that more
    gets through deep stacks from the first step on. steady: how much it counts that rebuilt positions move from frame
    to frame as those that came in do, or they tremble (beyond the paper). registered: how much it counts that a window
    with a twin (see `Windows`) is told as that one; the paper needs pairs, but none in step. `paper()` is as published,
    `laptop()` has the same parts and sizes.
    """

    config: ErdConfig = ErdConfig()
    steps: int = 20000
    batch: int = 16
    rate: float = 1e-4
    slower: float = 0.5
    fps: float = 60.0
    adversarial: bool = True
    perceptual: bool = True
    attention: bool = True
    beginnings: bool = True
    cycle: float = 0.0
    run_up: int = 0
    opened: float = 0.0
    steady: float = 0.0
    registered: float = 0.0

    @classmethod
    def paper(cls, windows: int) -> Config:
        """Paper 2, supplement A: 2,000 epochs, batch 16, rates 0.0001 and 0.00005; windows: how many there are."""
        return cls(steps=2000 * -(-windows // 16))

    @classmethod
    def laptop(cls) -> Config:
        """Larger batches and rates, fewer steps; run-ups, open gates, steadiness, twins, what is lost is put back."""
        beyond = {"run_up": 9, "opened": 1.5, "steady": 8.0, "registered": 1.0, "config": ErdConfig(skip=True)}
        return cls(steps=16000, batch=64, rate=3e-3, **beyond)


_FULL = replace(Config.laptop(), registered=0.0, config=ErdConfig())
ABLATIONS = {  # the rows of paper 2's table 1, each one call, and two of which the paper knows nothing
    "ours": _FULL,
    "L_gen = L_rec": replace(_FULL, adversarial=False, perceptual=False),
    "L_gen = L_rec + L_adv": replace(_FULL, perceptual=False),
    "L_gen = L_rec + L_per": replace(_FULL, adversarial=False),
    "without attention": replace(_FULL, attention=False),
    "without learned beginnings": replace(_FULL, beginnings=False),
    "ours + twins": replace(_FULL, registered=Config.laptop().registered),
    "ours + twins + skip": Config.laptop(),
}


class Pair(nn.Module):
    """Generator and critic side by side, so that one loop trains both, the critic at a rate of its own."""

    def __init__(self, generator: StyleErd, critic: nn.Module, slower: float) -> None:
        super().__init__()
        self.generator, self.critic, self.slower = generator, critic, slower

    def parameter_groups(self) -> list[dict]:
        """For `training.fit`: what is trained, and at which share of the rate."""
        mine = [weight for weight in self.generator.parameters() if weight.requires_grad]
        return [{"params": mine, "share": 1.0}, {"params": list(self.critic.parameters()), "share": self.slower}]

    def judged(self, seen: Tensor, style: Tensor, content: Tensor) -> Tensor:
        """The critic's answers, by which the generator learns and the critic does not."""
        fixed = {name: weight.detach() for name, weight in self.critic.named_parameters()}
        return functional_call(self.critic, fixed, (seen, style, content))


@dataclass(frozen=True, eq=False)
class StyleErdLoss:
    """All that a step of training needs: windows, the skeleton that they are on, the content network, the recipe."""

    pieces: Windows
    skeleton: Skeleton
    contents: ContentClassifier
    recipe: Config

    def draw(self, back: int = 0) -> tuple[Tensor, Tensor]:
        """Windows by chance, long [B], and the style that each is to be told in, long [B] (paper 2, section 3.2).

        Neutral ones go to any other style that has this content, styled ones to neutral, and who has a twin to its
        style. With a cycle the content does not matter. back: how many windows there must be before each.
        """
        able = torch.nonzero(self.pieces.earlier >= back)[:, 0]
        chosen = able[torch.randint(len(able), (self.recipe.batch,))]
        wanted = []
        for content, style in zip(self.pieces.content[chosen].tolist(), self.pieces.style[chosen].tolist()):
            others = sorted({s for c, s in self.members if s != 0 and (c == content or self.recipe.cycle)})
            wanted.append(others[int(torch.rand(()) * len(others))] if style == 0 and others else 0)
        twin, wanted = self.pieces.twin[chosen], torch.tensor(wanted)
        return chosen, torch.where(twin < 0, wanted, self.pieces.style[twin])

    @cached_property
    def members(self) -> dict[tuple[int, int], Tensor]:
        """See `Windows.members`."""
        return self.pieces.members()

    @cached_property
    def by_style(self) -> dict[int, Tensor]:
        """The windows of every style."""
        style = self.pieces.style[: self.pieces.recorded]
        return {s: torch.nonzero(style == s)[:, 0] for s in set(style.tolist())}

    def back(self) -> int:
        """How many windows a batch's memory comes from: for half of them none, nor for cycles; else up to `run_up`."""
        most = 0 if self.recipe.cycle else min(self.recipe.run_up, int(self.pieces.earlier.max()))
        return int(torch.randint(1, most + 1, ())) if most and torch.rand(()) < 0.5 else 0

    def real(self, content: Tensor, style: Tensor, amid: bool = False) -> tuple[Tensor, Tensor]:
        """For each content and style a real window by chance, [B, F, 6J], and its content, long [B].

        It is the paired motion, not in step with it; with a cycle, any motion in this style. amid: in the middle of a
        stream.
        """
        kinds = zip(content.tolist(), style.tolist())
        own = [self.by_style[kind[1]] if self.recipe.cycle else self.members[kind] for kind in kinds]
        rows = torch.stack([kind[int(torch.rand(()) * len(kind))] for kind in own])
        x = self.pieces.amid(rows) if amid else self.pieces.x[rows]
        return x[..., 4 * len(self.skeleton) :], self.pieces.content[rows]

    def loss(self, pair: Pair) -> Tensor:
        """One step's loss of both, eqs. 8 and 9 of paper 2 together: neither's gradient reaches the other."""
        recipe, joints, back = self.recipe, len(self.skeleton), self.back()
        chosen, target = self.draw(back)
        x, content, style = (part[chosen] for part in (self.pieces.x, self.pieces.content, self.pieces.style))
        x = self.pieces.amid(chosen) if back else x
        came, net, state = _parts(x, joints), pair.generator, None
        offsets, low = self.pieces.offsets[chosen][:, None], lowest_foot(self.skeleton, came[1])
        place = partial(placed_positions, self.skeleton, offsets, lowest=low)
        needed = (net.weights_of(style) + net.weights_of(target)) > 0
        if back:
            with torch.no_grad():
                state = net.hear(self.pieces.run_up(chosen, back), content, style, needed)[1]
        heard, _ = net.hear(x, content, style, needed, state)
        rebuilt, told = self._answers(net, x, heard, style, target)
        made = place(told[0])
        rebuilding = self._missed(came, (rebuilt[0], place(rebuilt[0]), rebuilt[1]))
        if recipe.registered:
            rebuilding = rebuilding + recipe.registered * self._unlike_twins(chosen, back > 0, place, made, told)
        fake = torch.cat((made.flatten(2), told[1].flatten(2)), 2)
        after = torch.cat((told[0].flatten(2), fake), 2)
        if recipe.cycle:
            again = self._answers(net, after, net.hear(after, content, target, needed)[0], target, style)[1]
            returned = reconstruction_loss((came[0], again[0]), (came[1], place(again[0])), (came[2], again[1]))
            rebuilding = rebuilding + recipe.cycle * returned
        nothing = x.new_zeros(())
        adversarial = adversarial_loss(pair.judged(fake, target, content)) if recipe.adversarial else nothing
        kept = perceptual_loss(self.contents(x)[1], self.contents(after)[1]) if recipe.perceptual else nothing
        total = generator_objective(rebuilding, adversarial, kept)
        return total + self._critics(pair, fake.detach(), target, content, back > 0) if recipe.adversarial else total

    @staticmethod
    def _answers(net: StyleErd, x: Tensor, heard: Tensor, own: Tensor, other: Tensor) -> list[tuple]:
        """What is said of frames x in their own style, and, with what that loses put back, in another."""
        rebuilt, told = (net.say(heard, net.weights_of(style)) for style in (own, other))
        return [split(rebuilt), split(input_residual(x, told, rebuilt) if net.config.skip else told)]

    def _missed(self, aim: tuple, made: tuple) -> Tensor:
        """Eq. 3 of rotations, positions, velocities, and how unlike the positions move from frame to frame: [B, F]."""
        missed = reconstruction_loss(*zip(aim, made))
        if not self.recipe.steady:
            return missed
        off = made[1] - aim[1]
        trembling = off.diff(dim=1, prepend=off[:, :1]) * (self.recipe.fps / TENTH)
        return missed + self.recipe.steady * trembling.square().sum((-2, -1))

    def _unlike_twins(self, chosen: Tensor, amid: bool, place, made: Tensor, told: tuple) -> Tensor:
        """`_missed` of what was told [B, F] by those that have a twin, on their own bodies; 0 of the others."""
        twin = self.pieces.twin[chosen]
        rows = twin.clamp(min=0)
        turns, _, speeds = _parts(self.pieces.amid(rows) if amid else self.pieces.x[rows], len(self.skeleton))
        missed = self._missed((turns, place(turns), speeds), (told[0], made, told[1]))
        return missed * (twin >= 0)[:, None]

    def _critics(self, pair: Pair, fake: Tensor, style: Tensor, content: Tensor, amid: bool) -> Tensor:
        """The critic's loss of motions [B, F, 6J] that were made in styles, and of real ones (eq. 9)."""
        real, theirs = self.real(content, style, amid)
        real = real.clone().requires_grad_()
        answers = pair.critic(real, style, theirs)
        critic = discriminator_loss(answers, pair.critic(fake, style, content))
        return discriminator_objective(critic, gradient_penalty(answers, real))


def _parts(x: Tensor, joints: int) -> tuple[Tensor, Tensor, Tensor]:
    """Frames [..., 10J] as quaternions [..., J, 4], positions and velocities [..., J, 3]."""
    turns, places, speeds = x.split((4 * joints, 3 * joints, 3 * joints), -1)
    return turns.unflatten(-1, (joints, 4)), places.unflatten(-1, (joints, 3)), speeds.unflatten(-1, (joints, 3))


def train_content_classifier(
    pieces: Windows, joints: int, steps: int = 600, seed: int = 0, **running
) -> ContentClassifier:
    """Paper 2's content network (section 3.1), a classifier of windows; frozen afterwards."""
    torch.manual_seed(seed)
    net = ContentClassifier(joints, len(pieces.contents))

    def loss_fn(model: nn.Module, step: int) -> Tensor:
        chosen = torch.randint(len(pieces.x), (64,))
        return nn.functional.cross_entropy(model(pieces.x[chosen])[0], pieces.content[chosen])

    running.setdefault("title", "contents")
    fit(net, loss_fn, TrainConfig(steps, 1e-3, seed=seed), **running)
    return net.requires_grad_(False)


def train_erd(
    data: Dataset, recipe: Config | None = None, seed: int = 0, contents: ContentClassifier | None = None, **running
) -> tuple[StyleErd, Run, Windows]:
    """Train Style-ERD on all clips of a labelled dataset (paper 2, section 3.2): the generator, its run, its windows.

    contents: a content network that is there already. running: as in `training.fit`. Raises MotionKitError where no
    style is neutral.
    """
    recipe = recipe or Config.laptop()
    pieces = Windows.of(data, recipe.fps, registered=recipe.registered > 0)
    skeleton = without_helper_joints(data[0].motion).skeleton
    joints, counts = len(skeleton), (len(pieces.contents), len(pieces.styles))
    contents = contents if contents is not None else train_content_classifier(pieces, joints, seed=seed)
    torch.manual_seed(seed)
    critic = (FTAttDiscriminator if recipe.attention else MultiClassDiscriminator)(joints, *counts)
    pair = Pair(StyleErd(joints, *counts, recipe.config, recipe.beginnings, recipe.opened), critic, recipe.slower)
    course = StyleErdLoss(pieces, skeleton, contents.eval(), recipe)
    same = f"{recipe}, {len(pieces.x)} windows of {pieces.contents} in {pieces.styles}"
    schedule = TrainConfig(recipe.steps, recipe.rate, decay=0.0, clip=1e6, seed=seed, average=0.995, recipe=same)
    run = fit(pair, lambda model, step: course.loss(model), schedule, **running)
    return pair.generator.eval(), run, pieces


_LABELS = "labels."  # before the names of the labeller's weights


@dataclass(eq=False)
class ErdModel:
    """A trained Style-ERD: its network, the labels that it knows (the neutral style first), its skeleton and rate.

    labeller: what guesses labels that nobody says; None where there is none.
    """

    network: StyleErd
    contents: tuple[str, ...]
    styles: tuple[str, ...]
    skeleton: Skeleton
    fps: float
    labeller: FrameClassifier | None = None
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"ErdModel({len(self.contents)} contents, {len(self.styles)} styles, {self.fps:g} fps)"

    @cached_property
    def fast(self) -> NumpyStep:
        """The network's quick step."""
        return NumpyStep(self.network)

    @cached_property
    def body(self) -> NumpyKinematics:
        """The skeleton's quick kinematics."""
        return NumpyKinematics(self.skeleton)

    def number(self, what: str, label: str) -> int:
        """Of a `content` or a `style`, neutral by any name; MotionKitError names the nearest."""
        if what == "style" and label in NEUTRAL:
            return 0
        known = self.contents if what == "content" else self.styles
        if label not in known:
            near = difflib.get_close_matches(str(label), known, 1, 0.4)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise MotionKitError(f"style-erd knows no {what} {label!r}; {hint}it knows {', '.join(known)}")
        return known.index(label)

    def wanted(self, style: str | Mapping[str, float], strength: float = 1.0) -> np.ndarray:
        """How much of each style, [S], from a name or a mix such as {"old": 0.5, "proud": 0.5} (paper 2, section 4.4).

        What a mix leaves of 1 is neutral, and what is beyond 1 is taken from it. Raises MotionKitError for unknown
        styles and numbers that are not finite.
        """
        if not isinstance(style, str | Mapping):
            hint = "a name, or a mix such as {'old': 0.5, 'proud': 0.5}"
            raise MotionKitError(f"style-erd takes a style by {hint}; found {style!r:.80}")
        mix, found = {style: 1.0} if isinstance(style, str) else dict(style), np.zeros(len(self.styles), np.float32)
        check_strength("style-erd: strength", strength)
        for name, share in mix.items():
            check_strength(f"style-erd: the share of style {name!r}", share)
            found[self.number("style", name)] += share * strength
        found[0] = 1 - found[1:].sum()
        return found

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`; 32 bits, since errors would add up from frame to frame."""
        card = {"kind": "style-erd", **self.card, "config": asdict(self.network.config), "fps": self.fps}
        card |= {"contents": list(self.contents), "styles": list(self.styles)}
        card["skeleton"] = checkpoints.skeleton_card(self.skeleton)
        tensors = dict(self.network.state_dict())
        if self.labeller is not None:
            tensors |= {_LABELS + name: value for name, value in self.labeller.state_dict().items()}
        return checkpoints.save(path, tensors, card)

    @classmethod
    def load(cls, path: str | os.PathLike) -> ErdModel:
        """From what `save` wrote; MotionKitError if the files are damaged, of another kind or of other sizes."""
        tensors, card = checkpoints.load(path, "style-erd")
        config = checkpoints.load_config(path, card, ErdConfig)
        config = replace(config, encoder=tuple(config.encoder), decoder=tuple(config.decoder))
        skeleton = checkpoints.skeleton_of(card["skeleton"])
        contents, styles = tuple(card["contents"]), tuple(card["styles"])
        sizes, labeller = (len(skeleton), len(contents), len(styles)), None
        labels = {name.removeprefix(_LABELS): tensors.pop(name) for name in list(tensors) if name.startswith(_LABELS)}
        network = StyleErd(*sizes, config).eval()
        checkpoints.load_into(network, tensors, path)
        if labels:
            labeller = FrameClassifier(*sizes).eval()
            checkpoints.load_into(labeller, labels, path)
            labeller.requires_grad_(False)
        return cls(network.requires_grad_(False), contents, styles, skeleton, card["fps"], labeller, card)


_LABEL_STEPS = 1500


def train_model(
    data: Dataset, recipe: Config | None = None, seed: int = 0, label_steps: int = _LABEL_STEPS, **running
) -> ErdModel:
    """A Style-ERD of a labelled dataset, with what guesses its labels; see `style_erd.train_erd` for the arguments.

    label_steps: 0 for no such guesses. The card says how it was made.
    """
    recipe, skeleton = recipe or Config.laptop(), without_helper_joints(data[0].motion).skeleton
    network, run, pieces = train_erd(data, recipe, seed, **running)
    model = ErdModel(network.requires_grad_(False), pieces.contents, pieces.styles, skeleton, recipe.fps)
    if label_steps:
        quiet = {"title": running.get("title", "") and "labels"}
        model.labeller = train_frame_classifier(
            Windows.of(data, recipe.fps, FRAMES), len(skeleton), label_steps, seed, **quiet
        )
    model.card = training_card(data, TrainConfig(recipe.steps, recipe.rate, seed=seed), run, network)
    model.card |= {"batch": recipe.batch, "last_loss": round(sum(run.losses[-200:]) / len(run.losses[-200:]), 3)}
    return model


@torch.no_grad()
def evaluate_model(model: ErdModel, data: Dataset) -> dict[str, float]:
    """How far a model is right on clips that it has not learned from.

    `rebuilt_mm`: how far joints are from those of the input, from the pelvis, where the style that it has is asked for
    and nothing is put back, mean over windows of `style_erd_stream.FRAMES` frames. The others are
    `style_erd_stream.label_accuracy`.
    """
    pieces, joints = Windows.of(data, model.fps, FRAMES), len(model.skeleton)
    network = model.network
    said = network.say(network.listen(pieces.x, pieces.content, pieces.style)[0], network.weights_of(pieces.style))
    places = []
    for turns in (split(said)[0], pieces.x[..., : 4 * joints].unflatten(-1, (joints, 4))):
        standing = placed_positions(model.skeleton, pieces.offsets[:, None], turns, torch.zeros(turns.shape[:2]))
        places.append(standing - standing[..., :1, :])
    found = {"rebuilt_mm": round(1000 * float((places[0] - places[1]).norm(dim=-1).mean()), 1)}
    return found | (label_accuracy(model.labeller, pieces) if model.labeller is not None else {})


def train_part(data: Dataset, steps: int | None, seed: int, command: str) -> Path:
    """Train the model of a dataset and write it where `methods.load("style-erd")` finds it; returns its path.

    The state of the run is kept beside the weights, so a run that was broken off goes on.
    """
    path, parts = default_path(data.name, "erd"), data.split()
    recipe = replace(Config.laptop(), steps=steps) if steps else Config.laptop()
    labels = _LABEL_STEPS if recipe.steps >= _LABEL_STEPS else recipe.steps
    model = train_model(parts.train, recipe, seed, labels, keep=path.with_suffix(".run"), title=path.stem)
    model.card = {"name": path.stem, "command": command, **model.card, "metrics": evaluate_model(model, parts.test)}
    main_process_first(lambda: model.save(path))
    return path


_LATE = 0.5  # seconds that a guessed content comes late


@lru_cache(maxsize=4)
def shipped(data: str) -> ErdModel:
    """The shipped model of a dataset; MotionKitError if there is none."""
    return ErdModel.load(checkpoints.find(f"{data}-erd"))


class StyleErdMethod:
    """Style-ERD (paper 2): an encoder, recurrent branches whose sum is the style, a decoder, all causal.

    model: by the name of the dataset that it learned from, or an `style_erd.ErdModel`. It knows the styles of that
    dataset and no others. The shipped ones learned by `style_erd.Config.laptop`, beyond the paper: they also saw
    neutral clips in step with styled ones, and what is lost on the way through the network is put back.

    >>> import motionkit as mk
    >>> method, walk = mk.methods.load("style-erd"), mk.load("data/actor/walk_neutral.bvh")
    >>> method.stylize(walk, style="old")
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    >>> stream, frames = method.stream(style="old"), method.seen(walk)
    >>> for n in range(60):
    ...     made = stream(frames[n : n + 1])
    >>> len(made), made.fps
    (1, 60.0)
    >>> stream.labels[0][1]
    'neutral'
    """

    name = "style-erd"

    def __init__(self, model: str | ErdModel = "actor") -> None:
        self.model = shipped(model) if isinstance(model, str) else model

    @property
    def styles(self) -> tuple[str, ...]:
        """What it can be asked for."""
        return self.model.styles

    def stream(self, style: object = "neutral", strength: object = 1.0, **labels) -> ErdStream:
        """A live stream: call it with one frame, at the model's rate, for one frame back; see
        `style_erd_stream.ErdStream`.

        style: a name or a mix such as {"old": 0.5, "proud": 0.5}; it may be changed at any frame. labels: `content`,
        `own_style`, `count` and `fade`, as there.
        """
        return ErdStream(self.model, style, strength, **labels)

    def stylize(
        self,
        content: Motion,
        style: str | Mapping[str, float] | Motion = "neutral",
        strength: float = 1.0,
        lock: bool = True,
        *,
        content_label: str | None = None,
        content_style: str | None = None,
    ) -> Motion:
        """The content clip in a style, streamed frame by frame.

        content: F frames of a human body, at any rate. style: a name, a mix of several (paper 2, section 4.4), or a
        clip, whose style is then recognised. strength: 0 is neutral, 1 the style, more exaggerates. lock: hold standing
        feet still, which looks ahead; a live stream does not. content_label, content_style: of what comes in; left out,
        the style is what most of the clip looks like, the content what each part of it does. Returns F frames at the
        content's rate, on its skeleton. Raises MotionKitError for styles that the model does not know, and bodies that
        cannot be brought to its own.
        """
        check_motions(self.name, content, content, strength)
        given, seen, what = without_helper_joints(content), self.seen(content), style
        if isinstance(style, Motion):
            style = self.recognised(style)[1]
        labels, own = self._labelled(seen, content_label, content_style)
        body = self._back(self._run(seen, style, strength, labels, own), given)
        if lock:
            body = clean_up_feet(body, given)
        return content.with_helper_joints_of(body).replace(name=result_name(content, _words(what)))

    def seen(self, motion: Motion) -> Motion:
        """A motion as the model sees it: its skeleton and rate. MotionKitError where it cannot be."""
        if not isinstance(motion, Motion):
            raise MotionKitError(f"style-erd takes a Motion, such as mk.load('walk.bvh'); found {motion!r:.80}")
        body, skeleton, fps = without_helper_joints(motion), self.model.skeleton, self.model.fps
        if not body.skeleton.same_tree(skeleton):
            still = Motion.from_root(skeleton, torch.eye(4)[:1].expand(1, len(skeleton), 4), torch.zeros(1, 3), fps)
            body = retarget_to(body, still)
        return body if abs(body.fps - fps) < 1e-3 else body.resample(fps, smooth=True)

    def transfer(self, content: Clip, style: Clip) -> Motion:
        """`stylize` for labelled clips, as the arena asks."""
        return self.stylize(content.motion, style.style, content_label=content.content, content_style=content.style)

    def recognised(self, motion: Motion) -> tuple[str, str]:
        """Content and style that most frames of a motion look like, after those before them.

        Raises MotionKitError where the model guesses no labels.
        """
        contents, styles = self._guessed(self.seen(motion))
        return max(contents, key=contents.count), max(styles, key=styles.count)

    def _guessed(self, seen: Motion) -> tuple[list[str], list[str]]:
        """What every frame looks like, after those before it."""
        if self.model.labeller is None:
            raise MotionKitError("style-erd: this model guesses no labels; give content_label and content_style")
        guesses, found = LabelTracker(self.model.labeller), ([], [])
        for frame in frames_of(seen).x.numpy():
            guesses.hear(frame[None])
            found[0].append(self.model.contents[guesses.content[0]])
            found[1].append(self.styles[guesses.style[0]])
        return found

    def _run(self, seen: Motion, style: object, strength: float, contents: list[str], own: str) -> Motion:
        """A motion of the model's skeleton and rate through a stream of its own; contents: of every frame."""
        stream, made = ErdStream(self.model, style, strength, content=contents[0], own_style=own), []
        for turns, places, content in zip(seen.rotations.numpy(), seen.translations.numpy(), contents):
            if content != stream.content:
                stream.content = content
            made.append(stream.push(turns[None], places[None]))
        rotations, roots = (torch.from_numpy(np.concatenate(part)) for part in zip(*made))
        return seen.replace(rotations=rotations, translations=_rooted(seen.translations, roots))

    def _labelled(self, seen: Motion, content: str | None, style: str | None) -> tuple[list[str], str]:
        """The content of every frame and the style of the clip: as given, the others recognised.

        A guess comes late, since it rests on what was; but here the whole clip is known, and it is taken earlier.
        """
        if content is not None and style is not None:
            return [content] * len(seen), style
        contents, styles = self._guessed(seen)
        late = round(_LATE * seen.fps)
        contents = [*contents[late:], *[contents[-1]] * min(late, len(contents))]
        given = [content] * len(seen) if content is not None else contents
        return given, max(styles, key=styles.count) if style is None else style

    def _back(self, body: Motion, given: Motion) -> Motion:
        """What the model made, on the content's body and in its frames."""
        if body.skeleton is not given.skeleton:
            body = retarget_to(body, given)
        if len(body) != len(given) or abs(body.fps - given.fps) > 1e-3:
            times = torch.arange(len(given), dtype=torch.float64) * (self.model.fps / given.fps)
            body = body.sample(times.clamp(max=len(body) - 1), smooth=True).replace(fps=given.fps)
        gap = given.root_path()[0] - body.root_path()[0]
        return body.transform(offset=(float(gap[0]), 0.0, float(gap[1])))


def _rooted(translations: Tensor, roots: Tensor) -> Tensor:
    """Bones as they are, the root elsewhere."""
    translations = translations.clone()
    translations[:, 0] = roots
    return translations


def _words(style: object) -> str:
    """What a style is called."""
    if isinstance(style, Mapping):
        return " + ".join(style)
    return getattr(style, "name", style)
