"""Training the kit's text encoder: sentences to learn from, two towers that learn to agree, and the card."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from ..checkpoints import training_card
from ..datasets import Dataset, Split
from ..datasets.batches import FeatureCache, fit_normalizer
from ..features import Normalizer
from ..features.facing_free import OfBody
from ..layers import SemanticEncoder, TransformerConfig
from ..training import TrainConfig, TrainOrder, fit
from .captions import CONTENTS, STYLES, capture_captions, content_words, gerund, performed_captions
from .encoders import Mini, MiniConfig, MiniNetwork


@dataclass(frozen=True)
class Meaning:
    """Sentences that mean one content in one style."""

    content: str
    style: str
    texts: tuple[str, ...]


# Contents of captures whose words are made from their names (`captions.gerund`).
_HANDS = tuple(f"{verb}-{side}" for verb in ("wave", "raise-up") for side in ("both-hands", "left-hand", "right-hand"))


def meanings(seed: int = 0) -> list[Meaning]:
    """All contents in all styles that there are words for, each meaning once.

    >>> every = meanings()
    >>> len(every) > 3000, min(len(meaning.texts) for meaning in every) >= 4
    (True, True)
    """
    return [
        Meaning(content, style, texts_for(content, style, seed))
        for content in sorted({*CONTENTS, *_HANDS})
        for style in sorted(_style_by_phrase().values())
    ]


def _style_by_phrase() -> dict[str, str]:
    """By its first phrase, one name for each style: some have two."""
    return {STYLES[style].how[0]: style for style in sorted(STYLES, reverse=True)}


def texts_for(content: str, style: str, seed: int = 0) -> tuple[str, ...]:
    """Sentences for one content in one style, as captions of the performer and of captures have them, all different.

    >>> texts_for("walk-back", "old")[-1]
    'someone is stepping back in an old way'
    """
    words, texts = content_words(content), ()
    if words.ways:
        texts = performed_captions(content.replace("-", "_"), style, seed, 6)
    if words.captured or not words.ways:
        texts += capture_captions(*gerund(content), style)
    return tuple(dict.fromkeys(texts))


def nonsense(chance: random.Random) -> str:
    """A sentence about something that nobody knows: real sentences around words that do not exist.

    >>> nonsense(random.Random(0)) != nonsense(random.Random(1))
    True
    """
    made = ["".join(chance.choice("bcdfghklmnprstvz") + chance.choice("aeiou") for _ in range(chance.randint(1, 4)))
            + chance.choice(("", "n", "r", "s", "t", "ck", "ll")) for _ in range(chance.randint(2, 5))]  # fmt: skip
    start = chance.choice(("a person is", "a person", "someone", "the", "somebody is", "he", "a", ""))
    return " ".join((start, *made)).strip()


BATCH, OTHERS, NONSENSE, FRAMES, TEMPERATURE = 48, 32, 8, 96, 0.1
STEPS = 1600


class TwoTowers(nn.Module):
    """A text encoder and a motion encoder, which learn to agree (as CLIP, Radford et al. 2021).

    Only the text encoder is kept; what to move like is what its words mean.
    """

    def __init__(self, features: int, config: MiniConfig) -> None:
        super().__init__()
        self.text = MiniNetwork(config)
        self.motion = SemanticEncoder(features, config.size, TransformerConfig(96, 2, 4, 192, 4, FRAMES, 0.0))

    def forward(self, texts: list[str], motion: Tensor) -> tuple[Tensor, Tensor]:
        """Unit vectors of N sentences and of motions [B, F, D]."""
        return self.text(texts), nn.functional.normalize(self.motion(motion), dim=1)


def info_nce(a: Tensor, b: Tensor, same: Tensor, temperature: float = TEMPERATURE) -> Tensor:
    """How far each a [N, E] is from telling its b [M, E], M of at least N, from the others (InfoNCE, Oord et al. 2018).

    same: bool [N, M], pairs that mean the same, which are no mistakes and do not count. Vectors have length 1.

    >>> a = torch.eye(3)
    >>> bool(info_nce(a, a, torch.zeros(3, 3).bool()) < info_nce(a, a.roll(1, 0), torch.zeros(3, 3).bool()))
    True
    """
    scores = a @ b.T / temperature
    own = torch.eye(*scores.shape, dtype=torch.bool, device=a.device)
    scores = scores.masked_fill(same & ~own, -torch.inf)
    return nn.functional.cross_entropy(scores, torch.arange(len(a), device=a.device))


def train_text(
    data: Dataset | Split, config: MiniConfig | None = None, training: TrainConfig | None = None, **running
) -> Mini:
    """The kit's text encoder, from a dataset's captions and motions, and from sentences about all contents and styles.

    Captions learn to be near the motion that they are of and near other captions of it, and far from others'; so do
    sentences of one meaning that no motion is there for; words that do not exist learn to be far from all. The card
    holds how often, on the test part, the right one of 32 is found. running: as in `training.fit`.
    """
    split = data.split() if isinstance(data, Dataset) else data
    training = training or TrainConfig(STEPS, lr=1e-3, weight_decay=1e-2)
    features, normalizer = fit_normalizer(split.train)
    torch.manual_seed(training.seed)
    towers = TwoTowers(features.layout.size, config or MiniConfig())
    run = fit(towers, _draw(split.train, features, normalizer), _loss, training, **running)
    encoder = Mini(towers.text)
    metrics = _metrics(towers, split, normalizer)
    encoder.card = {**training_card(split.train, training, run, towers.text), "metrics": metrics}
    return encoder


def make_text(order: TrainOrder) -> Mini:
    """For the command line."""
    return train_text(order.data, None, order.config(STEPS, 1e-3, weight_decay=1e-2), **order.running)


def _draw(train: Dataset, features: FeatureCache, normalizer: Normalizer) -> Callable[[int], dict]:
    """Motions with two captions each; sentences of meanings without a motion; and nonsense."""
    captions, classes, known = [clip.texts for clip in train], _classes(train), meanings()

    def draw(step: int) -> dict:
        clips = torch.randint(len(train), (BATCH,))
        chance = random.Random(int(torch.randint(2**31, ())))
        pairs = [chance.sample(captions[n], 2) for n in clips.tolist()]
        others: list[Meaning] = chance.sample(known, OTHERS)
        pairs += [chance.sample(one.texts, 2) for one in others]
        odd = [nonsense(chance) for _ in range(NONSENSE)]
        of = [classes[n] for n in clips.tolist()] + [(one.content, one.style) for one in others]
        return {
            "texts": [first for first, _ in pairs] + [second for _, second in pairs] + odd,
            "motion": normalizer.normalize(features.sample(clips, FRAMES)),
            "same": torch.tensor([[a == b for b in of] for a in of]),
            "names": [train[n].name for n in clips.tolist()],
        }

    return draw


def _loss(towers: nn.Module, batch: dict) -> Tensor:
    same = batch["same"]
    text, motion = towers(batch["texts"], batch["motion"])
    first, rest = text[: len(same)], text[len(same) :]
    own = torch.cat((first, text[2 * len(same) :]))
    everything = nn.functional.pad(same, (0, NONSENSE))
    return (
        info_nce(first, rest, everything)
        + info_nce(motion, own, everything[:BATCH])
        + info_nce(first[:BATCH], motion, same[:BATCH, :BATCH])
    )


def _classes(data: Dataset) -> list[tuple[str, str]]:
    """Content and style of each clip, by the names that `meanings` has."""
    names = _style_by_phrase()
    return [
        (clip.content.replace("_", "-"), names[STYLES[clip.style].how[0]] if clip.style in STYLES else clip.style)
        for clip in data
    ]


@torch.no_grad()
def _metrics(towers: TwoTowers, split: Split, normalizer: Normalizer) -> dict[str, float]:
    from ..metrics import recall_at_k

    layout = OfBody()
    motion = torch.stack([normalizer.normalize(layout.encode(clip.motion)[:FRAMES]) for clip in split.test])
    groups = _classes(split.test)
    a = towers.text([clip.texts[0] for clip in split.test])
    b = towers.text([clip.texts[1] for clip in split.test])
    seen = nn.functional.normalize(towers.motion(motion), dim=1)
    return {
        "sentence_by_sentence_r1": recall_at_k(a, b, groups)["r1"],
        "sentence_by_motion_r1": recall_at_k(seen, a, groups)["r1"],
    }
