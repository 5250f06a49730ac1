"""What `make test` leaves to the night: every check keeps a test. How the night is run."""

import json
import sys

import pytest
from noslip.tests import nightly, nightly_run
from noslip.tests.by_day import chosen
from noslip.tests.nightly import faults, is_nightly
from noslip.tests.nightly_run import Running, Step, content, night

ALL = [("test_bits", f"test_bits[{build}]") for build in ("cortex-m4f clang -O2", "x86_64 gcc -O0")]


@pytest.fixture
def table(monkeypatch):
    monkeypatch.setattr(nightly, "BY_DAY", {"test_bits": {"test_bits": ["x86_64 gcc -O0"]}})


def test_of_long_tests_the_parameters_of_the_table_stay(table):
    assert [is_nightly(*test) for test in ALL] == [True, False]
    assert not is_nightly("test_rooms", "test_bits[cortex-m4f clang -O2]") and not is_nightly(
        "test_bits", "test_other[1]"
    )
    assert faults(ALL) == []


def test_a_parameter_that_is_none_is_a_fault(table):
    assert faults(ALL[:1]) == ["test_bits: no test test_bits[x86_64 gcc -O0]"]
    assert faults([("test_rooms", "test_bits")]) == []


def test_what_stays_runs_what_is_worth_its_time():
    """Short functions; the quickest parameter of others; those with enough lines of their own."""
    times = {
        ("f", "a", "1"): 0.2,
        ("f", "a", "2"): 0.6,
        ("f", "a", "3"): 0.7,
        ("f", "b", "1"): 0.1,
        ("f", "b", "2"): 0.1,
    }
    times |= {("g", "c", ""): 0.2, ("g", "d", ""): 9.0, ("g", "e", "1"): 9.0, ("g", "e", "2"): 8.0}
    numbers = {
        ("f", "a", "1"): {1},
        ("f", "a", "2"): {*range(1, 16)},
        ("f", "a", "3"): {1, 4},
        ("g", "d", ""): {*range(240)},
    }
    lines = {test: sum(1 << line for line in those) for test, those in numbers.items()}
    assert times.keys() - chosen(times, lines, set()) == {
        ("f", "a", "2"),
        ("f", "a", "3"),
        ("g", "e", "1"),
        ("g", "e", "2"),
    }
    del lines["g", "d", ""]
    found = chosen(times, lines, {("g", "e", "1")})
    assert times.keys() - found == {("f", "a", "3"), ("g", "d", ""), ("g", "e", "2")}


# -- the run of a night --------------------------------------------------------------------------------------

MEET = """
import sys, time
from pathlib import Path
own, other = map(Path, sys.argv[1:])
own.touch()
until = time.monotonic() + 30
while not other.exists() and time.monotonic() < until:
    time.sleep(0.01)
sys.exit(not other.exists())
"""


def python(name: str, code: str, *arguments: str, **options) -> Step:
    return Step(name, [sys.executable, "-S", "-c", code, *arguments], **options)


def counted(tmp_path, name: str, code: str = "") -> Step:
    """A step that leaves a mark of each of its runs."""
    return python(name, f"open({str(tmp_path / name)!r}, 'a').write('x')\n{code}")


def runs(tmp_path, *names: str) -> list[int]:
    return [len((tmp_path / name).read_text()) for name in names]


def ends(tmp_path) -> dict[str, str]:
    found = json.loads((tmp_path / "nightly.json").read_text())
    return {step["name"]: step["status"] for step in found["steps"]}


def test_a_step_that_fails_does_not_stop_the_others(tmp_path, capsys):
    steps = [
        counted(tmp_path, "bad", "print('FAILED tests/test_x.py::test_y - 1 < 0'); raise SystemExit(3)"),
        counted(tmp_path, "good"),
        Step("absent", ["no_such_command"], lacking="no_such_command is not installed"),
    ]
    assert night(steps, tmp_path, "one", 1) == 1
    found = json.loads((tmp_path / "nightly.json").read_text())
    reasons = {step["name"]: step["reason"] for step in found["steps"]}
    assert ends(tmp_path) == {"bad": "failed", "good": "passed", "absent": "skipped"} and runs(
        tmp_path, "bad", "good"
    ) == [1, 1]
    assert (
        reasons["bad"] == "exit 3: FAILED tests/test_x.py::test_y - 1 < 0"
        and reasons["absent"] == steps[2].lacking
    )
    page = (tmp_path / "nightly.html").read_text()
    assert (
        "1 passed, 1 failed, 1 skipped" in page
        and "1 &lt; 0" in page
        and "failed: bad" in capsys.readouterr().out
    )


