"""What two processes do together, for test_training_processes.py: run by `accelerate launch`, with FOLDER and CLIPS."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import torch
from accelerate import PartialState
from safetensors.torch import save_file
from test_training import GAME, LOSSES, MEAN, a_batch, a_loss, a_net, a_net_with_buffers, a_pair, real_points

import motionkit as mk
from motionkit.__main__ import main
from motionkit.methods import style_erd
from motionkit.methods.style_erd_data import Windows
from motionkit.training import TrainConfig, fit, fit_adversarial, is_main, main_process_first

BAD = 3  # the step whose batch holds a NaN, in the second process


def together(folder: Path, rank: int, said: dict) -> None:
    """A run from beginning to end, shown and kept by one of the two."""
    net, shown = a_net(), []
    config = replace(MEAN, save_every=0.0)
    run = fit(net, a_batch, a_loss, config, resume=folder / f"kept-by-{rank}.run", title=f"bar of {rank}",
              callback=lambda *_: shown.append(sorted(path.name for path in folder.glob("kept-by-*"))))  # fmt: skip
    said.update(losses=run.losses, shown=len(shown), files=shown[-1] if shown else [])
    save_file(net.state_dict(), folder / f"together-{rank}.safetensors")


def broken_off(folder: Path, rank: int, said: dict) -> None:
    """The same run, which is stopped in both processes and goes on; and one with buffers."""
    net = a_net()

    def stopped(step: int) -> torch.Tensor:
        if step == 10:
            raise KeyboardInterrupt
        return a_batch(step)

    try:
        fit(net, stopped, a_loss, MEAN, resume=folder / "broken.run", title="")
    except KeyboardInterrupt:
        PartialState().wait_for_everyone()
    net = a_net()
    said.update(again=fit(net, a_batch, a_loss, MEAN, resume=folder / "broken.run", title="").losses)
    save_file(net.state_dict(), folder / f"broken-{rank}.safetensors")
    net = a_net_with_buffers()
    fit(net, a_batch, a_loss, MEAN, title="")
    save_file(net.state_dict(), folder / f"buffers-{rank}.safetensors")


def game(folder: Path, rank: int, said: dict) -> None:
    """A generator and its critic."""
    pair = a_pair()
    said.update(game=fit_adversarial(pair, real_points, LOSSES, GAME, title="").losses)
    save_file(torch.nn.ModuleList(pair).state_dict(), folder / f"game-{rank}.safetensors")


def style_erd_too(folder: Path, rank: int, said: dict) -> None:
    """Style-ERD, whose losses call methods of the generator; a loss that leaves out weights of some branches."""
    data = mk.datasets.load("folder", root=sys.argv[2])
    contents = style_erd.train_content_classifier(Windows.of(data, 30.0), 22, steps=2, title="")
    config = replace(style_erd.Config.tiny(), steps=3)
    model = style_erd.train_model(data, config, label_steps=0, contents=contents, title="")
    save_file(model.network.state_dict(), folder / f"style-erd-{rank}.safetensors")


def bad(folder: Path, rank: int, said: dict) -> None:
    """A NaN in the second process only."""

    def draw(step: int) -> dict:
        name = f"clip {int(torch.randint(10**6, ()))}"
        if step == BAD:
            said.update(drawn=name)
        return {"x": a_batch(step) * (torch.nan if step == BAD and rank == 1 else 1), "names": [name]}

    def loss_fn(model: torch.nn.Module, batch: dict) -> torch.Tensor:
        return a_loss(model, batch["x"])

    try:
        fit(a_net(), draw, loss_fn, TrainConfig(9), resume=folder / "bad.run", title="")
    except mk.MotionKitError as error:
        said.update(message=str(error))


if __name__ == "__main__":
    folder, clips = map(Path, sys.argv[1:3])
    said = {"main": is_main(), "processes": PartialState().num_processes}
    rank = PartialState().process_index
    for part in (together, broken_off, game, style_erd_too, bad):
        part(folder, rank, said)
        PartialState().wait_for_everyone()
    main_process_first(lambda: (folder / f"written-by-{rank}").touch())
    said.update(waited=(folder / "written-by-0").exists())
    said.update(
        code=main(["train", "prior", "--data", "folder", "--root", str(clips), "--config", "tiny", "--steps", "2"])
    )
    said.update(there=(folder / "checkpoints" / "folder-prior.json").exists())
    (folder / f"said-{rank}.json").write_text(json.dumps(said))
    PartialState().destroy_process_group()
