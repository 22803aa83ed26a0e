"""Execute notebooks in place, so that what is committed is what a fresh run shows.

    python tools/run_notebooks.py [NOTEBOOK ...]        (all of notebooks/ when none is named)

The same notebook gives the same file again: no timestamps, widget state, random ids or memory addresses. A
notebook that fails, complains on stderr or breaks a budget is not replaced; its run is left in out/.
"""

import os
import re
import sys
import time
import uuid
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from check_notebooks import ROOT, find_notebooks, problems, time_budget

WIDGET_VIEW = "application/vnd.jupyter.widget-view+json"
RANDOM_ID = re.compile(r"\b[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}\b")
ADDRESS = re.compile(r"\bat 0x[0-9a-f]{6,}")
METADATA = {
    "kernelspec": {"display_name": "Python 3 (ipykernel)", "language": "python", "name": "python3"},
    "language_info": {"file_extension": ".py", "name": "python", "pygments_lexer": "ipython3"},
}


def execute(path: Path) -> tuple[nbformat.NotebookNode, str]:
    """Run a notebook from top to bottom in a fresh kernel, in its folder; return the run and its error."""
    notebook = nbformat.read(path, as_version=4)
    os.environ["PYTHONHASHSEED"] = "0"  # sets print in the same order each time
    client = NotebookClient(
        notebook,
        timeout=2 * time_budget(path),
        kernel_name="python3",
        resources={"metadata": {"path": str(path.parent)}},
        record_timing=False,
        extra_arguments=["--IPKernelApp.log_level=ERROR"],
    )
    try:
        client.execute()
    except CellExecutionError as error:
        return notebook, f"a cell failed: {error.ename}: {error.evalue}"
    return notebook, ""


def tidy(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Take out of an executed notebook all that changes from run to run or tells of this machine."""
    notebook.metadata = nbformat.from_dict(METADATA)  # and with the old one goes the widgets' state
    seen: dict[str, str] = {}
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({k: v for k, v in cell.metadata.items() if k == "tags"})
        if cell.cell_type == "code":
            cell.outputs = [out for out in cell.outputs if still_picture(out)]
            for output in cell.outputs:
                clean_texts(output, seen)
    return notebook


def still_picture(output: nbformat.NotebookNode) -> bool:
    """Leave what a page without a kernel shows of a live widget; False for a progress bar: nothing."""
    data = output.get("data", {})
    if data.pop(WIDGET_VIEW, None) and set(data) <= {"text/plain"}:
        if "/s]" in data.get("text/plain", ""):
            return False
        data["text/plain"] = "(a live widget: run this cell to use it)"
    return True


def clean_texts(output: nbformat.NotebookNode, seen: dict[str, str]) -> None:
    """Give random ids a fixed name and cut this machine's folders and addresses from an output's texts."""

    def fixed(match: re.Match) -> str:
        return seen.setdefault(match[0], str(uuid.uuid5(uuid.NAMESPACE_OID, str(len(seen)))))

    texts = output.get("data", {}) if "data" in output else output
    for kind in ("text", "text/plain", "text/html", "application/javascript"):
        if isinstance(texts.get(kind), str):
            text = RANDOM_ID.sub(fixed, texts[kind]).replace(f"{ROOT}{os.sep}", "")
            texts[kind] = ADDRESS.sub("at 0x...", text)


def run_in_place(path: Path) -> list[str]:
    """Execute, tidy and check a notebook; replace it when it is sound, else keep the run in out/."""
    start = time.monotonic()
    notebook, error = execute(path)
    seconds, budget = time.monotonic() - start, time_budget(path)
    print(f"{path.name}: {seconds:.0f} s of {budget} s", flush=True)
    fresh = path.with_name(f".{path.name}.new")
    fresh.write_text(nbformat.writes(tidy(notebook)) + "\n", encoding="utf-8")
    faults = ([error] if error else []) + problems(fresh)
    if seconds > budget:
        faults.append(f"took {seconds:.0f} s, budget {budget} s")
    if faults:
        (ROOT / "out").mkdir(exist_ok=True)
        os.replace(fresh, ROOT / "out" / f"failed-{path.name}")
    else:
        os.replace(fresh, path)
    return faults


def main(names: list[str]) -> int:
    """Execute the named notebooks (or all) in place; 1 when any was not fit to keep."""
    paths = [Path(name).resolve() for name in names] or find_notebooks()
    faults = [f"{path.name}: {what}" for path in paths for what in run_in_place(path)]
    print("\n".join(faults) or f"{len(paths)} notebooks executed")
    if faults:
        print("Not replaced; these runs are in out/failed-*.ipynb")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
