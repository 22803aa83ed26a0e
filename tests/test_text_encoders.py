"""Text encoders: what each promises, vectors kept on disk, the check of prompts; other people's, on tiny models."""

import json
import logging
import string
import subprocess
import sys
import warnings

import pytest
import torch
from safetensors.torch import load_file, save_file

import motionkit as mk
from motionkit.text import TextEncoder, check_prompt, content_key, encoders, load, similarity
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


@pytest.mark.slow
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


transformers = pytest.importorskip("transformers", reason="pip install -e .[text]", exc_type=ImportError)
LETTERS = string.ascii_lowercase
TEXTS = ["a person walks", "a person walks in old age and then waves", "a", "somebody kicks"]


def save_clip(folder, seed=0, whole=False):
    """A CLIP text tower, or a whole CLIP, with a BPE tokenizer of letters and one long word."""
    folder.mkdir(parents=True, exist_ok=True)
    words = [*LETTERS, *(f"{c}</w>" for c in LETTERS), "wa", "wal", "walk", "walks</w>"]
    words += ["<|startoftext|>", "<|endoftext|>"]
    (folder / "vocab.json").write_text(json.dumps({word: n for n, word in enumerate(words)}))
    (folder / "merges.txt").write_text("#version: 0.2\nw a\nwa l\nwal k\nwalk s</w>\n")
    text = {
        "vocab_size": len(words), "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2,
        "num_attention_heads": 2, "projection_dim": 16, "max_position_embeddings": 48,
        "bos_token_id": len(words) - 2, "eos_token_id": len(words) - 1,
    }  # fmt: skip
    torch.manual_seed(seed)
    if whole:
        vision = {
            "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 2,
            "image_size": 16, "patch_size": 8, "projection_dim": 16,
        }  # fmt: skip
        config = transformers.CLIPConfig(text_config=text, vision_config=vision, projection_dim=16)
        model = transformers.CLIPModel(config)
    else:
        model = transformers.CLIPTextModelWithProjection(transformers.CLIPTextConfig(**text))
    model.save_pretrained(folder)
    transformers.CLIPTokenizer.from_pretrained(folder).save_pretrained(folder)
    return folder


def save_bert(folder, seed=0):
    """A BERT with a WordPiece tokenizer of a few words and all letters."""
    folder.mkdir(parents=True, exist_ok=True)
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", "person", "walks", "old", "age"]
    words += [*LETTERS, *(f"##{c}" for c in LETTERS)]
    (folder / "vocab.txt").write_text("\n".join(words) + "\n")
    transformers.BertTokenizer(str(folder / "vocab.txt")).save_pretrained(folder)
    torch.manual_seed(seed)
    config = transformers.BertConfig(
        vocab_size=len(words), hidden_size=32, intermediate_size=64, num_hidden_layers=2, num_attention_heads=2,
        max_position_embeddings=48,
    )  # fmt: skip
    transformers.BertModel(config).save_pretrained(folder)
    return folder


def save_sentence_transformer(folder, seed=0):
    """The same with mean pooling, saved by sentence-transformers itself."""
    package = pytest.importorskip("sentence_transformers", reason="pip install -e .[text]", exc_type=ImportError)
    bert = save_bert(folder.with_name(folder.name + "-bert"), seed)
    package.SentenceTransformer(str(bert), device="cpu", local_files_only=True).save(str(folder))
    return folder


KINDS = {"clip": save_clip, "sentence-transformers": save_sentence_transformer}


@pytest.fixture(scope="module", params=KINDS)
def saved(request, tmp_path_factory):
    """Name of a tiny model on disk."""
    folder = KINDS[request.param](tmp_path_factory.mktemp("models") / request.param)
    return f"{request.param}:{folder}"


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path / "cache"))


def no_network(monkeypatch):
    """Whatever asks the network fails as it does where there is none."""
    import socket

    def refuse(*args, **kwargs):
        raise OSError("Network is unreachable")

    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)


def test_models_on_disk(saved, monkeypatch, capfd):
    no_network(monkeypatch)
    capfd.readouterr()
    level = logging.root.manager.disable
    encoder = load(saved)
    assert isinstance(encoder, CachedEncoder) and encoder.name == saved
    found = encoder.encode(TEXTS)
    assert capfd.readouterr() == ("", ""), "a notebook should stay quiet"
    assert logging.root.manager.disable == level and transformers.utils.logging.is_progress_bar_enabled()
    assert found.shape == (4, encoder.size) and encoder.size == (16 if saved.startswith("clip") else 32)
    assert found.dtype == torch.float32 and not found.requires_grad
    inner = encoder.encoder
    alone = torch.cat([inner.encode([text]) for text in TEXTS])
    torch.testing.assert_close(found, alone, rtol=0, atol=1e-5)
    apart = similarity(found, found)[~torch.eye(4, dtype=torch.bool)]
    assert (apart < 0.9999).all(), "different sentences, different vectors"
    assert not any(p.requires_grad for p in inner.network.parameters()) and not inner.network.training


def test_vectors_are_the_packages_own(tmp_path):
    folder = save_clip(tmp_path / "clip")
    tokenizer = transformers.CLIPTokenizer.from_pretrained(folder)
    tower = transformers.CLIPTextModelWithProjection.from_pretrained(folder)
    with torch.no_grad():
        expected = tower(**tokenizer(TEXTS[1], return_tensors="pt")).text_embeds
    torch.testing.assert_close(encoders.clip(str(folder)).encode([TEXTS[1]]), expected, rtol=0, atol=1e-5)
    folder = save_sentence_transformer(tmp_path / "st")
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder)
    bert = transformers.AutoModel.from_pretrained(folder)
    with torch.no_grad():
        expected = bert(**tokenizer(TEXTS[1], return_tensors="pt")).last_hidden_state.mean(1)
    found = encoders.sentence_transformer(str(folder)).encode([TEXTS[1]])
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)


