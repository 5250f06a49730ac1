"""docs/agv.md: its commands, one after the other, give a SPEC, a run,
margins and firmware that drives the vehicle."""

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
LINES = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.S) for line in block.splitlines()]
COMMANDS = [line for line in LINES if re.match("noslip|make -C|cmp", line)]
(OPTIONS,) = re.findall(r"`noslip new truck.toml (--kind tricycle counts=\d+)`", PAGE)
OF_A_TRUCK = [f"noslip new truck.toml {OPTIONS}", *(line.replace("agv", "truck") for line in COMMANDS[1:])]
VEHICLES = {
    "agv": COMMANDS,
    "tricycle": OF_A_TRUCK,
    "car": [line.replace("tricycle", "car") for line in OF_A_TRUCK],
}
TARGET = "cortex-m4f" if not FIRMWARE["cortex-m4f"].missing("make") else "generic"


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_the_commands(vehicle, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    commands = [shlex.split(line) for line in VEHICLES[vehicle]]
    assert [command[1] for command in commands[:-1]] == [
        "new",
        "simulate",
        "outer-loop",
        "export",
        "-C",
        "simulate",
    ]
    for command in commands:
        if command[0] == "noslip":
            argv = [TARGET if word == "cortex-m4f" else word for word in command[1:]]
            assert main([*argv, *(["--json"] if argv[0] == "outer-loop" else [])]) == 0, command
        else:
            done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
            assert done.returncode == 0 and (command[0] == "cmp" or "selftest: pass" in done.stdout), command
    printed = capsys.readouterr().out
    margins = json.loads(printed[printed.index("{") : printed.rindex("}") + 1])
    assert set(margins["channels"]) == {"distance", "speed"}
    (picture,) = tmp_path.glob("*.png")
    assert picture.stat().st_size > 10_000
    with (tmp_path / commands[-1][-1]).open() as file:
        *_, last = csv.DictReader(file)
    # It stands on the last segment
    assert last["status"] == "ok" and last["piece"] == "2" and abs(float(last["y2"])) < 0.01


def test_its_velocity_drives(tmp_path):
    (drive,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
    assert main(["new", str(tmp_path / "agv.toml")]) == 0
    text = (tmp_path / "agv.toml").read_text()
    limits = re.search(r"\[limits\]\n.*?\n\n", text, re.S)
    spec = spec_of(text.replace(limits[0], f"{drive}\n"), "agv.toml")
    assert spec.drive.takes_velocity and spec.limits is None
    with pytest.raises(BadInput, match="bandwidth"):
        spec_of(text.replace(limits[0], drive.replace("bandwidth", "# ") + "\n"), "agv.toml")
