"""Strips, stills and curves for print."""

import io
import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import motionkit as mk
from motionkit.viewer import colours, plots


def test_a_strip_has_the_poses_rows_and_colours_asked_for(walk, proud):
    picture = mk.strip([walk, proud[:60]], poses=5, roles=["content", "result"], labels=["before", "after"])
    texts = [t.get_text() for t in picture.axes[0].texts]
    assert texts[:2] == ["before", "after"]
    assert texts[2:] == ["0.0 s", "1.0 s", "2.0 s", "3.0 s", "4.0 s"]
    bodies = [c for c in picture.axes[0].collections if c.get_zorder() >= 2]
    assert len(bodies) == 5 + 2  # the shorter motion's row ends sooner
    png = picture._repr_png_()
    assert png.startswith(b"\x89PNG") and len(png) < 150_000
    with pytest.raises(mk.MotionKitError, match="poses=0"):
        mk.strip(walk, poses=0)


def test_a_limb_that_reaches_past_the_axes_of_a_strip_is_not_cut_off(walk):
    picture = mk.strip(walk[:1], poses=1)
    axes, canvas = picture.axes[0], FigureCanvasAgg(picture)
    axes.set_xlim(-1, 0)  # the body stands at 0, so its other half is past the edge
    canvas.draw()
    past = math.ceil(axes.get_window_extent().x1) + 2
    assert (np.asarray(canvas.buffer_rgba())[:, past:, :3].min(-1) < 200).sum() > 100


def test_drawing_into_given_axes_and_the_small_plots(walk):
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots(1, 4)
    assert mk.strip(walk, ax=axes[0]) is figure
    assert plots.still(walk, 5, ax=axes[1]) is figure
    plots.plot_trajectory([walk, walk[:30]], ax=axes[2])
    plots.plot_curves({"left foot": walk.positions()[:, 3, 1], "other": [0.0, 1.0]}, fps=30, ax=axes[3])
    assert [line.get_color() for line in axes[3].lines] == [colours.LEFT, colours.CYCLE[1]]
    figure.savefig(io.BytesIO(), format="png")
    with pytest.raises(mk.MotionKitError, match="at least one named curve"):
        plots.plot_curves({})


@pytest.mark.parametrize("text", ["A", "noise sample", "a rather long sentence about what is seen here"])
def test_long_labels_leave_room_for_the_picture(walk, text):
    picture = plots.plot_trajectory([walk] * 5, labels=[f"{text} {n}" for n in range(5)])
    picture.png()  # layout warns, which is an error here, where no room is left
    box = picture.axes[0].get_window_extent()
    assert box.width > 150 and box.height > 150
