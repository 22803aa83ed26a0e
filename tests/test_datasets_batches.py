"""Batches of windows and clips as named tensors."""

import pickle
from collections import Counter

import pytest
import torch
from made_clips import Made, lengths, made
from torch.utils.data import DataLoader

import motionkit as mk
from motionkit.datasets import BalancedSampler, Item, Labels, Windows, batches, collate
from motionkit.datasets.batches import FeatureCache
from motionkit.datasets.loading import from_items


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        return lengths([70, 0, 64, 63, 130], joints=22, phase=True)


def test_a_batch_is_its_windows_together(walks):
    windows = walks.windows(64, 32, "pad")
    chosen = [windows[n] for n in (4, 0, 2, 1)]
    batch = collate(chosen)
    assert batch.rotations.shape == (4, 64, 22, 4) and batch["translations"].shape == (4, 64, 22, 3)
    for n, w in enumerate(chosen):
        assert torch.equal(batch.rotations[n], w.motion.rotations)
        assert torch.equal(batch.translations[n], w.motion.translations)
        assert torch.equal(batch.contacts[n], w.contacts) and batch.contacts.dtype == torch.bool
        assert torch.equal(batch.phase[n], w.recording.tracks["phase"])
        assert torch.equal(batch.mask[n], w.valid)
        assert walks.vocabulary["style"][batch.style[n]] == w.style and batch.style.dtype == torch.long
    assert batch.names == [w.name for w in chosen] and batch.texts == [w.clip.texts for w in chosen]
    assert all(batch[name].is_contiguous() for name in ("rotations", "translations", "phase"))
    with pytest.raises(AttributeError, match="this batch has no 'rotation'; it has rotations, translations"):
        _ = batch.rotation
    double = batch.to(torch.float64)
    assert double.rotations.dtype == torch.float64 and double.names is batch.names and type(double) is type(batch)


def test_whole_clips_are_padded_to_the_longest(walks):
    batch = collate(list(walks))
    assert batch.rotations.shape == (5, 130, 22, 4) and batch.mask.sum(1).tolist() == [70, 0, 64, 63, 130]
    assert torch.equal(batch.rotations[3, :63], walks[3].motion.rotations)
    assert torch.equal(batch.rotations[3, 63:], walks[3].motion.rotations[-1:].expand(67, -1, -1))
    assert torch.isfinite(batch.rotations).all()


@pytest.mark.parametrize("layout", [mk.features.FacingFree, mk.features.Graph])
def test_features_are_cut_from_those_of_the_whole_clip(walks, layout, monkeypatch):
    encoded = {clip.index: layout().encode(clip.motion) for clip in walks if len(clip)}
    loader = batches(walks.windows(40, short="pad"), 3, features=layout())
    windows = {w.name: w for w in loader.dataset}
    for epoch in range(2):
        for batch in loader:
            for x, mask, name in zip(batch.features, batch.mask, batch.names):
                w = windows[name]
                expected = encoded[w.clip.index][w.start : w.start + w.frames]
                assert torch.equal(x[mask], expected) and torch.equal(x[~mask], expected[-1:].expand_as(x[~mask]))
        if not epoch:
            monkeypatch.setattr(layout, "encode", lambda *_: pytest.fail("a clip was encoded again"))


def test_features_of_clips_without_frames_and_in_other_processes(walks):
    encoded = FeatureCache(walks, mk.features.SixD())
    batch = collate(list(walks), encoded)
    assert batch.features.shape == (5, 130, 135) and not batch.features[1].any() and batch.features[0].any()
    there = pickle.loads(pickle.dumps(encoded))
    assert torch.equal(collate([there.dataset[4]], there).features[0], batch.features[4])
    assert torch.equal(collate([walks[4]], mk.features.SixD()).features[0], batch.features[4])


