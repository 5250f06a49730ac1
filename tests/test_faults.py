"""docs/faults.md is what happens, and its two tables can tell good from bad."""

import numpy as np
import pytest
from noslip.guarantees import faults
from noslip.guarantees.tools import Failed, Task
from noslip.guarantees.vehicle import Firmware


def test_page_is_what_happens(tmp_path):
    assert "faults of the vehicle" in faults.check(Task(tmp_path))


def test_an_undisturbed_run_arrives(tmp_path):
    outcome = faults.outcome(Firmware(tmp_path), faults.Fault("none"))
    assert outcome.end == "arrives" and outcome.statuses == () and outcome.error < 2e-3


def test_a_flipped_bit_is_one_bit():
    state = np.array([1.0, -2.5, 3e-3])
    for bit in range(faults.BITS):
        broken = faults._flip(state, 1, bit)
        changed = broken.view(np.uint32) ^ state.astype(np.float32).view(np.uint32)
        assert list(changed) == [0, 1 << bit, 0]


@pytest.mark.parametrize(("status", "tau"), [("ok", [np.nan, 0]), ("ok", [20.1, 0]), ("singular", [0, 1e-3])])
def test_a_bad_answer_is_a_failure(status, tau):
    with pytest.raises(Failed):
        faults._kind("type_i", status, np.array(tau), np.zeros(2))
