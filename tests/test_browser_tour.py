"""The tour in a real JupyterLab, as a student and as somebody with captures runs it."""

import shutil
from pathlib import Path

import lab
import pytest

import motionkit as mk

ROOT = Path(__file__).resolve().parent.parent
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(bool(lab.missing()), reason=lab.missing() or "all there"),
    pytest.mark.filterwarnings("default"),
]


@pytest.fixture
def folder(tmp_path):
    """A copy of the tour and its clips, so that a test leaves nothing behind in the repository."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    (tmp_path / "notebooks").mkdir()
    shutil.copy(ROOT / "notebooks" / "00_tour.ipynb", tmp_path / "notebooks")
    return tmp_path


def test_the_tour_runs_and_its_mixer_moves_the_picture(folder):
    with lab.Lab(folder) as server, server.open("notebooks/00_tour.ipynb") as page:
        page.run_all(180)
        assert (folder / "out" / "tour_result.bvh").is_file()
        cell = page.raw.locator(".jp-CodeCell:has(.noUi-handle)")  # the one with the slider
        mixer = cell.locator(".mk-player")
        mixer.scroll_into_view_if_needed()
        page.raw.wait_for_timeout(2500)
        mixer.evaluate("player => player.setAttribute('id', 'mixer')")
        canvas = "#mixer .mk-view canvas"
        first = page.pixels(canvas)
        page.raw.wait_for_timeout(800)
        assert lab.changed(first, page.pixels(canvas)) > 0.003  # it plays
        mixer.focus()
        for key in ("Space", "Home"):
            page.raw.keyboard.press(key)
        page.raw.wait_for_timeout(1200)
        still = page.pixels(canvas)
        cell.locator(".noUi-handle").focus()
        for _ in range(5):
            page.raw.keyboard.press("ArrowRight")
        page.raw.wait_for_timeout(2500)
        assert lab.changed(still, page.pixels(canvas)) > 0.003  # the slider restyles


@pytest.mark.captures
def test_captures_play_get_restyled_and_written_in_jupyterlab(captures_dir, tmp_path):
    """Walk and raised hands in three styles: loaded, four at once in a player, restyled, written, read back equal."""
    names = [
        f"dataset-2_{c}_{s}_001.bvh" for c in ("walk", "raise-up-both-hands") for s in ("normal", "elderly", "active")
    ]
    for name in names:
        shutil.copy(captures_dir / name, tmp_path)
    lab.write_notebook(
        tmp_path / "captures.ipynb",
        f"import motionkit as mk, torch\nclips = [mk.load(n) for n in {names}]\nmethod = mk.methods.load('statistics')",
        "results = [method.stylize(clips[3 * k], style=clips[3 * k + s]) for k in (0, 1) for s in (1, 2)]\n"
        "mk.Player(results, labels=list('abcd'))",
        "for n, r in enumerate(results):\n"
        "    again = mk.load(mk.save(r, f'result{n}.bvh'))\n"
        "    assert torch.allclose(again.positions(), r.positions(), atol=1e-4 * r.skeleton.height)",
    )
    with lab.Lab(tmp_path) as server, server.open("captures.ipynb") as page:
        page.run_all()
        page.raw.wait_for_selector(".mk-view canvas")
        page.raw.wait_for_timeout(2000)
        first = page.pixels(".mk-view canvas")
        page.raw.wait_for_timeout(900)
        assert lab.changed(first, page.pixels(".mk-view canvas")) > 0.003
    assert len(mk.load(tmp_path / "result3.bvh")) == len(mk.load(tmp_path / names[3]))
