"""Paper 2, Style-ERD: responsive and coherent online style transfer, one frame in, one frame out.

In the order of the paper: the losses (section 3.2, eqs. 2 to 9), training, and the method. The networks of section 3.1
(generator, discriminator with eq. 1, content classifier) are in `style_erd_network`, what they see of a motion in
`features.style_erd`; the training windows are in `style_erd_data`, what guesses labels in `style_erd_labels`, live
streams in `style_erd_stream` and `style_erd_numpy`, a style more from one clip in `style_erd_new_style`.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache, partial

import numpy as np
import torch
from torch import Tensor, nn

from .. import checkpoints
from .. import rotations as rot
from ..checkpoints import Checkpoint, Saved, skeleton_card, training_card
from ..datasets import Dataset, Labels
from ..errors import MotionKitError
from ..features.style_erd import TENTH, frames_of, lowest_foot, motion_from, placed_positions, split, split_frames
from ..motion import Motion
from ..skeleton import Skeleton
from ..training import Run, TrainConfig, TrainOrder, fit, fit_adversarial
from .base import NEUTRAL, StyleTransfer, as_example, check_strength, without_helper_joints
from .style_erd_data import Draw, Windows
from .style_erd_labels import FRAMES, FrameClassifier, label_accuracy, recognize_frames, train_frame_classifier
from .style_erd_network import (
    ContentClassifier,
    FTAttDiscriminator,
    MultiClassDiscriminator,
    Sizes,
    StyleErd,
    input_residual,
)
from .style_erd_numpy import NumpyKinematics, NumpyStep
from .style_erd_stream import ErdStream

ADVERSARIAL, PERCEPTUAL, PENALTY = 1.0, 0.1, 128.0  # w_adv, w_per and w_gp (paper 2, below eq. 9)
LABEL_STEPS = 1500
_LATE = 0.5  # seconds that a guessed content comes late


# -- the losses (section 3.2) ----------------------------------------------------------------------------------------


def quaternion_loss(a: Tensor, b: Tensor) -> Tensor:
    """The squared angles between unit quaternions [..., J, 4] (paper 2, eq. 2), summed over joints, [...].

    The arc cosine of |a . b|, half the angle of the rotation from one to the other. Near equal ones its gradient is
    unbounded; that of the same angle by the arc tangent is not.

    >>> turned = torch.tensor([[0.5, 0.5, 0.5, 0.5]])
    >>> quaternion_loss(torch.tensor([[1.0, 0.0, 0.0, 0.0]]), -turned)  # (pi / 3) squared: both signs are one rotation
    tensor(1.0966)
    """
    w, *v = rot.quaternion_multiply(rot.quaternion_inverse(a), b).unbind(-1)
    across = sum(x * x for x in v).clamp(min=1e-12).sqrt()
    return (torch.atan2(across, w.abs()) ** 2).sum(-1)


def reconstruction_loss(
    rotations: tuple[Tensor, Tensor], positions: tuple[Tensor, Tensor], velocities: tuple[Tensor, Tensor]
) -> Tensor:
    """How far reconstructed frames are from those that came in (paper 2, eq. 3), [B, F].

    Each a pair, came in and reconstructed: unit quaternions [B, F, J, 4], positions and velocities [B, F, J, 3].

    >>> still = (rot.identity_quaternion(1, 2, 5), rot.identity_quaternion(1, 2, 5))
    >>> there, here = torch.zeros(1, 2, 5, 3), torch.ones(1, 2, 5, 3)
    >>> reconstruction_loss(still, (there, here), (there, there))
    tensor([[7.5000, 7.5000]])
    """
    positions, velocities = (((a - b) ** 2).sum((-2, -1)) for a, b in (positions, velocities))
    return quaternion_loss(*rotations) + 0.5 * positions + velocities


def adversarial_loss(fake: Tensor) -> Tensor:
    """L_adv: the generator wants the critic's scores [B] of its motions to be 0 (paper 2, eq. 4, as written).

    >>> adversarial_loss(torch.tensor([-1.0, 0.0]))
    tensor(0.5000)
    """
    return (fake**2).mean()


def discriminator_loss(real: Tensor, fake: Tensor) -> Tensor:
    """L_cri: the critic wants 1 for real motions, -1 for generated ones, both [B] (paper 2, eq. 5).

    >>> discriminator_loss(torch.tensor([1.0]), torch.tensor([0.0]))
    tensor(1.)
    """
    return ((real - 1) ** 2).mean() + ((fake + 1) ** 2).mean()


def gradient_penalty(scores: Tensor, real: Tensor) -> Tensor:
    """The squared gradient of the critic at real motions (paper 2, eq. 6; Mescheder et al. 2018).

    scores: [B], the critic's; real: [B, ...], what it saw, which must require gradients.

    >>> x = torch.ones(2, 3, requires_grad=True)
    >>> gradient_penalty((2 * x).sum(1), x)
    tensor(12.)
    """
    gradient = torch.autograd.grad(scores.sum(), real, create_graph=True)[0]
    return gradient.flatten(1).square().sum(1).mean()


def perceptual_loss(before: Sequence[Tensor], after: Sequence[Tensor]) -> Tensor:
    """How far the content classifier's maps are apart, before and after the transfer (paper 2, eq. 7).

    Maps [B, C', T'] of every layer. Eq. 7 is a squared norm, a sum over the map; here it is the map's mean, summed over
    layers, so that w_per = 0.1 counts less than as written.

    >>> perceptual_loss([torch.zeros(1, 2, 3)], [torch.full((1, 2, 3), 2.0)])
    tensor(4.)
    """
    return sum(((a - b) ** 2).mean() for a, b in zip(before, after, strict=True))


def generator_objective(reconstruction: Tensor, adversarial: Tensor, perceptual: Tensor) -> Tensor:
    """L_gen (paper 2, eq. 8): reconstruction of all frames [B, F], and both supervision modules.

    >>> generator_objective(torch.ones(2, 24), torch.tensor(0.5), torch.tensor(2.0))
    tensor(24.7000)
    """
    return reconstruction.sum(1).mean() + ADVERSARIAL * adversarial + PERCEPTUAL * perceptual


def discriminator_objective(loss: Tensor, penalty: Tensor) -> Tensor:
    """L_dis, all of the critic's loss (paper 2, eq. 9).

    >>> discriminator_objective(torch.tensor(2.0), torch.tensor(0.5))
    tensor(66.)
    """
    return loss + PENALTY * penalty


# -- training (section 3.2 and supplement A) -------------------------------------------------------------------------


@dataclass(frozen=True)
class Config:
    """How it is trained (paper 2, section 3.2 and supplement A).

    steps, batch, lr: of the generator; critic_lr_ratio: the critic's learning rate over it. adversarial, perceptual,
    attention, initial_states: false leaves that part out (table 1). fps: of the windows. Beyond the paper, and 0 in it:
    cycle: above 0, styles need not have been seen doing the same (supplement C.1), and what was restyled must come back
    as it was, which counts so much. ema: of the weights, see `training.TrainConfig`. burn_in: warm-start windows, see
    `style_erd_data.Draw`. gate_bias: gate-bias initialisation, see `StyleErd`. smoothness: how much it counts that
    positions move from frame to frame as their target does, or they tremble, where they are reconstructed and where
    they are restyled as a pair. paired: how much it counts that a window that is paired in time is restyled as its
    pair; the paper needs pairs, but none in step. `laptop()` adds all of these but the cycle, and
    `Sizes.input_residual`.
    """

    sizes: Sizes = Sizes()
    steps: int = 20000
    batch: int = 16
    lr: float = 1e-4
    critic_lr_ratio: float = 0.5
    fps: float = 60.0
    adversarial: bool = True
    perceptual: bool = True
    attention: bool = True
    initial_states: bool = True
    cycle: float = 0.0
    burn_in: int = 0
    gate_bias: float = 0.0
    smoothness: float = 0.0
    paired: float = 0.0
    ema: float = 0.0

    @classmethod
    def paper(cls, windows: int) -> Config:
        """Paper 2, supplement A: 2,000 epochs, batch 16, rates 0.0001 and 0.00005; windows: how many there are."""
        return cls(steps=2000 * -(-windows // 16))

    @classmethod
    def laptop(cls) -> Config:
        """Larger batches and rates, fewer steps; and everything beyond the paper but the cycle."""
        beyond = {"burn_in": 9, "gate_bias": 1.5, "smoothness": 8.0, "paired": 1.0, "ema": 0.995}
        return cls(Sizes(input_residual=True), steps=16000, batch=64, lr=3e-3, **beyond)

    @classmethod
    def tiny(cls) -> Config:
        """For tests."""
        return cls(Sizes.tiny(), steps=4, batch=6, lr=1e-3, fps=30.0)


_FULL = replace(Config.laptop(), paired=0.0, sizes=Sizes())
ABLATIONS = {  # paper 2's table 1, all with the burn-in, gate bias, smoothness and EMA of `laptop()`; two more
    "ours": _FULL,
    "L_gen = L_rec": replace(_FULL, adversarial=False, perceptual=False),
    "L_gen = L_rec + L_adv": replace(_FULL, perceptual=False),
    "L_gen = L_rec + L_per": replace(_FULL, adversarial=False),
    "without attention": replace(_FULL, attention=False),
    "without learned initial states": replace(_FULL, initial_states=False),
    "ours + time-aligned pairs": replace(_FULL, paired=Config.laptop().paired),
    "ours + time-aligned pairs + input residual": Config.laptop(),
}


class StyleErdLoss(nn.Module):
    """Eqs. 8 and 9 of paper 2 on a batch of `style_erd_data.Draw`; it holds the frozen content classifier."""

    def __init__(self, skeleton: Skeleton, contents: ContentClassifier, config: Config) -> None:
        super().__init__()
        self.skeleton, self.config = skeleton, config
        self.contents = contents.eval().requires_grad_(False)

    def generator(self, generator: StyleErd, critic: nn.Module | None, batch: dict) -> tuple[Tensor, Tensor]:
        """The generator's loss, and what it generated as the critic sees it, [B, F, 6J].

        L_gen (paper 2, eq. 8); where the config says so, with what goes beyond the paper: smoothness, paired, cycle.
        """
        config, x, content, target = self.config, batch["x"], batch["content"], batch["target"]
        source = split_frames(x)
        place = partial(placed_positions, self.skeleton, batch["offsets"], lowest=lowest_foot(self.skeleton, source[1]))
        active, states = generator.one_hot(batch["style"]) + generator.one_hot(target) > 0, None
        if batch["burn_in"] is not None:
            with torch.no_grad():
                states = generator.branch_features(batch["burn_in"], content, batch["style"], active=active)[1]
        features, _ = generator.branch_features(x, content, batch["style"], active=active, states=states)
        rebuilt, styled = self._outputs(generator, x, features, batch["style"], target)
        positions = place(styled[0])
        reconstruction = self._distance(source, (rebuilt[0], place(rebuilt[0]), rebuilt[1]))
        if config.paired:
            pair = split_frames(batch["pair"])
            pair = pair[0], place(pair[0]), pair[2]
            distance = self._distance(pair, (styled[0], positions, styled[1])) * batch["has_pair"][:, None]
            reconstruction = reconstruction + config.paired * distance
        fake = torch.cat((positions.flatten(2), styled[1].flatten(2)), 2)
        after = torch.cat((styled[0].flatten(2), fake), 2)
        if config.cycle:
            features, _ = generator.branch_features(after, content, target, active=active)
            again = self._outputs(generator, after, features, target, batch["style"])[1]
            returned = reconstruction_loss((source[0], again[0]), (source[1], place(again[0])), (source[2], again[1]))
            reconstruction = reconstruction + config.cycle * returned
        zero = x.new_zeros(())
        adversarial = adversarial_loss(critic(fake, target, content)) if config.adversarial else zero
        perceptual = perceptual_loss(self.contents(x)[1], self.contents(after)[1]) if config.perceptual else zero
        return generator_objective(reconstruction, adversarial, perceptual), fake

    def critic(self, critic: nn.Module, fake: Tensor, batch: dict) -> Tensor:
        """The critic's loss (paper 2, eq. 9) of generated motions [B, F, 6J] and of real ones."""
        real = batch["real"].clone().requires_grad_()
        scores = critic(real, batch["target"], batch["real_content"])
        loss = discriminator_loss(scores, critic(fake, batch["target"], batch["content"]))
        return discriminator_objective(loss, gradient_penalty(scores, real))

    def forward(self, generator: StyleErd, batch: dict) -> Tensor:
        """Eq. 8 without a critic, for configs that leave the adversarial term out."""
        return self.generator(generator, None, batch)[0]

    @staticmethod
    def _outputs(generator: StyleErd, x: Tensor, features: Tensor, own: Tensor, other: Tensor) -> list[tuple]:
        """The outputs of frames x in their own style, and, with what that loses put back, in another."""
        rebuilt, styled = (generator.decode(features, generator.one_hot(style)) for style in (own, other))
        styled = input_residual(x, styled, rebuilt) if generator.config.input_residual else styled
        return [split(rebuilt), split(styled)]

    def _distance(self, target: tuple, output: tuple) -> Tensor:
        """Eq. 3 of rotations, positions, velocities, and how unlike the positions move from frame to frame: [B, F]."""
        distance = reconstruction_loss(*zip(target, output))
        if not self.config.smoothness:
            return distance
        off = output[1] - target[1]
        trembling = off.diff(dim=1, prepend=off[:, :1]) * (self.config.fps / TENTH)
        return distance + self.config.smoothness * trembling.square().sum((-2, -1))


