"""Readers of published captures and of anybody's own files: each finds its clips, labels them, and lists them as items.

Bandai-Namco-Research-Motiondataset 1 and 2 (Kobayashi et al. 2023, CC BY-NC 4.0, (c) Bandai Namco Research Inc.), Xia
et al. 2015, 100STYLE (Mason et al. 2022, CC BY 4.0), HumanML3D (Guo et al. 2022), and folders of BVH files.
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
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from string import Formatter

import numpy as np
import torch

from ..errors import MotionKitError
from ..features import HumanML3D
from ..files import MotionKitWarning
from ..text.captions import capture_captions, gerund
from .sources import BvhSource, File, Item, Labels, Recording, Wanted, find, unique

FILE_PREFIXES = {"bandai-1": "dataset-1", "bandai-2": "dataset-2"}

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


def _smpl_names() -> dict[str, str]:
    limbs = {"Shoulder": "collar", "UpperArm": "shoulder", "LowerArm": "elbow", "Hand": "wrist", "UpperLeg": "hip",
             "LowerLeg": "knee", "Foot": "ankle", "Toes": "foot"}  # fmt: skip
    trunk = {"Hips": "pelvis", "Spine": "spine1", "Chest": "spine3", "Neck": "neck", "Head": "head"}
    sides = {"L": "left", "R": "right"}
    return trunk | {f"{a}_{s}": f"{side}_{b}" for s, side in sides.items() for a, b in limbs.items()}


SMPL_NAMES = _smpl_names()  # Bandai's joints, and those of SMPL in the same places


def bandai_labels(clip: str) -> Labels:
    """Content, style and sentences from a clip's name; each clip is a take of its own.

    >>> labels = bandai_labels("dataset-2_wave-left-hand_elderly_001")
    >>> labels.content, labels.style, labels.texts[0]
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
    fetch = f"with datasets.fetch({name!r}), " if name == "bandai-2" else ""
    how = (
        f"get {name} {fetch}with `git clone https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-"
        f"Motiondataset` or as the zip from there (licence CC BY-NC 4.0), then give datasets.load({name!r}, "
        "root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip"
    )
    shape = f"{prefix}_CONTENT_STYLE_NNN.bvh"
    clips, label_files = find(Wanted(name, re.compile(clip + "bvh"), shape, how, re.compile(clip + "json")), root)
    clips = unique(clips)
    beside = {file.place.removesuffix(".bvh") + ".json" for file in clips}
    for file in label_files:
        if file.place in beside:
            _check_numbers(name, file)
    return [Item(file.stem, bandai_labels(file.stem), BvhSource(file)) for file in clips]


def _check_numbers(name: str, file: File) -> None:
    """A MotionKitError unless a label file gives the numbers of the labels in its own name."""
    text = file.text()
    try:
        numbers = dict(json.loads(text))
    except (ValueError, TypeError) as error:
        raise MotionKitError(
            f'{file.where}: expected label numbers such as {{"content": 6, "style": 2}}; found {text[:40]!r} '
            f"({error}); get the file again"
        ) from None
    for kind, label in zip(("content", "style"), file.stem.split("_")[1:3]):
        words = BANDAI_LABELS[name][kind].split()
        expected = words.index(label) if label in words else None
        number = numbers.get(kind, expected)
        meant = next((f" ({word})" for n, word in enumerate(words) if n == number), "")
        if number == expected or (expected is None and not meant):
            continue  # someone's own clips may have labels of their own
        raise MotionKitError(
            f"{file.where}: its name says {kind} {label!r}, which is number "
            f"{'of no other' if expected is None else expected}; it gives number {number!r}{meant}; rename the clip "
            "or mend its label file"
        )


XIA_STYLES = ("angry", "childlike", "depressed", "neutral", "old", "proud", "sexy", "strutting")

