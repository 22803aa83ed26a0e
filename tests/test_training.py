"""Training that is broken off and resumed, checkpoints that are damaged, cut short, or somebody else's."""

import json
import multiprocessing
import os
import re
import signal
import sys
import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import pytest
import torch
from torch import nn

import motionkit as mk
from motionkit import checkpoints
from motionkit.training import TrainConfig, fit, fit_adversarial, seed_batch, to_device

PLAIN = TrainConfig(60, lr=0.05)
MEAN = TrainConfig(40, lr=0.05, ema=0.9)


def a_net() -> nn.Module:
    torch.manual_seed(3)
    return nn.Sequential(nn.Linear(4, 8), nn.ReLU(), nn.Dropout(0.2), nn.Linear(8, 1))


def a_net_with_buffers() -> nn.Module:
    torch.manual_seed(4)
    return nn.Sequential(nn.Linear(4, 8), nn.BatchNorm1d(8), nn.Linear(8, 1))


def a_batch(step: int) -> torch.Tensor:
    return torch.randn(16, 4)


def a_loss(net: nn.Module, x: torch.Tensor) -> torch.Tensor:
    return ((net(x)[:, 0] - x.sum(1)) ** 2).mean()


def same(a: nn.Module, b: nn.Module) -> bool:
    """Whether all weights and buffers are the same to the last bit."""
    return all(torch.equal(x, y) for x, y in zip(a.state_dict().values(), b.state_dict().values(), strict=True))


def stop_at(*numbers: int):
    """A `callback` that presses Ctrl-C after each of these steps."""
    left = list(numbers)

    def callback(step: int, loss: float) -> None:
        if left and step == left[0]:
            left.pop(0)
            raise KeyboardInterrupt

    return callback


@pytest.mark.parametrize("config", [PLAIN, MEAN], ids=["plain", "mean"])
@pytest.mark.parametrize("make", [a_net, a_net_with_buffers])
def test_a_run_that_was_broken_off_is_an_unbroken_one(make, config, tmp_path):
    a, again, kept, seen = make(), make(), tmp_path / "a.run", []
    whole = fit(a, a_batch, a_loss, config, title="").losses
    callback = stop_at(11, 12, 31)
    for _ in range(3):
        broken = make()
        with pytest.raises(KeyboardInterrupt):
            fit(broken, a_batch, a_loss, config, resume=kept, title="", callback=callback)
    run = fit(again, a_batch, a_loss, config, resume=kept, title="", callback=lambda step, _: seen.append(step))
    assert run.losses == whole and seen[0] == 32 and same(a, again)
    assert list(tmp_path.iterdir()) == [] and not again.training


@pytest.mark.parametrize("moment", ["loss", "optimizer", "mean"])
def test_ctrl_c_in_the_middle_of_a_step_keeps_no_half_step(moment, tmp_path, monkeypatch):
    a, broken, again, kept = a_net_with_buffers(), a_net_with_buffers(), a_net_with_buffers(), tmp_path / "a.run"
    whole = fit(a, a_batch, a_loss, MEAN, title="").losses
    calls = []

    def interrupted(original):
        def call(*args, **more):
            found = original(*args, **more)
            calls.append(0)
            if len(calls) == 20:
                raise KeyboardInterrupt  # when the work is done, but the step is not
            return found

        return call

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        if moment == "optimizer":
            patch.setattr(torch.optim.AdamW, "step", interrupted(torch.optim.AdamW.step))
        if moment == "mean":
            update = torch.optim.swa_utils.AveragedModel.update_parameters
            patch.setattr(torch.optim.swa_utils.AveragedModel, "update_parameters", interrupted(update))
        loss = interrupted(a_loss) if moment == "loss" else a_loss
        fit(broken, a_batch, loss, replace(MEAN, save_every=0.0), resume=kept, title="")
    assert fit(again, a_batch, a_loss, MEAN, resume=kept, title="").losses == whole and same(a, again)


