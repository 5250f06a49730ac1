"""The figures of the shipped robots: their claims hold, and can fail."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from noslip.examples.evidence.figures import robots
from noslip.examples.evidence.report import report
from noslip.model import ModelError, reduce
from noslip.model.robots import ROBOTS
from noslip.model.robots.labmate import labmate
from noslip.readers.robots import find_robot
from noslip.simulation.drawing import is_outline, outlines
from noslip.tests.codegen_tools import unicycle
from noslip.tests.figures_made import figure_of

NAMES = [figure.name for figure in robots.FIGURES]

WHEELS = (
    "slope_platform",
    "tractor_trailer",
    "turtlebot3_burger",
    "turtlebot3_waffle_pi",
    "pioneer_3dx",
)  # two side by side


def test_every_shipped_robot_but_the_labmate_has_one():
    assert sorted([*NAMES, "labmate"]) == sorted(ROBOTS)


@pytest.mark.parametrize("name", NAMES)
def test_claims_hold_and_can_fail(name):
    made = figure_of(name)
    assert [claim.text for claim in made.claims if not claim.as_expected] == []
    run = made.runs[robots.RUN]

    def doctored(**arrays) -> list[bool]:
        """Which claims hold of the run with other arrays."""
        return [
            c.holds
            for c in made.figure.all_claims(
                {robots.RUN: dataclasses.replace(run, arrays={**run.arrays, **arrays})}
            )
        ]

    wheels = name in WHEELS  # their angles tell the heading
    # What comes to rest, energy, constraints, heading, C and model
    assert doctored() == [True] * (4 + wheels)
    late = (run.t > run.t[-1] / 2)[:, None]
    assert doctored(y=run.y + late * np.abs(run.error).max())[0] is False
    assert doctored(power=1.001 * run.power)[1] is False
    assert doctored(energy=run.energy + 1e-3 * run.t * np.ptp(run.energy))[1] is False
    slips = dataclasses.replace(run, slip=1e-6, agreement=1e-6)
    assert [c.holds for c in made.figure.all_claims({robots.RUN: slips})][2:] == [
        False,
        *[True] * wheels,
        False,
    ]


@pytest.mark.nightly
def test_a_report_has_robots_without_contacts_and_without_the_labmates_integral():
    made = [figure_of(name) for name in ("geared_arm", "knife_edge")]
    pictured = [dataclasses.replace(each, pictures={"svg": b"<svg/>", "png": b""}) for each in made]
    text = report(pictured)
    assert "Parameters of the geared_arm" in text and "φ − c(θ_r − θ_l) constant" not in text


def test_every_shipped_robot_draws_lines_that_are_finite():
    for name in ROBOTS:
        robot = find_robot(name)
        lines = outlines(
            robot, np.zeros((1, len(robot.coordinates))), np.array([p.default for p in robot.parameters])
        )
        assert (
            robot.lines and len(lines) == len(robot.lines) and all(np.isfinite(line).all() for line in lines)
        )


def test_the_labmate_is_drawn_to_scale_where_it_is():
    robot, random = find_robot("labmate"), np.random.default_rng(6)
    p = {each.name: each.default * random.uniform(0.5, 2.0) for each in robot.parameters}
    q = random.uniform(-3.0, 3.0, (4, 5))
    body, *wheels = outlines(robot, q, np.array(list(p.values())))
    for k, (x, y, phi, *_) in enumerate(q):
        axle, left = x + 1j * y - p["d"] * np.exp(1j * phi), 1j * np.exp(1j * phi)
        places = [wheel[k] @ (1, 1j) for wheel in wheels]
        middles = sorted([(place.mean() - axle) / left for place in places], key=lambda z: z.real)
        np.testing.assert_allclose(middles, [-p["b"], p["b"]], atol=1e-12)
        np.testing.assert_allclose(
            [np.diff(place)[0] for place in places], 2 * p["r"] * np.exp(1j * phi), atol=1e-12
        )
        assert is_outline(body[k]) and abs((body[k, :4] @ (1, 1j)).mean() - (x + 1j * y)) < 1e-12
        assert not any(is_outline(wheel[k]) for wheel in wheels)


def test_a_robot_that_draws_nothing_is_a_small_box():
    robot = unicycle()
    ((box,),) = outlines(
        robot, np.array([[1.0, 2.0, np.pi / 2]]), np.array([p.default for p in robot.parameters])
    )
    np.testing.assert_allclose([box.min(axis=0), box.max(axis=0)], [[0.75, 1.5], [1.25, 2.5]], atol=1e-12)


def test_lines_of_rates_and_of_strangers_are_refused():
    robot = labmate()
    with pytest.raises(ModelError, match="line 4 of the drawing uses rates"):
        robot.draws([(robot.rate(robot["x_c"]), 0), (1, 1)])
    robot.draws([(ca.SX.sym("nowhere"), 0), (1, 1)])
    with pytest.raises(ModelError, match="a line of the drawing uses nowhere"):
        reduce(robot)
