"""Paper 2's Style-ERD: speed, switches, quality, the rows of table 1, captures: `make bench NAME=style_erd`.

The shipped models are measured, that of Bandai-2 on captures; the rows of table 1, and two with the kit's additions,
are trained anew, all alike and shorter, two at a time, and kept in the cache, so a run that is broken off goes on where
it was. Times are taken first, on one thread.
"""

from __future__ import annotations

import copy
import hashlib
from dataclasses import replace
from functools import cache
from itertools import cycle

import numpy as np
import torch
from joblib import Parallel, delayed

import motionkit as mk

from ..actor import perform, retell
from ..arena import Protocol
from ..arena.transfers import error_against
from ..checkpoints import data_hash
from ..datasets import Labels
from ..features.style_erd import frames_of, split
from ..files import cache_folder
from ..methods.style_erd import ABLATIONS, ErdModel, StyleErdTransfer, train_model
from . import BASELINES, captures, compare, figure, median_seconds, table, threads

ROW_STEPS = 1500  # of every row of table 1; the shipped model has more
COLUMNS = ("fmd", "fmd_ae", "cra", "sra", "truth_error", "fsf", "fca", "jitter", "seconds")
ABOUT = "Neutral clips of each content in every other style"
BESIDE = Protocol("beside baselines", "neutral to styled", columns=COLUMNS, about=f"{ABOUT}, of every style clip.")
TABLE_1 = Protocol(  # of a style clip these methods take the label alone, so one of each style is enough
    "table 1", "neutral to styled", samples=3, examples=1, columns=COLUMNS, about=f"{ABOUT}, of one style clip each."
)
CAPTURES = Protocol(
    "captures",
    "neutral to styled",
    samples=0,
    examples=1,
    columns=tuple(column for column in COLUMNS if column != "truth_error"),
    about="Every normal clip in every style.",
)


@cache
def shipped() -> ErdModel:
    """The model that is measured."""
    return mk.methods.load("style-erd").model


@figure("network_ms", at_most=0.2, unit="ms", note="a frame, one stream")
@figure("whole_ms", at_most=0.4, unit="ms", note="a frame, kinematics of both bodies with it")
@figure("frames_per_s", at_least=30_000, note="64 streams at once, kinematics with them")
@figure("late_over_early_ratio", at_most=1.1, note="a frame after 20,000 others over one of the first 700")
@figure("off_from_eager_ratio", at_most=1e-5, note="largest difference from torch's answers over 10 s")
@threads(1)
@torch.inference_mode()
def speed() -> dict:
    """A frame without and with kinematics, many streams at once, a long stream, agreement with the torch forward."""
    model = shipped()
    walk = perform("walk", "neutral", seed=1, seconds=10.0, fps=model.fps).motion
    x, labels = frames_of(walk).x.numpy(), (np.array([model.label_id("content", "walk")]), np.array([0]))
    weights = model.style_weights("old")[None]

    def network():
        """A call that takes the next frame through the NumPy twin."""
        state, frames = model.step.initial_states(labels[0]), cycle(x)

        def step() -> np.ndarray:
            nonlocal state
            y, state = model.step.step(next(frames)[None], *labels, weights, state)
            return y[0]

        return step

    def streams(count: int):
        """A call that takes the next frame through so many streams at once."""
        stream = StyleErdTransfer(model).stream("old", content="walk", own_style="neutral", count=count)
        frames = cycle(zip(*(x.numpy()[:, None].repeat(count, 1) for x in (walk.rotations, walk.translations))))
        return lambda: stream.push(*next(frames))

    step = network()
    stepped = torch.from_numpy(np.stack([step() for _ in x]))
    eager = model.network(torch.from_numpy(x)[None], *map(torch.from_numpy, (*labels, weights)))[0][0]
    seconds, step = median_seconds(network(), 3000, warm=200), network()
    early, late = (median_seconds(step, 500, warm=warm) for warm in (200, 20_000))
    return {
        "network_ms": 1000 * seconds,
        "whole_ms": 1000 * median_seconds(streams(1), 2000, warm=200),
        "frames_per_s": 64 / median_seconds(streams(64), 300, warm=200),
        "late_over_early_ratio": late / early,
        "off_from_eager_ratio": max(float((a - b).abs().max()) for a, b in zip(split(stepped), split(eager))),
    }


@figure("first_frame_error_ratio", at_most=1.5, note="error of the first frame over that of the 61st")
@table("figure_5", method="style-erd", dataset="actor")
@torch.inference_mode()
def figure_5() -> dict:
    """How far the first frames are from the performer's own, over all contents and styles: states learned, and zero."""
    model, frames, errors = shipped(), (*range(10), 60), {"learned": [], "zero": []}
    zeroed = replace(model, network=copy.deepcopy(model.network))
    for branch in (zeroed.network.neutral, zeroed.network.residual):
        branch.hidden.zero_()
        branch.cell.zero_()
    for k, content in enumerate(model.contents):
        played = perform(content, "neutral", seed=700 + k, seconds=4.0, fps=model.fps, performer=46)
        labels = Labels(content, "neutral")
        for style in model.styles[1:]:
            truth = retell(played, style).time_aligned(played)
            for name, one in (("learned", model), ("zero", zeroed)):
                result = StyleErdTransfer(one).stylize(played.motion, style, lock_feet=False, labels=labels)
                errors[name].append([error_against(result[n : n + 1], truth[n : n + 1]) for n in frames])
    learned, zero = (np.mean(errors[name], 0).round(2).tolist() for name in ("learned", "zero"))
    rows = [{"frame": n, "learned": a, "zero": b} for n, a, b in zip(frames, learned, zero)]
    return {"first_frame_error_ratio": learned[0] / learned[-1], "figure_5": rows}


