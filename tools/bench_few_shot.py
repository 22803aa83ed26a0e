"""Measure paper 1's few-shot style transfer into results/few-shot.json: styles held back, tables 1 to 3, figure 8.

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
from motionkit.arena import PROTOCOLS, Protocol
from motionkit.features import FacingFree
from motionkit.fewshot import ABLATIONS, Chain, Recipe
from motionkit.layers import Denoiser, TransformerConfig
from motionkit.skeleton import smpl

RESULT = ROOT / "results" / "few-shot.json"
EXAMPLES = 1  # of each style, drawn by the seed, of paper 1's 70: each is learned anew
PAIRS = 72  # of table 2, drawn by the seed
HELD_BACK = Protocol(
    "held back",
    "neutral to styled",
    examples=3,
    columns=("fmd", "cra", "sra", "truth_error", "fsf", "fca", "jitter", "seconds"),
    about="A neutral clip of each content in each of four styles that nothing was trained on; three clips lend each.",
)
CHANGES = (100, 200, 300, 400, 500)  # K of figure 8; each learns two styles anew
RIVALS = ("knn-dtw", "statistics", "linear", "copy-content", "copy-style")  # the copies only show the ends


def times() -> dict:
    """Seconds to learn a style and to restyle 4 s at laptop size, of 6 steps at paper size; bytes of a style."""
    old, walk = (perform("walk", style, seed=1, seconds=4.0).motion for style in ("zombie", "neutral"))
    figures, prompt = {}, "a person is walking in a zombie-like way"
    begun = time.perf_counter()
    mk.methods.load("few-shot", recipe=Recipe.in_space()).learn(old, prompt)
    taken, about = time.perf_counter() - begun, "a point in the space of styles"
    figures["learn_in_space_seconds"] = figure(taken, 180, "s", about, False)
    method = mk.methods.load("few-shot", recipe=Recipe.laptop())
    len(method.pairs.library)  # read before the clock starts
    begun = time.perf_counter()
    learned = method.learn(old, prompt)
    figures["learn_seconds"] = figure(time.perf_counter() - begun, 180, "s", "pair, contents, fine-tuning", False)
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


class Told:
    """Not a rival but a bound: few-shot told the performer's own numbers of the style, with nothing to learn."""

    def __init__(self) -> None:
        self.method = mk.methods.load("few-shot")

    def transfer(self, content, style) -> mk.Motion:
        """As the arena asks."""
        named = style.style
        return self.method.stylize(content.motion, named, caption=content.text, content_style=content.style)


def held_back(figures: dict) -> list[dict]:
    """Styles that neither prior nor space nor discriminator has seen, from one clip, beside all baselines."""
    clips = mk.datasets.load("actor-held-back").split().test
    split = mk.datasets.Split(mk.datasets.load("actor").split().train, clips[:0], clips)
    ways = {"few-shot": Recipe.in_space(), "few-shot, adapter": Recipe.laptop()}
    methods = {name: mk.methods.load("few-shot", library=split.train, recipe=recipe) for name, recipe in ways.items()}
    methods |= {"told the numbers": Told()} | {name: name for name in RIVALS}
    table = mk.arena.run(methods, split, HELD_BACK, judge=mk.judges.load("actor-held-back"))
    print(table)
    found = {row["method"]: row for row in table.records()}
    ours = found["few-shot"]
    for name, rival in (("knn", "knn-dtw"), ("statistics", "statistics")):
        share, note = ours["truth_error"] / found[rival]["truth_error"], f"truth error over that of {rival}"
        figures[f"held_back_error_{name}_ratio"] = figure(share, 0.7, "", note, False)
    for label in ("cra", "sra"):
        best = max((found[name] for name in RIVALS[:3]), key=lambda row: row[label])
        low, high = ours[f"{label}_ci"][0], best[f"{label}_ci"][1]
        note = f"low end of the interval, {low:.1f}, over the high end of the best other, {best['method']}, {high:.1f}"
        figures[f"held_back_{label}_over_best"] = figure(low / high, 1, "", note)
    return table.records()


def bandai(split, figures: dict) -> dict:
    """Tables 1 to 3 and figure 8, on captures; prior and discriminator learned from their training part."""
    protocol = replace(PROTOCOLS["paper-1"], name="paper-1, one example", examples=EXAMPLES)
    start = mk.methods.load("few-shot", prior="bandai-2", library=split.train, recipe=Recipe.laptop())
    methods = {name: start.having(**vars(recipe)) for name, recipe in ABLATIONS.items()}
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
    neutral = next(style for style in test.styles if style in mk.pairs.NEUTRAL)
    first = {(clip.content, clip.style): clip for clip in reversed(list(test))}
    styled, contents = (
        [clip for kind, clip in sorted(first.items()) if (kind[1] == neutral) is same] for same in (False, True)
    )
    examples = styled[:: len(styled) // 2][:2]
    return {
        "figure_8_g": mk.fewshot.sweep_noise(method, styled[::4]),
        "figure_8_k": mk.fewshot.sweep_change(method, examples, contents, CHANGES),
    }


def main() -> int:
    """Measure everything and write results/few-shot.json."""
    start, root = time.perf_counter(), find_root()
    try:
        split = mk.datasets.load("bandai-2", root).split()
    except mk.MotionKitError as error:
        print(error)
        return 1
    figures = times()
    tables = {"held_back": held_back(figures), **bandai(split, figures)}
    write_result(RESULT, "make bench-few-shot", start, figures, tables)
    return 0


if __name__ == "__main__":
    sys.exit(main())
