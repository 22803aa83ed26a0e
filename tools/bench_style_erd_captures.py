"""Measure Style-ERD (paper 2) on captures, Bandai-2, into results/style-erd-captures.json.

make bench-style-erd-captures        (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)

The model is the shipped one of Bandai-2 (`python -m motionkit train erd --data bandai-2`), with normal as neutral.
"""

import sys
import time

import motionkit as mk
from bench import ROOT, captures, figure, write_result
from motionkit.arena import Protocol

RESULT = ROOT / "results" / "style-erd-captures.json"
COLUMNS = ("fmd", "fmd_ae", "cra", "sra", "fsf", "fca", "jitter", "seconds")
CAPTURES = Protocol(  # of a style clip Style-ERD takes the label alone, so one of each style is enough
    "captures", "neutral to styled", samples=0, examples=1, columns=COLUMNS, about="Every normal clip in every style."
)
RIVALS = ("knn-dtw", "linear", "statistics")
ENDS = (("fmd", min), ("fmd_ae", min), ("cra", max), ("sra", max))


def main() -> int:
    """Measure everything and write results/style-erd-captures.json."""
    start, split = time.perf_counter(), captures().split()
    methods = {"style-erd": mk.methods.load("style-erd", model="bandai-2")} | {name: name for name in RIVALS}
    table = mk.arena.run(methods, split, CAPTURES)
    print(table)
    found, figures = {row["method"]: row for row in table.records()}, {}
    for label, better in ENDS:
        best = better((found[name] for name in RIVALS), key=lambda row: row[label])
        note = f"{label} over that of the best baseline, {best['method']}; {found['style-erd']['transfers']} transfers"
        share, ends = found["style-erd"][label] / best[label], "ratio" if better is min else "share"
        figures[f"{label}_over_best_{ends}"] = figure(share, 1, "", note, better is max)
    write_result(RESULT, "make bench-style-erd-captures", start, figures, {"bandai-2": table.records()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
