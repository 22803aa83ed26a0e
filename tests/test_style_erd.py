"""Paper 2: losses against hand-made answers and scipy, training, and clips through the method."""

import math
from dataclasses import replace

import pytest
import torch
from scipy.spatial.transform import Rotation
from style_erd_small import CONTENTS, STYLES, four_clips, small_model
from torch import nn

import motionkit as mk
from motionkit import rotations as rot
from motionkit.actor import perform, retell
from motionkit.arena.transfers import error_against
from motionkit.datasets import Labels
from motionkit.features.style_erd import lowest_foot, placed_positions, split
from motionkit.methods import style_erd
from motionkit.methods.style_erd import (
    ABLATIONS,
    Config,
    FTAttDiscriminator,
    MultiClassDiscriminator,
    StyleErdLoss,
    StyleErdTransfer,
    evaluate_model,
    train_content_classifier,
    train_generator,
    train_model,
)
from motionkit.methods.style_erd_data import Draw, Windows
from motionkit.methods.style_erd_network import Sizes, StyleErd
from motionkit.methods.style_erd_stream import ErdStream
from motionkit.training import TrainConfig, fit_adversarial

# -- losses -----------------------------------------------------------------------------------------------------------


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


def test_reconstruction_counts_all_parts_by_their_weights():
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


# -- training --------------------------------------------------------------------------------------------------------

SMALL = Config.tiny()
PLAIN = replace(SMALL, adversarial=False, perceptual=False)


@pytest.fixture(scope="module")
def data():
    return four_clips()


@pytest.fixture(scope="module")
def skeleton(data):
    return data[0].motion.skeleton


@pytest.fixture(scope="module")
def windows(data):
    return Windows.of(data, SMALL.fps)


@pytest.fixture(scope="module")
def paired(data):
    return Windows.of(data, SMALL.fps, paired=True)


@pytest.fixture(scope="module")
def contents(windows):
    return train_content_classifier(windows, 22, steps=2, title="")


@pytest.fixture
def generator():
    torch.manual_seed(0)
    return StyleErd(22, 2, 3, SMALL.sizes)


@pytest.fixture
def critic():
    torch.manual_seed(1)
    return FTAttDiscriminator(22, 2, 3)


def drawn(windows, seed=3, **options):
    """One batch."""
    torch.manual_seed(seed)
    return Draw(windows, SMALL.batch, **options)(0)


def parts(x):
    """Rotations, positions and velocities of frames."""
    return [part.unflatten(-1, (22, -1)) for part in x.split((88, 66, 66), -1)]


def by_hand(generator, critic, batch, contents, skeleton, config):
    """Eqs. 8 and 9 of a batch, written out: both losses."""
    x, content, style, target = (batch[name] for name in ("x", "content", "style", "target"))
    came, states = parts(x), None
    if batch["burn_in"] is not None:
        states = generator(batch["burn_in"], content, style, generator.one_hot(style))[1]
        states = [[part.detach() for part in state] for state in states]
    restyled = generator(x, content, style, generator.one_hot(target), states)[0]
    features = generator.branch_features(x, content, style, states=states)[0]
    rebuilt = generator.decode(features, generator.one_hot(style))  # before what is lost is put back

    def placed(rotations):
        return placed_positions(skeleton, batch["offsets"], rotations, lowest_foot(skeleton, came[1]))

    def distance(wanted, output):
        rotations, velocities = split(output)
        errors = [(wanted[1] - placed(rotations)).square(), (wanted[2] - velocities).square()]
        angles = (wanted[0] * rotations).sum(-1).abs().clamp(max=1 - 1e-7).acos().square().sum(-1)  # eq. 2
        frames = angles + 0.5 * errors[0].sum((-2, -1)) + errors[1].sum((-2, -1))  # eq. 3
        moved = (placed(rotations) - wanted[1]).diff(dim=1).mul(config.fps / 10).square().sum((-2, -1))
        return frames.sum(1) + config.smoothness * moved.sum(1)

    loss = distance(came, rebuilt).mean()
    if config.paired:
        pair = parts(batch["pair"])
        pair = pair[0], placed(pair[0]), pair[2]
        loss = loss + config.paired * (distance(pair, restyled) * batch["has_pair"]).mean()
    rotations, velocities = split(restyled)
    fake = torch.cat((placed(rotations).flatten(2), velocities.flatten(2)), 2)
    after = torch.cat((rotations.flatten(2), fake), 2)
    maps = zip(contents(x)[1], contents(after)[1])
    loss = loss + critic(fake, target, content).square().mean()  # eq. 4
    loss = loss + 0.1 * sum((a - b).square().mean() for a, b in maps)  # eqs. 7 and 8
    real, fake = batch["real"].clone().requires_grad_(), fake.detach()
    scores = critic(real, target, batch["real_content"])
    slope = torch.autograd.grad(scores.sum(), real, create_graph=True)[0]
    objective = (scores - 1).square().mean() + (critic(fake, target, content) + 1).square().mean()  # eq. 5
    return loss, objective + 128 * slope.square().sum((1, 2)).mean()  # eqs. 6 and 9


