"""The kit's own method, beyond paper 1: styles as codes. One clip says which of all styles it shows, in seconds.

Paper 1, section 7, names a model for every style as its limitation. Here its chain (eq. 9) is taught once, by its own
loss (eq. 10), on neutral motions performed again in thousands of random styles, each a vector of 37 numbers, the
*code*. To learn a style from a clip is then to read its code off the clip and to search nearby, by the same loss; all
else stays as it is. How it was taught, from the performer, is in `style_code_training`; here are no more of the
performer than the names and ranges of its numbers, and it never gives an answer.
"""

from __future__ import annotations

import difflib
import os
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import torch
from torch import Tensor, nn

from .. import checkpoints, text
from ..actor import Style, parameters
from ..checkpoints import Checkpoint, Saved
from ..datasets import Dataset
from ..errors import MotionKitError
from ..layers import Denoiser, SemanticEncoder, TransformerConfig
from ..motion import Motion
from ..sampling import Denoise, PartialDiffusion, reconstruction_loss
from ..training import TrainConfig, fit
from . import text_to_motion
from .base import NEUTRAL, Example
from .few_shot import NAMELESS, FewShot
from .text_to_motion import Discriminator, Prior

SEARCH_STEPS, SEARCH_LR = 100, 0.05
LABEL_CLIPS = 12  # read for a label of the library
CODES = len(parameters())
TO_NEUTRAL = torch.eye(CODES + 1)[-1]  # in place of a code: be neutral
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
        self.linear = nn.Linear(codes + 1, width, bias=False)
        self.mlp = nn.Sequential(nn.Linear(codes + 1, width), nn.SiLU(), nn.Linear(width, width, bias=False))

    def forward(self, x: Tensor, t: Tensor, text: Tensor, code: Tensor, mask: Tensor | None = None) -> Tensor:
        """As `layers.Denoiser.forward`; code: [B, C + 1]."""
        return self.denoiser(x, t, text, mask, self.linear(code) + self.mlp(code))


class GaussianCode(NamedTuple):
    """What an encoder says of codes: the mean of all that are possible, and their standard deviation, [..., C]."""

    code: Tensor
    spread: Tensor

    @classmethod
    def of(cls, numbers: Tensor) -> GaussianCode:
        """From the network's output, [..., 2 C].

        >>> code, spread = GaussianCode.of(torch.zeros(5, 2 * CODES))
        >>> code.shape == spread.shape == (5, CODES) and bool((spread > 0).all())
        True
        """
        code, spread = numbers.chunk(2, -1)
        return cls(code, _LEAST_SPREAD + nn.functional.softplus(spread - 1))


def new_style_encoder(prior: Prior, config: TransformerConfig | None = None) -> SemanticEncoder:
    """Paper 1's discriminator, but for `GaussianCode`s in place of sentences' vectors."""
    config = config or prior.network.config
    return SemanticEncoder(prior.layout.size, 2 * CODES, config, prior.network.embedding)


@dataclass(eq=False)
class StyleEncoder(Checkpoint):
    """Reads a code off a styled motion; what `python -m motionkit train style-encoder` makes."""

    kind = "style-encoder"

    prior: Prior
    network: SemanticEncoder
    card: dict = field(default_factory=dict, repr=False)

    @torch.no_grad()
    def __call__(self, x: Tensor) -> GaussianCode:
        """The code of a styled motion's features [F, D], and how sure it is; of a long one by its middle."""
        frames = self.network.config.frames
        first = max(len(x) - frames, 0) // 2
        return GaussianCode.of(self.network(x[None, first : first + frames])[0])

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network}

    def facts(self) -> dict:
        """Sizes, and the prior whose features it reads."""
        return {"config": asdict(self.network.config), "prior": self.prior.key}

    @classmethod
    def restore(cls, saved: Saved, prior: Prior) -> StyleEncoder:
        """prior: the one that it learned with; MotionKitError for another."""
        if saved.card.get("prior") != prior.key:
            raise MotionKitError(f"{saved.path}: this reads motions as another prior does; train one for this")
        network = new_style_encoder(prior, saved.config(TransformerConfig))
        return cls(prior, saved.fill("network", network), saved.card)


