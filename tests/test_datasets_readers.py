"""Readers of published captures: small files in each set's own format, whole and broken; and where they may lie."""

import zipfile
from collections import Counter
from pathlib import Path

import pytest
import torch
from small_files import chain, fails, write, zipped
from test_bvh import CHAIN

import motionkit as mk
from motionkit.datasets import captures as readers
from motionkit.datasets import sources
from motionkit.text import captions

pytestmark = pytest.mark.usefixtures("nothing_set")


NAMES = ["dataset-2_run_exhausted_003", "dataset-2_walk_normal_001", "dataset-2_wave-left-hand_elderly_012"]
NUMBERS = ['{"content": 3, "style": 2}', '{"content": 0, "style": 5}', '{"content": 5, "style": 1}']


@pytest.fixture
def bandai_2(root) -> Path:
    for name, numbers in zip(NAMES, NUMBERS):
        write(root, {f"x/data/{name}.bvh": CHAIN, f"x/data/{name}.json": numbers})
    return write(root, {"x/data/dataset-2_run.bvh": "no clip", "x/data/._" + NAMES[0] + ".bvh": "left by a Mac"})


def test_bandai_labels_come_from_names(bandai_2, tmp_path):
    for place in (bandai_2, zipped(bandai_2, tmp_path / "a.zip"), tmp_path):
        items = readers.bandai_items("bandai-2", place)
        assert [item.name for item in items] == NAMES
        assert [item.labels[:2] for item in items] == [
            ("run", "exhausted"),
            ("walk", "normal"),
            ("wave-left-hand", "elderly"),
        ]
        assert [item.labels.take for item in items] == NAMES
        assert [len(item.source.read().motion) for item in items] == [2, 2, 2]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.zip", "data"]


def test_bandai_captions():
    told = {
        label: readers.bandai_labels(f"dataset-1_walk_{label}_001").texts
        for label in readers.BANDAI_LABELS["bandai-1"]["style"].split()
    }
    assert told["sad"][0] == "a person is walking in sadness"
    assert told["normal"][0] == "a person is walking neutrally" and told["normal"][2] == "a person is walking"
    assert told["old"][2] == "an old person is walking"
    for texts in told.values():
        assert len(set(texts)) == 4 and not any("  " in t or t != t.strip() for t in texts)
    for name, kinds in readers.BANDAI_LABELS.items():
        for content in kinds["content"].split():
            clip = f"{readers.FILE_PREFIXES[name]}_{content}_tired_001"
            assert not any("doing " + content in t for t in readers.bandai_labels(clip).texts), content
    assert (
        captions.capture_captions("walking", "going on foot", "very-odd")[0]
        == "a person is walking in a very odd style"
    )


@pytest.mark.parametrize(
    "numbers, message",
    [
        ('{"content": 4, "style": 2}', r"content 'run', which is number 3; it gives number 4 \(wave-both-hands\)"),
        ('{"content": 3, "style": 99}', "style 'exhausted', which is number 2; it gives number 99;"),
        ('{"content": 3, "st', "expected label numbers such as .* get the file again"),
        ("7", "expected label numbers such as"),
        (b"\xff\xfe", "expected UTF-8 text"),
    ],
)
def test_bandai_label_files_must_agree(bandai_2, tmp_path, numbers, message):
    write(bandai_2, {f"x/data/{NAMES[0]}.json": numbers})
    with fails(f"data/{NAMES[0]}.json: .*{message}"):
        readers.bandai_items("bandai-2", bandai_2)
    with fails(f"a.zip/data/x/data/{NAMES[0]}.json: .*{message}"):
        readers.bandai_items("bandai-2", zipped(bandai_2, tmp_path / "a.zip"))


def test_bandai_does_without_label_files_and_takes_own_labels(bandai_2):
    (bandai_2 / f"x/data/{NAMES[0]}.json").unlink()
    own = "dataset-2_juggle_odd_001"
    write(bandai_2, {f"x/data/{own}.bvh": CHAIN, f"x/data/{own}.json": '{"content": 70, "style": 70}'})
    assert [item.name for item in readers.bandai_items("bandai-2", bandai_2)] == sorted([*NAMES, own])
    write(bandai_2, {f"x/data/{own}.json": '{"content": 0, "style": 70}'})
    with fails(r"content 'juggle', which is number of no other; it gives number 0 \(walk\)"):
        readers.bandai_items("bandai-2", bandai_2)


