"""Verdicts on starts against simulations: sampled and continuous, limited, delayed,
and of robots that differ a little."""

import math
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from noslip.analysis.certification.certificate import Certificate, Settled
from noslip.analysis.certification.enclosed_loop import EnclosedLoop, kink
from noslip.analysis.certification.enclosure import Enclosure
from noslip.analysis.certification.safe_offsets import safe_offsets
from noslip.analysis.certification.safety import NOT_PROVED, SAFE, SINGULAR, Verdict, certify
from noslip.analysis.certification.tube import Tube
from noslip.model.law import symbols
from noslip.readers.errors import BadInput
from noslip.simulation.closed_loop import simulate
from noslip.simulation.loop import make_loop
from noslip.simulation.specification.spec import Spec, read_spec, spec_of_table

ERROR = 0.01  # of every parameter of the robot
KINDS = ("line", "circle", "ellipse", "segment", "composite")


def spec_of(**sections) -> Spec:
    """A SPEC of the LABMATE from its tables."""
    return spec_of_table({"robot": "labmate", **sections}, "test.toml")


def random_start(random: np.random.Generator, kind: str) -> dict:
    """Tables of a SPEC for a kind of path: the path, gains, speeds, limits, period and start at random.

    Of two starts one is moderate, P_l at most 1.5 m beside the path; about four in ten of the others become
    singular.
    """
    wild = random.random() < 0.5
    offset, turned = (4.0, 1.45) if wild else (1.5, 1.2)
    offset, turned, along = (
        random.uniform(-offset, offset),
        random.uniform(-turned, turned),
        random.uniform(-math.pi, math.pi),
    )
    radius, direction = random.uniform(3.0, 15.0), random.uniform(-math.pi, math.pi)
    left = np.array([-math.sin(direction), math.cos(direction)])
    if kind == "line":
        path, point = (
            {"A": left[0], "B": left[1], "C": 0.0},
            offset * left + 3.0 * np.array([left[1], -left[0]]),
        )
    elif kind == "composite":
        curvatures = random.uniform(-0.3, 0.3, 5)
        curvatures[random.integers(1, 5)] = 0.0
        path, point = (
            {"segments": _pieces(random, direction, curvatures)},
            _outside(offset, curvatures[0]) * left,
        )
    elif kind == "segment":
        curvature = random.uniform(-0.3, 0.3)
        offset = _outside(offset, curvature)
        path, point = {"x_s": 0.0, "y_s": 0.0, "direction": direction, "curvature": curvature}, offset * left
    elif kind == "circle":  # its normal points outwards, so that it is followed clockwise
        path, direction, offset = (
            {"x_f": 1.0, "y_f": -2.0, "R": radius},
            along - math.pi / 2,
            _outside(offset, -1 / radius),
        )
        point = np.array([1.0, -2.0]) + (radius + offset) * np.array([math.cos(along), math.sin(along)])
    else:
        a, b = radius, radius * random.uniform(0.5, 1.0)
        offset = _outside(offset, -a / b**2)
        normal = np.array([math.cos(along) / a, math.sin(along) / b])
        normal /= np.linalg.norm(normal)
        path, direction = {"a": a, "b": b}, math.atan2(normal[1], normal[0]) - math.pi / 2
        point = np.array([a * math.cos(along), b * math.sin(along)]) + offset * normal
    speed, kp = random.uniform(0.4, 4.0 if wild else 2.5), random.uniform(0.5, 6.0)
    period = 0.0 if random.random() < 0.4 else float(random.choice([0.005, 0.01, 0.02, 0.05]))
    tables = {
        "gains": {
            "kp": kp,
            "kd": 2 * math.sqrt(kp) * random.uniform(0.8, 1.5),
            "kv": random.uniform(0.5, 3.0),
        },
        "output": {"type": "IV", "L": random.uniform(0.0, 0.6), "path": {"kind": kind, **path}},
        "reference": {"speed": speed},
        "initial": {
            "point": list(map(float, point)),
            "heading": direction + turned,
            "speed": speed * random.uniform(0.0, 1.2),
        },
        "simulation": {
            "duration": 5.0,
            "period": period,
            "backend": "casadi",
            "output_step": 0.05,
            "tolerance": 1e-9,
        },
    }
    if period and random.random() < 0.5:
        tables["simulation"]["delay"] = period * random.uniform(0.0, 1.0)
    if random.random() < 0.3:
        tables["limits"] = {
            "torque": random.uniform(30.0, 300.0),
            "mode": str(random.choice(["cut", "slow"])),
        }
    return tables


