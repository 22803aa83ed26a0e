"""The unit of length of a BVH file, which no file states: a guess from how tall the skeleton is."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import lru_cache
from itertools import count, islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from . import rotations as rot
from .errors import MotionKitError, motion_inside
from .files import MotionKitWarning, read_bytes, write_atomic
from .motion import Motion
from .skeleton import POSITION_CHANNELS, Skeleton

# Sizes (as `Skeleton.height`, in file units) up to which a file is taken to be in that unit.
_UNIT_GUESSES = ((5.0, 1.0), (45.0, 0.056444), (450.0, 0.01), (float("inf"), 0.001))


def guess_metres_per_unit(skeleton: Skeleton, unit: float = 1.0) -> float:
    """Metres a unit, guessed for a skeleton written in units of `unit` metres; see `load` for the steps.

    >>> import torch
    >>> guess_metres_per_unit(Skeleton(("a", "b"), (-1, 0), torch.tensor([[0.0, 90, 0], [0.0, 80, 0]])))
    0.01
    """
    size = (skeleton.height or float(skeleton.offsets.norm(dim=-1).max())) / unit
    return next(metres for limit, metres in _UNIT_GUESSES if size <= limit) if size else 1.0


_BLOCK = 1 << 16  # bytes at a time: small enough that working arrays are reused and stay in the processor's cache
_WORD_BYTES = 8  # characters of a 64-bit word
_LONGEST = 16  # digits before or after the dot; more are left to `float`
_MOST_DIGITS = 15  # integers up to 10^15 are exact doubles
_POWERS = 10.0 ** np.arange(_MOST_DIGITS + 1)
_SPACE = re.compile(rb"[\t-\r ]")
_ZEROS = np.uint64(0x3030303030303030)  # "00000000"
_OVER_NINE = np.uint64(0x7676767676767676)  # added to a byte, it reaches the top bit from 10 up
_TOP_BITS = np.uint64(0x8080808080808080)
_LAST = np.array([(~0 << 8 * (_WORD_BYTES - n)) & 0xFFFFFFFFFFFFFFFF for n in range(_WORD_BYTES + 1)], np.uint64)


class BadNumber(Exception):
    """A piece of text that is no number; `offset` is the byte at which it starts."""

    def __init__(self, offset: int, text: str) -> None:
        super().__init__(text)
        self.offset, self.text = offset, text


def parse_numbers(text: bytes, start: int = 0) -> np.ndarray:
    """All numbers of a text from byte `start` on, separated by white space, as float64 [N].

    Each equals what Python's `float` makes of it. Raises BadNumber at the first piece of text that is no number.

    >>> parse_numbers(b"1 -2.5\\t3e2\\r\\n")
    array([  1. ,  -2.5, 300. ])
    """
    parts = []
    while start < len(text):
        stop = min(start + _BLOCK, len(text))
        gap = _SPACE.search(text, stop)  # never cut a number in two
        stop = gap.start() if gap else len(text)
        parts.append(_parse_block(text, start, stop))
        start = stop
    return np.concatenate(parts) if parts else np.empty(0)


def _parse_block(text: bytes, start: int, stop: int) -> np.ndarray:
    padded = np.full(stop - start + _LONGEST + 1, 32, np.uint8)  # spaces before, to read words that end early
    padded[_LONGEST:-1] = np.frombuffer(text, np.uint8, stop - start, start)
    space = (padded - np.uint8(9) < 5) | (padded == 32)  # tab to carriage return, and space
    edges = np.flatnonzero(space[1:] != space[:-1]) + 1
    starts, ends = edges[::2], edges[1::2]
    values, odd = _plain_decimals(padded, starts, ends)
    for n in np.flatnonzero(odd):
        word = padded[starts[n] : ends[n]].tobytes()
        try:
            if b"_" in word:
                raise ValueError
            values[n] = float(word)
        except ValueError:
            raise BadNumber(start + int(starts[n]) - _LONGEST, word[:40].decode("latin-1")) from None
    return values


def _plain_decimals(padded: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values [N], and which of them [N] are not plain decimals and still have to be read."""
    dots = _find_dots(padded, starts, ends)
    sign = padded[starts]
    negative = sign == ord("-")
    before = dots - starts - (negative | (sign == ord("+")))
    after = np.maximum(ends - dots - 1, 0)
    odd = (before + after > _MOST_DIGITS) | (before + after == 0)
    before[odd] = after[odd] = 0
    whole, wrong = _digits(padded, dots, before)
    fraction, wrong_too = _digits(padded, ends, after)
    power = _POWERS[after]
    values = (whole * power + fraction) / power  # all but the division is exact
    return np.where(negative, -values, values), odd | wrong | wrong_too


