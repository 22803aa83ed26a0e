"""The tests of the tests: a metric with one thing wrong in it fails its known answers."""

import inspect

import pytest
import test_metrics
import test_metrics_intervals
from test_metrics import walk, walks  # noqa: F401  (fixtures of the tests that are run here)

from motionkit import metrics

# function, what stands there, what a careless hand might write, and how the test begins that must notice
MUTANTS = [
    ("fmd", "- 2 * inner.sqrt().sum()", "", "fmd_against_scipy"),
    ("fmd", "((mean_a - mean_b) ** 2).sum() + ", "", "fmd_against_scipy"),
    ("gaussian", "(x - mean).T @ (x - mean)", "x.T @ x", "fmd_against_scipy"),
    ("gaussian", "/ (count - 1)", "* 0", "fmd_against_scipy"),
    ("style_fmd", '_half(judge, "style")', '_half(judge, "content")', "fmd_of_motions_is"),
    ("recognition_accuracy", "& torch.isfinite(scores).all(1)", "", "recognition_counts"),
    ("recognition_accuracy", "scores.argmax(1)", "scores.argmin(1)", "recognition_counts"),
    ("confusion", "[known]", "", "recognition_counts"),
    ("repeated_accuracy", "recognition_accuracy(s, right)", "0.5", "accuracy_over_repeats"),
    ("spread", "found.std()", "found.std(correction=0)", "spread_prints"),
    ("finite_rows", ".all(1)", ".any(1)", "what_is_not_finite"),
    ("pair_similarities", "x / length", "x", "text_similarity"),
    ("foot_contact_accuracy", "found == contacts", "found != contacts", "feet"),
    ("foot_sliding_factor", "result, contacts)", "result, None)", "feet"),
    ("trajectory_similarity", ".at_origin()", "", "trajectories"),
    ("jitter", "3 * places[1:-2]", "2 * places[1:-2]", "soundness"),
    ("bone_length_error", "motion.skeleton.offsets[1:]", "0 * motion.skeleton.offsets[1:]", "soundness"),
    ("penetration", "ground - lowest", "lowest - ground", "soundness"),
    ("local_diversity", ".amin(1)", ".mean(1)", "diversity"),
    ("global_diversity", "best[start] + piece", "piece", "diversity"),
    ("bands", "(rates < high)", "(rates < 99)", "speed_bands"),
    ("_redrawn", "s[rows]", "s", "intervals_hold_the_truth"),
    ("bootstrap", "(1 - level) / 2", "1 - level", "intervals_hold_the_truth"),
    ("bootstrap", "_factors(groups, count) or ", "", "rows_that_share_clips"),
    ("_drawn", "times * torch.bincount", "torch.bincount", "rows_that_share_clips"),
    ("_drawn", "(sizes,), generator", "(1,), generator", "rows_that_share_clips"),
    ("bootstrap", "again - again.median() + value", "again", "centred_intervals"),
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


@pytest.mark.parametrize("name, old, new, beginning", MUTANTS)
def test_a_mutated_metric_is_caught(name, old, new, beginning, monkeypatch, request):
    test = known_answers(beginning)
    given = [request.getfixturevalue(fixture) for fixture in inspect.signature(test).parameters]
    monkeypatch.setattr(metrics, name, mutant(metrics, name, old, new))
    with pytest.raises((AssertionError, pytest.fail.Exception)):
        test(*given)
