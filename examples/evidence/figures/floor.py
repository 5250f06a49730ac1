"""Beyond the paper: its runs, and those of the shipped robots, on a floor where wheels may slip."""

import math
import textwrap
from collections.abc import Mapping
from typing import Any

import matplotlib.figure
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from ....readers.robots import find_robot
from ....simulation.contact import GRAVITY
from ....simulation.drawing import COLOURS, FAINT, STOP, legend_below, over_time, panels
from ....simulation.engine.measured import SLIPS
from ....simulation.run import Run
from ..framework import Case, Claim, Figure, FigureRun, Runs
from . import circle, composite, line, masses, robots, sensing

PERIOD = 0.01  # s
BARE, LIMITED, LED = "no limiter", "limiter", "limiter, approach"
KNOWN = {"limits.mode": "grip", "limits.friction": "given"}
LIMITS: Mapping[str, Mapping[str, Any]] = {BARE: {}, LIMITED: KNOWN, LED: KNOWN}
COLOUR = {BARE: STOP, LIMITED: COLOURS[2], LED: COLOURS[0]}
EDGE = "#444444"
Floor = tuple[float, str]  # friction, one of LIMITS
ROLLING: Floor = (math.inf, "rolling")

# 10 is about the path alone
MOTIONS = ("1", "6", "7", "8a", "8b", "9a", "9b", "11", "12", "13", "14", "15", "16")
PAPERS = tuple(
    each
    for room in (line, circle, masses, composite, sensing)
    for each in room.FIGURES
    if each.name in MOTIONS
)
# Figures each of whose claims is on trajectory tracking (I) or path following (IV) alone
BY_KIND = ("1", "7")
BESIDE = (sensing.AGAIN, sensing.OTHER_SEED)  # runs that no claim of the paper is about
SURVIVE: Mapping[Floor, int] = {  # of the paper's claims
    (0.7, BARE): 4,
    (0.7, LIMITED): 12,
    (0.7, LED): 11,
    (0.3, BARE): 1,
    (0.3, LIMITED): 9,
    (0.3, LED): 9,
}
SHOWN = "IV C"
# m: from there a path is approached at up to half the desired speed, but by this part of friction
FAR, OF_FRICTION = 0.75, 0.2

FLOORS = (0.7, 0.3, 0.15)
FLOORS_OF_ROBOTS: tuple[Floor, ...] = tuple((mu, limits) for mu in FLOORS for limits in (BARE, LIMITED))
# Not in the tables
OTHERS = ("knife_edge", "ball_plate", "geared_arm", "turntable_ball", "bus", "castor_platform", "mecanum")
ROBOTS = tuple(name for name in ("labmate", *robots.TITLES) if name not in OTHERS)
LEAST, MOST = 1e-5, 10.0  # m/s: slips that are drawn
RECKONED = 1e-2  # m; contacts creep in the engine: on any floor the pose of a car is off by 3 mm in 20 s


def _on_floor(case: Case, floor: Floor, **contact: float) -> Case:
    """The case with a sampled controller that knows the friction, on a floor; itself where it rolls."""
    mu, limits = floor
    if floor == ROLLING:
        return case
    changes = {
        "simulation.period": PERIOD,
        "contact": {"mu": mu, **contact},
        "floor": {"mu": mu},
        **LIMITS[limits],
    }
    if limits == LED:
        changes["reference.approach"] = {
            "acceleration": min(OF_FRICTION * mu * GRAVITY, _speed(case) ** 2 / (4 * FAR))
        }
    return Case(case.file, {**case.changes, **changes}, case.singular, "mujoco")


def _speed(case: Case) -> float:
    """The desired speed of a case, m/s."""
    reference = case.spec().reference
    return math.hypot(*(reference.velocity or ())) if reference.speed is None else reference.speed


def _said(floor: Floor) -> str:
    return floor[1] if floor == ROLLING else f"μ {floor[0]:g}, {floor[1]}"


# -- the paper's claims --------------------------------------------------------------------------------------


def _label(figure: Figure, label: str, floor: Floor) -> str:
    first = next(other for other in PAPERS if other.cases is figure.cases)
    return f"figure {first.name}, {label}, {_said(floor)}"