def test_places_are_looked_for_in_order(bandai_2, tmp_path, monkeypatch):
    with fails("where is bandai-2\\? No root is given and MOTIONKIT_DATA is not set; .*datasets.fetch"):
        readers.bandai_items("bandai-2")
    home = tmp_path / "cache" / "captures"
    home.mkdir(parents=True)
    with fails("captures: no clips of bandai-2 here .*datasets.fetch"):
        readers.bandai_items("bandai-2")
    bandai_2.rename(home / "bandai-2")
    assert len(readers.bandai_items("bandai-2")) == 3
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.setenv("MOTIONKIT_DATA", str(tmp_path / "elsewhere"))
    with fails("elsewhere: no clips of bandai-2 here"):
        readers.bandai_items("bandai-2")


def test_unfinished_and_hidden_things_are_passed_over(bandai_2, tmp_path):
    (tmp_path / "found").mkdir()
    write(tmp_path / "found", {".bandai-2.unpacking/dataset-2_run_old_001.bvh": CHAIN, "half.zip": b"PK\x03\x04 half"})
    with fails("half.zip: neither a folder nor a whole zip archive .*CC BY-NC"):
        readers.bandai_items("bandai-2", tmp_path / "found")
    zipped(bandai_2, tmp_path / "found" / "whole.zip")
    assert len(readers.bandai_items("bandai-2", tmp_path / "found")) == 3
    data = (tmp_path / "found" / "whole.zip").read_bytes()
    write(tmp_path, {"cut.zip": data[: len(data) // 2]})
    with fails("cut.zip: neither a folder nor a whole zip archive"):
        readers.bandai_items("bandai-2", tmp_path / "cut.zip")


def test_one_of_each_name_and_no_place_outside(root, tmp_path):
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as archive:
        for place in ("../../../", "/etc/", "C:/"):
            archive.writestr(f"{place}{NAMES[0]}.bvh", CHAIN)
    before = set(tmp_path.rglob("*"))
    (item,) = readers.bandai_items("bandai-2", tmp_path / "evil.zip")
    assert len(item.source.read().motion) == 2 and set(tmp_path.rglob("*")) == before


def test_damaged_tables_in_archives_are_named(bandai_2, tmp_path):
    archive = zipped(bandai_2, tmp_path / "a.zip")
    data = archive.read_bytes()
    place = data.index(b"data/x/data/" + NAMES[0].encode() + b".json")
    archive.write_bytes(data[: place + 60] + b"\xff" * 8 + data[place + 68 :])
    with fails("a.zip/data/x/data/.*json: cannot be read .*get the data again"):
        readers.bandai_items("bandai-2", archive)
    (tmp_path / "a.json").write_text("{}")
    with fails("1099511627776 bytes, which is no table"):
        sources.File("a.json", str(tmp_path / "a.json"), None, 1 << 40, 0).text()


def test_xia(root, tmp_path):
    names = [f"angry_{n:02d}_{take:03d}" for n, take in ((1, 0), (1, 1), (2, 0), (3, 0), (13, 0), (13, 1), (28, 4))]
    write(root, {f"mocap/{name}.bvh": CHAIN for name in [*names, "neutral_22_000"]} | {"mocap/rest.bvh": CHAIN})
    items = {item.name: item for item in readers.xia_items(root=zipped(root, tmp_path / "xia.zip"))}
    assert list(items) == sorted([*names, "neutral_22_000"])
    contents = {name: item.labels.content for name, item in items.items()}
    assert [contents[n] for n in names] == ["walk", "walk", "walk", "walk", "run", "run", "trans"]
    assert contents["neutral_22_000"] == "kick" and items["neutral_22_000"].labels.style == "neutral"
    assert items["angry_03_000"].labels.texts[0] == "a person is walking and turning left in anger"
    tested = [name for name, item in items.items() if item.labels.split == "test"]
    assert tested == ["angry_01_000", "angry_01_001", "angry_02_000", "angry_13_000", "neutral_22_000"]
    assert len(items["angry_01_000"].source.read().motion) == 2


def test_xia_contents_are_the_published_28():
    counts = Counter(content for content, *_ in readers.XIA_CONTENTS)
    assert counts == {"walk": 12, "run": 3, "jump": 2, "punch": 4, "kick": 2, "trans": 5}


@pytest.mark.parametrize("name, message", [("sad_01_000", "style 'sad'; xia has angry"), ("old_29_000", "number 29")])
def test_xia_names_that_do_not_fit(root, name, message):
    with fails(f"{name}: .*{message}.*rename the clip"):
        readers.xia_items(root=write(root, {f"{name}.bvh": CHAIN}))


ENDS = [f"{gait}_{end}" for gait in readers.GAITS for end in ("START", "STOP")]


def cuts(**rows: dict[str, int]) -> str:
    lines = [",".join(["STYLE_NAME", *ENDS])]
    lines += [",".join([style, *(str(row.get(end, "N/A")) for end in ENDS)]) for style, row in rows.items()]
    return "\r\n".join(lines) + "\r\n"


@pytest.fixture
def style_100(root) -> Path:
    table = cuts(
        Old={"FW_START": 2, "FW_STOP": 9, "ID_START": 0, "ID_STOP": 10},
        ArmsAboveHead={"TR1_START": 5, "TR1_STOP": 6},
    )
    described = "Style Name,Description,Stochastic,Symmetric Style\nArms Above Head,Arms raised above head.,No,Yes\n"
    clips = ["Old/Old_FW", "Old/Old_ID", "ArmsAboveHead/ArmsAboveHead_TR1", "ArmsAboveHead/ArmsAboveHead_TR2"]
    write(root, {"100STYLE/Frame_Cuts.csv": table, "100STYLE/Dataset_List.csv": described})
    return write(root, {f"100STYLE/{clip}.bvh": chain(10) for clip in clips})


def test_100style(style_100, tmp_path):
    for place in (style_100, zipped(style_100, tmp_path / "s.zip")):
        items = readers.style100_items(root=place)
        assert [item.name for item in items] == ["ArmsAboveHead_TR1", "Old_FW", "Old_ID"]  # TR2 is N/A
        assert [item.labels[:2] for item in items] == [
            ("transition", "arms-above-head"),
            ("walk", "old"),
            ("idle", "old"),
        ]
        walk = items[1].source.read().motion
        assert len(walk) == 7 and walk.fps == pytest.approx(60, abs=0.01)
        x = walk.translations[:, 0, 0]
        assert torch.allclose(x / x[0] * 2, torch.arange(2.0, 9.0))
        assert items[1].labels.texts[0] == "a person is walking forward in old age"
        assert items[0].labels.texts[-1] == "a person is changing from one gait to another: arms raised above head"
        assert len(set(items[0].labels.texts)) == 5
    ds = mk.datasets.load("100style", style_100)
    assert [len(clip) for clip in ds] == [1, 7, 10] and ds.styles == ("arms-above-head", "old")


@pytest.mark.parametrize(
    "table, message",
    [
        (None, "there are clips, but no Frame_Cuts.csv"),
        ("", "line 1: expected a table with the column 'STYLE_NAME'; found nothing"),
        ("style,BR_START\n", "line 1: expected a table with the column 'STYLE_NAME'; found style, BR_START"),
        (cuts(Old={"FW_START": 2, "FW_STOP": 9}), "no cut for TR1 of 'ArmsAboveHead'"),
        (cuts(Old={"FW_START": 9, "FW_STOP": 2}), "line 2: .*FW_START and FW_STOP of 'Old'; found '9' and '2'"),
        (cuts(Old={"FW_START": 9}), "line 2: .*found '9' and 'N/A'"),
        (cuts(Old={"FW_START": "two", "FW_STOP": 9}), "line 2: .*found 'two' and '9'"),
        (cuts(Old={}) + cuts(Old={}).split("\r\n")[1] + "\r\n", "line 3: style 'Old' is there twice"),
    ],
)
def test_100style_tables_that_are_broken(style_100, table, message):
    path = style_100 / "100STYLE" / "Frame_Cuts.csv"
    path.unlink() if table is None else path.write_text(table)
    with fails(message):
        readers.style100_items(root=style_100)


def test_100style_cut_beyond_the_end(style_100):
    write(style_100, {"100STYLE/Old/Old_FW.bvh": chain(5)})
    with fails("Old_FW.bvh: the table of cuts says frames 2 to 9; the file has 5"):
        readers.style100_items(root=style_100)[1].source.read()


@pytest.mark.captures
def test_the_whole_archive_is_found(captures):
    items = readers.bandai_items("bandai-2", captures)
    assert len(items) == 2902 and len({item.labels[:2] for item in items}) == 70
    assert min(len(set(item.labels.texts)) for item in items) == 4
