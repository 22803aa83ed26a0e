"""Content and style of what comes in, predicted frame by frame where no labels are given.

Beyond paper 2, whose supplement only says that labels of contents may be missing (C.1) and suggests a classifier (C.4).
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from ..training import TrainConfig, fit
from .style_erd_data import Windows

FRAMES = 120  # of the windows that it learns from
_SMOOTHING = 0.1  # how much of a guess a new frame changes, so that labels do not flicker


class FrameClassifier(nn.Module):
    """A small recurrent classifier (beyond paper 2): after every frame, what the frames so far look like.

    >>> guess = FrameClassifier(joints=5, contents=3, styles=4)
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
        features, state = self.memory(torch.relu(self.inside(x)), state)
        return self.content(features), self.style(features), state


class LabelTracker:
    """The labels of B streams as they come in: `update` takes a frame of each; `content` and `style` are numbers [B].

    As `style_erd_numpy.NumpyStep`, it does the labeller's work in NumPy, which is quicker for single frames.

    >>> guesses = LabelTracker(FrameClassifier(joints=5, contents=3, styles=4).eval())
    >>> guesses.update(np.zeros((2, 50), "f4"))
    >>> guesses.content.shape, guesses.style.shape
    ((2,), (2,))
    """

    def __init__(self, labeller: FrameClassifier) -> None:
        memory = labeller.memory
        layers = (labeller.inside, labeller.content, labeller.style)
        self._inside, *self._heads = ((_numbers(layer.weight).T, _numbers(layer.bias)) for layer in layers)
        self._w_ih, self._w_hh = _numbers(memory.weight_ih_l0).T, _numbers(memory.weight_hh_l0).T
        self._b_ih, self._b_hh = _numbers(memory.bias_ih_l0), _numbers(memory.bias_hh_l0)
        self._state, self._sure = None, None

    def update(self, x: np.ndarray) -> None:
        """The next frame of every stream, [B, 10J]."""
        h = np.zeros((len(x), len(self._w_hh)), np.float32) if self._state is None else self._state
        size = h.shape[1]
        of_frame = np.maximum(x @ self._inside[0] + self._inside[1], 0) @ self._w_ih + self._b_ih
        of_state = h @ self._w_hh + self._b_hh
        r, z = np.split(0.5 + 0.5 * np.tanh(0.5 * (of_frame + of_state)[:, : 2 * size]), 2, axis=1)  # sigmoids
        n = np.tanh(of_frame[:, 2 * size :] + r * of_state[:, 2 * size :])  # r, z and n as in torch's GRU
        self._state = n + z * (h - n)
        now = [_softmax(self._state @ weight + bias) for weight, bias in self._heads]
        self._sure = now if self._sure is None else [a + _SMOOTHING * (b - a) for a, b in zip(self._sure, now)]

    @property
    def content(self) -> np.ndarray:
        """The likeliest content of each stream."""
        return self._sure[0].argmax(1)

    @property
    def style(self) -> np.ndarray:
        """The likeliest style of each stream."""
        return self._sure[1].argmax(1)


def recognize_frames(labeller: FrameClassifier, x: Tensor) -> tuple[list[int], list[int]]:
    """The likeliest content and style of every frame [F, 10J] of a motion, after those before it.

    >>> contents, styles = recognize_frames(FrameClassifier(joints=5, contents=3, styles=4).eval(), torch.zeros(7, 50))
    >>> len(contents), len(styles)
    (7, 7)
    """
    tracker, contents, styles = LabelTracker(labeller), [], []
    for frame in x.numpy():
        tracker.update(frame[None])
        contents.append(int(tracker.content[0]))
        styles.append(int(tracker.style[0]))
    return contents, styles


def _numbers(weight: Tensor) -> np.ndarray:
    return weight.detach().numpy()


def _softmax(scores: np.ndarray) -> np.ndarray:
    """Over the last axis of scores [B, N]."""
    powers = np.exp(scores - scores.max(1, keepdims=True))
    return powers / powers.sum(1, keepdims=True)


def train_frame_classifier(
    windows: Windows, joints: int, steps: int = 1500, seed: int = 0, **running
) -> FrameClassifier:
    """Teach it on windows, every frame counts, the first ones too. running: of `training.fit`."""
    torch.manual_seed(seed)
    net = FrameClassifier(joints, len(windows.contents), len(windows.styles))

    def draw(step: int) -> tuple[Tensor, Tensor, Tensor]:
        chosen = torch.randint(len(windows.x), (32,))
        return windows.x[chosen], windows.content[chosen], windows.style[chosen]

    def loss_fn(model: nn.Module, batch: tuple[Tensor, Tensor, Tensor]) -> Tensor:
        scores = model(batch[0])[:2]
        labels = (label[:, None].expand(-1, batch[0].shape[1]) for label in batch[1:])
        return sum(nn.functional.cross_entropy(s.mT, label) for s, label in zip(scores, labels))

    running.setdefault("title", "labels")
    fit(net, draw, loss_fn, TrainConfig(steps, 2e-3, seed=seed, ema=0.99), **running)
    return net.requires_grad_(False)


@torch.no_grad()
def label_accuracy(labeller: FrameClassifier, windows: Windows) -> dict[str, float]:
    """Per cent of windows whose content and style are right after the last frame and, `first_`, after the first."""
    content, style, _ = labeller(windows.x)
    accuracy = {}
    for name, scores, right in (("content", content, windows.content), ("style", style, windows.style)):
        for when, frame in (("", -1), ("first_", 0)):
            accuracy[when + name] = round(100 * float((scores[:, frame].argmax(1) == right).float().mean()), 1)
    return accuracy