def _pieces(random: np.random.Generator, heading: float, curvatures: np.ndarray) -> list[dict]:
    """Lines and arcs that join, of 1 to 6 m; the last is longer."""
    tables = []
    for k, curvature in enumerate(curvatures):
        length = 30.0 if k + 1 == len(curvatures) else random.uniform(1.0, 6.0)
        arc = (
            {"kind": "arc", "radius": 1 / abs(curvature), "angle": curvature * length} if curvature else None
        )
        tables.append(
            (arc or {"kind": "line", "length": length})
            | ({} if k else {"from": [0.0, 0.0], "heading": heading})
        )
    return tables


def _outside(offset: float, curvature: float) -> float:
    """An offset to the left, moved away from the centres of curvature."""
    return offset if offset * curvature < 0.8 else 0.8 / curvature


def judged(seed: int) -> tuple[Verdict, str] | None:
    """The verdict on a random start, and how a run with a robot within ERROR ends;
    None for a start that is none."""
    random = np.random.default_rng([1992, seed])
    tables = random_start(random, KINDS[seed % len(KINDS)])
    spec = spec_of(**tables)
    loop = make_loop(spec)
    names = [q.name for q in loop.law.parameters]
    verdict = certify(loop, spec, dict.fromkeys(names, ERROR))
    signs = random.choice([-1.0, 1.0], len(names)) if seed % 2 else random.uniform(-1.0, 1.0, len(names))
    plant = {
        name: value * (1 + ERROR * sign)
        for name, value, sign in zip(names, loop.plant.parameters, signs, strict=True)
    }
    return verdict, simulate(spec_of(**tables, plant=plant)).stopped or "ok"


def compare(seeds: range) -> dict[str, int]:
    """How many starts got each verdict. Fails where a run contradicts one."""
    counts = dict.fromkeys((SAFE, SINGULAR, NOT_PROVED), 0)
    for seed in seeds:
        verdict, end = judged(seed)
        counts[verdict.kind] += 1
        assert verdict.kind != SAFE or end == "ok", (seed, str(verdict), end)
        assert verdict.kind != SINGULAR or end == "singular", (seed, str(verdict), end)
    return counts


FAST = {
    "gains": {"kp": 100.0, "kd": 5.0, "kv": 1.0},
    "output": {"type": "IV", "L": 0.2, "path": {"kind": "line", "A": 0.0, "B": 1.0, "C": 0.0}},
    "reference": {"speed": 4.0},
    "initial": {"point": [0.0, 0.5], "heading": -1.0822, "speed": 4.0},
    "simulation": {"duration": 2.0, "tolerance": 1e-11, "backend": "casadi"},
}


def test_a_brief_touch_of_the_singular_set_is_seen():
    """1 - |s| is negative only between 0.1107 s and a little later."""
    spec = spec_of(**FAST)
    verdict, run = certify(make_loop(spec), spec), simulate(spec)
    assert verdict.kind == SINGULAR and run.stopped == "singular" and abs(verdict.t - run.t[-1]) < 1e-6


def test_uncertain_parameters_are_named():
    spec = spec_of(**FAST)
    for wrong in ({"m": 0.1}, {"m_c": -0.1}, {"m_c": 1.0}):
        with pytest.raises(BadInput, match="uncertainty"):
            certify(make_loop(spec), spec, wrong)


