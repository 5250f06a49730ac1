"""Produces figures: each SPEC is run once, in separate processes,
while figures with complete runs are drawn in this one."""

import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import IO

from ...simulation.drawing import pictures
from ...simulation.specification.spec import Spec
from .framework import Claim, Figure, FigureRun, Runs

WORKER = (sys.executable, "-m", f"{__package__}.worker")


@dataclass(frozen=True)
class Made:
    """A finished figure: its runs by label, its claims, its picture as the bytes of a file,
    by kind (png, svg)."""

    figure: Figure
    runs: Runs
    claims: Sequence[Claim]
    pictures: Mapping[str, bytes]


def produce(figures: Sequence[Figure], jobs: int, done: Callable[[Made], None]) -> list[Made]:
    """Produce the figures with `jobs` processes and call `done` with each. Raises BadInput if a SPEC is
    invalid or cannot be run."""
    tasks = {
        f.name: {label: (case.spec(), case.singular, case.engine) for label, case in f.cases.items()}
        for f in figures
    }
    to_run = {repr(task): task for runs in tasks.values() for task in runs.values()}
    made = []
    with _workers(min(jobs, len(to_run))) as carry_out, ThreadPoolExecutor(jobs) as pool:
        futures = {key: pool.submit(carry_out, *task) for key, task in to_run.items()}
        try:
            for figure in figures:
                made.append(
                    _draw(
                        figure,
                        {label: futures[repr(task)].result() for label, task in tasks[figure.name].items()},
                    )
                )
                done(made[-1])
        finally:
            pool.shutdown(cancel_futures=True)
    return made


def _draw(figure: Figure, runs: Runs) -> Made:
    drawn = pictures(lambda: figure.draw(runs), figure.title, figure.assumed)
    return Made(figure, runs, figure.all_claims(runs), drawn)


@contextmanager
def _workers(count: int) -> Iterator[Callable[[Spec, bool, str | None], FigureRun]]:
    """`framework.carry_out`, but executed by the first idle one of `count` processes; to be called from as
    many threads.

    The processes have their own session, so that only this process receives Ctrl-C; when it ends, they end.
    """
    pipe = subprocess.PIPE
    workers = [
        subprocess.Popen(WORKER, stdin=pipe, stdout=pipe, start_new_session=True) for _ in range(count)
    ]
    free: SimpleQueue[subprocess.Popen] = SimpleQueue()
    for worker in workers:
        free.put(worker)

    def carry_out(spec: Spec, singular: bool, engine: str | None) -> FigureRun:
        worker = free.get()
        asked, answers = _pipes(worker)
        try:
            pickle.dump((spec, singular, engine), asked)
            asked.flush()
            answer = pickle.load(answers)
        except (EOFError, BrokenPipeError) as error:
            raise RuntimeError(f"a process that carries out runs ended with code {worker.wait()}") from error
        finally:
            free.put(worker)
        if isinstance(answer, Exception):
            raise answer
        return answer

    try:
        yield carry_out
    finally:
        for worker in workers:
            with suppress(BrokenPipeError):
                _pipes(worker)[0].close()
        for worker in workers:
            worker.wait()
            _pipes(worker)[1].close()


def _pipes(worker: subprocess.Popen) -> tuple[IO[bytes], IO[bytes]]:
    """Return standard input and standard output of a worker."""
    assert worker.stdin and worker.stdout, "started with pipes"
    return worker.stdin, worker.stdout
