"""Datasets: clips found in folders and archives, labels read from names, and a cache that notices damage."""

import pickle
import zipfile
from pathlib import Path

import pytest
import torch
from made_clips import Made, chain
from test_bvh import CHAIN, one_joint

import motionkit as mk
from motionkit import files
from motionkit.datasets import Item, Labels, Recording, from_items
from motionkit.datasets import cache as stores
from motionkit.skeleton import Skeleton

NAMES = [
    f"dataset-2_{content}_{style}_{take:03d}"
    for content in ("walk", "raise-up-both-hands")
    for style in ("normal", "elderly")
    for take in (1, 2)
]


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("MOTIONKIT_CACHE", str(folder))
    monkeypatch.delenv("MOTIONKIT_DATA", raising=False)
    return folder


@pytest.fixture
def clips(tmp_path) -> Path:
    """A folder laid out as the public archive, with eight tiny clips of two kinds of skeleton."""
    folder = tmp_path / "Research" / "dataset" / "data"
    folder.mkdir(parents=True)
    for n, name in enumerate(NAMES):
        text = CHAIN.replace("5 6 7", f"{n} 6 7") if n % 2 else one_joint("Zrotation", f"{n}", "1", "2")
        (folder / f"{name}.bvh").write_text(text)
        (folder / f"{name}.json").write_text("{}")
    (folder / "dataset-1_bow_normal_001.bvh").write_text(CHAIN)
    (folder / "dataset-2_notes.bvh").write_text("no clip")
    return tmp_path / "Research"


