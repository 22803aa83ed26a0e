"""Pictures and widgets of judging: they show the numbers they are given, and say what is wrong with them."""

import base64
import time

import numpy as np
import pytest
import torch
from looking import cloud, near, pixels
from matplotlib.patches import Ellipse

import motionkit as mk
from motionkit.lessons import judging
from motionkit.lessons.judging import cloud_explorer, plot_clouds, plot_confusion
from motionkit.viewer import LossCurve

TRAINING = """
import motionkit as mk
curve = mk.viewer.LossCurve("lesson", every=0)
for n in range(50):
    curve(n, 1 / (n + 1))
"""


# Clouds


def test_clouds_are_told_by_their_fmd_and_its_parts():
    a, b = cloud(300), 2 * cloud(300, seed=1) + torch.tensor([3.0, 1.0])
    title = plot_clouds(a, b, parts=True).axes[0].get_title(loc="left")
    whole, means, spreads = (float(word) for word in title.split() if word[0].isdigit())
    assert whole == pytest.approx(mk.metrics.fmd(a, b), abs=0.006)
    assert means == pytest.approx(float(((a.mean(0) - b.mean(0)) ** 2).sum()), abs=0.006)
    assert spreads == pytest.approx(whole - means, abs=0.011) and spreads > 1
    assert plot_clouds(a, b).axes[0].get_title(loc="left") == title.split(" =")[0]


def test_an_ellipse_holds_the_share_of_points_that_a_gaussian_has_there():
    a = cloud(4000) @ torch.tensor([[2.0, 1.0], [0.0, 0.5]])
    ax = plot_clouds(a, a, labels=("one", "two")).axes[0]
    found = [patch for patch in ax.patches if isinstance(patch, Ellipse)]
    assert len(found) == 4
    for ellipse, deviations in zip(found, (1, 2, 1, 2)):
        inside = ellipse.get_patch_transform().inverted().transform(a.numpy())
        share = float((np.hypot(*inside.T) < 1).mean())
        assert share == pytest.approx(1 - np.exp(-(deviations**2) / 2), abs=0.02)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["one: 4,000", "two: 4,000"]


def test_clouds_can_be_drawn_into_given_axes_and_stay_small():
    picture = plot_clouds(cloud(3000), cloud(3000, seed=1))
    assert all(len(line.get_xdata()) <= 2000 for line in picture.axes[0].lines)
    drawn = picture._repr_png_()
    assert len(drawn) < 60_000
    assert all(near(pixels(drawn), ink, 60) > 300 for ink in judging.CLOUD_COLOURS)
    assert plot_clouds(cloud(9), cloud(9), ax=picture.axes[0]) is picture


@pytest.mark.parametrize(
    ("a", "labels", "said"),
    [
        (cloud(9, 3), ("real", "made"), r"'real' as a tensor of points \[N, 2\]; found \[9, 3\]"),
        ([[1, 2]], ("real", "made"), "found a list"),
        (cloud(2), ("mine", "made"), "mine has 2 rows"),
        (torch.full((5, 2), torch.nan), ("mine", "made"), "mine"),
        (cloud(9), ("one",), "two labels"),
    ],
)
def test_clouds_say_what_is_wrong(a, labels, said):
    with pytest.raises(mk.MotionKitError, match=said):
        plot_clouds(a, cloud(9), labels)


def second_line(explorer: object) -> float:
    picture = explorer._draw(**explorer.values())
    return float(picture.axes[0].texts[0].get_text().rsplit(" ", 1)[1])


def test_the_explorer_moves_and_names_the_true_distance(caplog):
    explorer = cloud_explorer()
    for name, value in {"shift": 3.0, "spread": 2.0, "turn": -60, "points": 20}.items():
        before = explorer.png
        explorer.controls[name].value = value
        assert explorer.png != before, name
    explorer.set(shift=2.0, spread=1.0, turn=0, points=300)
    assert second_line(explorer) == 4.0
    explorer.set(shift=0.0, spread=2.0)
    assert second_line(explorer) == pytest.approx(1 + 0.4**2, abs=0.006)
    explorer.set(spread=1.0, turn=90)
    assert second_line(explorer) == pytest.approx(2 * (1 - 0.4) ** 2, abs=0.006)
    assert caplog.messages == []  # matplotlib logs what it could not fit


def test_few_points_measure_too_much_and_many_nearly_the_truth():
    explorer = cloud_explorer()
    measured = []
    for points in (5, 3000):
        explorer.set(shift=0.0, spread=1.0, turn=0, points=points)
        title = explorer._draw(**explorer.values()).axes[0].get_title(loc="left")
        measured.append(float(title.split()[1]))
    assert second_line(explorer) == 0 and measured[0] > 0.1 > 0.02 > measured[1]