def test_seconds_add_up(tmp_path):
    def slow(net: nn.Module, x: torch.Tensor) -> torch.Tensor:
        time.sleep(0.02)
        return a_loss(net, x)

    callback, kept, begun = stop_at(4, 9), tmp_path / "a.run", time.monotonic()
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            fit(a_net(), a_batch, slow, TrainConfig(15), resume=kept, title="", callback=callback)
    time.sleep(0.3)  # a pause between runs is no training
    run = fit(a_net(), a_batch, slow, TrainConfig(15), resume=kept, title="")
    passed = time.monotonic() - begun
    assert 15 * 0.02 < run.seconds < passed - 0.3
    assert run.steps_per_second == pytest.approx(15 / run.seconds)


def test_a_run_that_was_over_but_for_its_end_goes_on_to_it(tmp_path):
    a, again, kept = a_net(), a_net(), tmp_path / "a.run"
    fit(a, a_batch, a_loss, MEAN, title="")
    with pytest.raises(KeyboardInterrupt):
        fit(a_net(), a_batch, a_loss, MEAN, resume=kept, title="", callback=stop_at(39))
    assert len(fit(again, a_batch, a_loss, MEAN, resume=kept, title="").losses) == 40 and same(a, again)


def test_a_kept_run_of_something_else_is_refused(tmp_path):
    kept, net = tmp_path / "a.run", a_net()
    with pytest.raises(KeyboardInterrupt):
        fit(net, a_batch, a_loss, PLAIN, resume=kept, title="", callback=stop_at(1))
    with pytest.raises(mk.MotionKitError, match="another config"):
        fit(net, a_batch, a_loss, TrainConfig(61), resume=kept, title="")
    with pytest.raises(mk.MotionKitError, match="another config"):
        fit(net, a_batch, a_loss, replace(PLAIN, signature="batches of 8"), resume=kept, title="")
    other = nn.Linear(4, 1)
    with pytest.raises(mk.MotionKitError, match="another configuration"):
        fit(other, a_batch, a_loss, PLAIN, resume=kept, title="")
    kept.write_bytes(kept.read_bytes()[:-50])
    with pytest.raises(mk.MotionKitError, match="remove it to start again"):
        fit(net, a_batch, a_loss, PLAIN, resume=kept, title="")


def named_batch(step: int) -> dict:
    """A batch, and the clips that it is of."""
    return {"x": a_batch(step), "step": step, "names": [f"walk_{step}_1", f"walk_{step}_2"]}


def named_loss(net: nn.Module, batch: dict) -> torch.Tensor:
    return a_loss(net, batch["x"])


def bad_loss(net: nn.Module, batch: dict) -> torch.Tensor:
    """NaN at step 7, in what the network sees."""
    return a_loss(net, batch["x"] * (torch.nan if batch["step"] == 7 else 1))


class BadGradient(torch.autograd.Function):
    """A number as it is, with a gradient that is not finite."""

    @staticmethod
    def forward(context, x):
        return x.clone()

    @staticmethod
    def backward(context, gradient):
        return gradient * torch.inf


def bad_gradient(net: nn.Module, batch: dict) -> torch.Tensor:
    """A loss that is finite and whose gradient is not, at step 7."""
    loss = named_loss(net, batch)
    return BadGradient.apply(loss) if batch["step"] == 7 else loss


@pytest.mark.parametrize("make", [a_net, a_net_with_buffers])
@pytest.mark.parametrize(
    "bad, message",
    [
        (bad_loss, "the loss of step 7 is nan"),
        (bad_gradient, r"the loss of step 7 is \d.*, the norm of its gradient nan"),
    ],
)
def test_what_is_not_finite_stops_the_run_and_the_state_before_is_kept(make, bad, message, tmp_path):
    before, net, kept = make(), make(), tmp_path / "a.run"
    with pytest.raises(KeyboardInterrupt):
        fit(before, a_batch, a_loss, MEAN, title="", callback=stop_at(6))
    with pytest.raises(mk.MotionKitError, match=message + ".*its batch: walk_7_1, walk_7_2; the state before.*a.run"):
        fit(net, named_batch, bad, MEAN, resume=kept, title="")
    assert same(net, before) and all(torch.isfinite(value).all() for value in net.state_dict().values())
    a, again, seen = make(), make(), []
    fit(a, a_batch, a_loss, MEAN, title="")
    fit(again, a_batch, a_loss, MEAN, resume=kept, title="", callback=lambda step, _: seen.append(step))
    assert seen[0] == 7 and same(a, again)


