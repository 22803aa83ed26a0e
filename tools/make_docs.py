"""Write docs/papers.md, docs/features.md and docs/styles.md from the code; a test holds them to it.

    python tools/make_docs.py

A docstring that names a place in a paper, "(paper 1, section 3.4, eq. 8)", is a row of docs/papers.md.
"""

import importlib
import inspect
import json
import pkgutil
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import motionkit
from make_styles import markdown as styles
from motionkit.features import FacingFree, Graph, HumanML3D, SixD, StyleERD
from motionkit.features.layout import Layout

ROOT = Path(__file__).resolve().parent.parent
OUTER = ("motionkit.lessons", "motionkit.benchmarks", "motionkit.viewer")  # they show what others build
BUILDS = ("motionkit.benchmarks.few_shot",)  # but not this one: the autoencoder of a table, the sweeps of a figure
SECTIONS = {  # of the papers, and the equations, figures and tables in them
    1: {
        "3.2": "eq. 1, eq. 2, eq. 3",
        "3.3": "eq. 4, eq. 5, eq. 6, figure 2a, figure 3",
        "3.4": "eq. 7, eq. 8, eq. 9, eq. 10, eq. 11, eq. 12",
        "3.5": "eq. 13",
        "6.1": "figure 8",
        "6.2": "table 2",
        "6.3": "table 3",
    },
    2: {"3.1": "eq. 1", "3.2": "eq. 2, eq. 3, eq. 4, eq. 5, eq. 6, eq. 7, eq. 8, eq. 9"},
    3: {"7": "table 2"},
    4: {"3.3": "eq. 5"},
}
# notebook and text cell under whose heading is shown what is not called there by its name
SHOWN = {
    "motion.facing_of": "01 cell-63",
    "methods.base.warp_velocity": "00 cell-14",
    "metrics.content_fmd": "04 c035",
    "metrics.style_fmd": "04 c035",
    "judges.Classifier": "04 c019",
    "judges.DenoisingAutoencoder": "04 c035",
    "judges.denoising_loss": "04 c035",
    "diffusion.noise_from_x0": "05 c024",
    "diffusion.x0_from_noise": "05 c017",
    "sampling.guidance": "05 c030",
    "layers.SemanticEncoder": "06 c65",
    "layers.PoseEmbedding": "06 c20",
    "methods.text_to_motion.Prior": "06 c50",
    "methods.text_to_motion.train_prior": "06 c42",
    "methods.text_to_motion.Discriminator": "06 c70",
    "methods.text_to_motion.train_discriminator": "06 c65",
    "sampling.total_loss": "07 c15",
    "methods.few_shot.FewShot.transfer": "07 c21",
    "methods.few_shot.blend": "07 c21",
    "methods.few_shot.finetune": "07 c17",
    "methods.style_code.StyleCodeModel": "07 z3",
    "methods.style_erd_network.StyleErd": "08 m6",
    "methods.style_erd_network.FTAttDiscriminator": "08 m8",
    "methods.style_erd_network.ContentClassifier": "08 m8",
    "methods.style_erd_network.MultiClassDiscriminator": "08 m11",
    "methods.style_erd_network.Sizes.paper": "08 m6",
    "methods.style_erd.ErdModel.style_weights": "08 m18",
    "benchmarks.few_shot.sweep_g": "07 c28",
    "benchmarks.few_shot.sweep_k": "07 c28",
    "benchmarks.few_shot.with_autoencoder": "07 c28",
    "methods.style_erd_stream.ErdStream": "08 longer-words",
}
PAPERS = """# Papers, equations, code

Everything of the papers that the kit builds, with its function, a test, and the notebook cells that show it.

| paper | equation or section | function | test | notebook |
| --- | --- | --- | --- | --- |
{rows}

Papers: 1 *Diffusion-based Human Motion Style Transfer with Semantic Guidance* (Hu et al.); 2 *Style-ERD* (Tao et al.);
3 diverse multi-domain motion stylisation with an ST-GCN GAN (Park et al.); 4 *MCM-LDM* (Song et al.); 5 *MotionS*. The
263-number layout (`features.HumanML3D`) is that of Guo et al. 2022.

Made by `make docs` from the docstrings; a test holds it to the code.
"""
LAYOUTS = {FacingFree: "paper 1", StyleERD: "paper 2", Graph: "paper 3", HumanML3D: "paper 4", SixD: "paper 5"}
FEATURES = """# What the numbers mean

Every layout of `mk.features`, number by number, for SMPL's 22 joints. A layout for another skeleton prints its own
table: `layout.table()`, and `layout.describe(n)` for one number. Numbers count from 0; `4-6` are 4, 5 and 6.
Directions seen from the body: x to its left, y up, z ahead. 6D rotations are the first two columns of the matrix,
column 1 first. Speeds are per frame, not per second.

Made by `make docs`; a test holds it to the code.
"""

