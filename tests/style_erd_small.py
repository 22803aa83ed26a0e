"""A small Style-ERD with chance weights, and four clips to train one on, for tests of what is around it."""

from dataclasses import replace

import torch
from torch import nn

from motionkit.actor import perform
from motionkit.datasets import BvhSource, Dataset, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.methods.style_erd import ErdModel
from motionkit.methods.style_erd_labels import FrameClassifier
from motionkit.methods.style_erd_network import Sizes, StyleErd

STYLES, CONTENTS = ("neutral", "old", "proud"), ("walk", "jump")


def small_model(fps: float = 30.0, labels: bool = False, input_residual: bool = False) -> ErdModel:
    """Of three styles and two contents, somewhere near rest."""
    torch.manual_seed(0)
    sizes = replace(Sizes.tiny(), input_residual=input_residual)
    net = StyleErd(22, len(CONTENTS), len(STYLES), sizes).eval()
    with torch.no_grad():
        for branch in (net.neutral, net.residual):
            nn.init.normal_(branch.hidden)
        net.decoder[-1].bias[:88:4] += 2
    labeller = FrameClassifier(22, len(CONTENTS), len(STYLES)).eval() if labels else None
    skeleton = perform("walk", "neutral", seed=2, seconds=1.0).motion.skeleton
    return ErdModel(net, CONTENTS, STYLES, skeleton, fps, labeller)


def four_clips() -> Dataset:
    """Three walks and a jump; nobody jumps in a style."""
    kinds = [("walk", "neutral"), ("walk", "old"), ("walk", "proud"), ("jump", "neutral")]
    paths = [(f"data/actor/{content}_{style}.bvh", content, style) for content, style in kinds]
    return from_items("mine", [Item(path[11:-4], Labels(c, s, ()), BvhSource.at(path)) for path, c, s in paths])
