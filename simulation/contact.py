"""Rolling without slip: the ground force at each contact of a run, compared with the limit of friction.

The constraint forces lambda (8) are those that the ground must supply for the robot to roll without slip. If
several contacts share one of them, the equations do not determine its distribution (two wheels of an axle,
sideways); here it is proportional to their loads at rest. Loads are those of a level ground at rest, moved to
the outer wheel of each axle by the height of the centre of mass, without dynamics; for a robot that names all
its supports they are those of the balance of all moments, with load transfer forward and back.
"""

from __future__ import annotations

import dataclasses
import itertools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.algebra.linear_numbers import least_norm
from ..model.algebra.trigonometry import sine_cosine
from ..model.contacts import GRAVITY, axles, narrow, on_centre_line, unknown_loads
from ..model.mechanism import Mechanism
from ..readers.errors import BadInput
from .controllers.odometry import vehicle_wheels
from .planning.profile import Accelerations
from .plant import Plant
from .specification.spec import ContactSection

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .run import Run

    Coloured = Sequence[tuple["ContactForce", str]]

LEAST = 1e-6  # of the largest load: the part of a shared force that a wheel without load takes
NEGLIGIBLE = 1e-9  # relative; a singular value below it is due to rounding
LARGE = 1e3  # friction coefficients above this are printed without decimals
HIGHEST = 4.0  # upper limit of friction use in the plot
WIDE_CURVE = 100.0  # m/s, on a curve with a lateral acceleration of 1 m/s^2
WIDE = 140  # characters per line of the title