@pytest.mark.parametrize("beyond", [False, True], ids=["paper", "with the kit's additions"])
def test_a_batch_costs_what_the_equations_say(beyond, windows, paired, contents, skeleton, critic):
    config, batch = SMALL, drawn(windows)
    if beyond:
        config = replace(SMALL, paired=0.7, smoothness=8.0, sizes=replace(Sizes.tiny(), input_residual=True))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Draw, "back", lambda self: 2)
            batch = drawn(paired, burn_in=2)
        assert batch["has_pair"].any() and batch["burn_in"].shape[1] == 40
    torch.manual_seed(0)
    generator = StyleErd(22, 2, 3, config.sizes)
    losses = StyleErdLoss(skeleton, contents, config)
    loss, fake = losses.generator(generator, critic, batch)
    objective = losses.critic(critic, fake.detach(), batch)
    expected = by_hand(generator, critic, batch, contents, skeleton, config)
    assert fake.shape == (6, 24, 132) and loss.item() == pytest.approx(expected[0].item(), rel=1e-4)
    assert objective.item() == pytest.approx(expected[1].item(), rel=1e-4)


class Oracle(nn.Module):
    """A generator that knows the answers: frames come back as they were, and a target is the paired window."""

    def __init__(self, batch, off=0.0):
        super().__init__()
        self.config, self.batch, self.off = Sizes.tiny(), batch, off

    def one_hot(self, style):
        return nn.functional.one_hot(style, 3).float()

    def branch_features(self, x, content, style, **_):
        return x, None

    def decode(self, x, weights):
        own = (weights == self.one_hot(self.batch["style"])).all(1)[:, None, None]
        answer = torch.where(own, x, self.batch["pair"])
        velocities = answer[..., 154:] + torch.where(own, 0.0, self.off)
        return torch.cat((answer[..., :88], velocities), 2)


@torch.no_grad()
def test_a_paired_window_is_the_right_answer_and_costs_nothing(paired, contents, skeleton, generator):
    """The loss is 0 where the pair comes out, by hand what it is elsewhere, and counts by its weight."""
    batch = next(b for b in (drawn(paired, seed) for seed in range(99)) if 0 < int(b["has_pair"].sum()) < 6)
    batch["target"] = torch.where(batch["has_pair"], batch["target"], (batch["style"] + 1) % 3)
    losses = StyleErdLoss(skeleton, contents, replace(PLAIN, paired=1.0))
    assert losses(Oracle(batch), batch) < 1e-2
    share = float(batch["has_pair"].float().mean())  # those without a pair do not count
    assert float(losses(Oracle(batch, 0.5), batch)) == pytest.approx(24 * 0.25 * 3 * 22 * share, abs=0.01)
    found = [float(StyleErdLoss(skeleton, contents, replace(PLAIN, paired=w))(generator, batch)) for w in (0, 1, 2)]
    assert found[2] - found[1] == pytest.approx(found[1] - found[0], rel=1e-3) and found[1] > found[0]


