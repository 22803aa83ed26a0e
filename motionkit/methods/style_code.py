"""Styles that nobody has named, and what the performer makes of them: lessons for a space of styles."""

from __future__ import annotations

import copy
import os
import random
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple

import torch
from joblib import Parallel, delayed
from torch import Tensor, nn
from tqdm.auto import tqdm

from .. import checkpoints, text
from ..actor import CONTENTS, VERSION, Style, parameters, perform, retell
from ..actor.style import TRAIN_STYLES, get_style
from ..datasets import Dataset
from ..datasets.performed import FPS, PERFORMERS
from ..errors import MotionKitError
from ..features import Normalizer
from ..features.facing_free import OfBody, encode_normalized
from ..layers import Denoiser, SemanticEncoder, TransformerConfig
from ..sampling import PartialDiffusion, reconstruction_loss
from ..training import TrainConfig, default_path, device_of, fit, main_process_first
from . import text_to_motion
from .text_to_motion import Prior

FRAMES = 144  # of a lesson
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
    """A style's numbers [C], each from neutral in halves of its range: what a space of styles is told.

    >>> bool((code_of(Style()) == 0).all())
    True
    """
    halves = {key: 0.5 * (about.high - about.low) for key, about in parameters().items()}
    return torch.tensor([(getattr(style, key) - parameters()[key].neutral) / half for key, half in halves.items()])


@dataclass(frozen=True, eq=False)
class StylePairs:
    """Performances told neutrally and in invented styles, frame by frame at the same beat.

    neutral, styled: features [N, F, D], half precision. codes: [N, C], see `code_of`. captions: N neutral sentences.
    """

    neutral: Tensor
    styled: Tensor
    codes: Tensor
    captions: tuple[str, ...]


def style_pairs(prior: Prior, count: int, each: int = 3, seed: int = 0, jobs: int | None = None) -> StylePairs:
    """`count` performances by people of `actor`'s training part, each in `each` invented styles, in a prior's features.

    All contents come equally often. Half of the lessons are in the time of the neutral motion, as a content is, half in
    the style's own, as a style example is. jobs: processes, one a core if left out.
    """
    work = (delayed(_lesson)(prior.layout, prior.normalizer, n, each, seed) for n in range(count))
    found = Parallel(n_jobs=jobs or -1, batch_size=16, return_as="generator")(work)
    rows = list(tqdm(found, "performing", count))
    neutral, styled, codes = (torch.cat([row[n] for row in rows]) for n in range(3))
    return StylePairs(neutral, styled, codes, tuple(row[3] for row in rows for _ in range(each)))


def _lesson(layout: OfBody, normalizer: Normalizer, number: int, each: int, seed: int) -> tuple:
    torch.set_num_threads(1)
    chance = random.Random(f"lesson {seed} {number}")
    content, who = CONTENTS[number % len(CONTENTS)], chance.choice(PERFORMERS["train"])
    take = _FIRST_SEED * (1 + seed) + number
    played = perform(content, "neutral", take, seconds=(FRAMES + _ROOM) / FPS, fps=FPS, performer=who)
    styles, pairs = [random_style(chance) for _ in range(each)], []
    for style in styles:
        told = retell(played, style)
        if chance.random() < 0.5 and len(told) >= FRAMES:
            pairs.append((played.time_aligned(told), told.motion))
        else:
            pairs.append((played.motion, told.time_aligned(played)))
    starts = [chance.randrange(min(len(pair[0]) - FRAMES + 1, _ROOM)) for pair in pairs]
    neutral, styled = (
        torch.stack(
            [encode_normalized(pair[n][k : k + FRAMES], layout, normalizer).half() for pair, k in zip(pairs, starts)]
        )
        for n in range(2)
    )
    return neutral, styled, torch.stack([code_of(style) for style in styles]), played.captions[0]