def test_bounds_hold_and_are_of_second_order():
    """At random points of random boxes; a tenth of the box has a hundredth of the rest."""
    x, random = ca.SX.sym("x", 3), np.random.default_rng(3)
    f = ca.vertcat(
        ca.sin(x[0]) * ca.cos(x[1]) / (2 + x[2] ** 2),
        ca.sqrt(3 + x[0] * x[1]) - ca.tan(x[2] / 4),
        1 / (3 - x[0]),
    )
    enclosure, plain = Enclosure(f, x), ca.Function("f", [x], [f, ca.jacobian(f, x)])
    for _ in range(50):
        at, moved, radius = random.uniform(-1, 1, 3), random.uniform(0, 0.05, 3), random.uniform(0.01, 0.1, 3)
        bounds, small = enclosure.bounds(at, moved, radius), enclosure.bounds(at, 0 * moved, radius / 10)
        assert bounds.finite and (small.rest <= bounds.rest / 99).all()
        for _ in range(20):
            centre = at + moved * random.uniform(-1, 1, 3)
            e = radius * random.uniform(-1, 1, 3)
            (value, slope), (after, _), (before, _) = (
                [v.full() for v in plain(p)] for p in (centre, centre + e, at)
            )
            assert (np.abs(value - before)[:, 0] <= bounds.moved + 1e-14).all()
            assert (np.abs(after - value)[:, 0] <= bounds.radius + 1e-14).all()
            assert (np.abs((after - value)[:, 0] - slope @ e) <= bounds.rest + 1e-14).all()


@pytest.mark.nightly
def test_largest_offset_is_safe_and_ends_somewhere():
    tables = {**FAST, "gains": {"kp": 4.0, "kd": 5.0, "kv": 1.0}, "reference": {"speed": 1.0}}
    tables["initial"] = {"point": [0.0, 0.1], "heading": 0.0, "speed": 1.0}
    table = safe_offsets(spec_of(**tables), {}, speeds=[1.0], headings=[0.0])
    ((offset,),) = table.offsets
    assert 0 < offset < 8 and "m" in table.lines()[1]
    spec = spec_of(**{**tables, "initial": {"point": [5.0, -offset], "heading": 0.0, "speed": 1.0}})
    assert simulate(spec).stopped is None


ELLIPSE = {
    "output": {"type": "IV", "L": 0.4, "path": {"kind": "ellipse", "a": 5.25, "b": 4.47}},
    "reference": {"speed": 0.94},
    "initial": {"point": [3.84, -1.77], "heading": -2.39, "speed": 0.22},
    "simulation": {"duration": 5.0, "tolerance": 1e-9, "backend": "casadi"},
}
SLOPE = read_spec(Path(__file__).parents[2] / "examples/specs" / "robots" / "slope_platform.toml")


@pytest.mark.parametrize("spec", [spec_of(**ELLIPSE), SLOPE], ids=["ellipse", "slope"])
def test_a_course_is_that_of_the_run(spec):
    """On a path that bends differently everywhere, and where the forces depend on the heading in the
    world."""
    spec = replace(
        spec, simulation=replace(spec.simulation, duration=3.0, output_step=0.05, backend="casadi")
    )
    verdict, run = certify(make_loop(spec), spec), simulate(spec)
    x, y, heading = run.q[:, :3].T
    path = dict(zip([c.name for c in run.law.config], make_loop(spec).guidance.leg.config, strict=True))
    if "a" in path:
        L, a, b = path["L"], path["a"], path["b"]
        point = ca.SX.sym("x", 2)
        f = (point[0] / a) ** 2 + (point[1] / b) ** 2 - 1
        gradient = ca.Function("g", [point], [ca.gradient(f / ca.norm_2(ca.gradient(f, point)), point)])
        normal = gradient(np.array([x + L * np.cos(heading), y + L * np.sin(heading)])).full()
        normal /= np.linalg.norm(normal, axis=0)
    else:
        normal = np.array([path["A"], path["B"]]) / math.hypot(path["A"], path["B"])
    s = normal[0] * np.cos(heading) + normal[1] * np.sin(heading)
    _, one, other = np.intersect1d(
        np.round(1e6 * verdict.course[0]), np.round(1e6 * run.t), return_indices=True
    )
    assert len(one) > 50 and np.abs(verdict.course[1][one] - s[other]).max() < 1e-6


@pytest.mark.nightly
def test_an_ellipse_is_proved_with_uncertain_parameters():
    spec = spec_of(**ELLIPSE)
    loop = make_loop(spec)
    verdict = certify(loop, spec, {q.name: ERROR for q in loop.law.parameters})
    assert verdict.kind == SAFE


