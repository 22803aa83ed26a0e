"""BVH files: text to `Motion`.

What files in the wild do, and what the reader makes of it: any joint may have position channels, and they
stand in place of its offset, frame by frame; channels come in any order and number; names may hold spaces and
colons; lines may be wrapped, and end in any way; `Frames:` may disagree with the data, which then counts
(with a warning).
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import torch

from .bvh_angles import compose, layouts
from .bvh_data import line_at, read_data
from .bvh_header import Header, parse_header
from .bvh_units import guess_metres_per_unit
from .bvh_write import format_bvh, save
from .errors import MotionKitError
from .files import MotionKitWarning, read_bytes
from .motion import Motion
from .skeleton import POSITION_CHANNELS, Skeleton

__all__ = ["MotionKitWarning", "format_bvh", "guess_metres_per_unit", "load", "parse", "save"]

_MOTION = re.compile(rb"(?:^|\})[ \t]*(MOTION)(?=\s|$)", re.MULTILINE | re.IGNORECASE)


def load(path: str | os.PathLike, metres_per_unit: float | None = None, fps: float | None = None) -> Motion:
    """Read a BVH file.

    path: the file. metres_per_unit: the length of one unit of the file in metres (0.01 for centimetres). No
    BVH file states it; left out, it is guessed from the skeleton's size: up to 5 units tall is metres, up to
    45 the unit of the CMU captures (0.056444 m), up to 450 centimetres, above that millimetres. fps: a frame
    rate in place of the file's own. Returns a `Motion`. Warns (MotionKitWarning) where `Frames:` disagrees
    with the data. Raises MotionKitError naming file and line.

    >>> m = load("data/actor/walk_neutral.bvh")
    >>> m.fps, m.skeleton.names[0]
    (30.0, 'pelvis')
    """
    return parse(read_bytes(path), os.fspath(path), metres_per_unit, fps)


def parse(
    data: bytes, source: str = "<bytes>", metres_per_unit: float | None = None, fps: float | None = None
) -> Motion:
    """The text of a BVH file as bytes to a `Motion`; `source` is what errors call it. See `load`.

    >>> text = "HIERARCHY ROOT a { OFFSET 0 1 0 CHANNELS 1 Yrotation } MOTION Frames: 1 Frame Time: 0.5 90"
    >>> parse(text.encode()).rotations[0, 0]
    tensor([0.7071, 0.0000, 0.7071, 0.0000])
    """
    _check_argument("metres_per_unit", metres_per_unit, source)
    _check_argument("fps", fps, source)
    data = _plain_text(data, source)
    cut = _MOTION.search(data)
    if cut is None:
        parse_header(_decode(data[:1_000_000]), source)  # most often the header says more exactly what is wrong
        line = line_at(data, len(data))
        raise MotionKitError(f"{source}, line {line}: no line says MOTION; the file is cut off or holds no motion")
    header = parse_header(_decode(data[: cut.start(1)]), source)
    values, rate = read_data(data, cut.end(), header, source, fps)
    return _to_motion(header, values, metres_per_unit, rate, Path(source).stem)


def _check_argument(what: str, value: float | None, source: str) -> None:
    try:
        fine = value is None or 0 < float(value) < 1e6
    except (TypeError, ValueError):
        fine = False
    if not fine:
        raise MotionKitError(f"{source}: {what} must be a number above 0; found {value!r}")


def _plain_text(data: bytes, source: str) -> bytes:
    """The bytes without UTF-16, which some Windows tools write, and with ends of lines that `^` knows."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            data = data.decode("utf-16").encode()
        except UnicodeError:
            raise MotionKitError(f"{source}, line 1: neither text nor UTF-16; this is no BVH file") from None
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _to_motion(header: Header, values: np.ndarray, scale: float | None, fps: float, name: str) -> Motion:
    names, parents, channels = tuple(header.names), tuple(header.parents), tuple(header.channels)
    offsets = torch.tensor(header.offsets, dtype=torch.float64)
    skeleton = Skeleton(names, parents, offsets.float(), channels, tuple(header.end_sites))
    unit = guess_metres_per_unit(skeleton) if scale is None else float(scale)
    if unit != 1.0:
        ends = tuple((j, tuple(x * unit for x in offset)) for j, offset in header.end_sites)
        skeleton = Skeleton(names, parents, (offsets * unit).float(), channels, ends, skeleton.twins)
    frames, joints = len(values), len(names)
    rotations = torch.empty(frames, joints, 4)
    translations = skeleton.offsets.expand(frames, -1, -1).clone()
    groups = layouts(channels)
    for layout, (members, columns) in groups.items():
        count = len(members)
        if len(groups) == 1:  # every joint alike, as in many captures: views instead of copies
            members = columns = slice(None)
        block = torch.from_numpy(values[:, columns].reshape(frames, count, len(layout)))
        turns = [n for n, c in enumerate(layout) if c not in POSITION_CHANNELS]
        for n, channel in enumerate(layout):
            if channel in POSITION_CHANNELS:
                translations[:, members, POSITION_CHANNELS.index(channel)] = (block[:, :, n] * unit).float()
        angles = torch.deg2rad(block[:, :, turns])
        rotations[:, members] = compose(angles, [layout[n][0] for n in turns]).float()
    return Motion(skeleton, rotations, translations, fps, name, unit)