def zipped(folder: Path, path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*.*")):
            archive.write(file, file.relative_to(folder.parent))
    return path


def equal(a: mk.Motion, b: mk.Motion) -> None:
    assert a.skeleton.names == b.skeleton.names and a.skeleton.parents == b.skeleton.parents
    assert a.skeleton.channels == b.skeleton.channels and a.skeleton.end_sites == b.skeleton.end_sites
    assert (a.fps, a.name, a.metres_per_unit) == (b.fps, b.name, b.metres_per_unit)
    assert torch.equal(a.skeleton.offsets, b.skeleton.offsets)
    assert torch.equal(a.rotations, b.rotations) and torch.equal(a.translations, b.translations)


def no_reading(monkeypatch):
    def fail(*_):
        raise AssertionError("clips were read again")

    monkeypatch.setattr(stores, "read_all", fail)


def test_items_labels_and_motions(clips):
    ds = mk.datasets.load("bandai-2", clips)
    assert len(ds) == 8 and [clip.name for clip in ds] == sorted(NAMES)
    assert ds.contents == ("raise-up-both-hands", "walk") and ds.styles == ("elderly", "normal")
    assert repr(ds) == "Dataset('bandai-2', 8 clips, 2 contents, 2 styles)"
    first = ds[0]
    assert (first.content, first.style) == ("raise-up-both-hands", "elderly")
    assert first.text == first.texts[0] == "a person is raising both hands in old age"
    assert first.motion is first.motion and len(first) == len(first.motion)
    for clip in ds:
        equal(clip.motion, mk.load(next(clips.rglob(f"{clip.name}.bvh"))))


def test_filter_slices_and_ends(clips):
    ds = mk.datasets.load("bandai-2", clips)
    walks = ds.filter(content="walk")
    assert len(walks) == 4 and walks.contents == ("walk",) and walks.styles == ("elderly", "normal")
    assert [c.name for c in walks.filter(style=["normal"])] == NAMES[:2]
    assert [c.name for c in ds[2:4]] == sorted(NAMES)[2:4] and ds[-1].name == sorted(NAMES)[-1]
    with pytest.raises(mk.MotionKitError, match="no clip has the style 'old'; there are elderly, normal"):
        ds.filter(style="old")
    with pytest.raises(IndexError):
        ds[8]


def test_archive_is_read_in_place_and_alike(clips, tmp_path, monkeypatch):
    (tmp_path / "downloads").mkdir()
    archive = zipped(clips, tmp_path / "downloads" / "any name.zip")
    before = sorted(tmp_path.rglob("*.bvh"))
    for root in (archive, archive.parent):
        ds = mk.datasets.load("bandai-2", root)
        for a, b in zip(ds, mk.datasets.load("bandai-2", clips), strict=True):
            equal(a.motion, b.motion)
    assert sorted(tmp_path.rglob("*.bvh")) == before
    monkeypatch.setenv("MOTIONKIT_DATA", str(archive))
    assert len(mk.datasets.load("bandai-2")) == 8 and len(mk.datasets.load("bandai-1")) == 1


def test_names_in_an_archive_lead_nowhere(tmp_path):
    archive = tmp_path / "evil.zip"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("../../../dataset-2_walk_normal_001.bvh", CHAIN)
        file.writestr("/etc/dataset-2_walk_normal_002.bvh", CHAIN)
    before = set(tmp_path.rglob("*"))
    assert len(mk.datasets.load("bandai-2", archive)) == 2
    assert {p for p in set(tmp_path.rglob("*")) - before if "cache" not in p.parts} == set()


def test_second_load_reads_nothing(clips, cache, monkeypatch):
    mk.datasets.load("bandai-2", clips)
    assert sorted(p.suffix for p in cache.iterdir()) == [".f32", ".json"]
    no_reading(monkeypatch)
    ds = mk.datasets.load("bandai-2", clips)
    assert len(ds[3].motion) == len(ds[3])


def test_changed_clips_are_read_again(clips):
    path = next(clips.rglob("dataset-2_walk_normal_002.bvh"))
    before = mk.datasets.load("bandai-2", clips).filter("walk", "normal")[1].motion
    path.write_text(path.read_text().replace("90", "80"))
    after = mk.datasets.load("bandai-2", clips).filter("walk", "normal")[1].motion
    assert not torch.equal(before.rotations, after.rotations)
    path.unlink()
    assert len(mk.datasets.load("bandai-2", clips)) == 7


@pytest.mark.parametrize("suffix", [".f32", ".json"])
@pytest.mark.parametrize(
    "damage",
    [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: None, lambda b: b + b"\0\0\0\0"],
    ids=["half", "empty", "gone", "longer"],
)
def test_damaged_caches_are_made_again(clips, cache, suffix, damage):
    good = [clip.motion for clip in mk.datasets.load("bandai-2", clips)]
    path = next(cache.glob(f"*{suffix}"))
    data = damage(path.read_bytes())
    path.unlink()
    if data is not None:
        path.write_bytes(data)
    for a, b in zip(good, mk.datasets.load("bandai-2", clips), strict=True):
        equal(a, b.motion)


def test_a_flipped_bit_in_the_cache_is_noticed(clips, cache):
    ds = mk.datasets.load("bandai-2", clips)
    path = next(cache.glob("*.f32"))
    data = bytearray(path.read_bytes())
    data[50] ^= 4
    path.write_bytes(data)
    with pytest.raises(mk.MotionKitError, match=r"the cache is damaged at clip 'dataset-2.*load the dataset again"):
        [clip.motion for clip in mk.datasets.load("bandai-2", clips)]
    assert len([clip.motion for clip in mk.datasets.load("bandai-2", clips)]) == len(ds)


def test_a_bad_clip_is_named_and_leaves_no_cache(clips, cache):
    next(clips.rglob("dataset-2_walk_normal_002.bvh")).write_text(CHAIN[:-20])
    with pytest.raises(mk.MotionKitError, match=r"dataset-2_walk_normal_002.bvh, line 25: "):
        mk.datasets.load("bandai-2", clips)
    assert list(cache.iterdir()) == []


def test_a_clip_whose_count_disagrees_is_told_of(clips):
    path = next(clips.rglob("dataset-2_walk_normal_002.bvh"))
    path.write_text(path.read_text().replace("Frames: 2", "Frames: 9"))
    with pytest.warns(mk.MotionKitWarning, match="dataset-2_walk_normal_002.bvh: 'Frames: 9' disagrees"):
        mk.datasets.load("bandai-2", clips)


def test_a_dataset_can_be_sent_to_another_process(clips):
    ds = mk.datasets.load("bandai-2", clips)
    ds[0].motion.positions()
    sent = pickle.dumps(ds.filter("walk"))
    equal(pickle.loads(sent)[1].motion, ds.filter("walk")[1].motion)
    assert len(sent) < 20_000


def test_missing_data_say_how_to_get_them(tmp_path):
    how = "github.com/BandaiNamcoResearchInc.*CC BY-NC 4.0.*MOTIONKIT_DATA"
    with pytest.raises(mk.MotionKitError, match=f"MOTIONKIT_DATA is not set; .*{how}"):
        mk.datasets.load("bandai-2")
    with pytest.raises(mk.MotionKitError, match=f"nowhere: no such file or folder; .*{how}"):
        mk.datasets.load("bandai-2", tmp_path / "nowhere")
    with pytest.raises(mk.MotionKitError, match=f"no clips of bandai-2 here .*{how}"):
        mk.datasets.load("bandai-2", tmp_path)
    (tmp_path / "broken.zip").write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(mk.MotionKitError, match=f"broken.zip: neither a folder nor a whole zip archive .*{how}"):
        mk.datasets.load("bandai-2", tmp_path / "broken.zip")
    with pytest.raises(mk.MotionKitError, match="no dataset 'bandai'; there are '100style', 'actor'"):
        mk.datasets.load("bandai", tmp_path)


def test_a_damaged_member_is_named(clips, tmp_path):
    archive = zipped(clips, tmp_path / "a.zip")
    data = bytearray(archive.read_bytes())
    with zipfile.ZipFile(archive) as file:
        place = next(m for m in file.infolist() if m.filename.endswith("walk_normal_001.bvh")).header_offset
    data[place + 150 : place + 160] = b"\xff" * 10
    archive.write_bytes(data)
    with pytest.raises(mk.MotionKitError, match="a.zip: .*dataset-2_walk_normal_001.bvh cannot be read"):
        mk.datasets.load("bandai-2", archive)


def test_cache_folder_that_cannot_be(tmp_path, clips, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path / "file"))
    with pytest.raises(mk.MotionKitError, match="cannot make the cache folder: .*set MOTIONKIT_CACHE"):
        mk.datasets.load("bandai-2", clips)


