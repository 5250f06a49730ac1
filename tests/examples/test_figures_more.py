"""The later figures: composite paths, noise and recalibration, limits, reversing, rolling, planned paths."""

import math
from dataclasses import replace

import numpy as np
import pytest
from noslip.analysis.certification.safety import certify
from noslip.examples.evidence.figures import composite, limits, planned, redrawn, reversing, rolling, sensing
from noslip.examples.evidence.framework import Case, FigureRun
from noslip.examples.evidence.production import produce
from noslip.model.segments import Segment
from noslip.readers.robots import find_robot, law_of, system_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.contact import contact_forces
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.drawing import pictures
from noslip.simulation.loop import make_loop
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import ContactSection
from noslip.tests.figures_made import figure_of

MODULES = (composite, sensing, limits, reversing, rolling, planned)
FIGURES = [figure for module in MODULES for figure in module.FIGURES]


# -- claims can fail -----------------------------------------------------------------------------------------


def changed(run: FigureRun, **arrays) -> FigureRun:
    return replace(run, arrays={**run.arrays, **{name: value(run) for name, value in arrays.items()}})


def with_segments(run: FigureRun, change) -> FigureRun:
    """The same run, its path said to be another."""
    path = run.spec.output.path
    if not (path and path.segments):
        return run
    segments = tuple(change(k, segment) for k, segment in enumerate(path.segments))
    return replace(
        run, spec=replace(run.spec, output=replace(run.spec.output, path=replace(path, segments=segments)))
    )


def with_forces(run: FigureRun, factor: float) -> FigureRun:
    contacts = [
        replace(c, longitudinal=factor * c.longitudinal, lateral=factor * c.lateral)
        for c in run.grip.contacts
    ]
    return replace(run, grip=replace(run.grip, contacts=tuple(contacts)))


def second_join_eased(run: FigureRun) -> FigureRun:
    """From the second join on torque and distance stay as they were before it."""
    k = int(np.flatnonzero(run.piece == 1)[-1]) if 1 in run.piece else 0
    frozen = np.minimum(np.arange(len(run.t)), k)
    return changed(run, tau=lambda r: r.tau[frozen], y=lambda r: r.y[frozen])


