"""Networks that judge motions: classifiers of content and style, and the feature encoder that FMD measures in.

What a judge sees of a motion, the classifier, the autoencoder, how both are trained, and the shipped ones.

>>> import motionkit as mk
>>> mk.judges.load("actor")
Judge('actor', 12 contents, 8 styles)
"""

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
BATCH = 64  # windows

# What a judge sees


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
    motions = list(motions)
    if not motions:
        raise MotionKitError("a judge was given no motions")
    return motions


def joint_features(motion: Motion) -> Tensor:
    """Where each joint is and how fast it moves, seen from the body: [F, J, 6], metres and metres a second.

    Places are relative to the pelvis' spot on the ground, velocities relative to the ground; both turned so that the
    body faces +Z in every frame.

    >>> import motionkit as mk
    >>> joint_features(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 22, 6])
    """
    body = canonicalize(motion)
    velocities = forward_difference(motion.positions()) * motion.fps
    velocities = rot.quaternion_rotate(rot.yaw_to_quaternion(-body.yaw)[:, None], velocities)
    return torch.cat((body.local, velocities), -1).float()


def joint_rotations(motion: Motion) -> Tensor:
    """Joint rotations for paper 2's autoencoder: unit quaternions [F, J, 4], w >= 0, the pelvis' without its facing.

    >>> import motionkit as mk
    >>> joint_rotations(mk.load("data/actor/walk_neutral.bvh")).shape
    torch.Size([120, 22, 4])
    """
    body, rotations = canonicalize(motion), motion.rotations.clone()
    for joint in motion.skeleton.ancestors(motion.skeleton.pelvis):
        rotations[:, joint] = rot.quaternion_multiply(rot.yaw_to_quaternion(-body.yaw), body.world[:, joint])
    return rot.quaternion_canonical(rotations).float()


def window_starts(frames: int, length: int = WINDOW, stride: int = STRIDE) -> list[int]:
    """Where windows start so that they cover all frames; one window, as long as the clip, if that is shorter.

    >>> window_starts(120), window_starts(40)
    ([0, 32, 56], [0])
    """
    return sorted({*range(0, max(frames - length, 0) + 1, stride), max(frames - length, 0)})


@torch.no_grad()
def mean_over_windows(
    motions: Sequence[Motion | None],
    encode: Callable[[Motion], Tensor],
    network: Callable[[Tensor], Tensor],
    length: int,
) -> Tensor:
    """What a network says of motions, the mean over each one's windows: [N, D].

    encode: a motion to [F, ...]; network: windows [B, F, ...] to [B, D]. None, a result that is
    missing, gets NaN.
    """
    sums: dict[int, Tensor] = {}
    counts = [0] * len(motions)
    for first in range(0, len(motions), BATCH):
        windows: dict[int, list[tuple[int, Tensor]]] = {}  # by their length
        for n, motion in enumerate(motions[first : first + BATCH], first):
            if motion is None:
                continue
            features = encode(motion)
            for start in window_starts(len(features), length):
                window = features[start : start + length]
                windows.setdefault(len(window), []).append((n, window))
        for alike in windows.values():
            for batch in (alike[n : n + BATCH] for n in range(0, len(alike), BATCH)):
                for (n, _), output in zip(batch, network(torch.stack([window for _, window in batch]))):
                    sums[n] = sums[n] + output if n in sums else output
                    counts[n] += 1
    if not sums:
        raise MotionKitError(f"all {len(motions)} motions given to a judge are None; there is nothing to see")
    missing = torch.full_like(next(iter(sums.values())), torch.nan)
    return torch.stack([sums[n] / counts[n] if n in sums else missing for n in range(len(motions))])


# Content and style


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

        def network(windows: Tensor) -> Tensor:
            pooled = self.network.pooled(windows.permute(0, 3, 1, 2))  # [B, F, J, C] to [B, C, F, J]
            return torch.cat((self.network.classify(pooled).log_softmax(1), pooled), 1)

        return mean_over_windows(motions, self.encode, network, self.window).tensor_split([len(self.labels)], 1)

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

    def encode(self, rotations: Tensor) -> Tensor:
        """Quaternions [B, F, J, 4] to the encoder's last convolution, [B, D, F / 4]."""
        return self.encoder(rotations.flatten(2).mT)  # from [B, 4 J, F]

    def forward(self, rotations: Tensor) -> Tensor:
        """Quaternions [B, F, J, 4], noisy or not, to unit quaternions of the same shape."""
        decoded = self.decoder(self.encode(rotations))[..., : rotations.shape[1]].mT  # [B, F, 4 J]
        return rot.normalize(decoded.unflatten(2, (-1, 4)))


def denoising_loss(network: nn.Module, rotations: Tensor, noise: float = NOISE) -> Tensor:
    """Mean angle in radians between clean rotations and what a network makes of noisy ones (paper 2, supplement A).

    rotations: unit quaternions [B, F, J, 4]. Noise is normal, of standard deviation `noise`, on every number; the angle
    is the paper's L_quat (`rotations.quaternion_angle`).

    >>> denoising_loss(nn.Identity(), rot.identity_quaternion(1, 8, 2), noise=0.0)
    tensor(0.)
    """
    restored = network(rot.normalize(rotations + noise * torch.randn_like(rotations)))
    return rot.quaternion_angle(restored, rotations).mean()


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
    train, training = split.train, training or TrainConfig(STEPS[label])
    torch.manual_seed(training.seed)
    if len(train.contents if label == "content" else train.styles) < 2:
        raise MotionKitError(f"dataset {train.name!r} has one {label} only; there is nothing to tell apart")
    labels, motion = train.vocabulary[label], train[0].motion.without_helper_joints()
    network = StGcn(6 if moving else 3, len(labels), motion.skeleton, config)
    classifier = Classifier(network, label, labels, motion.skeleton, motion.fps, window, moving)
    classes = classifier.ids([getattr(clip, label) for clip in train])
    run = fit(network, _draw(FeatureCache(train, classifier), classes, window), _loss, training, **running)
    classifier.card = {**training_card(train, training, run, network), "metrics": {}}
    for part in ("validation", "test"):
        if len(getattr(split, part)):
            classifier.card["metrics"][f"{part}_accuracy"] = round(classifier.accuracy(getattr(split, part)), 2)
    return classifier