@dataclass(frozen=True, eq=False)
class ContactForce:
    """Force of the ground on the robot at one contact, N, (N,) each: forward, to the left,
    and the load, upward."""

    name: str
    longitudinal: np.ndarray
    lateral: np.ndarray
    load: np.ndarray
    mu: float
    support: bool = False  # without friction, such as a castor

    @property
    def needs(self) -> np.ndarray:
        """The friction coefficient required, |F| / load; infinite without load."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.hypot(self.longitudinal, self.lateral) / self.load
        return np.where((self.load > 0) & np.isfinite(ratio), ratio, np.inf)

    @property
    def use(self) -> np.ndarray:
        """|F| / (mu load): above 1 the contact would slip."""
        return self.needs / self.mu


@dataclass(frozen=True, eq=False)
class Grip:
    """The contacts of a run at the times t (N,) of its rows, and the assumptions.

    Only the rows are evaluated: what happens between them, for instance before the torque changes, is not
    seen.
    """

    t: np.ndarray
    contacts: tuple[ContactForce, ...]
    options: ContactSection
    unknown: str = "the robot defines no contacts"
    whole_axles: bool = False  # each contact stands for one, see `on_centre_line`

    @property
    def rolls(self) -> bool:
        """Whether every contact keeps its load and stays within friction, at every row."""
        return all(np.all(contact.use <= 1) for contact in self.contacts)

    def verdict(self) -> str:
        """Return a line for each finding: lifts, would slip, or rolls."""
        if not self.contacts:
            return f"not known whether it rolls: {self.unknown}"
        lifts = [
            f"{c.name}, first at t = {self._first(c.load <= 0)}" for c in self.contacts if np.any(c.load <= 0)
        ]
        slips = [self._slip(c) for c in self.contacts if np.any((c.use > 1) & ~(c.load <= 0))]
        lines = [
            f"{kind}: {'; '.join(found)}"
            for kind, found in (("wheel lifts", lifts), ("would slip", slips))
            if found
        ]
        return (
            "\n".join(lines)
            or "rolls: friction use at most "
            f"{', '.join(self._worst(c) for c in self.contacts if not c.support)}"
        )

    def summary(self) -> str:
        """Return the verdict and, in a last line, its assumptions."""
        return f"{self.verdict()}\n{self.assumed()}" if self.contacts else self.verdict()

    def as_json(self) -> dict[str, Any]:
        """Return the same: `rolls`, None if the robot defines no contacts, and by contact its verdict, the
        largest friction use and the friction coefficient required, with their times in s (None: no time, or
        infinite).
        """
        return {
            "rolls": self.rolls if self.contacts else None,
            "contacts": {contact.name: self._contact_json(contact) for contact in self.contacts},
            "assumed": dataclasses.asdict(self.options) | {"gravity": GRAVITY},
        }

    def _contact_json(self, contact: ContactForce) -> dict[str, Any]:
        lifts, slips = contact.load <= 0, contact.use > 1
        worst = int(np.argmax(contact.use))
        return {
            "verdict": "lifts" if lifts.any() else "would slip" if slips.any() else "rolls",
            "first": float(self.t[np.argmax(lifts if lifts.any() else slips)]) if slips.any() else None,
            "friction_use": float(contact.use[worst]),
            "friction_required": float(contact.needs[worst]),
            "at": float(self.t[worst]),
        }

    def assumed(self) -> str:
        """Return the assumptions of the verdict."""
        o = self.options
        castors = "without friction" if any(contact.support for contact in self.contacts) else "ignored"
        leans = ", axles carry side moments in themselves" if self.whole_axles and o.height else ""
        return (
            f"assumed: mu {o.mu:g}, {o.share:.0%} of the weight on these contacts, centre of mass "
            f"{o.height:g} m high, g {GRAVITY:g} m/s^2, castors {castors}, wheels of an axle share its side "
            f"force by load at rest{leans}"
        )

    def _worst(self, contact: ContactForce) -> str:
        k = int(np.argmax(contact.use))
        return f"{contact.use[k]:.2g} ({contact.name}, t = {self.t[k]:.4g} s)"

    def _slip(self, contact: ContactForce) -> str:
        needs = np.where(contact.load <= 0, 0.0, contact.needs)
        first, worst = self._first(contact.use > 1), self._first(needs == needs.max())
        return f"{contact.name}, first at t = {first}, requires mu >= {_up(needs.max())} at t = {worst}"

    def _first(self, where: np.ndarray) -> str:
        return f"{self.t[np.argmax(where)]:.4g} s"


def check_share(contact: ContactSection, plant: Plant) -> None:
    """Raise BadInput for a share of the weight on contacts that have one by the robot's own masses:
    it would count twice."""
    if contact.share < 1 and plant.part < 1 - NEGLIGIBLE:
        raise BadInput(
            f"[contact] share = {contact.share:g}: {plant.system.mechanism.name} says itself that "
            f"{plant.part:.0%} of the weight is on these contacts; leave share out, or correct the masses of "
            "the robot's contacts"
        )


@lru_cache(maxsize=1)
def grip(run: Run) -> Grip:
    """Return the contacts of a run, without the last row of a stopped run, whose torque did not act.

    Raises BadInput as `contact_forces` does.
    """
    going = slice(None, -1) if run.stopped else slice(None)
    options, plant = run.spec.contact or ContactSection(), run.plant
    found = contact_forces(plant, run.x[going], run.tau[going], options)
    options = dataclasses.replace(
        options, share=options.share * plant.part, height=options.height or plant.height
    )
    mechanism = run.plant.system.mechanism
    return Grip(run.t[going], found, options, unknown_loads(mechanism), on_centre_line(mechanism))


def contact_forces(
    plant: Plant, x: np.ndarray, tau: np.ndarray, options: ContactSection
) -> tuple[ContactForce, ...]:
    """Return forces at each contact of the plant in states x, (N, 2n-m), with inputs tau, (N, r); empty if
    `unknown_loads` has a reason. The height of the centre of mass is that of `options`, or if it has none
    that of the robot.

    Supports are contacts too, the last ones. Raises BadInput if a height of the centre of mass is given and
    an axle has no width, or all supports are on one line that is not the centre line.
    """
    mechanism = plant.system.mechanism
    if unknown_loads(mechanism):
        return ()
    combination, mass, left = plant.contacts(x)
    lam = plant.constraint_forces(x, tau)
    load = options.share * GRAVITY * mass
    force = _shared(combination, lam, load)
    height = options.height or plant.height
    if height and mechanism.places_named:
        if narrow(mechanism):
            raise BadInput(
                f"[contact] height = {height:g}: all supports of {mechanism.name} are on one line; omit it"
            )
        load = load + height * (plant.shift(x) @ force[:, :, None])[:, :, 0]
    elif height:
        load = load + _transfer(mechanism, force[:, 1::2], load, left, height)
    return tuple(
        ContactForce(
            each.name,
            force[:, 2 * k],
            force[:, 2 * k + 1],
            load[:, k],
            options.mu,
            k >= len(mechanism.contacts),
        )
        for k, each in enumerate(mechanism.standing)
    )


def friction_accelerations(
    plant: Plant, options: ContactSection, part: float, torque: Sequence[float] = ()
) -> Accelerations:
    """Return the accelerations that alone use a `part` of friction at some contact: towards the centre of a
    wide curve, along a line, and of the yaw rate at rest. The robot rolls as the parameters of the plant say.
    With `torque`, the largest input of each motor (N or N m; 0: no limit), those along a line and of the yaw
    rate also use at most this part of each.

    Raises BadInput as `contact_forces` and `vehicle_wheels` do, and if `unknown_loads` has a reason.
    """
    mechanism = plant.system.mechanism
    if reason := unknown_loads(mechanism):
        raise BadInput(
            f"[reference] {mechanism.name}: {reason}: give lateral, acceleration, deceleration and angular"
        )
    forward, turn, _ = vehicle_wheels(plant.system, plant.parameters)
    twist, n, inputs = np.array([forward, turn]), len(mechanism.coordinates), len(mechanism.inputs)

    def solution(A: np.ndarray, b: np.ndarray) -> np.ndarray:
        return least_norm(A[None], b[None])[0]

    def most(speed: float, yaw_rate: float, *acceleration: float) -> float:
        """How often the acceleration, the unit of it, uses the part of friction."""
        x = np.concatenate([np.zeros(n), solution(twist, np.array([speed, yaw_rate]))])
        free, *pushed = (plant.rate(x, tau)[n:] for tau in np.vstack([np.zeros(inputs), np.eye(inputs)]))
        tau = solution(np.transpose(pushed - free), solution(twist, np.array(acceleration)) - free)
        at_rest = contact_forces(plant, np.zeros((1, len(x))), np.zeros((1, inputs)), options)
        found = []
        for still, moving in zip(at_rest, contact_forces(plant, x[None], tau[None], options), strict=True):
            force = np.hypot(moving.longitudinal, moving.lateral)[0]
            limit, change = (
                part * options.mu * still.load[0],
                part * options.mu * (moving.load - still.load)[0],
            )
            found.append(limit / (force - change) if force > change else np.inf)
        for limit, size in zip(torque, np.abs(tau), strict=False) if acceleration != (0.0, 0.0) else ():
            found.append(part * limit / size if limit and size else np.inf)
        return float(min(found))

    along = most(0.0, 0.0, 1.0, 0.0)
    return Accelerations(most(WIDE_CURVE, 1 / WIDE_CURVE, 0.0, 0.0), along, along, most(0.0, 0.0, 0.0, 1.0))


def _shared(combination: np.ndarray, lam: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Return forces F, (N, 2 c), with C' F = -lambda and the smallest sum of F^2 / load: distributed in
    proportion to the load.
    """
    floor = LEAST * np.abs(load).max(axis=1, keepdims=True)
    root = np.sqrt(np.repeat(np.maximum(load, floor), 2, axis=1))[:, :, None]
    finite = np.isfinite(lam).all(axis=1) & np.isfinite(root).all(axis=(1, 2))
    force = np.full(root.shape[:2], np.nan)
    force[finite] = -root[finite, :, 0] * least_norm((combination * root)[finite].swapaxes(1, 2), lam[finite])
    return force


