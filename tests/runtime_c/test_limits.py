"""Limits of the inputs: each cut by itself, or kept by giving up the speed,
so that the path gets what it asks for."""

import math
from functools import cache
from unittest.mock import patch

import casadi as ca
import cffi
import numpy as np
import pytest
from noslip.checks.verification.sampling import random_plants
from noslip.codegen import program as program_module
from noslip.codegen.derivation.stages import Result
from noslip.codegen.files import law_program, law_text
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.program import Program, compile_law
from noslip.model.law import symbols
from noslip.model.outputs import OUTPUTS
from noslip.model.reduction import reduce
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.build import shared_library
from noslip.simulation.controllers.controller import BACKENDS, ON_LIMIT, Limits
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.controllers.symbolic import slowed
from noslip.tests.codegen_tools import unicycle, wave_law
from scipy.optimize import linprog

OTHERS = ("type_i", "type_ii", "type_iii")
FOLLOWING = (*(name for name in OUTPUTS if name not in OTHERS), "unicycle wave")

each_following = pytest.mark.parametrize("name", FOLLOWING)
# That is in test_grip.py
each_mode = pytest.mark.parametrize("mode", [mode for mode in ON_LIMIT if mode != "grip"])
each_scalar = pytest.mark.parametrize("scalar", list(SCALARS))


@cache
def law(name: str):
    """A law of the LABMATE, or path following of a unicycle that is pushed (N) and turned (N m)."""
    return wave_law(reduce(unicycle())) if name == "unicycle wave" else law_of(find_robot("labmate"), name)


@cache
def situations(name: str) -> list[tuple]:
    """Numbers of a law, state, reference, tau without limits, and limits: some are met, some are not,
    some are none."""
    source = np.random.default_rng(4)
    found = []
    for plant in random_plants(law(name), 300, seed=5):
        for point in plant.points:
            tau = point.truth.values["tau"]
            limits = np.abs(tau) * source.choice([0.2, 0.7, 0.95, 1.3, 4.0], 2) + source.choice(
                [0.0, 1.0, 10.0]
            )
            limits = np.where(source.random(2) < 0.1, source.choice([0.0, math.inf], 2), limits)
            found.append(
                ((plant.params, plant.config, plant.gains), point.state, point.reference, tau, tuple(limits))
            )
    return found


@cache
def limited(backend: str, name: str, mode: str) -> list[tuple]:
    """Situation, status and tau of a backend in every situation."""
    found = []
    for situation in situations(name):
        numbers, state, reference, _, limits = situation
        controller = make_controller(backend, law(name), *numbers, Limits(limits, mode))
        found.append((*situation, *controller.step(state, reference)))
    return found


def bounds(limits: tuple[float, ...]) -> np.ndarray:
    return np.array([limit or math.inf for limit in limits])


@cache
def tau_of_v(name: str) -> ca.Function:
    """(params, config, state, demand) to tau."""
    groups = [symbols(law(name).groups[group]) for group in ("params", "config", "state", "virtual_input")]
    return ca.Function("tau", groups, [law(name).tau_of_v])


def slope_of(name: str, numbers, state) -> np.ndarray:
    """Derivative of tau, which is affine in what is wanted of the speed, by differences."""
    none, one = (np.asarray(tau_of_v(name)(*numbers[:2], state, [0, v])).ravel() for v in (0, 1))
    return one - none


