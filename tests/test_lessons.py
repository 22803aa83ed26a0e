"""The exercise checker: right, wrong, not tried; every typical mistake gets its sentence; nothing crashes it."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import motionkit as mk
from motionkit import lessons
from motionkit import rotations as rot

ROOT = Path(__file__).parent.parent
MISTAKES = [(name, sentence) for name in lessons.names() for sentence in lessons._exercise(name).mistakes]


def said(capsys, name, mine, **more):
    """What is printed about an answer that is not right."""
    assert lessons.check(name, mine, **more) is False
    return capsys.readouterr().out


@pytest.mark.parametrize("name", lessons.names())
def test_the_reference_passes_and_a_stub_does_not(name, capsys):
    assert lessons.check(name, lessons.reference(name))
    assert capsys.readouterr().out == f"{name}: right.\n"
    assert "not tried yet" in said(capsys, name, lambda *args: None)


@pytest.mark.parametrize("name", lessons.names())
def test_a_wrong_answer_gets_the_second_hint(name, capsys):
    reference = lessons.reference(name)
    assert "Hint 2 of 3: " in said(capsys, name, lambda *args: torch.as_tensor(reference(*args)) + 0.1)


@pytest.mark.parametrize("name", lessons.names())
def test_every_exercise_has_hints_in_stages_and_three_mistakes(name):
    exercise = lessons._exercise(name)
    assert len(exercise.hints) >= 3 and len(set(exercise.hints)) == len(exercise.hints)
    assert len(exercise.mistakes) >= 3 and len(exercise.cases()) >= 2


@pytest.mark.parametrize("name, sentence", MISTAKES)
def test_a_typical_mistake_is_refused_and_told_by_name(name, sentence, capsys):
    assert f"\n{sentence}\n" in said(capsys, name, lessons._exercise(name).mistakes[sentence])


def test_the_table_of_lessons_names_every_exercise():
    for lesson, exercises in lessons._LESSONS.items():
        assert sorted(getattr(lessons, lesson).EXERCISES) == sorted(exercises)


def test_hints_come_in_stages(capsys):
    def stub(a, b, t):
        raise NotImplementedError

    hints = lessons._exercise("slerp").hints
    assert hints[0] in said(capsys, "slerp", stub) and hints[2] in said(capsys, "slerp", stub, hint=3)
    assert hints[1] in said(capsys, "slerp", lambda a, b, t: a)
    last = said(capsys, "slerp", lambda a, b, t: a, hint=9)
    assert hints[2] in last and "tells more" not in last


@pytest.mark.parametrize("stub", [lambda *_: None, lambda *_: NotImplemented, lambda *_: ...])
def test_every_kind_of_stub_counts_as_not_tried(stub, capsys):
    assert said(capsys, "blend", stub).startswith("blend: not tried yet, nothing is returned.\nHint 1 of 3: ")


def slides(motion, contacts, places, pairs):
    """A student's sliding with one thing left open."""
    feet = places(motion.positions()[:, list(motion.skeleton.feet())])
    steps = (feet[1:] - feet[:-1]).norm(dim=-1) * 1000
    chosen = steps[pairs(contacts)]
    return float(chosen.mean()) if len(chosen) else 0.0


@pytest.mark.parametrize(
    "places, pairs",
    [
        (lambda p: p[..., [0, 2]], lambda c: torch.ones_like(c[1:])),  # contacts ignored
        (lambda p: p[..., [0, 2]], lambda c: c[1:] | c[:-1]),
        (lambda p: p, lambda c: c[1:] & c[:-1]),  # y counted
        (lambda p: p[..., 2:], lambda c: c[1:] & c[:-1]),  # z only
    ],
)
def test_plausible_but_wrong_sliding_is_caught(places, pairs):
    assert not lessons.check("foot_sliding", lambda m, c: slides(m, c, places, pairs))


def test_right_sliding_passes():
    assert lessons.check("foot_sliding", lambda m, c: slides(m, c, lambda p: p[..., [0, 2]], lambda c: c[1:] & c[:-1]))


def test_an_unguarded_slerp_is_caught(capsys):
    def bare(a, b, t):
        b = torch.where((a * b).sum(-1, keepdim=True) < 0, -b, b)
        angle = torch.acos((a * b).sum(-1, keepdim=True))
        return (torch.sin((1 - t) * angle) * a + torch.sin(t * angle) * b) / torch.sin(angle)

    assert "In case 4 (equal rotations), some numbers are not finite" in said(capsys, "slerp", bare)


