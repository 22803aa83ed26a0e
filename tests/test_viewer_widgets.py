"""Loss curves and live restyling: what they show, how often, and what errors say."""

import asyncio
import base64
import time

import numpy as np
import pytest
import torch
from looking import near, pixels
from style_erd_small import small_model

import motionkit as mk
from motionkit.actor import perform
from motionkit.methods.style_erd import StyleErdTransfer
from motionkit.viewer import LossCurve
from motionkit.viewer.widgets import Endless, Live

TRAINING = """
import motionkit as mk
curve = mk.viewer.LossCurve("lesson", every=0)
for n in range(50):
    curve(n, 1 / (n + 1))
"""


def test_the_curve_follows_fit_to_its_last_step():
    line, curve = torch.nn.Linear(1, 1), LossCurve("a line")

    def loss_fn(line: torch.nn.Module, x: torch.Tensor) -> torch.Tensor:
        return ((line(x) - 3) ** 2).mean()

    config = mk.training.TrainConfig(60, lr=0.1)
    losses = mk.training.fit(line, lambda step: torch.ones(4, 1), loss_fn, config, callback=curve, title="").losses
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


@pytest.mark.slow
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


@pytest.fixture(scope="module")
def method():
    return StyleErdTransfer(small_model(labels=True))


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "neutral", seed=2, seconds=2.0).motion


@pytest.fixture
def live(method, walk):
    shown = Live(method, walk, left="old", right="proud")
    shown.out = []
    shown.send = lambda message, buffers=None: shown.out.append((message, buffers))
    return shown


def test_a_motion_goes_on_from_where_it_stands(walk):
    turning = walk.transform(0.7, (1.0, 0.0, 2.0))
    endless, body = Endless(turning), turning.skeleton
    frames = [next(endless) for _ in range(5 * len(walk))]
    turns, places = (torch.from_numpy(np.float32(np.stack(part))) for part in zip(*frames))
    once = turning.replace(rotations=turns[: len(walk)], translations=places[: len(walk)])
    assert float((once.positions() - turning.positions()).abs().max()) < 1e-4
    whole = turning[:1].replace(rotations=turns, translations=places)
    steps = whole.positions().diff(dim=0).norm(dim=-1).amax(1)
    assert float(steps.max()) < 2.5 * float(turning.positions().diff(dim=0).norm(dim=-1).amax())
    assert float((places[-1, 0] - places[0, 0])[[0, 2]].norm()) > 4 and len(body) == 22
    lengths = turning.root_path()[-1] - turning.root_path()[0]
    assert float((whole.root_path()[-1] - whole.root_path()[0]).norm()) > 3.5 * float(lengths.norm())


def test_every_frame_is_sent_with_both_characters(live, walk):
    for _ in range(30):
        live.step()
    message, (raw,) = live.out[-1]
    points = np.frombuffer(raw, "<f4").reshape(2, 22, 3)
    assert message["n"] == 30 and message["ms"] > 0 and "," in message["label"]
    assert np.isfinite(points).all()
    gap = live.result.positions()[-1].numpy() - points[1]
    assert np.abs(gap - gap[0]).max() < 1e-4  # moved aside as a whole
    assert len(live.result) == len(live.content) == 30 and live.result.fps == 30
    assert float((live.content.positions() - walk[:30].positions()).abs().max()) < 1e-4


def test_the_two_never_walk_far_apart(live):
    for _ in range(240):
        live._seen = live._sent  # a browser that keeps up
        live.step()
    apart = [np.frombuffer(raw, "<f4").reshape(2, 22, 3)[:, 0] for _, (raw,) in live.out]
    first, gaps = apart[0][0] - apart[0][1], [a[0] - a[1] for a in apart]
    assert max(np.linalg.norm((gap - first)[[0, 2]]) for gap in gaps) < 1.3


def test_wishes_count_from_the_next_frame_on(live, method):
    live.step()
    live.mix, live.strength = 0.25, 0.8
    assert live._stream.style == {"old": 0.75, "proud": 0.25} and live._stream.strength == 0.8
    live.left = "proud"
    assert live._stream.style == {"proud": 1.0}
    live.step()
    wanted = method.model.style_weights("proud", 0.8)
    assert np.allclose(live._stream._wanted[0], wanted)
    with pytest.raises(mk.MotionKitError, match="knows no style 'odl'"):
        Live(method, perform("walk", "neutral", seed=2, seconds=1.0).motion, left="odl")


def test_a_slow_browser_is_not_drowned_and_an_absent_one_is_left(live):
    for _ in range(100):
        live.step()
    assert len(live.out) == 60  # nobody has answered
    live._heard(None, {"seen": 60}, [])
    live.step()
    assert live.out[-1][0]["n"] == 101 and live.times["trip"] > 0


def test_frames_come_at_their_rate_while_somebody_looks(live):
    async def look():
        live._heard(None, {"hello": True}, [])
        assert live._task is not None
        for _ in range(10):
            await asyncio.sleep(0.05)
            live._heard(None, {"seen": live._sent}, [])
        live.playing = False
        await live._task

    asyncio.run(look())
    assert 11 <= len(live.out) <= 17  # half a second at 30 a second


def test_it_leaves_a_picture(live):
    assert live.still()[:4] == b"\x89PNG" and len(live.still()) < 120_000
    bundle = live._repr_mimebundle_()
    assert {"image/png", "application/vnd.jupyter.widget-view+json"} <= set(bundle)


def test_what_cannot_be_shown_live_is_told(method, walk):
    with pytest.raises(mk.MotionKitError, match="a method that streams"):
        Live(mk.methods.load("statistics"), walk)
    with pytest.raises(mk.MotionKitError, match="takes a Motion"):
        Live(method, None)
