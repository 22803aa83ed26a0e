"""docs/features.md says what the code says."""

from pathlib import Path

import pytest

from motionkit.features import __main__ as doc

PAGE = Path(__file__).resolve().parent.parent / "docs" / "features.md"


def test_the_page_agrees_with_the_code():
    page = PAGE.read_text(encoding="utf-8")
    assert page == doc.markdown(), "run: python -m motionkit.features > docs/features.md"


@pytest.mark.parametrize("make", doc.LAYOUTS)
def test_every_number_of_a_joint_is_in_its_row(make):
    layout = make()
    table = {row.split(" | ")[0].strip("| "): row for row in doc._section(layout, "").splitlines()}
    for number in range(layout.size):
        joint = layout.joint_of(number)
        if joint is None:
            continue
        cells = table[layout.skeleton.names[joint]].strip("| ").split("|")[1:]
        spans = [[int(n) for n in cell.split("-")] for cell in cells if cell.strip()]
        assert any(span[0] <= number <= span[-1] for span in spans), layout.describe(number)
