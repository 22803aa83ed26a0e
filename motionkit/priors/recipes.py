"""How priors and discriminators are trained: `python -m motionkit train prior --data actor --config laptop`."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from ..cards import card_of
from ..checkpoints import load_into
from ..datasets import Clip, Dataset, Encoded, Split
from ..diffusion import NoiseSchedule, simple_loss
from ..errors import MotionKitError
from ..features import Normalizer
from ..layers import Denoiser, SemanticEncoder, TransformerConfig, semantic_loss
from ..text import TextEncoder, similarity
from ..training import Schedule, device_of, fit, seed_batch
from .discriminator import Discriminator
from .features import fitted
from .prior import Prior
from .retrieval import AMONG, recalls
from .sentences import nonsense, texts_of

BATCH, RATE = 48, 7e-4
STEPS = {"prior": 25000, "discriminator": 1000}
LOUDER = 6.0  # noise than the plain cosine's: how fast a motion goes is settled where there is least signal
DROP = 0.1  # share of the motions that come without their sentence, so that guidance can be used
SHORTEST = 40  # frames of a window


@dataclass(frozen=True, eq=False)
class Sentences:
    """The captions of clips as vectors. vectors: [N, E], one for each caption; starts: long [C + 1], of each clip."""

    texts: tuple[str, ...]
    vectors: Tensor
    starts: Tensor

    @classmethod
    def of(cls, clips: Sequence[Clip], encoder: TextEncoder) -> Sentences:
        """All captions of these clips; MotionKitError if one has none."""
        mute = next((clip.name for clip in clips if not clip.texts), None)
        if mute is not None:
            raise MotionKitError(f"clip {mute!r} has no caption, and a prior learns from captions; give it texts")
        texts = tuple(text for clip in clips for text in clip.texts)
        starts = torch.tensor([0, *(len(clip.texts) for clip in clips)]).cumsum(0)
        return cls(texts, encoder.encode(texts), starts)

    def draw(self, clips: Tensor) -> Tensor:
        """A random caption's vector for each of these clips, [B, E]."""
        counts = self.starts[1:] - self.starts[:-1]
        return self.vectors[self.starts[clips] + (torch.rand(len(clips)) * counts[clips]).long()]


def train_prior(
    data: Dataset | Split,
    encoder: TextEncoder,
    config: TransformerConfig | None = None,
    schedule: Schedule | None = None,
    *,
    noise: NoiseSchedule | None = None,
    drop: float = DROP,
    batch: int = BATCH,
    start: Prior | None = None,
    **running,
) -> Prior:
    """Paper 1's generative prior (section 3.3, eq. 5) on the training part of a dataset with captions.

    config: sizes; `laptop()` if left out. noise: a `louder` cosine with 1000 steps if left out. drop: share of the
    motions that it sees without a sentence; with 0 it cannot be guided. batch: windows a step, all of one length, which
    is drawn. start: a prior to go on from, of the same sizes, with its normalizer and noise. running: as in `fit`.
    Raises MotionKitError for clips without captions, or where `start` has other sizes.
    """
    split = data.split() if isinstance(data, Dataset) else data
    config, noise = config or TransformerConfig.laptop(), noise or NoiseSchedule.cosine(1000).louder(LOUDER)
    schedule = schedule or Schedule(STEPS["prior"], rate=RATE, decay=1e-2, average=0.999)
    encoded, normalizer = fitted(split.train)
    if start is not None:
        normalizer, noise = start.normalizer, start.schedule
    sentences = Sentences.of(split.train, encoder)
    torch.manual_seed(schedule.seed)
    network = Denoiser(encoded.layout.size, encoder.size, config, noise.steps)
    if start is not None:
        load_into(network, start.network.state_dict(), "start")
    loss_of, batch_of = _prior_loss(encoded, normalizer, sentences, noise, config.frames, drop, batch, schedule)
    run = fit(network, loss_of, schedule, batch_of=batch_of, **running)
    known, least = known_sentences(split.train, encoder)
    card = {**card_of(split.train, schedule, run, network), "batch": batch, "drop": drop}
    card["last_loss"] = round(sum(run.losses[-200:]) / len(run.losses[-200:]), 4)
    card |= {} if start is None else {"started_from": {k: start.card.get(k) for k in ("command", "steps", "seconds")}}
    return Prior(network, encoded.layout, normalizer, noise, encoder, known, least, drop > 0, card)


