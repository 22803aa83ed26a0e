"""Small classifiers that tell how distinct labelled motion is: from windows of poses, and from a single frame."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

import motionkit as mk

WINDOW, STRIDE = 64, 16


def poses(motion: mk.Motion) -> Tensor:
    """Facing-free numbers of each frame: the root's movement, where the joints are, and how they move, [F, D].

    D = 4 + 6 (J - 1); single frames are probed without the movement.
    """
    layout = mk.features.FacingFree(motion.skeleton, motion.fps)
    encoded = layout.encode(motion)[:, : layout.slices["positions"].stop]
    moved = torch.nn.functional.pad(encoded[1:] - encoded[:-1], (0, 0, 1, 0))[:, layout.slices["positions"]]
    return torch.cat((encoded, moved), 1)


class Frames:
    """Encoded clips with their labels. values: [N, D] all frames; starts: where each clip begins, [C + 1]."""

    def __init__(self, clips: Sequence, names: dict[str, tuple[str, ...]]) -> None:
        encoded = [poses(clip.motion) for clip in clips]
        self.values = torch.cat(encoded)
        self.starts = torch.tensor([0, *(len(e) for e in encoded)]).cumsum(0)
        self.labels = {k: torch.tensor([v.index(getattr(c, k)) for c in clips]) for k, v in names.items()}

    def windows(self) -> tuple[Tensor, Tensor]:
        """First frames of all windows, and the clip that each is from."""
        found = [
            (start, clip)
            for clip, (a, b) in enumerate(zip(self.starts[:-1].tolist(), self.starts[1:].tolist()))
            for start in range(a, b - WINDOW + 1, STRIDE)
        ]
        return tuple(torch.tensor(column) for column in zip(*found))

    def scaled(self, mean: Tensor, spread: Tensor) -> Tensor:
        """All frames in standard deviations."""
        return (self.values - mean) / spread


def network(numbers: int, classes: int) -> nn.Module:
    """Three temporal convolutions and a mean over time."""
    sizes = (numbers, 96, 128, 128)
    layers = [part for a, b in zip(sizes, sizes[1:]) for part in (nn.Conv1d(a, b, 5, 2, 2), nn.ReLU(), nn.Dropout(0.1))]
    return nn.Sequential(*layers, nn.AdaptiveAvgPool1d(1), nn.Flatten(), nn.Linear(sizes[-1], classes))


def train(model: nn.Module, batch, count: int, epochs: int, size: int = 128) -> None:
    """Adam with a falling rate; batch(numbers) gives inputs and labels of some of `count` examples."""
    steps = epochs * (count // size)
    optimizer = torch.optim.AdamW(model.parameters(), 2e-3, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps)
    generator = torch.Generator().manual_seed(0)
    for _ in range(steps):
        x, y = batch(torch.randint(count, (size,), generator=generator))
        optimizer.zero_grad()
        nn.functional.cross_entropy(model(x), y).backward()
        optimizer.step()
        schedule.step()


def window_accuracy(learn: Frames, test: Frames, label: str, classes: int, epochs: int = 12) -> tuple[float, float]:
    """Per cent of unseen clips, and of their windows, whose label a network names that learned from other clips."""
    torch.manual_seed(0)
    mean, spread = learn.values.mean(0), learn.values.std(0).clamp(min=1e-4)
    span = torch.arange(WINDOW)
    starts, clips = learn.windows()
    values, names = learn.scaled(mean, spread), learn.labels[label]
    model = network(values.shape[1], classes)
    train(model, lambda n: (values[starts[n][:, None] + span].mT, names[clips[n]]), len(starts), epochs)
    model.eval()
    starts, clips = test.windows()
    values, names = test.scaled(mean, spread), test.labels[label]
    with torch.no_grad():
        scores = torch.cat([model(values[s[:, None] + span].mT) for s in starts.split(512)]).log_softmax(1)
    summed = torch.zeros(len(names), classes).index_add_(0, clips, scores)
    there = torch.unique(clips)
    right = (summed[there].argmax(1) == names[there]).float().mean()
    return 100 * float(right), 100 * float((scores.argmax(1) == names[clips]).float().mean())


def frame_accuracy(learn: Frames, test: Frames, label: str, pair: tuple[int, int], epochs: int = 4) -> float:
    """Per cent of single frames of unseen clips that a network tells apart: two labels, poses alone, no movement."""
    torch.manual_seed(0)
    sets = []
    for part in (learn, test):
        clip = torch.repeat_interleave(torch.arange(len(part.starts) - 1), part.starts[1:] - part.starts[:-1])
        names = part.labels[label][clip]
        chosen = (names == pair[0]) | (names == pair[1])
        still = slice(3, (part.values.shape[1] + 4) // 2)  # the root's height, and where the joints are
        sets.append((part.values[chosen][:, still], (names[chosen] == pair[1]).long()))
    (x, y), (unseen, wanted) = sets
    mean, spread = x.mean(0), x.std(0).clamp(min=1e-4)
    x, unseen = (x - mean) / spread, (unseen - mean) / spread
    model = nn.Sequential(nn.Linear(x.shape[1], 128), nn.ReLU(), nn.Dropout(0.2), nn.Linear(128, 2))
    train(model, lambda n: (x[n], y[n]), len(x), epochs)
    model.eval()
    with torch.no_grad():
        found = model(unseen).argmax(1)
    # both labels count alike, however many frames each has
    rates = [float((found[wanted == k] == k).float().mean()) for k in (0, 1)]
    return 50 * sum(rates)