# Content, and what someone is doing, twice in different words.
_XIA_ACTIONS = {
    "walk": ("walk", "walking", "going on foot"),
    "walk-left": ("walk", "walking and turning left", "taking a left turn on foot"),
    "walk-right": ("walk", "walking and turning right", "taking a right turn on foot"),
    "run": ("run", "running", "jogging along"),
    "run-left": ("run", "running and turning left", "taking a left turn at a run"),
    "run-right": ("run", "running and turning right", "taking a right turn at a run"),
    "jump": ("jump", "jumping", "leaping up"),
    "punch-left": ("punch", "punching with the left hand", "throwing a left punch"),
    "punch-right": ("punch", "punching with the right hand", "throwing a right punch"),
    "kick-left": ("kick", "kicking with the left leg", "throwing a left kick"),
    "kick-right": ("kick", "kicking with the right leg", "throwing a right kick"),
    "jump-walk": ("trans", "jumping and then walking", "going from a jump into a walk"),
    "walk-jump": ("trans", "walking and then jumping", "going from a walk into a jump"),
    "punch-kick": ("trans", "punching and then kicking", "going from a punch into a kick"),
    "walk-punch": ("trans", "walking and then punching", "going from a walk into a punch"),
    "run-jump": ("trans", "running and then jumping", "going from a run into a jump"),
}
# The same for each number in a file's name, from 1 on.
XIA_CONTENTS = tuple(
    _XIA_ACTIONS[action]
    for action in "walk walk walk-left walk-right walk-left walk-left walk walk walk-right walk-left walk-right "
    "walk-left run run-left run-right jump jump punch-right punch-left punch-right punch-left kick-left kick-right "
    "jump-walk walk-jump punch-kick walk-punch run-jump".split()
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

    >>> labels = xia_labels("depressed_13_000")
    >>> labels.content, labels.style, labels.texts[0]
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
    content, *doing = XIA_CONTENTS[int(number) - 1]
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
    clips, _ = find(_XIA_FILES, root)
    counts: Counter[tuple[str, str]] = Counter()
    items = []
    for file in unique(clips):
        labels = xia_labels(file.stem)
        counts[labels[:2]] += 1
        split = "test" if counts[labels[:2]] <= _TESTED[labels.content] else "train"
        items.append(Item(file.stem, labels._replace(split=split), BvhSource(file)))
    return items


def read_table(file: File) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Columns of a CSV file, and its lines, each with its number; none for a file of nothing.

    Commas or, as some spreadsheets write, semicolons stand between the cells.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "labels.csv")
    ...     _ = path.write_text("file; style\\nwalk_1; old\\n")
    ...     read_table(File.at(path))
    (['file', 'style'], [(2, ['walk_1', 'old'])])
    """
    text = file.text()
    first = text.partition("\n")[0]
    separator = ";" if first.count(";") > first.count(",") else ","
    reader = csv.reader(io.StringIO(text), delimiter=separator, skipinitialspace=True)
    lines = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader]
    return (lines[0][1] if lines else []), [(number, cells) for number, cells in lines[1:] if any(cells)]


# What the letters in a file's name stand for: content, and what someone is doing, twice in different words.
_TRANSITION = ("transition", "changing from one gait to another", "starting, stopping and changing pace")
GAITS = {
    "BR": ("run-back", "running backwards", "jogging backwards"),
    "BW": ("walk-back", "walking backwards", "stepping back"),
    "FR": ("run", "running forward", "jogging along"),
    "FW": ("walk", "walking forward", "going on foot"),
    "ID": ("idle", "standing", "staying in place"),
    "SR": ("run-sideways", "running sideways", "sidestepping fast"),
    "SW": ("walk-sideways", "walking sideways", "sidestepping"),
    "TR1": _TRANSITION,
    "TR2": _TRANSITION,
    "TR3": _TRANSITION,
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


def style100_labels(clip: str, description: str = "") -> Labels:
    """Content, style and sentences from a clip's name, and what is said of its style; each clip is a take of its own.

    >>> labels = style100_labels("ArmsAboveHead_FW")
    >>> labels.content, labels.style, labels.texts[0]
    ('walk', 'arms-above-head', 'a person is walking forward in an arms above head style')
    """
    style, gait = clip.rsplit("_", 1)
    content, doing, again = GAITS[gait]
    word = "-".join(re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", style)).lower()
    sentences = capture_captions(doing, again, word)
    if description:
        sentences += (f"a person is {doing}: {description}",)
    return Labels(content, word, sentences, take=clip)


def style100_items(name: str = "100style", root: str | os.PathLike | None = None) -> list[Item]:
    """The clips of 100STYLE cut to the frames in style, sorted by name; content walk, run, idle, ..., style a word.

    root: a folder with Frame_Cuts.csv and the STYLE_XX.bvh files somewhere below it, or a zip; see `sources.find`.
    Where Dataset_List.csv is there too, its description of the style is in the sentences. A cut that is N/A leaves the
    clip out. Raises MotionKitError where a clip has no line in the table of cuts, or the table cannot be read.

    >>> style100_items(root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of 100style here (STYLE_FW.bvh and so on); ...
    """
    clips, others = find(_STYLE100_FILES, root)
    clips, tables = unique(clips), {file.name: file for file in reversed(others)}
    if _CUTS not in tables:
        raise MotionKitError(
            f"{clips[0].where}: there are clips, but no {_CUTS} that says where they start; {_STYLE100_FILES.how}"
        )
    cuts = read_cuts(tables[_CUTS])
    descriptions = read_descriptions(tables[_STYLES]) if _STYLES in tables else {}
    items = []
    for file in clips:
        style, gait = file.stem.rsplit("_", 1)
        if (style, gait) not in cuts:
            raise MotionKitError(
                f"{file.where}: {tables[_CUTS].where} has no cut for {gait} of {style!r}; take table and files from "
                "the same release"
            )
        if cuts[style, gait]:
            labels = style100_labels(file.stem, descriptions.get(style.lower(), ""))
            items.append(Item(file.stem, labels, BvhSource(file, *cuts[style, gait])))
    return items


def read_cuts(file: File) -> dict[tuple[str, str], tuple[int, int] | None]:
    """For each style and gait its first frame and the one after its last; None where the table says N/A.

    file: Frame_Cuts.csv, with the columns STYLE_NAME, BR_START, BR_STOP, and so on for each gait. Raises MotionKitError
    that names the line.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "Frame_Cuts.csv")
    ...     _ = path.write_text("STYLE_NAME,FW_START,FW_STOP,TR3_START,TR3_STOP\\nOld,60,900,N/A,N/A\\n")
    ...     read_cuts(File.at(path))
    {('Old', 'FW'): (60, 900), ('Old', 'TR3'): None}
    """
    cuts: dict[tuple[str, str], tuple[int, int] | None] = {}
    for line, style, row in _style100_rows(file, "STYLE_NAME"):
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

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "Dataset_List.csv")
    ...     _ = path.write_text("Style Name,Description\\nBigSteps,Long strides.\\n")
    ...     read_descriptions(File.at(path))
    {'bigsteps': 'long strides'}
    """
    descriptions = {}
    for _, style, row in _style100_rows(file, "Style Name"):
        description = row.get("Description", "").rstrip(".")
        descriptions[style.replace(" ", "").lower()] = description[:1].lower() + description[1:]
    return descriptions


