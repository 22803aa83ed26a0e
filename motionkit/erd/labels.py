"""Content and style of what comes in, guessed frame by frame where nobody says them (paper 2, section C.1)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from ..training import Schedule, fit
from .pieces import Pieces

FRAMES = 120  # of the windows that it learns from
_CALM = 0.1  # how much of a guess a new frame changes, so that labels do not flicker


class Labeller(nn.Module):
    """A small recurrent classifier (paper 2, supplement C.1): after every frame, what the frames so far look like.

    >>> guess = Labeller(joints=5, contents=3, styles=4)
    >>> content, style, state = guess(torch.randn(2, 24, 50))
    >>> content.shape, style.shape
    (torch.Size([2, 24, 3]), torch.Size([2, 24, 4]))
    """

    def __init__(self, joints: int, contents: int, styles: int, size: int = 96) -> None:
        super().__init__()
        self.inside, self.memory = nn.Linear(10 * joints, size), nn.GRU(size, size, batch_first=True)
        self.content, self.style = nn.Linear(size, contents), nn.Linear(size, styles)

    def forward(self, x: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Frames x [B, F, 10J] after those that left `state` [1, B, H]: scores [B, F, C] and [B, F, S], and a state."""
        heard, state = self.memory(torch.relu(self.inside(x)), state)
        return self.content(heard), self.style(heard), state


class Guesses:
    """The labels of B streams as they come in: `hear` takes a frame of each; `content` and `style` are numbers [B].

    As `fast.FastErd`, it does the labeller's work in NumPy, which is quicker for single frames.

    >>> guesses = Guesses(Labeller(joints=5, contents=3, styles=4).eval())
    >>> guesses.hear(np.zeros((2, 50), "f4"))
    >>> guesses.content.shape, guesses.style.shape
    ((2,), (2,))
    """

    def __init__(self, labeller: Labeller) -> None:
        memory = labeller.memory
        layers = (labeller.inside, labeller.content, labeller.style)
        self._inside, *self._heads = ((_numbers(one.weight).T, _numbers(one.bias)) for one in layers)
        self._into, self._over = _numbers(memory.weight_ih_l0).T, _numbers(memory.weight_hh_l0).T
        self._plain, self._own = _numbers(memory.bias_ih_l0), _numbers(memory.bias_hh_l0)
        self._state, self._sure = None, None

    def hear(self, x: np.ndarray) -> None:
        """The next frame of every stream, [B, 10J]."""
        h = np.zeros((len(x), len(self._over)), np.float32) if self._state is None else self._state
        seen = np.maximum(x @ self._inside[0] + self._inside[1], 0) @ self._into + self._plain
        kept, size = h @ self._over + self._own, h.shape[1]
        reset, hold = np.split(0.5 + 0.5 * np.tanh(0.5 * (seen + kept)[:, : 2 * size]), 2, axis=1)  # sigmoids
        new = np.tanh(seen[:, 2 * size :] + reset * kept[:, 2 * size :])
        self._state = new + hold * (h - new)
        now = [_shares(self._state @ weight + bias) for weight, bias in self._heads]
        self._sure = now if self._sure is None else [a + _CALM * (b - a) for a, b in zip(self._sure, now)]

    @property
    def content(self) -> np.ndarray:
        """The likeliest content of each stream."""
        return self._sure[0].argmax(1)

    @property
    def style(self) -> np.ndarray:
        """The likeliest style of each stream."""
        return self._sure[1].argmax(1)


def _numbers(weight: Tensor) -> np.ndarray:
    return weight.detach().numpy()


def _shares(scores: np.ndarray) -> np.ndarray:
    """Scores [B, N] as shares of 1."""
    found = np.exp(scores - scores.max(1, keepdims=True))
    return found / found.sum(1, keepdims=True)


def train_labels(pieces: Pieces, joints: int, steps: int = 1500, seed: int = 0, **running) -> Labeller:
    """Teach it on windows, see `pieces.Pieces`; every frame counts, the first ones too. running: of `training.fit`."""
    torch.manual_seed(seed)
    net = Labeller(joints, len(pieces.contents), len(pieces.styles))

    def loss_of(model: nn.Module, step: int) -> Tensor:
        chosen = torch.randint(len(pieces.x), (32,))
        content, style, _ = model(pieces.x[chosen])
        wanted = ((content, pieces.content[chosen]), (style, pieces.style[chosen]))
        each = [nn.functional.cross_entropy(s.mT, right[:, None].expand(-1, s.shape[1])) for s, right in wanted]
        return each[0] + each[1]

    running.setdefault("title", "labels")
    fit(net, loss_of, Schedule(steps, 2e-3, seed=seed, average=0.99), **running)
    return net.requires_grad_(False)


@torch.no_grad()
def hits(labeller: Labeller, pieces: Pieces) -> dict[str, float]:
    """Per cent of windows whose content and style are right after the last frame and, `first_`, after the first."""
    content, style, _ = labeller(pieces.x)
    found = {}
    for name, scores, right in (("content", content, pieces.content), ("style", style, pieces.style)):
        for when, frame in (("", -1), ("first_", 0)):
            found[when + name] = round(100 * float((scores[:, frame].argmax(1) == right).float().mean()), 1)
    return found