def test_a_limit_that_is_perhaps_met_is_followed_by_one_line():
    """The change of max(0, x) is that of the line but for `off`, at random places."""
    random = np.random.default_rng(5)
    for _ in range(2000):
        over, moved, radius = random.uniform(-1, 1), random.uniform(0, 0.5), random.uniform(0, 1)
        slope, off, off_moved = kink(np.array(over), np.array(moved), np.array(radius))
        centre, e = over + moved * random.uniform(-1, 1), radius * random.uniform(-1, 1)
        assert abs(max(0, centre + e) - max(0, centre) - slope * e) <= off + 1e-14
        assert abs(max(0, centre) - max(0, over) - slope * (centre - over)) <= off_moved + 1e-15


COMPOSITE = {
    "gains": {"kp": 1.0, "kd": 2.5, "kv": 2.0},
    "output": {
        "type": "IV",
        "L": 0.0,
        "path": {
            "kind": "composite",
            "segments": [
                {"kind": "arc", "from": [0.0, 0.0], "heading": 0.0, "radius": 5.0, "angle": 0.5},
                {"kind": "line", "length": 1.0},
                {"kind": "arc", "radius": 3.0, "angle": -2.6},
            ],
        },
    },
    "reference": {"speed": 1.4},
    "initial": {"point": [0.0, 0.2], "heading": 0.1, "speed": 1.0},
    "simulation": {"duration": 5.0, "output_step": 0.05, "backend": "casadi"},
}


@pytest.mark.parametrize("period", [0.0, 0.05])
def test_all_runs_along_a_composite_path_are_within_what_is_proved(period):
    """Runs of robots at the corners of what their parameters may be, over two joints; sampled,
    with several calls near each."""
    tables = {**COMPOSITE, "simulation": {**COMPOSITE["simulation"], "period": period}}
    spec = spec_of(**tables)
    loop, random = make_loop(spec), np.random.default_rng(7)
    names = [q.name for q in loop.law.parameters]
    verdict = certify(loop, spec, dict.fromkeys(names, ERROR))
    assert verdict.kind == SAFE and verdict.until == pytest.approx(5.0)
    for _ in range(3):
        signs = random.choice([-1.0, 1.0], len(names))
        plant = {
            name: v * (1 + ERROR * sign)
            for name, v, sign in zip(names, loop.plant.parameters, signs, strict=True)
        }
        run = simulate(spec_of(**tables, plant=plant))
        assert run.stopped is None and max(run.piece) == 2


def test_a_composite_path_is_not_proved_beyond_where_its_speed_changes():
    tables = {**COMPOSITE, "reference": {"speed": 1.4, "deceleration": 0.25}}
    tables["simulation"] = {**tables["simulation"], "duration": 8.0}
    verdict = certify(make_loop(spec_of(**tables)), spec_of(**tables))
    assert verdict.kind == NOT_PROVED and "speed changes" in verdict.reason and verdict.until > 1.0


def test_a_set_that_is_known_to_settle_holds_what_is_in_it():
    tube = Tube(np.zeros(2), np.eye(2), np.zeros((2, 1)), np.array([0.1, 0.1]))
    settled = Settled(tube, np.array([0.02, 0.02]))
    assert settled.holds(tube) and not settled.holds(Tube(tube.centre + 0.03, tube.S, tube.G, tube.spread))
    assert not settled.holds(Tube(tube.centre, 1.3 * tube.S, tube.G, tube.spread))


def robots(spec: Spec, tables: dict, error: dict[str, float], corners: np.ndarray) -> list[Spec]:
    """SPECs with the named parameters of the plant at these corners of what they may be."""
    loop = make_loop(spec)
    values = {q.name: v for q, v in zip(loop.law.parameters, loop.plant.parameters, strict=True)}
    plants = [
        {name: values[name] * (1 + e) for name, e in zip(error, corner * [*error.values()], strict=True)}
        for corner in corners
    ]
    return [spec_of(**tables, plant=plant) for plant in plants]


@pytest.mark.nightly
def test_a_start_that_is_proved_in_parts_only():
    """Runs with the robot at random corners stay regular, and as far from singular as is proved."""
    random = np.random.default_rng([1992, 92])
    tables = random_start(random, "ellipse")
    spec = spec_of(**tables)
    loop = make_loop(spec)
    error = {q.name: ERROR for q in loop.law.parameters}
    enclosed = EnclosedLoop(loop, spec, error)
    assert Certificate(enclosed, spec.simulation).run().lost
    verdict = certify(loop, spec, error)
    assert verdict.kind == SAFE and verdict.parts == 4 and "4 parts" in str(verdict)
    arguments = [symbols(group) for group in (loop.law.state, loop.law.config, loop.law.parameters)]
    measure = ca.Function("measure", arguments, [ca.vertcat(*loop.law.linearization.measure)])
    for robot in robots(spec, tables, error, random.choice([-1.0, 1.0], (6, len(error)))):
        run = simulate(robot)
        size, scale = measure(np.hstack([run.q, run.nu]).T, loop.guidance.leg.config, loop.believed).full()
        assert run.stopped is None and (size / scale).min() >= verdict.margin