def _style100_rows(file: File, key: str) -> list[tuple[int, str, dict[str, str]]]:
    """Number of each line, its style in the column `key`, and its cells; MotionKitError if there is no such column."""
    columns, lines = read_table(file)
    if key not in columns:
        found = ", ".join(columns)[:80] or "nothing"
        raise MotionKitError(
            f"{file.where}, line 1: expected a table with the column {key!r}; found {found}; get it again"
        )
    rows = ((number, dict(zip(columns, cells))) for number, cells in lines)
    return [(number, row[key], row) for number, row in rows if row.get(key)]


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
    bvh, how = re.compile(r".*\.bvh", re.IGNORECASE), "give the folder above them"
    clips, tables = find(Wanted(name, bvh, "any .bvh file", how, re.compile(r".*\.csv")), root)
    labels = _by_pattern(clips, pattern) if table is None else _by_table(clips, _find_table(table, root, tables))
    stems = Counter(file.stem for file in clips)
    names = (file.stem if stems[file.stem] == 1 else _without_suffix(file) for file in clips)
    items = (Item(name, label, BvhSource(file)) for name, label, file in zip(names, labels, clips))
    return sorted(items, key=lambda item: item.name)


def _without_suffix(file: File) -> str:
    return file.place[: -len(".bvh")]


def _by_pattern(clips: list[File], pattern: str) -> list[Labels]:
    """The labels in each clip's name."""
    expression, depth = read_pattern(pattern), pattern.count("/") + 1
    labels = []
    for file in clips:
        path = "/".join(_without_suffix(file).split("/")[-depth:])
        match = expression.fullmatch(path)
        if match is None:
            raise MotionKitError(
                f"{file.where}: {path!r} does not fit the pattern {pattern!r}; rename the file, give another "
                "pattern=, or a table= with a line for each file"
            )
        words = match.groupdict()
        take = "_".join(words[k] for k in LABELS if k in words and k != "split") if "take" in words else ""
        labels.append(_folder_labels(words, take))
    return labels


