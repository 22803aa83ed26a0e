"""Every training with its weights on another device than its data, as on a GPU; see `other_device`."""

import importlib
from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from other_device import OTHER, other_device
from test_training import GAME, LOSSES, a_batch, a_loss, a_net, a_pair, real_points
from torch import nn

from motionkit import judges
from motionkit.__main__ import _TRAINERS
from motionkit.datasets import performed
from motionkit.datasets.loading import from_items
from motionkit.layers import TransformerConfig
from motionkit.methods import few_shot, style_code, style_code_training, style_erd, style_erd_new_style, text_to_motion
from motionkit.methods.style_erd_data import Windows
from motionkit.methods.style_erd_labels import train_frame_classifier
from motionkit.text import train as text_train
from motionkit.text.encoders import Mini, MiniConfig, MiniNetwork
from motionkit.training import TrainConfig, TrainOrder, fit, fit_adversarial

pytestmark = pytest.mark.slow

TWO = TrainConfig(2)


def trained(train):
    """What a training gives that has its weights on the other device; they come back."""
    with other_device() as marks:
        result = train()
        assert marks.ops > 50
        networks = getattr(result, "networks", dict)().values()
        assert not any(map(marks.marked, (value for one in networks for value in one.state_dict().values())))
    return result


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A few clips of the performer's, and hardly trained weights of everything that is learned from."""
    folder = tmp_path_factory.mktemp("world")
    kinds, counts = {("walk", "neutral"), ("walk", "old"), ("jump", "neutral"), ("jump", "old")}, {}
    items = []
    for item in performed.items("actor"):
        kind = item.labels.content, item.labels.style, item.labels.split
        counts[kind] = counts.get(kind, 0) + 1
        if kind[:2] in kinds and counts[kind] <= (2 if kind[2] == "train" else 1):
            items.append(item)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CHECKPOINTS", str(folder))
        patch.setenv("MOTIONKIT_CACHE", str(folder / "cache"))
        torch.manual_seed(0)
        encoder = Mini(MiniNetwork(MiniConfig(width=16, layers=1, heads=2, buckets=64, size=8)))
        encoder.save(folder / "text-mini.safetensors")
        data = from_items("actor", items)
        split = data.split()
        config = text_to_motion.Config(TransformerConfig(16, 1, 2, 16, 4, frames=160, dropout=0.0), batch=4)
        prior = text_to_motion.train_prior(split, encoder, config, TWO, title="")
        prior = text_to_motion.Prior.load(prior.save(folder / "actor-prior.safetensors"))
        discriminator = text_to_motion.train_discriminator(split, prior, TWO, batch=4, title="")
        pairs = style_code_training.style_pairs(prior, 3, each=2, jobs=1)
        windows = Windows.of(split.train, 30.0, paired=True)
        yield SimpleNamespace(**locals())


@pytest.mark.parametrize("what", _TRAINERS)
def test_what_the_command_line_trains(what, world, monkeypatch):
    monkeypatch.setattr(style_code_training, "style_pairs", lambda *_, **__: world.pairs)
    monkeypatch.setattr(text_train, "_metrics", lambda *_: {})  # of as many meanings as there are not
    contents = style_erd.train_content_classifier(world.windows, 22, steps=1, title="")
    monkeypatch.setattr(style_erd, "train_content_classifier", lambda *_, **__: contents)
    module, maker = _TRAINERS[what].split(":")
    make = getattr(importlib.import_module(f"motionkit.{module}"), maker)
    model = trained(lambda: make(TrainOrder(world.data, "tiny", steps=2, title="")))
    assert model.card["steps"] == 2


def test_a_prior_and_codes_that_go_on_from_others(world):
    prior = trained(lambda: text_to_motion.train_prior(
        world.split, world.encoder, world.config, TWO, start=world.prior, title=""))  # fmt: skip
    assert prior.card["started_from"]
    model = style_code_training.train_decoder(world.prior, world.pairs, TWO, title="")
    again = trained(lambda: style_code_training.train_decoder(world.prior, world.pairs, TWO, start=model, title=""))
    assert again.card["started_from"]


FULL = replace(
    style_erd.Config.tiny(),
    sizes=replace(style_erd.Sizes.tiny(), input_residual=True),
    steps=3,  # for half of the batches nothing burns in
    burn_in=2,
    gate_bias=1.5,
    smoothness=8.0,
    paired=1.0,
)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"cycle": 1.0},
        {"adversarial": False},
        {"perceptual": False},
        {"attention": False, "initial_states": False},
        {"adversarial": False, "perceptual": False},
    ],
    ids=lambda changes: ", ".join(changes) or "full",
)
def test_style_erd_with_every_option(changes, world):
    contents = style_erd.train_content_classifier(world.windows, 22, steps=1, title="")
    config = replace(FULL, **changes)
    trained(lambda: style_erd.train_model(world.split.train, config, label_steps=2, contents=contents, title=""))
    assert next(contents.parameters()).device.type == "cpu"


def test_what_style_erd_is_helped_by(world):
    trained(lambda: style_erd.train_content_classifier(world.windows, 22, steps=2, title=""))
    trained(lambda: train_frame_classifier(world.windows, 22, steps=2, title=""))


