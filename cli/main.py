"""The command line: `noslip COMMAND`.

Exit codes: 0 success, 1 a check failed, 2 bad input, 70 internal error, 130 Ctrl-C, 143 SIGTERM.
"""

# Already loaded by the interpreter, as is sys; everything else is imported after the signal handlers are
# installed
import os
import sys

INTERRUPTED, TERMINATED = 130, 143  # for the other exit codes see __init__.py
FILES = f"{__package__.rpartition('.')[0]}.readers.files"


def main(argv: list[str] | None = None) -> int:
    """Run a command line and return its exit code. Errors are one line on stderr;
    if NOSLIP_DEBUG is set, with a traceback."""
    try:
        if argv is None:
            import signal

            signal.signal(signal.SIGINT, lambda *_: _stop(INTERRUPTED, "interrupted"))
            signal.signal(signal.SIGTERM, lambda *_: _stop(TERMINATED, "terminated"))
            _open_streams()
            argv = sys.argv[1:]
            os.environ["MPLBACKEND"] = "agg"  # pictures are files: a backend for a screen need not exist
        # Before NumPy is imported: the matrices are too small for threads
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        from .commands import run

        return run(list(argv))
    except KeyboardInterrupt:
        print("noslip: interrupted", file=sys.stderr)
        return INTERRUPTED


def _open_streams() -> None:
    """Make what is printed into a file or a pipe UTF-8 whatever the locale, with the bytes of file names as
    they are. A terminal that has no φ gets \\u03c6.

    A stream that is closed becomes the null device: the first file that is opened would take its number, and
    what is printed.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) < 3:
        pass
    os.close(number)
    for name, number in (("stdout", 1), ("stderr", 2)):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w", closefd=False))
        stream = getattr(sys, name)
        if stream.isatty() or "PYTHONIOENCODING" in os.environ:
            stream.reconfigure(errors="backslashreplace")
        else:
            stream.reconfigure(encoding="utf-8", errors="surrogateescape")


def _stop(code: int, message: str) -> None:
    """Exit at once and remove temporary files. An exception raised inside a callback of CasADi or a compiler
    could be lost.

    The message bypasses the buffer of stderr, because the interrupted code may be writing to it. A module may
    be partly imported.
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