def read_pattern(pattern: str) -> re.Pattern:
    """The regular expression that finds the labels in a name; see `folder_items`. MotionKitError for one that is none.

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
    expression, before = "", set()
    for (text, label), (following, _) in zip(parts, [*parts[1:], ("/", None)]):
        expression += re.escape(text)
        if label is None:
            continue
        if label and (label not in LABELS or label in before):
            fault = f"{label!r} is there twice" if label in before else f"no label {label!r}"
            known = ", ".join(f"{{{known}}}" for known in LABELS)
            raise MotionKitError(f"pattern {pattern!r}: {fault}; there are {known} once each, and {{}} for the rest")
        if not following:
            raise MotionKitError(f"pattern {pattern!r}: nothing stands between two labels; put a sign there, such as _")
        before.add(label)
        beside = re.escape("".join(sorted({"/", *text[-1:], following[0]})))
        expression += f"(?P<{label}>[^{beside}]+)" if label else f"[^{beside}]+"
    if not before:
        raise MotionKitError(f"pattern {pattern!r}: no label in it; write it as in '{{content}}_{{style}}'")
    return re.compile(expression)


def _folder_labels(words: dict[str, str], take: str, sentences: tuple[str, ...] = ()) -> Labels:
    """Labels of what a name or a line says, with sentences of the kit's own where it has none."""
    content, style = words.get("content", ""), words.get("style", "")
    if not sentences:
        sentences = capture_captions(*(gerund(content) if content else ("moving", "in motion")), style)
    return Labels(content, style, sentences, words.get("performer", ""), take, words.get("split", ""))


def _find_table(table: str | os.PathLike, root: str | os.PathLike, tables: list[File]) -> File:
    """The table with this place in the root, or at this path; MotionKitError where there is neither."""
    place, path = Path(table).as_posix(), Path(table).expanduser()
    for file in tables:
        if file.place == place:
            return file
    if not path.is_file():
        there = ", ".join(file.place for file in tables) or "no CSV file"
        raise MotionKitError(f"{table}: no such table, neither in {root} nor as a path of its own; there: {there}")
    return File.at(path)


def _by_table(clips: list[File], table: File) -> list[Labels]:
    """The labels in each clip's line."""
    columns, lines = read_table(table)
    columns = [column.lower() for column in columns]
    if "file" not in columns or not set(columns) <= set(COLUMNS) or len(set(columns)) < len(columns):
        raise MotionKitError(
            f"{table.where}, line 1: expected the column 'file' and any of {', '.join(COLUMNS[1:])}; found "
            f"{', '.join(map(repr, columns)) or 'nothing'}; name each column so, once"
        )
    labels: dict[str, Labels | None] = {_without_suffix(file): None for file in clips}
    for number, cells in lines:
        line = f"{table.where}, line {number}"
        if len(cells) != len(columns):
            raise MotionKitError(f"{line}: expected {len(columns)} cells; put text with commas in quotes")
        row = dict(zip(columns, cells))
        place = re.sub(r"\.bvh$", "", row["file"].replace("\\", "/").removeprefix("./"), flags=re.IGNORECASE)
        if place not in labels:
            raise MotionKitError(
                f"{line}: no file {row['file']!r}; expected a path below the root, such as {clips[0].place}; mend the "
                "line or take it out"
            )
        if labels[place]:
            raise MotionKitError(f"{line}: {row['file']!r} is there twice; keep one of the lines")
        sentences = tuple(s.strip() for s in row.get("text", "").split("|") if s.strip())
        labels[place] = _folder_labels(row, row.get("take", ""), sentences)
    lacking = [file.place for file in clips if labels[_without_suffix(file)] is None]
    if lacking:
        raise MotionKitError(
            f"{table.where}: {len(lacking)} of {len(clips)} files have no line, such as {lacking[0]}; add lines, or "
            "move the files elsewhere"
        )
    return [labels[_without_suffix(file)] for file in clips]


