"""`make nightly`: everything that there are tools for, step by step on all cores, and a page of what came of
it.

    python -m noslip.tests.nightly_run [--steps REGEX] [-o DIR]

A step is a command in a process of its own; it passes with exit code 0. The longest steps begin first, as
many at a time as there are cores; a step that fails does not stop the others. What a step printed is in
DIR/night/NAME.log. The results are kept with the content of the tree: a night that was stopped goes on with
the steps that have not passed yet, and a changed tree starts anew. DIR/nightly.json and DIR/nightly.html say
what ran, what was skipped and why, and the numbers that README and guarantees rest on. Exit code 1 if a step
failed.
"""

from __future__ import annotations

import argparse
import hashlib
import html
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from noslip.checks.guarantees.__main__ import CHECKS
from noslip.tests.mutation import LEAST, SOURCES, files_of
from noslip.tests.processors import choices, lacking
from noslip.tests.tools import collected, path_of

ROOT = Path(__file__).resolve().parent.parent
LONGEST = 3600  # s: a step that takes longer is ended, and has failed
PYTEST = (sys.executable, "-P", "-m", "pytest")
PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
# Long steps, in s of one core, where no night has measured them yet; of the others it is assumed that they
# take 30 s.
ABOUT = {
    "guarantees eva": 400,
    "guarantees others": 300,
    "figures": 120,
    "bench": 120,
    "films": 120,
    "bits": 600,
    "firmware-test": 300,
    "night test_floor_figures": 600,
    "night test_processors": 450,
    "night test_mutated": 250,
    "night test_calibration": 350,
    "night test_package": 400,
    "night test_identification": 250,
    "night test_dialects": 350,
    "night test_identify_motors": 300,
    "night test_random_robots": 350,
    "night test_safety": 500,
    "night test_guarantees": 600,
    "night test_broken_logs": 500,
    "night test_battery": 250,
}
PIECE = 900  # s: the tests of a file that takes longer are dealt into several steps
PART = re.compile(r" \d+ of \d+$")  # in the name of such a step
# Of mutation: not the seed that tests were written for; mutants for each
SEEDS, OF_C, OF_CODEGEN = ("39", "1936"), "4", "2"
# Files whose tests integrate, linearize and plan: they pass with the kernels of other processors too.
NUMERICAL = "guidance simulate outer_loop outer_design planning integral analyse shape redundancy".split()
SHORT = re.compile(r"::test_(guarantee|bits)\[")  # short versions of the guarantees and of `make bits`
COMPILES = re.compile(r'HOST_CC|COMPILERS|"gcc"')  # in a test file: its tests run a compiler of this host
# Than gcc
OTHER_TOOLS = re.compile(r"clang|lld|ld\.lld|llvm|arm-none|riscv|qemu|cppcheck|frama|cbmc|chromium|node|emcc")


@dataclass(frozen=True)
class Step:
    """A command with its environment, the cores that it uses, and why it is skipped, if it is."""

    name: str
    command: Sequence[str]
    environment: Mapping[str, str] = field(default_factory=dict)
    cores: int = 1
    lacking: str = ""


@dataclass
class Result:
    """What became of a step. `seconds`: its part of the night, its duration times the part of the cores that
    it uses, so that those of all steps add up to the night. `reason`: why it failed or was skipped.
    """

    name: str
    status: str
    seconds: float = 0.0
    reason: str = ""


# -- the steps -----------------------------------------------------------------------------------------------


