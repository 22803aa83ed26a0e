"""The arena's protocols on labels alone: which pairs, how many, and that the seed draws them."""

from dataclasses import replace

import made_clips
import pytest

import motionkit as mk
from motionkit.arena import PROTOCOLS, Protocol
from motionkit.datasets import Labels

pytestmark = pytest.mark.slow

BANDAI = [(f"content {c}", style) for c in range(10) for style in ("normal", *"abcdef")]


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """As many kinds as Bandai-2 has, three clips of each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield made_clips.made([Labels(*kind, ()) for kind in BANDAI for _ in range(3)])


def kinds(clips, transfers):
    return [
        ((clips[t.content].content, clips[t.content].style), (clips[t.style].content, clips[t.style].style))
        for t in transfers
    ]


def test_paper_1_is_3780_transfers(clips):
    found = PROTOCOLS["paper-1"].transfers(clips)
    pairs = kinds(clips, found)
    assert len(found) == len(set(pairs)) == 3780
    assert all(a[0] != b[0] and a[1] != b[1] for a, b in pairs)
    assert len({t.content for t in found}) == len({t.style for t in found}) == 70


def test_paper_3_goes_from_neutral_to_styled_and_draws_again(clips):
    found = PROTOCOLS["paper-3"].transfers(clips)
    assert len(found) == 5 * 10 * 60
    assert all(a[1] == "normal" != b[1] for a, b in kinds(clips, found))
    sources = [{t.content for t in found if t.repeat == n} for n in range(5)]
    assert all(len(s) == 10 for s in sources)
    assert len(sources[0] | sources[1] | sources[2]) == 30  # no clip twice while there are others
    assert sources[3] not in sources[:3]


def test_paper_4_takes_styles_from_any_clip(clips):
    found = PROTOCOLS["paper-4"].transfers(clips)
    pairs = kinds(clips, found)
    assert len(set(found)) == 1000 and all(a[1] != b[1] for a, b in pairs)
    assert any(a[0] == b[0] for a, b in pairs) and any(a[0] != b[0] for a, b in pairs)


def test_small_is_a_draw_from_paper_1(clips):
    small, paper = PROTOCOLS["small"].transfers(clips, 3), PROTOCOLS["paper-1"].transfers(clips, 3)
    assert len(set(small)) == 120 and set(small) <= set(paper)
    assert small == PROTOCOLS["small"].transfers(clips, 3) != PROTOCOLS["small"].transfers(clips, 4)
    styles = [t.style for t in small]
    assert len(set(styles)) == 1 + sum(a != b for a, b in zip(styles, styles[1:]))  # those of a style clip together


def test_protocols_of_ones_own(clips):
    everything = Protocol("all", "styles differ", samples=0).transfers(clips[:9])
    assert len(everything) == 9 * 6
    for wrong in ({"pairs": "all"}, {"samples": -1}, {"most": 1.5}, {"repeats": 0}, {"columns": ("sra", "srb")}):
        with pytest.raises(mk.MotionKitError, match="protocol 'x'"):
            Protocol("x", **wrong)


def test_few_examples_of_each_style(clips):
    paper = set(PROTOCOLS["paper-1"].transfers(clips, 3))
    few = replace(PROTOCOLS["paper-1"], examples=2).transfers(clips, 3)
    assert set(few) < paper
    lent = {t.style for t in few}
    assert {clips[n].style for n in lent} == set(clips.styles) and len(lent) == 2 * len(clips.styles)
    assert {t for t in paper if t.style in lent} == set(few)  # each is taken to all contents
    assert lent != {t.style for t in replace(PROTOCOLS["paper-1"], examples=2).transfers(clips, 4)}
