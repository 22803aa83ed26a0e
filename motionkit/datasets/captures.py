"""Bandai-Namco-Research-Motiondataset 1 and 2: where the clips are, and what their names and label files say.

Licence of the data: CC BY-NC 4.0, (c) Bandai Namco Research Inc. Cite Kobayashi et al. 2023, "Motion Capture
Dataset for Practical Use of AI-based Motion Editing and Stylization".
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import warnings
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from string import Formatter

import numpy as np
import torch

from ..errors import MotionKitError
from ..features import HumanML3D
from ..files import MotionKitWarning
from ..text.captions import capture_captions, gerund
from .sources import BvhSource, File, Item, Labels, Recording, Wanted, find, read_heads, read_texts, unique

FILE_PREFIXES = {"bandai-1": "dataset-1", "bandai-2": "dataset-2"}
_ADDRESS = "https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset"

# The labels in the order of their numbers, as the data sets' own tables (cfg/*_label.txt) have them.
BANDAI_LABELS = {
    "bandai-1": {
        "content": "walk run dash walk-back walk-left walk-right bow bye guide byebye respond call punch kick slash "
        "dance-long dance-short",
        "style": "normal happy sad angry proud not-confident masculinity feminine childish old tired active musical "
        "giant chimpira",
    },
    "bandai-2": {
        "content": "walk walk-turn-left walk-turn-right run wave-both-hands wave-left-hand wave-right-hand "
        "raise-up-both-hands raise-up-left-hand raise-up-right-hand",
        "style": "active elderly exhausted feminine masculine normal youthful",
    },
}


def how_to_get(name: str) -> str:
    """What to do when the data are not there.

    >>> how_to_get("bandai-2")
    "get bandai-2 with datasets.fetch('bandai-2'), with `git clone https://github.com/Ban...
    """
    fetch = f"with datasets.fetch({name!r}), " if name == "bandai-2" else ""
    return (
        f"get {name} {fetch}with `git clone {_ADDRESS}` or as the zip from there (licence CC BY-NC 4.0), then give "
        f"datasets.load({name!r}, root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip"
    )


def bandai_labels(clip: str) -> Labels:
    """Content, style and sentences from a clip's name; each clip is a take of its own.

    >>> found = bandai_labels("dataset-2_wave-left-hand_elderly_001")
    >>> found.content, found.style, found.texts[0]
    ('wave-left-hand', 'elderly', 'a person is waving the left hand in old age')
    """
    content, style = clip.split("_")[1:3]
    return Labels(content, style, capture_captions(*gerund(content), style), take=clip)


def bandai_items(name: str, root: str | os.PathLike | None = None) -> list[Item]:
    """The clips of `bandai-1` or `bandai-2`, sorted by name, with labels from their names.

    root: a folder with the clips somewhere below it, or the archive's zip; see `sources.find`. Where a clip's label
    file lies beside it, MotionKitError if that says something else than the name.

    >>> bandai_items("bandai-2", "data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of bandai-2 here (dataset-2_CONTENT_STYLE_NNN.bvh); ...
    """
    prefix = FILE_PREFIXES[name]
    clip = re.escape(prefix) + r"_[^_/\\]+_[^_/\\]+_\d+\."
    shape = f"{prefix}_CONTENT_STYLE_NNN.bvh"
    wanted = Wanted(name, re.compile(clip + "bvh"), shape, how_to_get(name), re.compile(clip + "json"))
    files = find(wanted, root)
    clips = unique(f for f in files if f.name.endswith(".bvh"))
    beside = {f.place.removesuffix(".bvh") + ".json" for f in clips}
    _check_numbers(name, [f for f in files if f.place in beside])
    return [Item(file.stem, bandai_labels(file.stem), file.bvh()) for file in clips]


def _check_numbers(name: str, files: Iterable[File]) -> None:
    """A MotionKitError unless each label file gives the numbers of the labels in its own name."""
    numbers = {kind: {label: n for n, label in enumerate(words.split())} for kind, words in BANDAI_LABELS[name].items()}
    for file, text in read_texts(files):
        try:
            found = dict(json.loads(text))
        except (ValueError, TypeError) as error:
            raise MotionKitError(
                f'{file.where}: expected label numbers such as {{"content": 6, "style": 2}}; found {text[:40]!r} '
                f"({error}); get the file again"
            ) from None
        for kind, label in zip(("content", "style"), file.stem.split("_")[1:3]):
            number, known = found.get(kind), numbers[kind]
            if kind not in found or (label not in known and number not in known.values()):
                continue  # someone's own clips may have labels of their own
            if number != known.get(label):
                told = next((f" ({word})" for word, n in known.items() if n == number), "")
                raise MotionKitError(
                    f"{file.where}: its name says {kind} {label!r}, which is number {known.get(label, 'of no other')}; "
                    f"it gives number {number!r}{told}; rename the clip or mend its label file"
                )


def _smpl_names() -> dict[str, str]:
    limbs = {"Shoulder": "collar", "UpperArm": "shoulder", "LowerArm": "elbow", "Hand": "wrist", "UpperLeg": "hip",
             "LowerLeg": "knee", "Foot": "ankle", "Toes": "foot"}  # fmt: skip
    trunk = {"Hips": "pelvis", "Spine": "spine1", "Chest": "spine3", "Neck": "neck", "Head": "head"}
    sides = {"L": "left", "R": "right"}
    return trunk | {f"{a}_{s}": f"{side}_{b}" for s, side in sides.items() for a, b in limbs.items()}


SMPL_NAMES = _smpl_names()  # its joints, and those of SMPL in the same places


XIA_STYLES = ("angry", "childlike", "depressed", "neutral", "old", "proud", "sexy", "strutting")

_WALK = ("walking", "going on foot")
_LEFT = ("walking and turning left", "taking a left turn on foot")
_RIGHT = ("walking and turning right", "taking a right turn on foot")
_JUMP = ("jumping", "leaping up")
_LEFT_HAND = ("punching with the left hand", "throwing a left punch")
_RIGHT_HAND = ("punching with the right hand", "throwing a right punch")
# For each number from 1 on: content, and what someone is doing, twice in different words.
XIA_CONTENTS = (
    ("walk", _WALK),
    ("walk", _WALK),
    ("walk", _LEFT),
    ("walk", _RIGHT),
    ("walk", _LEFT),
    ("walk", _LEFT),
    ("walk", _WALK),
    ("walk", _WALK),
    ("walk", _RIGHT),
    ("walk", _LEFT),
    ("walk", _RIGHT),
    ("walk", _LEFT),
    ("run", ("running", "jogging along")),
    ("run", ("running and turning left", "taking a left turn at a run")),
    ("run", ("running and turning right", "taking a right turn at a run")),
    ("jump", _JUMP),
    ("jump", _JUMP),
    ("punch", _RIGHT_HAND),
    ("punch", _LEFT_HAND),
    ("punch", _RIGHT_HAND),
    ("punch", _LEFT_HAND),
    ("kick", ("kicking with the left leg", "throwing a left kick")),
    ("kick", ("kicking with the right leg", "throwing a right kick")),
    ("trans", ("jumping and then walking", "going from a jump into a walk")),
    ("trans", ("walking and then jumping", "going from a walk into a jump")),
    ("trans", ("punching and then kicking", "going from a punch into a kick")),
    ("trans", ("walking and then punching", "going from a walk into a punch")),
    ("trans", ("running and then jumping", "going from a run into a jump")),
)
_TESTED = {"walk": 3, "run": 1, "jump": 1, "kick": 1, "punch": 1, "trans": 0}  # clips of each style

_XIA_FILES = Wanted(
    "xia",
    re.compile(r"[A-Za-z-]+_\d+_\d+\.bvh"),
    "STYLE_NN_VVV.bvh",
    "get the BVH files that github.com/DeepMotionEditing/deep-motion-editing links to for style transfer, then give "
    "datasets.load('xia', root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip",
)


def xia_labels(clip: str) -> Labels:
    """Content, style and sentences from a clip's name; each clip is a take of its own.

    Raises MotionKitError for a style or number that the data set does not have.

    >>> found = xia_labels("depressed_13_000")
    >>> found.content, found.style, found.texts[0]
    ('run', 'depressed', 'a person is running in depression')
    """
    style, number, _ = clip.split("_")
    if style not in XIA_STYLES:
        raise MotionKitError(
            f"{clip}: the file's name says style {style!r}; xia has {', '.join(XIA_STYLES)}; rename the clip"
        )
    if not 1 <= int(number) <= len(XIA_CONTENTS):
        raise MotionKitError(
            f"{clip}: the file's name says content number {number}; xia has 1 to {len(XIA_CONTENTS)}; rename the clip"
        )
    content, doing = XIA_CONTENTS[int(number) - 1]
    return Labels(content, style, capture_captions(*doing, style), take=clip)


def xia_items(name: str = "xia", root: str | os.PathLike | None = None) -> list[Item]:
    """The clips, sorted by name, with the split of Aberman et al. 2020.

    root: a folder with the clips somewhere below it, or a zip; see `sources.find`. The test part is, of each style, the
    first three walks and the first run, jump, kick and punch in the order of names; the rest is for training. So it is
    theirs only where all clips are there. Raises MotionKitError for a name that does not fit.

    >>> xia_items(root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of xia here (STYLE_NN_VVV.bvh); ...
    """
    seen: Counter[tuple[str, str]] = Counter()
    found = []
    for file in unique(find(_XIA_FILES, root)):
        what = xia_labels(file.stem)
        seen[what[:2]] += 1
        split = "test" if seen[what[:2]] <= _TESTED[what.content] else "train"
        found.append(Item(file.stem, what._replace(split=split), file.bvh()))
    return found


# What the letters in a file's name stand for: content, and what someone is doing, twice in different words.
GAITS = {
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

_STYLE100_FILES = Wanted(
    "100style",
    re.compile(rf"[A-Za-z0-9]+_({'|'.join(GAITS)})\.bvh"),
    "STYLE_FW.bvh and so on",
    "get 100STYLE from https://www.ianxmason.com/100style/ (licence CC BY 4.0), then give datasets.load('100style', "
    "root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip",
    re.compile(rf"{re.escape(_CUTS)}|{re.escape(_STYLES)}"),
)


def style100_items(name: str = "100style", root: str | os.PathLike | None = None) -> list[Item]:
    """The clips of 100STYLE cut to the frames in style, sorted by name; content walk, run, idle, ..., style a word.

    root: a folder with Frame_Cuts.csv and the STYLE_XX.bvh files somewhere below it, or a zip; see `sources.find`.
    Where Dataset_List.csv is there too, its description of the style is in the sentences. A cut that is N/A leaves the
    clip out. Each clip is a take of its own. Raises MotionKitError where a clip has no
    line in the table of cuts, or the table cannot be read.

    >>> style100_items(root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of 100style here (STYLE_FW.bvh and so on); ...
    """
    files = find(_STYLE100_FILES, root)
    clips = unique(f for f in files if f.name.endswith(".bvh"))
    tables = dict.fromkeys((_CUTS, _STYLES))
    for file in files:
        if file.name in tables and tables[file.name] is None:
            tables[file.name] = file
    if tables[_CUTS] is None:
        raise MotionKitError(
            f"{clips[0].where}: there are clips, but no {_CUTS} that says where they start; {_STYLE100_FILES.how}"
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
            what = _style100_labels(style, gait, file.stem, described.get(style.lower(), ""))
            found.append(Item(file.stem, what, file.bvh(*cut)))
    return found


def _style100_labels(style: str, gait: str, clip: str, description: str) -> Labels:
    content, doing, again = GAITS[gait]
    word = "-".join(re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", style)).lower()
    sentences = capture_captions(doing, again, word)
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
    for line, row in _style100_rows(file, "STYLE_NAME"):
        style = row["STYLE_NAME"]
        for gait in GAITS:
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
    for _, row in _style100_rows(file, "Style Name"):
        description = (row.get("Description") or "").rstrip(".")
        told[row["Style Name"].replace(" ", "").lower()] = description[:1].lower() + description[1:]
    return told


def _style100_rows(file: File, first: str) -> list[tuple[int, dict[str, str]]]:
    """The table's lines with their numbers, without blank ones; a MotionKitError if the column `first` is missing."""
    ((_, text),) = read_texts([file])
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


LABELS = ("content", "style", "take", "performer", "split")
COLUMNS = ("file", "content", "style", "text", "performer", "take", "split")


def folder_items(
    name: str = "folder",
    root: str | os.PathLike | None = None,
    pattern: str = "{content}_{style}_{take}",
    table: str | os.PathLike | None = None,
) -> list[Item]:
    """All BVH files below a folder or in a zip, sorted by name, labelled by their names or by a table.

    root: the folder or zip. pattern: how names are made, without `.bvh`: {content}, {style}, {take}, {performer} and
    {split} stand for labels, {} for what is none, all else for itself; with slashes in it ("{style}/{content}_{take}")
    the folders above a file are read too. No label may hold a character that the pattern has beside it. Clips whose
    labels are all the same are one take. table: instead, a CSV file with a column `file` and any of content, style,
    text, performer, take and split; its files are paths below the root, with or without `.bvh`, and several sentences
    in `text` stand with | between them; the table lies in the root, or anywhere else.

    An item's name is the file's, with its folders where another file has the same. Raises MotionKitError for a file
    that does not fit the pattern, a line without its file, a file without a line, and no files at all.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "walk_old.bvh").write_text("nothing is read yet")
    ...     (item,) = folder_items(root=folder, pattern="{content}_{style}")
    >>> item.name, item.labels.content, item.labels.style, item.labels.texts[0]
    ('walk_old', 'walk', 'old', 'a person is walking in old age')
    """
    if root is None:
        raise MotionKitError("where are your clips? Give datasets.load('folder', root=FOLDER_OR_ZIP)")
    how = "give the folder above them"
    wanted = Wanted(name, re.compile(r".*\.bvh", re.IGNORECASE), "any .bvh file", how, re.compile(r".*\.csv"))
    files = find(wanted, root)
    clips = [f for f in files if f.name.lower().endswith(".bvh")]
    if table is None:
        told = _by_pattern(clips, pattern)
    else:
        told = _by_table(clips, _table_file(table, root, files))
    stems = Counter(f.stem for f in clips)
    names = {f.place: f.stem if stems[f.stem] == 1 else f.place[: -len(".bvh")] for f in clips}
    return sorted((Item(names[f.place], told[f.place], f.bvh()) for f in clips), key=lambda item: item.name)


def _by_pattern(clips: list[File], pattern: str) -> dict[str, Labels]:
    expression, depth = read_pattern(pattern), pattern.count("/") + 1
    told = {}
    for file in clips:
        path = "/".join(file.place[: -len(".bvh")].split("/")[-depth:])
        match = expression.fullmatch(path)
        if match is None:
            raise MotionKitError(
                f"{file.where}: {path!r} does not fit the pattern {pattern!r}; rename the file, give another "
                "pattern=, or a table= with a line for each file"
            )
        found = match.groupdict()
        take = "_".join(found[k] for k in LABELS if k in found and k != "split") if "take" in found else ""
        told[file.place] = _folder_labels(found, found.get("split", ""), take)
    return told


def read_pattern(pattern: str) -> re.Pattern:
    """The regular expression that finds the labels in a name; see `items`. MotionKitError for a pattern that is none.

    >>> read_pattern("{content}_{style}_{}").fullmatch("run_very-old_007").groupdict()
    {'content': 'run', 'style': 'very-old'}
    >>> read_pattern("{mood}")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: pattern '{mood}': no label 'mood'; there are {content}, {style}, ...
    """
    try:
        parts = [(text, label) for text, label, _, _ in Formatter().parse(pattern)]
    except ValueError as error:
        raise MotionKitError(f"pattern {pattern!r}: {error}; write labels as in '{{content}}_{{style}}'") from None
    expression, seen = "", set()
    for (text, label), (following, _) in zip(parts, [*parts[1:], ("/", None)]):
        expression += re.escape(text)
        if label is None:
            continue
        if label and (label not in LABELS or label in seen):
            fault = f"{label!r} is there twice" if label in seen else f"no label {label!r}"
            known = ", ".join(f"{{{known}}}" for known in LABELS)
            raise MotionKitError(f"pattern {pattern!r}: {fault}; there are {known} once each, and {{}} for the rest")
        if not following:
            raise MotionKitError(f"pattern {pattern!r}: nothing stands between two labels; put a sign there, such as _")
        seen.add(label)
        beside = re.escape("".join(sorted({"/", *text[-1:], following[0]})))
        expression += f"(?P<{label}>[^{beside}]+)" if label else f"[^{beside}]+"
    if not seen:
        raise MotionKitError(f"pattern {pattern!r}: no label in it; write it as in '{{content}}_{{style}}'")
    return re.compile(expression)


def _folder_labels(found: dict[str, str], split: str, take: str, sentences: tuple[str, ...] = ()) -> Labels:
    content, style = found.get("content", ""), found.get("style", "")
    if not sentences:
        sentences = capture_captions(*(gerund(content) if content else ("moving", "in motion")), style)
    return Labels(content, style, sentences, found.get("performer", ""), take, split)


def _table_file(table: str | os.PathLike, root: str | os.PathLike, files: list[File]) -> File:
    asked = Path(table).as_posix()
    inside = [f for f in files if f.place == asked]
    path = Path(table).expanduser()
    if inside:
        return inside[0]
    if not path.is_file():
        there = ", ".join(f.place for f in files if f.name.endswith(".csv")) or "no CSV file"
        raise MotionKitError(f"{table}: no such table, neither in {root} nor as a path of its own; there: {there}")
    return File(asked, str(path), None, path.stat().st_size, path.stat().st_mtime_ns)


def _by_table(clips: list[File], table: File) -> dict[str, Labels]:
    places = {f.place[: -len(".bvh")]: f for f in clips}
    told: dict[str, Labels] = {}
    for line, row in _table_rows(table):
        asked = re.sub(r"\.bvh$", "", row["file"].replace("\\", "/").removeprefix("./"), flags=re.IGNORECASE)
        if asked not in places:
            raise MotionKitError(
                f"{table.where}, line {line}: no file {row['file']!r}; expected a path below the root, such as "
                f"{clips[0].place}; mend the line or take it out"
            )
        place = places[asked].place
        if place in told:
            raise MotionKitError(f"{table.where}, line {line}: {row['file']!r} is there twice; keep one of the lines")
        sentences = tuple(s.strip() for s in row.get("text", "").split("|") if s.strip())
        told[place] = _folder_labels(row, row.get("split", ""), row.get("take", ""), sentences)
    lacking = [f for f in clips if f.place not in told]
    if lacking:
        raise MotionKitError(
            f"{table.where}: {len(lacking)} of {len(clips)} files have no line, such as {lacking[0].place}; add lines, "
            "or move the files elsewhere"
        )
    return told


def _table_rows(table: File) -> list[tuple[int, dict[str, str]]]:
    """The table's lines with their numbers; commas or, as some spreadsheets write, semicolons between the columns."""
    ((_, text),) = read_texts([table])
    first = text.partition("\n")[0]
    reader = csv.DictReader(io.StringIO(text), delimiter=";" if first.count(";") > first.count(",") else ",")
    columns = [column.strip().lower() for column in reader.fieldnames or []]
    unknown = [c for c in columns if c not in COLUMNS]
    if "file" not in columns or unknown or len(set(columns)) < len(columns):
        raise MotionKitError(
            f"{table.where}, line 1: expected the column 'file' and any of {', '.join(COLUMNS[1:])}; found "
            f"{', '.join(map(repr, columns)) or 'nothing'}; name each column so, once"
        )
    reader.fieldnames = columns
    rows = []
    for row in reader:
        if None in row or None in row.values():
            raise MotionKitError(
                f"{table.where}, line {reader.line_num}: expected {len(columns)} cells; put text with commas in quotes"
            )
        rows.append((reader.line_num, {key: value.strip() for key, value in row.items()}))
    return rows


HUMANML3D_FPS = 20.0
_BROKEN = ("007975", "M007975")  # known for NaNs; the data set's own statistics skip them too
WHOLE = (0.0, 0.0)  # what the files write for a caption of the whole motion
_SIZE = 263
_SPLITS = {"train.txt": "train", "val.txt": "validation", "test.txt": "test"}

_HUMANML3D_FILES = Wanted(
    "humanml3d",
    re.compile(r"M?\d+\.npy"),
    "new_joint_vecs/NNNNNN.npy with texts/NNNNNN.txt",
    "make HumanML3D from AMASS as https://github.com/EricGuo5513/HumanML3D says (motions may not be passed on), then "
    "give datasets.load('humanml3d', root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip",
    re.compile(r"M?\d+\.txt|train\.txt|val\.txt|test\.txt"),
)


@dataclass(frozen=True)
class FeatureSource(BvhSource):
    """A file of 263 numbers a frame, found and cut like a BVH file."""

    def read(self) -> Recording:
        """The motion by `features.HumanML3D`, on SMPL's 22 joints with bones of the data's own lengths.

        Its track `contacts` [F, 4] is 1 where left ankle, left toe, right ankle, right toe stand. Raises
        MotionKitError for a file that is no [F, 263] of finite numbers.
        """
        where = self.path if self.member is None else f"{self.path}/{self.member}"
        x = torch.from_numpy(_numbers(self._bytes(), where))
        layout = HumanML3D(fps=HUMANML3D_FPS)
        motion = layout.decode(x).replace(name=PurePosixPath(where.replace("\\", "/")).stem)
        contacts = x[:, layout.slices["contacts"]]
        return Recording(motion[self.start : self.stop], {"contacts": contacts[self.start : self.stop]})


def _numbers(data: bytes, where: str) -> np.ndarray:
    try:
        x = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise MotionKitError(f"{where}: not a whole .npy file ({error}); get it again") from None
    if not isinstance(x, np.ndarray) or x.ndim != 2 or x.shape[1] != _SIZE or not len(x) or x.dtype.kind != "f":
        found = f"{x.dtype} {list(x.shape)}" if isinstance(x, np.ndarray) else type(x).__name__
        raise MotionKitError(
            f"{where}: expected floating-point numbers [frames, {_SIZE}] with one frame or more; found {found}; take "
            "new_joint_vecs, not new_joints"
        )
    if not np.isfinite(x).all():
        frame, number = np.argwhere(~np.isfinite(x))[0].tolist()
        raise MotionKitError(f"{where}: frame {frame}, number {number} is {x[frame, number]}; make the file again")
    return np.ascontiguousarray(x, dtype=np.float32)


def humanml3d_items(name: str = "humanml3d", root: str | os.PathLike | None = None) -> list[Item]:
    """The motions with their captions, sorted by name. Content and style are empty: nobody labelled them.

    root: a folder with new_joint_vecs and texts somewhere below it, or a zip; see `sources.find`. A caption of a part
    (its start and end, in seconds, are not both 0) gives an item of its own, cut to that part and named
    NAME@START-END; one of a part without frames is passed over, as the data set's own loader does. The take is the
    name without the M of mirror images, so that a split keeps a motion with its image. The split is that of the lists,
    where they are; what they list and is not there is told of in one warning, as not everybody has all of AMASS.
    Raises MotionKitError for a motion without captions, a line that is no caption, and a name in two lists.

    >>> humanml3d_items(root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of humanml3d here (new_joint_vecs/NNNNNN.npy with ...
    """
    files = find(_HUMANML3D_FILES, root)
    motions = [m for m in unique(_in_folder(files, "new_joint_vecs", ".npy")) if m.stem not in _BROKEN]
    if not motions:
        raise MotionKitError(f"{files[0].where}: motions, but none in a folder new_joint_vecs; {_HUMANML3D_FILES.how}")
    captions = {f.stem: f for f in unique(_in_folder(files, "texts", ".txt"))}
    splits = _splits(f for f in files if f.name in _SPLITS)
    _warn_of_missing(splits, {m.stem for m in motions}.union(_BROKEN), motions[0])
    lacking = next((m for m in motions if m.stem not in captions), None)
    if lacking:
        raise MotionKitError(
            f"{lacking.where}: no captions for it; expected texts/{lacking.stem}.txt; unpack texts.zip"
        )
    told = {file.stem: read_captions(file, text) for file, text in read_texts(captions[m.stem] for m in motions)}
    frames = {
        f.stem: _frames(f, head) for f, head in read_heads((m for m in motions if set(told[m.stem]) - {WHOLE}), 256)
    }
    found = [item for m in motions for item in _parts(m, told[m.stem], splits.get(m.stem, ""), frames.get(m.stem, 0))]
    return sorted(found, key=lambda item: item.name)


def _parts(file: File, told: dict[tuple[float, float], tuple[str, ...]], split: str, frames: int) -> Iterable[Item]:
    """The whole motion and the parts that have captions of their own; frames: of the file, where there are such."""
    for (start, stop), sentences in told.items():
        part, cut = "", (0, None)
        if (start, stop) != WHOLE:
            part, cut = f"@{start:g}-{stop:g}", (int(start * HUMANML3D_FPS), int(stop * HUMANML3D_FPS))
            if not cut[0] < min(cut[1], frames):
                continue
        what = Labels("", "", sentences, take=file.stem.removeprefix("M"), split=split)
        source = FeatureSource(file.path, file.member, file.size, file.changed, *cut)
        yield Item(file.stem + part, what, source)


def _frames(file: File, head: bytes) -> int:
    """How many frames a .npy file has, from its header."""
    try:
        stream = io.BytesIO(head)
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        return read(stream)[0][0]
    except (ValueError, IndexError) as error:
        raise MotionKitError(f"{file.where}: not a whole .npy file ({error}); get it again") from None


def _in_folder(files: list[File], folder: str, suffix: str) -> list[File]:
    """Those that stand right in a folder of this name."""
    return [f for f in files if f.name.endswith(suffix) and f.where.replace("\\", "/").split("/")[-2:-1] == [folder]]


def _splits(files: Iterable[File]) -> dict[str, str]:
    found: dict[str, str] = {}
    for file, text in read_texts(files):
        for name in text.split():
            if found.setdefault(name, _SPLITS[file.name]) != _SPLITS[file.name]:
                raise MotionKitError(
                    f"{file.where}: {name} is in the list for {found[name]} too; take all lists from one release"
                )
    return found


def _warn_of_missing(splits: dict[str, str], there: set[str], example: File) -> None:
    missing = sorted(set(splits) - there)
    if missing:
        warnings.warn(
            f"{example.where}: {len(missing)} of {len(splits)} listed motions are not beside it, such as {missing[0]}; "
            "they are left out",
            MotionKitWarning,
            stacklevel=3,
        )


def read_captions(file: File, text: str) -> dict[tuple[float, float], tuple[str, ...]]:
    """Captions by the part that they speak of, in seconds from start to end; (0, 0) for the whole motion.

    text: lines `caption#tokens#start#end`. Raises MotionKitError that names a line of another form, or a file without.

    >>> file = File("read_texts/000001.txt", "000001.txt", None, 0, 0)
    >>> read_captions(file, "a man bows.#a/DET man/NOUN bow/VERB#0.0#0.0\\nhe waves.#he/PRON wave/VERB#1.5#4.0\\n")
    {(0.0, 0.0): ('a man bows.',), (1.5, 4.0): ('he waves.',)}
    """
    found: dict[tuple[float, float], tuple[str, ...]] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            caption, _, *ends = line.strip().split("#")
            start, stop = (0.0 if math.isnan(float(end)) else float(end) for end in ends)
        except ValueError:
            start, stop, caption = 0.0, -1.0, ""
        if not caption.strip() or not (0 <= start < math.inf and 0 <= stop < math.inf):
            raise MotionKitError(
                f"{file.where}, line {number}: expected caption#tokens#start#end, the last two in seconds; found "
                f"{line[:60]!r}; get the texts again"
            )
        found[start, stop] = (*found.get((start, stop), ()), caption.strip())
    if not found:
        raise MotionKitError(f"{file.where}: no caption in it; get the texts again")
    return found
