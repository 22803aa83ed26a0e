"""Paper 1's few-shot style transfer: `make bench NAME=few_shot`. Times, then styles held back, then captures.

In every table `few-shot` is the paper's method and `style-code` the kit's own. On captures stand the paper's tables 1
to 3 and figure 8, with a prior that learned from other clips of the same styles; and table 3 once more with a prior
that has seen nothing of the data, as in the paper, whose rows come from other clips (Xia's) than its prior's. All
results of the arena are kept, so a run that is broken off goes on where it was.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from pathlib import Path
from types import SimpleNamespace

import torch
from torch import Tensor, nn

import motionkit as mk

from .. import text
from ..actor import perform
from ..actor.style import get_style
from ..arena import PROTOCOLS, Protocol
from ..contacts import foot_contacts
from ..datasets import Clip, Dataset, Labels
from ..datasets.batches import FeatureCache
from ..errors import MotionKitError
from ..features import FacingFree
from ..layers import Denoiser, TransformerConfig
from ..methods.base import NEUTRAL, as_example
from ..methods.few_shot import Config, FewShot
from ..methods.style_code import StyleCode, StyleCodeTransfer
from ..methods.style_code_training import code_of
from ..methods.text_to_motion import Prior
from ..metrics import foot_contact_accuracy
from ..sampling import Denoise, PartialDiffusion
from ..skeleton import smpl
from ..training import TrainConfig, fit
from . import BASELINES, captures, compare, figure, median_seconds, table

PROMPT = "a person is walking in a zombie-like way"
HELD_BACK = Protocol(
    "held back",
    "neutral to styled",
    examples=3,
    columns=("fmd", "cra", "sra", "truth_error", "fsf", "fca", "jitter", "seconds"),
    about="A neutral clip of each content in each of four styles that nothing was trained on; three clips lend each.",
)
# of each style one example, drawn by the seed, of paper 1's 70: each is learned anew
ONE_EXAMPLE = replace(PROTOCOLS["paper-1"], name="paper-1, one example", examples=1)
PAIRS = 72  # of table 2, drawn by the seed


def walking(style: str) -> mk.Motion:
    """Four seconds of the performer."""
    return perform("walk", style, seed=1, seconds=4.0).motion


@figure("learn_code_seconds", at_most=180, unit="s", note="a style code")
def learning_a_code() -> float:
    """Seconds to learn a style by the kit's own method, as a code."""
    clip, start = walking("zombie"), time.perf_counter()
    mk.methods.load("style-code").learn(clip, PROMPT)
    return time.perf_counter() - start


@figure("learn_seconds", at_most=180, unit="s", note="pair, contents, fine-tuning")
@figure("restyle_seconds", at_most=0.3, unit="s", note="120 frames at laptop size, feet locked")
@figure("style_file_mb", at_most=1, unit="MB", note="rank 8, numbers of 16 bits")
def learning() -> dict:
    """Seconds to learn a style as the paper says, and to restyle four seconds of motion; the size of its file."""
    clip, method = walking("zombie"), mk.methods.load("few-shot")
    len(method.pairs.library)  # read before the clock starts
    start = time.perf_counter()
    style = method.learn(clip, PROMPT)
    seconds = time.perf_counter() - start
    restyle = partial(method.stylize, walking("neutral"), style=style, labels=Labels(texts=("a person is walking",)))
    with tempfile.TemporaryDirectory() as folder:
        size = style.save(Path(folder, "style.safetensors")).stat().st_size
    return {"learn_seconds": seconds, "restyle_seconds": median_seconds(restyle), "style_file_mb": size / 1e6}


@figure("paper_size_seconds", at_most=0.4, unit="s", note="120 frames, 6 steps of the reverse chain")
@torch.inference_mode()
def paper_size() -> float:
    """Seconds of the steps back at the paper's size."""
    features, chain = FacingFree(smpl(), 30).size, PartialDiffusion.from_paper(mk.diffusion.NoiseSchedule.cosine())
    network = Denoiser(features, 128, TransformerConfig.paper()).eval()  # fresh weights are as fast
    x, words = torch.randn(1, 120, features), torch.randn(1, 128)
    return median_seconds(partial(chain.reverse, lambda x, t: network(x, t, words), x))


