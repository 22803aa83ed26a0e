"""Paper 1: few-shot style transfer with semantic guidance. One clip teaches a style to a text-to-motion prior.

Stage 1, the prior and its discriminator, is `text_to_motion`. Stage 2 is here, in the order of section 3.4: the neutral
motion that is paired with the style clip (eqs. 7 and 8), K steps of noise forwards and back (eq. 9, in
`sampling.PartialDiffusion`), the two losses (eqs. 10 to 12), fine-tuning, and restyling with what was learned (section
3.5, eq. 13 in `base`).
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import torch
from torch import Tensor, nn

from .. import datasets, sampling, text
from ..checkpoints import Checkpoint, Saved
from ..datasets import Dataset, Labels
from ..diffusion import add_noise
from ..errors import MotionKitError, motion_inside
from ..features import FacingFree
from ..layers import LoRA, semantic_loss
from ..motion import Motion
from ..sampling import PAPER_G, PAPER_K, PAPER_S, PAPER_SCHEDULE, Denoise, PartialDiffusion
from ..training import Run, TrainConfig, fit
from . import base, text_to_motion
from .base import NEUTRAL, Example, LRUCache, StyleTransfer, as_example, check_motion, check_strength, motion_hash
from .neutral_pairs import NeutralPairs
from .text_to_motion import Discriminator, Prior

NAMELESS = "given"  # the style's word in the sentence for a clip of which nothing is said
_SHORTEST = 1.0  # seconds of a style clip
_MARGIN = 8  # frames added at either end while it is restyled: where a token sees nothing on one side, poses jump
_CONTENTS = 144  # of the library, for the semantic loss
_RUNNING = ("resume", "title", "callback")
_WORKED_OUT = ("pairs", "contents", "_learned", "_neutrals")  # of a method: what it can work out again


@dataclass(frozen=True)
class Config:
    """How a style is learned.

    G: of the neutral pair; K and S: of the way there and back, in steps of 1000 (paper 1, section 4). loss_weights:
    lambda_sr and lambda_s; with 0 for the second there is no semantic loss (table 3). steps, batch, lr: of fine-tuning.
    rank: of the LoRA; 0 changes all weights. pair: where the neutral motion comes from, "prior" or "knn-dtw" (tables 2
    and 3); pair_steps: of DDPM, where the prior makes it; None for every one. frames: of the windows that the semantic
    loss sees. Raises MotionKitError for values out of range.
    """

    G: int = PAPER_G
    K: int = PAPER_K
    S: int = PAPER_S
    loss_weights: tuple[float, float] = (1.0, 0.1)
    steps: int = -(-23384 // 64)  # batches of paper 1's one epoch (section 4)
    batch: int = 8
    lr: float = 3e-4
    rank: int = 8
    pair: str = "prior"
    pair_steps: int | None = 100
    frames: int = 120

    def __post_init__(self) -> None:
        if self.pair not in ("prior", "knn-dtw"):
            raise MotionKitError(f"a config's pair is 'prior' or 'knn-dtw'; found {self.pair!r}")
        for name, least in (("G", 1), ("K", 1), ("S", 1), ("steps", 1), ("batch", 1), ("rank", 0)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or value < least:
                raise MotionKitError(f"a config's {name} is a whole number from {least}; found {value!r}")
        weights = self.loss_weights if isinstance(self.loss_weights, tuple | list) else ()
        if len(weights) != 2 or not all(isinstance(one, int | float) and one >= 0 for one in weights):
            raise MotionKitError(f"a config has two loss weights from 0 up, as (1.0, 0.1); found {self.loss_weights!r}")
        if not isinstance(self.lr, int | float) or not self.lr > 0:
            raise MotionKitError(f"a config's learning rate is above 0; found {self.lr!r}")

    def changed(self, **changes) -> Config:
        """The same but for these; MotionKitError for what no config has.

        >>> Config().changed(K=200).K
        200
        """
        known = [one.name for one in fields(self)]
        for name in changes:
            if name not in known:
                raise MotionKitError(f"a config has no {name!r}; it has {', '.join(known)}")
        return replace(self, **changes)

    @classmethod
    def paper(cls, contents: int = 23384) -> Config:
        """Paper 1, section 4: all weights, batch 64, rate 0.0001, one epoch; contents: how many, here HumanML3D's."""
        return cls(steps=-(-contents // 64), batch=64, lr=1e-4, rank=0, pair_steps=None, frames=196)

    @classmethod
    def laptop(cls) -> Config:
        """As many steps of smaller batches, by LoRA: a minute or two on two cores."""
        return cls()

    @classmethod
    def tiny(cls) -> Config:
        """For tests."""
        return cls(steps=2, batch=1, pair_steps=10)


def in_windows(prior: Prior, predict: Denoise) -> Denoise:
    """For motions longer than the prior's longest: windows of it, which share a second."""
    return sampling.sliding_window(predict, prior.longest, round(prior.fps))


@torch.no_grad()
def neutral_pair(
    prior: Prior, style: Motion, prompt: str, *, G: int = PAPER_G, steps: int | None = None, seed: int = 0, **more
) -> Tensor:
    """A neutral motion aligned with a style example, as features [F, D] of the prior (paper 1, eqs. 7 and 8).

    The example is noised to step G of the paper's 1000, which leaves its timing and little else, and brought back by
    DDPM with its prompt made neutral (`text.to_neutral`) and a guidance scale of 2; at every step, the root's velocity
    over the ground is that of the example. steps: of the sampler; left out, every one, as in the paper. more: what
    `sampling.ddpm` takes beside, such as `callback`. Raises MotionKitError as `Prior.predict` does.
    """
    x = prior.encode(style)[None]
    start = prior.schedule.matching_step(G, PAPER_SCHEDULE)
    generator = torch.Generator().manual_seed(seed)
    noised = add_noise(x, start, prior.schedule, torch.randn(x.shape, generator=generator))
    path = sampling.feature_mask(prior.layout, "root x velocity", "root z velocity")  # O_hori of eq. 8
    predict = in_windows(prior, prior.predict([text.to_neutral(prompt)], 2.0))
    keep_path = sampling.inpainting(x[0], path)
    stops = sampling.timesteps(prior.schedule, steps, start)
    return sampling.ddpm(predict, noised, prior.schedule, stops, keep_path, generator=generator, **more)[0]


@dataclass(frozen=True, eq=False)
class ContentBank:
    """Neutral motions with sentences, M^c and D^c of paper 1: what a style is to be carried to while it is learned.

    noised: m_K of their features, [N, F, D]. captions: N sentences.
    """

    noised: Tensor
    captions: tuple[str, ...]

    @classmethod
    def of(cls, prior: Prior, partial: PartialDiffusion, clips: Sequence, frames: int = 120, seed: int = 0):
        """A window of each clip; clips: pairs of a motion on the prior's skeleton and its sentence.

        Raises MotionKitError where no motion is as long, or one has no caption.
        """
        generator, windows, captions = torch.Generator().manual_seed(seed), [], []
        for motion, caption in clips:
            if len(motion) >= frames and not caption:
                raise MotionKitError(
                    f"clip {motion.name!r} has no caption, which the semantic loss needs; give it texts"
                )
            if len(motion) >= frames:
                start = int(torch.randint(len(motion) - frames + 1, (), generator=generator))
                windows.append(prior.encode(motion[start : start + frames]))
                captions.append(text.to_neutral(caption))
        if not windows:
            raise MotionKitError(f"no neutral clip has {frames} frames; give longer ones, or fewer frames")
        with torch.no_grad():
            parts = [
                partial.forward(prior.predict(captions[n : n + 32], 1.0), torch.stack(windows[n : n + 32]))
                for n in range(0, len(windows), 32)
            ]
        return cls(torch.cat(parts), tuple(captions))


@dataclass(frozen=True, eq=False)
class FinetuneTask:
    """What is there to learn from: a style example beside its neutral pair, and contents for the semantic loss.

    styled, neutral: features [F, D]. prompt: d^s. style: its words, see `text.style_in`. contents: None where the
    semantic loss is left out.
    """

    prior: Prior
    partial: PartialDiffusion
    styled: Tensor
    neutral: Tensor
    prompt: str
    style: str
    contents: ContentBank | None = None

    def draw(self, batch: int) -> Callable[[int], dict[str, Tensor]]:
        """The batches of fine-tuning: the example, and so many contents drawn from the bank."""
        encode = self.prior.encoder.encode
        with torch.no_grad():
            predict = self.prior.predict([text.to_neutral(self.prompt)], 1.0)
            example = {"noised": self.partial.forward(predict, self.neutral[None]), "styled": self.styled}
        example["text"] = encode([self.prompt])  # E_text(d^s)
        if self.contents is None:
            return lambda step: example
        texts = encode([text.to_style(caption, self.style) for caption in self.contents.captions])  # of D^(c,s)

        def draw(step: int) -> dict[str, Tensor]:
            chosen = torch.randint(len(texts), (batch,))
            return {**example, "contents": self.contents.noised[chosen], "content_texts": texts[chosen]}

        return draw


class FinetuneLoss(nn.Module):
    """The losses of fine-tuning (paper 1, eqs. 9 to 12); it holds the frozen discriminator."""

    def __init__(self, partial: PartialDiffusion, discriminator: nn.Module, weights: tuple[float, float]) -> None:
        super().__init__()
        self.partial, self.weights = partial, weights
        self.discriminator = discriminator.eval().requires_grad_(False)

    def reconstruction(self, network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
        """L_sr: the example from its noised neutral pair (paper 1, eqs. 9 and 10)."""
        predictions = self.partial.reverse(lambda x, t: network(x, t, batch["text"]), batch["noised"])
        return sampling.reconstruction_loss(predictions, batch["styled"])

    def semantic(self, network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
        """L_s: contents restyled by the network, as the frozen discriminator sees them (paper 1, eq. 11)."""
        texts = batch["content_texts"]
        restyled = self.partial.reverse(lambda x, t: network(x, t, texts), batch["contents"])[-1]
        return semantic_loss(self.discriminator(restyled), texts)

    def forward(self, network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
        """Both together (paper 1, eq. 12)."""
        example = self.reconstruction(network, batch)
        meaning = self.semantic(network, batch) if "contents" in batch else example.new_zeros(())
        return sampling.total_loss(example, meaning, self.weights)


def finetune(
    task: FinetuneTask, discriminator: Discriminator, config: Config, seed: int = 0, **running
) -> tuple[LoRA, Run]:
    """Fine-tune the task's prior on it (paper 1, section 3.4, eq. 12); the prior itself stays as it is.

    running: as in `training.fit`, such as `resume` for a file to go on from, `callback` and `title`.
    """
    adapter = LoRA(task.prior.network, config.rank, seed)
    signature = f"{config}, {task.prompt!r}, {len(task.styled)} frames"
    training = TrainConfig(config.steps, config.lr, weight_decay=0.0, seed=seed, signature=signature)
    loss = FinetuneLoss(task.partial, discriminator.network, config.loss_weights)
    return adapter, fit(adapter, task.draw(config.batch), loss, training, **running)


@dataclass(eq=False)
class LearnedStyle(Checkpoint):
    """What `FewShot.learn` gives: the changes of a prior, in a small file.

    prior: what was fine-tuned. adapter: its changes. partial: the steps that it was taught on. prompt: of the style
    example. name: the words of style in it. neutral: the pair's neutral motion, features [F, D], where it was just
    learned.
    """

    kind = "style"

    prior: Prior
    adapter: LoRA
    partial: PartialDiffusion
    prompt: str
    name: str
    card: dict = field(default_factory=dict, repr=False)
    neutral: Tensor | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        count = sum(weight.numel() for weight in self.adapter.changes.parameters())
        return f"LearnedStyle({self.name!r}, {count / 1000:.0f} thousand parameters beside {self.prior!r})"

    @cached_property
    def network(self) -> Callable[..., Tensor]:
        """The changed denoiser, epsilon_theta_s."""
        return self.adapter.merged()

    def predict(self, caption: str) -> Denoise:
        """The changed denoiser with a content's sentence told in this style, for any function of `sampling`."""
        words = self.prior.encoder.encode([text.to_style(caption, self.name)])
        return lambda x, t: self.network(x, t, words.expand(len(x), -1))

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"changes": self.adapter.changes}

    def facts(self) -> dict:
        """What the style is, and the prior that it belongs to."""
        facts = {"prompt": self.prompt, "style": self.name, "rank": self.adapter.rank}
        return {**facts, "timesteps": list(self.partial.timesteps), "prior": self.prior.key}

    @classmethod
    def restore(cls, saved: Saved, prior: Prior) -> LearnedStyle:
        """prior: the one that it was learned with; MotionKitError for another."""
        card = saved.card
        if card.get("prior") != prior.key:
            raise MotionKitError(
                f"{saved.path}: this style was learned with another prior, whose weights it changes; load it with that "
                "one, or learn it again from its clip"
            )
        adapter = LoRA(prior.network, card["rank"])
        saved.fill("changes", adapter.changes)
        partial = PartialDiffusion(prior.schedule, tuple(card["timesteps"]))
        return cls(prior, adapter, partial, card["prompt"], card["style"], card)


def blend(styles: Mapping[LearnedStyle, float], caption: str, base: Denoise) -> Denoise:
    """Predictions of several styles together, each with its weight, and the rest of 1 from the prior as it is.

    base: the prior with the content's own sentence. One style with a weight of 1 is that style, 0.5 half of it, 1.5 a
    caricature; two with 0.5 each lie between both; a style with 1.5 and another with -0.5 lies beyond. It is
    DiffusionBlending (Shafir et al. 2024), which paper 1, section 7, names for this. Raises MotionKitError where no
    style is given.

    >>> blend({}, "a person walks", lambda x, t: x)
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: nothing to blend: give at least one learned style
    """
    if not styles:
        raise MotionKitError("nothing to blend: give at least one learned style")
    parts = [(style.predict(caption), float(weight)) for style, weight in styles.items() if weight]
    rest = 1 - sum(weight for _, weight in parts)
    if abs(rest) > 1e-6:
        parts.append((base, rest))

    def predict(x: Tensor, t: Tensor) -> Tensor:
        return torch.stack([weight * part(x, t) for part, weight in parts]).sum(0)

    return predict


class FewShot(StyleTransfer):
    """Few-shot style transfer (paper 1): a prior is fine-tuned on one clip, then its few steps of denoising restyle.

    Styles: what `learn` or `load_style` gives, several of these with weights, or a clip, which is learned when it first
    comes. prior, discriminator: by the name of the dataset that they learned from, or as objects. library: a labelled
    Dataset with captions, whose neutral clips the semantic loss is taken on; left out, the training part of the prior's
    dataset. config: `Config.laptop()` if left out. seed: of all that is drawn in learning.

    >>> import motionkit as mk
    >>> from motionkit.datasets import BvhSource, Item, Labels, from_items
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> item = Item("walk", Labels("walk", "neutral", ("a person walks",)), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> quick = mk.methods.few_shot.Config.tiny()
    >>> method = mk.methods.load("few-shot", library=from_items("mine", [item]), config=quick)
    >>> old = method.learn(style, "an old person walks", title="")
    >>> method.stylize(walk, style=old)
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "few-shot"
    version = 3

    def __init__(
        self,
        prior: str | Prior = "actor",
        discriminator: str | Discriminator | None = None,
        library: Dataset | None = None,
        config: Config | None = None,
        seed: int = 0,
    ) -> None:
        if config is not None and not isinstance(config, Config):
            hint = "mk.methods.few_shot.Config.laptop(), for instance"
            raise MotionKitError(f"{self.name}: a config is {hint}; found {config!r:.80}")
        if not isinstance(seed, int):
            raise MotionKitError(f"{self.name}: a seed is a whole number; found {seed!r}")
        if discriminator is None and not isinstance(prior, str):
            raise MotionKitError(f"{self.name}: with a prior of your own, give its discriminator too")
        discriminator = prior if discriminator is None else discriminator
        self.prior = text_to_motion.load(prior) if isinstance(prior, str) else prior
        if isinstance(discriminator, str):
            discriminator = text_to_motion.load_discriminator(discriminator)
        self.discriminator, self.config, self.seed = discriminator, config or Config.laptop(), seed
        self.skeleton, self.fps = self.prior.layout.skeleton, self.prior.fps
        self.fit(library)

    @property
    def model(self) -> Prior:
        """What is fine-tuned."""
        return self.prior

    @property
    def partial(self) -> PartialDiffusion:
        """The steps that motions go forwards and back, as the config says."""
        return PartialDiffusion.from_paper(self.prior.schedule, self.config.K, self.config.S)

    def fit(self, train: Dataset | None) -> FewShot:
        """Take neutral contents from this dataset from now on; its clips are read when a style is first learned."""
        self.__dict__ = self.__getstate__()  # forgets what was worked out from another library
        self._library, self._learned, self._neutrals = train, LRUCache(16), LRUCache()
        return self

    def __getstate__(self) -> dict:
        """What the method is, without what it has worked out or learned so far."""
        return {name: value for name, value in vars(self).items() if name not in _WORKED_OUT}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self.fit(self._library)

    def with_config(self, **changes) -> FewShot:
        """The same method with another config, such as `with_config(K=200)`: prior, library and seed stay."""
        other = copy.copy(self)
        other.config, other.__dict__["pairs"] = self.config.changed(**changes), self.pairs
        return other

    @cached_property
    def pairs(self) -> NeutralPairs:
        """The library's neutral clips."""
        if self._library is None:
            return NeutralPairs(datasets.load(self.prior.card.get("data") or "actor").split().train)
        return NeutralPairs(self._library)

    def learn(self, style: Motion, prompt: str, *, content: str | None = None, **running) -> LearnedStyle:
        """Teach the prior the style of one clip (paper 1, section 3.4).

        style: at least 1 s, of a human body. prompt: d^s, a sentence that says what is done and in which style.
        content: what is done, a label of the library, where the config's pair comes from there. running: `resume`, a
        file for the state of the run, `callback`, `title`, as in `training.fit`. Raises MotionKitError for a clip that
        is too short or cannot be retargeted to the prior's body, and a prompt without words of a style.
        """
        self._check_running(running)
        task = self.task(style, prompt, content)
        running.setdefault("title", f"learning {task.style!r}")
        adapter, run = finetune(task, self.discriminator, self.config, self.seed, **running)
        card = self._card(run, self.config.steps)
        return LearnedStyle(self.model, adapter, task.partial, prompt, task.style, card, task.neutral)

    def _check_running(self, running: Mapping) -> None:
        for name in running:
            if name not in _RUNNING:
                hint = f": give it to mk.methods.load({self.name!r}, config=...)" * (name in ("config", "recipe"))
                raise MotionKitError(
                    f"{self.name}: learn takes {', '.join(_RUNNING)} beside the clip, not {name!r}{hint}"
                )

    def _card(self, run: Run, steps: int) -> dict:
        origin = {key: self.prior.card.get(key, "") for key in ("data", "licence")}
        return {"steps": steps, "seconds": round(run.seconds, 1), "seed": self.seed, **origin}

    def task(self, style: Motion, prompt: str, content: str | None = None) -> FinetuneTask:
        """What `learn` learns from: the style example's features, its neutral pair, and contents.

        A clip that is longer than the prior's longest motion is cut to its middle. Raises MotionKitError as `learn`.
        """
        clip = self._style_clip(style)
        if not isinstance(prompt, str):
            raise MotionKitError(
                f"{self.name} learns a style from a clip and a sentence: method.learn(clip, 'an old person walks'); "
                f"found {prompt!r:.80}"
            )
        words = text.style_in(prompt)
        if self.config.pair == "knn-dtw":
            neutral = self.prior.encode(self.pairs.neutral_of(clip, content))
        else:
            neutral = self.neutral_features(clip, prompt)
        contents = self.contents if self.config.loss_weights[1] > 0 else None
        return FinetuneTask(self.model, self.partial, self.prior.encode(clip), neutral, prompt, words, contents)

    def _style_clip(self, style: object) -> Motion:
        """What is learned from a clip: its middle, on the model's body. MotionKitError where that cannot be."""
        if not isinstance(style, Motion):
            hint = motion_inside(style) or "; read a file with mk.load"
            raise MotionKitError(f"{self.name} learns a style from a Motion; found {style!r:.80}{hint}")
        check_motion("style", style)
        if style.duration < _SHORTEST - 1e-6:
            raise MotionKitError(
                f"style clip {style.name!r} lasts {style.duration:.2f} s; a style is learned from {_SHORTEST:g} s or "
                "more"
            )
        body = self.onto_model(style)
        first = max(len(body) - self.prior.longest, 0) // 2
        return body[first : first + self.prior.longest]

    def neutral_features(self, body: Motion, caption: str, seed: int | None = None) -> Tensor:
        """The neutral motion for one in some style, features [F, D] (paper 1, eqs. 7 and 8). seed: of its noise."""
        seed = self.seed if seed is None else seed
        options = {"G": self.config.G, "steps": self.config.pair_steps, "seed": seed}
        key = motion_hash(body), caption, seed
        return self._neutrals.get(key, lambda: neutral_pair(self.prior, body, caption, **options))

    @cached_property
    def contents(self) -> ContentBank:
        """Neutral clips of the library, for the semantic loss."""
        clips = [clip for clip in self.pairs.library if clip.style in NEUTRAL]
        order = torch.randperm(len(clips), generator=torch.Generator().manual_seed(self.seed)).tolist()
        chosen = [(self.onto_model(clips[n].motion), clips[n].text) for n in order[:_CONTENTS]]
        frames = min(self.config.frames, self.prior.longest, max(len(motion) for motion, _ in chosen))
        return ContentBank.of(self.model, self.partial, chosen, frames, self.seed)

    def load_style(self, path: str | os.PathLike) -> LearnedStyle:
        """A style that was saved. MotionKitError where it does not fit the prior."""
        return LearnedStyle.load(path, prior=self.model)

    def read_style(self, style: object) -> dict[LearnedStyle, float]:
        """Learned styles with weights; a clip is learned first; of a clip that is neutral, none."""
        example = as_example(style)
        if example is not None:
            if example.labels.style in NEUTRAL:
                return {}
            key = motion_hash(example.motion), example.labels.caption
            return {self._learned.get(key, lambda: self._learn_example(example)): 1.0}
        mix = style if isinstance(style, Mapping) else {style: 1.0} if isinstance(style, Hashable) else {}
        styles = {self.read_name(one) if isinstance(one, str) else one: weight for one, weight in mix.items()}
        if not styles or not all(hasattr(one, "predict") and hasattr(one, "partial") for one in styles):
            raise MotionKitError(
                f"{self.name} takes learned styles or a clip; several styles are mixed with weights, "
                f"{{old: 0.5, proud: 0.5}}; found {style!r:.80}"
            )
        if any(one.prior.key != self.model.key for one in styles):
            raise MotionKitError(f"{self.name}: this style was learned with another prior; learn it with this one")
        for one, weight in styles.items():
            check_strength(f"{self.name}: the weight of style {one.name!r}", weight)
        return styles

    def read_name(self, name: str) -> LearnedStyle:
        """A style by its name: this method knows none. MotionKitError that says how to get one."""
        if name.endswith((".safetensors", ".bvh")):
            how = "method.load_style" if name.endswith(".safetensors") else "mk.load"
            raise MotionKitError(f"{self.name}: {name!r} is a file; read it first: {how}({name!r})")
        raise MotionKitError(
            f"{self.name} knows no style by name, {name!r} neither; it is learned from a clip: style = "
            "method.learn(clip, 'an old person walks'), and given as it comes"
        )

    def _learn_example(self, example: Example) -> LearnedStyle:
        prompt = example.labels.caption or text.to_style(self.caption_of(self.onto_model(example.motion)), NAMELESS)
        return self.learn(example.motion, prompt, content=example.labels.content or None, title="")

    def transfer(self, body: Motion, style: dict, strength: float, *, labels: Labels, seed: int) -> Motion:
        """K steps of noise forwards by the prior, back by the learned styles (paper 1, section 3.5).

        The content's sentence: its label's caption, or the one that the discriminator finds nearest. A content that is
        styled itself is made neutral first.
        """
        caption = text.to_neutral(labels.caption or self.caption_of(body))
        x = self.prior.encode(body)
        styled = labels.style not in ("", *NEUTRAL)
        start = self.neutral_features(body, caption, seed) if styled or not style else x
        if not style:
            return base.match_root_speed(self._decode(start, x, body), body)
        styles = {one: strength * weight for one, weight in style.items()}
        restyled, plain = (self._decode(y, start, body) for y in self.restyle_features(start, caption, styles))
        total = sum(styles.values())
        if total <= 1:
            return base.match_root_speed(restyled, plain)
        # poses beyond all of a style say little of its speed: the style's own factor counts so many times
        shares = {one: weight / total for one, weight in styles.items()}
        once = self._decode(self.restyle_features(start, caption, shares)[0], start, body)
        return base.scale_path(restyled, base.clamp_ratio(base.speed_ratio(once, plain) ** total))

    def place(self, result: Motion, content: Motion) -> Motion:
        """It starts where the content starts, facing the same way."""
        return base.align_start(result, content)

    @torch.no_grad()
    def restyle_features(self, x: Tensor, caption: str, styles: Mapping) -> tuple[Tensor, Tensor]:
        """Neutral features [F, D] to styled ones: K steps of noise forwards and back (paper 1, section 3.5).

        The way forwards is the prior's own, with the content's caption; the way back that of the styles, see `blend`.
        The second answer is what the prior itself makes on the way back: the content, as nearly as it can.
        """
        partial = next(iter(styles)).partial
        plain = in_windows(self.prior, self.model.predict([caption], 1.0))
        longer = torch.cat((x[:1].expand(_MARGIN, -1), x, x[-1:].expand(_MARGIN, -1)))
        noised = partial.forward(plain, longer[None])
        styled = in_windows(self.prior, blend(styles, caption, plain))
        return tuple(partial.reverse(way, noised)[-1, 0, _MARGIN:-_MARGIN] for way in (styled, plain))

    def _decode(self, y: Tensor, x: Tensor, body: Motion) -> Motion:
        """Features y to a motion on the content's body, on the path of features x."""
        y = self.prior.normalizer.denormalize(y)
        y[:, :3] = self.prior.normalizer.denormalize(x)[:, :3]
        return FacingFree(body.skeleton, self.prior.fps).decode(y)

    def neutral_motion(self, motion: Motion, caption: str, *, lock_feet: bool = True) -> Motion:
        """The prior's neutral motion for one in some style, on the same path (paper 1, section 3.4, table 2)."""
        body = self.onto_model(motion)
        neutral = self._decode(self.neutral_features(body, caption), self.prior.encode(body), body)
        return self.bring_back(neutral, motion, f"{motion.name}, neutral", lock_feet=lock_feet)

    def caption_of(self, content: Motion) -> str:
        """The neutral sentence that goes best with a motion, of those that the prior knows (paper 1, eq. 6)."""
        known = self.prior.train_captions
        neutral = [one for one in known if text.to_neutral(one) == one or " neutral" in one]
        neutral = neutral or sorted({text.to_neutral(one) for one in known})
        return neutral[int(self.discriminator.similarity([content], neutral)[0].argmax())]
