"""Samplers against the schedulers of diffusers, x after every single step."""

import diffusers
import pytest
import torch
from sampling_lab import SCHEDULES, Trace, bent, normal

from motionkit.diffusion import NoiseSchedule, from_noise, noise_from_x0
from motionkit.sampling import ddim, ddim_invert, ddpm, dpm_solver, timesteps

kinds = pytest.mark.parametrize("kind", SCHEDULES)
predictions = pytest.mark.parametrize("prediction", ["sample", "epsilon"])
quiet = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # diffusers with numpy 2


def both_ways(schedule: NoiseSchedule, prediction: str):
    """The same network as our samplers take it, and as it answers diffusers: x0 ("sample") or noise ("epsilon")."""
    predict = bent(schedule)
    if prediction == "sample":
        return predict, predict

    def noise(x, t):
        return noise_from_x0(x, predict(x, t), t, schedule)

    return from_noise(noise, schedule), noise


def scheduler(name: str, kind: str, prediction: str, stops: list[int] | int, **options):
    """A scheduler of diffusers that stops where ours does; its steps are counted from 0, not from 1."""
    found = getattr(diffusers, name)(1000, beta_schedule=kind, prediction_type=prediction, **options)
    found.alphas_cumprod = SCHEDULES[kind].alphas_bar[1:]  # theirs in float64, so that this is about their steps
    if isinstance(stops, int):
        found.set_timesteps(stops)
    else:
        found.set_timesteps(timesteps=[t - 1 for t in stops])
    if name == "DPMSolverMultistepScheduler":
        bar = SCHEDULES[kind].alphas_bar[[*stops, 0]]
        sigmas = ((1 - bar) / bar).sqrt()
        torch.testing.assert_close(found.sigmas, sigmas.float(), rtol=1e-6, atol=0)
        found.sigmas = sigmas  # float64 here too
    return found


def compare(trace: Trace, oracle, network, x: torch.Tensor, stops: list[int], options=dict) -> None:
    """x after every step against the oracle's, which goes its own way from the same start."""
    assert len(trace) == len(stops)
    for (_, ours, _), t in zip(trace, stops):
        x = oracle.step(network(x, torch.full((len(x),), t)), t - 1, x, **options()).prev_sample
        torch.testing.assert_close(ours, x, rtol=1e-5, atol=1e-5)


@pytest.fixture
def same_numbers(monkeypatch):
    """diffusers draws its fresh noise as motionkit does: in float32, on the CPU."""

    def draw(shape, generator=None, device=None, dtype=None):
        return torch.randn(shape, generator=generator).to(device, dtype)

    monkeypatch.setattr("diffusers.schedulers.scheduling_ddpm.randn_tensor", draw)


@kinds
@predictions
@pytest.mark.parametrize("steps, start", [(1, None), (7, None), (50, None), (20, 300), (None, 100)])
def test_ddpm_is_that_of_diffusers(kind, prediction, steps, start, same_numbers):
    schedule, x, trace, theirs = SCHEDULES[kind], normal(3, 4), Trace(), torch.Generator().manual_seed(3)
    predict, network = both_ways(schedule, prediction)
    stops = timesteps(schedule, steps, start)
    ddpm(predict, x, schedule, stops, callback=trace, generator=torch.Generator().manual_seed(3))
    oracle = scheduler("DDPMScheduler", kind, prediction, stops, clip_sample=False)
    compare(trace, oracle, network, x, stops, lambda: {"generator": theirs})


@kinds
@predictions
@pytest.mark.parametrize("eta", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("steps, start", [(1, None), (5, None), (50, None), (20, 300)])
def test_ddim_is_that_of_diffusers(kind, prediction, eta, steps, start):
    schedule, x, trace, theirs = SCHEDULES[kind], normal(3, 4), Trace(), torch.Generator().manual_seed(3)
    predict, network = both_ways(schedule, prediction)
    stops = timesteps(schedule, steps, start)
    ddim(predict, x, schedule, stops, callback=trace, generator=torch.Generator().manual_seed(3), eta=eta)
    oracle = scheduler("DDIMScheduler", kind, prediction, steps, clip_sample=False, timestep_spacing="trailing")
    assert (oracle.timesteps[-len(stops) :] + 1).tolist() == stops

    def fresh():
        return {"eta": eta, "variance_noise": torch.randn(x.shape, generator=theirs).double()}

    compare(trace, oracle, network, x, stops, fresh)


@kinds
@predictions
@pytest.mark.parametrize("steps, stop", [(1, None), (5, None), (50, None), (20, 300)])
def test_ddim_backwards_is_that_of_diffusers(kind, prediction, steps, stop):
    """A network of x0 answers as its noise here: with x0 the scheduler divides 0 by 0 on its first step."""
    schedule, x, trace = SCHEDULES[kind], normal(3, 4), Trace()
    predict, _ = both_ways(schedule, prediction)
    _, network = both_ways(schedule, "epsilon")
    stops = timesteps(schedule, steps, stop)[::-1]
    found = ddim_invert(predict, x, schedule, stops[::-1], callback=trace)
    oracle = scheduler("DDIMInverseScheduler", kind, "epsilon", steps, clip_sample=False, timestep_spacing="trailing")
    assert (oracle.timesteps[: len(stops)] + 1).tolist() == stops == [step for step, _, _ in trace]
    compare(trace, oracle, network, x, stops)
    assert torch.equal(found, trace[-1][1])


@quiet
@kinds
@predictions
@pytest.mark.parametrize("steps, start", [(1, None), (2, None), (10, None), (13, None), (20, None), (20, 300)])
def test_dpm_solver_is_that_of_diffusers(kind, prediction, steps, start):
    schedule, x, trace = SCHEDULES[kind], normal(3, 4), Trace()
    predict, network = both_ways(schedule, prediction)
    stops = timesteps(schedule, steps, start)
    dpm_solver(predict, x, schedule, stops, callback=trace)
    solver = {"algorithm_type": "dpmsolver++", "solver_order": 2, "final_sigmas_type": "zero"}
    oracle = scheduler("DPMSolverMultistepScheduler", kind, prediction, stops, **solver)
    compare(trace, oracle, network, x, stops)


@quiet
@kinds
@pytest.mark.parametrize("steps, start", [(7, None), (13, 777)])
def test_ddim_with_uneven_steps_is_dpm_solver_of_first_order(kind, steps, start):
    schedule, x, trace = SCHEDULES[kind], normal(3, 4), Trace()
    stops = timesteps(schedule, steps, start)
    ddim(bent(schedule), x, schedule, stops, callback=trace)
    oracle = scheduler("DPMSolverMultistepScheduler", kind, "sample", stops, solver_order=1, final_sigmas_type="zero")
    compare(trace, oracle, bent(schedule), x, stops)


def test_steps_are_spaced_as_the_trailing_ones_of_diffusers():
    schedule = NoiseSchedule.cosine()
    for steps in (1, 2, 3, 6, 7, 10, 16, 20, 30, 50, 77, 100, 250, 999, 1000):
        oracle = diffusers.DDIMScheduler(1000, timestep_spacing="trailing")
        oracle.set_timesteps(steps)
        assert timesteps(schedule, steps) == (oracle.timesteps + 1).tolist()
