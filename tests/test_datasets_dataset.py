"""Clips with their labels, filters and tables of them, and windows read from the mapped file."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from made_clips import Made, grid, lengths, made

import motionkit as mk
from motionkit.datasets import Labels, batches, collate
from motionkit.datasets import cache as stores


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        return lengths([70, 0, 64, 63, 130], joints=22, phase=True)


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


class Frames:
    """As much of a store as counting windows needs."""

    def __init__(self, frames: list[int]) -> None:
        self.frames = torch.tensor(frames).numpy()
        self.clips = [Clip(n, count) for n, count in enumerate(frames)]


class Clip:
    def __init__(self, number: int, frames: int) -> None:
        self.name, self.frames = f"clip_{number}", frames


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=6),
    st.integers(1, 20),
    st.integers(1, 25),
    st.sampled_from(["skip", "pad"]),
)
@settings(max_examples=200)
def test_windows_are_where_they_should_be(frames, length, stride, short):
    expected = []
    for clip, count in enumerate(frames):
        start = 0
        while start + length <= count:
            expected.append((clip, start))
            start += stride
        left_over = start == 0 or start - stride + length < count
        if short == "pad" and count and left_over and start < count:
            expected.append((clip, start))
    labels = tuple(Labels("walk", "old", ()) for _ in frames)
    ds = mk.datasets.Dataset("any", Frames(frames), labels)
    if not expected:
        with pytest.raises(mk.MotionKitError, match="no clip has"):
            ds.windows(length, stride, short)
        return
    windows = ds.windows(length, stride, short)
    assert [(w.clip.index, w.start) for w in windows] == expected and len(windows) == len(expected)
    assert windows.clip_indices().tolist() == [clip for clip, _ in expected]


def test_a_window_is_a_piece_of_its_clip(walks, monkeypatch):
    whole = [clip.recording for clip in walks]
    monkeypatch.setattr(stores.Store, "check", lambda *_: pytest.fail("a whole clip was read"))
    windows = walks.windows(60, stride=30)
    assert [w.name for w in windows][:4] == ["clip_000[0:60]", "clip_002[0:60]", "clip_003[0:60]", "clip_004[0:60]"]
    for w in windows:
        motion, piece = w.motion, whole[w.clip.index].motion[w.start : w.start + 60]
        assert torch.equal(motion.rotations, piece.rotations) and torch.equal(motion.translations, piece.translations)
        assert (motion.fps, motion.name, len(w), w.valid.all()) == (30.0, w.name, 60, True)
        assert torch.equal(w.contacts, whole[w.clip.index].tracks["contacts"][w.start : w.start + 60].bool())
    last = windows[-1]
    assert (last.content, last.style, last.text, last.start) == ("walk", "proud", "clip 4", 60)
    assert last.motion.skeleton is windows[0].motion.skeleton is walks.skeleton
    assert [w.name for w in windows[-2:]] == [windows[len(windows) - 2].name, windows[-1].name]
    with pytest.raises(IndexError):
        windows[len(windows)]


def test_a_padded_window_stays_in_the_last_pose(walks):
    windows = walks.windows(64, short="pad")
    assert [(w.clip.name, w.start, w.frames) for w in windows if w.frames < 64] == [
        ("clip_000", 64, 6),
        ("clip_003", 0, 63),
        ("clip_004", 128, 2),
    ]
    w, clip = windows[1], walks[0].motion
    assert w.valid.tolist() == [True] * 6 + [False] * 58 and len(w.motion) == 64
    assert torch.equal(w.motion.rotations[:6], clip.rotations[64:])
    assert torch.equal(w.motion.translations[6:], clip.translations[-1:].expand(58, -1, -1))
    assert repr(w) == "Window('clip_000[64:128]', 64 frames, 6 of them its own)"


def test_windows_that_cannot_be(walks):
    with pytest.raises(mk.MotionKitError, match="no clip has 200 frames; the longest has 130: choose a smaller"):
        walks.windows(200)
    for length, stride in ((0, 1), (8, 0), (2.5, 1), (True, 1)):
        with pytest.raises(mk.MotionKitError, match="is a number of frames from 1"):
            walks.windows(length, stride)
    with pytest.raises(mk.MotionKitError, match="short is 'skip' or 'pad'; found 'cut'"):
        walks.windows(8, short="cut")
    with pytest.raises(mk.MotionKitError, match="split the dataset first: train, validation, test = "):
        walks.windows(8).split(by="take")


def test_ids_are_the_same_in_every_part_of_a_split(walks):
    part = walks.filter(style="sad")
    assert part.styles == ("sad",) and part.vocabulary["style"] == ("old", "proud", "sad")
    assert collate([part[0]]).style.tolist() == [2] == next(iter(batches(part, 1))).style.tolist()
