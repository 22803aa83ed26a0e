"""Writing BVH files that other tools read, and that `load` reads back as the same motion."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from . import rotations as rot
from .bvh_angles import compose, decompose, layouts
from .bvh_units import guess_metres_per_unit
from .errors import MotionKitError, motion_inside
from .files import MotionKitWarning, write_atomic
from .motion import Motion
from .skeleton import POSITION_CHANNELS, Skeleton

_SAME_TURN = 1e-5  # radians; a rotation that a joint's own channels give this closely needs no further channel


def save(motion: Motion, path: str | os.PathLike) -> Path:
    """Write a BVH file that other tools read, in the motion's own unit; `load(save(m))` is the motion again.

    Joint names, hierarchy, End Sites, channels and their order, frame rate and unit are kept. A joint gets
    channels that it did not have only where the motion needs them. As braces nest, the file lists joints branch by
    branch, whatever their order in the skeleton. The file is written whole or not at all. Returns the path. Warns
    (MotionKitWarning) where `load` would guess another unit than the motion's. Raises MotionKitError if it cannot
    be written, a joint's name does not fit into a BVH file, or the path does not end in .bvh.

    >>> import tempfile
    >>> from motionkit.bvh import load
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = load(save(load("data/actor/walk_neutral.bvh"), folder + "/again.bvh"))
    >>> len(again)
    120
    """
    if not isinstance(motion, Motion):
        hint = motion_inside(motion)
        raise MotionKitError(f"save(motion, path): expected a Motion first; found {type(motion).__name__}{hint}")
    if isinstance(path, str | os.PathLike) and str(path) and Path(path).suffix.lower() != ".bvh":
        raise MotionKitError(f"{path}: what is written is a BVH file; let its name end in .bvh")
    text = format_bvh(motion)
    unit = motion.metres_per_unit
    guess = guess_metres_per_unit(motion.skeleton, unit)
    if not math.isclose(guess, unit, rel_tol=1e-3):
        warnings.warn(
            f"{path}: one unit of this file is {unit:g} m, but from its size {guess:g} m would be guessed: "
            f"read it with load(..., metres_per_unit={unit:g})",
            MotionKitWarning,
            2,
        )
    return write_atomic(path, text)


def format_bvh(motion: Motion) -> str:
    """The text of a BVH file; see `save`.

    >>> from motionkit.bvh import load
    >>> print(format_bvh(load("data/actor/walk_neutral.bvh")[:1])[:9])
    HIERARCHY
    """
    channels = _writable_channels(motion)
    header = format_header(motion.skeleton, channels, motion.metres_per_unit)
    values = _values(motion, channels)
    broken = (~values.isfinite()).any(1).nonzero()
    if len(broken):
        raise MotionKitError(
            f"motion {motion.name!r}: frame {int(broken[0])} holds numbers that are not finite, which no file can hold"
        )
    rows = values.tolist()
    line = " ".join([f"%.{_decimals(motion)}f"] * sum(map(len, channels)))
    body = "".join(line % tuple(row) + "\n" for row in rows)
    return f"{header}\nMOTION\nFrames: {len(motion)}\nFrame Time: {_frame_time(motion.fps)}\n{body}"


def _values(motion: Motion, channels: list[tuple[str, ...]]) -> Tensor:
    """What the channels hold, float64 [F, C]: degrees, and places in the motion's unit."""
    order = _file_order(motion.skeleton)
    values = torch.empty(len(motion), sum(map(len, channels)), dtype=torch.float64)
    for layout, (members, columns) in layouts([channels[j] for j in order]).items():
        joints = [order[n] for n in members]
        axes = [c[0] for c in layout if c not in POSITION_CHANNELS]
        angles = torch.rad2deg(decompose(motion.rotations[:, joints].double(), axes))
        places = motion.translations[:, joints].double() / motion.metres_per_unit
        parts = [
            places[..., POSITION_CHANNELS.index(c)] if c in POSITION_CHANNELS else angles[..., axes.index(c[0])]
            for c in layout
        ]
        if parts:
            values[:, columns] = torch.stack(parts, -1).flatten(1)
    return values


def _file_order(skeleton: Skeleton) -> list[int]:
    """Joint numbers as nested braces can hold them: a joint's whole branch before its next sibling."""
    order, waiting = [], [0]
    while waiting:
        order.append(waiting.pop())
        waiting.extend(reversed(skeleton.children[order[-1]]))
    return order