_NUMBER = r"[A-Z]?[\d.]*[\dA-Za-z]"
_PLACE = rf"(?:(?:below )?(?:sections?|eqs?\.|figures?|tables?) {_NUMBER}(?:(?:, | and | to ){_NUMBER}(?![\w' ]))*"
_PLACE += r"|supplement(?: [A-Z](?:\.\d)?\b)?)"
_PLACES = rf"{_PLACE}(?:(?:, | and ){_PLACE})*"
CITATION = re.compile(rf"(?<!eyond )[Pp]aper (\d)(?:'s [^.;()]*)?(?:, | \()({_PLACES})")


class Row(NamedTuple):
    """A line of docs/papers.md: of a function or class, by its dotted name, what a paper says where."""

    paper: int
    place: str
    about: str
    name: str

    def key(self) -> tuple:
        """Rows stand as the papers are read: sections, then equations, supplements at the end."""
        section = re.search(r"section ([A-Z]?[\d.]+)", self.place)
        numbers = [int(n) for n in section[1].strip(".").split(".") if n.isdigit()] if section else [99]
        supplement = "supplement" in self.place or (section is not None and section[1][0].isalpha())
        equation = re.search(r"eqs?\. (\d+)", self.place)
        return self.paper, supplement, numbers, int(equation[1]) if equation else 0, self.place, self.name


def citations(docstring: str) -> list[tuple[int, str]]:
    """Papers and places that a docstring names, each once, an equation with its section."""
    places = []
    for paper, place in CITATION.findall(_prose(docstring)):
        place = re.sub(r"section (?=[A-Z])", "supplement ", place)
        first = re.match(r"(?:below )?((?:eq|figure|table)s?\.?) (\w+)", place)
        if first:
            kind = first[1].replace("s", "") + " " + first[2]
            sections = SECTIONS.get(int(paper), {}).items()
            place = next((f"section {name}, {place}" for name, kinds in sections if kind in kinds.split(", ")), place)
        places.append((int(paper), place))
    return list(dict.fromkeys(places))


def first_sentence(docstring: str) -> str:
    """What the docstring says first, without the papers that it names, and without its full stop."""
    text = re.sub(
        rf" \((?:[^()]|\([^()]*\))*?[Pp]apers? \d(?:[^()]|\([^()]*\))*\)| \({_PLACES}\)", "", _prose(docstring)
    )
    text = re.sub(rf"[Pp]aper \d, {_PLACES}[,:] ", "", text)
    return re.split(r"\.(?: (?=[A-Z]|[\w, ]+:)|$)", text)[0].replace("|", "\\|")


def _prose(docstring: str) -> str:
    """A docstring up to its example, in one line."""
    return " ".join(docstring.split(">>>")[0].split())


def public_objects() -> Iterator[tuple[str, object]]:
    """Public functions, classes and their members, by their shortest dotted names, outside the outer rings."""
    for module in pkgutil.walk_packages(motionkit.__path__, "motionkit."):
        outer = module.name.startswith(OUTER) and module.name not in BUILDS
        if outer or module.name.rsplit(".", 1)[-1].startswith("_"):
            continue
        imported = importlib.import_module(module.name)
        parent = importlib.import_module(module.name.rpartition(".")[0])
        for name, thing in vars(imported).items():
            if name.startswith("_") or getattr(thing, "__module__", None) != module.name:
                continue
            exported = parent is not motionkit and getattr(parent, name, None) is thing
            dotted = f"{(parent if exported else imported).__name__}.{name}".removeprefix("motionkit.")
            yield dotted, thing
            if inspect.isclass(thing):
                yield from ((f"{dotted}.{member}", part) for member, part in vars(thing).items() if member[0] != "_")


def rows() -> list[Row]:
    """All rows of docs/papers.md; what a network's `forward` says is its class's."""
    listed = {}
    for name, thing in public_objects():
        if inspect.isclass(thing) or inspect.isroutine(thing) or hasattr(thing, "__get__"):
            docstring = inspect.getdoc(thing) or ""
            for paper, place in citations(docstring):
                row = Row(paper, place, first_sentence(docstring), name.removesuffix(".forward"))
                listed.setdefault((row.paper, row.place, row.name), row)
    return sorted(listed.values(), key=Row.key)


def uses(name: str, text: str) -> tuple[int, int]:
    """How well, and how often, a text uses what has this dotted name: (0, 0) where it does not.

    2: its home, the class of a member or the module of a function, is named there, too, or a method by the name that
    `mk.methods.load` knows; 1: only the module of the class is named.
    """
    *home, last = name.split(".")
    of_class = home[-1][0].isupper()
    known = known_as(name.rpartition(".")[0] if of_class else name)
    count = len(re.findall(rf"(?:\.|import |, ){last}\b|\b{last}\(", text))
    count += text.count(f'"{last}"') if last[0].isupper() else 0
    if known and not of_class:
        named = text.count(f'"{known}"')
        return (2, count + named) if count + named else (0, 0)
    homes = [home[-1], *([f'"{known}"'] if known else []), *([] if of_class else [home[-1].replace("_", "-")])]
    if count and any(word in text for word in homes):
        return 2, count
    return (1, count) if count and of_class and home[-2] in text else (0, 0)