def test_a_style_more_for_style_erd(world, monkeypatch):
    monkeypatch.setattr(style_erd_new_style, "STEPS", 2)
    contents = style_erd.train_content_classifier(world.windows, 22, steps=1, title="")
    walk = next(clip.motion for clip in world.split.train if clip.content == "walk")
    for config in (FULL, style_erd.Config.tiny()):
        model = style_erd.train_model(world.split.train, config, label_steps=0, contents=contents, title="")
        more = trained(
            lambda m=model: style_erd_new_style.learn_style(m, "new", walk[:60], walk[3:63], "walk", title="")[0]
        )
        assert more.styles[-1] == "new"


@pytest.mark.parametrize("rank", [0, 4])
def test_fine_tuning_a_prior(rank, world):
    config = few_shot.Config.tiny().changed(rank=rank)
    method = few_shot.FewShot(world.prior, world.discriminator, world.split.train, config=config)
    clip = next(clip.motion for clip in world.split.train if clip.style == "old")
    style = trained(lambda: method.learn(clip, "an old person walks", title=""))
    assert style.card["steps"] == 2


@pytest.mark.parametrize("encoder", [False, True])
def test_looking_for_a_code(encoder, world):
    model = style_code_training.train_decoder(world.prior, world.pairs, TWO, title="")
    model.encoder = style_code_training.train_encoder(world.prior, world.pairs, TWO, title="") if encoder else None
    method = style_code.StyleCodeTransfer(world.prior, world.discriminator, world.split.train, model=model)
    clip = next(clip.motion for clip in world.split.train if clip.style == "old")
    style = trained(lambda: method.learn(clip, "an old person walks", steps=2, title=""))
    assert style.card["steps"] == 2


def test_a_classifier_of_single_frames(world):
    trained(lambda: judges.train_classifier("style", world.split, None, TWO, window=1, moving=False, title=""))


def test_two_nets_and_a_net_that_learns_twice():
    """What `fit` has moved once it moves again."""
    with other_device():
        places = []

        def loss(net: nn.Module, x: torch.Tensor) -> torch.Tensor:
            places.append((net[0].weight.device, x.device))
            return a_loss(net, x)

        net = a_net()
        for _ in range(2):
            fit(net, a_batch, loss, TrainConfig(3, ema=0.9), title="")
            assert net[0].weight.device == torch.device("cpu")
        assert set(places) == {(OTHER, OTHER)} and len(places) == 6
        fit_adversarial(a_pair(), real_points, LOSSES, replace(GAME, steps=3), title="")


def test_a_run_goes_on_on_the_other_device(tmp_path):
    def stop(step: int, loss: float) -> None:
        if step == 3:
            raise KeyboardInterrupt

    whole, again = a_net(), a_net()
    config, kept = TrainConfig(6, ema=0.9), tmp_path / "a.run"
    fit(whole, a_batch, a_loss, config, title="")
    with other_device():
        with pytest.raises(KeyboardInterrupt):
            fit(a_net(), a_batch, a_loss, config, resume=kept, title="", callback=stop)
        fit(again, a_batch, a_loss, config, resume=kept, title="")
    assert all(torch.equal(a, b) for a, b in zip(whole.parameters(), again.parameters(), strict=True))


TABLE = torch.arange(4.0)


class Holder(nn.Module):
    """A loss with a network of its own, as those of both papers."""

    def __init__(self) -> None:
        super().__init__()
        self.frozen = nn.Linear(1, 1).requires_grad_(False)

    def forward(self, net: nn.Module, x: torch.Tensor) -> torch.Tensor:
        return self.frozen(net(x)).mean()

    def other(self, net: nn.Module, x: torch.Tensor) -> torch.Tensor:
        return self(net, x)


@pytest.mark.parametrize(
    "forgetful",
    [
        lambda net, x: (net(x) * torch.arange(16.0)[:, None]).mean(),
        lambda net, x: net(torch.zeros(16, 4)).mean(),
        lambda net, x: net(x * TABLE).mean(),
        lambda net, x: net(x)[:, 0].mean() + TABLE[(x[:, 0] > 0).long()].mean(),
        lambda net, x: nn.functional.mse_loss(net(x), torch.zeros(16, 1)),
        lambda net, x: torch.cat((net(x), torch.zeros(16, 1)), 1).mean(),
        lambda net, x: Holder()(net, x),
    ],
)
def test_a_recipe_that_forgets_to_move_something_fails(forgetful):
    with other_device(), pytest.raises(RuntimeError, match="same device|on the other device"):
        fit(a_net(), a_batch, forgetful, TWO, title="")
    fit(a_net(), a_batch, forgetful, TWO, title="")  # where there is one device nobody sees it


@pytest.mark.parametrize(
    "careful",
    [
        lambda net, x: (net(x) * torch.arange(16.0, device=x.device)[:, None]).mean(),
        lambda net, x: net(x * torch.tensor(2.0)).mean() + torch.tensor(1.0),
        lambda net, x: net(x[torch.tensor([0, 1])]).mean(),
        lambda net, x: net(x)[:, 0].mean() + TABLE.to(x)[(x[:, 0] > 0).long()].mean(),
        lambda net, x: nn.functional.mse_loss(net(x), torch.zeros_like(x[:, :1])),
        Holder(),
        Holder().other,
    ],
)
def test_a_recipe_that_moves_all_does_not(careful):
    with other_device():
        fit(a_net(), a_batch, careful, TWO, title="")
