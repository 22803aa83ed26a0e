"""Paper 1: few-shot style transfer with semantic guidance. One clip teaches a style to a text-to-motion prior."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property

import torch
from torch import Tensor

from .. import priors, sampling, text
from ..datasets import Clip, Dataset
from ..datasets import load as load_dataset
from ..errors import MotionKitError
from ..features import FacingFree
from ..fewshot import (
    Chain,
    Contents,
    Direct,
    LearnedStyle,
    Lesson,
    Recipe,
    StyleSpace,
    blended,
    neutral_pair,
    teach,
    with_autoencoder,
)
from ..fewshot.asked import NAMELESS, as_styles, check_learning, check_made
from ..fewshot.space import found_for
from ..motion import Motion
from ..pairs import NEUTRAL, NeutralPairs
from ..priors import Discriminator, Prior
from ..restyling import (
    Memory,
    body_of,
    check_clips,
    in_step,
    key_of,
    named,
    on_body,
    on_the_ground,
    pace,
    placed,
    scale_path,
    within,
)

_LEAST = 1.0  # seconds of a style clip
_OVERLAP = 1.0  # seconds that windows of longer motions share
_BEYOND = 8  # frames added at either end while it is restyled: where a token sees nothing on one side, poses jump
_MOST = 144  # contents for the semantic loss


class FewShot:
    """Few-shot style transfer (paper 1): a prior is fine-tuned on one clip, then its few steps of denoising restyle.

    prior, discriminator: by the name of the dataset that they learned from, or as objects. library: a labelled Dataset
    with captions, whose neutral clips the semantic loss is taken on; left out, the training part of the prior's
    dataset. recipe: see `fewshot.Recipe`; left out, the style is looked for in the kit's space of styles where the
    prior has one (`Recipe.in_space()`), or else learned as in the paper (`Recipe.laptop()`). seed: of all that is
    drawn. space: for `Recipe.in_space()`, one of your own.

    >>> import motionkit as mk
    >>> from motionkit.datasets import BvhSource, Item, Labels, of_items
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> item = Item("walk", Labels("walk", "neutral", ("a person walks",)), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> quick = mk.fewshot.Recipe(steps=2, batch=1, noise=500)
    >>> method = mk.methods.load("few-shot", library=of_items("mine", [item]), recipe=quick)
    >>> old = method.learn(style, "an old person walks", title="")
    >>> method.stylize(walk, style=old)
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "few-shot"

    def __init__(
        self,
        prior: str | Prior = "actor",
        discriminator: str | Discriminator | None = None,
        library: Dataset | None = None,
        recipe: Recipe | None = None,
        seed: int = 0,
        space: StyleSpace | None = None,
    ) -> None:
        check_made(recipe, space, seed)
        self.prior = priors.load(prior) if isinstance(prior, str) else prior
        if discriminator is None and not isinstance(prior, str):
            raise MotionKitError("few-shot: with a prior of your own, give its discriminator too")
        judge = prior if discriminator is None else discriminator
        self.discriminator = priors.load_discriminator(judge) if isinstance(judge, str) else judge
        self.space, self.seed = found_for(self.prior) if space is None else space, seed
        self.recipe = recipe or (Recipe.in_space() if self.space is not None else Recipe.laptop())
        self.fit(library)

    @property
    def chain(self) -> Chain | Direct:
        """The steps that motions go forwards and back, as the recipe says."""
        if self.recipe.model == "autoencoder":
            return Direct()
        if self.recipe.model == "diffusion":
            return Chain.like_paper(self.prior.schedule, self.recipe.change, self.recipe.chain)
        if self.space is None or self.space.prior.key != self.prior.key:
            raise MotionKitError("few-shot: there is no space of styles of this prior; give space=, or another recipe")
        return self.space.chain

    def fit(self, train: Dataset | None) -> FewShot:
        """Take neutral contents from this dataset from now on; its clips are read when a style is first learned."""
        self._library, self._contents = train, Memory(1)
        self.learned, self._pairs, self.last = Memory(16), Memory(), None
        for known in ("pairs", "taught"):
            self.__dict__.pop(known, None)
        return self

    def __getstate__(self) -> dict:
        """What the method is, without what it has worked out or learned so far."""
        kept = ("prior", "discriminator", "recipe", "seed", "space", "_library")
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self.fit(self._library)

    def having(self, **changes) -> FewShot:
        """The same method with another recipe, such as `having(change=200)`: prior, library and seed stay."""
        recipe = self.recipe.changed(**changes)
        other = FewShot(self.prior, self.discriminator, self._library, recipe, self.seed, self.space)
        other.__dict__.update({"pairs": self.pairs})
        return other

    @cached_property
    def pairs(self) -> NeutralPairs:
        """The library's neutral clips."""
        if self._library is None:
            return NeutralPairs(load_dataset(self.prior.card.get("data") or "actor").split().train)
        return NeutralPairs(self._library)

    @cached_property
    def taught(self) -> Prior:
        """What is fine-tuned: the prior, or the autoencoder in its place, which then learns first (table 3)."""
        if self.recipe.model != "autoencoder":
            return self.prior
        return with_autoencoder(self.prior, self.pairs.library, seed=self.seed)

    def learn(
        self, style: Motion, prompt: str | None = None, *, content: str | None = None, **running
    ) -> LearnedStyle:
        """Teach the prior the style of one clip (paper 1, section 3.4); `stylize` uses it from now on.

        style: at least 1 s, of a human body. prompt: d^s, a sentence that says what is done and in which style; it may
        be left out in a space of styles, which hears no words of style. content: what is done, a label of the library,
        where the recipe's pair comes from there. running: as in `training.fit`: `keep`, a file for the state of the
        run, `show`, `title`. Raises MotionKitError for a clip that is too short or cannot be retargeted to the prior's
        body, a prompt without words of a style, and words that are none of these.
        """
        check_learning(self, style, prompt, running)
        check_clips(self.name, style, style)
        nameless = prompt is None
        if nameless:
            prompt = self.prompt_for(style)
        if style.duration < _LEAST - 1e-6:
            raise MotionKitError(
                f"style clip {style.name!r} lasts {style.duration:.2f} s; a style is learned from {_LEAST:g} s or more"
            )
        lesson = self.lesson(style, prompt, content)
        running.setdefault("title", f"learning {lesson.style!r}")
        adapter, run = teach(lesson, self.recipe, self.seed, **running)
        card = {"steps": self.recipe.steps, "seconds": round(run.seconds, 1), "seed": self.seed}
        card |= {"data": self.prior.card.get("data", ""), "licence": self.prior.card.get("licence", "")}
        words = style.name or NAMELESS if nameless else lesson.style
        self.last = LearnedStyle(self.taught, adapter, self.chain, prompt, words, card, lesson.neutral)
        return self.last

    def lesson(self, style: Motion, prompt: str, content: str | None = None) -> Lesson:
        """What `learn` learns from: the style example's features, its neutral pair, and contents; see `fewshot.Lesson`.

        A clip that is longer than the prior's longest motion is cut to its middle. Raises MotionKitError as `learn`.
        """
        words, chain = text.style_in(prompt), self.chain
        clip = self._middle(self.seen(style))
        neutral = self.neutral_of(clip, prompt, content)
        wanted = self.recipe.weights[1] > 0
        return Lesson(
            self.taught,
            self.discriminator,
            chain,
            self.prior.encode(clip),
            neutral,
            prompt,
            words,
            self._neutral_contents() if wanted else None,
            self.space if self.recipe.model == "space" else None,
        )

    def neutral_of(self, style: Motion, prompt: str, content: str | None = None) -> Tensor:
        """The neutral motion paired with a clip, features [F, D], as the recipe says: eqs. 7 and 8, for instance."""
        if self.recipe.pair == "knn-dtw":
            return self.prior.encode(self.pairs.neutral_of(style, content))
        return self._neutral(style, prompt)

    def load_style(self, path: str | os.PathLike) -> LearnedStyle:
        """A style that was saved; `stylize` uses it from now on. MotionKitError where it does not fit the prior."""
        self.last = LearnedStyle.load(path, self.taught, self.space)
        return self.last

    def stylize(
        self,
        content: Motion,
        style: LearnedStyle | Mapping[LearnedStyle, float] | Motion | str | None = None,
        strength: float = 1.0,
        lock: bool = True,
        *,
        caption: str | None = None,
        content_style: str | None = None,
    ) -> Motion:
        """The content clip in a style that was learned (paper 1, section 3.5).

        content: F frames of any length and frame rate, of a human body. style: of `learn` or `load_style`, the last one
        if left out; several with weights, see `fewshot.blended`; a clip, learned when it first comes; or in the kit's
        space of styles a label or a sentence, such as "old", with nothing to learn. strength: 0 keeps the content, 1 is
        the style, more exaggerates. lock: hold standing feet still. caption: a sentence that says what the content
        does; left out, the discriminator picks one that the prior knows. content_style: the content's own style; unless
        it is neutral, or left out, the content is made neutral first. Returns F frames at the content's rate, on its
        skeleton. Raises MotionKitError where nothing was learned yet, and for arguments that are none of these.
        """
        check_clips(self.name, content, content, strength)
        styles = as_styles(self, style)
        what = style.name if isinstance(style, Motion) else " + ".join(one.style for one in styles)
        if strength == 0:
            return content.replace(name=named(content, what))
        given = body_of(content)
        seen = self.seen(given)
        caption = text.to_neutral(self.caption_of(seen) if caption is None else caption)
        x = self.prior.encode(seen)
        if content_style is not None and content_style not in NEUTRAL:
            x = self._neutral(seen, caption)
        body = self._restyled(x, caption, {one: strength * weight for one, weight in styles.items()}, seen, given)
        if lock:
            body = on_the_ground(body, given)
        return content.with_body(body).replace(name=named(content, what))

    def _restyled(
        self, x: Tensor, caption: str, styles: Mapping[LearnedStyle, float], seen: Motion, given: Motion
    ) -> Motion:
        """Neutral features on the content's body in styles, at a speed that goes with them.

        Poses beyond all of a style say little of its speed: there the style's own factor counts so many times.
        """
        y, same = self.translated(x, caption, styles)
        body, plain = (self._decoded(features, x, seen, given) for features in (y, same))
        total = sum(styles.values())
        if total <= 1:
            return in_step(body, plain)
        once, _ = self.translated(x, caption, {one: weight / total for one, weight in styles.items()})
        return scale_path(body, within(pace(self._decoded(once, x, seen, given), plain) ** total))

    @torch.no_grad()
    def translated(self, x: Tensor, caption: str, styles: Mapping[LearnedStyle, float]) -> tuple[Tensor, Tensor]:
        """Neutral features [F, D] to styled ones: K steps of noise forwards and back (paper 1, section 3.5).

        The way forwards is the prior's own, with the content's caption; the way back that of the styles, see `blended`.
        The second answer is what the prior itself makes on the way back: the content, as nearly as it can.
        """
        chain = next(iter(styles)).chain
        plain = self._windows(self.taught.predict([caption], 1.0))
        longer = torch.cat((x[:1].expand(_BEYOND, -1), x, x[-1:].expand(_BEYOND, -1)))
        noised = chain.forward(plain, longer[None])
        there = self._windows(blended(styles, caption, plain))
        return tuple(chain.reverse(way, noised)[-1, 0, _BEYOND:-_BEYOND] for way in (there, plain))

    def neutral_motion(self, motion: Motion, caption: str, warp: bool = False, lock: bool = True) -> Motion:
        """The prior's neutral motion for one in some style (paper 1, sections 3.4 and 3.5, table 2).

        motion: F frames. caption: a sentence that says what it does. warp: let the speed over the ground go with the
        movements, see `restyling.in_step`; else the path is the motion's own, as in paper 1, eq. 8. lock: hold standing
        feet still. Returns F frames on the motion's skeleton.
        """
        given = body_of(motion)
        seen = self.seen(given)
        x = self._neutral(seen, caption)
        body = self._decoded(x, self.prior.encode(seen), seen, given)
        body = in_step(body, given) if warp else body
        body = on_the_ground(body, given) if lock else body
        return motion.with_body(body).replace(name=f"{motion.name}, neutral")

    def caption_of(self, content: Motion) -> str:
        """The neutral sentence that goes best with a motion, of those that the prior knows (paper 1, eq. 6)."""
        known = [one for one in self.prior.known if text.to_neutral(one) == one or " neutral" in one]
        known = known or sorted({text.to_neutral(one) for one in self.prior.known})
        return known[int(self.discriminator.similarity([content], known)[0].argmax())]

    def prompt_for(self, style: Motion) -> str:
        """A sentence for a style clip of which nothing is said."""
        return text.to_style(self.caption_of(self.seen(style)), NAMELESS)

    def transfer(self, content: Clip, style: Clip) -> Motion:
        """`stylize` for labelled clips with captions, as the arena asks: the style is learned when it first comes."""
        if style.style in NEUTRAL:
            return self.neutral_motion(content.motion, content.text, warp=True)
        learned = self.learned.get(
            key_of(style.motion), lambda: self.learn(style.motion, style.text, content=style.content, title="")
        )
        return self.stylize(content.motion, learned, caption=content.text, content_style=content.style)

    def seen(self, motion: Motion) -> Motion:
        """A motion as the prior sees it: its skeleton and frame rate. MotionKitError where it cannot be."""
        body, wanted = body_of(motion), self.prior.layout.skeleton
        if not body.skeleton.same_tree(wanted):
            still = Motion.from_root(wanted, torch.eye(4)[:1].expand(1, len(wanted), 4), torch.zeros(1, 3), body.fps)
            body = on_body(body, still)
        return body if abs(body.fps - self.prior.fps) < 1e-3 else body.resample(self.prior.fps, smooth=True)

    def _middle(self, motion: Motion) -> Motion:
        first = max(len(motion) - self.prior.longest, 0) // 2
        return motion[first : first + self.prior.longest]

    def _windows(self, predict: sampling.Predict) -> sampling.Predict:
        return sampling.windowed(predict, self.prior.longest, round(_OVERLAP * self.prior.fps))

    def _neutral_contents(self) -> Contents:
        def work_out() -> Contents:
            library = self.pairs.library
            clips = [clip for clip in library if clip.style in NEUTRAL]
            order = torch.randperm(len(clips), generator=torch.Generator().manual_seed(self.seed)).tolist()
            chosen = [clips[n] for n in order[:_MOST]]
            motions = [self.seen(clip.motion) for clip in chosen]
            frames = min(self.recipe.frames, self.prior.longest, max(map(len, motions)))
            return Contents.of(self.taught, motions, [clip.text for clip in chosen], self.chain, frames, self.seed)

        return self._contents.get("contents", work_out)

    def _neutral(self, motion: Motion, caption: str) -> Tensor:
        """The neutral motion for one in some style, features [F, D]: the space's, or paper 1's, eqs. 7 and 8."""
        if self.recipe.pair == "space":
            return self.space.neutral(self.prior.encode(motion), caption)
        how = {"noise": self.recipe.noise, "steps": self.recipe.pair_steps, "seed": self.seed}
        return self._pairs.get((key_of(motion), caption), lambda: neutral_pair(self.prior, motion, caption, **how))

    def _decoded(self, y: Tensor, x: Tensor, seen: Motion, given: Motion) -> Motion:
        """Features to a motion on the content's body, on the content's own path, in its frames."""
        y = self.prior.normalizer.denormalize(y)
        y[:, :3] = self.prior.normalizer.denormalize(x)[:, :3]
        body = FacingFree(seen.skeleton, self.prior.fps).decode(y)
        if body.skeleton is not given.skeleton:
            body = on_body(body, given)
        if len(body) != len(given):
            body = body.at(torch.arange(len(given), dtype=torch.float64) * (self.prior.fps / given.fps), smooth=True)
        return placed(body.replace(fps=given.fps), given)
