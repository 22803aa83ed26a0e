"""A small Style-ERD with chance weights, for tests of what is around it."""

from dataclasses import replace

import torch
from torch import nn

from motionkit.actor import perform
from motionkit.methods.style_erd import ErdConfig, ErdModel, StyleErd
from motionkit.methods.style_erd_stream import FrameClassifier

STYLES, CONTENTS = ("neutral", "old", "proud"), ("walk", "jump")


def small_model(fps: float = 30.0, labels: bool = False, skip: bool = False) -> ErdModel:
    """Of three styles and two contents, somewhere near rest."""
    torch.manual_seed(0)
    net = StyleErd(22, len(CONTENTS), len(STYLES), replace(ErdConfig.tiny(), skip=skip)).eval()
    with torch.no_grad():
        for branch in (net.neutral, net.residual):
            nn.init.normal_(branch.hidden)
        net.decoder[-1].bias[:88:4] += 2
    labeller = FrameClassifier(22, len(CONTENTS), len(STYLES)).eval() if labels else None
    skeleton = perform("walk", "neutral", seed=2, seconds=1.0).motion.skeleton
    return ErdModel(net, CONTENTS, STYLES, skeleton, fps, labeller)
