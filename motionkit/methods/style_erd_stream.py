"""Content and style of what comes in, guessed frame by frame where nobody says them (paper 2, section C.1)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from ..errors import MotionKitError
from ..features.style_erd import SETTLE, TENTH
from ..motion import Motion, left_right_pairs
from ..rotations import quaternion_multiply
from ..skeleton import Skeleton
from ..training import TrainConfig, fit
from .base import without_helper_joints

FRAMES = 120  # of the windows that it learns from
_SMOOTHING = 0.1  # how much of a guess a new frame changes, so that labels do not flicker


class FrameClassifier(nn.Module):
    """A small recurrent classifier (paper 2, supplement C.1): after every frame, what the frames so far look like.

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
        heard, state = self.memory(torch.relu(self.inside(x)), state)
        return self.content(heard), self.style(heard), state


class LabelTracker:
    """The labels of B streams as they come in: `update` takes a frame of each; `content` and `style` are numbers [B].

    As `style_erd_stream.NumpyStep`, it does the labeller's work in NumPy, which is quicker for single frames.

    >>> guesses = LabelTracker(FrameClassifier(joints=5, contents=3, styles=4).eval())
    >>> guesses.update(np.zeros((2, 50), "f4"))
    >>> guesses.content.shape, guesses.style.shape
    ((2,), (2,))
    """

    def __init__(self, labeller: FrameClassifier) -> None:
        memory = labeller.memory
        layers = (labeller.inside, labeller.content, labeller.style)
        self._inside, *self._heads = ((_numbers(one.weight).T, _numbers(one.bias)) for one in layers)
        self._into, self._over = _numbers(memory.weight_ih_l0).T, _numbers(memory.weight_hh_l0).T
        self._plain, self._own = _numbers(memory.bias_ih_l0), _numbers(memory.bias_hh_l0)
        self._state, self._sure = None, None

    def update(self, x: np.ndarray) -> None:
        """The next frame of every stream, [B, 10J]."""
        h = np.zeros((len(x), len(self._over)), np.float32) if self._state is None else self._state
        seen = np.maximum(x @ self._inside[0] + self._inside[1], 0) @ self._into + self._plain
        kept, size = h @ self._over + self._own, h.shape[1]
        reset, hold = np.split(0.5 + 0.5 * np.tanh(0.5 * (seen + kept)[:, : 2 * size]), 2, axis=1)  # sigmoids
        new = np.tanh(seen[:, 2 * size :] + reset * kept[:, 2 * size :])
        self._state = new + hold * (h - new)
        now = [_shares(self._state @ weight + bias) for weight, bias in self._heads]
        self._sure = now if self._sure is None else [a + _SMOOTHING * (b - a) for a, b in zip(self._sure, now)]

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


def train_frame_classifier(windows, joints: int, steps: int = 1500, seed: int = 0, **running) -> FrameClassifier:
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
def label_accuracy(labeller: FrameClassifier, windows) -> dict[str, float]:
    """Per cent of windows whose content and style are right after the last frame and, `first_`, after the first."""
    content, style, _ = labeller(windows.x)
    found = {}
    for name, scores, right in (("content", content, windows.content), ("style", style, windows.style)):
        for when, frame in (("", -1), ("first_", 0)):
            found[when + name] = round(100 * float((scores[:, frame].argmax(1) == right).float().mean()), 1)
    return found


