"""The player in a real JupyterLab and as a page of its own, in headless Chromium: pixels, keys, frame rate."""

import json
import shutil
from pathlib import Path

import lab
import pytest

import motionkit as mk
from motionkit.viewer import save_html

ROOT = Path(__file__).resolve().parent.parent
CLIPS = [ROOT / "data" / "actor" / f"walk_{style}.bvh" for style in ("neutral", "old", "proud", "childlike")]
CANVAS = ".mk-view canvas"
# Chromium's and other packages' own complaints, none of them about the player.
OTHERS = ("widget model not found", "Failed to initialize model", "GPU stall", "favicon")

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(bool(lab.missing()), reason=lab.missing() or "all there"),
    pytest.mark.filterwarnings("default"),
]


def ours(errors: list[str]) -> list[str]:
    return [e for e in errors if not any(text in e for text in OTHERS)]


def state(page: object, what: str) -> object:
    """Something of the first player on the page, such as `frame()`."""
    return page.evaluate(f"() => document.querySelector('.mk-player').motionkit.{what}")


def frame_rate(page: object, seconds: float = 4.0) -> tuple[float, float]:
    """Pictures a second, and milliseconds of JavaScript for each."""
    look = "() => ({...document.querySelector('.mk-player').motionkit.stats, now: performance.now()})"
    before = page.evaluate(look)
    page.wait_for_timeout(1000 * seconds)
    after = page.evaluate(look)
    frames = after["frames"] - before["frames"]
    return 1000 * frames / (after["now"] - before["now"]), (after["busy"] - before["busy"]) / max(frames, 1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("lab")
    for path in CLIPS:
        shutil.copy(path, folder)
    names = [path.name for path in CLIPS]
    lab.write_notebook(
        folder / "player.ipynb",
        f"import motionkit as mk\nmotions = [mk.load(n) for n in {names}]",
        "labels = ['one', 'two', 'three', 'four']\n"
        "player = mk.Player(motions, labels=labels, trails=['left_wrist'], contacts=True)\nplayer",
        "player.frame, player.playing",
    )
    lab.write_notebook(folder / "scene.ipynb", f"import motionkit as mk\nmk.scene(mk.load({names[0]!r}))")
    return folder


def rewrite(page: object, number: int, text: str) -> None:
    """Puts other text into a code cell."""
    page.locator(".jp-CodeCell").nth(number).locator(".cm-content").click()
    page.keyboard.press("Control+a")
    page.keyboard.insert_text(text)


@pytest.fixture(scope="module")
def chromium():
    with lab.browser() as found:
        yield found


@pytest.fixture(scope="module")
def page(folder, chromium):
    """The player's notebook, run; the tests below go on from where the one before them left it."""
    with lab.Lab(folder) as server, server.open("player.ipynb", chromium) as page:
        page.run_all()
        page.raw.wait_for_selector(CANVAS)
        page.raw.locator(".mk-player").scroll_into_view_if_needed()
        page.raw.wait_for_timeout(1500)
        yield page


def test_the_player_moves_in_jupyterlab(page, capsys):
    assert state(page.raw, "stats.kind") == "GlView", state(page.raw, "stats.why")
    first = page.pixels(CANVAS)
    page.raw.wait_for_timeout(700)
    assert lab.changed(first, page.pixels(CANVAS)) > 0.005
    rate, busy = frame_rate(page.raw)
    with capsys.disabled():
        print(f"\nfour characters in JupyterLab: {rate:.0f} pictures a second, {busy:.1f} ms of JavaScript each")
    # Low, since other work may share the processor that also stands in for a graphics card here.
    assert rate > 1 and busy < 16


def test_keys_pause_and_step(page):
    page.raw.locator(".mk-player").focus()
    page.raw.keyboard.press("Space")
    page.raw.wait_for_timeout(800)
    still = page.pixels(CANVAS)
    page.raw.wait_for_timeout(700)
    assert lab.changed(still, page.pixels(CANVAS)) == 0
    steps = {"End": lambda n: state(page.raw, "stage.frames") - 1, "Home": lambda n: 0, "ArrowRight": lambda n: n + 1}
    steps |= {"Shift+ArrowRight": lambda n: n + 10, "ArrowLeft": lambda n: n - 1}
    for key, goal in steps.items():
        before = state(page.raw, "frame()")
        page.raw.keyboard.press(key)
        assert state(page.raw, "frame()") == goal(before), key


def test_the_slider_moves_the_picture_and_python_hears_of_it(page):
    before = page.pixels(CANVAS)
    box = page.raw.locator(".mk-scrub").bounding_box()
    page.raw.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.raw.wait_for_timeout(800)
    assert lab.changed(before, page.pixels(CANVAS)) > 0.005
    middle = state(page.raw, "frame()")
    assert abs(middle - state(page.raw, "stage.frames") / 2) < 6
    page.run_cell(2)
    told = page.raw.locator(".jp-CodeCell").nth(2).locator(".jp-OutputArea-output").inner_text()
    assert told.strip() == f"({middle}, False)"


def test_python_moves_the_picture_and_replaces_what_it_shows(page):
    before = page.pixels(CANVAS)
    rewrite(page.raw, 2, "player.frame = 7")
    page.run_cell(2)
    page.raw.wait_for_timeout(600)
    assert state(page.raw, "frame()") == 7
    seventh = page.pixels(CANVAS)
    assert lab.changed(before, seventh) > 0.005
    rewrite(page.raw, 2, "player.motions = [m.mirror() for m in reversed(motions)]")
    page.run_cell(2)
    page.raw.wait_for_timeout(1000)
    assert lab.changed(seventh, page.pixels(CANVAS)) > 0.005 and state(page.raw, "frame()") == 7
    rewrite(page.raw, 2, "player.playing, player.speed = True, 2.0")
    page.run_cell(2)
    page.raw.wait_for_timeout(1000)
    assert state(page.raw, "frame()") != 7 and state(page.raw, "ui.speed.value") == "2"


def test_what_the_notebook_keeps(page, folder, tmp_path):
    page.raw.locator(".mk-play").click()
    page.shot(tmp_path / "player.png")
    page.save()
    assert not page.raw.locator("img[alt^=Player]").is_visible()  # the live view hides its still
    assert ours(page.errors) == []
    saved = json.loads((folder / "player.ipynb").read_text())
    assert "widgets" not in saved["metadata"]
    assert (folder / "player.ipynb").stat().st_size < 100_000


def test_a_saved_notebook_shows_a_still_without_its_kernel(folder, chromium, tmp_path):
    book = json.loads((folder / "player.ipynb").read_text())
    if not book["cells"][1]["outputs"]:
        pytest.skip("runs after the test that saves the notebook")
    with lab.Lab(folder) as server, server.open("player.ipynb", chromium) as page:
        page.raw.wait_for_timeout(2000)
        page.shot(tmp_path / "saved.png")
        image = page.raw.locator("img[alt^=Player]")
        assert image.is_visible()
        assert page.pixels("img[alt^=Player]").std() > 5
        assert page.raw.locator(".mk-player").count() == 0


def test_a_scene_in_jupyterlab(folder, chromium, tmp_path):
    with lab.Lab(folder, dark=True) as server, server.open("scene.ipynb", chromium) as page:
        page.run_all()
        page.raw.wait_for_selector(".js-plotly-plot .gl-container canvas, .js-plotly-plot canvas", timeout=60000)
        page.raw.wait_for_timeout(2500)
        before = page.pixels(".js-plotly-plot")
        page.raw.locator(".updatemenu-button").first.click()
        page.raw.wait_for_timeout(2500)
        assert lab.changed(before, page.pixels(".js-plotly-plot")) > 0.002
        page.shot(tmp_path / "scene.png")
        assert ours(page.errors) == []


def test_the_page_of_its_own(chromium, tmp_path, capsys):
    path = save_html([mk.load(p) for p in CLIPS], tmp_path / "walks.html")
    requests, errors = [], []
    for scheme in ("light", "dark"):
        page = chromium.new_page(viewport={"width": 1000, "height": 600}, color_scheme=scheme)
        page.on("request", lambda r: requests.append(r.url))
        page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda e: errors.append(str(e)))
        page.goto(path.as_uri())
        page.wait_for_timeout(1500)
        assert state(page, "stats.kind") == "GlView", state(page, "stats.why")
        page.screenshot(path=str(tmp_path / f"{scheme}.png"))
        assert state(page, "ui.root.classList.contains('mk-dark')") == (scheme == "dark")
        rate, busy = frame_rate(page)
        with capsys.disabled():
            print(f"\nfour characters on a page: {rate:.0f} pictures a second, {busy:.1f} ms of JavaScript each")
        use_the_mouse(page)
        page.close()
    assert ours(errors) == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []


