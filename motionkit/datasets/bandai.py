"""Bandai-Namco-Research-Motiondataset 1 and 2: where the clips are, and what their names and label files say.

Licence of the data: CC BY-NC 4.0, (c) Bandai Namco Research Inc. Cite Kobayashi et al. 2023, "Motion Capture
Dataset for Practical Use of AI-based Motion Editing and Stylization".
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable

from ..errors import MotionKitError
from .captions import captions, doing
from .places import File, Wanted, find, texts, unique
from .sources import Item, Labels

FILE_PREFIXES = {"bandai-1": "dataset-1", "bandai-2": "dataset-2"}
_ADDRESS = "https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset"

# The labels in the order of their numbers, as the data sets' own tables (cfg/*_label.txt) have them.
LABELS = {
    "bandai-1": {
        "content": "walk run dash walk-back walk-left walk-right bow bye guide byebye respond call punch kick slash "
        "dance-long dance-short",
        "style": "normal happy sad angry proud not-confident masculinity feminine childish old tired active musical "
        "giant chimpira",
    },
    "bandai-2": {
        "content": "walk walk-turn-left walk-turn-right run wave-both-hands wave-left-hand wave-right-hand "
        "raise-up-both-hands raise-up-left-hand raise-up-right-hand",
        "style": "active elderly exhausted feminine masculine normal youthful",
    },
}


def how_to_get(name: str) -> str:
    """What to do when the data are not there.

    >>> how_to_get("bandai-2")
    "get bandai-2 with datasets.fetch('bandai-2'), with `git clone https://github.com/Ban...
    """
    fetch = f"with datasets.fetch({name!r}), " if name == "bandai-2" else ""
    return (
        f"get {name} {fetch}with `git clone {_ADDRESS}` or as the zip from there (licence CC BY-NC 4.0), then give "
        f"datasets.load({name!r}, root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip"
    )


def labels(clip: str) -> Labels:
    """Content, style and sentences from a clip's name; each clip is a take of its own.

    >>> found = labels("dataset-2_wave-left-hand_elderly_001")
    >>> found.content, found.style, found.texts[0]
    ('wave-left-hand', 'elderly', 'a person is waving the left hand in old age')
    """
    content, style = clip.split("_")[1:3]
    return Labels(content, style, captions(*doing(content), style), take=clip)


def items(name: str, root: str | os.PathLike | None = None) -> list[Item]:
    """The clips of `bandai-1` or `bandai-2`, sorted by name, with labels from their names.

    root: a folder with the clips somewhere below it, or the archive's zip; see `places.find`. Where a clip's label
    file lies beside it, MotionKitError if that says something else than the name.

    >>> items("bandai-2", "data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of bandai-2 here (dataset-2_CONTENT_STYLE_NNN.bvh); ...
    """
    prefix = FILE_PREFIXES[name]
    clip = re.escape(prefix) + r"_[^_/\\]+_[^_/\\]+_\d+\."
    shape = f"{prefix}_CONTENT_STYLE_NNN.bvh"
    wanted = Wanted(name, re.compile(clip + "bvh"), shape, how_to_get(name), re.compile(clip + "json"))
    files = find(wanted, root)
    clips = unique(f for f in files if f.name.endswith(".bvh"))
    beside = {f.place.removesuffix(".bvh") + ".json" for f in clips}
    _check_numbers(name, [f for f in files if f.place in beside])
    return [Item(file.stem, labels(file.stem), file.bvh()) for file in clips]


def _check_numbers(name: str, files: Iterable[File]) -> None:
    """A MotionKitError unless each label file gives the numbers of the labels in its own name."""
    numbers = {kind: {label: n for n, label in enumerate(words.split())} for kind, words in LABELS[name].items()}
    for file, text in texts(files):
        try:
            found = dict(json.loads(text))
        except (ValueError, TypeError) as error:
            raise MotionKitError(
                f'{file.where}: expected label numbers such as {{"content": 6, "style": 2}}; found {text[:40]!r} '
                f"({error}); get the file again"
            ) from None
        for kind, label in zip(("content", "style"), file.stem.split("_")[1:3]):
            number, known = found.get(kind), numbers[kind]
            if kind not in found or (label not in known and number not in known.values()):
                continue  # someone's own clips may have labels of their own
            if number != known.get(label):
                told = next((f" ({word})" for word, n in known.items() if n == number), "")
                raise MotionKitError(
                    f"{file.where}: its name says {kind} {label!r}, which is number {known.get(label, 'of no other')}; "
                    f"it gives number {number!r}{told}; rename the clip or mend its label file"
                )


def _smpl_names() -> dict[str, str]:
    limbs = {"Shoulder": "collar", "UpperArm": "shoulder", "LowerArm": "elbow", "Hand": "wrist", "UpperLeg": "hip",
             "LowerLeg": "knee", "Foot": "ankle", "Toes": "foot"}  # fmt: skip
    trunk = {"Hips": "pelvis", "Spine": "spine1", "Chest": "spine3", "Neck": "neck", "Head": "head"}
    sides = {"L": "left", "R": "right"}
    return trunk | {f"{a}_{s}": f"{side}_{b}" for s, side in sides.items() for a, b in limbs.items()}


SMPL_NAMES = _smpl_names()  # its joints, and those of SMPL in the same places
