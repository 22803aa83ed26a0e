"""Paper 2's losses against hand-made answers and scipy."""

import math

import pytest
import torch
from scipy.spatial.transform import Rotation

from motionkit import rotations as rot
from motionkit.methods import style_erd


def test_the_angle_is_half_the_rotation_whatever_the_signs():
    torch.manual_seed(0)
    a, b = (rot.normalize(torch.randn(50, 1, 4, dtype=torch.float64)) for _ in range(2))
    turns = [Rotation.from_quat(q[:, 0].numpy(), scalar_first=True) for q in (a, b)]
    wanted = torch.from_numpy((turns[0].inv() * turns[1]).magnitude() / 2) ** 2
    for sign in (1, -1):
        assert torch.allclose(style_erd.quaternion_loss(a, sign * b), wanted, atol=1e-9)
    assert torch.allclose(wanted, (a * b).sum(-1).abs().acos()[:, 0] ** 2, atol=1e-9)  # as eq. 2 writes it


def test_its_gradient_ends_where_both_are_the_same():
    a = rot.identity_quaternion(1, 3).requires_grad_()
    style_erd.quaternion_loss(a, rot.identity_quaternion(1, 3)).sum().backward()
    assert bool(a.grad.isfinite().all())


def test_rebuilding_counts_all_parts_by_their_weights():
    turned = rot.axis_angle_to_quaternion(torch.tensor([0.0, 1.0, 0.0]), torch.tensor(0.4)).expand(2, 6, 5, 4)
    rotations = (rot.identity_quaternion(2, 6, 5), turned)
    places, speeds = ((torch.zeros(2, 6, 5, 3), torch.full((2, 6, 5, 3), value)) for value in (2.0, 3.0))
    wanted = 5 * 0.2**2 + 0.5 * 15 * 4 + 15 * 9
    found = style_erd.reconstruction_loss(rotations, places, speeds)
    assert found.shape == (2, 6) and torch.allclose(found, torch.full((2, 6), wanted), atol=1e-3)


def test_adversaries_want_what_the_paper_writes():
    real, fake = torch.tensor([1.0, 0.5]), torch.tensor([-1.0, 1.0])
    assert style_erd.discriminator_loss(real, fake).item() == pytest.approx((0 + 0.25) / 2 + (0 + 4) / 2)
    assert style_erd.adversarial_loss(fake).item() == pytest.approx(1.0)  # 0 is wanted, not 1


def test_the_penalty_is_the_slope_at_real_motions():
    x = torch.randn(4, 3, 2, requires_grad=True)
    weight = torch.randn(3, 2, requires_grad=True)
    penalty = style_erd.gradient_penalty((x * weight).sum((1, 2)), x)
    assert penalty.item() == pytest.approx(weight.detach().square().sum().item(), rel=1e-5)
    penalty.backward()
    assert torch.allclose(weight.grad, 2 * weight, atol=1e-5)  # so the critic can learn from it


def test_totals_have_the_papers_weights():
    frames = torch.tensor([[1.0, 2.0], [3.0, 6.0]])
    total = style_erd.generator_objective(frames, torch.tensor(5.0), torch.tensor(7.0))
    assert total.item() == pytest.approx((3 + 9) / 2 + 5 + 0.7)
    assert style_erd.discriminator_objective(torch.tensor(1.0), torch.tensor(0.25)).item() == pytest.approx(33.0)
    with pytest.raises(ValueError):
        style_erd.perceptual_loss([torch.zeros(1)], [])
    assert math.isclose(
        style_erd.perceptual_loss([torch.zeros(2), torch.zeros(2)], [torch.ones(2), torch.ones(2)]).item(), 2
    )
