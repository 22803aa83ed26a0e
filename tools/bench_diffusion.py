"""Measure speed and quality of the priors, and the discriminators, into results/diffusion.json.

make bench-diffusion        (needs the Bandai-2 archive: MOTIONKIT_DATA, or ../shared/datasets)
"""

import time
from functools import partial

import torch

import motionkit as mk
from bench import ROOT, figure, find_root, write_result
from motionkit import sampling
from motionkit.layers import Denoiser, TransformerConfig
from motionkit.methods.text_to_motion import SEEDS, generate_for, quality
from motionkit.skeleton import smpl

RESULT = ROOT / "results" / "diffusion.json"
FRAMES, THREADS = 120, 2
STEPS = (2, 5, 10, 20, 50)  # of the samplers
SPACING = {"ddpm": 1.0, "ddim": 1.0, "dpm_solver": 2.0}  # see `sampling.timesteps`


def seconds_of(run, times: int = 7) -> float:
    """The median time of a call, after two to warm up."""
    taken = []
    for _ in range(times + 2):
        begun = time.perf_counter()
        run()
        taken.append(time.perf_counter() - begun)
    return sorted(taken[2:])[times // 2]


def speed() -> tuple[dict, list[dict]]:
    """One call of the denoiser, and 20 DDIM steps with and without guidance, at two sizes, for one clip."""
    layout = mk.features.FacingFree(smpl(), 30)
    x, schedule = torch.randn(1, FRAMES, layout.size), mk.diffusion.NoiseSchedule.cosine()
    text, none, t = torch.randn(1, 128), torch.zeros(128), torch.tensor([500])
    note, figures, rows = f"{FRAMES} frames, {THREADS} threads, median of 7", {}, []
    for size, limit in (("paper", 1.0), ("laptop", 0.15)):
        network = Denoiser(layout.size, 128, getattr(TransformerConfig, size)()).eval()  # fresh weights are as fast
        with torch.inference_mode():
            if size == "paper":
                call = 1000 * seconds_of(partial(network, x, t, text))
                figures["paper_call_ms"] = figure(call, 52, "ms", f"denoiser, one call, {note}", False)
            for scale in (1.0, mk.methods.text_to_motion.GUIDANCE_SCALE):
                predict = sampling.guided(network, text, none, scale)
                taken = seconds_of(partial(sampling.ddim, predict, x, schedule, 20))
                rows.append({"size": size, "guidance": scale, "seconds": round(taken, 4)})
        once = rows[-2]["seconds"]
        figures[f"{size}_ddim20_seconds"] = figure(once, limit, "s", f"no guidance (twice the work), {note}", False)
    return figures, rows


def judged(data: str, root: str | None) -> tuple[dict, dict]:
    """A prior and its discriminator on the test part of their dataset, and the row of the table."""
    split = mk.datasets.load(data, root).split()
    prior, judge = mk.methods.text_to_motion.load(data), mk.judges.load(data)
    row = {"dataset": data, "prompts": len(split.test), "seeds": len(SEEDS)}
    row |= quality(prior, split, judge, f"{data}, 20 DDIM steps")
    row |= mk.methods.text_to_motion.retrieval(mk.methods.text_to_motion.load_discriminator(data), split.test)
    before = prior.card.get("started_from") or {}  # weights that it went on from took their own steps and time
    for name in ("steps", "seconds"):
        row[f"training_{name}"] = prior.card[name] + before.get(name, 0)
    for name in ("parameters", "hardware"):
        row[f"training_{name}"] = prior.card[name]
    row["training_steps_per_second"] = round(row["training_steps"] / row["training_seconds"], 2)
    return row, {"split": split, "prior": prior, "judge": judge}


def samplers(split, prior, judge) -> list[dict]:
    """Each sampler over its number of steps: FMD to the test clips, mean over seeds, and seconds a clip, 48 at once."""
    there, rows = judge.content.features([clip.motion for clip in split.test]), []
    for name, spacing in SPACING.items():
        for steps in STEPS:
            title, taken, far = f"{name}, {steps} steps", 0.0, []
            for seed in SEEDS:
                begun = time.perf_counter()
                made = generate_for(prior, split.test, getattr(sampling, name), steps, seed, title, spacing=spacing)
                taken += (time.perf_counter() - begun) / len(made) / len(SEEDS)
                far.append(mk.metrics.fmd(judge.content.features(made), there))
            row = {"sampler": name, "steps": steps, "spacing": spacing, "fmd": round(sum(far) / len(far), 3)}
            rows.append(row | {"clip_seconds": round(taken, 4)})
    return rows


def scales(split, prior, judge) -> list[dict]:
    """What guidance does: accuracy and FMD over its scale; on the validation part, by which `SCALE` was chosen."""
    rows, split = [], split._replace(test=split.validation)
    for scale in (1.0, 1.5, 2.0, 2.5, 5.0):
        found = quality(prior, split, judge, f"guidance {scale:g}", scale=scale)
        rows.append({"scale": scale, **{name: found[name] for name in ("content", "style", "fmd", "fmd_ae")}})
    return rows


def main() -> None:
    """Measure everything and write it."""
    start = time.perf_counter()
    torch.set_num_threads(THREADS)
    torch.manual_seed(0)
    figures, speeds = speed()
    actor, things = judged("actor", None)
    bandai, _ = judged("bandai-2", find_root())
    table = samplers(**things)
    fmds = {(row["sampler"], row["steps"]): row["fmd"] for row in table}
    ratio = fmds["dpm_solver", 10] / fmds["ddim", 50]
    scale = mk.methods.text_to_motion.GUIDANCE_SCALE
    how = f"test prompts, 20 DDIM steps, guidance {scale:g}, mean over {len(SEEDS)} seeds"
    note = f"FMD on actor's test prompts, mean over {len(SEEDS)} seeds; DDIM in even steps"
    figures |= {
        "dpm_solver_10_over_ddim_50_fmd_ratio": figure(ratio, 1.05, "", note, False),
        "actor_content": figure(actor["content"], 95, "%", how),
        "actor_style": figure(actor["style"], 90, "%", f"the same; of the clips themselves {actor['real_style']:.1f}"),
        "actor_r1": figure(actor["r1"], 70, "%", "the discriminator, right caption among 32 of different meaning"),
        "actor_training_seconds": figure(
            actor["training_seconds"], 5400, "s", "from its card, with what it started from", False
        ),
    }
    tables = {"speed": speeds, "quality": [actor, bandai], "samplers": table, "guidance": scales(**things)}
    write_result(RESULT, "make bench-diffusion", start, figures, tables)


if __name__ == "__main__":
    main()
