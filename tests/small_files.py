"""What the tests of dataset readers share: small files, folders and zips of them."""

import zipfile
from pathlib import Path

import pytest
from test_bvh import CHAIN, STILL

import motionkit as mk


def write(root: Path, files: dict[str, str | bytes]) -> Path:
    for place, content in files.items():
        path = root / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return root


def zipped(root: Path, path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(p for p in root.rglob("*") if p.is_file()):
            archive.write(file, file.relative_to(root.parent))
    return path


def chain(frames: int) -> str:
    """CHAIN with so many frames, in which the root's X counts them (in the file's unit)."""
    head = CHAIN.split("Frames:")[0]
    rows = (STILL.replace("0", str(n), 1) for n in range(frames))
    return f"{head}Frames: {frames}\nFrame Time: 0.01666667\n" + "\n".join(rows) + "\n"


def fails(message: str):
    return pytest.raises(mk.MotionKitError, match=message)