def train_content_classifier(
    windows: Windows, joints: int, steps: int = 600, seed: int = 0, **running
) -> ContentClassifier:
    """Paper 2's content supervision (section 3.1), a classifier of windows; frozen afterwards."""
    torch.manual_seed(seed)
    network = ContentClassifier(joints, len(windows.contents))

    def draw(step: int) -> tuple[Tensor, Tensor]:
        chosen = torch.randint(len(windows.x), (64,))
        return windows.x[chosen], windows.content[chosen]

    def loss_fn(model: nn.Module, batch: tuple[Tensor, Tensor]) -> Tensor:
        return nn.functional.cross_entropy(model(batch[0])[0], batch[1])

    running.setdefault("title", "contents")
    fit(network, draw, loss_fn, TrainConfig(steps, 1e-3, seed=seed), **running)
    return network.requires_grad_(False)


def train_generator(
    data: Dataset, config: Config, seed: int = 0, contents: ContentClassifier | None = None, **running
) -> tuple[StyleErd, Run, Windows]:
    """Train Style-ERD on all clips of a labelled dataset (paper 2, section 3.2): the generator, its run, its windows.

    contents: a content classifier that is there already. running: as in `training.fit`. Raises MotionKitError where no
    style is neutral.
    """
    windows = Windows.of(data, config.fps, paired=config.paired > 0)
    skeleton = without_helper_joints(data[0].motion).skeleton
    joints, counts = len(skeleton), (len(windows.contents), len(windows.styles))
    if contents is None:
        title = running.get("title", "training") and "contents"
        contents = train_content_classifier(windows, joints, seed=seed, title=title)
    torch.manual_seed(seed)
    critic = (FTAttDiscriminator if config.attention else MultiClassDiscriminator)(joints, *counts)
    generator = StyleErd(joints, *counts, config.sizes, learned=config.initial_states, gate_bias=config.gate_bias)
    signature = f"{config}, {len(windows.x)} windows of {windows.contents} in {windows.styles}"
    numbers = {"weight_decay": 0.0, "grad_clip": 1e6, "ema": config.ema, "critic_lr_ratio": config.critic_lr_ratio}
    training = TrainConfig(config.steps, config.lr, seed=seed, signature=signature, **numbers)
    draw = Draw(windows, config.batch, config.burn_in, config.cycle > 0)
    loss = StyleErdLoss(skeleton, contents, config)
    if config.adversarial:
        run = fit_adversarial((generator, critic), draw, (loss.generator, loss.critic), training, **running)
    else:
        run = fit(generator, draw, loss, training, **running)
    return generator.requires_grad_(False), run, windows