class NumpyKinematics:
    """A skeleton for B frames at once; all arrays are float32, quaternions w x y z.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> body = NumpyKinematics(walk.skeleton)
    >>> places = body.places(walk.rotations.numpy(), walk.translations.numpy())
    >>> bool(abs(places - walk.positions().numpy()).max() < 1e-5)
    True
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.feet = np.array(skeleton.feet())
        self._all = _Tree(skeleton, range(len(skeleton)))
        self._place = np.argsort(self._all.order)
        self._legs = _Tree(skeleton, {joint for foot in skeleton.feet() for joint in skeleton.ancestors(foot)})
        self._soles = np.nonzero(np.isin(self._legs.order, self.feet))[0]
        left, right = zip(*left_right_pairs(skeleton))
        self.left, self.right = np.array(left), np.array(right)

    def places(self, turns: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """Local quaternions [B, J, 4] and translations [B, J, 3] to positions [B, J, 3]."""
        return self._all.places(turns, translations)[:, self._place]

    def lowest_of(self, turns: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """`lowest` of `places`, by the joints from the root to the feet alone."""
        return self._legs.places(turns, translations)[:, self._soles, 1].min(1)

    def facing(self, places: np.ndarray) -> np.ndarray:
        """Yaw [B] in radians, as `motion.facing_of`."""
        across = places[:, self.left] - places[:, self.right]
        across = (across / np.linalg.norm(across, axis=-1, keepdims=True)).mean(1)
        return np.arctan2(-across[:, 2], across[:, 0])  # across x up, seen from above

    def lowest(self, places: np.ndarray) -> np.ndarray:
        """The height of the lower foot, [B]."""
        return places[:, self.feet, 1].min(1)


class _Tree:
    """Some joints of a skeleton, the root among them, in an order in which those of one depth stand together."""

    def __init__(self, skeleton: Skeleton, joints: Iterable[int]) -> None:
        depth = {joint: len(skeleton.ancestors(joint)) for joint in joints}
        order = sorted(depth, key=lambda joint: (depth[joint], joint))
        self.order, self._levels = np.array(order), []
        for level in sorted({*depth.values()})[1:]:
            own = [n for n, joint in enumerate(order) if depth[joint] == level]
            parents = [order.index(skeleton.parents[order[n]]) for n in own]
            self._levels.append((slice(own[0], own[-1] + 1), np.array(parents)))

    def places(self, turns: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """Forward kinematics, level by level: positions in the order of this tree."""
        turns, translations = turns[:, self.order], translations[:, self.order]
        local = np.empty((*turns.shape[:2], 3, 4), turns.dtype)  # rotation, and where it stands
        local[..., :3], local[..., 3] = quaternion_matrices(turns), translations
        world = np.empty_like(local)
        world[:, 0] = local[:, 0]
        for own, parents in self._levels:
            above = world[:, parents]
            np.matmul(above[..., :3], local[:, own], out=world[:, own])
            world[:, own, :, 3] += above[..., 3]
        return world[..., 3]


def _squares() -> np.ndarray:
    """Of a quaternion's products w w, w x, ... z z, [16], how much goes into each entry of its matrix: [16, 9]."""
    ww, xx, yy, zz = (np.eye(16, dtype=np.float32)[5 * k] for k in range(4))
    wx, wy, wz, xy, xz, yz = (2 * np.eye(16, dtype=np.float32)[k] for k in (1, 2, 3, 6, 7, 11))
    down = ww + xx - yy - zz, ww - xx + yy - zz, ww - xx - yy + zz
    return np.stack((down[0], xy - wz, xz + wy, xy + wz, down[1], yz - wx, xz - wy, yz + wx, down[2]), 1)


_TURN = _squares()


def quaternion_matrices(q: np.ndarray) -> np.ndarray:
    """Unit quaternions [..., 4] to matrices [..., 3, 3].

    >>> quaternion_matrices(np.array([0.0, 0.0, 1.0, 0.0])).tolist()
    [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]
    """
    return ((q[..., :, None] * q[..., None, :]).reshape(*q.shape[:-1], 16) @ _TURN).reshape(*q.shape[:-1], 3, 3)