def use_the_mouse(page: object) -> None:
    yaw = state(page, "camera.yaw")
    page.mouse.move(500, 250)
    page.mouse.down()
    page.mouse.move(600, 260, steps=4)
    page.mouse.up()
    assert state(page, "camera.yaw") < yaw - 0.5
    page.mouse.wheel(0, -400)
    page.wait_for_timeout(500)
    assert state(page, "camera.zoom") > 1.2
    page.dblclick(".mk-view")
    assert state(page, "camera.zoom") == 1


def test_without_webgl_the_player_draws_on_a_plain_canvas(chromium, tmp_path):
    page = chromium.new_page(viewport={"width": 900, "height": 520})
    page.add_init_script(
        "const get = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        " return kind === 'webgl2' ? null : get.call(this, kind, ...more); };"
    )
    page.goto(save_html(mk.load(CLIPS[0]), tmp_path / "walk.html").as_uri())
    page.wait_for_timeout(800)
    assert state(page, "stats.kind") == "FlatView"
    before = lab.Page(page).pixels(CANVAS)
    page.wait_for_timeout(500)
    after = lab.Page(page).pixels(CANVAS)
    page.screenshot(path=str(tmp_path / "flat.png"))
    page.close()
    assert after.std() > 5 and lab.changed(before, after) > 0.003
