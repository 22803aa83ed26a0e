"""The command line, run as a user runs it."""

import subprocess
import sys
from pathlib import Path

import pytest

import motionkit as mk
from motionkit.__main__ import main


def test_info_names_joints_and_size(capsys):
    assert main(["info", "data/actor/walk_neutral.bvh"]) == 0
    out = capsys.readouterr().out
    assert "120 frames at 30 fps" in out and "left_knee" in out and "1.74 m tall" in out


def test_stylize_writes_a_file_that_loads(tmp_path, capsys):
    out = tmp_path / "old.bvh"
    assert main(["stylize", "data/actor/walk_neutral.bvh", "--style", "data/actor/walk_old.bvh", "-o", str(out)]) == 0
    assert len(mk.load(out)) == 120 and str(out) in capsys.readouterr().out


def test_perform_writes_what_was_asked_for(tmp_path, capsys):
    out = tmp_path / "bow.bvh"
    assert main(["perform", "bow", "--style", "tired", "--seconds", "8", "-o", str(out)]) == 0
    assert len(mk.load(out)) == 240 and "bow" in capsys.readouterr().out.splitlines()[1]
    assert main(["perform", "sit", "--performer", "dog", "--seconds", "7", "-o", str(tmp_path / "dog.bvh")]) == 0
    assert mk.load(tmp_path / "dog.bvh").skeleton.names != mk.load(out).skeleton.names
    assert main(["perform", "walk", "--style", "tird", "-o", str(tmp_path / "no.bvh")]) == 2
    assert "did you mean 'tired'" in capsys.readouterr().err and not (tmp_path / "no.bvh").exists()


def test_imagine_writes_what_a_sentence_says(tmp_path, capsys):
    out = tmp_path / "walk.bvh"
    assert main(["imagine", "an old person walks", "--seconds", "2", "-o", str(out)]) == 0
    assert len(mk.load(out)) == 60 and str(out) in capsys.readouterr().out
    assert main(["imagine", "a dog barks at the moon", "--seconds", "1", "-o", str(out)]) == 0
    assert "nearest" in capsys.readouterr().err
    for wrong in (["imagine", " ", "-o", str(tmp_path / "no.bvh")], ["imagine", "a walk", "--seconds", "99"]):
        assert main([*wrong, "-o", str(tmp_path / "no.bvh")]) == 2 and not (tmp_path / "no.bvh").exists()


def test_a_style_by_name_says_which_methods_know_names(tmp_path, capsys):
    out = str(tmp_path / "no.bvh")
    for method in ([], ["--method", "few-shot"]):
        assert main(["stylize", "data/actor/walk_neutral.bvh", "--style", "old", *method, "-o", out]) == 2
        assert "--method style-code or --method style-erd" in capsys.readouterr().err
    assert main(["stylize", "data/actor/walk_neutral.bvh", "--style", "old", "--method", "few-shto", "-o", out]) == 2
    assert "did you mean 'few-shot'" in capsys.readouterr().err
    nowhere = str(tmp_path / "nowhere" / "old.safetensors")
    assert main(["learn", "data/actor/walk_old.bvh", "-o", nowhere]) == 2
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.slow
def test_learn_writes_a_style_that_stylize_takes(tmp_path, capsys):
    style, out, walk = tmp_path / "old.safetensors", tmp_path / "kick.bvh", "data/actor/walk_old.bvh"
    learn = ["learn", walk, "--method", "few-shot", "--steps", "1", "-o", str(style), "--prompt"]
    assert main([*learn, "a person walks"]) == 2 and "says nothing of a style" in capsys.readouterr().err
    assert main([*learn, "an old person walks"]) == 0 and not style.with_suffix(".run").exists()
    assert main(["stylize", "data/actor/walk_neutral.bvh", "--style", str(style), "-o", str(out)]) == 0
    assert len(mk.load(out)) == 120
    named = ["stylize", "data/actor/jump_neutral.bvh", "--style", "old", "--method", "few-shot", "-o", str(out)]
    assert main(named) == 2
    assert "few-shot takes its style from a BVH file" in capsys.readouterr().err


@pytest.mark.slow
def test_styles_by_name_and_codes_of_styles(tmp_path, capsys):
    """style-code is what learns where there is one; it takes the labels of its library too."""
    style, out, walk = tmp_path / "old.safetensors", tmp_path / "kick.bvh", "data/actor/walk_old.bvh"
    assert main(["learn", walk, "--steps", "1", "-o", str(style)]) == 0
    assert "learning by style-code" in capsys.readouterr().out
    stylize = ["stylize", "data/actor/jump_neutral.bvh", "-o", str(out), "--style"]
    assert main([*stylize, str(style)]) == 0 and len(mk.load(out)) > 60
    assert main([*stylize, str(style), "--method", "few-shot"]) == 2
    assert "this style was learned by --method style-code" in capsys.readouterr().err
    for known in (walk, "old"):  # a clip is learned on the way
        assert main([*stylize, known, "--method", "style-code"]) == 0 and len(mk.load(out)) > 60
    assert main([*stylize, "purple", "--method", "style-code"]) == 2
    assert "'purple' is no style" in capsys.readouterr().err


