"""Run the tour without a browser: its result as BVH and the whole page as HTML, both in out/.

    python tools/tour.py
"""

import sys
import time

from nbconvert import HTMLExporter
from nbformat import NotebookNode
from plotly.io import to_html

from run_notebooks import ROOT, execute, tidy

PLOTLY = "application/vnd.plotly.v1+json"


def embed_figures(notebook: NotebookNode) -> None:
    """Turn moving figures into HTML, the first one with plotly in it, so that the page needs no network."""
    outputs = [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs]
    figures = [out.data for out in outputs if PLOTLY in out.get("data", {})]
    for number, data in enumerate(figures):
        figure, first = dict(data.pop(PLOTLY)), number == 0
        config = figure.pop("config", None)
        data["text/html"] = to_html(
            figure, config, auto_play=False, include_plotlyjs=first, full_html=False, validate=False
        )


def main() -> int:
    """Run notebooks/00_tour.ipynb, write out/tour.html, and say which BVH the run left in out/."""
    out, start = ROOT / "out", time.time()
    out.mkdir(exist_ok=True)
    notebook, error = execute(ROOT / "notebooks" / "00_tour.ipynb")
    embed_figures(tidy(notebook))
    page, _ = HTMLExporter().from_notebook_node(notebook, {"metadata": {"name": "motionkit: the tour"}})
    (out / "tour.html").write_text(page, encoding="utf-8")
    print("the page:   out/tour.html")
    if error:
        print(f"The tour stopped: {error}")
        return 1
    written = [path for path in sorted(out.glob("*.bvh")) if path.stat().st_mtime >= start - 1]
    print("the motion:", " ".join(f"out/{path.name}" for path in written) or "none was written to out/")
    return int(not written)


if __name__ == "__main__":
    sys.exit(main())
