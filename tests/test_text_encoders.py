"""What every text encoder promises, vectors kept on disk, and the check of prompts."""

import subprocess
import sys
import warnings

import pytest
import torch
from safetensors.torch import load_file, save_file

import motionkit as mk
from motionkit.text import TextEncoder, check_prompt, content_key, load, similarity
from motionkit.text.encoders import CachedEncoder

SENTENCES = ["a person walks", "somebody runs in old age", "a", "a person walks", "an angry person kicks twice"]


class Padded(TextEncoder):
    """Letters through a network that sees padding, as real ones do; tells what it was asked."""

    def __init__(self, seed: int = 0, batch: int = 64) -> None:
        self.name, self.size, self.batch, self.asked = "padded", 8, batch, []
        self.weight = torch.randn(64, 8, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
        self.weight.requires_grad_()
        self.key = content_key({"weight": self.weight})

    def embed(self, texts):
        assert len(texts) <= self.batch and not torch.is_grad_enabled()
        self.asked += texts
        letters = torch.zeros(len(texts), max(map(len, texts)), 64, dtype=torch.float64)
        for n, text in enumerate(texts):
            for at, letter in enumerate(text.encode()):
                letters[n, at, letter % 64] = 1
        return (letters @ self.weight).sum(1)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "text"


@pytest.mark.parametrize("batch", [1, 2, 64])
def test_encode_gives_back_each_sentence_in_its_place(batch):
    encoder = Padded(batch=batch)
    found = encoder.encode(SENTENCES)
    assert found.shape == (5, 8) and found.dtype == torch.float32 and not found.requires_grad
    alone = torch.cat([encoder.encode([text]) for text in SENTENCES])
    torch.testing.assert_close(found, alone, rtol=0, atol=1e-5)
    assert found[0].equal(found[3]) and not torch.allclose(found[0], found[1])
    assert encoder.asked.count("a person walks") == 3  # once together, and twice alone
    assert encoder.encode([]).shape == (0, 8)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["a person walks", ""], r"texts\[1\]: the sentence is empty; say what"),
        ([" \n\t"], r"texts\[0\]: the sentence is empty"),
        (["a", None], r"texts\[1\]: expected a sentence; found None"),
        ("a person walks", r"texts: expected a list of sentences; found 'a person walks'; put one"),
        (3, "texts: expected a list of sentences; found 3"),
    ],
)
def test_bad_sentences(texts, message, folder):
    for encoder in (Padded(), CachedEncoder(Padded())):
        with pytest.raises(mk.MotionKitError, match=message):
            encoder.encode(texts)


def test_vectors_that_are_not_finite():
    class Broken(Padded):
        def embed(self, texts):
            return torch.where(torch.tensor([["z" in text] for text in texts]), torch.nan, super().embed(texts))

    assert Broken().encode(["a person"]).isfinite().all()
    with pytest.raises(mk.MotionKitError, match="'padded': the vector of 'a zombie' is not finite; get its files"):
        Broken().encode(["a person", "a zombie"])


def test_key_is_of_the_content():
    weights = {"b": torch.ones(2), "a": torch.arange(3)}
    here = content_key(weights, "tokens")
    assert len(here) == 64 and here == content_key({"a": torch.arange(3), "b": torch.ones(2)}, "tokens")
    others = [
        content_key({**weights, "b": torch.ones(2, 1)}, "tokens"),
        content_key({**weights, "b": torch.ones(2).double()}, "tokens"),
        content_key({**weights, "b": torch.tensor([1.0, 1.0000001])}, "tokens"),
        content_key({"b": torch.ones(2), "c": torch.arange(3)}, "tokens"),
        content_key(weights, "token", "s"),
        content_key(weights),
    ]
    assert len({here, *others}) == 7
    assert content_key({"w": torch.ones(2, dtype=torch.bfloat16), "empty": torch.empty(0), "one": torch.tensor(1.0)})


def test_similarity_is_the_cosine():
    a, b = torch.randn(4, 6), torch.randn(3, 6)
    expected = torch.nn.functional.cosine_similarity(a[:, None], b[None], dim=-1)
    torch.testing.assert_close(similarity(a, b), expected)
    torch.testing.assert_close(similarity(3 * a, a).diagonal(), torch.ones(4))
    with pytest.raises(mk.MotionKitError, match=r"of one encoder; found \[4, 6\] and \[3, 5\]"):
        similarity(a, b[:, :5])