# -- the trained model and the method --------------------------------------------------------------------------------


@dataclass(eq=False)
class ErdModel(Checkpoint):
    """A trained Style-ERD: its network, the labels that it knows (the neutral style first), its skeleton and rate.

    labeller: what guesses labels that nobody gives; None where there is none.
    """

    kind = "style-erd"

    network: StyleErd
    contents: tuple[str, ...]
    styles: tuple[str, ...]
    skeleton: Skeleton
    fps: float
    labeller: FrameClassifier | None = None
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"ErdModel({len(self.contents)} contents, {len(self.styles)} styles, {self.fps:g} fps)"

    @cached_property
    def step(self) -> NumpyStep:
        """The network's NumPy twin, for live streams."""
        return NumpyStep(self.network)

    @cached_property
    def body(self) -> NumpyKinematics:
        """The skeleton's forward kinematics in NumPy, for live streams."""
        return NumpyKinematics(self.skeleton)

    def label_id(self, what: str, label: str) -> int:
        """Of a `content` or a `style`, neutral by any name; MotionKitError names the nearest."""
        if what == "style" and label in NEUTRAL:
            return 0
        known = self.contents if what == "content" else self.styles
        if label not in known:
            near = difflib.get_close_matches(str(label), known, 1, 0.4)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise MotionKitError(f"style-erd knows no {what} {label!r}; {hint}it knows {', '.join(known)}")
        return known.index(label)

    def style_weights(
        self, style: str | Mapping[str, float], strength: float = 1.0, rest: str = "neutral"
    ) -> np.ndarray:
        """How much of each style, [S], from a name or a mix such as {"old": 0.5, "proud": 0.5} (paper 2, section 4.4).

        What a mix leaves of 1 is the style `rest`, and what is beyond 1 is taken from it. Raises MotionKitError for
        unknown styles and numbers that are not finite.
        """
        if not isinstance(style, str | Mapping):
            hint = "a name, or a mix such as {'old': 0.5, 'proud': 0.5}"
            raise MotionKitError(f"style-erd takes a style by {hint}; found {style!r:.80}")
        mix, weights = {style: 1.0} if isinstance(style, str) else dict(style), np.zeros(len(self.styles), np.float32)
        check_strength("style-erd: strength", strength)
        for name, share in mix.items():
            check_strength(f"style-erd: the share of style {name!r}", share)
            weights[self.label_id("style", name)] += share * strength
        rest = self.label_id("style", rest)
        weights[rest] += 1 - weights.sum()
        return weights

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network} | ({"labels": self.labeller} if self.labeller is not None else {})

    def facts(self) -> dict:
        """Sizes, labels, skeleton and frame rate."""
        facts = {"config": asdict(self.network.config), "fps": self.fps, "skeleton": skeleton_card(self.skeleton)}
        return {**facts, "contents": list(self.contents), "styles": list(self.styles)}

    @classmethod
    def restore(cls, saved: Saved) -> ErdModel:
        """See `checkpoints.Checkpoint`."""
        card, skeleton = saved.card, saved.skeleton
        contents, styles = tuple(card["contents"]), tuple(card["styles"])
        counts = len(skeleton), len(contents), len(styles)
        network = saved.fill("network", StyleErd(*counts, saved.config(Sizes)))
        labeller = saved.fill("labels", FrameClassifier(*counts)) if saved.has("labels") else None
        return cls(network, contents, styles, skeleton, card["fps"], labeller, card)


