"""Runs the parts of a sweep in parallel, in threads of this process or on other workers."""

import atexit
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from functools import lru_cache, partial
from typing import Any, Protocol

import numpy as np

from ...readers.progress import Reported
from .batch import Batch
from .simulated import Simulated
from .store import Parts
from .study import Study, outcomes_of

AHEAD = 2  # queued parts for each thread or worker
PIECES = 4  # of a table, for each thread or process
LANES = 8  # samples that the longest vectors run together


class TableRunner(Protocol):
    """Runs tables in any order, several at a time."""

    def results(
        self, tables: Iterable[tuple[int, np.ndarray]]
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Yield number, table and outcomes of each part when it is finished."""

    def close(self) -> None:
        """Release the threads or workers."""


class Threads:
    """Threads of this process: the simulator releases the GIL."""

    def __init__(self, batch: Batch, jobs: int):
        self._batch, self._jobs = batch, jobs

    def results(
        self, tables: Iterable[tuple[int, np.ndarray]]
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """See `TableRunner`."""
        with ThreadPoolExecutor(self._jobs) as pool:
            yield from in_flight(
                tables, lambda table: pool.submit(self._batch.run, table), first_finished, AHEAD * self._jobs
            )

    def close(self) -> None:
        """Nothing to release: threads end with their work."""


class Processes:
    """Processes of this machine, for runs in Python; each prepares the sweep anew."""

    def __init__(self, study: Study, jobs: int):
        self._jobs, self._pool = jobs, ProcessPoolExecutor(jobs)
        self._run = partial(outcomes_of, study.text, study.identity, instants=study.instants)

    def results(
        self, tables: Iterable[tuple[int, np.ndarray]]
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """See `TableRunner`."""
        yield from in_flight(
            tables, partial(self._pool.submit, self._run), first_finished, AHEAD * self._jobs
        )

    def close(self) -> None:
        """Nothing to release: processes end with the last table."""


def in_flight(
    tables: Iterable[tuple[int, np.ndarray]],
    submit: Callable[[np.ndarray], Any],
    finished: Callable[[list[Any]], Iterable[Any]],
    most: int,
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Submit tables, a limited number at a time; `finished` waits for one or more of the futures."""
    flying: dict[Any, tuple[int, np.ndarray]] = {}

    def landed() -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        for future in finished(list(flying)):
            yield *flying.pop(future), future.result()

    for number, table in tables:
        flying[submit(table)] = number, table
        if len(flying) >= most:
            yield from landed()
    while flying:
        yield from landed()


def first_finished(futures: Iterable[Future]) -> Iterable[Future]:
    """Return the finished futures of a thread pool, at least one."""
    return wait(futures, return_when=FIRST_COMPLETED).done


def run_parts(parts: Parts, engine: TableRunner, progress: Reported) -> None:
    """Run the missing parts and store each as soon as it is finished."""
    plan, samples, missing = parts.study.plan, parts.study.samples, parts.missing()
    done = samples - sum(parts.range(part)[1] for part in missing)
    progress(done, samples, "samples")
    for part, table, outcomes in engine.results((part, plan.table(*parts.range(part))) for part in missing):
        parts.write(part, table, outcomes)
        done += len(table)
        progress(done, samples, "samples")


@lru_cache(maxsize=1)  # the processes are kept for the next table
def engine_of(study: Study, jobs: int) -> Threads | Processes:
    """Return what runs a sweep on this machine: threads where the C does, processes where Python does."""
    return Processes(study, jobs) if isinstance(study.batch, Simulated) else Threads(study.batch, jobs)


atexit.register(engine_of.cache_clear)  # while there are still modules that end processes


def run_table(
    study: Study, table: np.ndarray, jobs: int, finished: Callable[[int], None] | None = None
) -> np.ndarray:
    """Return the outcomes of a table; `finished` is told how many of its rows are."""
    least = 1 if isinstance(study.batch, Simulated) else LANES
    pieces, found = np.array_split(table, max(1, min(PIECES * jobs, len(table) // least))), {}
    for number, _, outcomes in engine_of(study, jobs).results(enumerate(pieces)):
        found[number] = outcomes
        if finished:
            finished(sum(map(len, found.values())))
    return np.concatenate([found[number] for number in range(len(pieces))])