@dataclass(eq=False)
class StyleCodeModel(Checkpoint):
    """One model for every style (paper 1, section 7, leaves it open): a code says which; `train style-code` makes it.

    prior: what takes motions forwards. network: what takes them back. partial: the steps that it was taught on.
    encoder: what reads a code off a styled motion; without one a style is looked for from neutral on.
    """

    kind = "style-code-model"

    prior: Prior
    network: CodedDenoiser
    partial: PartialDiffusion
    encoder: StyleEncoder | None = None
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"StyleCodeModel(codes of {CODES} parameters, on {self.prior!r})"

    @cached_property
    def key(self) -> str:
        """The same for the same weights of prior and network, and for no others; the encoder does not count."""
        state = {name: value.half() for name, value in self.network.state_dict().items()}
        return text.content_key(state, self.prior.key)

    def predict(self, caption: str, code: Tensor) -> Denoise:
        """The network with a neutral sentence and a code [C + 1], for any function of `sampling`."""
        words = self.prior.encoder.encode([text.to_neutral(caption)])
        return lambda x, t: self.network(x, t, words.expand(len(x), -1), code.expand(len(x), -1))

    @torch.no_grad()
    def neutral(self, x: Tensor, caption: str) -> Tensor:
        """The neutral motion for one in any style, features [F, D] both: forwards, and back told to be neutral.

        It is quicker than paper 1's way through much noise (eqs. 7 and 8), and stays in step with the example.
        """
        noised = self.partial.forward(self.prior.predict([text.to_neutral(caption)], 1.0), x[None])
        return self.partial.reverse(self.predict(caption, TO_NEUTRAL), noised)[-1, 0]

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network}

    def facts(self) -> dict:
        """Sizes, the prior that it was made from, and what the numbers of a code are called."""
        facts = {"config": asdict(self.network.denoiser.config), "prior": self.prior.key}
        return {**facts, "codes": list(parameters()), "timesteps": list(self.partial.timesteps)}

    @classmethod
    def restore(cls, saved: Saved, prior: Prior) -> StyleCodeModel:
        """prior: the one that it was made from; MotionKitError for another, or another performer."""
        card = saved.card
        if card.get("prior") != prior.key or card.get("codes") != list(parameters()):
            raise MotionKitError(
                f"{saved.path}: made from another prior, or by another performer; get both files again"
            )
        denoiser = Denoiser(
            prior.layout.size, prior.encoder.size, saved.config(TransformerConfig), prior.schedule.steps
        )
        network = saved.fill("network", CodedDenoiser(denoiser))
        return cls(prior, network, PartialDiffusion(prior.schedule, tuple(card["timesteps"])), card=card)


@lru_cache(maxsize=2)
def load(prior: str | Prior = "actor") -> StyleCodeModel:
    """The shipped model that was made from a prior, or a dataset's, with its encoder; MotionKitError if there is none.

    >>> load("actor")
    StyleCodeModel(codes of 37 parameters, on Prior(...))
    """
    prior = text_to_motion.load(prior) if isinstance(prior, str) else prior
    data = prior.card.get("data")
    if not data:
        raise MotionKitError("style-code: the card of this prior does not say its data; give a model made from it too")
    model = StyleCodeModel.load(checkpoints.find(f"{data}-style-code"), prior=prior)
    if f"{data}-style-encoder" in checkpoints.names():
        model.encoder = StyleEncoder.load(checkpoints.find(f"{data}-style-encoder"), prior=prior)
    return model