@cache
def motion(name: str) -> ca.Function:
    """(params, config, gains, state, reference, tau) to the distance's second derivative, from (8) with its
    constraint forces, to what the outer loop wants it to be, and to the rate of the speed."""
    made, system = law(name), law(name).system
    mechanism, q, qdot = system.mechanism, system.mechanism.q, system.S @ system.nu
    tau = ca.SX.sym("tau", len(mechanism.inputs))
    along = lambda matrix: ca.reshape(ca.jacobian(ca.vec(matrix), q) @ qdot, matrix.shape)  # noqa: E731
    A = ca.densify(mechanism.A)
    system_of_all = ca.blockcat([[mechanism.M, A.T], [A, ca.SX.zeros(A.shape[0], A.shape[0])]])
    qddot = ca.solve(system_of_all, ca.vertcat(mechanism.E @ tau - system.V, -along(A) @ qdot))[: q.numel()]
    distance, speed = (row.expression for row in made.output.rows)
    slope = ca.jacobian(distance, q)
    y, y_rate, y_acceleration = (symbol.symbol for symbol in made.reference[:3])
    kp, kd = (gain.symbol for gain in made.gains[:2])
    wanted = y_acceleration + kd * (y_rate - slope @ qdot) + kp * (y - distance)
    nu_rate = ca.solve(ca.SX(system.S.T @ system.S), system.S.T @ (qddot - along(system.S) @ system.nu))
    speed_rate = ca.jacobian(speed, q) @ qdot + ca.jacobian(speed, system.nu) @ nu_rate
    groups = [
        symbols(group) for group in (made.parameters, made.config, made.gains, made.state, made.reference)
    ]
    return ca.Function("motion", [*groups, tau], [slope @ qddot + along(slope) @ qdot, wanted, speed_rate])


# -- what is answered ----------------------------------------------------------------------------------------


@each_mode
@pytest.mark.parametrize("name", [*FOLLOWING, *OTHERS])
def test_c_is_casadi(name, mode):
    if mode == "slow" and name in OTHERS:
        pytest.skip("no speed to give up")
    found = set()
    for ours, truth in zip(limited("c", name, mode), limited("casadi", name, mode), strict=True):
        *_, free, limits, status, tau = ours
        assert status == truth[-2]
        assert np.abs(tau - truth[-1]).max() <= 1e-11 * max(1, np.abs(free).max()), limits
        found.add(status)
    assert found == {"ok", "saturated"}


@pytest.mark.parametrize("backend", BACKENDS)
@each_mode
@each_following
def test_limits_hold(name, mode, backend):
    kind = np.float32 if backend == "cf" else np.float64
    for *_, limits, status, tau in limited(backend, name, mode):
        assert status in ("ok", "saturated")
        assert np.all(np.isfinite(tau)) and np.all(np.abs(tau) <= bounds(limits).astype(kind).astype(float))


@pytest.mark.parametrize("backend", BACKENDS)
@each_mode
@each_following
def test_within_limits_nothing_changes(name, mode, backend):
    """The bits are those of the law without limits; a limit just met is one that holds."""
    for numbers, state, reference, _, limits in situations(name)[:60]:
        _, free = make_controller(backend, law(name), *numbers).step(state, reference)
        for least in (tuple(np.abs(free)), (math.inf, 0.0), tuple(np.abs(free) + bounds(limits))):
            controller = make_controller(backend, law(name), *numbers, Limits(least, mode))
            status, tau = controller.step(state, reference)
            assert status == "ok" and tau.tobytes() == free.tobytes()
            assert controller.evaluate(state, reference).status == "ok"


@each_following
def test_evaluation_has_no_limits(name):
    for backend in BACKENDS:
        for numbers, state, reference, free, _ in situations(name)[:20]:
            limits = Limits(tuple(np.abs(free) / 2), "slow")
            evaluation = make_controller(backend, law(name), *numbers, limits).evaluate(state, reference)
            without = make_controller(backend, law(name), *numbers).evaluate(state, reference)
            assert evaluation.status == "ok" and np.array_equal(
                evaluation.values["tau"], without.values["tau"]
            )


def least_overload(tau: np.ndarray, slope: np.ndarray, limits: np.ndarray) -> float:
    """The least F >= 1 such that |tau + c slope| <= F limits for some c, by linear programming."""
    held = np.isfinite(limits)
    x, y, one = tau[held] / limits[held], slope[held] / limits[held], np.ones(held.sum())
    rows, right = (
        np.vstack([np.column_stack([y, -one]), np.column_stack([-y, -one])]),
        np.concatenate([-x, x]),
    )
    return linprog([0, 1], rows, right, bounds=[(None, None), (1, None)]).x[1]


def test_overload_without_a_change_to_make():
    assert abs(least_overload(np.array([3.0, 8.0]), np.zeros(2), np.array([2.0, 2.0])) - 4) < 1e-9


