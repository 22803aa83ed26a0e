"""The performer: feet, bones, joints, likeness to captures, distinctness and speed: `make bench NAME=actor`.

Likeness and acceleration need the captures. How distinct labelled motion is, small classifiers tell: from windows of
poses, and from a single frame.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import torch
from torch import Tensor, nn

import motionkit as mk

from .. import actor
from ..actor.bodies import HEEL
from ..datasets.captures import SMPL_NAMES
from ..metrics import bands, speed_bands, within_spread
from . import captures, figure, run_python, table, threads
from .corpus import corpus_speed

MAKE = """
import sys, time, motionkit as mk
if __name__ == "__main__":
    t = time.perf_counter()
    ds = mk.datasets.load("actor")
    print(time.perf_counter() - t, len(ds), sum(len(clip) for clip in ds))
"""
# contents of the performer, and Bandai-2's of the same kind
KINDS = {
    "walk": ("walk",),
    "walk_turn_left": ("walk-turn-left",),
    "walk_turn_right": ("walk-turn-right",),
    "run": ("run",),
    "wave": ("wave-left-hand", "wave-right-hand"),
    "raise_hands": ("raise-up-both-hands",),
}
LIMITS = {  # joint in the middle of two bones, and by how many degrees it bends at the most
    ("hip", "knee", "ankle"): 155,
    ("shoulder", "elbow", "wrist"): 150,
}
TIMING = (("proud", "strutting"), ("depressed", "tired"))  # styles of one pose, which only their timing tells apart
PER_KIND, BANDAI_TALL = 120, 1.63  # metres; leg and height of Bandai-2's actors
WINDOW, STRIDE = 64, 16  # frames that a classifier sees at once


@figure("making_frames_per_s", at_least=3000, unit="frames/s")
@threads(1)
def making() -> tuple[float, str]:
    """Clips of every content in every style, one thread: frames a second, the best of three runs."""
    wishes = [(content, style) for content in actor.CONTENTS for style in actor.TRAIN_STYLES]
    best = 0.0
    for _ in range(3):
        start = time.perf_counter()
        frames = sum(len(actor.perform(c, s, seed=n, seconds=8)) for n, (c, s) in enumerate(wishes))
        best = max(best, frames / (time.perf_counter() - start))
    return best, f"{len(wishes)} clips, one thread"


@figure("dataset_seconds", at_most=90, unit="s")
@figure("dataset_peak_gb", at_most=1, unit="GB", note="all processes together, shared pages counted for each")
def making_the_dataset() -> dict:
    """The whole data set, on all cores."""
    with tempfile.TemporaryDirectory() as folder:
        (seconds, clips, frames), peak = run_python(MAKE, cache_at=Path(folder))
    note = f"{clips:.0f} clips, {frames:.0f} frames, joblib, to the cache"
    return {"dataset_seconds": (seconds, note)} | ({"dataset_peak_gb": peak} if peak else {})


@figure("corpus_batches_per_s", at_least=200, unit="batches/s")
@threads(1)
def reading_a_corpus() -> tuple[float, str]:
    """Batches of windows from a million frames on disk."""
    with tempfile.TemporaryDirectory() as folder:
        speed = corpus_speed(folder)
    grew = f"private memory grew {speed['memory_growth_mb']:.1f} MB"
    return speed["batches_per_s"], f"64 windows of 64 frames x 22 joints from {speed['frames']:,.0f} frames; {grew}"


def soles(motion: mk.Motion, height: float) -> Tensor:
    """Height of heels and toe tips, [F, 4] metres; `height` of the performer."""
    world, positions = motion.world_rotations(), motion.positions()
    heights = []
    for side in ("left", "right"):
        for joint, offset in (("ankle", (0, -0.039, -HEEL)), ("foot", (0, -0.012, 0.046))):
            j = motion.skeleton.index(f"{side}_{joint}")
            arm = torch.tensor(offset, dtype=world.dtype).expand(len(motion), 3) * height
            heights.append((positions[:, j] + mk.rotations.quaternion_rotate(world[:, j], arm))[:, 1])
    return torch.stack(heights, 1)


def bend(motion: mk.Motion, joints: tuple[str, str, str]) -> Tensor:
    """Degrees between the bones that meet in the middle one of three joints, 0 in line, [F]."""
    a, b, c = (motion.positions()[:, motion.skeleton.index(j)] for j in joints)
    return torch.rad2deg(torch.acos(torch.cosine_similarity(b - a, c - b, dim=-1).clamp(-1, 1)))


@figure("foot_sliding_mm", at_most=1, unit="mm/frame")
@figure("penetration_mm", at_most=5, unit="mm")
@figure("bone_error_mm", at_most=0.01, unit="mm")
@figure("frames_beyond_limits", at_most=0, unit="frames")
def quality() -> dict:
    """Feet, bones and joints of every clip of the data set."""
    clips = mk.datasets.load("actor")
    slide, depth, bones, beyond, frames = [], [], 0.0, 0, 0
    for clip in clips:
        motion = clip.motion
        slide.append(mk.contacts.foot_sliding(motion, clip.contacts))
        height = actor.Performer.from_seed(int(clip.performer.split()[-1])).height
        depth.append(-1000 * float(soles(motion, height).min()))
        positions, parents = motion.positions(), list(motion.skeleton.parents[1:])
        lengths = (positions[:, 1:] - positions[:, parents]).norm(dim=-1)
        bones = max(bones, float((lengths - motion.skeleton.offsets[1:].norm(dim=-1)).abs().max()) * 1000)
        for (a, b, c), most in LIMITS.items():
            for side in ("left", "right"):
                beyond += int((bend(motion, (f"{side}_{a}", f"{side}_{b}", f"{side}_{c}")) > most).sum())
        frames += len(motion)
    note = f"largest of {len(clips)} clips, {frames:,} frames"
    limits = ", ".join(f"{b} {most}" for (_, b, _), most in LIMITS.items())
    return {
        "foot_sliding_mm": (max(slide), f"{note}, mean over planted feet"),
        "penetration_mm": (max(depth), f"{note}, heels and toe tips below the ground"),
        "bone_error_mm": (bones, note),
        "frames_beyond_limits": (beyond, f"at most {limits} degrees of bend; knees are hinges"),
    }


def top_acceleration(motion: mk.Motion) -> float:
    """The largest of any joint in any frame, m/s^2."""
    positions = motion.positions().double()
    return float((positions[2:] - 2 * positions[1:-1] + positions[:-2]).norm(dim=-1).max()) * motion.fps**2


@table("acceleration", method="actor", dataset="bandai-2")
@figure("acceleration_ratio", at_most=1.5, unit="times")
def accelerations() -> dict:
    """Largest joint acceleration beside that of captured clips of the same kind."""
    performed, rows = mk.datasets.load("actor"), []
    for content, kinds in KINDS.items():
        captured = captures().filter(content=kinds)
        step = max(1, len(captured) // PER_KIND)
        theirs = max(top_acceleration(captured[n].motion) for n in range(0, len(captured), step))
        ours = max(top_acceleration(clip.motion) for clip in performed.filter(content=content))
        numbers = {"ours": ours, "captured": theirs, "ratio": ours / theirs}
        rows.append({"content": content} | {name: float(f"{value:.3g}") for name, value in numbers.items()})
    worst = max(rows, key=lambda row: row["ratio"])
    note = f"largest joint acceleration, ours by captured, worst of {len(rows)} contents: {worst['content']}"
    return {"acceleration": rows, "acceleration_ratio": (worst["ratio"], note)}


@figure("like_walk", at_least=80, unit="%")
@figure("like_run", at_least=80, unit="%")
@table("likeness", method="actor", dataset="bandai-2")
def likeness() -> dict:
    """Share of joints whose speed, by frequency, lies within the spread of captured normal walks and runs; by joint."""
    figures, rows = {}, []
    person = actor.Performer(height=BANDAI_TALL)
    for content in ("walk", "run"):
        captured = [c.motion for c in captures().filter(content=content, style="normal") if len(c) >= 60]
        performed = [actor.perform(content, seed=n, seconds=5, performer=person).motion for n in range(20)]
        theirs = torch.stack([speed_bands(motion, list(SMPL_NAMES)) for motion in captured])
        ours = torch.stack([speed_bands(motion, list(SMPL_NAMES.values())) for motion in performed]).median(0).values
        inside = within_spread(ours, theirs)
        captured_heights, heights = (
            torch.stack([bands(m.positions()[:, pelvis, 1], m.fps) for m in motions])[:, 1:]
            for motions, pelvis in ((captured, 1), (performed, 0))
        )
        level = within_spread(heights.median(0).values, captured_heights)
        alike = 100 * float((inside.sum(1) >= inside.shape[1] - 1).float().mean())
        numbers = 100 * float(inside.float().mean())
        note = (
            "joints with at least 4 of 5 numbers (mean speed and its swings in 4 bands from 0.3 to 10 Hz) where 95 % "
            f"of {len(captured)} captured clips are; median of 20 made clips; of all numbers {numbers:.0f} %, of the "
            f"pelvis' height {int(level.sum())} of {len(level)} bands"
        )
        figures[f"like_{content}"] = alike, note
        for joint, speeds, within in zip(SMPL_NAMES.values(), ours, inside):
            mean_speed = round(float(speeds[0]), 3)
            rows.append({"content": content, "joint": joint, "inside": int(within.sum()), "mean_speed": mean_speed})
    return figures | {"likeness": rows}


@figure("style_accuracy", at_least=97, unit="%")
@figure("content_accuracy", at_least=98, unit="%")
def window_accuracies() -> dict:
    """How well small networks name content and style of people they have never seen."""
    figures, (train, test, names) = {}, classifier_frames()
    for label in ("style", "content"):
        clips, windows = window_accuracy(train, test, label, len(names[label]))
        note = f"of {len(test.starts) - 1} clips of unseen people, three temporal convolutions"
        figures[f"{label}_accuracy"] = clips, f"{note}; of windows {windows:.1f} %"
    return figures


@figure("single_frame_proud_strutting", at_most=60, unit="%")
@figure("single_frame_depressed_tired", at_most=60, unit="%")
def frame_accuracies() -> dict:
    """What single frames tell of styles that differ in timing: little above chance, if they are well made."""
    figures, (train, test, names) = {}, classifier_frames()
    for pair in TIMING:
        rate = frame_accuracy(train, test, "style", tuple(names["style"].index(style) for style in pair))
        note = "a network's share of right answers from single frames of unseen performers; chance is 50"
        figures[f"single_frame_{'_'.join(pair)}"] = rate, note
    return figures


class Frames:
    """Encoded clips with their labels. values: [N, D] all frames; starts: where each clip begins, [C + 1]."""

    def __init__(self, clips: Sequence, names: dict[str, tuple[str, ...]]) -> None:
        encoded = [poses(clip.motion) for clip in clips]
        self.values = torch.cat(encoded)
        self.starts = torch.tensor([0, *(len(e) for e in encoded)]).cumsum(0)
        self.labels = {k: torch.tensor([v.index(getattr(c, k)) for c in clips]) for k, v in names.items()}

    def windows(self) -> tuple[Tensor, Tensor]:
        """First frames of all windows, and the clip that each is from."""
        starts = [
            (start, clip)
            for clip, (a, b) in enumerate(zip(self.starts[:-1].tolist(), self.starts[1:].tolist()))
            for start in range(a, b - WINDOW + 1, STRIDE)
        ]
        return tuple(torch.tensor(column) for column in zip(*starts))


@cache
def classifier_frames() -> tuple[Frames, Frames, dict[str, tuple[str, ...]]]:
    """Training and test part as frames, and the names of the labels."""
    clips = mk.datasets.load("actor")
    names, split = {"content": clips.contents, "style": clips.styles}, clips.split()
    return Frames(split.train, names), Frames(split.test, names), names


def poses(motion: mk.Motion) -> Tensor:
    """Facing-free numbers of each frame: the root's movement, where the joints are, and how they move, [F, D].

    D = 4 + 6 (J - 1); single frames are classified without the movement.
    """
    layout = mk.features.FacingFree(motion.skeleton, motion.fps)
    encoded = layout.encode(motion)[:, : layout.slices["positions"].stop]
    velocities = nn.functional.pad(encoded[1:] - encoded[:-1], (0, 0, 1, 0))[:, layout.slices["positions"]]
    return torch.cat((encoded, velocities), 1)


def network(numbers: int, classes: int) -> nn.Module:
    """Three temporal convolutions and a mean over time."""
    sizes = (numbers, 96, 128, 128)
    layers = [part for a, b in zip(sizes, sizes[1:]) for part in (nn.Conv1d(a, b, 5, 2, 2), nn.ReLU(), nn.Dropout(0.1))]
    return nn.Sequential(*layers, nn.AdaptiveAvgPool1d(1), nn.Flatten(), nn.Linear(sizes[-1], classes))


def train_classifier(model: nn.Module, batch, count: int, epochs: int, size: int = 128) -> None:
    """Adam with a falling rate; batch(numbers) gives inputs and labels of some of `count` examples."""
    steps = epochs * (count // size)
    optimizer = torch.optim.AdamW(model.parameters(), 2e-3, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps)
    generator = torch.Generator().manual_seed(0)
    for _ in range(steps):
        x, y = batch(torch.randint(count, (size,), generator=generator))
        optimizer.zero_grad()
        nn.functional.cross_entropy(model(x), y).backward()
        optimizer.step()
        schedule.step()
    model.eval()


def window_accuracy(train: Frames, test: Frames, label: str, classes: int, epochs: int = 12) -> tuple[float, float]:
    """Per cent of unseen clips, and of their windows, whose label a network names that learned from other clips."""
    torch.manual_seed(0)
    mean, std = train.values.mean(0), train.values.std(0).clamp(min=1e-4)
    span = torch.arange(WINDOW)
    starts, clips = train.windows()
    values, names = (train.values - mean) / std, train.labels[label]
    model = network(values.shape[1], classes)
    train_classifier(model, lambda n: (values[starts[n][:, None] + span].mT, names[clips[n]]), len(starts), epochs)
    test_starts, test_clips = test.windows()
    test_values, test_names = (test.values - mean) / std, test.labels[label]
    with torch.no_grad():
        scores = [model(test_values[s[:, None] + span].mT) for s in test_starts.split(512)]
    scores = torch.cat(scores).log_softmax(1)
    summed = torch.zeros(len(test_names), classes).index_add_(0, test_clips, scores)
    long_enough = torch.unique(test_clips)
    right = (summed[long_enough].argmax(1) == test_names[long_enough]).float().mean()
    return 100 * float(right), 100 * float((scores.argmax(1) == test_names[test_clips]).float().mean())


def frame_accuracy(train: Frames, test: Frames, label: str, pair: tuple[int, int], epochs: int = 4) -> float:
    """Per cent of single frames of unseen clips that a network tells apart: two labels, poses alone, no movement."""
    torch.manual_seed(0)
    sets = []
    for part in (train, test):
        clip = torch.repeat_interleave(torch.arange(len(part.starts) - 1), part.starts[1:] - part.starts[:-1])
        names = part.labels[label][clip]
        chosen = (names == pair[0]) | (names == pair[1])
        still = slice(3, (part.values.shape[1] + 4) // 2)  # the root's height, and where the joints are
        sets.append((part.values[chosen][:, still], (names[chosen] == pair[1]).long()))
    (x, y), (test_x, test_y) = sets
    mean, std = x.mean(0), x.std(0).clamp(min=1e-4)
    x, test_x = (x - mean) / std, (test_x - mean) / std
    model = nn.Sequential(nn.Linear(x.shape[1], 128), nn.ReLU(), nn.Dropout(0.2), nn.Linear(128, 2))
    train_classifier(model, lambda n: (x[n], y[n]), len(x), epochs)
    with torch.no_grad():
        answers = model(test_x).argmax(1)
    # both labels count alike, however many frames each has
    return 50 * sum(float((answers[test_y == k] == k).float().mean()) for k in (0, 1))
