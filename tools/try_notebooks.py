"""Run notebooks as tests: each in a process of its own, top to bottom, as a student's Run All does.

    python tools/try_notebooks.py [NOTEBOOK ...]        (all of notebooks/ when none is named)

Any cell that raises fails; cells marked `# NBVAL_CHECK_OUTPUT` must print again what is saved. The budgets
of memory and time hold too; a busy laptop may be slow, so a time over the budget is said, and fails only in CI
(where the variable `CI` is set).
"""

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

from check_notebooks import MAX_KERNEL_BYTES, ROOT, find_notebooks, time_budget

TO_BYTES = 1 if sys.platform == "darwin" else 1024  # the unit of ru_maxrss


def largest_child() -> int:
    """Bytes of memory that the largest process started from here (a kernel) has held so far."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * TO_BYTES


def run_one(path: Path) -> list[str]:
    """Run one notebook under nbval, print a line about it, and return what went wrong."""
    budget = time_budget(path)
    before, start = largest_child(), time.monotonic()
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--nbval-lax", "--nbval-current-env"]
    limit = 2 * budget if os.environ.get("CI") else 20 * budget  # seconds after which it hangs
    command += [f"--nbval-cell-timeout={limit}", "-p", "no:cacheprovider", "--no-header", str(path)]
    try:
        result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit + 30)
        failed, log = result.returncode != 0, result.stdout + result.stderr
    except subprocess.TimeoutExpired:
        failed, log = True, f"still running after {limit + 30} s; stopped"
    seconds, held = time.monotonic() - start, largest_child()
    slow = seconds > budget
    print(f"{path.name}: {seconds:.0f} s of {budget} s{' (more than it should)' if slow else ''}", end="", flush=True)
    print(f", {held / 1e9:.1f} GB at most so far" if not failed else f": FAILED\n{log}", flush=True)
    faults = ["a cell failed"] if failed else []
    if slow and os.environ.get("CI"):
        faults.append(f"took {seconds:.0f} s, budget {budget} s")
    if held > max(before, MAX_KERNEL_BYTES):
        faults.append(f"held {held / 1e9:.1f} GB, budget {MAX_KERNEL_BYTES / 1e9:.0f} GB")
    return faults


def main(names: list[str]) -> int:
    """Run the named notebooks (or all); 1 when any went wrong."""
    paths = [Path(name).resolve() for name in names] or find_notebooks()
    faults = [f"{path.name}: {what}" for path in paths for what in run_one(path)]
    print("\n".join(faults) or f"{len(paths)} notebooks ran")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
