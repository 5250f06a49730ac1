"""Motors: the command for a torque, its limits, and the torque that is left at a speed."""

import math

import numpy as np
import pytest
from noslip.simulation.controllers.runtime import runtime

HEADER = "noslip_motor.h"
NAN, INF = math.nan, math.inf
TORQUE, CURRENT, VOLTAGE, DUTY = range(4)  # modes
SCALARS = {"double": 1e-11, "float": 1e-4}  # relative error
REFUSED = {
    "mode": (4, -1),
    "gear": (0.0, NAN, INF, 1e-320),
    "efficiency": (0.0, -0.5, 1.01, NAN),
    "back_efficiency": (0.0, -0.5, 1.01, NAN),
    "torque_constant": (0.0, -0.1, NAN, INF),
    "friction": (-0.1, NAN, INF),
    "dry_friction": (-0.1, NAN, INF),
    "moving": (0.0, -0.1, NAN, INF, 1e-320),
    "resistance": (0.0, -1.0, NAN, INF),
    "current": (0.0, -1.0, NAN, INF),
    "supply": (0.0, -1.0, NAN, INF),
}


def some_motor(random) -> dict:
    """Numbers of a motor, at random."""
    return {
        "mode": int(random.choice([CURRENT, VOLTAGE, DUTY])),
        "gear": random.choice([-1, 1]) * random.uniform(5, 50),
        "efficiency": random.uniform(0.5, 1),
        "back_efficiency": random.uniform(0.4, 1),
        "torque_constant": random.uniform(0.02, 0.2),
        "friction": random.uniform(0, 0.1),
        "dry_friction": random.uniform(0, 1.0),
        "moving": random.uniform(0.05, 0.5),
        "resistance": random.uniform(0.2, 3),
        "current": random.uniform(5, 30),
        "supply": random.uniform(12, 48),
    }


def motor_does(s: dict, command: float, rate: float) -> tuple[float, float, float]:
    """Torque (N m), current (A) and voltage (V) of a DC motor with a gear given `command` at a rate of a
    turning wheel."""
    emf = s["torque_constant"] * s["gear"] * rate
    volts = command * s["supply"] if s["mode"] == DUTY else command
    current = command if s["mode"] == CURRENT else (volts - emf) / s["resistance"]
    power = emf * current  # of the motor, mechanical
    loss = s["efficiency"] if power >= 0 else 1 / s["back_efficiency"]
    driven = s["torque_constant"] * s["gear"] * current * loss
    return (
        driven - s["friction"] * rate - s["dry_friction"] * np.sign(rate),
        current,
        current * s["resistance"] + emf,
    )


def reachable(s: dict, rate: float) -> list[float]:
    """The least and the largest torque (N m) at a rate with which the back EMF is less than the supply."""
    emf = s["torque_constant"] * s["gear"] * rate
    currents = [sign * min(s["current"], (s["supply"] - sign * emf) / s["resistance"]) for sign in (-1, 1)]
    return sorted(motor_does(s | {"mode": CURRENT}, current, rate)[0] for current in currents)


class Motor:
    """A motor of the C in one scalar; `status` is that of init."""

    def __init__(self, scalar: str, **settings):
        self.c, self.scalar = runtime(HEADER), scalar
        self.self = self.c.new("noslip_motor", scalar)
        self.c.ffi.buffer(self.self)[:] = b"\xff" * self.c.ffi.sizeof(self.self[0])
        self.status = self.call("init", self.c.new("noslip_motor_settings", scalar, settings))

    def call(self, name: str, *arguments) -> str:
        return self.c.status(self.c.function(f"noslip_motor_{name}", self.scalar)(self.self, *arguments))

    def number(self, name: str, *arguments) -> tuple[str, float]:
        """Status and result of a function with one result."""
        result = self.c.array(self.scalar, [NAN])
        return self.call(name, *arguments, result), result[0]


@pytest.mark.parametrize("scalar", SCALARS)
def test_the_wheel_has_the_torque_that_is_desired(scalar):
    """Or the nearest within current and supply: then one of them is at its limit. In all modes,
    driving and braking."""
    random, seen = np.random.default_rng(1), {"ok": 0, "saturated": 0}
    for _ in range(2000):
        settings = some_motor(random)
        motor = Motor(scalar, **settings)
        assert motor.status == "ok"
        free = settings["supply"] / abs(settings["torque_constant"] * settings["gear"])  # rad/s, without load
        desired, rate = random.uniform(-40, 40), random.choice([-1, 1]) * random.uniform(0.06, 0.9) * free
        rate = math.copysign(max(abs(rate), settings["moving"]), rate)
        status, command = motor.number("step", desired, rate)
        torque, current, voltage = motor_does(settings, command, rate)
        seen[status] += 1
        within = 1 + 10 * SCALARS[scalar]
        assert (
            abs(current) <= settings["current"] * within + SCALARS[scalar] * 10
            and abs(voltage) <= settings["supply"] * within
        )
        if status == "ok":
            assert abs(torque - desired) < 10 * SCALARS[scalar] * (1 + abs(desired))
        else:
            full = max(abs(current) / settings["current"], abs(voltage) / settings["supply"])
            assert full > 1 - 10 * SCALARS[scalar]
            assert torque == pytest.approx(
                np.clip(desired, *reachable(settings, rate)), rel=20 * SCALARS[scalar]
            )
    assert min(seen.values()) > 200