def rotate_y(yaw: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places [B, J, 3] turned about the vertical by yaw [B].

    >>> rotate_y(np.array([np.pi / 2]), np.array([[[0.0, 1.0, 2.0]]])).round(6).tolist()
    [[[2.0, 1.0, 0.0]]]
    """
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, z, found = places[..., 0], places[..., 2], places.copy()
    found[..., 0], found[..., 2] = c * x + s * z, c * z - s * x
    return found


_ASIDE = np.float32([-1, 1, 1, -1])  # what a quaternion's y z w x count in its product with the vertical


def rotate_quaternion_y(yaw: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternions [B, 4] turned about the vertical by yaw [B].

    >>> rotate_quaternion_y(np.array([np.pi]), np.array([[1.0, 0.0, 0.0, 0.0]])).round(6).tolist()
    [[0.0, 0.0, 1.0, 0.0]]
    """
    c, s = np.cos(yaw / 2)[:, None], np.sin(yaw / 2)[:, None]
    return c * q + s * (q[:, [2, 3, 0, 1]] * _ASIDE)


class NumpyStep:
    """A trained network for B streams at once, each with labels and wishes of its own.

    network: is read once; later changes of it do not count. `reset` begins streams, `step` takes one frame of all.

    >>> import torch
    >>> from motionkit.methods.style_erd import Sizes, StyleErd
    >>> net = StyleErd(joints=5, contents=3, styles=4, sizes=Sizes.tiny()).eval()
    >>> twin, content, style = NumpyStep(net), np.array([0, 2]), np.array([0, 1])
    >>> state, weights = twin.initial_states(content), np.eye(4, dtype="f4")[:2]
    >>> out, state = twin.step(np.ones((2, 50), "f4"), content, style, weights, state)
    >>> out.shape
    (2, 35)
    """

    def __init__(self, network: nn.Module) -> None:
        self.contents, self.styles, self.size = network.contents, network.styles, network.config.latent
        self.encoder, self.decoder = (_layers(part) for part in (network.encoder, network.decoder))
        self.input_residual, self._turns = network.config.input_residual, slice(4 * network.joints)
        self._root = slice(4 * network.joints, 4 * network.joints + 3)  # of an answer, the root's velocity
        neutral, residual = _stacked_weights(network.neutral), _stacked_weights(network.residual)
        together = min(len(neutral), len(residual))
        self.layers = [np.concatenate(pair) for pair in zip(neutral, residual)] + neutral[together:]
        self._neutral = _initial(network.neutral)
        self._styles = _initial(network.residual)

    def initial_states(self, content: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """The learned states before the first frame, of every layer (h, c), [N, B, H] each; content: [B]."""
        state = []
        for layer in range(len(self.layers)):
            own = []
            for kind in (0, 1):
                parts = [self._neutral[kind][content][:, :, layer]]
                if layer < self._styles[kind].shape[2]:
                    parts.append(self._styles[kind][np.zeros_like(content)][:, :, layer])
                own.append(np.ascontiguousarray(np.concatenate(parts, 1).transpose(1, 0, 2)))
            state.append(tuple(own))
        return state

    def step(
        self,
        x: np.ndarray,
        content: np.ndarray,
        style: np.ndarray,
        wanted: np.ndarray,
        state: list[tuple[np.ndarray, np.ndarray]],
        own: np.ndarray | None = None,
    ) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """One frame of every stream: x [B, 10J], labels [B], wanted [B, S] to [B, 7J], and the state after it.

        own: [B, S], how much of each style the frames are taken to have where they are rebuilt; left out, all of one.
        """
        count = len(x)
        told = np.zeros((count, self.styles + self.contents), np.float32)
        told[np.arange(count), style] = 1
        told[np.arange(count), self.styles + content] = 1
        y = np.concatenate((x, told), 1)
        for weight, bias in self.encoder:
            y = np.maximum(y @ weight + bias, 0)
        kept, heard, h = [], None, np.broadcast_to(y, (self.styles, *y.shape))
        for weights, (before, cell) in zip(self.layers, state):
            if len(weights) < len(h):  # only the neutral branch is as deep as this
                heard, h = h[1:], h[:1]
            h, cell = _cell(weights, h, before, cell)
            kept.append((h, cell))
        heard = h[1:] if heard is None else heard
        if not self.input_residual:
            return self._decode_mix(h[0], heard, wanted), kept
        own = told[:, : self.styles] if own is None else own
        twice = np.concatenate((h[0], h[0])), np.concatenate((heard, heard), 1), np.concatenate((wanted, own))
        both = self._decode_mix(*twice)
        return self._add_residual(x, both[:count], both[count:]), kept

    def _decode_mix(self, plain: np.ndarray, heard: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """The answers [B, 7J] of branches, neutral [B, H] and styles [S - 1, B, H], in the styles wanted [B, S]."""
        y = self._decode(plain + np.einsum("bs,sbh->bh", wanted[:, 1:], heard), wanted)
        mixed = ((wanted != 0) & (wanted != 1)).any(1)
        if mixed.any():
            y[mixed, self._root] = self._mixed_velocity(plain[mixed], heard[:, mixed], wanted[mixed])
        return y

    def _add_residual(self, x: np.ndarray, told: np.ndarray, rebuilt: np.ndarray) -> np.ndarray:
        """As `style_erd.input_residual`."""
        turns = self._turns
        other, own, came = (one[:, turns].reshape(len(x), -1, 4) for one in (told, rebuilt, x))
        lost = _product(own * _BACK, came)
        lost *= np.where(lost[..., :1] < 0, np.float32(-1), np.float32(1))
        speeds = told[:, turns.stop :] + x[:, turns.stop // 4 * 7 :] - rebuilt[:, turns.stop :]
        return np.concatenate((_product(other, lost).reshape(len(x), -1), speeds), 1)

    def _mixed_velocity(self, plain: np.ndarray, heard: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """The root's velocities [B, 3] of mixes: what each style says alone, mixed; see `StyleErd.decode`."""
        used = np.nonzero(wanted.any(0))[0]
        added = np.concatenate((np.zeros_like(plain)[None], heard))[used]
        alone = np.eye(self.styles, dtype=np.float32)[used][:, None].repeat(len(plain), 1)
        said = self._decode(plain + added, alone)
        return np.einsum("bk,kbv->bv", wanted[:, used], said[..., self._root])

    def _decode(self, y: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """The decoder's answer [..., 7J] to mixed branches [..., H], told the shares [..., S]."""
        y = np.concatenate((y, wanted), -1)
        for n, (weight, bias) in enumerate(self.decoder):
            y = y @ weight
            y += bias
            if n < len(self.decoder) - 1:
                np.maximum(y, 0, out=y)
        return y


_BACK = np.float32([1, -1, -1, -1])
_HAMILTON = quaternion_multiply(torch.eye(4)[:, None], torch.eye(4)).numpy()  # [i, k]: the product of units i and k
_HAMILTON = np.ascontiguousarray(_HAMILTON.transpose(0, 2, 1))  # [i, j, k]: how much of a_i b_k is in entry j


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The quaternion product, of [B, J, 4]: as a matrix times a vector, quicker than sixteen products."""
    return np.einsum("...jk,...k->...j", (a @ _HAMILTON.reshape(4, 16)).reshape(*a.shape, 4), b)


def _cell(weights: np.ndarray, x: np.ndarray, h: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An LSTM of N branches; weights [N, 2H + 1, 4H], x, h and c [N, B, H]."""
    size = h.shape[2]
    gates = np.matmul(np.concatenate((x, h), 2), weights[:, :-1])
    gates += weights[:, -1:]
    np.tanh(gates, out=gates)
    shares = gates[..., : 3 * size]  # sigmoid(x) = (1 + tanh(x / 2)) / 2
    shares *= 0.5
    shares += 0.5
    c = gates[..., size : 2 * size] * c + gates[..., :size] * gates[..., 3 * size :]
    return gates[..., 2 * size : 3 * size] * np.tanh(c), c


def _stacked_weights(branch: nn.Module) -> list[np.ndarray]:
    """For each layer [N, 2H + 1, 4H], for what comes in, what was before, and 1; gates in the order i, f, o, g."""
    found = []
    for w_ih, w_hh, bias in zip(branch.w_ih.detach(), branch.w_hh.detach(), branch.bias.detach()):
        whole = np.concatenate((w_ih.numpy(), w_hh.numpy(), bias.numpy()[..., None]), 2)  # [N, 4H, 2H + 1]
        i, f, g, o = np.split(whole, 4, axis=1)
        whole = np.concatenate((i / 2, f / 2, o / 2, g), 1)
        found.append(np.ascontiguousarray(whole.transpose(0, 2, 1), np.float32))
    return found


def _initial(branch: nn.Module) -> tuple[np.ndarray, np.ndarray]:
    return branch.hidden.detach().numpy(), branch.cell.detach().numpy()


def _layers(part: nn.Sequential) -> list[tuple[np.ndarray, np.ndarray]]:
    linear = [one for one in part if isinstance(one, nn.Linear)]
    return [(np.ascontiguousarray(one.weight.detach().numpy().T), one.bias.detach().numpy()) for one in linear]


_STAGES = 4  # low-passes between a wish and what is done


class ErdStream:
    """B streams through a model at once (paper 2, section 4.3): call it with one frame of each, each has its own state.

    model: trained. style: a name, or a mix; strength: how much of it; both may be set at any frame: `stream.style =
    "old"`, or a list with one for each stream. From the next frame on the style follows the wish, and is there after
    about `fade` seconds, since a pose that changes from one frame to the next is a jump; 0: at once. content,
    own_style: labels of what comes in, which may change too; None where they are to be guessed, see `labels`. count: B.

    `held`: how many frames in a row were not finite numbers, for each stream; then the last good one was taken again.
    `extrapolated`: whether more than all or less than nothing of a style is asked for.
    """

    def __init__(
        self,
        model,
        style: object = "neutral",
        strength: object = 1.0,
        *,
        content: object = None,
        own_style: object = None,
        count: int = 1,
        fade: float = 1.0,
    ) -> None:
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise MotionKitError(f"count says how many streams run side by side, from 1; found {count!r}")
        if isinstance(fade, bool) or not isinstance(fade, int | float) or not 0 <= fade < float("inf"):
            raise MotionKitError(f"fade is how many seconds a style takes to come, from 0; found {fade!r}")
        self.model, self.count, self.fade, self._strength, self._style = model, count, fade, 1.0, None
        self._state, self._before, self._path, self._stages = None, None, None, None
        self._whole = np.eye(len(model.styles), dtype=np.float32)
        self._guesses = LabelTracker(model.labeller) if model.labeller is not None else None
        self.content, self.own_style = content, own_style
        self._strength = strength
        self.style = style
        self.held, self._like = np.zeros(count, int), None

    @property
    def style(self) -> object:
        """What is wanted, as it was given."""
        return self._style

    @style.setter
    def style(self, style: object) -> None:
        pairs = zip(self._each(style), self._each(self._strength), strict=True)
        self._wanted = np.stack([self.model.style_weights(*pair) for pair in pairs])
        self._style = style

    @property
    def strength(self) -> object:
        """How much of the style: 0 is neutral, 1 all of it."""
        return self._strength

    @strength.setter
    def strength(self, strength: object) -> None:
        before, self._strength = self._strength, strength
        try:
            self.style = self._style
        except MotionKitError:
            self._strength = before
            raise

    @property
    def content(self) -> object:
        """The label of what comes in, as it was given."""
        return self._content

    @content.setter
    def content(self, content: object) -> None:
        self._contents, self._content = self._numbers("content", content), content

    @property
    def own_style(self) -> object:
        """The style of what comes in, as it was given."""
        return self._own

    @own_style.setter
    def own_style(self, style: object) -> None:
        self._owns, self._own = self._numbers("style", style), style

    @property
    def labels(self) -> list[tuple[str, str]]:
        """Content and own style of every stream, by which the last frame was restyled: as given, or as guessed."""
        return [(self.model.contents[c], self.model.styles[s]) for c, s in zip(self._contents, self._owns)]

    @property
    def extrapolated(self) -> bool:
        """Whether a style is asked for beyond what was learned from."""
        others = self._wanted[:, 1:]
        return bool((others < 0).any() or (others.sum(1) > 1 + 1e-6).any())

    def __call__(self, frames: Motion | Sequence[Motion]) -> Motion | list[Motion]:
        """The next frame of every stream, each a Motion of one frame; as many come back.

        Raises MotionKitError where skeleton, joints or frame rate are not the model's, or change midway.
        """
        several = list(frames) if isinstance(frames, list | tuple) else [frames]
        bodies = [self._checked(one) for one in several]
        if len(several) != self.count:
            raise MotionKitError(f"this stream takes {self.count} frames at a time; found {len(several)}")
        turns, moves = (torch.cat(part).numpy() for part in zip(*((b.rotations, b.translations) for b in bodies)))
        turns, root = self.push(turns, moves)
        made = []
        for n, (motion, body) in enumerate(zip(several, bodies)):
            translations = body.translations.clone()
            translations[0, 0] = torch.from_numpy(root[n])
            rotations = torch.from_numpy(turns[n : n + 1])
            made.append(motion.with_helper_joints_of(body.replace(rotations=rotations, translations=translations)))
        return made[0] if isinstance(frames, Motion) else made

    def push(self, turns: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same in numbers: local quaternions [B, J, 4] and translations [B, J, 3], the root's in the world.

        Returns quaternions [B, J, 4] and the root's places [B, 3].
        """
        turns, translations = self._good(np.float32(turns), np.float32(translations))
        body, count = self.model.body, self.count
        places = body.places(turns, translations)
        yaw, ground = body.facing(places), places[:, 0] * np.float32([1, 0, 1])
        gap = (self._gap / self.model.fps * TENTH)[:, None, None]
        moved = np.zeros_like(places) if self._before is None else (places - self._before) / gap
        seen = rotate_y(-yaw, np.concatenate((places - ground[:, None], moved), 1))
        local, speed = seen[:, : places.shape[1]], seen[:, places.shape[1] :]
        own = turns.copy()
        own[:, 0] = rotate_quaternion_y(-yaw, turns[:, 0])
        own *= np.where(own[..., :1] < 0, np.float32(-1), np.float32(1))
        x = np.concatenate([part.reshape(count, -1) for part in (own, local, speed)], 1, dtype=np.float32)
        self._guess(x)
        if self._state is None:
            self._state, self._path = self.model.step.initial_states(self._contents), ground
        wanted, own = self._followed(np.stack((self._wanted, self._whole[self._owns])))
        y, self._state = self.model.step.step(x, self._contents, self._owns, wanted, self._state, own)
        made, root = self._placed(y, translations, yaw, body.lowest(local))
        self._before = places
        return made, root

    def _placed(self, y: np.ndarray, translations: np.ndarray, yaw: np.ndarray, low: np.ndarray) -> tuple:
        """The network's answer [B, 7J] in the world: quaternions and the root's places."""
        joints, body = translations.shape[1], self.model.body
        made = y[:, : 4 * joints].reshape(self.count, joints, 4)
        made = made / np.sqrt((made * made).sum(-1, keepdims=True))
        lying = translations.copy()
        lying[:, 0] = 0
        height = low - body.lowest_of(made, lying)
        if self._before is not None:
            step = rotate_y(yaw, y[:, None, 4 * joints : 4 * joints + 3] * np.float32(TENTH / self.model.fps))[:, 0]
            self._path = self._path + step
            height = self._path[:, 1] + np.float32(SETTLE) * (height - self._path[:, 1])
        self._path[:, 1] = height
        root = self._path.copy()
        made[:, 0] = rotate_quaternion_y(yaw, made[:, 0])
        return made.astype(np.float32), root.astype(np.float32)

    def _followed(self, shares: np.ndarray) -> np.ndarray:
        """Shares of styles for this frame, [2, B, S]: those wanted and those that come in, through low-passes in a row.

        So they set out and arrive gently, also where a wish changes with every frame, as a dial does, or a guess does.
        """
        if self._stages is None or not self.fade:
            self._stages = [shares] * _STAGES
            return shares
        share = np.float32(-np.expm1(-2 * _STAGES / (self.fade * self.model.fps)))
        for n, stage in enumerate(self._stages):
            self._stages[n] = shares = stage + share * (shares - stage)
        return shares

    def _guess(self, x: np.ndarray) -> None:
        """Labels that nobody has said."""
        missing = [self._content is None, self._own is None]
        if any(missing):
            self._guesses.update(x)
            self._contents = self._guesses.content if missing[0] else self._contents
            self._owns = self._guesses.style if missing[1] else self._owns

    def _numbers(self, what: str, labels: object) -> np.ndarray:
        """Of a content or a style of each stream; 0 until they are guessed, where they are to be."""
        if labels is not None:
            return np.array([self.model.label_id(what, one) for one in self._each(labels)])
        if self._guesses is None:
            known = self.model.contents if what == "content" else self.model.styles
            raise MotionKitError(f"this model guesses no labels; say the {what} of what comes in: {', '.join(known)}")
        return np.zeros(self.count, int)

    def _good(self, turns: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frames that are not finite replaced by the last good ones; how many frames lie between counts for speeds."""
        fine = np.isfinite(turns).all((1, 2)) & np.isfinite(translations).all((1, 2))
        self._gap = np.where(fine, self.held + 1, 1).astype(np.float32)
        if not fine.all():
            if self._like is None:
                raise MotionKitError("a stream's first frame holds numbers that are not finite; begin with a whole one")
            pick = fine[:, None, None]
            turns, translations = np.where(pick, turns, self._like[0]), np.where(pick, translations, self._like[1])
        self.held = np.where(fine, 0, self.held + 1)
        self._like = turns, translations
        return turns, translations

    def _each(self, value: object) -> list:
        """One for each stream."""
        found = list(value) if isinstance(value, list | tuple | np.ndarray) else [value] * self.count
        if len(found) != self.count:
            mix = "; a mix of styles is such as {'old': 0.5, 'proud': 0.5}" if self.count == 1 else ""
            raise MotionKitError(f"expected one for each of {self.count} streams; found {value!r:.60}{mix}")
        return found

    def _checked(self, frame: Motion) -> Motion:
        if not isinstance(frame, Motion) or len(frame) != 1:
            raise MotionKitError(f"a stream takes one frame at a time, such as motion[n : n + 1]; found {frame!r:.60}")
        body, model = without_helper_joints(frame), self.model
        if body.skeleton.names != model.skeleton.names or body.skeleton.parents != model.skeleton.parents:
            odd = next((a for a, b in zip(body.skeleton.names, model.skeleton.names) if a != b), "another tree")
            raise MotionKitError(
                f"the stream's frames stand on another skeleton than the model's, or on its joints in another order "
                f"(first at {odd!r}); bring them on it first, method.onto_model(motion)"
            )
        if abs(frame.fps - model.fps) > 1e-3:
            raise MotionKitError(f"this model takes {model.fps:g} frames a second; found {frame.fps:g}: resample first")
        return body
