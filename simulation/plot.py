"""Plots of runs: path, errors, speed and inputs."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..model.paths import Path
from ..model.segments import Segment
from ..model.vehicle import point_on_body
from ..readers.errors import BadInput
from .controllers.odometry import vehicle_wheels
from .drawing import (
    at_times,
    draw_floor,
    draw_implicit,
    evenly_spread,
    implicit_path,
    is_outline,
    legend_below,
    legend_on_top,
    outlines,
)
from .engine.measured import SLIPS, FloorMeasurements
from .guidance import smooth_curve, vehicle_motion
from .run import Run
from .specification.cases import gain_entries, integral_entries, observer_entries
from .specification.spec import CourseSection

FOLLOWED, POINT, VEHICLE, AXLE, STOP = "#999999", "#0b61a4", "#c2570c", "#2e8b57", "#c00000"
SENSED = "#d08a00"
SECOND = "#8a4fa3"  # second colour beside POINT
COLOURS = (POINT, SECOND, AXLE, VEHICLE)
WIDE = 150  # characters per line of the title
OUTLINES, APART = 6, 2.5  # largest number of drawn vehicles, and their smallest distance, m
STAYS = 0.3  # m: a vehicle that ends so near to its start is drawn once
# rad by which the vehicle may turn while it is drawn: after a full turn it is where it was before
TURN = 1.6 * np.pi


def draw(run: Run) -> Figure:
    """Return the figure of a run: the path in the plane on the left; errors, forward speed and inputs over
    time on the right. SI units. A run in a physics engine has the slip of each contact as well, one that
    learns parameters these, one on ground that moves the balance of energy, one of an underactuated robot the
    coordinates that no output controls.

    For a robot that is not a vehicle: its outputs on the left, and on the right its quasi-velocities instead
    of the speed.
    """
    figure = Figure(figsize=(13, 7.5), layout="constrained")
    passive = _passive(run)
    more = (run.floor, run.spec.adaptation, run.balanced, passive)
    grid = figure.add_gridspec(3 + sum(map(bool, more)), 2, width_ratios=(1.25, 1))
    figure.suptitle(_title(run), fontsize=11)
    plane = figure.add_subplot(grid[:, 0])
    errors = figure.add_subplot(grid[0, 1])
    speed = figure.add_subplot(grid[1, 1], sharex=errors)
    inputs = figure.add_subplot(grid[2, 1], sharex=errors)
    vehicle = run.law.system.mechanism.vehicle
    (_draw_plane if vehicle else _draw_outputs)(plane, run)
    figure.legend(
        *plane.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=9, frameon=False
    )
    _draw_errors(errors, run)
    (_draw_speed if vehicle else _draw_rates)(speed, run)
    _draw_inputs(inputs, run)
    below = [inputs]
    if run.floor:
        below.append(figure.add_subplot(grid[3, 1], sharex=errors))
        _draw_slip(below[-1], run, run.floor)
    if run.spec.adaptation:
        below.append(figure.add_subplot(grid[2 + len(below), 1], sharex=errors))
        _draw_learned(below[-1], run, run.spec.adaptation.bounds)
    if run.balanced:
        below.append(figure.add_subplot(grid[2 + len(below), 1], sharex=errors))
        _draw_energy(below[-1], run)
    if passive:
        below.append(figure.add_subplot(grid[2 + len(below), 1], sharex=errors))
        _draw_passive(below[-1], run, passive)
    below[-1].set_xlabel("time t (s)")
    for axes in (errors, speed, *below[:-1]):
        axes.tick_params(labelbottom=False)
    for axes in (errors, speed, *below):
        axes.grid(alpha=0.3)
        axes.margins(x=0.01)
        if run.stopped:
            _clip(axes)
            axes.axvline(run.t[-1], color=STOP, linestyle=":", linewidth=1.5)
    return figure


def _clip(axes: Axes) -> None:
    """Limit the view to the run without the last instants before it stopped,
    when values grow without bound."""
    drawn = [
        np.asarray(line.get_ydata(), float) for line in axes.get_lines() if np.size(line.get_xdata()) > 2
    ]
    values = np.concatenate([*drawn, np.empty(0)])
    values = values[np.isfinite(values)]
    if not len(values):
        return
    low, high = np.percentile(values, [2, 98])
    room = max(0.3 * (high - low), 0.1 * max(abs(low), abs(high)), 1e-3)
    axes.set_ylim(low - room, high + room)


def _title(run: Run) -> str:
    """Return the title: robot, law, backend; then parameters."""
    simulation = run.spec.simulation
    held = f"controller called every {simulation.period:g} s" if simulation.period else "continuous"
    held += f", delay {simulation.delay:g} s" if simulation.delay else ""
    what = f"{run.law.system.mechanism.name}: {run.law.output.about}"
    how = f"({run.law.name}, backend {simulation.backend}, {held})"
    first = what + ("\n" if len(what) + len(how) > WIDE else "  ") + how
    names = [p.name for p in run.law.parameters]
    place = [] if run.spec.output.own else [f"L = {run.spec.output.L:g} m"]
    shown = [*place, *[f"{name} = {value:g}" for name, value in _gains(run).items()]]
    assumed = [p for p in run.law.parameters if "assumed" in p.about or p.name in run.spec.parameters]
    for parameter in assumed:
        value = run.spec.parameters.get(parameter.name, parameter.default)
        mark = "" if parameter.name in run.spec.parameters else " (assumed)"
        shown.append(f"{parameter.name} = {_measured(value, parameter.unit)}{mark}")
    truth = [
        f"{name} = {_measured(value, run.law.parameters[names.index(name)].unit)}"
        for name, value in run.spec.plant.items()
    ]
    if truth:
        shown.append("plant: " + ", ".join(truth))
    # keep a number and its unit on one line
    lines = textwrap.wrap(",  ".join(text.replace(" ", "\xa0") for text in shown), WIDE)
    return "\n".join([first, *lines]).replace("\xa0", " ")


def _measured(value: float, unit: str) -> str:
    """Return a value with its unit, unless that is 1."""
    return f"{value:g}" if unit == "1" else f"{value:g} {unit}"


def _gains(run: Run) -> dict[str, float]:
    """Return the gains, as kp, kd, kv if all of a kind are equal."""
    given = gain_entries(run.law, run.spec.gains, "gains")
    used = {gain.name: given.get(gain.name, gain.default) for gain in run.law.gains}
    used |= {name: ki for name, ki in integral_entries(run.law, run.spec.gains).items() if ki}
    used |= {name: ko for name, ko in observer_entries(run.law, run.spec.gains).items() if ko}
    alike = {name[:2]: {value for other, value in used.items() if other[:2] == name[:2]} for name in used}
    return {name[:2] if len(alike[name[:2]]) == 1 else name: value for name, value in used.items()}


def _draw_plane(axes: Axes, run: Run) -> None:
    """Draw the path, the loci of P_l, of the vehicle's point and of the axle,
    and some outlines of the vehicle."""
    pose = _motion(run)
    p_l, vehicle, heading = pose[:, :2], pose[:, 2:4], pose[:, 4]
    point = "the vehicle's point" if run.spec.output.own else "$P_l$"
    axes.plot(*p_l.T, color=POINT, linewidth=1.8, label=f"locus of {point}", zorder=2.5)
    if run.spec.sensors and run.spec.sensors.pose == "reckoned":
        believed = _vehicle_motion(run, run.seen)[:, :2]
        axes.plot(*believed.T, color=SENSED, linewidth=1.0, label="estimated position", zorder=2.4)
    if np.any(p_l != vehicle):
        axes.plot(
            *vehicle.T, ":", color=VEHICLE, linewidth=1.5, label="locus of the vehicle's point", zorder=2.6
        )
    ahead = _ahead_of_axle(run)
    if ahead:
        axle = vehicle - ahead * np.column_stack([np.cos(heading), np.sin(heading)])
        axes.plot(
            *axle.T,
            "--",
            color=AXLE,
            linewidth=1.5,
            label="locus of the middle of the axle $P_o$",
            zorder=2.6,
        )
    _draw_vehicles(axes, run, vehicle, heading)
    ring: dict[str, Any] = {"markersize": 9, "markerfacecolor": "white", "markeredgewidth": 2}
    axes.plot(*p_l[0], "o", color=POINT, **ring, label=f"start of {point}", zorder=5)
    rounds = abs(heading[-1] - heading[0]) / (2 * np.pi)
    if rounds > 1 and not run.stopped:
        axes.plot(
            *p_l[-1],
            "s",
            color=POINT,
            **ring,
            label=f"end at {run.t[-1]:.4g} s, {rounds:.1f} turns",
            zorder=5,
        )
    if run.stopped:
        label = f"stopped at {run.t[-1]:.4g} s: {run.stopped}"
        axes.plot(*p_l[-1], "X", color=STOP, markersize=11, label=label, zorder=6)
    if run.spec.feedback and are_places(run):
        _draw_desired(axes, run)
    elif run.spec.output.own and are_places(run):
        _draw_places(axes, run, SECOND)
    if run.spec.output.type == "I":
        axes.plot(*run.y_d.T, color=FOLLOWED, linewidth=4, alpha=0.6, label="desired $P_l$", zorder=0)
    if run.composite:
        _draw_pieces(axes, run.spec.output.segments)
    elif run.spec.output.along_course and run.spec.reference.course:
        _draw_course(axes, run, run.spec.reference.course)
    elif run.law.output.path:
        _draw_followed(axes, run, run.law.output.path, p_l)
    else:
        _make_square(axes)
    if run.floor and run.spec.floor:
        draw_floor(axes, run.spec.floor)
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.grid(alpha=0.3)


def _draw_outputs(axes: Axes, run: Run) -> None:
    """Draw the first two outputs against each other if both are lengths, else all of them over time;
    and their desired values."""
    rows = run.law.output.rows
    if are_places(run):
        _draw_places(axes, run, POINT)
        axes.set(xlabel=f"{rows[0].about} (m)", ylabel=f"{rows[1].about} (m)")
        _make_square(axes)
    else:
        for row, y, y_d, colour in zip(rows, run.y.T, run.y_d.T, COLOURS, strict=False):
            axes.plot(
                run.t,
                y_d,
                color=FOLLOWED,
                linewidth=4,
                alpha=0.6,
                label="desired" if row is rows[0] else None,
                zorder=0,
            )
            axes.plot(run.t, y, color=colour, label=f"{row.about} ({row.unit})")
        axes.set(xlabel="time t (s)", ylabel="outputs")
    axes.grid(alpha=0.3)


def are_places(run: Run) -> bool:
    """Return whether the first two outputs are lengths, as the coordinates of a point are."""
    return [row.unit for row in run.law.output.rows[:2]] == ["m", "m"]


def _draw_places(axes: Axes, run: Run, colour: str) -> None:
    """Draw the first two outputs against each other, and their desired values."""
    first, second, *_ = run.law.output.rows
    _draw_desired(axes, run)
    axes.plot(*run.y[:, :2].T, color=colour, label=f"{first.name}, {second.name}", zorder=2.7)
    square: dict[str, Any] = {"markersize": 7, "markerfacecolor": "white", "markeredgewidth": 2}
    axes.plot(*run.y[0, :2], "s", color=colour, **square, label=f"start of {first.name}, {second.name}")


def _draw_desired(axes: Axes, run: Run) -> None:
    axes.plot(*run.y_d[:, :2].T, color=FOLLOWED, linewidth=4, alpha=0.6, label="desired", zorder=0)


def _make_square(axes: Axes) -> None:
    """Set equal scales on a square that contains everything drawn."""
    box = axes.dataLim
    half = 0.54 * max(box.width, box.height)
    x, y = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), aspect="equal")


def _draw_followed(axes: Axes, run: Run, path: Path, p_l: np.ndarray) -> None:
    """Draw the curve where the signed distance is zero; its points nearest to the start and the end must be
    in view."""
    function, config = implicit_path(run.law.output), run.config[0]
    axes.update_datalim(function(p_l[[0, -1]].T, config)[1].full().T)
    _make_square(axes)
    x, y = np.linspace(*axes.get_xlim(), 400), np.linspace(*axes.get_ylim(), 400)
    style = {"color": FOLLOWED, "linewidth": 4, "alpha": 0.6}
    draw_implicit(axes, function, config, x, y, f"path to follow: {path.kind}", **style)


def _draw_course(axes: Axes, run: Run, section: CourseSection) -> None:
    """Draw the course of the reference, which Type IV follows, up to its end or as far as the run came."""
    course = smooth_curve(section, *(run.spec.reference.position or ())[:2])
    feet = run.config[:, [c.name in ("x_s", "y_s") for c in run.law.config]]
    for piece in course.pieces:
        places = np.array([piece.position(length) for length in np.linspace(0.0, piece.way, 400)])
        backward = piece.stretches[0].backward and course.cusps
        style: Any = (0, (2, 1)) if backward else "-"
        axes.plot(places.real, places.imag, color=FOLLOWED, linestyle=style, linewidth=4, alpha=0.6, zorder=0)
    label = "path to follow: course" + (" (dashed: in reverse)" if course.cusps else "")
    axes.plot([], [], color=FOLLOWED, linewidth=4, alpha=0.6, label=label)
    axes.plot(*feet.T, color=FOLLOWED, linewidth=4, alpha=0.3, zorder=0)
    _make_square(axes)


def _draw_pieces(axes: Axes, segments: Sequence[Segment]) -> None:
    """Draw lines and arcs of a composite path, with a mark at each join; segments in reverse dashed."""
    for piece in segments:
        style: Any = (0, (2, 1)) if piece.backward else "-"
        axes.plot(
            *np.transpose(piece.places(100)),
            color=FOLLOWED,
            linestyle=style,
            linewidth=4,
            alpha=0.6,
            zorder=0,
        )
    joins = np.array([piece.end[:2] for piece in segments])
    axes.plot(*joins.T, "|", color="#555555", markersize=9, zorder=1, label="join")
    backward = any(piece.backward for piece in segments)
    label = "path to follow" + (" (dashed: in reverse)" if backward else "")
    axes.plot([], [], color=FOLLOWED, linewidth=4, alpha=0.6, label=label)
    _make_square(axes)


def _draw_vehicles(axes: Axes, run: Run, place: np.ndarray, heading: np.ndarray) -> None:
    """Draw outlines to scale at equal distances along the way of the first turn,
    each with its time and the front marked."""
    turned = np.flatnonzero(np.abs(heading - heading[0]) > TURN)
    way = place[: turned[0]] if len(turned) else place
    length = np.hypot(*np.diff(way, axis=0).T).sum()
    instants = np.unique(evenly_spread(way, int(np.clip(1 + length / APART, 2, OUTLINES))))
    if len(instants) == 2 and np.hypot(*(way[-1] - way[0])) < STAYS:  # the later one would hide the first
        instants = instants[:1]
    if len(turned) and not run.stopped:  # the end, instead of vehicles that would overlap it
        last = outlines(run.law.system.mechanism, run.q[-1:], run.plant.parameters)
        size = np.ptp(np.concatenate([line[0] for line in last]), axis=0).max()
        instants = np.append(instants[np.hypot(*(place[instants] - place[-1]).T) > size], len(place) - 1)
    forward = np.column_stack([np.cos(heading), np.sin(heading)])[instants]
    left = forward[:, ::-1] * (-1.0, 1.0)
    lines = outlines(run.law.system.mechanism, run.q[instants], run.plant.parameters)
    ahead, aside = (
        np.max(
            [((line - place[instants][:, None]) @ side[..., None]).max(axis=(1, 2)) for line in lines], axis=0
        )
        for side in (forward, left)
    )
    for line in (each for instant in lines for each in instant):
        if is_outline(line):
            axes.fill(*line.T, facecolor="#00000010", edgecolor="#333333", linewidth=1.0, zorder=3)
        else:
            axes.plot(*line.T, color="#333333", linewidth=3, solid_capstyle="butt", zorder=3)
    for start, nose in zip(place[instants], place[instants] + ahead[:, None] * forward, strict=True):
        axes.annotate("", nose, start, arrowprops={"arrowstyle": "-|>", "color": "#333333"}, zorder=4)
    at_times(axes, run.t[instants], place[instants] + aside[:, None] * left, left)


def _draw_errors(axes: Axes, run: Run) -> None:
    """Draw the errors of the outputs that are functions of q, or of all if there are none,
    each with its unit."""
    if run.distance.size and all(row.name != "distance" for row in run.law.output.rows):
        label = f"distance from the course, {run.distance[-1]:.2g} m at the end"
        axes.plot(run.t, run.distance, color=COLOURS[0], label=label)
        axes.axhline(0.0, color="black", linewidth=0.8)
        axes.set_ylabel("path error (m)")
        legend_on_top(axes)
        return
    every = run.law.output.rows
    shown = [
        k for k, row in enumerate(every) if not ca.depends_on(row.expression, run.law.system.nu)
    ] or range(len(every))
    rows = [every[k] for k in shown]
    for k, row, colour in zip(shown, rows, COLOURS, strict=False):
        label = f"{row.name} - desired, {run.error[-1, k]:.2g} {row.unit} at the end"
        axes.plot(run.t, run.error[:, k], color=colour, label=label)
    axes.axhline(0.0, color="black", linewidth=0.8)
    units = " or ".join(dict.fromkeys(row.unit for row in rows))
    axes.set_ylabel(f"{'path error' if run.law.output.path else 'error'} ({units})")
    if len(rows) == 1:
        legend_on_top(axes)
    else:
        axes.legend(loc="best", fontsize=9)


def _draw_speed(axes: Axes, run: Run) -> None:
    """Draw the forward speed of the vehicle, and the desired one if there is one."""
    speed = _motion(run)[:, 5]
    axes.plot(run.t, speed, color=VEHICLE, label="forward speed")
    for row, desired in zip(run.law.output.rows, run.y_d.T, strict=True):
        if row.name == "speed":
            axes.plot(run.t, desired, color=FOLLOWED, linewidth=3, alpha=0.6, label="desired", zorder=0)
    for name, text in run.plant.given:
        place = [c.name for c in run.plant.system.mechanism.coordinates].index(name)
        if run.plant.system.mechanism.coordinates[place].unit == "m/s":
            axes.plot(run.t, run.q[:, place], "--", color=SECOND, linewidth=1.2, label=f"{name} = {text}")
    low, high = axes.get_ylim()
    spread = 0.05 * np.abs(speed).max()  # so that a constant speed looks constant
    axes.set_ylim(min(low, speed.min() - spread), max(high, speed.max() + spread))
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_ylabel("forward speed (m/s)")
    if run.plant.given:
        legend_on_top(axes)
    else:
        axes.legend(loc="best", fontsize=9)


def _draw_rates(axes: Axes, run: Run) -> None:
    """The quasi-velocities."""
    for velocity, values, colour in zip(run.law.system.quasi_velocities, run.nu.T, COLOURS, strict=False):
        axes.plot(run.t, values, color=colour, label=f"{velocity.name} ({velocity.unit})")
    axes.set_ylabel("quasi-velocities")
    axes.legend(loc="best", fontsize=9)


def _draw_inputs(axes: Axes, run: Run) -> None:
    """Draw the inputs, as held between calls of the controller if the rows show that."""
    inputs = run.law.system.mechanism.inputs
    going = slice(None, -1) if run.stopped else slice(None)  # the last row of a stopped run has no torque
    held = run.spec.simulation.period >= run.spec.simulation.output_step
    style = "steps-post" if held else "default"
    for given, values, colour in zip(inputs, run.tau[going].T, COLOURS, strict=False):
        label = f"{given.name} ({given.unit}): {given.about}".rstrip(": ")
        axes.plot(run.t[going], values, color=colour, drawstyle=style, label=label)
    axes.axhline(0.0, color="black", linewidth=0.8)
    steady = np.abs(run.tau[-1]).min() > 0.1 * np.abs(run.tau).max()  # at the end, as on a circle
    if _ahead_of_axle(run) and not run.stopped and steady and run.tau[-1].prod() < 0:
        axes.set_title(
            "turning: they balance the side force's moment about the centre of mass", loc="left", fontsize=9
        )
    units = {i.unit for i in inputs}
    axes.set_ylabel(
        "inputs" if len(units) > 1 else f"{'torque' if units == {'N m'} else 'input'} ({inputs[0].unit})"
    )
    axes.legend(loc="best", fontsize=9)


def _draw_energy(axes: Axes, run: Run) -> None:
    """Draw the energy gained, and the works of inputs and of the ground's drive, whose sum it is."""
    names = ("gained", "by inputs and forces", "by the drive of the ground")
    for name, values, colour in zip(names, run.works, COLOURS, strict=False):
        axes.plot(run.t, values, color=colour, label=name)
    axes.set_ylabel("energy, work (J)")
    legend_on_top(axes)


