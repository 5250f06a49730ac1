"""Coulomb friction at several contacts at once, for one step of time."""

from __future__ import annotations

import numpy as np

CREEP = 1e-6  # m/s: slip of a contact that rolls, where its force is as large as its load; shares what several contacts hold
CLOSE = 1e-8  # relative, of a sliding contact's force to its limit
LEAST = 1e-9  # N, of a limit
TRIES = 20
SWEEPS = 300


def coulomb(give: np.ndarray, free: np.ndarray, load: np.ndarray, mu: np.ndarray, creep: float = CREEP) -> np.ndarray:
    """Return the friction forces F, (2 c,), N, two components at each of c contacts.

    The slip after the step is `free` + `give` F, (2 c,), m/s; `give` (2 c, 2 c) is symmetric and may be singular. At each
    contact |F| <= mu load; where it is less, the contact does not slip; where it is equal, F is opposite to the slip. F minimizes
    F' give F / 2 + F' free within these limits. A force that several contacts can hold is shared by load; a contact
    that rolls slips by `creep` (m/s) times its force over its load.

    Every sliding contact has a multiplier, its slip divided by its force; each is found by Newton's method for the reciprocal of
    the size of its force, as the radius of a trust region is met (Moré and Sorensen, 1983), all at once; where that does not
    converge, contact by contact.
    """
    limit = np.maximum(mu * load, LEAST)
    base = give + np.diag(np.repeat(creep / np.maximum(load, CREEP), 2))
    slides = np.zeros(len(load))
    for _ in range(TRIES):
        inverse = np.linalg.inv(base + np.diag(np.repeat(slides, 2)))
        force = -(inverse @ free).reshape(-1, 2)
        size = np.hypot(*force.T)
        beyond = size / limit - 1
        if np.all((np.abs(beyond) <= CLOSE) | ((beyond < 0) & (slides == 0))):
            return force.ravel()
        blocks = inverse.reshape(len(load), 2, len(load), 2)
        bends = np.array([f @ blocks[k, :, k] @ f for k, f in enumerate(force)])
        change = np.divide(size**2 * beyond, bends, out=np.zeros_like(size), where=bends > 0)
        slides = np.maximum(slides + change, 0.0)
    force = (force * np.minimum(1.0, limit / np.maximum(size, limit))[:, None]).ravel()
    return force if len(load) == 1 else _in_turn(give, free, load, mu, creep, force)


def _in_turn(give: np.ndarray, free: np.ndarray, load: np.ndarray, mu: np.ndarray, creep: float, force: np.ndarray) -> np.ndarray:
    """Return the same, contact by contact with the others held (Gauss and Seidel): slower, and sure.

    The forces are within their limits also where the last sweep is not exact; the next step starts from the slip that is left.
    """
    for _ in range(SWEEPS):
        before = force.copy()
        for k in range(len(load)):
            own = slice(2 * k, 2 * k + 2)
            others = free[own] + give[own] @ force - give[own, own] @ force[own]
            force[own] = coulomb(give[own, own], others, load[k : k + 1], mu[k : k + 1], creep)
        if np.abs(force - before).max() <= CLOSE * np.abs(force).max():
            break
    return force