PAPER_CASES = {
    _label(figure, label, floor): _on_floor(case, floor, share=0.7)
    for floor in (ROLLING, *SURVIVE)
    for figure in PAPERS
    for label, case in figure.cases.items()
}
Survivors = Mapping[str, Mapping[Floor, tuple[bool, str]]]


def survivors(runs: Runs) -> Survivors:
    """For each of the paper's claims on a motion that holds where the wheels roll, and each floor: whether it
    holds there, and what was measured.

    It does not where a run that it is about ended early, as with wheels that spin without bound.
    """
    found: dict[str, dict[Floor, tuple[bool, str]]] = {}
    for figure in PAPERS:
        for floor in (ROLLING, *SURVIVE):
            here = {label: runs[_label(figure, label, floor)] for label in figure.cases}
            claims = _claims(figure, here)
            if floor == ROLLING:
                motions = [
                    text
                    for text, claim in claims.items()
                    if claim.paper and claim.holds and "singular" not in text
                ]
            for text in motions:
                ended = [
                    _end(label, here[label]) for label in _about(figure, text, here) if here[label].stopped
                ]
                same = claims.get(text)
                result = (
                    (False, ended[0])
                    if ended
                    else (same.holds, same.measured)
                    if same
                    else (False, "cannot be compared")
                )
                found.setdefault(f"{figure.name}: {text}", {})[floor] = result
    return found


def _claims(figure: Figure, runs: Runs) -> dict[str, Claim]:
    """The figure's claims by their text; none where runs ended too early to be compared."""
    try:
        return {claim.text: claim for claim in figure.claims(runs)}
    except (ValueError, IndexError):
        return {}


def _about(figure: Figure, text: str, runs: Runs) -> list[str]:
    """The labels of the runs that a claim is about."""
    kind = "IV" if text.startswith("path following") else "I"
    started = [label for label, run in runs.items() if not run.refused and label not in BESIDE]
    return [label for label in started if figure.name not in BY_KIND or label.split()[0] == kind]


def _end(label: str, run: FigureRun) -> str:
    return f"{label}: {run.stopped} at {run.t[-1]:.2f} s"


def survive(table: Survivors, floor: Floor) -> int:
    """How many claims hold on a floor."""
    return sum(by_floor[floor][0] for by_floor in table.values())


def draw_papers(runs: Runs) -> matplotlib.figure.Figure:
    """Which claims hold on which floor, and how the line is approached there."""
    figure, axes = panels(
        "claims of the paper, by figure: ● holds, × lost",
        "Type IV, case C of figures 1 and 6",
        height=10.5,
        widths=(2, 1),
    )
    table = survivors(runs)
    floors = (ROLLING, *SURVIVE)
    for row, (text, by_floor) in enumerate(table.items()):
        for column, floor in enumerate(floors):
            holds = by_floor[floor][0]
            colour, mark, verdict = (COLOURS[2], "o", "holds") if holds else (STOP, "x", "lost")
            axes[0].add_patch(
                Rectangle((column - 0.47, row - 0.46), 0.94, 0.92, facecolor=colour, alpha=0.12, linewidth=0)
            )
            axes[0].plot(column, row, mark, color=colour, label=f"{text}; {_said(floor)}: {verdict}")
    counts = [
        f"{_said(floor).replace(', ', chr(10))}\n{survive(table, floor)} of {len(table)}" for floor in floors
    ]
    axes[0].set_xticks(range(len(floors)), counts, fontsize=8, linespacing=1.4)
    axes[0].set_yticks(range(len(table)), [textwrap.fill(text, 62) for text in table], fontsize=8)
    axes[0].set(xlim=(-0.5, len(floors) - 0.5), ylim=(len(table) - 0.5, -0.5))
    axes[0].xaxis.tick_top()
    axes[0].tick_params(length=0)
    axes[0].grid(False)
    axes[0].spines[:].set_visible(False)
    for floor in floors:
        run = runs[_label(PAPERS[0], SHOWN, floor)]
        how = "stopped" if run.stopped else f"slip ≤ {1e3 * run.slipping:.1f} mm/s"
        drawn = (
            {"color": FAINT, "linewidth": 5, "alpha": 0.5}
            if floor == ROLLING
            else {"color": COLOUR[floor[1]]}
        )
        label = _said(floor) if floor == ROLLING else f"{_said(floor)}: {how}"
        style = "--" if floor[0] == 0.3 else "-"
        axes[1].plot(
            run.t, line.distance(run.P_l), style, marker="X" * bool(run.stopped), label=label, **drawn
        )
    over_time(axes[1], "distance of $P_l$ from the line (m)")
    axes[1].set_xlim(-0.2, 8.0)
    legend_below(axes[1])
    return figure


