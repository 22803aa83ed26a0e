"""The style mixer in a real JupyterLab: it plays, and its sliders move the performer."""

import lab
import pytest

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(bool(lab.missing()), reason=lab.missing() or "all there"),
    pytest.mark.filterwarnings("default"),
]
CANVAS = ".mk-view canvas"


def test_a_slider_of_the_mixer_moves_the_picture_and_keeps_time_and_camera(tmp_path):
    lab.write_notebook(
        tmp_path / "mixer.ipynb",
        "import motionkit as mk\nmixer = mk.lessons.data.style_mixer('walk', 'old')\nmixer",
        "print(mixer.player.frame, mixer.style.slump, mixer.player.playing)",
    )
    with lab.Lab(tmp_path) as server, server.open("mixer.ipynb") as page:
        page.run_all(120)
        page.raw.wait_for_selector(CANVAS)
        page.raw.wait_for_timeout(2000)
        playing = page.pixels(CANVAS)
        page.raw.wait_for_timeout(800)
        assert lab.changed(playing, page.pixels(CANVAS)) > 0.003
        page.raw.locator(".mk-player").first.focus()
        for key in ("Space", "Home"):
            page.raw.keyboard.press(key)
        page.raw.wait_for_timeout(1200)
        still = page.pixels(CANVAS)
        page.raw.locator(".widget-hslider:has(.widget-label:text-is('slump')) .noUi-handle").focus()
        for _ in range(8):
            page.raw.keyboard.press("PageDown")
        page.raw.wait_for_timeout(2500)
        moved = page.pixels(CANVAS)
        assert 0.003 < lab.changed(still, moved) < 0.25  # the trunk; with another camera the floor would change too
        page.run_cell(1)
        frame, slump, plays = page.raw.locator(".jp-OutputArea-output pre").last.inner_text().split()
        assert float(slump) < 0.3 and plays == "False" and int(frame) < 3
        page.shot(tmp_path / "mixer.png")
