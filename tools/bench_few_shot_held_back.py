"""Measure few-shot style transfer in styles held back into results/few-shot-held-back.json, and how long it takes.

make bench-few-shot-held-back        (needs no captures)

All results of the arena are kept, so a run that is broken off goes on where it was. Times are taken first.
"""

import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import torch

import motionkit as mk
from bench import ROOT, figure, write_result
from bench_diffusion import seconds_of
from motionkit.actor import perform
from motionkit.arena import Protocol
from motionkit.features import FacingFree
from motionkit.layers import Denoiser, TransformerConfig
from motionkit.methods.few_shot import Recipe
from motionkit.sampling import PartialDiffusion
from motionkit.skeleton import smpl

RESULT = ROOT / "results" / "few-shot-held-back.json"
HELD_BACK = Protocol(
    "held back",
    "neutral to styled",
    examples=3,
    columns=("fmd", "cra", "sra", "truth_error", "fsf", "fca", "jitter", "seconds"),
    about="A neutral clip of each content in each of four styles that nothing was trained on; three clips lend each.",
)
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
    layout, chain = FacingFree(smpl(), 30), PartialDiffusion.from_paper(method.prior.schedule)
    network = Denoiser(layout.size, 128, TransformerConfig.paper()).eval()  # fresh weights are as fast
    x, words = torch.randn(1, 120, layout.size), torch.randn(1, 128)
    with torch.inference_mode():
        taken = seconds_of(partial(chain.reverse, lambda x, t: network(x, t, words), x))
    figures["paper_size_seconds"] = figure(taken, 0.4, "s", "120 frames, 6 steps of the reverse chain", False)
    return figures


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


def main() -> int:
    """Measure everything and write results/few-shot-held-back.json."""
    start, figures = time.perf_counter(), times()
    write_result(RESULT, "make bench-few-shot-held-back", start, figures, {"held_back": held_back(figures)})
    return 0


if __name__ == "__main__":
    sys.exit(main())
