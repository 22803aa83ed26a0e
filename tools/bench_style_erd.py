"""Measure paper 2's Style-ERD into results/style-erd.json: speed, switches, quality, the rows of table 1.

make bench-style-erd

The shipped model is measured; the rows of table 1, and two with the kit's additions, are trained anew, all alike and
shorter, two at a time, and kept in the cache, so a run that is broken off goes on where it was. Times are taken first,
on one thread.
"""

import hashlib
import os
import sys
import time
from dataclasses import replace

import numpy as np
import torch
from joblib import Parallel, delayed

import motionkit as mk
from bench import ROOT, figure, write_result
from motionkit.actor import perform, retell
from motionkit.arena import Protocol
from motionkit.arena.transfers import error_against
from motionkit.files import cache_folder
from motionkit.methods.style_erd import ABLATIONS, ErdModel, StyleErdMethod, frames_of, split, train_model
from motionkit.training import data_hash

RESULT = ROOT / "results" / "style-erd.json"
ROW_STEPS = 1500  # of every row of table 1; the shipped model has more
COLUMNS = ("fmd", "fmd_ae", "cra", "sra", "truth_error", "fsf", "fca", "jitter", "seconds")
ABOUT = "Neutral clips of each content in every other style"
BESIDE = Protocol("beside baselines", "neutral to styled", columns=COLUMNS, about=f"{ABOUT}, of every style clip.")
TABLE_1 = Protocol(  # of a style clip these methods take the label alone, so one of each style is enough
    "table 1", "neutral to styled", samples=3, examples=1, columns=COLUMNS, about=f"{ABOUT}, of one style clip each."
)
RIVALS = ("knn-dtw", "linear", "statistics")


def seconds_each(step, count: int, warm: int = 200) -> float:
    """Seconds for one call, the median of `count`."""
    found = []
    for n in range(count + warm):
        begun = time.perf_counter()
        step(n)
        found.append(time.perf_counter() - begun)
    return float(np.median(found[warm:]))


def speed(model: ErdModel, figures: dict) -> None:
    """Milliseconds a frame without and with kinematics, many streams at once, a long clip, agreement with torch."""
    walk = perform("walk", "neutral", seed=1, seconds=10.0, fps=model.fps).motion
    x, label, own = frames_of(walk).x.numpy(), np.array([model.number("content", "walk")]), np.array([0])
    wanted, fast, kept = model.wanted("old")[None], model.fast, [model.fast.begin(label)]

    def network(n):
        kept[0] = fast.step(x[None, n % len(x)], label, own, wanted, kept[0])[1]

    figures["network_ms"] = figure(1000 * seconds_each(network, 3000), 0.2, "ms", "a frame, one stream", False)
    turns, places = walk.rotations.numpy(), walk.translations.numpy()
    for count, name in ((1, "whole_ms"), (64, "frames_per_s")):
        stream = StyleErdMethod(model).stream("old", content="walk", own_style="neutral", count=count)
        rows = [(np.repeat(turns[n, None], count, 0), np.repeat(places[n, None], count, 0)) for n in range(len(turns))]
        taken = seconds_each(lambda n, s=stream, r=rows: s.push(*r[n % len(r)]), 2000 if count == 1 else 300)
        if count == 1:
            figures[name] = figure(1000 * taken, 0.4, "ms", "a frame, kinematics of both bodies with it", False)
        else:
            figures[name] = figure(count / taken, 30_000, "", "64 streams at once, kinematics with them")
    kept[0] = fast.begin(label)
    early, late = (seconds_each(network, 500, warm) for warm in (200, 20_000))
    note = "a frame after 20,000 others over one of the first 700"
    figures["late_over_early_ratio"] = figure(late / early, 1.1, "", note, False)
    eager = model.network(torch.from_numpy(x)[None], *map(torch.from_numpy, (label, own, wanted)))
    state, made = fast.begin(label), []
    for row in x:
        y, state = fast.step(row[None], label, own, wanted, state)
        made.append(y[0])
    pairs = zip(split(torch.from_numpy(np.stack(made))), split(eager[0][0]))
    gap = max(float((a - b).abs().max()) for a, b in pairs)
    figures["off_from_eager_ratio"] = figure(gap, 1e-5, "", "largest difference from torch's answers over 10 s", False)


