"""Samplers on a Gaussian whose answers are known, and what may be done on the way."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from sampling_lab import SCHEDULES, Trace, bent, normal

import motionkit as mk
from motionkit.diffusion import NoiseSchedule
from motionkit.sampling import (
    classifier_free_guidance,
    ddim,
    ddim_invert,
    ddpm,
    dpm_solver,
    feature_mask,
    guidance,
    inpainting,
    timesteps,
)

SAMPLERS = [ddpm, ddim, dpm_solver]
MEAN, SPREAD = 1.5, 0.5  # of the Gaussian data
kinds = pytest.mark.parametrize("kind", SCHEDULES)


def test_ddim_with_eta_1_is_ddpm():
    schedule, x, traces = NoiseSchedule.cosine(), normal(3, 4), (Trace(), Trace())
    for sampler, trace, more in ((ddpm, traces[0], {}), (ddim, traces[1], {"eta": 1.0})):
        noise = torch.Generator().manual_seed(5)
        sampler(bent(schedule), x, schedule, 37, callback=trace, generator=noise, **more)
    for (_, one, _), (_, other, _) in zip(*traces, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)


def gaussian(schedule: NoiseSchedule):
    """The best network there is for data N(MEAN, SPREAD^2): the mean of the posterior, in closed form."""

    def predict(x, t):
        bar = schedule.at(schedule.alphas_bar, t, x)
        return MEAN + bar.sqrt() * SPREAD**2 / (bar * SPREAD**2 + 1 - bar) * (x - bar.sqrt() * MEAN)

    return predict


def exact(x: torch.Tensor, t: int, s: int, schedule: NoiseSchedule) -> torch.Tensor:
    """Where the flow carries x from step t to step s: as many deviations from the mean, there as here."""
    (mean_t, spread_t), (mean_s, spread_s) = (
        (bar**0.5 * MEAN, (bar * SPREAD**2 + 1 - bar) ** 0.5) for bar in schedule.alphas_bar[[t, s]].tolist()
    )
    return mean_s + spread_s * (x - mean_t) / spread_t


@kinds
@pytest.mark.parametrize("sampler, steps", [(ddpm, 1000), (ddim, 200), (dpm_solver, 40)])
def test_samples_of_a_gaussian_have_its_mean_and_spread(kind, sampler, steps):
    samples, schedule = 20_000, SCHEDULES[kind]
    torch.manual_seed(1)
    found = sampler(gaussian(schedule), normal(samples, 1), schedule, steps)
    assert float(found.mean()) == pytest.approx(MEAN, abs=4 * SPREAD / samples**0.5)  # four standard errors
    assert float(found.std()) == pytest.approx(SPREAD, rel=4 / (2 * samples) ** 0.5)


@kinds
@pytest.mark.parametrize("steps, start", [(3, None), (50, None), (1000, None), (20, 300)])
def test_ddim_on_a_gaussian_is_a_known_linear_map(kind, steps, start):
    """Each step multiplies the distance from the mean by the covariance of x_s and x_t over the variance of x_t."""
    schedule, x = SCHEDULES[kind], torch.linspace(-3, 3, 13, dtype=torch.float64)[:, None]
    stops, slope = timesteps(schedule, steps, start), 1.0
    for t, s in zip(stops, [*stops[1:], 0]):
        (a, b), (c, d) = (
            schedule.alphas_bar[[t, s]].sqrt().tolist(),
            (1 - schedule.alphas_bar[[t, s]]).sqrt().tolist(),
        )
        slope *= (a * b * SPREAD**2 + c * d) / (a * a * SPREAD**2 + c * c)
    wanted = MEAN + slope * (x - float(schedule.signal[stops[0]]) * MEAN)
    torch.testing.assert_close(ddim(gaussian(schedule), x, schedule, stops), wanted, rtol=0, atol=1e-9)


@kinds
def test_few_steps_of_dpm_solver_are_nearer_than_those_of_ddim(kind):
    schedule, x = SCHEDULES[kind], torch.linspace(-2, 2, 9, dtype=torch.float64)[:, None]

    def miss(sampler, steps: int) -> float:
        return float((sampler(gaussian(schedule), x, schedule, steps) - exact(x, 1000, 0, schedule)).abs().max())

    assert miss(dpm_solver, 10) < 0.75 * miss(ddim, 10)
    assert miss(dpm_solver, 20) < 0.4 * miss(ddim, 20) and miss(dpm_solver, 20) < miss(ddim, 50)
    halves = [miss(ddim, steps) / miss(ddim, 2 * steps) for steps in (50, 100, 200)]
    assert halves == pytest.approx([2, 2, 2], abs=0.15)  # first order: half the step, half the miss
    assert miss(dpm_solver, 160) < 0.002 < miss(ddim, 160)


@kinds
def test_inversion_there_and_back_gets_better_with_steps(kind):
    schedule = SCHEDULES[kind]
    x = MEAN + SPREAD * torch.linspace(-2, 2, 9, dtype=torch.float64)[:, None]
    predict, there, back = gaussian(schedule), [], []
    for steps in (20, 40, 80, 160, 1000):
        stops = timesteps(schedule, steps, start=500)
        noise = ddim_invert(predict, x, schedule, stops)
        there.append(float((noise - exact(x, 0, 500, schedule)).abs().max()))
        back.append(float((ddim(predict, noise, schedule, stops) - x).abs().max()))
    for misses in (there, back):
        assert all(0.4 < after / before < 0.65 for before, after in zip(misses[:3], misses[1:4]))  # about a half
        assert misses[4] < 0.01


@given(st.integers(1, 2000).flatmap(lambda most: st.tuples(st.just(most), *[st.integers(1, most)] * 2)))
def test_steps_fall_from_start_and_never_reach_0(numbers):
    most, steps, start = numbers
    stops = timesteps(NoiseSchedule(torch.linspace(1, 0.5, most + 1)), steps, start)
    assert stops[0] == start and stops[-1] >= 1 and stops == sorted(set(stops), reverse=True)
    assert abs(len(stops) - start * steps / most) <= 1
    assert all(abs(t - s - most / steps) <= 1 for t, s in zip(stops, stops[1:]))
    if start == most:
        assert len(stops) == steps


def test_start_at_k_leaves_the_steps_of_the_paper():
    """Paper 1, section 4: S = 20 of T = 1000, and K = 300."""
    schedule, asked = NoiseSchedule.cosine(), []
    stops = timesteps(schedule, 20, start=300)

    def predict(x, t):
        asked.append(t.tolist())
        return x * 0

    for sampler in SAMPLERS:
        trace = Trace()
        asked.clear()
        found = sampler(predict, normal(2, 4), schedule, stops, callback=trace)
        assert asked == [[t, t] for t in (300, 250, 200, 150, 100, 50)]
        assert [step for step, _, _ in trace] == [250, 200, 150, 100, 50, 0]
        assert torch.equal(trace[-1][1], found) and torch.equal(found, trace[-1][2])
    asked.clear()
    ddim_invert(predict, normal(2, 4), schedule, stops)
    assert asked == [[t, t] for t in (50, 100, 150, 200, 250, 300)]


def test_left_out_steps_and_seeds():
    schedule, x, counts = NoiseSchedule.linear(60), normal(2, 4), []
    for sampler in SAMPLERS:
        trace = Trace()
        sampler(bent(schedule), x, schedule, callback=trace)
        counts.append(len(trace))
    assert counts == [60, 50, 10]
    runs = [ddpm(bent(schedule), x, schedule, 9, generator=torch.Generator().manual_seed(n)) for n in (1, 1, 2)]
    assert torch.equal(runs[0], runs[1]) and not torch.allclose(runs[0], runs[2])


@pytest.mark.parametrize("sampler", [*SAMPLERS, ddim_invert])
def test_float32_stays_and_is_near_float64(sampler):
    schedule, x, before = NoiseSchedule.cosine(), normal(3, 4), torch.get_rng_state()
    torch.manual_seed(0)
    wide = sampler(bent(schedule), x, schedule, 20)
    torch.manual_seed(0)
    found = sampler(bent(schedule), x.float(), schedule, 20)
    torch.set_rng_state(before)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.double(), wide, rtol=1e-3, atol=1e-3)


@given(st.floats(-5, 5), st.floats(-3, 3), st.floats(-3, 3))
def test_guidance_is_a_straight_line_through_both_predictions(scale, one, other):
    """Paper 4, eq. 5."""
    conditioned, unconditioned = (torch.full((2, 3), n, dtype=torch.float64) for n in (one, other))
    found = guidance(conditioned, unconditioned, scale)
    torch.testing.assert_close(found, unconditioned + scale * (conditioned - unconditioned), rtol=1e-9, atol=1e-9)
    assert torch.equal(guidance(conditioned, unconditioned, 0), unconditioned)
    assert torch.equal(guidance(conditioned, unconditioned, 1), conditioned)


def test_guided_asks_once_with_both_conditions():
    """Paper 4, eq. 5, with a mask that goes along."""
    calls, x, t = [], normal(2, 5, 4), torch.tensor([7, 9])
    words, nothing, mask = normal(2, 4, seed=1), normal(4, seed=2), normal(2, 5, seed=3) > 0

    def model(x, t, condition, mask):
        calls.append((x, t, condition, mask))
        return x * mask[..., None] + condition[:, None] * t[:, None, None]

    found = classifier_free_guidance(model, words, nothing, scale=2.5, mask=mask)(x, t)
    assert len(calls) == 1
    seen_x, seen_t, conditions, seen_mask = calls[0]
    assert torch.equal(seen_x, torch.cat((x, x))) and seen_t.tolist() == [7, 9, 7, 9]
    assert torch.equal(conditions, torch.stack((*words, nothing, nothing)))
    assert torch.equal(seen_mask, torch.cat((mask, mask)))
    told, untold = model(x, t, words, mask), model(x, t, nothing.expand(2, 4), mask)
    torch.testing.assert_close(found, 2.5 * told - 1.5 * untold)
    torch.testing.assert_close(classifier_free_guidance(model, words, nothing, scale=0, mask=mask)(x, t), untold)
    calls.clear()
    assert torch.equal(classifier_free_guidance(model, words, nothing, scale=1, mask=mask)(x, t), told)
    assert [len(call[0]) for call in calls] == [2]


def test_guided_goes_through_a_sampler():
    schedule, words = NoiseSchedule.cosine(), normal(3, 4)
    predict = classifier_free_guidance(lambda x, t, c: 0 * x + c, words, torch.zeros(4).double(), scale=3.0)
    for sampler in SAMPLERS:
        torch.testing.assert_close(sampler(predict, normal(3, 4, seed=1), schedule, 5), 3 * words)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_inpainting_holds_named_numbers_at_every_step(sampler):
    """Paper 1, eq. 8: the root's velocity is that of the content, whatever the network says."""
    layout, schedule = mk.features.FacingFree(mk.skeleton.smpl(), 30), NoiseSchedule.cosine()
    where, trace = feature_mask(layout, "root x velocity", "root z velocity"), Trace()
    known = normal(6, layout.size, seed=1)  # [F, D]

    def predict(x, t):
        return torch.tanh(x) + 3

    x = normal(2, 6, layout.size)
    found = sampler(predict, x, schedule, 8, inpaint=inpainting(known, where), callback=trace)
    assert len(trace) == 8 and torch.equal(found[..., where], known[:, where].expand(2, 6, 2))
    before = x
    for _, after, x0 in trace:
        assert torch.equal(x0[..., where], known[:, where].expand(2, 6, 2))
        assert torch.equal(x0[..., ~where], predict(before, None)[..., ~where])
        before = after