def batches_of(count: int, size: int) -> Iterator[slice]:
    """Slices of at most `size` that cover `count`.

    >>> list(batches_of(5, 3))
    [slice(0, 3, None), slice(3, 5, None)]
    """
    return (slice(n, min(n + size, count)) for n in range(0, count, size))


CODES = len(parameters())
_LEAST_SPREAD = 0.02  # of half a range
_NEAR = 0.15  # of half a range: how far from neutral half of a style's numbers lie
_READ, _UNREAD = 0.3, 0.2  # how much it counts how unlikely a point is, beside the reconstruction loss


class CodedDenoiser(nn.Module):
    """A denoiser that every token of which is told a code, [B, C + 1]: a style, or in its last number, to be neutral.

    >>> network = CodedDenoiser(Denoiser(10, 16, TransformerConfig.tiny()), codes=3)
    >>> x, t, words = torch.randn(2, 30, 10), torch.tensor([5, 900]), torch.zeros(2, 16)
    >>> network(x, t, words, torch.zeros(2, 4)).shape
    torch.Size([2, 30, 10])
    """

    def __init__(self, denoiser: Denoiser, codes: int = CODES) -> None:
        super().__init__()
        self.denoiser, width = denoiser, denoiser.config.width
        self.straight = nn.Linear(codes + 1, width, bias=False)
        self.bent = nn.Sequential(nn.Linear(codes + 1, width), nn.SiLU(), nn.Linear(width, width, bias=False))

    def forward(self, x: Tensor, t: Tensor, text: Tensor, code: Tensor, mask: Tensor | None = None) -> Tensor:
        """As `layers.Denoiser.forward`; code: [B, C + 1]."""
        return self.denoiser(x, t, text, mask, self.straight(code) + self.bent(code))


class GaussianCode(NamedTuple):
    """What a reader guesses of codes: the mean of all that are possible, and how far they lie around it, [..., C]."""

    code: Tensor
    spread: Tensor

    @classmethod
    def of(cls, numbers: Tensor) -> GaussianCode:
        """From what the network says, [..., 2 C].

        >>> code, spread = GaussianCode.of(torch.zeros(5, 2 * CODES))
        >>> code.shape == spread.shape == (5, CODES) and bool((spread > 0).all())
        True
        """
        code, spread = numbers.chunk(2, -1)
        return cls(code, _LEAST_SPREAD + nn.functional.softplus(spread - 1))


