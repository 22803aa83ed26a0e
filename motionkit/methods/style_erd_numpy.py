"""The NumPy twin of Style-ERD, for live streams: one frame of many streams at a time, as quickly as can be.

`NumpyKinematics` computes what `kinematics` and `motion` do, `NumpyStep` what `style_erd_network.StyleErd` does: in
torch the overhead of so many small products is longer than the products. Tests hold both equal to torch's.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from torch import nn

from ..motion import left_right_pairs
from ..rotations import quaternion_multiply
from ..skeleton import Skeleton

# -- kinematics ------------------------------------------------------------------------------------------------------


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

    def places(self, rotations: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """Local quaternions [B, J, 4] and translations [B, J, 3] to positions [B, J, 3]."""
        return self._all.places(rotations, translations)[:, self._place]

    def lowest_of(self, rotations: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """`lowest` of `places`, by the joints from the root to the feet alone."""
        return self._legs.places(rotations, translations)[:, self._soles, 1].min(1)

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
            places = [n for n, joint in enumerate(order) if depth[joint] == level]
            parents = [order.index(skeleton.parents[order[n]]) for n in places]
            self._levels.append((slice(places[0], places[-1] + 1), np.array(parents)))

    def places(self, rotations: np.ndarray, translations: np.ndarray) -> np.ndarray:
        """Forward kinematics, level by level: positions in the order of this tree."""
        rotations, translations = rotations[:, self.order], translations[:, self.order]
        local = np.empty((*rotations.shape[:2], 3, 4), rotations.dtype)  # rotation, and where it stands
        local[..., :3], local[..., 3] = quaternion_matrices(rotations), translations
        world = np.empty_like(local)
        world[:, 0] = local[:, 0]
        for joints, parents in self._levels:
            above = world[:, parents]
            np.matmul(above[..., :3], local[:, joints], out=world[:, joints])
            world[:, joints, :, 3] += above[..., 3]
        return world[..., 3]


def _quadratic_form() -> np.ndarray:
    """Of a quaternion's products w w, w x, ... z z, [16], how much goes into each entry of its matrix: [16, 9]."""
    ww, xx, yy, zz = np.eye(16, dtype=np.float32)[::5]
    wx, wy, wz, xy, xz, yz = 2 * np.eye(16, dtype=np.float32)[[1, 2, 3, 6, 7, 11]]
    entries = (
        ww + xx - yy - zz, xy - wz, xz + wy,
        xy + wz, ww - xx + yy - zz, yz - wx,
        xz - wy, yz + wx, ww - xx - yy + zz,
    )  # fmt: skip
    return np.stack(entries, 1)


_TO_MATRIX = _quadratic_form()


def quaternion_matrices(q: np.ndarray) -> np.ndarray:
    """Unit quaternions [..., 4] to matrices [..., 3, 3].

    >>> quaternion_matrices(np.array([0.0, 0.0, 1.0, 0.0])).tolist()
    [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]
    """
    return ((q[..., :, None] * q[..., None, :]).reshape(*q.shape[:-1], 16) @ _TO_MATRIX).reshape(*q.shape[:-1], 3, 3)