def claims_papers(runs: Runs) -> list[Claim]:
    """How many of the paper's claims survive, and whether the wheels roll."""
    table, made = survivors(runs), []
    for floor, count in SURVIVE.items():
        lost = [text for text, by_floor in table.items() if not by_floor[floor][0]]
        made.append(
            Claim(
                f"at {_said(floor)}: {count} of the paper's {len(table)} claims survive",
                f"{survive(table, floor)} survive",
                survive(table, floor) == count,
                note="lost: " + "; ".join(f"{text} ({table[text][floor][1]})" for text in lost),
            )
        )
    right = {
        label: run
        for label, run in _measured(runs, LIMITED, LED).items()
        if masses.LIGHT not in label and masses.HEAVY not in label
    }
    with_noise = tuple(f"figure {figure.name}," for figure in sensing.FIGURES)
    exact = {label: run for label, run in right.items() if not label.startswith(with_noise)}
    worst = max(exact, key=lambda label: exact[label].slipping)
    noisy = max((run.slipping for run in right.values()), default=0.0)
    return [
        *made,
        Claim(
            "with the limiter, the right masses and exact sensors no wheel slips faster than 1 cm/s, "
            "singular or not",
            f"{1e3 * exact[worst].slipping:.1f} mm/s in {len(exact)} runs ({worst})",
            exact[worst].slipping < SLIPS,
            note=f"with noise in the wheel rates they slip at up to {noisy:.2g} m/s: the limiter knows what "
            "is sensed",
        ),
    ]


def _measured(runs: Runs, *limits: str) -> dict[str, FigureRun]:
    """The runs on a floor with one of these limits."""
    ends = tuple(
        f"μ {mu:g}, {each}" for mu in {mu for mu, _ in (*SURVIVE, *FLOORS_OF_ROBOTS)} for each in limits
    )
    return {label: run for label, run in runs.items() if run.floor and label.endswith(ends)}


# -- the shipped robots --------------------------------------------------------------------------------------


def file_of(name: str) -> str:
    """The SPEC of a robot, from the folder of those of figures."""
    return "../line.toml" if name == "labmate" else f"../robots/{name}.toml"


ROBOT_CASES = {
    f"{name}, {_said(floor)}": _on_floor(Case(file_of(name)), floor)
    for floor in FLOORS_OF_ROBOTS
    for name in ROBOTS
}


def reckoning_error(run: FigureRun) -> float | None:
    """How far the reckoned place is off at the end, m; None for a robot that does not reckon."""
    if run.floor is None or run.floor.reckoned is None:
        return None
    places = [k for k, coordinate in enumerate(run.robot.coordinates) if coordinate.unit == "m"]
    return float(np.hypot(*(run.floor.reckoned[-1, :2] - run.q[-1, places])))


def draw_robots(runs: Runs) -> matplotlib.figure.Figure:
    """Peak slip of each robot on each floor, and how far dead reckoning is off."""
    titles = [f"peak slip, μ {mu:g}" for mu in FLOORS]
    figure, axes = panels(*titles, f"dead reckoning off, μ {FLOORS[-1]:g}", height=5.4)
    for panel, mu in zip(axes, FLOORS, strict=False):
        _compare(panel, runs, mu, lambda run: run.slipping)
        panel.axvline(SLIPS, color=EDGE, linestyle=":", linewidth=1.0)
        panel.set(xlabel="m/s (dotted: 1 cm/s)", xlim=(LEAST, 3 * MOST))
    _compare(axes[-1], runs, FLOORS[-1], reckoning_error)
    axes[-1].set(xlabel="m, at the end", xlim=(LEAST, 3 * MOST))
    for panel in axes[1:]:
        panel.tick_params(labelleft=False)
    axes[0].plot([], [], "o", color=COLOUR[BARE], markerfacecolor="none", label=BARE)
    axes[0].plot([], [], "X", color=EDGE, label="stopped: wheels spin, or singular")
    axes[0].plot([], [], "o", color=COLOUR[LIMITED], label=LIMITED)
    legend_below(axes[0])
    return figure


