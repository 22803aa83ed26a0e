"""How a space of styles is trained: `python -m motionkit train space --data actor`."""

from __future__ import annotations

import copy
from pathlib import Path

import torch
from torch import Tensor, nn

from .. import checkpoints, priors, text
from ..cards import place_for
from ..datasets import Dataset
from ..datasets.made import version
from ..errors import MotionKitError
from ..priors import Prior
from ..training import Schedule, device_of, fit, in_main
from .chain import Chain, reconstruction_loss
from .invented import FRAMES, Lessons, batches_of, lessons
from .space import CODES, CodedDenoiser, Reading, StyleSpace, fresh_reader, load

STEPS, RATE, BATCH = 10000, 1e-3, 16
READER_STEPS, READER_RATE, READER_BATCH = 8000, 7e-4, 64
COUNT = 7200  # performances, each told in three styles
_BACK = 4  # of a batch so many are taken from their style to neutral
_SHORTEST = 96


@torch.no_grad()
def noised(prior: Prior, chain: Chain, x: Tensor, words: Tensor) -> Tensor:
    """m_K of features [N, F, D] with their sentences' vectors [N, E], in half precision."""
    found = [
        chain.forward(lambda y, t, own=words[part]: prior.network(y, t, own), x[part].float()).half()
        for part in batches_of(len(x), 64)
    ]
    return torch.cat(found)


def train_space(
    prior: Prior, known: Lessons, schedule: Schedule | None = None, start: StyleSpace | None = None, **running
) -> StyleSpace:
    """Teach the chain of a prior on lessons in invented styles (paper 1, eqs. 9 and 10), starting from its weights.

    A quarter of each batch goes from a styled motion to the neutral one, told so by a number of its own; the rest from
    neutral to a style by its code. start: a space of this prior to go on from. running: as in `training.fit`.
    """
    schedule = schedule or Schedule(STEPS, RATE, average=0.995)
    prior.network.eval()
    chain, words = Chain.like_paper(prior.schedule), prior.encoder.encode([text.to_neutral(c) for c in known.captions])
    plain, changed = (noised(prior, chain, x, words) for x in (known.neutral, known.styled))
    torch.manual_seed(schedule.seed)
    network = CodedDenoiser(copy.deepcopy(prior.network)) if start is None else copy.deepcopy(start.network)
    network.requires_grad_(True)

    def loss_of(model: nn.Module, step: int) -> Tensor:
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

    run = fit(network, loss_of, schedule, **running)
    space = StyleSpace(prior, network.requires_grad_(False), chain)
    space.card = {"seed": schedule.seed, "steps": schedule.steps, "seconds": round(run.seconds)}
    space.card |= {"steps_per_second": round(run.steps_per_second, 2), "hardware": checkpoints.hardware()}
    space.card |= {"parameters": sum(p.numel() for p in network.parameters()), "lessons": len(known.styled)}
    space.card["last_loss"] = round(sum(run.losses[-200:]) / len(run.losses[-200:]), 4)
    if start is not None:
        space.card["started_from"] = {key: start.card.get(key) for key in ("command", "steps", "seconds")}
    return space


