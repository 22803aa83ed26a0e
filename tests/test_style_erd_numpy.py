"""The NumPy twin of Style-ERD gives torch's numbers, for one stream and many, whatever is asked for."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from motionkit.actor import perform
from motionkit.methods.style_erd_network import Sizes, StyleErd
from motionkit.methods.style_erd_numpy import NumpyKinematics, NumpyStep

SIZES = [Sizes.tiny(), Sizes.paper(), Sizes((8,), 6, 2, 2, (8,))]


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "neutral", seed=2, seconds=2.0).motion


@pytest.fixture(params=[*SIZES, *(replace(one, input_residual=True) for one in SIZES)])
def net(request):
    torch.manual_seed(0)
    made = StyleErd(joints=5, contents=3, styles=4, sizes=request.param).eval()
    for branch in (made.neutral, made.residual):
        nn.init.normal_(branch.hidden)
        nn.init.normal_(branch.cell)
    return made


@pytest.mark.parametrize("count", [1, 3])
def test_the_quick_step_gives_the_networks_numbers(net, count):
    rng = np.random.default_rng(0)
    x = rng.normal(size=(count, 40, 50)).astype("f4")
    content, style = rng.integers(0, 3, count), rng.integers(0, 4, count)
    wanted = rng.random((count, 40, 4)).astype("f4")  # mixes and dials that change with every frame
    twin, found = NumpyStep(net), []
    state = twin.initial_states(content)
    for n in range(40):
        out, state = twin.step(x[:, n], content, style, wanted[:, n], state)
        found.append(out)
    with torch.no_grad():
        labels = torch.from_numpy(content), torch.from_numpy(style)
        eager = net(torch.from_numpy(x), *labels, torch.from_numpy(wanted))[0]
    assert np.abs(np.stack(found, 1) - eager.numpy()).max() < 1e-5


def test_quick_kinematics_and_facing(walk):
    turned = walk.transform(2.5)
    body, places = NumpyKinematics(walk.skeleton), turned.positions()
    assert np.abs(body.places(turned.rotations.numpy(), turned.translations.numpy()) - places.numpy()).max() < 1e-5
    low = body.lowest_of(turned.rotations.numpy(), turned.translations.numpy())
    assert np.abs(low - body.lowest(places.numpy())).max() < 1e-5
    gap = torch.from_numpy(body.facing(places.numpy())) - turned.facing()
    assert float(torch.sin(gap).abs().max()) < 1e-5 and float(torch.cos(gap).min()) > 0.99
