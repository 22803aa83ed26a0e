"""The example clips in data/actor: all there, of the right kinds, and as the tool makes them."""

import sys
from collections import Counter
from pathlib import Path

import pytest
import torch

import make_examples
import motionkit as mk
from motionkit.actor import CONTENTS, performing
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES
from motionkit.contacts import foot_contacts

FOLDER = Path(__file__).resolve().parent.parent / "data" / "actor"


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """The clips as a dataset."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield mk.datasets.load("folder", FOLDER, table="clips.csv")


def test_every_content_style_and_creature_is_shown(examples):
    shown = Counter(part for clip in examples for part in clip.content.split(", "))
    assert set(shown) >= set(CONTENTS)
    assert {clip.style for clip in examples} == {*TRAIN_STYLES, *HELD_OUT_STYLES}
    assert {clip.style for clip in examples.filter(content="walk", performer="person 01")} == {
        *TRAIN_STYLES,
        *HELD_OUT_STYLES,
    }
    assert {clip.performer.split(" ")[0] for clip in examples} == {"person", *performing.CREATURES}
    assert 30 <= len(examples) <= 40 and all(len(clip.texts) == 4 for clip in examples)


def test_small_and_short(examples):
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 6e6
    assert all(2 <= len(clip) / clip.motion.fps <= 10 for clip in examples)


def test_the_walks_are_one_take(examples):
    assert {clip.take for clip in examples.filter(performer="person 01")} == {"walk"}
    others = [clip.take for clip in examples if clip.take != "walk"]
    assert len(set(others)) == len(others)


def test_people_stand_on_the_ground(examples):
    for clip in (clip for clip in examples if clip.performer.startswith("person")):
        lowest = clip.motion.positions()[..., 1].amin()
        assert -0.005 < lowest < 0.05, clip.name
        assert foot_contacts(clip.motion).any(), clip.name


def test_as_the_tool_makes_them(tmp_path, monkeypatch, capsys):
    (tmp_path / "clips.csv").write_text("file\nolder.bvh\n")
    (tmp_path / "older.bvh").write_text("")
    (tmp_path / "yours.bvh").write_text("")
    monkeypatch.setattr(sys, "argv", ["make_examples.py", str(tmp_path)])
    assert make_examples.main() == 0
    assert "clips, " in capsys.readouterr().out
    names = sorted(path.name for path in tmp_path.glob("*.bvh"))
    assert "yours.bvh" in names and "older.bvh" not in names
    names.remove("yours.bvh")
    assert names == sorted(path.name for path in FOLDER.glob("*.bvh"))
    tables = [(folder / "clips.csv").read_text(encoding="utf-8").splitlines() for folder in (tmp_path, FOLDER)]
    assert tables[0] == tables[1], "run python tools/make_examples.py"
    for name in names:
        here, there = (mk.load(folder / name).positions() for folder in (tmp_path, FOLDER))
        assert here.shape == there.shape, f"{name}: run python tools/make_examples.py"
        torch.testing.assert_close(here, there, rtol=0, atol=1e-4, msg=f"{name}: run python tools/make_examples.py")
