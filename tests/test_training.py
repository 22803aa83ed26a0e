"""Training that is broken off and resumed, checkpoints that are damaged, cut short, or somebody else's."""

import json
import multiprocessing
import os
import signal
import sys
import time
from dataclasses import replace

import pytest
import torch
from torch import nn

import motionkit as mk
from motionkit import checkpoints
from motionkit.training import TrainConfig, fit, seed_batch

SCHEDULE = TrainConfig(60, rate=0.05)
MEAN = TrainConfig(40, rate=0.05, average=0.9)


def a_net() -> nn.Module:
    torch.manual_seed(3)
    return nn.Sequential(nn.Linear(4, 8), nn.ReLU(), nn.Dropout(0.2), nn.Linear(8, 1))


def a_net_with_buffers() -> nn.Module:
    torch.manual_seed(4)
    return nn.Sequential(nn.Linear(4, 8), nn.BatchNorm1d(8), nn.Linear(8, 1))


def a_loss(net: nn.Module, step: int) -> torch.Tensor:
    x = torch.randn(16, 4)
    return ((net(x)[:, 0] - x.sum(1)) ** 2).mean()


def same(a: nn.Module, b: nn.Module) -> bool:
    """Whether all weights and buffers are the same to the last bit."""
    return all(torch.equal(x, y) for x, y in zip(a.state_dict().values(), b.state_dict().values(), strict=True))


def stop_at(*numbers: int):
    """A `show` that presses Ctrl-C after each of these steps."""
    left = list(numbers)

    def show(step: int, loss: float) -> None:
        if left and step == left[0]:
            left.pop(0)
            raise KeyboardInterrupt

    return show


@pytest.mark.parametrize("schedule", [SCHEDULE, MEAN], ids=["plain", "mean"])
@pytest.mark.parametrize("make", [a_net, a_net_with_buffers])
def test_a_run_that_was_broken_off_is_an_unbroken_one(make, schedule, tmp_path):
    a, again, keep, seen = make(), make(), tmp_path / "a.run", []
    whole = fit(a, a_loss, schedule, title="").losses
    show = stop_at(11, 12, 31)
    for _ in range(3):
        broken = make()
        with pytest.raises(KeyboardInterrupt):
            fit(broken, a_loss, schedule, keep=keep, title="", show=show)
    run = fit(again, a_loss, schedule, keep=keep, title="", show=lambda step, _: seen.append(step))
    assert run.losses == whole and seen[0] == 32 and same(a, again)
    assert list(tmp_path.iterdir()) == [] and not again.training


@pytest.mark.parametrize("moment", ["loss", "optimizer", "mean"])
def test_ctrl_c_in_the_middle_of_a_step_keeps_no_half_step(moment, tmp_path, monkeypatch):
    a, broken, again, keep = a_net_with_buffers(), a_net_with_buffers(), a_net_with_buffers(), tmp_path / "a.run"
    whole = fit(a, a_loss, MEAN, title="").losses
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
        fit(broken, loss, MEAN, keep=keep, every=0.0, title="")
    assert fit(again, a_loss, MEAN, keep=keep, title="").losses == whole and same(a, again)


def test_seconds_add_up(tmp_path):
    def slow(net: nn.Module, step: int) -> torch.Tensor:
        time.sleep(0.02)
        return a_loss(net, step)

    show, keep, begun = stop_at(4, 9), tmp_path / "a.run", time.monotonic()
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            fit(a_net(), slow, TrainConfig(15), keep=keep, title="", show=show)
    time.sleep(0.3)  # a pause between runs is no training
    run = fit(a_net(), slow, TrainConfig(15), keep=keep, title="")
    passed = time.monotonic() - begun
    assert 15 * 0.02 < run.seconds < passed - 0.3
    assert run.steps_per_second == pytest.approx(15 / run.seconds)


