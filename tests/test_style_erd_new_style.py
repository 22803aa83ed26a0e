"""A style more for a trained Style-ERD, from one clip."""

import pytest
import torch
from style_erd_small import small_model

import motionkit as mk
from motionkit.actor import perform, retell
from motionkit.datasets import Labels
from motionkit.methods.style_erd import StyleErdTransfer
from motionkit.methods.style_erd_new_style import StyleBranch, learn_style
from motionkit.metrics import truth_error

LABELS = Labels("walk", "neutral")


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "neutral", seed=2, seconds=2.0).motion


@pytest.mark.parametrize("input_residual", [False, True])
def test_a_new_branch_stands_beside_the_others_which_stay(input_residual):
    model = small_model(input_residual=input_residual)
    branch = StyleBranch(model.network, like=2)
    with torch.no_grad():
        branch.style_embedding += 0.3
    wider, x = branch.merged(), torch.randn(1, 6, 220)
    content, style = torch.tensor([1]), torch.tensor([0])
    for name in (1, 2):
        same = [net(x, content, style, net.one_hot(torch.tensor([name])))[0] for net in (model.network, wider)]
        assert torch.allclose(*same, atol=1e-5)
    new = wider(x, content, style, wider.one_hot(torch.tensor([3])))[0]
    assert torch.allclose(new, branch(x, content, style), atol=1e-5)


@pytest.mark.slow
def test_one_clip_teaches_a_style_more(walk):
    model, played = small_model(input_residual=True), perform("walk", "neutral", seed=3, seconds=2.0)
    angry = retell(played, "angry").time_aligned(played)
    wider, run = learn_style(model, "angry", angry, played.motion, "walk", title="")
    assert sum(run.losses[-20:]) < 0.98 * sum(run.losses[:20])  # a decoder by chance can say little
    assert wider.styles == (*model.styles, "angry") and len(model.styles) == 3
    old = [StyleErdTransfer(one).stylize(walk, "old", labels=LABELS).rotations for one in (model, wider)]
    assert torch.allclose(*old, atol=1e-4)
    with pytest.raises(mk.MotionKitError, match="knows a style 'old' already"):
        learn_style(model, "old", angry, played.motion, "walk")
    with pytest.raises(mk.MotionKitError, match="in step with it"):
        learn_style(model, "new", angry[:10], played.motion, "walk")


@pytest.mark.slow
def test_a_style_learned_from_a_walk_carries_nobody_along_who_stands():
    """A bow at rest, in a style that the shipped model has learned from somebody walking: two metres, once."""
    model, played = mk.methods.load("style-erd").model, perform("walk", "neutral", seed=3, seconds=4, fps=60)
    zombie = retell(played, "zombie").time_aligned(played)
    wider, _ = learn_style(model, "zombie", zombie, played.motion, "walk", title="")
    bow = perform("bow", "neutral", seed=31, seconds=4, fps=60)
    made = StyleErdTransfer(wider).stylize(bow.motion, "zombie", lock_feet=False, labels=Labels("bow", "neutral"))
    way = made.root_path() - bow.motion.root_path()
    assert float((way - way[:1]).norm(dim=-1).max()) < 0.5
    after, before = (truth_error(motion, retell(bow, "zombie"), bow).mean() for motion in (made, bow.motion))
    assert after < 0.8 * before