def train_reader(space: StyleSpace, known: Lessons, schedule: Schedule | None = None, **running) -> dict:
    """Teach a network to read the code off a styled motion; the space has it afterwards. Returns its card.

    It learns to guess the mean of all that are possible, and how sure that is (`doubted`). running: as in
    `training.fit`.
    """
    schedule = schedule or Schedule(READER_STEPS, READER_RATE, decay=1e-2, average=0.995)
    torch.manual_seed(schedule.seed)
    reader = fresh_reader(space.prior)

    def loss_of(model: nn.Module, step: int) -> Tensor:
        chosen, here = torch.randint(len(known.styled), (READER_BATCH,)), device_of(model)
        length = int(torch.randint(_SHORTEST // 4, FRAMES // 4 + 1, ())) * 4
        start = int(torch.randint(FRAMES - length + 1, ()))
        x = known.styled[chosen, start : start + length].float().to(here)
        return doubted(Reading.of(model(x)), known.codes[chosen].to(here))

    run = fit(reader, loss_of, schedule, **running)
    space.reader = reader.requires_grad_(False)
    card = {"seed": schedule.seed, "steps": schedule.steps, "seconds": round(run.seconds)}
    card |= {"steps_per_second": round(run.steps_per_second, 2), "hardware": checkpoints.hardware()}
    return card | {"parameters": sum(p.numel() for p in reader.parameters()), "lessons": len(known.styled)}


def doubted(found: Reading, codes: Tensor) -> Tensor:
    """The loss of readings of codes, both [..., C]: a Gaussian's minus log, where the unsure ones count as others do.

    Each number is weighted by the spread guessed for it, through which no gradient goes (the beta-NLL of Seitzer et
    al., 2022), or a network lets go of what it cannot read at once.

    >>> far, right = torch.ones(1, 3), torch.zeros(1, 3)
    >>> bool(doubted(Reading(far, right + 0.1), right) > doubted(Reading(far, far), right))
    True
    """
    each = nn.functional.gaussian_nll_loss(found.code, codes, found.spread**2, reduction="none")
    return (each * found.spread.detach()).mean()


def misread(space: StyleSpace, known: Lessons) -> dict[str, float]:
    """Mean square errors of codes read off lessons that were not learned from; `guessed`: of neutral for all.

    `expected`: what the reader itself thinks that its errors are.
    """
    with torch.no_grad():
        said = torch.cat([space.reader(known.styled[part].float()) for part in batches_of(len(known.styled), 64)])
    found = Reading.of(said)
    errors = {"read": (found.code - known.codes).square().mean(), "guessed": known.codes.square().mean()}
    errors["expected"] = found.spread.square().mean()
    return {name: round(float(value), 4) for name, value in errors.items()}


def train_reader_part(data: Dataset, steps: int | None, seed: int, command: str) -> Path:
    """Train the reader of a dataset's space and write it where `space.load` finds it; returns the weights' path."""
    path, space = place_for(data.name, "reader"), load(data.name)
    schedule = Schedule(steps or READER_STEPS, READER_RATE, decay=1e-2, seed=seed, average=0.995)
    count = COUNT if steps is None or steps >= READER_STEPS else 24
    known, fresh = lessons(space.prior, count, seed=seed), lessons(space.prior, 60, seed=seed + 1)
    card = train_reader(space, known, schedule, keep=path.with_suffix(".run"), title=path.stem)
    card = {"name": path.stem, "command": command, "data": data.name, **card, "licence": "MIT"}
    card |= {"data_sha256": version() + space.prior.key[:4], "metrics": misread(space, fresh)}
    in_main(lambda: space.save_reader(path, card))
    return path


@torch.no_grad()
def misses(space: StyleSpace, known: Lessons) -> dict[str, float]:
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
    """Train the space of a dataset's prior and write it where `space.load` finds it; returns the weights' path.

    start: the name of a space to go on from, the one trained before for instance. The state of the run is kept beside
    the weights, so a run that was broken off goes on. Only the performer can tell a motion in a style that was never
    captured, so raises MotionKitError for captures.
    """
    if data.name != "actor":
        raise MotionKitError(f"a space of styles is learned from the performer, data 'actor'; found {data.name!r}")
    path, prior = place_for(data.name, "space"), priors.load(data.name)
    schedule = Schedule(steps or STEPS, RATE, seed=seed, average=0.995)
    count = COUNT if steps is None or steps >= STEPS else max(24, COUNT * steps // STEPS)
    first, running = None, {"keep": path.with_suffix(".run"), "title": path.stem}
    if start:
        first = StyleSpace.load(checkpoints.find(start), prior)
    made = train_space(prior, lessons(prior, count, seed=seed), schedule, first, **running)
    made.card = {"name": path.stem, "command": command, "data": data.name, **made.card, "licence": "MIT"}
    made.card |= {"data_sha256": version() + prior.key[:4], "metrics": misses(made, lessons(prior, 60, seed=seed + 1))}
    in_main(lambda: made.save(path))
    return path
