"""Paper 2's feature extractor for the Fréchet Motion Distance: a denoising autoencoder of joint rotations."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn

from .. import checkpoints
from .. import rotations as rot
from ..motion import Motion
from ..skeleton import Skeleton
from .poses import WINDOW, fitting, joint_turns, over_windows, several

NOISE = 0.03  # standard deviation; paper 2 writes N(0, 0.03)


class DenoisingAutoencoder(nn.Module):
    """1D convolutions over time, from joint rotations to an eighth of their number and back (paper 2, supplement A).

    The paper gives no sizes; here the encoder has three convolutions that halve time twice.

    >>> net = DenoisingAutoencoder(joints=22)
    >>> x = rot.identity_quaternion(2, 64, 22)
    >>> net.encode(x).shape, net(x).shape
    (torch.Size([2, 64, 16]), torch.Size([2, 64, 22, 4]))
    """

    def __init__(self, joints: int, width: int = 128, features: int = 64) -> None:
        super().__init__()
        self.encoder = nn.Sequential(
            nn.Conv1d(4 * joints, width, 5, 2, 2),
            nn.ReLU(),
            nn.Conv1d(width, width, 5, 2, 2),
            nn.ReLU(),
            nn.Conv1d(width, features, 5, 1, 2),
        )
        self.decoder = nn.Sequential(
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="linear"),
            nn.Conv1d(features, width, 5, 1, 2),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="linear"),
            nn.Conv1d(width, 4 * joints, 5, 1, 2),
        )

    def encode(self, turns: Tensor) -> Tensor:
        """Quaternions [B, F, J, 4] to the encoder's last convolution, [B, D, F / 4]."""
        return self.encoder(turns.flatten(2).mT)

    def forward(self, turns: Tensor) -> Tensor:
        """Quaternions [B, F, J, 4], noisy or not, to unit quaternions of the same shape."""
        decoded = self.decoder(self.encode(turns))[..., : turns.shape[1]].mT  # [B, F, 4 J]
        return rot.normalize(decoded.unflatten(2, (-1, 4)))


def denoising_loss(network: nn.Module, turns: Tensor, noise: float = NOISE) -> Tensor:
    """Mean angle in radians between clean rotations and what a network makes of noisy ones (paper 2, supplement A).

    turns: unit quaternions [B, F, J, 4]. Noise is normal, of standard deviation `noise`, on every number; the angle is
    the paper's L_quat (`rotations.quaternion_angle`).

    >>> denoising_loss(nn.Identity(), rot.identity_quaternion(1, 8, 2), noise=0.0)
    tensor(0.)
    """
    restored = network(rot.normalize(turns + noise * torch.randn_like(turns)))
    return rot.quaternion_angle(restored, turns).mean()


@dataclass(eq=False)
class MotionAutoencoder:
    """Features of motions from paper 2's autoencoder; it needs no labels, so it sees quality and not classes.

    skeleton, fps: of the motions it learned from. card: how it was made.
    """

    network: DenoisingAutoencoder
    skeleton: Skeleton
    fps: float
    card: dict = field(default_factory=dict, repr=False)

    def encode(self, motion: Motion) -> Tensor:
        """What the network sees of a motion, [F, J, 4]; MotionKitError on another skeleton."""
        return joint_turns(fitting(motion, self.skeleton, self.fps, "this autoencoder"))

    def features(self, motions: Sequence[Motion | None]) -> Tensor:
        """The encoder's last convolution, mean over time: [N, D]; NaN for None.

        Raises MotionKitError for another skeleton.
        """
        self.network.eval()
        return over_windows(several(motions), self.encode, lambda x: self.network.encode(x).mean(2), WINDOW)

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`."""
        card = {
            "kind": "autoencoder",
            **self.card,
            "fps": self.fps,
            "skeleton": checkpoints.skeleton_card(self.skeleton),
        }
        return checkpoints.save(path, self.network.state_dict(), card)

    @classmethod
    def load(cls, path: str | os.PathLike) -> MotionAutoencoder:
        """From what `save` wrote; MotionKitError if the files are damaged or hold something else."""
        tensors, card = checkpoints.load(path, "autoencoder")
        skeleton = checkpoints.skeleton_of(card["skeleton"])
        network = DenoisingAutoencoder(len(skeleton)).eval()
        checkpoints.load_into(network, tensors, path)
        return cls(network, skeleton, card["fps"], card)