# Styles held back: neither prior nor codes nor discriminator have seen them.


class GroundTruthCode(StyleCodeTransfer):
    """Not a rival but a bound: the code is the performer's own numbers of the style, and nothing is learned."""

    def read_style(self, style: object) -> dict[StyleCode, float]:
        """A style by the label of its clip."""
        label = as_example(style).labels.style
        return {StyleCode(self.codes, code_of(get_style(label)), "", label): 1.0}


@figure("held_back_error_knn_ratio", at_most=0.7, note="truth error over that of knn-dtw")
@figure("held_back_error_statistics_ratio", at_most=0.7, note="truth error over that of statistics")
@figure("held_back_cra_over_best", at_least=1)
@figure("held_back_sra_over_best", at_least=1)
@table("held_back", dataset="actor-held-back")
def held_back() -> dict:
    """Held-back styles, each from one clip, beside all baselines."""
    test = mk.datasets.load("actor-held-back").split().test
    split = mk.datasets.Split(mk.datasets.load("actor").split().train, test[:0], test)
    methods = {name: mk.methods.load(name, library=split.train) for name in ("style-code", "few-shot")}
    methods |= {"style-code, ground-truth code": GroundTruthCode(library=split.train)}
    methods |= {name: name for name in (*BASELINES, "copy-content", "copy-style")}
    rows = compare(methods, split, HELD_BACK, judge=mk.judges.load("actor-held-back"))
    ours, figures = rows["style-code"], {"held_back": list(rows.values())}
    for name, rival in (("knn", "knn-dtw"), ("statistics", "statistics")):
        figures[f"held_back_error_{name}_ratio"] = ours["truth_error"] / rows[rival]["truth_error"]
    for label in ("cra", "sra"):
        best = max((rows[name] for name in BASELINES), key=lambda row: row[label])
        low, high = ours[f"{label}_ci"][0], best[f"{label}_ci"][1]
        note = f"low end of the interval, {low:.1f}, over the high end of the best other, {best['method']}, {high:.1f}"
        figures[f"held_back_{label}_over_best"] = low / high, note
    return figures


# The rows of table 3: what the method is without one of its parts.

_AE_STEPS, _AE_BATCH, _AE_LR, _AE_FRAMES = 1500, 48, 1e-3, 64
_AE_WIDTHS = (128, 192)


class ConvAutoencoder(nn.Module):
    """The autoencoder of unpaired motion style transfer (Aberman et al. 2020), its normalisations left out.

    Two convolutions over time, each halving the frames, and a residual block; then the same backwards. Paper 1's table
    3 takes it so, "while omitting the Instance Normalization and AdaIN layers". It is called like `layers.Denoiser`,
    but neither step nor sentence count. features: D. longest: frames of a window.

    >>> network = ConvAutoencoder(features=10)
    >>> network(torch.randn(2, 30, 10)).shape
    torch.Size([2, 30, 10])
    """

    def __init__(self, features: int, longest: int = 160) -> None:
        super().__init__()
        near, far = _AE_WIDTHS
        self.config = SimpleNamespace(frames=longest, frames_per_token=4)
        self.down = nn.ModuleList((_strided(features, near), _strided(near, far)))
        self.middle = nn.ModuleList((_residual(far), _residual(far)))
        self.up = nn.ModuleList((_smooth(far, near), _smooth(near, features)))

    def forward(self, x: Tensor, t: Tensor | None = None, text: Tensor | None = None, mask: Tensor | None = None):
        """x: clean [B, F, D]; the rest is not looked at. Returns [B, F, D]."""
        frames = x.shape[1]
        y = nn.functional.pad(x.transpose(1, 2), (0, -frames % 4), mode="replicate")  # [B, D, F]
        for layer in self.down:
            y = nn.functional.leaky_relu(layer(y), 0.2)
        for block in self.middle:
            y = y + block(y)
        for n, layer in enumerate(self.up):
            y = nn.functional.interpolate(y, scale_factor=2, mode="nearest")
            y = layer(y if n == 0 else nn.functional.leaky_relu(y, 0.2))
        return y.transpose(1, 2)[:, :frames]