def _transfer(
    mechanism: Mechanism, sideways: np.ndarray, load: np.ndarray, left: np.ndarray, height: float
) -> np.ndarray:
    """Return the change of the loads by the side force of each axle, (N, c):
    its moment height * force, carried by its wheels."""
    change = np.zeros_like(load)
    for axle in axles(mechanism):
        weight, place = load[:, axle], left[:, axle]
        arm = place - (weight * place).sum(axis=1, keepdims=True) / weight.sum(axis=1, keepdims=True)
        width = (weight * arm**2).sum(axis=1, keepdims=True)
        if not np.all(width > 0):
            names = ", ".join(mechanism.contacts[k].name for k in axle)
            raise BadInput(
                f"[contact] height = {height:g}: {names} of {mechanism.name} has no width to carry the "
                "moment; omit it"
            )
        change[:, axle] = -height * sideways[:, axle].sum(axis=1, keepdims=True) * weight * arm / width
    return change


def _up(value: float) -> str:
    """Return a number with two decimals, rounded up; a large number with three digits."""
    return f"{np.ceil(value * 100 - 1e-9) / 100:.2f}" if value < LARGE else f"{value * 1.005:.3g}"


def draw_contact(run: Run) -> Figure:
    """Return a figure: friction use of each contact over time, and its force with the friction circle of
    radius mu load. SI units.

    Raises BadInput if `unknown_loads` has a reason, and as `contact_forces` does.
    """
    from matplotlib.figure import Figure  # slow to import

    from .plot import AXLE, POINT, SECOND, STOP, VEHICLE

    found = grip(run)
    if not found.contacts:
        raise BadInput(
            f"--contact: {found.unknown}; the figure is for robots that stay level, with contact(name, mass, "
            "along, across)"
        )
    shown = [contact for contact in found.contacts if not contact.support]
    coloured = list(zip(shown, itertools.cycle((POINT, VEHICLE, AXLE, SECOND)), strict=False))
    figure = Figure(figsize=(13, 6.5), layout="constrained")
    figure.suptitle(_title(run, found), fontsize=11)
    use, circle = figure.subplots(1, 2, width_ratios=(1.2, 1))
    _draw_use(use, found.t, coloured, STOP)
    if run.stopped:
        use.axvline(
            run.t[-1],
            color=STOP,
            linestyle=":",
            linewidth=1.5,
            label=f"stopped at {run.t[-1]:.4g} s: {run.stopped}",
        )
    _draw_circle(circle, coloured, STOP)
    for axes in (use, circle):
        axes.grid(alpha=0.3)
    use.legend(loc="best", fontsize=9)
    figure.legend(
        *circle.get_legend_handles_labels(), loc="outside lower right", ncols=3, fontsize=9, frameon=False
    )
    return figure


