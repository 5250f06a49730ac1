"""docs/agv.md: its commands, one after the other, give a SPEC, a run, margins and firmware that drives the vehicle."""

import csv
import json
import re
import shlex
import subprocess
from pathlib import Path

import noslip
import pytest
from noslip.checks.verification.project import FIRMWARE
from noslip.cli.main import main
from noslip.readers.errors import BadInput
from noslip.simulation.specification.spec import spec_of

PAGE = (Path(noslip.__file__).parent / "docs/agv.md").read_text()
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S) for line in block.splitlines()]
(OPTIONS,) = re.findall(r"`noslip new truck.toml (--kind tricycle counts=\d+)`", PAGE)
OF_A_TRUCK = [f"noslip new truck.toml {OPTIONS}", *(line.replace("agv", "truck") for line in COMMANDS[1:5])]
VEHICLES = {"agv": COMMANDS[:5], "tricycle": OF_A_TRUCK, "car": [line.replace("tricycle", "car") for line in OF_A_TRUCK]}
TARGET = "cortex-m4f" if not FIRMWARE["cortex-m4f"].missing("make") else "generic"


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_the_commands(vehicle, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    commands = VEHICLES[vehicle]
    assert [shlex.split(line)[1] for line in commands] == ["new", "simulate", "outer-loop", "export", "-C"]
    for line in commands[:-1]:
        argv = [TARGET if word == "cortex-m4f" else word for word in shlex.split(line)[1:]]
        assert main([*argv, *(["--json"] if argv[0] == "outer-loop" else [])]) == 0, line
    printed = capsys.readouterr().out
    margins = json.loads(printed[printed.index("{") : printed.rindex("}") + 1])
    assert set(margins["channels"]) == {"distance", "speed"}
    (picture,) = tmp_path.glob("*.png")
    assert picture.stat().st_size > 10_000
    done = subprocess.run(shlex.split(commands[-1]), capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0 and "selftest: pass" in done.stdout
    with (tmp_path / shlex.split(commands[-1])[2] / "build/run.csv").open() as file:
        *_, last = csv.DictReader(file)
    assert last["status"] == "ok" and last["piece"] == "2" and abs(float(last["y2"])) < 0.01  # it stands on the last segment


def test_its_velocity_drives(tmp_path):
    (drive,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
    assert main(["new", str(tmp_path / "agv.toml")]) == 0
    text = (tmp_path / "agv.toml").read_text()
    limits = re.search(r"\[limits\]\n.*?\n\n", text, re.S)
    spec = spec_of(text.replace(limits[0], f"{drive}\n"), "agv.toml")
    assert spec.drive.takes_velocity and spec.limits is None
    with pytest.raises(BadInput, match="bandwidth"):
        spec_of(text.replace(limits[0], drive.replace("bandwidth", "# ") + "\n"), "agv.toml")
