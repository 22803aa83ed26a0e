"""What tests share: where the real captures are, and Hypothesis settings for slow, shared machines."""

import os
import zipfile
from pathlib import Path

import pytest
from hypothesis import settings

import motionkit as mk

ROOT = Path(__file__).resolve().parent.parent
ARCHIVE = "Bandai-Namco-Research-Motiondataset-74ead3b.zip"
CONTENTS = ("walk", "raise-up-both-hands")
STYLES = ("normal", "elderly", "active")

settings.register_profile("motionkit", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("motionkit")


@pytest.fixture(scope="session")
def captures() -> Path:
    """The archive of real captures; skips where there is none."""
    folder = Path(os.environ.get("MOTIONKIT_DATA") or ROOT.parent / "shared" / "datasets")
    if not (folder / ARCHIVE).is_file():
        pytest.skip(f"no captures: {ARCHIVE} is not in MOTIONKIT_DATA (or ../shared/datasets)")
    return folder / ARCHIVE


@pytest.fixture(scope="session")
def captures_dir(captures: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of 18 real clips (`dataset-2_walk_normal_001.bvh`, ...): 2 contents, 3 styles, 3 takes."""
    wanted = {
        f"dataset-2_{content}_{style}_{take:03d}.bvh" for content in CONTENTS for style in STYLES for take in (1, 2, 3)
    }
    folder = tmp_path_factory.mktemp("captures")
    with zipfile.ZipFile(captures) as archive:
        for member in archive.namelist():
            name = member.rsplit("/", 1)[-1]
            if name in wanted:
                (folder / name).write_bytes(archive.read(member))
    assert {path.name for path in folder.iterdir()} == wanted
    return folder


@pytest.fixture
def nothing_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of the test's own, and no captures named."""
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("MOTIONKIT_DATA", raising=False)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """An empty folder for a test to put clips in."""
    (tmp_path / "data").mkdir()
    return tmp_path / "data"


@pytest.fixture(scope="session")
def walk():
    """The performer's neutral walk."""
    return mk.load(ROOT / "data" / "actor" / "walk_neutral.bvh")


@pytest.fixture(scope="session")
def proud():
    """The performer's proud walk."""
    return mk.load(ROOT / "data" / "actor" / "walk_proud.bvh")