@pytest.mark.slow
def test_learn_by_the_papers_method(tmp_path, capsys, monkeypatch):
    from motionkit.methods import few_shot

    monkeypatch.setattr(few_shot.Config, "laptop", few_shot.Config.tiny)
    style, out = tmp_path / "old.safetensors", tmp_path / "walk.bvh"
    learn = ["learn", "data/actor/walk_old.bvh", "--method", "few-shot", "--steps", "1", "-o", str(style)]
    assert main(learn) == 2 and "from a clip and a sentence" in capsys.readouterr().err
    assert main([*learn, "--prompt", "an old person walks"]) == 0
    assert "learning by few-shot" in capsys.readouterr().out
    assert main(["stylize", "data/actor/walk_neutral.bvh", "--style", str(style), "-o", str(out)]) == 0
    assert len(mk.load(out)) == 120


def test_play_writes_a_page_without_network(tmp_path, capsys):
    page = tmp_path / "walk.html"
    assert main(["play", "data/actor/walk_neutral.bvh", "data/actor/walk_old.bvh", "-o", str(page), "--no-open"]) == 0
    text = page.read_text()
    assert "<html" in text.lower() and 'src="http' not in text and 'import("http' not in text


@pytest.mark.parametrize(
    "arguments, part",
    [
        (["info", "nowhere.bvh"], "no such file"),
        (["stylize", "data/actor/walk_neutral.bvh", "--style", "README.md", "-o", "x.bvh"], "README.md"),
        (
            [
                "stylize",
                "data/actor/walk_neutral.bvh",
                "--style",
                "data/actor/walk_old.bvh",
                "-o",
                "no/such/folder/x.bvh",
            ],
            "there is no folder",
        ),
        (
            [
                "stylize",
                "data/actor/walk_neutral.bvh",
                "--style",
                "data/actor/walk_old.bvh",
                "-o",
                "x.bvh",
                "--method",
                "magic",
            ],
            "no method",
        ),
    ],
)
def test_errors_are_one_line_and_exit_code_2(arguments, part, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert part in error and error.count("\n") == 1 and "Traceback" not in error


def test_nothing_that_is_read_gets_overwritten(tmp_path, capsys):
    clip = tmp_path / "clip.bvh"
    clip.write_bytes(Path("data/actor/walk_neutral.bvh").read_bytes())
    before = clip.read_bytes()
    for arguments, part in (
        (["stylize", str(clip), "--style", "data/actor/walk_old.bvh", "-o", str(clip)], "would be lost"),
        (["stylize", "data/actor/walk_old.bvh", "--style", str(clip), "-o", str(clip)], "would be lost"),
        (["stylize", str(clip), "--style", "data/actor/walk_old.bvh", "-o", str(tmp_path / "x.fbx")], "a .bvh file"),
        (["play", str(clip), "--no-open", "-o", str(clip)], "would be lost"),
        (["play", str(clip), "--no-open", "-o", str(tmp_path)], "this is a folder"),
    ):
        assert main(arguments) == 2
        assert part in capsys.readouterr().err
    assert clip.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["clip.bvh"]
    assert main(["play", str(clip), "--no-open"]) == 0
    assert (tmp_path / "clip.play.html").is_file()


def test_strength_and_warnings_on_the_command_line(tmp_path, capsys):
    text = Path("data/actor/walk_neutral.bvh").read_text().replace("Frames: 120", "Frames: 130")
    (tmp_path / "off.bvh").write_text(text)
    out = tmp_path / "out.bvh"
    assert (
        main(
            [
                "stylize",
                str(tmp_path / "off.bvh"),
                "--style",
                "data/actor/walk_old.bvh",
                "--strength",
                "0.5",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    error = capsys.readouterr().err
    assert error.startswith("motionkit: ") and "disagrees" in error and "load(" not in error
    assert len(mk.load(out)) == 120


@pytest.mark.slow
@pytest.mark.parametrize("command", [[], ["info"], ["play"], ["stylize"]])
def test_help_from_a_shell(command):
    result = subprocess.run([sys.executable, "-m", "motionkit", *command, "--help"], capture_output=True, text=True)
    assert result.returncode == 0 and "usage:" in result.stdout