def _compare(panel: Axes, runs: Runs, mu: float, value: Any) -> None:
    """A row for each robot, on a logarithmic scale: its values without and with the limiter."""
    for row, name in enumerate(ROBOTS):
        for limits, style in (
            (BARE, {"markerfacecolor": "none", "markersize": 9}),
            (LIMITED, {"markersize": 5}),
        ):
            run = runs.get(f"{name}, {_said((mu, limits))}")
            found = value(run) if run else None
            if run and found is not None:
                mark = "X" if run.stopped else "o"
                filled = style | ({"markerfacecolor": COLOUR[limits]} if run.stopped else {})
                panel.plot(np.clip(found, LEAST * 1.5, MOST), row, mark, color=COLOUR[limits], **filled)
    panel.set_xscale("log")
    panel.set_yticks(range(len(ROBOTS)), ROBOTS)
    panel.set_ylim(len(ROBOTS) - 0.5, -0.5)
    panel.grid(axis="y", alpha=0.3)


def claims_robots(runs: Runs) -> list[Claim]:
    """With the limiter they roll and dead reckoning holds, but on a slope that friction cannot hold."""
    slope = {p.name: p.default for p in find_robot("slope_platform").parameters}["slope"]
    steep = [f"slope_platform, {_said(floor)}" for floor in FLOORS_OF_ROBOTS if math.tan(slope) > floor[0]]
    slips = {label: run.slipping for label, run in runs.items() if label not in steep}
    bare, limited = (
        {k: v for k, v in slips.items() if k.endswith(f", {limits}")} for limits in (BARE, LIMITED)
    )
    worst = max(limited, key=lambda label: limited[label])
    spun = sorted(label.rpartition(",")[0] for label, slip in bare.items() if slip > SLIPS)
    went = {
        limits: [reckoning_error(run) for run in _measured(runs, limits).values() if not run.stopped]
        for limits in (BARE, LIMITED)
    }
    off = {
        limits: max((e for e in errors if e is not None), default=math.inf) for limits, errors in went.items()
    }
    return [
        Claim(
            "with the limiter no wheel slips faster than 1 cm/s",
            f"{1e3 * limited[worst]:.1f} mm/s in {len(limited)} runs ({worst})",
            limited[worst] < SLIPS,
            note=f"without it some do in {len(spun)} of {len(bare)}: {'; '.join(spun)}",
        ),
        Claim(
            f"with the limiter dead reckoning is off by at most {1e3 * RECKONED:g} mm at the end",
            f"{1e3 * off[LIMITED]:.2f} mm; without it up to {1e3 * off[BARE]:.0f} mm",
            off[LIMITED] < RECKONED < off[BARE],
        ),
        Claim(
            f"no limiter holds a platform on a slope of {slope:g} rad where μ is 0.15",
            "; ".join(f"{label}: slips at {runs[label].slipping:.3g} m/s" for label in steep),
            bool(steep) and all(runs[label].slipping > SLIPS for label in steep),
        ),
    ]


# -- noticing slip -------------------------------------------------------------------------------------------

CUT, EARNED, NOTICING = "torque cut", "limiter, friction earned", "limiter, slip noticed"
SEEN = {"counts": 4000, "pose": "true", "gyro": {"noise": 0.003, "bias": 0.002}}
GIVEN = {"limits.friction": "given"}  # noticing slip alone
BELIEVED = {"contact.mu": 0.65, "floor": {"mu": 0.5}, "sensors": SEEN, "simulation.duration": 11.0}
OVER, WET = "mu 1.3 times too large", "wet patch"
SLIP_CASES = {
    f"{OVER}, {LIMITED}": Case("fastest.toml", {**BELIEVED, **GIVEN}, engine="mujoco"),
    f"{OVER}, {EARNED}": Case("fastest.toml", BELIEVED, engine="mujoco"),
    f"{OVER}, {NOTICING}": Case(
        "fastest.toml", {**BELIEVED, **GIVEN, "limits.notice_slip": {}}, engine="mujoco"
    ),
    f"{WET}, {CUT}": Case("wet.toml", {"limits": {"mode": "cut", "torque": 20.0}}, engine="mujoco"),
    f"{WET}, {LIMITED}": Case("wet.toml", GIVEN, engine="mujoco"),
    f"{WET}, {NOTICING}": Case("wet.toml", {**GIVEN, "limits.notice_slip": {}}, engine="mujoco"),
}
COLOUR_OF = {BARE: FAINT, CUT: FAINT, LIMITED: STOP, EARNED: COLOURS[1], NOTICING: COLOURS[2]}