@dataclass(eq=False)
class StyleCodeModel:
    """One model for every style (paper 1, section 7, leaves it open), made by `python -m motionkit train space`;
    `mk.methods.load("few-shot")` finds styles in it.

    prior: what takes motions forwards. network: what takes them back. chain: the steps that it was taught on. reader:
    what reads a code off a styled motion; without one a style is looked for from neutral on.
    """

    prior: Prior
    network: CodedDenoiser
    chain: PartialDiffusion
    reader: SemanticEncoder | None = None
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"StyleSpace({CODES} numbers say a style, on {self.prior!r})"

    @cached_property
    def key(self) -> str:
        """The same for the same weights of prior and space, and for no others; the reader does not count."""
        state = {name: value.half() for name, value in self.network.state_dict().items()}
        return text.content_key(state, self.prior.key)

    @property
    def config(self) -> TransformerConfig:
        """The network's sizes."""
        return self.network.denoiser.config

    @torch.no_grad()
    def neutral(self, x: Tensor, caption: str) -> Tensor:
        """The neutral motion for one in any style, features [F, D] both: the chain forwards, and back told to be so.

        It is quicker than paper 1's way through much noise (eqs. 7 and 8), and stays in step with the example.
        """
        noised = self.chain.forward(self.prior.predict([text.to_neutral(caption)], 1.0), x[None])
        words = self.prior.encoder.encode([text.to_neutral(caption)])
        code = torch.zeros(1, CODES + 1)
        code[:, -1] = 1
        return self.chain.reverse(lambda y, t: self.network(y, t, words, code), noised)[-1, 0]

    @torch.no_grad()
    def read(self, x: Tensor) -> GaussianCode | None:
        """What the reader guesses of the code of a styled motion's features [F, D]; None without a reader."""
        if self.reader is None:
            return None
        first = max(len(x) - self.reader.config.frames, 0) // 2
        return GaussianCode.of(self.reader(x[None, first : first + self.reader.config.frames])[0])

    def save_reader(self, path: str | os.PathLike, card: dict) -> Path:
        """The reader's weights and card, see `checkpoints.save`; 16 bits."""
        tensors = {name: value.half() for name, value in self.reader.state_dict().items()}
        card = {"kind": "reader", **card, "config": asdict(self.reader.config), "prior": self.prior.key}
        return checkpoints.save(path, tensors, card)

    def load_reader(self, path: str | os.PathLike) -> StyleCodeModel:
        """The space with the reader that `save_reader` wrote; MotionKitError where it is for another prior."""
        tensors, card = checkpoints.load(path, "reader")
        if card.get("prior") != self.prior.key:
            raise MotionKitError(f"{path}: this reader sees motions as another prior does; train one for this")
        reader = new_style_encoder(self.prior, checkpoints.load_config(path, card, TransformerConfig)).eval()
        checkpoints.load_into(reader, {name: value.float() for name, value in tensors.items()}, path)
        self.reader = reader.requires_grad_(False)
        return self

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`; 16 bits."""
        tensors = {name: value.half() for name, value in self.network.state_dict().items()}
        card = {"kind": "space", **self.card, "config": asdict(self.config), "prior": self.prior.key}
        return checkpoints.save(path, tensors, card | {"codes": list(parameters()), "stops": list(self.chain.stops)})

    @classmethod
    def load(cls, path: str | os.PathLike, prior: Prior) -> StyleCodeModel:
        """From what `save` wrote, for the prior that it was made from; MotionKitError where they do not fit."""
        tensors, card = checkpoints.load(path, "space")
        if card.get("prior") != prior.key or card.get("codes") != list(parameters()):
            raise MotionKitError(f"{path}: made from another prior, or by another performer; get both files again")
        config = checkpoints.load_config(path, card, TransformerConfig)
        size, words = prior.layout.size, prior.encoder.size
        network = CodedDenoiser(Denoiser(size, words, config, prior.schedule.steps)).eval()
        checkpoints.load_into(network, {name: value.float() for name, value in tensors.items()}, path)
        return cls(
            prior, network.requires_grad_(False), PartialDiffusion(prior.schedule, tuple(card["stops"])), card=card
        )


def new_style_encoder(prior: Prior, config: TransformerConfig | None = None) -> SemanticEncoder:
    """A network: paper 1's discriminator, `GaussianCode`s in place of sentences' vectors."""
    config = config or prior.network.config
    return SemanticEncoder(prior.layout.size, 2 * CODES, config, prior.network.embedding)


@lru_cache(maxsize=2)
def load(name: str = "actor") -> StyleCodeModel:
    """The shipped space of styles of a dataset; MotionKitError if there is none."""
    return load_for(text_to_motion.load(name)) or StyleCodeModel.load(
        checkpoints.find(f"{name}-space"), text_to_motion.load(name)
    )


def load_for(prior: Prior) -> StyleCodeModel | None:
    """The shipped space that was made from this very prior, with its reader if there is one; or None."""
    data, there = prior.card.get("data"), checkpoints.names()
    if f"{data}-space" not in there:
        return None
    path = checkpoints.find(f"{data}-space")
    if checkpoints.load(path, "space")[1].get("prior") != prior.key:
        return None
    space = StyleCodeModel.load(path, prior)
    return space.load_reader(checkpoints.find(f"{data}-reader")) if f"{data}-reader" in there else space


class StyleCode(nn.Module):
    """A style as a point of a space: the network as it is, told one code, which alone is learned.

    It has an `Adapter`'s interface, so `teach` finds the point as it trains an adapter; but the sentences that it hears
    stay neutral. start: a style, or what was
    read off a clip; neutral if left out.
    """

    rank, uses_style_text = 0, False

    def __init__(self, space: StyleCodeModel, start: Style | GaussianCode | None = None) -> None:
        super().__init__()
        self.space = (space,)  # in a tuple, so that it is no part of this module's state
        self.read = start if isinstance(start, GaussianCode) else None
        code = torch.zeros(CODES) if start is None else code_of(start) if self.read is None else self.read.code
        self.start = code.clone()
        self.changes = nn.ParameterDict({"code": code.clone()})

    @property
    def code(self) -> Tensor:
        """C + 1 numbers."""
        return torch.cat((self.changes["code"], torch.zeros(1)))

    def forward(self, x: Tensor, t: Tensor, text: Tensor, mask: Tensor | None = None) -> Tensor:
        """As `layers.Denoiser.forward`."""
        return self.space[0].network(x, t, text, self.code.expand(len(x), -1), mask)

    def unlikely(self) -> Tensor:
        """How unlikely such a style is: where it was read, by how far the reading may be off (a Gaussian's minus log).

        Where nothing was read, by how far it is from the start: some numbers may be, most are not (a Cauchy's minus
        log). Without it numbers that one clip says nothing of would wander off.
        """
        off = self.changes["code"] - self.start
        if self.read is not None:
            return _READ * 0.5 * ((off / self.read.spread) ** 2).mean()
        return _UNREAD * torch.log1p((off / _NEAR) ** 2).mean()

    def merged(self) -> Callable[..., Tensor]:
        """As `Adapter.frozen`."""
        code = self.code.detach()
        return lambda x, t, text, mask=None: self.space[0].network(x, t, text, code.expand(len(x), -1), mask)

    def style(self, name: str = "found") -> Style:
        """The performer's numbers that the point stands for, within their ranges."""
        numbers = {}
        for value, (key, about) in zip(self.changes["code"].tolist(), parameters().items()):
            numbers[key] = min(max(about.neutral + value * 0.5 * (about.high - about.low), about.low), about.high)
        return Style(name, **numbers)


STEPS, RATE, BATCH = 10000, 1e-3, 16
READER_STEPS, READER_RATE, READER_BATCH = 8000, 7e-4, 64
COUNT = 7200  # performances, each told in three styles
_BACK = 4  # of a batch so many are taken from their style to neutral
_SHORTEST = 96


@torch.no_grad()
def noised(prior: Prior, chain: PartialDiffusion, x: Tensor, words: Tensor) -> Tensor:
    """m_K of features [N, F, D] with their sentences' vectors [N, E], in half precision."""
    found = [
        chain.forward(lambda y, t, own=words[part]: prior.network(y, t, own), x[part].float()).half()
        for part in batches_of(len(x), 64)
    ]
    return torch.cat(found)


def train_decoder(
    prior: Prior, known: StylePairs, schedule: TrainConfig | None = None, start: StyleCodeModel | None = None, **running
) -> StyleCodeModel:
    """Teach the chain of a prior on lessons in invented styles (paper 1, eqs. 9 and 10), starting from its weights.

    A quarter of each batch goes from a styled motion to the neutral one, told so by a number of its own; the rest from
    neutral to a style by its code. start: a space of this prior to go on from. running: as in `training.fit`.
    """
    schedule = schedule or TrainConfig(STEPS, RATE, average=0.995)
    prior.network.eval()
    chain, words = (
        PartialDiffusion.from_paper(prior.schedule),
        prior.encoder.encode([text.to_neutral(c) for c in known.captions]),
    )
    plain, changed = (noised(prior, chain, x, words) for x in (known.neutral, known.styled))
    torch.manual_seed(schedule.seed)
    network = CodedDenoiser(copy.deepcopy(prior.network)) if start is None else copy.deepcopy(start.network)
    network.requires_grad_(True)

    def loss_fn(model: nn.Module, step: int) -> Tensor:
        chosen, here = torch.randint(len(known.styled), (BATCH,)), device_of(model)
        length = int(torch.randint(_SHORTEST // 4, FRAMES // 4 + 1, ())) * 4
        start = int(torch.randint(FRAMES - length + 1, ()))
        back, there, window = chosen[:_BACK], chosen[_BACK:], slice(start, start + length)
        given = torch.cat((changed[back, window], plain[there, window])).float().to(here)
        wanted = torch.cat((known.neutral[back, window], known.styled[there, window])).float().to(here)
        code, told = torch.zeros(BATCH, CODES + 1), words[chosen].to(here)
        code[:_BACK, -1], code[_BACK:, :-1] = 1, known.codes[there]
        code = code.to(here)
        return reconstruction_loss(chain.reverse(lambda x, t: model(x, t, told, code), given), wanted)

    run = fit(network, loss_fn, schedule, **running)
    space = StyleCodeModel(prior, network.requires_grad_(False), chain)
    space.card = {"seed": schedule.seed, "steps": schedule.steps, "seconds": round(run.seconds)}
    space.card |= {"steps_per_second": round(run.steps_per_second, 2), "hardware": checkpoints.hardware()}
    space.card |= {"parameters": sum(p.numel() for p in network.parameters()), "lessons": len(known.styled)}
    space.card["last_loss"] = round(sum(run.losses[-200:]) / len(run.losses[-200:]), 4)
    if start is not None:
        space.card["started_from"] = {key: start.card.get(key) for key in ("command", "steps", "seconds")}
    return space


def train_encoder(space: StyleCodeModel, known: StylePairs, schedule: TrainConfig | None = None, **running) -> dict:
    """Teach a network to read the code off a styled motion; the space has it afterwards. Returns its card.

    It learns to guess the mean of all that are possible, and how sure that is (`beta_nll`). running: as in
    `training.fit`.
    """
    schedule = schedule or TrainConfig(READER_STEPS, READER_RATE, decay=1e-2, average=0.995)
    torch.manual_seed(schedule.seed)
    reader = new_style_encoder(space.prior)

    def loss_fn(model: nn.Module, step: int) -> Tensor:
        chosen, here = torch.randint(len(known.styled), (READER_BATCH,)), device_of(model)
        length = int(torch.randint(_SHORTEST // 4, FRAMES // 4 + 1, ())) * 4
        start = int(torch.randint(FRAMES - length + 1, ()))
        x = known.styled[chosen, start : start + length].float().to(here)
        return beta_nll(GaussianCode.of(model(x)), known.codes[chosen].to(here))

    run = fit(reader, loss_fn, schedule, **running)
    space.reader = reader.requires_grad_(False)
    card = {"seed": schedule.seed, "steps": schedule.steps, "seconds": round(run.seconds)}
    card |= {"steps_per_second": round(run.steps_per_second, 2), "hardware": checkpoints.hardware()}
    return card | {"parameters": sum(p.numel() for p in reader.parameters()), "lessons": len(known.styled)}


def beta_nll(found: GaussianCode, codes: Tensor) -> Tensor:
    """The loss of readings of codes, both [..., C]: a Gaussian's minus log, where the unsure ones count as others do.

    Each number is weighted by the spread guessed for it, through which no gradient goes (the beta-NLL of Seitzer et
    al., 2022), or a network lets go of what it cannot read at once.

    >>> far, right = torch.ones(1, 3), torch.zeros(1, 3)
    >>> bool(beta_nll(GaussianCode(far, right + 0.1), right) > beta_nll(GaussianCode(far, far), right))
    True
    """
    each = nn.functional.gaussian_nll_loss(found.code, codes, found.spread**2, reduction="none")
    return (each * found.spread.detach()).mean()


def encoder_error(space: StyleCodeModel, known: StylePairs) -> dict[str, float]:
    """Mean square errors of codes read off lessons that were not learned from; `guessed`: of neutral for all.

    `expected`: what the reader itself thinks that its errors are.
    """
    with torch.no_grad():
        said = torch.cat([space.reader(known.styled[part].float()) for part in batches_of(len(known.styled), 64)])
    found = GaussianCode.of(said)
    errors = {"read": (found.code - known.codes).square().mean(), "guessed": known.codes.square().mean()}
    errors["expected"] = found.spread.square().mean()
    return {name: round(float(value), 4) for name, value in errors.items()}


def train_reader_part(data: Dataset, steps: int | None, seed: int, command: str) -> Path:
    """Train the reader of a dataset's space and write it where `load` finds it; returns the weights' path."""
    path, space = default_path(data.name, "reader"), load(data.name)
    schedule = TrainConfig(steps or READER_STEPS, READER_RATE, decay=1e-2, seed=seed, average=0.995)
    count = COUNT if steps is None or steps >= READER_STEPS else 24
    known, fresh = style_pairs(space.prior, count, seed=seed), style_pairs(space.prior, 60, seed=seed + 1)
    card = train_encoder(space, known, schedule, keep=path.with_suffix(".run"), title=path.stem)
    card = {"name": path.stem, "command": command, "data": data.name, **card, "licence": "MIT"}
    card |= {"data_sha256": str(VERSION) + space.prior.key[:4], "metrics": encoder_error(space, fresh)}
    main_process_first(lambda: space.save_reader(path, card))
    return path


@torch.no_grad()
def decoder_error(space: StyleCodeModel, known: StylePairs) -> dict[str, float]:
    """Mean square errors of the chain's last prediction on lessons that were not learned from, both ways.

    `styled`: from neutral to the style that the code says; `neutral`: from the style to neutral; `copied`: what there
    is between the two.
    """
    words = space.prior.encoder.encode([text.to_neutral(c) for c in known.captions])
    code = torch.cat((known.codes, torch.zeros(len(words), 1)), 1)
    found = {"copied": float((known.neutral.float() - known.styled.float()).square().mean())}
    flag = torch.zeros_like(code)
    flag[:, -1] = 1
    for name, given, wanted, told in (
        ("styled", known.neutral, known.styled, code),
        ("neutral", known.styled, known.neutral, flag),
    ):
        start = noised(space.prior, space.chain, given, words).float()
        made = space.chain.reverse(lambda x, t, told=told: space.network(x, t, words, told), start)[-1]
        found[name] = float((made - wanted.float()).square().mean())
    return {name: round(value, 4) for name, value in found.items()}


def train_part(data: Dataset, steps: int | None, seed: int, command: str, start: str | None = None) -> Path:
    """Train the space of a dataset's prior and write it where `load` finds it; returns the weights' path.

    start: the name of a space to go on from, the one trained before for instance. The state of the run is kept beside
    the weights, so a run that was broken off goes on. Only the performer can tell a motion in a style that was never
    captured, so raises MotionKitError for captures.
    """
    if data.name != "actor":
        raise MotionKitError(f"a space of styles is learned from the performer, data 'actor'; found {data.name!r}")
    path, prior = default_path(data.name, "space"), text_to_motion.load(data.name)
    schedule = TrainConfig(steps or STEPS, RATE, seed=seed, average=0.995)
    count = COUNT if steps is None or steps >= STEPS else max(24, COUNT * steps // STEPS)
    first, running = None, {"keep": path.with_suffix(".run"), "title": path.stem}
    if start:
        first = StyleCodeModel.load(checkpoints.find(start), prior)
    made = train_decoder(prior, style_pairs(prior, count, seed=seed), schedule, first, **running)
    made.card = {"name": path.stem, "command": command, "data": data.name, **made.card, "licence": "MIT"}
    made.card |= {
        "data_sha256": str(VERSION) + prior.key[:4],
        "metrics": decoder_error(made, style_pairs(prior, 60, seed=seed + 1)),
    }
    main_process_first(lambda: made.save(path))
    return path
