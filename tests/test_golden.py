"""What methods and layouts answer stays as it was when tools/make_golden.py last wrote it down.

On the same kind of processor it is the same to the last bit; on another one, whose last digits differ, to a millimetre
(a network's recurrences carry such differences on).
"""

import pytest
import torch
from safetensors import safe_open

import make_golden


@pytest.fixture(scope="module")
def golden() -> tuple[dict[str, torch.Tensor], str]:
    with safe_open(make_golden.TARGET, "pt") as file:
        return {name: file.get_tensor(name) for name in file.keys()}, file.metadata()["machine"]  # noqa: SIM118


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_answers_are_those_that_were_written_down(golden):
    told, machine = golden
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        found = {name: value.detach().float() for name, value in make_golden.answers()}
    finally:
        torch.set_num_threads(threads)
    missing = [name for name in told if name not in found and "captured" not in name]
    assert not missing and set(found) <= set(told)
    same = machine == make_golden.machine()
    wrong = {
        name: float((value - told[name]).abs().max())
        for name, value in found.items()
        if not (torch.equal(value, told[name]) if same else torch.allclose(value, told[name], rtol=0, atol=1e-3))
    }
    assert not wrong
