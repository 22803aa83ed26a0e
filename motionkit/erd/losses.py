"""Paper 2's losses, equations 2 to 9. Batches are averaged; joints and frames are summed, as norms are."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from .. import rotations as rot

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


def rebuilding_loss(
    rotations: tuple[Tensor, Tensor], positions: tuple[Tensor, Tensor], velocities: tuple[Tensor, Tensor]
) -> Tensor:
    """How far rebuilt frames are from those that came in (paper 2, eq. 3), [B, F].

    Each a pair, came in and rebuilt: unit quaternions [B, F, J, 4], positions and velocities [B, F, J, 3].

    >>> still = (rot.identity_quaternion(1, 2, 5), rot.identity_quaternion(1, 2, 5))
    >>> there, here = torch.zeros(1, 2, 5, 3), torch.ones(1, 2, 5, 3)
    >>> rebuilding_loss(still, (there, here), (there, there))
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


def critic_loss(real: Tensor, fake: Tensor) -> Tensor:
    """What the critic wants: 1 of real motions, -1 of made ones, both [B] (paper 2, eq. 5).

    >>> critic_loss(torch.tensor([1.0]), torch.tensor([0.0]))
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


def generator_total(rebuilt: Tensor, adversarial: Tensor, perceptual: Tensor) -> Tensor:
    """The generator's loss (paper 2, eq. 8): rebuilding of all frames [B, F], and what both supervisors say.

    >>> generator_total(torch.ones(2, 24), torch.tensor(0.5), torch.tensor(2.0))
    tensor(24.7000)
    """
    return rebuilt.sum(1).mean() + ADVERSARIAL * adversarial + PERCEPTUAL * perceptual


def critic_total(critic: Tensor, penalty: Tensor) -> Tensor:
    """The critic's loss (paper 2, eq. 9).

    >>> critic_total(torch.tensor(2.0), torch.tensor(0.5))
    tensor(66.)
    """
    return critic + PENALTY * penalty