def train_model(
    data: Dataset, config: Config | None = None, seed: int = 0, label_steps: int = LABEL_STEPS, **running
) -> ErdModel:
    """A Style-ERD of a labelled dataset, with what guesses its labels; see `train_generator` for the arguments.

    config: `Config.laptop()` if left out. label_steps: 0 for no such guesses. The card says how it was made.
    """
    config, skeleton = config or Config.laptop(), without_helper_joints(data[0].motion).skeleton
    network, run, windows = train_generator(data, config, seed, **running)
    model = ErdModel(network, windows.contents, windows.styles, skeleton, config.fps)
    if label_steps:
        longer, title = Windows.of(data, config.fps, FRAMES), running.get("title", "training") and "labels"
        model.labeller = train_frame_classifier(longer, len(skeleton), label_steps, seed, title=title)
    model.card = training_card(data, TrainConfig(config.steps, config.lr, seed=seed), run, network)
    model.card["batch"] = config.batch
    return model


@torch.no_grad()
def evaluate_model(model: ErdModel, data: Dataset) -> dict[str, float]:
    """How far a model is right on clips that it has not learned from.

    `rebuilt_mm`: how far joints are from those of the input, from the pelvis, where the style that it has is asked for
    and nothing is put back, mean over windows of `style_erd_labels.FRAMES` frames. The others are `label_accuracy`.
    """
    windows, network = Windows.of(data, model.fps, FRAMES), model.network
    features = network.branch_features(windows.x, windows.content, windows.style)[0]
    rebuilt = split(network.decode(features, network.one_hot(windows.style)))[0]
    ground = torch.zeros(rebuilt.shape[:2])
    positions = [
        placed_positions(model.skeleton, windows.offsets[:, None], rotations, ground)
        for rotations in (rebuilt, split_frames(windows.x)[0])
    ]
    positions = [one - one[..., :1, :] for one in positions]
    metrics = {"rebuilt_mm": round(1000 * float((positions[0] - positions[1]).norm(dim=-1).mean()), 1)}
    return metrics | (label_accuracy(model.labeller, windows) if model.labeller is not None else {})


