"""Text encoders of other people, on tiny models with random weights, saved as theirs are."""

import json
import logging
import string
import sys

import pytest
import torch

import motionkit as mk
from motionkit.text import encoders, load, similarity
from motionkit.text.encoders import CachedEncoder

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
