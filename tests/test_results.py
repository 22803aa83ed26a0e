"""results/*.json: their form, figures that agree with their targets, nothing about a machine's folders."""

import json
import re
from pathlib import Path

import pytest

import motionkit as mk
from check_notebooks import MACHINE_PATH

ROOT = Path(__file__).resolve().parent.parent
TARGETS = {
    "io": {
        "bvh_read_mb_per_s": 40,
        "bvh_read_times_pymotion": 3,
        "fk_frames_per_s": 1_000_000,
        "fk_times_pymotion": 2.46,
        "import_seconds": 0.3,
        "all_clips_seconds": 12,
        "all_clips_peak_gb": 1.5,
        "cached_load_seconds": 1,
    },
    "arena-baselines": {
        "measuring_seconds": 120,
        "measuring_peak_gb": 2,
        "small_seconds": 60,
        "bandai_transfers": 3780,
    },
    "actor": {
        "making_frames_per_s": 3000,
        "dataset_seconds": 90,
        "dataset_peak_gb": 1,
        "corpus_batches_per_s": 200,
        "foot_sliding_mm": 1,
        "penetration_mm": 5,
        "bone_error_mm": 0.01,
        "frames_beyond_limits": 0,
        "acceleration_ratio": 1.5,
        "like_walk": 80,
        "like_run": 80,
        "style_accuracy": 97,
        "content_accuracy": 98,
        "single_frame_proud_strutting": 60,
        "single_frame_depressed_tired": 60,
    },
    "few-shot": {"bandai_cra": 93.41, "bandai_sra": 60.11, "sra_without_semantic_ratio": 0.5},
    "few-shot-why": {"ae_cra_ratio": 0.5, "ae_sra_ratio": 0.5, "sra_ratio": 0.5},
    "few-shot-held-back": {
        "learn_in_space_seconds": 180,
        "learn_seconds": 180,
        "restyle_seconds": 0.3,
        "style_file_mb": 1,
        "paper_size_seconds": 0.4,
        "held_back_error_knn_ratio": 0.7,
        "held_back_error_statistics_ratio": 0.7,
        "held_back_cra_over_best": 1,
        "held_back_sra_over_best": 1,
    },
    "style-erd": {
        "network_ms": 0.2,
        "whole_ms": 0.4,
        "frames_per_s": 30_000,
        "late_over_early_ratio": 1.1,
        "off_from_eager_ratio": 1e-5,
        "first_frame_error_ratio": 1.5,
        "switch_jerk_ratio": 1,
        "training_seconds": 5400,
        "fmd_over_best_ratio": 1,
        "fmd_ae_over_best_ratio": 1,
        "truth_error_over_best_ratio": 1,
        "cra_over_best_share": 1,
        "sra_over_best_share": 1,
    },
    "style-erd-captures": {
        "fmd_over_best_ratio": 1,
        "fmd_ae_over_best_ratio": 1,
        "cra_over_best_share": 1,
        "sra_over_best_share": 1,
    },
    "diffusion": {
        "paper_call_ms": 52,
        "paper_ddim20_seconds": 1.0,
        "laptop_ddim20_seconds": 0.15,
        "dpm_solver_10_over_ddim_50_fmd_ratio": 1.05,
        "actor_content": 95,
        "actor_style": 90,
        "actor_r1": 70,
        "actor_training_seconds": 5400,
    },
}
COMMANDS = {"arena-baselines": "make bench-arena"}  # where it is not `make bench-SUBJECT`
LESS = ("_seconds", "_ms", "_gb", "_mb", "_mm", "_ratio", "_limits")  # endings of figures that should be small
CASES = [(subject, name) for subject, names in TARGETS.items() for name in names]


def result(subject: str) -> dict:
    return json.loads((ROOT / "results" / f"{subject}.json").read_text())


