"""Runs the parts of a sweep in parallel, in threads of this process or on other workers."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any, Protocol

import numpy as np

from .batch import Batch
from .store import Parts

AHEAD = 2  # queued parts for each thread or worker
PIECES = 4  # of a table, for each thread


class Engine(Protocol):
    """Runs tables in any order, several at a time."""

    def results(self, tables: Iterable[tuple[int, np.ndarray]]) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Yield number, table and outcomes of each part when it is finished."""

    def close(self) -> None:
        """Release the threads or workers."""


class Threads:
    """Threads of this process: the simulator releases the GIL."""

    def __init__(self, batch: Batch, jobs: int):
        self._batch, self._jobs = batch, jobs

    def results(self, tables: Iterable[tuple[int, np.ndarray]]) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """See `Engine`."""
        with ThreadPoolExecutor(self._jobs) as pool:
            yield from in_flight(tables, lambda table: pool.submit(self._batch.run, table), first_finished, AHEAD * self._jobs)

    def close(self) -> None:
        """Nothing to release: threads end with their work."""


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


def run_parts(parts: Parts, engine: Engine, progress: "SweepProgress") -> None:
    """Run the missing parts and store each as soon as it is finished."""
    plan = parts.study.plan
    missing = parts.missing()
    progress.begin(parts.study.samples - sum(parts.range(part)[1] for part in missing))
    for part, table, outcomes in engine.results((part, plan.table(*parts.range(part))) for part in missing):
        parts.write(part, table, outcomes)
        progress.add(len(table))


def run_table(batch: Batch, table: np.ndarray, jobs: int) -> np.ndarray:
    """Return the outcomes of a table, computed by threads."""
    pieces = np.array_split(table, max(1, min(PIECES * jobs, len(table) // 8)))
    with ThreadPoolExecutor(jobs) as pool:
        return np.concatenate(list(pool.map(batch.run, pieces)))


class SweepProgress:
    """Prints progress, rate and remaining time on stderr: a line that is updated on a terminal, else a line now and then."""

    def __init__(self, samples: int):
        self._samples, self._terminal = samples, sys.stderr.isatty()
        self._every, self._shown = (0.2 if self._terminal else 10.0), False

    def begin(self, done: int) -> None:
        """Start the clock; `count` samples exist already."""
        self._before = self._done = done
        self._start = self._last = time.monotonic()
        if done and done < self._samples:
            print(f"resuming: {done} of {self._samples} samples exist", file=sys.stderr)

    def add(self, count: int) -> None:
        """Count further finished samples."""
        self._done += count
        now = time.monotonic()
        if now - self._last < self._every:
            return
        self._last, self._shown = now, True
        rate = (self._done - self._before) / (now - self._start)
        left = (self._samples - self._done) / rate
        line = f"{self._done} of {self._samples} samples, {rate:.4g}/s, {_clock(left)} left"
        print(f"\r\033[K{line}" if self._terminal else line, end="" if self._terminal else "\n", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Clear the line of a terminal."""
        if self._shown and self._terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}"