def test_with_a_burn_in_it_learns_from_the_middle_of_streams(windows, contents, skeleton, generator, monkeypatch):
    monkeypatch.setattr(Draw, "back", lambda self: 2)
    batch, calls, branch_features = drawn(windows, burn_in=2), [], generator.branch_features

    def watched(x, *labels, **options):
        calls.append((x.shape[1], torch.is_grad_enabled()))
        return branch_features(x, *labels, **options)

    monkeypatch.setattr(generator, "branch_features", watched)
    StyleErdLoss(skeleton, contents, PLAIN)(generator, batch).backward()
    assert calls == [(40, False), (24, True)]
    assert generator.neutral.hidden.grad is None  # its own initial state is not what it is learning from here


@torch.no_grad()
def test_what_trembles_costs_where_smoothness_counts(windows, contents, skeleton, generator):
    batch = drawn(windows)
    costs = [
        float(StyleErdLoss(skeleton, contents, replace(PLAIN, smoothness=weight))(generator, batch))
        for weight in (0.0, 3.0)
    ]
    x, content, style = (batch[name] for name in ("x", "content", "style"))
    rotations = split(generator(x, content, style, generator.one_hot(style))[0])[0]
    came = parts(x)[1]
    off = placed_positions(skeleton, batch["offsets"], rotations, lowest_foot(skeleton, came)) - came
    moved = 3.0 * (off.diff(dim=1) * (SMALL.fps / 10)).square().sum((1, 2, 3)).mean()
    assert costs[1] - costs[0] == pytest.approx(float(moved), rel=1e-4) and moved > 0


@torch.no_grad()
def test_with_an_input_residual_the_network_learns_what_comes_out_of_it(windows):
    """In its own style a window comes back whole, whatever the network says; and that is what is judged."""
    rows = torch.arange(4)
    torch.manual_seed(0)
    net = StyleErd(22, 2, 3, replace(SMALL.sizes, input_residual=True))
    x, content, style = (part[rows] for part in (windows.x, windows.content, windows.style))
    other = (style + 1) % 3
    features, _ = net.branch_features(x, content, style)
    _, same = StyleErdLoss._outputs(net, x, features, style, style)
    assert torch.allclose(same[1].flatten(2), x[..., 154:], atol=1e-5)
    rotations = parts(x)[0]
    assert style_erd.quaternion_loss(same[0], rotations).max() < 1e-4
    rebuilt, styled = StyleErdLoss._outputs(net, x, features, style, other)
    whole = split(net(x, content, style, net.one_hot(other))[0])
    assert all(torch.allclose(a, b, atol=1e-5) for a, b in zip(styled, whole))
    assert style_erd.quaternion_loss(rebuilt[0], rotations).min() > 1e-2


def test_neither_network_learns_from_the_others_loss(windows, contents, skeleton, generator, critic):
    batch, gradients = drawn(windows), {}
    for name, config in (("all", SMALL), ("reconstruction", PLAIN)):
        generator.zero_grad()
        critic.requires_grad_(False)
        loss, fake = StyleErdLoss(skeleton, contents, config).generator(generator, critic, batch)
        loss.backward()
        gradients[name] = [w.grad.clone() for w in generator.decoder.parameters()]
    assert any(float((a - b).abs().max()) > 0 for a, b in zip(*gradients.values()))
    assert all(w.grad is None for w in critic.parameters()) and not any(w.requires_grad for w in contents.parameters())
    generator.zero_grad()
    critic.requires_grad_(True)
    StyleErdLoss(skeleton, contents, SMALL).critic(critic, fake.detach(), batch).backward()
    assert any(float(w.grad.abs().max()) > 0 for w in critic.parameters())
    assert all(w.grad is None for w in generator.parameters())


def test_the_critic_has_a_rate_of_its_own(windows, contents, skeleton, generator, critic):
    losses, networks = StyleErdLoss(skeleton, contents, SMALL), (generator, critic)
    before = [{key: value.clone() for key, value in network.state_dict().items()} for network in networks]
    training = TrainConfig(1, 1e-3, weight_decay=0.0, grad_clip=1e6, critic_lr_ratio=0.5)
    fit_adversarial(networks, Draw(windows, 6), (losses.generator, losses.critic), training, title="")
    moved = [
        max(float((value - old[key]).abs().max()) for key, value in network.state_dict().items())
        for old, network in zip(before, networks)
    ]
    assert moved == pytest.approx([1e-3, 5e-4], rel=0.01)  # Adam's first step is as long as the rate


