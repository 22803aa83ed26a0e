"""Readers of published captures: small files in each set's own format, whole and broken; and where they may lie."""

import warnings
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch
from test_bvh import CHAIN, STILL

import motionkit as mk
from motionkit.datasets import captures as readers
from motionkit.datasets import sources
from motionkit.text import captions

pytestmark = pytest.mark.usefixtures("nothing_set")


def write(root: Path, files: dict[str, str | bytes]) -> Path:
    for place, content in files.items():
        path = root / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return root


def zipped(root: Path, path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(p for p in root.rglob("*") if p.is_file()):
            archive.write(file, file.relative_to(root.parent))
    return path


def chain(frames: int) -> str:
    """CHAIN with so many frames, in which the root's X counts them (in the file's unit)."""
    head = CHAIN.split("Frames:")[0]
    rows = (STILL.replace("0", str(n), 1) for n in range(frames))
    return f"{head}Frames: {frames}\nFrame Time: 0.01666667\n" + "\n".join(rows) + "\n"


def fails(message: str):
    return pytest.raises(mk.MotionKitError, match=message)


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


def test_folder_by_pattern(root, tmp_path):
    write(
        root, {"a/walk_old_01.bvh": CHAIN, "b/walk_old_01.BVH": CHAIN, "b/run_very-proud_7.bvh": CHAIN, "notes.txt": ""}
    )
    for place in (root, zipped(root, tmp_path / "f.zip")):
        items = {item.name.removeprefix("data/"): item.labels for item in readers.folder_items(root=place)}
        assert list(items) == ["a/walk_old_01", "b/walk_old_01", "run_very-proud_7"]
        assert items["a/walk_old_01"].take == items["b/walk_old_01"].take == "walk_old_01"
        assert items["run_very-proud_7"][:2] == ("run", "very-proud")
        assert items["run_very-proud_7"].texts[0] == "a person is running in a very proud style"
    ds = mk.datasets.load("folder", root, pattern="{performer}/{content}_{style}_{}")
    assert [clip.performer for clip in ds] == ["a", "b", "b"] and ds[0].labels.take == ""


@pytest.mark.parametrize(
    "pattern, name, labels",
    [
        ("{content}", "walk", ("walk", "")),
        ("{style}.{content}", "old.walk_1", ("walk_1", "old")),
        ("take{take}__{style}", "take7__old-man", ("", "old-man")),
        ("{}-{content}({style})", "007-walk(old)", ("walk", "old")),
        ("{split}/{style}/{content}", "deep/test/old/walk", ("walk", "old")),
    ],
)
def test_folder_patterns(root, pattern, name, labels):
    (item,) = readers.folder_items(root=write(root, {f"{name}.bvh": CHAIN}), pattern=pattern)
    assert item.labels[:2] == labels and item.labels.split == ("test" if "split" in pattern else "")
    assert item.labels.texts[0].startswith("a person is ")


@pytest.mark.parametrize(
    "pattern, message",
    [
        ("{content}_{style}_{take}", "'walk_left_old_1' does not fit the pattern .*table="),
        ("{content}_{mood}", r"no label 'mood'; there are \{content\}"),
        ("{style}_{style}", "'style' is there twice"),
        ("{content}{style}", "nothing stands between two labels"),
        ("walk", "no label in it"),
        ("{content", "write labels as in"),
    ],
)
def test_folder_patterns_that_do_not_fit(root, pattern, message):
    with fails(message):
        readers.folder_items(root=write(root, {"walk_left_old_1.bvh": CHAIN}), pattern=pattern)


TABLE = "file,content,style,text,performer,split\n"


@pytest.mark.parametrize("separator", [",", ";"])
def test_folder_by_table(root, tmp_path, separator):
    rows = 'x/1.bvh,walk,old,"he walks|he strolls",Ann,train\n2,run,,,,\n'
    write(root, {"x/1.bvh": CHAIN, "2.bvh": CHAIN, "labels.csv": ("\ufeff" + TABLE + rows).replace(",", separator)})
    items = readers.folder_items(root=root, table="labels.csv")
    assert [item.name for item in items] == ["1", "2"]
    assert items[0].labels == ("walk", "old", ("he walks", "he strolls"), "Ann", "", "train")
    assert items[1].labels.texts == ("a person is running", "someone is jogging along")
    (root / "labels.csv").rename(tmp_path / "labels.csv")
    assert readers.folder_items(root=root, table=tmp_path / "labels.csv") == items


def test_folder_table_in_a_zip(root, tmp_path):
    write(root, {"1.bvh": CHAIN, "labels.csv": "file,style,take\n1.bvh,old,7\n"})
    with zipfile.ZipFile(tmp_path / "f.zip", "w") as archive:
        for name in ("1.bvh", "labels.csv"):
            archive.write(root / name, name)
    (item,) = readers.folder_items(root=tmp_path / "f.zip", table="labels.csv")
    assert (item.labels.style, item.labels.take) == ("old", "7") and len(item.source.read().motion) == 2


@pytest.mark.parametrize(
    "table, message",
    [
        (TABLE + "1,walk,old,,,\n", "labels.csv: 1 of 2 files have no line, such as 2.bvh"),
        (TABLE + "1,a,b,,,\n2,a,b,,,\n3,a,b,,,\n", "labels.csv, line 4: no file '3'; expected a path below the root"),
        (TABLE + "1,a,b,,,\n1.bvh,a,b,,,\n", "line 3: '1.bvh' is there twice"),
        (TABLE + "1,walk,old,he walks, then stops,,\n", "line 2: expected 6 cells; put text with commas in quotes"),
        (TABLE + "1,walk\n", "line 2: expected 6 cells"),
        ("name,style\n1,old\n", "line 1: expected the column 'file' and any of .* found 'name', 'style'"),
        ("file,mood\n1,old\n", "line 1: expected the column 'file' and any of content"),
        ("", "line 1: .*found nothing"),
        (b"file\n\xff\n", "expected UTF-8 text"),
        (None, "labels.csv: no such table, neither in .* there: no CSV file"),
    ],
)
def test_folder_tables_that_are_broken(root, table, message):
    write(root, {"1.bvh": CHAIN, "2.bvh": CHAIN} | ({} if table is None else {"labels.csv": table}))
    with fails(message):
        readers.folder_items(root=root, table="labels.csv")


def test_folder_that_is_empty(root):
    with fails("data: no clips of folder here"):
        readers.folder_items(root=root)
    with fails("where are your clips\\?"):
        readers.folder_items()


@pytest.fixture(scope="module")
def features() -> np.ndarray:
    x = mk.features.HumanML3D().encode(mk.load("data/actor/walk_neutral.bvh").resample(20))
    return x[:-1].numpy()


@pytest.fixture
def human(root, features) -> Path:
    def npy(x) -> bytes:
        path = root / "x.npy"
        np.save(path, x)
        data = path.read_bytes()
        path.unlink()
        return data

    texts = "a man walks.#a/DET man/NOUN walk/VERB#0.0#0.0\na person strolls.#a/DET#nan#nan\n"
    part = "he steps.#he/PRON step/VERB#0.5#1.25\nlater he flies.#he/PRON#900.0#901.0\nhe waits.#he/PRON#2.0#1.0\n"
    write(root, {f"texts/{name}.txt": texts for name in ("000000", "M000000", "007975")})
    write(root, {"texts/000001.txt": part, "new_joints/000000.npy": npy(np.zeros((5, 22, 3)))})
    write(root, {"train.txt": "000000\nM000000\n", "val.txt": "000001\n", "test.txt": "\n", "all.txt": "000000\n"})
    names = ("000000", "M000000", "000001", "007975")
    return write(root, {f"new_joint_vecs/{name}.npy": npy(features.astype(np.float64)) for name in names})


def test_humanml3d(human, features, tmp_path):
    for place in (human, zipped(human, tmp_path / "h.zip")):
        items = {item.name: item for item in readers.humanml3d_items(root=place)}
        assert list(items) == ["000000", "000001@0.5-1.25", "M000000"]
        whole, part, mirror = (item.labels for item in items.values())
        assert whole.texts == ("a man walks.", "a person strolls.") and part.texts == ("he steps.",)
        assert whole.take == mirror.take == "000000" and part.take == "000001"
        assert (whole.split, part.split, mirror.split) == ("train", "validation", "train")
        assert whole[:2] == ("", "")
        read = items["000000"].source.read()
        assert len(read.motion) == len(features) and read.motion.fps == 20 and read.motion.name == "000000"
        assert read.tracks["contacts"].shape == (len(features), 4)
        cut = items["000001@0.5-1.25"].source.read()
        assert torch.equal(cut.motion.rotations, read.motion.rotations[10:25])
        assert torch.equal(cut.tracks["contacts"], read.tracks["contacts"][10:25])
    places = mk.features.HumanML3D(fps=20).positions(torch.from_numpy(features))
    assert (read.motion.positions() - places).norm(dim=-1).mean() < 0.02
    assert len(mk.datasets.load("humanml3d", human)) == 3


def test_humanml3d_lists_that_name_more_than_is_there(human):
    write(human, {"test.txt": "000123\n000124\n007975\n"})
    with pytest.warns(mk.MotionKitWarning, match="2 of 6 listed motions are not beside it, such as 000123"):
        assert len(readers.humanml3d_items(root=human)) == 3
    write(human, {"test.txt": "000000\n"})
    with warnings.catch_warnings(), fails("(train|test).txt: 000000 is in the list for (train|test) too"):
        readers.humanml3d_items(root=human)


@pytest.mark.parametrize(
    "text, message",
    [
        (None, "000001.npy: no captions for it; expected texts/000001.txt"),
        ("", "000001.txt: no caption in it"),
        ("a man walks.\n", "000001.txt, line 1: expected caption#tokens#start#end"),
        ("\na man#a/DET#0.0#soon\n", "000001.txt, line 2: expected caption#tokens#start#end"),
        ("#a/DET#0.0#0.0\n", "line 1: expected caption"),
        ("a man#a/DET#-1.0#2.0\n", "line 1: expected caption"),
    ],
)
def test_humanml3d_captions_that_are_broken(human, text, message):
    path = human / "texts" / "000001.txt"
    path.unlink() if text is None else path.write_text(text)
    with fails(message):
        readers.humanml3d_items(root=human)


@pytest.mark.parametrize(
    "array, message",
    [
        (np.zeros((5, 22, 3)), r"expected floating-point numbers \[frames, 263\].*found float64 \[5, 22, 3\]"),
        (np.zeros((0, 263), np.float32), r"found float32 \[0, 263\]"),
        (np.zeros((5, 263), np.int64), r"found int64 \[5, 263\]"),
        (np.array([{}], object), "not a whole .npy file"),
        (np.where(np.arange(526).reshape(2, 263) == 300, np.nan, 0.0), "frame 1, number 37 is nan"),
    ],
)
def test_humanml3d_numbers_that_are_broken(human, array, message):
    np.save(human / "new_joint_vecs" / "000000.npy", array)
    with fails(f"000000.npy: .*{message}"):
        readers.humanml3d_items(root=human)[0].source.read()


def test_humanml3d_files_cut_short(human):
    for name in ("000000", "000001"):
        path = human / "new_joint_vecs" / f"{name}.npy"
        path.write_bytes(path.read_bytes()[: 1000 if name == "000000" else 9])
    with fails("000001.npy: not a whole .npy file"):
        readers.humanml3d_items(root=human)
    write(human, {"texts/000001.txt": "he walks.#he/PRON#0.0#0.0\n"})
    with fails("000000.npy: not a whole .npy file"):
        readers.humanml3d_items(root=human)[0].source.read()


def test_humanml3d_positions_are_not_features(human):
    for path in (human / "new_joint_vecs").iterdir():
        path.unlink()
    with fails("new_joints/000000.npy: motions, but none in a folder new_joint_vecs"):
        readers.humanml3d_items(root=human)


@pytest.mark.captures
def test_the_whole_archive_is_found(captures):
    items = readers.bandai_items("bandai-2", captures)
    assert len(items) == 2902 and len({item.labels[:2] for item in items}) == 70
    assert min(len(set(item.labels.texts)) for item in items) == 4
