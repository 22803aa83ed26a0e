"""The checks of arguments: what fits comes back, what does not is named with what was expected and found."""

import re

import pytest
import torch

import motionkit as mk
from motionkit.errors import check


def test_what_fits_comes_back():
    walk, points = mk.load("data/actor/walk_neutral.bvh"), torch.zeros(8, 22, 3)
    assert check.number("seconds", 2.5, 0.1, 3600) == 2.5 and check.number("seed", 0, whole=True) == 0
    assert check.one_of("style", "old", {"old": 1, "tired": 2}) == "old"
    assert check.motion("jitter", walk, 120) is walk
    assert check.shape("positions", points, ("F", 22, 3)) is points


@pytest.mark.parametrize(
    ("refuse", "message"),
    [
        (lambda: check.number("fps", 0, 1, 1000), "fps: expected a number from 1 to 1000; found 0"),
        (lambda: check.number("fps", float("nan")), "fps: expected a number; found nan"),
        (lambda: check.number("fps", True, 1), "fps: expected a number of at least 1; found True"),
        (
            lambda: check.number("cutoff", 9, high=5, hint="; in Hz"),
            "cutoff: expected a number of at most 5; found 9; in",
        ),
        (lambda: check.number("count", 1.5, 1, whole=True), "count: expected a whole number of at least 1; found 1.5"),
        (
            lambda: check.one_of("content", "fly", ["walk"], owner="a dog has "),
            "a dog has no content 'fly'; There are walk",
        ),
        (lambda: check.one_of("style", ["old"], ["old"]), "no style ['old']; did you mean 'old'? There are old"),
        (lambda: check.motion("jitter", 3), "jitter: expected a Motion; found a int"),
        (lambda: check.motion("jitter", mk.actor.perform("bow")), "a Performance; it holds one: give its .motion"),
        (
            lambda: check.motion("fmd", mk.load("data/actor/walk_neutral.bvh")[:1], 2),
            "has 1 frames; at least 2 are needed",
        ),
        (lambda: check.shape("scores", torch.zeros(3), ("N", "C")), "expected scores [N, C]; found [3]"),
        (lambda: check.shape("scores", [1.0], ("N",)), "expected scores [N]; found a list"),
    ],
)
def test_what_does_not_fit_is_named(refuse, message):
    with pytest.raises(mk.MotionKitError, match=re.escape(message)):
        refuse()