@each_following
def test_slow_keeps_the_path(name):
    """The distance gets the second derivative that is wanted of it if any speed can be given up for that, and
    the speed given up is then as little as can be; else the inputs keep the ratio of the change that
    overloads them least."""
    kept = scaled = gone_with_cut = 0
    cuts = limited("c", name, "cut")
    for (numbers, state, reference, free, limits, status, tau), (*_, cut) in zip(
        limited("c", name, "slow"), cuts, strict=True
    ):
        if status == "ok":
            continue
        bound, slope = bounds(limits), slope_of(name, numbers, state)
        overload = least_overload(free, slope, bound)
        size = max(1, np.abs(free).max())
        c = (overload * tau - free) @ slope / (slope @ slope)
        if overload > 1 + 1e-6:
            scaled += 1
            assert np.abs(free + c * slope - overload * tau).max() <= 1e-6 * size
            assert abs(np.max(np.abs(tau) / bound) - 1) <= 1e-12
            continue
        if overload > 1 + 1e-9:
            continue
        kept += 1
        slow, unlimited, with_cut = (
            motion(name)(*numbers, state, reference, answer) for answer in (tau, free, cut)
        )
        acceleration, wanted, speed_rate = map(float, slow)
        assert abs(acceleration - wanted) <= 1e-9 * max(1, abs(wanted))
        given_up = speed_rate - float(unlimited[2])
        assert abs(given_up - c) <= 1e-9 * max(1, abs(speed_rate), abs(given_up))
        assert np.any(np.abs(free + 0.999 * c * slope) > bound)
        gone_with_cut += abs(float(with_cut[0]) - wanted) > 1e-3
    assert kept > 50 and scaled > 10 and gone_with_cut > 0.9 * kept, (kept, scaled, gone_with_cut)


def test_slow_follows_a_circle():
    """On a circle, from 0.5 m/s to a speed for which the outer wheel has not the torque."""
    made, radius, speed, steps, h = law("type_iv_circle"), 2.0, 0.5, 1500, 2e-3
    system, torque, params = made.system, ca.SX.sym("tau", 2), [q.default for q in made.parameters]
    numbers = params, (0.0, 0.0, 0.0, radius), (4.0, 5.0, 2.0)
    b, d, r = (next(q.default for q in made.parameters if q.name == name) for name in "bdr")
    axle = math.sqrt(radius**2 - d**2)  # radius of its circle
    wheels = [speed * (1 + side * b / axle) / r for side in (1, -1)]
    start = np.array([radius, 0, math.atan2(axle, d), 0, 0, *wheels])
    rate = ca.vertcat(system.S @ system.nu, system.acceleration(torque))
    rate = ca.Function("rate", [symbols(made.state), torque, symbols(made.parameters)], [rate])

    def furthest(mode: str) -> tuple[float, float]:
        """Largest |distance| on the way, and the speed in the end."""
        controller = make_controller("c", made, *numbers, Limits((8.0, 8.0), mode))
        flow = lambda x: np.asarray(  # noqa: E731
            rate(x, controller.step(x, [0, 0, 0, 3.0, 0])[1], params)
        ).ravel()
        x, worst = start, 0.0
        for _ in range(steps):
            k1 = flow(x)
            k2 = flow(x + h / 2 * k1)
            k3 = flow(x + h / 2 * k2)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + flow(x + h * k3))
            worst = max(worst, abs(math.hypot(x[0], x[1]) - radius))
        return worst, r * (x[5] + x[6]) / 2

    (slow, speed), (cut, _) = furthest("slow"), furthest("cut")
    assert slow < 1e-9 and speed > 2.9 and cut > 0.02


# -- the function by itself ----------------------------------------------------------------------------------


@each_scalar
@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_values_are_written_and_nothing_beside_them(scalar, count):
    made = runtime("noslip_odometry.h")
    given, place = made.array(scalar, range(1, 7)), made.array(scalar, [9.0] * 6)
    for name, written in (("noslip_write", list(given)), ("noslip_write_zeros", [0.0] * 6)):
        made.function(name, scalar)(*([given] if name == "noslip_write" else []), place, count)
        assert list(place) == written[:count] + [9.0] * (6 - count)


