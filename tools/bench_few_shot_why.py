"""Why table 3 of paper 1 looks otherwise here: experiments on its rows, into results/few-shot-why.json.

make bench-few-shot-why     (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

The paper's rows come from clips (Xia's) that its prior did not learn from, after one epoch of fine-tuning. Here some
rows get as many steps, others a prior that has seen none of the captures. All results of the arena are kept.
"""

import sys
import time
from dataclasses import replace
from functools import cached_property

import motionkit as mk
from bench import ROOT, figure, find_root, write_result
from motionkit.arena import PROTOCOLS
from motionkit.fewshot import ABLATIONS, Recipe, with_autoencoder
from motionkit.methods.few_shot import FewShot
from motionkit.priors import Prior

RESULT = ROOT / "results" / "few-shot-why.json"
EPOCH = 23384 // 64  # steps of fine-tuning: one epoch of paper 1 (section 4), in whole batches
FALLS = (("ae_cra", "with AE", "cra"), ("ae_sra", "with AE", "sra"), ("sra", "without L_s", "sra"))  # in the paper
ROWS = ("ours", "without L_s", "with AE")


class Elsewhere(FewShot):
    """Few-shot with the prior of `actor`; an autoencoder in its place learns from `actor`'s clips, too."""

    @cached_property
    def taught(self) -> Prior:
        """What is fine-tuned on clips that neither it nor its discriminator has seen the like of."""
        if self.recipe.model != "autoencoder":
            return self.prior
        return with_autoencoder(self.prior, mk.datasets.load("actor").split().train, seed=self.seed)


def main() -> int:
    """Measure everything and write results/few-shot-why.json."""
    start = time.perf_counter()
    try:
        split = mk.datasets.load("bandai-2", find_root()).split()
    except mk.MotionKitError as error:
        print(error)
        return 1
    protocol = replace(PROTOCOLS["paper-1"], name="paper-1, one example", examples=1)
    home = mk.methods.load("few-shot", prior="bandai-2", library=split.train, recipe=Recipe.laptop())
    methods = {f"{row}, one epoch": home.having(steps=EPOCH, **_change(row)) for row in ROWS}
    away = {row: Elsewhere("actor", library=split.train, recipe=ABLATIONS[row]) for row in ROWS}
    methods |= {f"{row}, prior of actor": method for row, method in away.items()}
    table = mk.arena.run(methods, split, protocol)
    print(table)
    found, figures = {row["method"]: row for row in table.records()}, {}
    for name in ("one epoch", "prior of actor"):
        for key, row, label in FALLS:
            share = found[f"{row}, {name}"][label] / found[f"ours, {name}"][label]
            note = f"{label} of {row} over that of ours; {name}"
            figures[f"{key}_{name.replace(' ', '_')}_ratio"] = figure(share, 0.5, "", note, False)
    write_result(RESULT, "make bench-few-shot-why", start, figures, {"why": table.records()})
    return 0


def _change(row: str) -> dict:
    """What a row of table 3 changes in the recipe."""
    recipe, plain = ABLATIONS[row], Recipe()
    return {name: value for name, value in vars(recipe).items() if value != vars(plain)[name]}


if __name__ == "__main__":
    sys.exit(main())
