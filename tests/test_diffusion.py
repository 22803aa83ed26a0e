"""The maths of diffusion: schedules against diffusers, paper 1's equations by hand, there and back, bad input."""

import math

import pytest
import torch
from diffusers import DDIMScheduler, DDPMScheduler
from hypothesis import given
from hypothesis import strategies as st

import motionkit as mk
from motionkit import diffusion
from motionkit.diffusion import NoiseSchedule, add_noise, noise_from_x0, simple_loss, step_forward, x0_from_noise

SCHEDULES = {"linear": NoiseSchedule.linear(), "squaredcos_cap_v2": NoiseSchedule.cosine()}
ANY_SCHEDULE = st.sampled_from(sorted(SCHEDULES))
ANY_STEP = st.integers(1, 1000)


def normal(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


@pytest.mark.parametrize("kind", SCHEDULES)
def test_schedules_are_those_of_diffusers(kind):
    schedule = SCHEDULES[kind]
    oracle = DDPMScheduler(1000, beta_schedule=kind)  # its timestep 0 is step 1 here
    torch.testing.assert_close(schedule.alphas_bar[1:].float(), oracle.alphas_cumprod, rtol=1e-4, atol=1e-7)
    betas = 1 - schedule.alphas_bar[1:] / schedule.alphas_bar[:-1]
    torch.testing.assert_close(betas.float(), oracle.betas, rtol=1e-4, atol=0)
    assert schedule.steps == 1000 and schedule.alphas_bar.dtype == torch.float64


def test_cosine_of_other_lengths_is_that_of_diffusers():
    for steps in (1, 2, 10, 77, 4000):
        oracle = DDPMScheduler(steps, beta_schedule="squaredcos_cap_v2")
        ours = NoiseSchedule.cosine(steps).alphas_bar[1:].float()
        torch.testing.assert_close(ours, oracle.alphas_cumprod, rtol=1e-3, atol=1e-6)


def test_linear_of_other_lengths_adds_as_much_noise_in_all():
    ends = [float(NoiseSchedule.linear(steps).alphas_bar[-1].log()) for steps in (500, 1000, 4000)]
    assert ends == pytest.approx([ends[1]] * 3, rel=0.02)  # half the sum of betas is the same; the rest is small


def test_log_snr_is_lambda_of_dpm_solver():
    schedule = NoiseSchedule.cosine()
    bar = schedule.alphas_bar[1:]
    torch.testing.assert_close(schedule.log_snr[1:], 0.5 * (bar / (1 - bar)).log(), rtol=1e-9, atol=1e-9)
    assert schedule.log_snr[0] == math.inf and bool((schedule.log_snr.diff() < 0).all())


def test_repr_says_how_long_and_how_noisy():
    assert repr(NoiseSchedule.linear(100)) == "NoiseSchedule(100 steps; half of the variance is noise from step 27 on)"
    little = NoiseSchedule.of_betas(torch.tensor([0.1, 0.2]))
    assert repr(little) == "NoiseSchedule(2 steps; more signal than noise to the end)"


@pytest.mark.parametrize("kind", SCHEDULES)
def test_add_noise_is_that_of_diffusers(kind):
    """Paper 1, eq. 2, with a step for each sample."""
    x0, noise, t = normal(6, 4, 3), normal(6, 4, 3, seed=1), torch.tensor([1, 2, 50, 400, 999, 1000])
    oracle = DDIMScheduler(1000, beta_schedule=kind)
    wanted = oracle.add_noise(x0, noise, t - 1)
    torch.testing.assert_close(add_noise(x0, t, SCHEDULES[kind], noise), wanted, rtol=0, atol=1e-5)
    one_by_one = [add_noise(x0[n : n + 1], int(t[n]), SCHEDULES[kind], noise[n : n + 1]) for n in range(6)]
    torch.testing.assert_close(add_noise(x0, t, SCHEDULES[kind], noise), torch.cat(one_by_one))


@pytest.mark.parametrize("kind", SCHEDULES)
def test_many_single_steps_make_one_jump(kind):
    """Paper 1, eqs. 1 and 2: sample 0 carries the signal alone, sample n the noise of step n alone."""
    schedule, last = SCHEDULES[kind], 1000
    x = torch.zeros(last + 1, dtype=torch.float64)
    x[0] = 1
    for t in range(1, last + 1):
        noise = torch.zeros(last + 1, dtype=torch.float64)
        noise[t] = 1
        x = step_forward(x, t, schedule, noise)
        bar = float(schedule.alphas_bar[t])
        assert float(x[0]) == pytest.approx(bar**0.5, rel=1e-9)
        assert float((x[1:] ** 2).sum()) == pytest.approx(1 - bar, rel=1e-9)


def test_drawn_noise_has_the_mean_and_variance_of_the_equations():
    torch.manual_seed(0)
    schedule, samples = NoiseSchedule.cosine(40), 40_000
    walked = torch.full((samples,), 3.0)
    for t in range(1, 21):
        walked = step_forward(walked, t, schedule)
    jumped = add_noise(torch.full((samples,), 3.0), 20, schedule)
    bar = float(schedule.alphas_bar[20])
    for x in (walked, jumped):  # four standard errors of a mean and of a variance
        assert float(x.mean()) == pytest.approx(3 * bar**0.5, abs=4 * ((1 - bar) / samples) ** 0.5)
        assert float(x.var()) == pytest.approx(1 - bar, rel=4 * (2 / samples) ** 0.5)


def test_first_steps_are_exact_in_float32():
    """1 - alphas_bar is tiny there; taken in float32 it would be off by a thousandth."""
    schedule, zero, one = NoiseSchedule.cosine(), torch.zeros(1, 1), torch.ones(1, 1)
    wanted = math.sqrt(1 - float(schedule.alphas_bar[1]))
    assert float(add_noise(zero, 1, schedule, one)) == pytest.approx(wanted, rel=1e-6)
    assert float(step_forward(zero, 1, schedule, one)) == pytest.approx(wanted, rel=1e-6)


@given(ANY_SCHEDULE, ANY_STEP, st.floats(-10, 10), st.floats(-5, 5))
def test_x0_and_noise_there_and_back(kind, t, value, noise):
    schedule = SCHEDULES[kind]
    x0, noise = (torch.full((2, 3), n, dtype=torch.float64) for n in (value, noise))
    x = add_noise(x0, t, schedule, noise)
    torch.testing.assert_close(x0_from_noise(x, noise, t, schedule), x0, rtol=0, atol=1e-9)
    torch.testing.assert_close(noise_from_x0(x, x0, t, schedule), noise, rtol=0, atol=1e-9)
    torch.testing.assert_close(x0_from_noise(x, noise_from_x0(x, x0, t, schedule), t, schedule), x0, rtol=0, atol=1e-9)


def test_from_noise_turns_a_noise_network_into_an_x0_network():
    schedule, x0, noise = NoiseSchedule.cosine(), normal(3, 5), normal(3, 5, seed=1)
    t = torch.tensor([1, 500, 1000])
    asked = []

    def network(x, t, *more):
        asked.append((x, t, more))
        return noise

    x = add_noise(x0, t, schedule, noise)
    torch.testing.assert_close(diffusion.from_noise(network, schedule)(x, t, "text"), x0, rtol=0, atol=1e-9)
    assert len(asked) == 1 and asked[0][0] is x and asked[0][2] == ("text",)


@given(ANY_SCHEDULE, st.integers(2, 1000), st.data())
def test_posterior_is_bayes_rule_by_precisions(kind, t, data):
    """Two Gaussians multiplied: what x0 says of x_s (eq. 2), and what x_t says of it (eq. 1, many steps)."""
    schedule, s = SCHEDULES[kind], data.draw(st.integers(1, t - 1))
    bar_t, bar_s = float(schedule.alphas_bar[t]), float(schedule.alphas_bar[s])
    x, x0, kept = 0.7, -1.3, bar_t / bar_s
    prior, seen = 1 / (1 - bar_s), kept / (1 - kept)  # precisions
    mean, variance = diffusion.posterior(*torch.tensor([[x], [x0]], dtype=torch.float64), t, s, schedule)
    assert variance == pytest.approx(1 / (prior + seen), rel=1e-7)
    wanted = (prior * bar_s**0.5 * x0 + seen * x / kept**0.5) / (prior + seen)
    assert float(mean) == pytest.approx(wanted, rel=1e-7, abs=1e-9)


def test_simple_loss_by_hand():
    """Paper 1, eqs. 3 to 5: two frames of two numbers, missed by 1, 2, 3 and 0."""
    schedule, x0 = NoiseSchedule.cosine(), torch.tensor([[[5.0, 6.0], [7.0, 8.0]]])
    miss = torch.tensor([[[1.0, -2.0], [3.0, 0.0]]])
    assert float(simple_loss(lambda x, t: x0 + miss, x0, schedule)) == pytest.approx((1 + 4 + 9 + 0) / 4)
    first = torch.tensor([[True, False]])
    assert float(simple_loss(lambda x, t: x0 + miss, x0, schedule, mask=first)) == pytest.approx((1 + 4) / 2)
    nothing = torch.tensor([[False, False]])
    assert float(simple_loss(lambda x, t: x0 + miss, x0, schedule, mask=nothing)) == 0


def test_simple_loss_shows_the_network_noisy_motions_and_their_steps():
    torch.manual_seed(0)
    schedule, seen = NoiseSchedule.cosine(50), []
    x0 = torch.full((4000, 2, 3), 2.0)

    def network(x, t):
        seen.append((x, t))
        return x

    simple_loss(network, x0, schedule)
    x, t = seen[0]
    assert t.shape == (4000,) and not t.is_floating_point()
    counts = t.bincount(minlength=51)
    assert counts[0] == 0 and len(counts) == 51 and int(counts[1:].min()) > 40  # 80 are expected of each
    noise = noise_from_x0(x.double(), x0.double(), t, schedule)
    assert float(noise.mean()) == pytest.approx(0, abs=0.03) and float(noise.std()) == pytest.approx(1, abs=0.03)
    wanted = torch.tensor([3] * 4000)
    simple_loss(network, x0, schedule, t=wanted)
    assert torch.equal(seen[1][1], wanted)


def test_simple_loss_ignores_masked_frames():
    schedule, x0, guess = NoiseSchedule.cosine(), normal(3, 6, 4), normal(3, 6, 4, seed=1)
    mask = torch.arange(6) < torch.tensor([[6], [4], [1]])
    other = torch.where(mask[..., None], x0, torch.tensor(1e6, dtype=torch.float64))
    short = simple_loss(lambda x, t: guess, x0, schedule, mask=mask)
    assert float(simple_loss(lambda x, t: guess, other, schedule, mask=mask)) == pytest.approx(float(short))
    assert float(short) == pytest.approx(float(((guess - x0)[mask] ** 2).mean()))
    whole = simple_loss(lambda x, t: guess, x0, schedule, mask=torch.ones(3, 6, dtype=torch.bool))
    assert float(whole) == pytest.approx(float(simple_loss(lambda x, t: guess, x0, schedule)))


def test_simple_loss_is_least_for_the_posterior_mean():
    """Paper 1, eq. 5 asks for the mean of the x0 that may lie behind x_t; on Gaussian data that is known."""
    schedule, data = NoiseSchedule.cosine(), 1 + 0.5 * normal(20_000, 1, 1, seed=5)
    t = torch.full((20_000,), 500)
    bar = float(schedule.alphas_bar[500])
    best = 0.25 * bar**0.5 / (0.25 * bar + 1 - bar)
    losses = []
    for slope in (0.8 * best, best, 1.2 * best):
        torch.manual_seed(0)  # the same noise for all three
        losses.append(float(simple_loss(lambda x, t, k=slope: 1 + k * (x - bar**0.5), data, schedule, t)))
    assert losses[1] < min(losses[0], losses[2])
    assert losses[1] == pytest.approx(0.25 * (1 - bar) / (0.25 * bar + 1 - bar), rel=0.04)  # the posterior's variance


@pytest.mark.parametrize("t", [-1, 11, torch.tensor([1, 11]), torch.tensor([-1, 3])])
def test_steps_out_of_range(t):
    schedule, x = NoiseSchedule.cosine(10), torch.zeros(2, 3)
    for function in (lambda: add_noise(x, t, schedule), lambda: x0_from_noise(x, x, t, schedule)):
        with pytest.raises(mk.MotionKitError, match="steps go from 0 to 10 here; found"):
            function()
    for function in (lambda: step_forward(x, t, schedule), lambda: noise_from_x0(x, x, t, schedule)):
        with pytest.raises(mk.MotionKitError, match="steps go from 1 to 10 here; found"):
            function()


def test_step_zero_has_no_step_before_and_no_noise():
    schedule, x = NoiseSchedule.cosine(10), normal(2, 3)
    assert torch.equal(add_noise(x, 0, schedule), x) and torch.equal(x0_from_noise(x, x, 0, schedule), x)
    for function in (lambda: step_forward(x, 0, schedule), lambda: noise_from_x0(x, x, torch.tensor([0, 5]), schedule)):
        with pytest.raises(mk.MotionKitError, match="from 1 to 10 here; found 0 to"):
            function()


def test_steps_must_be_whole_and_posteriors_go_back():
    schedule, x = NoiseSchedule.cosine(10), torch.zeros(2, 3)
    with pytest.raises(mk.MotionKitError, match=r"whole numbers from 0 to 10; found torch.float32: use t.long\(\)"):
        add_noise(x, torch.tensor([0.5, 1.0]), schedule)
    for t, s in ((0, 0), (5, 5), (5, 6), (11, 3), (5, -1)):
        with pytest.raises(mk.MotionKitError, match=f"s must be a step before t.*found s={s}, t={t}"):
            diffusion.posterior(x, x, t, s, schedule)


@pytest.mark.parametrize(
    "bar",
    [
        [1.0],
        [0.9, 0.5],
        [1.0, 0.5, 0.5],
        [1.0, 0.5, 0.7],
        [1.0, 0.5, 0.0],
        [1.0, 0.5, -0.1],
        [1.0, math.nan, 0.5],
        [1.0, 0.5, math.nan],
        [math.nan, 0.5],
        [[1.0, 0.5]],
    ],
)
def test_broken_alphas_bar(bar):
    with pytest.raises(mk.MotionKitError, match="alphas_bar must start at 1 and fall at every step"):
        NoiseSchedule(torch.tensor(bar, dtype=torch.float64))


@pytest.mark.parametrize("betas", [[0.0, 0.1], [0.1, 1.0], [0.1, 1.5], [-0.1, 0.1], [0.1, math.nan]])
def test_broken_betas(betas):
    with pytest.raises(mk.MotionKitError, match="alphas_bar must"):
        NoiseSchedule.of_betas(torch.tensor(betas))


@pytest.mark.parametrize("steps", [0, -5])
def test_schedules_without_steps(steps):
    for make in (NoiseSchedule.linear, NoiseSchedule.cosine):
        with pytest.raises(mk.MotionKitError, match=f"at least 1 step, 1000 as a rule; found {steps}"):
            make(steps)


@pytest.mark.parametrize("times", [0.5, 6.0])
def test_louder_multiplies_the_noise_beside_the_signal(times):
    plain = NoiseSchedule.cosine(200)
    louder = plain.snr_shift(times)
    ratio = (louder.noise / louder.signal)[1:] / (plain.noise / plain.signal)[1:]
    assert torch.allclose(ratio, torch.full_like(ratio, times), rtol=1e-9)
    assert louder.alphas_bar[0] == 1 and louder.steps == 200
    assert torch.allclose(louder.snr_shift(1 / times).alphas_bar, plain.alphas_bar, rtol=1e-12)


@pytest.mark.parametrize("times", [0, -1, float("nan"), float("inf")])
def test_shifted_by_no_factor(times):
    with pytest.raises(mk.MotionKitError, match="shifted by a factor above 0"):
        NoiseSchedule.cosine(10).snr_shift(times)
