"""Work shared by several processes, such as the laws of a robot. Its results are in the cache,
where the caller finds them."""

import os
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import current_process, get_context

from ...readers.errors import BadInput
from ...readers.kept import folder_of_results
from ...readers.progress import Reported

WAIT = 0.2  # s between two reports of progress


def processors() -> int:
    """Return the number of processors that this process may use by forking: 1 unless it runs on Linux, has
    one thread, may have children, and has a cache."""
    if sys.platform != "linux" or threading.active_count() > 1 or current_process().daemon:
        return 1
    with suppress(BadInput):
        folder_of_results()
        return len(os.sched_getaffinity(0))
    return 1


def in_shares(work: Callable[[int], object], count: int, progress: Reported) -> None:
    """Call work(0) to work(count - 1) in processes of which each takes every n-th, if there are n > 1
    processors; otherwise do nothing.

    What fails is silent here, also that a process is killed: it is missing in the cache, so that the caller
    meets it again.
    """
    shared_by = min(processors(), count)
    if shared_by < 2:
        return
    shares = [range(first, count, shared_by) for first in range(shared_by)]
    # Each process counts for itself: a killed one leaves no lock behind
    done = get_context("fork").RawArray("i", shared_by)

    def process(share: Sequence[int]) -> None:
        nothing = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            os.dup2(nothing, stream)
        for k in share:
            work(k)
            done[share[0]] += 1

    running = [get_context("fork").Process(target=process, args=(share,), daemon=True) for share in shares]
    for each in running:
        each.start()
    while any(each.is_alive() for each in running):
        progress(sum(done), count, "parts derived and compared")
        next(each for each in running if each.is_alive() or each is running[-1]).join(WAIT)
