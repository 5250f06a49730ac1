"""Dead reckoning, its corrections, encoders and the reversing check: the C against closed forms,
the reference, the plant."""

import cmath
import math
from fractions import Fraction
from itertools import product

import mpmath
import numpy as np
import pytest
from casadi import cos, sin
from noslip.model import Mechanism
from noslip.model.reduction import reduce
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, system_of
from noslip.simulation.controllers.odometry import CompiledOdometry, Odometry, make_odometry, vehicle_wheels
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.plant import Plant
from noslip.tests.codegen_tools import unicycle
from scipy.integrate import solve_ivp

FORWARD, TURN, AHEAD = (0.075, 0.075), (0.1, -0.1), 0.3  # the LABMATE's: r/2, r/(2b), d
WHEELS = (FORWARD, TURN, AHEAD)
HEADERS = ("noslip_odometry.h", "noslip_reversing.h")
RANGE = {"double": 1048576.0, "float": 8192.0}  # rad, of sine and cosine
BACKENDS = ("casadi", "c", "cf")
# Ten times what rounding makes in a few hundred steps and some 10 m
TOLERANCE = {"casadi": 1e-12, "c": 1e-12, "cf": 3e-5}
NAN, INF = math.nan, math.inf

each_backend = pytest.mark.parametrize("backend", BACKENDS)
each_scalar = pytest.mark.parametrize("scalar", ["double", "float"])


def angles(way: float, turn: float) -> np.ndarray:
    """What the wheels turn for a way (m) and a turn (rad)."""
    return np.linalg.solve([FORWARD, TURN], [way, turn])


def short(angle: float) -> float:
    """The same direction within half a turn."""
    return math.remainder(angle, 2 * math.pi)


def used(ffi, struct) -> None:
    """Fills a struct with what memory may hold before init: NaN in every number."""
    ffi.buffer(struct)[:] = b"\xff" * ffi.sizeof(struct[0])


class C:
    """Dead reckoning by the C itself: statuses are answered, poses too."""

    def __init__(self, scalar: str, start=None, release: float = 0.0, wheels=WHEELS):
        self.scalar, self.runtime = scalar, runtime(HEADERS[0])
        self.null = self.runtime.ffi.NULL
        self.self, self.told = self.new("noslip_odometry"), self.new("noslip_pose", (7.0, 7.0, 7.0))
        forward, turn, ahead = wheels
        self.options = self.new("noslip_odometry_options", (forward, turn, ahead, release))
        used(self.runtime.ffi, self.self)
        self.status = self.call(
            "init", self.self, self.options, self.null if start is None else self.pose(start)
        )

    def new(self, kind: str, *initial):
        return self.runtime.new(kind, self.scalar, *initial)

    def pose(self, values):
        return self.new("noslip_pose", tuple(map(float, values)))

    def array(self, values):
        return self.runtime.array(self.scalar, values)

    def call(self, name: str, *arguments) -> str:
        return self.runtime.status(self.runtime.function(f"noslip_odometry_{name}", self.scalar)(*arguments))

    def move(self, angle, dt: float = 0.01, name: str = "move") -> tuple[str, list[float]]:
        status = self.call(name, self.self, self.array(angle), dt, self.told)
        return status, self.answer()

    def correct(self, truth, mode: int) -> str:
        return self.call("correct", self.self, self.pose(truth), mode)

    def look(self) -> list[float]:
        assert self.call("pose", self.self, self.told) == "ok"
        return self.answer()

    def answer(self) -> list[float]:
        return [self.told.x, self.told.y, self.told.heading]


# -- sin(x) / x ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scalar", "bound"), [("double", 2.5e-16), ("float", 1.5e-7)])
def test_sinc(scalar, bound):
    random = np.random.default_rng(1)
    function, kind = (
        runtime(HEADERS[0]).function("noslip_sinc", scalar),
        {"double": np.float64, "float": np.float32}[scalar],
    )
    borders = np.outer([1e-4, 1e-3], 1 + random.uniform(-1e-6, 1e-6, 200)).ravel()
    x = np.concatenate(
        [10.0 ** random.uniform(-40, 3.9, 3000), math.pi * np.arange(1, 200) / 2, borders, [0.0]]
    ).astype(kind)
    value = np.array([function(float(v)) for v in x])
    with mpmath.workprec(120):
        truth = [mpmath.sinc(mpmath.mpf(float(v))) for v in x]
        assert max(abs(mpmath.mpf(v) - t) for v, t in zip(value, truth, strict=True)) < bound
    assert np.abs(value).max() <= 1 and function(0.0) == 1
    assert [function(float(-v)) for v in x] == value.tolist()


@pytest.mark.parametrize(("scalar", "bound"), [("double", 1.3e-16), ("float", 7e-8)])
def test_half_tanc(scalar, bound):
    function, kind = (
        runtime(HEADERS[0]).function("noslip_half_tanc", scalar),
        {"double": np.float64, "float": np.float32}[scalar],
    )
    x = np.concatenate([np.random.default_rng(1).uniform(-0.25, 0.25, 3000), [1e-30, 0.25, -0.25]]).astype(
        kind
    )
    with mpmath.workprec(120):
        truth = [mpmath.tan(mpmath.mpf(float(v)) / 2) / mpmath.mpf(float(v)) for v in x]
        assert max(abs(function(float(v)) - t) for v, t in zip(x, truth, strict=True)) < bound
    assert function(0.0) == 0.5 and all(function(float(-v)) == function(float(v)) for v in x)


