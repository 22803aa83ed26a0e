"""What judges look at: joints seen from the body, in windows of one length."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache

import torch
from torch import Tensor, nn

from . import checkpoints
from . import rotations as rot
from .checkpoints import Checkpoint, Saved, training_card
from .datasets import Dataset, Split
from .datasets.batches import FeatureCache
from .errors import MotionKitError, motion_inside
from .features.canonical import canonicalize, forward_difference
from .layers import StGcn, StGcnConfig
from .metrics import recognition_accuracy
from .motion import Motion
from .skeleton import Skeleton
from .training import TrainConfig, TrainOrder, fit

WINDOW, STRIDE = 64, 32  # frames


def prepare(motion: Motion, skeleton: Skeleton, fps: float, who: str) -> Motion:
    """The motion's body at a judge's frame rate, its joints in the judge's order (a BVH file has one of its own).

    Raises MotionKitError if it is no motion, or its joints or their parents are others.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> len(prepare(walk, walk.skeleton, 15.0, "a judge"))
    60
    """
    if not isinstance(motion, Motion):
        raise MotionKitError(f"{who} judges motions; found {motion!r}{motion_inside(motion)}")
    body = motion.without_helper_joints().reorder(skeleton)
    if not body.skeleton.same_tree(skeleton):
        odd = sorted(set(body.skeleton.names) ^ set(skeleton.names)) or ["the joints' parents"]
        raise MotionKitError(
            f"{who} was trained on a skeleton of {len(skeleton)} joints; {motion.name!r} has {len(body.skeleton)}, and "
            f"they differ in {', '.join(odd[:4])}: retarget it with mk.retarget(motion, judge.skeleton), or train a "
            "classifier for this skeleton with mk.judges.train_classifier"
        )
    if not len(body):
        raise MotionKitError(f"{who}: {motion.name!r} has no frames")
    return body if body.fps == fps else body.resample(fps)


def as_list(motions: Sequence[Motion | None]) -> list[Motion | None]:
    """The motions as a list; MotionKitError for a single one, or none."""
    if isinstance(motions, Motion):
        raise MotionKitError("a judge takes several motions: give a list, [motion] for one")
    found = list(motions)
    if not found:
        raise MotionKitError("a judge was given no motions")
    return found


def joint_features(motion: Motion) -> Tensor:
    """Where each joint is and how fast it moves, seen from the body: [F, J, 6], metres and metres a second.

    Places are relative to the pelvis' spot on the ground, velocities relative to the ground; both turned so that the
    body faces +Z in every frame.

    >>> import motionkit as mk
    >>> joint_features(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 22, 6])
    """
    body = canonicalize(motion)
    moved = forward_difference(motion.positions()) * motion.fps
    return torch.cat((body.local, rot.quaternion_rotate(rot.yaw_to_quaternion(-body.yaw)[:, None], moved)), -1).float()


def joint_rotations(motion: Motion) -> Tensor:
    """Joint rotations for paper 2's autoencoder: unit quaternions [F, J, 4], w >= 0, the pelvis' without its facing.

    >>> import motionkit as mk
    >>> joint_rotations(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 22, 4])
    """
    body, turns = canonicalize(motion), motion.rotations.clone()
    for joint in motion.skeleton.ancestors(motion.skeleton.pelvis):
        turns[:, joint] = rot.quaternion_multiply(rot.yaw_to_quaternion(-body.yaw), body.world[:, joint])
    return rot.quaternion_canonical(turns).float()


def cut(frames: int, length: int = WINDOW, stride: int = STRIDE) -> list[int]:
    """Where windows start so that they cover all frames; one window, as long as the clip, if that is shorter.

    >>> cut(120), cut(40)
    ([0, 32, 56], [0])
    """
    return sorted({*range(0, max(frames - length, 0) + 1, stride), max(frames - length, 0)})


@torch.no_grad()
def mean_over_windows(
    motions: Sequence[Motion | None],
    numbers: Callable[[Motion], Tensor],
    network: Callable[[Tensor], Tensor],
    length: int,
) -> Tensor:
    """What a network says of motions, the mean over each one's windows: [N, D].

    numbers: a motion to [F, ...]; network: windows [B, F, ...] to [B, D]. None, a result that is
    missing, gets NaN.
    """
    found: list[Tensor | None] = []
    for start in range(0, len(motions), 64):
        found += _chunk(motions[start : start + 64], numbers, network, length)
    there = next((x for x in found if x is not None), None)
    if there is None:
        raise MotionKitError(f"all {len(motions)} motions given to a judge are None; there is nothing to see")
    return torch.stack([torch.full_like(there, torch.nan) if x is None else x for x in found])


def _chunk(
    motions: Sequence[Motion | None],
    numbers: Callable[[Motion], Tensor],
    network: Callable[[Tensor], Tensor],
    length: int,
) -> list[Tensor | None]:
    windows: dict[int, list[tuple[int, Tensor]]] = {}  # by their length
    for n, motion in enumerate(motions):
        if motion is None:
            continue
        x = numbers(motion)
        for start in cut(len(x), length):
            piece = x[start : start + length]
            windows.setdefault(len(piece), []).append((n, piece))
    sums: list[Tensor | None] = [None] * len(motions)
    counts = [0] * len(motions)
    for pieces in windows.values():
        for some in (pieces[n : n + 64] for n in range(0, len(pieces), 64)):
            for (n, _), value in zip(some, network(torch.stack([piece for _, piece in some]))):
                sums[n] = value if sums[n] is None else sums[n] + value
                counts[n] += 1
    return [None if total is None else total / count for total, count in zip(sums, counts)]


@dataclass(eq=False)
class Classifier(Checkpoint):
    """Tells the `content` or the `style` of motions on one skeleton (paper 1, section 5.2; paper 3; paper 4).

    label: which of the two. labels: the classes, in the order of the scores. skeleton, fps: of the motions it learned
    from; other frame rates are resampled. window: frames it sees at a time; a motion gets the mean over its windows.
    moving: whether it sees velocities. card: how it was made, see `checkpoints`.

    >>> import motionkit as mk
    >>> judge = mk.judges.load("actor").content
    >>> walk = mk.load("data/actor/walk_old.bvh")
    >>> judge.labels[int(judge.scores([walk]).argmax())]
    'walk'
    """

    kind = "classifier"

    network: StGcn
    label: str
    labels: tuple[str, ...]
    skeleton: Skeleton
    fps: float
    window: int = WINDOW
    moving: bool = True
    card: dict = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"Classifier({self.label}: {', '.join(self.labels)}; {self.skeleton!r}, {self.fps:g} fps)"

    def encode(self, motion: Motion) -> Tensor:
        """What the network sees of a motion, [F, J, 6], or 3 without velocities; MotionKitError on another skeleton."""
        x = joint_features(prepare(motion, self.skeleton, self.fps, f"this {self.label} classifier"))
        return x if self.moving else x[..., :3]

    def scores_and_features(self, motions: Sequence[Motion | None]) -> tuple[Tensor, Tensor]:
        """Log-probabilities [N, C], and the last pooling layer [N, D], of N motions; NaN for None.

        Raises MotionKitError for another skeleton, or where there is no motion at all.
        """
        motions = as_list(motions)
        self.network.eval()
        both = mean_over_windows(motions, self.encode, self._see, self.window)
        return both[:, : len(self.labels)], both[:, len(self.labels) :]

    def _see(self, windows: Tensor) -> Tensor:
        pooled = self.network.pooled(windows.permute(0, 3, 1, 2))
        return torch.cat((self.network.classify(pooled).log_softmax(1), pooled), 1)

    def scores(self, motions: Sequence[Motion | None]) -> Tensor:
        """Log-probabilities of the classes, mean over windows: [N, C]; see `scores_and_features`."""
        return self.scores_and_features(motions)[0]

    def features(self, motions: Sequence[Motion | None]) -> Tensor:
        """The last pooling layer, mean over windows: [N, D], what FMD measures in (papers 1, 3 and 4)."""
        return self.scores_and_features(motions)[1]

    def ids(self, labels: Sequence[str]) -> Tensor:
        """Class numbers of labels, long [N]; MotionKitError names one that it was not trained for."""
        unknown = sorted(set(labels) - set(self.labels))
        if unknown:
            raise MotionKitError(
                f"this classifier knows the {self.label}s {', '.join(self.labels)}; {unknown[0]!r} is none of them: "
                "take the classifier of the same dataset, or train one with mk.judges.train_classifier"
            )
        return torch.tensor([self.labels.index(label) for label in labels], dtype=torch.long)

    def accuracy(self, clips: Sequence) -> float:
        """Per cent of labelled clips (a `Dataset`, for instance) whose label it names."""
        clips = list(clips)
        scores = self.scores([clip.motion for clip in clips])
        return recognition_accuracy(scores, self.ids([getattr(clip, self.label) for clip in clips]))

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network}

    def facts(self) -> dict:
        """Labels, skeleton, and how it sees motions."""
        facts = {"label": self.label, "labels": list(self.labels), "fps": self.fps, "window": self.window}
        facts |= {"moving": self.moving, "skeleton": checkpoints.skeleton_card(self.skeleton)}
        return facts | {"config": asdict(self.network.config)}

    @classmethod
    def restore(cls, saved: Saved) -> Classifier:
        """See `checkpoints.Checkpoint`."""
        card, skeleton, labels = saved.card, saved.skeleton, tuple(saved.card["labels"])
        network = StGcn(6 if card["moving"] else 3, len(labels), skeleton, saved.config(StGcnConfig))
        network = saved.fill("network", network)
        return cls(network, card["label"], labels, skeleton, card["fps"], card["window"], card["moving"], card)


NOISE = 0.03  # standard deviation; paper 2 writes N(0, 0.03)


class DenoisingAutoencoder(nn.Module):
    """1D convolutions over time, from joint rotations to an eighth of their number and back (paper 2, supplement A).

    The paper gives no sizes; here the encoder has three convolutions that halve time twice.

    >>> net = DenoisingAutoencoder(joints=22)
    >>> x = rot.identity_quaternion(2, 64, 22)
    >>> net.encode(x).shape, net(x).shape
    (torch.Size([2, 64, 16]), torch.Size([2, 64, 22, 4]))
    """

    def __init__(self, joints: int, width: int = 128, features: int = 64) -> None:
        super().__init__()
        self.encoder = nn.Sequential(
            nn.Conv1d(4 * joints, width, 5, 2, 2),
            nn.ReLU(),
            nn.Conv1d(width, width, 5, 2, 2),
            nn.ReLU(),
            nn.Conv1d(width, features, 5, 1, 2),
        )
        self.decoder = nn.Sequential(
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="linear"),
            nn.Conv1d(features, width, 5, 1, 2),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="linear"),
            nn.Conv1d(width, 4 * joints, 5, 1, 2),
        )

    def encode(self, turns: Tensor) -> Tensor:
        """Quaternions [B, F, J, 4] to the encoder's last convolution, [B, D, F / 4]."""
        return self.encoder(turns.flatten(2).mT)

    def forward(self, turns: Tensor) -> Tensor:
        """Quaternions [B, F, J, 4], noisy or not, to unit quaternions of the same shape."""
        decoded = self.decoder(self.encode(turns))[..., : turns.shape[1]].mT  # [B, F, 4 J]
        return rot.normalize(decoded.unflatten(2, (-1, 4)))


