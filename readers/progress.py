"""Progress of a long command, on a terminal only."""

import sys
import time
from collections.abc import Callable

PATIENCE, PAUSE = 1.0, 0.2  # s: before the first message, and between two
Reported = Callable[[float, float, str], None]  # called with the number done, the total, and the kind of work


class Progress:
    """Prints what is done and the time left on one line of the terminal of stderr; prints nothing if stderr
    is no terminal.

    The line is cleared at the end of a `with` block. Time is counted from the first call for each kind of
    work.
    """

    def __init__(self) -> None:
        self._terminal, self._shown, self._of = sys.stderr.isatty(), False, ""
        self._start, self._before = time.monotonic(), 0.0
        self._next = self._start + PATIENCE

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def __call__(self, count: float, total: float, of: str) -> None:
        """Print that `count` of `total` are done, such as 3 of 7 "laws compared",
        at most five times a second."""
        now = time.monotonic()
        if of != self._of:
            self._of, self._start, self._before = of, now, count
        if self._terminal and now >= self._next:
            self._next, self._shown = now + PAUSE, True
            new, passed = count - self._before, now - self._start
            left = f", {_clock((total - count) * passed / new)} left" if new > 0 else ""
            print(f"\r\033[K{count:.6g} of {total:.6g} {of}{left}", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Clear the line, as before any other output."""
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
            self._shown = False


def silent(count: float, total: float, of: str) -> None:
    """Report nothing."""


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}"