# -- closed forms --------------------------------------------------------------------------------------------


@each_backend
def test_straight_on(backend):
    odometry = make_odometry(backend, *WHEELS, start=(1.0, -2.0, 0.7))
    for _ in range(200):
        pose = odometry.move(angles(0.01, 0.0), 0.01)
    assert pose == pytest.approx([1 + 2 * math.cos(0.7), -2 + 2 * math.sin(0.7), 0.7], abs=TOLERANCE[backend])


@each_backend
def test_once_around_a_circle(backend):
    odometry = make_odometry(backend, *WHEELS, start=(3.0, 4.0, -1.0))
    for _ in range(100):
        pose = odometry.move(angles(2 * math.pi * 5 / 100, 2 * math.pi / 100), 0.01)
    assert pose == pytest.approx([3.0, 4.0, 2 * math.pi - 1], abs=TOLERANCE[backend])


@each_backend
def test_turning_on_the_spot(backend):
    """The axle's middle stays, the point goes around it."""
    odometry = make_odometry(backend, *WHEELS)
    for k in range(1, 51):
        x, y, heading = odometry.move(angles(0.0, -0.4), 0.01)
        assert heading == pytest.approx(-0.4 * k, abs=TOLERANCE[backend])
        assert (x, y) == pytest.approx(
            (AHEAD * math.cos(heading) - AHEAD, AHEAD * math.sin(heading)), abs=TOLERANCE[backend]
        )


@each_backend
@pytest.mark.parametrize("seed", range(3))
def test_one_long_arc_is_many_short_ones(backend, seed):
    """And both are where the point of the turning circle is: by rotation about its centre."""
    random = np.random.default_rng(seed)
    way, turn, heading = random.uniform(-5, 5), random.uniform(-6, 6), random.uniform(-3, 3)
    start = (*random.uniform(-5, 5, 2), heading)
    once, often = (make_odometry(backend, *WHEELS, start=start) for _ in range(2))
    pose = once.move(angles(way, turn), 1.0)
    for _ in range(300):
        last = often.move(angles(way, turn) / 300, 1 / 300)
    point, ahead = complex(*start[:2]), cmath.exp(1j * heading)
    centre = point - AHEAD * ahead + 1j * ahead * way / turn
    turned = centre + (point - centre) * cmath.exp(1j * turn)
    truth = [turned.real, turned.imag, heading + turn]
    assert pose == pytest.approx(truth, abs=TOLERANCE[backend])
    assert last == pytest.approx(truth, abs=TOLERANCE[backend])