def test_an_epoch_has_every_window_once_and_a_seed_is_an_order(walks):
    windows = walks.windows(16, 8)
    loader = batches(windows, 10, seed=1)
    epochs = [[name for batch in loader for name in batch.names] for _ in range(2)]
    assert sorted(epochs[0]) == sorted(epochs[1]) == sorted(w.name for w in windows) and epochs[0] != epochs[1]
    assert len(loader) == -(-len(windows) // 10)
    again = batches(windows, 10, seed=1)
    assert [[name for batch in again for name in batch.names] for _ in range(2)] == epochs
    other = batches(windows, 10, seed=2)
    assert [name for batch in other for name in batch.names] != epochs[0]


@pytest.mark.parametrize("by, groups", [("style", 3), ("content", 2), (("content", "style"), 5)])
def test_balanced_batches(by, groups):
    kinds = [("walk", "old")] * 20 + [("walk", "sad")] * 3 + [("run", "old")] * 2 + [("run", "new")] + [("walk", "new")]
    ds = made([Labels(content, style, ()) for content, style in kinds])
    sampler = BalancedSampler(ds, by, seed=5)
    keys = (by,) if isinstance(by, str) else by
    for _ in range(2):
        drawn = list(sampler)
        assert len(drawn) == len(sampler) == len(ds)
        values = [tuple(getattr(ds[n], key) for key in keys) for n in drawn]
        counts = Counter(values)
        assert len(counts) == groups and max(counts.values()) - min(counts.values()) <= 1
        assert all(len(set(values[n : n + groups])) == groups for n in range(0, len(ds) - groups, groups))
        for value in counts:  # all of a label's clips come before one comes again
            clips = [n for n, v in zip(drawn, values) if v == value]
            there = sum(tuple(getattr(c, key) for key in keys) == value for c in ds)
            assert len(set(clips[:there])) == min(there, len(clips))
    assert list(BalancedSampler(ds, by, seed=5)) != drawn
    first = next(iter(batches(ds, groups, balanced=by)))
    assert len(set(zip(*(first[key].tolist() for key in keys)))) == groups


def test_balanced_windows_count_windows():
    windows = lengths([400, 20, 20]).windows(10)
    styles = Counter(s for batch in batches(windows, 11, balanced="style") for s in batch.style.tolist())
    assert max(styles.values()) - min(styles.values()) <= 1 and len(styles) == 3


def test_torchs_own_loader_and_other_processes_take_them(walks):
    windows = walks.windows(32)
    there = pickle.loads(pickle.dumps(windows))
    assert isinstance(there, Windows) and torch.equal(there[3].motion.rotations, windows[3].motion.rotations)
    batch = next(iter(DataLoader(there, 4, collate_fn=collate)))
    assert torch.equal(batch.rotations[3], windows[3].motion.rotations)


@pytest.mark.parametrize("other", [Made(1, joints=3), Made(1, fps=60.0), Made(1, phase=True)])
def test_clips_that_differ_share_no_batch(other):
    items = [Item("a", Labels("walk", "old", ()), Made(0)), Item("b", Labels("walk", "old", ()), other)]
    ds = from_items("mixed", items)
    message = r"one skeleton and frame rate are needed here, but 'a' has Skeleton\(2 joints.*, and 'b' has .*retarget"
    for attempt in (lambda: batches(ds.windows(2), 2), lambda: collate(list(ds)), lambda: ds.skeleton):
        with pytest.raises(mk.MotionKitError, match=message):
            attempt()
    assert len(ds[0].motion) == len(ds[1].motion) and len(list(batches(ds[:1], 2))) == 1


def test_batches_of_nothing(walks):
    with pytest.raises(mk.MotionKitError, match="no clips, so no skeleton"):
        batches(walks[:0], 2)
    with pytest.raises(mk.MotionKitError, match=r"made of a dataset or of its windows\(...\); found list"):
        batches([], 2)
    with pytest.raises(mk.MotionKitError, match="size is a number of samples from 1; found 0"):
        batches(walks, 0)
    with pytest.raises(mk.MotionKitError, match="balanced must be 'style', .*found 'performer'"):
        batches(walks, 2, balanced="performer")
    with pytest.raises(mk.MotionKitError, match="from one dataset"):
        collate([walks[0], lengths([5])[0]])
