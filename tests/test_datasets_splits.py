"""Splits that never leak."""

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_clips import grid, made

import motionkit as mk
from motionkit.datasets import Item, Labels


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))


def parts_of(ds, **more) -> list[list[str]]:
    return [[clip.name for clip in part] for part in ds.split(**more)]


def test_every_content_and_style_gets_its_share_of_takes():
    ds = made(grid(4, 3, 10))
    split = ds.split()
    assert split._fields == ("train", "validation", "test") and [len(part) for part in split] == [96, 12, 12]
    for part, least, most in zip(split, (7, 0, 0), (9, 2, 2)):
        counts = Counter((clip.content, clip.style) for clip in part)
        assert all(least <= counts[c, s] <= most for c in ds.contents for s in ds.styles)
    assert sorted(sum(parts_of(ds), [])) == [clip.name for clip in ds]


def test_one_take_of_each_kind_still_gives_every_part_several_styles():
    for part in made(grid(10, 10, 1)).split():
        assert len(part.styles) >= 4 and len(part.contents) >= 4


def test_a_seed_is_a_split():
    ds = made(grid(2, 2, 5))
    assert parts_of(ds) == parts_of(ds, by="take", seed=0) != parts_of(ds, seed=1)
    # the same in every version of Python, on every machine
    assert parts_of(made(grid(1, 1, 12)), shares=(0.5, 0.0, 0.5), seed=3)[2] == [
        f"clip_{n:03d}" for n in (0, 2, 4, 6, 7, 10)
    ]


@given(
    st.lists(st.tuples(*(st.integers(0, 3) for _ in range(4))), min_size=1, max_size=30),
    st.sampled_from(["take", "performer", "content", "style"]),
    st.sampled_from([(0.8, 0.1, 0.1), (0.5, 0.0, 0.5), (1.0, 0.0, 0.0), (0.34, 0.33, 0.33)]),
)
@settings(max_examples=150)
def test_no_take_is_ever_in_two_parts(rows, by, shares):
    labels = [Labels(f"c{c}", f"s{s}", (), f"p{p}", f"t{t}") for c, s, p, t in rows]
    ds = mk.datasets.Dataset("any", Names(len(labels)), tuple(labels))
    try:
        parts = ds.split(by, shares, seed=len(rows))
    except mk.MotionKitError as error:
        assert "share no take; found" in str(error) or "tie all" in str(error)
        return
    assert sorted(n for part in parts for n in part.indices) == list(range(len(labels)))
    assert [len(part) > 0 for part in parts] == [share > 0 for share in shares]
    for label in ("take", by):
        held = [{getattr(labels[n], label) for n in part.indices} for part in parts]
        assert not (held[0] & held[1] or held[0] & held[2] or held[1] & held[2])


class Names:
    """As much of a store as splitting needs."""

    def __init__(self, count: int) -> None:
        self.clips = [Item(f"clip {n}", None, None) for n in range(count)]


def test_by_performer_style_or_content():
    ds = made(grid(3, 5, 4, performers=4))
    parts = ds.split("performer", (0.5, 0.25, 0.25))
    assert [len(part.performers) for part in parts] == [2, 1, 1] and [len(p) for p in parts] == [30, 15, 15]
    assert [len(part.styles) for part in ds.split("style")] == [3, 1, 1]
    assert [len(part.contents) for part in ds.split("content", (0.7, 0.0, 0.3))] == [2, 0, 1]


def test_what_cannot_be_split_is_said():
    ds = made(grid(1, 2, 4))
    with pytest.raises(mk.MotionKitError, match="3 parts need at least 3 styles that share no take; found 2"):
        ds.split("style")
    with pytest.raises(mk.MotionKitError, match="found by='takes'"):
        ds.split("takes")
    for shares in ((0.8, 0.2), (0.8, 0.1, 0.2), (1.1, -0.1, 0.0), "abc", (float("nan"), 0.5, 0.5)):
        with pytest.raises(mk.MotionKitError, match="three numbers from 0 that add up to 1"):
            ds.split(shares=shares)
    unknown = made([Labels("walk", "old", ()) for _ in range(3)])
    with pytest.raises(mk.MotionKitError, match="does not say who performs clip 'clip_000'; split by='take'"):
        unknown.split("performer")
    tied = made([Labels("walk", f"s{n}", (), take=f"t{t}") for t in range(2) for n in range(t, t + 3)])
    with pytest.raises(mk.MotionKitError, match="its takes tie all 4 styles together"):
        tied.split("style")
    with pytest.raises(mk.MotionKitError, match="found 0"):
        ds[:0].split()


def test_the_makers_split_comes_first():
    said = ["train", "test", "val", "train", "validation"]
    ds = made([Labels("walk", "old", (), split=part) for part in said])
    assert (
        parts_of(ds) == parts_of(ds, by="given") == [["clip_000", "clip_003"], ["clip_002", "clip_004"], ["clip_001"]]
    )
    assert [c.split for c in ds.filter(split=["test", "val"])] == ["test", "val"]
    half = made([Labels("walk", "old", (), split=part) for part in ("train", "", "", "")])
    assert [len(part) for part in half.split()] == [2, 1, 1]
    with pytest.raises(mk.MotionKitError, match="clip 'clip_001' is in no part; split by='take'"):
        half.split("given")
    with pytest.raises(mk.MotionKitError, match="clip 'clip_000' is in part 'dev'; expected train"):
        made([Labels("walk", "old", (), split="dev")]).split("given")
    leaks = made([Labels("walk", "old", (), take="t", split=part) for part in ("train", "test")])
    with pytest.raises(mk.MotionKitError, match=r"take 't' into two parts \('clip_000' and 'clip_001'\)"):
        leaks.split()