def _find_dots(padded: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Where the decimal dot of each number is (the last one, if several); its end where it has none."""
    dots = np.flatnonzero(padded == ord("."))
    if len(dots) == len(starts) and (dots >= starts).all() and (dots < ends).all():
        return dots
    found = ends.copy()
    found[np.searchsorted(starts, dots, "right") - 1] = dots
    return found


def _digits(padded: np.ndarray, stops: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The integers [N] that the `counts` (0 to 16) characters before `stops` spell, and which are no digits."""
    words = np.ndarray(len(padded) - _WORD_BYTES + 1, "<u8", padded, strides=(1,))  # a word starts at every byte
    word = (words[stops - _WORD_BYTES] ^ _ZEROS) & _LAST[np.minimum(counts, _WORD_BYTES)]
    wrong = ((word + _OVER_NINE) | word) & _TOP_BITS != 0
    word = (word * np.uint64(10 * 2**8 + 1)) >> np.uint64(8)
    word = ((word & np.uint64(0x00FF00FF00FF00FF)) * np.uint64(100 * 2**16 + 1)) >> np.uint64(16)
    word = ((word & np.uint64(0x0000FFFF0000FFFF)) * np.uint64(10000 * 2**32 + 1)) >> np.uint64(32)
    value = word.astype(np.float64)
    more = np.flatnonzero(counts > _WORD_BYTES)
    if len(more):
        high, wrong_high = _digits(padded, stops[more] - _WORD_BYTES, counts[more] - _WORD_BYTES)
        value[more] += high * 1e8
        wrong[more] |= wrong_high
    return value, wrong


def compose(angles: Tensor, axes: list[str]) -> Tensor:
    """Zero to three turns about different axes, in turn: radians [..., n] to unit quaternions [..., 4].

    >>> compose(torch.tensor([torch.pi]), ["Y"]).abs().round(decimals=3)
    tensor([0., 0., 1., 0.])
    """
    half = (angles / 2).movedim(-1, 0).contiguous()  # one plane an angle
    cosine, sine = torch.cos(half), torch.sin(half)
    w = torch.ones_like(angles[..., :1].sum(-1))
    planes = [w, torch.zeros_like(w), torch.zeros_like(w), torch.zeros_like(w)]
    for c, s, axis in zip(cosine, sine, axes, strict=True):
        k = 1 + rot.AXES[axis]
        i, j = k % 3 + 1, (k + 1) % 3 + 1  # the axes that follow k in the cycle x y z
        w, qi, qj, qk = (planes[n] for n in (0, i, j, k))
        planes[0], planes[k] = w * c - qk * s, qk * c + w * s
        planes[i], planes[j] = qi * c + qj * s, qj * c - qi * s
    return torch.stack(planes, -1)


def decompose(q: Tensor, axes: list[str]) -> Tensor:
    """The turns about zero to three axes that give, or come close to, rotations [..., 4]; radians [..., n].

    >>> decompose(rot.yaw_to_quaternion(torch.tensor([0.5])), ["Y"])
    tensor([[0.5000]])
    """
    if len(axes) == 3:
        return rot.quaternion_to_euler(q, "".join(axes))
    if not axes:
        return q[..., :0]
    # Without a third turn there is no gimbal lock: each angle shows on a vector that the other leaves alone.
    i = rot.AXES[axes[0]]
    j = rot.AXES[axes[1]] if len(axes) == 2 else (i + 1) % 3
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = rot.quaternion_to_matrix(q)
    first = torch.atan2(sign * m[..., k, j], m[..., j, j])
    second = torch.atan2(sign * m[..., i, k], m[..., i, i])
    return torch.stack((first, second), -1)[..., : len(axes)]


def layouts(channels: Sequence[tuple[str, ...]]) -> dict[tuple[str, ...], tuple[list[int], list[int]]]:
    """For each different list of channels the joints that have it, and their columns.

    >>> layouts([("Xrotation",), ("Zrotation", "Xrotation"), ("Xrotation",)])
    {('Xrotation',): ([0, 2], [0, 3]), ('Zrotation', 'Xrotation'): ([1], [1, 2])}
    """
    found: dict[tuple[str, ...], tuple[list[int], list[int]]] = {}
    first = 0
    for joint, layout in enumerate(channels):
        joints, columns = found.setdefault(layout, ([], []))
        joints.append(joint)
        columns.extend(range(first, first + len(layout)))
        first += len(layout)
    return found


ROTATION_CHANNELS = ("Xrotation", "Yrotation", "Zrotation")
LARGEST = 1e9  # numbers beyond this are no offsets, places or angles, and would overflow further on
_CHANNELS = {c.lower(): c for c in POSITION_CHANNELS + ROTATION_CHANNELS}
_NEWLINE_TEXT = re.compile(r"\r\n?|\n")
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
        line = len(_NEWLINE_TEXT.findall(self.text, 0, next(places, 0))) + 1
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


_FRAMES = re.compile(rb"\s*Frames\s*:[ \t]*(\S*)", re.IGNORECASE)
_FRAME_TIME = re.compile(rb"\s*Frame[ \t]*Time\s*:[ \t]*(\S*)", re.IGNORECASE)
_NEWLINE = re.compile(rb"\r\n?|\n")
_WORD = re.compile(rb"\S+")


def line_at(data: bytes, offset: int) -> int:
    """The number of the line, from 1, that byte `offset` is on.

    >>> line_at(b"one\\r\\ntwo\\rthree", 12)
    3
    """
    return len(_NEWLINE.findall(data, 0, offset)) + 1


def read_data(data: bytes, start: int, header: Header, source: str, fps: float | None) -> tuple[np.ndarray, float]:
    """What follows MOTION, from byte `start` on: the numbers, float64 [F, C] in file units and degrees, and fps.

    fps: a rate in place of the file's own. Raises MotionKitError naming `source` and line; warns where
    `Frames:` and the data disagree.
    """
    count, place = _field(_FRAMES, "Frames:", data, start, source)
    time, start = _field(_FRAME_TIME, "Frame Time:", data, place, source)
    try:
        frames = int(count)
        fine = 0 <= frames < 1e18 and "_" not in count
    except ValueError:
        fine = False
    if not fine:
        where = f"{source}, line {line_at(data, place)}"
        raise MotionKitError(f"{where}: 'Frames:' needs a whole number from 0 up; found {count!r}")
    rate = float(fps) if fps is not None else _rate(time)
    if rate is None:
        where = f"{source}, line {line_at(data, start)}"
        raise MotionKitError(f"{where}: 'Frame Time:' needs seconds above 0; found {time!r}; give load(..., fps=30)")
    return _rows(data, start, frames, header, source), rate


def _field(pattern: re.Pattern, what: str, data: bytes, start: int, source: str) -> tuple[str, int]:
    """The word after a heading such as `Frames:`, and where it ends."""
    match = pattern.match(data, start)
    if match is None:
        found = _WORD.search(data, start)
        where = f"{source}, line {line_at(data, found.start() if found else len(data))}"
        shown = repr(found[0][:40].decode("latin-1")) if found else "the end of the file"
        raise MotionKitError(f"{where}: expected '{what}' and a number after MOTION; found {shown}")
    return match[1][:40].decode("latin-1"), match.end()


def _rate(word: str) -> float | None:
    """Frames a second from a frame time as written, or None if it is none: 0.0333333 means 30, not 30.00003.

    A whole number is taken where the last digit written leaves it open.

    >>> _rate("0.0333333"), _rate("0.04"), _rate("0")
    (30.0, 25.0, None)
    """
    try:
        seconds = float(word)
    except ValueError:
        return None
    if not 1e-6 < seconds < 1e6 or "_" in word:
        return None
    step = 10.0 ** Decimal(word).as_tuple().exponent
    whole = round(1 / seconds)
    return float(whole) if whole and abs(1 / whole - seconds) < min(step, 5e-4 * seconds) else 1 / seconds


def _rows(data: bytes, start: int, frames: int, header: Header, source: str) -> np.ndarray:
    """The numbers of all frames, float64 [F, C], checked."""
    width = header.channel_count
    if width == 0:
        raise MotionKitError(f"{source}: no joint has channels, so nothing can move; export the motion with channels")
    try:
        numbers = parse_numbers(data, start)
    except BadNumber as bad:
        line = line_at(data, bad.offset)
        raise MotionKitError(f"{source}, line {line}: expected a number; found {bad.text!r}") from None
    rows = len(numbers) // width
    if len(numbers) % width or rows == 0 < frames or rows <= frames and _ends_inside_number(data, start, width):
        raise MotionKitError(_cut_off(data, start, frames, len(numbers), width, source))
    if rows != frames:
        what = f"{source}: 'Frames: {frames}' disagrees with the data, which have {rows}; read {rows}"
        warnings.warn(what, MotionKitWarning, 5)
    if not max(numbers.max(initial=0), -numbers.min(initial=0)) <= LARGEST:  # also where one is NaN
        first = int((~(np.abs(numbers) <= LARGEST)).argmax())
        joint, channel = header.channel_at(first % width)
        where = f"{source}, line {_line_of_number(data, start, first)}, frame {first // width}"
        raise MotionKitError(
            f"{where}: {channel} of joint {joint!r} is {numbers[first]:g}; expected a finite number up to "
            f"{LARGEST:g}: cut this frame out or fill it from its neighbours"
        )
    return numbers.reshape(rows, width)


def _ends_inside_number(data: bytes, start: int, width: int) -> bool:
    """Whether the file is cut off inside its last number: no line end, and fewer decimals than all before."""
    if data.endswith((b"\n", b"\r")):
        return False
    words = data[start:].rsplit(None, 2 * width)[-2 * width :]
    decimals = [len(w.partition(b".")[2]) for w in words]
    fixed = len(set(decimals[:-1])) == 1 and decimals[0] >= 3  # written with so many decimals always
    return fixed and decimals[-1] < decimals[0]


def _line_of_number(data: bytes, start: int, index: int) -> int:
    return line_at(data, next(islice(_WORD.finditer(data, start), index, None)).start())


def _cut_off(data: bytes, start: int, frames: int, count: int, width: int, source: str) -> str:
    """What to say of data whose numbers do not fill whole frames; names the first line that is off."""
    lines = [len(line.split()) for line in _NEWLINE.split(data[start:])]
    filled = [n for n, found in enumerate(lines) if found]
    line, told = line_at(data, len(data)), ""
    if filled and (len(filled) == 1 or width in lines):  # a frame a line; otherwise lines are wrapped anyhow
        wrong = next((n for n in filled if lines[n] != width), filled[-1])
        line, told = line_at(data, start) + wrong, f"{lines[wrong]} on this line and "
    return (
        f"{source}, line {line}: expected {frames} frames of {width} numbers; found {told}{count} numbers in "
        "all; the file is cut off or its channels do not fit: export it again"
    )


_SAME_TURN = 1e-5  # radians; a rotation that a joint's own channels give this closely needs no further channel


def save(motion: Motion, path: str | os.PathLike) -> Path:
    """Write a BVH file that other tools read, in the motion's own unit; `load(save(m))` is the motion again.

    Joint names, hierarchy, End Sites, channels and their order, frame rate and unit are kept. A joint gets
    channels that it did not have only where the motion needs them. As braces nest, the file lists joints branch by
    branch, whatever their order in the skeleton. The file is written whole or not at all. Returns the path. Warns
    (MotionKitWarning) where `load` would guess another unit than the motion's. Raises MotionKitError if it cannot
    be written, a joint's name does not fit into a BVH file, or the path does not end in .bvh.

    >>> import tempfile
    >>> from motionkit.bvh import load
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = load(save(load("data/actor/walk_neutral.bvh"), folder + "/again.bvh"))
    >>> len(again)
    120
    """
    if not isinstance(motion, Motion):
        hint = motion_inside(motion)
        raise MotionKitError(f"save(motion, path): expected a Motion first; found {type(motion).__name__}{hint}")
    if isinstance(path, str | os.PathLike) and str(path) and Path(path).suffix.lower() != ".bvh":
        raise MotionKitError(f"{path}: what is written is a BVH file; let its name end in .bvh")
    text = format_bvh(motion)
    unit = motion.metres_per_unit
    guess = guess_metres_per_unit(motion.skeleton, unit)
    if not math.isclose(guess, unit, rel_tol=1e-3):
        warnings.warn(
            f"{path}: one unit of this file is {unit:g} m, but from its size {guess:g} m would be guessed: "
            f"read it with load(..., metres_per_unit={unit:g})",
            MotionKitWarning,
            2,
        )
    return write_atomic(path, text)


def format_bvh(motion: Motion) -> str:
    """The text of a BVH file; see `save`.

    >>> from motionkit.bvh import load
    >>> print(format_bvh(load("data/actor/walk_neutral.bvh")[:1])[:9])
    HIERARCHY
    """
    channels = _writable_channels(motion)
    header = format_header(motion.skeleton, channels, motion.metres_per_unit)
    values = _values(motion, channels)
    broken = (~values.isfinite()).any(1).nonzero()
    if len(broken):
        raise MotionKitError(
            f"motion {motion.name!r}: frame {int(broken[0])} holds numbers that are not finite, which no file can hold"
        )
    rows = values.tolist()
    line = " ".join([f"%.{_decimals(motion)}f"] * sum(map(len, channels)))
    body = "".join(line % tuple(row) + "\n" for row in rows)
    return f"{header}\nMOTION\nFrames: {len(motion)}\nFrame Time: {_frame_time(motion.fps)}\n{body}"


def _values(motion: Motion, channels: list[tuple[str, ...]]) -> Tensor:
    """What the channels hold, float64 [F, C]: degrees, and places in the motion's unit."""
    order = _file_order(motion.skeleton)
    values = torch.empty(len(motion), sum(map(len, channels)), dtype=torch.float64)
    for layout, (members, columns) in layouts([channels[j] for j in order]).items():
        joints = [order[n] for n in members]
        axes = [c[0] for c in layout if c not in POSITION_CHANNELS]
        angles = torch.rad2deg(decompose(motion.rotations[:, joints].double(), axes))
        places = motion.translations[:, joints].double() / motion.metres_per_unit
        parts = [
            places[..., POSITION_CHANNELS.index(c)] if c in POSITION_CHANNELS else angles[..., axes.index(c[0])]
            for c in layout
        ]
        if parts:
            values[:, columns] = torch.stack(parts, -1).flatten(1)
    return values


def _file_order(skeleton: Skeleton) -> list[int]:
    """Joint numbers as nested braces can hold them: a joint's whole branch before its next sibling."""
    order, waiting = [], [0]
    while waiting:
        order.append(waiting.pop())
        waiting.extend(reversed(skeleton.children[order[-1]]))
    return order


def _decimals(motion: Motion) -> int:
    """Six, as most tools write; more where the unit is so large that six would be coarse."""
    size = motion.skeleton.height / motion.metres_per_unit
    return 6 if size >= 0.1 or size <= 0 else min(6 - math.floor(math.log10(size)), 15)


def _frame_time(fps: float) -> str:
    return f"{1 / fps:.9f}" if fps < 1000 else f"{1 / fps:.15f}"


def _writable_channels(motion: Motion) -> list[tuple[str, ...]]:
    """The skeleton's channels, and what this motion needs besides: positions in front, rotations behind."""
    skeleton = motion.skeleton
    drift = (
        (motion.translations - skeleton.offsets).abs().amax(0) if len(motion) else torch.zeros_like(skeleton.offsets)
    )
    adrift = (drift > 1e-5 * skeleton.height).tolist()
    result: list[tuple[str, ...]] = [()] * len(skeleton)
    for names, (joints, _) in layouts(skeleton.channels).items():
        axes = [c[0] for c in names if c not in POSITION_CHANNELS]
        spare = tuple(f"{x}rotation" for x in "ZXY" if x not in axes)
        q = motion.rotations[:, joints].double()
        turned = rot.quaternion_angle(compose(decompose(q, axes), axes), q) > _SAME_TURN
        for joint, more in zip(joints, turned.any(0).tolist(), strict=True):
            places = tuple(c for n, c in enumerate(POSITION_CHANNELS) if c not in names and adrift[joint][n])
            result[joint] = places + names + (spare if more else ())
    if not any(result):  # a file without any channel has nothing to hold its frames
        result[0] = ("Zrotation", "Xrotation", "Yrotation")
    return result


def format_header(skeleton: Skeleton, channels: list[tuple[str, ...]], unit: float = 1.0) -> str:
    """A hierarchy as BVH text, from HIERARCHY to the last closing brace; offsets in units of `unit` metres.

    >>> s = Skeleton(("Hips",), (-1,), torch.tensor([[0.0, 1.0, 0.0]]), end_sites=((0, (0.0, 2.0, 0.0)),))
    >>> print(format_header(s, [("Xrotation",)]))
    HIERARCHY
    ROOT Hips
    {
        OFFSET 0.000000 1.000000 0.000000
        CHANNELS 1 Xrotation
        End Site
        {
            OFFSET 0.000000 2.000000 0.000000
        }
    }
    """
    lines: list[str] = ["HIERARCHY"]
    open_joints: list[int] = []
    offsets = (skeleton.offsets.double() / unit).tolist()
    ends: dict[int, list] = {}
    for joint, offset in skeleton.end_sites:
        ends.setdefault(joint, []).append([x / unit for x in offset])

    def add(*rows: str) -> None:
        lines.extend("    " * min(len(open_joints), 40) + row for row in rows)

    for joint in _file_order(skeleton):
        _close_to(skeleton.parents[joint], open_joints, add)
        add(f"{'JOINT' if joint else 'ROOT'} {_checked_name(skeleton.names[joint])}", "{")
        open_joints.append(joint)
        add(_offset(offsets[joint]), " ".join(("CHANNELS", str(len(channels[joint])), *channels[joint])))
        for offset in ends.get(joint, ()):
            add("End Site", "{", "    " + _offset(offset), "}")
    _close_to(-1, open_joints, add)
    return "\n".join(lines)


def _close_to(parent: int, open_joints: list[int], add: Callable[[str], None]) -> None:
    while open_joints and open_joints[-1] != parent:
        open_joints.pop()
        add("}")


def _offset(offset: list[float]) -> str:
    """An OFFSET line; at least seven digits, however small the number."""
    size = max(map(abs, offset))
    decimals = 6 if size >= 0.1 or size == 0 else min(6 - math.floor(math.log10(size)), 15)
    return "OFFSET " + " ".join(f"{x:.{decimals}f}" for x in offset)


def _checked_name(name: str) -> str:
    fits = name and name == name.strip() and not set(name) & set("{}\r\n")
    try:
        name.encode()
    except UnicodeEncodeError:
        fits = False
    if not fits:
        raise MotionKitError(
            f"joint name {name!r} does not fit into a BVH file; expected a text without braces, line ends and "
            "outer spaces: give the skeleton other names"
        )
    return name


__all__ = ["MotionKitWarning", "format_bvh", "guess_metres_per_unit", "load", "parse", "save"]

_MOTION = re.compile(rb"(?:^|\})[ \t]*(MOTION)(?=\s|$)", re.MULTILINE | re.IGNORECASE)


def load(path: str | os.PathLike, metres_per_unit: float | None = None, fps: float | None = None) -> Motion:
    """Read a BVH file.

    path: the file. metres_per_unit: the length of one unit of the file in metres (0.01 for centimetres). No
    BVH file states it; left out, it is guessed from the skeleton's size: up to 5 units tall is metres, up to
    45 the unit of the CMU captures (0.056444 m), up to 450 centimetres, above that millimetres. fps: a frame
    rate in place of the file's own. Returns a `Motion`. Warns (MotionKitWarning) where `Frames:` disagrees
    with the data. Raises MotionKitError naming file and line.

    >>> m = load("data/actor/walk_neutral.bvh")
    >>> m.fps, m.skeleton.names[0]
    (30.0, 'pelvis')
    """
    return parse(read_bytes(path), os.fspath(path), metres_per_unit, fps)


def parse(
    data: bytes, source: str = "<bytes>", metres_per_unit: float | None = None, fps: float | None = None
) -> Motion:
    """The text of a BVH file as bytes to a `Motion`; `source` is what errors call it. See `load`.

    >>> text = "HIERARCHY ROOT a { OFFSET 0 1 0 CHANNELS 1 Yrotation } MOTION Frames: 1 Frame Time: 0.5 90"
    >>> parse(text.encode()).rotations[0, 0]
    tensor([0.7071, 0.0000, 0.7071, 0.0000])
    """
    _check_argument("metres_per_unit", metres_per_unit, source)
    _check_argument("fps", fps, source)
    data = _plain_text(data, source)
    cut = _MOTION.search(data)
    if cut is None:
        parse_header(_decode(data[:1_000_000]), source)  # most often the header says more exactly what is wrong
        line = line_at(data, len(data))
        raise MotionKitError(f"{source}, line {line}: no line says MOTION; the file is cut off or holds no motion")
    header = parse_header(_decode(data[: cut.start(1)]), source)
    values, rate = read_data(data, cut.end(), header, source, fps)
    return _to_motion(header, values, metres_per_unit, rate, Path(source).stem)


def _check_argument(what: str, value: float | None, source: str) -> None:
    try:
        fine = value is None or 0 < float(value) < 1e6
    except (TypeError, ValueError):
        fine = False
    if not fine:
        raise MotionKitError(f"{source}: {what} must be a number above 0; found {value!r}")


def _plain_text(data: bytes, source: str) -> bytes:
    """The bytes without UTF-16, which some Windows tools write, and with ends of lines that `^` knows."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            data = data.decode("utf-16").encode()
        except UnicodeError:
            raise MotionKitError(f"{source}, line 1: neither text nor UTF-16; this is no BVH file") from None
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _to_motion(header: Header, values: np.ndarray, scale: float | None, fps: float, name: str) -> Motion:
    names, parents, channels = tuple(header.names), tuple(header.parents), tuple(header.channels)
    offsets = torch.tensor(header.offsets, dtype=torch.float64)
    skeleton = Skeleton(names, parents, offsets.float(), channels, tuple(header.end_sites))
    unit = guess_metres_per_unit(skeleton) if scale is None else float(scale)
    if unit != 1.0:
        ends = tuple((j, tuple(x * unit for x in offset)) for j, offset in header.end_sites)
        skeleton = Skeleton(names, parents, (offsets * unit).float(), channels, ends, skeleton.mirror_joints)
    frames, joints = len(values), len(names)
    rotations = torch.empty(frames, joints, 4)
    translations = skeleton.offsets.expand(frames, -1, -1).clone()
    groups = layouts(channels)
    for layout, (members, columns) in groups.items():
        count = len(members)
        if len(groups) == 1:  # every joint alike, as in many captures: views instead of copies
            members = columns = slice(None)
        block = torch.from_numpy(values[:, columns].reshape(frames, count, len(layout)))
        turns = [n for n, c in enumerate(layout) if c not in POSITION_CHANNELS]
        for n, channel in enumerate(layout):
            if channel in POSITION_CHANNELS:
                translations[:, members, POSITION_CHANNELS.index(channel)] = (block[:, :, n] * unit).float()
        angles = torch.deg2rad(block[:, :, turns])
        rotations[:, members] = compose(angles, [layout[n][0] for n in turns]).float()
    return Motion(skeleton, rotations, translations, fps, name, unit)
