"""Sentences to vectors: what every encoder offers, a cache of vectors, the kit's own encoder, and other people's.

`TextEncoder` is the interface, `CachedEncoder` keeps what another one answered, `Mini` is the shipped one, and
`Pretrained` stands for models of sentence-transformers, of CLIP (through transformers) and of open_clip.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import logging
import os
import re
import threading
import warnings
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load as read_tensors
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor, nn
from torch.nn import functional

from .. import checkpoints
from ..checkpoints import Checkpoint, Saved
from ..errors import MotionKitError
from ..files import MotionKitWarning, cache_folder, write_atomic


class TextEncoder(ABC):
    """Sentences to vectors of `size` numbers.

    name: as `load` takes it. size: numbers in a vector, E. key: 64 hex digits that change with the weights and the
    tokenizer, see `content_key`. batch: how many sentences go through the network at once. A subclass sets these and
    writes `embed`.

    >>> class Lengths(TextEncoder):
    ...     name, size, key = "lengths", 1, content_key({}, "lengths")
    ...     def embed(self, texts):
    ...         return torch.tensor([[float(len(text))] for text in texts])
    >>> Lengths().encode(["a person walks", "hello"])
    tensor([[14.],
            [ 5.]])
    """

    name: str
    size: int
    key: str
    batch: int = 64

    @abstractmethod
    def embed(self, texts: list[str]) -> Tensor:
        """The vectors [N, E] of at most `batch` sentences, none of them empty. Called without gradients."""

    def encode(self, texts: Sequence[str]) -> Tensor:
        """The vectors [N, E] of any number of sentences, float32 on the CPU, without gradients; of any length.

        A sentence has the same vector whatever else is encoded with it, up to rounding (1e-5). Raises MotionKitError
        for a sentence that is empty, for something that is no text, and for a vector that is not finite.
        """
        texts = checked_texts(texts)
        several = sorted(set(texts), key=lambda text: (len(text), text))  # like lengths together: little padding
        parts = [several[n : n + self.batch] for n in range(0, len(several), self.batch)]
        with torch.no_grad():
            embedded = [self.embed(part).detach().to("cpu", torch.float32) for part in parts]
        vectors = torch.cat([torch.empty(0, self.size), *embedded])
        if not torch.isfinite(vectors).all():
            bad = several[int((~torch.isfinite(vectors)).any(-1).nonzero()[0])]
            raise MotionKitError(
                f"text encoder {self.name!r}: the vector of {bad!r} is not finite; get its files again"
            )
        place = {text: n for n, text in enumerate(several)}
        return vectors[[place[text] for text in texts]]


def checked_texts(texts: Sequence[str]) -> list[str]:
    """The sentences as a list; MotionKitError if one is empty or is no text.

    >>> checked_texts(["a person walks", " "])
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: texts[1]: the sentence is empty; say what someone does, such as 'a person walks'
    """
    if isinstance(texts, str | bytes) or not isinstance(texts, Sequence):
        raise MotionKitError(f"texts: expected a list of sentences; found {texts!r:.60}; put one sentence in [ ]")
    for n, text in enumerate(texts):
        if not isinstance(text, str):
            raise MotionKitError(f"texts[{n}]: expected a sentence; found {text!r:.60}")
        if not text.strip():
            raise MotionKitError(f"texts[{n}]: the sentence is empty; say what someone does, such as 'a person walks'")
    return list(texts)


def content_key(weights: Mapping[str, Tensor], *states: str) -> str:
    """SHA-256 over an encoder's weights and what else its vectors depend on; 64 hex digits.

    weights: tensors by name, of any type and on any device. states: configuration and tokenizer, as text.

    >>> content_key({"w": torch.zeros(2)}) == content_key({"w": torch.zeros(2)}, "another tokenizer")
    False
    """
    digest = hashlib.sha256()
    for name in sorted(weights):
        value = weights[name].detach().cpu().contiguous()
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}\n".encode())
        digest.update(value.reshape(-1).view(torch.uint8).numpy())
    for state in states:
        digest.update(f"{len(state.encode())}\n{state}\n".encode())
    return digest.hexdigest()


def similarity(a: Tensor, b: Tensor) -> Tensor:
    """Cosine of the angle between each of `a` and each of `b`: [N, E] and [M, E] to [N, M], from -1 to 1.

    Raises MotionKitError if the two are not of one size, as vectors of two encoders may be.

    >>> similarity(torch.tensor([[1.0, 0.0]]), torch.tensor([[2.0, 0.0], [0.0, 3.0], [-1.0, 0.0]]))
    tensor([[ 1.,  0., -1.]])
    """
    if a.ndim != 2 or b.ndim != 2 or a.shape[1] != b.shape[1]:
        raise MotionKitError(
            f"expected vectors [N, E] and [M, E] of one encoder; found {list(a.shape)} and {list(b.shape)}"
        )
    return (functional.normalize(a, dim=1) @ functional.normalize(b, dim=1).T).clamp(-1, 1)


def check_prompt(
    prompt: str, encoder: TextEncoder, known: Sequence[str], known_embeddings: Tensor, least: float
) -> float:
    """How near a prompt is to the nearest known sentence: the cosine of their vectors, -1 to 1.

    known: sentences, such as those trained on; known_embeddings: their vectors [N, E] by the same encoder. Below
    `least` a MotionKitWarning names the nearest. Raises MotionKitError for an empty prompt, for no known sentences, and
    where the vectors do not fit.

    >>> class Letters(TextEncoder):
    ...     name, size, key = "letters", 26, content_key({}, "letters")
    ...     def embed(self, texts):
    ...         return torch.tensor([[float(text.count(chr(97 + n))) for n in range(26)] for text in texts])
    >>> known = ["a person walks", "a person kicks"]
    >>> check_prompt("a person walks", Letters(), known, Letters().encode(known), least=0.8)
    1.0
    """
    if not isinstance(prompt, str) or not prompt.strip():
        raise MotionKitError(f"the prompt is empty; say what someone does, such as 'a person walks'; found {prompt!r}")
    if len(known) == 0 or len(known) != len(known_embeddings):
        raise MotionKitError(
            f"expected at least one known sentence and a vector for each; found {len(known)} sentences and "
            f"{len(known_embeddings)} vectors"
        )
    near = similarity(encoder.encode([prompt]), known_embeddings)[0]
    best = int(near.argmax())
    value = round(float(near[best]), 6)
    if value < least:
        warnings.warn(
            f"the prompt {prompt!r} is far from anything known: similarity {value:.2f} to the nearest, "
            f"{known[best]!r}; expected {least:.2f} or more; say it with the words of such sentences",
            MotionKitWarning,
            stacklevel=2,
        )
    return value


class CachedEncoder(TextEncoder):
    """An encoder that encodes no sentence twice: vectors are kept in memory and on disk.

    encoder: whose vectors these are. folder: where they lie, in KEY.safetensors (KEY: the encoder's); left out, `text`
    in the cache folder (MOTIONKIT_CACHE). A damaged file is made anew. Several processes may use one file: each writes
    what it read and found, whole; at the worst one encodes again what another did. Where nothing can be written there
    is one MotionKitWarning, and memory has to do.

    >>> import tempfile
    >>> class Lengths(TextEncoder):
    ...     name, size, key = "lengths", 1, content_key({}, "lengths")
    ...     def embed(self, texts):
    ...         print("encodes", texts)
    ...         return torch.tensor([[float(len(text))] for text in texts])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = CachedEncoder(Lengths(), folder).encode(["hello"])
    ...     CachedEncoder(Lengths(), folder).encode(["hello", "hello"])
    encodes ['hello']
    tensor([[5.],
            [5.]])
    """

    def __init__(self, encoder: TextEncoder, folder: str | os.PathLike | None = None) -> None:
        self.encoder = encoder
        self.name, self.size, self.key, self.batch = encoder.name, encoder.size, encoder.key, encoder.batch
        self.folder = Path(folder).expanduser() if folder is not None else None
        self._kept: dict[bytes, Tensor] = {}
        self._lock = threading.RLock()
        self._writes = True

    @property
    def path(self) -> Path:
        """The file that the vectors lie in."""
        return (self.folder or cache_folder() / "text") / f"{self.key}.safetensors"

    def embed(self, texts: list[str]) -> Tensor:
        """The vectors [N, E], asked of the encoder itself."""
        return self.encoder.embed(texts)

    def encode(self, texts: Sequence[str]) -> Tensor:
        """See `TextEncoder.encode`."""
        texts = checked_texts(texts)
        keys = [hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest() for text in texts]
        with self._lock:
            if not all(key in self._kept for key in keys):
                self._kept.update(self._read())
            new = {key: text for key, text in zip(keys, texts) if key not in self._kept}
            if new:
                self._kept.update(zip(new, self.encoder.encode(list(new.values()))))
                self._write()
            return torch.stack([self._kept[key] for key in keys]) if keys else torch.empty(0, self.size)

    def _read(self) -> dict[bytes, Tensor]:
        """What the file holds, by hash of the text; nothing if it is missing or damaged."""
        try:
            tensors = read_tensors(self.path.read_bytes())
            hashes, vectors, check = tensors["hashes"], tensors["vectors"], tensors["check"]
        except (OSError, SafetensorError, KeyError, ValueError):
            return {}
        fits = hashes.dtype == torch.uint8 and hashes.shape[1:] == (32,) and vectors.dtype == torch.float32
        if not fits or vectors.shape != (len(hashes), self.size) or bytes(check.tolist()) != _check(hashes, vectors):
            return {}
        return {bytes(key): vector for key, vector in zip(hashes.numpy(), vectors)}

    def _write(self) -> None:
        if not self._writes:
            return
        kept = {**self._read(), **self._kept}
        hashes = torch.frombuffer(bytearray(b"".join(kept)), dtype=torch.uint8).reshape(-1, 32)
        vectors = torch.stack(list(kept.values()))
        check = torch.tensor(list(_check(hashes, vectors)), dtype=torch.uint8)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(self.path, tensors_as_bytes({"hashes": hashes, "vectors": vectors, "check": check}))
        except (OSError, MotionKitError) as error:
            self._writes = False
            warnings.warn(
                f"vectors of sentences are not kept on disk: {error}; MOTIONKIT_CACHE can name another folder",
                MotionKitWarning,
                stacklevel=3,
            )


def _check(hashes: Tensor, vectors: Tensor) -> bytes:
    """What the file's other two tensors must hash to."""
    return hashlib.sha256(hashes.numpy().tobytes() + vectors.numpy().tobytes()).digest()


@dataclass(frozen=True)
class MiniConfig:
    """Sizes. buckets: rows of the table that pieces of words share. size: of the answer, E.

    >>> MiniConfig().size
    128
    """

    width: int = 128
    layers: int = 2
    heads: int = 4
    buckets: int = 4096
    size: int = 128


def split_words(text: str) -> list[str]:
    """The words of a sentence in small letters, without stops.

    >>> split_words("A person's arm, raised.")
    ['a', "person's", 'arm', 'raised']
    """
    return re.findall(r"[^\W_]+(?:'[^\W_]+)?", text.lower()) or ["?"]


@lru_cache(65536)
def subwords(word: str, buckets: int) -> tuple[int, ...]:
    """Numbers of a word and of its pieces of 3 to 5 letters (as fastText, Bojanowski et al. 2017), from 1 to buckets.

    A word never seen so shares pieces with those seen: "walkers" with "walking". 0 is left free for padding.

    >>> len(subwords("walk", 4096)), subwords("walk", 4096) == subwords("walk", 4096)
    (10, True)
    """
    marked = f"<{word}>"
    pieces = [marked[n : n + size] for size in (3, 4, 5) for n in range(len(marked) - size + 1)]
    return tuple(1 + zlib.crc32(piece.encode()) % buckets for piece in [f"={word}", *pieces])


class MiniNetwork(nn.Module):
    """Words as means of their pieces, a small transformer over them, and the mean of that, of length 1.

    >>> MiniNetwork(MiniConfig())(["a person walks", "someone kicks a ball"]).shape
    torch.Size([2, 128])
    """

    def __init__(self, config: MiniConfig) -> None:
        super().__init__()
        from ..layers import sinusoids

        self.config = config
        self.pieces = nn.EmbeddingBag(config.buckets + 1, config.width, mode="mean", padding_idx=0)
        layer = nn.TransformerEncoderLayer(
            config.width, config.heads, 2 * config.width, 0.0, nn.functional.gelu, batch_first=True
        )
        self.encoder = nn.TransformerEncoder(layer, config.layers, enable_nested_tensor=False)
        self.output = nn.Linear(config.width, config.size)
        self.register_buffer("waves", sinusoids(64, config.width), persistent=False)

    def forward(self, texts: Sequence[str]) -> Tensor:
        """Sentences to unit vectors [N, E]; of one with more than 64 words the first count."""
        words = [split_words(text)[: len(self.waves)] for text in texts]
        pieces = [subwords(word, self.config.buckets) for sentence in words for word in sentence]
        flat = torch.tensor([n for word in pieces for n in word], device=self.waves.device)
        starts = torch.tensor([0, *map(len, pieces)], device=flat.device).cumsum(0)[:-1]
        each = self.pieces(flat, starts).split([len(sentence) for sentence in words])
        x = nn.utils.rnn.pad_sequence(each, batch_first=True)  # [N, W, width]
        is_word = (
            torch.arange(x.shape[1], device=x.device) < torch.tensor([len(w) for w in words]).to(x.device)[:, None]
        )
        encoded = self.encoder(x + self.waves[: x.shape[1]], src_key_padding_mask=~is_word)
        pooled = (encoded * is_word[..., None]).sum(1) / is_word.sum(1, keepdim=True)
        return nn.functional.normalize(self.output(pooled), dim=1)


class Mini(TextEncoder, Checkpoint):
    """The shipped encoder; `mk.text.load("mini")`.

    network: what encodes. card: how it was made.
    """

    name, kind = "mini", "text"

    def __init__(self, network: MiniNetwork, card: dict | None = None) -> None:
        self.network, self.card = network.eval(), card or {}
        self.size = network.config.size
        state = {name: value.half() for name, value in network.state_dict().items()}  # as `save` writes them
        self.key = content_key(state, repr(network.config))

    def embed(self, texts: list[str]) -> Tensor:
        """Unit vectors [N, E]."""
        return self.network(texts)

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network}

    def facts(self) -> dict:
        """Sizes."""
        return {"config": asdict(self.network.config)}

    @classmethod
    def restore(cls, saved: Saved) -> Mini:
        """See `checkpoints.Checkpoint`."""
        return cls(saved.fill("network", MiniNetwork(saved.config(MiniConfig))), saved.card)


