"""Measure the performer: feet, bones, joints, likeness to captures, distinctness and speed, into results/actor.json.

make bench-actor        (likeness needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)
"""

import sys
import tempfile
import time
from pathlib import Path

import torch

import motionkit as mk
from bench import ROOT, captures, figure, run_python, write_result
from bench_corpus import corpus_speed
from motionkit import actor
from motionkit.actor.bodies import HEEL
from motionkit.datasets.captures import SMPL_NAMES
from motionkit.metrics import bands, speed_bands, within_spread
from probes import Frames, frame_accuracy, window_accuracy

RESULT = ROOT / "results" / "actor.json"
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
TIMING = (("proud", "strutting"), ("depressed", "tired"))
PER_KIND, BANDAI_TALL = 120, 1.63  # metres; leg and height of Bandai-2's actors


def soles(motion: mk.Motion, height: float) -> torch.Tensor:
    """Height of heels and toe tips, [F, 4] metres; `height` of the performer."""
    world, places = motion.world_rotations(), motion.positions()
    found = []
    for side in ("left", "right"):
        for joint, offset in (("ankle", (0, -0.039, -HEEL)), ("foot", (0, -0.012, 0.046))):
            j = motion.skeleton.index(f"{side}_{joint}")
            arm = torch.tensor(offset, dtype=world.dtype).expand(len(motion), 3) * height
            found.append((places[:, j] + mk.rotations.quaternion_rotate(world[:, j], arm))[:, 1])
    return torch.stack(found, 1)


def bend(motion: mk.Motion, joints: tuple[str, str, str]) -> torch.Tensor:
    """Degrees between the bones that meet in the middle one of three joints, 0 in line, [F]."""
    a, b, c = (motion.positions()[:, motion.skeleton.index(j)] for j in joints)
    return torch.rad2deg(torch.acos(torch.cosine_similarity(b - a, c - b, dim=-1).clamp(-1, 1)))


def top_acceleration(motion: mk.Motion) -> float:
    """The largest of any joint in any frame, m/s^2."""
    places = motion.positions().double()
    return float((places[2:] - 2 * places[1:-1] + places[:-2]).norm(dim=-1).max()) * motion.fps**2


def quality(ds: mk.datasets.Dataset) -> dict:
    """Feet, bones and joints of every clip of a data set."""
    slide, deep, bones, beyond, frames = [], [], 0.0, 0, 0
    for clip in ds:
        motion = clip.motion
        slide.append(mk.contacts.foot_sliding(motion, clip.contacts))
        height = actor.Performer.from_seed(int(clip.performer.split()[-1])).height
        deep.append(-1000 * float(soles(motion, height).min()))
        places, parents = motion.positions(), list(motion.skeleton.parents[1:])
        lengths = (places[:, 1:] - places[:, parents]).norm(dim=-1)
        bones = max(bones, float((lengths - motion.skeleton.offsets[1:].norm(dim=-1)).abs().max()) * 1000)
        for (a, b, c), most in LIMITS.items():
            for side in ("left", "right"):
                beyond += int((bend(motion, (f"{side}_{a}", f"{side}_{b}", f"{side}_{c}")) > most).sum())
        frames += len(motion)
    note = f"largest of {len(ds)} clips, {frames:,} frames"
    limits = ", ".join(f"{b} {most}" for (_, b, _), most in LIMITS.items())
    return {
        "foot_sliding_mm": figure(max(slide), 1, "mm/frame", note + ", mean over standing feet", False),
        "penetration_mm": figure(max(deep), 5, "mm", note + ", heels and toe tips below the ground", False),
        "bone_error_mm": figure(bones, 0.01, "mm", note, False),
        "frames_beyond_limits": figure(
            beyond, 0, "frames", f"at most {limits} degrees of bend; knees are hinges", False
        ),
    }


