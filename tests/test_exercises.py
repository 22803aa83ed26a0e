"""The exercise checker tells right from wrong from not tried."""

import pytest
import torch

import motionkit as mk
from motionkit import exercises


@pytest.mark.parametrize("name", exercises.names())
def test_the_reference_passes_and_a_stub_does_not(name, capsys):
    assert exercises.check(name, exercises._EXERCISES[name].reference)
    assert not exercises.check(name, lambda *args: None)
    assert "not tried yet" in capsys.readouterr().out


@pytest.mark.parametrize("name", exercises.names())
def test_a_wrong_answer_gets_a_hint(name, capsys):
    reference = exercises._EXERCISES[name].reference
    assert not exercises.check(name, lambda *args: torch.as_tensor(reference(*args)) + 0.1)
    assert "Hint:" in capsys.readouterr().out


def test_errors_and_shapes_are_put_in_words(capsys):
    assert not exercises.check("slerp", lambda a: a)
    assert "TypeError" in capsys.readouterr().out
    assert not exercises.check("slerp", lambda a, b, t: torch.zeros(3))
    assert "shape is [3]" in capsys.readouterr().out
    with pytest.raises(mk.MotionKitError, match="did you mean 'slerp'"):
        exercises.check("slurp", print)