def _prior_loss(
    encoded: Encoded,
    normalizer: Normalizer,
    sentences: Sentences,
    noise: NoiseSchedule,
    frames: int,
    drop: float,
    batch: int,
    schedule: Schedule,
) -> tuple[Callable[[nn.Module, int], Tensor], Callable[[int], str]]:
    """The loss of a step (paper 1, eq. 5), and what is in its batch, in words."""

    def chosen() -> tuple[Tensor, int]:
        clips = torch.randint(len(encoded.dataset), (batch,))
        return clips, int(torch.randint(min(SHORTEST, frames) // 4, frames // 4 + 1, ())) * 4

    def loss_of(network: nn.Module, step: int) -> Tensor:
        clips, length = chosen()
        x, mask = encoded.draw_masked(clips, length)
        text = sentences.draw(clips) * (torch.rand(batch, 1) >= drop)
        t = torch.randint(1, noise.steps + 1, (batch,))
        x, mask, text, t = (value.to(device_of(network)) for value in (normalizer.normalize(x), mask, text, t))
        everyone = bool(mask.all())
        return simple_loss(
            lambda x, t: network(x, t, text, None if everyone else mask), x, noise, t, None if everyone else mask
        )

    def batch_of(step: int) -> str:
        seed_batch(schedule, step)
        clips, length = chosen()
        names = [encoded.dataset[n].name for n in clips.tolist()]
        return f"{length} frames of {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"

    return loss_of, batch_of


def train_discriminator(
    data: Dataset | Split,
    prior: Prior,
    schedule: Schedule | None = None,
    *,
    batch: int = BATCH,
    **running,
) -> Discriminator:
    """Paper 1's motion-semantic discriminator (section 3.3, eq. 6), with a prior's embedding, which stays as it is.

    Sizes are the prior's. The card holds R@1 and R@3 among 32 sentences on the test part. running: as in `fit`.
    """
    split = data.split() if isinstance(data, Dataset) else data
    schedule = schedule or Schedule(STEPS["discriminator"], rate=RATE, decay=1e-2, average=0.999)
    encoded = Encoded(split.train, prior.layout)
    sentences = Sentences.of(split.train, prior.encoder)
    torch.manual_seed(schedule.seed)
    config, embedding = prior.network.config, prior.network.embedding
    network = SemanticEncoder(prior.layout.size, prior.encoder.size, config, embedding)

    def loss_of(model: nn.Module, step: int) -> Tensor:
        clips = torch.randint(len(split.train), (batch,))
        length = int(torch.randint(min(SHORTEST, config.frames) // 4, config.frames // 4 + 1, ())) * 4
        x, mask = encoded.draw_masked(clips, length)
        text, here = sentences.draw(clips), device_of(model)
        everyone = None if mask.all() else mask.to(here)
        return semantic_loss(model(prior.normalizer.normalize(x).to(here), everyone), text.to(here))

    run = fit(network, loss_of, schedule, **running)
    made = Discriminator(network, prior.layout, prior.normalizer, prior.encoder)
    made.card = {**card_of(split.train, schedule, run, network), "batch": batch}
    made.card["metrics"] = retrieval(made, split.test) if len(split.test) else {}
    return made


def retrieval(judge: Discriminator, clips: Dataset) -> dict[str, float]:
    """R@1 and R@3 of clips' own first captions, see `recalls`; among half of the meanings where 32 are too many."""
    groups = [(clip.content, clip.style) for clip in clips]
    motions = judge.embed([clip.motion for clip in clips])
    texts = judge.encoder.encode([clip.text for clip in clips])
    return recalls(motions, texts, groups, min(AMONG, max(len(set(groups)) // 2, 1)))


def known_sentences(train: Dataset, encoder: TextEncoder, each: int = 4) -> tuple[tuple[str, ...], float]:
    """Some captions of each content and style, and how near to one of them a prompt should be.

    That is halfway between what other wordings of the same meanings reach (all but one in a hundred) and what sentences
    of words that do not exist reach (all but five in a hundred).
    """
    found: dict[tuple[str, str], dict[str, None]] = {}
    for clip in train:
        several = found.setdefault((clip.content, clip.style), {})
        several.update(dict.fromkeys(clip.texts[: each if len(several) < each else 0]))
    known = tuple(sorted({text for several in found.values() for text in several}))
    chance = random.Random(0)
    again = sorted({text for content, style in found for text in texts_of(content, style, seed=1)})
    near, far = (
        similarity(encoder.encode(texts), encoder.encode(known)).amax(1)
        for texts in (again, [nonsense(chance) for _ in range(200)])
    )
    return known, round(float(near.quantile(0.01) + far.quantile(0.95)) / 2, 3)
