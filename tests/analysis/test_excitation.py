"""Manoeuvres that show parameters: within room and grip, and as telling as was said."""

import math
from pathlib import Path

import numpy as np
import pytest
from noslip.analysis.identification.dynamics import Dynamics
from noslip.analysis.identification.excitation import parameters_of_motion
from noslip.analysis.identification.fit import identify, predicted
from noslip.analysis.identification.log import Log
from noslip.cli.main import main
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.run import Run
from noslip.simulation.specification.spec import read_spec, read_text, toml_table
from noslip.simulation.specification.vary import spec_text

SPECS = sorted((Path(__file__).resolve().parents[2] / "examples/specs").rglob("*.toml"))
NOISE, ROOM = 0.02, 5.0  # rad/s, m


@pytest.fixture(scope="module")
def eight(tmp_path_factory) -> Run:
    file = tmp_path_factory.mktemp("excite") / "eight.toml"
    assert (
        main(
            [
                "excite",
                "line",
                "--fit",
                "m_c",
                "I_c",
                "--room",
                f"{ROOM}",
                "--speed",
                "2",
                "--noise",
                f"{NOISE}",
                "-o",
                str(file),
            ]
        )
        == 0
    )
    return simulate(read_spec(file))


def log_of(run: Run, noise: float = 0.0, seed: int = 0) -> Log:
    nu = run.nu + noise * np.random.default_rng(seed).normal(size=run.nu.shape)
    return Log(run.t, np.hstack([run.q, nu]), run.tau, (range(len(run.t)),), ())


def expected(run: Run) -> dict[str, float]:
    dynamics = Dynamics.of(run.law.system)
    values = dynamics.values(
        {p.name: v for p, v in zip(run.law.parameters, run.plant.parameters, strict=True)}
    )
    fit = predicted(log_of(run), dynamics, ["m_c", "I_c"], values, True)
    return fit.expected_deviations(np.full(2, NOISE))


@pytest.mark.nightly
def test_it_stays_in_the_room_and_rolls(eight):
    assert set(eight.status) == {"ok"} and np.ptp(eight.q[:, :2], axis=0).max() <= ROOM
    assert max(use.max() for use in eight.use.values()) <= 0.95


@pytest.mark.nightly
def test_the_log_tells_as_much_as_was_said(eight):
    values = {p.name: v for p, v in zip(eight.law.parameters, eight.plant.parameters, strict=True)}
    stated, off = expected(eight), []
    for seed in range(8):
        estimates = identify(
            log_of(eight, NOISE, seed), Dynamics.of(eight.law.system), list(stated), values, True
        ).estimates
        off.append([(estimates[name].value - values[name]) / sd for name, sd in stated.items()])
    # four fifths of the windows are fitted, the rest validates: sqrt(1.25) times the deviation with all of
    # them
    assert 0.6 < np.std(off) / math.sqrt(1.25) < 1.5
    line = expected(simulate(read_spec("line")))
    assert stated["I_c"] < line["I_c"] / 3


def test_the_parameters_that_the_dynamics_determine():
    """By hand: m_c, I_c and m_w, which stands for m_w + I_w/r^2;
    I_m is seen with I_c only. Lengths are for calibration."""
    dynamics = Dynamics.of(system_of(find_robot("labmate")))
    assert set(parameters_of_motion(dynamics, dynamics.values({"r": 0.15}).tolist())) == {"m_c", "I_c", "m_w"}


@pytest.mark.parametrize("file", SPECS, ids=[file.stem for file in SPECS])
def test_a_spec_is_written_as_it_is_read(file):
    table = toml_table(read_text(file))
    assert toml_table(spec_text(table)) == table


@pytest.mark.parametrize(
    "options, message",
    [
        (["line", "--fit", "m_c", "m_w", "I_w"], "would not show I_w"),
        (["line", "--fit", "mass"], "--fit mass: not a parameter of this robot"),
        (["line", "--room", "0"], "--room = 0 must be positive"),
        (["line", "--speed", "-1"], "--speed = -1 must be positive"),
        (["line", "--noise", "nan"], "--noise = nan is not finite"),
        (["figures/figure_1_type_i", "--room", "5"], "excite needs"),
        (["figures/fastest"], "excite needs --speed"),
    ],
)
def test_refused(options, message, tmp_path, bad_input):
    spec, *rest = options
    file = next((str(each) for each in SPECS if str(each).endswith(f"{spec}.toml") and "/" in spec), spec)
    assert message in bad_input(["excite", file, *rest, "-o", str(tmp_path / "made.toml")])
    assert not list(tmp_path.iterdir())