@pytest.mark.parametrize("more", [{}, {"names": []}, {"names": [f"clip {n}" for n in range(9)]}])
def test_a_bad_batch_is_named_as_well_as_it_can_be(more):
    def bad(net: nn.Module, batch: object) -> torch.Tensor:
        return a_loss(net, batch if isinstance(batch, torch.Tensor) else batch["x"]) * torch.nan

    batch = {"x": torch.ones(2, 4), **more} if more else torch.ones(2, 4)
    said = "its batch: clip 0, .*, clip 7, ...[.] Look" if more.get("names") else "its batch is that of seed 5. Look"
    with pytest.raises(mk.MotionKitError, match=said):
        fit(a_net(), lambda step: batch, bad, TrainConfig(2, seed=5), title="")


def test_the_batch_of_a_step_can_be_drawn_again():
    batches = []

    def draw(step: int) -> torch.Tensor:
        batches.append(a_batch(step))
        return batches[-1]

    fit(a_net(), draw, a_loss, TrainConfig(5, seed=8), title="")
    for step, numbers in enumerate(batches):
        seed_batch(TrainConfig(5, seed=8), step)
        assert torch.equal(a_batch(step), numbers)
    assert len({tuple(numbers[0].tolist()) for numbers in batches}) == 5


def test_the_mean_of_the_weights_by_hand():
    config, net, weights = TrainConfig(6, lr=0.1, ema=0.25), nn.Linear(1, 1, bias=False), []

    def miss(model: nn.Module, x: torch.Tensor) -> torch.Tensor:
        return (model(x) - 3).square().sum()

    ones = torch.ones(1, 1)
    fit(net, lambda step: ones, miss, config, title="", callback=lambda *_: weights.append(net.weight.item()))
    mean = weights[0]  # the first mean is the first weight; then (1 + n) / (10 + n) of it stays, but at most a quarter
    for stays, weight in zip((2 / 11, 0.25, 0.25, 0.25, 0.25), weights[1:], strict=True):
        mean = stays * mean + (1 - stays) * weight
    assert net.weight.item() == pytest.approx(mean, abs=1e-6) and abs(mean - weights[-1]) > 1e-4


def test_one_training_says_nothing_and_leaves_nothing_to_the_next(capfd, tmp_path):
    alone, other, after = a_net(), a_net_with_buffers(), a_net()
    fit(alone, a_batch, a_loss, replace(PLAIN, save_every=0.0), title="", resume=tmp_path / "a.run")
    fit(other, a_batch, a_loss, MEAN, title="")
    fit(after, a_batch, a_loss, PLAIN, title="")
    assert same(alone, after) and capfd.readouterr() == ("", "")
    assert type(alone) is nn.Sequential and "forward" not in vars(alone)
    fit(alone, a_batch, a_loss, TrainConfig(3), title="bar")
    shown = capfd.readouterr()
    assert shown.out == "" and "bar" in shown.err and "3/3" in shown.err and "loss=" in shown.err


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"lr": -1.0}, {"grad_clip": 0.0}, {"ema": 1.0}, {"lr": torch.nan}])
def test_configs_out_of_range(wrong):
    with pytest.raises(mk.MotionKitError, match="training takes at least 1 step"):
        TrainConfig(**{"steps": 5, **wrong})


LONG = TrainConfig(10**6, lr=0.05, ema=0.9, save_every=0.0)