def test_inpainting_takes_frames_batches_and_float32():
    x0, known = normal(2, 4, 3), normal(2, 4, 3, seed=1)
    frames = torch.tensor([True, False, False, True])[:, None]  # the first and the last, as between two poses
    found = inpainting(known, frames)(x0)
    assert torch.equal(found[:, [0, 3]], known[:, [0, 3]]) and torch.equal(found[:, 1:3], x0[:, 1:3])
    assert inpainting(known, frames)(x0.float()).dtype == torch.float32
    assert torch.equal(inpainting(known, torch.zeros(3, dtype=torch.bool))(x0), x0)


def test_names_are_parts_or_components_of_a_pose():
    layout = mk.features.FacingFree(mk.skeleton.smpl(), 30)
    for part, where in layout.slices.items():
        assert feature_mask(layout, part).nonzero().flatten().tolist() == list(range(layout.size))[where]
    assert feature_mask(layout, "root height", "root x velocity").nonzero().flatten().tolist() == [1, 3]
    [hip] = feature_mask(layout, "positions y of left_hip").nonzero().flatten().tolist()
    assert layout.describe(hip) == "positions y of left_hip (m)"
    assert not feature_mask(layout).any()


@pytest.mark.parametrize("name", ["roots", "roo", "root x vel", "", "velocity", "positions x of tail"])
def test_names_that_nothing_has(name):
    layout = mk.features.FacingFree(mk.skeleton.smpl(), 30)
    with pytest.raises(
        mk.MotionKitError, match=f"no number of FacingFree is called '{name}'; the first are .*its parts"
    ):
        feature_mask(layout, "root", name)


