"""The player without a browser: its traits, its still, its page, and what errors say."""

import base64
import html.parser
import io

import numpy as np
import pytest
import torch
from looking import clip
from PIL import Image

import motionkit as mk
from motionkit.viewer import colours
from motionkit.viewer import figure as bodies
from motionkit.viewer import player as players


def test_wrong_arguments_say_what_was_expected(walk):
    wrong = {
        "layout 'above': expected one of side, treadmill, overlay": {"layout": "above"},
        "role 'teacher': expected one of content, style, result": {"roles": ["teacher"]},
        "labels: expected 1, one for each motion; found 2": {"labels": ["a", "b"]},
        "trails: no joint 'Wing'": {"trails": ["Wing"]},
        "has no joint 'Wing'": {"contacts": {"Wing": torch.ones(len(walk), dtype=torch.bool)}},
        "expected 120 frames, found 3": {"contacts": {walk.skeleton.names[3]: torch.ones(3)}},
        "expected a number above 0": {"speed": 0.0},
    }
    for text, arguments in wrong.items():
        with pytest.raises(mk.MotionKitError, match=text):
            mk.Player(walk, **arguments)
    with pytest.raises(mk.MotionKitError, match="no number"):
        mk.Player(clip(np.full((2, 1, 3), np.nan), [-1]))


def test_replacing_motions_keeps_looks_and_frame_in_range(walk, proud):
    player = mk.Player([walk, walk], roles=["content", "result"], labels=["a", "b"], autoplay=False)
    player.frame = 100
    player.motions = [walk[:50], proud[:50]]
    head, _ = bodies.decode_scene(player._data)
    assert [m["label"] for m in head["motions"]] == ["a", "b"]
    assert head["motions"][0]["role"] == colours.ROLES["content"]
    assert player.frame == 49 == player.frame_count - 1
    player.set_motions(walk, labels=["only"])
    assert [m["label"] for m in bodies.decode_scene(player._data)[0]["motions"]] == ["only"]
    before = player._data
    with pytest.raises(mk.MotionKitError, match="unknown colour"):
        player.set_motions(proud, colour="red")
    with pytest.raises(mk.MotionKitError):
        player.motions = []
    assert player._data == before and player.motions == [walk]


def test_the_frame_stays_inside_and_counts_in_the_first_motions_frames(walk):
    player = mk.Player([walk, walk.resample(60)], autoplay=False)
    assert player.frame_count in (len(walk), len(walk) + 1)
    player.frame = 10_000
    assert player.frame == player.frame_count - 1
    player.frame = -5
    assert player.frame == 0


def test_what_a_notebook_keeps_of_a_player(walk, monkeypatch):
    shown = []
    monkeypatch.setattr("IPython.display.display", lambda bundle, raw: shown.append(bundle))
    player = mk.Player(walk)
    player._ipython_display_()
    view, still = shown
    assert view["application/vnd.jupyter.widget-view+json"]["model_id"] == player.model_id
    assert view["text/plain"] == repr(player)
    picture = still["text/html"].split("base64,")[1].split('"')[0]
    assert player._still in still["text/html"] and len(still["text/html"]) < 60_000
    with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
        assert image.size == (760, 380)
        assert len(np.unique(np.asarray(image.convert("RGB")).reshape(-1, 3), axis=0)) > 20


class Links(html.parser.HTMLParser):
    found: list

    def handle_starttag(self, tag, attrs):
        self.found = [*getattr(self, "found", []), *[v for k, v in attrs if k in ("src", "href")]]


def test_the_page_is_whole_and_needs_no_network(walk, tmp_path):
    path = players.save_html([walk, walk], tmp_path / "walk <1>.html", labels=["<b>bold</b>", "two"])
    text = path.read_text(encoding="utf-8")
    links = Links()
    links.feed(text)
    assert links.found == ["data:,"]
    assert "<!--" not in text.split("<script")[0] and len(text) < 160_000
    assert [p.name for p in tmp_path.iterdir()] == ["walk <1>.html"]
    data = base64.b64decode(text.split('id="motionkit-data">')[1].split("<")[0])
    assert bodies.decode_scene(data)[0]["motions"][1]["label"] == "two"
    assert mk.Player(walk).save_html(tmp_path / "two.html").is_file()
    with pytest.raises(mk.MotionKitError, match="there is no folder"):
        players.save_html(walk, tmp_path / "nowhere" / "x.html")
    (tmp_path / "taken").mkdir()
    with pytest.raises(mk.MotionKitError, match="this is a folder"):
        players.save_html(walk, tmp_path / "taken")
    assert not list(tmp_path.glob(".*"))
