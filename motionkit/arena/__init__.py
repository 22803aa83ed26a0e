"""One benchmark that runs any method on any data set: `run` makes, measures and returns the table.

>>> import motionkit as mk
>>> print(mk.arena.PROTOCOLS["small"].about)
For a laptop and a lesson: 120 pairs drawn from those of paper-1.
"""

from .protocols import PROTOCOLS, Protocol, Transfer
from .running import run
from .scoring import COLUMNS, Cell
from .table import ArenaTable, Row
from .views import Outcome, Results

__all__ = ["COLUMNS", "PROTOCOLS", "ArenaTable", "Cell", "Outcome", "Protocol", "Results", "Row", "Transfer", "run"]
