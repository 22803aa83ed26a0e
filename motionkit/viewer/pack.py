"""Figures packed into one block of bytes for the browser.

Layout, little-endian: uint32 length of the header, the header (JSON, UTF-8), zeros up to a multiple of 4, then the
arrays that the header points at by byte offset. For each motion: the first joint's path as float32 [F, 3], and all
joints relative to it as int16 [F, J, 3] times `scale`. Half a step of `scale` is the largest error: under 0.05 mm for a
person, under 1 mm for anything up to 32 m across.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence

import numpy as np

from ..errors import MotionKitError
from . import colours
from .body import Figure

STEPS = 32767


def pack(
    figures: Sequence[Figure],
    *,
    labels: Sequence[str | None],
    trails: Sequence[str] = (),
    contacts: Sequence | None = None,
    follow: bool = True,
) -> bytes:
    """Figures as the bytes that `player.js` reads.

    labels: one text or None for each figure. trails: joint names. contacts: for each figure None, or pairs of joint
    number and bool array [F].
    """
    blocks: list[bytes] = []
    head = {"motions": [], "follow": follow, "contact": colours.CONTACT}
    marks = contacts if contacts is not None else [None] * len(figures)
    for figure, label, mark in zip(figures, labels, marks):
        head["motions"].append(_describe(figure, label, trails, mark or [], blocks))
    return _join(head, blocks)


def _describe(figure: Figure, label: str | None, trails: Sequence[str], marks: Sequence, blocks: list[bytes]) -> dict:
    root = figure.points[:, 0]
    around = figure.points - root[:, None]
    scale = max(float(np.abs(around).max()), 1e-6) / STEPS
    known = [figure.names.index(n) for n in trails if n in figure.names]
    return {
        "label": label or "",
        "name": figure.name,
        "fps": figure.fps,
        "frames": len(figure.points),
        "joints": len(figure.parents),
        "bones": figure.bones,
        "scale": scale,
        "height": round(figure.size, 4),
        "drawn": figure.drawn,
        "radii": [round(float(r), 4) for r in figure.radii],
        "colours": figure.colours,
        "role": figure.role,
        "head": figure.head,
        "headParent": figure.parents[figure.head] if figure.head >= 0 else -1,
        "headRadius": round(figure.head_radius, 4),
        "left": [round(float(x), 4) for x in figure.left],
        "trails": known,
        "marks": [j for j, _ in marks],
        "root": _add(blocks, root.astype("<f4")),
        "around": _add(blocks, np.rint(around / scale).astype("<i2")),
        "touch": _add(blocks, np.stack([t for _, t in marks], 1).astype("u1")) if marks else -1,
    }


def _add(blocks: list[bytes], array: np.ndarray) -> int:
    """Appends an array, padded to four bytes; returns its place after the header."""
    place = sum(map(len, blocks))
    raw = np.ascontiguousarray(array).tobytes()
    blocks.append(raw + bytes(-len(raw) % 4))
    return place


def _join(head: dict, blocks: Sequence[bytes]) -> bytes:
    text = json.dumps(head, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return len(text).to_bytes(4, "little") + text + b"".join(blocks)


def unpack(data: bytes) -> tuple[dict, list[np.ndarray]]:
    """The header and each motion's positions [F, J, 3]: what the browser reads, for tests and tools."""
    length = int.from_bytes(data[:4], "little")
    head = json.loads(data[4 : 4 + length])
    body, found = data[4 + length :], []
    for m in head["motions"]:
        frames, joints = m["frames"], m["joints"]
        root = np.frombuffer(body, "<f4", frames * 3, m["root"]).reshape(frames, 1, 3)
        around = np.frombuffer(body, "<i2", frames * joints * 3, m["around"]).reshape(frames, joints, 3)
        found.append(root + around * np.float32(m["scale"]))
    return head, found


def contact_marks(figure: Figure, given: object) -> list[tuple[int, np.ndarray]]:
    """Contacts as pairs (joint number, bool [F]).

    given: None; a dict from joint name to bool [F]; a pair (joint names or numbers, bool [F, K]); or, where every joint
    has a column, a bool [F, J] alone.
    """
    if given is None:
        return []
    if isinstance(given, dict):
        return [(_joint(figure, n), _column(figure, v)) for n, v in given.items()]
    names, table = given if isinstance(given, (tuple, list)) and len(given) == 2 else (range(len(figure.names)), given)
    table = _array(table)
    names = list(names)
    if table.ndim != 2 or table.shape != (len(figure.points), len(names)):
        raise MotionKitError(
            f"contacts of {figure.name!r}: expected [{len(figure.points)}, {len(names)}] (frames, joints), found "
            f"{list(table.shape)}; give (joint names, bool tensor [F, K]) or {{joint name: bool tensor [F]}}"
        )
    return [(_joint(figure, n), table[:, k].astype(bool)) for k, n in enumerate(names)]


def _array(values: object) -> np.ndarray:
    return values.detach().cpu().numpy() if hasattr(values, "detach") else np.asarray(values)


def _joint(figure: Figure, name: object) -> int:
    if isinstance(name, str) and name in figure.names:
        return figure.names.index(name)
    if not isinstance(name, str) and 0 <= int(name) < len(figure.names):
        return int(name)
    raise MotionKitError(f"{figure.name!r} has no joint {name!r}; joints: {', '.join(figure.names)}")


def _column(figure: Figure, values: object) -> np.ndarray:
    column = _array(values).astype(bool).reshape(-1)
    if len(column) != len(figure.points):
        raise MotionKitError(f"contacts of {figure.name!r}: expected {len(figure.points)} frames, found {len(column)}")
    return column


def inline(data: bytes) -> str:
    """Bytes as base64 text."""
    return base64.b64encode(data).decode()
