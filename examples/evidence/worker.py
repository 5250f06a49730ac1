"""A process that carries out runs: reads pickled arguments of `carry_out` and writes outcomes or
exceptions."""

import os
import pickle
import sys
import threading
import traceback
from queue import SimpleQueue

from ...readers.files import remove, unfinished
from .framework import FigureRun, carry_out


def main() -> None:
    """Process requests from standard input until it is closed."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries does not belong to the results
    asked: SimpleQueue = SimpleQueue()
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()
    while True:
        task = asked.get()
        answer: FigureRun | Exception
        try:
            answer = carry_out(*task)
        except Exception as error:
            error.add_note(traceback.format_exc())
            answer = error
        pickle.dump(answer, answers)
        answers.flush()


def _listen(asked: SimpleQueue) -> None:
    """Pass on requests; when the parent process has ended, exit at once, even during a run,
    and leave no files."""
    try:
        while True:
            asked.put(pickle.load(sys.stdin.buffer))
    except EOFError:
        remove(unfinished)
        os._exit(0)


if __name__ == "__main__":
    main()
