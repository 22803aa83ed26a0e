"""Numbers from text, many at once: the inner loop of the BVH reader.

Plain decimals (`-12.345`) with at most 15 digits are exact integers divided by exact powers of ten, which
gives the correctly rounded double (Clinger 1990, the fast path). Eight digits are one 64-bit word and are
worked out together (Lemire 2018, "Quickly parsing eight digits"), for all numbers of a block at once.
Whatever is not a plain decimal (`1e-5`, longer ones) goes through Python's `float`.
"""

from __future__ import annotations

import re

import numpy as np

_BLOCK = 1 << 16  # bytes at a time: small enough that working arrays are reused and stay in the processor's cache
_WORD = 8  # characters of a 64-bit word
_LONGEST = 16  # digits before or after the dot; more are left to `float`
_MOST_DIGITS = 15  # integers up to 10^15 are exact doubles
_POWERS = 10.0 ** np.arange(_MOST_DIGITS + 1)
_SPACE = re.compile(rb"[\t-\r ]")
_ZEROS = np.uint64(0x3030303030303030)  # "00000000"
_OVER_NINE = np.uint64(0x7676767676767676)  # added to a byte, it reaches the top bit from 10 up
_TOP_BITS = np.uint64(0x8080808080808080)
_LAST = np.array([(~0 << 8 * (_WORD - n)) & 0xFFFFFFFFFFFFFFFF for n in range(_WORD + 1)], np.uint64)


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
    words = np.ndarray(len(padded) - _WORD + 1, "<u8", padded, strides=(1,))  # a word starts at every byte
    word = (words[stops - _WORD] ^ _ZEROS) & _LAST[np.minimum(counts, _WORD)]
    wrong = ((word + _OVER_NINE) | word) & _TOP_BITS != 0
    word = (word * np.uint64(10 * 2**8 + 1)) >> np.uint64(8)
    word = ((word & np.uint64(0x00FF00FF00FF00FF)) * np.uint64(100 * 2**16 + 1)) >> np.uint64(16)
    word = ((word & np.uint64(0x0000FFFF0000FFFF)) * np.uint64(10000 * 2**32 + 1)) >> np.uint64(32)
    value = word.astype(np.float64)
    more = np.flatnonzero(counts > _WORD)
    if len(more):
        high, wrong_high = _digits(padded, stops[more] - _WORD, counts[more] - _WORD)
        value[more] += high * 1e8
        wrong[more] |= wrong_high
    return value, wrong