def beginnings(model: ErdModel, figures: dict) -> list[dict]:
    """Figure 5: how far the first frames are from the performer's own, over all contents and styles."""
    errors: dict[str, list] = {"learned": [], "zero": []}
    bare = ErdModel(model.network, model.contents, model.styles, model.skeleton, model.fps)
    bare.fast._neutral, bare.fast._styles = (
        tuple(np.zeros_like(numbers) for numbers in part) for part in (bare.fast._neutral, bare.fast._styles)
    )
    for k, content in enumerate(model.contents):
        played = perform(content, "neutral", seed=700 + k, seconds=4.0, fps=model.fps, performer=46)
        for style in model.styles[1:]:
            answer = retell(played, style).time_aligned(played)
            for name, one in (("learned", model), ("zero", bare)):
                labels = {"content_label": content, "content_style": "neutral"}
                made = StyleErdMethod(one).stylize(played.motion, style, lock=False, **labels)
                errors[name].append([error_against(made[n : n + 1], answer[n : n + 1]) for n in (*range(10), 60)])
    rows = [{"frame": n, **{k: round(float(np.mean(e, 0)[i]), 2) for k, e in errors.items()}}
            for i, n in enumerate((*range(10), 60))]  # fmt: skip
    share = rows[0]["learned"] / rows[-1]["learned"]
    figures["first_frame_error_ratio"] = figure(share, 1.5, "", "error of the first frame over that of the 61st", False)
    return rows


def switches(model: ErdModel, figures: dict) -> None:
    """Jerk while one style becomes another, every two seconds, over that in between, where the style stays."""
    walk = perform("walk", "neutral", seed=2, seconds=60.0, fps=model.fps).motion
    stream = StyleErdMethod(model).stream("neutral", content="walk", own_style="neutral")
    chance = np.random.default_rng(0)
    turns, places, marks, made = walk.rotations.numpy(), walk.translations.numpy(), [], []
    for n in range(len(walk)):
        if n and n % 120 == 0:
            stream.style = model.styles[int(chance.integers(len(model.styles)))]
            marks.append(n)
        rotations, root = stream.push(turns[None, n], places[None, n])
        moved = places[n].copy()
        moved[0] = root[0]
        made.append(model.body.places(rotations, moved[None])[0])
    jerk = np.linalg.norm(np.diff(np.stack(made), n=3, axis=0), axis=-1).mean(1)
    near = np.zeros(len(jerk), bool)
    for mark in marks:
        near[mark - 3 : mark + round(stream.fade * model.fps)] = True  # each is of four frames
    share = float(np.percentile(jerk[near], 90) / np.percentile(jerk[~near], 90))
    figures["switch_jerk_ratio"] = figure(share, 1, "", "90th percentile in a change over that elsewhere", False)


def row_model(name: str, train, steps: int = ROW_STEPS) -> ErdModel:
    """A model of a row of table 1, kept in the cache."""
    torch.set_num_threads(1)
    recipe = replace(ABLATIONS[name], steps=steps)
    same = hashlib.sha256(f"{recipe} {data_hash(train)}".encode()).hexdigest()[:16]
    path = cache_folder() / "bench" / f"erd-{same}.safetensors"
    os.makedirs(path.parent, exist_ok=True)
    if not path.exists():
        train_model(train, recipe, label_steps=0, title="", keep=path.with_suffix(".run")).save(path)
    return ErdModel.load(path)


def quality(model: ErdModel, figures: dict) -> dict:
    """The arena's tables on the performer's clips: beside the baselines, and the rows of table 1."""
    split = mk.datasets.load("actor").split()
    methods = {"style-erd": StyleErdMethod(model)} | {name: name for name in RIVALS}
    table = mk.arena.run(methods, split, BESIDE)
    print(table)
    found = {row["method"]: row for row in table.records()}
    for label, better in (("fmd", min), ("fmd_ae", min), ("truth_error", min), ("cra", max), ("sra", max)):
        best = better((found[name] for name in RIVALS), key=lambda row: row[label])
        value = found["style-erd"][label] / best[label]
        note = f"{label} over that of the best baseline, {best['method']}"
        ends = "ratio" if better is min else "share"
        figures[f"{label}_over_best_{ends}"] = figure(value, 1, "", note, better is max)
    models = Parallel(n_jobs=2)(delayed(row_model)(name, split.train) for name in ABLATIONS)
    rows = mk.arena.run({name: StyleErdMethod(one) for name, one in zip(ABLATIONS, models)}, split, TABLE_1)
    print(rows)
    return {"actor": table.records(), "table_1": rows.records()}


def main() -> int:
    """Measure everything and write results/style-erd.json."""
    start, figures = time.perf_counter(), {}
    torch.set_num_threads(1)
    model = mk.methods.load("style-erd").model
    with torch.inference_mode():
        speed(model, figures)
        tables = {"figure_5": beginnings(model, figures)}
        switches(model, figures)
    figures["training_seconds"] = figure(model.card["seconds"], 5400, "s", "by the card", False)
    tables |= quality(model, figures)
    write_result(RESULT, "make bench-style-erd", start, figures, tables)
    return 0


if __name__ == "__main__":
    sys.exit(main())
