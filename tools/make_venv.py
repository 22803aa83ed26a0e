"""Make a virtual environment and install motionkit into it with the pinned versions.

    python3 tools/make_venv.py .venv [EXTRA_INDEX_URL]

The first thing that runs on a bare machine: standard library only, and old Pythons can read it too.
"""

import importlib.util
import subprocess
import sys
from pathlib import Path

OLDEST, NEWEST = (3, 10), (3, 13)
ROOT = Path(__file__).resolve().parent.parent
NEWS = "@jupyterlab/apputils-extension:announcements"  # asks a question on JupyterLab's first start


def dotted(version):
    """(3, 10) as 3.10."""
    return ".".join(map(str, version))


def check_this_python():
    """Stop with one clear sentence where this Python cannot carry motionkit."""
    found = sys.version_info[:2]
    if not OLDEST <= found <= NEWEST:
        sys.exit(
            f"motionkit needs Python {dotted(OLDEST)} to {dotted(NEWEST)}, and {sys.executable} is "
            f"{dotted(found)}. Name another one, for example: make lab PYTHON=python3.12"
        )
    if not all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")):
        sys.exit(
            "This Python cannot make virtual environments. On Debian or Ubuntu, install that part first: "
            "sudo apt install python3-venv"
        )


def usable(python):
    """Whether a virtual environment's Python starts, has pip and is of a version that motionkit supports."""
    test = f"import pip, sys; sys.exit(not {OLDEST} <= sys.version_info[:2] <= {NEWEST})"
    return python.exists() and subprocess.run([str(python), "-c", test], capture_output=True).returncode == 0


def install(python, extra_index):
    """Install motionkit, editable, with the tools for the lab and the tests, at the pinned versions."""
    command = [str(python), "-m", "pip", "install", "-qq", "--disable-pip-version-check"]
    command += ["-c", "constraints.txt", "-e", ".[lab,test]"]
    command += ["--extra-index-url", extra_index] if extra_index else []
    if subprocess.run(command, cwd=ROOT).returncode:
        sys.exit("Installing failed; pip says why above. The same command starts over once that is mended.")
    labextension = [str(python), "-m", "jupyter", "labextension", "disable", "--level=sys_prefix", NEWS]
    subprocess.run(labextension, cwd=ROOT, capture_output=True)  # a courtesy: the lab works without it


def main(folder, extra_index=""):
    """Make FOLDER a virtual environment unless it is one, then install."""
    python = ROOT / folder / "bin" / "python"
    fresh = not usable(python)
    if fresh:
        check_this_python()
    print(f"Installing motionkit into {folder}; the first time takes some minutes.", flush=True)
    if fresh:
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(ROOT / folder)], check=True)
    install(python, extra_index)
    print("Installed.", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