def load_mini() -> Mini:
    """The shipped one."""
    return Mini.load(checkpoints.find("text-mini"))


class Pretrained(TextEncoder):
    """A text encoder that somebody else trained.

    name: as `text.load` takes it. network: frozen here, in float32. run: up to `batch` sentences to vectors [N, E].
    states: what the answers depend on beside the weights, as text. tokenizer: counts the tokens of sentences; those
    with more than `limit` are cut, with a MotionKitWarning. weights: of the network, which to count for the key.

    >>> network = nn.Linear(1, 3)
    >>> encoder = Pretrained("lengths", network, lambda texts: network(torch.tensor([[float(len(t))] for t in texts])))
    >>> encoder.encode(["a person walks"]).shape, encoder.size
    (torch.Size([1, 3]), 3)
    """

    def __init__(
        self,
        name: str,
        network: nn.Module,
        run: Callable[[list[str]], Tensor],
        states: Sequence[str] = (),
        *,
        tokenizer: Callable | None = None,
        limit: int | None = None,
        weights: Callable[[str], bool] = lambda name: True,
    ) -> None:
        self.name = name
        self.network = network.float().eval().requires_grad_(False)
        self._run, self._tokenizer, self._limit = run, tokenizer, limit
        self.key = content_key({k: v for k, v in network.state_dict().items() if weights(k)}, *states)
        with torch.no_grad():
            self.size = run(["a person walks"]).shape[1]

    def embed(self, texts: list[str]) -> Tensor:
        """The vectors [N, E]."""
        if self._tokenizer is not None and self._limit is not None:
            with _quiet():  # it warns of long sentences itself, but not always
                tokens = self._tokenizer(texts, truncation=False, padding=False)["input_ids"]
            for text, ids in zip(texts, tokens):
                if len(ids) > self._limit:
                    warnings.warn(
                        f"{self.name} reads {self._limit} tokens; of the {len(ids)} of {text[:40]!r}... the last do "
                        "not count; say it in fewer words",
                        MotionKitWarning,
                        stacklevel=3,
                    )
        return self._run(texts)


