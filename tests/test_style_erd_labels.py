"""What guesses content and style of what comes in: it learns, and its quick twin gives the same."""

import numpy as np
import pytest
import torch
from style_erd_small import four_clips

from motionkit.actor import perform
from motionkit.features.style_erd import frames_of
from motionkit.methods.style_erd_data import Windows
from motionkit.methods.style_erd_labels import FrameClassifier, LabelTracker, label_accuracy, train_frame_classifier


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "neutral", seed=2, seconds=2.0).motion


def test_guesses_are_the_labellers_own(walk):
    torch.manual_seed(3)
    labeller, x = FrameClassifier(22, 4, 5).eval(), frames_of(walk).x
    guesses, calm = LabelTracker(labeller), []
    with torch.no_grad():
        scores = labeller(x[None])[:2]
    for n in range(len(x)):
        guesses.update(x[n : n + 1].numpy())
        now = [torch.softmax(one[0, n], 0) for one in scores]
        calm = now if not calm else [a + 0.1 * (b - a) for a, b in zip(calm, now)]
        for mine, theirs in zip(guesses._sure, calm):
            assert np.abs(mine[0] - theirs.numpy()).max() < 1e-4


@pytest.mark.slow
def test_labels_are_learned():
    windows = Windows.of(four_clips(), 30.0, 60)
    before, after = FrameClassifier(22, 2, 3), train_frame_classifier(windows, 22, steps=150, title="")
    assert (
        label_accuracy(after, windows)["content"] > 85
        and label_accuracy(after, windows)["style"] > label_accuracy(before, windows)["style"]
    )
    guesses = LabelTracker(after)
    for frame in windows.x[int((windows.content == windows.contents.index("jump")).nonzero()[0])].numpy():
        guesses.update(frame[None])
    assert windows.contents[int(guesses.content[0])] == "jump"
