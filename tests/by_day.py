"""Chooses which parameters of long tests `make test` keeps, and writes by_day.json.

    python -m noslip.tests.by_day TIMES COVERAGE

TIMES is what pytest wrote with `--junitxml`, where nothing had been compiled yet, COVERAGE what it wrote with
`--cov-context=test`: which test runs which lines. The tests by which the mutants of C and codegen are looked
for stay, and those of the repository. Of another function that takes longer than LONG in all, its quickest
parameter stays, if that alone takes less; others are added, those with the most new lines for their time
first, as long as they run WORTH lines a second that nothing else by day runs.
"""

import heapq
import json
import re
import sqlite3
import sys
from collections import defaultdict
from functools import reduce
from operator import or_
from pathlib import Path
from xml.etree import ElementTree

from noslip.tests.mutation import SOURCES
from noslip.tests.tools import collected

TESTS = Path(__file__).resolve().parent
LONG = 0.3  # s
WORTH = 20.0  # lines for each second
GROUP = re.compile(r"@\w+$")  # of tests that run in one process, which pytest-xdist adds to a name
TEST = re.compile(r"tests/\w+/(test_\w+)\.py::(\w+)(?:\[(.*)\])?", re.S)
MOST_LINES = 4096  # of a file
Test = tuple[str, str, str]  # file, function, parameters


def times_of(path: Path) -> dict[Test, float]:
    """Return the duration of each test, s."""
    found = {}
    for case in ElementTree.parse(path).iter("testcase"):
        function, _, parameters = GROUP.sub("", case.get("name", "")).partition("[")
        found[case.get("classname", "").rpartition(".")[2], function, parameters.removesuffix("]")] = float(
            case.get("time", 0)
        )
    return found


def lines_of(path: Path) -> dict[Test, int]:
    """Return the lines of the product that each test runs, a bit for each line of all files one after the
    other."""
    found, first = defaultdict[Test, int](int), dict[str, int]()
    joined = "line_bits JOIN file ON file.id = file_id JOIN context ON context.id = context_id"
    rows = (
        sqlite3.connect(path).execute(f"SELECT path, context, numbits FROM {joined} ORDER BY path").fetchall()
    )
    for file, context, bits in rows:
        if TESTS not in Path(file).parents and (
            named := TEST.fullmatch(GROUP.sub("", context.rpartition("|")[0]))
        ):
            place = first.setdefault(file, len(first) * MOST_LINES)
            found[named[1], named[2], named[3] or ""] |= int.from_bytes(bits, "little") << place
    return found


def tests_of(*arguments: str) -> set[Test]:
    """Return the tests of day and night that arguments of pytest choose, but for those of the night alone."""
    names = collected("not nightly or left", *arguments)
    return {(named[1], named[2], named[3] or "") for named in map(TEST.fullmatch, names) if named}


def always() -> set[Test]:
    """Return the tests by which mutants are looked for, and those of the repository,
    which run no lines of the product."""
    runs = {source.tests for source in SOURCES.values()} | {("tests/repository",)}
    return set().union(*(tests_of(*arguments) for arguments in runs))


def chosen(times: dict[Test, float], lines: dict[Test, int], always: set[Test]) -> set[Test]:
    """Return the tests that stay, `always` among them."""
    functions = defaultdict[tuple[str, str], list[Test]](list)
    for test in times:
        functions[test[:2]].append(test)
    kept = always & times.keys()
    for own in functions.values():
        quickest = min(own, key=lambda test: times[test])
        if sum(times[test] for test in own) < LONG:
            kept |= set(own)
        elif times[quickest] < LONG and not kept & set(own):
            kept.add(quickest)
    run = reduce(or_, (lines.get(test, 0) for test in kept))

    def worth(test: Test) -> float:
        return (lines.get(test, 0) & ~run).bit_count() / max(times[test], 0.01)

    # What a test is worth only falls while others are added: the best of what was once worth more is the best
    # of all.
    others = [(-worth(test), test) for test in times.keys() - kept]
    heapq.heapify(others)
    while others:
        test = others[0][1]
        if worth(test) < -others[0][0]:
            heapq.heapreplace(others, (-worth(test), test))
        elif worth(test) < WORTH:
            break
        else:
            kept.add(heapq.heappop(others)[1])
            run |= lines[test]
    return kept


def main() -> None:
    known, fixed, lines = tests_of(), always(), lines_of(Path(sys.argv[2]))
    times = {test: seconds for test, seconds in times_of(Path(sys.argv[1])).items() if test in known}
    kept = chosen(times, lines, fixed) | fixed  # also those that were not measured
    table = defaultdict[str, dict[str, list[str]]](dict)
    for file, function in sorted({test[:2] for test in times.keys() - kept}):
        table[file][function] = sorted(test[2] for test in kept if test[:2] == (file, function))
    (TESTS / "by_day.json").write_text(json.dumps(table, indent=1) + "\n")
    stay = sum(times.get(test, 0.0) for test in kept)
    print(
        f"{len(kept)} of {len(known)} tests stay; of those measured {stay:.0f} of {sum(times.values()):.0f} s"
    )


if __name__ == "__main__":
    main()