@pytest.mark.parametrize("steps, start", [(0, None), (-1, None), (1001, None), (10, 0), (10, 1001), (10, -3)])
def test_steps_out_of_range(steps, start):
    schedule, x = NoiseSchedule.cosine(), normal(1, 4)
    wrong = f"must be from 1 to 1000; found steps={steps}, start={start or ''}"
    with pytest.raises(mk.MotionKitError, match=wrong):
        timesteps(schedule, steps, start)
    for sampler in [*SAMPLERS, ddim_invert] if start is None else []:
        with pytest.raises(mk.MotionKitError, match=wrong):
            sampler(bent(schedule), x, schedule, steps)


@pytest.mark.parametrize("eta", [-0.1, 1.5, math.nan])
def test_eta_out_of_range(eta):
    with pytest.raises(mk.MotionKitError, match=f"eta must be from 0 .* found {eta}"):
        ddim(bent(SCHEDULES["linear"]), normal(1, 4), SCHEDULES["linear"], 5, eta=eta)


@pytest.mark.parametrize("spacing", [0.5, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("steps, start", [(20, 1000), (20, 300), (1000, 1000), (7, 1)])
def test_spaced_steps_fall_from_the_start_and_follow_the_power(steps, start, spacing):
    stops = timesteps(NoiseSchedule.cosine(), steps, start, spacing)
    assert stops[0] == start and all(t > s > 0 for t, s in zip(stops, stops[1:]))
    even = [(t / 1000) ** (1 / spacing) for t in stops]  # evenly apart again, but for the rounding of t
    for t, a, b in zip(stops, even, even[1:]):
        off = ((t / 1000) ** (1 / spacing) - ((t - 1) / 1000) ** (1 / spacing)) * 2 + 1e-9
        assert a - b >= 1 / steps - off


@pytest.mark.parametrize("sampler", [ddpm, ddim, dpm_solver])
def test_samplers_stop_where_spacing_says(sampler):
    schedule, seen = NoiseSchedule.cosine(), []
    stops = timesteps(schedule, 5, spacing=2.0)
    sampler(lambda x, t: x * 0, normal(1, 2), schedule, stops, callback=lambda s, x, x0: seen.append(s))
    assert seen == [640, 360, 160, 40, 0]
    back = []
    ddim_invert(lambda x, t: x * 0, normal(1, 2), schedule, stops, callback=lambda t, x, x0: back.append(t))
    assert back == [40, 160, 360, 640, 1000]


@pytest.mark.parametrize("spacing", [0, -1, float("nan"), float("inf")])
def test_no_spacing(spacing):
    with pytest.raises(mk.MotionKitError, match="spacing must be a number above 0"):
        timesteps(NoiseSchedule.cosine(), 5, spacing=spacing)