def test_the_text_tower_of_a_whole_clip(tmp_path):
    folder = save_clip(tmp_path / "clip", whole=True)
    whole = transformers.CLIPModel.from_pretrained(folder)
    tokens = transformers.CLIPTokenizer.from_pretrained(folder)(TEXTS[0], return_tensors="pt")
    with torch.no_grad():
        expected = whole.get_text_features(**tokens)
    expected = getattr(expected, "pooler_output", expected)
    torch.testing.assert_close(encoders.clip(str(folder)).encode(TEXTS[:1]), expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_key_changes_with_weights_and_tokenizer(kind, tmp_path):
    make = {"clip": encoders.clip, "sentence-transformers": encoders.sentence_transformer}[kind]
    one, same, other = (KINDS[kind](tmp_path / name, seed) for name, seed in (("one", 0), ("same", 0), ("other", 1)))
    first = make(str(one))
    assert first.key == make(str(same)).key != make(str(other)).key
    assert first.key == make(str(one)).key
    first.encode(TEXTS)
    rules = json.loads((same / "tokenizer.json").read_text())
    words = rules["model"]["vocab"]
    words["p"], words["w"] = words["w"], words["p"]
    (same / "tokenizer.json").write_text(json.dumps(rules))
    (same / "vocab.json").write_text(json.dumps(words)) if kind == "clip" else None
    assert make(str(same)).key != first.key


def test_long_sentences_are_cut_and_say_so(saved):
    encoder = load(saved)
    long = " ".join(["a person walks"] * 30)
    with pytest.warns(mk.MotionKitWarning, match="reads 48 tokens; of the .* of 'a person walks.*fewer words"):
        found = encoder.encode([long])
    assert torch.isfinite(found).all()


def test_no_network_and_nothing_on_disk(monkeypatch, tmp_path):
    no_network(monkeypatch)
    for name in ("clip:openai/no-such-clip", "sentence-transformers:no-such-model"):
        with pytest.raises(mk.MotionKitError, match=f"'{name}' cannot be loaded: it is not on disk, and the network"):
            load(name)
    for name in (f"clip:{tmp_path}/nowhere", "sentence-transformers:~/nowhere", "clip:../no"):
        with pytest.raises(mk.MotionKitError, match="no such folder; check the path"):
            load(name)


def test_folders_that_hold_something_else(tmp_path):
    (tmp_path / "empty").mkdir()
    for name in ("clip", "sentence-transformers"):
        with pytest.raises(mk.MotionKitError, match="cannot be loaded: .*a folder that has all its files"):
            load(f"{name}:{tmp_path / 'empty'}")
    folder = save_clip(tmp_path / "half")
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "num_hidden_layers": 3}))
    with pytest.raises(mk.MotionKitError, match="no text tower of CLIP there .*layers.2.*give a CLIP model"):
        load(f"clip:{folder}")
    (folder / "model.safetensors").write_bytes(b"damaged")
    with pytest.raises(mk.MotionKitError, match="cannot be loaded"):
        load(f"clip:{folder}")


@pytest.mark.parametrize(
    ("name", "package", "how"),
    [
        ("clip:openai/clip", "transformers", r"pip install -e .\[text\]"),
        ("sentence-transformers:mini", "sentence_transformers", r"pip install -e .\[text\]"),
        ("open-clip:ViT-B-32@openai", "open_clip", "pip install open_clip_torch, and torchvision"),
    ],
)
def test_missing_packages(name, package, how, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(mk.MotionKitError, match=f"{name}' needs the package {package}, .*; {how}"):
        load(name)


@pytest.mark.parametrize("name", ["ViT-B-32", "@openai", "ViT-B-32@"])
def test_open_clip_names(name):
    with pytest.raises(mk.MotionKitError, match="expected ARCH@WEIGHTS, such as ViT-B-32@openai"):
        load(f"open-clip:{name}")
    with pytest.raises(mk.MotionKitError, match="no such file of weights; check the path"):
        load("open-clip:ViT-B-32@./nowhere.pt")


def test_open_clip_on_disk(tmp_path):
    try:
        import open_clip
        from open_clip.model import CLIP
    except (ImportError, RuntimeError) as error:
        pytest.skip(f"open_clip needs a torchvision of the same build as torch: {error}")
    from safetensors.torch import save_file

    torch.manual_seed(0)
    vision = {"image_size": 16, "layers": 1, "width": 64, "patch_size": 8}
    text = {"context_length": 24, "vocab_size": 49408, "width": 32, "heads": 2, "layers": 2}
    config = {"embed_dim": 16, "vision_cfg": vision, "text_cfg": text}
    model = CLIP(**config)
    save_file({k: v.contiguous() for k, v in model.state_dict().items()}, tmp_path / "open_clip_model.safetensors")
    about = {"model_cfg": config, "preprocess_cfg": {"mean": [0, 0, 0], "std": [1, 1, 1]}}
    (tmp_path / "open_clip_config.json").write_text(json.dumps(about))
    encoder = load(f"open-clip:{tmp_path}")
    with torch.no_grad():
        expected = model.eval().encode_text(open_clip.SimpleTokenizer(context_length=24)(TEXTS))
    torch.testing.assert_close(encoder.encode(TEXTS), expected, rtol=0, atol=1e-5)
    with pytest.raises(mk.MotionKitError, match="no architecture 'ViT-B-33'"):
        load("open-clip:ViT-B-33@openai")
