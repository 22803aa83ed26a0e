"""Measure paper 1's few-shot style transfer on captures into results/few-shot.json: tables 1 to 3, figure 8.

make bench-few-shot        (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

All results of the arena are kept, so a run that is broken off goes on where it was.
"""

import sys
import time
from dataclasses import replace

import torch

import motionkit as mk
from bench import ROOT, captures, figure, write_result
from motionkit.arena import PROTOCOLS
from motionkit.methods.few_shot import ABLATIONS, Recipe

RESULT = ROOT / "results" / "few-shot.json"
EXAMPLES = 1  # of each style, drawn by the seed, of paper 1's 70: each is learned anew
PAIRS = 72  # of table 2, drawn by the seed
CHANGES = (100, 200, 300, 400, 500)  # K of figure 8; each learns two styles anew


def pairs(method, judge, test) -> list[dict]:
    """Table 2: are the neutral motions that are paired with test clips neutral, and do they keep the content?"""
    rows, styled = [], [clip for clip in test if clip.style not in mk.methods.neutral_pairs.NEUTRAL]
    neutral = next(style for style in test.styles if style in mk.methods.neutral_pairs.NEUTRAL)
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


def bandai(split, figures: dict) -> dict:
    """Tables 1 to 3 and figure 8, on captures; prior and discriminator learned from their training part."""
    protocol = replace(PROTOCOLS["paper-1"], name="paper-1, one example", examples=EXAMPLES)
    start = mk.methods.load("few-shot", prior="bandai-2", library=split.train, recipe=Recipe.laptop())
    methods = {name: start.with_recipe(**vars(recipe)) for name, recipe in ABLATIONS.items()}
    table = mk.arena.run(methods | {"statistics": "statistics"}, split, protocol)
    print(table)
    found = {row["method"]: row for row in table.records()}
    note = f"Bandai-2, one example of each style, {found['ours']['transfers']} of paper 1's transfers"
    figures["bandai_cra"] = figure(found["ours"]["cra"], 93.41, "%", note)
    figures["bandai_sra"] = figure(found["ours"]["sra"], 60.11, "%", note)
    shares = found["without L_s"]["sra"] / found["ours"]["sra"]
    figures["sra_without_semantic_ratio"] = figure(shares, 0.5, "", "SRA without L_s over SRA with it", False)
    judge = mk.judges.load("bandai-2")
    return {"table_3": table.records(), "table_2": pairs(start, judge, split.test), **sweeps(start, split.test)}


def sweeps(method, test) -> dict:
    """Figure 8: G on a styled clip of each kind, K on a clip of two styles taken to a neutral one of each content."""
    neutral = next(style for style in test.styles if style in mk.methods.neutral_pairs.NEUTRAL)
    first = {(clip.content, clip.style): clip for clip in reversed(list(test))}
    styled, contents = (
        [clip for kind, clip in sorted(first.items()) if (kind[1] == neutral) is same] for same in (False, True)
    )
    examples = styled[:: len(styled) // 2][:2]
    return {
        "figure_8_g": mk.methods.few_shot.sweep_noise(method, styled[::4]),
        "figure_8_k": mk.methods.few_shot.sweep_change(method, examples, contents, CHANGES),
    }


def main() -> int:
    """Measure everything and write results/few-shot.json."""
    start, figures = time.perf_counter(), {}
    tables = bandai(captures().split(), figures)
    write_result(RESULT, "make bench-few-shot", start, figures, tables)
    return 0


if __name__ == "__main__":
    sys.exit(main())
