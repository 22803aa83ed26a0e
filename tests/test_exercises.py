"""The exercise checker tells right from wrong from not tried."""

import pytest
import torch

import motionkit as mk
from motionkit import lessons


@pytest.mark.parametrize("name", lessons.names())
def test_the_reference_passes_and_a_stub_does_not(name, capsys):
    assert lessons.check(name, lessons._EXERCISES[name].reference)
    assert not lessons.check(name, lambda *args: None)
    assert "not tried yet" in capsys.readouterr().out


@pytest.mark.parametrize("name", lessons.names())
def test_a_wrong_answer_gets_a_hint(name, capsys):
    reference = lessons._EXERCISES[name].reference
    assert not lessons.check(name, lambda *args: torch.as_tensor(reference(*args)) + 0.1)
    assert "Hint:" in capsys.readouterr().out


def slides(motion, contacts, places, pairs):
    """A student's sliding with one thing left open."""
    feet = places(motion.positions()[:, list(motion.skeleton.feet())])
    steps = (feet[1:] - feet[:-1]).norm(dim=-1) * 1000
    chosen = steps[pairs(contacts)]
    return float(chosen.mean()) if len(chosen) else 0.0


@pytest.mark.parametrize(
    "places, pairs",
    [
        (lambda p: p[..., [0, 2]], lambda c: torch.ones_like(c[1:])),  # contacts ignored
        (lambda p: p[..., [0, 2]], lambda c: c[1:] | c[:-1]),
        (lambda p: p, lambda c: c[1:] & c[:-1]),  # y counted
        (lambda p: p[..., 2:], lambda c: c[1:] & c[:-1]),  # z only
    ],
)
def test_plausible_but_wrong_sliding_is_caught(places, pairs):
    assert not lessons.check("foot_sliding", lambda m, c: slides(m, c, places, pairs))


def test_right_sliding_passes():
    assert lessons.check("foot_sliding", lambda m, c: slides(m, c, lambda p: p[..., [0, 2]], lambda c: c[1:] & c[:-1]))


def test_an_unguarded_slerp_is_caught(capsys):
    def bare(a, b, t):
        b = torch.where((a * b).sum(-1, keepdim=True) < 0, -b, b)
        angle = torch.acos((a * b).sum(-1, keepdim=True))
        return (torch.sin((1 - t) * angle) * a + torch.sin(t * angle) * b) / torch.sin(angle)

    assert not lessons.check("slerp", bare)
    assert "not finite" in capsys.readouterr().out


def test_common_slips_are_named(capsys):
    angle = lessons._EXERCISES["swing_angle"].reference
    for mine, part in (
        (lambda a, b: torch.rad2deg(angle(a, b)), "degrees?"),
        (lambda a, b: angle(a, b) / 2, "half the right"),
        (lambda a, b: (angle(a, b), 1), "not a tuple"),
    ):
        assert not lessons.check("swing_angle", mine)
        assert part in capsys.readouterr().out


def test_errors_and_shapes_are_put_in_words(capsys):
    assert not lessons.check("slerp", lambda a: a)
    assert "TypeError" in capsys.readouterr().out
    assert not lessons.check("slerp", lambda a, b, t: torch.zeros(3))
    assert "shape is [3]" in capsys.readouterr().out
    with pytest.raises(mk.MotionKitError, match="did you mean 'slerp'"):
        lessons.check("slurp", print)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda takes: torch.arange(len(takes)) % 5 == 0,  # deals out clips
        lambda takes: torch.tensor([take in list(dict.fromkeys(takes))[::5] for take in takes]),  # in order of coming
        lambda takes: torch.tensor([take in sorted(takes)[::5] for take in takes]),  # large takes count more
    ],
)
def test_a_split_that_leaks_or_is_unfair_is_caught(wrong):
    assert not lessons.check("take_split", wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda x, mask: x.mean(1),
        lambda x, mask: (x * mask[..., None]).mean(1),
        lambda x, mask: x[mask].mean(0).expand(len(x), -1),
    ],
)
def test_a_mean_that_counts_padding_is_caught(wrong):
    assert not lessons.check("masked_mean", wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda labels: torch.full((len(labels),), 1 / len(labels)),
        lambda labels: 1 / torch.bincount(labels)[labels],
        lambda labels: 1 / (torch.bincount(labels)[labels] * len(torch.bincount(labels))),  # labels that do not occur
    ],
)
def test_unbalanced_chances_are_caught(wrong):
    assert not lessons.check("balanced_chances", wrong)