def _decimals(motion: Motion) -> int:
    """Six, as most tools write; more where the unit is so large that six would be coarse."""
    size = motion.skeleton.height / motion.metres_per_unit
    return 6 if size >= 0.1 or size <= 0 else min(6 - math.floor(math.log10(size)), 15)


def _frame_time(fps: float) -> str:
    return f"{1 / fps:.9f}" if fps < 1000 else f"{1 / fps:.15f}"


def _writable_channels(motion: Motion) -> list[tuple[str, ...]]:
    """The skeleton's channels, and what this motion needs besides: positions in front, rotations behind."""
    skeleton = motion.skeleton
    drift = (
        (motion.translations - skeleton.offsets).abs().amax(0) if len(motion) else torch.zeros_like(skeleton.offsets)
    )
    adrift = (drift > 1e-5 * skeleton.height).tolist()
    result: list[tuple[str, ...]] = [()] * len(skeleton)
    for names, (joints, _) in layouts(skeleton.channels).items():
        axes = [c[0] for c in names if c not in POSITION_CHANNELS]
        spare = tuple(f"{x}rotation" for x in "ZXY" if x not in axes)
        q = motion.rotations[:, joints].double()
        turned = rot.quaternion_angle(compose(decompose(q, axes), axes), q) > _SAME_TURN
        for joint, more in zip(joints, turned.any(0).tolist(), strict=True):
            places = tuple(c for n, c in enumerate(POSITION_CHANNELS) if c not in names and adrift[joint][n])
            result[joint] = places + names + (spare if more else ())
    if not any(result):  # a file without any channel has nothing to hold its frames
        result[0] = ("Zrotation", "Xrotation", "Yrotation")
    return result


def format_header(skeleton: Skeleton, channels: list[tuple[str, ...]], unit: float = 1.0) -> str:
    """A hierarchy as BVH text, from HIERARCHY to the last closing brace; offsets in units of `unit` metres.

    >>> s = Skeleton(("Hips",), (-1,), torch.tensor([[0.0, 1.0, 0.0]]), end_sites=((0, (0.0, 2.0, 0.0)),))
    >>> print(format_header(s, [("Xrotation",)]))
    HIERARCHY
    ROOT Hips
    {
        OFFSET 0.000000 1.000000 0.000000
        CHANNELS 1 Xrotation
        End Site
        {
            OFFSET 0.000000 2.000000 0.000000
        }
    }
    """
    lines: list[str] = ["HIERARCHY"]
    open_joints: list[int] = []
    offsets = (skeleton.offsets.double() / unit).tolist()
    ends: dict[int, list] = {}
    for joint, offset in skeleton.end_sites:
        ends.setdefault(joint, []).append([x / unit for x in offset])

    def add(*rows: str) -> None:
        lines.extend("    " * min(len(open_joints), 40) + row for row in rows)

    for joint in _file_order(skeleton):
        _close_to(skeleton.parents[joint], open_joints, add)
        add(f"{'JOINT' if joint else 'ROOT'} {_checked_name(skeleton.names[joint])}", "{")
        open_joints.append(joint)
        add(_offset(offsets[joint]), " ".join(("CHANNELS", str(len(channels[joint])), *channels[joint])))
        for offset in ends.get(joint, ()):
            add("End Site", "{", "    " + _offset(offset), "}")
    _close_to(-1, open_joints, add)
    return "\n".join(lines)


def _close_to(parent: int, open_joints: list[int], add: Callable[[str], None]) -> None:
    while open_joints and open_joints[-1] != parent:
        open_joints.pop()
        add("}")


def _offset(offset: list[float]) -> str:
    """An OFFSET line; at least seven digits, however small the number."""
    size = max(map(abs, offset))
    decimals = 6 if size >= 0.1 or size == 0 else min(6 - math.floor(math.log10(size)), 15)
    return "OFFSET " + " ".join(f"{x:.{decimals}f}" for x in offset)


def _checked_name(name: str) -> str:
    fits = name and name == name.strip() and not set(name) & set("{}\r\n")
    try:
        name.encode()
    except UnicodeEncodeError:
        fits = False
    if not fits:
        raise MotionKitError(
            f"joint name {name!r} does not fit into a BVH file; expected a text without braces, line ends and "
            "outer spaces: give the skeleton other names"
        )
    return name