class CodeSearch(nn.Module):
    """A style as a code: the network as it is, told one code, which alone is learned.

    start: where the search begins, as read off a clip; neutral if left out.
    """

    def __init__(self, model: StyleCodeModel, start: GaussianCode | None = None) -> None:
        super().__init__()
        self.network = model.network.requires_grad_(False)
        self.register_buffer("start", torch.zeros(CODES) if start is None else start.code.clone())
        self.register_buffer("spread", None if start is None else start.spread.clone())
        self.code = nn.Parameter(self.start.clone())

    def train(self, mode: bool = True) -> CodeSearch:
        """The network itself stays as it is in use."""
        super().train(mode)
        self.network.eval()
        return self

    def forward(self, x: Tensor, t: Tensor, text: Tensor) -> Tensor:
        """As `layers.Denoiser.forward`."""
        return self.network(x, t, text, torch.cat((self.code, self.code.new_zeros(1))).expand(len(x), -1))

    def prior_nll(self) -> Tensor:
        """How unlikely such a style is: where it was read, by how far the reading may be off (a Gaussian's minus log).

        Where nothing was read, by how far it is from the start: some numbers may be, most are not (a Cauchy's minus
        log). Without it numbers that one clip says nothing of would wander off.
        """
        off = self.code - self.start
        if self.spread is not None:
            return _READ * 0.5 * ((off / self.spread) ** 2).mean()
        return _UNREAD * torch.log1p((off / _NEAR) ** 2).mean()


@dataclass(eq=False)
class StyleCode(Checkpoint):
    """What `StyleCodeTransfer.learn` gives: a style as a code of 37 numbers, in a small file.

    model: whose code it is. code: [C]. prompt: of the clip. name: what the style is called.
    """

    kind = "style-code"

    model: StyleCodeModel
    code: Tensor
    prompt: str
    name: str
    card: dict = field(default_factory=dict, repr=False)
    neutral: Tensor | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return f"StyleCode({self.name!r}, {len(self.code)} numbers beside {self.prior!r})"

    @property
    def prior(self) -> Prior:
        """The prior that it belongs to."""
        return self.model.prior

    @property
    def partial(self) -> PartialDiffusion:
        """The steps that the model was taught on."""
        return self.model.partial

    def predict(self, caption: str) -> Denoise:
        """The model told this code, with a content's neutral sentence, for any function of `sampling`."""
        return self.model.predict(caption, torch.cat((self.code, torch.zeros(1))))

    def style(self) -> Style:
        """The performer's numbers that the code stands for, within their ranges."""
        numbers = {}
        for value, (key, about) in zip(self.code.tolist(), parameters().items()):
            numbers[key] = min(max(about.neutral + value * 0.5 * (about.high - about.low), about.low), about.high)
        return Style(self.name, **numbers)

    def tensors(self) -> dict[str, Tensor]:
        """The code."""
        return {"code": self.code}

    def facts(self) -> dict:
        """What the style is, and the model that it belongs to."""
        return {"prompt": self.prompt, "style": self.name, "model": self.model.key}

    @classmethod
    def restore(cls, saved: Saved, model: StyleCodeModel) -> StyleCode:
        """model: the one that it was learned with; MotionKitError for another."""
        if saved.card.get("model") != model.key:
            raise MotionKitError(f"{saved.path}: a code of another model; learn it again from its clip")
        return cls(model, saved.tensors["code"], saved.card["prompt"], saved.card["style"], saved.card)


