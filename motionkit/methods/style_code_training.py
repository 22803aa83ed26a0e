"""How `style_code` learns: pairs of neutral motions and the same in thousands of random styles, and two trainings.

Only the performer can perform a motion in a style that nobody ever captured, in step with the neutral one: it is the
data of this method.
"""

from __future__ import annotations

import copy
import random
from dataclasses import dataclass

import torch
from joblib import Parallel, delayed
from torch import Tensor, nn
from tqdm.auto import tqdm

from .. import checkpoints, text
from ..actor import CONTENTS, VERSION, Style, parameters, perform, retell
from ..actor.style import TRAIN_STYLES, get_style
from ..datasets.performed import FPS, PERFORMERS
from ..errors import MotionKitError
from ..features import Normalizer
from ..features.facing_free import OfBody, encode_normalized
from ..sampling import PartialDiffusion, reconstruction_loss
from ..training import TrainConfig, TrainOrder, fit
from . import text_to_motion
from .style_code import TO_NEUTRAL, CodedDenoiser, GaussianCode, StyleCodeModel, StyleEncoder, new_style_encoder
from .text_to_motion import Prior

FRAMES = 144  # of a pair
_FIRST_SEED = 500_000  # of performances; data sets have others
_ROOM = 15  # frames that a performance is longer


def random_style(chance: random.Random) -> Style:
    """A style drawn by chance: most of its numbers near neutral, as far as the eight styles of `actor` go, some far.

    Of the styles held back nothing is known here. Two in three numbers are normal with half the largest distance from
    neutral that any style of `actor` has, one in three lies anywhere within its range, near neutral more often.

    >>> a, b = (random_style(random.Random(seed)) for seed in (0, 1))
    >>> a.lean != b.lean
    True
    """
    numbers = {}
    for key, about in parameters().items():
        reach = max(abs(getattr(get_style(style), key) - about.neutral) for style in TRAIN_STYLES)
        if chance.random() < 2 / 3:
            value = about.neutral + 0.5 * reach * chance.gauss(0, 1) * (chance.random() < 0.7)
        else:
            bound = about.high if chance.random() < 0.7 else about.low
            value = about.neutral + 0.85 * chance.random() ** 1.5 * (bound - about.neutral)
        numbers[key] = min(max(value, about.low), about.high)
    return Style("invented", **numbers)


def code_of(style: Style) -> Tensor:
    """A style's numbers [C], each from neutral in halves of its range: its code.

    >>> bool((code_of(Style()) == 0).all())
    True
    """
    halves = {key: 0.5 * (about.high - about.low) for key, about in parameters().items()}
    return torch.tensor([(getattr(style, key) - parameters()[key].neutral) / half for key, half in halves.items()])


@dataclass(frozen=True, eq=False)
class StylePairs:
    """Motions performed neutrally and in random styles, frame by frame at the same beat.

    neutral, styled: features [N, F, D], half precision. codes: [N, C], see `code_of`. captions: N neutral sentences.
    """

    neutral: Tensor
    styled: Tensor
    codes: Tensor
    captions: tuple[str, ...]


def style_pairs(prior: Prior, count: int, each: int = 3, seed: int = 0, jobs: int | None = None) -> StylePairs:
    """`count` performances by people of `actor`'s training part, each in `each` random styles, in a prior's features.

    All contents come equally often. Half of the pairs are in the time of the neutral motion, as a content is, half in
    the style's own, as a style example is. jobs: processes, one a core if left out.
    """
    work = (delayed(_performed)(prior.layout, prior.normalizer, n, each, seed) for n in range(count))
    performed = Parallel(n_jobs=jobs or -1, batch_size=16, return_as="generator")(work)
    rows = list(tqdm(performed, "performing", count))
    neutral, styled, codes = (torch.cat([row[n] for row in rows]) for n in range(3))
    return StylePairs(neutral, styled, codes, tuple(row[3] for row in rows for _ in range(each)))


def _performed(layout: OfBody, normalizer: Normalizer, number: int, each: int, seed: int) -> tuple:
    """One performance in some styles: neutral and styled features, codes, and the neutral sentence."""
    torch.set_num_threads(1)
    chance = random.Random(f"lesson {seed} {number}")
    content, performer = CONTENTS[number % len(CONTENTS)], chance.choice(PERFORMERS["train"])
    take, seconds = _FIRST_SEED * (1 + seed) + number, (FRAMES + _ROOM) / FPS
    neutral = perform(content, "neutral", take, seconds=seconds, fps=FPS, performer=performer)
    styles, pairs = [random_style(chance) for _ in range(each)], []
    for style in styles:
        styled = retell(neutral, style)
        if chance.random() < 0.5 and len(styled) >= FRAMES:
            pairs.append((neutral.time_aligned(styled), styled.motion))
        else:
            pairs.append((neutral.motion, styled.time_aligned(neutral)))
    windows = []
    for pair in pairs:
        start = chance.randrange(min(len(pair[0]) - FRAMES + 1, _ROOM))
        windows.append([encode_normalized(motion[start : start + FRAMES], layout, normalizer) for motion in pair])
    features = (torch.stack(column).half() for column in zip(*windows))
    return *features, torch.stack([code_of(style) for style in styles]), neutral.captions[0]