def test_a_penalty_that_nobody_can_learn_from_is_caught(capsys):
    def flat(answers, points, weight):
        (slope,) = torch.autograd.grad(answers.sum(), points)
        return weight * slope.square().sum(1).mean()

    def half(answers, points, weight):
        (slope,) = torch.autograd.grad(answers.sum(), points, create_graph=True)
        return weight * (slope * slope.detach()).sum(1).mean()

    out = said(capsys, "slope_penalty", flat)
    assert "no gradient flows back" in out and "create_graph=True" in out
    out = said(capsys, "slope_penalty", half)
    assert "the numbers are right, but not the gradients" in out and "create_graph=True the" not in out
    assert "no gradient flows back" in said(
        capsys, "contrastive_loss", lambda *case: lessons.reference("contrastive_loss")(*case).item()
    )


def test_common_slips_are_named(capsys):
    angle = lessons.reference("swing_angle")
    for mine, part in (
        (lambda a, b: torch.rad2deg(angle(a, b)), "degrees?"),
        (lambda a, b: angle(a, b) / 2, "half the right"),
        (lambda a, b: (angle(a, b), 1), "not a tuple"),
    ):
        assert part in said(capsys, "swing_angle", mine)


def test_errors_and_shapes_are_put_in_words(capsys):
    assert "TypeError" in said(capsys, "slerp", lambda a: a)
    assert "shape is [3]" in said(capsys, "slerp", lambda a, b, t: torch.zeros(3))
    with pytest.raises(mk.MotionKitError, match="did you mean 'slerp'"):
        lessons.check("slurp", print)
    for wrong in (None, ["slerp"], 3):
        with pytest.raises(mk.MotionKitError, match="no exercise"):
            lessons.check(wrong, print)


def stopping(*_):
    raise SystemExit


def deep(*case):
    return deep(*case)


class Mine:
    def __init__(self, *_):
        pass


ENDLESS = []
ENDLESS.append(ENDLESS)
NO_ANSWER = {
    "a string": ("slerp", "found a str"),
    "nothing": (None, "found a NoneType"),
    "a class": (Mine, "found a Mine"),
    "a class without arguments": (object, "TypeError"),
    "a string back": (lambda *_: "pose", "found a str"),
    "a dictionary back": (lambda *_: {"a": 1}, "found a dict"),
    "a set of pieces": (lambda *_: [torch.zeros(2), torch.zeros(3)], "found a list"),
    "a motion back": (lambda *_: mk.load(ROOT / "data/actor/walk_old.bvh"), "found a Motion"),
    "a tensor without numbers": (lambda a, *_: a.to("meta"), "found a Tensor that cannot be read"),
    "a list in itself": (lambda *_: ENDLESS, "found a list"),
    "a generator": (lambda *_: (n for n in range(3)), "found a generator"),
    "complex numbers": (lambda a, b, t: a + 0j, "complex"),
    "not finite": (lambda a, b, t: a / 0, "not finite"),
    "nothing in it": (lambda a, b, t: a[:0], "the shape is [0, 4]"),
    "an exit": (stopping, "SystemExit"),
    "no end": (deep, "RecursionError"),
    "an error": (lambda a, b, t: a @ b, "RuntimeError"),
    "not in torch": (lambda a, b, t: torch.linalg.cross(a[:, 1:] > 0, b[:, 1:] > 0), "not implemented for 'Bool'"),
}


@pytest.mark.parametrize("what", NO_ANSWER)
def test_nothing_that_a_student_gives_crashes_the_checker(what, capsys):
    mine, part = NO_ANSWER[what]
    out = said(capsys, "slerp", mine)
    assert out.startswith("slerp: not yet. ") and part in out and "Hint 2 of 3" in out


@pytest.mark.parametrize("name", lessons.names())
@pytest.mark.parametrize(
    "odd", ["a string", lambda: 1, lambda *_: torch.nan, lambda *_: [], lambda *_: True, lambda *case: case[0]]
)
def test_odd_answers_are_told_for_every_exercise(name, odd, capsys):
    assert "not yet" in said(capsys, name, odd)


def test_a_way_through_without_return_is_told(capsys):
    mine = lambda a, b, t: lessons.reference("slerp")(a, b, t) if t < 1 else None  # noqa: E731
    assert "In case 3 (at the end), nothing is returned" in said(capsys, "slerp", mine)