HUMANML3D_FPS = 20.0
WHOLE = (0.0, 0.0)  # what the files write for a caption of the whole motion
_BROKEN = ("007975", "M007975")  # known for NaNs; the data set's own statistics skip them too
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
        x = torch.from_numpy(_numbers(self.data(), self.file.where))
        layout, cut = HumanML3D(fps=HUMANML3D_FPS), slice(self.start, self.stop)
        motion = layout.decode(x).replace(name=self.file.stem)
        return Recording(motion[cut], {"contacts": x[:, layout.slices["contacts"]][cut]})


def _numbers(data: bytes, where: str) -> np.ndarray:
    """What a .npy file holds, [F, 263]."""
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
    arrays, texts = find(_HUMANML3D_FILES, root)
    motions = [file for file in unique(_directly_in("new_joint_vecs", arrays)) if file.stem not in _BROKEN]
    if not motions:
        raise MotionKitError(f"{arrays[0].where}: motions, but none in a folder new_joint_vecs; {_HUMANML3D_FILES.how}")
    captions = {file.stem: file for file in unique(_directly_in("texts", texts))}
    splits = _read_splits(file for file in texts if file.name in _SPLITS)
    missing = sorted(set(splits) - {file.stem for file in motions} - set(_BROKEN))
    if missing:
        warnings.warn(
            f"{motions[0].where}: {len(missing)} of {len(splits)} listed motions are not beside it, such as "
            f"{missing[0]}; they are left out",
            MotionKitWarning,
            stacklevel=2,
        )
    items = []
    for file in motions:
        if file.stem not in captions:
            raise MotionKitError(f"{file.where}: no captions for it; expected texts/{file.stem}.txt; unpack texts.zip")
        items += _parts(file, captions[file.stem], splits.get(file.stem, ""))
    return sorted(items, key=lambda item: item.name)


def _directly_in(folder: str, files: Iterable[File]) -> list[File]:
    """Those that stand right in a folder of this name."""
    return [file for file in files if file.where.replace("\\", "/").split("/")[-2:-1] == [folder]]


def _read_splits(lists: Iterable[File]) -> dict[str, str]:
    """The part of each motion that is in a list."""
    splits: dict[str, str] = {}
    for file in lists:
        for name in file.text().split():
            if splits.setdefault(name, _SPLITS[file.name]) != _SPLITS[file.name]:
                raise MotionKitError(
                    f"{file.where}: {name} is in the list for {splits[name]} too; take all lists from one release"
                )
    return splits


def _parts(file: File, captions: File, split: str) -> Iterator[Item]:
    """The whole motion and the parts that have captions of their own."""
    for (start, stop), sentences in read_captions(captions, captions.text()).items():
        name, cut = file.stem, (0, None)
        if (start, stop) != WHOLE:
            name, cut = f"{name}@{start:g}-{stop:g}", (int(start * HUMANML3D_FPS), int(stop * HUMANML3D_FPS))
            if cut[0] >= min(cut[1], _count_frames(file)):
                continue
        labels = Labels("", "", sentences, take=file.stem.removeprefix("M"), split=split)
        yield Item(name, labels, FeatureSource(file, *cut))


def _count_frames(file: File) -> int:
    """How many frames a .npy file has, from its header."""
    stream = io.BytesIO(file.head(256))
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        return read(stream)[0][0]
    except (ValueError, IndexError) as error:
        raise MotionKitError(f"{file.where}: not a whole .npy file ({error}); get it again") from None


def read_captions(file: File, text: str) -> dict[tuple[float, float], tuple[str, ...]]:
    """Captions by the part that they speak of, in seconds from start to end; (0, 0) for the whole motion.

    text: lines `caption#tokens#start#end`. Raises MotionKitError that names a line of another form, or a file without.

    >>> file = File("texts/000001.txt", "000001.txt", None, 0, 0)
    >>> read_captions(file, "a man bows.#a/DET man/NOUN bow/VERB#0.0#0.0\\nhe waves.#he/PRON wave/VERB#1.5#4.0\\n")
    {(0.0, 0.0): ('a man bows.',), (1.5, 4.0): ('he waves.',)}
    """
    captions: dict[tuple[float, float], tuple[str, ...]] = {}
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
        captions[start, stop] = (*captions.get((start, stop), ()), caption.strip())
    if not captions:
        raise MotionKitError(f"{file.where}: no caption in it; get the texts again")
    return captions
