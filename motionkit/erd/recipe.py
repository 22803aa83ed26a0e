"""How Style-ERD is trained (paper 2, section 3.2 and supplement A): generator and critic in one loop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from torch import Tensor, nn
from torch.func import functional_call

from ..datasets import Dataset
from ..layers import ContentNet, ErdConfig, FtAttCritic, MultiClassCritic, StyleErd
from ..layers.style_erd import put_back
from ..restyling import body_of
from ..skeleton import Skeleton
from ..training import Run, Schedule, fit
from .frames import TENTH, lowest_foot, placed_positions, split
from .losses import (
    adversarial_loss,
    critic_loss,
    critic_total,
    generator_total,
    gradient_penalty,
    perceptual_loss,
    rebuilding_loss,
)
from .pieces import Pieces


@dataclass(frozen=True)
class ErdRecipe:
    """How it is trained (paper 2, section 3.2 and supplement A).

    steps, batch, rate: of the generator; slower: the critic's rate over it. adversarial, perceptual, attention,
    beginnings: false leaves that part out (table 1). fps: of the windows. cycle: above 0, styles need not have been
    seen doing the same (beyond the paper, its section C.1): the critic is shown whatever there is of a style,
    and what was told in another style must come back as it was, which counts so much. run_up: half of the batches are
    not the beginning of a stream; their memory comes from up to so many earlier windows (beyond the paper, where each
    window begins anew). opened: added to the biases of the gates that take and give before training, so that more
    gets through deep stacks from the first step on. steady: how much it counts that rebuilt positions move from frame
    to frame as those that came in do, or they tremble (beyond the paper). registered: how much it counts that a window
    with a twin (see `Pieces`) is told as that one; the paper needs pairs, but none in step. `paper()` is as published,
    `laptop()` has the same parts and sizes.
    """

    config: ErdConfig = ErdConfig()
    steps: int = 20000
    batch: int = 16
    rate: float = 1e-4
    slower: float = 0.5
    fps: float = 60.0
    adversarial: bool = True
    perceptual: bool = True
    attention: bool = True
    beginnings: bool = True
    cycle: float = 0.0
    run_up: int = 0
    opened: float = 0.0
    steady: float = 0.0
    registered: float = 0.0

    @classmethod
    def paper(cls, windows: int) -> ErdRecipe:
        """Paper 2, supplement A: 2,000 epochs, batch 16, rates 0.0001 and 0.00005; windows: how many there are."""
        return cls(steps=2000 * -(-windows // 16))

    @classmethod
    def laptop(cls) -> ErdRecipe:
        """Larger batches and rates, fewer steps; run-ups, open gates, steadiness, twins, what is lost is put back."""
        beyond = {"run_up": 9, "opened": 1.5, "steady": 8.0, "registered": 1.0, "config": ErdConfig(skip=True)}
        return cls(steps=16000, batch=64, rate=3e-3, **beyond)


_FULL = replace(ErdRecipe.laptop(), registered=0.0, config=ErdConfig())
ABLATIONS = {  # the rows of paper 2's table 1, each one call, and two of which the paper knows nothing
    "ours": _FULL,
    "L_gen = L_rec": replace(_FULL, adversarial=False, perceptual=False),
    "L_gen = L_rec + L_adv": replace(_FULL, perceptual=False),
    "L_gen = L_rec + L_per": replace(_FULL, adversarial=False),
    "without attention": replace(_FULL, attention=False),
    "without learned beginnings": replace(_FULL, beginnings=False),
    "ours + twins": replace(_FULL, registered=ErdRecipe.laptop().registered),
    "ours + twins + skip": ErdRecipe.laptop(),
}


class Pair(nn.Module):
    """Generator and critic side by side, so that one loop trains both, the critic at a rate of its own."""

    def __init__(self, generator: StyleErd, critic: nn.Module, slower: float) -> None:
        super().__init__()
        self.generator, self.critic, self.slower = generator, critic, slower

    def parameter_groups(self) -> list[dict]:
        """For `training.fit`: what is trained, and at which share of the rate."""
        mine = [weight for weight in self.generator.parameters() if weight.requires_grad]
        return [{"params": mine, "share": 1.0}, {"params": list(self.critic.parameters()), "share": self.slower}]

    def judged(self, seen: Tensor, style: Tensor, content: Tensor) -> Tensor:
        """The critic's answers, by which the generator learns and the critic does not."""
        fixed = {name: weight.detach() for name, weight in self.critic.named_parameters()}
        return functional_call(self.critic, fixed, (seen, style, content))