def denoising_loss(network: nn.Module, turns: Tensor, noise: float = NOISE) -> Tensor:
    """Mean angle in radians between clean rotations and what a network makes of noisy ones (paper 2, supplement A).

    turns: unit quaternions [B, F, J, 4]. Noise is normal, of standard deviation `noise`, on every number; the angle is
    the paper's L_quat (`rotations.quaternion_angle`).

    >>> denoising_loss(nn.Identity(), rot.identity_quaternion(1, 8, 2), noise=0.0)
    tensor(0.)
    """
    restored = network(rot.normalize(turns + noise * torch.randn_like(turns)))
    return rot.quaternion_angle(restored, turns).mean()


@dataclass(eq=False)
class MotionAutoencoder(Checkpoint):
    """Features of motions from paper 2's autoencoder; it needs no labels, so it sees quality and not classes.

    skeleton, fps: of the motions it learned from. card: how it was made.
    """

    kind = "autoencoder"

    network: DenoisingAutoencoder
    skeleton: Skeleton
    fps: float
    card: dict = field(default_factory=dict, repr=False)

    def encode(self, motion: Motion) -> Tensor:
        """What the network sees of a motion, [F, J, 4]; MotionKitError on another skeleton."""
        return joint_rotations(prepare(motion, self.skeleton, self.fps, "this autoencoder"))

    def features(self, motions: Sequence[Motion | None]) -> Tensor:
        """The encoder's last convolution, mean over time: [N, D]; NaN for None.

        Raises MotionKitError for another skeleton.
        """
        self.network.eval()
        return mean_over_windows(as_list(motions), self.encode, lambda x: self.network.encode(x).mean(2), WINDOW)

    def networks(self) -> dict[str, nn.Module]:
        """See `checkpoints.Checkpoint`."""
        return {"network": self.network}

    def facts(self) -> dict:
        """Skeleton and frame rate."""
        return {"fps": self.fps, "skeleton": checkpoints.skeleton_card(self.skeleton)}

    @classmethod
    def restore(cls, saved: Saved) -> MotionAutoencoder:
        """See `checkpoints.Checkpoint`."""
        skeleton = saved.skeleton
        return cls(saved.fill("network", DenoisingAutoencoder(len(skeleton))), skeleton, saved.card["fps"], saved.card)


