"""Paper 2's generator: LSTMs against PyTorch's, streams against whole clips, mixes, initial states; critics."""

from dataclasses import replace

import pytest
import torch
from torch import nn

import motionkit as mk
from motionkit import rotations as rot
from motionkit.methods.style_erd_network import (
    ContentClassifier,
    FTAttDiscriminator,
    LSTMBank,
    MultiClassDiscriminator,
    Sizes,
    StyleErd,
    attention_score,
)

CONTENT, STYLE = torch.tensor([0, 2]), torch.tensor([0, 1])


@pytest.fixture
def net():
    torch.manual_seed(0)
    made = StyleErd(joints=5, contents=3, styles=4, sizes=Sizes.tiny())
    for branch in (made.neutral, made.residual):
        nn.init.normal_(branch.hidden)
        nn.init.normal_(branch.cell)
    return made


def test_stacks_are_pytorchs_lstms_side_by_side():
    torch.manual_seed(0)
    stacks, z = LSTMBank(count=3, layers=2, size=4, initial_states=2), torch.randn(2, 7, 4)
    nn.init.normal_(stacks.hidden)
    nn.init.normal_(stacks.cell)
    h, c = stacks.initial_state(torch.tensor([1, 0]))
    out, state = stacks(z, (h, c))
    for n in range(3):
        oracle = nn.LSTM(4, 4, 2, batch_first=True)
        for layer in range(2):
            for name, weight in (("ih", stacks.w_ih), ("hh", stacks.w_hh)):
                getattr(oracle, f"weight_{name}_l{layer}").data = weight.data[layer, n]
            getattr(oracle, f"bias_ih_l{layer}").data = stacks.bias.data[layer, n]
            getattr(oracle, f"bias_hh_l{layer}").data.zero_()
        wanted, (last_h, last_c) = oracle(z, tuple(one[:, n].permute(1, 0, 2).contiguous() for one in (h, c)))
        assert torch.allclose(out[:, :, n], wanted, atol=1e-6)
        assert torch.allclose(state[0][:, n].permute(1, 0, 2), last_h, atol=1e-6)
        assert torch.allclose(state[1][:, n].permute(1, 0, 2), last_c, atol=1e-6)


def test_training_runs_only_the_branches_that_it_needs(net):
    x, both = torch.randn(3, 6, 50), (torch.tensor([0, 2, 3]), torch.tensor([1, 0, 0]))
    content, active = torch.tensor([0, 2, 1]), (net.one_hot(both[0]) + net.one_hot(both[1])) > 0
    few, after = net.branch_features(x, content, both[0], active=active)
    every, whole = net.branch_features(x, content, both[0])
    for weights in map(net.one_hot, both):
        assert torch.allclose(net.decode(few, weights), net.decode(every, weights), atol=1e-6)
    assert not few[:, :, 1:][~active[:, None, 1:].expand(-1, 6, -1)].any() and few[0, 0, 1].any()
    then = net.branch_features(x, content, both[0], active=active, states=after)[0]
    again = net.branch_features(x, content, both[0], active=active, states=whole)[0]
    assert torch.allclose(then, again, atol=1e-6) and not torch.allclose(then, few, atol=1e-3)