class StyleCodeTransfer(FewShot):
    """The kit's own method, beyond paper 1: a style is a code of 37 numbers, read off one clip in seconds.

    Styles: what `learn` or `load_style` gives, several of these with weights; a clip, which is learned when it first
    comes; or a label of the library's training clips, whose code is the mean of those read off them. It restyles as
    `FewShot`, but one network serves all styles, and a styled content is made neutral by the same network. model: left
    out, the one that was made from the prior. prior, discriminator, library, seed: as in `FewShot`.

    >>> import motionkit as mk
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> method = mk.methods.load("style-code")
    >>> old = method.learn(style, "an old person walks", title="")
    >>> method.stylize(walk, style=old)
    Motion('walk_neutral as old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "style-code"
    version = 1

    def __init__(
        self,
        prior: str | Prior = "actor",
        discriminator: str | Discriminator | None = None,
        library: Dataset | None = None,
        seed: int = 0,
        model: StyleCodeModel | None = None,
    ) -> None:
        if model is not None and not isinstance(model, StyleCodeModel):
            raise MotionKitError(f"style-code: model is a StyleCodeModel, or left out; found {model!r:.80}")
        super().__init__(prior, discriminator, library, seed=seed)
        self.codes = load(self.prior) if model is None else model
        if self.codes.prior.key != self.prior.key:
            raise MotionKitError("style-code: this model was made from another prior; give that one too")

    def learn(self, style: Motion, prompt: str | None = None, *, steps: int = SEARCH_STEPS, **running) -> StyleCode:
        """Find the code of one clip: read off it, then searched for nearby, by paper 1's eq. 10.

        style: at least 1 s, of a human body. prompt: a sentence that says what is done; left out, the discriminator
        finds one. steps: of the search. running: `resume`, `callback`, `title`, as in `training.fit`. Raises
        MotionKitError for a clip that is too short or cannot be retargeted to the prior's body.
        """
        self._check_running(running)
        if prompt is not None and not isinstance(prompt, str):
            raise MotionKitError(f"style-code: a prompt is a sentence, or left out; found {prompt!r:.80}")
        clip = self._style_clip(style)
        name = style.name or NAMELESS if prompt is None else text.style_in(prompt)
        prompt = text.to_style(self.caption_of(clip), NAMELESS) if prompt is None else prompt
        x, neutral, caption = self.prior.encode(clip), self.neutral_features(clip, prompt), text.to_neutral(prompt)
        search = CodeSearch(self.codes, self.codes.encoder(x) if self.codes.encoder is not None else None)
        with torch.no_grad():
            noised = self.codes.partial.forward(self.prior.predict([caption], 1.0), neutral[None])
        batch = {"noised": noised, "text": self.prior.encoder.encode([caption]), "styled": x}

        def loss_fn(network: CodeSearch, batch: dict[str, Tensor]) -> Tensor:
            back = self.codes.partial.reverse(lambda y, t: network(y, t, batch["text"]), batch["noised"])
            return reconstruction_loss(back, batch["styled"]) + search.prior_nll()

        signature = f"code, {steps} steps, {prompt!r}, {len(x)} frames"
        training = TrainConfig(steps, SEARCH_LR, weight_decay=0.0, seed=self.seed, signature=signature)
        running.setdefault("title", f"learning {name!r}")
        run = fit(search, lambda step: batch, loss_fn, training, **running)
        return StyleCode(self.codes, search.code.detach(), prompt, name, self._card(run, steps), neutral)

    def _learn_example(self, example: Example) -> StyleCode:
        return self.learn(example.motion, example.labels.caption or None, title="")

    def neutral_features(self, body: Motion, caption: str, seed: int | None = None) -> Tensor:
        """The neutral motion for one in some style, features [F, D], by `StyleCodeModel.neutral`; it draws nothing."""
        return self.codes.neutral(self.prior.encode(body), caption)

    def read_name(self, name: str) -> StyleCode:
        """A label of the library, or a sentence that speaks of one: the mean of the codes read off its clips."""
        if name.endswith((".safetensors", ".bvh")) or self.codes.encoder is None:
            return super().read_name(name)
        known = [style for style in self.pairs.library.styles if style not in NEUTRAL]
        label = name.lower() if name.lower() in known or " " not in name else text.style_in(name)
        if label not in known:
            near = difflib.get_close_matches(label, known, 1, 0.5)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise MotionKitError(
                f"style-code: {name!r} is no style that its library has: {', '.join(known)}.{hint} Any other is "
                "learned from a clip, style = method.learn(clip), and given as it comes"
            )

        def work_out() -> StyleCode:
            clips = list(self.pairs.library.filter(style=label))
            clips = clips[:: max(len(clips) // LABEL_CLIPS, 1)][:LABEL_CLIPS]
            codes = [self.codes.encoder(self.prior.encode(self.onto_model(clip.motion))).code for clip in clips]
            return StyleCode(self.codes, torch.stack(codes).mean(0), clips[0].text, label)

        return self._learned.get(label, work_out)

    def load_style(self, path: str | os.PathLike) -> StyleCode:
        """A code that was saved. MotionKitError where it does not fit the model."""
        return StyleCode.load(path, model=self.codes)