BATCH = 64
PARTS = ("content", "style", "autoencoder")
STEPS = {"content": 800, "style": 2000, "autoencoder": 2500, "frame": 600}
_LENGTHS = (24, 32, 48, WINDOW, WINDOW, WINDOW)  # of the windows of a batch: captures have clips shorter than 64 frames


def train_classifier(
    label: str,
    data: Dataset | Split,
    config: StGcnConfig | None = None,
    training: TrainConfig | None = None,
    *,
    window: int = WINDOW,
    moving: bool = True,
    **running,
) -> Classifier:
    """A classifier of the `content` or the `style` of a dataset's clips, trained on its training part.

    data: a dataset (its `split()` is used) or the three parts. window: frames it sees at a time; 1 shows what a single
    pose gives away, best with `moving` off. running: `resume`, `title`, `callback` of `training.fit`. Every class comes
    equally often. The card holds the accuracy on the test part. Raises MotionKitError for a label that is neither, or
    only one class.

    >>> import motionkit as mk
    >>> train_classifier("mood", mk.datasets.Split([], [], []))
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: a classifier is trained for 'content' or 'style'; found 'mood'
    """
    if label not in ("content", "style"):
        raise MotionKitError(f"a classifier is trained for 'content' or 'style'; found {label!r}")
    split = data.split() if isinstance(data, Dataset) else data
    training = training or TrainConfig(STEPS[label])
    torch.manual_seed(training.seed)
    judge = _fresh(label, split, config, window, moving)
    frames = FeatureCache(split.train, judge)
    classes = judge.ids([getattr(clip, label) for clip in split.train])
    run = fit(judge.network, _draw(frames, classes, window), _loss, training, **running)
    judge.card = {**training_card(split.train, training, run, judge.network), "metrics": {}}
    for part in ("validation", "test"):
        if len(getattr(split, part)):
            judge.card["metrics"][f"{part}_accuracy"] = round(judge.accuracy(getattr(split, part)), 2)
    return judge


