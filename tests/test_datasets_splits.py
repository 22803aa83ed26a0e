"""Splits that never leak, tables of labels, and what is stored beside a motion."""

from collections import Counter

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from made_clips import Made, chain, made

import motionkit as mk
from motionkit.datasets import Item, Labels, Recording
from motionkit.datasets.loading import from_items
from motionkit.skeleton import Skeleton


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))


def grid(contents: int, styles: int, takes: int, performers: int = 4) -> list[Labels]:
    return [
        Labels(f"c{c}", f"s{s}", (f"a person does c{c}",), f"p{t % performers}", f"take {c} {s} {t}")
        for c in range(contents)
        for s in range(styles)
        for t in range(takes)
    ]


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


def test_filters():
    ds = made(grid(2, 2, 4))
    assert len(ds.filter(performer="p1")) == 4 and len(ds.filter("c0", ["s0", "s1"], ["p1", "p2"])) == 4
    assert ds.filter(performer="p1").performers == ("p1",)
    with pytest.raises(mk.MotionKitError, match="no clip has the performer 'p9'; there are p0, p1, p2, p3"):
        ds.filter(performer="p9")
    with pytest.raises(mk.MotionKitError, match="no clip has the split 'test'"):
        ds.filter(split="test")


def test_tables_of_labels():
    ds = made([*grid(2, 2, 2), Labels("c0", "<b>", ("one", "two"))])
    assert str(ds.table()).splitlines() == [
        "content \\ style  <b>  s0  s1  all",
        "c0                 1   2   2    5",
        "c1                 0   2   2    4",
        "all                1   4   4    9",
    ]
    assert "<th>&lt;b&gt;</th>" in ds.table()._repr_html_() and "<b>" not in ds.table()._repr_html_()
    assert ds.captions().rows[-2:] == (("clip_008", "c0", "<b>", "one"), ("clip_008", "c0", "<b>", "two"))
    many = made(grid(1, 13, 4))
    assert many.table().header == ("style \\ content", "c0", "all") and len(many.table().rows) == 14
    assert str(many.captions()).splitlines()[-1] == "... and 12 more lines in .rows"
    assert ds[:0].table().rows == (("all", 0),) and ds[:0].captions().rows == ()


def test_contacts_and_phase_are_stored_beside_the_motion():
    ds = made([Labels("walk", "old", ("text",), "anna", "take 7", "train")], joints=22, frames=40, phase=True)
    clip = ds[0]
    expected = Made(0, joints=22, frames=40, phase=True).read()
    assert torch.equal(clip.contacts, mk.contacts.foot_contacts(expected.motion)) and clip.contacts.dtype == torch.bool
    assert torch.equal(clip.phase, expected.tracks["phase"]) and clip.phase.shape == (40, 1)
    assert torch.equal(clip.motion.rotations, expected.motion.rotations) and clip.motion.rotations.is_contiguous()
    assert torch.equal(clip.motion.translations, expected.motion.translations)
    assert (clip.performer, clip.take, clip.split, clip.texts) == ("anna", "take 7", "train", ("text",))


def test_labels_that_are_not_there():
    clip = made([Labels("walk", "old", ())])[0]
    assert (clip.text, clip.take, clip.phase) == ("", "clip_000", None)
    with pytest.raises(mk.MotionKitError, match="cannot tell the feet among j0, j1"):
        _ = clip.contacts


class Given:
    """A source of one recording."""

    state = "1"

    def __init__(self, recording: Recording) -> None:
        self.recording = recording

    def read(self) -> Recording:
        return self.recording


def test_given_contacts_and_twins_are_kept():
    skeleton = Skeleton(("a", "b", "c"), (-1, 0, 0), chain(3).offsets, mirror_joints=(0, 2, 1))
    turns = torch.tensor([1.0, 0, 0, 0]).expand(4, 3, 4)
    motion = mk.Motion.from_root(skeleton, turns, torch.zeros(4, 3), 25.0)
    stands = torch.rand(4, 6) > 0.5
    ds = from_items("mine", [Item("a", Labels("walk", "old", ()), Given(Recording(motion, {"contacts": stands})))])
    assert torch.equal(ds[0].contacts, stands) and ds[0].motion.skeleton.mirror_joints == (0, 2, 1)
    wrong = Given(Recording(motion, {"phase": torch.zeros(3, 1)}))
    with pytest.raises(mk.MotionKitError, match=r"clip 'b': expected track 'phase' as \[4, K\].* found \[3, 1\]"):
        from_items("mine", [Item("b", Labels("walk", "old", ()), wrong)])


def test_lists_of_items_that_make_no_dataset():
    item = Item("a", Labels("walk", "old", ()), Made(0))
    with pytest.raises(mk.MotionKitError, match="two clips are called 'a'"):
        from_items("mine", [item, item])
    with pytest.raises(mk.MotionKitError, match="'mine' has no clips"):
        from_items("mine", [])


def test_options_are_the_readers(tmp_path):
    with pytest.raises(mk.MotionKitError, match="'xia' has no option 'pattern'; it has none"):
        mk.datasets.load("xia", tmp_path, pattern="{style}")
