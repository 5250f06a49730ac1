"""A sweep on the workers of a Dask cluster (distributed, optional): they receive rows of numbers and the
SPEC, and run the C.

Rows are made here, so that the numbers do not depend on whose processor computes a logarithm.
"""

import logging
from collections.abc import Iterable, Iterator
from contextlib import suppress

import numpy as np

from ...readers.errors import BadInput, library, naming
from .runner import AHEAD, in_flight
from .study import Study, outcomes_of

PATIENCE = "10s"  # for the connection to the scheduler


class Cluster:
    """The workers of the scheduler at an address."""

    def __init__(self, address: str, study: Study):
        """Raises BadInput if distributed is not installed, no scheduler answers, or it has no workers."""
        distributed = library("distributed", "--scheduler needs distributed", "cluster")
        for name in ("distributed", "distributed.client", "distributed.core", "distributed.comm"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # this module reports errors itself
        self._distributed, self._study = distributed, study
        absent = OSError, ValueError, RuntimeError  # TimeoutError is an OSError
        with naming(f"--scheduler {address}: no scheduler answers", absent, "start one with dask scheduler"):
            self._client = distributed.Client(address, timeout=PATIENCE)
        self.workers = sum(
            worker["nthreads"] for worker in self._client.scheduler_info(n_workers=-1)["workers"].values()
        )
        if not self.workers:
            self.close()
            raise BadInput(f"--scheduler {address}: it has no workers; start some with dask worker {address}")

    def results(
        self, tables: Iterable[tuple[int, np.ndarray]]
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """See `Engine`. Raises BadInput if a worker cannot run this sweep or the connection is lost."""
        study, client = self._study, self._client

        def submit(table: np.ndarray):
            return client.submit(outcomes_of, study.text, study.identity, table, pure=False)

        gone = OSError, self._distributed.client.FutureCancelledError
        with (
            naming("a worker cannot run noslip", ImportError, "install the same version of it there"),
            naming(
                "too many workers died on one part", self._distributed.KilledWorker, "give them more memory"
            ),
            naming(
                "the scheduler is gone", gone, "what is finished is kept, the same command goes on from there"
            ),
        ):
            yield from in_flight(tables, submit, self._finished, AHEAD * self.workers)

    def close(self) -> None:
        """Close the connection."""
        with suppress(OSError, TimeoutError):
            self._client.close(timeout=2)

    def _finished(self, futures: list) -> Iterable:
        return self._distributed.wait(futures, return_when="FIRST_COMPLETED").done
