"""Speed and quality of paper 1's priors, samplers and guidance, and the discriminators: `make bench NAME=diffusion`.

Bandai-2's row of the quality needs the captures.
"""

from __future__ import annotations

import time
from functools import cache, partial

import torch

import motionkit as mk

from .. import sampling
from ..layers import Denoiser, TransformerConfig
from ..methods import text_to_motion
from ..methods.text_to_motion import GUIDANCE_SCALE, SEEDS, generate_for
from ..skeleton import smpl
from . import captures, figure, median_seconds, table, threads

FRAMES, THREADS = 120, 2
STEPS = (2, 5, 10, 20, 50)  # of the samplers
SPACING = {"ddpm": 1.0, "ddim": 1.0, "dpm_solver": 2.0}  # see `sampling.timesteps`
HOW = f"{FRAMES} frames, {THREADS} threads, median of 7"
PROMPTS = f"test prompts, 20 DDIM steps, guidance {GUIDANCE_SCALE:g}, mean over {len(SEEDS)} seeds"


@figure("paper_call_ms", at_most=52, unit="ms", note=f"denoiser, one call, {HOW}")
@figure("paper_ddim20_seconds", at_most=1.0, unit="s", note=f"no guidance (twice the work), {HOW}")
@figure("laptop_ddim20_seconds", at_most=0.15, unit="s", note=f"no guidance (twice the work), {HOW}")
@table("speed", method="prior", dataset="noise")
@threads(THREADS)
@torch.inference_mode()
def speed() -> dict:
    """One call of the denoiser, and 20 DDIM steps with and without guidance, at two sizes, for one clip."""
    size_of_features = mk.features.FacingFree(smpl(), 30).size
    x, schedule = torch.randn(1, FRAMES, size_of_features), mk.diffusion.NoiseSchedule.cosine()
    text, none, t, figures, rows = torch.randn(1, 128), torch.zeros(128), torch.tensor([500]), {}, []
    for size in ("paper", "laptop"):
        network = Denoiser(size_of_features, 128, getattr(TransformerConfig, size)()).eval()  # as fast as learned ones
        if size == "paper":
            figures["paper_call_ms"] = 1000 * median_seconds(partial(network, x, t, text))
        for scale in (1.0, GUIDANCE_SCALE):
            predict = sampling.classifier_free_guidance(network, text, none, scale)
            seconds = round(median_seconds(partial(sampling.ddim, predict, x, schedule, 20)), 4)
            rows.append({"size": size, "guidance": scale, "seconds": seconds})
        figures[f"{size}_ddim20_seconds"] = rows[-2]["seconds"]
    return figures | {"speed": rows}


@cache
def quality_of(data: str) -> dict:
    """A prior and its discriminator on the test part of their dataset: a row of the table."""
    split = (mk.datasets.load("actor") if data == "actor" else captures()).split()
    prior, judge = text_to_motion.load(data), mk.judges.load(data)
    row = {"dataset": data, "prompts": len(split.test), "seeds": len(SEEDS)}
    row |= text_to_motion.quality(prior, split, judge, f"{data}, 20 DDIM steps")
    row |= text_to_motion.retrieval(text_to_motion.load_discriminator(data), split.test)
    before = prior.card.get("started_from") or {}  # weights that it went on from took their own steps and time
    for name in ("steps", "seconds"):
        row[f"training_{name}"] = prior.card[name] + before.get(name, 0)
    for name in ("parameters", "hardware"):
        row[f"training_{name}"] = prior.card[name]
    return row | {"training_steps_per_second": round(row["training_steps"] / row["training_seconds"], 2)}


@table("quality", method="prior")
def quality() -> list[dict]:
    """The shipped priors."""
    return [quality_of("actor"), quality_of("bandai-2")]


@figure("actor_content", at_least=95, unit="%", note=PROMPTS)
@figure("actor_style", at_least=90, unit="%")
@figure("actor_r1", at_least=70, unit="%", note="the discriminator, right caption among 32 of different meaning")
@figure("actor_training_seconds", at_most=5400, unit="s", note="from its card, with what it started from")
def on_actor() -> dict:
    """Quality on the performer's clips."""
    row = quality_of("actor")
    figures = {f"actor_{name}": row[name] for name in ("content", "r1", "training_seconds")}
    return figures | {"actor_style": (row["style"], f"the same; of the clips themselves {row['real_style']:.1f}")}


@figure("dpm_solver_10_over_ddim_50_fmd_ratio", at_most=1.05)
@table("samplers", method="prior", dataset="actor")
@threads(THREADS)
def samplers() -> dict:
    """Each sampler over its number of steps: FMD to the test clips, mean over seeds, and seconds a clip, 48 at once."""
    test, prior, judge = mk.datasets.load("actor").split().test, text_to_motion.load("actor"), mk.judges.load("actor")
    real, rows = judge.content.features([clip.motion for clip in test]), []
    for name, spacing in SPACING.items():
        for steps in STEPS:
            stops = sampling.timesteps(prior.schedule, steps, spacing=spacing)
            title, seconds, distances = f"{name}, {steps} steps", 0.0, []
            for seed in SEEDS:
                start = time.perf_counter()
                motions = generate_for(prior, test, getattr(sampling, name), stops, seed, title)
                seconds += (time.perf_counter() - start) / len(motions) / len(SEEDS)
                distances.append(mk.metrics.fmd(judge.content.features(motions), real))
            row = {"sampler": name, "steps": steps, "spacing": spacing, "fmd": round(sum(distances) / len(SEEDS), 3)}
            rows.append(row | {"clip_seconds": round(seconds, 4)})
    fmds = {(row["sampler"], row["steps"]): row["fmd"] for row in rows}
    note = f"FMD on actor's test prompts, mean over {len(SEEDS)} seeds; DDIM in even steps"
    return {"dpm_solver_10_over_ddim_50_fmd_ratio": (fmds["dpm_solver", 10] / fmds["ddim", 50], note), "samplers": rows}


@table("guidance", method="prior", dataset="actor")
def guidance_scales() -> list[dict]:
    """What guidance does: accuracy and FMD over its scale, on the validation part, by which the scale was chosen."""
    split, rows = mk.datasets.load("actor").split(), []
    split = split._replace(test=split.validation)
    prior, judge = text_to_motion.load("actor"), mk.judges.load("actor")
    for scale in (1.0, 1.5, 2.0, 2.5, 5.0):
        scores = text_to_motion.quality(prior, split, judge, f"guidance {scale:g}", scale=scale)
        rows.append({"scale": scale, **{name: scores[name] for name in ("content", "style", "fmd", "fmd_ae")}})
    return rows
