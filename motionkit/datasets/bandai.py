"""Bandai-Namco-Research-Motiondataset: where its clips are, and what their names and labels say.

Licence of the data: CC BY-NC 4.0, (c) Bandai Namco Research Inc. Cite Kobayashi et al. 2023, "Motion Capture
Dataset for Practical Use of AI-based Motion Editing and Stylization".
"""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path

from ..errors import MotionKitError
from .dataset import Labels
from .store import Source

FILE_PREFIXES = {"bandai-1": "dataset-1", "bandai-2": "dataset-2"}
_ADDRESS = "https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset"
_DOING = {
    "bow": "bowing",
    "bye": "waving goodbye",
    "byebye": "waving goodbye",
    "call": "calling someone over",
    "dance-long": "dancing",
    "dance-short": "dancing",
    "dash": "dashing",
    "guide": "showing the way",
    "kick": "kicking",
    "punch": "punching",
    "respond": "responding",
    "run": "running",
    "slash": "slashing with a sword",
    "walk": "walking",
    "walk-back": "walking backwards",
    "walk-left": "walking to the left",
    "walk-right": "walking to the right",
    "walk-turn-left": "walking and turning left",
    "walk-turn-right": "walking and turning right",
}


def how_to_get(name: str) -> str:
    """What to do when the data are not there."""
    return (
        f"get {name} with `git clone {_ADDRESS}` or as the zip from there (licence CC BY-NC 4.0), then give "
        f"datasets.load({name!r}, root=FOLDER_OR_ZIP) or set MOTIONKIT_DATA to that folder or zip"
    )


def labels(clip: str) -> Labels:
    """Content, style and a sentence from a clip's name.

    >>> labels("dataset-2_wave-left-hand_elderly_001")
    Labels(content='wave-left-hand', style='elderly', text='a person is waving the left hand in an elderly
    style')
    """
    content, style = clip.split("_")[1:3]
    article = "an" if style[0] in "aeiou" else "a"
    return Labels(content, style, f"a person is {_doing(content)} in {article} {style} style")


def _doing(content: str) -> str:
    match = re.fullmatch(r"(wave|raise-up)-(both|left|right)-hands?", content)
    if match is None:
        return _DOING.get(content, f"doing {content.replace('-', ' ')}")
    verb = {"wave": "waving", "raise-up": "raising"}[match[1]]
    return f"{verb} both hands" if match[2] == "both" else f"{verb} the {match[2]} hand"


def find(name: str, root: str | os.PathLike | None) -> list[Source]:
    """The clips of a dataset below a folder, in a zip, or in a zip in the folder; sorted by name."""
    given = root if root is not None else os.environ.get("MOTIONKIT_DATA")
    if not given:
        raise MotionKitError(f"where is {name}? No root is given and MOTIONKIT_DATA is not set; {how_to_get(name)}")
    place = Path(given).expanduser()
    if not place.exists():
        raise MotionKitError(f"{place}: no such file or folder; {how_to_get(name)}")
    if place.is_dir():
        found = _unique(_in_folder(name, place)) or next(
            filter(None, (_unique(_in_zip(name, path)) for path in sorted(place.glob("*.zip")))), []
        )
    else:
        found = _unique(_in_zip(name, place))
    if not found:
        pattern = f"{FILE_PREFIXES[name]}_CONTENT_STYLE_NNN.bvh"
        raise MotionKitError(f"{place}: no clips of {name} here ({pattern}); {how_to_get(name)}")
    return found


def _pattern(name: str) -> re.Pattern:
    return re.compile(re.escape(FILE_PREFIXES[name]) + r"_[^_/\\]+_[^_/\\]+_\d+\.bvh")


def _unique(sources: Iterable[Source]) -> list[Source]:
    """One of each name (the data may lie there twice), in the order of names."""
    found: dict[str, Source] = {}
    for source in sorted(sources, key=lambda s: (s.name, s.path)):
        found.setdefault(source.name, source)
    return list(found.values())


def _in_folder(name: str, folder: Path) -> Iterable[Source]:
    pattern = _pattern(name)
    for path in folder.rglob(f"{FILE_PREFIXES[name]}_*.bvh"):
        if pattern.fullmatch(path.name) and path.is_file():
            state = path.stat()
            yield Source(path.stem, str(path), None, state.st_size, state.st_mtime_ns)


def _in_zip(name: str, path: Path) -> Iterable[Source]:
    pattern = _pattern(name)
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (OSError, zipfile.BadZipFile) as error:
        raise MotionKitError(
            f"{path}: neither a folder nor a whole zip archive ({error}); {how_to_get(name)}"
        ) from None
    for member in members:
        file = member.filename.rsplit("/", 1)[-1]
        if pattern.fullmatch(file):
            yield Source(file[: -len(".bvh")], str(path), member.filename, member.file_size, member.CRC)