def test_a_night_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    """Stopped in its second step, which is not left running; what has passed is not run again,
    unless the tree has changed."""
    steps = [
        counted(tmp_path, "first"),
        counted(tmp_path, "second", "import time; time.sleep(60)"),
        counted(tmp_path, "third"),
    ]
    ended, began = Running.ended, []

    def stopped(one: Running) -> bool:
        if one.step.name == "second" and (tmp_path / "second").exists():
            began.append(one)
            raise KeyboardInterrupt
        return ended(one)

    monkeypatch.setattr(Running, "ended", stopped)
    with pytest.raises(KeyboardInterrupt):
        night(steps, tmp_path, "one", 1)
    assert (
        began[0].process.returncode < 0
        and runs(tmp_path, "first", "second") == [1, 1]
        and not (tmp_path / "third").exists()
    )
    monkeypatch.undo()
    steps[1] = counted(tmp_path, "second", "raise SystemExit(1)")
    assert night(steps, tmp_path, "one", 1) == 1 and runs(tmp_path, "first", "second", "third") == [1, 2, 1]
    steps[1] = counted(tmp_path, "second")
    assert night(steps, tmp_path, "one", 1) == 0 and runs(tmp_path, "first", "second", "third") == [1, 3, 1]
    assert night(steps, tmp_path, "two", 1) == 0 and runs(tmp_path, "first", "second", "third") == [2, 4, 2]


def test_both_cores_are_busy(tmp_path):
    """Two steps that end only side by side; one for both cores is alone."""
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    alone = f"import os; raise SystemExit(os.path.exists({a!r}) != os.path.exists({b!r}))"
    steps = [python("alone", alone, cores=2), python("one", MEET, a, b), python("other", MEET, b, a)]
    assert night(steps, tmp_path, "one", 2) == 0
    assert (
        night(
            [python("not together", MEET.replace("30", "0.2"), str(tmp_path / "c"), b + "c")],
            tmp_path,
            "one",
            2,
        )
        == 1
    )


def test_a_step_without_end_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(nightly_run, "LONGEST", 0.3)
    assert night([python("endless", "import time; time.sleep(60)")], tmp_path, "one", 1) == 1


TESTS = """
import pytest
def test_good(): pass
def test_bad(): assert 1 == 2
@pytest.mark.skip(reason="no tool")
def test_absent(): pass
"""


def test_the_page_has_what_the_steps_found(tmp_path):
    """Tests with their ends and durations, scores of mutants, what the guarantees say, digests."""
    (tmp_path / "test_made.py").write_text(TESTS)
    places = {
        path: nightly_run._file(tmp_path / "night", path, "json")
        for path in ("mutation a.inc", "mutation codegen/b.py")
    }
    ends = ({"killed": 30, "equivalent": 2, "survived": 0}, {"killed": 9, "equivalent": 0, "survived": 1})
    steps = [
        Step(
            "tests",
            [
                *nightly_run._pytest(tmp_path / "night", "tests", "-p", "no:cacheprovider"),
                str(tmp_path / "test_made.py"),
            ],
        ),
        python(
            "guarantees others",
            "print('sizes            holds    12 laws  [1 s]\\nmisra            skipped  install x  [0 s]')",
        ),
        python("guarantees eva", "print('eva              holds    0 alarms in 30 programs  [9 s]')"),
        python("bits", "print('x86_64     gcc    -O2   2000; 0123456789abcdef')"),
    ]
    for (name, place), counts in zip(places.items(), ends, strict=True):
        steps.append(
            python(name, f"open({str(place)!r}, 'w').write({json.dumps({'files': {name[9:]: counts}})!r})")
        )
    assert night(steps, tmp_path, "one", 2) == 1
    found = json.loads((tmp_path / "nightly.json").read_text())
    status = {step["name"]: (step["status"], step["reason"]) for step in found["steps"]}
    assert status["tests"][0] == "failed" and status["guarantees others"] == (
        "passed",
        "misra skipped: install x",
    )
    assert status["mutation score of C"][0] == "passed" and status["mutation score of codegen"][0] == "failed"
    assert {kind: found["mutation"][kind] for kind in ends[0]} == {
        "killed": 39,
        "equivalent": 2,
        "survived": 1,
    }
    assert [each["test"].rpartition("::")[2] for each in found["failures"]] == ["test_bad"]
    assert [each["reason"] for each in found["skipped"]] == ["no tool"] and len(found["slowest"]) == 3
    assert "0 alarms" in found["eva"][0] and "0123456789abcdef" in found["digests"][0]


def test_a_changed_tree_is_another(tmp_path):
    (tmp_path / "a.py").write_text("1")
    first = content(tmp_path)
    assert first == content(tmp_path)
    (tmp_path / "a.py").write_text("2")
    assert content(tmp_path) != first