def test_a_training_that_was_broken_off_goes_on_exactly_there(data, contents, tmp_path):
    config, file = replace(SMALL, burn_in=2, paired=1.0), tmp_path / "erd.run"
    whole, unbroken, _ = train_generator(data, config, contents=contents, title="")

    def stop(step, loss):
        if step == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_generator(data, config, contents=contents, title="", resume=file, callback=stop)
    assert file.exists()
    resumed, run, _ = train_generator(data, config, contents=contents, title="", resume=file)
    assert run.losses == unbroken.losses and len(run.losses) == 4 and not file.exists()
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name


def test_the_papers_numbers_and_what_the_kit_adds():
    """Supplement A: 2,000 epochs, batch 16, rates 0.0001 and 0.00005; none of the kit's additions."""
    assert Config.paper(windows=33) == Config(Sizes.paper(), steps=2000 * 3, batch=16, lr=1e-4, critic_lr_ratio=0.5)
    additions = ("cycle", "burn_in", "gate_bias", "smoothness", "paired")
    assert not any(getattr(Config.paper(33), name) for name in additions) and not Sizes.paper().input_residual
    laptop = Config.laptop()
    assert all(getattr(laptop, name) for name in additions if name != "cycle") and laptop.sizes.input_residual


def test_table_1_has_its_rows_and_each_leaves_out_its_part(data, contents, monkeypatch):
    full = replace(Config.laptop(), paired=0.0, sizes=Sizes.paper())
    assert list(ABLATIONS) == [
        "ours", "L_gen = L_rec", "L_gen = L_rec + L_adv", "L_gen = L_rec + L_per", "without attention",
        "without learned initial states", "ours + time-aligned pairs", "ours + time-aligned pairs + input residual",
    ]  # fmt: skip
    assert ABLATIONS["ours + time-aligned pairs + input residual"] == Config.laptop()
    assert ABLATIONS["ours"] == full and ABLATIONS["L_gen = L_rec + L_adv"] == replace(full, perceptual=False)
    made = []
    for cls in (FTAttDiscriminator, MultiClassDiscriminator):
        monkeypatch.setattr(style_erd, cls.__name__, lambda *a, cls=cls: made.append(cls) or cls(*a))
    for changes in ({}, {"attention": False}, {"initial_states": False}):
        net, run, _ = train_generator(data, replace(SMALL, **changes), contents=contents, title="")
        assert len(run.losses) == 4 and not net.training
        assert bool(net.neutral.hidden.any()) is changes.get("initial_states", True)
    assert made == [FTAttDiscriminator, MultiClassDiscriminator, FTAttDiscriminator]


def test_reconstruction_is_learned(data, contents):
    config = replace(PLAIN, steps=60, lr=1e-2)
    _, run, _ = train_generator(data, config, contents=contents, title="")
    assert sum(run.losses[-5:]) < 0.6 * sum(run.losses[:5])


def test_a_cycle_counts_by_its_weight_and_can_be_trained(data, windows, contents, skeleton, generator):
    batch = drawn(windows, unpaired=True)
    with torch.no_grad():
        losses = [
            float(StyleErdLoss(skeleton, contents, replace(PLAIN, cycle=weight))(generator, batch))
            for weight in (0.0, 1.0, 2.0)
        ]
    assert losses[2] - losses[1] == pytest.approx(losses[1] - losses[0], rel=1e-3) and losses[1] > losses[0]
    net, run, _ = train_generator(data, replace(SMALL, cycle=1.0), contents=contents, title="")
    assert len(run.losses) == SMALL.steps and all(torch.isfinite(w).all() for w in net.parameters())


@pytest.mark.slow
def test_a_model_is_trained_and_measured(data, capsys):
    model = train_model(data, SMALL, label_steps=3, title="")
    assert model.styles[0] == "neutral" and model.labeller is not None and model.card["batch"] == 6
    found = evaluate_model(model, data)
    assert found["rebuilt_mm"] > 0 and set(found) == {"rebuilt_mm", "content", "style", "first_content", "first_style"}
    assert all(0 <= found[name] <= 100 for name in found if name != "rebuilt_mm")
    assert train_model(data, SMALL, label_steps=0, title="").labeller is None
    assert capsys.readouterr().err == ""  # without a title there are no progress bars


