"""The viewer without a browser: what is drawn, what is sent, how large it is, and what errors say."""

import ast
import base64
import html.parser
import io
import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

import motionkit as mk
from motionkit.viewer import colours, plots, scenes
from motionkit.viewer import figure as bodies
from motionkit.viewer import player as players

ROOT = Path(__file__).resolve().parent.parent
MIME = "application/vnd.plotly.v1+json"


class Clip(SimpleNamespace):
    """The least that the viewer asks of a motion."""

    def __len__(self) -> int:
        return len(self.points)

    def positions(self) -> torch.Tensor:
        return self.points


def clip(points, parents, names=None, sides=None, fps=30.0, name="clip") -> Clip:
    names = tuple(names or [f"joint{j}" for j in range(len(parents))])
    skeleton = SimpleNamespace(names=names, parents=tuple(parents), sides=tuple(sides or ["middle"] * len(parents)))
    return Clip(points=torch.as_tensor(np.asarray(points), dtype=torch.float32), skeleton=skeleton, fps=fps, name=name)


@pytest.fixture(scope="module")
def walk():
    return mk.load(ROOT / "data" / "actor" / "walk_neutral.bvh")


@pytest.fixture(scope="module")
def proud():
    return mk.load(ROOT / "data" / "actor" / "walk_proud.bvh")


def dog() -> Clip:
    """Root on the ground where it began, a spine, four legs and a tail; runs away from its root."""
    rest = [(0, 0, 0), (0, 0.5, 0), (0, 0.5, 0.5), (0, 0.7, 0.7), (0, 0.5, -0.3)]
    names, parents, sides = ["root", "hips", "chest", "Head", "tail"], [-1, 0, 1, 2, 1], ["middle"] * 5
    for side, x in (("left", 0.1), ("right", -0.1)):
        for end, z, top in (("front", 0.5, 2), ("back", 0.0, 1)):
            names += [f"{side}_{end}_knee", f"{side}_{end}_paw"]
            parents += [top, len(names) - 2]
            sides += [side] * 2
            rest += [(x, 0.25, z), (x, 0.0, z)]
    points = np.tile(np.asarray(rest, dtype=float), (20, 1, 1))
    points[:, 1:, 2] += np.linspace(0, 3, 20)[:, None]
    return clip(points, parents, names, sides, name="dog")


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


def test_a_root_left_on_the_ground_is_no_bone_and_does_not_count_for_size(walk):
    assert (0, 1) not in bodies.figures(dog())[0].bones
    assert 0 not in bodies.figures(dog())[0].drawn
    assert 0.5 < bodies.figures(dog())[0].size < 1.3
    assert len(bodies.figures(walk)[0].bones) == len(walk.skeleton.names) - 1  # a root at the hips stays


def test_no_frames_is_one_clear_error(walk):
    empty = clip(np.zeros((0, 1, 3)), [-1], name="nothing")
    for show in (mk.Player, mk.scene, mk.strip, plots.still_png, plots.plot_trajectory):
        with pytest.raises(mk.MotionKitError, match="'nothing' has no frames"):
            show(empty)
        with pytest.raises(mk.MotionKitError, match="empty list"):
            show([])
    with pytest.raises(mk.MotionKitError, match="expected a Motion, found str"):
        mk.Player("walk.bvh")


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


def test_what_is_sent_is_within_a_tenth_of_a_millimetre_and_small(walk):
    head, (found,) = bodies.decode_scene(mk.Player(walk)._data)
    assert np.abs(found - walk.positions().numpy()).max() < 1e-4
    assert len(mk.Player(walk)._data) < 22_000  # 4 s of 22 joints
    far = clip(np.random.default_rng(1).uniform(-30, 30, (50, 5, 3)), [-1, 0, 1, 2, 3])
    assert np.abs(bodies.decode_scene(mk.Player(far)._data)[1][0] - far.points.numpy()).max() < 1e-3


def test_side_by_side_leaves_room_and_overlay_leaves_places(walk, proud):
    made = bodies.figures([walk, proud, walk])
    starts = np.stack([f.points[0].mean(axis=0) for f in made])
    gaps = np.linalg.norm(np.diff(starts[:, [0, 2]], axis=0), axis=1)
    assert gaps == pytest.approx([gaps[0]] * 2, abs=1e-4) and gaps[0] > 0.6
    assert np.array_equal(bodies.figures([walk, proud], layout="overlay")[1].points, proud.positions().numpy())
    # whoever faces +Z has its left hand at +X, which a viewer in front sees at the right
    assert starts[0, 0] < starts[1, 0] < starts[2, 0]


def test_on_a_treadmill_nobody_leaves_the_spot_and_the_body_moves_as_before(walk, proud):
    made = bodies.figures([walk, proud], layout="treadmill")
    for figure, motion in zip(made, (walk, proud)):
        places = motion.positions().numpy()
        assert np.ptp(places[:, 0, 2]) > 1.5 and np.ptp(figure.points[:, 0, [0, 2]], axis=0).max() < 0.25
        around, before = (x - x[:, :1] for x in (figure.points, places))
        assert np.abs(around - before).max() < 1e-4 and np.allclose(figure.points[..., 1], places[..., 1], atol=1e-5)
    assert abs(made[0].points[0, 0, 0] - made[1].points[0, 0, 0]) > 0.6
    one = bodies.figures(walk[:1], layout="treadmill")[0]
    assert one.points.shape == (1, 22, 3) and np.isfinite(one.points).all()


def test_contacts_in_every_form_say_the_same(walk):
    from motionkit.contacts import feet_of, foot_contacts

    table, feet = foot_contacts(walk), feet_of(walk)
    names = [walk.skeleton.names[j] for j in feet]
    forms = [True, table, (names, table), {n: table[:, k] for k, n in enumerate(names)}, [table]]
    sent = {mk.Player(walk, contacts=form)._data for form in forms}
    assert len(sent) == 1
    assert bodies.decode_scene(sent.pop())[0]["motions"][0]["marks"] == feet


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


def test_a_body_seen_from_the_front_has_its_left_hand_at_the_right():
    right, up, near = bodies.view_axes(np.float32([1, 0, 0]), turn=0.0, rise=0.0)
    assert right == pytest.approx([1, 0, 0]) and up == pytest.approx([0, 1, 0]) and near == pytest.approx([0, 0, 1])
    axes = bodies.view_axes(np.float32([0.6, 0, 0.8]))
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-6) and np.linalg.det(axes) == pytest.approx(1)


def lightness(colour: str) -> float:
    linear = [((c + 0.055) / 1.055) ** 2.4 if c > 0.04 else c / 12.92 for c in colours.rgb(colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


# Viénot, Brettel and Mollon 1999: what is left of linear red, green and blue without one kind of cone.
BLIND = {"red": [[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]],
         "green": [[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]]}  # fmt: skip


@pytest.mark.parametrize("kind", BLIND)
def test_sides_and_roles_stay_apart_for_colour_blind_eyes(kind):
    for group in (colours.SIDES, colours.ROLES):
        seen = [np.asarray(BLIND[kind]) @ np.array(colours.rgb(c)) ** 2.2 for c in group.values()]
        for n, a in enumerate(seen):
            for b in seen[:n]:
                assert np.abs(np.clip(a, 0, 1) ** (1 / 2.2) - np.clip(b, 0, 1) ** (1 / 2.2)).sum() > 0.3
    assert lightness(colours.LEFT) > 1.5 * lightness(colours.RIGHT)


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


def test_importing_the_kit_loads_no_heavy_library():
    heavy = ("plotly", "matplotlib", "anywidget", "IPython")
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