@dataclass(frozen=True, eq=False)
class Course:
    """All that a step of training needs: windows, the skeleton that they are on, the content network, the recipe."""

    pieces: Pieces
    skeleton: Skeleton
    contents: ContentNet
    recipe: ErdRecipe

    def draw(self, back: int = 0) -> tuple[Tensor, Tensor]:
        """Windows by chance, long [B], and the style that each is to be told in, long [B] (paper 2, section 3.2).

        Neutral ones go to any other style that has this content, styled ones to neutral, and who has a twin to its
        style. With a cycle the content does not matter. back: how many windows there must be before each.
        """
        able = torch.nonzero(self.pieces.earlier >= back)[:, 0]
        chosen = able[torch.randint(len(able), (self.recipe.batch,))]
        wanted = []
        for content, style in zip(self.pieces.content[chosen].tolist(), self.pieces.style[chosen].tolist()):
            others = sorted({s for c, s in self.members if s != 0 and (c == content or self.recipe.cycle)})
            wanted.append(others[int(torch.rand(()) * len(others))] if style == 0 and others else 0)
        twin, wanted = self.pieces.twin[chosen], torch.tensor(wanted)
        return chosen, torch.where(twin < 0, wanted, self.pieces.style[twin])

    @cached_property
    def members(self) -> dict[tuple[int, int], Tensor]:
        """See `Pieces.members`."""
        return self.pieces.members()

    @cached_property
    def by_style(self) -> dict[int, Tensor]:
        """The windows of every style."""
        style = self.pieces.style[: self.pieces.recorded]
        return {s: torch.nonzero(style == s)[:, 0] for s in set(style.tolist())}

    def back(self) -> int:
        """How many windows a batch's memory comes from: for half of them none, nor for cycles; else up to `run_up`."""
        most = 0 if self.recipe.cycle else min(self.recipe.run_up, int(self.pieces.earlier.max()))
        return int(torch.randint(1, most + 1, ())) if most and torch.rand(()) < 0.5 else 0

    def real(self, content: Tensor, style: Tensor, amid: bool = False) -> tuple[Tensor, Tensor]:
        """For each content and style a real window by chance, [B, F, 6J], and its content, long [B].

        It is the paired motion, not in step with it; with a cycle, any motion in this style. amid: in the middle of a
        stream.
        """
        kinds = zip(content.tolist(), style.tolist())
        own = [self.by_style[kind[1]] if self.recipe.cycle else self.members[kind] for kind in kinds]
        rows = torch.stack([kind[int(torch.rand(()) * len(kind))] for kind in own])
        x = self.pieces.amid(rows) if amid else self.pieces.x[rows]
        return x[..., 4 * len(self.skeleton) :], self.pieces.content[rows]

    def loss(self, pair: Pair) -> Tensor:
        """One step's loss of both, eqs. 8 and 9 of paper 2 together: neither's gradient reaches the other."""
        recipe, joints, back = self.recipe, len(self.skeleton), self.back()
        chosen, target = self.draw(back)
        x, content, style = (part[chosen] for part in (self.pieces.x, self.pieces.content, self.pieces.style))
        x = self.pieces.amid(chosen) if back else x
        came, net, state = _parts(x, joints), pair.generator, None
        offsets, low = self.pieces.offsets[chosen][:, None], lowest_foot(self.skeleton, came[1])
        place = partial(placed_positions, self.skeleton, offsets, lowest=low)
        needed = (net.weights_of(style) + net.weights_of(target)) > 0
        if back:
            with torch.no_grad():
                state = net.hear(self.pieces.run_up(chosen, back), content, style, needed)[1]
        heard, _ = net.hear(x, content, style, needed, state)
        rebuilt, told = self._answers(net, x, heard, style, target)
        made = place(told[0])
        rebuilding = self._missed(came, (rebuilt[0], place(rebuilt[0]), rebuilt[1]))
        if recipe.registered:
            rebuilding = rebuilding + recipe.registered * self._unlike_twins(chosen, back > 0, place, made, told)
        fake = torch.cat((made.flatten(2), told[1].flatten(2)), 2)
        after = torch.cat((told[0].flatten(2), fake), 2)
        if recipe.cycle:
            again = self._answers(net, after, net.hear(after, content, target, needed)[0], target, style)[1]
            returned = rebuilding_loss((came[0], again[0]), (came[1], place(again[0])), (came[2], again[1]))
            rebuilding = rebuilding + recipe.cycle * returned
        nothing = x.new_zeros(())
        adversarial = adversarial_loss(pair.judged(fake, target, content)) if recipe.adversarial else nothing
        kept = perceptual_loss(self.contents(x)[1], self.contents(after)[1]) if recipe.perceptual else nothing
        total = generator_total(rebuilding, adversarial, kept)
        return total + self._critics(pair, fake.detach(), target, content, back > 0) if recipe.adversarial else total

    @staticmethod
    def _answers(net: StyleErd, x: Tensor, heard: Tensor, own: Tensor, other: Tensor) -> list[tuple]:
        """What is said of frames x in their own style, and, with what that loses put back, in another."""
        rebuilt, told = (net.say(heard, net.weights_of(style)) for style in (own, other))
        return [split(rebuilt), split(put_back(x, told, rebuilt) if net.config.skip else told)]

    def _missed(self, aim: tuple, made: tuple) -> Tensor:
        """Eq. 3 of rotations, positions, velocities, and how unlike the positions move from frame to frame: [B, F]."""
        missed = rebuilding_loss(*zip(aim, made))
        if not self.recipe.steady:
            return missed
        off = made[1] - aim[1]
        trembling = off.diff(dim=1, prepend=off[:, :1]) * (self.recipe.fps / TENTH)
        return missed + self.recipe.steady * trembling.square().sum((-2, -1))

    def _unlike_twins(self, chosen: Tensor, amid: bool, place, made: Tensor, told: tuple) -> Tensor:
        """`_missed` of what was told [B, F] by those that have a twin, on their own bodies; 0 of the others."""
        twin = self.pieces.twin[chosen]
        rows = twin.clamp(min=0)
        turns, _, speeds = _parts(self.pieces.amid(rows) if amid else self.pieces.x[rows], len(self.skeleton))
        missed = self._missed((turns, place(turns), speeds), (told[0], made, told[1]))
        return missed * (twin >= 0)[:, None]

    def _critics(self, pair: Pair, fake: Tensor, style: Tensor, content: Tensor, amid: bool) -> Tensor:
        """The critic's loss of motions [B, F, 6J] that were made in styles, and of real ones (eq. 9)."""
        real, theirs = self.real(content, style, amid)
        real = real.clone().requires_grad_()
        answers = pair.critic(real, style, theirs)
        critic = critic_loss(answers, pair.critic(fake, style, content))
        return critic_total(critic, gradient_penalty(answers, real))


