"""Table 3 of paper 1 with a prior that has seen nothing of the data, into results/few-shot-why.json.

make bench-few-shot-why     (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

The paper's rows come from clips (Xia's) that its prior did not learn from; in `make bench-few-shot` the prior has
learned from other clips of the same styles. Here it is that of `actor`. All results of the arena are kept.
"""

import sys
import time
from dataclasses import replace
from functools import cached_property

import motionkit as mk
from bench import ROOT, captures, figure, write_result
from motionkit.arena import PROTOCOLS
from motionkit.methods.few_shot import ABLATIONS, FewShot, with_autoencoder
from motionkit.methods.text_to_motion import Prior

RESULT = ROOT / "results" / "few-shot-why.json"
ROWS = ("ours", "without L_s", "with AE")
FALLS = (("ae_cra", "with AE", "cra"), ("ae_sra", "with AE", "sra"), ("sra", "without L_s", "sra"))  # in the paper


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
    start, split = time.perf_counter(), captures().split()
    protocol = replace(PROTOCOLS["paper-1"], name="paper-1, one example", examples=1)
    methods = {row: Elsewhere("actor", library=split.train, recipe=ABLATIONS[row]) for row in ROWS}
    table = mk.arena.run(methods, split, protocol)
    print(table)
    found, figures = {row["method"]: row for row in table.records()}, {}
    for key, row, label in FALLS:
        note = f"{label} of {row} over that of ours; prior of actor, clips of Bandai-2"
        figures[f"{key}_ratio"] = figure(found[row][label] / found["ours"][label], 0.5, "", note, False)
    write_result(RESULT, "make bench-few-shot-why", start, figures, {"table_3": table.records()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
