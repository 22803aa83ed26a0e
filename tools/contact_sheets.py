"""Draw what the performer can do: a page for each content with a row for each style, and one for each creature.

python tools/contact_sheets.py [CONTENT_OR_CREATURE ...]        (all when none is named; into out/sheets/)
"""

import sys
from pathlib import Path

import motionkit as mk
from motionkit import actor
from motionkit.actor import CONTENTS, performing
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES

FOLDER = Path(__file__).resolve().parent.parent / "out" / "sheets"
SECONDS = {"walk": 2.6, "walk_back": 3.0, "run": 1.8}  # what is shown; gestures are shown whole
STYLES = ("neutral", "proud", "tired", "angry")  # of creatures


def rows_of(name: str) -> tuple[list[mk.Motion], list[str]]:
    """The motions of one page, and what to write beside them."""
    if name in CONTENTS:
        made = [(actor.perform(name, style, seed=3, seconds=8), style) for style in TRAIN_STYLES + HELD_OUT_STYLES]
        return [_shown(name, p.motion) for p, _ in made], [style for _, style in made]
    can = performing.get_creature(name).contents
    wishes = [(content, style) for content in can for style in (STYLES if content == "walk" else STYLES[:1])]
    made = [actor.perform(content, style, seed=3, seconds=8, performer=name) for content, style in wishes]
    return [_shown(content, p.motion) for (content, _), p in zip(wishes, made)], [" ".join(wish) for wish in wishes]


def _shown(content: str, motion: mk.Motion) -> mk.Motion:
    return motion[: round(SECONDS.get(content, 6.0) * motion.fps)]


def main(names: list[str]) -> int:
    """Write a PNG for each of the named contents and creatures, or for all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names or (*CONTENTS, *performing.CREATURES):
        motions, labels = rows_of(name)
        path = FOLDER / f"{name}.png"
        mk.strip(motions, poses=12, labels=labels).savefig(path, dpi=60, bbox_inches="tight")
        print(path.relative_to(FOLDER.parent.parent))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
