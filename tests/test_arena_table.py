"""The arena's table as text, HTML, JSON and picture."""

import json
import math
from dataclasses import replace

import pytest

import motionkit as mk
from motionkit.arena import ArenaTable, Cell, Row


@pytest.fixture
def table():
    rows = (
        Row("good", {"fmd": Cell(1.004, 0.5, 2.25), "cra": Cell(80.0, 70.0, 90.0)}, 20),
        Row("tie", {"fmd": Cell(1.001, 0.5, 2.25), "cra": Cell(70.0, 60.0, 75.5)}, 20),
        Row(
            "partial",
            {"fmd": Cell(0.5, 0.1, 0.9, missing=3), "cra": Cell(85.0, 80.0, 90.0)},
            20,
            {2: "walk as old: ValueError: a < b"},
        ),
        Row("none", {"fmd": Cell(math.nan, why="5 motions; too few"), "cra": Cell(0.0, 0.0, 0.0)}, 20),
        Row("real", {"fmd": Cell(0.1, 0.0, 0.2), "cra": Cell(100.0, 100.0, 100.0)}, 9),
    )
    about = {"dataset": "toy", "protocol": "small", "seed": 0, "transfers": 20, "judge": "toy", "shrinkage": None}
    return ArenaTable(rows, ("fmd", "cra"), about)


def test_text(table):
    assert str(table).splitlines() == [
        "toy, protocol small, seed 0: 20 transfers, judge toy; [95 % interval]",
        "method   FMD ↓               CRA % ↑",
        "good     1.00 [0.50, 2.25]   80.0 [70.0, 90.0]",
        "tie      1.00 [0.50, 2.25]   70.0 [60.0, 75.5]",
        "partial  0.50* [0.10, 0.90]  85.0 [80.0, 90.0]",
        "none     –                   0.0 [0.0, 0.0]",
        "real     0.10 [0.00, 0.20]   100.0 [100.0, 100.0]",
        "partial: 1 of 20 transfers failed, counted as not recognised: walk as old: ValueError: a < b",
        "* partial: FMD without 3 of 20",
        "none: no FMD: 5 motions; too few",
    ]
    assert str(table.only("cra")).splitlines()[1] == "method   CRA % ↑"
    assert table.best("fmd") == "tie" and table.best("cra") == "good"  # who fails does not win, nor do real clips


def test_wide_tables_are_cut_between_columns(table):
    wide = replace(table, columns=("fmd", "cra") * 6)
    assert max(map(len, str(wide).splitlines()[1:15])) <= 120
    assert str(wide).count("CRA % ↑") == 6


def test_html(table):
    html = table._repr_html_()
    assert html.count("<b>") == 3 and html.count("<b>1.00</b>") == 2 and "<b>80.0</b>" in html
    assert "a &lt; b" in html and "<td style" in html and "0.50</b>" not in html


def test_deviations_print_as_in_paper_3(table):
    row = Row("m", {"cra": Cell(60.86, 58.8, 62.92, deviation=True)}, 20)
    again = ArenaTable.from_records(replace(table, rows=(row,)).records())
    assert "60.9±2.1" in str(again) and again.records()[0]["cra_std"] == pytest.approx(2.06)


def test_json_there_and_back(table, tmp_path):
    path = table.to_json(tmp_path / "table.json")
    back = ArenaTable.from_json(path)
    assert str(back) == str(table) and back.records() == table.records()
    assert json.loads(path.read_text())["rows"][3]["fmd"] is None
    assert {record["dataset"] for record in table.records()} == {"toy"}
    with pytest.raises(mk.MotionKitError, match="without results"):
        back.results("good")
    with pytest.raises(mk.MotionKitError, match="no row 'bad'"):
        back.results("bad")
    with pytest.raises(mk.MotionKitError, match="no column"):
        table.only("fid")
    path.write_text("{}")
    with pytest.raises(mk.MotionKitError, match="not a table"):
        ArenaTable.from_json(path)


def test_every_record_names_its_dataset(table):
    rows = [replace(row, dataset=name) for row, name in zip(table.rows, ("actor", "bandai-2"))]
    records = replace(table, rows=tuple(rows)).records()
    assert [record["dataset"] for record in records] == ["actor", "bandai-2"]
    assert ArenaTable.from_records(records).records() == records  # without what the table was measured on
    for record in records:
        del record["dataset"]  # as older files have them
    assert [row.dataset for row in ArenaTable.from_records(records, {"dataset": "toy"}).rows] == ["toy", "toy"]


def test_picture(table):
    picture = mk.lessons.judging.plot_arena(table)
    first, second = picture.axes
    assert [label.get_text() for label in first.get_yticklabels()] == ["good", "tie", "partial", "none"]
    dots = [line for line in first.lines if line.get_marker() == "o"]
    assert [float(line.get_xdata()[0]) for line in dots] == [1.004, 1.001, 0.5]
    assert dots[2].get_markerfacecolor() == "white" != dots[0].get_markerfacecolor()
    assert [text.get_text() for text in first.texts] == ["–"]
    assert second.get_title(loc="left") == "CRA % ↑" and picture._repr_png_()[:4] == b"\x89PNG"
    assert len(mk.lessons.judging.plot_arena(table, "cra").axes) == 1
    with pytest.raises(mk.MotionKitError, match="plot_arena draws"):
        mk.lessons.judging.plot_arena("table")