# -- the method ------------------------------------------------------------------------------------------------------

LABELS = Labels("walk", "neutral")


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "neutral", seed=2, seconds=2.0).motion


@pytest.fixture(scope="module")
def method():
    return StyleErdTransfer(small_model())


@pytest.mark.parametrize("input_residual", [False, True])
@pytest.mark.parametrize("style", ["old", {"old": 0.5, "proud": 0.5}])
def test_a_clip_is_what_its_stream_gives(input_residual, style, walk):
    method = StyleErdTransfer(small_model(input_residual=input_residual))
    whole = method.transfer(walk, style, 1.0, labels=LABELS, seed=0)
    stream = method.stream(style, content="walk", own_style="neutral", fade=0)
    frames = torch.cat([stream(walk[n : n + 1]).positions() for n in range(len(walk))])
    assert float((whole.positions() - frames).abs().max()) < 1e-4
    styled = method.stylize(walk, style, lock_feet=False, labels=LABELS)
    moved = styled.positions() - frames
    assert float((moved - moved[:1, :1]).abs().max()) < 1e-4  # but for where it begins
    assert styled.name.endswith("as old" if style == "old" else "as old + proud") and styled.skeleton is walk.skeleton
    assert isinstance(stream, ErdStream)


def test_a_clip_whose_content_changes_midway_is_what_its_stream_gives(walk, monkeypatch):
    method = StyleErdTransfer(small_model(input_residual=True))
    contents = ["walk"] * 25 + ["jump"] * (len(walk) - 25)
    monkeypatch.setattr(method, "_labels", lambda body, labels: (contents, "neutral"))
    whole, stream = method.transfer(walk, "old", 1.0, labels=Labels(), seed=0).positions(), method.stream(
        "old", content="walk", own_style="neutral", fade=0
    )  # fmt: skip
    frames = []
    for n, content in enumerate(contents):
        stream.content = content
        frames.append(stream(walk[n : n + 1]).positions())
    assert float((whole - torch.cat(frames)).abs().max()) < 1e-4
    monkeypatch.undo()
    as_walk = method.transfer(walk, "old", 1.0, labels=LABELS, seed=0).positions()
    assert torch.allclose(whole[:25], as_walk[:25], atol=1e-5) and float((whole - as_walk)[25:].abs().max()) > 1e-3


def test_other_rates_and_bodies_come_back_as_they_were(method):
    faster = perform("walk", "neutral", seed=1, seconds=2, fps=50).motion
    for motion in (mk.load("data/actor/walk_neutral.bvh"), faster):
        result = method.stylize(motion, "proud", labels=LABELS)
        assert (len(result), result.fps) == (len(motion), motion.fps) and result.skeleton.same_tree(motion.skeleton)
        assert bool(result.positions().isfinite().all())
        start = result.root_path()[0] - motion.root_path()[0]
        assert float(start.norm()) < 0.05
    with pytest.raises(mk.MotionKitError):
        method.stylize(mk.load("data/actor/dog_trot_neutral.bvh"), "old", labels=LABELS)


def test_mixes_strengths_and_names(method, walk):
    whole, half, none = (
        method.stylize(walk, "old", s, lock_feet=False, labels=LABELS).positions() for s in (1.0, 0.5, 0.0)
    )
    assert torch.equal(none, walk.positions())  # 0 is the content itself
    neutral = method.stylize(walk, "neutral", lock_feet=False, labels=LABELS).positions()
    assert not torch.equal(half, whole) and not torch.equal(half, none) and not torch.equal(half, neutral)
    mixed = method.stylize(walk, {"old": 0.5, "proud": 0.5}, labels=LABELS)
    assert mixed.name.endswith("as old + proud")
    with pytest.raises(mk.MotionKitError, match="did you mean 'proud'"):
        method.stylize(walk, "prud", labels=LABELS)
    with pytest.raises(mk.MotionKitError, match=r"guesses no labels; give labels=Labels\(content, style\)"):
        method.stylize(walk, "old")


