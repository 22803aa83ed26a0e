"""The MOTION part of a BVH file: frame count, frame time, and the numbers of every frame."""

from __future__ import annotations

import re
import warnings
from decimal import Decimal
from itertools import islice

import numpy as np

from .bvh_header import LARGEST, Header
from .bvh_numbers import BadNumber, parse_numbers
from .errors import MotionKitError
from .files import MotionKitWarning

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