@pytest.mark.parametrize("subject", TARGETS)
def test_form(subject):
    found = result(subject)
    assert set(found) - {"tables"} == {"command", "commit", "hardware", "seed", "seconds", "figures"}
    assert found["command"] == COMMANDS.get(subject, f"make bench-{subject}") and found["seconds"] > 0
    assert re.fullmatch(r"[0-9a-f]{7,40}(-dirty)?", found["commit"]) and "cores" in found["hardware"]
    assert not re.search(MACHINE_PATH, json.dumps(found))
    assert set(found["figures"]) == set(TARGETS[subject])


@pytest.mark.parametrize("subject, name", CASES)
def test_figures_agree_with_their_targets(subject, name):
    line = result(subject)["figures"][name]
    assert set(line) == {"value", "target", "met", "unit", "note"}
    assert line["target"] == TARGETS[subject][name] and line["value"] >= 0
    less = name.endswith(LESS) or name.startswith("single_frame")
    assert line["met"] is (line["value"] <= line["target"] if less else line["value"] >= line["target"])


def test_every_results_file_is_known():
    assert {path.stem for path in (ROOT / "results").glob("*.json")} == set(TARGETS)


def test_the_arena_tables_hold_every_method_on_the_whole_protocol():
    tables = result("arena-baselines")["tables"]
    counts = {"actor": 7392, "bandai-2": 3780}
    for data, count in counts.items():
        rows = {row["method"]: row for row in tables[data]}
        assert set(rows) == {*mk.methods.BASELINES, "real"}
        assert all(row["transfers"] == count for name, row in rows.items() if name != "real")
        assert rows["copy-content"]["cra"] > 95 and rows["copy-content"]["sra"] < 5
        assert rows["copy-style"]["sra"] > 95 and rows["copy-style"]["cra"] < 5
    assert [p["protocol"] for p in tables["provenance"]] == ["paper-1", "paper-1"]


def test_the_diffusion_tables_hold_both_datasets_and_every_sampler():
    tables = result("diffusion")["tables"]
    rows = {row["dataset"]: row for row in tables["quality"]}
    assert set(rows) == {"actor", "bandai-2"} and all(row["fmd_real"] < row["fmd"] for row in rows.values())
    assert {row["sampler"] for row in tables["samplers"]} == {"ddpm", "ddim", "dpm_solver"}
    for size in ("paper", "laptop"):  # guidance asks the network twice
        once, twice = (row["seconds"] for row in tables["speed"] if row["size"] == size)
        assert once < twice


def test_the_few_shot_tables_have_all_rows_of_the_paper():
    tables = result("few-shot")["tables"]
    rows = {row["method"]: row for row in tables["table_3"]}
    assert set(rows) == {*mk.methods.few_shot.ABLATIONS, "statistics", "real"}
    assert [row["method"] for row in tables["table_2"]] == ["few-shot", "KNN + DTW"]
    assert [row["g"] for row in tables["figure_8_g"]] == [700, 800, 900, 950, 1000]
    assert len(tables["figure_8_k"]) == 5
    why = [row["method"] for row in result("few-shot-why")["tables"]["table_3"]]
    assert why == ["ours", "without L_s", "with AE", "real"]
    held = {row["method"]: row for row in result("few-shot-held-back")["tables"]["held_back"]}
    assert set(held) == {"few-shot", "few-shot, adapter", "told the numbers", *mk.methods.BASELINES, "real"}
    assert held["told the numbers"]["truth_error"] < held["few-shot"]["truth_error"]  # the bound is one


def test_the_style_erd_tables_have_all_rows_of_the_paper():
    tables = result("style-erd")["tables"]
    rows = {row["method"]: row for row in tables["table_1"]}
    assert set(rows) == {*mk.methods.style_erd.ABLATIONS, "real"} and rows["ours"]["transfers"] == 252
    beside = {row["method"]: row for row in tables["actor"]}
    assert set(beside) == {"style-erd", "knn-dtw", "linear", "statistics", "real"}
    assert beside["style-erd"]["truth_error"] < beside["statistics"]["truth_error"]
    assert [row["frame"] for row in tables["figure_5"]] == [*range(10), 60]
