"""docs/papers.md against the code: functions that exist and name the paper, tests that use them, notebook headings."""

import importlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs" / "papers.md").read_text().splitlines()
    if re.match(r"\| \d", line)
]


def resolve(dotted: str) -> object:
    """`features.FacingFree` to the class, `skeleton.Skeleton.height` to the attribute."""
    parts = dotted.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            found = importlib.import_module("motionkit." + ".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return found
    raise AssertionError(dotted)


@pytest.mark.parametrize("paper, _, function, test, notebook", ROWS)
def test_papers_table_is_true(paper, _, function, test, notebook):
    name = function.strip("`")
    assert f"paper {paper}" in (resolve(name).__doc__ or "").lower(), f"{name} does not name its paper"
    assert name.rsplit(".", 1)[-1] in (ROOT / test.strip("`")).read_text()
    if notebook:
        number, heading = re.fullmatch(r'(\d\d), "(.*)"', notebook).groups()
        path = next((ROOT / "notebooks").glob(f"{number}_*.ipynb"))
        cells = ["".join(c["source"]) for c in json.loads(path.read_text())["cells"] if c["cell_type"] == "markdown"]
        assert any(re.search(rf"^#+ .*{re.escape(heading)}", cell, re.MULTILINE) for cell in cells), heading


def test_there_are_rows():
    assert len(ROWS) >= 8
