"""A style more for a trained Style-ERD, from one clip: one residual branch learns, all else stays as it is.

Beyond paper 2, whose section C.1 leaves quick adaptation to unseen styles open.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from ..errors import MotionKitError
from ..motion import Motion
from ..training import Run, TrainConfig, fit
from .style_erd import (
    WINDOW,
    ErdModel,
    Frames,
    LSTMBank,
    StyleErd,
    frames_of,
    input_residual,
    lowest_foot,
    placed_positions,
    quaternion_loss,
    reconstruction_loss,
    split,
    zero_first_velocity,
)

STEPS, RATE, BATCH = 400, 1e-3, 16
_STAY = 1.0  # how much it counts how far the new branch goes from where it began


class StyleBranch(nn.Module):
    """One more branch beside those of a network, and what the decoder is told of it.

    like: the number of a known style whose branch it begins as.

    >>> from motionkit.methods.style_erd import ErdConfig
    >>> net = StyleErd(joints=5, contents=3, styles=4, config=ErdConfig.tiny())
    >>> branch, x = StyleBranch(net, like=2), torch.randn(2, 24, 50)
    >>> branch(x, torch.tensor([0, 2]), torch.tensor([0, 0])).shape
    torch.Size([2, 24, 35])
    >>> branch.beside().styles
    5
    """

    def __init__(self, network: StyleErd, like: int) -> None:
        super().__init__()
        self.network = (network,)  # in a tuple, so that it is no part of this module's state
        config = network.config
        self.branch = LSTMBank(1, config.style, config.latent, 1)
        known = {name: value[:, like - 1 : like] for name, value in network.residual.state_dict().items()}
        self.branch.load_state_dict(known)
        self.told = nn.Parameter(network.decoder[0].weight[:, config.latent + like].detach().clone())
        self.began = tuple(value.detach().clone() for value in self.parameters())

    def forward(self, x: Tensor, content: Tensor, style: Tensor) -> Tensor:
        """Neutral frames x [B, F, 10J] with labels long [B], to [B, F, 7J] in the new style."""
        net = self.network[0]
        z = net.encode(x, content, style)
        plain = net.neutral(z, net.neutral.begin(content))[0][:, :, 0]
        added = self.branch(z, self.branch.begin(content * 0))[0][:, :, 0]
        told = self._decoded(plain + added, self.told)
        if not net.config.skip:
            return told
        return input_residual(x, told, self._decoded(plain, net.decoder[0].weight[:, net.config.latent]))

    def _decoded(self, mixed: Tensor, told: Tensor) -> Tensor:
        """The decoder's answer [B, F, 7J] to branches [B, F, H]; told: what its first layer makes of the style."""
        first, *rest = self.network[0].decoder
        y = nn.functional.linear(mixed, first.weight[:, : mixed.shape[2]], first.bias) + told
        for layer in rest:
            y = layer(y)
        return y

    def gone(self) -> Tensor:
        """How far it is from where it began, squared."""
        return sum(((now - then) ** 2).sum() for now, then in zip(self.parameters(), self.began))

    def beside(self) -> StyleErd:
        """The network with one style more, the last."""
        net = self.network[0]
        made = StyleErd(net.joints, net.contents, net.styles + 1, net.config)
        state, place = dict(net.state_dict()), 10 * net.joints + net.styles
        seen = state["encoder.0.weight"]  # of the new style as one that comes in it knows nothing: as of neutral
        neutral = seen[:, 10 * net.joints, None]
        state["encoder.0.weight"] = torch.cat((seen[:, :place], neutral, seen[:, place:]), 1)
        state["decoder.0.weight"] = torch.cat((state["decoder.0.weight"], self.told.detach()[:, None]), 1)
        for name, value in self.branch.state_dict().items():
            state[f"residual.{name}"] = torch.cat((state[f"residual.{name}"], value), 1)
        made.load_state_dict(state)
        return made.eval().requires_grad_(False)


def learn_style(
    model: ErdModel, name: str, clip: Motion, neutral: Motion, content: str, *, seed: int = 0, **running
) -> tuple[ErdModel, Run]:
    """Teach a model a new style from one clip and its neutral pair, in step with it (paper 2, section C.1).

    clip, neutral: F frames each of the model's skeleton and rate, such as by `neutral_pairs.NeutralPairs`. content:
    what is done. running: as in `training.fit`. The loss is the rebuilding loss (eq. 3) of the clip from its pair, with
    the decoder, the encoder and all other branches frozen. The new branch begins as that of the known style that comes
    nearest, and stays near it: what a clip does not show, it then does as that style. In a third of what it learns from
    somebody stands still, in a pose of the clip, since whoever stands is not to be carried along. Returns a model that
    knows the style, and the run; the one given is not changed. Raises MotionKitError for a name that is taken, and
    clips that are too short or not in step.
    """
    if name in model.styles:
        raise MotionKitError(f"style-erd knows a style {name!r} already; give the new one another name")
    if len(clip) != len(neutral) or len(clip) < WINDOW:
        raise MotionKitError(
            f"a style is learned from a clip and a neutral one in step with it, of {WINDOW} frames at least; found "
            f"{len(clip)} and {len(neutral)}"
        )
    network = model.network.eval().requires_grad_(False)
    wanted, given, number = frames_of(clip), frames_of(neutral), model.number("content", content)
    branch = StyleBranch(network, like=_nearest(network, given, wanted, number))
    offsets = clip.translations[0]

    def loss_fn(module: nn.Module, step: int) -> Tensor:
        rows, content, moving = _drawn(len(clip), number, len(model.contents))
        x = zero_first_velocity(given.x[rows], len(model.skeleton))
        x[..., -3 * len(model.skeleton) :] *= moving
        made = split(module(x, content, torch.zeros_like(content)))
        aim = wanted.rotations[rows], wanted.positions[rows], wanted.velocities[rows] * moving[..., None]
        places = placed_positions(model.skeleton, offsets, made[0], lowest_foot(model.skeleton, aim[1]))
        missed = reconstruction_loss((aim[0], made[0]), (aim[1], places), (aim[2], made[1]))
        return missed.sum(1).mean() + _STAY * module.gone()

    running.setdefault("title", f"learning {name!r}")
    run = fit(branch, loss_fn, TrainConfig(STEPS, RATE, decay=0.0, seed=seed, average=0.99), **running)
    return replace(model, network=branch.beside(), styles=(*model.styles, name), labeller=None, card={}), run


def _drawn(frames: int, content: int, contents: int) -> tuple[Tensor, Tensor, Tensor]:
    """Which frames the windows of a batch are of [B, WINDOW], their contents [B], and whether they move [B, 1, 1].

    A third stand still, in any pose of the clip, whatever their content is called: or else a style learned from
    somebody who walks would carry along whoever stands.
    """
    still = torch.arange(BATCH) < BATCH // 3
    within = torch.where(still[:, None], 0, torch.arange(WINDOW))
    rows = torch.randint(frames - WINDOW + 1, (BATCH, 1)) + within
    called = torch.where(still, torch.randint(contents, (BATCH,)), content)
    return rows, called, (~still)[:, None, None].float()


@torch.no_grad()
def _nearest(network: StyleErd, given: Frames, wanted: Frames, content: int) -> int:
    """The known style whose rotations come nearest to the wanted ones, by its number."""
    found, labels = [], (torch.tensor([content]), torch.tensor([0]))
    for style in range(1, network.styles):
        turns = split(network(given.x[None], *labels, network.weights_of(torch.tensor([style])))[0][0])[0]
        found.append(float(quaternion_loss(wanted.rotations, turns).mean()))
    return 1 + found.index(min(found))
