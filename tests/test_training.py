"""Training that is broken off and resumed, checkpoints that are damaged, cut short, or somebody else's."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
import torch
from torch import nn

import motionkit as mk
from motionkit import checkpoints
from motionkit.training import Schedule, fit

SCHEDULE = Schedule(60, rate=0.05)


def a_net() -> nn.Module:
    torch.manual_seed(3)
    return nn.Sequential(nn.Linear(4, 8), nn.ReLU(), nn.Dropout(0.2), nn.Linear(8, 1))


def a_loss(net: nn.Module, step: int) -> torch.Tensor:
    x = torch.randn(16, 4)
    return ((net(x)[:, 0] - x.sum(1)) ** 2).mean()


def test_a_run_that_was_broken_off_gives_the_losses_of_an_unbroken_one(tmp_path):
    a = a_net()
    whole = fit(a, a_loss, SCHEDULE, title="").losses
    keep = tmp_path / "a.run"

    def stop(step: int, loss: float) -> None:
        if step == 31:
            raise KeyboardInterrupt

    broken = a_net()
    with pytest.raises(KeyboardInterrupt):
        fit(broken, a_loss, SCHEDULE, keep=keep, every=0.0, title="", show=stop)
    assert keep.exists()
    again = a_net()
    seen = []
    run = fit(again, a_loss, SCHEDULE, keep=keep, title="", show=lambda step, _: seen.append(step))
    assert run.losses == whole and seen[0] == 31 and not keep.exists()
    assert all(torch.equal(x, y) for x, y in zip(a.state_dict().values(), again.state_dict().values()))


def test_a_kept_run_of_something_else_is_refused(tmp_path):
    keep = tmp_path / "a.run"

    def stop(step: int, loss: float) -> None:
        raise KeyboardInterrupt

    net = a_net()
    with pytest.raises(KeyboardInterrupt):
        fit(net, a_loss, SCHEDULE, keep=keep, every=0.0, title="", show=lambda n, _: stop(n, _) if n else None)
    with pytest.raises(mk.MotionKitError, match="another schedule"):
        fit(net, a_loss, Schedule(61), keep=keep, title="")
    other = nn.Linear(4, 1)
    with pytest.raises(mk.MotionKitError, match="another configuration"):
        fit(other, a_loss, SCHEDULE, keep=keep, title="")
    keep.write_bytes(keep.read_bytes()[:-50])
    with pytest.raises(mk.MotionKitError, match="remove it to start again"):
        fit(net, a_loss, SCHEDULE, keep=keep, title="")


def test_a_loss_that_is_not_finite_stops_the_run_and_keeps_what_was(tmp_path):
    net, keep = a_net(), tmp_path / "a.run"
    with pytest.raises(mk.MotionKitError, match="the loss of step 7 is nan"):
        fit(
            net,
            lambda model, n: a_loss(model, n) * (torch.nan if n == 7 else 1),
            SCHEDULE,
            keep=keep,
            every=0.0,
            title="",
        )
    assert all(torch.isfinite(value).all() for value in net.state_dict().values())
    again = a_net()
    assert len(fit(again, a_loss, SCHEDULE, keep=keep, title="").losses) == 60


KILLED = """
import sys, torch
sys.path.insert(0, "tests")
from test_training import SCHEDULE, a_loss, a_net
from motionkit.training import Schedule, fit
net = a_net()
show = lambda *_: print("x", flush=True)
fit(net, a_loss, Schedule(10**6, rate=0.05), keep=sys.argv[1], every=0.0, title="", show=show)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL there")
def test_a_run_that_is_killed_at_any_moment_leaves_a_state_that_can_be_read(tmp_path):
    keep = tmp_path / "a.run"
    for pause in (0.05, 0.11, 0.17):
        process = subprocess.Popen([sys.executable, "-c", KILLED, str(keep)], stdout=subprocess.PIPE)
        process.stdout.readline()
        time.sleep(pause)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        process.stdout.close()
        assert first_step(keep) > 0  # it goes on, it does not start again


def first_step(keep) -> int:
    """Where a kept run goes on."""
    net, steps = a_net(), []
    with pytest.raises(ZeroDivisionError):
        kept = Schedule(10**6, rate=0.05)
        fit(net, a_loss, kept, keep=keep, title="", show=lambda n, _: steps.append(n) or 1 / 0)
    return steps[0]


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
