"""Logs with wrong signs, exchanged columns and wrong units: each is refused in one line that names the column and the remedy."""

import csv
from pathlib import Path

import noslip
import numpy as np
import pytest
from noslip.cli.main import main
from noslip.identification.plausibility import _Motion
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.spec import read_spec
from noslip.tests import test_calibration as geometry
from noslip.tests import test_identification as dynamics

DRIVE = ["--fit", "m_c", "I_c", "--set", "r=0.15", "--inputs", "held"]
ROWS = 400


def driven() -> dict[str, np.ndarray]:
    """A run towards a circle: all columns of `noslip simulate`, noisy rates."""
    table = np.array(dynamics.table()[:ROWS])
    table[:, 6:8] += dynamics.NOISE * np.random.default_rng(1).normal(size=(ROWS, 2))
    return dict(zip(dynamics.columns(), table.T, strict=True))


def measured() -> dict[str, np.ndarray]:
    """Angles and noisy poses of a winding path, with geometry that is not quite that of the robot."""
    log = geometry.log_of(*geometry.winding(200), 1.0, 3)
    return {"t": log.t, **dict(zip((*log.names, "x_c", "y_c", "phi"), np.column_stack([log.angles, log.pose]).T, strict=True))}


def times(factor, *names):
    return lambda c: {**c, **{name: factor * c[name] for name in names}}


def swapped(*pairs):
    new = {**dict(pairs), **{b: a for a, b in pairs}}
    return lambda c: {**c, **{a: c[b] for a, b in new.items()}}


def only(change, *left_out):
    return lambda c: {name: each for name, each in change(c).items() if name not in left_out}


POSE, ANGLES, RATES = ("x_c", "y_c", "phi"), ("theta_r", "theta_l"), ("thetadot_r", "thetadot_l")
DEG, RPM = 180 / np.pi, 60 / (2 * np.pi)
BAD = {  # command, what happened to the log, what is said
    "right encoder": (measured, times(-1, "theta_r"), "--map theta_r=-theta_r"),
    "left encoder": (measured, times(-1, "theta_l"), "--map theta_l=-theta_l"),
    "encoders exchanged": (measured, swapped(ANGLES), "--map theta_r=theta_l --map theta_l=theta_r"),
    "heading clockwise": (measured, times(-1, "phi"), "--map phi=-phi"),
    "x and y exchanged": (measured, swapped(("x_c", "y_c")), "--map x_c=y_c --map y_c=x_c"),
    "x backwards": (measured, times(-1, "x_c"), "--map x_c=-x_c"),
    "heading in degrees": (measured, times(DEG, "phi"), "phi=phi [deg]"),
    "angles in degrees": (measured, times(DEG, *ANGLES), "--map 'theta_r=theta_r [deg]' --map 'theta_l=theta_l [deg]'"),
    "one angle in turns": (measured, times(1 / (2 * np.pi), "theta_l"), "theta_l=theta_l [turn]"),
    "place in mm": (measured, times(1000, "x_c", "y_c"), "--map 'x_c=x_c [mm]' --map 'y_c=y_c [mm]'"),
    "x in mm": (measured, times(1000, "x_c"), "x_c=x_c [mm]"),
    "a wheel backwards": (driven, times(-1, "theta_r", "thetadot_r"), "--map theta_r=-theta_r --map thetadot_r=-thetadot_r"),
    "wheels exchanged": (driven, swapped(ANGLES, RATES), "theta_r and theta_l exchanged and thetadot_r and thetadot_l exchanged"),
    "a rate backwards": (driven, times(-1, "thetadot_r"), "--map thetadot_r=-thetadot_r"),
    "rates exchanged": (driven, swapped(RATES), "--map thetadot_r=thetadot_l"),
    "rates in rpm": (driven, times(RPM, *RATES), "--map 'thetadot_r=thetadot_r [rpm]' --map 'thetadot_l=thetadot_l [rpm]'"),
    "rates in degrees": (driven, times(DEG, *RATES), "[deg/s]"),
    "time in ms": (driven, times(1000, "t"), "t in ms (--map 't=t [ms]')"),
    "right torque": (driven, only(times(-1, "tau_r"), *POSE, *ANGLES), "--map tau_r=-tau_r"),
    "left torque": (driven, times(-1, "tau_l"), "--map tau_l=-tau_l"),
    "both torques": (driven, times(-1, "tau_r", "tau_l"), "--map tau_r=-tau_r --map tau_l=-tau_l"),
    "torques exchanged": (driven, swapped(("tau_r", "tau_l")), "--map tau_r=tau_l --map tau_l=tau_r"),
    "a rate backwards, alone": (driven, only(times(-1, "thetadot_l"), *POSE, *ANGLES), "--map thetadot_l=-thetadot_l"),
}


@pytest.fixture
def write(tmp_path):
    def write(columns) -> str:
        with (tmp_path / "log.csv").open("w", newline="") as stream:
            csv.writer(stream).writerows(
                [list(columns), *zip(*([repr(float(e)) for e in c] for c in columns.values()), strict=True)]
            )
        return str(tmp_path / "log.csv")

    return write


def arguments(log) -> list[str]:
    return ["calibrate", "--robot", "labmate"] if log is measured else ["identify", "--robot", "labmate", *DRIVE]


@pytest.mark.parametrize("case", BAD)
def test_it_is_found_which_column_is_wrong(case, write, bad_input):
    log, change, message = BAD[case]
    said = bad_input([*arguments(log), write(change(log()))])
    assert message in said
    print(said)


def test_the_remedy_is_one(write, capsys):
    """What is advised gives the result of the right log."""
    for log, change, options in (
        (driven, times(-1, "tau_l"), ["--map", "tau_l=-tau_l"]),
        (measured, times(DEG, "phi"), ["--map", "phi=phi [deg]"]),
    ):
        assert main([*arguments(log), write(log())]) == 0
        right = capsys.readouterr().out
        assert main([*arguments(log), write(change(log())), *options]) == 0
        assert capsys.readouterr().out.splitlines()[1:4] == right.splitlines()[1:4]


@pytest.mark.parametrize("spec", ["turntable_ball", "tractor_trailer"])
def test_right_logs_of_other_robots_are_not_refused(spec, write):
    """Robots on a moving surface and with joints: what `noslip simulate` writes agrees with itself within 1 %."""
    run = simulate(read_spec(str(Path(noslip.__file__).parent / f"specs/robots/{spec}.toml")), "c")
    system = run.law.system
    columns = dict(zip((q.name for q in system.state), run.x.T, strict=True))
    values = [float(value) for value in run.plant.parameters]
    motion = _Motion(system, values, list(columns), [])
    assert len(motion.compared) == len(system.mechanism.coordinates)
    assert motion.misfit({"t": run.t, **columns}, [range(len(run.t))]) < 0.01


def test_right_logs_of_other_numbers_are_not_refused(write, capsys):
    """Masses twice and lengths a third off are what is looked for, not a wrong sign."""
    assert main(["calibrate", "--robot", "labmate", write(measured()), "--set", "r=0.1"]) == 0
    assert main(["identify", "--robot", "labmate", *DRIVE[:3], "--set", "m_w=4", write(driven())]) in (0, 1)
    assert Path(write(driven())).exists() and capsys.readouterr().out
