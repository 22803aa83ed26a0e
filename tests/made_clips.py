"""Clips that tests make up: noise on a small or a whole skeleton, as items of a dataset."""

from dataclasses import dataclass
from pathlib import Path

import torch

import motionkit as mk
from motionkit.datasets import Dataset, Item, Labels, Recording
from motionkit.datasets.loading import from_items
from motionkit.skeleton import Skeleton, smpl


def chain(joints: int = 2) -> Skeleton:
    """Joints in a row, with no feet among them."""
    offsets = torch.tensor([[0.0, 0.1, 0.0]]).repeat(joints, 1)
    return Skeleton(tuple(f"j{n}" for n in range(joints)), tuple(range(-1, joints - 1)), offsets)


@dataclass(frozen=True)
class Made:
    """A source of noise. log: a file that gets a line whenever the clip is read."""

    seed: int
    frames: int = 5
    joints: int = 2
    fps: float = 30.0
    phase: bool = False
    version: int = 1
    log: str = ""
    fails: type[BaseException] | None = None

    @property
    def state(self) -> str:
        return f"{self.seed} {self.frames} {self.joints} {self.fps} {self.version}"

    def read(self) -> Recording:
        if self.log:
            with Path(self.log).open("a") as file:
                file.write(f"{self.seed}\n")
        if self.fails:
            raise self.fails(f"clip {self.seed}.bvh, line 7: broken on purpose")
        generator = torch.Generator().manual_seed(self.seed + 1000 * self.version)
        skeleton = smpl() if self.joints == 22 else chain(self.joints)
        turns = torch.nn.functional.normalize(torch.randn(self.frames, self.joints, 4, generator=generator), dim=-1)
        path = torch.randn(self.frames, 3, generator=generator)
        tracks = {"phase": torch.rand(self.frames, 1, generator=generator)} if self.phase else {}
        return Recording(mk.Motion.from_root(skeleton, turns, path, self.fps), tracks)


def grid(contents: int, styles: int, takes: int, performers: int = 4) -> list[Labels]:
    """Labels of so many takes of each content in each style, by performers in turn."""
    return [
        Labels(f"c{c}", f"s{s}", (f"a person does c{c}",), f"p{t % performers}", f"take {c} {s} {t}")
        for c in range(contents)
        for s in range(styles)
        for t in range(takes)
    ]


def made(labels: list[Labels], **more) -> Dataset:
    """A dataset of short clips with these labels, called clip_000 and so on."""
    return from_items("made", [Item(f"clip_{n:03d}", label, Made(n, **more)) for n, label in enumerate(labels)])


def lengths(frames: list[int], **more) -> Dataset:
    """A dataset of clips of these lengths; three styles in turn."""
    labels = [Labels("walk", ("old", "proud", "sad")[n % 3], (f"clip {n}",)) for n in range(len(frames))]
    return from_items(
        "made", [Item(f"clip_{n:03d}", labels[n], Made(n, frames=f, **more)) for n, f in enumerate(frames)]
    )
