"""All of the viewer without a browser: any skeleton is shown everywhere, and errors are clear."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from looking import Clip, clip, dog

import motionkit as mk
from motionkit.viewer import figure as bodies
from motionkit.viewer import player as players
from motionkit.viewer import plots

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def walk():
    return mk.load(ROOT / "data" / "actor" / "walk_neutral.bvh")


def chain() -> Clip:
    return clip(np.random.default_rng(0).normal(size=(12, 1, 3)), [-1], name="chain")


def oddities() -> list[Clip]:
    still = dog()
    still.points = still.points[:1]
    return [dog(), chain(), clip(np.zeros((1, 1, 3)), [-1], name="dot"), still]


@pytest.mark.parametrize("motion", oddities(), ids=["dog", "chain", "dot", "still dog"])
def test_any_skeleton_and_a_single_frame_are_shown_everywhere(motion, tmp_path):
    player = mk.Player([motion, motion], autoplay=False)
    head, found = bodies.decode_scene(player._data)
    assert [m["frames"] for m in head["motions"]] == [len(motion)] * 2
    assert player.still().startswith(b"\x89PNG")
    assert mk.scene(motion).frames
    assert len(mk.strip(motion, poses=3).axes) == 1
    plots.plot_trajectory(motion)
    players.save_html(motion, tmp_path / "page.html")


def test_no_frames_is_one_clear_error(walk):
    empty = clip(np.zeros((0, 1, 3)), [-1], name="nothing")
    for show in (mk.Player, mk.scene, mk.strip, plots.still_png, plots.plot_trajectory):
        with pytest.raises(mk.MotionKitError, match="'nothing' has no frames"):
            show(empty)
        with pytest.raises(mk.MotionKitError, match="empty list"):
            show([])
    with pytest.raises(mk.MotionKitError, match="expected a Motion, found str"):
        mk.Player("walk.bvh")


@pytest.mark.slow
def test_importing_the_kit_loads_no_heavy_library():
    heavy = ("plotly", "matplotlib", "anywidget", "IPython", "scipy", "sklearn", "accelerate", "joblib", "pooch")
    code = f"import sys, motionkit, motionkit.viewer; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ast.literal_eval(done.stdout) == []


def test_what_holds_a_motion_is_told_apart(tmp_path):
    told = mk.actor.perform("walk", seconds=2)
    for wrong in (lambda: mk.strip(told), lambda: mk.save(told, tmp_path / "x.bvh"),
                  lambda: mk.methods.load("statistics").stylize(told, style=told.motion)):  # fmt: skip
        with pytest.raises(mk.MotionKitError, match="give its .motion"):
            wrong()
    assert not list(tmp_path.iterdir())
