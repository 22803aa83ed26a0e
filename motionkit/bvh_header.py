"""The HIERARCHY part of a BVH file: text to joints with names, parents, offsets and channels, and back."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import count

from .errors import MotionKitError
from .skeleton import POSITION_CHANNELS

ROTATION_CHANNELS = ("Xrotation", "Yrotation", "Zrotation")
LARGEST = 1e9  # numbers beyond this are no offsets, places or angles, and would overflow further on
_CHANNELS = {c.lower(): c for c in POSITION_CHANNELS + ROTATION_CHANNELS}
_NEWLINE = re.compile(r"\r\n?|\n")
# a brace, a heading with the rest of its line (names may hold spaces), or a word
_TOKEN = re.compile(r"[{}]|(?:ROOT|JOINT|END)(?![^\s{}])[^{}\r\n]*|[^\s{}]+", re.IGNORECASE)
_HEADING = re.compile(r"(ROOT|JOINT|END)(?!\S)(.*)", re.IGNORECASE)
_OFFSET = re.compile(r"(?<![^\s{}])OFFSET[ \t]+([-+.\deE]+)[ \t]+([-+.\deE]+)[ \t]+([-+.\deE]+)(?![^\s{}])")
_MOST_JOINTS = 4096  # far above any character; a guard against files that only nest


@dataclass
class Header:
    """Joints as the file lists them; offsets in the file's own unit."""

    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[tuple[float, float, float]] = field(default_factory=list)
    channels: list[tuple[str, ...]] = field(default_factory=list)
    end_sites: list[tuple[int, tuple[float, float, float]]] = field(default_factory=list)

    @property
    def channel_count(self) -> int:
        """Numbers on each line of motion data."""
        return sum(map(len, self.channels))

    def channel_at(self, column: int) -> tuple[str, str]:
        """The joint's name and the channel's name of one column of the motion data."""
        return [(n, c) for n, cs in zip(self.names, self.channels, strict=True) for c in cs][column]


class _Reader:
    """Walks the tokens of a header once, keeping the open joints on a stack."""

    def __init__(self, text: str, source: str) -> None:
        self.text, self.source = text, source
        self.tokens = _TOKEN.findall(text)
        self.at = 0
        self.header = Header()
        self.open: list[int | None] = []  # numbers of open joints; None is an End Site
        self.has: list[set[str]] = []  # what each open block has stated so far

    def fail(self, what: str, at: int | None = None) -> MotionKitError:
        """An error at token `at` (left out: the present one); only here are places in the text looked up."""
        wanted = min(self.at if at is None else at, len(self.tokens) - 1)
        places = (m.start() for n, m in enumerate(_TOKEN.finditer(self.text)) if n == wanted)
        line = len(_NEWLINE.findall(self.text, 0, next(places, 0))) + 1
        return MotionKitError(f"{self.source}, line {line}: {what}")

    def peek(self) -> str:
        try:
            return self.tokens[self.at]
        except IndexError:
            raise self.fail(
                "the file ends in the middle of the hierarchy; it seems to be cut off, get it again"
            ) from None

    def name_until_brace(self, name: str) -> str:
        """The name that a heading such as `JOINT left hand` gives, or the line below it, up to `{`."""
        name = name.strip()
        if not name and self.peek() != "{":
            name = self.peek().strip()
            self.at += 1
        if self.peek() != "{":
            raise self.fail(f"expected '{{' after the joint's name; found {self.peek()[:40]!r}")
        self.at += 1
        return name

    def numbers(self, count: int, what: str) -> tuple[float, ...]:
        words = self.tokens[self.at : self.at + count]
        try:
            values = tuple(map(float, words))
        except ValueError:
            values = ()
        if len(values) < count or not all(abs(v) <= LARGEST for v in values) or "_" in "".join(words):
            wrong = next((n for n, w in enumerate(words) if not _is_number(w)), len(words))
            found = repr(words[wrong][:40]) if wrong < len(words) else "the end of the hierarchy"
            raise self.fail(f"{what} needs {count} finite numbers up to {LARGEST:g}; found {found}", self.at + wrong)
        self.at += count
        return values

    def open_joint(self, name: str, root: bool) -> None:
        header = self.header
        if root and self.open:
            raise self.fail("a ROOT inside another joint; expected JOINT or a closing '}' before it", self.at - 1)
        if root and header.names:
            raise self.fail(
                f"a second character starts here (the first has the root {header.names[0]!r}); the kit reads "
                "one character a file: save each character to a file of its own",
                self.at - 1,
            )
        if not root and (not self.open or self.open[-1] is None):
            what = "a JOINT outside of any joint; expected ROOT first, and no joint inside an End Site"
            raise self.fail(what, self.at - 1)
        if len(header.names) >= _MOST_JOINTS:
            raise self.fail(f"more than {_MOST_JOINTS} joints; this is no character", self.at - 1)
        header.names.append(self.name_until_brace(name) or f"joint{len(header.names)}")
        header.parents.append(self.open[-1] if self.open else -1)
        header.offsets.append((0.0, 0.0, 0.0))
        header.channels.append(())
        self.open.append(len(header.names) - 1)
        self.has.append(set())

    def open_end_site(self, name: str) -> None:
        if not self.open or self.open[-1] is None:
            raise self.fail("an End Site outside of any joint", self.at - 1)
        self.name_until_brace(name)
        self.open.append(None)
        self.has.append(set())

    def once(self, what: str) -> None:
        if not self.open:
            raise self.fail(f"{what} outside of any joint", self.at - 1)
        if what in self.has[-1]:
            raise self.fail(f"a second {what} in one joint", self.at - 1)
        self.has[-1].add(what)

    def offset(self) -> None:
        self.once("OFFSET")
        values = self.numbers(3, "OFFSET")
        if self.open[-1] is None:
            self.header.end_sites.append((self.open[-2], values))
        else:
            self.header.offsets[self.open[-1]] = values

    def channel_list(self) -> None:
        self.once("CHANNELS")
        if self.open[-1] is None:
            raise self.fail("CHANNELS inside an End Site; only joints have channels", self.at - 1)
        word = self.peek()
        if word not in ("0", "1", "2", "3", "4", "5", "6"):
            raise self.fail(f"CHANNELS needs a count from 0 to 6; found {word[:40]!r}")
        self.at += 1
        names: list[str] = []
        for _ in range(int(word)):
            name = _CHANNELS.get(self.peek().lower())
            if name is None or name in names:
                problem = "appears twice" if name else "is not known"
                expected = f"expected {word} different ones of {', '.join(_CHANNELS.values())}"
                raise self.fail(f"channel {self.peek()[:40]!r} {problem}; {expected}")
            names.append(name)
            self.at += 1
        self.header.channels[self.open[-1]] = tuple(names)

    def close(self) -> None:
        if not self.open:
            raise self.fail("a '}' that closes nothing", self.at - 1)
        joint = self.open.pop()
        if "OFFSET" not in self.has.pop():
            name = "an End Site" if joint is None else f"joint {self.header.names[joint]!r}"
            raise self.fail(f"{name} ends without an OFFSET", self.at - 1)

    def read(self) -> Header:
        if not self.tokens or self.tokens[0].upper() != "HIERARCHY":
            raise self.fail("expected the word HIERARCHY; this is no BVH file")
        self.at, count = 1, len(self.tokens)
        while self.at < count:
            token = self.tokens[self.at]
            word = token.upper()
            self.at += 1
            if word == "OFFSET":
                self.offset()
            elif word == "CHANNELS":
                self.channel_list()
            elif word == "}":
                self.close()
            elif (heading := _HEADING.match(token)) is None:
                what = f"expected JOINT, End Site, OFFSET, CHANNELS or '}}'; found {token[:40]!r}"
                raise self.fail(what, self.at - 1)
            elif word.startswith("END"):
                self.open_end_site(heading[2])
            else:
                self.open_joint(heading[2], word.startswith("ROOT"))
        if self.open or not self.header.names:
            raise self.fail("the hierarchy is not closed before MOTION; a '}' is missing or the file is cut off")
        return self.header