@pytest.fixture
def one_thread():
    """Sums of several threads differ in the last digit from those of one, which the killed process has."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def train_until_killed(kept, begun, saves: int) -> None:
    """In a process of its own. saves: at the end of which it kills itself, before the file is in place; 0: never."""
    torch.set_num_threads(1)
    replace, count = os.replace, []

    def deadly(*paths) -> None:
        count.append(0)
        if len(count) == saves:
            os.kill(os.getpid(), signal.SIGKILL)
        replace(*paths)

    os.replace = deadly
    fit(
        a_net_with_buffers(),
        a_batch,
        a_loss,
        LONG,
        resume=kept,
        title="",
        callback=lambda *_: kept.exists() and begun.set(),
    )


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL there")
def test_a_run_that_is_killed_at_any_moment_goes_on_as_if_nothing_had_happened(tmp_path, one_thread):
    kept, context, reached = tmp_path / "a.run", multiprocessing.get_context("forkserver"), [0]
    context.set_forkserver_preload(["motionkit.training"])
    for pause, saves in ((0.05, 0), (0, 4), (0.003, 0), (0, 1), (0.11, 0), (0, 2)):
        begun = context.Event()
        process = context.Process(target=train_until_killed, args=(kept, begun, saves), daemon=True)
        process.start()
        if not saves:
            assert begun.wait(60)
            time.sleep(pause)
            os.kill(process.pid, signal.SIGKILL)
        process.join(60)
        assert process.exitcode == -signal.SIGKILL
        a, again, count = a_net_with_buffers(), a_net_with_buffers(), len(run_of(kept))
        assert count >= reached[-1] + max(saves - 1, 0)
        reached.append(count)
    assert any(path.name.startswith(".a.run.") for path in tmp_path.iterdir())  # it did die while it saved
    losses = run_of(kept)
    with pytest.raises(KeyboardInterrupt):
        fit(a, a_batch, a_loss, LONG, title="", resume=tmp_path / "b.run", callback=stop_at(len(losses)))
    with pytest.raises(KeyboardInterrupt):
        fit(again, a_batch, a_loss, LONG, title="", resume=kept, callback=stop_at(len(losses)))
    assert run_of(kept) == run_of(tmp_path / "b.run") and same(a, again)


def run_of(kept) -> list[float]:
    """The losses in a kept run."""
    from safetensors.torch import load_file

    return load_file(kept)["losses"].tolist()


REAL = torch.tensor([2.0, -1.0])


def a_pair() -> tuple[nn.Module, nn.Module]:
    """A generator of points in the plane, which has buffers, and its critic."""
    torch.manual_seed(5)
    generator = nn.Sequential(nn.Linear(2, 8), nn.BatchNorm1d(8), nn.ReLU(), nn.Linear(8, 2))
    return generator, nn.Sequential(nn.Linear(2, 8), nn.ReLU(), nn.Linear(8, 1))


def real_points(step: int) -> dict:
    return {"real": REAL + 0.1 * torch.randn(16, 2), "noise": torch.randn(16, 2), "names": [f"points_{step}"]}


def generator_loss(generator: nn.Module, critic: nn.Module, batch: dict) -> tuple[torch.Tensor, torch.Tensor]:
    fake = generator(batch["noise"])
    return ((critic(fake) - 1) ** 2).mean(), fake


def critic_loss(critic: nn.Module, fake: torch.Tensor, batch: dict) -> torch.Tensor:
    return ((critic(batch["real"]) - 1) ** 2).mean() + ((critic(fake) + 1) ** 2).mean()


LOSSES, GAME = (generator_loss, critic_loss), TrainConfig(40, lr=0.01, weight_decay=0.0, ema=0.9)


def test_a_generator_and_its_critic_both_learn():
    (generator, critic), untrained = a_pair(), a_pair()
    config = TrainConfig(300, lr=0.01, weight_decay=0.0, critic_lr_ratio=0.5)
    run = fit_adversarial((generator, critic), real_points, LOSSES, config, title="")
    assert len(run.losses) == 300 and not generator.training and not critic.training
    noise = torch.randn(64, 2)
    miss = [(net(noise).mean(0) - REAL).norm().item() for net in (generator, untrained[0].eval())]
    assert miss[0] < 0.5 * miss[1]
    assert not same(critic, untrained[1]) and all(weight.requires_grad for weight in critic.parameters())


def test_neither_loss_reaches_the_other_net():
    """A generator's loss gives its critic no gradient, a critic's none to what was generated."""
    before, after = a_pair(), a_pair()
    generated = []

    def only_generator(generator: nn.Module, critic: nn.Module, batch: dict) -> tuple:
        assert not any(weight.requires_grad for weight in critic.parameters())
        loss, fake = generator_loss(generator, critic, batch)
        assert fake.requires_grad
        return loss, (fake, fake[:2])

    def no_critic(critic: nn.Module, fakes: tuple, batch: dict) -> torch.Tensor:
        generated.extend(fakes)
        assert all(weight.grad is None or not weight.grad.any() for weight in critic.parameters())
        return 0 * critic_loss(critic, fakes[0], batch)

    config = TrainConfig(3, weight_decay=0.0)
    fit_adversarial(after, real_points, (only_generator, no_critic), config, title="")
    assert len(generated) == 6 and not any(fake.requires_grad for fake in generated)
    for old, new in zip(before[1].parameters(), after[1].parameters(), strict=True):
        assert torch.equal(old, new)
    assert not same(before[0], after[0])


def test_the_critics_rate_is_a_share_of_the_generators():
    """AdamW's first step is as long as its learning rate."""
    before, after = a_pair(), a_pair()
    config = TrainConfig(1, lr=0.01, weight_decay=0.0, critic_lr_ratio=0.25)
    fit_adversarial(after, real_points, LOSSES, config, title="")
    for part, rate in ((0, 0.01), (1, 0.0025)):
        moved = (before[part][0].weight - after[part][0].weight).detach().abs().max()
        assert float(moved) == pytest.approx(rate * config.lr_at(0) / config.lr, rel=1e-3)