def _strided(inside: int, outside: int) -> nn.Conv1d:
    return nn.Conv1d(inside, outside, 8, stride=2, padding=3, padding_mode="replicate")


def _smooth(inside: int, outside: int) -> nn.Conv1d:
    return nn.Conv1d(inside, outside, 5, padding=2, padding_mode="replicate")


def _residual(width: int) -> nn.Sequential:
    first, second = (nn.Conv1d(width, width, 3, padding=1) for _ in range(2))
    return nn.Sequential(first, nn.LeakyReLU(0.2), second)


class Direct:
    """In place of a `PartialDiffusion`: no noise, one call, so that eqs. 10 to 12 of paper 1 teach an autoencoder
    (table 3).

    >>> Direct().reverse(lambda x, t: 2 * x, torch.ones(1, 4, 2)).shape
    torch.Size([1, 1, 4, 2])
    """

    @property
    def timesteps(self) -> tuple[int, ...]:
        """There are none; a file of the style would name them."""
        raise MotionKitError("an autoencoder's style is not kept: it is an ablation, made anew where it is needed")

    def forward(self, predict: Denoise, x: Tensor) -> Tensor:
        """x [B, F, D] as it is."""
        return x

    def reverse(self, predict: Denoise, noised: Tensor) -> Tensor:
        """What the network makes of it, [1, B, F, D]."""
        return predict(noised, torch.zeros(len(noised), dtype=torch.long))[None]


def with_autoencoder(prior: Prior, library: Dataset, steps: int = _AE_STEPS, seed: int = 0, **running) -> Prior:
    """A prior whose network is an autoencoder that learned to give a library's motions back (paper 1, table 3).

    It has the prior's features, sentences and card; it cannot make motions. running: as in `training.fit`. Raises
    MotionKitError where no clip of the library is as long as a window.
    """
    features = FeatureCache(library, prior.layout)
    long = (features.lengths >= _AE_FRAMES).nonzero()[:, 0]
    if not len(long):
        raise MotionKitError(f"no clip of the library has {_AE_FRAMES} frames for the autoencoder to learn from")
    torch.manual_seed(seed)
    network = ConvAutoencoder(prior.layout.size, prior.longest)

    def draw(step: int) -> Tensor:
        clips = long[torch.randint(len(long), (_AE_BATCH,))]
        return prior.normalizer.normalize(features.sample(clips, _AE_FRAMES))

    def loss_fn(network: nn.Module, x: Tensor) -> Tensor:
        return ((network(x) - x) ** 2).mean()

    running.setdefault("title", "an autoencoder")
    fit(network, draw, loss_fn, TrainConfig(steps, _AE_LR, seed=seed), **running)
    return replace(prior, network=network)


class Autoencoder(FewShot):
    """Few-shot with an autoencoder in place of diffusion (paper 1, table 3).

    clips: what the autoencoder learns from when it is first needed; left out, the library.
    """

    def __init__(self, *arguments, clips: Dataset | None = None, **more) -> None:
        self.clips = clips
        super().__init__(*arguments, **more)

    @cached_property
    def model(self) -> Prior:
        """What is fine-tuned."""
        return with_autoencoder(self.prior, self.pairs.library if self.clips is None else self.clips, seed=self.seed)

    @property
    def partial(self) -> Direct:
        """No steps, but one call."""
        return Direct()

    def __getstate__(self) -> dict:
        return {name: value for name, value in super().__getstate__().items() if name != "model"}


ABLATIONS = {  # the rows of paper 1's table 3: the method, and what is other in its config
    "ours": (FewShot, {}),
    "with KNN + DTW": (FewShot, {"pair": "knn-dtw"}),
    "with AE": (Autoencoder, {}),
    "without L_s": (FewShot, {"loss_weights": (1.0, 0.0)}),
}