@figure("switch_jerk_ratio", at_most=1, note="90th percentile in a change over that elsewhere")
@torch.inference_mode()
def switch_jerk() -> float:
    """Jerk while one style becomes another, every two seconds, over that in between, where the style stays."""
    model = shipped()
    walk = perform("walk", "neutral", seed=2, seconds=60.0, fps=model.fps).motion
    stream = StyleErdTransfer(model).stream("neutral", content="walk", own_style="neutral")
    draws, switches, positions = np.random.default_rng(0), [], []
    for n, (rotations, translations) in enumerate(zip(walk.rotations.numpy(), walk.translations.numpy())):
        if n and n % 120 == 0:
            stream.style = model.styles[int(draws.integers(len(model.styles)))]
            switches.append(n)
        styled, root = stream.push(rotations[None], translations[None])
        moved = translations.copy()
        moved[0] = root[0]
        positions.append(model.body.places(styled, moved[None])[0])
    jerk = np.linalg.norm(np.diff(np.stack(positions), n=3, axis=0), axis=-1).mean(1)
    changing = np.zeros(len(jerk), bool)
    for n in switches:
        changing[n - 3 : n + round(stream.fade * model.fps)] = True  # each is of four frames
    return float(np.percentile(jerk[changing], 90) / np.percentile(jerk[~changing], 90))


@figure("training_seconds", at_most=5400, unit="s", note="by the card")
def training_seconds() -> float:
    """Seconds that the shipped model took to train."""
    return shipped().card["seconds"]


def over_best(rows: dict[str, dict], *labels: str) -> dict[str, tuple[float, str]]:
    """Style-ERD's figures over those of the best baseline, and which that is."""
    figures, ours = {}, rows["style-erd"]
    for label in labels:
        better, ends = (max, "share") if label in ("cra", "sra") else (min, "ratio")
        best = better((rows[name] for name in BASELINES), key=lambda row: row[label])
        note = f"{label} over that of the best baseline, {best['method']}; {ours['transfers']} transfers"
        figures[f"{label}_over_best_{ends}"] = ours[label] / best[label], note
    return figures


@figure("fmd_over_best_ratio", at_most=1)
@figure("fmd_ae_over_best_ratio", at_most=1)
@figure("truth_error_over_best_ratio", at_most=1)
@figure("cra_over_best_share", at_least=1)
@figure("sra_over_best_share", at_least=1)
@table("actor", dataset="actor")
def on_actor() -> dict:
    """On the performer's clips, beside the baselines."""
    methods = {"style-erd": StyleErdTransfer(shipped())} | {name: name for name in BASELINES}
    rows = compare(methods, mk.datasets.load("actor").split(), BESIDE)
    return over_best(rows, "fmd", "fmd_ae", "truth_error", "cra", "sra") | {"actor": list(rows.values())}


def row_model(name: str, train: mk.datasets.Dataset, steps: int = ROW_STEPS) -> ErdModel:
    """A model of a row of table 1, kept in the cache."""
    torch.set_num_threads(1)
    config = replace(ABLATIONS[name], steps=steps)
    key = hashlib.sha256(f"{config} {data_hash(train)}".encode()).hexdigest()[:16]
    path = cache_folder() / "bench" / f"erd-{key}.safetensors"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        train_model(train, config, label_steps=0, title="", resume=path.with_suffix(".run")).save(path)
    return ErdModel.load(path)


@table("table_1", dataset="actor")
def table_1() -> list[dict]:
    """The rows of table 1."""
    clips = mk.datasets.load("actor").split()
    models = Parallel(n_jobs=2)(delayed(row_model)(name, clips.train) for name in ABLATIONS)
    methods = {name: StyleErdTransfer(model) for name, model in zip(ABLATIONS, models)}
    return list(compare(methods, clips, TABLE_1).values())


@figure("bandai_fmd_over_best_ratio", at_most=1)
@figure("bandai_fmd_ae_over_best_ratio", at_most=1)
@figure("bandai_cra_over_best_share", at_least=1)
@figure("bandai_sra_over_best_share", at_least=1)
@table("bandai-2", dataset="bandai-2")
def on_captures() -> dict:
    """The model of Bandai-2, with normal as neutral, beside the baselines."""
    methods = {"style-erd": mk.methods.load("style-erd", model="bandai-2")} | {name: name for name in BASELINES}
    rows = compare(methods, captures().split(), CAPTURES)
    figures = over_best(rows, "fmd", "fmd_ae", "cra", "sra")
    return {f"bandai_{name}": figure for name, figure in figures.items()} | {"bandai-2": list(rows.values())}
