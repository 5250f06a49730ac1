"""A process that carries out runs: pickled arguments of `carry_out` come in, outcomes or exceptions go out."""

import os
import pickle
import sys
import threading
import traceback
from queue import SimpleQueue

from ..readers.files import remove, unfinished
from .framework import Outcome, carry_out


def main() -> None:
    """Answer what comes on standard input, until that ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    asked: SimpleQueue = SimpleQueue()
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()
    while True:
        spec, singular = asked.get()
        answer: Outcome | Exception
        try:
            answer = carry_out(spec, singular)
        except Exception as error:
            error.add_note(traceback.format_exc())
            answer = error
        pickle.dump(answer, answers)
        answers.flush()


def _listen(asked: SimpleQueue) -> None:
    """Pass on what is asked; when nobody is there any more, end at once, also in the middle of a run, and leave nothing."""
    try:
        while True:
            asked.put(pickle.load(sys.stdin.buffer))
    except EOFError:
        remove(unfinished)
        os._exit(0)


if __name__ == "__main__":
    main()
