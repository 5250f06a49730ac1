"""Dead reckoning of vehicles with a steered wheel in a run, from a rolling and a steered wheel."""

import numpy as np
import pytest
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.spec import spec_of
from noslip.simulation.sweeping.simulated import Simulated
from noslip.simulation.sweeping.study import study_of

BEND = """
robot = "{robot}"
gains = {{ kp = 2.0, kd = 3.0, kv = 0.8 }}
output = {{ type = "IV", L = 0.5, path = {{ kind = "circle", x_f = 0.0, y_f = 6.0, R = 6.0 }} }}
reference = {{ speed = 1.2 }}
initial = {{ point = [0.3, -0.4], heading = 0.3, speed = 0.5 }}
sensors = {{ pose = "reckoned" }}
simulation = {{ duration = 8.0, period = {period}, output_step = {period}, backend = "casadi" }}
"""


def wrong_by(robot: str, period: float, more: str = "") -> np.ndarray:
    """The largest error of x, y (m) and heading (rad) that the controller sees."""
    run = simulate(spec_of(more + BEND.format(robot=robot, period=period), "bend.toml"))
    assert np.ptp(run.x[:, 2]) > 0.3  # it turns
    return np.abs(run.seen[:, :3] - run.x[:, :3]).max(axis=0)


@pytest.mark.parametrize("robot", ["car", "tricycle"])
def test_the_error_of_a_step_is_of_third_order(robot):
    """The arc of each period is that at the mean steering angle,
    so that half the period has a quarter of the error."""
    coarse, fine = wrong_by(robot, 0.04), wrong_by(robot, 0.02)
    # Of one order less it is 2, of one more 8
    assert (coarse < 5e-4).all() and coarse / fine == pytest.approx(4.0, rel=0.3)


def test_a_wrong_wheelbase_is_seen():
    """It is what the controller reckons with that counts, and not the truth."""
    assert wrong_by("car", 0.04, "plant = { l = 2.5 }\n")[2] > 0.01


def test_what_goes_with_it():
    """No filter, and a sweep runs each sample as simulate does."""
    text = BEND.format(robot="tricycle", period=0.02)
    with pytest.raises(BadInput, match=r"\[estimator\] does not go with a steered wheel"):
        simulate(spec_of(text + "[estimator]\nnoise = 0.01\n", "bend.toml"))
    sweep = "[sweep]\nseed = 1\n[sweep.plant]\nm = { normal = [80.0, 2.0] }\n"
    assert isinstance(study_of(text + sweep, "bend.toml", 2).batch, Simulated)
