"""The figures of the shipped robots: their claims hold, and can fail."""

import dataclasses

import numpy as np
import pytest
from noslip.evidence.figures import robots
from noslip.evidence.report import report
from noslip.model.robots import ROBOTS
from noslip.tests.figures_made import figure_of

NAMES = [figure.name for figure in robots.FIGURES]


def test_every_shipped_robot_but_the_labmate_has_one():
    assert sorted([*NAMES, "labmate"]) == sorted(ROBOTS)


@pytest.mark.parametrize("name", NAMES)
def test_claims_hold_and_can_fail(name):
    made = figure_of(name)
    assert [claim.text for claim in made.claims if not claim.as_expected] == []
    run = made.runs[robots.RUN]

    def doctored(**arrays) -> list[bool]:
        """Which claims hold of the run with other arrays."""
        return [c.holds for c in made.figure.all_claims({robots.RUN: dataclasses.replace(run, arrays={**run.arrays, **arrays})})]

    wheels = name in ("slope_platform", "tractor_trailer")  # their angles tell the heading
    assert doctored() == [True] * (4 + wheels)  # what comes to rest, energy, constraints, heading, C and model
    late = (run.t > run.t[-1] / 2)[:, None]
    assert doctored(y=run.y + late * np.abs(run.error).max())[0] is False
    assert doctored(power=1.001 * run.power)[1] is False
    assert doctored(energy=run.energy + 1e-3 * run.t * np.ptp(run.energy))[1] is False
    slips = dataclasses.replace(run, slip=1e-6, agreement=1e-6)
    assert [c.holds for c in made.figure.all_claims({robots.RUN: slips})][2:] == [False, *[True] * wheels, False]


def test_a_report_has_robots_without_contacts_and_without_the_labmates_integral():
    made = [figure_of(name) for name in ("geared_arm", "car")]
    pictured = [dataclasses.replace(each, pictures={"svg": b"<svg/>", "png": b""}) for each in made]
    text = report(pictured)
    assert "Parameters of the geared_arm" in text and "φ − c(θ_r − θ_l) constant" not in text
