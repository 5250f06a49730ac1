"""Coulomb friction at several contacts at once, for one step of time."""

from __future__ import annotations

import numpy as np

# m/s: slip of a contact that rolls, where its force is as large as its load; shares what several contacts
# hold
CREEP = 1e-6
CLOSE = 1e-8  # relative, of a sliding contact's force to its limit
LEAST = 1e-9  # N, of a limit
TRIES, NEWTON = 20, 60
SHORTER = [4.0**-k for k in range(12)]


def coulomb(
    give: np.ndarray, free: np.ndarray, load: np.ndarray, mu: np.ndarray, creep: float = CREEP
) -> np.ndarray:
    """Return the friction forces F, (2 c,), N, two components at each of c contacts.

    The slip after the step is `free` + `give` F, (2 c,), m/s; `give` (2 c, 2 c) is symmetric and may be
    singular. At each contact |F| <= mu load; where it is less, the contact does not slip; where it is equal,
    F is opposite to the slip. F minimizes F' give F / 2 + F' free within these limits. A force that several
    contacts can hold is shared by load; a contact that rolls slips by `creep` (m/s) times its force over its
    load.

    Every sliding contact has a multiplier, its slip divided by its force; each is found by Newton's method
    for the reciprocal of the size of its force, as the radius of a trust region is met (Moré and Sorensen,
    1983), side by side; where contacts depend too much on each other for that, all at once.
    """
    limit = np.maximum(mu * load, LEAST)
    base = _with_diagonal(give, creep / np.maximum(load, CREEP))
    slides = np.zeros(len(load))
    for _ in range(TRIES):
        inverse = np.linalg.inv(_with_diagonal(base, slides) if slides.any() else base)
        force = -(inverse @ free).reshape(-1, 2)
        size = np.hypot(force[:, 0], force[:, 1])
        beyond = size / limit - 1
        if ((np.abs(beyond) <= CLOSE) | ((beyond < 0) & (slides == 0))).all():
            return force.ravel()
        blocks = inverse.reshape(len(load), 2, len(load), 2)
        bends = np.array([f @ blocks[k, :, k] @ f for k, f in enumerate(force)])
        change = np.divide(size**2 * beyond, bends, out=np.zeros_like(size), where=bends > 0)
        slides = np.maximum(slides + change, 0.0)
    force = (force * np.minimum(1.0, limit / np.maximum(size, limit))[:, None]).ravel()
    return force if len(load) == 1 else _together(base, free, limit, force)


def _with_diagonal(matrix: np.ndarray, more: np.ndarray) -> np.ndarray:
    """Return a matrix (2 c, 2 c) with (c,) added to its diagonal, twice each."""
    made = matrix.copy()
    made.reshape(-1)[:: len(made) + 1] += more.repeat(2)
    return made


def _together(base: np.ndarray, free: np.ndarray, limit: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the same by Newton's method for all multipliers s at once, in the dual problem: with F =
    -(base + diag(s))^-1 free, maximize F' free / 2 - s' limit^2 / 2 for s >= 0, which is concave. A step that
    does not raise it is shortened. `force` is returned where contacts without a load leave nothing to do, and
    within the limits where this does not converge.
    """
    loaded = np.flatnonzero(limit > LEAST)
    own, count = np.repeat(2 * loaded, 2) + np.tile([0, 1], len(loaded)), len(loaded)
    B, f, most, s = base[np.ix_(own, own)], free[own], limit[loaded], np.zeros(count)

    def at(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        inverse = np.linalg.inv(_with_diagonal(B, s))
        F = -(inverse @ f)
        return inverse.reshape(count, 2, count, 2), F.reshape(count, 2), float(F @ f - s @ most**2) / 2

    inverse, F, value = at(s)
    for _ in range(NEWTON):
        size = np.hypot(*F.T)
        held = (size <= most * (1 + CLOSE)) & (s == 0)
        if np.all(held | (np.abs(size / most - 1) <= CLOSE)):
            break
        slope, moves = (size**2 - most**2) / 2, np.flatnonzero(~held)
        bends = np.einsum("ka,kalb,lb->kl", F, inverse, F)[np.ix_(moves, moves)]
        step = np.zeros(count)
        step[moves] = np.linalg.lstsq(bends, slope[moves], rcond=None)[0]
        for shorter in SHORTER:
            inverse, F, new = at(following := np.maximum(s + shorter * step, 0.0))
            if new > value:
                break
        s, value = following, new
    force[own] = (F * np.minimum(1.0, most / np.maximum(np.hypot(*F.T), most))[:, None]).ravel()
    return force