def ablation(row: str, *arguments, **more) -> FewShot:
    """A row of table 3 as a method; more: what `FewShot` takes beside a config.

    >>> ablation("without L_s").config.loss_weights
    (1.0, 0.0)
    """
    method, changes = ABLATIONS[row]
    return method(*arguments, config=Config().changed(**changes), **more)


# Captures; prior and discriminator learned from their training part.


@cache
def bandai() -> tuple[mk.datasets.Split, FewShot]:
    """The captures, and the method that learns from them."""
    split = captures().split()
    return split, mk.methods.load("few-shot", prior="bandai-2", library=split.train)


@figure("bandai_cra", at_least=93.41, unit="%")
@figure("bandai_sra", at_least=60.11, unit="%")
@figure("sra_without_semantic_ratio", at_most=0.5, note="SRA without L_s over SRA with it")
@table("table_3", dataset="bandai-2")
def table_3() -> dict:
    """Tables 1 and 3: the method, and what it is without its parts; accuracies beside the paper's own."""
    split = bandai()[0]
    methods = {row: ablation(row, "bandai-2", library=split.train) for row in ABLATIONS}
    rows = compare(methods | {"statistics": "statistics"}, split, ONE_EXAMPLE)
    ours = rows["ours"]
    note = f"Bandai-2, one example of each style, {ours['transfers']} of paper 1's transfers"
    figures = {f"bandai_{label}": (ours[label], note) for label in ("cra", "sra")}
    ratio = rows["without L_s"]["sra"] / ours["sra"]
    return figures | {"sra_without_semantic_ratio": ratio, "table_3": list(rows.values())}


@table("table_2", dataset="bandai-2")
def table_2() -> list[dict]:
    """Are the neutral motions that are paired with test clips neutral, and do they keep the content?"""
    (split, method), judge = bandai(), mk.judges.load("bandai-2")
    styled = [clip for clip in split.test if clip.style not in NEUTRAL]
    order = torch.randperm(len(styled), generator=torch.Generator().manual_seed(0)).tolist()
    clips = [styled[n] for n in order[:PAIRS]]
    neighbours = mk.methods.load("knn-dtw", library=method.pairs.library)
    motions = {
        "few-shot": [method.neutral_motion(clip.motion, clip.text) for clip in clips],
        "KNN + DTW": [neighbours.neutral_pair(clip.motion, clip.content) for clip in clips],
    }
    real, rows = judge.content.features([clip.motion for clip in split.test]), []
    for name, pairs in motions.items():
        contents = judge.content.scores(pairs).argmax(1) == judge.content.ids([clip.content for clip in clips])
        styles = judge.style.scores(pairs).argmax(1) == judge.style.ids([neutral_of(split.test)] * len(pairs))
        row = {"method": name, "pairs": len(pairs), "fmd": mk.metrics.fmd(judge.content.features(pairs), real)}
        row |= {"cra": 100 * contents.double().mean().item(), "sra": 100 * styles.double().mean().item()}
        rows.append({key: round(value, 2) if isinstance(value, float) else value for key, value in row.items()})
    return rows


def neutral_of(clips: mk.datasets.Dataset) -> str:
    """The label of the style that counts as neutral."""
    return next(style for style in clips.styles if style in NEUTRAL)


FIGURE_8_G = (700, 800, 900, 950, 1000)
FIGURE_8_K = (100, 200, 300, 400, 500)  # each learns two styles anew; the paper goes on to 600


def sweep_g(method: FewShot, examples: Sequence[Clip], values: Iterable[int] = FIGURE_8_G) -> list[dict]:
    """What G does to the neutral motion of a pair (paper 1, figure 8, left).

    method: of `methods.load("few-shot")`. examples: styled clips with captions. values: of G. For each value a row:
    `g`; `fca`, how well the feet of pair and example agree, per cent; `similarity`, the cosine between the pair and the
    neutral sentence as the discriminator sees them. Raises MotionKitError for no examples, and values out of range.
    """
    _check_captions("examples", examples)
    rows = []
    for value in values:
        variant = method.with_config(G=value)
        pairs = [variant.neutral_motion(clip.motion, clip.text) for clip in examples]
        captions = [text.to_neutral(clip.text) for clip in examples]
        rows.append({"g": value} | _agreement(method, pairs, [clip.motion for clip in examples], captions))
    return rows


