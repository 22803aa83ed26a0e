"""Transformers over time: masks, sizes, the shared embedding, waves and losses by hand, and learning one clip."""

import math

import pytest
import torch
from torch import nn

import motionkit as mk
from motionkit.diffusion import NoiseSchedule, simple_loss
from motionkit.layers import (
    Denoiser,
    PoseEmbedding,
    PoseOutput,
    SemanticEncoder,
    TransformerConfig,
    encoder,
    semantic_loss,
    sinusoids,
)
from motionkit.training import TrainConfig, fit

TINY, FRAME = TransformerConfig.tiny(), TransformerConfig(32, 2, 2, 64, frames_per_token=1, frames=40, dropout=0.0)
CONFIGS = pytest.mark.parametrize("config", [TINY, FRAME], ids=["four frames a token", "one"])


def denoiser(config: TransformerConfig = TINY, steps: int = 1000) -> Denoiser:
    torch.manual_seed(0)
    return Denoiser(10, 16, config, steps).eval()


def judge(config: TransformerConfig = TINY, embedding: PoseEmbedding | None = None) -> SemanticEncoder:
    torch.manual_seed(1)
    return SemanticEncoder(10, 16, config, embedding).eval()


def some(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(sum(shape)))


T, TEXT = torch.tensor([5, 900]), some(2, 16)


def test_paper_sizes():
    config = TransformerConfig.paper()
    assert (config.layers, config.width, config.feedforward, config.frames_per_token) == (8, 512, 1024, 1)
    with torch.device("meta"):  # no memory, no time
        network, dis = Denoiser(199, 512, config), SemanticEncoder(199, 512, config)
    for built in (network, dis):
        assert len(built.encoder.layers) == 8
        first = built.encoder.layers[0]
        assert first.linear1.weight.shape == (1024, 512) and first.self_attn.embed_dim == 512
        assert built.embedding.linear.weight.shape == (512, 199)
    assert network.output.linear.weight.shape == (199, 512)  # the input embedding's inverse
    attention, forward, norms = 4 * (512 * 512 + 512), 2 * 512 * 1024 + 1024 + 512, 4 * 512
    assert sum(p.numel() for p in encoder(config).parameters()) == 8 * (attention + forward + norms)


@CONFIGS
@pytest.mark.parametrize("frames", [1, 7, 30, 33])
def test_any_number_of_frames_comes_back(config, frames):
    x = some(2, frames, 10)
    assert denoiser(config)(x, T, TEXT).shape == x.shape
    assert judge(config)(x).shape == (2, 16)


@CONFIGS
def test_frames_that_are_not_there_change_nothing(config):
    x, mask = some(2, 32, 10), torch.arange(32) < torch.tensor([20, 32])[:, None]
    for other in (torch.zeros(()), torch.tensor(50.0)):
        changed = torch.where(mask[..., None], x, other)
        for network, more in ((denoiser(config), (T, TEXT)), (judge(config), ())):
            with torch.no_grad():
                a, b = network(x, *more, mask), network(changed, *more, mask)
                alone, free = network(x[:1, :20], *(one[:1] for one in more)), network(changed, *more)
            a, b, alone, free = (value[0, :18] if more else value[0] for value in (a, b, alone, free))
            # the motion's last two frames are not compared: half of them comes from the token behind the end
            assert torch.allclose(a, b, atol=1e-5) and torch.allclose(a, alone, atol=1e-5)
            assert not torch.allclose(a, free, atol=1e-3)  # without the mask they would


def test_a_token_that_is_partly_there_counts():
    embedding = PoseEmbedding(10, TINY)
    hidden = embedding.hidden(torch.arange(10) < torch.tensor([4, 5, 9, 10])[:, None])
    assert hidden.tolist() == [[False, True, True], [False, False, True], [False] * 3, [False] * 3]


def test_tokens_overlap_and_see_zeros_beyond_the_ends():
    embedding, x = PoseEmbedding(10, TINY), some(2, 30, 10)
    longer = torch.cat((torch.zeros(2, 2, 10), x, torch.zeros(2, 4, 10)), 1)
    by_hand = [embedding.linear(longer[:, n : n + 8].mT.flatten(1)) for n in range(0, 32, 4)]
    assert torch.allclose(embedding(x), torch.stack(by_hand, 1), atol=1e-5)


def test_frames_that_two_tokens_make_fade_from_one_to_the_other():
    output, tokens = PoseOutput(1, TINY), torch.zeros(1, 3, 64)
    nn.init.constant_(output.linear.bias, 5.0)
    assert torch.allclose(output(tokens, 11), torch.full((1, 11, 1), 5.0), atol=1e-5)
    output.linear.weight.data = torch.ones(8, 64) / 64
    made = output(tokens + torch.tensor([0.0, 1.0, 0.0])[None, :, None], 12)[0, :, 0] - 5
    assert torch.allclose(made[:2], torch.zeros(2), atol=1e-5) and torch.allclose(made[10:], torch.zeros(2), atol=1e-5)
    fade = torch.sin((torch.arange(8) + 0.5) * math.pi / 8) ** 2  # frames 2 to 9 are the middle token's
    assert torch.allclose(made[2:10], fade, atol=1e-5)
    assert made[:6].diff().min() >= 0 and made[6:].diff().max() <= 0


@CONFIGS
def test_a_motion_is_the_same_in_any_company(config):
    x, t, text = some(5, 24, 10), torch.tensor([1, 10, 100, 500, 1000]), some(5, 16)
    network, dis, order = denoiser(config), judge(config), [3, 0, 4]
    with torch.no_grad():
        assert torch.allclose(network(x, t, text)[order], network(x[order], t[order], text[order]), atol=1e-5)
        assert torch.allclose(dis(x)[order], dis(x[order]), atol=1e-5)