@torch.no_grad()
def test_the_input_residual_puts_back_what_is_lost(net):
    """In its own style a frame comes back as it was; in another it differs by what the network's two answers do."""
    net_with = StyleErd(5, 3, 4, replace(Sizes.tiny(), input_residual=True))
    net_with.load_state_dict(net.state_dict())
    x = torch.randn(2, 6, 50)
    x[..., :20] = rot.normalize(x[..., :20].unflatten(-1, (5, 4))).flatten(-2)
    same, other = net.one_hot(STYLE), net.one_hot(torch.tensor([3, 2]))
    back = net_with(x, CONTENT, STYLE, same)[0]
    angles = rot.quaternion_angle(*(part[..., :20].unflatten(-1, (5, 4)) for part in (back, x)))
    assert angles.max() < 1e-3 and torch.allclose(back[..., 20:], x[..., 35:], atol=1e-5)
    made, told, rebuilt = net_with(x, CONTENT, STYLE, other)[0], *(net(x, CONTENT, STYLE, w)[0] for w in (other, same))
    assert torch.allclose(made[..., 20:] - x[..., 35:], told[..., 20:] - rebuilt[..., 20:], atol=1e-5)
    made, told, rebuilt, came = (y[..., :20].unflatten(-1, (5, 4)) for y in (made, told, rebuilt, x))
    turned = rot.quaternion_multiply(made, rot.quaternion_inverse(came))
    asked = rot.quaternion_multiply(rot.normalize(told), rot.quaternion_inverse(rot.normalize(rebuilt)))
    assert rot.quaternion_angle(turned, asked).max() < 1e-3
    whole, last = net_with(x, CONTENT, STYLE, other)
    first, state = net_with(x[:, :2], CONTENT, STYLE, other)
    assert torch.allclose(torch.cat((first, net_with(x[:, 2:], CONTENT, STYLE, other, state)[0]), 1), whole, atol=1e-5)


def test_gates_may_be_open_at_first():
    torch.manual_seed(0)
    plain = StyleErd(5, 3, 4, Sizes.tiny())
    torch.manual_seed(0)
    gap = StyleErd(5, 3, 4, Sizes.tiny(), gate_bias=1.5).neutral.bias - plain.neutral.bias
    take, forget, new, give = gap.detach().chunk(4, -1)
    assert torch.allclose(take, torch.full_like(take, 1.5)) and torch.allclose(give, take)
    assert not forget.any() and not new.any()


def test_frame_by_frame_is_the_clip_at_once(net):
    x, wanted = torch.randn(2, 24, 50), net.one_hot(torch.tensor([3, 1]))
    whole, last = net(x, CONTENT, STYLE, wanted)
    state, found = None, []
    for n in range(24):
        out, state = net(x[:, n : n + 1], CONTENT, STYLE, wanted, state)
        found.append(out)
    assert torch.allclose(torch.cat(found, 1), whole, atol=1e-5)
    assert torch.allclose(state[0][0], last[0][0], atol=1e-5)


def test_a_later_frame_changes_nothing_before(net):
    x, wanted = torch.randn(2, 24, 50), net.one_hot(torch.tensor([3, 1]))
    other = x.clone()
    other[:, 10:] += 1
    a, b = (net(y, CONTENT, STYLE, wanted)[0] for y in (x, other))
    assert torch.equal(a[:, :10], b[:, :10]) and not torch.allclose(a[:, 10], b[:, 10])


def test_styles_add_up_as_section_4_4_says(net):
    """z' = r_0 + alpha r_s + (1 - alpha) r_t; the decoder here is told nothing, so it is linear in z'."""
    net.decoder = nn.Linear(net.config.latent + 4, 35)
    with torch.no_grad():
        net.decoder.weight[:, net.config.latent :] = 0
    x, one = torch.randn(2, 6, 50), torch.tensor([1, 1])
    several = (net.one_hot(one), net.one_hot(one + 1), torch.zeros(2, 4))
    a, b, none = (net(x, CONTENT, STYLE, wanted)[0] for wanted in several)
    mixed = net(x, CONTENT, STYLE, 0.3 * net.one_hot(one) + 0.7 * net.one_hot(one + 1))[0]
    assert torch.allclose(mixed, 0.3 * a + 0.7 * b, atol=1e-5)
    half = net(x, CONTENT, STYLE, 0.5 * (net.one_hot(one) + net.one_hot(0 * one)))[0]  # the rest is neutral
    assert torch.allclose(half, 0.5 * (a + none), atol=1e-5)
    assert torch.allclose(net(x, CONTENT, STYLE, net.one_hot(torch.tensor([0, 0])))[0], none, atol=1e-5)


