"""State feedback on an emulated processor: its generated header in an image of firmware/pil,
called from here."""

from functools import lru_cache

import numpy as np

from ....readers.errors import check_status
from ..pil import Handle, Served, session_of
from ..runtime import runtime
from .feedback import Balanced
from .in_c import HEADER, callable_files

CHOSEN = """#include "{name}.h"
#define PIL_FEEDBACK(name) {name}##name##_f
#define PIL_STATES {upper}_STATES
#define PIL_INPUTS {upper}_INPUTS
"""


@lru_cache(maxsize=16)
def served_feedback(balanced: Balanced) -> Served:
    """Return what an image of a feedback serves."""
    name = f"{balanced.name}_lqr"
    return Served(callable_files(balanced, []), CHOSEN.format(name=name, upper=name.upper()))


class BalanceOnTarget:
    """A Feedback: its C in float on the processor of a backend. Raises BadInput as `Session`,
    and where init refuses a number."""

    def __init__(self, balanced: Balanced, backend: str):
        self._handle = Handle(session_of(served_feedback(balanced), backend), "feedback")
        check_status(self._call("init", b"")[0], f"{balanced.name}_lqr: init")

    def _call(self, operation: str, given: bytes) -> tuple[str, bytes]:
        status, answer = self._handle.session.call(f"feedback_{operation}", self._handle.number, given)
        return runtime(HEADER).status(status), answer

    def step(self, state: np.ndarray, desired: np.ndarray) -> tuple[str, np.ndarray]:
        """See Feedback."""
        with np.errstate(over="ignore"):  # values too large for float become infinite, which the C rejects
            status, answer = self._call("step", np.array([state, desired], np.float32).tobytes())
        return status, np.frombuffer(answer, np.float32).astype(float)