def _fresh(label: str, split: Split, config: StGcnConfig | None, window: int, moving: bool) -> Classifier:
    """A classifier that has learned nothing yet, for the labels, skeleton and frame rate of a training part."""
    train = split.train
    labels = train.vocabulary[label]
    if len(train.contents if label == "content" else train.styles) < 2:
        raise MotionKitError(f"dataset {train.name!r} has one {label} only; there is nothing to tell apart")
    motion = train[0].motion.without_helper_joints()
    network = StGcn(6 if moving else 3, len(labels), motion.skeleton, config)
    return Classifier(network, label, labels, motion.skeleton, motion.fps, window, moving)


def _draw(frames: FeatureCache, classes: Tensor, window: int) -> Callable[[int], dict]:
    """Windows of a random length; of each class as many, of a random clip that has frames enough."""
    longest = int(frames.lengths.max())
    lengths = (1,) if window == 1 else tuple(n for n in _LENGTHS if n <= window)
    usable = {n: frames.lengths >= min(n, longest) for n in lengths}
    members = {n: [torch.nonzero((classes == c) & ok)[:, 0] for c in classes.unique()] for n, ok in usable.items()}

    def draw(step: int) -> dict:
        length = lengths[int(torch.randint(len(lengths), ()))]
        groups = [group for group in members[length] if len(group)]
        chosen = torch.arange(BATCH) % len(groups)
        clips = torch.stack([groups[g][int(torch.rand(()) * len(groups[g]))] for g in chosen.tolist()])
        x = frames.sample(clips, min(length, longest)).permute(0, 3, 1, 2)
        return {"x": x, "classes": classes[clips], "names": [frames.dataset[n].name for n in clips.tolist()]}

    return draw


def _loss(network: nn.Module, batch: dict) -> Tensor:
    return nn.functional.cross_entropy(network(batch["x"]), batch["classes"])


