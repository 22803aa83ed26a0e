"""Style-ERD's step for streams: the same numbers as the network's, without torch's overhead for small tensors.

One frame asks for some ten small matrix products. Torch takes longer to find each than to do it; here NumPy does them,
all branches of a layer at once, with every sigmoid as a hyperbolic tangent, whose factors are put into the weights.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from ..layers import StyleErd
from ..layers.style_erd import Branches
from ..rotations import quaternion_multiply


class FastErd:
    """A trained network for B streams at once, each with labels and wishes of its own.

    network: is read once; later changes of it do not count. `reset` begins streams, `step` takes one frame of all.

    >>> import torch
    >>> from motionkit.layers import ErdConfig
    >>> net = StyleErd(joints=5, contents=3, styles=4, config=ErdConfig.tiny()).eval()
    >>> fast, content, style = FastErd(net), np.array([0, 2]), np.array([0, 1])
    >>> out, state = fast.step(np.ones((2, 50), "f4"), content, style, np.eye(4, dtype="f4")[:2], fast.begin(content))
    >>> out.shape
    (2, 35)
    """

    def __init__(self, network: StyleErd) -> None:
        self.contents, self.styles, self.size = network.contents, network.styles, network.config.latent
        self.encoder, self.decoder = (_layers(part) for part in (network.encoder, network.decoder))
        self.skip, self._turns = network.config.skip, slice(4 * network.joints)
        self._root = slice(4 * network.joints, 4 * network.joints + 3)  # of an answer, the root's velocity
        neutral, residual = _weights(network.neutral), _weights(network.residual)
        together = min(len(neutral), len(residual))
        self.layers = [np.concatenate(pair) for pair in zip(neutral, residual)] + neutral[together:]
        self._neutral = _beginnings(network.neutral)
        self._styles = _beginnings(network.residual)

    def begin(self, content: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
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
        if not self.skip:
            return self._said(h[0], heard, wanted), kept
        own = told[:, : self.styles] if own is None else own
        twice = np.concatenate((h[0], h[0])), np.concatenate((heard, heard), 1), np.concatenate((wanted, own))
        both = self._said(*twice)
        return self._put_back(x, both[:count], both[count:]), kept

    def _said(self, plain: np.ndarray, heard: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """The answers [B, 7J] of branches, neutral [B, H] and styles [S - 1, B, H], in the styles wanted [B, S]."""
        y = self._decoded(plain + np.einsum("bs,sbh->bh", wanted[:, 1:], heard), wanted)
        mixed = ((wanted != 0) & (wanted != 1)).any(1)
        if mixed.any():
            y[mixed, self._root] = self._ways(plain[mixed], heard[:, mixed], wanted[mixed])
        return y

    def _put_back(self, x: np.ndarray, told: np.ndarray, rebuilt: np.ndarray) -> np.ndarray:
        """As `layers.put_back`."""
        turns = self._turns
        other, own, came = (one[:, turns].reshape(len(x), -1, 4) for one in (told, rebuilt, x))
        lost = _product(own * _BACK, came)
        lost *= np.where(lost[..., :1] < 0, np.float32(-1), np.float32(1))
        speeds = told[:, turns.stop :] + x[:, turns.stop // 4 * 7 :] - rebuilt[:, turns.stop :]
        return np.concatenate((_product(other, lost).reshape(len(x), -1), speeds), 1)

    def _ways(self, plain: np.ndarray, heard: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """The root's velocities [B, 3] of mixes: what each style says alone, mixed; see `StyleErd.say`."""
        used = np.nonzero(wanted.any(0))[0]
        added = np.concatenate((np.zeros_like(plain)[None], heard))[used]
        alone = np.eye(self.styles, dtype=np.float32)[used][:, None].repeat(len(plain), 1)
        said = self._decoded(plain + added, alone)
        return np.einsum("bk,kbv->bv", wanted[:, used], said[..., self._root])

    def _decoded(self, y: np.ndarray, wanted: np.ndarray) -> np.ndarray:
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


def _weights(branch: Branches) -> list[np.ndarray]:
    """For each layer [N, 2H + 1, 4H], for what comes in, what was before, and 1; gates: take, forget, give, new."""
    found = []
    for into, over, bias in zip(branch.into.detach(), branch.over.detach(), branch.bias.detach()):
        whole = np.concatenate((into.numpy(), over.numpy(), bias.numpy()[..., None]), 2)  # [N, 4H, 2H + 1]
        take, forget, new, give = np.split(whole, 4, axis=1)
        whole = np.concatenate((take / 2, forget / 2, give / 2, new), 1)
        found.append(np.ascontiguousarray(whole.transpose(0, 2, 1), np.float32))
    return found


def _beginnings(branch: Branches) -> tuple[np.ndarray, np.ndarray]:
    return branch.hidden.detach().numpy(), branch.cell.detach().numpy()


def _layers(part: nn.Sequential) -> list[tuple[np.ndarray, np.ndarray]]:
    linear = [one for one in part if isinstance(one, nn.Linear)]
    return [(np.ascontiguousarray(one.weight.detach().numpy().T), one.bias.detach().numpy()) for one in linear]
