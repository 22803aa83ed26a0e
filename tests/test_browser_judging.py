"""The map of features in a real JupyterLab: the dot under the mouse plays its clip."""

import json

import lab
import pytest

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(bool(lab.missing()), reason=lab.missing() or "all there"),
    pytest.mark.filterwarnings("default"),
]
CANVAS = ".mk-map-player canvas"
MAP = """import torch, motionkit as mk
kinds = ("walk", "jump", "wave", "kick")
motions = [mk.actor.perform(kinds[n % 4], seed=n).motion for n in range(16)]
features = torch.eye(4)[torch.arange(16) % 4] * 9 + torch.randn(16, 4, generator=torch.Generator().manual_seed(0))
features[3] = torch.nan
view = mk.lessons.judging.feature_map(features, [kinds[n % 4] for n in range(16)], motions)
view"""


def test_the_dot_under_the_mouse_plays_its_clip_and_a_still_is_saved(tmp_path):
    lab.write_notebook(tmp_path / "map.ipynb", MAP, "print(view.shown, view.player.motions[0].name)")
    with lab.Lab(tmp_path) as server, server.open("map.ipynb") as page:
        page.run_all(120)
        page.raw.wait_for_selector(CANVAS)
        dots = page.raw.locator(".scatterlayer .trace path.point")
        dots.first.wait_for()
        page.raw.wait_for_timeout(1500)
        page.raw.locator(".mk-player").first.focus()
        for key in ("Space", "Home"):
            page.raw.keyboard.press(key)
        page.raw.wait_for_timeout(1200)
        still = page.pixels(CANVAS)
        page.raw.wait_for_timeout(400)
        assert lab.changed(still, page.pixels(CANVAS)) < 0.001
        assert dots.count() == 15 + 1  # one clip is left out, and one dot is the ring
        box = page.raw.locator(".scatterlayer .trace").nth(1).locator("path.point").nth(1).bounding_box()
        page.raw.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, steps=4)
        page.raw.wait_for_timeout(2500)
        moved = page.pixels(CANVAS)
        assert 0.003 < lab.changed(still, moved) < 0.5
        page.shot(tmp_path / "map.png")
        page.raw.wait_for_timeout(400)
        assert lab.changed(moved, page.pixels(CANVAS)) > 0.001  # it plays
        page.run_cell(1)
        shown = page.raw.locator(".jp-OutputArea-output pre").last.inner_text().split()
        assert shown[0] == "11" and "kick" in shown[1]  # of the kicks 3, 7, 11, 15 the first is left out
        page.save()
    saved = json.loads((tmp_path / "map.ipynb").read_text())
    assert any("image/png" in output.get("data", {}) for output in saved["cells"][0]["outputs"])