def sentence_transformer(model: str) -> Pretrained:
    """A model of sentence-transformers on the CPU. model: its name, or a folder that it was saved to.

    Raises MotionKitError where the package is missing, and where the model is neither on disk nor to be had.

    >>> sentence_transformer("./nowhere")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: text encoder 'sentence-transformers:./nowhere': no such folder; check the path
    """
    name = f"sentence-transformers:{model}"
    place = _place(name, model)
    package = _package(name, "sentence_transformers", "pip install -e .[text]")
    with _loading(name):
        make = package.SentenceTransformer
        network = _local_first(place, lambda where, local: make(where, device="cpu", local_files_only=local))
        tokenizer, limit = network.tokenizer, network.max_seq_length
        states = [repr(network), str(limit), json.dumps([network.prompts, network.default_prompt_name])]
        config = getattr(getattr(network[0], "auto_model", None), "config", None)
        states += [_config_text(config) if config is not None else "", _tokenizer_text(tokenizer)]

        def run(texts: list[str]) -> Tensor:
            return network.encode(texts, batch_size=len(texts), convert_to_tensor=True, show_progress_bar=False)

        return Pretrained(name, network, run, states, tokenizer=tokenizer if callable(tokenizer) else None, limit=limit)


def clip(model: str) -> Pretrained:
    """The text tower of a CLIP model with its projection, through transformers, on the CPU.

    model: its name, or a folder that a CLIPModel or CLIPTextModelWithProjection and its tokenizer were saved to. Raises
    MotionKitError where the package is missing, where the model is neither on disk nor to be had, and where it has no
    such tower.

    >>> clip("./nowhere")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: text encoder 'clip:./nowhere': no such folder; check the path
    """
    name = f"clip:{model}"
    place = _place(name, model)
    package = _package(name, "transformers", "pip install -e .[text]")
    with _loading(name):

        def load(where: str, *, local: bool) -> tuple[Any, Any, Any]:
            make = package.CLIPTextModelWithProjection.from_pretrained
            return *make(
                where, local_files_only=local, output_loading_info=True
            ), package.AutoTokenizer.from_pretrained(where, local_files_only=local)

        network, info, tokenizer = _local_first(place, load)
        if info["missing_keys"]:
            raise MotionKitError(
                f"text encoder {name!r}: no text tower of CLIP there ({sorted(info['missing_keys'])[0]} is missing); "
                "give a CLIP model"
            )
        limit = network.config.max_position_embeddings

        def run(texts: list[str]) -> Tensor:
            tokens = tokenizer(texts, padding=True, truncation=True, max_length=limit, return_tensors="pt")
            return network(input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"]).text_embeds

        states = (_config_text(network.config), _tokenizer_text(tokenizer))
        return Pretrained(name, network, run, states, tokenizer=tokenizer, limit=limit)


def open_clip(model: str) -> Pretrained:
    """The text tower of a model of open_clip, on the CPU.

    model: ARCH@WEIGHTS, such as "ViT-B-32@openai", with a file of weights or the tag of published ones; or a folder
    with open_clip_config.json and the weights. Raises MotionKitError where the package is missing, for an architecture
    that it does not know, and where the weights are neither on disk nor to be had.

    >>> open_clip("ViT-B-32")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: text encoder 'open-clip:ViT-B-32': expected ARCH@WEIGHTS, such as ...
    """
    name, (arch, _, weights) = f"open-clip:{model}", model.partition("@")
    folder, file = Path(model).expanduser(), Path(weights).expanduser()
    if not folder.is_dir() and not (arch and weights):
        raise MotionKitError(f"text encoder {name!r}: expected ARCH@WEIGHTS, such as ViT-B-32@openai, or a folder")
    if (weights.startswith((".", "~")) or len(file.parts) > 1) and not file.is_file():
        raise MotionKitError(f"text encoder {name!r}: no such file of weights; check the path")
    package = _package(name, "open_clip", "pip install open_clip_torch, and torchvision of the same build as torch")
    with _loading(name):
        if folder.is_dir():
            arch, weights = f"local-dir:{folder}", None
        elif arch not in package.list_models():
            raise MotionKitError(
                f"text encoder {name!r}: open_clip has no architecture {arch!r}; open_clip.list_models() names them"
            )
        known = str(file) if weights and file.is_file() else weights
        network = package.create_model(arch, pretrained=known, device="cpu", require_pretrained=True)
        tokenizer = package.get_tokenizer(arch)
        inner = getattr(tokenizer, "tokenizer", None)  # of transformers; else open_clip's own
        words = _tokenizer_text(inner) if inner is not None else json.dumps(sorted(tokenizer.encoder.items()))
        states = (repr(network), words, str(tokenizer.context_length))

        def run(texts: list[str]) -> Tensor:
            return network.encode_text(tokenizer(texts))

        return Pretrained(name, network, run, states, weights=lambda key: not key.startswith("visual."))


def _place(name: str, model: str) -> str:
    """A folder as a path, or a name as it is; MotionKitError for what can only be a folder and is none."""
    place = Path(model).expanduser()
    if place.is_dir():
        return str(place)
    if place.is_absolute() or model.startswith((".", "~")) or "\\" in model or model.count("/") > 1:
        raise MotionKitError(f"text encoder {name!r}: no such folder; check the path")
    return model


def _local_first(where: str, load: Callable[[str, bool], Any]) -> Any:
    """What is loaded from disk (a folder, or the cache of what was downloaded before) or else from the network."""
    try:
        return load(where, local=True)
    except (OSError, ValueError):
        if Path(where).is_dir():
            raise
    with suppress(ImportError):
        from huggingface_hub import constants
        from huggingface_hub.utils import get_session

        try:  # within seconds: the packages themselves try for a minute
            get_session().head(constants.ENDPOINT, timeout=5)
        except Exception as error:  # of whichever client it uses
            raise OSError("it is not on disk, and the network cannot be reached") from error
    return load(where, local=False)


def _package(name: str, module: str, how: str) -> Any:
    """A package that not everybody has; MotionKitError says how to get it."""
    try:
        with _quiet():
            return importlib.import_module(module)
    except Exception as error:  # a torchvision of another build than torch raises a RuntimeError
        raise MotionKitError(
            f"text encoder {name!r} needs the package {module}, which cannot be imported ({_first_line(error)}); {how}"
        ) from None


@contextmanager
def _loading(name: str) -> Iterator[None]:
    """Loading without the packages' chatter, and with one kind of error."""
    try:
        with _quiet():
            yield
    except MotionKitError:
        raise
    except Exception as error:  # the packages raise what they like
        raise MotionKitError(
            f"text encoder {name!r} cannot be loaded: {_first_line(error)}. Give a folder that has all its files, or a "
            "name that is right, with the network at hand for the first time"
        ) from None


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")[:200]


@contextmanager
def _quiet() -> Iterator[None]:
    """No log lines (errors are raised), no warnings and no bars of transformers; all as before afterwards."""
    before, bars = logging.root.manager.disable, None
    with suppress(ImportError):
        from transformers.utils import logging as bars
    shown = bars is not None and bars.is_progress_bar_enabled()
    try:
        logging.disable(max(before, logging.ERROR))
        if shown:
            bars.disable_progress_bar()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
        if shown:
            bars.enable_progress_bar()


def _config_text(config: Any) -> str:
    """A model's configuration as text, without how or by whom it was saved, which is nothing to its answers."""
    besides = ("_name_or_path", "transformers_version", "architectures", "dtype", "torch_dtype")
    facts = {key: value for key, value in config.to_dict().items() if key not in besides}
    return json.dumps(facts, sort_keys=True, default=str)


def _tokenizer_text(tokenizer: Any) -> str:
    """A tokenizer's words and rules as text, without what changes from call to call."""
    backend = getattr(tokenizer, "backend_tokenizer", None)
    if backend is None:
        words = tokenizer.get_vocab() if hasattr(tokenizer, "get_vocab") else repr(tokenizer)
        return json.dumps(words, sort_keys=True, default=str)
    rules = json.loads(backend.to_str())
    return json.dumps({key: value for key, value in rules.items() if key not in ("padding", "truncation")})