def steps(folder: Path) -> list[Step]:
    """Return all steps of a night whose files are in a folder."""
    make, python = ["make", "--no-print-directory"], sys.executable

    def target(name: str, *options: str, cores: int = 1) -> Step:
        return Step(name, [*make, name, *options], cores=cores)

    # The tests of the day, by which the margins are measured.
    found = [target("margins", cores=os.cpu_count() or 1)]
    found += [
        target("lint"),
        target("types"),
        target("check-generated"),
        target("bits"),
        target("firmware-test"),
    ]
    found += [target("figures", cores=os.cpu_count() or 1), target("films")]
    found += [
        Step("bench", [python, str(ROOT / "checks/bench/run.py"), "--quick", "-o", str(folder / "bench")])
    ]
    found += [Step(name, _pytest(folder, name, "-m", "nightly", *tests)) for name, tests in _of_the_night()]
    for choice, environment in choices().items():
        command = _pytest(folder, f"kernels {choice}", *(f"test_{name}" for name in NUMERICAL))
        if environment:  # the margins have the kernels of this processor
            found.append(Step(f"kernels {choice}", command, environment, lacking=lacking(choice)))
    alone = [
        path.stem for path in sorted(ROOT.glob("tests/*/test_*.py")) if COMPILES.search(path.read_text())
    ]
    absent = "" if shutil.which("gcc") else "gcc is not installed"
    found.append(
        Step("gcc alone", _pytest(folder, "gcc alone", *alone), {"PATH": str(folder / "gcc")}, lacking=absent)
    )
    others = [name for name in CHECKS if name not in ("eva", "fuzz")]
    for name, checks in {"eva": ["eva"], "fuzz": ["fuzz"], "others": others}.items():
        command = [python, "-m", "noslip.checks.guarantees", *checks, "-o", str(folder / "guarantees" / name)]
        at_once = 1 if name == "fuzz" else 2  # as `tools.each` runs them
        found.append(Step(f"guarantees {name}", command, cores=at_once))
    for path in SOURCES:
        sample = OF_CODEGEN if path.startswith("codegen") else OF_C
        options = ["--jobs", "1", "--seed", *SEEDS, "--sample", sample, "--least", "0"]
        name = f"mutation {path}"
        command = [
            python,
            "-m",
            "noslip.tests.mutation",
            path,
            *options,
            "--json",
            str(_file(folder, name, "json")),
        ]
        found.append(Step(name, command))
    return found


def _pytest(folder: Path, name: str, *arguments: str) -> list[str]:
    """Return the command of a step that runs tests, of files named without their ending."""
    named = [path_of(argument) if argument.startswith("test_") else argument for argument in arguments]
    return [*PYTEST, "-n", "0", f"--junitxml={_file(folder, name, 'xml')}", *named]


def _of_the_night() -> Iterator[tuple[str, list[str]]]:
    """Yield the names of the steps that run what is left to the night, and their tests: a file each, or a
    part of one. Left out are short versions of what other steps run whole.
    """
    tests = [test for test in collected("nightly", "tests") if not SHORT.search(test)]
    for file in sorted({re.split(r"[/.]", test)[2] for test in tests}):
        own, name = [test for test in tests if f"/{file}.py::" in test], f"night {file}"
        count = min(len(own), math.ceil(ABOUT.get(name, 1) / PIECE))
        for k in range(count):
            yield (name if count == 1 else f"{name} {k + 1} of {count}"), own[k::count]