def test_what_is_frozen_in_a_critic_stays_frozen():
    generator, critic = a_pair()
    critic[0].requires_grad_(False)
    frozen = critic[0].weight.clone()
    fit_adversarial((generator, critic), real_points, LOSSES, GAME, title="")
    assert torch.equal(critic[0].weight, frozen) and not critic[0].weight.requires_grad
    assert critic[2].weight.requires_grad


def test_an_adversarial_run_that_was_broken_off_is_an_unbroken_one(tmp_path):
    whole, again, kept = a_pair(), a_pair(), tmp_path / "a.run"
    losses = fit_adversarial(whole, real_points, LOSSES, GAME, title="").losses
    callback = stop_at(11, 12, 31)
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            fit_adversarial(a_pair(), real_points, LOSSES, GAME, resume=kept, title="", callback=callback)
    run = fit_adversarial(again, real_points, LOSSES, GAME, resume=kept, title="")
    assert run.losses == losses and all(same(a, b) for a, b in zip(whole, again))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("who", [0, 1], ids=["generator", "critic"])
@pytest.mark.parametrize("error", [torch.nan, KeyboardInterrupt], ids=["nan", "ctrl-c"])
def test_what_stops_an_adversarial_step_leaves_the_state_before_it(who, error, tmp_path):
    whole, broken, kept = a_pair(), a_pair(), tmp_path / "a.run"
    losses = fit_adversarial(whole, real_points, LOSSES, GAME, title="").losses

    def bad(*arguments):
        answer = LOSSES[who](*arguments)
        if arguments[-1]["names"] != ["points_7"]:
            return answer
        if error is KeyboardInterrupt:
            raise error
        return (answer[0] * error, answer[1]) if who == 0 else answer * error

    parts = tuple(bad if n == who else loss for n, loss in enumerate(LOSSES))
    message = "the loss of step 7 is nan.*its batch: points_7; the state before that step.*a.run"
    with pytest.raises(KeyboardInterrupt if error is KeyboardInterrupt else mk.MotionKitError) as told:
        fit_adversarial(broken, real_points, parts, GAME, resume=kept, title="")
    assert error is KeyboardInterrupt or re.search(message, str(told.value))
    assert len(run_of(kept)) == 7 and all(weight.requires_grad for net in broken for weight in net.parameters())
    again = a_pair()
    assert fit_adversarial(again, real_points, LOSSES, GAME, resume=kept, title="").losses == losses
    assert all(same(a, b) for a, b in zip(whole, again))


