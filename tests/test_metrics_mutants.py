"""The tests of the tests: a metric with one thing wrong in it fails its known answers."""

import importlib
import inspect

import pytest
import test_metrics
import test_metrics_intervals
from test_metrics import walk, walks  # noqa: F401  (fixtures of the tests that are run here)

from motionkit import metrics

# file and function, what stands there, what a careless hand might write, and how the test begins that must notice
MUTANTS = [
    ("frechet.fmd", "- 2 * inner.sqrt().sum()", "", "fmd_against_scipy"),
    ("frechet.fmd", "((mean_a - mean_b) ** 2).sum() + ", "", "fmd_against_scipy"),
    ("frechet.gaussian", "(x - mean).T @ (x - mean)", "x.T @ x", "fmd_against_scipy"),
    ("frechet.gaussian", "/ (count - 1)", "* 0", "fmd_against_scipy"),
    ("frechet.style_fmd", '_half(judge, "style")', '_half(judge, "content")', "fmd_of_motions_is"),
    ("recognition.recognition_accuracy", "& torch.isfinite(scores).all(1)", "", "recognition_counts"),
    ("recognition.recognition_accuracy", "scores.argmax(1)", "scores.argmin(1)", "recognition_counts"),
    ("recognition.confusion", "[known]", "", "recognition_counts"),
    ("recognition.repeated_accuracy", "recognition_accuracy(s, right)", "0.5", "accuracy_over_repeats"),
    ("repeats.spread", "found.std()", "found.std(correction=0)", "spread_prints"),
    ("repeats.finite_rows", ".all(1)", ".any(1)", "what_is_not_finite"),
    ("texts.pair_similarities", "x / length", "x", "text_similarity"),
    ("paths.foot_contact_accuracy", "found == contacts", "found != contacts", "feet"),
    ("paths.foot_sliding_factor", "result, contacts)", "result, None)", "feet"),
    ("paths.trajectory_similarity", ".at_origin()", "", "trajectories"),
    ("soundness.jitter", "3 * places[1:-2]", "2 * places[1:-2]", "soundness"),
    ("soundness.bone_length_error", "motion.skeleton.offsets[1:]", "0 * motion.skeleton.offsets[1:]", "soundness"),
    ("soundness.penetration", "ground - lowest", "lowest - ground", "soundness"),
    ("diversity.local_diversity", ".amin(1)", ".mean(1)", "diversity"),
    ("diversity.global_diversity", "best[start] + piece", "piece", "diversity"),
    ("spectra.bands", "(rates < high)", "(rates < 99)", "speed_bands"),
    ("intervals._redrawn", "s[rows]", "s", "intervals_hold_the_truth"),
    ("intervals.bootstrap", "(1 - level) / 2", "1 - level", "intervals_hold_the_truth"),
    ("intervals.bootstrap", "_factors(groups, count) or ", "", "rows_that_share_clips"),
    ("intervals._drawn", "times * torch.bincount", "torch.bincount", "rows_that_share_clips"),
    ("intervals._drawn", "(sizes,), generator", "(1,), generator", "rows_that_share_clips"),
    ("intervals.bootstrap", "again - again.median() + value", "again", "centred_intervals"),
]


def mutant(module: object, name: str, old: str, new: str) -> object:
    """A function of a module with a piece of its source replaced."""
    source = inspect.getsource(getattr(module, name))
    assert old in source, f"{name} no longer says {old!r}: choose another mutation"
    found: dict[str, object] = {}
    exec("from __future__ import annotations\n" + source.replace(old, new), vars(module), found)
    return found[name]


def known_answers(beginning: str):
    """The one test whose name begins so."""
    functions = {**vars(test_metrics), **vars(test_metrics_intervals)}
    (found,) = (value for name, value in functions.items() if name.startswith(f"test_{beginning}"))
    return found


@pytest.mark.parametrize("where, old, new, beginning", MUTANTS)
def test_a_mutated_metric_is_caught(where, old, new, beginning, monkeypatch, request):
    file, name = where.split(".")
    module, test = importlib.import_module(f"motionkit.metrics.{file}"), known_answers(beginning)
    given = [request.getfixturevalue(fixture) for fixture in inspect.signature(test).parameters]
    wrong = mutant(module, name, old, new)
    for place in (module, metrics):
        if hasattr(place, name):
            monkeypatch.setattr(place, name, wrong)
    with pytest.raises((AssertionError, pytest.fail.Exception)):
        test(*given)