def test_a_run_that_was_over_but_for_its_end_goes_on_to_it(tmp_path):
    a, again, keep = a_net(), a_net(), tmp_path / "a.run"
    fit(a, a_loss, MEAN, title="")
    with pytest.raises(KeyboardInterrupt):
        fit(a_net(), a_loss, MEAN, keep=keep, title="", show=stop_at(39))
    assert len(fit(again, a_loss, MEAN, keep=keep, title="").losses) == 40 and same(a, again)


def test_a_kept_run_of_something_else_is_refused(tmp_path):
    keep, net = tmp_path / "a.run", a_net()
    with pytest.raises(KeyboardInterrupt):
        fit(net, a_loss, SCHEDULE, keep=keep, title="", show=stop_at(1))
    with pytest.raises(mk.MotionKitError, match="another schedule"):
        fit(net, a_loss, TrainConfig(61), keep=keep, title="")
    with pytest.raises(mk.MotionKitError, match="another schedule or recipe"):
        fit(net, a_loss, replace(SCHEDULE, recipe="batches of 8"), keep=keep, title="")
    other = nn.Linear(4, 1)
    with pytest.raises(mk.MotionKitError, match="another configuration"):
        fit(other, a_loss, SCHEDULE, keep=keep, title="")
    keep.write_bytes(keep.read_bytes()[:-50])
    with pytest.raises(mk.MotionKitError, match="remove it to start again"):
        fit(net, a_loss, SCHEDULE, keep=keep, title="")


def bad_loss(net: nn.Module, step: int) -> torch.Tensor:
    """NaN at step 7, in what the network sees."""
    x = torch.randn(16, 4) * (torch.nan if step == 7 else 1)
    return ((net(x)[:, 0] - x.sum(1)) ** 2).mean()


class BadGradient(torch.autograd.Function):
    """A number as it is, with a gradient that is not finite."""

    @staticmethod
    def forward(context, x):
        return x.clone()

    @staticmethod
    def backward(context, gradient):
        return gradient * torch.inf


def bad_gradient(net: nn.Module, step: int) -> torch.Tensor:
    """A loss that is finite and whose gradient is not, at step 7."""
    loss = a_loss(net, step)
    return BadGradient.apply(loss) if step == 7 else loss


@pytest.mark.parametrize("make", [a_net, a_net_with_buffers])
@pytest.mark.parametrize(
    "bad, message",
    [
        (bad_loss, "the loss of step 7 is nan"),
        (bad_gradient, r"the loss of step 7 is \d.*, the length of its gradient nan"),
    ],
)
def test_what_is_not_finite_stops_the_run_and_the_state_before_is_kept(make, bad, message, tmp_path):
    before, net, keep = make(), make(), tmp_path / "a.run"
    with pytest.raises(KeyboardInterrupt):
        fit(before, a_loss, MEAN, title="", show=stop_at(6))
    clips = {7: "walk_old_1, walk_old_2"}
    with pytest.raises(
        mk.MotionKitError, match=message + ".*its batch: walk_old_1, walk_old_2; the state before.*a.run"
    ):
        fit(net, bad, MEAN, keep=keep, title="", batch_of=clips.get)
    assert same(net, before) and all(torch.isfinite(value).all() for value in net.state_dict().values())
    a, again, seen = make(), make(), []
    fit(a, a_loss, MEAN, title="")
    fit(again, a_loss, MEAN, keep=keep, title="", show=lambda step, _: seen.append(step))
    assert seen[0] == 7 and same(a, again)


def test_the_batch_of_a_step_can_be_drawn_again():
    seen = []
    fit(a_net(), lambda net, n: seen.append(torch.rand(3)) or a_loss(net, n), TrainConfig(5, seed=8), title="")
    for step, numbers in enumerate(seen):
        seed_batch(TrainConfig(5, seed=8), step)
        assert torch.equal(torch.rand(3), numbers)
    assert len({tuple(numbers.tolist()) for numbers in seen}) == 5


