"""The quick step for streams gives the network's numbers, for one stream and many, whatever is asked for."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from motionkit.methods.style_erd import ErdConfig, StyleErd
from motionkit.methods.style_erd_stream import NumpyStep

SIZES = [ErdConfig.tiny(), ErdConfig.paper(), ErdConfig((8,), 6, 2, 2, (8,))]


@pytest.fixture(params=[*SIZES, *(replace(one, skip=True) for one in SIZES)])
def net(request):
    torch.manual_seed(0)
    made = StyleErd(joints=5, contents=3, styles=4, config=request.param).eval()
    for branch in (made.neutral, made.residual):
        nn.init.normal_(branch.hidden)
        nn.init.normal_(branch.cell)
    return made


@pytest.mark.parametrize("count", [1, 3])
def test_it_gives_the_networks_numbers(net, count):
    rng = np.random.default_rng(0)
    x = rng.normal(size=(count, 40, 50)).astype("f4")
    content, style = rng.integers(0, 3, count), rng.integers(0, 4, count)
    wanted = rng.random((count, 40, 4)).astype("f4")  # mixes and dials that change with every frame
    fast, found = NumpyStep(net), []
    state = fast.begin(content)
    for n in range(40):
        out, state = fast.step(x[:, n], content, style, wanted[:, n], state)
        found.append(out)
    with torch.no_grad():
        labels = torch.from_numpy(content), torch.from_numpy(style)
        eager = net(torch.from_numpy(x), *labels, torch.from_numpy(wanted))[0]
    assert np.abs(np.stack(found, 1) - eager.numpy()).max() < 1e-5