# Confusion


def cells(ax: object) -> dict[tuple[int, int], str]:
    return {(round(t.get_position()[1]), round(t.get_position()[0])): t.get_text() for t in ax.texts}


def test_cells_are_per_cent_of_their_row_and_empty_ones_stay_empty():
    counts = torch.tensor([[3, 1, 0], [0, 8, 0], [1, 0, 399]])
    ax = plot_confusion(counts, ["walk", "run", "jump"], "content").axes[0]
    assert cells(ax) == {(0, 0): "75", (0, 1): "25", (1, 1): "100", (2, 0): "<1", (2, 2): "100"}
    assert ax.get_title(loc="left") == "content: 100 % right"  # 410 of 412
    assert [t.get_text() for t in ax.get_yticklabels()] == ["walk", "run", "jump"]
    assert ax.images[0].get_array()[0].tolist() == [75, 25, 0]


def test_accuracy_in_the_title_is_the_metrics():
    scores, labels = cloud(90, 9), torch.arange(90) % 9
    title = plot_confusion(mk.metrics.confusion(scores, labels), list("abcdefghi")).axes[0].get_title(loc="left")
    assert title == f"{mk.metrics.recognition_accuracy(scores, labels):.0f} % right"


def test_a_class_without_clips_leaves_an_empty_row():
    ax = plot_confusion(torch.tensor([[2, 0], [0, 0]]), ["walk", "run"]).axes[0]
    assert cells(ax) == {(0, 0): "100"} and ax.get_title(loc="left") == "100 % right"


def test_twelve_classes_beside_eight_can_be_read():
    tables = [50 * torch.eye(12).long() + 3, 50 * torch.eye(8).long() + 3]
    tables[0][3, 4] = tables[1][3, 4] = 30  # a cell neither light nor dark
    names = [[f"content_{n:02}" for n in range(12)], [f"style_{n}" for n in range(8)]]
    picture = plot_confusion(tables, names, ["content", "style"])
    assert [ax.get_title(loc="left") for ax in picture.axes] == ["content: 60 % right", "style: 68 % right"]
    assert picture.get_size_inches()[0] <= 11 and len(picture._repr_png_()) < 60_000
    for ax in picture.axes:
        boxes = [text.get_window_extent() for text in ax.texts]
        wide = ax.transData.transform((1, 0))[0] - ax.transData.transform((0, 0))[0]
        assert max(box.width for box in boxes) < 0.8 * wide and min(t.get_fontsize() for t in ax.texts) >= 7.5
        for text in ax.texts:  # light on dark, dark on light
            column, row = text.get_position()
            dark = ax.images[0].get_array()[row, column] > 55
            assert (text.get_color() == "white") == dark


@pytest.mark.parametrize(
    ("counts", "labels", "said"),
    [
        (torch.ones(2, 3), ["a", "b"], r"found \[2, 3\]"),
        (torch.ones(2, 2), ["a"], "a label for each of 2 classes; found 1"),
        (torch.ones(2, 2), "ab", "found 'ab'"),
        (np.ones((2, 2)), ["a", "b"], "found a ndarray"),
        (-torch.ones(2, 2), ["a", "b"], "negative"),
        ([torch.ones(2, 2)] * 2, [["a", "b"]], "2 tables of counts, 1 lists of labels"),
        ([], [], "0 tables"),
    ],
)
def test_confusion_says_what_is_wrong(counts, labels, said):
    with pytest.raises(mk.MotionKitError, match=said):
        plot_confusion(counts, labels)


# The loss


def test_the_curve_follows_fit_to_its_last_step():
    line, curve = torch.nn.Linear(1, 1), LossCurve("a line")

    def loss_fn(line: torch.nn.Module, _: int) -> torch.Tensor:
        return ((line(torch.ones(4, 1)) - 3) ** 2).mean()

    losses = mk.training.fit(line, loss_fn, mk.training.TrainConfig(60, rate=0.1), show=curve, title="").losses
    assert curve.losses == losses and curve.steps == list(range(60))
    raw, strong = curve.figure().axes[0].lines
    assert raw.get_ydata().tolist() == losses and raw.get_xdata().tolist() == curve.steps
    assert strong.get_ydata()[-1] == pytest.approx(curve.smoothed()[-1])
    assert curve.figure().axes[0].get_title(loc="left") == "a line" and "step 59" in repr(curve)


def test_the_strong_line_is_a_mean_of_the_past():
    curve = LossCurve(smooth=0.9)
    for step in range(500):
        curve(step, 2.0 + (-1) ** step)
    smoothed = curve.smoothed()
    assert smoothed[0] == 3.0 and abs(smoothed[200:] - 2).max() < 0.1
    assert np.array_equal(LossCurve(smooth=0.0).smoothed(), [])


