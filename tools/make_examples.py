"""Make the example clips in data/actor, with the table of what they are.

python tools/make_examples.py [FOLDER]
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import motionkit as mk
from motionkit.actor import Performance, Performer, perform, performing, retell
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES

FOLDER = Path(__file__).resolve().parent.parent / "data" / "actor"
# content, style, seconds: quick styles hold a whole gesture in three seconds, slow ones need more
PEOPLE = (
    ("walk_turn_left", "neutral", 5),
    ("walk_turn_left", "childlike", 4),
    ("walk_turn_right", "strutting", 4),
    ("walk_back", "sneaky", 4),
    ("run", "neutral", 3),
    ("run", "angry", 3),
    ("jump", "neutral", 4),
    ("jump", "childlike", 4),
    ("kick", "angry", 3.5),
    ("punch", "robot", 4),
    ("wave", "proud", 5),
    ("raise_hands", "childlike", 4),
    ("bow", "old", 6),
    ("idle", "drunk", 4),
    ("idle", "neutral", 3),
    ("walk, jump, kick", "neutral", 9),
)
CREATURES = (
    ("dog", "trot", "neutral", 3),
    ("dog", "sit", "tired", 6.5),
    ("crab", "threat", "angry", 4),
    ("ostrich", "walk", "proud", 4),
    ("dragon", "walk", "neutral", 4),
    ("humanoid", "wave", "childlike", 4.5),
)


def clips() -> Iterator[tuple[Performance, tuple[str, ...], str, str]]:
    """Performances with sentences, who performs, and the take: one walk told in all styles, then all else."""
    walk = perform("walk", "neutral", seed=1, performer=Performer(seed=1), seconds=4)  # of usual height and build
    for style in TRAIN_STYLES + HELD_OUT_STYLES:
        told = retell(walk, style)
        yield told, told.captions, "person 01", "walk"
    for number, (content, style, seconds) in enumerate(PEOPLE, 2):
        made = perform(content, style, seed=number, performer=number, seconds=seconds)
        yield made, made.captions, f"person {number:02d}", made.motion.name
    for kind, content, style, seconds in CREATURES:
        made = performing.perform_creature(content, style, seed=1, creature=kind, seconds=seconds)
        yield made, made.captions, f"{kind} 01", made.motion.name


def main() -> int:
    """Write all clips and clips.csv, and take away the clips of an older set."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    index = folder / "clips.csv"
    if index.exists():
        for row in csv.DictReader(index.read_text(encoding="utf-8").splitlines()):
            (folder / row["file"]).unlink(missing_ok=True)
    lines = []
    for made, sentences, who, take in clips():
        name = made.motion.name.rpartition("_")[0] + ".bvh"
        mk.save(made.motion, folder / name)
        lines.append([name, made.content, made.style.name, "|".join(sentences), who, take])
    with index.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([["file", "content", "style", "text", "performer", "take"], *sorted(lines)])
    size = sum(path.stat().st_size for path in folder.iterdir())
    print(f"{folder}: {len(lines)} clips, {size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
