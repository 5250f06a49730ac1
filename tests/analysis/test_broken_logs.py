"""Logs that are broken at random: what `calibrate` and `identify` answer lies within four deviations, or they
refuse and say why.

Motions are made by hand, of a platform with two driven wheels and of a car: other numbers, paths, periods and
noise in each log. Of some faults nothing is lost, so that the log must be answered.
"""

import contextlib
import csv
import io
import json
import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from noslip.cli.main import main

Columns = dict[str, np.ndarray]
Change = Callable[[Columns, np.random.Generator], Columns | None]
FARTHEST = 4.0  # deviations
ROUNDING = 3e-5  # of a value: angles are taken as linear between rows
TURN = 2 * math.pi
NIGHT = 8  # logs of each fault


# -- motions -------------------------------------------------------------------------------------------------


def path(
    random: np.random.Generator, t: np.ndarray, fastest: float, sharpest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Speed (m/s) and curvature (1/m) over time: a circle, an eight, a winding path, or with stops."""
    kind, a, b, c = random.integers(4), *random.uniform(0.3, 1.2, 3)
    speed = fastest * (0.6 + 0.3 * np.sin(a * t + 6 * b))
    curvature = sharpest * [0.7 + 0 * t, np.sign(np.sin(0.35 * t)), np.sin(b * t), np.sin(c * t)][kind]
    start = np.clip(t / 1.5, 0, 1) * (np.clip(2 * np.sin(0.6 * a * t) + 1, 0, 1) if kind == 3 else 1.0)
    return speed * start, curvature * np.clip((t - 2) / 3, 0, 1)


def moved(t: np.ndarray, forward: np.ndarray, turning: np.ndarray, heading: float) -> np.ndarray:
    """Poses (N, 3) from speed and rate of the heading, which are constant from row to row: chords of arcs."""
    turn, way = np.diff(t) * turning[:-1], np.diff(t) * forward[:-1]
    phi = heading + np.concatenate([[0.0], np.cumsum(turn)])
    chord, middle = way * np.sinc(turn / TURN), phi[:-1] + turn / 2
    x, y = (np.concatenate([[0.0], np.cumsum(chord * f(middle))]) for f in (np.cos, np.sin))
    return np.column_stack([x + 3.0, y - 2.0, phi])


def driven(random: np.random.Generator) -> tuple[list[str], dict[str, float], Columns]:
    """A log for `calibrate`: robot and options, true values, columns."""
    t = np.arange(random.integers(500, 900)) * random.choice([0.02, 0.05])
    noise = random.choice([0.2, 1.0, 3.0]) * np.array([2e-3, 2e-3, 1.5e-3])
    r, size = 0.15 * random.uniform(0.7, 1.4), random.uniform(0.7, 1.4)
    if random.random() < 0.7:
        b, d = 0.36 * size, 0.3
        speed, curvature = path(random, t, 0.8, 1.0)
        pose = moved(t, speed, speed * curvature, random.uniform(-3, 3))
        pose[:, :2] += d * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
        rates = {"theta_r": speed * (1 + b * curvature) / r, "theta_l": speed * (1 - b * curvature) / r}
        names, options, true = ("x_c", "y_c", "phi"), ["labmate", "--set", "b=0.4"], {"r": r, "b": b}
    else:
        length = 2.6 * size
        speed, curvature = path(random, t, 3.0, 0.2)
        delta = np.arctan(length * np.convolve(curvature, np.ones(15) / 15, "same"))
        # Between rows angles are linear
        fine = np.interp(np.arange(16 * (len(t) - 1) + 1) / 16, np.arange(len(t)), t)
        middle = np.interp((fine + fine[1] / 2)[:-1], t, delta)
        v = np.repeat(speed[:-1], 16)
        pose = moved(fine, np.append(v, 0), np.append(v * np.tan(middle) / length, 0), random.uniform(-3, 3))[
            ::16
        ]
        r *= 2
        rates = {"theta": speed / r}
        names, options, true = ("x", "y", "phi"), ["car"], {"r": r, "l": length}
    columns = {"t": t}
    for name, rate in rates.items():
        columns[name] = np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(t))]) + random.uniform(-3, 3)
    if "theta" in columns:
        columns["delta"] = delta
    columns |= dict(zip(names, (pose + noise * random.normal(size=pose.shape)).T, strict=True))
    return ["calibrate", "--robot", *options, "--fit", *true], true, columns


def accelerations(of: str, p: dict[str, float]) -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    """The equations of motion by hand: (rates, torques, steering angle) -> derivatives of the rates."""
    if of == "labmate":  # the platform turns about its axle; the masses of the wheels as points
        m, J = (
            p["m_c"] + 2 * p["m_w"],
            p["I_c"] + 2 * p["I_m"] + p["m_c"] * p["d"] ** 2 + 2 * p["m_w"] * p["b"] ** 2,
        )
        r, b = p["r"], p["b"]

        def platform(nu: np.ndarray, tau: np.ndarray, _: float) -> np.ndarray:
            v, w = r * (nu[0] + nu[1]) / 2, r * (nu[0] - nu[1]) / (2 * b)
            force, moment = (tau[0] + tau[1]) / r, (tau[0] - tau[1]) * b / r
            vdot = (force + p["m_c"] * p["d"] * w**2) / (m + 2 * p["I_w"] / r**2)
            wdot = (moment - p["m_c"] * p["d"] * v * w) / (J + 2 * p["I_w"] * b**2 / r**2)
            return np.array([vdot + b * wdot, vdot - b * wdot]) / r

        return platform

    def car(nu: np.ndarray, tau: np.ndarray, delta: float) -> np.ndarray:
        k = p["r"] * math.tan(delta) / p["l"]  # turning per rate of the wheel
        kdot = p["r"] / p["l"] / math.cos(delta) ** 2 * nu[1]
        turned = p["m"] * p["c"] ** 2 + p["I_c"]
        A = np.array(
            [
                [p["m"] * p["r"] ** 2 + p["I_w"] + (turned + p["I_s"]) * k**2, p["I_s"] * k],
                [p["I_s"] * k, p["I_s"]],
            ]
        )
        return np.linalg.solve(A, tau - np.array([(turned + p["I_s"]) * k, p["I_s"]]) * kdot * nu[0])

    return car


LABMATE = {
    "b": 0.36,
    "d": 0.3,
    "r": 0.15,
    "m_c": 30.0,
    "m_w": 1.0,
    "I_c": 15.625,
    "I_w": 0.005,
    "I_m": 0.0025,
}
CAR = {"m": 1200.0, "l": 2.6, "c": 1.3, "r": 0.3, "I_c": 1800.0, "I_s": 4.0, "I_w": 3.0}


def pushed(random: np.random.Generator) -> tuple[list[str], dict[str, float], Columns]:
    """A log for `identify`, of held torques."""
    of = "labmate" if random.random() < 0.7 else "car"
    period, rows = random.choice([0.01, 0.02]), 800
    t = np.arange(rows) * period
    a, b, c, e, f, g = random.uniform(0.7, 1.5, 6)
    if of == "labmate":
        p = LABMATE | {"m_c": random.uniform(20, 60), "I_c": random.uniform(5, 20)}
        push, steer = (
            3 * a * np.sin(1.3 * b * t) + 1.5 * np.sign(np.sin(0.8 * e * t)),
            2 * c * np.sin(2.1 * f * t),
        )
        tau, nu, fitted, noise = (
            np.column_stack([push + steer, push - steer]),
            np.array([3.0, 2.8]),
            ("m_c", "I_c"),
            0.02,
        )
    else:
        p = CAR | {"m": random.uniform(800, 1600), "I_c": random.uniform(1200, 2400)}
        drive, steer = (
            500 * a * np.sin(0.9 * b * t) + 200 * np.sign(np.sin(0.7 * e * t)),
            6 * np.cos(1.5 * f * t),
        )
        tau, nu, fitted, noise = np.column_stack([drive, steer]), np.array([25.0, 0.0]), ("m", "I_c"), 0.02
    rate, state, log = accelerations(of, p), np.array([*nu, 0.0]), []

    def derivative(s: np.ndarray, torque: np.ndarray) -> np.ndarray:
        return np.array([*rate(s[:2], torque, s[2]), s[1]])

    for torque in tau:
        log.append(state)
        h = period
        k1 = derivative(state, torque)
        k2 = derivative(state + h / 2 * k1, torque)
        k3 = derivative(state + h / 2 * k2, torque)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + derivative(state + h * k3, torque))
    states = np.array(log)
    noisy = states[:, :2] + random.choice([0.2, 1.0, 3.0]) * noise * random.normal(size=(rows, 2))
    true = {name: p[name] for name in fitted}
    given = [each for name, value in p.items() if name not in fitted for each in ("--set", f"{name}={value}")]
    names, taus = (
        (("thetadot_r", "thetadot_l"), ("tau_r", "tau_l"))
        if of == "labmate"
        else (("thetadot", "deltadot"), ("tau_d", "tau_s"))
    )
    columns = {"t": t, **dict(zip((*names, *taus), np.hstack([noisy, tau]).T, strict=True))}
    if of == "car":
        columns["delta"] = states[:, 2]
    return ["identify", "--robot", of, "--fit", *true, *given], true, columns


# -- faults --------------------------------------------------------------------------------------------------


def of_kind(c: Columns, kind: str) -> list[str]:
    """Names of wheel angles, poses, places, rates or torques that a log has."""
    kinds = {
        "angles": ("theta_r", "theta_l", "theta"),
        "place": ("x_c", "y_c", "x", "y"),
        "heading": ("phi",),
        "rates": ("thetadot_r", "thetadot_l", "thetadot", "deltadot"),
        "torques": ("tau_r", "tau_l", "tau_d", "tau_s"),
    }
    kinds["pose"] = kinds["place"] + kinds["heading"]
    return [name for name in c if name in kinds[kind]]


def each(
    kind: str, change: Callable[[np.ndarray, np.random.Generator], np.ndarray], single: bool = False
) -> Change:
    """Change columns of a kind, all or one of them at random."""

    def changed(c: Columns, random: np.random.Generator) -> Columns:
        names = of_kind(c, kind)
        names = [str(random.choice(names))] if single else names
        return {**c, **{name: change(c[name].copy(), random) for name in names}}

    return changed


def rows(choose: Callable[[int, np.random.Generator], np.ndarray]) -> Change:
    """Keep the rows that are chosen, of a number of rows."""
    return lambda c, random: (lambda kept: {name: v[kept] for name, v in c.items()})(
        choose(len(c["t"]), random)
    )


def swap(kind: str) -> Change:
    def swapped(c: Columns, _: np.random.Generator) -> Columns | None:
        names = of_kind(c, kind)[:2]
        return (
            {**c, **dict(zip(names, (c[name] for name in reversed(names)), strict=True))}
            if len(names) == 2
            else None
        )

    return swapped


def part(random: np.random.Generator, count: int, shortest: int, longest: int) -> slice:
    """Rows somewhere in the middle."""
    length = int(random.integers(shortest, longest))
    begin = int(random.integers(count // 10, count - count // 10 - length))
    return slice(begin, begin + length)


def spiked(most: int, size: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    def change(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
        at = random.choice(np.arange(5, len(v) - 5), int(random.integers(1, most + 1)), replace=False)
        v[at] += size * random.choice([-1, 1], len(at)) * random.uniform(0.3, 1.0, len(at))
        return v

    return change


def stepped(size: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    return lambda v, random: (
        v
        + size
        * random.choice([-1, 1])
        * random.uniform(0.3, 1)
        * (np.arange(len(v)) > random.uniform(0.1, 0.9) * len(v))
    )


def restarted(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
    at = int(random.uniform(0.2, 0.8) * len(v))
    return np.where(np.arange(len(v)) >= at, v - v[at], v)


def register(bits: int, signed: bool) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    def change(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
        count, size = TURN / random.choice([512, 4096, 16384]), 2**bits
        n = np.round(v / count).astype(np.int64) + int(random.integers(size))
        n = n - n[len(n) // 2] if bits == 32 else n  # so that it starts again within the log
        return count * ((n + size // 2 * signed) % size - size // 2 * signed)

    return change


def held(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
    every = int(random.integers(2, 6))
    return v[np.arange(len(v)) // every * every]


def stuck(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
    at = part(random, len(v), 10, 60)
    v[at] = v[at.start]
    return v


def clipped(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
    low, high = np.quantile(v, [0.0, random.uniform(0.7, 0.98)])
    return np.clip(v, low, high)


def late(kind: str, longest: float) -> Change:
    def change(c: Columns, random: np.random.Generator) -> Columns:
        delay = random.uniform(0.2, 1.0) * longest
        return {**c, **{name: np.interp(c["t"] - delay, c["t"], c[name]) for name in of_kind(c, kind)}}

    return change


def drifted(c: Columns, random: np.random.Generator) -> Columns:
    """The clock of the pose or of the torques runs otherwise."""
    t = c["t"] * (1 + 2e-3 * random.uniform(-1, 1))
    return {
        **c,
        **{name: np.interp(t, c["t"], c[name]) for name in (*of_kind(c, "pose"), *of_kind(c, "torques"))},
    }


def jittered(c: Columns, random: np.random.Generator) -> Columns:
    step = np.diff(c["t"]) * random.choice([0.8, 0.8, 0.8, 1.7], len(c["t"]) - 1)
    t = np.concatenate([[0.0], np.cumsum(step)])
    return (
        {**c, "t": t}
        if of_kind(c, "angles")
        else {name: np.interp(t, c["t"], v) if name != "t" else t for name, v in c.items()}
    )


def unevenly_stamped(c: Columns, random: np.random.Generator) -> Columns:
    return {**c, "t": c["t"] + 0.3 * np.median(np.diff(c["t"])) * random.uniform(-1, 1, len(c["t"]))}


def turns_both_ways(c: Columns) -> bool:
    """Whether a log can tell a wheel or sensor that differs from another radius or track,
    as on a circle it cannot."""
    turned = np.diff(c["phi"][::25])
    return "theta_r" in c and min(turned.max(), -turned.min()) > 0.1


def moved_sensor(c: Columns, random: np.random.Generator) -> Columns | None:
    if not turns_both_ways(c):
        return None
    x, y = of_kind(c, "place")
    ahead, left, phi = *random.uniform(-0.3, 0.3, 2), c["phi"]
    return {
        **c,
        x: c[x] + ahead * np.cos(phi) - left * np.sin(phi),
        y: c[y] + ahead * np.sin(phi) + left * np.cos(phi),
        "phi": phi + random.uniform(-0.1, 0.1),
    }


def rounded(finest: float, coarsest: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    def change(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
        step = math.exp(random.uniform(math.log(finest), math.log(coarsest)))
        return step * np.round(v / step)

    return change


def at_rest_before(c: Columns, _: np.random.Generator) -> Columns:
    """A wheel that rests where its angle starts again, three decimals."""
    count, step = 80, float(c["t"][1] - c["t"][0])
    c = {name: np.concatenate([np.full(count, v[0]), v]) for name, v in c.items()}
    c["t"][:count] -= step * np.arange(count, 0, -1)
    for name in of_kind(c, "angles"):
        jitter = 1e-4 * np.random.default_rng(1).normal(size=len(c["t"])) * (np.arange(len(c["t"])) < count)
        c[name] = np.round(wrapped(c[name] - c[name][0] + math.pi + jitter), 3)
    return c


def wrapped(v: np.ndarray) -> np.ndarray:
    return np.remainder(v + math.pi, TURN) - math.pi


def every(least: int, most: int) -> Change:
    return rows(lambda n, random: np.arange(0, n, int(random.integers(least, most + 1))))


def then(*changes: Change) -> Change:
    def change(c: Columns, random: np.random.Generator) -> Columns | None:
        for each in changes:
            c = c and each(c, random)
        return c

    return change


def fewer_poses(c: Columns, random: np.random.Generator) -> Columns:
    empty = np.arange(len(c["t"])) % int(random.integers(3, 20)) != 0
    return {**c, **{name: np.where(empty, math.nan, c[name]) for name in of_kind(c, "pose")}}


def slipped(c: Columns, random: np.random.Generator) -> Columns:
    """A wheel spins on the spot for a while."""
    return each(
        "angles",
        lambda v, r: (
            v
            + np.interp(
                np.arange(len(v)), [(k := r.uniform(0.1, 0.8) * len(v)), k + 15], [0, r.uniform(0.5, 6)]
            )
        ),
        True,
    )(c, random)


def fraction_empty(v: np.ndarray, random: np.random.Generator) -> np.ndarray:
    v[random.random(len(v)) < 0.05] = math.nan
    return v


def backwards(v, r):
    """Angles that turn the other way from somewhere on."""
    k = int(r.uniform(0.2, 0.8) * len(v))
    return np.where(np.arange(len(v)) > k, 2 * v[k] - v, v)


def pose_stuck(c, r):
    """A pose that stands for a while."""
    at = part(r, len(c["t"]), 10, 60)
    return {
        **c,
        **{
            n: np.where(np.isin(np.arange(len(c[n])), np.r_[at]), c[n][at.start], c[n])
            for n in of_kind(c, "pose")
        },
    }


def held_together(kind, most):
    """Columns of a kind that change every second row, or up to every row before `most`."""

    def broken(c, r):
        k = int(r.integers(2, most))
        return {**c, **{n: c[n][np.arange(len(c["t"])) // k * k] for n in of_kind(c, kind)}}

    return broken


def one_wheel_larger(c, r):
    """Only where the vehicle turns both ways."""
    return (
        each("angles", lambda v, r: v * (1 + r.uniform(-0.03, 0.03)), True)(c, r)
        if turns_both_ways(c)
        else None
    )


def friction(c, r):
    """Torques that friction of the wheels takes a tenth of."""
    pairs = zip(of_kind(c, "torques"), of_kind(c, "rates"), strict=True)
    return {**c, **{n: c[n] + 0.1 * np.std(c[n]) * c[v] / np.std(c[v]) for n, v in pairs}}


CALIBRATE: dict[str, Change] = {
    "nothing": lambda c, _: c,
    "wrapped": each("angles", lambda v, _: wrapped(v)),
    "wrapped from 0": each("angles", lambda v, _: np.remainder(v, TURN)),
    "wrapped, rounded": each("angles", lambda v, _: np.round(wrapped(v), 3)),
    "wrapped at rest": at_rest_before,
    "heading wrapped": each("heading", lambda v, _: wrapped(v)),
    "heading from 0": each("heading", lambda v, _: np.remainder(v, TURN)),
    "int16": each("angles", register(16, True)),
    "uint16": each("angles", register(16, False)),
    "uint32": each("angles", register(32, False)),
    "restart": each("angles", restarted),
    "one restarts": each("angles", restarted, True),
    "spike": each("angles", spiked(1, 100.0), True),
    "spikes": each("angles", spiked(8, 5.0)),
    "bit": each("angles", spiked(2, 64 * TURN / 4096), True),
    "poses far off": each("pose", spiked(20, 3.0)),
    "place jumps": each("place", stepped(1.0)),
    "place jumps a little": each("place", stepped(0.05)),
    "heading jumps": each("heading", stepped(1.0)),
    "wheels exchanged": swap("angles"),
    "x and y exchanged": swap("place"),
    "wheel backwards": each("angles", lambda v, _: -v, True),
    "heading backwards": each("heading", lambda v, _: -v),
    "y mirrored": each("place", lambda v, _: -v, True),
    "angles in degrees": each("angles", lambda v, _: np.degrees(v)),
    "heading in degrees": each("heading", lambda v, _: np.degrees(v)),
    "place in mm": each("place", lambda v, _: 1000 * v),
    "backwards from the middle": each("angles", backwards, True),
    "fewer rows": every(2, 6),
    "wrapped, fewer rows": then(each("angles", lambda v, _: wrapped(v)), every(5, 40)),
    "gap": rows(lambda n, random: np.delete(np.arange(n), part(random, n, 5, 60))),
    "wrapped with a gap": then(
        each("angles", lambda v, _: wrapped(v)), rows(lambda n, r: np.delete(np.arange(n), part(r, n, 5, 60)))
    ),
    "rows lost": rows(lambda n, random: np.flatnonzero(random.random(n) > random.uniform(0.02, 0.3))),
    "rows twice": rows(lambda n, random: np.sort(np.concatenate([np.arange(n), random.integers(0, n, 30)]))),
    "few counts": each("angles", rounded(TURN / 4000, TURN / 60)),
    "rounded poses": each("pose", rounded(1e-3, 2e-2)),
    "late poses": late("pose", 0.3),
    "wheel stuck": each("angles", stuck, True),
    "pose stuck": pose_stuck,
    "poses held": held_together("pose", 8),
    "angles held": held_together("angles", 5),
    "another clock": drifted,
    "times jitter": jittered,
    "angle saturates": each("angles", clipped, True),
    "one wheel larger": one_wheel_larger,
    "sensor moved": moved_sensor,
    "wheel slips": slipped,
    "entries missing": each("pose", fraction_empty),
    "angles missing": each("angles", fraction_empty),
    "few poses": fewer_poses,
    "noisy": each("pose", lambda v, r: v + 0.03 * r.normal(size=len(v))),
    "drifting heading": each(
        "heading", lambda v, r: v + 0.02 * np.cumsum(r.normal(size=len(v))) / math.sqrt(len(v))
    ),
}

IDENTIFY: dict[str, Change] = {
    "nothing": lambda c, _: c,
    "spike": each("rates", spiked(1, 50.0), True),
    "spikes": each("rates", spiked(12, 5.0)),
    "torque spike": each("torques", lambda v, r: spiked(2, 20 * np.std(v))(v, r), True),
    "rate backwards": each("rates", lambda v, _: -v, True),
    "torque backwards": each("torques", lambda v, _: -v, True),
    "rates exchanged": swap("rates"),
    "torques exchanged": swap("torques"),
    "torque backwards from the middle": each(
        "torques", lambda v, r: np.where(np.arange(len(v)) > r.uniform(0.2, 0.8) * len(v), -v, v), True
    ),
    "rates held": held_together("rates", 6),
    "one rate held": each("rates", held, True),
    "late torques": late("torques", 0.05),
    "late rates": late("rates", 0.05),
    "rate stuck": each("rates", stuck, True),
    "torque stuck": each("torques", stuck, True),
    "gap": rows(lambda n, random: np.delete(np.arange(n), part(random, n, 5, 60))),
    "rows lost": rows(lambda n, random: np.flatnonzero(random.random(n) > random.uniform(0.01, 0.05))),
    "many rows lost": rows(lambda n, random: np.flatnonzero(random.random(n) > random.uniform(0.05, 0.4))),
    "rows twice": rows(lambda n, random: np.sort(np.concatenate([np.arange(n), random.integers(0, n, 30)]))),
    "fewer rows": every(2, 4),
    "rounded rates": each("rates", rounded(1e-3, 0.2)),
    "rounded torques": each("torques", lambda v, r: rounded(1e-3 * np.std(v), 0.3 * np.std(v))(v, r)),
    "rate saturates": each("rates", clipped, True),
    "torque saturates": each("torques", clipped, True),
    "another clock": drifted,
    "times jitter": unevenly_stamped,
    "friction": friction,
    "torque offset": each("torques", lambda v, r: v + 0.1 * np.std(v) * r.uniform(-1, 1), True),
    "rate offset": each("rates", lambda v, r: v + 0.1 * np.std(v) * r.uniform(-1, 1), True),
    "filtered rates": each(
        "rates", lambda v, _: np.convolve(np.pad(v, (4, 0), "edge"), np.ones(5) / 5, "valid")
    ),
    "noisy torques": each("torques", lambda v, r: v + 0.1 * np.std(v) * r.normal(size=len(v))),
    "noisy rates": each("rates", lambda v, r: v + 0.1 * np.std(v) * r.normal(size=len(v))),
    "entries missing": each("rates", fraction_empty),
    "rates zero": each(
        "rates",
        lambda v, r: np.where(np.isin(np.arange(len(v)), np.arange(len(v))[part(r, len(v), 5, 40)]), 0.0, v),
    ),
    "drifting rate": each(
        "rates", lambda v, r: v + 0.1 * np.std(v) * np.cumsum(r.normal(size=len(v))) / math.sqrt(len(v))
    ),
    "in degrees": each("rates", lambda v, _: np.degrees(v)),
    "in rpm": each("rates", lambda v, _: v * 60 / TURN),
    "in ms": lambda c, _: {**c, "t": 1000 * c["t"]},
}

ANSWERED = {  # faults that do not take anything away: most logs must be answered
    "calibrate": {
        "nothing",
        "wrapped",
        "wrapped from 0",
        "wrapped, rounded",
        "wrapped at rest",
        "heading wrapped",
        "heading from 0",
        "int16",
        "uint16",
        "uint32",
        "restart",
        "one restarts",
        "spike",
        "spikes",
        "bit",
        "poses far off",
        "place jumps",
        "place jumps a little",
        "gap",
        "wrapped with a gap",
        "rows lost",
        "rows twice",
        "few counts",
        "rounded poses",
        "wheel stuck",
        "pose stuck",
        "poses held",
        "angles held",
        "times jitter",
        "entries missing",
        "angles missing",
        "few poses",
        "noisy",
        "wheel slips",
    },
    "identify": {
        "nothing",
        "spike",
        "spikes",
        "torque spike",
        "rates held",
        "one rate held",
        "gap",
        "rows lost",
        "rows twice",
        "rounded rates",
        "rate stuck",
        "rate saturates",
        "rates zero",
    },
}
CAUSE = re.compile(
    r"row|theta|phi|delta|tau|x_c|y_c|\bx\b|\by\b|\bt\b|\b[rblm]\b|m_c|I_c|heading|errors|column"
)


def answer(tmp_path, command: str, fault: str, seed: int) -> str:
    """'right', 'refused', 'skipped' where the fault does not apply, or what is wrong."""
    faults = CALIBRATE if command == "calibrate" else IDENTIFY
    random = np.random.default_rng([seed, sorted(faults).index(fault), len(command)])
    arguments, true, columns = (driven if command == "calibrate" else pushed)(random)
    broken = faults[fault](columns, random)
    if broken is None:
        return "skipped"
    file = tmp_path / "broken.csv"
    with file.open("w", newline="") as stream:
        cells = ([repr(float(e)) if e == e else "" for e in column] for column in broken.values())
        csv.writer(stream).writerows([list(broken), *zip(*cells, strict=True)])
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([arguments[0], str(file), *arguments[1:], "--json"])
    if status not in (0, 1, 2):
        return f"exit {status}: {err.getvalue().strip()}"
    if status == 2:
        said = err.getvalue().strip()
        return "refused" if "\n" not in said and CAUSE.search(said) else f"refused without a cause: {said}"
    result = json.loads(out.getvalue())
    for name, e in result["parameters"].items():
        if abs(e["value"] - true[name]) > FARTHEST * e["sd"] + ROUNDING * true[name]:
            return f"{name} = {e['value']:.6g} +- {e['sd']:.2g}, true {true[name]:.6g}; {result['remarks']}"
    if status == 0 and set(result["parameters"]) != set(true):
        return "answers with exit 0, but not all"
    return "right" if status == 0 else "refused" if result["unidentifiable"] else "exit 1 without a cause"


def check(tmp_path, command: str, fault: str, seeds: range) -> None:
    answers = [answer(tmp_path, command, fault, seed) for seed in seeds]
    wrong = {
        seed: each
        for seed, each in zip(seeds, answers, strict=True)
        if each not in ("right", "refused", "skipped")
    }
    assert not wrong
    if fault in ANSWERED[command]:
        assert answers.count("right") >= 0.8 * (len(answers) - answers.count("skipped")) - 1, answers


CASES = [("calibrate", fault) for fault in CALIBRATE] + [("identify", fault) for fault in IDENTIFY]


@pytest.mark.parametrize(("command", "fault"), CASES[::9])
def test_a_broken_log_is_answered_right_or_refused(command, fault, tmp_path):
    check(tmp_path, command, fault, range(1))


WAS_WRONG = [
    ("calibrate", "angles held", 1),  # they were interpolated
    ("calibrate", "wheel stuck", 0),  # it was refused
    ("calibrate", "wheel stuck", 15),  # a steering angle at rest was taken for one that is stuck
    ("calibrate", "one wheel larger", 21),
    ("identify", "rate offset", 5),
]


@pytest.mark.parametrize(("command", "fault", "seed"), WAS_WRONG)
def test_logs_that_were_answered_wrong(command, fault, seed, tmp_path):
    assert answer(tmp_path, command, fault, seed) == "right"


@pytest.mark.nightly
@pytest.mark.parametrize(("command", "fault"), CASES)
def test_broken_logs_are_answered_right_or_refused(command, fault, tmp_path):
    check(tmp_path, command, fault, range(NIGHT))