def test_prompts_far_from_anything_known():
    encoder, known = Padded(), ["a person walks", "a person kicks"]
    vectors = encoder.encode(known)
    assert check_prompt("a person kicks", encoder, known, vectors, 0.99) == pytest.approx(1, abs=1e-5)
    near = similarity(encoder.encode(["qqq"]), vectors)[0]
    nearest = known[int(near.argmax())]
    with pytest.warns(mk.MotionKitWarning, match=f"'qqq' is far.*similarity {near.max():.2f}.*'{nearest}'.*0.99"):
        assert check_prompt("qqq", encoder, known, vectors, 0.99) == pytest.approx(float(near.max()), abs=1e-5)
    assert check_prompt("qqq", encoder, known, vectors, -1.0) < 0.99
    for prompt in ("", "  ", None):
        with pytest.raises(mk.MotionKitError, match="the prompt is empty"):
            check_prompt(prompt, encoder, known, vectors, 0.5)
    for wrong in ([], ["one"]):
        with pytest.raises(mk.MotionKitError, match="a vector for each; found"):
            check_prompt("a", encoder, wrong, vectors[: 2 * len(wrong)], 0.5)


def test_remembered_asks_once_and_keeps_it_on_disk(folder):
    encoder = Padded()
    kept = CachedEncoder(encoder)
    assert (kept.name, kept.size, kept.key) == ("padded", 8, encoder.key)
    first = kept.encode(SENTENCES)
    assert first.equal(Padded().encode(SENTENCES)) and sorted(encoder.asked) == sorted(set(SENTENCES))
    assert kept.encode(SENTENCES[::-1]).equal(first.flip(0)) and len(encoder.asked) == 4
    assert [path.name for path in folder.iterdir()] == [f"{encoder.key}.safetensors"]

    class Idle(Padded):
        def embed(self, texts):
            raise AssertionError(f"asked again: {texts}")

    again = CachedEncoder(Idle())
    assert again.encode(SENTENCES[:2]).equal(first[:2]) and again.encode([]).shape == (0, 8)
    other = Padded(seed=1)
    assert not CachedEncoder(other).encode(SENTENCES).allclose(first) and len(other.asked) == 4
    assert len(list(folder.iterdir())) == 2


def damage(path, how):
    data = bytearray(path.read_bytes())
    if how == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif how == "empty":
        path.write_bytes(b"")
    elif how == "bit":
        data[-1] ^= 4
        path.write_bytes(data)
    elif how == "other":
        save_file({"vectors": torch.zeros(1, 8)}, path)
    elif how == "size":
        save_file({**load_file(path), "vectors": torch.zeros(4, 5)}, path)


@pytest.mark.parametrize("how", ["cut", "empty", "bit", "other", "size"])
def test_damaged_caches_are_made_anew(folder, how):
    first = CachedEncoder(Padded()).encode(SENTENCES)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    damage(path, how)
    assert path.read_bytes() != whole
    encoder = Padded()
    assert CachedEncoder(encoder).encode(SENTENCES).equal(first) and len(encoder.asked) == 4
    assert path.read_bytes() == whole


def test_two_at_once_lose_nothing_that_was_written(folder):
    one, two = CachedEncoder(Padded()), CachedEncoder(Padded())
    one.encode(["a"])
    two.encode(["b"])
    one.encode(["c"])
    third = Padded()
    CachedEncoder(third).encode(["a", "b", "c"])
    assert third.asked == []


def test_two_processes_share_a_cache(folder):
    code = """
import sys, torch
from motionkit.text import CachedEncoder, TextEncoder
class Lengths(TextEncoder):
    name, size, key, batch = "lengths", 2, "k" * 64, 1
    def embed(self, texts):
        return torch.tensor([[float(len(t)), float(ord(t[0]))] for t in texts])
kept = CachedEncoder(Lengths())
for n in range(40):
    text = sys.argv[1] * (n + 1)
    assert kept.encode([text]).tolist() == [[float(len(text)), float(ord(text[0]))]]
"""
    running = [subprocess.Popen([sys.executable, "-c", code, letter]) for letter in "ab"]
    assert [one.wait(120) for one in running] == [0, 0]
    found = load_file(next(folder.glob("*.safetensors")))
    assert len(found["hashes"]) >= 40 and [p.name for p in folder.iterdir()] == ["k" * 64 + ".safetensors"]


def test_a_cache_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("no folder")
    kept = CachedEncoder(Padded(), tmp_path / "file" / "below")
    with pytest.warns(mk.MotionKitWarning, match="not kept on disk.*MOTIONKIT_CACHE"):
        first = kept.encode(["a"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert kept.encode(["a"]).equal(first) and kept.encode(["b"]).shape == (1, 8)


@pytest.mark.parametrize("name", ["bert", "clip", "clip:", "mini:x", "", None, 3])
def test_unknown_names(name):
    with pytest.raises(mk.MotionKitError, match="no text encoder .*expected 'mini', 'sentence-transformers:"):
        load(name)