def draw_slip(runs: Runs) -> matplotlib.figure.Figure:
    """Distance from the path and slip, where mu is overestimated and on a wet patch;
    and what is believed of mu."""
    titles = (f"{OVER}: off the path", f"{OVER}: friction", f"{WET}: off the path", f"{WET}: friction")
    figure, axes = panels(*titles, height=4.4)
    for label, run in runs.items():
        scene, _, how = label.partition(", ")
        distance, friction = axes[:2] if scene == OVER else axes[2:]
        colour = COLOUR_OF[how]
        distance.plot(run.t, 100 * run.y[:, 0], color=colour, label=f"{how}: slip ≤ {run.slipping:.2f} m/s")
        if how in (EARNED, NOTICING):
            friction.plot(run.t, run.noticed[:, 0], color=colour, label=f"believed, {how.partition(', ')[2]}")
        if how == NOTICING:
            friction.axhline(run.noticed[0, 0], color=STOP, label="believed, limiter alone")
            assert run.floor
            friction.axhline(
                run.floor.mu if scene == OVER else 0.2,
                color="black",
                linestyle=":",
                label="true" + " on the patch" * (scene == WET),
            )
    for panel, unit in zip(axes, ("distance (cm)", "friction coefficient") * 2, strict=True):
        over_time(panel, unit)
        legend_below(panel)
    for panel in axes[1::2]:
        panel.set_ylim(0.0, 0.8)
    return figure


def claims_slip(runs: Runs) -> list[Claim]:
    """The path is kept where mu is overestimated; on the patch, dead reckoning loses less."""
    off = {label: float(np.abs(run.y[:, 0]).max()) for label, run in runs.items()}
    lost = {label: reckoning_error(run) or 0.0 for label, run in runs.items()}
    names = [f"{OVER}, {LIMITED}", f"{OVER}, {NOTICING}"]
    patch = [f"{WET}, {how}" for how in (CUT, LIMITED, NOTICING)]
    return [
        Claim(
            "where the limiter believes 1.3 times the friction, noticing slip keeps the path within 1 cm; "
            "else it is lost",
            f"{1e3 * off[names[1]]:.1f} mm; {1e3 * off[names[0]]:.0f} mm",
            off[names[1]] < 0.01 and off[names[0]] > 0.1,
        ),
        Claim(
            "after the wet patch dead reckoning has lost less where slip was noticed",
            ", ".join(f"{label.partition(', ')[2]} {lost[label]:.2f} m" for label in patch),
            lost[patch[2]] < 0.9 * min(lost[patch[0]], lost[patch[1]]),
            note="the patch cannot be held at this speed: off the path by "
            + ", ".join(f"{1e3 * off[label]:.0f} mm" for label in patch),
        ),
    ]


# -- friction that is not what is believed -------------------------------------------------------------------

BELIEVED_MU = 0.5
RATIOS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3)  # of the true friction to the believed one
FROM_REST = {
    "initial.speed": 0.0,
    "simulation.period": PERIOD,
    "simulation.duration": 12.0,
    "contact": {"mu": BELIEVED_MU},
}
LIMITERS: Mapping[str, Mapping[str, Any]] = {BARE: {}, LIMITED: KNOWN, EARNED: {"limits.mode": "grip"}}
EARNED_CASES = {
    f"{how}, {ratio:g}": Case(
        file_of("labmate"), {**FROM_REST, "floor": {"mu": ratio * BELIEVED_MU}, **limits}, engine="mujoco"
    )
    for how, limits in LIMITERS.items()
    for ratio in RATIOS
}
SLIDES = 0.05  # m/s


def sliding(run: FigureRun | Run) -> float:
    """How long a wheel slips faster than SLIDES, s."""
    assert run.floor
    return float(np.diff(run.t, append=run.t[-1])[run.floor.slip.max(axis=1) > SLIDES].sum())


