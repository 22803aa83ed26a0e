"""The project's own files agree with one another and keep the house rules."""

import ast
import importlib
import pkgutil
import re
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

import motionkit
from check_notebooks import MACHINE_PATH
from make_venv import NEWEST, OLDEST

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10; pytest brings this one there
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = [f"3.{minor}" for minor in range(OLDEST[1], NEWEST[1] + 1)]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
EXTRAS = PROJECT["optional-dependencies"]
CONSTRAINTS = (ROOT / "constraints.txt").read_text()
PINS = [Requirement(line) for line in CONSTRAINTS.splitlines() if not line.startswith("#")]
CODE = [path for folder in ("motionkit", "tools", "tests") for path in sorted((ROOT / folder).rglob("*.py"))]
MODULES = [found.name for found in pkgutil.walk_packages(motionkit.__path__, "motionkit.")]


def pins_on(python: str) -> dict[str, str]:
    """Name to version, as the constraints say for Linux and this Python."""
    machine = {"python_version": python, "python_full_version": f"{python}.9", "sys_platform": "linux"}
    pins: dict[str, str] = {}
    for pin in PINS:
        if pin.marker is None or pin.marker.evaluate(machine):
            assert canonicalize_name(pin.name) not in pins, f"{pin.name} is pinned twice on Python {python}"
            pins[canonicalize_name(pin.name)] = str(pin.specifier)
    return pins


def test_every_pin_is_exact():
    assert len(PINS) > 100
    assert [str(pin) for pin in PINS if not re.fullmatch(r"==[0-9][^*,]*", str(pin.specifier))] == []
    assert {str(pin.specifier) for pin in PINS if pin.name == "torch"} == {"==2.13.0"}


@pytest.mark.parametrize("python", PYTHONS)
def test_every_dependency_is_pinned_within_its_range(python):
    pins = pins_on(python)
    for line in [*PROJECT["dependencies"], *EXTRAS["lab"], *EXTRAS["test"]]:
        wanted = Requirement(line)
        if wanted.name != "motionkit":
            assert pins[canonicalize_name(wanted.name)].removeprefix("==") in wanted.specifier, line


def test_python_ranges_agree():
    supported = SpecifierSet(PROJECT["requires-python"])
    assert [f"3.{minor}" for minor in range(30) if f"3.{minor}.9" in supported] == PYTHONS
    assert f"Python {PYTHONS[0]} to {PYTHONS[-1]}" in (ROOT / "Makefile").read_text()
    assert f"Python {PYTHONS[0]} to {PYTHONS[-1]}" in CONSTRAINTS
    assert PYPROJECT["tool"]["ruff"]["target-version"] == "py" + PYTHONS[0].replace(".", "")


def test_conda_installs_the_same():
    environment = yaml.safe_load((ROOT / "environment.yml").read_text())
    assert environment["name"] == PROJECT["name"]
    python = next(d for d in environment["dependencies"] if isinstance(d, str) and d.startswith("python="))
    assert python.removeprefix("python=") in PYTHONS
    pip = next(d["pip"] for d in environment["dependencies"] if isinstance(d, dict))
    assert pip == ["-c constraints.txt", "-e .[lab,test]"]
    asked = re.search(r"\.\[(.*)\]", pip[1])[1]
    assert set(asked.split(",")) <= set(EXTRAS)
    assert f'".[{asked}]"' in (ROOT / "tools" / "make_venv.py").read_text()


def test_readme_names_commands_that_exist():
    readme = (ROOT / "README.md").read_text()
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    named = re.findall(r"(?:^ *|`)make ([a-z-]+)", readme, re.MULTILINE)
    assert {"lab", "test", "tour"} <= set(named) <= set(targets)
    assert "conda env create -f environment.yml" in readme
    assert f"conda activate {PROJECT['name']}" in readme


@pytest.mark.parametrize("name", MODULES)
def test_every_module_imports(name):
    importlib.import_module(name)


def test_documents_name_no_path_of_one_machine():
    documents = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "notebooks").rglob("*.md")]
    assert [path.name for path in documents if MACHINE_PATH.search(path.read_text())] == []


@pytest.mark.slow
def test_functions_stay_short():
    long_functions = [
        f"{path.name}: {node.name}, {node.end_lineno - node.lineno + 1} lines"
        for path in CODE
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno - node.lineno >= 60
    ]
    assert long_functions == []