@pytest.mark.nightly
def test_a_start_that_is_singular_at_one_corner_only_is_not_proved():
    """However the range of the parameters is split; the motions with the given parameters and at three
    corners are regular."""
    tables = {**FAST, "initial": {**FAST["initial"], "heading": -1.07}}
    spec, error = spec_of(**tables), {"b": 0.02, "r": 0.02}
    corners = np.array([[b, r] for b in (-1.0, 1.0) for r in (-1.0, 1.0)])
    ends = [simulate(robot).stopped for robot in (spec, *robots(spec, tables, error, corners))]
    assert ends.count("singular") == 1 and ends.count(None) == 4
    verdict = certify(make_loop(spec), spec, error)
    assert verdict.kind == NOT_PROVED and verdict.parts == 1


def test_halves_make_up_the_whole():
    """Of each parameter; what the controller believes stays, and so does the start."""
    spec = spec_of(**ELLIPSE, plant={"m_c": 31.0})
    loop = make_loop(spec)
    whole = EnclosedLoop(loop, spec, {"m_c": 0.1, "r": 0.01, "b": 0.02})
    for which in range(3):
        halves = [whole.half(spec, which, side)[0] for side in (-1.0, 1.0)]
        low, high = (np.array([half.nominal + sign * half.spread for half in halves]) for sign in (-1, 1))
        assert (low.min(axis=0) <= whole.nominal - whole.spread).all()
        assert (high.max(axis=0) >= whole.nominal + whole.spread).all()
        assert low[1, which] <= high[0, which] and (halves[0].spread <= whole.spread).all()
        assert halves[0].spread[which] == pytest.approx(whole.spread[which] / 2)
        for half in halves:
            assert (half.loop.believed == loop.believed).all() and np.abs(
                half.loop.start[:3] - loop.start[:3]
            ).max() == 0


def test_no_verdict_is_wrong():
    counts = compare(range(3))
    assert counts[SAFE] >= 2


@pytest.mark.nightly
@pytest.mark.parametrize("first", range(0, 200, 100))
def test_no_verdict_is_wrong_of_many(first):
    counts = compare(range(first, first + 100))
    assert counts[SAFE] > 30 and counts[SINGULAR] >= 1, counts
    assert counts[NOT_PROVED] <= 20, counts


EXTENDED = {
    "initial": {"point": [-0.1, 0.05], "heading": 0.1, "speed": 0.5},
    "simulation": {"duration": 8.0, "backend": "casadi"},
}
POINT = {
    "output": {"type": "I", "L": -0.3, "extension": True},
    "reference": {"position": [0.0, 0.0], "velocity": [0.6, 0.0]},
}
ALONG = {
    "output": {
        "type": "IV",
        "L": -0.3,
        "extension": True,
        "path": {"kind": "line", "A": 0.0, "B": 1.0, "C": 0.0},
    },
    "reference": {"speed": 0.8},
}
ROUND = {
    "output": {
        "type": "IV",
        "L": -0.3,
        "extension": True,
        "path": {"kind": "circle", "x_f": 0.0, "y_f": -3.0, "R": 3.0},
    },
    "reference": {"speed": 0.8},
}
CIRCLING = {"reference": {"position": [0.0, -1.0], "circle": {"radius": 1.0, "rate": 0.5, "angle": "90 deg"}}}


def what_must_not_vanish(run) -> np.ndarray:
    """Of a law whose P_l is on the axle: its speed, along a path that less the rate of the distance;
    from the pose alone."""
    heading, speed = run.q[:, 2], 0.15 * run.nu.mean(axis=1)
    if run.law.output.path is None:
        return np.abs(speed)
    normal = np.column_stack([np.zeros(len(run.t)), np.ones(len(run.t))])
    if run.law.output.path.kind == "circle":
        from_centre = run.q[:, :2] - 0.3 * np.column_stack([np.cos(heading), np.sin(heading)]) - [0.0, -3.0]
        normal = from_centre / np.linalg.norm(from_centre, axis=1)[:, None]
    across = normal[:, 0] * np.cos(heading) + normal[:, 1] * np.sin(heading)
    return np.abs(speed) * (1 - np.abs(across))


