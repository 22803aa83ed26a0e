"""HumanML3D as it is published (Guo et al. 2022): 263 numbers a frame in .npy files, captions in .txt files, 20 fps.

`new_joint_vecs/NAME.npy` holds [F, 263], `texts/NAME.txt` a line `caption#tokens#start#end` for each caption, and
train.txt, val.txt and test.txt list names. A name with an M in front is the mirror image of the one without.
"""

from __future__ import annotations

import io
import math
import os
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np
import torch

from ..errors import MotionKitError
from ..features import HumanML3D
from ..files import MotionKitWarning
from .places import File, Wanted, find, heads, texts, unique
from .sources import BvhSource, Item, Labels, Recording

FPS = 20.0
_BROKEN = ("007975", "M007975")  # known for NaNs; the data set's own statistics skip them too
WHOLE = (0.0, 0.0)  # what the files write for a caption of the whole motion
_SIZE = 263
_SPLITS = {"train.txt": "train", "val.txt": "validation", "test.txt": "test"}

_WANTED = Wanted(
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
        layout = HumanML3D(fps=FPS)
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


def items(name: str = "humanml3d", root: str | os.PathLike | None = None) -> list[Item]:
    """The motions with their captions, sorted by name. Content and style are empty: nobody labelled them.

    root: a folder with new_joint_vecs and texts somewhere below it, or a zip; see `places.find`. A caption of a part
    (its start and end, in seconds, are not both 0) gives an item of its own, cut to that part and named
    NAME@START-END; one of a part without frames is passed over, as the data set's own loader does. The take is the
    name without the M of mirror images, so that a split keeps a motion with its image. The split is that of the lists,
    where they are; what they list and is not there is told of in one warning, as not everybody has all of AMASS.
    Raises MotionKitError for a motion without captions, a line that is no caption, and a name in two lists.

    >>> items(root="data")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: data: no clips of humanml3d here (new_joint_vecs/NNNNNN.npy with ...
    """
    files = find(_WANTED, root)
    motions = [m for m in unique(_in_folder(files, "new_joint_vecs", ".npy")) if m.stem not in _BROKEN]
    if not motions:
        raise MotionKitError(f"{files[0].where}: motions, but none in a folder new_joint_vecs; {_WANTED.how}")
    captions = {f.stem: f for f in unique(_in_folder(files, "texts", ".txt"))}
    splits = _splits(f for f in files if f.name in _SPLITS)
    _warn_of_missing(splits, {m.stem for m in motions}.union(_BROKEN), motions[0])
    lacking = next((m for m in motions if m.stem not in captions), None)
    if lacking:
        raise MotionKitError(
            f"{lacking.where}: no captions for it; expected texts/{lacking.stem}.txt; unpack texts.zip"
        )
    told = {file.stem: read_captions(file, text) for file, text in texts(captions[m.stem] for m in motions)}
    frames = {f.stem: _frames(f, head) for f, head in heads((m for m in motions if set(told[m.stem]) - {WHOLE}), 256)}
    found = [item for m in motions for item in _parts(m, told[m.stem], splits.get(m.stem, ""), frames.get(m.stem, 0))]
    return sorted(found, key=lambda item: item.name)


def _parts(file: File, told: dict[tuple[float, float], tuple[str, ...]], split: str, frames: int) -> Iterable[Item]:
    """The whole motion and the parts that have captions of their own; frames: of the file, where there are such."""
    for (start, stop), sentences in told.items():
        part, cut = "", (0, None)
        if (start, stop) != WHOLE:
            part, cut = f"@{start:g}-{stop:g}", (int(start * FPS), int(stop * FPS))
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
    for file, text in texts(files):
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

    >>> file = File("texts/000001.txt", "000001.txt", None, 0, 0)
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
