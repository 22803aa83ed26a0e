"""Sentences to vectors: what every text encoder offers, a memory for their results, and a check of prompts."""

from __future__ import annotations

import hashlib
import os
import threading
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load as read_tensors
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor
from torch.nn import functional

from ..errors import MotionKitError
from ..files import MotionKitWarning, write_atomic


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
            found = [self.embed(part).detach().to("cpu", torch.float32) for part in parts]
        vectors = torch.cat([torch.empty(0, self.size), *found])
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
    found = hashlib.sha256()
    for name in sorted(weights):
        value = weights[name].detach().cpu().contiguous()
        found.update(f"{name} {value.dtype} {tuple(value.shape)}\n".encode())
        found.update(value.reshape(-1).view(torch.uint8).numpy())
    for state in states:
        found.update(f"{len(state.encode())}\n{state}\n".encode())
    return found.hexdigest()


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


class Remembered(TextEncoder):
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
    ...     _ = Remembered(Lengths(), folder).encode(["hello"])
    ...     Remembered(Lengths(), folder).encode(["hello", "hello"])
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
        if self.folder is not None:
            return self.folder / f"{self.key}.safetensors"
        from ..datasets.store import cache_folder  # `datasets` itself takes its words from `text`

        return cache_folder() / "text" / f"{self.key}.safetensors"

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
            found = read_tensors(self.path.read_bytes())
            hashes, vectors, check = found["hashes"], found["vectors"], found["check"]
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
