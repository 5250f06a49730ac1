"""CasADi functions without the cost of converting arguments and results."""

from threading import Lock
from typing import Any

import casadi as ca
import numpy as np


class Direct:
    """A CasADi function called through fixed buffers: no conversion, a microsecond. All arguments and results
    are dense.

    Threads that share it take turns.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self._arguments = [
            np.zeros(function.size1_in(k) * function.size2_in(k)) for k in range(function.n_in())
        ]
        self._results = [
            np.zeros(function.size1_out(k) * function.size2_out(k)) for k in range(function.n_out())
        ]
        self._buffer: Any  # its stub asks for the sizes too, which the call does not take
        self._buffer, self._evaluate = function.buffer()
        self._lock = Lock()
        for k, array in enumerate(self._arguments):
            self._buffer.set_arg(k, array.data)
        for k, array in enumerate(self._results):
            self._buffer.set_res(k, array.data)

    def __call__(self, *arguments: np.ndarray | float) -> list[np.ndarray]:
        """The results, each a fresh column-major vector."""
        with self._lock:
            for array, argument in zip(self._arguments, arguments, strict=True):
                array[:] = argument
            self._evaluate()
            return [array.copy() for array in self._results]
