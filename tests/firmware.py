"""`make firmware-test`: what runs on the targets, in QEMU, against this host.

The bits of every law; closed loops with the controller on the target; the loop of firmware/; how a program
that fails is seen. Prints a line for each; the last one sums up. Exit 1 where something is wrong. A tool that
is not there: what needs it is skipped, and said so; with NOSLIP_REQUIRE_FIRMWARE=1 that is wrong.
"""

import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from noslip.codegen.targets import STANDARD, TABLE
from noslip.readers.errors import BadInput
from noslip.readers.reading import section
from noslip.simulation.closed_loop import simulate
from noslip.simulation.controllers.controller import ON_TARGET
from noslip.simulation.controllers.pil import recorded, replay_session
from noslip.simulation.controllers.targets import CONSOLE, TARGETS, Target, required
from noslip.simulation.loop import make_loop
from noslip.simulation.replay import Record, first_difference
from noslip.simulation.specification.spec import (
    ApproachSection,
    ContactSection,
    LimitsSection,
    Spec,
    read_spec,
)
from noslip.tests.runtime_c.test_bits import TIMEOUT, table, targeted

ROOT = Path(__file__).resolve().parent.parent
DEMOS = ("cortex-m4f", "cortex-m7", "netduinoplus2", "rv32imafc", "rv32imac")  # of firmware/Makefile

# Forward, into a cusp, in reverse and forward again, led by what encoders count, with noise, corrections,
# limits, an integral and an approach.
COMPOSITE = """
robot = "labmate"
gains = { kp = 4.0, kd = 5.0, kv = 2.0, ki_distance = 1.0 }
plant = { m_c = 40.0 }
reference = { speed = 1.0, deceleration = 0.5, approach = { acceleration = 0.8 } }
limits = { torque = [15.0], mode = "slow", integral = [0.5] }
sensors = { noise = { sd = [0.01] }, seed = 3, counts = 4096 }
correction = { rate = 2.0, mode = "bumpless" }
simulation = { duration = 14.0, period = 0.01 }
[output]
type = "IV"
L = 0.2
reversing = "switch"
[output.path]
kind = "reeds_shepp"
from = [0.0, 0.0, 0.0]
to = [0.0, 3.0, 0.0]
radius = 1.5
stop = "axle"
"""


def runs() -> dict[str, Spec]:
    """Closed loops by name, the controller called every 10 ms."""
    specs = {name: read_spec(ROOT / "examples/specs" / f"{name}.toml") for name in ("line", "circle")}
    called = {
        name: replace(spec, simulation=replace(spec.simulation, period=0.01)) for name, spec in specs.items()
    }
    gripped = {"contact": ContactSection(mu=0.4, height=0.1), "limits": LimitsSection(mode="grip")}
    approach = replace(called["line"].reference, approach=ApproachSection(acceleration=0.4))
    called["grip"] = replace(called["line"], reference=approach, **gripped)
    return called | {"composite": section(Spec)(tomllib.loads(COMPOSITE), "")}


class Report:
    """Counts what is right, wrong and skipped."""

    def __init__(self):
        self.right, self.wrong, self.skipped = 0, 0, 0

    def take(self, title: str, check: Callable[[], str], missing: list[str]) -> None:
        """Prints what a check finds. It raises AssertionError or BadInput where something is wrong."""
        if missing:
            self.skipped, self.wrong = self.skipped + 1, self.wrong + required()
            print(f"{title}: skipped: {', '.join(missing)} not installed", flush=True)
            return
        try:
            said = check()
            self.right += 1
        except (AssertionError, BadInput, subprocess.TimeoutExpired) as error:
            said = f"WRONG: {error}"
            self.wrong += 1
        print(f"{title}: {said}", flush=True)


def loop_on(backend: str, spec: Spec, here: str) -> str:
    """The run on a target against the table of the one on this host, byte for byte,
    and its record replayed on the host."""
    law = make_loop(spec).law
    with recorded(law, backend) as calls:
        run = simulate(spec, backend)
    assert run.csv() == here, "differs from the host's run"
    with closing(replay_session(law, "cf")) as host:
        difference = first_difference(Record(law, calls, range(len(calls))), host, "cf")
    assert difference is None, difference
    return (
        f"{len(run.t)} rows to t = {run.t[-1]:g} s as on the host, byte for byte; {len(calls)} calls "
        "replayed there, same bits"
    )


PROGRAMS = {  # main -> exit code
    "return 0;": 0,
    "return 3;": 3,
    "__builtin_trap();": 255,
}


def exit_codes(target: Target) -> str:
    """Programs that end well, end badly, and do not end as they should."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for name, text in target.files().items():
            Path(folder, name).write_text(text, encoding="utf-8")
        for body, wanted in PROGRAMS.items():
            Path(folder, "main.c").write_text(f"int main(void)\n{{\n    {body}\n}}\n", encoding="utf-8")
            build = [
                *target.compile(),
                *STANDARD,
                "-O2",
                "-I.",
                *target.start,
                "main.c",
                *target.link(),
                "-o",
                "image",
            ]
            subprocess.run(build, cwd=folder, check=True, timeout=TIMEOUT)
            run = subprocess.run(
                target.run("image", *CONSOLE),
                cwd=folder,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=TIMEOUT,
            )
            assert run.returncode == wanted, f"{body} ends with {run.returncode}, not {wanted}"
            found.append(str(wanted))
    return "exit codes " + ", ".join(found)


def demo(target: str) -> str:
    """The loop of firmware/ drives its vehicle to the end."""
    run = subprocess.run(
        ["make", "-C", str(ROOT / "firmware"), "--no-print-directory", "-s", "run", f"TARGET={target}"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
    )
    lines = (run.stdout + run.stderr).splitlines()
    assert run.returncode == 0, next((line for line in lines if "error" in line), lines[-1])
    return lines[-1]


def checks() -> Iterator[tuple[str, Callable[[], str], list[str]]]:
    """Title, check, and which tools are missing for it."""
    for name, spec in runs().items():
        here = simulate(spec, "cf").csv()
        for backend, target in ON_TARGET.items():
            yield (
                f"loop {name}, backend {backend}",
                lambda backend=backend, spec=spec, here=here: loop_on(backend, spec, here),
                TARGETS[target].missing(),
            )
    for target in TARGETS.values():
        if target.machine:
            yield f"programs on {target.name}", lambda target=target: exit_codes(target), target.missing()
    for name in DEMOS:
        processor = TARGETS[TABLE["target"][name].get("processor", name)]
        yield f"firmware on {name}", lambda name=name: demo(name), processor.missing("make")


def main() -> int:
    """All of it."""
    report, every = Report(), targeted()
    report.wrong, report.skipped = table(every)
    report.right = len(every) - report.wrong - report.skipped
    for check in checks():
        report.take(*check)
    print(f"firmware-test: {report.right} right, {report.wrong} wrong, {report.skipped} skipped")
    return int(report.wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