def _passive(run: Run) -> list[int]:
    """Return the numbers of the coordinates, besides the pose, on which the motion of an underactuated robot
    depends and that are no outputs.
    """
    system = run.law.system
    if not system.underactuated:
        return []
    equations = ca.vertcat(ca.vec(system.Mbar), system.bias)
    moves = [ca.depends_on(equations, c.symbol) for c in system.mechanism.coordinates]
    held = [
        any(ca.is_equal(row.expression, c.symbol) for row in run.law.output.rows)
        for c in system.mechanism.coordinates
    ]
    pose = point.pose if (point := point_on_body(system)) else ()
    return [k for k, m in enumerate(moves) if m and not held[k] and k not in pose]


def _draw_passive(axes: Axes, run: Run, passive: Sequence[int]) -> None:
    """Draw coordinates."""
    for k, colour in zip(passive, COLOURS, strict=False):
        quantity = run.law.system.mechanism.coordinates[k]
        axes.plot(run.t, run.q[:, k], color=colour, label=f"{quantity.name} ({quantity.unit})")
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_ylabel("not controlled")
    axes.legend(loc="best", fontsize=9)


def _draw_slip(axes: Axes, run: Run, floor: FloorMeasurements) -> None:
    """Draw the slip of each contact; where some of it counts,
    on a logarithmic axis that is linear below that."""
    for name, slip, colour in zip(floor.names, floor.slip.T, COLOURS, strict=False):
        axes.plot(run.t, slip, color=colour, label=f"{name}, at most {slip.max():.2g} m/s")
    if floor.slip.max() > SLIPS:
        axes.set_yscale("symlog", linthresh=SLIPS)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("slip (m/s)")
    axes.legend(loc="best", fontsize=9)


