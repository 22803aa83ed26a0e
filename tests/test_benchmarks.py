"""Benchmarks: what figures and tables register, and a run of a toy one in a repository of its own."""

import json
import subprocess

import pytest

import motionkit as mk
from motionkit import benchmarks
from motionkit.benchmarks import Entry, entries, figure, resident_bytes, run_python, table, threads
from motionkit.benchmarks.__main__ import commit_of, main, run

TOY = """
from motionkit.benchmarks import figure, table

calls = []

@figure("seconds", at_most=2, unit="s", note="of a run")
def seconds():
    calls.append("seconds")
    return VALUE

@figure("cra", at_least=90, unit="%")
@figure("peak_gb", at_most=1, unit="GB")
@table("scores", dataset="actor")
def scores():
    calls.append("scores")
    return {"cra": (10 * VALUE, "of 12 clips"), "scores": [{"method": "linear", "cra": 10 * VALUE}]}
"""


def toy(name: str, value: float) -> tuple[dict, list[Entry]]:
    """The toy benchmark as a module of this name."""
    benchmarks._ENTRIES.pop(name, None)
    module = {"__name__": name, "VALUE": value}
    exec(TOY, module)
    return module, entries(name)


@pytest.fixture
def repository(tmp_path):
    """A committed tree, and a function that asks git about it."""

    def git(*arguments: str) -> str:
        command = ["git", "-c", "user.name=Ann", "-c", "user.email=ann@example.org", *arguments]
        return subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout.strip()

    git("init", "-q")
    (tmp_path / "code.py").write_text("x = 1\n")
    git("add", ".")
    git("commit", "-qm", "first")
    return tmp_path, git


def test_a_run_writes_every_figure_and_table(repository, capsys):
    root, git = repository
    module, listed = toy("toy_of_a_run", 1.21875)
    path = run("my_toy", listed, root)
    assert path == root / "results" / "my-toy.json"
    found = json.loads(path.read_text())
    assert found["command"] == "make bench NAME=my_toy" and found["commit"] == git("rev-parse", "--short=7", "HEAD")
    assert found["seed"] == 0 and found["seconds"] >= 0 and "cores" in found["hardware"]
    assert found["figures"] == {
        "seconds": {"value": 1.22, "target": 2, "met": True, "unit": "s", "note": "of a run"},
        "cra": {"value": 12.2, "target": 90, "met": False, "unit": "%", "note": "of 12 clips"},
    }
    assert found["tables"] == {"scores": [{"method": "linear", "dataset": "actor", "cra": 12.1875}]}
    assert module["calls"] == ["seconds", "scores"]  # once for all that it measures
    printed = capsys.readouterr().out
    assert "met    seconds" in printed and "MISSED cra" in printed and "peak_gb" in printed
    results = mk.results("my-toy", root / "results")
    assert results.figure("cra") == 12.2 and results.table("scores")[0]["method"] == "linear"


def test_a_tree_with_changes_is_refused_unless_told(repository):
    root, git = repository
    _, listed = toy("toy_of_a_dirty_tree", 1.0)
    for name in ("code.py", "new.py"):
        (root / name).write_text("x = 2\n")
        with pytest.raises(mk.MotionKitError, match=f"changed: {name}; commit, or give --dirty"):
            run("toy", listed, root)
        assert not (root / "results").exists()
        git("add", ".")
        git("commit", "-qm", "more")
    (root / "code.py").write_text("x = 3\n")
    found = json.loads(run("toy", listed, root, dirty=True).read_text())
    assert found["commit"] == git("rev-parse", "--short=7", "HEAD") + "-dirty"
    git("checkout", "code.py")
    assert not commit_of(root).endswith("-dirty")  # results of an earlier run are no change of the code


def test_without_git_there_is_no_commit_to_name(tmp_path):
    _, listed = toy("toy_without_git", 1.0)
    with pytest.raises(mk.MotionKitError, match="no git checkout"):
        run("toy", listed, tmp_path)
    assert json.loads(run("toy", listed, tmp_path, dirty=True).read_text())["commit"] == "unknown-dirty"


