"""Sentences to learn words from: all that the kit's data sets could say of any content in any style."""

from __future__ import annotations

import random
from dataclasses import dataclass

from ..actor import captions as acted
from ..datasets import captions as captured
from ..text import words


@dataclass(frozen=True)
class Meaning:
    """Sentences that mean one content in one style."""

    content: str
    style: str
    texts: tuple[str, ...]


# Contents of captures whose words are made from their names (`datasets.captions.doing`).
_HANDS = tuple(f"{verb}-{side}" for verb in ("wave", "raise-up") for side in ("both-hands", "left-hand", "right-hand"))


def meanings(seed: int = 0) -> list[Meaning]:
    """All contents in all styles that there are words for, each meaning once.

    >>> found = meanings()
    >>> len(found) > 3000, min(len(one.texts) for one in found) >= 4
    (True, True)
    """
    styles = {words.STYLES[style].how[0]: style for style in sorted(words.STYLES, reverse=True)}
    return [
        Meaning(content, style, texts_of(content, style, seed))
        for content in sorted({*words.DEEDS, *_HANDS})
        for style in sorted(styles.values())
    ]


def texts_of(content: str, style: str, seed: int = 0) -> tuple[str, ...]:
    """Sentences for one content in one style, as captions of the performer and of captures have them, all different.

    >>> texts_of("walk-back", "old")[-1]
    'someone is stepping back in an old way'
    """
    deed, found = words.deed(content), ()
    if deed.ways:
        found = acted.captions(content.replace("-", "_"), style, seed, 6)
    if deed.captured or not deed.ways:
        found += captured.captions(*captured.doing(content), style)
    return tuple(dict.fromkeys(found))


def nonsense(chance: random.Random) -> str:
    """A sentence about something that nobody knows: real sentences around words that do not exist.

    >>> nonsense(random.Random(0)) != nonsense(random.Random(1))
    True
    """
    made = ["".join(chance.choice("bcdfghklmnprstvz") + chance.choice("aeiou") for _ in range(chance.randint(1, 4)))
            + chance.choice(("", "n", "r", "s", "t", "ck", "ll")) for _ in range(chance.randint(2, 5))]  # fmt: skip
    start = chance.choice(("a person is", "a person", "someone", "the", "somebody is", "he", "a", ""))
    return " ".join((start, *made)).strip()
