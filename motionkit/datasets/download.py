"""Downloading one large file over a connection that breaks: what has come is kept, and the rest is asked for."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from ..errors import MotionKitError

_PIECE = 1 << 14  # bytes to write at once; so many may be lost when a connection breaks
_TRY_AGAIN = (408, 425, 429, 500, 502, 503, 504)  # answers that may be better a moment later


class _Broken(Exception):
    """The connection ended before the file did."""


@dataclass
class Resuming:
    """A downloader for `pooch.retrieve` that goes on where a broken connection stopped, also in another session.

    part: the file that holds what has come so far. tries: how often in a row nothing more may come before it gives up.
    pause: seconds before the second try; twice as many before each one after. patience: seconds to wait for an answer.

    >>> Resuming(Path("a.part"))("nowhere://a.zip", "a.zip", None)
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nowhere://a.zip: cannot be downloaded: No connection adapters ...
    """

    part: Path
    tries: int = 5
    pause: float = 1.0
    patience: float = 30.0

    def __call__(self, address: str, target: str | os.PathLike, _pooch: object) -> None:
        """Download to `target`; MotionKitError where the server refuses or the connection keeps breaking."""
        from requests import exceptions

        furthest, failures = self._size(), 0
        while True:
            try:
                self._go_on(address)
                break
            except exceptions.SSLError as error:
                raise MotionKitError(f"{address}: no safe connection to the server: {_reason(error)}") from None
            except (_Broken, exceptions.ConnectionError, exceptions.Timeout, exceptions.ChunkedEncodingError) as error:
                failures = 1 if self._size() > furthest else failures + 1
                furthest = max(furthest, self._size())
                self._wait(address, failures, error)
            except exceptions.RequestException as error:
                raise MotionKitError(f"{address}: cannot be downloaded: {_reason(error)}; mend the address") from None
        os.replace(self.part, target)

    def _wait(self, address: str, failures: int, error: Exception) -> None:
        have = f"{self._size() / 1e6:.1f} MB"
        if failures >= self.tries:
            raise MotionKitError(
                f"{address}: the download stopped after {have}, and {failures} tries in a row brought no more "
                f"({_reason(error)}); look at your connection and call fetch again: it goes on from {self.part}"
            ) from None
        seconds = self.pause * 2 ** (failures - 1)
        print(f"The connection broke after {have}; another try in {seconds:g} s.")
        time.sleep(seconds)

    def _size(self) -> int:
        return self.part.stat().st_size if self.part.exists() else 0

    def _go_on(self, address: str) -> None:
        """One request for what is missing; returns when the file is whole, raises _Broken where it ends before that."""
        import requests

        have = self._size()
        headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
        with requests.get(address, headers=headers, stream=True, timeout=self.patience) as answer:
            if answer.status_code == 416:  # nothing is left after `have`: either it is whole, or it was another file
                if answer.headers.get("Content-Range", "").endswith(f"/{have}"):
                    return
                self.part.unlink()
                raise _Broken("what had come was no part of it")
            if answer.status_code in _TRY_AGAIN:
                raise _Broken(f"the server answered {answer.status_code} {answer.reason}")
            if answer.status_code not in (200, 206):
                raise MotionKitError(
                    f"{address}: the server answered {answer.status_code} {answer.reason}; open the address in a "
                    "browser, and if the data have moved, get them by hand"
                )
            if answer.status_code == 200:  # not every server sends parts
                have = 0
            elif not answer.headers.get("Content-Range", "").startswith(f"bytes {have}-"):
                self.part.unlink(missing_ok=True)
                raise _Broken("the server sent another part than was asked for")
            self._save(answer, have)

    def _save(self, answer, have: int) -> None:
        """Append what comes to the first `have` bytes."""
        from tqdm.auto import tqdm

        length = answer.headers.get("Content-Length", "")
        total = have + int(length) if length.isdigit() else None
        with (
            open(self.part, "ab" if have else "wb") as file,
            tqdm(total=total, initial=have, unit="B", unit_scale=True, desc="downloading", leave=False) as progress,
        ):
            for piece in answer.iter_content(_PIECE):
                progress.update(file.write(piece))
        if total is not None and self._size() != total:
            raise _Broken(f"{self._size()} of {total} bytes came")


def _reason(error: Exception) -> str:
    """The innermost message of an error, which says what happened."""
    while error.__cause__ or error.__context__:
        error = error.__cause__ or error.__context__
    return str(error) or type(error).__name__
