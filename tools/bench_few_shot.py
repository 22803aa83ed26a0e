"""Measure paper 1's few-shot style transfer into results/few-shot.json: table 1's row, tables 2 and 3, time and size.

make bench-few-shot        (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

All results of the arena are kept, so a run that is broken off goes on where it was. Times are taken first.
"""

import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

import motionkit as mk
from bench import ROOT, figure, find_root, write_result
from bench_diffusion import seconds_of
from motionkit.actor import perform
from motionkit.arena import PROTOCOLS
from motionkit.features import FacingFree
from motionkit.fewshot import Chain, Recipe
from motionkit.layers import Denoiser, TransformerConfig
from motionkit.skeleton import smpl

RESULT = ROOT / "results" / "few-shot.json"
EXAMPLES = 1  # of each style, drawn by the seed, of paper 1's 70: each is learned anew
PAIRS = 72  # of table 2, drawn by the seed
ROWS = {  # of table 3; other methods' rows on all of the protocol are in results/arena-baselines.json
    "few-shot": Recipe.laptop(),
    "without L_s": replace(Recipe.laptop(), weights=(1.0, 0.0)),
}


def times() -> dict:
    """Seconds to learn a style and to restyle 4 s at laptop size, of 6 steps at paper size; bytes of a style."""
    old, walk = (perform("walk", style, seed=1, seconds=4.0).motion for style in ("zombie", "neutral"))
    method = mk.methods.load("few-shot")
    len(method.pairs.library)  # read before the clock starts
    begun = time.perf_counter()
    learned = method.learn(old, "a person is walking in a zombie-like way")
    figures = {"learn_seconds": figure(time.perf_counter() - begun, 180, "s", "pair, contents, fine-tuning", False)}
    taken = seconds_of(partial(method.stylize, walk, style=learned, caption="a person is walking"))
    figures["restyle_seconds"] = figure(taken, 0.3, "s", "120 frames at laptop size, feet locked", False)
    with tempfile.TemporaryDirectory() as folder:
        size = learned.save(Path(folder, "style.safetensors")).stat().st_size
    figures["style_file_mb"] = figure(size / 1e6, 1, "MB", "rank 8, numbers of 16 bits", False)
    layout, chain = FacingFree(smpl(), 30), Chain.like_paper(method.prior.schedule)
    network = Denoiser(layout.size, 128, TransformerConfig.paper()).eval()  # fresh weights are as fast
    x, words = torch.randn(1, 120, layout.size), torch.randn(1, 128)
    with torch.inference_mode():
        taken = seconds_of(partial(chain.reverse, lambda x, t: network(x, t, words), x))
    figures["paper_size_seconds"] = figure(taken, 0.4, "s", "120 frames, 6 steps of the reverse chain", False)
    return figures


def pairs(method, judge, test) -> list[dict]:
    """Table 2: are the neutral motions that are paired with test clips neutral, and do they keep the content?"""
    rows, styled = [], [clip for clip in test if clip.style not in mk.pairs.NEUTRAL]
    neutral = next(style for style in test.styles if style in mk.pairs.NEUTRAL)
    order = torch.randperm(len(styled), generator=torch.Generator().manual_seed(0)).tolist()
    clips = [styled[n] for n in order[:PAIRS]]
    real = judge.content.features([clip.motion for clip in test])
    for name, own in (("few-shot", method), ("KNN + DTW", mk.methods.load("knn-dtw", library=method.pairs.library))):
        make = own.neutral_motion if name == "few-shot" else own.neutral_pair
        made = [make(c.motion, c.text if name == "few-shot" else c.content) for c in clips]
        contents = judge.content.scores(made).argmax(1) == judge.content.ids([c.content for c in clips])
        styles = judge.style.scores(made).argmax(1) == judge.style.ids([neutral] * len(made))
        row = {"method": name, "pairs": len(made), "fmd": mk.metrics.fmd(judge.content.features(made), real)}
        row |= {"cra": 100 * contents.double().mean().item(), "sra": 100 * styles.double().mean().item()}
        rows.append({key: round(value, 2) if isinstance(value, float) else value for key, value in row.items()})
    return rows


def main() -> int:
    """Measure everything and write results/few-shot.json."""
    start, root = time.perf_counter(), find_root()
    try:
        split = mk.datasets.load("bandai-2", root).split()
    except mk.MotionKitError as error:
        print(error)
        return 1
    figures = times()
    protocol = replace(PROTOCOLS["paper-1"], name="paper-1, one example", examples=EXAMPLES)
    methods = {
        name: mk.methods.load("few-shot", prior="bandai-2", library=split.train, recipe=recipe)
        for name, recipe in ROWS.items()
    }
    table = mk.arena.run(methods | {"statistics": "statistics"}, split, protocol)
    print(table)
    found = {row["method"]: row for row in table.records()}
    note = f"Bandai-2, one example of each style, {found['few-shot']['transfers']} of paper 1's transfers"
    figures["bandai_cra"] = figure(found["few-shot"]["cra"], 93.41, "%", note)
    figures["bandai_sra"] = figure(found["few-shot"]["sra"], 60.11, "%", note)
    shares = found["without L_s"]["sra"] / found["few-shot"]["sra"]
    figures["sra_without_semantic_ratio"] = figure(shares, 0.5, "", "SRA without L_s over SRA with it", False)
    judge = mk.judges.load("bandai-2")
    tables = {"table_3": table.records(), "table_2": pairs(methods["few-shot"], judge, split.test)}
    write_result(RESULT, "make bench-few-shot", start, figures, {**tables, "provenance": [table.provenance]})
    return 0


if __name__ == "__main__":
    sys.exit(main())