def _title(run: Run, found: Grip) -> str:
    """Return robot and law; the verdict; the assumptions."""
    lines = (line for text in (found.verdict(), found.assumed()) for line in text.splitlines())
    shown = [wrapped for line in lines for wrapped in textwrap.wrap(line, WIDE)]
    return "\n".join([f"{run.law.system.mechanism.name}, {run.law.name}: does it still roll?", *shown])


def _draw_use(axes: Axes, t: np.ndarray, coloured: Coloured, beyond: str) -> None:
    """Plot friction use over time; above 1 the contact would slip."""
    for contact, colour in coloured:
        k = int(np.argmax(contact.use))
        axes.plot(
            t,
            contact.use,
            color=colour,
            label=f"{contact.name}, at most {contact.use[k]:.2g} at t = {t[k]:.4g} s",
        )
        axes.plot(t[k], contact.use[k], "o", color=colour, markersize=8)
    top = _reach(max(contact.use.max() for contact, _ in coloured))
    axes.axhspan(1.0, top, color=beyond, alpha=0.1, linewidth=0, label="would slip")
    axes.axhline(1.0, color=beyond, linewidth=1.5)
    axes.set(xlabel="time t (s)", ylabel=r"friction use  |F| / ($\mu$ load)", ylim=(0.0, top))
    axes.margins(x=0.01)


def _draw_circle(axes: Axes, coloured: Coloured, beyond: str) -> None:
    """Plot the force of each contact in the vehicle's frame, forward up and left to the left, and the limit
    of friction.

    If loads vary, the circle of each contact is that of the row with its largest friction use, which is
    marked.
    """
    constant = np.ptp([contact.load for contact, _ in coloured]) <= NEGLIGIBLE * np.max(
        [c.load for c, _ in coloured]
    )
    radii = []
    for contact, colour in coloured:
        axes.plot(contact.lateral, contact.longitudinal, color=colour, label=contact.name)
        k = int(np.argmax(contact.use))
        worst = f"{contact.name}, largest use"
        axes.plot(contact.lateral[k], contact.longitudinal[k], "o", color=colour, markersize=8, label=worst)
        radii.append(contact.mu * max(contact.load[k], 0.0))
        if not constant:
            _draw_limit(
                axes, radii[-1], colour, f"friction circle at that time, $\\mu$ load = {radii[-1]:.3g} N"
            )
    if constant:
        _draw_limit(axes, radii[0], beyond, f"friction circle $\\mu$ load = {radii[0]:.3g} N")
    limit = coloured[0][0].mu * max(contact.load.max() for contact, _ in coloured)
    half = limit * _reach(
        max(np.abs(f).max() for c, _ in coloured for f in (c.lateral, c.longitudinal)) / limit
    )
    axes.set(xlim=(half, -half), ylim=(-half, half), aspect="equal")
    axes.set(xlabel="side force on the robot, left positive (N)", ylabel="force forward (N)")


def _draw_limit(axes: Axes, radius: float, colour: str, label: str) -> None:
    angle = np.linspace(0.0, 2 * np.pi, 361)
    s, c = sine_cosine(angle)
    axes.plot(radius * c, radius * s, "--", color=colour, linewidth=1.5, label=label)


def _reach(worst: float) -> float:
    """Return the range of an axis relative to its limit: past both the limit and the largest value,
    unless that is infinite."""
    return float(np.clip(1.15 * worst, 1.3, HIGHEST)) if np.isfinite(worst) else HIGHEST