@pytest.mark.parametrize("platform, part", [("linux", ".cache"), ("darwin", "Caches"), ("win32", "Local")])
def test_default_cache_folder(platform, part, monkeypatch):
    for variable in ("MOTIONKIT_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(files.sys, "platform", platform)
    assert files.cache_folder().parts[-2:] == (part, "motionkit")


def test_several_processes_read_the_same(clips, cache, monkeypatch):
    alone = [clip.motion for clip in mk.datasets.load("bandai-2", clips)]
    for path in cache.iterdir():
        path.unlink()
    monkeypatch.setattr(stores, "_FEW", 0)
    monkeypatch.setattr(stores, "_BATCH", 3)
    for a, b in zip(alone, mk.datasets.load("bandai-2", clips), strict=True):
        equal(a, b.motion)


@pytest.mark.captures
def test_real_captures(captures_dir):
    ds = mk.datasets.load("bandai-2", captures_dir)
    assert len(ds) == 18 and len(ds.contents) == 2 and len(ds.styles) == 3
    for clip in ds[::5]:
        equal(clip.motion, mk.load(captures_dir / f"{clip.name}.bvh"))


@pytest.mark.captures
def test_the_whole_archive_is_found(captures):
    found = mk.datasets.list_items("bandai-2", captures)
    assert len(found) == 2902 and len({item.labels[:2] for item in found}) == 70


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