def reached(run: FigureRun) -> float:
    """The time from which on the path is nearer than 1 cm, s; infinite if it is not at the end."""
    last = int(np.flatnonzero(np.abs(run.y[:, 0]) > 0.01)[-1])
    return float(run.t[last + 1]) if last + 1 < len(run.t) else math.inf


def draw_earned(runs: Runs) -> matplotlib.figure.Figure:
    """Largest slip, and for how long, over the true friction; for how long not of runs that end early,
    their wheels spinning."""
    figure, axes = panels("largest slip of a wheel", f"slips faster than {100 * SLIDES:g} cm/s", height=3.6)
    true = [ratio * BELIEVED_MU for ratio in RATIOS]
    for how in LIMITERS:
        own = [runs[f"{how}, {ratio:g}"] for ratio in RATIOS]
        axes[0].semilogy(
            true, [100 * max(run.slipping, LEAST) for run in own], "o-", color=COLOUR_OF[how], label=how
        )
        axes[1].plot(
            true,
            [math.nan if run.stopped else sliding(run) for run in own],
            "o-",
            color=COLOUR_OF[how],
            label=how,
        )
    for panel, unit in zip(axes, ("cm/s", "s"), strict=True):
        panel.axvline(BELIEVED_MU, color=EDGE, linestyle=":", label="believed friction")
        panel.set(xlabel="true friction coefficient", ylabel=unit)
        legend_below(panel)
    return figure


def claims_earned(runs: Runs) -> list[Claim]:
    """How much slips where friction is less than believed, and that nothing is lost where it is not."""
    claims = []
    for least, most, slip, seconds in ((1.0, 1.3, 0.01, 0.0), (0.8, 1.0, 0.1, 0.04), (0.5, 0.8, 0.3, 0.1)):
        own, given = (
            [runs[f"{how}, {ratio:g}"] for ratio in RATIOS if least <= ratio <= most]
            for how in (EARNED, LIMITED)
        )
        worst, longest = max(run.slipping for run in own), max(map(sliding, own))
        claims.append(
            Claim(
                f"earned, true friction {least:g} to {most:g} of the believed one: at most {100 * slip:g} "
                "cm/s" + (f", above {100 * SLIDES:g} cm/s for at most {seconds:g} s" if seconds else ""),
                f"{100 * worst:.2g} cm/s, {longest:.2g} s",
                worst <= slip and longest <= seconds,
                note=f"given: {100 * max(run.slipping for run in given):.2g} cm/s, "
                f"{max(map(sliding, given)):.2g} s",
            )
        )
    times = [reached(runs[f"{how}, 1"]) for how in (EARNED, LIMITED)]
    text = "where friction is as believed, earning it reaches the path at most 1.02 times as late"
    return [
        *claims,
        Claim(text, f"{times[0]:.2f} s, given {times[1]:.2f} s", times[0] <= 1.02 * times[1] < math.inf),
    ]


FIGURES = (
    Figure(
        "floor",
        "Beyond the paper: which of its claims survive a floor",
        "The runs of figures 1 and 6 to 16 at 100 Hz in a physics engine, where wheels slip and a castor "
        "carries 30 %: without and with the grip limiter, and with it and an approach. A claim is lost, too, "
        "where a run that it is about ends early.",
        "",
        PAPER_CASES,
        draw_papers,
        claims_papers,
    ),
    Figure(
        "robots_on_floor",
        "Beyond the paper: the shipped robots on slippery floors",
        "Each robot in the run of its SPEC, at 100 Hz, with and without the grip limiter, which believes the "
        "true friction.",
        "",
        ROBOT_CASES,
        draw_robots,
        claims_robots,
    ),
    Figure(
        "slip",
        "Beyond the paper: noticing slip",
        "A gyro tells slip from the wheels; the limiter then believes less friction for a while, and the "
        "robot drives slower.",
        "",
        SLIP_CASES,
        draw_slip,
        claims_slip,
    ),
    Figure(
        "earned",
        "Beyond the paper: friction that is not what is believed",
        "The line of the paper from rest at 100 Hz in a physics engine; the controller believes a friction "
        f"of {BELIEVED_MU:g}.",
        "",
        EARNED_CASES,
        draw_earned,
        claims_earned,
    ),
)