def _is_number(word: str) -> bool:
    """Whether a word is a finite number of a size that offsets have."""
    try:
        return abs(float(word)) <= LARGEST and "_" not in word
    except ValueError:
        return False


def parse_header(text: str, source: str) -> Header:
    """The hierarchy from its text; MotionKitError names `source` and the line of what is wrong.

    The clips of a dataset mostly differ in their offsets alone, so what else a hierarchy says is read once and kept.

    >>> parse_header("HIERARCHY ROOT Hips { OFFSET 0 1 0 CHANNELS 1 Xrotation }", "walk.bvh").names
    ['Hips']
    """
    number = count()
    shape = _OFFSET.sub(lambda _: f"OFFSET {next(number)} 0 0", text)
    try:
        known = _read_shape(shape)
        offsets = [tuple(map(float, words)) for words in _OFFSET.findall(text)]
    except (MotionKitError, ValueError):
        return _read(text, source)  # again, to name the line
    fits = len(offsets) == len(known.names) + len(known.end_sites)
    if not fits or not all(abs(x) <= LARGEST for offset in offsets for x in offset):
        return _read(text, source)
    return Header(
        list(known.names),
        list(known.parents),
        [offsets[int(n)] for n, _, _ in known.offsets],
        list(known.channels),
        [(joint, offsets[int(n)]) for joint, (n, _, _) in known.end_sites],
    )


@lru_cache(64)
def _read_shape(text: str) -> Header:
    """A hierarchy in which each OFFSET holds its own number, counted from 0, instead of a place."""
    return _read(text, "")


def _read(text: str, source: str) -> Header:
    header = _Reader(text, source).read()
    if len(set(header.names)) < len(header.names):
        header.names = _distinct(header.names)
    return header


def _distinct(names: list[str]) -> list[str]:
    """Repeated names numbered (`hand`, `hand#2`): some exporters repeat them; here names are looked up.

    >>> _distinct(["hand", "hand", "hand#2"])
    ['hand', 'hand#3', 'hand#2']
    """
    taken, seen, result = set(names), set(), []
    copies: dict[str, int] = {}
    for name in names:
        unique = name
        while unique in seen:
            copies[name] = copies.get(name, 1) + 1
            candidate = f"{name}#{copies[name]}"
            unique = name if candidate in taken else candidate
        seen.add(unique)
        result.append(unique)
    return result