def _parts(x: Tensor, joints: int) -> tuple[Tensor, Tensor, Tensor]:
    """Frames [..., 10J] as quaternions [..., J, 4], positions and velocities [..., J, 3]."""
    turns, places, speeds = x.split((4 * joints, 3 * joints, 3 * joints), -1)
    return turns.unflatten(-1, (joints, 4)), places.unflatten(-1, (joints, 3)), speeds.unflatten(-1, (joints, 3))


def train_contents(pieces: Pieces, joints: int, steps: int = 600, seed: int = 0, **running) -> ContentNet:
    """Paper 2's content network (section 3.1), a classifier of windows; frozen afterwards."""
    torch.manual_seed(seed)
    net = ContentNet(joints, len(pieces.contents))

    def loss_of(model: nn.Module, step: int) -> Tensor:
        chosen = torch.randint(len(pieces.x), (64,))
        return nn.functional.cross_entropy(model(pieces.x[chosen])[0], pieces.content[chosen])

    running.setdefault("title", "contents")
    fit(net, loss_of, Schedule(steps, 1e-3, seed=seed), **running)
    return net.requires_grad_(False)


def train_erd(
    data: Dataset, recipe: ErdRecipe | None = None, seed: int = 0, contents: ContentNet | None = None, **running
) -> tuple[StyleErd, Run, Pieces]:
    """Train Style-ERD on all clips of a labelled dataset (paper 2, section 3.2): the generator, its run, its windows.

    contents: a content network that is there already. running: as in `training.fit`. Raises MotionKitError where no
    style is neutral.
    """
    recipe = recipe or ErdRecipe.laptop()
    pieces = Pieces.of(data, recipe.fps, registered=recipe.registered > 0)
    skeleton = body_of(data[0].motion).skeleton
    joints, counts = len(skeleton), (len(pieces.contents), len(pieces.styles))
    contents = contents if contents is not None else train_contents(pieces, joints, seed=seed)
    torch.manual_seed(seed)
    critic = (FtAttCritic if recipe.attention else MultiClassCritic)(joints, *counts)
    pair = Pair(StyleErd(joints, *counts, recipe.config, recipe.beginnings, recipe.opened), critic, recipe.slower)
    course = Course(pieces, skeleton, contents.eval(), recipe)
    same = f"{recipe}, {len(pieces.x)} windows of {pieces.contents} in {pieces.styles}"
    schedule = Schedule(recipe.steps, recipe.rate, decay=0.0, clip=1e6, seed=seed, average=0.995, recipe=same)
    run = fit(pair, lambda model, step: course.loss(model), schedule, **running)
    return pair.generator.eval(), run, pieces