@cache
def slow_in_c(scalar: str):
    """noslip_slow, then noslip_apply_limits: (inputs, slope, limits) to statuses of both,
    inputs after each."""
    suffix = SCALARS[scalar].suffix
    declared = f"int slow({scalar} *inputs, {scalar} *slope, const {scalar} *limits, int count)"
    answer = f"int answer(int status, const {scalar} *limits, {scalar} *held, {scalar} *inputs, int count)"
    text = f'#include "noslip_controller.h"\n{declared}; {answer};\n'
    text += f"{declared} {{ return noslip_slow{suffix}(inputs, slope, limits, count); }}\n"
    text += (
        f"{answer} {{ return noslip_apply_limits{suffix}(status, NOSLIP_ZERO, limits, held, inputs, "
        "inputs, count); }\n"
    )
    ffi = cffi.FFI()
    ffi.cdef(f"{declared}; {answer};")
    library = ffi.dlopen(str(shared_library({"slow.c": text})))
    largest = float(np.finfo(np.float32 if suffix else np.float64).max)

    def call(inputs, slope, limits, after=()) -> tuple[int, list[float], int, list[float]]:
        """`after`: what comes after the inputs in memory."""
        count = len(inputs)
        bound = ffi.new(f"{scalar}[]", [limit if 0 < limit < math.inf else largest for limit in limits])
        values, held = ffi.new(f"{scalar}[]", [*inputs, *after]), ffi.new(f"{scalar}[]", count)
        first = library.slow(values, ffi.new(f"{scalar}[]", list(slope)), bound, count)
        between = list(values)
        return first, between, library.answer(first, bound, held, values, count), list(values)

    return call


@each_scalar
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_slow_by_itself(scalar, count):
    """Random inputs, slopes with zeros among them, and limits: as the independent search says."""
    source, tolerance = np.random.default_rng(count), 5e-4 if scalar == "float" else 2e-11
    saturated = 0
    for _ in range(2000):
        tau = np.round(source.normal(0, 10, count), 3)
        slope = np.round(source.normal(0, 1, count), 2) * source.choice([0, 1, 1e-7, 1, 1, 1], count)
        limits = bounds(source.choice([0.0, 1.0, 4.0, 7.5, 20.0], count))
        first, between, status, answer = slow_in_c(scalar)(tau, slope, limits)
        beyond = bool(np.any(np.abs(tau) > limits))
        saturated += beyond
        assert first == status == beyond
        if not beyond:
            assert answer == between == slow_in_c(scalar)(tau, np.zeros(count), limits)[3]
            continue
        size = max(1, np.abs(tau).max() * np.abs(between).max())
        assert np.abs(slowed(tau, slope, limits) - between).max() <= tolerance * size, (tau, slope, limits)
        assert np.abs(np.subtract(answer, between)).max() <= tolerance * size
        assert np.all(np.abs(answer) <= limits)
    assert saturated > 500


@each_scalar
def test_slow_where_nothing_helps(scalar):
    """All inputs are scaled alike; a slope that is rounding beside the other's counts as none."""
    for slope in ((0, 0), (1, 1e-6), (-1e3, 1e-3)):
        assert slow_in_c(scalar)((3, 12), slope, (0, 4))[2:] == (1, [1, 4])
    assert slow_in_c(scalar)((-3, 12), (0, 0), (1, 4))[2:] == (1, [-1, 4])
    assert slow_in_c(scalar)((-3, 8), (0, 0), (1, 4))[3] == pytest.approx([-1, 8 / 3])
    # Small, but as steep as any
    assert slow_in_c(scalar)((3, 12), (1e-7, -1e-7), (0, 4))[3] == pytest.approx([11, 4])