@dataclass(frozen=True)
class Sample:
    x: torch.Tensor
    name: str


class Place(NamedTuple):
    x: torch.Tensor
    clip: int


def test_every_tensor_of_a_batch_is_moved():
    """To a device that holds no numbers, so that every machine has it."""
    here = torch.ones(2, 3)
    batch = {"x": here, "several": [here, (here, "walk")], "none": None, "step": 3}
    moved = to_device(batch, "meta")
    assert list(moved) == list(batch) and moved["none"] is None and moved["step"] == 3
    assert moved["x"].is_meta and moved["several"][0].is_meta and moved["several"][1][0].is_meta
    assert isinstance(moved["several"], list) and moved["several"][1][1] == "walk" and batch["x"] is here
    sample, place = to_device(Sample(here, "walk"), "meta"), to_device(Place(here, 4), "meta")
    assert sample.x.is_meta and sample.name == "walk" and isinstance(sample, Sample)
    assert place.x.is_meta and place.clip == 4 and isinstance(place, Place)
    assert to_device("walk", "meta") == "walk" and to_device(here, "cpu") is here


def test_a_data_sets_batch_stays_one():
    moved = to_device(mk.datasets.Batch(mask=torch.ones(2, 8).bool(), names=["a", "b"]), "meta")
    assert moved.mask.is_meta and moved.names == ["a", "b"]


@pytest.fixture
def pair(tmp_path):
    path = tmp_path / "toy.safetensors"
    return checkpoints.save(path, {"w": torch.arange(6.0).reshape(2, 3)}, {"kind": "toy", "seed": 0})


def test_there_and_back(pair):
    tensors, card = checkpoints.load(pair, "toy")
    assert torch.equal(tensors["w"], torch.arange(6.0).reshape(2, 3)) and card["seed"] == 0


def test_damaged_and_foreign_checkpoints_are_named(pair, tmp_path):
    data, text = pair.read_bytes(), pair.with_suffix(".json").read_text()
    with pytest.raises(mk.MotionKitError, match="holds a 'toy'; expected a 'prior'"):
        checkpoints.load(pair, "prior")
    for broken in (data[:-1], data[:10], b"", data[:-4] + b"abcd"):
        pair.write_bytes(broken)
        with pytest.raises(mk.MotionKitError, match="damaged"):
            checkpoints.load(pair)
    pair.write_bytes(data)
    for card, message in ((text[:20], "no card can be read"), ('{"format": 99}', "newer"), ("[]", "newer")):
        pair.with_suffix(".json").write_text(card)
        with pytest.raises(mk.MotionKitError, match=message):
            checkpoints.load(pair)
    pair.with_suffix(".json").unlink()
    with pytest.raises(mk.MotionKitError, match="no such file"):
        checkpoints.load(pair)
    with pytest.raises(mk.MotionKitError, match="not finite"):
        checkpoints.save(pair, {"w": torch.tensor([torch.nan])}, {})
    assert pair.read_bytes() == data  # what was there is not lost


def test_weights_of_another_network_are_refused(pair):
    tensors, _ = checkpoints.load(pair)
    with pytest.raises(mk.MotionKitError, match="weight is missing"):
        checkpoints.load_into(nn.Linear(3, 2), tensors, pair)
    with pytest.raises(mk.MotionKitError, match=r"weight is \[2, 3\], the network's \[2, 4\]"):
        checkpoints.load_into(nn.Linear(4, 2, bias=False), {"weight": tensors["w"]}, pair)


def test_another_folder_can_be_named(pair, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CHECKPOINTS", str(pair.parent))
    assert checkpoints.names() == ["toy"] and checkpoints.find("toy") == pair
    with pytest.raises(mk.MotionKitError, match="did you mean 'toy'"):
        checkpoints.find("toyy")
    assert json.loads(pair.with_suffix(".json").read_text())["format"] == checkpoints.FORMAT