def test_step_text_and_order_of_frames_matter():
    network, dis, x = denoiser(), judge(), some(2, 24, 10)
    with torch.no_grad():
        now = network(x, T, TEXT)
        assert not torch.allclose(now, network(x, T + 50, TEXT), atol=1e-4)
        assert not torch.allclose(now, network(x, T, TEXT + 1), atol=1e-4)
        swapped = x.roll(8, 1)
        assert not torch.allclose(now.roll(8, 1), network(swapped, T, TEXT), atol=1e-4)
        assert not torch.allclose(dis(x), dis(swapped), atol=1e-5)


def test_gradients_reach_every_weight():
    for network, more in ((denoiser(), (T, TEXT)), (judge(), ())):
        network(some(2, 24, 10), *more).square().sum().backward()
        assert [name for name, p in network.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_waves_are_those_of_the_formula():
    found = sinusoids(50, 12)
    for place in (0, 1, 7, 49):
        for n in range(6):
            angle = place / 10000 ** (2 * n / 12)
            assert found[place, 2 * n].item() == pytest.approx(math.sin(angle), abs=1e-5)
            assert found[place, 2 * n + 1].item() == pytest.approx(math.cos(angle), abs=1e-5)


def test_motions_longer_than_the_positions_are_refused():
    network = denoiser(TransformerConfig(32, 1, 2, 32, frames=10), steps=20)
    assert network(some(1, 21, 10), T[:1], TEXT[:1]).shape == (1, 21, 10)
    with pytest.raises(mk.MotionKitError, match="positions for 21 frames; found 22"):
        network(some(1, 22, 10), T[:1], TEXT[:1])
    assert judge(FRAME)(some(1, 40, 10)).shape == (1, 16)
    with pytest.raises(mk.MotionKitError, match="longest motion for this network has 40 frames"):
        judge(FRAME)(some(1, 42, 10))


def test_the_discriminator_has_the_priors_embedding_and_leaves_it():
    """Paper 1, section 3.3: the embedding layer is shared, and stays while the discriminator learns."""
    prior = denoiser()
    dis = judge(embedding=prior.embedding)
    x = some(4, 24, 10)
    assert torch.equal(dis.embedding(x), prior.embedding(x))
    start = {name: p.detach().clone() for name, p in dis.named_parameters()}
    text = some(4, 16)
    config = TrainConfig(5, weight_decay=0.1, ema=0.9)
    fit(dis, lambda step: (x, text), lambda model, batch: semantic_loss(model(batch[0]), batch[1]), config, title="")
    moved = {name for name, p in dis.named_parameters() if not torch.equal(p, start[name])}
    assert moved == {name for name in start if not name.startswith("embedding.")}
    assert torch.equal(dis.embedding(x), prior.embedding(x)) and prior.embedding.linear.weight.requires_grad


def test_semantic_loss_by_hand():
    """Paper 1, eq. 6: one minus the product over the lengths, which count as delta at least."""
    a, b = torch.tensor([[3.0, 4.0], [1.0, 0.0], [-2.0, 0.0]]), torch.tensor([[4.0, 3.0], [5.0, 0.0], [1.0, 0.0]])
    assert semantic_loss(a, b).item() == pytest.approx((1 - 24 / 25 + 0 + 2) / 3)
    assert semantic_loss(7 * a, b / 9).item() == pytest.approx(semantic_loss(a, b).item())
    small = torch.tensor([[1e-3, 0.0]])
    assert semantic_loss(small, small, delta=1e-2).item() == pytest.approx(1 - 1e-6 / 1e-2)
    nothing = torch.zeros(1, 2, requires_grad=True)
    semantic_loss(nothing, small).backward()
    assert semantic_loss(nothing, small).item() == 1 and torch.isfinite(nothing.grad).all()
    cosine = nn.functional.cosine_similarity(some(6, 9), some(6, 9) * 2 + 1)
    assert semantic_loss(some(6, 9), some(6, 9) * 2 + 1).item() == pytest.approx(1 - cosine.mean().item(), abs=1e-6)


@pytest.mark.slow
def test_a_denoiser_overfits_one_clip():
    x = mk.features.FacingFree().encode(mk.load("data/actor/walk_old.bvh"))[:48]
    x = ((x - x.mean(0)) / x.std(0).clamp(min=0.1))[None].expand(8, -1, -1)
    torch.manual_seed(0)
    network, noise = Denoiser(x.shape[2], 4, TINY), NoiseSchedule.cosine(50)

    def loss_fn(model: nn.Module, batch: torch.Tensor) -> torch.Tensor:
        return simple_loss(lambda noisy, t: model(noisy, t, torch.zeros(8, 4)), batch, noise)

    run = fit(network, lambda step: x, loss_fn, TrainConfig(150, lr=6e-3), title="")
    assert sum(run.losses[-10:]) < 0.1 * sum(run.losses[:10])


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"width": 65}, "width must be even"),
        ({"heads": 3}, "3 heads: take width 60"),
        ({"layers": 0}, "whole numbers from 1"),
        ({"frames_per_token": 0}, "whole numbers from 1"),
        ({"frames": 2.5}, "whole numbers from 1"),
        ({"dropout": 1.0}, "dropout from 0"),
    ],
)
def test_sizes_that_do_not_fit_are_refused(wrong, message):
    sizes = {"width": 64, "layers": 2, "heads": 2, "feedforward": 128, **wrong}
    with pytest.raises(mk.MotionKitError, match=message):
        TransformerConfig(**sizes)
