"""Any BVH files below a folder or in a zip, with labels from their names or from a table."""

from __future__ import annotations

import csv
import io
import os
import re
from collections import Counter
from pathlib import Path
from string import Formatter

from ..errors import MotionKitError
from .captions import captions, doing
from .places import File, Wanted, find, texts
from .sources import Item, Labels

LABELS = ("content", "style", "take", "performer", "split")
COLUMNS = ("file", "content", "style", "text", "performer", "take", "split")


def items(
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
    ...     (item,) = items(root=folder, pattern="{content}_{style}")
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
        told[file.place] = _labels(found, found.get("split", ""), take)
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


def _labels(found: dict[str, str], split: str, take: str, sentences: tuple[str, ...] = ()) -> Labels:
    content, style = found.get("content", ""), found.get("style", "")
    if not sentences:
        sentences = captions(*(doing(content) if content else ("moving", "in motion")), style)
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
    for line, row in _rows(table):
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
        told[place] = _labels(row, row.get("split", ""), row.get("take", ""), sentences)
    lacking = [f for f in clips if f.place not in told]
    if lacking:
        raise MotionKitError(
            f"{table.where}: {len(lacking)} of {len(clips)} files have no line, such as {lacking[0].place}; add lines, "
            "or move the files elsewhere"
        )
    return told


def _rows(table: File) -> list[tuple[int, dict[str, str]]]:
    """The table's lines with their numbers; commas or, as some spreadsheets write, semicolons between the columns."""
    ((_, text),) = texts([table])
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
