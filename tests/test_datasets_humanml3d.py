"""The reader of HumanML3D's files: small ones in its format, whole and broken."""

import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from small_files import fails, write, zipped

import motionkit as mk
from motionkit.datasets import captures

pytestmark = pytest.mark.usefixtures("nothing_set")


@pytest.fixture(scope="module")
def features() -> np.ndarray:
    x = mk.features.HumanML3D().encode(mk.load("data/actor/walk_neutral.bvh").resample(20))
    return x[:-1].numpy()


@pytest.fixture
def human(root, features) -> Path:
    def npy(x) -> bytes:
        path = root / "x.npy"
        np.save(path, x)
        data = path.read_bytes()
        path.unlink()
        return data

    texts = "a man walks.#a/DET man/NOUN walk/VERB#0.0#0.0\na person strolls.#a/DET#nan#nan\n"
    part = "he steps.#he/PRON step/VERB#0.5#1.25\nlater he flies.#he/PRON#900.0#901.0\nhe waits.#he/PRON#2.0#1.0\n"
    write(root, {f"texts/{name}.txt": texts for name in ("000000", "M000000", "007975")})
    write(root, {"texts/000001.txt": part, "new_joints/000000.npy": npy(np.zeros((5, 22, 3)))})
    write(root, {"train.txt": "000000\nM000000\n", "val.txt": "000001\n", "test.txt": "\n", "all.txt": "000000\n"})
    names = ("000000", "M000000", "000001", "007975")
    return write(root, {f"new_joint_vecs/{name}.npy": npy(features.astype(np.float64)) for name in names})


def test_humanml3d(human, features, tmp_path):
    for place in (human, zipped(human, tmp_path / "h.zip")):
        items = {item.name: item for item in captures.humanml3d_items(root=place)}
        assert list(items) == ["000000", "000001@0.5-1.25", "M000000"]
        whole, part, mirror = (item.labels for item in items.values())
        assert whole.texts == ("a man walks.", "a person strolls.") and part.texts == ("he steps.",)
        assert whole.take == mirror.take == "000000" and part.take == "000001"
        assert (whole.split, part.split, mirror.split) == ("train", "validation", "train")
        assert whole[:2] == ("", "")
        read = items["000000"].source.read()
        assert len(read.motion) == len(features) and read.motion.fps == 20 and read.motion.name == "000000"
        assert read.tracks["contacts"].shape == (len(features), 4)
        cut = items["000001@0.5-1.25"].source.read()
        assert torch.equal(cut.motion.rotations, read.motion.rotations[10:25])
        assert torch.equal(cut.tracks["contacts"], read.tracks["contacts"][10:25])
    places = mk.features.HumanML3D(fps=20).positions(torch.from_numpy(features))
    assert (read.motion.positions() - places).norm(dim=-1).mean() < 0.02
    assert len(mk.datasets.load("humanml3d", human)) == 3


def test_humanml3d_lists_that_name_more_than_is_there(human):
    write(human, {"test.txt": "000123\n000124\n007975\n"})
    with pytest.warns(mk.MotionKitWarning, match="2 of 6 listed motions are not beside it, such as 000123"):
        assert len(captures.humanml3d_items(root=human)) == 3
    write(human, {"test.txt": "000000\n"})
    with warnings.catch_warnings(), fails("(train|test).txt: 000000 is in the list for (train|test) too"):
        captures.humanml3d_items(root=human)


@pytest.mark.parametrize(
    "text, message",
    [
        (None, "000001.npy: no captions for it; expected texts/000001.txt"),
        ("", "000001.txt: no caption in it"),
        ("a man walks.\n", "000001.txt, line 1: expected caption#tokens#start#end"),
        ("\na man#a/DET#0.0#soon\n", "000001.txt, line 2: expected caption#tokens#start#end"),
        ("#a/DET#0.0#0.0\n", "line 1: expected caption"),
        ("a man#a/DET#-1.0#2.0\n", "line 1: expected caption"),
    ],
)
def test_humanml3d_captions_that_are_broken(human, text, message):
    path = human / "texts" / "000001.txt"
    path.unlink() if text is None else path.write_text(text)
    with fails(message):
        captures.humanml3d_items(root=human)


@pytest.mark.parametrize(
    "array, message",
    [
        (np.zeros((5, 22, 3)), r"expected floating-point numbers \[frames, 263\].*found float64 \[5, 22, 3\]"),
        (np.zeros((0, 263), np.float32), r"found float32 \[0, 263\]"),
        (np.zeros((5, 263), np.int64), r"found int64 \[5, 263\]"),
        (np.array([{}], object), "not a whole .npy file"),
        (np.where(np.arange(526).reshape(2, 263) == 300, np.nan, 0.0), "frame 1, number 37 is nan"),
    ],
)
def test_humanml3d_numbers_that_are_broken(human, array, message):
    np.save(human / "new_joint_vecs" / "000000.npy", array)
    with fails(f"000000.npy: .*{message}"):
        captures.humanml3d_items(root=human)[0].source.read()


def test_humanml3d_files_cut_short(human):
    for name in ("000000", "000001"):
        path = human / "new_joint_vecs" / f"{name}.npy"
        path.write_bytes(path.read_bytes()[: 1000 if name == "000000" else 9])
    with fails("000001.npy: not a whole .npy file"):
        captures.humanml3d_items(root=human)
    write(human, {"texts/000001.txt": "he walks.#he/PRON#0.0#0.0\n"})
    with fails("000000.npy: not a whole .npy file"):
        captures.humanml3d_items(root=human)[0].source.read()


def test_humanml3d_positions_are_not_features(human):
    for path in (human / "new_joint_vecs").iterdir():
        path.unlink()
    with fails("new_joints/000000.npy: motions, but none in a folder new_joint_vecs"):
        captures.humanml3d_items(root=human)
