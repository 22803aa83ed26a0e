"""The prior: a network that has learned which motions there are, and which sentence goes with which."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from .. import checkpoints, sampling, text
from ..diffusion import NoiseSchedule
from ..errors import MotionKitError
from ..features import FacingFree, Normalizer
from ..layers import Denoiser, TransformerConfig
from ..motion import Motion
from .features import OfBody, encoded, of_size

SCALE = 2.0  # of guidance: the least with nine styles of ten named right on `actor`'s validation part
Sampler = Callable[..., Tensor]


@dataclass(eq=False)
class Prior:
    """Paper 1's text-to-motion model (section 3.3): sentences to motions, for one skeleton and frame rate.

    network: the denoiser. layout, normalizer: what it sees of a motion. schedule: of the noise. encoder: of the
    sentences. known: sentences that it learned from, some of each meaning; least: how near to one a prompt should be.
    guided: whether it also learned to do without a sentence, which guidance needs. card: how it was made.

    >>> import motionkit as mk
    >>> prior = mk.priors.load("actor")
    >>> prior.generate(["an old person walks"], seconds=2)[0]
    Motion('an old person walks', 60 frames at 30 fps, 2.0 s, 22 joints)
    """

    network: Denoiser
    layout: OfBody
    normalizer: Normalizer
    schedule: NoiseSchedule
    encoder: text.TextEncoder
    known: tuple[str, ...]
    least: float
    guided: bool = True
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        millions = sum(p.numel() for p in self.network.parameters()) / 1e6
        return f"Prior({millions:.1f} million weights, text by {self.encoder.name!r}, {self.layout.skeleton!r})"

    @property
    def fps(self) -> float:
        """Frames a second of what it makes."""
        return self.layout.fps

    @property
    def longest(self) -> int:
        """The most frames of what it learned from, and so of what it makes."""
        return self.network.config.frames

    @cached_property
    def key(self) -> str:
        """The same for the same weights, and for no others: what was learned beside them goes by it."""
        state = {name: value.half() for name, value in self.network.state_dict().items()}  # as `save` writes them
        return text.content_key(state, self.encoder.key)

    @cached_property
    def known_embeddings(self) -> Tensor:
        """Of the sentences in `known`, [N, E]."""
        return self.encoder.encode(self.known)

    def encode(self, motion: Motion) -> Tensor:
        """A motion of F frames to the normalised features [F, D] that noise is added to."""
        return encoded(motion, self.layout, self.normalizer)

    def decode(self, x: Tensor, name: str = "") -> Motion:
        """Normalised features [F, D] to a motion, by their rotations; it starts at the origin, facing +Z.

        Bones are as long as the positions among the features say, all in one proportion: people of all sizes are made.
        """
        x = self.normalizer.denormalize(x.detach().cpu().float())
        return FacingFree(of_size(self.layout, x), self.fps).decode(x).replace(name=name)

    def noise(self, prompts: Sequence[str], frames: int, seed: int = 0) -> Tensor:
        """What sampling starts from, [B, F, D]: standard normal, the same for a seed on every machine."""
        shape = (len(prompts), frames, self.layout.size)
        return torch.randn(shape, generator=torch.Generator().manual_seed(seed))

    def predict(self, prompts: Sequence[str], scale: float = SCALE, mask: Tensor | None = None) -> sampling.Predict:
        """The network with these sentences, for any function in `sampling`; see `sampling.guided` for scale.

        mask: bool [B, F], frames that are there, where motions differ in length. Raises MotionKitError for an empty
        sentence, and for guidance where it was trained without. Warns of a sentence that is far from all that it knows,
        and names the nearest.
        """
        if scale != 1 and not self.guided:
            raise MotionKitError(
                "this prior always saw a sentence while it was trained, so it cannot be guided: take scale=1, or train "
                "one with drop above 0"
            )
        for prompt in prompts:
            text.check_prompt(prompt, self.encoder, self.known, self.known_embeddings, self.least)
        vectors, more = self.encoder.encode(prompts), {} if mask is None else {"mask": mask}
        return sampling.guided(self.network.eval(), vectors, torch.zeros(vectors.shape[1]), scale, **more)

    @torch.no_grad()
    def generate(
        self,
        prompts: str | Sequence[str],
        seconds: float | Sequence[float] = 4.0,
        *,
        scale: float = SCALE,
        sampler: Sampler = sampling.ddim,
        steps: int = 20,
        seed: int = 0,
        **more,
    ) -> list[Motion]:
        """A motion for each sentence (paper 1, section 3.3).

        seconds: of all, or one for each sentence; at most what it learned from. scale: of guidance; 1 is none. sampler,
        steps: from `sampling`. more: what the sampler takes beside, such as `inpaint`, `callback` and `spacing`. Raises
        MotionKitError for a time that is too long or too short, and as `predict`.
        """
        prompts = [prompts] if isinstance(prompts, str) else list(prompts)
        frames = self._frames(seconds, len(prompts))
        longer = torch.tensor(frames)[:, None] + self.network.config.frames_per_token // 2  # the last token whole
        mask = torch.arange(max(frames)) < longer if len(set(frames)) > 1 else None
        predict = self.predict(prompts, scale, mask)
        with torch.random.fork_rng(devices=[]):  # what a sampler draws beside, as ddpm does, follows the seed too
            torch.manual_seed(seed)
            x = sampler(predict, self.noise(prompts, max(frames), seed), self.schedule, steps, **more)
        return [self.decode(one[:count], prompt) for one, prompt, count in zip(x, prompts, frames)]

    def _frames(self, seconds: float | Sequence[float], count: int) -> list[int]:
        each = list(seconds) if isinstance(seconds, Sequence) else [seconds] * count
        if not each or len(each) != count:
            raise MotionKitError(f"expected at least one prompt, and seconds for each; found {count} and {len(each)}")
        for one in each:
            number = isinstance(one, int | float) and math.isfinite(one)
            if not number or not 2 <= round(one * self.fps) <= self.longest:
                raise MotionKitError(
                    f"seconds: this prior learned from motions of up to {self.longest / self.fps:.1f} s "
                    f"({self.longest} frames); found {one!r}: make several and put them together with mk.concatenate"
                )
        return [round(one * self.fps) for one in each]

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`. Weights are written with 16 bits."""
        tensors = {name: value.half() for name, value in self.network.state_dict().items()}
        tensors |= {"mean": self.normalizer.mean, "std": self.normalizer.std, "alphas_bar": self.schedule.alphas_bar}
        card = {"kind": "prior", **self.card, "config": asdict(self.network.config), "features": "FacingFree"}
        card |= {"fps": self.fps, "text_encoder": self.encoder.name, "text_size": self.encoder.size}
        card |= {"text_key": self.encoder.key, "guided": self.guided, "known": list(self.known), "least": self.least}
        card |= {"features_hash": self.normalizer.data_hash}
        return checkpoints.save(path, tensors, card | {"skeleton": checkpoints.skeleton_card(self.layout.skeleton)})

    @classmethod
    def load(cls, path: str | os.PathLike, encoder: text.TextEncoder | None = None) -> Prior:
        """From what `save` wrote, with the text encoder that it was trained with; see `priors.load`.

        Raises MotionKitError if the files are damaged, of a newer format, of another kind or configuration, or if the
        text encoder's weights are others than those it learned from.
        """
        tensors, card = checkpoints.load(path, "prior")
        encoder = checkpoints.same_encoder(path, card, encoder or text.load(card["text_encoder"]))
        layout = OfBody(checkpoints.skeleton_of(card["skeleton"]), card["fps"])
        normalizer = Normalizer(tensors.pop("mean"), tensors.pop("std"), card["features"], card["features_hash"])
        schedule = NoiseSchedule(tensors.pop("alphas_bar"))
        config = checkpoints.config_of(path, card, TransformerConfig)
        network = Denoiser(layout.size, card["text_size"], config, schedule.steps).eval()
        checkpoints.load_into(network, {name: value.float() for name, value in tensors.items()}, path)
        return cls(
            network, layout, normalizer, schedule, encoder, tuple(card["known"]), card["least"], card["guided"], card
        )
