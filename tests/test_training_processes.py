"""Two processes under `accelerate launch`: one model, their gradients' mean, one of them writes and shows."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from processes_lab import BAD
from safetensors.torch import load_file
from test_training import MEAN, a_batch, a_loss, a_net, a_pair

import motionkit as mk
from motionkit import checkpoints
from motionkit.text.encoders import Mini, MiniConfig, MiniNetwork
from motionkit.training import fit, seed_batch

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
# `--cpu` would start one process only; `--multi_gpu` starts several, and they stay on the CPU if they are told so.
LAUNCH = ["-m", "accelerate.commands.launch", "--multi_gpu", "--num_processes", "2", "--num_machines", "1",
          "--mixed_precision", "no", "--dynamo_backend", "no", "--main_process_port", "0"]  # fmt: skip


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """What both processes said, the folder that they worked in, and what came out of them."""
    folder = tmp_path_factory.mktemp("two")
    (folder / "checkpoints").mkdir()
    (folder / "clips").mkdir()
    for name in ("walk_neutral", "walk_old", "walk_angry", "run_neutral", "run_angry"):
        walk = mk.load(ROOT / "data" / "actor" / f"{name}.bvh")
        for take in range(4):
            mk.save(walk[take : take + 45], folder / "clips" / f"{name}_{take}.bvh")
    torch.manual_seed(0)
    Mini(MiniNetwork(MiniConfig(width=16, layers=1, heads=2, buckets=64, size=8))).save(
        folder / "checkpoints" / "text-mini.safetensors"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "MOTIONKIT_CHECKPOINTS": str(folder / "checkpoints")}
    environment |= {"MOTIONKIT_CACHE": str(folder / "cache"), "ACCELERATE_USE_CPU": "true"}
    command = [sys.executable, *LAUNCH, str(ROOT / "tests" / "processes_lab.py"), str(folder), str(folder / "clips")]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-3000:]
    said = [json.loads((folder / f"said-{rank}.json").read_text()) for rank in (0, 1)]
    return SimpleNamespace(folder=folder, said=said, out=done.stdout, err=done.stderr)


def weights(two, name: str) -> list[dict[str, torch.Tensor]]:
    """Of both processes."""
    return [load_file(two.folder / f"{name}-{rank}.safetensors") for rank in (0, 1)]


def test_both_took_part(two):
    assert [one["processes"] for one in two.said] == [2, 2] and [one["main"] for one in two.said] == [True, False]


def test_two_processes_train_as_one_on_the_mean_of_their_losses(two):
    def draw(step: int) -> dict:
        batches = []
        for rank in (0, 1):
            seed_batch(MEAN, step, rank)
            batches.append((a_batch(step), torch.get_rng_state()))  # the state says what the dropout then drops
        return {"batches": batches}

    def mean_loss(net: torch.nn.Module, batch: dict) -> torch.Tensor:
        losses = []
        for x, state in batch["batches"]:
            torch.set_rng_state(state)
            losses.append(a_loss(net, x))
        return torch.stack(losses).mean()

    one, alone = a_net(), a_net()
    run = fit(one, draw, mean_loss, MEAN, title="")
    fit(alone, a_batch, a_loss, MEAN, title="")
    for said, found in zip(two.said, weights(two, "together")):
        assert said["losses"] == pytest.approx(run.losses, rel=1e-4)
        for name, value in one.state_dict().items():
            assert torch.allclose(found[name], value, atol=1e-4), name
        assert not torch.allclose(found["0.weight"], alone.state_dict()["0.weight"], atol=1e-3)


@pytest.mark.parametrize("name", ["together", "broken", "buffers", "game", "style-erd"])
def test_both_end_with_the_same_weights(two, name):
    first, second = weights(two, name)
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_a_run_that_was_broken_off_is_an_unbroken_one(two):
    assert two.said[0]["again"] == two.said[0]["losses"]
    broken, whole = weights(two, "broken")[0], weights(two, "together")[0]
    assert all(torch.equal(broken[name], whole[name]) for name in whole)


def test_a_generator_and_its_critic_train_in_both(two):
    first, second = (one["game"] for one in two.said)
    assert first == second and len(first) == 40
    before = torch.nn.ModuleList(a_pair()).state_dict()
    after = weights(two, "game")[0]
    assert not any(torch.equal(after[name], before[name]) for name in ("0.0.weight", "1.0.weight"))


def test_only_one_shows_and_keeps(two):
    assert [one["shown"] for one in two.said] == [40, 0]
    assert two.said[0]["files"] == ["kept-by-0.run"]
    assert "bar of 0" in two.err and "bar of 1" not in two.err
    assert {path.name for path in two.folder.glob("*.run")} == {"bad.run"}  # a run that is over leaves none


def test_the_process_with_the_bad_batch_names_it(two):
    first, second = (one["message"] for one in two.said)
    assert f"the loss of step {BAD} is nan" in first and f"the loss of step {BAD} is nan" in second
    assert two.said[1]["drawn"] in second and "named by another process" in first
    assert two.said[0]["drawn"] != two.said[1]["drawn"]
    kept = load_file(two.folder / "bad.run")
    assert len(kept["losses"]) == BAD and all(torch.isfinite(value).all() for value in kept.values())


def test_the_command_writes_and_prints_once(two):
    assert [one["code"] for one in two.said] == [0, 0]
    assert [one["there"] for one in two.said] == [one["waited"] for one in two.said] == [True, True]
    assert not (two.folder / "written-by-1").exists()
    path = two.folder / "checkpoints" / "folder-prior.safetensors"
    assert two.out.split() == [str(path)]
    tensors, card = checkpoints.load(path, "prior")
    assert card["steps"] == 2 and card["training_clips"] > 0 and "network.text.weight" in tensors