@each_scalar
def test_slow_with_numbers_of_any_size(scalar):
    """NaN, infinities, subnormal and huge numbers: no NaN with a good status, and the limits hold."""
    kind = np.float32 if scalar == "float" else np.float64
    info = np.finfo(kind)
    special = [
        float(x)
        for x in (info.max, info.tiny, info.smallest_subnormal, np.sqrt(info.max), np.sqrt(info.tiny))
    ]
    values = [0.0, 1.0, math.nan, math.inf, *special, *(-x for x in special)]
    source = np.random.default_rng(9)
    good = 0
    for _ in range(20_000):
        tau, slope = (kind(source.choice(values, 3)) for _ in range(2))
        limits = np.abs(kind(source.choice([0.0, 1.0, *special], 3)))
        _, _, status, answer = slow_in_c(scalar)(tau.tolist(), slope.tolist(), limits.tolist())
        assert np.all(np.isfinite(answer)) and np.all(np.abs(answer) <= bounds(limits.tolist()))
        assert (status < 0) or np.all(np.isfinite(tau))
        good += status >= 0
    assert good > 1000


@each_scalar
def test_finite_inputs_of_any_size_pass(scalar):
    """Also where their sum overflows; what comes after them in memory is none of them."""
    largest = float(np.finfo(np.float32 if scalar == "float" else np.float64).max)
    inputs = [largest, largest]
    for after in (math.inf, math.nan, 1.0):
        assert slow_in_c(scalar)(inputs, (0, 0), (0, 0), (after,))[2:] == (
            0,
            [*inputs, pytest.approx(after, nan_ok=True)],
        )
    assert slow_in_c(scalar)((largest, math.inf), (0, 0), (0, 0))[2:] == (-2, [0, 0])


# -- what is refused -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        (Limits((10.0,)), "torque has 1 numbers; it must have 2: tau_r, tau_l"),
        (Limits((1.0, 2.0, 3.0)), "torque has 3 numbers"),
        (Limits((10.0, math.nan)), "torque of tau_l is nan"),
        (Limits((-1.0, 10.0)), "torque of tau_r is -1.0; give a positive number of N m, or 0 for no limit"),
        (Limits((1.0, -math.inf), "slow"), "torque of tau_l is -inf"),
        (Limits((1.0, 1.0), "brake"), "unknown mode 'brake'; known are cut, slow, grip"),
    ],
)
@pytest.mark.parametrize("backend", BACKENDS)
def test_bad_limits(backend, limits, says):
    made = law("type_iv_line")
    numbers = [[1.0] * len(group) for group in (made.parameters, made.config, made.gains)]
    with pytest.raises(BadInput, match=f"^limits: {says}"):
        make_controller(backend, made, *numbers, limits)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", OTHERS)
def test_no_speed_to_give_up(name, backend):
    made = law(name)
    assert made.speed_row is None and made.slope.shape == (0, 1)
    numbers = [[1.0] * len(group) for group in (made.parameters, made.config, made.gains)]
    with pytest.raises(
        BadInput, match=f'^limits: {name} has no speed to reduce.*; use Type IV, or mode "cut"$'
    ):
        make_controller(backend, made, *numbers, Limits((1.0, 1.0), "slow"))


# -- what it costs -------------------------------------------------------------------------------------------


@cache
def programs(name: str) -> tuple[Program, Program]:
    """A law, and one that knows nothing of slowing."""
    others = [entry for entry in program_module.ENTRIES if Result.SLOPE not in entry.answers]
    with patch.object(program_module, "ENTRIES", others):
        without = compile_law(law(name))
    return law_program(law(name)), without


@each_scalar
@each_following
def test_the_step_costs_no_more(name, scalar):
    """Where no limit is exceeded the C that runs is that of a law that knows nothing of slowing."""
    with_slow, without = (law_text(program, SCALARS[scalar]).source() for program in programs(name))
    assert "slow" in with_slow.lower() and "slow" not in without.lower()

    def step(source: str) -> tuple[str, str]:
        mathematics = source[source.index("_step" + SCALARS[scalar].suffix + "_law(") :]
        return mathematics[: mathematics.index("\n}\n")], source[source.rindex("\nint ") :]

    assert step(with_slow) == step(without)
    assert "slope" not in "".join(step(with_slow)) and "on_limit" not in "".join(step(with_slow))