def test_commands_are_continuous_at_standstill():
    """Through zero rate the current is that of the formula,
    dry friction and back efficiency in proportion to the rate."""
    random = np.random.default_rng(2)
    for _ in range(200):
        settings = {**some_motor(random), "mode": CURRENT, "current": 1e4, "supply": 1e6}
        motor, torque = Motor("double", **settings), random.uniform(-5, 5)
        constant = settings["torque_constant"] * settings["gear"]
        for share in np.linspace(-1.5, 1.5, 31):
            rate = share * settings["moving"]
            part = min(1.0, max(-1.0, share))
            load = torque + settings["friction"] * rate + settings["dry_friction"] * part
            against = max(0.0, -part * np.sign(load))
            factor = (1 - against) / settings["efficiency"] + against * settings["back_efficiency"]
            assert motor.number("step", torque, rate) == (
                "ok",
                pytest.approx(load * factor / constant, rel=1e-11, abs=1e-12),
            )


@pytest.mark.parametrize("scalar", SCALARS)
def test_the_limit_is_what_current_and_supply_leave(scalar):
    """By bisection: the largest torque in the direction of motion that is not cut;
    not less than 1/20 of that at standstill."""
    random, floors = np.random.default_rng(3), 0
    for _ in range(120):
        settings = some_motor(random)
        motor = Motor(scalar, **settings)
        free = settings["supply"] / abs(settings["torque_constant"] * settings["gear"])

        def found(rate, motor=motor):
            low, high = 0.0, 1e4
            for _ in range(60):
                middle = (low + high) / 2
                cut = motor.number("step", math.copysign(middle, rate), rate)[0] == "saturated"
                low, high = (low, middle) if cut else (middle, high)
            return low

        standing = found(0.0)
        for rate in (0.0, *random.uniform(-1.3, 1.3, 4) * free):
            status, limit = motor.number("limit", rate)
            expected = max(found(rate), standing / 20)
            floors += expected == standing / 20
            assert status == "ok" and limit == pytest.approx(
                expected, rel=100 * SCALARS[scalar], abs=SCALARS[scalar]
            )
    assert 20 < floors < 300


def test_a_lower_supply_is_used_at_once():
    """As a motor that was initialized with it; the driver's own model has no supply."""
    settings = some_motor(np.random.default_rng(4))
    motor, low = Motor("double", **settings), Motor("double", **{**settings, "supply": 6.0})
    for bad in (0.0, -1.0, NAN, INF):
        assert motor.call("set_supply", bad) == "bad_parameter"
    assert motor.call("set_supply", 6.0) == "ok"
    assert bytes(motor.c.ffi.buffer(motor.self)) == bytes(low.c.ffi.buffer(low.self))
    driver = Motor("double", mode=TORQUE)
    before = bytes(driver.c.ffi.buffer(driver.self))
    assert driver.call("set_supply", 6.0) == "ok" and bytes(driver.c.ffi.buffer(driver.self)) == before


@pytest.mark.parametrize("scalar", SCALARS)
def test_a_driver_with_a_model_of_its_own_gets_the_torque(scalar):
    motor, kind = Motor(scalar, mode=TORQUE), np.float32 if scalar == "float" else float
    assert motor.status == "ok"
    for torque in (0.0, -3.5, 1e30):
        assert motor.number("step", torque, 7.0) == ("ok", kind(torque))
    assert motor.number("limit", 7.0) == ("ok", np.finfo(kind).max)


@pytest.mark.parametrize("scalar", SCALARS)
def test_misuse(scalar):
    good = some_motor(np.random.default_rng(5))
    for name, values in REFUSED.items():
        for value in values:
            motor = Motor(scalar, **{**good, name: value})
            assert motor.status == "bad_parameter", (name, value)
            assert motor.number("step", 1.0, 1.0) == ("not_ready", 0.0) == motor.number("limit", 1.0)
            assert motor.call("set_supply", 1.0) == "not_ready"
    for border in ({"efficiency": 1.0}, {"back_efficiency": 1.0}, {"friction": 0.0}, {"dry_friction": 0.0}):
        assert Motor(scalar, **{**good, **border}).status == "ok"
    motor, c = Motor(scalar, **good), runtime(HEADER)
    null, one = c.ffi.NULL, c.array(scalar, [7.0])
    step, limit = (c.function(f"noslip_motor_{name}", scalar) for name in ("step", "limit"))
    assert c.status(step(null, 1.0, 1.0, one)) == "null" and one[0] == 0.0
    assert motor.call("step", 1.0, 1.0, null) == motor.call("limit", 1.0, null) == "null"
    assert c.status(step(null, 1.0, 1.0, null)) == c.status(limit(null, 1.0, null)) == "null"
    one[0] = 7.0
    assert c.status(limit(null, 1.0, one)) == "null" and one[0] == 0.0
    assert c.status(c.function("noslip_motor_set_supply", scalar)(null, 1.0)) == "null"
    assert c.status(c.function("noslip_motor_init", scalar)(null, null)) == "null"
    assert motor.call("init", null) == "null" and motor.number("step", 1.0, 1.0) == ("not_ready", 0.0)


@pytest.mark.parametrize("scalar", SCALARS)
def test_commands_are_finite_and_within_the_limits(scalar):
    """Whatever the torque and the rate."""
    random = np.random.default_rng(6)
    hard = [0.0, 1.0, -1e38, 3e38, 1e-45, NAN, INF, -INF]
    for _ in range(20):
        settings = some_motor(random)
        motor = Motor(scalar, **settings)
        most = {CURRENT: settings["current"], VOLTAGE: settings["supply"], DUTY: 1.0}[settings["mode"]]
        for torque in hard:
            for rate in hard:
                status, command = motor.number("step", torque, rate)
                assert abs(command) <= most * (1 + 1e-6)
                assert status in ("ok", "saturated") or command == 0
                assert status not in ("ok", "saturated") or math.isfinite(torque + rate)
                status, limit = motor.number("limit", rate)
                assert math.isfinite(limit) and (
                    limit > 0 if math.isfinite(rate) else (status, limit) == ("nonfinite", 0.0)
                )
