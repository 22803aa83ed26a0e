"""100STYLE (Mason, Starke and Komura 2022): 100 styles of locomotion at 60 fps, with a table of where each clip starts.

The performer stands still before and after a clip; Frame_Cuts.csv says which frames are in style, and each clip is cut
to them. Licence of the data: CC BY 4.0. Cite "Real-Time Style Modelling of Human Locomotion via Feature-Wise
Transformations and Local Motion Phases".
"""

from __future__ import annotations

import csv
import io
import os
import re

from ..errors import MotionKitError
from .captions import captions
from .places import File, Wanted, find, texts, unique
from .sources import Item, Labels

# What the letters in a file's name stand for: content, and what someone is doing, twice in different words.
CONTENTS = {
    "BR": ("run-back", "running backwards", "jogging backwards"),
    "BW": ("walk-back", "walking backwards", "stepping back"),
    "FR": ("run", "running forward", "jogging along"),
    "FW": ("walk", "walking forward", "going on foot"),
    "ID": ("idle", "standing", "staying in place"),
    "SR": ("run-sideways", "running sideways", "sidestepping fast"),
    "SW": ("walk-sideways", "walking sideways", "sidestepping"),
    "TR1": ("transition", "changing from one gait to another", "starting, stopping and changing pace"),
    "TR2": ("transition", "changing from one gait to another", "starting, stopping and changing pace"),
    "TR3": ("transition", "changing from one gait to another", "starting, stopping and changing pace"),
}
_CUTS, _STYLES = "Frame_Cuts.csv", "Dataset_List.csv"

_WANTED = Wanted(
    "100style",
    re.compile(rf"[A-Za-z0-9]+_({'|'.join(CONTENTS)})\.bvh"),
    "STYLE_FW.bvh and so on",
    "get 100STYLE from https://www.ianxmason.com/100style/ (licence CC BY 4.0), then give datasets.load('100style', "
    "root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip",
    re.compile(rf"{re.escape(_CUTS)}|{re.escape(_STYLES)}"),
)


def items(name: str = "100style", root: str | os.PathLike | None = None) -> list[Item]:
    """The clips of 100STYLE cut to the frames in style, sorted by name; content walk, run, idle, ..., style a word.

    root: a folder with Frame_Cuts.csv and the STYLE_XX.bvh files somewhere below it, or a zip; see `places.find`.
    Where Dataset_List.csv is there too, its description of the style is in the sentences. A cut that is N/A leaves the
    clip out. Each clip is a take of its own. Raises MotionKitError where a clip has no
    line in the table of cuts, or the table cannot be read.

    >>> items(root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of 100style here (STYLE_FW.bvh and so on); ...
    """
    files = find(_WANTED, root)
    clips = unique(f for f in files if f.name.endswith(".bvh"))
    tables = dict.fromkeys((_CUTS, _STYLES))
    for file in files:
        if file.name in tables and tables[file.name] is None:
            tables[file.name] = file
    if tables[_CUTS] is None:
        raise MotionKitError(
            f"{clips[0].where}: there are clips, but no {_CUTS} that says where they start; {_WANTED.how}"
        )
    cuts = read_cuts(tables[_CUTS])
    described = read_descriptions(tables[_STYLES]) if tables[_STYLES] else {}
    found = []
    for file in clips:
        style, gait = file.stem.rsplit("_", 1)
        if (style, gait) not in cuts:
            raise MotionKitError(
                f"{file.where}: {tables[_CUTS].where} has no cut for {gait} of {style!r}; take table and files from "
                "the same release"
            )
        cut = cuts[style, gait]
        if cut is not None:
            what = _labels(style, gait, file.stem, described.get(style.lower(), ""))
            found.append(Item(file.stem, what, file.bvh(*cut)))
    return found


def _labels(style: str, gait: str, clip: str, description: str) -> Labels:
    content, doing, again = CONTENTS[gait]
    word = "-".join(re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", style)).lower()
    sentences = captions(doing, again, word)
    if description:
        sentences += (f"a person is {doing}: {description}",)
    return Labels(content, word, sentences, take=clip)


def read_cuts(file: File) -> dict[tuple[str, str], tuple[int, int] | None]:
    """For each style and gait its first frame and the one after its last; None where the table says N/A.

    file: Frame_Cuts.csv, with the columns STYLE_NAME, BR_START, BR_STOP, and so on for each gait. Raises MotionKitError
    that names the line.

    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "Frame_Cuts.csv")
    ...     _ = path.write_text("STYLE_NAME,FW_START,FW_STOP,TR3_START,TR3_STOP\\nOld,60,900,N/A,N/A\\n")
    ...     read_cuts(File("Frame_Cuts.csv", str(path), None, path.stat().st_size, 0))
    {('Old', 'FW'): (60, 900), ('Old', 'TR3'): None}
    """
    cuts: dict[tuple[str, str], tuple[int, int] | None] = {}
    for line, row in _rows(file, "STYLE_NAME"):
        style = row["STYLE_NAME"]
        for gait in CONTENTS:
            cells = [row.get(f"{gait}_{end}") for end in ("START", "STOP")]
            if cells == [None, None]:
                continue
            if (style, gait) in cuts:
                raise MotionKitError(
                    f"{file.where}, line {line}: style {style!r} is there twice; keep one of the lines"
                )
            if all((cell or "N/A").upper() in ("N/A", "NA") for cell in cells):
                cuts[style, gait] = None
                continue
            try:
                start, stop = (int(float(cell or "")) for cell in cells)
            except ValueError:
                start, stop = 0, -1
            if not 0 <= start < stop:
                raise MotionKitError(
                    f"{file.where}, line {line}: expected two frame numbers, the first below the second, or N/A in "
                    f"{gait}_START and {gait}_STOP of {style!r}; found {cells[0]!r} and {cells[1]!r}; get it again"
                )
            cuts[style, gait] = (start, stop)
    return cuts


def read_descriptions(file: File) -> dict[str, str]:
    """For each style, in small letters and without spaces, what Dataset_List.csv says of it.

    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "Dataset_List.csv")
    ...     _ = path.write_text("Style Name,Description\\nBigSteps,Long strides.\\n")
    ...     read_descriptions(File("Dataset_List.csv", str(path), None, path.stat().st_size, 0))
    {'bigsteps': 'long strides'}
    """
    told = {}
    for _, row in _rows(file, "Style Name"):
        description = (row.get("Description") or "").rstrip(".")
        told[row["Style Name"].replace(" ", "").lower()] = description[:1].lower() + description[1:]
    return told


def _rows(file: File, first: str) -> list[tuple[int, dict[str, str]]]:
    """The table's lines with their numbers, without blank ones; a MotionKitError if the column `first` is missing."""
    ((_, text),) = texts([file])
    reader = csv.DictReader(io.StringIO(text), skipinitialspace=True)
    columns = [c.strip() for c in reader.fieldnames or []]
    if first not in columns:
        found = ", ".join(columns)[:80] or "nothing"
        raise MotionKitError(
            f"{file.where}, line 1: expected a table with the column {first!r}; found {found}; get it again"
        )
    reader.fieldnames = columns
    rows = []
    for row in reader:
        cells = {key: value.strip() for key, value in row.items() if key and isinstance(value, str)}
        if cells.get(first):
            rows.append((reader.line_num, cells))
    return rows