@cache
def known_as(name: str) -> str:
    """The name by which `mk.methods.load` knows a class; empty for others."""
    thing = dict(public_objects())[name] if name.startswith("methods.") else None
    return thing.name if inspect.isclass(thing) and isinstance(getattr(thing, "name", None), str) else ""


@cache
def test_texts() -> dict[str, str]:
    """The tests, by path."""
    return {f"tests/{path.name}": path.read_text() for path in sorted((ROOT / "tests").glob("test_*.py"))}


def test_of(name: str) -> str:
    """The test file of the module, if it names the function, else the one that names it most; empty for none."""
    counts = {path: uses(name, text) for path, text in test_texts().items()}
    modules = tuple(f"tests/test_{part}" for part in name.split(".")[:-1])
    own = {path: count for path, count in counts.items() if path.startswith(modules) and count[0] == 2}
    path = max(own or counts, key=counts.get)
    if counts[path][0] < 2 and name.split(".")[-2][0].isupper():
        return test_of(name.rpartition(".")[0])  # of a member that no test calls by itself
    return f"`{path}`" if counts[path][0] else ""


@cache
def notebook_cells() -> dict[str, list[tuple[str, str]]]:
    """By number, the cells of each notebook below its title, each with its heading: code as it is, of texts the id."""
    notebooks = {}
    for path in sorted((ROOT / "notebooks").glob("[0-9]*.ipynb")):
        heading, cells = "", notebooks.setdefault(path.name[:2], [])
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            source = "".join(cell["source"])
            if cell["cell_type"] == "code":
                cells += [(heading, source)] if heading else []
            elif headings := re.findall(r"^##+ (?:[\d.]+ )?(?:· )?(.*)$", source, re.MULTILINE):
                heading = headings[-1]
                cells.append((headings[0], f"<{cell['id']}>"))
    return notebooks


def notebook_of(name: str) -> str:
    """The notebook that uses a function most, and the heading over its first use there; empty for none."""
    if name in SHOWN:
        number, cell = SHOWN[name].split()
        return f'{number}, "{next(heading for heading, text in notebook_cells()[number] if text == f"<{cell}>")}"'
    texts = {number: "\n".join(source for _, source in cells) for number, cells in notebook_cells().items()}
    counts = {number: uses(name, text) for number, text in texts.items()}
    number = max(counts, key=counts.get)
    if not counts[number][0]:
        return ""
    words = [rf"\b{name.rsplit('.', 1)[-1]}\b", *([f'"{known_as(name)}"'] if known_as(name) else [])]
    cells = notebook_cells()[number]
    return f'{number}, "{next(heading for heading, source in cells if re.search("|".join(words), source))}"'


def papers() -> str:
    """docs/papers.md."""
    lines = [
        f"| {row.paper} | {row.place}: {row.about} | `{row.name}` | {test_of(row.name)} | {notebook_of(row.name)} |"
        for row in rows()
    ]
    return PAPERS.format(rows=re.sub(r"\|  (?=\|)", "| ", "\n".join(lines)))


def features() -> str:
    """docs/features.md."""
    return "\n".join([FEATURES, *(layout_section(make(), paper) for make, paper in LAYOUTS.items())])


def layout_section(layout: Layout, paper: str) -> str:
    """What each number of a layout means, part by part and joint by joint."""
    parts = layout.rows()
    notes = inspect.getdoc(type(layout)).split(">>>")[0].strip()
    by_part = [(_span(p.start, p.stop), p.name, ", ".join(layout.components[p.name]), p.unit, p.meaning) for p in parts]
    per_joint = [part for part in parts if layout.joints[part.name]]
    joints = [j for j in layout.order if any(j in layout.joints[part.name] for part in per_joint)]
    by_joint = [(layout.skeleton.names[j], *(_numbers(layout, part, j) for part in per_joint)) for j in joints]
    lines = [f"## {type(layout).__name__}: {layout.size} numbers a frame ({paper})", "", notes, ""]
    lines += [*_table(("numbers", "part", "for each joint", "unit", "meaning"), by_part), ""]
    lines += [*_table(("joint", *(part.name for part in per_joint)), by_joint), ""]
    return "\n".join(lines)


def _numbers(layout: Layout, part, joint: int) -> str:
    """The numbers of one joint in one part of the layout; empty where it has none."""
    joints, wide = layout.joints[part.name], len(layout.components[part.name])
    if joint not in joints:
        return ""
    start = part.start + wide * joints.index(joint)
    return _span(start, start + wide)


def _span(start: int, stop: int) -> str:
    return f"{start}-{stop - 1}" if stop - start > 1 else str(start)


def _table(head: tuple[str, ...], cells: list[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *cells)]


PAGES = {"papers": papers, "features": features, "styles": styles}


if __name__ == "__main__":
    for page, make in PAGES.items():
        (ROOT / "docs" / f"{page}.md").write_text(make(), encoding="utf-8")
        print(f"docs/{page}.md")
