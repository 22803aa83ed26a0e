"""The arena's protocols on labels alone, and its table as text, HTML, JSON and picture."""

import json
import math
from dataclasses import replace

import made_clips
import pytest

import motionkit as mk
from motionkit.arena import PROTOCOLS, ArenaTable, Cell, Protocol, Row
from motionkit.datasets import Labels

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
    with pytest.raises(mk.MotionKitError, match="without results"):
        back.results("good")
    with pytest.raises(mk.MotionKitError, match="no row 'bad'"):
        back.results("bad")
    with pytest.raises(mk.MotionKitError, match="no column"):
        table.only("fid")
    path.write_text("{}")
    with pytest.raises(mk.MotionKitError, match="not a table"):
        ArenaTable.from_json(path)


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
