"""`noslip new`: the SPEC has the numbers that were given, says which nobody gave, and is one of a run."""

import io
import math
import tomllib

import pytest
from noslip.cli.main import main
from noslip.cli.robot.new import KINDS
from noslip.simulation.closed_loop import simulate
from noslip.simulation.specification.spec import read_spec
from noslip.simulation.specification.vary import read_varied


class Terminal(io.StringIO):
    """What is typed at a terminal."""

    def isatty(self) -> bool:
        return True


def test_the_numbers_are_those_given(tmp_path, capsys):
    file = tmp_path / "agv.toml"
    given = [
        "track=62cm",
        "wheel_radius=0.097",
        "mass=48",
        "counts=2048",
        "torque=9",
        "period=8ms",
        "speed=0.7",
    ]
    assert main(["new", str(file), "--kind", "differential", *given]) == 0
    assert "noslip simulate" in capsys.readouterr().out
    spec, text = tomllib.loads(file.read_text()), file.read_text()
    p = spec["parameters"]
    assert (
        p["b"] == pytest.approx(0.31)
        and p["r"] == 0.097
        and p["m_c"] + 2 * p["m_w"] == pytest.approx(48.0, rel=1e-4)
    )
    # A uniform box of 0.8 m by 0.62 m, and wheels as discs; the SPEC has 6 digits.
    assert p["I_c"] == pytest.approx(p["m_c"] * (0.8**2 + 0.62**2) / 12, rel=1e-4)
    assert p["I_w"] == pytest.approx(p["m_w"] * 0.097**2 / 2, rel=1e-4)
    assert (
        spec["sensors"]["counts"] == 2048
        and spec["limits"]["torque"] == 9
        and spec["simulation"]["period"] == 0.008
    )
    lines = {line.split(" = ")[0]: line for line in text.splitlines() if " = " in line}
    assert (
        "assumed" not in lines["b"] + lines["r"] + lines["speed"]
        and "assumed" in lines["d"]
        and "assumed" in lines["deceleration"]
    )
    assert text.count("#") > 20


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_arrives_and_keeps_to_the_path(kind, tmp_path):
    assert main(["new", str(tmp_path / "new.toml"), "--kind", kind]) == 0
    run = simulate(read_varied(tmp_path / "new.toml", {"sensors.pose": "true"}))
    assert run.stopped is None and abs(run.error[-1, 0]) < 2e-3
    # Half a count of the steering angle, which is always below it, turns a car by 2.6 mrad in 36 m.
    assert abs(simulate(read_spec(tmp_path / "new.toml")).error[-1, 0]) < 0.2
    assert abs(run.nu[-1]).max() < 0.05 * abs(run.nu).max()
    acceleration = run.spec.reference.speed * run.spec.gains["kv"]
    assert acceleration <= 1.0 + 1e-2  # from rest; kv has three decimals
    bend = max(abs(segment.curvature) for segment in run.spec.output.segments)
    assert run.spec.reference.speed**2 * bend <= 0.5 + 1e-2


def test_it_asks_at_a_terminal(tmp_path, monkeypatch):
    """For what is not given; an empty answer is the default."""
    file = tmp_path / "agv.toml"
    monkeypatch.setattr("sys.stdin", Terminal("tricycle\n1.3 m\n\n\n8192\n\n\n\n0.02\n\n"))
    assert main(["new", str(file), "mass=90"]) == 0
    spec = tomllib.loads(file.read_text())
    assert spec["robot"] == "tricycle" and spec["parameters"]["l"] == 1.3 and spec["parameters"]["m"] == 90.0
    assert spec["simulation"]["period"] == 0.02 and spec["sensors"]["counts"] == 8192
    monkeypatch.setattr("sys.stdin", Terminal("tricycle\n"))
    assert main(["new", str(tmp_path / "other.toml")]) == 2 and not (tmp_path / "other.toml").exists()


@pytest.mark.parametrize(
    "argv, says",
    [
        (["x.toml", "track=-1"], "track = -1: must be positive"),
        (["x.toml", "track=nan"], "track"),
        (["x.toml", "trak=1"], "did you mean 'track'"),
        (["x.toml", "track"], "KEY=VALUE"),
        (["x.toml", "track=1", "track=2"], "track has a number already"),
        (["x.toml", "counts=1.5"], "whole number"),
        (["x.toml", "mass=3s"], "in kg"),
        (["x.toml", "--kind", "car", "ahead=0.1"], "unknown number of a car vehicle"),
        (["x.csv"], "ends in .toml"),
        (["there.toml"], "exists"),
        (["absent/x.toml"], "absent"),
    ],
)
def test_bad_input(argv, says, bad_input, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("")
    assert says in bad_input(["new", *argv])


def test_the_labels_are_what_was_not_given(tmp_path):
    """A number given with the value of its default is not assumed."""
    main(["new", str(tmp_path / "a.toml"), f"ahead={KINDS['differential']['ahead'].default}"])
    line = next(line for line in (tmp_path / "a.toml").read_text().splitlines() if line.startswith("d = "))
    assert "assumed" not in line and math.isclose(float(line.split()[2]), 0.05)
