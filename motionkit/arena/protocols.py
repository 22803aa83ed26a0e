"""Protocols: which clip is restyled after which, so that two tables with one protocol and seed compare the same work.

The papers say what kind of pairs they took and seldom which ones; `PROTOCOLS[name].about` tells what each leaves open.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from ..datasets import Clip, Dataset
from ..errors import MotionKitError
from ..methods.neutral_pairs import NEUTRAL

ALL = (
    "fmd", "fmd_ae", "fmd_content", "fmd_style", "cra", "sra", "truth_error", "tsi", "fsf", "fca", "jitter", "seconds"
)  # fmt: skip
_PAIRS = ("both differ", "neutral to styled", "styles differ")
_CLIPS = 600  # their pairs are 360,000, which take a moment; those of all clips of a corpus would take days


class Transfer(NamedTuple):
    """One thing to do: a content clip and a style clip, by their numbers in the test clips; repeat: of which draw."""

    content: int
    style: int
    repeat: int = 0


@dataclass(frozen=True)
class Protocol:
    """How the transfers of a table are chosen from the test clips.

    pairs: `both differ`: content label and style label of the two clips differ; `neutral to styled`: from every clip
    whose style is neutral (or normal) to every clip in another style, of whatever content; `styles differ`: contents
    may be the same. samples: clips drawn of each content x style, 0 for all. most: a draw of so many pairs (among 600
    clips, drawn first, if there are more), 0 for all. repeats: how often all is drawn again; with more than one,
    figures are means and standard deviations over repeats, and as long as there are clips, each repeat has others.
    examples: of each style so many of the drawn clips lend it, for methods that learn each anew; 0 for all.
    columns: the figures that the table shows (`ALL` at the most). about: what a paper says, what it leaves open, what
    was chosen. Draws depend on the seed and on the clips' names alone. Raises MotionKitError for values that are none
    of these.

    >>> Protocol("quick", most=10).most
    10
    """

    name: str
    pairs: str = "both differ"
    samples: int = 1
    most: int = 0
    repeats: int = 1
    examples: int = 0
    columns: tuple[str, ...] = ALL
    about: str = field(default="", repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.pairs not in _PAIRS:
            raise MotionKitError(
                f"protocol {self.name!r}: pairs are {', '.join(map(repr, _PAIRS))}; found {self.pairs!r}"
            )
        for what, least in (("samples", 0), ("most", 0), ("repeats", 1), ("examples", 0)):
            value = getattr(self, what)
            if not isinstance(value, int) or value < least:
                raise MotionKitError(f"protocol {self.name!r}: {what} is a whole number from {least}; found {value!r}")
        unknown = [column for column in self.columns if column not in ALL]
        if unknown or not self.columns:
            what = f"no column {unknown[0]!r}" if unknown else "a table needs columns"
            raise MotionKitError(f"protocol {self.name!r}: {what}; there are {', '.join(ALL)}")

    def transfers(self, test: Dataset, seed: int = 0) -> tuple[Transfer, ...]:
        """What is to be done on these test clips, in an order in which transfers of one style clip stand together.

        Raises MotionKitError where there is no such pair.

        >>> import motionkit as mk
        >>> source = mk.datasets.BvhSource.at("data/actor/walk_neutral.bvh")
        >>> kinds = [("walk", "neutral"), ("jump", "old"), ("walk", "old")]
        >>> items = [mk.datasets.Item("_".join(kind), mk.datasets.Labels(*kind, ()), source) for kind in kinds]
        >>> PROTOCOLS["paper-1"].transfers(mk.datasets.from_items("mine", items))
        (Transfer(content=1, style=0, repeat=0), Transfer(content=0, style=1, repeat=0))
        """
        clips, transfers = list(test), []
        for repeat in range(self.repeats):
            draw = f"{seed} {repeat}"
            contents = self._contents(clips, repeat, seed)
            if self.most and len(contents) > _CLIPS:
                contents = sorted(_shuffled({n: f"{draw} {clips[n].name}" for n in contents})[:_CLIPS])
            styles = _groups(contents, lambda n: clips[n].style)
            lends = {n: f"{draw} lends {clips[n].name}" for n in contents}
            examples = (_shuffled({n: lends[n] for n in group})[: self.examples or None] for group in styles)
            pairs = [
                (content, style)
                for style in sorted(n for group in examples for n in group)
                for content in contents
                if content != style and self._takes(clips[content], clips[style])
            ]
            if self.most:
                names = {pair: f"{draw} {clips[pair[0]].name} {clips[pair[1]].name}" for pair in pairs}
                pairs = sorted(_shuffled(names)[: self.most], key=lambda pair: pair[::-1])
            transfers += [Transfer(*pair, repeat) for pair in pairs]
        if not transfers:
            raise MotionKitError(
                f"protocol {self.name!r} finds no pair ({self.pairs}) among {len(clips)} test clips with contents "
                f"{', '.join(test.contents)} and styles {', '.join(test.styles)}; take a data set or a split with more"
            )
        return tuple(transfers)

    def _contents(self, clips: list[Clip], repeat: int, seed: int) -> list[int]:
        """Numbers of the clips drawn of each content and style, in order. Repeat after repeat has others, until none
        is left and they are shuffled anew.
        """
        drawn = []
        for group in _groups(range(len(clips)), lambda n: (clips[n].content, clips[n].style)):
            count = min(self.samples or len(group), len(group))
            rounds = len(group) // count
            start = repeat % rounds * count
            drawn += _shuffled({n: f"{seed} {repeat // rounds} {clips[n].name}" for n in group})[start : start + count]
        return sorted(drawn)

    def _takes(self, content: Clip, style: Clip) -> bool:
        if self.pairs == "neutral to styled":
            return content.style in NEUTRAL and style.style not in NEUTRAL
        if self.pairs == "both differ" and content.content == style.content:
            return False
        return content.style != style.style


def _groups(numbers: Iterable[int], kind: Callable[[int], Hashable]) -> list[list[int]]:
    """Numbers of clips, those of one kind together."""
    groups: dict[Hashable, list[int]] = {}
    for n in numbers:
        groups.setdefault(kind(n), []).append(n)
    return list(groups.values())


def _shuffled(names: dict) -> list:
    """The keys in an order that depends on nothing but what they are called."""
    return sorted(names, key=lambda key: hashlib.sha256(names[key].encode()).digest())


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            "paper-1",
            about="Paper 1, section 5.2: 'we uniformly select test samples from each content and style, resulting in a "
            "total of 3780 transfer combinations'. On Bandai-2's 10 contents and 7 styles that is one sample of each "
            "of the 70 kinds, and all pairs in which both labels differ: 70 x 9 x 6. Left open: which samples. Here "
            "the seed draws them.",
        ),
        Protocol(
            "paper-3",
            "neutral to styled",
            repeats=5,
            columns=("fmd", "cra", "sra"),
            about="Paper 3, section 7, table 2: 'all possible combinations of source (content) and reference (style) "
            "motions', as mean and deviation; its figure 8 goes from neutral sources to styled references. Left open: "
            "over what figures deviate, and how many clips there are. Here five draws of one clip of each content and "
            "style. The paper's one accuracy is CRA.",
        ),
        Protocol(
            "paper-4",
            "styles differ",
            samples=0,
            most=1000,
            columns=("fmd", "cra", "sra", "tsi", "fsf"),
            about="Paper 4, section 4.3, table 1: any clip may lend its style to any other. Left open: which pairs and "
            "how many, and whether the styles may be the same. Here 1,000 pairs of different styles, drawn from all "
            "test clips.",
        ),
        Protocol("small", most=120, about="For a laptop and a lesson: 120 pairs drawn from those of paper-1."),
    )
}


def get_protocol(protocol: str | Protocol) -> Protocol:
    """A protocol as it is, or by its name; MotionKitError lists the names.

    >>> get_protocol("paper-5")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: no protocol 'paper-5'; there are 'paper-1', 'paper-3', 'paper-4', 'small'; ...
    """
    if isinstance(protocol, Protocol):
        return protocol
    if not isinstance(protocol, str) or protocol not in PROTOCOLS:
        raise MotionKitError(
            f"no protocol {protocol!r}; there are {', '.join(map(repr, PROTOCOLS))}; or make one, "
            "mk.arena.Protocol(...)"
        )
    return PROTOCOLS[protocol]