def test_half_of_a_style_lies_between_the_content_and_the_style_not_neutral(method):
    """What is left of a styled content at strength 0.5 is its own style."""
    proud = perform("walk", "proud", seed=4, seconds=2.0).motion
    half = method.stylize(proud, "old", 0.5, lock_feet=False, labels=Labels("walk", "proud"))
    mixed = method.stylize(proud, {"old": 0.5, "proud": 0.5}, lock_feet=False, labels=Labels("walk", "proud"))
    neutral = method.stylize(proud, {"old": 0.5, "neutral": 0.5}, lock_feet=False, labels=Labels("walk", "proud"))
    assert torch.equal(half.rotations, mixed.rotations) and not torch.equal(half.rotations, neutral.rotations)
    shipped, labels = mk.methods.load("style-erd"), Labels("walk", "proud")
    half, whole = (shipped.stylize(proud, "old", s, lock_feet=False, labels=labels) for s in (0.5, 1.0))

    def distance(a, b):
        poses = [motion.positions() - motion.positions()[:, :1] for motion in (a, b)]
        return float((poses[0] - poses[1]).norm(dim=-1).mean())

    assert max(distance(half, proud), distance(half, whole)) < 0.8 * distance(proud, whole)
    assert distance(half, proud) + distance(half, whole) < 1.2 * distance(proud, whole)


def test_a_mix_goes_as_fast_as_its_parts_together():
    method, clips = mk.methods.load("style-erd"), [mk.load(f"data/actor/{n}_neutral.bvh") for n in ("idle", "walk")]
    for clip in clips:
        made = [method.stylize(clip, "old", s).root_path() for s in (0.0, 0.25, 0.5, 1.0, 1.5)]
        ways = [float((path[1:] - path[:-1]).norm(dim=-1).sum()) for path in made]
        if clip is clips[0]:
            assert max(ways[:-1]) < 0.1 and ways[-1] < 0.15  # who stands, stands, if less so beyond what was learned
        else:
            assert ways == sorted(ways, reverse=True) and ways[-1] < 0.5 * ways[0]


def test_every_part_of_a_clip_is_restyled_by_what_it_does():
    method, played = mk.methods.load("style-erd"), perform("walk, jump, kick", "neutral", seed=3, seconds=11)
    contents, style = method._labels(method.onto_model(played.motion), Labels())
    assert {"walk", "jump", "kick"} <= set(contents) and style == "neutral"
    answer = retell(played, "old").time_aligned(played)
    parts, *others = (
        error_against(method.stylize(played.motion, "old", labels=Labels(content=content)), answer)
        for content in (None, "walk", "jump", "kick", "wave")
    )
    assert parts < min(others) and parts < 0.8 * others[-1]


def test_labels_are_guessed_and_a_clip_may_lend_its_style(walk, data):
    knowing = StyleErdTransfer(small_model(labels=True))
    content, own = knowing.recognize(walk)
    assert content in CONTENTS and own in STYLES
    guessed = knowing.stylize(walk, "old")
    given = knowing.stylize(walk, "old", labels=Labels(content, own))
    assert torch.equal(guessed.rotations, given.rotations)
    lent = knowing.stylize(walk, walk, labels=LABELS)
    named = knowing.stylize(walk, own, labels=LABELS)
    assert torch.equal(lent.rotations, named.rotations) and lent.name == f"{walk.name} as {walk.name}"
    old = data.filter(style="old")[0]  # a dataset's clip says its style itself
    named = knowing.stylize(walk, "old", labels=LABELS)
    for style in (old, mk.methods.Example(old.motion, Labels("walk", "old"))):
        assert torch.equal(knowing.stylize(walk, style, labels=LABELS).rotations, named.rotations)


def test_with_an_input_residual_who_is_restyled_in_his_own_style_moves_as_he_did(walk):
    method = StyleErdTransfer(small_model(input_residual=True))
    played = walk.resample(30.0)
    for asked in ({"style": "neutral"}, {"style": "old", "strength": 0.0}, {"style": "neutral", "strength": 0.5}):
        result = method.stylize(played, lock_feet=False, labels=LABELS, **asked)
        assert (result.positions() - played.positions())[1:, 1:].norm(dim=-1).max() < 0.01
    styled = method.stylize(played, "old", lock_feet=False, labels=LABELS)
    assert (styled.positions() - played.positions()).abs().max() > 0.02