def make_style_erd(order: TrainOrder) -> ErdModel:
    """For the command line: the model of a dataset."""
    config, split = getattr(Config, order.size), order.data.split()
    config = config(len(Windows.of(split.train, Config.fps).x)) if order.size == "paper" else config()
    config = replace(config, steps=order.steps or config.steps, lr=order.lr or config.lr)
    model = train_model(split.train, config, order.seed, min(LABEL_STEPS, config.steps), **order.running)
    model.card["metrics"] = evaluate_model(model, split.test)
    return model


@lru_cache(maxsize=4)
def load(data: str = "actor") -> ErdModel:
    """The shipped model of a dataset; MotionKitError if there is none."""
    return ErdModel.load(checkpoints.find(f"{data}-style-erd"))


class StyleErdTransfer(StyleTransfer):
    """Style-ERD (paper 2): an encoder, recurrent branches whose sum is the style, a decoder, all causal.

    Styles: a name of `styles`, a mix of several with weights (paper 2, section 4.4), or a clip, whose style is then
    recognised. model: by the name of the dataset that it learned from, or an `ErdModel`; it knows the styles of that
    dataset and no others. The shipped ones learned by `Config.laptop`, beyond the paper.

    >>> import motionkit as mk
    >>> method, walk = mk.methods.load("style-erd"), mk.load("data/actor/walk_neutral.bvh")
    >>> method.stylize(walk, style="old")
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    >>> stream, frames = method.stream(style="old"), method.onto_model(walk)
    >>> for n in range(60):
    ...     restyled = stream(frames[n : n + 1])
    >>> len(restyled), restyled.fps
    (1, 60.0)
    >>> stream.labels[0][1]
    'neutral'
    """

    name = "style-erd"
    version = 2

    def __init__(self, model: str | ErdModel = "actor") -> None:
        self.model = load(model) if isinstance(model, str) else model
        self.skeleton, self.fps = self.model.skeleton, self.model.fps

    @property
    def styles(self) -> tuple[str, ...]:
        """What it can be asked for."""
        return self.model.styles

    def stream(self, style: object = "neutral", strength: object = 1.0, **labels) -> ErdStream:
        """A live stream: call it with one frame, at the model's rate, for one frame back; see `ErdStream`.

        style: a name or a mix such as {"old": 0.5, "proud": 0.5}; it may be changed at any frame. labels: `content`,
        `own_style`, `count` and `fade`, as there.
        """
        return ErdStream(self.model, style, strength, **labels)

    def read_style(self, style: object) -> str | Mapping[str, float]:
        """A name or a mix; of a clip its label, or the style that it is recognised to have."""
        example = as_example(style)
        if example is not None:
            return example.labels.style or self.recognize(example.motion)[1]
        self.model.style_weights(style)
        return style

    @torch.no_grad()
    def transfer(self, body: Motion, style: object, strength: float, *, labels: Labels, seed: int) -> Motion:
        """The whole clip through the network, every frame after those before it.

        Labels of the content, where they are not given, are recognised: its style is what most of the clip looks like,
        its content what each part of it does.
        """
        contents, own_style = self._labels(body, labels)
        content = torch.tensor([[self.model.label_id("content", label) for label in contents]])
        own = torch.tensor([self.model.label_id("style", own_style)])
        weights = torch.from_numpy(self.model.style_weights(style, strength, rest=own_style))[None]
        frames = frames_of(body)
        output, _ = self.model.network(frames.x[None], content, own, weights)
        return motion_from(body, frames, *split(output[0]))

    def place(self, result: Motion, content: Motion) -> Motion:
        """It starts where the content starts; where it faces was never given up."""
        gap = content.root_path()[0] - result.root_path()[0]
        return result.transform(offset=(float(gap[0]), 0.0, float(gap[1])))

    def recognize(self, motion: Motion) -> tuple[str, str]:
        """Content and style that most frames of a motion look like, after those before them.

        Raises MotionKitError where the model guesses no labels.
        """
        contents, styles = self._recognized(self.onto_model(motion))
        return max(contents, key=contents.count), max(styles, key=styles.count)

    def _recognized(self, body: Motion) -> tuple[list[str], list[str]]:
        """What every frame looks like, after those before it."""
        if self.model.labeller is None:
            raise MotionKitError("style-erd: this model guesses no labels; give labels=Labels(content, style)")
        contents, styles = recognize_frames(self.model.labeller, frames_of(body).x)
        return [self.model.contents[n] for n in contents], [self.styles[n] for n in styles]

    def _labels(self, body: Motion, labels: Labels) -> tuple[list[str], str]:
        """The content of every frame and the style of the clip: as given, the others recognised.

        A guess comes late, since it rests on what was; but here the whole clip is known, and it is taken earlier.
        """
        if labels.content and labels.style:
            return [labels.content] * len(body), labels.style
        contents, styles = self._recognized(body)
        late = round(_LATE * self.fps)
        contents = [*contents[late:], *[contents[-1]] * min(late, len(contents))]
        contents = [labels.content] * len(body) if labels.content else contents
        return contents, labels.style or max(styles, key=styles.count)
