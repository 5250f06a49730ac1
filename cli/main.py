"""The command line: `noslip COMMAND`.

Exit 0 success, 1 a check failed, 2 bad input, 70 an error of noslip's own, 130 Ctrl-C, 143 SIGTERM.
"""

import os  # loaded with the interpreter, as sys is: what else is imported comes after signals are ours
import sys

INTERRUPTED, TERMINATED = 130, 143  # the other exit codes are in codes.py
FILES = f"{__package__.rpartition('.')[0]}.readers.files"


def main(argv: list[str] | None = None) -> int:
    """Run a command line and return its exit code; errors are one line on stderr, with NOSLIP_DEBUG set a traceback too."""
    try:
        if argv is None:
            import signal

            signal.signal(signal.SIGINT, lambda *_: _stop(INTERRUPTED, "interrupted"))
            signal.signal(signal.SIGTERM, lambda *_: _stop(TERMINATED, "terminated"))
            argv = sys.argv[1:]
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy comes: matrices are small, threads would only wait
        from .commands import run

        return run(list(argv))
    except KeyboardInterrupt:
        print("noslip: interrupted", file=sys.stderr)
        return INTERRUPTED


def _stop(code: int, message: str) -> None:
    """End at once and leave nothing: an exception raised inside CasADi's or a compiler's callback could be lost.

    The line goes past the buffer of stderr, which the code that was interrupted may be writing to. A module may be half imported.
    """
    try:
        files = sys.modules.get(FILES)
        pools = sys.modules.get("multiprocessing")
        for child in [*getattr(pools, "active_children", list)(), *getattr(files, "children", ())]:
            child.kill()
        if files is not None and hasattr(files, "remove"):
            files.remove(files.unfinished)
        os.write(2, f"noslip: {message}\n".encode())
    finally:
        os._exit(code)