def train_autoencoder(data: Dataset | Split, training: TrainConfig | None = None, **running) -> MotionAutoencoder:
    """Paper 2's denoising autoencoder (supplement A) on a dataset's training part; its labels are not looked at.

    The card holds the mean angle, in degrees, by which it misses clean rotations of the test part, and how far the
    noise had turned them.
    """
    split = data.split() if isinstance(data, Dataset) else data
    training = training or TrainConfig(STEPS["autoencoder"])
    skeleton, fps = split.train[0].motion.without_helper_joints().skeleton, split.train[0].motion.fps
    torch.manual_seed(training.seed)
    network = DenoisingAutoencoder(len(skeleton))
    encoder = MotionAutoencoder(network, skeleton, fps)
    frames = FeatureCache(split.train, encoder)
    length = min(WINDOW, int(frames.lengths.max()))
    enough = torch.nonzero(frames.lengths >= length)[:, 0]

    def draw(step: int) -> dict:
        clips = enough[torch.randint(len(enough), (BATCH,))]
        return {"x": frames.sample(clips, length), "names": [split.train[n].name for n in clips.tolist()]}

    def loss_fn(model: nn.Module, batch: dict) -> Tensor:
        return denoising_loss(model, batch["x"])

    run = fit(network, draw, loss_fn, training, **running)
    unseen = FeatureCache(split.test, encoder)
    there = torch.nonzero(unseen.lengths >= WINDOW)[:, 0]
    with torch.no_grad():
        torch.manual_seed(training.seed)
        turns = unseen.sample(there, WINDOW)
        found = {"test_degrees": denoising_loss(network, turns), "noise_degrees": denoising_loss(nn.Identity(), turns)}
    metrics = {name: round(float(value.rad2deg()), 3) for name, value in found.items()}
    encoder.card = {**training_card(split.train, training, run, network), "metrics": metrics}
    return encoder


def single_frame_accuracy(label: str, split: Split, training: TrainConfig | None = None, **running) -> float:
    """Per cent of single frames of unseen clips whose label a classifier names that sees poses and no movement.

    Every fifth frame of the test part counts; what it misses is in the timing.
    """
    judge = train_classifier(
        label, split, None, training or TrainConfig(STEPS["frame"]), window=1, moving=False, **running
    )
    frames = [(clip.motion[n], getattr(clip, label)) for clip in split.test for n in range(0, len(clip), 5)]
    scores = judge.scores([frame for frame, _ in frames])
    return 100 * float((scores.argmax(1) == judge.ids([name for _, name in frames])).double().mean())


def make_classifier(order: TrainOrder, label: str) -> Classifier:
    """For the command line: a dataset's classifier; its card also says what single frames give away."""
    split, config = order.data.split(), getattr(StGcnConfig, order.size)()
    training = order.config(STEPS[label], TrainConfig.lr)
    judge = train_classifier(label, split, config, training, **order.running)
    still = TrainConfig(min(training.steps, STEPS["frame"]), seed=order.seed)
    share = single_frame_accuracy(label, split, still, title=f"{order.title}, single frames")
    judge.card["metrics"]["single_frame_accuracy"] = round(share, 2)
    return judge


def make_content(order: TrainOrder) -> Classifier:
    """For the command line."""
    return make_classifier(order, "content")


def make_style(order: TrainOrder) -> Classifier:
    """For the command line."""
    return make_classifier(order, "style")


def make_autoencoder(order: TrainOrder) -> MotionAutoencoder:
    """For the command line."""
    return train_autoencoder(order.data, order.config(STEPS["autoencoder"], TrainConfig.lr), **order.running)


__all__ = [
    "Classifier",
    "DenoisingAutoencoder",
    "Judge",
    "MotionAutoencoder",
    "denoising_loss",
    "load",
    "names",
    "train_autoencoder",
    "train_classifier",
]


@dataclass(frozen=True, eq=False)
class Judge:
    """What a dataset's results are measured with; `mk.arena.run` takes one.

    content, style: classifiers of the dataset's labels. autoencoder: paper 2's feature encoder.
    """

    name: str
    content: Classifier
    style: Classifier
    autoencoder: MotionAutoencoder

    def __repr__(self) -> str:
        return f"Judge({self.name!r}, {len(self.content.labels)} contents, {len(self.style.labels)} styles)"


def names() -> list[str]:
    """The datasets that `load` has judges of.

    >>> names()
    ['actor', 'actor-held-back', 'bandai-2']
    """
    there = set(checkpoints.names())
    found = {name.removesuffix("-style") for name in there if name.endswith("-style")}
    return sorted(name for name in found if {_home(name, part) for part in PARTS} <= there)


def _home(name: str, part: str) -> str:
    """The checkpoint of a part of a dataset's judge: `actor-held-back` has but styles of its own."""
    return f"{'actor' if name == 'actor-held-back' and part != 'style' else name}-{part}"


@lru_cache(maxsize=4)
def load(name: str = "actor") -> Judge:
    """The shipped judge of a dataset; MotionKitError if there is none, and how to train one."""
    if name not in names():
        raise MotionKitError(
            f"no judge for {name!r}; there are {', '.join(names()) or 'none'}. Train one: python -m motionkit train "
            f"judge --data {name}"
        )
    content, style = (Classifier.load(checkpoints.find(_home(name, label))) for label in ("content", "style"))
    return Judge(name, content, style, MotionAutoencoder.load(checkpoints.find(_home(name, "autoencoder"))))
