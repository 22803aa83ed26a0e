"""Drives a real JupyterLab in headless Chromium, for tests of notebooks and widgets.

    with Lab(folder) as lab, lab.open("tour.ipynb") as page:
        page.run_all()
        page.shot("tour.png")

Needs chromium on the path and the Python packages jupyterlab and playwright; `missing()` says what is not there.
"""

from __future__ import annotations

import importlib.util
import json
import os
import secrets
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# SwiftShader draws WebGL without a graphics card; the rest keeps Chromium from calling home.
ARGUMENTS = (
    "--no-sandbox --disable-quic --no-first-run --disable-background-networking --disable-component-update "
    "--disable-sync --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist"
).split()


def missing() -> str:
    """What a browser test needs and does not find, or an empty text."""
    lacking = [n for n in ("jupyterlab", "playwright", "anywidget") if importlib.util.find_spec(n) is None]
    if shutil.which("chromium") is None:
        lacking.append("chromium (on the path)")
    return f"no {', '.join(lacking)}" if lacking else ""


@contextmanager
def browser() -> Iterator[object]:
    """A headless Chromium as Playwright's Browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        try:
            yield found
        finally:
            found.close()


def changed(before: object, after: object) -> float:
    """Share of pixels that differ by more than a shade."""
    return float((abs(before - after).max(axis=-1) > 12).mean())


def write_notebook(path: Path, *cells: str) -> Path:
    """Writes a notebook of code cells, not run."""
    import nbformat.v4 as v4

    book = v4.new_notebook(cells=[v4.new_code_cell(source) for source in cells])
    book.metadata.kernelspec = {"name": "python3", "display_name": "Python 3", "language": "python"}
    path.write_text(json.dumps(book), encoding="utf-8")
    return path


class Lab:
    """A JupyterLab server of its own for a folder, with settings that no other server sees. dark: its theme."""

    def __init__(self, folder: Path, *, dark: bool = False) -> None:
        self.folder, self.dark = Path(folder), dark
        self.token = secrets.token_hex(8)
        with socket.socket() as s:
            s.bind(("127.0.0.1", 0))
            self.port = s.getsockname()[1]

    def __enter__(self) -> Lab:
        private = self.folder / ".lab"
        settings = private / "settings" / "@jupyterlab"
        for name, values in {
            "apputils-extension/themes": {"theme": "JupyterLab Dark" if self.dark else "JupyterLab Light"},
            "apputils-extension/notification": {"fetchNews": "false", "checkForUpdates": False},
            "notebook-extension/tracker": {"windowingMode": "none"},  # else cells off the screen are not there
        }.items():
            path = settings / f"{name}.jupyterlab-settings"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(values), encoding="utf-8")
        places = {
            "JUPYTERLAB_SETTINGS_DIR": private / "settings",
            "JUPYTERLAB_WORKSPACES_DIR": private / "workspaces",
            "JUPYTER_CONFIG_DIR": private / "config",
            "JUPYTER_RUNTIME_DIR": private / "runtime",
            "JUPYTER_DATA_DIR": private / "data",
            "IPYTHONDIR": private / "ipython",
        }
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
        environment = {**os.environ, **{k: str(v) for k, v in places.items()}, "PYTHONPATH": path}
        self.log = (private / "server.log").open("w")
        command = [
            *(
                sys.executable,
                "-m",
                "jupyterlab",
                "--no-browser",
                "--allow-root",
                "--ip=127.0.0.1",
                f"--port={self.port}",
            ),
            *(f"--IdentityProvider.token={self.token}", f"--ServerApp.root_dir={self.folder}"),
        ]
        self.server = subprocess.Popen(command, stdout=self.log, stderr=self.log, env=environment)
        self._wait()
        return self

    def _wait(self) -> None:
        for _ in range(120):
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api?token={self.token}").close()
                return
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.5)
        raise RuntimeError(f"JupyterLab did not start; see {self.log.name}")

    def __exit__(self, *_: object) -> None:
        self.server.terminate()
        try:
            self.server.wait(20)
        except subprocess.TimeoutExpired:
            self.server.kill()
            self.server.wait(10)
        self.log.close()

    @contextmanager
    def open(self, notebook: str, chromium: object = None, *, width: int = 1200, height: int = 1000) -> Iterator[Page]:
        """The notebook's page, nothing run. chromium: a `browser()` that is open already, as there can be only one."""
        with nullcontext(chromium) if chromium else browser() as found:
            raw = found.new_page(viewport={"width": width, "height": height})
            page = Page(raw)
            address = f"http://127.0.0.1:{self.port}/lab/tree/{notebook}?token={self.token}&reset"
            raw.goto(address)
            if not page.ready(45):  # a kernel whose first answer got lost stays "connecting": a person reloads
                raw.goto(address)
                if not page.ready(90):
                    raise RuntimeError(f"{notebook}: no kernel got ready; see {self.log.name}; {page.errors[-5:]}")
            raw.wait_for_timeout(1000)
            yield page
            raw.close()


