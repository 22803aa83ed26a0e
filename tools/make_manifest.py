"""Write what a data set's archive holds, for `mk.datasets.fetch` to check downloads against.

    python tools/make_manifest.py ARCHIVE.zip

Takes the archive of Bandai-Namco-Research-Motiondataset at the commit below; writes the same bytes for the same files.
"""

import gzip
import hashlib
import json
import re
import sys
import zipfile
from pathlib import Path

COMMIT = "74ead3ba1ae4696404e6086233779f60de8bf9ef"
REPOSITORY = "https://github.com/BandaiNamcoResearchInc/Bandai-Namco-Research-Motiondataset"
FOLDER = "dataset/Bandai-Namco-Research-Motiondataset-2"
KEPT = re.compile(r"LICENSE|cfg/\w+\.txt|data/dataset-2_[^/]+\.(bvh|json)")  # what the kit reads; no pictures, no pages
OUT = Path(__file__).resolve().parent.parent / "motionkit" / "datasets" / "manifests" / "bandai-2.json.gz"
ABOUT = {
    "licence": "CC BY-NC 4.0",
    "terms": "you may share and change it with attribution, and not for commercial purposes; treat weights that you "
    "train on it the same way. The full text lies beside the data (LICENSE).",
    "owner": "(c) 2022 Bandai Namco Research Inc.",
    "cite": "Kobayashi et al. 2023, Motion Capture Dataset for Practical Use of AI-based Motion Editing and "
    "Stylization, arXiv:2306.08861",
    "repository": REPOSITORY,
    "commit": COMMIT,
}


def files_in(archive: Path) -> dict[str, tuple[int, str]]:
    """For each kept file its size and SHA-256, sorted by path."""
    found = {}
    with zipfile.ZipFile(archive) as opened:
        for member in opened.infolist():
            place = member.filename.partition(f"/{FOLDER}/")[2]
            if KEPT.fullmatch(place):
                data = opened.read(member)
                found[place] = (len(data), hashlib.sha256(data).hexdigest())
    return dict(sorted(found.items()))


def main(archive: str) -> None:
    """Write the manifest and say what it holds."""
    files = files_in(Path(archive))
    told = {
        "name": "bandai-2",
        "address": f"{REPOSITORY}/archive/{COMMIT}.zip",
        "folder": FOLDER,
        "about": ABOUT,
        "files": files,
    }
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_bytes(gzip.compress(json.dumps(told, separators=(",", ":")).encode(), 9, mtime=0))
    print(f"{OUT.name}: {len(files)} files, {OUT.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(*sys.argv[1:])
