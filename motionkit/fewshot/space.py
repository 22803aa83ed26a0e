"""A space of styles: a prior that has seen so many styles change a motion that one clip says which of them it shows.

Beyond paper 1, whose section 7 names a model for every style as its limitation. Its chain (eq. 9) is taught once, by
its own loss (eq. 10), on neutral motions told again in thousands of invented styles, each a vector of numbers, the
*code*. To learn a style from a clip is then to find its code, by the same loss; all else stays as it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from .. import checkpoints, priors, text
from ..actor import Style, parameters
from ..errors import MotionKitError
from ..layers import Denoiser, SemanticEncoder, TransformerConfig
from ..priors import Prior
from .chain import Chain
from .invented import code_of

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


class Reading(NamedTuple):
    """What a reader guesses of codes: the mean of all that are possible, and how far they lie around it, [..., C]."""

    code: Tensor
    spread: Tensor

    @classmethod
    def of(cls, numbers: Tensor) -> Reading:
        """From what the network says, [..., 2 C].

        >>> code, spread = Reading.of(torch.zeros(5, 2 * CODES))
        >>> code.shape == spread.shape == (5, CODES) and bool((spread > 0).all())
        True
        """
        code, spread = numbers.chunk(2, -1)
        return cls(code, _LEAST_SPREAD + nn.functional.softplus(spread - 1))


@dataclass(eq=False)
class StyleSpace:
    """What `python -m motionkit train space` makes, beyond paper 1; `mk.methods.load("few-shot")` finds styles in it.

    prior: what takes motions forwards. network: what takes them back. chain: the steps that it was taught on. reader:
    what reads a code off a styled motion; without one a style is looked for from neutral on.
    """

    prior: Prior
    network: CodedDenoiser
    chain: Chain
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
    def read(self, x: Tensor) -> Reading | None:
        """What the reader guesses of the code of a styled motion's features [F, D]; None without a reader."""
        if self.reader is None:
            return None
        first = max(len(x) - self.reader.config.frames, 0) // 2
        return Reading.of(self.reader(x[None, first : first + self.reader.config.frames])[0])

    def save_reader(self, path: str | os.PathLike, card: dict) -> Path:
        """The reader's weights and card, see `checkpoints.save`; 16 bits."""
        tensors = {name: value.half() for name, value in self.reader.state_dict().items()}
        card = {"kind": "reader", **card, "config": asdict(self.reader.config), "prior": self.prior.key}
        return checkpoints.save(path, tensors, card)

    def load_reader(self, path: str | os.PathLike) -> StyleSpace:
        """The space with the reader that `save_reader` wrote; MotionKitError where it is for another prior."""
        tensors, card = checkpoints.load(path, "reader")
        if card.get("prior") != self.prior.key:
            raise MotionKitError(f"{path}: this reader sees motions as another prior does; train one for this")
        reader = fresh_reader(self.prior, checkpoints.config_of(path, card, TransformerConfig)).eval()
        checkpoints.load_into(reader, {name: value.float() for name, value in tensors.items()}, path)
        self.reader = reader.requires_grad_(False)
        return self

    def save(self, path: str | os.PathLike) -> Path:
        """Weights and card, see `checkpoints.save`; 16 bits."""
        tensors = {name: value.half() for name, value in self.network.state_dict().items()}
        card = {"kind": "space", **self.card, "config": asdict(self.config), "prior": self.prior.key}
        return checkpoints.save(path, tensors, card | {"codes": list(parameters()), "stops": list(self.chain.stops)})

    @classmethod
    def load(cls, path: str | os.PathLike, prior: Prior) -> StyleSpace:
        """From what `save` wrote, for the prior that it was made from; MotionKitError where they do not fit."""
        tensors, card = checkpoints.load(path, "space")
        if card.get("prior") != prior.key or card.get("codes") != list(parameters()):
            raise MotionKitError(f"{path}: made from another prior, or by another performer; get both files again")
        config = checkpoints.config_of(path, card, TransformerConfig)
        size, words = prior.layout.size, prior.encoder.size
        network = CodedDenoiser(Denoiser(size, words, config, prior.schedule.steps)).eval()
        checkpoints.load_into(network, {name: value.float() for name, value in tensors.items()}, path)
        return cls(prior, network.requires_grad_(False), Chain(prior.schedule, tuple(card["stops"])), card=card)


def fresh_reader(prior: Prior, config: TransformerConfig | None = None) -> SemanticEncoder:
    """A network that has learned nothing yet: paper 1's discriminator, `Reading`s in place of sentences' vectors."""
    config = config or prior.network.config
    return SemanticEncoder(prior.layout.size, 2 * CODES, config, prior.network.embedding)


@lru_cache(maxsize=2)
def load(name: str = "actor") -> StyleSpace:
    """The shipped space of styles of a dataset; MotionKitError if there is none."""
    return found_for(priors.load(name)) or StyleSpace.load(checkpoints.find(f"{name}-space"), priors.load(name))


def found_for(prior: Prior) -> StyleSpace | None:
    """The shipped space that was made from this very prior, with its reader if there is one; or None."""
    data, there = prior.card.get("data"), checkpoints.names()
    if f"{data}-space" not in there:
        return None
    path = checkpoints.find(f"{data}-space")
    if checkpoints.load(path, "space")[1].get("prior") != prior.key:
        return None
    space = StyleSpace.load(path, prior)
    return space.load_reader(checkpoints.find(f"{data}-reader")) if f"{data}-reader" in there else space


class Point(nn.Module):
    """A style as a point of a space: the network as it is, told one code, which alone is learned.

    It has an `Adapter`'s interface, so `teach` finds the point as it trains an adapter; but the sentences that it hears
    stay neutral. start: a style, or what was
    read off a clip; neutral if left out.
    """

    rank, hears_style = 0, False

    def __init__(self, space: StyleSpace, start: Style | Reading | None = None) -> None:
        super().__init__()
        self.space = (space,)  # in a tuple, so that it is no part of this module's state
        self.read = start if isinstance(start, Reading) else None
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

    def frozen(self) -> Callable[..., Tensor]:
        """As `Adapter.frozen`."""
        code = self.code.detach()
        return lambda x, t, text, mask=None: self.space[0].network(x, t, text, code.expand(len(x), -1), mask)

    def style(self, name: str = "found") -> Style:
        """The performer's numbers that the point stands for, within their ranges."""
        numbers = {}
        for value, (key, about) in zip(self.changes["code"].tolist(), parameters().items()):
            numbers[key] = min(max(about.neutral + value * 0.5 * (about.high - about.low), about.low), about.high)
        return Style(name, **numbers)
