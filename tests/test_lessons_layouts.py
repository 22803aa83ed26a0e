"""The inspectors: built without a kernel, and a slider changes what is drawn."""

import json

import lab
import pytest
import torch

import motionkit as mk
from motionkit.features import FacingFree, Graph, HumanML3D, SixD, StyleERD
from motionkit.lessons.layouts import facing_view, feature_inspector, plot_layouts, plot_paddle, plot_paths

TRAITS = ("_points", "_values", "_look", "_kind", "_still", "frame", "number")
PAGE = """<style>%s</style><body><div id="here"></div><script type="module">
%s
const values = %s, heard = [];
for (const n of ["_points", "_values"]) if (values[n]) values[n] = new DataView(Uint8Array.from(values[n]).buffer);
const model = { get: (n) => values[n], set: (n, v) => { values[n] = v; }, on: (n, f) => heard.push(f), off: () => {},
  save_changes: () => { window.saved = { ...values }; } };
render({ model, el: document.getElementById("here") });
</script></body>"""


@pytest.fixture(scope="module")
def walk():
    return mk.load("data/actor/walk_turn_left_neutral.bvh")


def test_a_frame_changes_the_facing_picture(walk):
    view = facing_view(walk, frame=10)
    before = view.still()
    view.frame = 60
    assert before[:4] == b"\x89PNG" and view.still() != before and len(before) < 40_000
    view.frame = 5000
    assert view.frame == len(walk) - 1


@pytest.mark.slow
@pytest.mark.parametrize("make", [FacingFree, Graph, HumanML3D, SixD, StyleERD])
def test_a_number_lights_its_joint(walk, make):
    layout = make()
    view = feature_inspector(walk, layout, frame=10)
    for number in range(0, layout.size, 7):
        view.number = number
        joint = layout.joint_of(number)
        assert view.joint == (None if joint is None else walk.skeleton.names[joint])
        assert view.description == layout.describe(number)
    look = json.loads(view._look)
    assert len(look["axis_of"]) == len(look["describe"]) == layout.size
    for number, axis in enumerate(look["axis_of"]):
        if axis is not None:
            assert f" {'xyz'[axis]} " in view._shape["describe"][number] or number < 4


@pytest.mark.slow
def test_the_inspector_picture_follows_number_and_frame(walk):
    view = feature_inspector(walk, number=14, frame=10)
    pictures = [view.still()]
    view.number = 200
    pictures.append(view.still())
    view.frame = 40
    pictures.append(view.still())
    assert len(set(pictures)) == 3 and max(map(len, pictures)) < 40_000
    view.number = 9999
    assert view.number == 262


@pytest.mark.slow
def test_a_saved_page_gets_a_picture_with_the_same_name_each_time(walk):
    view, again = facing_view(walk), facing_view(walk)
    assert view._still == again._still != feature_inspector(walk)._still
    with pytest.raises(mk.MotionKitError, match="one motion; found 2"):
        facing_view([walk, walk])
    with pytest.raises(mk.MotionKitError, match="expected a Motion"):
        feature_inspector("walk.bvh")


def test_layouts_are_drawn_as_long_as_their_rows():
    layouts = [FacingFree(), Graph(), HumanML3D(), SixD(), StyleERD()]
    ax = plot_layouts(layouts).axes[0]
    ends = {}
    for bar in ax.patches:
        y = round(-bar.get_y() - bar.get_height() / 2)
        ends[y] = max(ends.get(y, 0), bar.get_x() + bar.get_width())
    assert [ends[y] for y in range(5)] == [layout.size for layout in layouts]


def test_paths_are_drawn_from_above():
    lines = plot_paths({"there": torch.eye(2), "back": torch.zeros(3, 2)}, title="two").axes[0].lines
    assert [line.get_label() for line in lines] == ["there", "back"]
    assert lines[0].get_xydata().tolist() == torch.eye(2).tolist() and lines[0].axes.xaxis.get_inverted()


def test_a_paddle_shows_a_twist(walk):
    twisted = walk.rotations.clone()
    wrist = walk.skeleton.index("right_wrist")
    twisted[:, wrist] = torch.tensor([0.5**0.5, -(0.5**0.5), 0.0, 0.0])  # about the forearm's own length
    ax = plot_paddle({"as it is": walk, "twisted": walk.replace(rotations=twisted)}, frame=15).axes[0]
    paddles = [patch.get_xy() for patch in ax.patches]
    shapes = [(p - p[0]).round(3).tolist() for p in paddles]
    assert len(paddles) == 2 and shapes[0] != shapes[1]


@pytest.mark.browser
@pytest.mark.skipif(bool(lab.missing()), reason=lab.missing())
def test_sliders_and_hovering_redraw_in_a_browser(walk, tmp_path):
    with lab.browser() as browser:
        page = browser.new_page(viewport={"width": 1000, "height": 560})
        faults = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        for view in (facing_view(walk, frame=10), feature_inspector(walk, number=14, frame=10)):
            values = {n: getattr(view, n, None) for n in TRAITS}
            values = {n: list(v) if isinstance(v, bytes) else v for n, v in values.items()}
            page.set_content(PAGE % (view._css, view._esm.replace("export default", "void"), json.dumps(values)))
            page.wait_for_selector(".mk-said b")
            before = page.screenshot(path=str(tmp_path / f"{view._kind}.png"))
            page.locator(".mk-frame").fill("40")
            after = page.screenshot()
            assert before != after and "40" in page.locator(".mk-said").inner_text()
        keys = page.locator(".mk-side canvas").first
        keys.hover(position={"x": 132 + 9 * 17 + 5, "y": 62 + 4 * 14 + 8 + 20})
        said = page.locator(".mk-said")
        assert "positions" in said.inner_text() and said.get_attribute("data-joint") in walk.skeleton.names
        lit = page.screenshot()
        page.locator(".mk-number").fill("261")
        assert "contacts stands of right_ankle" in said.inner_text() and page.screenshot() != lit
        page.wait_for_function("window.saved && window.saved.number === 261")
        assert faults == []


@pytest.mark.browser
@pytest.mark.skipif(bool(lab.missing()), reason=lab.missing())
def test_in_jupyterlab_the_live_views_take_the_place_of_their_stills(tmp_path):
    start = (
        f"import motionkit as mk\nwalk = mk.load({str(lab.ROOT / 'data' / 'actor' / 'walk_turn_left_neutral.bvh')!r})\n"
    )
    lab.write_notebook(
        tmp_path / "t.ipynb",
        start + "mk.lessons.layouts.facing_view(walk)",
        "mk.lessons.layouts.feature_inspector(walk, number=14)",
    )
    with lab.Lab(tmp_path) as server, server.open("t.ipynb", height=1400) as page:
        page.run_all()
        page.raw.wait_for_function("document.querySelectorAll('.mk-inspect').length === 2")
        views, stills = page.raw.locator(".mk-inspect"), page.raw.locator("div[class^=mk-still]")
        assert [views.nth(n).is_visible() for n in (0, 1)] == [True, True]
        assert stills.count() == 2 and not stills.first.is_visible() and not stills.last.is_visible()
        before = views.first.screenshot()
        views.first.locator(".mk-frame").fill("90")
        page.shot(tmp_path / "lab.png")
        assert views.first.screenshot() != before
