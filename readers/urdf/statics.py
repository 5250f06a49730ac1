"""How the weight of a robot at rest is shared by what it stands on."""

from collections.abc import Mapping, Sequence

import numpy as np

from .parts import Part, ahead_and_left


def shares(
    base: Part,
    others: Sequence[Part],
    trailers: Sequence[Part],
    castors: Mapping[str, np.ndarray],
    heading: np.ndarray,
) -> tuple[dict[str, float], dict[str, float], bool]:
    """Return the part of the whole weight on each wheel, by joint, and on each castor, by link, and whether
    they can carry it.

    The robot is straight and level. If they cannot carry it, the wheels are taken to carry all.

    A trailer rests on its axle and on its hitch. The base with `others`, its steered parts and links of an
    arm, rests on wheels and castors; if these are more than three, the loads are taken as linear in the
    place, as on equal springs.
    """
    total = sum(part.mass for part in (base, *others, *trailers))
    carried: dict[str, float] = {}
    weights = [(part.mass, *_place(part, base, heading)) for part in (base, *others)]
    pulled = 0.0  # kg on the hitch of the trailer before
    for k in reversed(range(len(trailers))):
        part, after = trailers[k], trailers[k + 1] if k + 1 < len(trailers) else None
        length = ahead_and_left(part.pivot - part.origin, heading)[0]
        behind = ahead_and_left(after.pivot - part.origin, heading)[0] if after else 0.0
        on_hitch = (part.mass * part.ahead + pulled * behind) / length
        half = ahead_and_left(part.wheels[1].centre - part.origin, heading)[1]
        for wheel, side in zip(part.wheels, (-1, 1), strict=True):
            carried[wheel.joint] = (part.mass + pulled - on_hitch) / 2 + side * part.mass * part.left / (
                2 * half
            )
        pulled = on_hitch
    if trailers:
        weights.append((pulled, *ahead_and_left(trailers[0].pivot - base.origin, heading)))
    wheels = [*base.wheels, *[wheel for part in others for wheel in part.wheels]]
    places = [wheel.centre for wheel in wheels] + list(castors.values())
    stands = np.array([ahead_and_left(place - base.origin, heading) for place in places])
    loads, stable = _loads(np.array(weights), stands, len(wheels))
    carried |= {wheel.joint: load for wheel, load in zip(wheels, loads, strict=False)}
    on_castors = {
        link: load / total for link, load in zip(castors, loads[len(wheels) :].tolist(), strict=True)
    }
    return {joint: max(0.0, load) / total for joint, load in carried.items()}, on_castors, stable


def _place(part: Part, base: Part, heading: np.ndarray) -> tuple[float, float]:
    ahead, left = ahead_and_left(part.origin - base.origin, heading)
    return ahead + part.ahead, left + part.left


def _loads(weights: np.ndarray, stands: np.ndarray, wheels: int) -> tuple[np.ndarray, bool]:
    """Return the load on each stand, kg, from weights (kg, ahead, left), and whether they can carry it."""
    forces = np.array([weights[:, 0].sum(), weights[:, 0] @ weights[:, 1], weights[:, 0] @ weights[:, 2]])
    kept = list(range(len(stands)))
    size = np.abs(stands).max() * forces[0]
    while len(kept) > 1:
        rows = np.vstack([np.ones(len(kept)), stands[kept].T])
        loads = np.linalg.lstsq(rows, forces, rcond=None)[0]
        if np.abs(rows @ loads - forces).max() > 1e-9 * size:
            break
        if loads.min() >= 0:
            all_loads = np.zeros(len(stands))
            all_loads[kept] = loads
            return all_loads, True
        kept.remove(kept[int(loads.argmin())])  # it is lifted
    rows = np.vstack([np.ones(wheels), stands[:wheels, 1]])
    all_loads = np.zeros(len(stands))
    all_loads[:wheels] = np.linalg.lstsq(rows, forces[[0, 2]], rcond=None)[0]
    return all_loads, False