def test_the_mean_of_the_weights_by_hand():
    schedule, net, weights = TrainConfig(6, rate=0.1, average=0.25), nn.Linear(1, 1, bias=False), []

    def miss(model: nn.Module, step: int) -> torch.Tensor:
        return (model(torch.ones(1, 1)) - 3).square().sum()

    fit(net, miss, schedule, title="", show=lambda *_: weights.append(net.weight.item()))
    mean = weights[0]  # the first mean is the first weight; then (1 + n) / (10 + n) of it stays, but at most a quarter
    for stays, weight in zip((2 / 11, 0.25, 0.25, 0.25, 0.25), weights[1:], strict=True):
        mean = stays * mean + (1 - stays) * weight
    assert net.weight.item() == pytest.approx(mean, abs=1e-6) and abs(mean - weights[-1]) > 1e-4


def test_one_training_says_nothing_and_leaves_nothing_to_the_next(capfd, tmp_path):
    alone, other, after = a_net(), a_net_with_buffers(), a_net()
    fit(alone, a_loss, SCHEDULE, title="", keep=tmp_path / "a.run", every=0.0)
    fit(other, a_loss, MEAN, title="")
    fit(after, a_loss, SCHEDULE, title="")
    assert same(alone, after) and capfd.readouterr() == ("", "")
    assert type(alone) is nn.Sequential and "forward" not in vars(alone)
    fit(alone, a_loss, TrainConfig(3), title="bar")
    shown = capfd.readouterr()
    assert shown.out == "" and "bar" in shown.err and "3/3" in shown.err and "loss=" in shown.err


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"rate": -1.0}, {"clip": 0.0}, {"average": 1.0}, {"rate": torch.nan}])
def test_schedules_out_of_range(wrong):
    with pytest.raises(mk.MotionKitError, match="a schedule has at least 1 step"):
        TrainConfig(**{"steps": 5, **wrong})


LONG = TrainConfig(10**6, rate=0.05, average=0.9)


@pytest.fixture
def one_thread():
    """Sums of several threads differ in the last digit from those of one, which the killed process has."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def train_until_killed(keep, begun, saves: int) -> None:
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
        a_loss,
        LONG,
        keep=keep,
        every=0.0,
        title="",
        show=lambda *_: keep.exists() and begun.set(),
    )


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL there")
def test_a_run_that_is_killed_at_any_moment_goes_on_as_if_nothing_had_happened(tmp_path, one_thread):
    keep, context, reached = tmp_path / "a.run", multiprocessing.get_context("forkserver"), [0]
    context.set_forkserver_preload(["motionkit.training"])
    for pause, saves in ((0.05, 0), (0, 4), (0.003, 0), (0, 1), (0.11, 0), (0, 2)):
        begun = context.Event()
        process = context.Process(target=train_until_killed, args=(keep, begun, saves), daemon=True)
        process.start()
        if not saves:
            assert begun.wait(60)
            time.sleep(pause)
            os.kill(process.pid, signal.SIGKILL)
        process.join(60)
        assert process.exitcode == -signal.SIGKILL
        a, again, count = a_net_with_buffers(), a_net_with_buffers(), len(run_of(keep))
        assert count >= reached[-1] + max(saves - 1, 0)
        reached.append(count)
    assert any(path.name.startswith(".a.run.") for path in tmp_path.iterdir())  # it did die while it saved
    losses = run_of(keep)
    with pytest.raises(KeyboardInterrupt):
        fit(a, a_loss, LONG, title="", keep=tmp_path / "b.run", show=stop_at(len(losses)))
    with pytest.raises(KeyboardInterrupt):
        fit(again, a_loss, LONG, title="", keep=keep, show=stop_at(len(losses)))
    assert run_of(keep) == run_of(tmp_path / "b.run") and same(a, again)


def run_of(keep) -> list[float]:
    """The losses in a kept run."""
    from safetensors.torch import load_file

    return load_file(keep)["losses"].tolist()


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
