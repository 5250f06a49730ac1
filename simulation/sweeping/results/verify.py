"""Samples run once more by `noslip simulate`, whose steps are controlled, one by one, and compared."""

import signal
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from ....readers.errors import BadInput
from ....readers.progress import Reported, silent
from ..batch import ACCURACY, Batch
from ..store import open_sweep, sample_of
from ..study import Study, sample_spec

TOLERANCE = 1e-11  # of the adaptive simulator, well below what is stated
# s: when a run stops; `simulate` looks for that instant to 1e-9, and the state changes fast there
TIME = 1e-8


@dataclass(frozen=True)
class Verified:
    """How many samples were run again; the largest difference of a state or error at the end of runs to their
    end, and of which sample; what is stated: the largest integration error; samples that ended otherwise:
    with another status, or at another time.
    """

    samples: int
    largest: float
    of: int
    stated: float
    otherwise: tuple[int, ...]

    @property
    def holds(self) -> bool:
        """Is the difference within what is stated, and does every run end as and when it did?"""
        return self.largest <= self.stated and not self.otherwise


def check_verify(study: Study) -> None:
    """Raise BadInput for a sweep whose samples `simulate` runs: they would be compared with themselves."""
    if not isinstance(study.batch, Batch):
        raise BadInput(
            "--verify: noslip simulate runs the samples of this SPEC itself, nothing else could differ; "
            "leave it out"
        )


def verify(file: Path | str, count: int, jobs: int, progress: Reported = silent) -> Verified:
    """`count` samples of a finished sweep, evenly spread, by processes."""
    samples = open_sweep(file)[2]["samples"]
    chosen = np.unique(np.linspace(0, samples - 1, min(count, samples)).round().astype(int)).tolist()
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        # Ctrl-C is for this process, not for its children
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        begun = pool.map(
            _differences, [str(file)] * len(chosen), chosen, chunksize=max(1, len(chosen) // (8 * jobs))
        )
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        progress(0, len(chosen), "samples run again")
        found: list[tuple[float, bool]] = []
        for difference in begun:
            found.append(difference)
            progress(len(found), len(chosen), "samples run again")
    worst = int(np.argmax([difference for difference, _ in found]))
    otherwise = tuple(sample for sample, (_, same) in zip(chosen, found, strict=True) if not same)
    return Verified(len(chosen), found[worst][0], chosen[worst], ACCURACY, otherwise)


def _differences(file: str, sample: int) -> tuple[float, bool]:
    """Of one sample: largest difference of the state and errors at the end of a run to its end;
    did both end alike?"""
    from ...closed_loop import simulate

    text, row, outcome = sample_of(file, sample)
    spec = sample_spec(text, row)
    run = simulate(replace(spec, simulation=replace(spec.simulation, tolerance=TOLERANCE)), stages=True)
    same = run.status[-1] == outcome["status"] and abs(run.t[-1] - outcome["t_end"]) <= TIME
    if run.stopped:
        return 0.0, bool(same)
    names = [q.name for q in run.law.state]
    pairs = [(run.x[-1, k], outcome[f"end.{name}"]) for k, name in enumerate(names)]
    pairs += [(run.error[-1, k], outcome[f"final.{row.name}"]) for k, row in enumerate(run.law.output.rows)]
    return max(abs(float(one) - other) for one, other in pairs), bool(same)
