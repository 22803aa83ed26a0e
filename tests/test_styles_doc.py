"""docs/styles.md says what the code says."""

from pathlib import Path

from motionkit.actor import parameters
from motionkit.actor.__main__ import markdown
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES

PAGE = Path(__file__).resolve().parent.parent / "docs" / "styles.md"


def test_the_page_agrees_with_the_code():
    page = PAGE.read_text(encoding="utf-8")
    assert page == markdown(), "run: python -m motionkit.actor > docs/styles.md"
    assert all(f"| `{name}` |" in page for name in parameters())
    assert all(f"| {style} |" in page for style in TRAIN_STYLES + HELD_OUT_STYLES)