def _draw_learned(axes: Axes, run: Run, bounds: Mapping[str, tuple[float, float]]) -> None:
    """Draw the parameters in use between their bounds, which are 0 and 1, and the true ones dashed."""
    for (p, used, true), colour in zip(run.learned_parameters, COLOURS, strict=False):
        low, high = bounds[p.name]
        label = f"{p.name} in {low:g} to {high:g} {p.unit}: {used[-1]:.4g} at the end, true {true:.4g}"
        axes.plot(run.t, (used - low) / (high - low), color=colour, label=label)
        axes.axhline((true - low) / (high - low), color=colour, linestyle="--", linewidth=1.0)
    axes.set_ylabel("learned, 0 to 1:\nfrom bound to bound")
    legend_below(axes, fontsize=9, title="in use; dashed: true", title_fontsize=9)


def _ahead_of_axle(run: Run) -> float:
    """Return the distance of the vehicle's point ahead of the axle, m;
    0 also if no axle is fixed to the vehicle."""
    try:
        return vehicle_wheels(run.law.system, run.plant.parameters)[2]
    except BadInput:
        return 0.0


def _motion(run: Run) -> np.ndarray:
    """Return P_l (m), the vehicle's point (m), heading (rad) and forward speed (m/s) of every row, (N, 6)."""
    motion = _vehicle_motion(run, run.x)
    return np.hstack([_reference_points(run, motion), motion[:, :4]])


def _vehicle_motion(run: Run, x: np.ndarray) -> np.ndarray:
    """Return x, y, heading, forward speed, yaw rate of the vehicle for each row of states."""
    return vehicle_motion(run.law.system)(x.T, run.plant.parameters).full().T


def _reference_points(run: Run, motion: np.ndarray) -> np.ndarray:
    """Return P_l of every row, with its position on the vehicle at that time."""
    names = [c.name for c in run.law.config]
    given = {"L": run.spec.output.L, "W": run.spec.output.W}
    ahead, left = (
        run.config[:, names.index(name)] if name in names else value for name, value in given.items()
    )
    cosine, sine = np.cos(motion[:, 2]), np.sin(motion[:, 2])
    return motion[:, :2] + np.column_stack([ahead * cosine - left * sine, ahead * sine + left * cosine])
