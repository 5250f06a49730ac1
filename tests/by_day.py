"""Chooses which parameters of long tests `make test` keeps, and writes by_day.json.

    python -m noslip.tests.by_day TIMES COVERAGE

TIMES is what pytest wrote with `--junitxml`, COVERAGE what it wrote with `--cov-context=test`: which test runs which lines.
The tests by which the mutants of C and codegen are looked for stay, and those of the repository. Of another function that
takes longer than LONG in all, its quickest parameter stays, if that takes less than ALONE; others are added, those with the
most new lines for their time first, as long as they run WORTH lines a second that nothing else by day runs.
"""

import json
import re
import sys
from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

from noslip.tests.mutation import SOURCES
from noslip.tests.tools import collected

TESTS = Path(__file__).resolve().parent
LONG, ALONE = 0.3, 1.0  # s: of all parameters of a test; of its quickest one
WORTH = 10.0  # lines for each second
GROUP = re.compile(r"@\w+$")  # of tests that run in one process, which pytest-xdist adds to a name
TEST = re.compile(r"tests/\w+/(test_\w+)\.py::(\w+)(?:\[(.*)\])?", re.S)
Test = tuple[str, str, str]  # file, function, parameters


def times_of(path: Path) -> dict[Test, float]:
    """Return the duration of each test, s."""
    found = {}
    for case in ElementTree.parse(path).iter("testcase"):
        function, _, parameters = GROUP.sub("", case.get("name", "")).partition("[")
        found[case.get("classname", "").rpartition(".")[2], function, parameters.removesuffix("]")] = float(case.get("time", 0))
    return found


def lines_of(path: Path) -> dict[Test, set[tuple[str, int]]]:
    """Return the lines of the product that each test runs."""
    from coverage import CoverageData

    data, found = CoverageData(str(path)), defaultdict[Test, set[tuple[str, int]]](set)
    data.read()
    for file in [file for file in data.measured_files() if TESTS not in Path(file).parents]:
        for line, contexts in data.contexts_by_lineno(file).items():
            for context in contexts:
                if named := TEST.fullmatch(GROUP.sub("", context.rpartition("|")[0])):
                    found[named[1], named[2], named[3] or ""].add((file, line))
    return found


def always() -> set[Test]:
    """Return the tests by which mutants are looked for, and those of the repository, which run no lines of the product."""
    runs = {source.tests for source in SOURCES.values()} | {("tests/repository",)}
    names = {name for tests in runs for name in collected("not nightly or left", *tests)}
    return {(named[1], named[2], named[3] or "") for named in map(TEST.fullmatch, names) if named}


def chosen(times: dict[Test, float], lines: dict[Test, set[tuple[str, int]]], always: set[Test]) -> set[Test]:
    """Return the tests that stay, `always` among them."""
    functions = defaultdict[tuple[str, str], list[Test]](list)
    for test in times:
        functions[test[:2]].append(test)
    kept = always & times.keys()
    for own in functions.values():
        quickest = min(own, key=lambda test: times[test])
        if sum(times[test] for test in own) < (LONG if len(own) > 1 else ALONE):
            kept |= set(own)
        elif times[quickest] < ALONE and not kept & set(own):
            kept.add(quickest)
    missing = set().union(*lines.values()) - set().union(*(lines.get(test, ()) for test in kept))
    while others := times.keys() - kept:
        worth, best = max((len(missing & lines.get(test, set())) / max(times[test], 0.01), test) for test in others)
        if worth < WORTH:
            break
        kept.add(best)
        missing -= lines[best]
    return kept


def main() -> None:
    times, lines = times_of(Path(sys.argv[1])), lines_of(Path(sys.argv[2]))
    kept = chosen(times, lines, always())
    table = defaultdict[str, dict[str, list[str]]](dict)
    for file, function in sorted({test[:2] for test in times.keys() - kept}):
        table[file][function] = sorted(test[2] for test in kept if test[:2] == (file, function))
    (TESTS / "by_day.json").write_text(json.dumps(table, indent=1) + "\n")
    print(f"{len(kept)} of {len(times)} tests stay, {sum(times[t] for t in kept):.0f} of {sum(times.values()):.0f} s")


if __name__ == "__main__":
    main()