def test_the_reference_is_the_integral():
    """Wheel rates that jump: the velocity of the axle's middle integrated numerically."""
    random = np.random.default_rng(5)
    odometry, z = (
        Odometry(*WHEELS, start=(1.0, 2.0, 0.5)),
        np.array([1 - 0.3 * math.cos(0.5), 2 - 0.3 * math.sin(0.5), 0.5]),
    )
    for _ in range(40):
        rate, dt = random.normal(0, 5, 2), random.uniform(0, 0.5)
        v, w = np.array([FORWARD, TURN]) @ rate
        unicycle = lambda t, z, v=v, w=w: (v * math.cos(z[2]), v * math.sin(z[2]), w)  # noqa: E731
        z = solve_ivp(unicycle, (0, dt), z, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        pose = odometry.move(rate * dt, dt)
        point = [z[0] + 0.3 * math.cos(z[2]), z[1] + 0.3 * math.sin(z[2]), z[2]]
        assert pose == pytest.approx(point, abs=1e-11)


@pytest.mark.parametrize(("scalar", "bound"), [("double", 1e-11), ("float", 1e-4)])
@pytest.mark.parametrize("seed", range(3))
def test_c_is_the_reference(scalar, bound, seed):
    """Random wheels, moves and corrections of both modes, 2000 steps."""
    random = np.random.default_rng(seed)
    wheels = (random.normal(0, 0.1, 2), random.normal(0, 0.1, 2), random.normal(0, 0.5))
    start, release = random.normal(0, 2, 3), random.uniform(0.1, 1.0)
    reference, compiled = Odometry(*wheels, release, start), CompiledOdometry(*wheels, release, start, scalar)
    for k in range(2000):
        angle, dt = random.normal(0, 0.2, 2), random.uniform(0, 0.02)
        if k % 53 == 17:
            truth, mode = (
                reference.pose + random.normal(0, 1, 3) * (1, 1, 3),
                "bumpless" if k % 3 else "reset",
            )
            assert compiled.correct(truth, mode) == pytest.approx(reference.correct(truth, mode), abs=bound)
        assert compiled.move(angle, dt) == pytest.approx(reference.move(angle, dt), abs=bound)


@pytest.mark.parametrize(("scalar", "bound"), [("double", 1e-13), ("float", 3e-5)])
def test_short_arcs_and_long_ones(scalar, bound):
    """Turns about the border of a quarter of a radian, where one formula takes over from the other,
    and far beyond it."""
    for size in (0.2499, 0.2501, 0.5, 3.0, 6.3):
        for way, turn in product((-2.0, 0.0, 3.0), (size, -size)):
            reference, compiled = (
                make(*WHEELS, 0.0, (1.0, 2.0, 0.5))
                for make in (Odometry, lambda *a: CompiledOdometry(*a, scalar))
            )
            for _ in range(3):
                assert compiled.move(angles(way, turn), 0.1) == pytest.approx(
                    reference.move(angles(way, turn), 0.1), abs=bound
                )


@each_scalar
def test_the_direction_is_that_of_the_pose(scalar):
    """After every kind of call, also while a correction is let in;
    of a heading in float it is good to the rounding of that."""
    random, made, pending = np.random.default_rng(4), C(scalar, (1.0, 2.0, 3.0), release=0.2), set()
    for k in range(400):
        made.move(random.normal(0, 3 if k % 9 == 0 else 0.3, 2), 0.01)
        if k % 60 == 50:
            made.correct(random.normal(0, 3, 3), k // 60 % 2)
        if k % 70 == 40:
            made.call("unwind", made.self)
        if k % 11 == 7:
            before = made.look()
            assert made.move(((NAN, 0.0), (INF, 0.0), (1e30, -1e30))[k % 3]) in (
                ("nonfinite", before),
                ("range", before),
            )
            pending.add((k % 3, made.self.left > 0))
        heading = made.look()[2]
        rounding = 4 * np.finfo(np.float32 if scalar == "float" else float).eps * (1 + abs(heading))
        assert [*made.self.direction] == pytest.approx([math.cos(heading), math.sin(heading)], abs=rounding)
    assert pending == set(product(range(3), (False, True)))


@each_scalar
def test_the_direction_where_a_correction_leaves_the_range(scalar):
    """The reckoned heading stays within the range, what is left of the correction takes the pose beyond it:
    refused."""
    made = C(scalar, (1.0, 2.0, RANGE[scalar] - 0.25), release=1.0)
    assert made.correct((1.0, 2.0, RANGE[scalar] - 2.25), 1) == "ok"
    before = made.look()
    assert made.move(angles(0.0, 1.0), 1e-3) == ("range", before) and made.look() == before
    wanted = [math.cos(before[2]), math.sin(before[2])]
    assert [*made.self.direction] == pytest.approx(wanted, abs=1e-6 if scalar == "float" else 1e-15)
    assert made.move(angles(0.0, -1.0), 1e-3)[0] == "ok"


@each_scalar
def test_a_move_in_no_time(scalar):
    """dt = 0 is a move like any other, of which nothing of a correction is let in."""
    slow, fast = C(scalar, release=0.5), C(scalar, release=0.5)
    assert fast.move(angles(0.5, 0.25), 0.0) == slow.move(angles(0.5, 0.25), 0.25)
    reset = C(scalar, (1.0, 1.0, 1.0))
    before = fast.look()
    assert fast.correct((1.0, 1.0, 1.0), 1) == "ok"
    for _ in range(3):
        told, bare = fast.move(angles(0.1, 0.0), 0.0)[1], reset.move(angles(0.1, 0.0), 0.0)[1]
        assert np.subtract(told, bare) == pytest.approx(
            np.subtract(before, 1.0), abs=2e-6 if scalar == "float" else 1e-14
        )
    assert fast.self.left == 0.5


@each_scalar
def test_long_arcs_go_by_the_heading_before_rounding(scalar):
    """At a large heading: what its sum has lost turns the chord,
    which is off by one rounding at that size and not by two."""
    kind, random, far = (
        {"double": np.float64, "float": np.float32}[scalar],
        np.random.default_rng(11),
        RANGE[scalar] / 2,
    )
    made, heading, worst = (
        C(scalar, (0.0, 0.0, far), wheels=((1.0, 0.0), (0.0, 1.0), 0.0)),
        mpmath.mpf(far),
        0.0,
    )
    for _ in range(300):
        way, turn, before = 4.0, float(kind(random.choice([-1, 1]) * random.uniform(0.3, 3.0))), made.look()
        assert made.move((way, turn))[0] == "ok"
        chord = way * mpmath.sinc(mpmath.mpf(turn) / 2) * mpmath.expj(heading + mpmath.mpf(turn) / 2)
        heading += turn
        worst = max(worst, abs(complex(*np.subtract(made.look(), before)[:2]) - complex(chord)) / way)
    ulp = float(np.spacing(kind(far)))
    # Half an ulp of the heading; its rest with the other sign gives up to 1.5 of them
    assert ulp / 4 < worst < 0.8 * ulp


@each_scalar
def test_rates_are_a_move(scalar):
    one, other = C(scalar), C(scalar)
    for rate in np.random.default_rng(2).normal(0, 4, (50, 2)).astype(np.float32):
        assert one.move(rate * np.float32(0.25), 0.25) == other.move(rate, 0.25, "rates")


@each_scalar
def test_options_of_a_differential_drive(scalar):
    made = C(scalar)
    function = runtime(HEADERS[0]).function("noslip_odometry_differential", scalar)
    assert function(made.options, 0.15, 0.75, -0.3) == 0
    found = [*made.options.forward, *made.options.turn, made.options.ahead, made.options.release]
    assert found == pytest.approx(
        [0.075, 0.075, 0.1, -0.1, -0.3, 0.0], rel=1e-6 if scalar == "float" else 1e-14
    )
    for bad in product((0.15, 0.0, -1.0, NAN, INF), (0.75, 0.0, -1.0, NAN, INF), (0.3, NAN, -INF)):
        if bad != (0.15, 0.75, 0.3):
            assert function(made.options, *bad) == -4
            assert [*made.options.forward, *made.options.turn, made.options.ahead] == [0.0] * 5
    assert function(made.null, 0.15, 0.75, 0.3) == -1


# -- drift ---------------------------------------------------------------------------------------------------

MILLION = 1_000_000


@pytest.mark.parametrize("rates", [(5.0, 5.0), (3.5, 3.0), (4.0, 3.97), (0.35, 0.3)])
def test_float_keeps_small_steps(rates):
    """A million steps of 1 ms, up to 750 m, against the arc in closed form.

    Found: 4e-6 to 6.5e-5 m (one ulp at 750 m) and 6e-6 rad; plain float sums of the same steps stray by 0.36
    to 3.4 m and up to 0.34 rad.
    """
    made = C("float", start=(0.0, 0.0, 0.3))
    runtime(HEADERS[0]).function("noslip_odometry_differential", "float")(made.options, 0.15, 0.75, 0.3)
    assert made.call("init", made.self, made.options, made.pose((0.0, 0.0, 0.3))) == "ok"
    angle, move = (
        made.array([rate * 1e-3 for rate in rates]),
        made.runtime.function("noslip_odometry_move", "float"),
    )
    for _ in range(MILLION):
        move(made.self, angle, 1e-3, made.told)
    way, turn = (
        sum(k * a for k, a in zip(row, angle, strict=True))
        for row in (made.options.forward, made.options.turn)
    )
    start, total = float(np.float32(0.3)), MILLION * turn
    mean = (cmath.exp(1j * total) - 1) / (1j * total) if turn else 1
    axle = -made.options.ahead * cmath.exp(1j * start) + MILLION * way * mean * cmath.exp(1j * start)
    point = axle + made.options.ahead * cmath.exp(1j * (start + total))
    x, y, heading = made.look()
    assert abs(complex(x, y) - point) < 1e-3
    assert abs(heading - start - total) < 1e-4
    assert _plain_float_sums(way, turn, start, axle, made.options.ahead) > 0.3


def _plain_float_sums(way: float, turn: float, start: float, axle: complex, ahead: float) -> float:
    """How far from `axle` the same steps end when float sums are not compensated, m."""
    single = np.float32
    heading = np.cumsum(np.append(single(start), np.full(MILLION, turn, single)), dtype=single)[:-1] + single(
        turn / 2
    )
    place = [np.cumsum(single(way) * f(heading), dtype=single)[-1] for f in (np.cos, np.sin)]
    return abs(complex(*map(float, place)) - ahead * cmath.exp(1j * start) - axle)


# -- corrections ---------------------------------------------------------------------------------------------


@each_backend
def test_a_reset_is_a_new_start(backend):
    truth = (7.0, -3.0, 20.0)
    corrected, fresh = make_odometry(backend, *WHEELS, 0.5), make_odometry(backend, *WHEELS, start=truth)
    corrected.move(angles(1.0, 0.3), 0.1)
    corrected.correct((0.0, 0.0, 0.0), "bumpless")  # what is pending is dropped
    assert corrected.correct(truth, "reset") == pytest.approx(truth, abs=1e-6 if backend == "cf" else 1e-15)
    for _ in range(5):
        assert corrected.move(angles(0.1, 0.1), 0.01).tolist() == fresh.move(angles(0.1, 0.1), 0.01).tolist()


@each_backend
def test_a_bumpless_correction_is_linear(backend):
    """The pose is that of a reset, and a part of the difference: 1 at the correction, 0 after `release`."""
    release, steps, tolerance = 0.5, 50, TOLERANCE[backend]
    bumpless, reset = (make_odometry(backend, *WHEELS, release, (1.0, 2.0, 0.5)) for _ in range(2))
    truth = np.array([1.2, 1.7, 0.9])
    before = bumpless.move(angles(0.0, 0.0), 0.01)
    assert bumpless.correct(truth, "bumpless") == pytest.approx(before, abs=tolerance)
    reset.correct(truth, "reset")
    for k in range(1, 71):
        after, wanted = (o.move(angles(0.02, 0.01), release / steps) for o in (bumpless, reset))
        assert after - wanted == pytest.approx((before - truth) * max(0.0, 1 - k / steps), abs=tolerance)
        if k > steps:
            assert after.tolist() == wanted.tolist()


@each_backend
def test_a_bumpless_correction_does_not_jump(backend):
    """Each step changes the pose by no more than the motion and a step's share of the difference."""
    random, release, dt = np.random.default_rng(3), 0.3, 0.01
    odometry = make_odometry(backend, *WHEELS, release)
    before, difference = np.zeros(3), np.zeros(3)
    for k in range(300):
        if k % 20 == 10:  # the one before is still being let in
            truth = before + random.normal(0, 0.3, 3)
            difference = np.abs(truth - before)
            assert odometry.correct(truth, "bumpless") == pytest.approx(before, abs=TOLERANCE[backend])
        way, turn = random.uniform(-0.02, 0.02), random.uniform(-0.02, 0.02)
        pose = odometry.move(angles(way, turn), dt)
        motion = np.array([abs(way) + AHEAD * abs(turn)] * 2 + [abs(turn)])
        assert np.all(np.abs(pose - before) <= motion + difference * dt / release + TOLERANCE[backend])
        before = pose


@each_backend
def test_a_correction_replaces_a_pending_one(backend):
    """Standing still: it goes from where it is, not from where it was, to the last truth."""
    odometry = make_odometry(backend, *WHEELS, 1.0)
    odometry.correct((4.0, 0.0, 0.0), "bumpless")
    tolerance = TOLERANCE[backend]
    assert odometry.move((0.0, 0.0), 0.25) == pytest.approx((1.0, 0.0, 0.0), abs=tolerance)
    odometry.correct((1.0, 8.0, 0.4), "bumpless")
    assert odometry.move((0.0, 0.0), 0.5) == pytest.approx((1.0, 4.0, 0.2), abs=tolerance)
    assert odometry.move((0.0, 0.0), 0.75) == pytest.approx((1.0, 8.0, 0.4), abs=tolerance)


@each_backend
@pytest.mark.parametrize("turns", [-3, 0, 2])
def test_heading_goes_the_shorter_way(backend, turns):
    odometry = make_odometry(backend, *WHEELS, 1.0, (0.0, 0.0, 3.0))
    odometry.correct((0.0, 0.0, -3.0 + 2 * math.pi * turns), "bumpless")
    headings = [odometry.move((0.0, 0.0), 0.1)[2] for _ in range(12)]
    assert headings[-1] == pytest.approx(2 * math.pi - 3.0, abs=TOLERANCE[backend])
    assert min(headings) > 3.0 and max(headings) < 2 * math.pi - 3.0 + TOLERANCE[backend]


@each_backend
def test_without_release_it_is_let_in_at_once(backend):
    odometry = make_odometry(backend, *WHEELS)
    odometry.move(angles(1.0, 4 * math.pi), 0.1)
    pose = odometry.correct((5.0, 6.0, 0.25), "bumpless")
    assert pose == pytest.approx((5.0, 6.0, 4 * math.pi + 0.25), abs=TOLERANCE[backend])


@each_scalar
def test_whole_turns_are_taken_off(scalar):
    """The heading stays modulo a turn, and the place, as well as a heading so large can be told."""
    far, tolerance = RANGE[scalar] - 100, {"double": 5e-10, "float": 2e-3}[scalar]  # two ulps
    wound = C(scalar, (1.0, 2.0, far), release=1.0)
    assert wound.move(angles(0.5, 0.5))[0] == "ok"
    before = wound.look()
    assert wound.call("unwind", wound.self) == "ok"
    pose = wound.look()
    assert abs(pose[2]) <= math.pi * (1 + 1e-6) and abs(short(pose[2] - before[2])) < tolerance
    assert pose[:2] == pytest.approx(before[:2], abs=AHEAD * tolerance)
    for turn in np.random.default_rng(9).uniform(-20, 20, 200):  # around and around, close to 0
        wound.move(angles(0.0, turn))
        wound.call("unwind", wound.self)
    assert abs(wound.look()[2]) <= math.pi * (1 + 1e-6)


def test_unwinding_loses_nothing():
    """500 turns in float, taken off as they come, to the last bits of a heading below half a turn."""
    made = C("float", wheels=(FORWARD, (0.125, -0.125), AHEAD))
    angle, steps = made.array((2**-4, -(2**-4))), 200_000  # 1/64 rad, exactly
    move, unwind = (made.runtime.function(f"noslip_odometry_{name}", "float") for name in ("move", "unwind"))
    for _ in range(steps):
        move(made.self, angle, 1e-3, made.told)
        unwind(made.self)
    assert abs(short(made.look()[2] - math.remainder(steps / 64, 2 * math.pi))) < 1e-5


# -- what is refused -----------------------------------------------------------------------------------------


@each_scalar
def test_a_heading_out_of_range(scalar):
    """The move is not made; unwound, it is."""
    made, fresh = C(scalar, (1.0, 2.0, RANGE[scalar] - 1)), C(scalar, (1.0, 2.0, RANGE[scalar] - 1))
    before = made.look()
    assert made.move(angles(1.0, 1.5)) == ("range", before) and made.look() == before
    assert made.call("unwind", made.self) == fresh.call("unwind", fresh.self) == "ok"
    assert made.move(angles(1.0, 1.5)) == fresh.move(angles(1.0, 1.5))
    assert made.move(angles(1.0, 3 * RANGE[scalar]))[0] == "range"
    for mode in (0, 1):
        assert made.correct((0.0, 0.0, 1.01 * RANGE[scalar]), mode) == "range"
    assert C(scalar, (0.0, 0.0, -1.01 * RANGE[scalar])).status == "range"


@each_scalar
@pytest.mark.parametrize("bad", [NAN, INF, -INF])
def test_what_is_not_finite_changes_nothing(scalar, bad):
    made = C(scalar, (1.0, 2.0, 0.5), 0.5)
    made.correct((1.5, 2.5, 0.4), 1)
    before = made.move((1.0, 0.5))[1]
    for name in ("move", "rates"):
        for angle in ((bad, 0.0), (0.0, bad), (bad, bad), (bad, -bad)):
            assert made.move(angle, name=name) == ("nonfinite", before)
        assert made.move((0.1, 0.1), bad, name) == ("nonfinite", before)
    for mode, k in product((0, 1), range(3)):
        truth = np.where(np.arange(3) == k, bad, 0.5)
        assert made.correct(truth, mode) == "nonfinite"
        assert C(scalar, truth).status == "nonfinite"
    assert made.look() == before


@each_scalar
def test_a_refused_move_keeps_the_direction(scalar):
    """Also where it is that of the heading before whole turns were taken off,
    and where the pose told is the odometry's own."""
    c = C(scalar, (1.0, 2.0, 5000.0))
    assert c.call("unwind", c.self) == "ok"
    kept, pose = list(c.self.direction), [c.self.pose.x, c.self.pose.y, c.self.pose.heading]
    own = c.runtime.ffi.addressof(c.self.pose)
    for angle, told in (
        (c.null, c.told),
        (c.array([math.nan, 0.0]), c.told),
        (c.array([math.inf, 0.0]), own),
        (c.null, own),
    ):
        assert c.call("move", c.self, angle, 0.01, told) in ("null", "nonfinite")
        assert list(c.self.direction) == kept and [told.x, told.y, told.heading] == pose


@each_scalar
def test_what_overflows_changes_nothing(scalar):
    large = float(np.finfo({"double": np.float64, "float": np.float32}[scalar]).max)
    made = C(scalar, (large, -large, 0.0), 1.0, ((1.0, 1.0), (1.0, -1.0), 0.3))
    before = made.look()
    assert made.status == "ok" and made.move((large, large)) == ("nonfinite", before)
    assert made.move((large / 4, large / 4)) == ("nonfinite", before)
    assert made.correct((-large, large, 0.0), 1) == "nonfinite" and made.look() == before
    assert C(scalar, (large, 0.0, math.pi), wheels=((1.0, 1.0), (1.0, -1.0), large)).status == "nonfinite"


@each_scalar
def test_refused_options_and_arguments(scalar):
    assert C(scalar).status == "ok"
    bad = [
        *(((value, 0.075), TURN, AHEAD) for value in (NAN, INF)),
        *((FORWARD, (0.1, value), AHEAD) for value in (NAN, -INF)),
        *((FORWARD, TURN, value) for value in (NAN, INF)),
        # Does not drive, or turn
        *((FORWARD, FORWARD, AHEAD), ((0.0, 0.0), TURN, AHEAD), ((0.0, 0.0), (0.0, 0.0), 0.0)),
    ]
    assert {C(scalar, wheels=wheels).status for wheels in bad} == {"bad_parameter"}
    assert {C(scalar, release=release).status for release in (NAN, INF, -0.1)} == {"bad_parameter"}
    made = C(scalar)
    assert made.move((0.1, 0.1), -0.01) == ("bad_parameter", made.look())
    assert [made.correct((0.0, 0.0, 0.0), mode) for mode in (-1, 2)] == ["bad_parameter"] * 2


@each_scalar
def test_null_and_not_ready(scalar):
    made = C(scalar, (1.0, 2.0, 3.0))
    null, self, pose, angle = made.null, made.self, made.told, made.array((0.1, 0.1))
    before = made.look()
    for name in ("move", "rates"):
        assert made.call(name, self, null, 0.1, pose) == "null" and made.answer() == before
        assert made.call(name, self, angle, 0.1, null) == "null"
        assert made.call(name, null, angle, 0.1, pose) == "null" and made.answer() == [0.0] * 3
    assert made.call("pose", null, pose) == made.call("pose", self, null) == "null"
    assert made.call("correct", null, pose, 0) == made.call("correct", self, null, 0) == "null"
    assert made.call("unwind", null) == made.call("init", null, made.options, null) == "null"
    assert made.look() == before
    assert made.call("init", self, null, null) == "null"  # and it is not ready any more
    for fresh in (self, made.new("noslip_odometry")):
        pose.x = 7.0
        assert made.call("move", fresh, angle, 0.1, pose) == "not_ready" and made.answer() == [0.0] * 3
        assert made.call("correct", fresh, pose, 0) == made.call("unwind", fresh) == "not_ready"


def test_what_python_is_told():
    with pytest.raises(BadInput, match="dead reckoning: noslip_odometry_init returns 'nonfinite'"):
        CompiledOdometry(*WHEELS, start=(NAN, 0.0, 0.0))
    for backend in BACKENDS:
        with pytest.raises(BadInput, match="unknown correction mode 'soft'"):
            make_odometry(backend, *WHEELS).correct((0.0, 0.0, 0.0), "soft")
    with pytest.raises(BadInput, match="unknown backend 'm4f'"):
        make_odometry("m4f", *WHEELS)


# -- encoders ------------------------------------------------------------------------------------------------


class Encoder:
    def __init__(self, scalar: str, counts: float, bits: int):
        self.runtime, self.scalar = runtime(HEADERS[0]), scalar
        self.self, self.angle = self.runtime.new("noslip_encoder", scalar), self.runtime.array(scalar, [7.0])
        used(self.runtime.ffi, self.self)
        self.status = self.call("init", self.self, counts, bits)

    def call(self, name: str, *arguments) -> str:
        return self.runtime.status(self.runtime.function(f"noslip_encoder_{name}", self.scalar)(*arguments))

    def read(self, counter: int) -> float:
        assert self.call("read", self.self, counter, self.angle) == "ok"
        return self.angle[0]


@each_scalar
@pytest.mark.parametrize("bits", [2, 8, 16, 31, 32])
@pytest.mark.parametrize("counts", [4096, -500])
def test_a_counter_that_wraps(scalar, bits, counts):
    """Steps of less than half its range, forward and back; half of it is a step back. The bits above the
    counter's are noise."""
    random, most = np.random.default_rng(bits), 2 ** (bits - 1) - 1
    encoder, total = Encoder(scalar, counts, bits), int(random.integers(2**bits))
    assert encoder.read(total) == 0
    # What rounding left out of the last angle is in the next
    eps, last = 2e-6 if scalar == "float" else 1e-14, 0.0
    for step in [*random.integers(-most, most + 1, 200).tolist(), most, -most, 0, -most - 1]:
        total += step
        noise = int(random.integers(2 ** (32 - bits))) << bits if bits < 32 else 0
        wanted = step * 2 * math.pi / counts
        assert encoder.read(total % 2**bits | noise) == pytest.approx(wanted, rel=eps, abs=eps * last)
        last = abs(wanted)


@each_scalar
@pytest.mark.parametrize("counts", [40000.0, -4096.3, 997.0])
def test_rounding_of_angles_does_not_add_up(scalar, counts):
    """The sum of a million counts' angles is that of the exact angle per count within one rounding of the
    last angle, at steps that always round to the same side too.
    """
    random, encoder, total, turned = np.random.default_rng(7), Encoder(scalar, counts, 16), 0, Fraction(0)
    encoder.read(0)
    exact = Fraction(encoder.self.angle)
    for step in [*[43] * 3000, *[-42, 43] * 1000, *random.integers(-2000, 2000, 3000).tolist()]:
        total += step
        angle = encoder.read(total % 2**16)
        turned += Fraction(angle)
        assert (
            abs(turned - total * exact)
            <= abs(Fraction(angle)) * Fraction(1, 2**23 if scalar == "float" else 2**51) + 1e-12
        )
    assert abs(encoder.self.carry) < 1e-6


@each_scalar
def test_refused_encoders(scalar):
    for counts, bits in ((0.0, 16), (0.5, 16), (NAN, 16), (INF, 16), (4096, 1), (4096, 33), (4096, -3)):
        assert Encoder(scalar, counts, bits).status == "bad_parameter"
    encoder, null = Encoder(scalar, 4096, 16), runtime(HEADERS[0]).ffi.NULL
    assert encoder.call("init", null, 4096, 16) == encoder.call("read", encoder.self, 5, null) == "null"
    encoder.angle[0] = 7.0
    assert encoder.call("read", null, 5, encoder.angle) == "null" and encoder.angle[0] == 0
    fresh = Encoder(scalar, 0.0, 16)
    assert fresh.call("read", fresh.self, 5, fresh.angle) == "not_ready" and fresh.angle[0] == 0


# -- reversing -----------------------------------------------------------------------------------------------

REFUSE, SWITCH, ALLOW = 0, 1, 2


@each_scalar
@pytest.mark.parametrize(
    ("mode", "speed", "lever", "which", "status", "then"),
    [
        (REFUSE, 1.0, (0.3, -0.3), 0, "ok", 0),
        (REFUSE, -1.0, (0.3, -0.3), 0, "unstable", 0),
        (REFUSE, -1.0, (0.3, -0.3), 1, "ok", 1),
        (REFUSE, 0.0, (0.3, -0.3), 1, "ok", 1),
        (REFUSE, 1e-30, (0.3, -1e-30), 1, "unstable", 1),  # their product is 0 in float
        (REFUSE, -1.0, (0.0, 0.3), 0, "ok", 0),  # singular, which the law itself says
        (SWITCH, 1.0, (0.3, -0.3), 0, "ok", 0),
        (SWITCH, -1.0, (0.3, -0.3), 0, "ok", 1),
        (SWITCH, 1.0, (0.3, -0.3), 1, "ok", 0),
        (SWITCH, 0.0, (0.3, -0.3), 1, "ok", 1),
        (SWITCH, -0.0, (0.3, -0.3), 0, "ok", 0),
        (SWITCH, -1.0, (0.3, 0.6), 0, "unstable", 0),
        (SWITCH, -1.0, (0.3, 0.0), 0, "unstable", 0),
        (ALLOW, -1.0, (0.3, -0.3), 0, "ok", 0),
        (ALLOW, 1.0, (-0.3, -0.3), 1, "ok", 1),
        (3, 1.0, (0.3, -0.3), 0, "bad_parameter", 0),
        (-1, 1.0, (0.3, -0.3), 0, "bad_parameter", 0),
        (REFUSE, 1.0, (0.3, -0.3), 2, "bad_parameter", 2),
        (SWITCH, 1.0, (0.3, -0.3), -1, "bad_parameter", -1),
        *((mode, NAN, (0.3, -0.3), 0, "nonfinite", 0) for mode in (REFUSE, SWITCH, ALLOW)),
        (SWITCH, 1.0, (0.3, NAN), 0, "nonfinite", 0),
        (SWITCH, 1.0, (INF, -0.3), 0, "nonfinite", 0),
    ],
)
def test_reversing(scalar, mode, speed, lever, which, status, then):
    made = runtime(HEADERS[1])
    law, levers = made.ffi.new("int *", which), made.array(scalar, lever)
    function = made.function("noslip_reversing", scalar)
    assert made.status(function(mode, speed, levers, law)) == status and law[0] == then
    assert function(mode, speed, made.ffi.NULL, law) == function(mode, speed, levers, made.ffi.NULL) == -1


# -- the robot it stands for ---------------------------------------------------------------------------------


def driven(seconds: float) -> tuple[Plant, object]:
    """The LABMATE under smooth torques; its motion as a function of time."""
    robot = find_robot("labmate")
    plant = Plant(system_of(robot), robot.parameter_values({}))
    start = np.array([0.5, -1.0, 0.4, 0.2, -0.3, 4.0, 3.0])

    def rate(t, x):
        return plant.rate(x, np.array([1.5 * math.sin(1.3 * t), -math.cos(0.9 * t)]))

    return plant, solve_ivp(
        rate, (0, seconds), start, "DOP853", dense_output=True, rtol=1e-13, atol=1e-13
    ).sol


@pytest.mark.parametrize("backend", ["casadi", "c"])
@pytest.mark.parametrize("period", [0.02, 0.005])
def test_it_finds_the_plant(backend, period):
    """From the wheels' angles alone: the heading to rounding; the place but for the change of the rates
    within a period h.

    With v + v' s and w + w' s about the middle of a period, true minus reckoned is i exp(i phi) (v' w - v w')
    h^3 / 12 and terms of h^5: some 1e-5 m in 10 s at 10 ms.
    """
    plant, motion = driven(10.0)
    forward, turn, ahead = vehicle_wheels(plant.system, plant.parameters)
    q = motion(np.arange(round(10 / period) + 1) * period)[:5].T
    odometry = make_odometry(backend, forward, turn, ahead, start=q[0, :3])
    poses = np.array([odometry.move(moved, period) for moved in np.diff(q[:, 3:], axis=0)])
    assert np.abs(poses[:, 2] - q[1:, 2]).max() < 1e-11

    middle = (np.arange(len(poses)) + 0.5) * period
    rates, before, after = (motion(middle + s)[5:] for s in (0.0, -1e-4, 1e-4))
    change = (after - before) / 2e-4
    slip = (forward @ change) * (turn @ rates) - (forward @ rates) * (turn @ change)
    error = np.cumsum(1j * np.exp(1j * motion(middle)[2]) * slip) * period**3 / 12
    found = (q[1:, :2] - poses[:, :2]) @ [1, 1j]
    assert np.abs(found - error).max() < 1e-3 * np.abs(error).max() + 1e-11
    assert np.abs(found).max() < 0.2 * period**2


@pytest.mark.parametrize("seed", range(3))
def test_wheels_of_the_labmate(seed):
    robot = find_robot("labmate")
    b, d, r = np.random.default_rng(seed).uniform(0.1, 1, 3)
    forward, turn, ahead = vehicle_wheels(system_of(robot), robot.parameter_values({"b": b, "d": -d, "r": r}))
    assert forward == pytest.approx([r / 2, r / 2], abs=1e-15)
    assert turn == pytest.approx([r / (2 * b), -r / (2 * b)], abs=1e-15)
    assert ahead == pytest.approx(-d, abs=1e-15)


def test_wheels_of_a_unicycle():
    """Whose quasi-velocities are forward speed and yaw rate themselves."""
    robot = unicycle()
    forward, turn, ahead = vehicle_wheels(reduce(robot), robot.parameter_values({}))
    assert (forward.tolist(), turn.tolist(), ahead) == ([1.0, 0.0], [0.0, 1.0], 0.0)


def skewed(rate_of_x: bool = False, place: bool = True) -> Mechanism:
    """Drives at an angle to its heading; where asked for, described by the rate of x, or without a place."""
    robot = Mechanism("skewed", "drives at an angle to its heading")
    x, y, a = robot.coordinate("x", "m"), robot.coordinate("y", "m"), robot.coordinate("a", "rad")
    way = (4 * cos(a) - 3 * sin(a), 3 * cos(a) + 4 * sin(a))
    robot.kinetic_energy((robot.rate(x) ** 2 + robot.rate(y) ** 2 + robot.rate(a) ** 2) / 2)
    robot.rolls("no side slip", way[0] * robot.rate(y) - way[1] * robot.rate(x))
    robot.input("push", "N", on=way[0] * robot.rate(x) + way[1] * robot.rate(y))
    robot.input("turn", "N m", on=robot.rate(a))
    robot.quasi_velocity(
        "v", "m/s", robot.rate(x) if rate_of_x else way[0] * robot.rate(x) + way[1] * robot.rate(y)
    )
    robot.quasi_velocity("w", "rad/s", robot.rate(a))
    if place:
        robot.moves_in_plane(x, y, a)
    return robot


def test_robots_that_cannot_be_reckoned_so():
    for robot, message in (
        (skewed(), "skewed: the vehicle's point moves sideways while it drives straight"),
        (
            skewed(rate_of_x=True),
            "skewed: forward speed and yaw rate are not fixed combinations of two quasi-velocities",
        ),
        (skewed(place=False), "skewed: .* moves_in_plane"),
        (
            unicycle("armed", arm=True),
            "armed: forward speed and yaw rate are not fixed combinations of two quasi-velocities",
        ),
    ):
        with pytest.raises(BadInput, match=message):
            vehicle_wheels(reduce(robot), robot.parameter_values({}))