def pops(ds: mk.datasets.Dataset, captured: mk.datasets.Dataset) -> tuple[dict, list[dict]]:
    """Largest joint acceleration beside that of captured clips of the same kind."""
    rows = []
    for content, kinds in KINDS.items():
        theirs = captured.filter(content=kinds)
        theirs = [top_acceleration(theirs[n].motion) for n in range(0, len(theirs), max(1, len(theirs) // PER_KIND))]
        ours = [top_acceleration(clip.motion) for clip in ds.filter(content=content)]
        ratio = max(ours) / max(theirs)
        row = {"content": content, "ours": max(ours), "captured": max(theirs), "ratio": ratio}
        rows.append({k: v if isinstance(v, str) else float(f"{v:.3g}") for k, v in row.items()})
    worst = max(rows, key=lambda r: r["ratio"])
    note = f"largest joint acceleration, ours by captured, worst of {len(rows)} contents: {worst['content']}"
    return {"acceleration_ratio": figure(worst["ratio"], 1.5, "times", note, False)}, rows


def likeness(captured: mk.datasets.Dataset) -> tuple[dict, list[dict]]:
    """Share of joints whose speed, by frequency, lies within the spread of captured normal walks and runs."""
    figures, rows = {}, []
    person = actor.Performer(height=BANDAI_TALL)
    for content in ("walk", "run"):
        clips = [c.motion for c in captured.filter(content=content, style="normal") if len(c) >= 60]
        theirs = torch.stack([speed_bands(m, list(SMPL_NAMES)) for m in clips])
        made = [actor.perform(content, seed=n, seconds=5, performer=person).motion for n in range(20)]
        ours = torch.stack([speed_bands(m, list(SMPL_NAMES.values())) for m in made]).median(0).values
        inside = within_spread(ours, theirs)
        heights = [
            torch.stack([bands(m.positions()[:, j, 1], m.fps) for m in ms])[:, 1:] for ms, j in ((clips, 1), (made, 0))
        ]
        level = within_spread(heights[1].median(0).values, heights[0])
        good = 100 * float((inside.sum(1) >= inside.shape[1] - 1).float().mean())
        numbers = 100 * float(inside.float().mean())
        note = (
            "joints with at least 4 of 5 numbers (mean speed and its swings in 4 bands from 0.3 to 10 Hz) where 95 % "
            f"of {len(clips)} captured clips are; median of 20 made clips; of all numbers {numbers:.0f} %, of the "
            f"pelvis' height {int(level.sum())} of {len(level)} bands"
        )
        figures[f"like_{content}"] = figure(good, 80, "%", note)
        for name, row, low in zip(SMPL_NAMES.values(), ours, inside):
            rows.append(
                {"content": content, "joint": name, "inside": int(low.sum()), "mean_speed": round(float(row[0]), 3)}
            )
    return figures, rows


def distinct(ds: mk.datasets.Dataset) -> dict:
    """How well small networks name content and style of people they have never seen, and what single frames tell."""
    parts = ds.split()
    names = {"content": ds.contents, "style": ds.styles}
    learn, test = Frames(parts.train, names), Frames(parts.test, names)
    figures = {}
    for label, least in (("style", 97), ("content", 98)):
        clips, windows = window_accuracy(learn, test, label, len(names[label]))
        note = f"of {len(parts.test)} clips of unseen people, three temporal convolutions; of windows {windows:.1f} %"
        figures[f"{label}_accuracy"] = figure(clips, least, "%", note)
    for pair in TIMING:
        rate = frame_accuracy(learn, test, "style", tuple(ds.styles.index(s) for s in pair))
        note = "a network's share of right answers from single frames of unseen performers; chance is 50"
        figures[f"single_frame_{'_'.join(pair)}"] = figure(rate, 60, "%", note, False)
    return figures


def speed(folder: Path) -> dict:
    """Making clips on one core, the whole data set on all, and reading a corpus."""
    torch.set_num_threads(1)
    wishes = [(c, s) for c in actor.CONTENTS for s in actor.TRAIN_STYLES]
    best = 0.0
    for _ in range(3):
        start = time.perf_counter()
        frames = sum(len(actor.perform(c, s, seed=n, seconds=8)) for n, (c, s) in enumerate(wishes))
        best = max(best, frames / (time.perf_counter() - start))
    (seconds, clips, total), peak = run_python(MAKE, cache=folder / "cache")
    figures = {
        "making_frames_per_s": figure(best, 3000, "frames/s", f"{len(wishes)} clips, one thread"),
        "dataset_seconds": figure(
            seconds, 90, "s", f"{clips:.0f} clips, {total:.0f} frames, joblib, to the cache", False
        ),
    }
    if peak:
        figures["dataset_peak_gb"] = figure(
            peak, 1, "GB", "all processes together, shared pages counted for each", False
        )
    read = corpus_speed(folder / "corpus")
    grew = f"private memory grew {read['memory_growth_mb']:.1f} MB"
    note = f"64 windows of 64 frames x 22 joints from {read['frames']:,.0f} frames; {grew}"
    figures["corpus_batches_per_s"] = figure(read["batches_per_s"], 200, "batches/s", note)
    return figures


def main() -> int:
    """Measure everything and write results/actor.json."""
    start = time.perf_counter()
    captured = captures()
    with tempfile.TemporaryDirectory() as folder:
        figures = speed(Path(folder))
    torch.set_num_threads(2)
    ds = mk.datasets.load("actor")
    figures |= quality(ds)
    ratio, accelerations = pops(ds, captured)
    like, joints = likeness(captured)
    figures |= {**ratio, **like, **distinct(ds)}
    write_result(RESULT, "make bench-actor", start, figures, {"acceleration": accelerations, "likeness": joints})
    return 0


if __name__ == "__main__":
    sys.exit(main())
