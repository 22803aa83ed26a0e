"""The space of styles and the styles in it, as Markdown: `python tools/make_styles.py > docs/styles.md`."""

from __future__ import annotations

from motionkit.actor import HELD_OUT_STYLES, TRAIN_STYLES, get_style, parameters

_HEAD = """# Styles

A style of `mk.actor` is a point in a space of named numbers. Angles are in radians, lengths in leg lengths, times in
beats (a beat is a step of the walk), `x` stands for a factor. `Style(name, lean=0.2, ...)` makes one of your own,
`mix({a: 0.5, b: 0.5})` one in between, and `style.at(1.5)` exaggerates.

Made by `python tools/make_styles.py > docs/styles.md`; a test holds it to the code.
"""


def markdown() -> str:
    """The whole document.

    >>> markdown().splitlines()[0]
    '# Styles'
    """
    lines = [_HEAD, "## The numbers", "", *_row("number", "neutral", "from", "to", "unit", "meaning"), _line(6)]
    for name, p in parameters().items():
        lines += _row(f"`{name}`", f"{p.neutral:g}", f"{p.low:g}", f"{p.high:g}", p.unit, p.about)
    lines += ["", "## The styles, by what differs from neutral", "", *_row("style", "", "numbers"), _line(3)]
    for name in TRAIN_STYLES + HELD_OUT_STYLES:
        style = get_style(name)
        differ = [f"{n} {v:g}" for n, v in style.values().items() if v != parameters()[n].neutral]
        lines += _row(name, "held back" if name in HELD_OUT_STYLES else "", ", ".join(differ))
    return "\n".join(lines) + "\n"


def _row(*cells: str) -> list[str]:
    return [f"| {' | '.join(cells)} |"]


def _line(columns: int) -> str:
    return "|" + " --- |" * columns


if __name__ == "__main__":
    print(markdown(), end="")
