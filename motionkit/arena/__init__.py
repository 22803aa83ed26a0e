"""One benchmark that runs any method on any data set: `run` makes the results, measures them and returns the table.

`mk.arena.run(["copy-content", "statistics"])` takes methods by name, `mk.arena.run({"mine": my_function})` a function
of two motions. A method with `fit` learns from the data set's training clips first (a copy of it does); one with
`transfer(content, style)` gets clips, with their labels, instead of motions.

Every result goes to disk as soon as it is there, below `folder` or in the cache (MOTIONKIT_CACHE). A run that was
stopped or killed goes on where it was, and results are not made again until the clips, the protocol, the seed or the
method change. Of the kit's own methods that is name, version and state; of a function of yours its code, constants,
defaults and closure, and what it names of its own module or notebook. What it calls elsewhere is not looked at, so
after a change there say `resume=False`, which makes all again. Results of earlier versions stay in the folder until you
delete it.

Chance is seeded for each transfer: one seed gives one table, all but the seconds, with however many jobs. Under
`joblib.parallel_config("dask")` a cluster works, whose machines must see the folder and the cache.

A transfer that fails (an error, no Motion, another skeleton, no frames, numbers that are not finite) is counted and
named below the table, and tried again by the next run. Accuracies count it as wrong; other figures are marked with a
star and say without how many they are. The row `real` is the test clips themselves, and for FMD as many training clips.

>>> import motionkit as mk
>>> print(mk.arena.PROTOCOLS["small"].about)
For a laptop and a lesson: 120 pairs drawn from those of paper-1.
"""

from __future__ import annotations

from .protocols import PROTOCOLS, Protocol, Transfer
from .running import run
from .table import COLUMNS, ArenaTable, Cell, Outcome, Results, Row

__all__ = ["COLUMNS", "PROTOCOLS", "ArenaTable", "Cell", "Outcome", "Protocol", "Results", "Row", "Transfer", "run"]