def test_one_figure_alone_leaves_the_others(repository):
    root, git = repository
    run("toy", toy("toy_alone", 1.0)[1], root)
    first = git("rev-parse", "--short=7", "HEAD")
    git("commit", "-q", "--allow-empty", "-m", "second")
    second = git("rev-parse", "--short=7", "HEAD")
    module, listed = toy("toy_alone", 9.5)
    found = json.loads(run("toy", listed, root, ["seconds"]).read_text())
    assert module["calls"] == ["seconds"]
    assert found["figures"]["seconds"]["value"] == 9.5 and not found["figures"]["seconds"]["met"]
    assert found["figures"]["cra"]["value"] == 10 and found["tables"]["scores"][0]["cra"] == 10
    assert found["commit"] == first and list(found["figures"]) == ["seconds", "cra"]
    others = [(other["command"], other["commit"], other["entries"]) for other in found["other_runs"]]
    assert others == [('make bench NAME=toy ONLY="seconds"', second, ["seconds"])]
    run("toy", listed, root, ["scores"])
    results = mk.results("toy", root / "results")
    assert results.figure("cra") == 10 and results.table("scores")[0]["cra"] == 95  # each replaces itself alone
    run("toy", listed, root, ["seconds", "scores"])  # what was measured again is of one run alone
    results = mk.results("toy", root / "results")
    assert [other["entries"] for other in results.run["other_runs"]] == [["seconds", "scores"]]
    assert results.run_of("seconds")["commit"] == second and results.run_of("cra")["commit"] == first
    assert "other_runs" not in json.loads(run("toy", listed, root).read_text())


def test_what_fails_leaves_the_file_as_it_was(repository):
    root, _ = repository
    path = run("toy", toy("toy_that_fails", 1.0)[1], root)
    before = path.read_text()
    with pytest.raises(TypeError):
        run("toy", toy("toy_that_fails", None)[1], root)
    with pytest.raises(mk.MotionKitError, match="does not measure speed; it measures seconds, cra, peak_gb, scores"):
        run("toy", toy("toy_that_fails", 1.0)[1], root, ["speed"])
    assert path.read_text() == before and [file.name for file in path.parent.iterdir()] == ["toy.json"]


def test_what_cannot_be_registered():
    with pytest.raises(mk.MotionKitError, match="at_least or at_most"):
        figure("speed", unit="s")
    with pytest.raises(mk.MotionKitError, match="at_least or at_most"):
        figure("speed", at_most=1, at_least=0)

    def measure():
        return 1.0

    measure.__module__ = "toy_measured_twice"
    figure("speed", at_most=1)(measure)
    with pytest.raises(mk.MotionKitError, match="measures 'speed' twice"):
        figure("speed", at_most=2)(measure)


def test_rows_name_method_and_dataset():
    def rows():
        return [{"method": "linear", "dataset": "actor"}, {"cra": 1.0}]

    rows.__module__ = "toy_of_rows"
    table("scores")(rows)
    with pytest.raises(mk.MotionKitError, match="row 1 has no dataset and no method"):
        entries("toy_of_rows")[0].to_json(rows())


def test_the_command_names_what_there_is(capsys):
    with pytest.raises(SystemExit):
        main(["speed"])
    assert "'io', 'actor', 'arena'" in capsys.readouterr().err.replace("invalid choice", "")
    assert main(["io", "--only", "speed", "--dirty"]) == 2
    assert "io does not measure speed; it measures bvh_read_mb_per_s" in capsys.readouterr().err


def test_a_script_of_its_own_prints_numbers():
    numbers, peak = run_python("import sys, time; time.sleep(0.3); print(sys.argv[1], 2.5)", "1")
    assert numbers == [1.0, 2.5] and 0 <= peak < 1
    with pytest.raises(mk.MotionKitError, match="ended with 1"):
        run_python("raise SystemExit(1)")


def test_memory_of_a_process_that_is_gone_is_none():
    assert resident_bytes(2**30) == 0


def test_threads_are_put_back():
    import torch

    before = torch.get_num_threads()
    with threads(before + 1):
        assert torch.get_num_threads() == before + 1
    assert torch.get_num_threads() == before
