"""A style more for a trained Style-ERD, from one clip: one residual branch learns, all else stays as it is.

Beyond paper 2, whose supplement C.1 leaves quick adaptation to unseen styles open.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from ..errors import MotionKitError
from ..features.style_erd import Frames, frames_of, lowest_foot, placed_positions, split, zero_first_velocity
from ..motion import Motion
from ..training import Run, TrainConfig, fit
from .style_erd import ErdModel, quaternion_loss, reconstruction_loss
from .style_erd_data import WINDOW
from .style_erd_network import LSTMBank, StyleErd, input_residual

STEPS, LR, BATCH = 400, 1e-3, 16
_STAY = 1.0  # how much it counts how far the new branch goes from where it began


class StyleBranch(nn.Module):
    """One more branch beside those of a network, and what the decoder is told of it.

    like: the number of a known style whose branch it begins as.

    >>> from motionkit.methods.style_erd_network import Sizes
    >>> net = StyleErd(joints=5, contents=3, styles=4, sizes=Sizes.tiny())
    >>> branch, x = StyleBranch(net, like=2), torch.randn(2, 24, 50)
    >>> branch(x, torch.tensor([0, 2]), torch.tensor([0, 0])).shape
    torch.Size([2, 24, 35])
    >>> branch.merged().styles
    5
    """

    def __init__(self, network: StyleErd, like: int) -> None:
        super().__init__()
        self.network = network.eval().requires_grad_(False)
        config = network.config
        self.branch = LSTMBank(1, config.style, config.latent, 1)
        known = {name: value[:, like - 1 : like] for name, value in network.residual.state_dict().items()}
        self.branch.load_state_dict(known)
        self.style_embedding = nn.Parameter(network.decoder[0].weight[:, config.latent + like].detach().clone())
        self.initial = [value.detach().clone() for value in self._learned()]

    def _learned(self) -> list[nn.Parameter]:
        return [*self.branch.parameters(), self.style_embedding]

    def forward(self, x: Tensor, content: Tensor, style: Tensor) -> Tensor:
        """Neutral frames x [B, F, 10J] with labels long [B], to [B, F, 7J] in the new style."""
        net = self.network
        z = net.encode(x, content, style)
        plain = net.neutral(z, net.neutral.initial_state(content))[0][:, :, 0]
        added = self.branch(z, self.branch.initial_state(content * 0))[0][:, :, 0]
        told = self._decode(plain + added, self.style_embedding)
        if not net.config.input_residual:
            return told
        return input_residual(x, told, self._decode(plain, net.decoder[0].weight[:, net.config.latent]))

    def _decode(self, mixed: Tensor, style_embedding: Tensor) -> Tensor:
        """The decoder's output [B, F, 7J]; mixed: [B, F, H]; style_embedding: of its first layer."""
        first, *rest = self.network.decoder
        y = nn.functional.linear(mixed, first.weight[:, : mixed.shape[2]], first.bias) + style_embedding
        for layer in rest:
            y = layer(y)
        return y

    def l2_from_init(self) -> Tensor:
        """How far it is from where it began, squared."""
        return sum(((now - then.to(now)) ** 2).sum() for now, then in zip(self._learned(), self.initial))

    def merged(self) -> StyleErd:
        """The network with one style more, the last."""
        net = self.network
        made = StyleErd(net.joints, net.contents, net.styles + 1, net.config)
        state, place = dict(net.state_dict()), 10 * net.joints + net.styles
        seen = state["encoder.0.weight"]  # of the new style as one that comes in it knows nothing: as of neutral
        neutral = seen[:, 10 * net.joints, None]
        state["encoder.0.weight"] = torch.cat((seen[:, :place], neutral, seen[:, place:]), 1)
        state["decoder.0.weight"] = torch.cat((state["decoder.0.weight"], self.style_embedding.detach()[:, None]), 1)
        for name, value in self.branch.state_dict().items():
            state[f"residual.{name}"] = torch.cat((state[f"residual.{name}"], value), 1)
        made.load_state_dict(state)
        return made.eval().requires_grad_(False)


def learn_style(
    model: ErdModel, name: str, clip: Motion, neutral: Motion, content: str, *, seed: int = 0, **running
) -> tuple[ErdModel, Run]:
    """Teach a model a new style from one clip and its neutral pair, in step with it (beyond paper 2).

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
    target, source, number = frames_of(clip), frames_of(neutral), model.label_id("content", content)
    branch = StyleBranch(network, like=_nearest(network, source, target, number))

    targets = torch.cat([target.rotations.flatten(1), target.positions.flatten(1), target.velocities.flatten(1)], 1)
    joints = len(model.skeleton)

    def draw(step: int) -> dict[str, Tensor]:
        rows, content, moving = _drawn(len(clip), number, len(model.contents))
        x, y = zero_first_velocity(source.x[rows], joints), targets[rows].clone()
        for part in (x, y):
            part[..., -3 * joints :] *= moving
        return {"x": x, "content": content, "target": y, "offsets": clip.translations[0]}

    def loss_fn(branch: nn.Module, batch: dict[str, Tensor]) -> Tensor:
        rotations, velocities = split(branch(batch["x"], batch["content"], torch.zeros_like(batch["content"])))
        sizes = (4 * joints, 3 * joints, 3 * joints)
        aim = [part.unflatten(-1, (joints, -1)) for part in batch["target"].split(sizes, -1)]
        lowest = lowest_foot(model.skeleton, aim[1])
        positions = placed_positions(model.skeleton, batch["offsets"], rotations, lowest)
        distance = reconstruction_loss((aim[0], rotations), (aim[1], positions), (aim[2], velocities))
        return distance.sum(1).mean() + _STAY * branch.l2_from_init()

    running.setdefault("title", f"learning {name!r}")
    run = fit(branch, draw, loss_fn, TrainConfig(STEPS, LR, weight_decay=0.0, seed=seed, ema=0.99), **running)
    return replace(model, network=branch.merged(), styles=(*model.styles, name), labeller=None, card={}), run


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
def _nearest(network: StyleErd, source: Frames, target: Frames, content: int) -> int:
    """The known style whose rotations come nearest to the wanted ones, by its number."""
    found, labels = [], (torch.tensor([content]), torch.tensor([0]))
    for style in range(1, network.styles):
        turns = split(network(source.x[None], *labels, network.one_hot(torch.tensor([style])))[0][0])[0]
        found.append(float(quaternion_loss(target.rotations, turns).mean()))
    return 1 + found.index(min(found))