def sweep_k(
    method: FewShot, examples: Sequence[Clip], contents: Sequence[Clip], values: Iterable[int] = FIGURE_8_K
) -> list[dict]:
    """What K does to the result (paper 1, figure 8, right): every style is learned anew with each K.

    examples, contents: styled and neutral clips with captions; every content is told in every style. values: of K. For
    each value a row: `k`; `fca`, how well the feet of result and content agree, per cent; `similarity`, the cosine
    between the result and the content's sentence in the style. Raises MotionKitError as `sweep_g`.
    """
    _check_captions("examples", examples)
    _check_captions("contents", contents)
    rows = []
    for value in values:
        variant, results, captions = method.with_config(K=value), [], []
        for example in examples:
            style = variant.learn(example.motion, example.text, content=example.content, title="")
            results += [variant.stylize(clip, style) for clip in contents]
            captions += [text.to_style(clip.text, style.name) for clip in contents]
        before = [clip.motion for clip in contents] * len(examples)
        rows.append({"k": value} | _agreement(method, results, before, captions))
    return rows


def _agreement(method: FewShot, after: list[mk.Motion], before: list[mk.Motion], captions: list[str]) -> dict:
    feet = [foot_contact_accuracy(motion, foot_contacts(other)) for motion, other in zip(after, before)]
    cosines = method.discriminator.similarity(after, captions).diagonal()
    return {"fca": round(sum(feet) / len(feet), 2), "similarity": round(float(cosines.mean()), 4)}


def _check_captions(what: str, clips: Sequence[Clip]) -> None:
    mute = next((clip.name for clip in clips if not clip.text), None)
    if not clips or mute is not None:
        which = "none" if not clips else f"{mute!r} without one"
        raise MotionKitError(f"a sweep needs {what}, clips with captions; found {which}")


def clips_of_figure_8() -> tuple[list, list]:
    """The first test clip of each content and style: the styled ones, and the neutral ones."""
    test = bandai()[0].test
    first = {(clip.content, clip.style): clip for clip in reversed(list(test))}
    clips = [clip for _, clip in sorted(first.items())]
    neutral = neutral_of(test)
    return [c for c in clips if c.style != neutral], [c for c in clips if c.style == neutral]


@table("figure_8_g", method="few-shot", dataset="bandai-2")
def figure_8_g() -> list[dict]:
    """G on a styled clip of every fourth kind."""
    return sweep_g(bandai()[1], clips_of_figure_8()[0][::4])


@table("figure_8_k", method="few-shot", dataset="bandai-2")
def figure_8_k() -> list[dict]:
    """K on a clip of two styles, taken to a neutral one of each content."""
    styled, contents = clips_of_figure_8()
    return sweep_k(bandai()[1], styled[:: len(styled) // 2][:2], contents)


# Why table 3 falls less than in the paper: captures again, with a prior that has seen nothing like them.


@figure("ae_cra_ratio", at_most=0.5)
@figure("ae_sra_ratio", at_most=0.5)
@figure("sra_ratio", at_most=0.5)
@table("table_3_actor_prior", dataset="bandai-2")
def table_3_of_a_stranger() -> dict:
    """Rows of table 3 with prior and discriminator of `actor`; in the paper all three figures fall by half or more."""
    split = captures().split()
    names = ("ours", "without L_s", "with AE")
    more = {"with AE": {"clips": mk.datasets.load("actor").split().train}}  # it has seen none of the captures either
    methods = {row: ablation(row, "actor", library=split.train, **more.get(row, {})) for row in names}
    rows = compare(methods, split, ONE_EXAMPLE)
    figures = {"table_3_actor_prior": list(rows.values())}
    for name, method, label in (("ae_cra", "with AE", "cra"), ("ae_sra", "with AE", "sra"), ("sra", names[1], "sra")):
        note = f"{label} of {method} over that of ours; prior of actor, clips of Bandai-2"
        figures[f"{name}_ratio"] = rows[method][label] / rows["ours"][label], note
    return figures