def rotate_y(yaw: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places [B, J, 3] turned about the vertical by yaw [B].

    >>> rotate_y(np.array([np.pi / 2]), np.array([[[0.0, 1.0, 2.0]]])).round(6).tolist()
    [[[2.0, 1.0, 0.0]]]
    """
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, z, turned = places[..., 0], places[..., 2], places.copy()
    turned[..., 0], turned[..., 2] = c * x + s * z, c * z - s * x
    return turned


def rotate_quaternion_y(yaw: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternions [B, 4] turned about the vertical by yaw [B].

    >>> rotate_quaternion_y(np.array([np.pi]), np.array([[1.0, 0.0, 0.0, 0.0]])).round(6).tolist()
    [[0.0, 0.0, 1.0, 0.0]]
    """
    c, s = np.cos(yaw / 2)[:, None], np.sin(yaw / 2)[:, None]
    return c * q + s * (q[:, [2, 3, 0, 1]] * np.float32([-1, 1, 1, -1]))  # the product with the vertical


# -- the network -----------------------------------------------------------------------------------------------------


class NumpyStep:
    """A trained network for B streams at once, each with labels and style weights of its own.

    network: is read once; later changes of it do not count. `initial_states` begin streams, `step` takes one frame of
    all.

    >>> import torch
    >>> from motionkit.methods.style_erd_network import Sizes, StyleErd
    >>> net = StyleErd(joints=5, contents=3, styles=4, sizes=Sizes.tiny()).eval()
    >>> twin, content, style = NumpyStep(net), np.array([0, 2]), np.array([0, 1])
    >>> state, weights = twin.initial_states(content), np.eye(4, dtype="f4")[:2]
    >>> out, state = twin.step(np.ones((2, 50), "f4"), content, style, weights, state)
    >>> out.shape
    (2, 35)
    """

    def __init__(self, network: nn.Module) -> None:
        self.contents, self.styles = network.contents, network.styles
        self.encoder, self.decoder = (_linear_layers(part) for part in (network.encoder, network.decoder))
        self.input_residual, self._rotations = network.config.input_residual, slice(4 * network.joints)
        self._root = slice(4 * network.joints, 4 * network.joints + 3)  # of the output, the root's velocity
        neutral, residual = _stacked_weights(network.neutral), _stacked_weights(network.residual)
        together = min(len(neutral), len(residual))
        self.layers = [np.concatenate(pair) for pair in zip(neutral, residual)] + neutral[together:]
        self._initial = []  # of every layer h and c, [N, contents, H] each
        for layer in range(len(self.layers)):
            branches = [part for part in (network.neutral, network.residual) if layer < len(part.w_ih)]
            kinds = ([part.hidden for part in branches], [part.cell for part in branches])
            parts = ([one[:, :, layer].expand(self.contents, -1, -1) for one in kind] for kind in kinds)
            self._initial.append([torch.cat(part, 1).transpose(0, 1).detach().numpy() for part in parts])

    def initial_states(self, content: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """The learned states before the first frame, of every layer (h, c), [N, B, H] each; content: [B]."""
        return [(hidden[:, content], cell[:, content]) for hidden, cell in self._initial]

    def step(
        self,
        x: np.ndarray,
        content: np.ndarray,
        style: np.ndarray,
        weights: np.ndarray,
        state: list[tuple[np.ndarray, np.ndarray]],
        own: np.ndarray | None = None,
    ) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
        """One frame of every stream: x [B, 10J], labels [B], weights [B, S] to [B, 7J], and the state after it.

        own: [B, S], how much of each style the frames are taken to have where they are rebuilt; left out, all of one.
        """
        rows, labels = np.arange(len(x)), np.zeros((len(x), self.styles + self.contents), np.float32)
        labels[rows, style] = 1
        labels[rows, self.styles + content] = 1
        y = np.concatenate((x, labels), 1)
        for weight, bias in self.encoder:
            y = np.maximum(y @ weight + bias, 0)
        after, residual, h = [], None, np.broadcast_to(y, (self.styles, *y.shape))
        for layer, (hidden, cell) in zip(self.layers, state):
            if len(layer) < len(h):  # only the neutral branch is as deep as this
                residual, h = h[1:], h[:1]
            h, cell = _cell(layer, h, hidden, cell)
            after.append((h, cell))
        neutral, residual = h[0], h[1:] if residual is None else residual
        if not self.input_residual:
            return self._decode_mix(neutral, residual, weights), after
        own = labels[:, : self.styles] if own is None else own
        twice = np.concatenate((neutral, neutral)), np.concatenate((residual, residual), 1)
        both = self._decode_mix(*twice, np.concatenate((weights, own)))
        return self._add_residual(x, both[: len(x)], both[len(x) :]), after

    def _decode_mix(self, neutral: np.ndarray, residual: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The output [B, 7J] of branches [B, H] and [S - 1, B, H] in a mix of styles [B, S]; see `StyleErd.decode`."""
        y = self._decode(neutral + np.einsum("bs,sbh->bh", weights[:, 1:], residual), weights)
        mixed = ((weights != 0) & (weights != 1)).any(1)
        if mixed.any():  # the root's velocities are mixed from those of each style alone
            neutral, residual, weights = neutral[mixed], residual[:, mixed], weights[mixed]
            used = np.nonzero(weights.any(0))[0]
            added = np.concatenate((np.zeros_like(neutral)[None], residual))[used]
            alone = np.eye(self.styles, dtype=np.float32)[used][:, None].repeat(len(neutral), 1)
            velocities = self._decode(neutral + added, alone)[..., self._root]
            y[mixed, self._root] = np.einsum("bk,kbv->bv", weights[:, used], velocities)
        return y

    def _decode(self, y: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The decoder's output [..., 7J] to mixed branches [..., H] and style weights [..., S]."""
        y = np.concatenate((y, weights), -1)
        for n, (weight, bias) in enumerate(self.decoder):
            y = y @ weight
            y += bias
            if n < len(self.decoder) - 1:
                np.maximum(y, 0, out=y)
        return y

    def _add_residual(self, x: np.ndarray, output: np.ndarray, rebuilt: np.ndarray) -> np.ndarray:
        """As `style_erd_network.input_residual`."""
        end = self._rotations.stop
        styled, own, came = (part[:, :end].reshape(len(x), -1, 4) for part in (output, rebuilt, x))
        lost = _product(own * np.float32([1, -1, -1, -1]), came)
        lost *= np.where(lost[..., :1] < 0, np.float32(-1), np.float32(1))
        velocities = output[:, end:] + x[:, end // 4 * 7 :] - rebuilt[:, end:]
        return np.concatenate((_product(styled, lost).reshape(len(x), -1), velocities), 1)


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
    layers = []
    for w_ih, w_hh, bias in zip(branch.w_ih.detach(), branch.w_hh.detach(), branch.bias.detach()):
        whole = np.concatenate((w_ih.numpy(), w_hh.numpy(), bias.numpy()[..., None]), 2)  # [N, 4H, 2H + 1]
        i, f, g, o = np.split(whole, 4, axis=1)
        whole = np.concatenate((i / 2, f / 2, o / 2, g), 1)
        layers.append(np.ascontiguousarray(whole.transpose(0, 2, 1), np.float32))
    return layers


def _linear_layers(part: nn.Sequential) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights, transposed, and biases."""
    layers = [layer for layer in part if isinstance(layer, nn.Linear)]
    return [(np.ascontiguousarray(one.weight.detach().numpy().T), one.bias.detach().numpy()) for one in layers]