def _only_gcc(folder: Path) -> None:
    """Make a folder with links to all commands of this machine but compilers and tools other than gcc."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for place in map(Path, os.environ["PATH"].split(os.pathsep)):
        for path in place.iterdir() if place.is_dir() else ():
            if not OTHER_TOOLS.match(path.name) and not (folder / path.name).is_symlink():
                (folder / path.name).symlink_to(path)


def _file(folder: Path, name: str, kind: str) -> Path:
    """Return the file of a step."""
    return folder / f"{re.sub(r'[^A-Za-z0-9_.-]+', '-', name)}.{kind}"


# -- running them --------------------------------------------------------------------------------------------


class Night:
    """The results so far, in a folder; those of another content of the tree are not taken over,
    but for their duration."""

    def __init__(self, folder: Path, tree: str):
        self.folder, self.tree, self.results = folder, tree, dict[str, Result]()
        folder.mkdir(parents=True, exist_ok=True)
        kept = json.loads((folder / "results.json").read_text()) if (folder / "results.json").exists() else {}
        self.seconds: dict[str, float] = kept.get("seconds", {})
        if kept.get("tree") == tree:
            self.results = {each["name"]: Result(**each) for each in kept["steps"]}

    def run(self, chosen: Sequence[Step], cores: int) -> list[Result]:
        """Run the steps that have not passed, the longest first, and return the results of all,
        in the order of the steps."""
        waiting = [step for step in chosen if self._outstanding(step)]
        waiting.sort(key=lambda step: (-min(step.cores, cores), -self._expected(step)))
        running: dict[Running, int] = {}
        try:
            while waiting or running:
                free = cores - sum(running.values())
                step = next((step for step in waiting if min(step.cores, cores) <= free), None)
                if step is not None:
                    waiting.remove(step)
                    running[Running(step, _file(self.folder, step.name, "log"))] = min(step.cores, cores)
                    continue
                time.sleep(0.05)
                for one in [one for one in running if one.ended()]:
                    result = one.result()
                    result.seconds *= running.pop(one) / cores
                    self._keep(result)
        finally:
            for one in running:
                one.stop()
        return [self.results[step.name] for step in chosen]

    def _outstanding(self, step: Step) -> bool:
        """Is a step still to be run? One that lacks something is skipped."""
        if step.lacking:
            self.results[step.name] = Result(step.name, SKIPPED, reason=step.lacking)
        before = self.results.get(step.name)
        return not step.lacking and (before is None or before.status != PASSED)

    def _expected(self, step: Step) -> float:
        whole = PART.sub("", step.name)
        return self.seconds.get(step.name, ABOUT.get(whole, 30.0) if whole == step.name else PIECE)

    def _keep(self, result: Result) -> None:
        print(f"{result.status:8}{result.name}  [{result.seconds:.0f} s]  {result.reason}", flush=True)
        self.results[result.name] = result
        self.seconds[result.name] = result.seconds
        kept = {
            "tree": self.tree,
            "seconds": self.seconds,
            "steps": [asdict(each) for each in self.results.values()],
        }
        write(self.folder / "results.json", json.dumps(kept, indent=1))


class Running:
    """A step that runs, in a process group of its own."""

    def __init__(self, step: Step, log: Path):
        self.step, self.log, self.began = step, log, time.monotonic()
        for kind in (".xml", ".json"):
            log.with_suffix(kind).unlink(missing_ok=True)
        with log.open("w") as printed:
            environment = {**os.environ, **step.environment}
            self.process = subprocess.Popen(
                step.command,
                cwd=ROOT,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=printed,
                stderr=printed,
                start_new_session=True,
            )

    def ended(self) -> bool:
        """Has it ended? One that takes too long is ended."""
        if time.monotonic() - self.began > LONGEST:
            self.stop()
        return self.process.poll() is not None

    def stop(self) -> None:
        """End it with all that it has started."""
        try:
            os.killpg(self.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self.process.wait()

    def result(self) -> Result:
        """Return what became of it."""
        seconds, code, printed = (
            time.monotonic() - self.began,
            self.process.returncode,
            self.log.read_text(errors="replace"),
        )
        if seconds > LONGEST:
            return Result(self.step.name, FAILED, seconds, f"took longer than {LONGEST} s")
        if code == 0:
            absent = re.findall(r"^(\S+) +skipped +(.+?)  \[", printed, re.M)  # of guarantees, one line each
            whole = absent and not re.search(r"^\S+ +holds ", printed, re.M)
            reason = "; ".join(f"{name} skipped: {why}" for name, why in absent)
            return Result(self.step.name, SKIPPED if whole else PASSED, seconds, reason)
        lines = [line.strip() for line in printed.splitlines() if line.strip()]
        telling = [line for line in lines if re.match(r"FAILED|ERROR|\S+ +FAILED|make.*Error", line)]
        return Result(
            self.step.name, FAILED, seconds, f"exit {code}: {'; '.join((telling or lines)[-3:])[:300]}"
        )


def content(root: Path = ROOT) -> str:
    """Return a digest of all files of a tree that git has or would take."""
    digest = hashlib.sha256()
    for name in files_of(root):
        digest.update(name.encode() + b"\0" + hashlib.sha256((root / name).read_bytes()).digest())
    return digest.hexdigest()


def write(path: Path, text: str) -> None:
    """Write a file as a whole or not at all."""
    path.with_suffix(".new").write_text(text)
    path.with_suffix(".new").replace(path)


# -- what they found -----------------------------------------------------------------------------------------


def report(folder: Path, results: Sequence[Result], tree: str) -> dict:
    """Return what the page says, from the results of the steps and the files that they wrote."""
    tests = list(_tests(folder, results))
    by_file = _mutation(folder, results)
    totals = {
        kind: sum(counts[kind] for counts in by_file.values())
        for kind in ("killed", "equivalent", "survived")
    }
    judged = [*results, *_scores(by_file)]
    margins = (
        json.loads((ROOT / "build/margins.json").read_text())
        if (ROOT / "build/margins.json").exists()
        else {}
    )
    needed = [(part, test, place) for test, places in margins.items() for place, part in places.items()]
    return {
        "tree": tree,
        "steps": [asdict(result) for result in judged],
        "mutation": {**totals, "files": by_file},
        "eva": _lines(folder, "guarantees eva", r"^eva .*"),
        "digests": _lines(folder, "bits", r"^\S.*\b[0-9a-f]{8,}.*"),
        "margins": [
            {"part": part, "test": test, "place": place}
            for part, test, place in sorted(needed, reverse=True)[:20]
        ],
        "slowest": [
            {"test": name, "seconds": seconds} for seconds, name, _, _ in sorted(tests, reverse=True)[:30]
        ],
        "failures": [{"test": name, "says": says} for _, name, end, says in tests if end == "failure"],
        "skipped": [{"test": name, "reason": says} for _, name, end, says in tests if end == "skipped"],
    }


def _tests(folder: Path, results: Iterable[Result]) -> Iterator[tuple[float, str, str, str]]:
    """Yield of each test of the steps its duration (s), its name, how it ended ("",
    "failure" or "skipped"), and why so."""
    for result in results:
        file = _file(folder, result.name, "xml")
        for case in ElementTree.parse(file).iter("testcase") if file.exists() and result.seconds else ():
            ends = [
                (("skipped" if each.tag == "skipped" else "failure"), each.get("message", ""))
                for each in case
                if each.tag in ("failure", "error", "skipped")
            ]
            end, says = ends[0] if ends else ("", "")
            yield float(case.get("time", 0)), f"{case.get('classname')}::{case.get('name')}", end, says[:300]


def _mutation(folder: Path, results: Iterable[Result]) -> dict[str, dict[str, int]]:
    """Return by source how many mutants were killed, were equivalent, and survived, with all seeds."""
    counted: dict[str, dict[str, int]] = {}
    for result in results:
        file = _file(folder, result.name, "json")
        if result.name.startswith("mutation") and result.status == PASSED and file.exists():
            for path, counts in json.loads(file.read_text())["files"].items():
                known = counted.setdefault(path, dict.fromkeys(counts, 0))
                known.update({kind: known[kind] + count for kind, count in counts.items()})
    return counted


def _scores(by_file: Mapping[str, Mapping[str, int]]) -> Iterator[Result]:
    """Yield, as steps, whether enough mutants of C and of codegen were killed."""
    for words, of_codegen in (("C", False), ("codegen", True)):
        some = [counts for path, counts in by_file.items() if path.startswith("codegen") == of_codegen]
        killed = sum(counts["killed"] for counts in some)
        total = killed + sum(counts["survived"] for counts in some)
        says = f"{killed} of {total} mutants of {words} killed; {LEAST:.0%} are asked"
        if total:
            yield Result(
                f"mutation score of {words}", PASSED if killed >= LEAST * total else FAILED, 0.0, says
            )


def _lines(folder: Path, name: str, pattern: str) -> list[str]:
    """Return lines of what a step printed."""
    log = _file(folder, name, "log")
    return (
        [line.rstrip() for line in re.findall(pattern, log.read_text(errors="replace"), re.M)]
        if log.exists()
        else []
    )


STYLE = """
body { font: 15px sans-serif; margin: 2em; max-width: 75em } table { border-collapse: collapse } pre {
    font-size: 12px }
