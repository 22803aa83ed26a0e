"""The live view: a motion without an end, frames for the browser, and what it answers."""

import asyncio

import numpy as np
import pytest
import torch
from erd_small import small_model

import motionkit as mk
from motionkit.actor import perform
from motionkit.methods.style_erd import StyleErdMethod
from motionkit.viewer.widgets import Endless, Live


@pytest.fixture(scope="module")
def method():
    return StyleErdMethod(small_model(labels=True))


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
    wanted = method.model.wanted("proud", 0.8)
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
