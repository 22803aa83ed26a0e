"""Makes the pictures of the README and of the notebooks' first cells, in notebooks/pictures/.

python tools/make_pictures.py
"""

from pathlib import Path

from matplotlib.figure import Figure

import motionkit as mk

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "notebooks" / "pictures"


def clip(name: str) -> mk.Motion:
    """One of the example clips."""
    return mk.load(ROOT / "data" / "actor" / f"walk_{name}.bvh")


def restyled(style: str) -> Path:
    """content + style = result, three rows of poses."""
    content, given = clip("neutral")[:56], clip(style)[:56]
    result = mk.methods.load("statistics").stylize(clip("neutral"), style=clip(style))[:56]
    figure = mk.strip([content, given, result], poses=8, roles=["content", "style", "result"])
    path = PICTURES / f"restyled_{style}.png"
    getattr(figure, "figure", figure).savefig(path, dpi=80, bbox_inches="tight")
    return path


def equation(style: str) -> Path:
    """content + style = result side by side, for the README's first screen."""
    content, given = clip("neutral"), clip(style)
    result = mk.methods.load("statistics").stylize(content, style=given)
    figure = Figure(figsize=(12, 3.6))
    rows = (
        ("content", content, "a walk"),
        ("style", given, f"a style: {style}"),
        ("result", result, "the same walk in that style"),
    )
    for n, (role, motion, text) in enumerate(rows):
        ax = figure.add_axes((0.01 + n * 0.34, 0.0, 0.3, 0.9))
        mk.strip(motion[8:38], poses=3, roles=[role], labels=[""], ax=ax)
        for label in list(ax.texts):
            label.remove()
        figure.text(
            0.16 + n * 0.34,
            0.93,
            text,
            ha="center",
            fontsize=14,
            color=figure.mix(figure.role_colour(role), "#000000", 0.35),
        )
        if n:
            figure.text(n * 0.34 - 0.005, 0.45, "+="[n - 1], ha="center", va="center", fontsize=34, color="#39424e")
    path = PICTURES / "equation.png"
    figure.savefig(path, dpi=90)
    return path


def main() -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    for path in (equation("old"), restyled("old"), restyled("childlike")):
        print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
