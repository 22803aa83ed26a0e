"""The ST-GCN: neighbour sets by hand, invariances of a graph network, and that it learns."""

import pytest
import torch

import motionkit as mk
from motionkit.layers import StGcn, StGcnConfig, spatial_partitions
from motionkit.skeleton import smpl


def test_adjacency_is_the_bones():
    skeleton = smpl()
    found = skeleton.adjacency
    assert torch.equal(found, found.T) and not found.diagonal().any() and found.sum() == 2 * 21
    assert all(found[child, parent] for child, parent in enumerate(skeleton.parents) if parent >= 0)


def test_neighbour_sets_of_a_star_by_hand():
    star = torch.zeros(4, 4)
    star[0, 1:] = star[1:, 0] = 1
    own, nearer, further = spatial_partitions(star, 0)
    assert torch.allclose(own, torch.diag(torch.tensor([1 / 4, 1 / 2, 1 / 2, 1 / 2])))
    assert torch.allclose(nearer[1:, 0], torch.full((3,), 0.5)) and nearer.sum() == 1.5
    assert torch.allclose(further[0, 1:], torch.full((3,), 0.25)) and further.sum() == 0.75


def test_every_joint_hears_its_neighbours_with_weights_that_add_up_to_one():
    skeleton = smpl()
    sets = spatial_partitions(skeleton.adjacency, skeleton.pelvis)
    assert torch.allclose(sets.sum((0, 2)), torch.ones(22))
    assert torch.equal(sets.sum(0) > 0, skeleton.adjacency | torch.eye(22).bool())


def test_joints_that_hang_together_with_nothing_are_refused():
    with pytest.raises(mk.MotionKitError, match="joint 2 is not connected"):
        spatial_partitions(torch.tensor([[0, 1, 0], [1, 0, 0], [0, 0, 0]]), 0)


def test_the_paper_network_is_that_of_the_publication():
    net = StGcn(3, 400, smpl(), StGcnConfig.paper())
    assert len(net.blocks) == 9 and net.blocks[0].shortcut is None
    assert [block.temporal[2].stride[0] for block in net.blocks] == [1, 1, 1, 2, 1, 1, 2, 1, 1]
    assert net.pooled(torch.zeros(1, 3, 16, 22)).shape == (1, 256)


def test_the_order_of_a_batch_does_not_matter_and_its_frames_do():
    torch.manual_seed(0)
    net = StGcn(6, 5, smpl(), StGcnConfig.tiny()).eval()
    x = torch.randn(3, 6, 40, 22)
    with torch.no_grad():
        assert torch.allclose(net(x)[[2, 0]], net(x[[2, 0]]), atol=1e-5)
        assert (net(x) - net(x.flip(2))).abs().max() > 1e-3
        assert (net(x) - net(x.flip(3))).abs().max() > 1e-3


def test_it_reaches_as_far_over_the_graph_as_it_has_blocks():
    """Two blocks: a joint two bones away is heard, one three bones away is not."""
    torch.manual_seed(0)
    skeleton = smpl()
    net = StGcn(1, 2, skeleton, StGcnConfig((4, 4), (1, 1), dropout=0.0)).eval()
    x = torch.randn(1, 1, 8, 22)
    ankle = skeleton.index("left_ankle")
    with torch.no_grad():
        before = net.blocks(x)[0, :, :, ankle]
        for joint, heard in (("left_hip", True), ("pelvis", False)):
            moved = x.clone()
            moved[..., skeleton.index(joint)] += 1
            assert bool((net.blocks(moved)[0, :, :, ankle] - before).abs().max() > 1e-6) is heard


def test_it_learns_two_gestures_by_heart():
    torch.manual_seed(0)
    net = StGcn(3, 2, smpl(), StGcnConfig.tiny())
    t = torch.linspace(0, 6, 32)
    x, y = 0.1 * torch.randn(16, 3, 32, 22), torch.arange(16) % 2
    x[:, 1, :, 20] += torch.where(y[:, None] == 0, torch.sin(2 * t), torch.sin(4 * t))
    loss_fn = lambda net, batch: torch.nn.functional.cross_entropy(net(batch[0]), batch[1])  # noqa: E731
    losses = mk.training.fit(net, lambda step: (x, y), loss_fn, mk.training.TrainConfig(60, lr=1e-2), title="").losses
    assert losses[-1] < 0.1 * losses[0]
    assert (net(x).argmax(1) == y).all()
