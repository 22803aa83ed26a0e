"""Check saved notebooks against the house budgets.

    python tools/check_notebooks.py [NOTEBOOK ...]      (all of notebooks/ when none is named)

A notebook is saved as a student's Run All leaves it: executed in order, no errors, no noise, small, and free
of paths that mean something on one machine only.
"""

import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MAX_BYTES = 2_000_000
MAX_CELL_LINES = 25
MAX_WIDGET_BYTES = 100_000
MAX_SECONDS = 180
MAX_TOUR_SECONDS = 60
MAX_KERNEL_BYTES = 2_000_000_000
MACHINE_PATH = re.compile(r"/(work|root|home|tmp|Users)/|[A-Z]:\\+Users\\")
WIDGET_STATE = "application/vnd.jupyter.widget-state+json"


def find_notebooks() -> list[Path]:
    """Every notebook of the project, solutions included, in reading order."""
    found = (ROOT / "notebooks").glob("**/*.ipynb")
    return sorted(path for path in found if ".ipynb_checkpoints" not in path.parts)


def time_budget(path: Path) -> int:
    """Seconds that a whole run of this notebook may take on two cores."""
    return MAX_TOUR_SECONDS if path.name.startswith("00_") else MAX_SECONDS


def problems(path: Path) -> list[str]:
    """What is wrong with a saved notebook, one sentence each; empty when all is well."""
    text = path.read_text(encoding="utf-8")
    try:
        notebook = json.loads(text)
        code = [c for c in notebook["cells"] if c["cell_type"] == "code" and source(c).strip()]
    except (ValueError, KeyError, TypeError) as error:
        return [f"not a notebook that can be read: {error!r}"]
    found = []
    if [c.get("execution_count") for c in code] != list(range(1, len(code) + 1)):
        found.append("not executed top to bottom in one go; run `make notebooks`")
    for number, cell in enumerate(code, start=1):
        found += [f"code cell {number}: {what}" for what in cell_problems(cell)]
    if any(MACHINE_PATH.search(source(c)) for c in notebook["cells"]):
        found.append("the text names a path of one machine")
    if len(text.encode()) > MAX_BYTES:
        found.append(f"{len(text.encode()) / 1e6:.1f} MB, budget {MAX_BYTES / 1e6:.0f} MB")
    state = len(json.dumps(notebook["metadata"].get("widgets", {}).get(WIDGET_STATE, {})))
    if state > MAX_WIDGET_BYTES:
        found.append(f"{state / 1e3:.0f} kB of widget state, budget {MAX_WIDGET_BYTES / 1e3:.0f} kB")
    return found


def cell_problems(cell: dict) -> list[str]:
    """What is wrong with one code cell and its outputs."""
    found = []
    lines = source(cell).splitlines()
    if len(lines) > MAX_CELL_LINES:
        found.append(f"{len(lines)} lines, budget {MAX_CELL_LINES}")
    if any(line.lstrip().startswith(("!", "%%bash", "%%sh", "%pip")) for line in lines):
        found.append("a shell command, which passes the tests even when it fails; use Python")
    for output in cell["outputs"]:
        if output["output_type"] == "error":
            found.append(f"saved with an error: {output.get('ename')}: {output.get('evalue')}")
        if output.get("name") == "stderr":
            found.append(f"noise on stderr: {''.join(output['text'])[:200]!r}")
        if MACHINE_PATH.search(readable(output)):
            found.append("the output names a path of one machine")
    return found


def source(cell: dict) -> str:
    """A cell's source as one string."""
    return "".join(cell["source"])


def readable(output: dict) -> str:
    """The words of an output, without pictures (their base64 may spell anything)."""
    data = {kind: value for kind, value in output.get("data", {}).items() if not kind.startswith("image/")}
    return json.dumps([output.get("text"), data])


def main(names: list[str]) -> int:
    """Print every problem of the named notebooks (or all); 1 when there is any."""
    paths = [Path(name).resolve() for name in names] or find_notebooks()
    faults = [f"{path.name}: {what}" for path in paths for what in problems(path)]
    print("\n".join(faults) or f"{len(paths)} notebooks within the budgets")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
