"""results/*.json: their form, figures that agree with their targets, nothing about a machine's folders."""

import importlib
import json
import re
from pathlib import Path

import pytest

import motionkit as mk
from check_notebooks import MACHINE_PATH
from motionkit.benchmarks import entries
from motionkit.benchmarks.__main__ import ABOUT_RUN, NAMES
from motionkit.benchmarks.few_shot import ABLATIONS

FOLDER = Path(__file__).resolve().parent.parent / "results"
ENTRIES = {
    name.replace("_", "-"): entries(importlib.import_module(f"motionkit.benchmarks.{name}").__name__) for name in NAMES
}
FIGURES = [(name, entry) for name, listed in ENTRIES.items() for entry in listed if entry.kind == "figures"]


@pytest.mark.parametrize("name", ENTRIES)
def test_form(name):
    text = (FOLDER / f"{name}.json").read_text()
    assert not re.search(MACHINE_PATH, text)
    results = json.loads(text)
    assert set(results) - {"other_runs"} == {*ABOUT_RUN, "figures", "tables"}
    for run in (results, *results.get("other_runs", [])):
        assert run["command"].startswith("make bench") and run["seconds"] >= 0 and run["seed"] == 0
        assert re.fullmatch(r"[0-9a-f]{7,40}(-dirty)?", run["commit"]) and "cores" in run["hardware"]
    for kind in ("figures", "tables"):
        assert set(results[kind]) == {entry.name for entry in ENTRIES[name] if entry.kind == kind}
    measured_elsewhere = [entry for run in results.get("other_runs", []) for entry in run["entries"]]
    assert len(set(measured_elsewhere)) == len(measured_elsewhere)
    assert set(measured_elsewhere) <= {*results["figures"], *results["tables"]}


@pytest.mark.parametrize("name, entry", FIGURES, ids=[f"{name}-{entry.name}" for name, entry in FIGURES])
def test_figures_agree_with_their_targets(name, entry):
    line = mk.results(name).figures[entry.name]
    assert set(line) == {"value", "target", "met", "unit", "note"} and line["value"] >= 0
    again = entry.to_json((line["value"], line["note"]))
    assert again == line


@pytest.mark.parametrize("name", ENTRIES)
def test_every_row_names_its_method_and_dataset(name):
    rows = [row for table in mk.results(name).tables.values() for row in table]
    known = {*mk.datasets.names(), "noise"}
    assert all(row["method"] and row["dataset"] in known for row in rows)
    shares = [row[label] for row in rows for label in ("cra", "sra") if row.get(label) is not None]
    assert not shares or max(shares) > 1.5  # per cent


def test_every_results_file_is_known():
    assert {path.stem for path in FOLDER.glob("*.json")} == set(ENTRIES)


def test_results_in_a_cell():
    results = mk.results("few-shot")
    assert results.figure("bandai_cra") == results.figures["bandai_cra"]["value"] == 89.9
    assert results.run_of("bandai_cra") is results.run and results.run_of("held_back")["seconds"] == 2116.7
    assert repr(results) == f"Results('few-shot', measured at {results.run['commit']}, 15 figures, 6 tables)"
    page = results._repr_html_()
    assert "<td>bandai_cra</td><td>89.9 %</td><td>✗ 93.41 %</td>" in page and "table_3_actor_prior" in page


def test_what_was_not_measured(tmp_path):
    with pytest.raises(mk.MotionKitError, match=r"no results 'few_shot' in .*; there are: actor, .*few-shot"):
        mk.results("few_shot")
    with pytest.raises(mk.MotionKitError, match="have no figure 'speed'; they have bvh_read_mb_per_s"):
        mk.results("io").figure("speed")
    with pytest.raises(mk.MotionKitError, match="have no table 'speed'; they have none"):
        mk.results("io").table("speed")
    with pytest.raises(mk.MotionKitError, match="have no figure or table 'speed'"):
        mk.results("io").run_of("speed")
    with pytest.raises(mk.MotionKitError, match="there are: none. They come with the repository"):
        mk.results("io", tmp_path)
    for text in ("{", "[]", "{}"):
        (tmp_path / "io.json").write_text(text)
        with pytest.raises(mk.MotionKitError, match=r"io.json: not the results of a benchmark"):
            mk.results("io", tmp_path)


def test_the_arena_tables_hold_every_method_on_the_whole_protocol():
    tables = mk.results("arena").tables
    counts = {"actor": 7392, "bandai-2": 3780}
    for data, count in counts.items():
        rows = {row["method"]: row for row in tables[data]}
        assert set(rows) == {*mk.methods.BASELINES, "real"} and {row["dataset"] for row in tables[data]} == {data}
        assert all(row["transfers"] == count for name, row in rows.items() if name != "real")
        assert rows["copy-content"]["cra"] > 95 and rows["copy-content"]["sra"] < 5
        assert rows["copy-style"]["sra"] > 95 and rows["copy-style"]["cra"] < 5
    assert [p["protocol"] for p in tables["provenance"]] == ["paper-1", "paper-1"]


def test_the_diffusion_tables_hold_both_datasets_and_every_sampler():
    tables = mk.results("diffusion").tables
    rows = {row["dataset"]: row for row in tables["quality"]}
    assert set(rows) == {"actor", "bandai-2"} and all(row["fmd_real"] < row["fmd"] for row in rows.values())
    assert {row["sampler"] for row in tables["samplers"]} == {"ddpm", "ddim", "dpm_solver"}
    for size in ("paper", "laptop"):  # guidance asks the network twice
        once, twice = (row["seconds"] for row in tables["speed"] if row["size"] == size)
        assert once < twice


def test_the_few_shot_tables_have_all_rows_of_the_paper():
    tables = mk.results("few-shot").tables
    rows = {row["method"]: row for row in tables["table_3"]}
    assert list(rows) == [*ABLATIONS, "statistics", "real"]
    assert [row["method"] for row in tables["table_2"]] == ["few-shot", "KNN + DTW"]
    assert [row["g"] for row in tables["figure_8_g"]] == [700, 800, 900, 950, 1000]
    assert len(tables["figure_8_k"]) == 5
    assert [row["method"] for row in tables["table_3_actor_prior"]] == ["ours", "without L_s", "with AE", "real"]
    held_back = {row["method"]: row for row in tables["held_back"]}
    bound = "style-code, ground-truth code"
    assert set(held_back) == {"few-shot", "style-code", bound, *mk.methods.BASELINES, "real"}
    assert held_back[bound]["truth_error"] < held_back["style-code"]["truth_error"]
    assert held_back["style-code"]["truth_error"] < held_back["few-shot"]["truth_error"]


def test_the_style_erd_tables_have_all_rows_of_the_paper():
    tables = mk.results("style-erd").tables
    rows = {row["method"]: row for row in tables["table_1"]}
    assert set(rows) == {*mk.methods.style_erd.ABLATIONS, "real"} and rows["ours"]["transfers"] == 252
    beside = {row["method"]: row for row in tables["actor"]}
    assert set(beside) == {"style-erd", "knn-dtw", "linear", "statistics", "real"}
    assert beside["style-erd"]["truth_error"] < beside["statistics"]["truth_error"]
    assert [row["frame"] for row in tables["figure_5"]] == [*range(10), 60]
