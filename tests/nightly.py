"""Which parameters of tests `make test` leaves to `make nightly`: those of long tests that find nothing more.

by_day.json names, for each long test, the parameters that stay by day, if any; `by_day.py` chooses them and
writes it. Other tests that are long as a whole carry the marker `nightly` where they are defined; others look
at the same, or at a smaller version of it.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

BY_DAY: Mapping[str, Mapping[str, Sequence[str]]] = json.loads(
    (Path(__file__).parent / "by_day.json").read_text()
)


def is_nightly(file: str, name: str) -> bool:
    """Return whether a test (its name after `::`) of a file (without `.py`) is left to the night."""
    function, _, parameters = name.partition("[")
    kept = BY_DAY.get(file, {}).get(function)
    return kept is not None and parameters.removesuffix("]") not in kept


def faults(tests: Iterable[tuple[str, str]]) -> list[str]:
    """Return what by_day.json names that is no test, of all tests (file, name) of some files."""
    names = set(tests)
    return [
        f"{file}: no test {function}[{kept}]"
        for file in sorted({file for file, _ in names} & BY_DAY.keys())
        for function, those in BY_DAY[file].items()
        for kept in those
        if (file, f"{function}[{kept}]") not in names
    ]
