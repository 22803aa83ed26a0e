"""Run the tour without a browser: its result as BVH and the whole page as HTML, both in out/.

python tools/tour.py
"""

import base64
import io
import re
import sys
import time

from matplotlib import mathtext
from nbconvert import HTMLExporter
from nbformat import NotebookNode
from plotly.io import to_html

from run_notebooks import ROOT, execute, tidy

PLOTLY = "application/vnd.plotly.v1+json"
FORMULA = re.compile(r"\$\$(.+?)\$\$|(?<![\\$])\$([^$\n]+)\$", re.DOTALL)
# what mathtext, which draws the formulas, writes in another way than LaTeX
SPELLING = {r"\,": " ", "\n": " ", r"\tfrac": r"\frac"}


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


def draw_formulas(notebook: NotebookNode) -> None:
    """Turn formulas in the text into pictures, since the page cannot fetch a library that sets them."""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = FORMULA.sub(lambda m: formula_picture(m[1] or m[2], bool(m[1])), cell.source)


def formula_picture(formula: str, display: bool) -> str:
    """A formula as an SVG image of its own; inline, it stands on the line of the text."""
    for latex, plain in SPELLING.items():
        formula = formula.replace(latex, plain)
    svg = io.BytesIO()
    depth = mathtext.math_to_image(f"${formula.strip()}$", svg, format="svg", color="#212121")
    source = base64.b64encode(svg.getvalue()).decode()
    place = "display: block; margin: 0.6em auto; height: 3.2em" if display else f"vertical-align: {-depth:.1f}pt"
    return f'<img alt="formula" style="{place}" src="data:image/svg+xml;base64,{source}">'


def main() -> int:
    """Run notebooks/00_tour.ipynb, write out/tour.html, and say which BVH the run left in out/."""
    out, start = ROOT / "out", time.time()
    out.mkdir(exist_ok=True)
    notebook, error = execute(ROOT / "notebooks" / "00_tour.ipynb")
    embed_figures(tidy(notebook))
    draw_formulas(notebook)
    exporter = HTMLExporter(embed_images=True, mathjax_url="", require_js_url="")
    about = {"name": "motionkit: the tour", "path": str(ROOT / "notebooks")}
    page, _ = exporter.from_notebook_node(notebook, {"metadata": about})
    page = re.sub(r'<script\b[^>]*\bsrc="(https?:)?//[^"]*"[^>]*>\s*</script>', "", page)
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