@pytest.mark.parametrize(
    "chosen", [(3, 7, 9), pytest.param(range(40), marks=pytest.mark.nightly)], ids=["few", "many"]
)
def test_starts_of_laws_with_a_dynamic_extension(chosen):
    """Verdicts on random starts against runs: what is said to stay above a bound does, closely;
    what stops is not safe."""
    random, found = np.random.default_rng(21), []
    for k in range(max(chosen) + 1):
        tables = [POINT, ALONG, POINT | CIRCLING, ROUND][k % 4]
        speed = random.choice([-1.0, 1.0]) * random.uniform(0.2, 1.0)
        start = {
            "point": random.uniform(-1, 1, 2).tolist(),
            "heading": random.uniform(-1.2, 1.2),
            "speed": speed,
        }
        if k not in chosen:
            continue
        spec = spec_of(**EXTENDED | tables | {"initial": start})
        verdict, run = certify(make_loop(spec), spec), simulate(spec)
        found.append(verdict.kind)
        if verdict.kind == SAFE:
            least = float(verdict.reason.split("above ")[1].split(" m/s")[0])
            sizes = what_must_not_vanish(run)
            assert run.stopped is None and 0.3 * sizes.min() - 1e-3 < least < sizes.min(), k
        elif verdict.kind == SINGULAR:
            assert run.stopped == "singular" and abs(run.t[-1] - verdict.t) < 1e-3, k
        else:
            assert "may vanish" in verdict.reason and run.stopped is None, k
    assert found.count(SAFE) >= len(chosen) / 2 and found.count(SINGULAR) >= 1, found


def test_what_is_not_proved_of_an_extended_law_is_said():
    period = {"simulation": EXTENDED["simulation"] | {"period": 0.02, "duration": 1.0}}
    short = {"simulation": EXTENDED["simulation"] | {"duration": 1.0}}
    cases = [
        (EXTENDED | POINT | period, {}, "the loop is sampled"),
        (EXTENDED | POINT | short, {"m_c": 0.1}, "the robot's parameters differ"),
        (EXTENDED | POINT | short | {"plant": {"m_c": 31.0}}, {}, "the robot's parameters differ"),
        (EXTENDED | POINT | short | {"gains": {"ki": 0.1}}, {}, "the loop has integral action"),
        (EXTENDED | POINT | short | {"limits": {"torque": 5.0, "mode": "cut"}}, {}, "the inputs are limited"),
    ]
    for tables, uncertainty, why in cases:
        spec = spec_of(**tables)
        verdict = certify(make_loop(spec), spec, uncertainty)
        assert (
            verdict.kind == NOT_PROVED and verdict.reason.startswith(why) and "begins here" in verdict.reason
        ), why


@pytest.mark.parametrize(("kind", "expected"), [("line", SAFE), ("circle", NOT_PROVED)])
def test_a_damped_law_begins_from_every_start(kind, expected):
    """Also with the heading normal to the path, where the law without a band has no verdict but singular."""
    paths = {"line": {"A": 0.0, "B": 1.0, "C": 0.0}, "circle": {"x_f": 0.0, "y_f": -3.0, "R": 3.0}}
    start = {"point": [0.0, 2.0], "heading": "90 deg"}
    output = {"type": "IV", "near_singular": "damped", "path": {"kind": kind, **paths[kind]}}
    tables = {
        "reference": {"speed": 1.0},
        "initial": start,
        "simulation": {"duration": 2.0, "backend": "casadi", "period": 0.02},
    }
    spec = spec_of(output=output, **tables)
    verdict = certify(make_loop(spec), spec, {"m_c": 0.2})
    assert verdict.kind == expected and "begins from every start" in verdict.reason
    assert expected == NOT_PROVED or simulate(spec).stopped is None
    with pytest.raises(BadInput, match="singular at the start"):
        make_loop(
            spec_of(
                output={name: value for name, value in output.items() if name != "near_singular"}, **tables
            )
        )
