"""A list of labelled clips, whose motions are read when asked for."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, overload

from ..errors import MotionKitError
from ..motion import Motion

if TYPE_CHECKING:
    from .store import Store


class Labels(NamedTuple):
    """What a clip shows: content, style, and both in a sentence."""

    content: str
    style: str
    text: str


@dataclass(frozen=True, eq=False)
class Clip:
    """One clip: `name`, `content`, `style`, `text` (a sentence), and `motion`, read on first use."""

    name: str
    content: str
    style: str
    text: str
    _store: Store
    _number: int

    @cached_property
    def motion(self) -> Motion:
        """The motion, in metres; see `Motion`."""
        return self._store.motion(self._number)

    def __len__(self) -> int:
        return self._store.clips[self._number].frames

    def __repr__(self) -> str:
        return f"Clip({self.name!r}, {len(self)} frames, content {self.content!r}, style {self.style!r})"


@dataclass(frozen=True, eq=False)
class Dataset:
    """Clips in the order of their names; `ds[0]` is a `Clip`, `ds[:10]` and `ds.filter(style="old")` datasets."""

    name: str
    store: Store
    labels: tuple[Labels, ...]
    chosen: tuple[int, ...] | None = None

    @cached_property
    def numbers(self) -> tuple[int, ...]:
        """Which of the stored clips are in this dataset."""
        return tuple(range(len(self.labels))) if self.chosen is None else self.chosen

    @cached_property
    def contents(self) -> tuple[str, ...]:
        """The contents that occur, sorted."""
        return tuple(sorted({self.labels[n].content for n in self.numbers}))

    @cached_property
    def styles(self) -> tuple[str, ...]:
        """The styles that occur, sorted."""
        return tuple(sorted({self.labels[n].style for n in self.numbers}))

    def __len__(self) -> int:
        return len(self.numbers)

    def __repr__(self) -> str:
        found = f"{len(self.contents)} contents, {len(self.styles)} styles"
        return f"Dataset({self.name!r}, {len(self)} clips, {found})"

    @overload
    def __getitem__(self, number: int) -> Clip: ...
    @overload
    def __getitem__(self, number: slice) -> Dataset: ...
    def __getitem__(self, number):
        if isinstance(number, slice):
            return Dataset(self.name, self.store, self.labels, self.numbers[number])
        stored = self.numbers[number]
        return Clip(self.store.clips[stored].name, *self.labels[stored], self.store, stored)

    def __iter__(self) -> Iterator[Clip]:
        return (self[n] for n in range(len(self)))

    def filter(
        self, content: str | Collection[str] | None = None, style: str | Collection[str] | None = None
    ) -> Dataset:
        """The clips of one or several contents and styles; MotionKitError for a label that does not occur."""
        contents = _wanted("content", content, self.contents)
        styles = _wanted("style", style, self.styles)
        fits = (n for n in self.numbers if self.labels[n].content in contents and self.labels[n].style in styles)
        return Dataset(self.name, self.store, self.labels, tuple(fits))


def _wanted(what: str, asked: str | Collection[str] | None, there: tuple[str, ...]) -> set[str]:
    wanted = set(there) if asked is None else {asked} if isinstance(asked, str) else set(asked)
    unknown = sorted(wanted - set(there))
    if unknown:
        raise MotionKitError(f"no clip has the {what} {unknown[0]!r}; there are {', '.join(there)}")
    return wanted
