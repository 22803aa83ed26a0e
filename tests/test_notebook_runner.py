"""Tests of the tests: the commands that guard the notebooks must fail on a bad one."""

import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

import check_notebooks
import run_notebooks

ROOT = Path(__file__).resolve().parent.parent
ELSEWHERE = "/".join(["", "home", "ann", "walk.bvh"])  # spelt so that no file here names such a path


def write(path: Path, *sources: str) -> Path:
    """Save a notebook with these code cells, not executed."""
    cells = [new_markdown_cell("# A notebook"), *map(new_code_cell, sources)]
    nbformat.write(new_notebook(cells=cells, metadata=run_notebooks.METADATA), path)
    return path


def tool(name: str, *paths: Path) -> subprocess.CompletedProcess:
    """Run one of the scripts as `make` does."""
    command = [sys.executable, str(ROOT / "tools" / name), *map(str, paths)]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.mark.slow
def test_a_sound_notebook_passes_and_a_broken_one_fails(tmp_path):
    sound = write(tmp_path / "sound.ipynb", "import motionkit", "assert motionkit.__name__ == 'motionkit'")
    broken = write(tmp_path / "broken.ipynb", "x = 1", "assert x == 2, 'broken on purpose'", "x")
    result = tool("try_notebooks.py", sound)
    assert result.returncode == 0, result.stdout + result.stderr
    result = tool("try_notebooks.py", sound, broken)
    assert result.returncode == 1
    assert "broken on purpose" in result.stdout
    assert "broken.ipynb: a cell failed" in result.stdout
    assert "sound.ipynb: a cell failed" not in result.stdout


@pytest.mark.slow
def test_a_checked_output_that_changed_fails(tmp_path):
    path = write(tmp_path / "drift.ipynb", "# NBVAL_CHECK_OUTPUT\nprint(41 + 1)")
    assert run_notebooks.run_in_place(path) == []
    path.write_text(path.read_text().replace('"42\\n"', '"43\\n"'))
    result = tool("try_notebooks.py", path)
    assert result.returncode == 1, result.stdout


@pytest.mark.slow
def test_executing_twice_gives_the_same_file(tmp_path):
    widget = "import ipywidgets, uuid\nprint(uuid.uuid4(), object())\nipywidgets.IntSlider()"
    path = write(tmp_path / "twice.ipynb", "{str(k) for k in range(20)}", widget)
    assert run_notebooks.run_in_place(path) == []
    first = path.read_bytes()
    assert run_notebooks.run_in_place(path) == []
    assert path.read_bytes() == first
    assert b"a live widget" in first and b"widget-view" not in first


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("1 / 0", "a cell failed: ZeroDivisionError"),
        ("import sys; print('careful', file=sys.stderr)", "noise on stderr: 'careful"),
        (f"print({ELSEWHERE!r})", "a path of one machine"),
    ],
)
def test_a_bad_run_is_not_kept(tmp_path, monkeypatch, source, fault):
    monkeypatch.setattr(run_notebooks, "ROOT", tmp_path)
    path = write(tmp_path / "bad.ipynb", source)
    before = path.read_bytes()
    assert any(fault in what for what in run_notebooks.run_in_place(path))
    assert path.read_bytes() == before
    assert (tmp_path / "out" / "failed-bad.ipynb").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.ipynb", "out"]


def executed(**changes) -> nbformat.NotebookNode:
    """A notebook of two executed cells, the second changed."""
    first = new_code_cell("1", execution_count=1)
    return new_notebook(cells=[first, new_code_cell(**{"source": "2", "execution_count": 2, **changes})])


BAD = {
    "not executed top to bottom": executed(execution_count=7),
    "not executed top": executed(execution_count=None),
    "saved with an error": executed(outputs=[new_output("error", ename="E", evalue="e", traceback=[])]),
    "noise on stderr": executed(outputs=[new_output("stream", name="stderr", text="Warning")]),
    "the output names a path": executed(outputs=[new_output("stream", name="stdout", text=ELSEWHERE)]),
    "the text names a path": executed(source=f"x = {ELSEWHERE!r}"),
    "26 lines, budget 25": executed(source="\n".join("x" * 26)),
    "a shell command": executed(source="!echo hello"),
    "2.1 MB, budget 2 MB": executed(outputs=[new_output("display_data", {"image/png": "A" * 2_100_000})]),
}


@pytest.mark.parametrize("fault", BAD)
def test_the_check_sees(tmp_path, fault):
    nbformat.write(BAD[fault], tmp_path / "bad.ipynb")
    assert any(fault in what for what in check_notebooks.problems(tmp_path / "bad.ipynb"))


def test_the_check_sees_widget_state_and_broken_files(tmp_path):
    notebook = executed()
    notebook.metadata["widgets"] = {check_notebooks.WIDGET_STATE: {"state": {"a": "A" * 200_000}}}
    nbformat.write(notebook, tmp_path / "state.ipynb")
    assert "200 kB of widget state, budget 100 kB" in check_notebooks.problems(tmp_path / "state.ipynb")
    (tmp_path / "junk.ipynb").write_text("{")
    assert "can be read" in check_notebooks.problems(tmp_path / "junk.ipynb")[0]
    assert tool("check_notebooks.py", tmp_path / "junk.ipynb").returncode == 1


def test_pictures_may_spell_anything(tmp_path):
    nbformat.write(executed(outputs=[new_output("display_data", {"image/png": ELSEWHERE})]), tmp_path / "fine.ipynb")
    assert check_notebooks.problems(tmp_path / "fine.ipynb") == []


@pytest.mark.parametrize("path", check_notebooks.find_notebooks(), ids=lambda path: path.name)
def test_the_real_notebooks_keep_the_budgets(path):
    assert check_notebooks.problems(path) == []
