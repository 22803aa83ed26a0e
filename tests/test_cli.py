"""The command line, run as a user runs it."""

import subprocess
import sys

import pytest

import motionkit as mk
from motionkit.__main__ import main


def test_info_names_joints_and_size(capsys):
    assert main(["info", "data/walk_neutral.bvh"]) == 0
    out = capsys.readouterr().out
    assert "120 frames at 30 fps" in out and "left_knee" in out and "1.74 m tall" in out


def test_stylize_writes_a_file_that_loads(tmp_path, capsys):
    out = tmp_path / "old.bvh"
    assert main(["stylize", "data/walk_neutral.bvh", "--style", "data/walk_old.bvh", "-o", str(out)]) == 0
    assert len(mk.load(out)) == 120 and str(out) in capsys.readouterr().out


def test_play_writes_a_page_without_network(tmp_path, capsys):
    page = tmp_path / "walk.html"
    assert main(["play", "data/walk_neutral.bvh", "data/walk_old.bvh", "-o", str(page), "--no-open"]) == 0
    text = page.read_text()
    assert "<html" in text.lower() and 'src="http' not in text and 'import("http' not in text


@pytest.mark.parametrize(
    "arguments, part",
    [
        (["info", "nowhere.bvh"], "no such file"),
        (["stylize", "data/walk_neutral.bvh", "--style", "README.md", "-o", "x.bvh"], "README.md"),
        (
            ["stylize", "data/walk_neutral.bvh", "--style", "data/walk_old.bvh", "-o", "no/such/folder/x.bvh"],
            "cannot be written",
        ),
        (
            ["stylize", "data/walk_neutral.bvh", "--style", "data/walk_old.bvh", "-o", "x.bvh", "--method", "magic"],
            "no method",
        ),
    ],
)
def test_errors_are_one_line_and_exit_code_2(arguments, part, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert part in error and error.count("\n") == 1 and "Traceback" not in error


@pytest.mark.parametrize("command", [[], ["info"], ["play"], ["stylize"]])
def test_help_from_a_shell(command):
    result = subprocess.run([sys.executable, "-m", "motionkit", *command, "--help"], capture_output=True, text=True)
    assert result.returncode == 0 and "usage:" in result.stdout