DOCTORS = {
    "beside": lambda r: changed(r, q=lambda r: r.q + [0.5, 0.5, 0, 0, 0], y=lambda r: r.y + [0.5, 0]),
    "drifting": lambda r: changed(
        r, q=lambda r: r.q + r.t[:, None] ** 2 * [1, 1, 0, 0, 0], y=lambda r: r.y + 0.01 * r.t[:, None]
    ),
    "turned": lambda r: changed(r, q=lambda r: r.q + [0, 0, 1.0, 0, 0]),
    "swaying": lambda r: changed(
        r, nu=lambda r: r.nu * (1 + 0.1 * (np.arange(len(r.t)) % 100 == 1))[:, None]
    ),
    "jumping": lambda r: changed(r, q=lambda r: r.q + 0.3 * (np.arange(len(r.t)) // 100)[:, None]),
    "rushing": lambda r: changed(r, nu=lambda r: r.nu + 1.0),
    "still": lambda r: changed(r, q=lambda r: np.tile(r.q[0], (len(r.t), 1)), nu=lambda r: 0 * r.nu),
    "weak": lambda r: changed(r, tau=lambda r: r.tau / 10, status=lambda r: np.full(len(r.t), "ok")),
    "strong": lambda r: changed(r, tau=lambda r: r.tau * 2),
    "unlike": lambda r: replace(r, slip=1e-6, integral=1e-6, agreement=1e-6),
    "stopped": lambda r: changed(r, status=lambda r: np.full(len(r.t), "singular")),
    "all-seeing": lambda r: changed(r, seen=lambda r: np.hstack([r.q, r.nu])),
    "as believed": lambda r: changed(r, q=lambda r: r.seen[:, :5]),
    "one noise": lambda r: changed(r, seen=lambda r: np.hstack([r.q, r.nu + np.sin(r.t)[:, None]])),
    "a jump a second": lambda r: changed(r, seen=lambda r: r.seen + 0.5 * np.floor(r.t + 1e-9)[:, None]),
    "one piece": lambda r: changed(r, piece=lambda r: 0 * r.piece),
    "late L": lambda r: changed(r, place=lambda r: np.roll(r.place, 1, axis=0)),
    "behind": lambda r: changed(r, place=lambda r: -1 - r.place),
    "bent": lambda r: with_segments(
        r, lambda k, s: replace(s, heading=s.heading + 0.01 * k, curvature=s.curvature + 3.0)
    ),
    "apart": lambda r: with_segments(r, lambda k, s: replace(s, x=s.x + 0.2, y=s.y + 0.01 * k)),
    "tight at first": lambda r: with_segments(
        r, lambda k, s: replace(s, curvature=s.curvature / (0.1 if k == 0 else 1))
    ),
    "off after a join": lambda r: changed(r, y=lambda r: r.y + 0.01 * (r.piece > 0)[:, None] * [1, 0]),
    "eased": second_join_eased,
    "icy": lambda r: with_forces(r, 30.0),
    "sticky": lambda r: with_forces(r, 1 / 100),
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", [figure.name for figure in FIGURES])
def test_every_claim_can_fail(name):
    """Of runs that were tampered with, all of a figure or every other one,
    some make each claim come out otherwise."""
    made = figure_of(name)
    otherwise = {claim.text: set() for claim in made.claims}
    for doctor, tamper in DOCTORS.items():
        for every in (1, 2):
            try:
                runs = {
                    label: run if k % every else tamper(run)
                    for k, (label, run) in enumerate(made.runs.items())
                }
                doctored = made.figure.all_claims(runs)
            except (IndexError, ValueError):  # nothing left to measure
                continue
            for claim, other in zip(made.claims, doctored, strict=True):
                if claim.holds != other.holds:
                    otherwise[claim.text].add(doctor)
    assert [text for text, doctors in otherwise.items() if not doctors] == []


# -- what claims are measured against ------------------------------------------------------------------------


def test_torque_jump_is_that_of_the_law():
    """The law of line and arc, asked in the state of steady motion before the join,
    jumps as the closed form says."""
    random = np.random.default_rng(10)
    law = law_of(find_robot("labmate"), "type_iv_segment")
    parameters = {p.name: p.default for p in law.parameters}
    gains = [gain.default for gain in law.gains]
    for _ in range(20):
        v, radius, other = random.uniform(0.3, 5.0), random.uniform(1.0, 20.0), random.uniform(-0.5, 0.5)
        before = random.choice([0.0, 1.0]) / radius
        s = parameters["d"] * before
        heading, yaw = -math.asin(s), before * v / math.sqrt(1 - s**2)  # the path leads along x, to the left
        nu = (v + np.array([1, -1]) * parameters["b"] * yaw) / parameters["r"]
        state, tau = np.array([0.0, 0.0, heading, 0.0, 0.0, *nu]), []
        for curvature in (before, other):
            given = {"L": 0.0, "x_s": 0.0, "y_s": 0.0, "direction": 0.0, "curvature": curvature}
            config = [given[c.name] for c in law.config]
            controller = make_controller("casadi", law, list(parameters.values()), config, gains)
            wanted = np.array([v if q.name == "speed" else 0.0 for q in law.reference])
            tau.append(controller.step(state, wanted)[1])
        jump = tau[1] - tau[0]
        assert jump[1] == pytest.approx(-jump[0], abs=1e-9)
        assert composite.expected_jump(parameters, v, other - before, s) == pytest.approx(
            jump[0], rel=1e-9, abs=1e-9
        )


def test_sampled_runs_start_on_the_arc_within_one_period():
    arc = composite.CASES[composite.CONTINUOUS].spec().output.path.segments[0]
    for label in composite.SAMPLED:
        spec = composite.CASES[label].spec()
        x, y, direction = arc.pose(arc.progress(*spec.initial.point))
        assert math.dist((x, y), spec.initial.point) < 1e-12 and direction == pytest.approx(
            spec.initial.heading, abs=1e-12
        )
        assert 0 <= arc.progress(*spec.initial.point) < spec.reference.speed * spec.simulation.period
        assert 1 / arc.curvature == composite.RADIUS and spec.reference.speed == composite.SPEED


@pytest.mark.parametrize("label", list(sensing.LEFT_MEANS))
def test_noise_is_the_same_for_the_same_seed_in_c_and_in_python(label):
    case = {figure.name: figure for figure in sensing.FIGURES}["15"].cases[label]
    changes = {**case.changes, "simulation.duration": 2.5}
    spec, other = Case(case.file, changes).spec(), Case(case.file, {**changes, "sensors.seed": 2}).spec()
    runs = [simulate(spec, backend) for backend in ("c", "c", "casadi", "casadi")]
    for name in ("q", "nu", "tau", "seen"):
        c, again, python, python_again = (getattr(run, name) for run in runs)
        assert np.array_equal(c, again) and np.array_equal(python, python_again)
        assert np.abs(c - python).max() < 1e-8
        assert np.abs(getattr(simulate(other, "c"), name) - c).max() > 1e-3


@pytest.mark.nightly
def test_singular_time_in_closed_form_is_that_of_the_integrated_equation():
    run = figure_of("reversing").runs[reversing.WRONG]
    random = np.random.default_rng(11)
    for _ in range(5):
        offset, heading, v = random.uniform(-0.2, 0.2), random.uniform(0.02, 0.2), -random.uniform(0.7, 2.0)
        rate = v / run.parameters["r"]
        initial = {"q": [0.0, offset, heading, 0.0, 0.0], "nu": [rate, rate]}
        spec = Case("reversing.toml", {"initial": initial, "reference.speed": v}).spec()
        q = np.array([[*initial["q"]]])
        begin = changed(
            run,
            q=lambda r, q=q: q,
            nu=lambda r, rate=rate: np.array([[rate, rate]]),
            place=lambda r: r.place[:1],
        )
        verdict = certify(make_loop(spec), spec)
        assert verdict.kind == "singular" and reversing.singular_at(begin) == pytest.approx(
            verdict.t, abs=1e-7
        )


def test_refused_reversing_says_what_to_do():
    with pytest.raises(Exception, match='reversing = "switch"'):
        simulate(Case("reversing.toml", {"output.reversing": "refuse"}).spec())


def test_friction_needed_on_a_circle_is_that_of_the_constraint_forces():
    system = system_of(find_robot("labmate"))
    p = {q.name: q.default for q in system.mechanism.parameters}
    plant, spec = Plant(system, list(p.values())), Case("rolling.toml").spec()
    for v in np.random.default_rng(12).uniform(0.5, 9.0, 10):
        yaw = v / math.sqrt(100 - p["d"] ** 2)
        nu = (v + np.array([1, -1]) * p["b"] * yaw) / p["r"]
        x = np.array([1.0, 2.0, 0.3, 0.0, 0.0, *nu])
        tau = -plant.rate(x, np.zeros(2))[5:]  # what keeps nu constant, by the inertia below
        inertia = np.column_stack([plant.rate(x, e)[5:] + tau for e in np.eye(2)])
        tau = np.linalg.solve(inertia, tau)
        found = contact_forces(plant, x[None], tau[None], spec.contact or ContactSection())
        assert max(c.needs[0] for c in found) == pytest.approx(rolling.needed_on_circle(v), rel=1e-12)
    assert rolling.needed_on_circle(rolling.FASTEST) == pytest.approx(rolling.MU, rel=1e-12)


def test_distance_from_a_path_is_that_to_its_nearest_place():
    random = np.random.default_rng(13)
    segments = (Segment(0, 0, 0, 0.5, 2.0), Segment(*Segment(0, 0, 0, 0.5, 2.0).end, 0.0, 3.0))
    dense = np.array(
        [segment.pose(s)[:2] for segment in segments for s in np.linspace(0, segment.length, 20001)]
    )
    points = random.uniform(-1, 4, (30, 2))
    nearest = np.array([np.hypot(*(dense - place).T).min() for place in points])
    assert planned.off_path(points, segments) == pytest.approx(nearest, abs=1e-6)


def test_specs_are_what_the_figures_say():
    spec = Case("cusp.toml").spec()
    path, last = spec.output.path, spec.output.path.segments[-1].end
    assert path.stop == "axle" and last == pytest.approx(planned.GOAL, abs=1e-9)
    assert (spec.reference.creep, spec.gains["kv"]) == (planned.CREEP, planned.KV)
    spec = Case("limits.toml").spec()
    assert (spec.limits.torque, spec.reference.speed) == ((limits.LIMIT,), limits.SPEED)
    assert spec.output.path.parameters["R"] == limits.RADIUS
    for figure in sensing.FIGURES:
        for label, mean in sensing.LEFT_MEANS.items():
            for case in (case for name, case in figure.cases.items() if name.endswith(label)):
                noise = case.spec().sensors.noise
                assert noise.mean == (sensing.RIGHT_MEAN, mean) and noise.sd == (sensing.SD,)
    assert Case("rolling.toml").spec().contact.mu == rolling.MU


@pytest.mark.nightly
def test_diagrams_need_no_runs():
    made = produce(redrawn.FIGURES, 1, lambda made: None)
    assert [each.figure.name for each in made] == ["2", "3", "4", "5"]
    for each in made:
        assert not each.runs and not each.claims and each.pictures["png"].startswith(b"\x89PNG")
        assert b"<svg" in each.pictures["svg"]


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["7", "12"])
def test_pictures_are_the_same_every_time(name):
    made = figure_of(name)
    first, second = (
        pictures(lambda: made.figure.draw(made.runs), made.figure.title, made.figure.assumed)
        for _ in range(2)
    )
    assert first == second and first["svg"] == made.pictures["svg"]
