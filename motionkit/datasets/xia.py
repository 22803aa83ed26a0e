"""Xia et al. 2015, "Realtime Style Transfer for Unlabeled Heterogeneous Human Motion": eight styles, as BVH.

The file names are those of the copy that Aberman et al. 2020 (deep-motion-editing) trained on and that papers 1 and 2
use: STYLE_NN_VVV.bvh, where NN is one of 28 contents, counted from 1. Ask the authors about the licence of the data.
"""

from __future__ import annotations

import os
import re
from collections import Counter

from ..errors import MotionKitError
from .captions import captions
from .places import Wanted, find, unique
from .sources import Item, Labels

STYLES = ("angry", "childlike", "depressed", "neutral", "old", "proud", "sexy", "strutting")

_WALK = ("walking", "going on foot")
_LEFT = ("walking and turning left", "taking a left turn on foot")
_RIGHT = ("walking and turning right", "taking a right turn on foot")
_JUMP = ("jumping", "leaping up")
_LEFT_HAND = ("punching with the left hand", "throwing a left punch")
_RIGHT_HAND = ("punching with the right hand", "throwing a right punch")
# For each number from 1 on: content, and what someone is doing, twice in different words.
CONTENTS = (
    ("walk", _WALK),
    ("walk", _WALK),
    ("walk", _LEFT),
    ("walk", _RIGHT),
    ("walk", _LEFT),
    ("walk", _LEFT),
    ("walk", _WALK),
    ("walk", _WALK),
    ("walk", _RIGHT),
    ("walk", _LEFT),
    ("walk", _RIGHT),
    ("walk", _LEFT),
    ("run", ("running", "jogging along")),
    ("run", ("running and turning left", "taking a left turn at a run")),
    ("run", ("running and turning right", "taking a right turn at a run")),
    ("jump", _JUMP),
    ("jump", _JUMP),
    ("punch", _RIGHT_HAND),
    ("punch", _LEFT_HAND),
    ("punch", _RIGHT_HAND),
    ("punch", _LEFT_HAND),
    ("kick", ("kicking with the left leg", "throwing a left kick")),
    ("kick", ("kicking with the right leg", "throwing a right kick")),
    ("trans", ("jumping and then walking", "going from a jump into a walk")),
    ("trans", ("walking and then jumping", "going from a walk into a jump")),
    ("trans", ("punching and then kicking", "going from a punch into a kick")),
    ("trans", ("walking and then punching", "going from a walk into a punch")),
    ("trans", ("running and then jumping", "going from a run into a jump")),
)
_TESTED = {"walk": 3, "run": 1, "jump": 1, "kick": 1, "punch": 1, "trans": 0}  # clips of each style

_WANTED = Wanted(
    "xia",
    re.compile(r"[A-Za-z-]+_\d+_\d+\.bvh"),
    "STYLE_NN_VVV.bvh",
    "get the BVH files that github.com/DeepMotionEditing/deep-motion-editing links to for style transfer, then give "
    "datasets.load('xia', root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip",
)


def labels(clip: str) -> Labels:
    """Content, style and sentences from a clip's name; each clip is a take of its own.

    Raises MotionKitError for a style or number that the data set does not have.

    >>> found = labels("depressed_13_000")
    >>> found.content, found.style, found.texts[0]
    ('run', 'depressed', 'a person is running in depression')
    """
    style, number, _ = clip.split("_")
    if style not in STYLES:
        raise MotionKitError(
            f"{clip}: the file's name says style {style!r}; xia has {', '.join(STYLES)}; rename the clip"
        )
    if not 1 <= int(number) <= len(CONTENTS):
        raise MotionKitError(
            f"{clip}: the file's name says content number {number}; xia has 1 to {len(CONTENTS)}; rename the clip"
        )
    content, doing = CONTENTS[int(number) - 1]
    return Labels(content, style, captions(*doing, style), take=clip)


def items(name: str = "xia", root: str | os.PathLike | None = None) -> list[Item]:
    """The clips, sorted by name, with the split of Aberman et al. 2020.

    root: a folder with the clips somewhere below it, or a zip; see `places.find`. The test part is, of each style, the
    first three walks and the first run, jump, kick and punch in the order of names; the rest is for training. So it is
    theirs only where all clips are there. Raises MotionKitError for a name that does not fit.

    >>> items(root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of xia here (STYLE_NN_VVV.bvh); ...
    """
    seen: Counter[tuple[str, str]] = Counter()
    found = []
    for file in unique(find(_WANTED, root)):
        what = labels(file.stem)
        seen[what[:2]] += 1
        split = "test" if seen[what[:2]] <= _TESTED[what.content] else "train"
        found.append(Item(file.stem, what._replace(split=split), file.bvh()))
    return found