class Page:
    """A notebook in JupyterLab. `raw` is Playwright's page; `errors` what the browser's console complained of."""

    def __init__(self, raw: object) -> None:
        self.raw, self.errors = raw, []
        raw.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        raw.on("pageerror", lambda e: self.errors.append(str(e)))

    def ready(self, seconds: float) -> bool:
        """Waits until the cells are there and the kernel is idle; whether that happened in time."""
        from playwright.sync_api import TimeoutError

        try:
            self.raw.wait_for_selector(".jp-Notebook .jp-Cell", timeout=90000)
            self.raw.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status='idle']", timeout=1000 * seconds)
        except TimeoutError:
            return False
        return True

    def menu(self, *names: str) -> None:
        """Clicks through the menu bar, such as menu("Run", "Run All Cells")."""
        for name in names:
            self.raw.get_by_role("menuitem", name=name, exact=True).click()

    def run_all(self, seconds: float = 120) -> None:
        """Runs all cells and waits until they are done; RuntimeError names a cell's error or the time-out."""
        for _ in range(3):  # JupyterLab now and then loses the command: no cell as much as waits, on an idle kernel
            self.menu("Run", "Run All Cells")
            if self._began():
                break
        self.wait_done(seconds)

    def _began(self, seconds: float = 10) -> bool:
        """Whether some cell waits, or has run, before so many seconds are over."""
        end = time.time() + seconds
        while time.time() < end:
            self.raw.wait_for_timeout(200)
            if any(self._prompts()):
                return True
        return False

    def wait_done(self, seconds: float = 120) -> None:
        """Waits until every code cell that is not empty has a number; a cell's error ends the wait at once."""
        end = time.time() + seconds
        while time.time() < end:
            self.raw.wait_for_timeout(400)
            failed = self.raw.locator(".jp-OutputArea-output[data-mime-type='application/vnd.jupyter.error']")
            if failed.count():
                raise RuntimeError(failed.first.inner_text()[-3000:])
            prompts = self._prompts()
            if prompts and all(p.isdigit() for p in prompts):
                return
        raise RuntimeError(
            f"the notebook was not done after {seconds} s; kernel {self._kernel()}, cells "
            f"{' '.join(p or '-' for p in self._prompts())}; the browser said: {self.errors[-5:]}"
        )

    def _prompts(self) -> list[str]:
        """What stands beside each code cell: a number once it has run, `*` while it waits, nothing before."""
        return [p.strip("[]: \n") for p in self.raw.locator(".jp-CodeCell .jp-InputPrompt").all_inner_texts()]

    def _kernel(self) -> str:
        """The kernel's state as JupyterLab shows it: connecting, idle, busy, dead, ..."""
        return self.raw.locator(".jp-Notebook-ExecutionIndicator").first.get_attribute("data-status") or "unknown"

    def run_cell(self, number: int, seconds: float = 60) -> None:
        """Runs one code cell again, counted from 0, and waits for its new number."""
        cell = self.raw.locator(".jp-CodeCell").nth(number)
        before = cell.locator(".jp-InputPrompt").inner_text()
        cell.locator(".jp-InputPrompt").click()
        self.raw.keyboard.press("Control+Enter")
        end = time.time() + seconds
        while time.time() < end:
            self.raw.wait_for_timeout(200)
            now = cell.locator(".jp-InputPrompt").inner_text()
            if now != before and now.strip("[]: \n").isdigit():
                return
        raise RuntimeError(f"cell {number} was not done after {seconds} s")

    def save(self) -> None:
        """Saves the notebook's file."""
        self.raw.keyboard.press("Control+s")
        self.raw.wait_for_timeout(2500)

    def shot(self, path: str | Path, selector: str | None = None) -> bytes:
        """A screenshot of the page, or of the first thing the selector finds, into a PNG file; returns its bytes."""
        target = self.raw.locator(selector).first if selector else self.raw
        return target.screenshot(path=str(path))

    def pixels(self, selector: str) -> object:
        """What the first thing the selector finds looks like, as an array [H, W, 3] of 0 to 255."""
        import io

        import numpy as np
        from PIL import Image

        # Not the element's own screenshot: that waits for it to stand still.
        spot = self.raw.locator(selector).first
        spot.scroll_into_view_if_needed()
        with Image.open(io.BytesIO(self.raw.screenshot(clip=spot.bounding_box()))) as image:
            return np.asarray(image.convert("RGB")).astype(int)