def test_another_style_may_be_chosen_at_any_frame(net):
    """What was asked for before leaves no trace: all branches listen all the time."""
    x, first, then = torch.randn(2, 12, 50), net.one_hot(torch.tensor([1, 1])), net.one_hot(torch.tensor([3, 3]))
    wanted = torch.cat((first[:, None].expand(-1, 6, -1), then[:, None].expand(-1, 6, -1)), 1)
    out = net(x, CONTENT, STYLE, wanted)[0]
    assert torch.allclose(out[:, :6], net(x, CONTENT, STYLE, first)[0][:, :6], atol=1e-6)
    assert torch.allclose(out[:, 6:], net(x, CONTENT, STYLE, then)[0][:, 6:], atol=1e-6)


def test_initial_states_go_by_content_and_are_learned(net):
    neutral, styles = net.initial_states(torch.tensor([0, 2]))
    assert not torch.equal(neutral[0][0], neutral[0][1])
    assert torch.equal(styles[0][0], styles[0][1])
    assert not torch.equal(styles[0][0, 0], styles[0][0, 1])
    net(torch.randn(2, 3, 50), CONTENT, STYLE, net.one_hot(torch.tensor([3, 1])))[0].sum().backward()
    assert float(net.neutral.hidden.grad[0].abs().sum()) > 0 and float(net.neutral.hidden.grad[1].abs().sum()) == 0
    assert float(net.residual.cell.grad[0, 2].abs().sum()) > 0 and float(net.residual.cell.grad[0, 1].abs().sum()) == 0
    plain = StyleErd(5, 3, 4, Sizes.tiny(), learned=False)
    assert not plain.neutral.hidden.requires_grad and not plain.initial_states(CONTENT)[1][1].any()


def test_sizes_of_the_paper():
    net = StyleErd(joints=21, contents=5, styles=8)
    assert [m.out_features for m in net.encoder if isinstance(m, nn.Linear)] == [64, 32]
    assert [m.out_features for m in net.decoder if isinstance(m, nn.Linear)] == [58, 86, 128, 184, 147]
    assert net.neutral.w_ih.shape == (6, 1, 128, 32) and net.residual.w_ih.shape == (4, 7, 128, 32)
    assert net.neutral.hidden.shape == (5, 1, 6, 32)
    with pytest.raises(mk.MotionKitError, match="no style branch is deeper"):
        Sizes(neutral=2, style=3)


def test_attention_is_equation_1():
    torch.manual_seed(0)
    m, f, t = torch.randn(2, 3, 4), torch.randn(2, 3), torch.randn(2, 4)
    by_hand = [sum(m[b, i, j] * f[b, i] * t[b, j] for i in range(3) for j in range(4)) for b in range(2)]
    assert torch.allclose(attention_score(m, f, t), torch.stack(by_hand), atol=1e-5)


@pytest.mark.parametrize("cls", [FTAttDiscriminator, MultiClassDiscriminator])
def test_critics_hear_the_labels(cls):
    torch.manual_seed(0)
    critic, x = cls(5, 3, 4), torch.randn(1, 24, 30).expand(4, -1, -1)
    by_style = critic(x, torch.arange(4), torch.zeros(4, dtype=torch.long))
    by_content = critic(x[:3], torch.zeros(3, dtype=torch.long), torch.arange(3))
    assert len(set(by_style.tolist())) == 4
    assert len(set(by_content.tolist())) == (3 if cls is FTAttDiscriminator else 1)


def test_the_content_network_does_not_see_scale_or_offset():
    """A manner that shifts and scales every feature for the whole window is gone after the first layer's norm."""
    torch.manual_seed(0)
    net, x = ContentClassifier(5, 3).eval(), torch.randn(2, 24, 50)
    first = net.convolutions[0][0]
    first.padding, first.padding_mode = (0,), "zeros"  # so that borders see the same offset
    a, b = (net(y)[1][0] for y in (x, 3 * x + 2))
    assert torch.allclose(a, b, atol=1e-3)