def _draw(features: FeatureCache, classes: Tensor, window: int) -> Callable[[int], dict]:
    """Windows of a random length; of each class as many, of a random clip that has frames enough."""
    longest = int(features.lengths.max())
    lengths = (1,) if window == 1 else tuple(n for n in _LENGTHS if n <= window)
    members = {}  # by length, the clips of each class that have as many frames
    for length in lengths:
        enough = features.lengths >= min(length, longest)
        groups = [torch.nonzero((classes == c) & enough)[:, 0] for c in classes.unique()]
        members[length] = [group for group in groups if len(group)]

    def draw(step: int) -> dict:
        length = lengths[int(torch.randint(len(lengths), ()))]
        groups = members[length]
        drawn = [groups[n % len(groups)] for n in range(BATCH)]
        clips = torch.stack([group[int(torch.rand(()) * len(group))] for group in drawn])
        x = features.sample(clips, min(length, longest)).permute(0, 3, 1, 2)  # [B, F, J, C] to [B, C, F, J]
        return {"x": x, "classes": classes[clips], "names": [features.dataset[n].name for n in clips.tolist()]}

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
    autoencoder = MotionAutoencoder(network, skeleton, fps)
    features = FeatureCache(split.train, autoencoder)
    window = min(WINDOW, int(features.lengths.max()))
    enough = torch.nonzero(features.lengths >= window)[:, 0]

    def draw(step: int) -> dict:
        clips = enough[torch.randint(len(enough), (BATCH,))]
        return {"x": features.sample(clips, window), "names": [split.train[n].name for n in clips.tolist()]}

    def loss_fn(model: nn.Module, batch: dict) -> Tensor:
        return denoising_loss(model, batch["x"])

    run = fit(network, draw, loss_fn, training, **running)
    unseen = FeatureCache(split.test, autoencoder)
    torch.manual_seed(training.seed)
    rotations = unseen.sample(torch.nonzero(unseen.lengths >= WINDOW)[:, 0], WINDOW)
    with torch.no_grad():
        angles = {
            "test_degrees": denoising_loss(network, rotations),
            "noise_degrees": denoising_loss(nn.Identity(), rotations),
        }
    metrics = {name: round(float(angle.rad2deg()), 3) for name, angle in angles.items()}
    autoencoder.card = {**training_card(split.train, training, run, network), "metrics": metrics}
    return autoencoder


def single_frame_accuracy(label: str, split: Split, training: TrainConfig | None = None, **running) -> float:
    """Per cent of single frames of unseen clips whose label a classifier names that sees poses and no movement.

    Every fifth frame of the test part counts; what it misses is in the timing.
    """
    training = training or TrainConfig(STEPS["frame"])
    classifier = train_classifier(label, split, None, training, window=1, moving=False, **running)
    frames = [(clip.motion[n], getattr(clip, label)) for clip in split.test for n in range(0, len(clip), 5)]
    poses, labels = zip(*frames)
    return recognition_accuracy(classifier.scores(poses), classifier.ids(labels))


def make_content(order: TrainOrder) -> Classifier:
    """For the command line: a dataset's content classifier."""
    return _make_classifier("content", order)


def make_style(order: TrainOrder) -> Classifier:
    """For the command line: a dataset's style classifier."""
    return _make_classifier("style", order)


def _make_classifier(label: str, order: TrainOrder) -> Classifier:
    """Its card also says what single frames give away."""
    split, config = order.data.split(), getattr(StGcnConfig, order.size)()
    training = order.config(STEPS[label], TrainConfig.lr)
    classifier = train_classifier(label, split, config, training, **order.running)
    still = TrainConfig(min(training.steps, STEPS["frame"]), seed=order.seed)
    accuracy = single_frame_accuracy(label, split, still, title=f"{order.title}, single frames")
    classifier.card["metrics"]["single_frame_accuracy"] = round(accuracy, 2)
    return classifier


def make_autoencoder(order: TrainOrder) -> MotionAutoencoder:
    """For the command line: the autoencoder of a dataset's motions."""
    return train_autoencoder(order.data, order.config(STEPS["autoencoder"], TrainConfig.lr), **order.running)


# The shipped ones


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
    weights = set(checkpoints.names())
    datasets = {name.removesuffix("-style") for name in weights if name.endswith("-style")}
    return sorted(name for name in datasets if {_checkpoint(name, part) for part in PARTS} <= weights)


def _checkpoint(name: str, part: str) -> str:
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
    paths = {part: checkpoints.find(_checkpoint(name, part)) for part in PARTS}
    classifiers = (Classifier.load(paths[label]) for label in ("content", "style"))
    return Judge(name, *classifiers, MotionAutoencoder.load(paths["autoencoder"]))
