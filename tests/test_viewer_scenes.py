"""Scenes: small, whole, and every bone once."""

import json

import numpy as np
import pytest

import motionkit as mk
from motionkit.viewer import figure as bodies
from motionkit.viewer import scenes

MIME = "application/vnd.plotly.v1+json"


def test_a_scene_is_small_and_holds_the_motion(walk, proud):
    made = mk.scene(walk)
    bundle = made._repr_mimebundle_()
    assert len(json.dumps(bundle[MIME])) < 80_000
    three = mk.scene([walk, proud, walk], roles=["content", "style", "result"])
    assert len(json.dumps(three._repr_mimebundle_()[MIME])) < 150_000
    assert "image/png" not in bundle and len(bundle["image/jpeg"]) < 60_000
    assert "text/html" not in bundle  # where plotly would put its own 5 MB
    last = made.frames[-1].data
    ends = np.array([[v for t in last for v in (t[axis] or ()) if v is not None] for axis in "yzx"])
    truth = bodies.figures(walk)[0].points[-1]
    assert ends.min(axis=1) == pytest.approx(truth.min(axis=0), abs=2e-3)
    assert ends.max(axis=1) == pytest.approx(truth.max(axis=0), abs=2e-3)
    extents = [np.ptp(made.layout.scene[f"{n}axis"].range) for n in "xyz"]
    shares = [made.layout.scene.aspectratio[n] for n in "xyz"]
    assert np.array(shares) / shares[0] == pytest.approx(np.array(extents) / extents[0], rel=0.01)
    assert len(mk.scene(walk, stride=10).frames) == 12


def test_every_bone_is_drawn_once_in_a_scene(walk):
    figure = bodies.figures(walk)[0]
    seen = [p for _, run in scenes._runs(figure) for p in zip(run, run[1:]) if None not in p]
    assert sorted(seen) == sorted(figure.bones)
