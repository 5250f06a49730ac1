"""A step of numerical integration, for numbers and for CasADi's expressions alike."""

from collections.abc import Callable, Iterable
from typing import TypeVar

import casadi as ca
import numpy as np

State = TypeVar("State", ca.SX, np.ndarray)


def runge_kutta(rates: Iterable[Callable[[State], State]], x: State, h: State | float) -> State:
    """Return x after a step of length h of order 4; `rates` of x at its beginning, twice in its middle,
    and at its end."""
    begin, middle, again, end = rates
    k1 = begin(x)
    k2 = middle(x + h / 2 * k1)
    k3 = again(x + h / 2 * k2)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + end(x + h * k3))