def test_a_hole_in_the_loss_is_left_out_and_drawn():
    curve = LossCurve(smooth=0.5)
    for step, loss in enumerate([float("nan"), 2.0, float("inf"), 2.0]):
        curve(step, loss)
    assert np.isnan(curve.smoothed()[0]) and curve.smoothed()[1:].tolist() == [2, 2, 2]
    assert near(pixels(curve.png), "#2b6ca8") > 100


def test_a_step_back_begins_anew_and_going_on_goes_on():
    curve = LossCurve()
    for step in (0, 1, 2):
        curve(step, 1.0)
    curve.done()
    curve(3, 0.5)
    assert curve.steps == [0, 1, 2, 3]
    curve(0, 9.0)
    assert curve.steps == [0] and curve.losses == [9.0]


def test_a_step_costs_next_to_nothing_and_a_long_curve_is_drawn_quickly():
    curve = LossCurve()
    curve(0, 1.0)
    start = time.process_time()
    for step in range(1, 100_000):
        curve(step, 1.0)
    assert time.process_time() - start < 2  # 20 microseconds a step
    start = time.process_time()
    picture = curve.figure()
    assert time.process_time() - start < 1
    assert all(len(line.get_xdata()) <= 2000 and line.get_xdata()[-1] == 99_999 for line in picture.axes[0].lines)
    assert len(curve._repr_png_()) < 30_000


@pytest.mark.parametrize(("drawing", "between"), [(0.001, 0.5), (0.1, 2.0)])
def test_it_is_drawn_at_most_every_half_second_and_in_a_twentieth_of_the_time(monkeypatch, drawing, between):
    class Image:
        drawn = []
        value = property(fset=lambda self, png: self.drawn.append(now[0]))

    now, curve = [0.0], LossCurve()
    curve(0, 1.0)
    monkeypatch.setattr(Image, "drawn", [])
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(LossCurve, "png", property(lambda self: now.__setitem__(0, now[0] + drawing)))
    curve._image = Image()
    for step in range(1, 1000):
        now[0] += 0.01
        curve(step, 1.0)
    gaps = np.diff(Image.drawn)
    assert len(gaps) > 3 and gaps.min() >= between and gaps.max() < between + drawing + 0.02


def test_a_curve_without_a_step_can_be_shown(capsys):
    curve = LossCurve("nothing")
    assert repr(curve) == "LossCurve('nothing': no step yet)" and pixels(curve.png).shape == (270, 640, 3)
    curve._ipython_display_()
    assert capsys.readouterr().out == repr(curve) + "\n"


def test_curves_say_what_is_wrong():
    for given in ({"smooth": 1}, {"smooth": -0.1}, {"every": -1}, {"every": "often"}, {"smooth": float("nan")}):
        with pytest.raises(mk.MotionKitError, match=f"expected {next(iter(given))}"):
            LossCurve(**given)
    with pytest.raises(mk.MotionKitError, match="one number each; found 0 and"):
        LossCurve()(0, torch.ones(3))


def run_cells(*cells: str) -> list[list[dict]]:
    """What cells leave behind in a notebook that nobody looks at, run by a kernel."""
    import nbformat.v4 as v4
    from nbclient import NotebookClient

    book = v4.new_notebook(cells=[v4.new_code_cell(source) for source in cells])
    NotebookClient(book, kernel_name="python3", allow_errors=True, extra_arguments=["--log-level=ERROR"]).execute()
    return [[output.get("data", {}) for output in cell.outputs if "data" in output] for cell in book.cells]


@pytest.mark.filterwarnings("default")  # of the kernel's machinery
def test_a_saved_notebook_holds_the_whole_curve_however_the_cell_ends():
    ended, shown, broken, gone_on, empty, filled = run_cells(
        TRAINING,
        TRAINING + "curve",
        TRAINING + "1 / 0",
        "curve(50, 1.0)",
        "late = mk.viewer.LossCurve()\nlate",
        "late(0, 5.0)",
    )
    for outputs in (ended, shown, broken):
        (only,) = outputs
        assert only["text/plain"].startswith("LossCurve('lesson': step 49")
        assert set(only) == {"image/png", "text/plain"}
        assert near(pixels(base64.b64decode(only["image/png"])), "#2b6ca8") > 300
    assert [output["text/plain"].split(",")[0] for output in gone_on] == ["LossCurve('lesson': step 50"]
    assert "step 0" in empty[0]["text/plain"] and filled == []  # it grows where it was shown
