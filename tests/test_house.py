"""The house rules: seven principles of how motionkit is laid out, each held here, each shown to catch a violation.

What the house still owes stands in DEBTS, by rule; a debt that is paid must be taken off the list, a new one fails.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import motionkit as mk
from motionkit.methods import StyleTransfer

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "motionkit"
FILES = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}

# Lines that a folder may have, docstrings and blanks counted; five methods and all baselines are to fit.
BUDGETS = {
    "actor": 3300,
    "arena": 1170,
    "benchmarks": 1400,
    "datasets": 2400,
    "features": 1030,
    "layers": 500,
    "lessons": 2800,
    "methods": 6900,
    "text": 1010,
    "viewer": 1800,
    ".": 6500,
}
WHOLE = 26_000  # benchmarks apart
PAPERS = ("few_shot", "text_to_motion", "style_erd", "style_erd_network")  # one file a paper
PAPER_LINES = 600
PERFORMER = (  # who may import the performer
    "motionkit/actor/",
    "motionkit/datasets/performed.py",
    "motionkit/arena/transfers.py",
    "motionkit/methods/style_code.py",
    "motionkit/methods/style_code_training.py",
    "motionkit/lessons/",
    "motionkit/benchmarks/",
    "motionkit/__main__.py",
)
REFUSED = {  # words that no book, framework or paper uses; what to say stands in the docstring of `refused`
    "body_frames", "BodyFrames", "body_of", "blended", "chain_of", "doubted", "entrants", "fanning", "FastErd",
    "fitting", "frames_of_body", "guided", "hears_style", "invented", "kept_runs", "Labeller", "like_paper", "loss_of",
    "louder", "misread", "named", "on_body", "on_the_ground", "pieces_of", "Pieces", "placed", "put_back", "QuickBody",
    "rebuilding_loss", "Remembered", "retold", "run_up", "step_like", "StyleSpace", "teach", "truths", "unroll",
    "windowed", "within", "yawed",
}  # fmt: skip
DEBTS = {
    "whole": True,
    "budget": {".", "arena", "benchmarks", "datasets", "features", "lessons", "text"},
    "parameters": {
        "motionkit/actor/performing.py: perform",
        "motionkit/actor/performing.py: perform_creature",
        "motionkit/actor/pose.py: _creature_legs",
        "motionkit/actor/pose.py: _legs",
        "motionkit/arena/running.py: run",
        "motionkit/lessons/judging.py: feature_map",
        "motionkit/sampling.py: ddim",
        "motionkit/viewer/player.py: __init__",
    },
}


def lines(text: str) -> int:
    return len(text.splitlines())


def folder_of(path: str) -> str:
    parts = path.split("/")[1:]
    return parts[0] if len(parts) > 1 else "."


def functions(text: str) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    return (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


# 1 and 7: budgets by folder, a paper in one file, no small files


def over_budget(files: dict[str, str]) -> set[str]:
    sizes: dict[str, int] = {}
    for path, text in files.items():
        sizes[folder_of(path)] = sizes.get(folder_of(path), 0) + lines(text)
    return {folder for folder, size in sizes.items() if size > BUDGETS[folder]}


def test_folders_keep_their_budgets():
    assert over_budget(FILES) == DEBTS["budget"]
    assert over_budget({"motionkit/layers/a.py": "x = 1\n" * 501}) == {"layers"}


def too_large(files: dict[str, str]) -> bool:
    return sum(lines(text) for path, text in files.items() if folder_of(path) != "benchmarks") > WHOLE


def test_the_whole_package_fits():
    assert too_large(FILES) == DEBTS["whole"]
    assert too_large({"motionkit/a.py": "x = 1\n" * (WHOLE + 1)}) and not too_large({"motionkit/a.py": "x = 1\n"})


def too_long(files: dict[str, str]) -> set[str]:
    return {name for name in PAPERS if lines(files[f"motionkit/methods/{name}.py"]) > PAPER_LINES}


def test_a_paper_is_one_file():
    assert too_long(FILES) == set()
    assert too_long(FILES | {"motionkit/methods/few_shot.py": "x = 1\n" * 601}) == {"few_shot"}


def small(files: dict[str, str]) -> list[str]:
    return [path for path, text in files.items() if lines(text) < 50 and not path.endswith("__init__.py")]


def test_no_file_is_too_small_for_a_room_of_its_own():
    assert small(FILES) == []
    assert small({"motionkit/a.py": "x = 1\n"}) == ["motionkit/a.py"]


# 2: a method writes one function


def rewritten(method: type) -> set[str]:
    """Parts of the bracket that a method writes again, and `transfer` where it does not write it."""
    bracket = {"stylize", "onto_model", "bring_back"}
    same = {name for name in bracket if getattr(method, name) is getattr(StyleTransfer, name)}
    return bracket - same | ({"transfer"} if method.transfer is StyleTransfer.transfer else set())


def test_a_method_writes_transfer_and_the_bracket_is_written_once():
    for name in mk.methods.names():
        method = type(mk.methods.load(name))
        assert issubclass(method, StyleTransfer) and method.name == name and rewritten(method) == set()

    class Own(StyleTransfer):
        def stylize(self, content, style):
            return content

    assert rewritten(Own) == {"stylize", "transfer"}


# 3: one batch, one loop: nobody else moves tensors to a device


def moving(files: dict[str, str]) -> set[str]:
    pattern = re.compile(r"\.to\((?:device|here|self\.device|device_of)|\.cuda\(|device_of\(")
    return {path for path, text in files.items() if pattern.search(text)}


def test_only_the_loop_moves_batches():
    assert moving({path: text for path, text in FILES.items() if path != "motionkit/training.py"}) == set()
    assert moving({"a.py": "x = x.to(device)"}) == {"a.py"}


# 4: one Checkpoint


def test_weights_are_written_in_one_place():
    writers = {path for path, text in FILES.items() if "safetensors.torch import save" in text}
    allowed = ("checkpoints", "training", "arena/transfers", "features/layout", "text/encoders")
    assert {path for path in writers if not path.removeprefix("motionkit/").startswith(allowed)} == set()
    own = {
        f"{path}: {node.name}"
        for path, text in FILES.items()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ClassDef)
        and any(ast.unparse(base).endswith("Checkpoint") for base in node.bases)
        and {"save", "load"} & {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
    }
    assert own == set()


# 5 and 6: who imports whom


def imports(path: str, text: str) -> set[str]:
    """The modules and names that a file imports, anywhere in it, as dotted paths."""
    parts = path.removesuffix(".py").split("/")
    here = parts[:-1]
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return {name for name in found if name.startswith("motionkit")}


def reaches(files: dict[str, str], package: str, allowed: tuple[str, ...]) -> set[str]:
    """Files outside `allowed` that import the package."""
    return {
        path
        for path, text in files.items()
        if not path.startswith(allowed)
        and any(name == package or name.startswith(f"{package}.") for name in imports(path, text))
    }


def test_nothing_imports_the_outer_rings():
    assert reaches(FILES, "motionkit.lessons", ("motionkit/lessons/",)) == set()
    assert reaches(FILES, "motionkit.benchmarks", ("motionkit/benchmarks/",)) == set()
    assert reaches({"motionkit/a.py": "from .lessons import data"}, "motionkit.lessons", ("x",)) == {"motionkit/a.py"}


def test_the_performer_is_imported_where_it_may_be():
    assert reaches(FILES, "motionkit.actor", PERFORMER) == set()
    hidden = {"motionkit/methods/a.py": "def f():\n    from ..actor.style import get_style"}
    assert reaches(hidden, "motionkit.actor", PERFORMER) == set(hidden)


def circles(files: dict[str, str]) -> list[set[str]]:
    """Groups of modules that import one another, functions counted."""
    modules = {path.removesuffix(".py").removesuffix("/__init__").replace("/", "."): path for path in files}
    graph = {}
    for module, path in modules.items():
        names = imports(path, files[path])
        graph[module] = {n if n in modules else n.rpartition(".")[0] for n in names} & set(modules) - {module}
    numbers, lowest, stack, groups = {}, {}, [], []

    def visit(module: str) -> None:
        numbers[module] = lowest[module] = len(numbers)
        stack.append(module)
        for other in graph[module]:
            if other not in numbers:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in stack:
                lowest[module] = min(lowest[module], numbers[other])
        if lowest[module] == numbers[module]:
            group = set(stack[stack.index(module) :])
            del stack[stack.index(module) :]
            groups.append(group)

    for module in graph:
        if module not in numbers:
            visit(module)
    return [group for group in groups if len(group) > 1]


def test_no_module_imports_itself_by_a_detour():
    assert circles(FILES) == []
    two = {"motionkit/a.py": "from . import b", "motionkit/b.py": "def f():\n    from .a import g"}
    assert circles(two) == [{"motionkit.a", "motionkit.b"}]


# 7: signatures and names


def crowded(files: dict[str, str]) -> set[str]:
    found = set()
    for path, text in files.items():
        for node in functions(text):
            given = node.args
            names = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
            count = len([name for name in names if name not in ("self", "cls")]) + bool(given.vararg)
            found |= {f"{path}: {node.name}"} if count + bool(given.kwarg) > 7 else set()
    return found


def test_functions_have_seven_parameters_at_most():
    assert crowded(FILES) == DEBTS["parameters"]
    assert crowded({"a.py": "def f(a, b, c, d, e, *, f, g, h): ..."}) == {"a.py: f"}


def loose_booleans(files: dict[str, str]) -> set[str]:
    """Booleans of public functions that may be given by position."""
    found = set()
    for path, text in files.items():
        for node in functions(text):
            given = (*node.args.posonlyargs, *node.args.args)
            defaults = [None] * (len(given) - len(node.args.defaults)) + list(node.args.defaults)
            for parameter, default in zip(given, defaults):
                flag = isinstance(default, ast.Constant) and isinstance(default.value, bool)
                typed = parameter.annotation is not None and ast.unparse(parameter.annotation) == "bool"
                torchs = node.name == "train" and parameter.arg == "mode"  # torch's own signature
                if (flag or typed) and not node.name.startswith("_") and not torchs:
                    found.add(f"{path}: {node.name}({parameter.arg})")
    return found


def test_booleans_are_given_by_name():
    assert loose_booleans(FILES) == set()
    assert loose_booleans({"a.py": "def f(x, fast=True): ..."}) == {"a.py: f(fast)"}


def refused(files: dict[str, str]) -> set[str]:
    """Definitions whose names are refused: instead, the word of the paper or of torch's documentation."""
    found = set()
    for path, text in files.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name in REFUSED:
                found.add(f"{path}: {node.name}")
            elif isinstance(node, ast.arg) and node.arg in REFUSED:
                found.add(f"{path}: {node.arg}")
    return found


def test_names_can_be_looked_up():
    assert refused(FILES) == set()
    assert refused({"a.py": "def teach(): ..."}) == {"a.py: teach"}
    assert set(DEBTS) == {"whole", "budget", "parameters"}


def nameless_equations(text: str) -> set[str]:
    """Docstrings that name an equation and no paper."""
    nodes = (*(n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef | ast.ClassDef)), ast.parse(text))
    docs = {ast.get_docstring(node) or "" for node in nodes}
    return {
        doc for doc in docs if re.search(r"\beqs?\. \d", doc) and not re.search(r"paper \d|\d{4}", doc, re.IGNORECASE)
    }


def test_every_equation_of_a_paper_says_which():
    for path, text in FILES.items():
        assert nameless_equations(text) == set(), path
    assert nameless_equations('def f():\n    "The loss (eq. 3)."') == {"The loss (eq. 3)."}