td, th { padding: 2px 9px; text-align: left; vertical-align: top; border-bottom: 1px solid #ddd }
.failed { color: #b00020; font-weight: bold } .skipped { color: #777 }
"""


def page(found: Mapping) -> str:
    """Return the page of a night in HTML."""
    ends = [step["status"] for step in found["steps"]]
    minutes = sum(step["seconds"] for step in found["steps"]) / 60
    counts = ", ".join(f"{ends.count(end)} {end}" for end in (PASSED, FAILED, SKIPPED))
    order = (FAILED, SKIPPED, PASSED)
    rows = sorted(found["steps"], key=lambda step: (order.index(step["status"]), -step["seconds"]))
    mutants = [{"source": path, **counts} for path, counts in found["mutation"]["files"].items()]
    parts = [
        f"<h1>The night</h1><p>{counts}; {minutes:.0f} minutes.</p>",
        _table("Steps", rows, ("status", "name", "seconds", "reason")),
        _table("Tests that failed", found["failures"], ("test", "says")),
        _table("Mutants", mutants, ("source", "killed", "equivalent", "survived")),
        f"<h2>EVA</h2><pre>{html.escape(chr(10).join(found['eva']))}</pre>",
        f"<h2>Digests by target</h2><pre>{html.escape(chr(10).join(found['digests']))}</pre>",
        _table("Parts of tolerances that are needed", found["margins"], ("part", "test", "place")),
        _table("Slowest tests", found["slowest"], ("seconds", "test")),
        _table("Tests that were skipped", found["skipped"], ("test", "reason")),
    ]
    return (
        f"<!doctype html><meta charset=utf-8><title>The night</title><style>{STYLE}</style>\n"
        + "\n".join(parts)
        + "\n"
    )


def _table(title: str, rows: Iterable[Mapping], columns: Sequence[str]) -> str:
    def cell(row: Mapping, name: str) -> str:
        value = f"{row[name]:.3g}" if isinstance(row[name], float) and row[name] < 100 else row[name]
        value = f"{value:.0f}" if isinstance(value, float) else str(value)
        return f'<td class="{row.get("status", "")}">{html.escape(value)}</td>'

    lines = [f"<tr>{''.join(cell(row, name) for name in columns)}</tr>" for row in rows]
    head = "".join(f"<th>{name}</th>" for name in columns)
    return f"<h2>{title}</h2><table><tr>{head}</tr>\n{chr(10).join(lines)}</table>" if lines else ""


def night(chosen: Sequence[Step], out: Path, tree: str, cores: int) -> int:
    """Run steps, write the page and its JSON into a folder; 1 if one has failed."""
    results = Night(out / "night", tree).run(chosen, cores)
    found = report(out / "night", results, tree)
    write(out / "nightly.json", json.dumps(found, indent=1) + "\n")
    write(out / "nightly.html", page(found))
    failed = [step["name"] for step in found["steps"] if step["status"] == FAILED]
    print(f"{len(found['steps'])} steps, failed: {', '.join(failed) or 'none'}; page: {out / 'nightly.html'}")
    return int(bool(failed))


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description="runs everything that there are tools for, and writes build/nightly.html"
    )
    parser.add_argument("--steps", metavar="REGEX", default="", help="only steps whose names have this")
    parser.add_argument(
        "-o", metavar="DIR", dest="out", type=Path, default=ROOT / "build", help="where the page goes"
    )
    given = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    out = given.out.resolve()
    _only_gcc(out / "night" / "gcc")
    chosen = [step for step in steps(out / "night") if re.search(given.steps, step.name)]
    try:
        return night(
            chosen, out, content(), len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
        )
    except KeyboardInterrupt:
        print("stopped; make nightly goes on from here")
        return 130


if __name__ == "__main__":
    sys.exit(main())
