"""docs/faults.md is what happens, and its two tables can tell good from bad."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from noslip.checks.guarantees import faults
from noslip.checks.guarantees.tools import ROOT, Failed, Task
from noslip.checks.guarantees.vehicle import Firmware
from noslip.tests.tools import need


def test_page_is_what_happens(tmp_path):
    need("gcc")
    assert "faults of the vehicle" in faults.check(Task(tmp_path))


def test_an_undisturbed_run_arrives(tmp_path):
    outcome = faults.outcome(Firmware(tmp_path), faults.Fault("none"))
    assert outcome.end == "arrives" and outcome.statuses == () and outcome.error < 0.002


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


# -- a defect of the firmware --------------------------------------------------------------------------------


def planted(folder: Path, file: str, was: str, now: str) -> Path:
    """A copy of what the page is made of, with one thing changed in its C."""
    for name in ("firmware", "generated", "docs"):
        shutil.copytree(ROOT / name, folder / name)
    path = folder / "generated/labmate" / file
    text = path.read_text()
    assert text.count(was) == 1
    path.write_text(text.replace(was, now))
    return folder


FOLLOWER = "labmate_follower_f.c"
INIT = "init_drives(self, config);"
# in both motors: the law scales all torques down to what the weaker motor has, so one wrong supply gives no
# wrong command
SUPPLIED = f"{INIT} self->motors[0].supply = self->motors[1].supply = 24;"


@pytest.mark.parametrize(
    ("words", "defect", "told"),
    [
        (
            "random numbers",
            (FOLLOWER, "state == NOSLIP_WATCHDOG_HOLD", "state != NOSLIP_WATCHDOG_RUN"),
            "after the watchdog has",
        ),
        ("supplies of", (FOLLOWER, INIT, SUPPLIED), "the supply"),
    ],
)
def test_a_command_that_may_not_be_is_found(words, defect, told, tmp_path):
    (fault,) = (fault for fault in faults.faults() if words in fault.name)
    c = Firmware(tmp_path, planted(tmp_path / "root", *defect))
    with pytest.raises(Failed, match=told):
        faults.outcome(c, fault)


@pytest.mark.nightly
def test_another_response_is_found(tmp_path):
    """The watchdog counts one missed tick less than there was."""
    call = "noslip_watchdog_step(&self->watchdog, status, missed"
    root = planted(tmp_path / "root", FOLLOWER, call, f"{call} - (missed > 0)")
    with pytest.raises(Failed, match="differs from the measurements"):
        faults.check(Task(tmp_path, root=root))
