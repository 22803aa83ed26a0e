"""results/io.json has the form of a results file, agrees with itself and tells nothing about the machine's folders."""

import json
import re
from pathlib import Path

import pytest

from check_notebooks import MACHINE_PATH

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "results" / "io.json").read_text()
RESULT = json.loads(TEXT)
TARGETS = {
    "bvh_read_mb_per_s": 40,
    "bvh_read_times_pymotion": 3,
    "fk_frames_per_s": 1_000_000,
    "fk_times_pymotion": 2.46,
    "import_seconds": 0.3,
    "all_clips_seconds": 12,
    "all_clips_peak_gb": 1.5,
    "cached_load_seconds": 1,
}


def test_form():
    assert set(RESULT) == {"command", "commit", "hardware", "seed", "seconds", "figures"}
    assert RESULT["command"] == "make bench-io" and RESULT["seconds"] > 0
    assert re.fullmatch(r"[0-9a-f]{7,40}(-dirty)?", RESULT["commit"]) and "cores" in RESULT["hardware"]
    assert not re.search(MACHINE_PATH, TEXT)


@pytest.mark.parametrize("name", TARGETS)
def test_figures_agree_with_their_targets(name):
    line = RESULT["figures"][name]
    assert set(line) == {"value", "target", "met", "unit", "note"}
    assert line["target"] == TARGETS[name] and line["value"] > 0
    less = name.endswith(("_seconds", "_gb"))
    assert line["met"] is (line["value"] <= line["target"] if less else line["value"] >= line["target"])


def test_no_figure_is_unknown():
    assert set(RESULT["figures"]) == set(TARGETS)