STEPS, LR, BATCH = 10000, 1e-3, 16
ENCODER_STEPS, ENCODER_LR, ENCODER_BATCH = 8000, 7e-4, 64
COUNT = 7200  # performances, each in three styles
_BACK = 4  # of a batch so many are taken from their style to neutral
_SHORTEST = 96


@torch.no_grad()
def noised(prior: Prior, partial: PartialDiffusion, x: Tensor, words: Tensor) -> Tensor:
    """m_K of features [N, F, D] with their sentences' vectors [N, E], in half precision."""
    parts = [
        partial.forward(lambda y, t, texts=texts: prior.network(y, t, texts), clean.float()).half()
        for clean, texts in zip(x.split(64), words.split(64))
    ]
    return torch.cat(parts)


def _window() -> slice:
    length = int(torch.randint(_SHORTEST // 4, FRAMES // 4 + 1, ())) * 4
    start = int(torch.randint(FRAMES - length + 1, ()))
    return slice(start, start + length)


def train_decoder(
    prior: Prior, pairs: StylePairs, training: TrainConfig | None = None, start: StyleCodeModel | None = None, **running
) -> StyleCodeModel:
    """Teach the chain of a prior on pairs in random styles (paper 1, eqs. 9 and 10), starting from its weights.

    A quarter of each batch goes from a styled motion to the neutral one, told so by a number of its own; the rest from
    neutral to a style by its code. start: a model of this prior to go on from. running: as in `training.fit`.
    """
    training = training or TrainConfig(STEPS, LR, ema=0.995)
    prior.network.eval()
    partial = PartialDiffusion.from_paper(prior.schedule)
    words = prior.encoder.encode([text.to_neutral(caption) for caption in pairs.captions])
    neutral_noised, styled_noised = (noised(prior, partial, x, words) for x in (pairs.neutral, pairs.styled))
    torch.manual_seed(training.seed)
    network = CodedDenoiser(copy.deepcopy(prior.network)) if start is None else copy.deepcopy(start.network)
    network.requires_grad_(True)

    def draw(step: int) -> dict[str, Tensor]:
        chosen, window = torch.randint(len(pairs.styled), (BATCH,)), _window()
        back, there = chosen[:_BACK], chosen[_BACK:]
        code = torch.cat((TO_NEUTRAL.expand(_BACK, -1), nn.functional.pad(pairs.codes[there], (0, 1))))
        return {
            "noised": torch.cat((styled_noised[back, window], neutral_noised[there, window])).float(),
            "target": torch.cat((pairs.neutral[back, window], pairs.styled[there, window])).float(),
            "text": words[chosen],
            "code": code,
        }

    def loss_fn(network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
        predict = lambda x, t: network(x, t, batch["text"], batch["code"])  # noqa: E731
        return reconstruction_loss(partial.reverse(predict, batch["noised"]), batch["target"])

    run = fit(network, draw, loss_fn, training, **running)
    model = StyleCodeModel(prior, network.requires_grad_(False), partial, card=_card(training, run, network, pairs))
    if start is not None:
        model.card["started_from"] = {key: start.card.get(key) for key in ("command", "steps", "seconds")}
    return model


def train_encoder(prior: Prior, pairs: StylePairs, training: TrainConfig | None = None, **running) -> StyleEncoder:
    """Teach a network to read the code off a styled motion: the mean of all that are possible, and how sure it is.

    By `beta_nll`. running: as in `training.fit`.
    """
    training = training or TrainConfig(ENCODER_STEPS, ENCODER_LR, weight_decay=1e-2, ema=0.995)
    torch.manual_seed(training.seed)
    network = new_style_encoder(prior)

    def draw(step: int) -> dict[str, Tensor]:
        chosen = torch.randint(len(pairs.styled), (ENCODER_BATCH,))
        return {"x": pairs.styled[chosen, _window()].float(), "code": pairs.codes[chosen]}

    def loss_fn(network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
        return beta_nll(GaussianCode.of(network(batch["x"])), batch["code"])

    run = fit(network, draw, loss_fn, training, **running)
    return StyleEncoder(prior, network.requires_grad_(False), _card(training, run, network, pairs))


def _card(training: TrainConfig, run, network: nn.Module, pairs: StylePairs) -> dict:
    return {
        "data": "actor",
        "data_sha256": f"performer {VERSION}",
        "training_clips": len(pairs.styled),
        "seed": training.seed,
        "steps": training.steps,
        "seconds": round(run.seconds),
        "steps_per_second": round(run.steps_per_second, 2),
        "hardware": checkpoints.hardware(),
        "parameters": sum(p.numel() for p in network.parameters()),
        "last_loss": round(run.last_loss, 4),
        "licence": "MIT",
    }


def beta_nll(predicted: GaussianCode, codes: Tensor) -> Tensor:
    """The loss of predicted codes, both [..., C]: a Gaussian's minus log, where the unsure ones count as others do.

    Each number is weighted by the standard deviation predicted for it, through which no gradient goes (the beta-NLL of
    Seitzer et al., 2022), or a network lets go of what it cannot read at once.

    >>> far, right = torch.ones(1, 3), torch.zeros(1, 3)
    >>> bool(beta_nll(GaussianCode(far, right + 0.1), right) > beta_nll(GaussianCode(far, far), right))
    True
    """
    each = nn.functional.gaussian_nll_loss(predicted.code, codes, predicted.spread**2, reduction="none")
    return (each * predicted.spread.detach()).mean()


@torch.no_grad()
def encoder_error(encoder: StyleEncoder, pairs: StylePairs) -> dict[str, float]:
    """Mean square errors of codes read off pairs that were not learned from; `guessed`: of neutral for all.

    `expected`: what the encoder itself thinks that its errors are.
    """
    predicted = GaussianCode.of(torch.cat([encoder.network(x.float()) for x in pairs.styled.split(64)]))
    errors = {"read": (predicted.code - pairs.codes).square().mean(), "guessed": pairs.codes.square().mean()}
    errors["expected"] = predicted.spread.square().mean()
    return {name: round(float(value), 4) for name, value in errors.items()}


@torch.no_grad()
def decoder_error(model: StyleCodeModel, pairs: StylePairs) -> dict[str, float]:
    """Mean square errors of the chain's last prediction on pairs that were not learned from, both ways.

    `styled`: from neutral to the style that the code says; `neutral`: from the style to neutral; `copied`: what there
    is between the two.
    """
    words = model.prior.encoder.encode([text.to_neutral(caption) for caption in pairs.captions])
    errors = {"copied": float((pairs.neutral.float() - pairs.styled.float()).square().mean())}
    codes = {"styled": nn.functional.pad(pairs.codes, (0, 1)), "neutral": TO_NEUTRAL.expand(len(words), -1)}
    for name, code in codes.items():
        source, target = (pairs.neutral, pairs.styled) if name == "styled" else (pairs.styled, pairs.neutral)
        start = noised(model.prior, model.partial, source, words).float()
        predicted = model.partial.reverse(lambda x, t, code=code: model.network(x, t, words, code), start)[-1]
        errors[name] = float((predicted - target.float()).square().mean())
    return {name: round(value, 4) for name, value in errors.items()}


def make_style_code(order: TrainOrder) -> StyleCodeModel:
    """For the command line: the model of a dataset's prior; MotionKitError for captures, which nobody can perform."""
    prior, count = _prior_and_count(order, STEPS)
    start = StyleCodeModel.load(checkpoints.find(order.start), prior=prior) if order.start else None
    pairs = style_pairs(prior, count, seed=order.seed)
    model = train_decoder(prior, pairs, order.config(STEPS, LR, ema=0.995), start, **order.running)
    model.card["metrics"] = decoder_error(model, style_pairs(prior, 60, seed=order.seed + 1))
    return model


def make_style_encoder(order: TrainOrder) -> StyleEncoder:
    """For the command line: what reads codes off the motions of a dataset's prior."""
    prior, count = _prior_and_count(order, ENCODER_STEPS)
    training = order.config(ENCODER_STEPS, ENCODER_LR, weight_decay=1e-2, ema=0.995)
    encoder = train_encoder(prior, style_pairs(prior, count, seed=order.seed), training, **order.running)
    encoder.card["metrics"] = encoder_error(encoder, style_pairs(prior, 60, seed=order.seed + 1))
    return encoder


def _prior_and_count(order: TrainOrder, steps: int) -> tuple[Prior, int]:
    """The prior, and of how many performances to learn: fewer where there are fewer steps than usual."""
    if order.data.name != "actor":
        raise MotionKitError(f"codes of styles are learned from the performer, data 'actor'; found {order.data.name!r}")
    share = min((order.steps or steps) / steps, 1)
    return text_to_motion.load("actor"), max(24, int(COUNT * share))
