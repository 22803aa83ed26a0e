"""Write down what every method and layout answers today, so that a move of code can be seen to change nothing.

    python tools/make_golden.py        (after a change that is meant to change answers; say in the commit what moved)

tests/golden.safetensors gets rotations and root of each method's answer to three clips, one of them captured, and each
layout's numbers of the same clips, every tenth frame; its metadata say on which kind of machine.
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from pathlib import Path

import torch
from safetensors.torch import save
from torch import Tensor

import motionkit as mk
from motionkit.files import write_atomic

ROOT = Path(__file__).resolve().parent.parent
TARGET = ROOT / "tests" / "golden.safetensors"
CLIPS = ("walk_neutral", "kick_angry")  # of data/actor
CAPTURE = "walk_normal_001"  # of bandai-2, where it is at hand
METHODS = ("copy-content", "copy-style", "knn-dtw", "linear", "statistics")
STEP = 10


def machine() -> str:
    """Where the same code gives the same last digits."""
    return f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()} torch {torch.__version__.split('+')[0]}"


def clips() -> dict[str, mk.Motion]:
    """The contents by name."""
    found = {name: mk.load(ROOT / "data" / "actor" / f"{name}.bvh")[:90] for name in CLIPS}
    folder = Path(os.environ.get("MOTIONKIT_DATA") or ROOT.parent / "shared" / "datasets")
    if any(folder.glob("*.zip")):
        data = mk.datasets.load("bandai-2", folder)
        found["captured"] = next(clip for clip in data if clip.name.endswith(CAPTURE)).motion[:90]
    return found


def answers() -> Iterator[tuple[str, Tensor]]:
    """All that is compared, by names such as `statistics walk_neutral rotations`."""
    contents = clips()
    old = mk.load(ROOT / "data" / "actor" / "walk_old.bvh")
    for method in METHODS:
        restyle = mk.methods.load(method)
        for name, content in contents.items():
            yield from numbers(f"{method} {name}", restyle.stylize(content, style=old))
    codes, erd = mk.methods.load("style-code"), mk.methods.load("style-erd")
    told = mk.methods.Labels(texts=("a person walks",))
    learned = codes.learn(old, "an old person walks", title="")
    paper = mk.methods.load("few-shot", config=mk.methods.few_shot.Config.laptop().changed(steps=2))
    adapted = paper.learn(old, "an old person walks", title="")
    walk = erd.onto_model(contents["walk_neutral"])
    stream = erd.stream(style="old")
    yield from numbers("style-erd stream", mk.concatenate([stream(walk[n : n + 1]) for n in range(60)]))
    for name, content in contents.items():
        yield from numbers(f"style-code {name}", codes.stylize(content, learned, labels=told))
        yield from numbers(f"few-shot {name}", paper.stylize(content, adapted, labels=told))
        yield from numbers(f"style-erd {name}", erd.stylize(content, style="old"))
        for layout in ("FacingFree", "HumanML3D", "StyleERD", "Graph", "SixD"):
            body = content.without_helper_joints() if layout != "SixD" else content
            yield f"{layout} {name}", getattr(mk.features, layout)(body.skeleton, body.fps).encode(body)[::STEP]


def numbers(name: str, motion: mk.Motion) -> Iterator[tuple[str, Tensor]]:
    """Rotations and root of a motion."""
    yield f"{name} rotations", motion.rotations[::STEP]
    yield f"{name} root", motion.translations[::STEP, 0]


def main() -> int:
    """Write the file."""
    torch.set_num_threads(1)
    found = {name: value.detach().float().contiguous() for name, value in answers()}
    write_atomic(TARGET, save(found, {"machine": machine(), "command": "python tools/make_golden.py"}))
    print(f"{TARGET.name}: {len(found)} answers, {TARGET.stat().st_size // 1024} KB, on {machine()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
