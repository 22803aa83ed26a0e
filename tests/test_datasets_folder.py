"""The reader of anybody's BVH files: labels by a pattern or from a table."""

import zipfile

import pytest
from small_files import fails, write, zipped
from test_bvh import CHAIN

import motionkit as mk
from motionkit.datasets import captures

pytestmark = pytest.mark.usefixtures("nothing_set")


def test_folder_by_pattern(root, tmp_path):
    write(
        root, {"a/walk_old_01.bvh": CHAIN, "b/walk_old_01.BVH": CHAIN, "b/run_very-proud_7.bvh": CHAIN, "notes.txt": ""}
    )
    for place in (root, zipped(root, tmp_path / "f.zip")):
        items = {item.name.removeprefix("data/"): item.labels for item in captures.folder_items(root=place)}
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
    (item,) = captures.folder_items(root=write(root, {f"{name}.bvh": CHAIN}), pattern=pattern)
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
        captures.folder_items(root=write(root, {"walk_left_old_1.bvh": CHAIN}), pattern=pattern)


TABLE = "file,content,style,text,performer,split\n"


@pytest.mark.parametrize("separator", [",", ";"])
def test_folder_by_table(root, tmp_path, separator):
    rows = 'x/1.bvh,walk,old,"he walks|he strolls",Ann,train\n2,run,,,,\n'
    write(root, {"x/1.bvh": CHAIN, "2.bvh": CHAIN, "labels.csv": ("\ufeff" + TABLE + rows).replace(",", separator)})
    items = captures.folder_items(root=root, table="labels.csv")
    assert [item.name for item in items] == ["1", "2"]
    assert items[0].labels == ("walk", "old", ("he walks", "he strolls"), "Ann", "", "train")
    assert items[1].labels.texts == ("a person is running", "someone is jogging along")
    (root / "labels.csv").rename(tmp_path / "labels.csv")
    assert captures.folder_items(root=root, table=tmp_path / "labels.csv") == items


def test_folder_table_in_a_zip(root, tmp_path):
    write(root, {"1.bvh": CHAIN, "labels.csv": "file,style,take\n1.bvh,old,7\n"})
    with zipfile.ZipFile(tmp_path / "f.zip", "w") as archive:
        for name in ("1.bvh", "labels.csv"):
            archive.write(root / name, name)
    (item,) = captures.folder_items(root=tmp_path / "f.zip", table="labels.csv")
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
        captures.folder_items(root=root, table="labels.csv")


def test_folder_that_is_empty(root):
    with fails("data: no clips of folder here"):
        captures.folder_items(root=root)
    with fails("where are your clips\\?"):
        captures.folder_items()
