"""`mini`: the kit's own text encoder, small enough to ship, which learned its words from captions and motions.

How it is trained stands in `priors.train_text`.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache

import torch
from torch import Tensor, nn

from .. import checkpoints
from .encoder import TextEncoder, content_key


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


def words_of(text: str) -> list[str]:
    """The words of a sentence in small letters, without stops.

    >>> words_of("A person's arm, raised.")
    ['a', "person's", 'arm', 'raised']
    """
    return re.findall(r"[^\W_]+(?:'[^\W_]+)?", text.lower()) or ["?"]


@lru_cache(65536)
def pieces_of(word: str, buckets: int) -> tuple[int, ...]:
    """Numbers of a word and of its pieces of 3 to 5 letters (as fastText, Bojanowski et al. 2017), from 1 to buckets.

    A word never seen so shares pieces with those seen: "walkers" with "walking". 0 is left free for padding.

    >>> len(pieces_of("walk", 4096)), pieces_of("walk", 4096) == pieces_of("walk", 4096)
    (10, True)
    """
    marked = f"<{word}>"
    found = [marked[n : n + size] for size in (3, 4, 5) for n in range(len(marked) - size + 1)]
    return tuple(1 + zlib.crc32(piece.encode()) % buckets for piece in [f"={word}", *found])


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
        words = [words_of(text)[: len(self.waves)] for text in texts]
        pieces = [pieces_of(word, self.config.buckets) for sentence in words for word in sentence]
        flat = torch.tensor([n for word in pieces for n in word], device=self.waves.device)
        starts = torch.tensor([0, *map(len, pieces)], device=flat.device).cumsum(0)[:-1]
        each = self.pieces(flat, starts).split([len(sentence) for sentence in words])
        x = nn.utils.rnn.pad_sequence(each, batch_first=True)  # [N, W, width]
        there = torch.arange(x.shape[1], device=x.device) < torch.tensor([len(w) for w in words]).to(x.device)[:, None]
        seen = self.encoder(x + self.waves[: x.shape[1]], src_key_padding_mask=~there)
        pooled = (seen * there[..., None]).sum(1) / there.sum(1, keepdim=True)
        return nn.functional.normalize(self.output(pooled), dim=1)


class Mini(TextEncoder):
    """The shipped encoder; `mk.text.load("mini")`.

    network: what encodes. card: how it was made.
    """

    name = "mini"

    def __init__(self, network: MiniNetwork, card: dict | None = None) -> None:
        self.network, self.card = network.eval(), card or {}
        self.size = network.config.size
        self.key = content_key(network.state_dict(), repr(network.config))

    def embed(self, texts: list[str]) -> Tensor:
        """Unit vectors [N, E]."""
        return self.network(texts)

    def save(self, path):
        """Weights and card, see `checkpoints.save`."""
        card = {"kind": "text", **self.card, "config": asdict(self.network.config)}
        return checkpoints.save(path, self.network.state_dict(), card)

    @classmethod
    def load(cls, path) -> Mini:
        """From what `save` wrote; MotionKitError if the files are damaged or hold something else."""
        tensors, card = checkpoints.load(path, "text")
        network = MiniNetwork(checkpoints.config_of(path, card, MiniConfig))
        checkpoints.load_into(network, tensors, path)
        return cls(network, card)


def load_mini() -> Mini:
    """The shipped one."""
    return Mini.load(checkpoints.find("text-mini"))