def test_changing_the_input_is_told(capsys):
    def mean(features, mask):
        features *= mask[..., None]
        return features.sum(1) / mask.sum(1, keepdim=True)

    assert "In case 2 (clips of several lengths), it changes what it was given" in said(capsys, "masked_mean", mean)

    def sliding(motion, contacts):
        sliding = mk.contacts.foot_sliding(motion, contacts)
        motion.translations.zero_()
        return sliding

    assert "it changes what it was given" in said(capsys, "foot_sliding", sliding)

    def split(takes):
        takes.sort()
        return lessons.reference("take_split")(takes)

    assert "it changes what it was given" in said(capsys, "take_split", split)


@pytest.mark.parametrize("kind", [torch.float64, torch.bfloat16, torch.long])
def test_a_mask_is_bool_and_all_else_may_be_of_any_type(kind, capsys):
    reference = lessons.reference("key_frames")
    assert "expected torch.bool" in said(capsys, "key_frames", lambda *case: reference(*case).to(kind))
    assert lessons.check(
        "sampler_steps", lambda *case: torch.tensor(lessons.reference("sampler_steps")(*case)).to(kind)
    )


@pytest.mark.parametrize("numbers", [np.asarray, list, torch.Tensor.to_sparse, torch.Tensor.double])
def test_numbers_may_come_in_any_dress(numbers):
    assert lessons.check("swing_angle", lambda a, b: numbers(lessons.reference("swing_angle")(a, b)))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda takes: torch.arange(len(takes)) % 5 == 0,  # deals out clips
        lambda takes: torch.tensor([take in list(dict.fromkeys(takes))[::5] for take in takes]),  # in order of coming
        lambda takes: torch.tensor([take in sorted(takes)[::5] for take in takes]),  # large takes count more
    ],
)
def test_a_split_that_leaks_or_is_unfair_is_caught(wrong):
    assert not lessons.check("take_split", wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda x, mask: x.mean(1),
        lambda x, mask: (x * mask[..., None]).mean(1),
        lambda x, mask: x[mask].mean(0).expand(len(x), -1),
    ],
)
def test_a_mean_that_counts_padding_is_caught(wrong):
    assert not lessons.check("masked_mean", wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda labels: torch.full((len(labels),), 1 / len(labels)),
        lambda labels: 1 / torch.bincount(labels)[labels],
        lambda labels: 1 / (torch.bincount(labels)[labels] * len(torch.bincount(labels))),  # labels that do not occur
    ],
)
def test_unbalanced_chances_are_caught(wrong):
    assert not lessons.check("balanced_chances", wrong)


def code_cells(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


NOTEBOOKS = sorted((ROOT / "notebooks").glob("0*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_ship_unsolved_stubs(path, capsys):
    stubs = [cell for cell in code_cells(path) if "exercises.check" in cell]
    assert len(stubs) >= 2
    for cell in stubs:
        exec(cell, {"mk": mk})  # with nothing but the kit at hand: a stub calls nothing
        assert ": not tried yet" in capsys.readouterr().out and '"""' in cell


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_no_later_cell_needs_a_solved_stub(path):
    cells = code_cells(path)
    for number, cell in enumerate(cells):
        if "exercises.check" in cell:
            (stub,) = [node.name for node in ast.parse(cell.rstrip(";")).body if isinstance(node, ast.FunctionDef)]
            assert not any(stub in later for later in cells[number + 1 :])


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_solutions_are_right(path, capsys):
    names = {"mk": mk, "torch": torch, "rot": rot}
    solved = [cell for cell in code_cells(path.parent / "solutions" / path.name) if "exercises.check" in cell]
    for cell in solved:
        exec(cell, names)
    asked = [cell.split('check("')[1].split('"')[0] for cell in code_cells(path) if "exercises.check" in cell]
    assert [cell.split('check("')[1].split('"')[0] for cell in solved] == asked
    assert capsys.readouterr().out.count(": right.") == len(asked)


@pytest.mark.slow
def test_a_check_loads_no_other_lesson():
    code = "import motionkit as mk, sys; mk.exercises.names(); mk.exercises.check('residual_mix', print); " + (
        "print([name for name in sys.modules if name.startswith('motionkit.lessons.')])"
    )
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert out.splitlines()[-1] == "['motionkit.lessons.style_erd']"
