"""Does table 1 of paper 2 look otherwise after a longer training? Into results/style-erd-longer.json.

make bench-style-erd-longer

`make bench-style-erd` gives each row of the table a short training. Here the row that came first there, the rebuilding
loss alone, gets the shipped model's, and stands beside it. What is trained is kept in the cache, and goes on there.
"""

import sys
import time

import motionkit as mk
from bench import ROOT, figure, write_result
from bench_style_erd import TABLE_1, row_model
from motionkit.erd.recipe import ErdRecipe
from motionkit.methods.style_erd import StyleErdMethod

RESULT = ROOT / "results" / "style-erd-longer.json"
ALONE = "L_gen = L_rec"


def main() -> int:
    """Train, measure, and write results/style-erd-longer.json."""
    start, steps = time.perf_counter(), ErdRecipe.laptop().steps
    split, shipped = mk.datasets.load("actor").split(), mk.methods.load("style-erd").model
    assert shipped.card["steps"] == steps, "the shipped model was trained otherwise; the rows would not compare"
    models = {"ours": shipped, ALONE: row_model(ALONE, split.train, steps)}
    table = mk.arena.run({name: StyleErdMethod(model) for name, model in models.items()}, split, TABLE_1)
    print(table)
    found, figures = {row["method"]: row for row in table.records()}, {}
    for label in ("truth_error", "cra", "sra"):
        share, error = found["ours"][label] / found[ALONE][label], label == "truth_error"
        note = f"{label} of ours over that of L_rec alone, {steps:,} steps both"
        figures[f"{label}_{'ratio' if error else 'share'}"] = figure(share, 1, "", note, not error)
    write_result(RESULT, "make bench-style-erd-longer", start, figures, {"table_1": table.records()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
