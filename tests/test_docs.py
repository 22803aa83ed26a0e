"""docs/*.md are what tools/make_docs.py makes, and docs/papers.md is true: functions, tests, notebook headings."""

import importlib
import json
import re
from pathlib import Path

import pytest

import make_docs

ROOT = Path(__file__).resolve().parent.parent
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs" / "papers.md").read_text(encoding="utf-8").splitlines()
    if re.match(r"\| \d", line)
]


@pytest.mark.slow
@pytest.mark.parametrize("page", make_docs.PAGES)
def test_the_page_agrees_with_the_code(page):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    assert text == make_docs.PAGES[page](), "run: make docs"


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


@pytest.mark.parametrize("paper, place, function, test, notebook", ROWS)
def test_papers_table_is_true(paper, place, function, test, notebook):
    thing = resolve(function.strip("`"))
    words = f"{thing.__doc__} {getattr(getattr(thing, 'forward', None), '__doc__', '')}".lower()
    assert f"paper {paper}" in words and not re.search(r"\(paper|^[^:]*\||:$", place)
    if test:
        home, name = function.strip("`").rsplit(".", 1)
        text = (ROOT / test.strip("`")).read_text()
        known = make_docs.known_as(home) if home.rsplit(".", 1)[-1][0].isupper() else ""
        assert name in text or home.rsplit(".", 1)[-1] in text or (known and f'"{known}"' in text)
    if notebook:
        number, heading = re.fullmatch(r'(\d\d), "(.*)"', notebook).groups()
        path = next((ROOT / "notebooks").glob(f"{number}_*.ipynb"))
        cells = ["".join(c["source"]) for c in json.loads(path.read_text())["cells"] if c["cell_type"] == "markdown"]
        assert any(re.search(rf"^#+ .*{re.escape(heading)}", cell, re.MULTILINE) for cell in cells), heading


def test_every_numbered_equation_has_a_row():
    spans = {"1": 13, "2": 9}
    for paper, last in spans.items():
        places = " ".join(row[1].split(":")[0] for row in ROWS if row[0] == paper)
        numbers = {int(n) for n in re.findall(r"(?:eqs?\.|and) (\d+)", places)}
        for low, high in re.findall(r"eqs\. (\d+) to (\d+)", places):
            numbers |= set(range(int(low), int(high) + 1))
        assert numbers >= set(range(1, last + 1))
    assert any(row[0] == "4" and "eq. 5" in row[1] for row in ROWS)
    assert len(ROWS) > 90 and sum(not row[3] for row in ROWS) <= 1


def test_what_is_shown_elsewhere_is_a_row():
    assert set(make_docs.SHOWN) <= {row[2].strip("`") for row in ROWS}


@pytest.mark.parametrize(
    "docstring, expected",
    [
        ("Noise (paper 1, eqs. 1 and 2; paper 4, section 4).", [(1, "section 3.2, eqs. 1 and 2"), (4, "section 4")]),
        ("Paper 1's prior (section 3.3, eq. 5)\non clips.", [(1, "section 3.3, eq. 5")]),
        ("As published (paper 2, supplement A).", [(2, "supplement A")]),
        ("Quick (paper 2, section C.1), and paper 2, supplement: L_quat.", [(2, "supplement C.1"), (2, "supplement")]),
        ("Few (paper 1, eq. 9 and section 4: K = 300).", [(1, "section 3.4, eq. 9 and section 4")]),
        ("Trains (paper 1, sections 3.4 and 3.5, table 2).", [(1, "sections 3.4 and 3.5, table 2")]),
        ("A sweep (paper 1, figure 8, left), twice (paper 1, figure 8).", [(1, "section 6.1, figure 8")]),
        ("Faster (beyond paper 2, section 4.4), as papers 1 and 3, and paper 5.", []),
        ("Fine.\n\n>>> paper = 'paper 1, eq. 1'", []),
    ],
)  # fmt: skip
def test_places_that_a_docstring_names(docstring, expected):
    assert make_docs.citations(docstring) == expected


def test_first_sentences():
    text = "How lively (paper 1, eq. 13: U), in m/s. More.\n\n>>> x"
    assert make_docs.first_sentence(text) == "How lively, in m/s"
    assert make_docs.first_sentence("Paper 1's Dis (section 3.3, figure 3): motions as vectors") == (
        "Paper 1's Dis: motions as vectors"
    )
    assert make_docs.first_sentence("Paper 1, section 4: all weights. steps: how many") == "all weights"


@pytest.mark.slow
@pytest.mark.parametrize("make", make_docs.LAYOUTS)
def test_every_number_of_a_joint_is_in_its_row(make):
    layout = make()
    table = {row.split(" | ")[0].strip("| "): row for row in make_docs.layout_section(layout, "").splitlines()}
    for number in range(layout.size):
        joint = layout.joint_of(number)
        if joint is None:
            continue
        cells = table[layout.skeleton.names[joint]].strip("| ").split("|")[1:]
        spans = [[int(n) for n in cell.split("-")] for cell in cells if cell.strip()]
        assert any(span[0] <= number <= span[-1] for span in spans), layout.describe(number)
