"""Inputs that keep the wheels rolling: the generated C against a second implementation,
and against plain searches."""

import math
from copy import copy
from fractions import Fraction
from functools import cache, partial

import casadi as ca
import numpy as np
import pytest
from noslip.checks.verification.sampling import random_plants
from noslip.codegen.derivation.grip import is_wide
from noslip.codegen.printing.scalar import SCALARS
from noslip.codegen.program import ENTRIES
from noslip.model.law import symbols
from noslip.readers.errors import BadInput
from noslip.readers.robots import find_robot, law_of
from noslip.simulation.closed_loop import simulate
from noslip.simulation.contact import contact_forces
from noslip.simulation.controllers.backends import make_controller
from noslip.simulation.controllers.compiled import CompiledController
from noslip.simulation.controllers.controller import Friction, Limits
from noslip.simulation.controllers.grip import Cones, GripReference
from noslip.simulation.controllers.runtime import runtime
from noslip.simulation.controllers.symbolic import slope_function
from noslip.simulation.plant import Plant
from noslip.simulation.specification.spec import ContactSection, spec_of
from noslip.simulation.specification.vary import varied
from noslip.simulation.sweeping.batch import Batch
from scipy.optimize import minimize, minimize_scalar

LAWS = (("labmate", "type_iv_line"), ("labmate", "type_i"))
MORE_INPUTS = (("four_wheel", "type_iv_line"), ("mobile_manipulator", "end_point"))
OTHERS = (("car", "type_iv_line"), ("tractor_trailer:2", "type_iv_line"), *MORE_INPUTS)
STATES = 40

each_law = pytest.mark.parametrize("robot, name", [*LAWS, *OTHERS])


@cache
def law(robot: str, name: str):
    return law_of(find_robot(robot), name)


@cache
def situations(robot: str, name: str) -> list[tuple]:
    """Numbers of a law, state, reference, limits: friction from slippery to more than is needed,
    some limits of the inputs."""
    source, inputs = np.random.default_rng(14), len(law(robot, name).system.mechanism.inputs)
    found = []
    for plant in random_plants(law(robot, name), STATES, seed=6):
        for point in plant.points:
            height = float(source.choice([0.0, 0.1, 0.4])) if is_wide(law(robot, name).system) else 0.0
            mu = float(np.exp(source.uniform(math.log(1e-3), math.log(100.0))))
            friction = Friction(
                mu, float(source.choice([0.0, 0.05])), float(source.choice([1.0, 0.7])), height
            )
            tau = point.truth.values["tau"]
            torque = np.abs(tau) * source.choice([0.2, 0.9, 2.0], inputs) * source.choice([0.0, 0.0, 1.0])
            found.append(
                (
                    (plant.params, plant.config, plant.gains),
                    point.state,
                    point.reference,
                    tau,
                    friction,
                    torque,
                )
            )
    return found


def limited(backend: str, robot: str, name: str):
    """Situation, status and tau of a backend in every situation."""
    for situation in situations(robot, name):
        numbers, state, reference, _, friction, torque = situation
        controller = make_controller(
            backend, law(robot, name), *numbers, Limits(tuple(torque), "grip", friction)
        )
        yield (*situation, *controller.step(state, reference))


def cones_at(robot: str, name: str, numbers, state, friction) -> Cones:
    unlimited = np.full(len(law(robot, name).system.mechanism.inputs), np.inf)
    return GripReference(law(robot, name), numbers[0], friction, unlimited).cones(np.asarray(state))


def slope_of(robot: str, name: str, numbers, state, reference) -> np.ndarray:
    return np.asarray(slope_function(law(robot, name))(*numbers, state, reference)).ravel()


@each_law
def test_c_is_the_reference(robot, name):
    """Alike but for rounding, which is larger where an input is large beside the friction there is."""
    statuses = set()
    for ours, truth in zip(limited("c", robot, name), limited("casadi", robot, name), strict=True):
        numbers, state, _, free, friction, _, status, tau = ours
        assert np.abs(tau - truth[-1]).max() <= 1e-9 * max(1, np.abs(free).max()), (ours, truth)
        same = status == truth[-2]
        assert same or abs(cones_at(robot, name, numbers, state, friction).use(tau).max() - 1) < 1e-6, (
            ours,
            truth,
        )
        statuses.add(status)
    assert statuses == {"ok", "grip", "will_slip"}


@pytest.mark.parametrize("backend", ["c", "cf"])
@each_law
def test_it_rolls_or_says_so(robot, name, backend):
    """Friction use by the plant's own constraint forces; inputs within limits,
    and unchanged where nothing had to change."""
    slack = 1e-9 if backend == "c" else 2e-3
    for numbers, state, _, free, friction, torque, status, tau in limited(backend, robot, name):
        most = np.array([limit or math.inf for limit in torque])
        assert np.isfinite(tau).all() and (np.abs(tau) <= most * (1 + slack)).all()
        floor = ContactSection(
            mu=friction.mu * (1 - friction.margin), share=friction.share, height=friction.height
        )
        plant = Plant(law(robot, name).system, numbers[0])
        use = max(contact.use[0] for contact in contact_forces(plant, np.asarray(state), tau, floor))
        if status == "will_slip":
            continue
        assert use <= 1 + slack, (status, use, friction)
        if status == "ok":
            assert np.abs(tau - free).max() <= (1e-11 if backend == "c" else 2e-4) * max(
                1, np.abs(free).max()
            )


def test_the_forces_of_a_virtual_input():
    """`feedback` returns the inputs of v, `ground` their forces: those of lambda (8), and affine in v."""
    entries, random = {entry.name: entry for entry in ENTRIES}, np.random.default_rng(18)
    made = law("labmate", "type_iv_line")
    for numbers, state, *_ in situations("labmate", "type_iv_line")[:STATES]:
        controller, plant = CompiledController(made, *numbers), Plant(made.system, numbers[0])
        one, other = random.uniform(-3, 3, (2, 2))
        found = []
        for v in (one, other, (one + other) / 2):
            (tau,) = (
                answer.ravel()
                for answer in controller.entry(entries["feedback"], state, more=v).values.values()
            )
            (forces,) = controller.entry(entries["ground"], state, more=tau).values.values()
            found.append(forces.reshape(-1, 4))
            truth = contact_forces(plant, np.asarray(state), tau, ContactSection())
            forces = np.array([[contact.longitudinal[0], contact.lateral[0]] for contact in truth])
            assert np.abs(found[-1][:, :2] - forces).max() < 1e-9 * (1 + np.abs(forces).max())
        assert np.abs(found[0] + found[1] - 2 * found[2]).max() < 1e-9 * (1 + np.abs(found[0]).max())


@pytest.mark.parametrize("robot, name", [("labmate", "type_iv_line")])
def test_the_speed_is_given_up_first_and_no_more_than_needed(robot, name):
    """On the line of the speed's virtual input: the nearest to what was asked for,
    wherever a search finds any that rolls."""
    ways = {"speed": 0, "coasting": 0}
    for numbers, state, reference, free, friction, torque, status, tau in limited("c", robot, name):
        if status != "grip":
            continue
        slope, cones = (
            slope_of(robot, name, numbers, state, reference),
            cones_at(robot, name, numbers, state, friction),
        )
        most = np.array([limit or math.inf for limit in torque])

        def beyond(inputs, cones=cones, most=most):
            return max(
                cones.excess(inputs).max(),
                (np.abs(inputs) - most).max() if np.isfinite(most).any() else -np.inf,
            )

        s = slope @ (tau - free) / (slope @ slope)
        on_line = np.abs(free + s * slope - tau).max() <= 1e-9 * max(1, np.abs(free).max())
        if on_line and s:
            ways["speed"] += 1
            assert beyond(free + 0.9999 * s * slope) > 0, "more than needed"
        elif not on_line:
            ways["coasting"] += 1
            scale = np.abs(free).max() / np.abs(slope).max()
            best = minimize_scalar(
                lambda s, a=free, b=slope: beyond(a + s * b), bracket=(-scale, scale), options={"xtol": 1e-10}
            )
            assert best.fun > -1e-6 * max(1, np.abs(free).max()), "the speed would have been enough"
    assert min(ways.values()) > 2, ways


@pytest.mark.parametrize("robot, name", [("labmate", "type_i"), ("labmate", "type_iv_line")])
def test_coasting_is_least_squares(robot, name):
    """Where it will slip, the inputs are those of smallest sum (F / mass)^2, by a search; and a search finds
    none near them that roll with a tenth less friction use."""
    seen = 0
    for numbers, state, _, _, friction, torque, status, tau in limited("c", robot, name):
        if status != "will_slip" or torque.any():
            continue
        cones = cones_at(robot, name, numbers, state, friction)

        def cost(inputs, cones=cones):
            force = cones.force + np.tensordot(inputs, cones.force_by, 1)
            return np.sum((force / cones.mass[:, None]) ** 2)

        scale = max(1.0, np.abs(tau).max())
        found = minimize(lambda x, cost=cost, scale=scale: cost(scale * x), tau / scale + 0.1, tol=1e-14)
        assert cost(tau) <= found.fun * (1 + 1e-6) + 1e-12
        seen += 1
        if seen == 40:
            break
    assert seen > 1


def cut_by_reference(at, along) -> tuple[float, float, bool]:
    cones = Cones(at[None, :2], at[2:], along[None, None, :2], along[None, 2:], np.ones(1))
    low, high, found = cones.interval(0, np.zeros(1), np.ones(1))
    return low, high, bool(found)


def cut_by_c(scalar: str, at, along) -> tuple[float, float, bool]:
    made = runtime("noslip_grip.h")
    steps = made.new("noslip_steps", scalar)
    steps.low, steps.high, steps.any = -LARGEST, LARGEST, 1
    made.function("noslip_within_cone", scalar)(steps, made.array(scalar, at), made.array(scalar, along))
    return *(
        s if abs(s) < LARGEST / 2 else math.copysign(math.inf, s) for s in (steps.low, steps.high)
    ), bool(steps.any)


LARGEST = 3e38


@pytest.mark.parametrize(
    "cut",
    [cut_by_reference, partial(cut_by_c, "double"), partial(cut_by_c, "float")],
    ids=["numpy", "c", "cf"],
)
def test_a_cone_is_cut_by_a_line_where_it_is(cut):
    """|F + s D| <= N + s M against a fine grid of s, also where the load N + s M grows faster than the force;
    at all sizes."""
    source, kinds, near = np.random.default_rng(3), set(), 1e-3 if "float" in str(cut) else 1e-9
    for k in range(400):
        at, along = source.normal(size=3), source.normal(size=3) * (0.05 if k % 2 else 1.0)
        # Grow alike: one root
        along = along if k % 8 else np.array([0.75, 1.0, math.copysign(1.25, along[2])])
        along = along if k % 8 != 1 else np.zeros(3)  # every s, or none
        low, high, found = cut(at, along)
        grid = np.linspace(-30, 30, 301)
        room = at[2] + grid * along[2] - np.hypot(at[0] + grid * along[0], at[1] + grid * along[1])
        off = near * (1 + np.abs(grid))
        if not found:
            assert not (room > near).any()
        else:
            assert not (room > near)[(grid < low - off) | (grid > high + off)].any(), (at, along)
            assert (room > -near)[(grid > low + off) & (grid < high - off)].all(), (at, along)
        kinds.add((found, math.isfinite(low), math.isfinite(high)))
    assert len(kinds) >= 4


@pytest.mark.nightly
def test_inputs_that_do_not_move_it_are_used_first(robot="four_wheel", name="type_iv_line"):
    """Where such inputs alone are enough, the motion is as desired: S'E tau is. A search in the null space of
    S'E finds none that roll with a fifth less friction use where they are not."""
    system, effort = law(robot, name).system, None
    mechanism, kept, given_up, better = system.mechanism, 0, 0, 0
    effort = ca.Function("effort", [symbols(system.state), mechanism.p], [ca.densify(system.input_map)])
    for numbers, state, _, free, friction, torque, status, tau in limited("c", robot, name):
        if status == "ok" or torque.any():
            continue
        B = effort(state, numbers[0]).full()
        if np.abs(B @ (tau - free)).max() <= 1e-9 * (np.abs(B) @ np.abs(free)).max():
            assert status == "grip"
            kept += 1
            continue
        null, cones = np.linalg.svd(B)[2][2:], cones_at(robot, name, numbers, state, friction)
        scale = np.abs(free).max()

        def worst(z, cones=cones, free=free, null=null, scale=scale):
            return cones.excess(free + scale * z @ null).max() / (cones.most.max() or 1.0)

        least = minimize(worst, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-9})
        better += least.fun < -0.2
        given_up += 1
    assert kept > 2 and given_up > 2 and better == 0, (kept, given_up, better)


@pytest.mark.parametrize("scalar, accuracy", [("double", 1e-9), ("float", 1e-3)])
@pytest.mark.parametrize("inputs", [2, 3, 5])
def test_the_way_to_least_forces_is_a_stationary_point(inputs, scalar, accuracy):
    """Of the sum of (F / mass)^2 and 1e-4 of the mean effect times the squared coefficients; for inputs by
    themselves, for combinations, and for the forces by a way; if no input has an effect, nothing changes."""
    made, source = runtime("noslip_shaping.h"), np.random.default_rng(8)
    for k in range(120):
        mass, contacts = source.uniform(0.5, 20.0, 3), 3
        by = source.normal(size=(contacts, 3, inputs)) * 10.0 ** source.uniform(-3, 3) * mass[:, None, None]
        by *= 0.0 if k % 8 == 0 else 1.0
        ground, along = source.normal(size=(contacts, 4)) * mass[:, None], source.normal(size=inputs)
        ground[:, 3] = mass
        free = None if k % 2 else np.outer(source.normal(size=inputs), source.normal(size=inputs))
        asked = None if k % 3 else along
        NULL, array = made.ffi.NULL, partial(made.array, scalar)
        way, work = array(np.zeros(inputs)), array(np.append(np.zeros(inputs * (inputs + 2)), [7.0] * 2))
        combined = NULL if free is None else array(free.ravel())
        toward = NULL if asked is None else array(asked)
        function = made.function("noslip_way_to_least", scalar)
        function(array(ground.ravel()), toward, combined, array(by.ravel()), contacts, inputs, work, way)
        assert list(work)[-2:] == [7.0] * 2
        rows = np.eye(inputs) if free is None else free
        effect = (by[:, :2] / mass[:, None, None]).reshape(-1, inputs) @ rows.T
        force = (
            np.ravel(ground[:, :2] / mass[:, None])
            if asked is None
            else (by[:, :2] / mass[:, None, None]).reshape(-1, inputs) @ along
        )
        normal = effect.T @ effect + 1e-4 * np.trace(effect.T @ effect) / inputs * np.eye(inputs)
        truth = -rows.T @ np.linalg.solve(normal, effect.T @ force) if k % 8 else np.zeros(inputs)
        assert np.abs(np.array(list(way)) - truth).max() <= accuracy * (np.abs(truth).max() + (k % 8 == 0)), k


@pytest.mark.parametrize("scalar", ["double", "float"])
@pytest.mark.parametrize("robot, name", [LAWS[0], *MORE_INPUTS])
def test_any_bits_are_answered_within_the_limits(robot, name, scalar):
    """State, reference and friction of any bits: finite inputs within the limits, whatever the status."""
    source, seen = np.random.default_rng(21), set()
    kind, whole = (np.float64, np.uint64) if scalar == "double" else (np.float32, np.uint32)
    made = law(robot, name)
    (plant, *_) = random_plants(made, 1, seed=3)
    inputs = len(made.system.mechanism.inputs)
    for k in range(60):
        torque = tuple(10.0 ** source.uniform(-3, 3, inputs))
        friction = Friction(float(10.0 ** source.uniform(-30, 30)), 0.05)
        controller = CompiledController(
            made,
            plant.params,
            plant.config,
            plant.gains,
            scalar,
            Limits(torque, "grip", friction if k % 3 else Friction(0.3)),
        )
        for _ in range(20):
            both = [
                source.integers(0, np.iinfo(whole).max, size, whole, True).view(kind)
                for size in (len(made.state), len(made.reference))
            ]
            ordinary = [
                10.0 ** source.uniform(-6, 6, each.size) * source.choice([-1, 1], each.size) for each in both
            ]
            mixed = [
                np.where(source.random(a.size) < 0.1, a, b).astype(float)
                for a, b in zip(both, ordinary, strict=True)
            ]
            status, tau = controller.step(*mixed)
            assert np.isfinite(tau).all() and (np.abs(tau) <= np.array(torque) * (1 + 1e-6)).all(), (
                status,
                mixed,
            )
            seen.add(status)
    assert seen >= {"nonfinite", "grip", "will_slip"}, seen


@pytest.mark.parametrize("scalar, near", [("double", 1e-9), ("float", 1e-3)])
def test_steps_keep_every_contact_and_every_limit(scalar, near):
    """Of two to four inputs, some of which may stay as they are, and one or two contacts,
    against a fine grid of steps."""
    made, source, kinds = runtime("noslip_grip.h"), np.random.default_rng(5), set()
    grip = made.new("noslip_grip", scalar)
    grid = np.linspace(-20.0, 20.0, 401)
    for k in range(400):
        contacts, count = 1 + k % 2, 2 if k % 5 else 4
        inputs, way, limits = (
            source.normal(size=count),
            source.normal(size=count),
            source.uniform(0.2, 4.0, count),
        )
        way[k % 3 :] *= 0.0 if k % 3 else 1.0
        ground, by = (
            source.normal(size=(contacts, 4)),
            source.normal(size=(contacts, 3, count)) * [[[0.3], [0.3], [1.0]]],
        )
        ground[:, 3] = source.uniform(0.5, 3.0, contacts)
        grip.weight, grip.height = source.uniform(0.5, 3.0), source.uniform(0.0, 1.0)
        behind = np.append(way, np.inf)  # what comes after it in memory is none of it
        given = [
            made.array(scalar, np.ravel(each)) for each in (inputs, behind, ground, np.zeros(3 * contacts))
        ]
        made.function("noslip_write_loads", scalar)(given[2], grip, contacts)
        made.function("noslip_effects", scalar)(
            given[1], made.array(scalar, by.ravel()), grip.height, contacts, count, given[3]
        )
        steps = made.function("noslip_steps_within", scalar)(
            *given, made.array(scalar, limits), contacts, count
        )
        parts = ground[:, :3, None] + (by @ way)[..., None] * grid
        load = grip.weight * ground[:, 3, None] + grip.height * parts[:, 2]
        room = np.vstack(
            [
                load - np.hypot(parts[:, 0], parts[:, 1]),
                limits[:, None] - np.abs(inputs[:, None] + np.outer(way, grid)),
            ]
        )
        room, off = room.min(axis=0), near * (1 + np.abs(grid))
        if not steps.any or steps.low > steps.high:
            assert not (room > near).any(), k
        else:
            assert not (room > near)[(grid < steps.low - off) | (grid > steps.high + off)].any(), k
            assert (room > -near)[(grid > steps.low + off) & (grid < steps.high - off)].all(), k
        kinds.add((bool(steps.any), steps.low <= steps.high, k % 3))
    assert len(kinds) >= 6


@pytest.mark.parametrize("scalar, accuracy", [("double", 1e-9), ("float", 2e-2)])
def test_the_way_to_coasting_ends_at_least_forces(scalar, accuracy):
    """Of two contacts at all sizes: the gradient of sum (F / m)^2 is zero at its end,
    or along it if an input has no effect."""
    made, source = runtime("noslip_grip.h"), np.random.default_rng(8)
    for k in range(300):
        mass = source.uniform(0.5, 20.0, 2)
        by = source.normal(size=(2, 3, 2)) * 10.0 ** source.uniform(-3, 3) * mass[:, None, None]
        if k % 3 == 0:  # both inputs do the same
            by[..., 1] = by[..., 0] * source.uniform(-2, 2)
        elif k % 3 == 1:
            by[..., k % 2] = 0.0
        force = source.normal(size=(2, 4)) * mass[:, None]
        force[:, 3] = mass
        if k % 5 == 0:  # a contact that carries no mass has no load and does not count
            force[1, 3] = 0.0
            mass[1] = np.inf
        ground, by_inputs, way = (
            made.array(scalar, each) for each in (force.ravel(), by.ravel(), np.zeros(2))
        )
        made.function("noslip_way_to_coasting", scalar)(ground, by_inputs, 2, way)
        moved = np.array([way[0], way[1]])
        effect = (by[:, :2] / mass[:, None, None]).reshape(4, 2)
        start, end = (np.ravel(force[:, :2] / mass[:, None]) + effect @ (part * moved) for part in (0.0, 1.0))
        gradient, size = effect.T @ end, np.linalg.norm(effect) * np.linalg.norm(start)
        left = gradient if k % 3 == 2 else [gradient @ moved / (np.linalg.norm(moved) or 1.0)]
        assert np.abs(left).max() <= accuracy * size and np.linalg.norm(end) <= np.linalg.norm(start) * (
            1 + accuracy
        )


class Floor(GripReference):
    """The reference at given cones and combinations of inputs that do not change the motion;
    notes how many lines it cut."""

    def __init__(self, cones: Cones, limits: np.ndarray, free: np.ndarray | None):
        self._cones, self._limits, self.params, self.lines = cones, limits, np.zeros(0), 0
        self._effort = None if free is None else lambda *_: (free,)

    def cones(self, state: np.ndarray) -> Cones:
        return self._cones

    @staticmethod
    def _null_inputs(free: np.ndarray) -> np.ndarray:
        return free

    def _steps(self, cones: Cones, tau: np.ndarray, way: np.ndarray) -> tuple[float, float, bool]:
        self.lines += 1
        return super()._steps(cones, tau, way)


def test_the_limiter_is_the_reference_at_any_forces():
    """Of two to four inputs and one to three contacts, with and without a speed and inputs that do not change
    the motion: all directions are taken, and each ends for all reasons."""
    made, source, kinds = runtime("noslip_shaping.h"), np.random.default_rng(17), set()
    array = partial(made.array, "double")
    for k in range(600):
        count, contacts = 2 + k % 3, 1 + k // 3 % 3
        force, mass, shift = (
            source.normal(size=(contacts, 2)),
            source.uniform(0.5, 3.0, contacts),
            source.normal(size=contacts),
        )
        by, slope, tau = (
            source.normal(size=(contacts, 3, count)),
            source.normal(size=count),
            source.normal(size=count),
        )
        rank_one = np.outer(*source.normal(size=(2, count)))
        free = rank_one if count > 2 and k % 2 else None
        slope = slope if k % 5 else np.zeros(0)
        limits = source.uniform(0.3, 3.0, count) if k % 4 else np.full(count, 1e30)
        weight, height = 10 ** source.uniform(-1, 1), source.choice([0.0, 0.1, 0.4])
        by_load = np.moveaxis(height * by[:, 2], 0, 1)
        cones = Cones(force, weight * mass + height * shift, np.moveaxis(by[:, :2], 2, 0), by_load, mass)
        reference = Floor(cones, limits, free)
        status, truth = reference(np.zeros(0), tau, slope)
        if status == "ok":
            continue
        grip = made.new("noslip_grip", "double")
        grip.weight, grip.height = weight, height
        ground = np.column_stack([cones.at(tau), shift + by[:, 2] @ tau, mass])
        inputs, along = array(tau), array(slope) if len(slope) else made.ffi.NULL
        given = array(ground.ravel()), array(by.ravel()), grip, array(limits), contacts
        size = 3 * contacts + (count * (count + 3) if count > 2 else 0)
        work = array([0.0] * size + [7.0])
        if count == 2:
            made.function("noslip_keep_grip", "double")(inputs, along, *given, work)
        else:
            combined = made.ffi.NULL if free is None else array(free.ravel())
            made.function("noslip_keep_grip_of", "double")(inputs, along, combined, *given, count, work)
        assert np.abs(np.array(list(inputs)) - truth).max() <= 1e-7 * max(1.0, np.abs(truth).max()), k
        assert work[size] == 7.0
        kinds.add((count > 2, free is None, len(slope) > 0, reference.lines, status))
    assert len(kinds) == 17, kinds  # each way to end at each of its steps


@pytest.mark.parametrize("scalar, kind", [("double", np.float64), ("float", np.float32)])
def test_a_contact_that_holds_is_within_friction_but_for_one_rounding(scalar, kind):
    """In exact arithmetic, for forces within some roundings of mu load and at all sizes: what is computed as
    within friction is at most 1 + epsilon times it, what is computed as beyond is not below 1 - 2 epsilon.
    Infinite numbers and NaN are beyond."""
    made, source, answers = runtime("noslip_grip.h"), np.random.default_rng(12), []
    holds, grip, one = (
        made.function("noslip_holds", scalar),
        made.new("noslip_grip", scalar),
        np.finfo(kind).eps,
    )
    grip.height, epsilon = 0.0, Fraction(float(one))
    for _ in range(4000):
        most, angle = (
            kind(10 ** source.uniform(-15, 15)),
            source.choice([0.0, 1e-4, 0.3, 0.8, 1.2, 1.6]) * source.uniform(0.9, 1),
        )
        size = most * (1 + source.integers(-3, 4) * one)
        force = (size * np.array([np.cos(angle), np.sin(angle)]) * source.choice([-1, 1], 2)).astype(kind)
        grip.weight = float(most)
        answers.append(holds(made.array(scalar, [*force, 0.0, 1.0]), grip))
        square, limit = sum(Fraction(float(f)) ** 2 for f in force), Fraction(float(most))
        assert (
            square <= (limit * (1 + epsilon)) ** 2
            if answers[-1]
            else square >= (limit * (1 - 2 * epsilon)) ** 2
        )
    assert 0.2 < np.mean(answers) < 0.8
    for beyond in (
        [math.nan, 0.0, 0.0, 1.0],
        [0.0, math.inf, 0.0, 1.0],
        [0.0, 0.0, 0.0, math.nan],
        [0.0, 0.0, 0.0, -1.0],
    ):
        assert not holds(made.array(scalar, beyond), grip)


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_inputs_behind_the_two_are_not_touched(scalar):
    made = runtime("noslip_shaping.h")
    grip = made.new("noslip_grip", scalar)
    grip.weight = 1.0
    inputs, limits = made.array(scalar, [5.0, -5.0, 7.0]), made.array(scalar, [1.0, 1.0, 1.0])
    ground, by_inputs = made.array(scalar, [0.0, 0.0, 0.0, 1.0]), made.array(scalar, np.zeros(6))
    work = made.array(scalar, [0.0] * 3 + [7.0])
    made.function("noslip_keep_grip", scalar)(inputs, made.ffi.NULL, ground, by_inputs, grip, limits, 1, work)
    assert list(inputs) == [1.0, -1.0, 7.0] and work[3] == 7.0
    ground = made.array(scalar, [0.0, 0.0, 0.0, 1.0])
    inputs, limits, by_inputs = (
        made.array(scalar, each) for each in ([5.0, -5.0, 0.5, 7.0], [1.0] * 4, np.zeros(9))
    )
    work = made.array(scalar, [0.0] * 21 + [7.0])
    given = inputs, made.ffi.NULL, made.ffi.NULL, ground, by_inputs, grip, limits, 1, 3, work
    made.function("noslip_keep_grip_of", scalar)(*given)
    assert list(inputs) == [1.0, -1.0, 0.5, 7.0] and work[21] == 7.0


SPEC = """
robot = "labmate"
gains = { kp = 1.0, kd = 2.5, kv = 2.0 }
output = { type = "IV", path = { kind = "line", A = 1.0, B = -1.0, C = 0.0 } }
reference = { speed = 1.414 }
initial = { point = [0.0, 2.0], heading = "90 deg", speed = 0.0 }
simulation = { duration = 2.0, period = 0.01, tolerance = 1e-9 }
"""


def run(more: str, **replaced: str):
    text = SPEC + more
    for old, new in replaced.items():
        text = text.replace(old, new)
    return simulate(spec_of(text, "test"))


def test_the_papers_start_rolls():
    """Which asks for 2.4 times what friction gives; and all backends compute the same run."""
    floor = "[contact]\nmu = 0.7\nheight = 0.1\n"
    bare = run(floor)
    assert max(use.max() for use in bare.use.values()) > 2
    runs = {
        backend: run(
            floor + '[limits]\nmode = "grip"\n', **{"2.0, period": f'2.0, backend = "{backend}", period'}
        )
        for backend in ("c", "cf", "casadi")
    }
    for backend, made in runs.items():
        assert "grip" in made.status and "will_slip" not in made.status
        assert max(use.max() for use in made.use.values()) <= 0.95 * (1 + (1e-9 if backend != "cf" else 1e-2))
        assert np.abs(made.x - runs["c"].x).max() < (1e-8 if backend != "cf" else 0.01)


STARTS = SPEC.replace("A = 1.0, B = -1.0", "A = 0.0, B = 1.0").replace('"90 deg"', "0.0")
STARTS = STARTS.replace("2.0, period = 0.01", "12.0, period = 0.01, output_step = 0.005")


@pytest.mark.parametrize("count", [200, pytest.param(10_000, marks=pytest.mark.nightly)])
def test_random_starts_on_any_floor_keep_rolling_and_reach_the_path(count):
    """Friction use is at most 1 at the calls and between, unless a status says otherwise; without the limiter
    it is not. The path is reached in 99 % of the starts from which it is reached without, as soon (the median
    within 10 %).
    """
    source = np.random.default_rng(1)
    starts = {
        "contact.mu": source.uniform(0.15, 1.0, count),
        "contact.height": source.choice([0.0, 0.15], count),
        "initial.point[1]": source.uniform(-2.0, 2.0, count),
        "initial.heading": np.radians(source.uniform(-70.0, 70.0, count)),
        "initial.speed": source.uniform(0.0, 1.4, count),
    }
    found = []
    for more in ("[contact]\nheight = 0.1\n", '[contact]\nheight = 0.1\n[limits]\nmode = "grip"\n'):
        batch = Batch(spec_of(STARTS + more, "test"), band=0.05)
        found.append(dict(zip(batch.outcomes, batch.run(batch.table(starts, count)).T, strict=True)))
    bare, gripped = found
    says = gripped["will_slip"] > 0
    assert gripped["use"][~says].max() <= 1.0 and np.mean(says) <= 0.005
    assert bare["use"].max() > 10 and np.mean(bare["use"] > 1) > 0.5, "nothing was to be limited"
    reached = [(each["status"] >= 0) & (np.abs(each["final.distance"]) < 0.05) for each in found]
    assert np.mean(reached[1][reached[0]]) >= 0.99
    times = [each["settling.distance"][reached[0] & reached[1]] for each in found]
    assert np.median(times[1] / np.maximum(times[0], 0.01)) <= 1.1


@pytest.mark.parametrize(
    "more, said",
    [
        ('[limits]\nmode = "grip"\n', r"\[limits\] mode = \"grip\" requires \[contact\]: mu"),
        ('[limits]\nmode = "cut"\n', r"mode = \"cut\" requires \[limits\] torque"),
        ('[contact]\n[limits]\nmode = "grip"\nmargin = 1.0\n', "margin = 1 must be below 1"),
    ],
)
def test_refused_specs(more, said):
    with pytest.raises(BadInput, match=said):
        run(more)


@pytest.mark.parametrize(
    "robot, name, limits, said",
    [
        ("geared_arm", None, None, "it defines no contacts: add them"),
        (
            "tractor_trailer",
            "type_iv_line",
            Limits((0.0, 0.0), "grip", Friction(0.5, height=0.2)),
            "height = 0.2: tractor_trailer has an axle without width",
        ),
        ("labmate", "type_i", Limits((0.0, 0.0), "grip"), "requires friction"),
        ("labmate", "type_i", Limits((0.0, 0.0), "grip", Friction(-0.5)), "mu must be positive"),
    ],
)
def test_refused_robots_and_numbers(robot, name, limits, said):
    mechanism = find_robot(robot)
    made = law_of(mechanism, name or mechanism.outputs[0].name)
    limits = limits or Limits((0.0,) * len(mechanism.inputs), "grip", Friction(0.5))
    with pytest.raises(BadInput, match=said):
        limits.check(made)


REFUSED = {
    **{"mu": (0.0, -0.5, math.inf, math.nan), "margin": (-0.1, 1.0, math.nan)},
    **{"share": (-0.1, 1.1, math.nan), "height": (-0.1, math.inf, math.nan)},
}


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_init_checks_the_friction(scalar):
    def status(robot: str, **changed: float) -> str | None:
        made = law(robot, "type_iv_line")
        numbers = [[1.0] * len(group) for group in (made.parameters, made.config, made.gains)]
        friction = Friction(**{"mu": 0.5, **changed})
        return CompiledController(made, *numbers, scalar, Limits((0.0, 0.0), "grip", friction)).refused

    for changed in ({}, {"margin": 0.9}, {"share": 0.0}, {"share": 1.0}, {"height": 0.3}):
        assert status("labmate", **changed) is None, changed
    for name, values in REFUSED.items():
        assert {status("labmate", **{name: value}) for value in values} == {"bad_parameter"}, name
    assert (status("tractor_trailer"), status("tractor_trailer", height=0.3)) == (None, "bad_parameter")
    assert status("car", height=0.3) is None  # its axles are on the centre line, and named


def straight_on(
    backend: str, friction: Friction, floor: float, counts: int = 0, mass: float = 1.0, torque: float = 1.0
):
    """mu believed and slip (m/s) in each of 150 steps of a platform that drives straight on, as fast as it
    may, on a `floor` that its wheels slip on: the body moves by the forces of the ground, the rims by the
    torques less these. `counts` of the encoders; `mass` and `torque` are factors of what the law assumes.
    """
    made, numbers = law("labmate", "type_iv_line"), find_robot("labmate").parameter_values({})
    b, d, r, m_c, m_w, I_c, I_w, I_m = numbers
    controller = make_controller(
        backend, made, numbers, [0, 0, 1, 0], [1.0, 2.5, 2.0], Limits((0.0, 0.0), "grip", friction)
    )
    body, rims, most = mass * (m_c + 2 * m_w), 2 * mass * I_w / r**2, floor * mass * (m_c + 2 * m_w) * 9.81
    fine, unit, before, found = friction.period / 50, 2 * math.pi / (counts or math.inf), 0.0, []
    x = speed = rim = angle = 0.0
    for _ in range(150):
        counted = math.floor(angle / unit) * unit if counts else angle
        rate = (counted - before) / friction.period if counts else rim / r
        before = counted
        status, tau = controller.step(
            np.array([x + d, 0, 0, angle, angle, rate, rate]), np.array([0, 0, 0, 20.0, 0])
        )
        assert status == "grip" and abs(tau[0] - tau[1]) < 1e-4
        pull = torque * 2 * tau[0] / r
        for _ in range(50):
            if rim == speed and abs(pull) * body / (body + rims) <= most:
                rim = speed = speed + fine * pull / (body + rims)
            else:
                force, gap = math.copysign(most, rim - speed if rim != speed else pull), rim - speed
                speed, rim = speed + fine * force / body, rim + fine * (pull - force) / rims
                rim = speed if gap * (rim - speed) < 0 else rim
            x, angle = x + fine * speed, angle + fine * rim / r
        found.append((controller.believed, rim - speed))
    return np.array(found).T


earning = partial(Friction, 0.5, period=0.01)


@pytest.mark.parametrize("backend", ["c", "cf", "casadi"])
def test_friction_is_earned_where_the_wheels_roll(backend):
    """From 0.6 of what is given, or from what was known, 0.5 of it more each second; never more than that."""
    t = 0.01 * np.arange(1, 151)
    for friction, first in ((earning(), 0.3), (earning(known=0.45), 0.45), (earning(margin=0.1), 0.3)):
        mu, slip = straight_on(backend, friction, 0.5)
        assert np.abs(mu - np.minimum(first + 0.25 * t, 0.5)).max() < 1e-5 and slip.max() == 0
    mu, _ = straight_on(backend, Friction(0.5, period=0.01), 0.5)
    given = make_controller(
        backend,
        law("labmate", "type_iv_line"),
        find_robot("labmate").parameter_values({}),
        [0, 0, 1, 0],
        [1, 2, 2],
        Limits((0.0, 0.0), "grip", Friction(0.5)),
    )
    assert given.believed == pytest.approx(0.5)


@pytest.mark.parametrize("part, most", [(0.8, 0.1), (0.7, 0.1), (0.5, 0.4)])
def test_a_wheel_that_runs_away_shows_the_friction(part, most):
    """It slips for some steps, after which 0.9 of the friction that there is is believed,
    as by the reference; and again."""
    runs = [straight_on(backend, earning(), part * 0.5) for backend in ("c", "casadi", "cf")]
    assert np.abs(runs[0] - runs[1]).max() < 1e-9 and np.abs(runs[0] - runs[2]).max() < 1e-2
    mu, slip = runs[0]
    falls = np.flatnonzero(np.diff(mu) < 0) + 1
    assert np.abs(mu[falls] / (0.9 * part * 0.5) - 1).max() < 0.03 and len(falls) > 1
    assert slip.max() < most and np.mean(slip > 0.05) < 0.1


def test_wrong_masses_and_coarse_rates():
    """No false alarm where the floor is as given, and where it is not, what is believed stays near it."""
    for mass, torque, counts in (
        (0.8, 1.2, 4096),
        (1.2, 0.8, 4096),
        (0.8, 1.2, 0),
        (0.8, 0.8, 1024),
        (1.2, 1.2, 1024),
    ):
        friction = earning(
            coarse=2 * math.pi / counts / 0.01 if counts else 0.0, lag=0.005 if counts else 0.0
        )
        mu, slip = straight_on("c", friction, 2.0, counts, mass, torque)
        assert (np.diff(mu) >= 0).all() and mu[-1] > 0.4 and slip.max() == 0
        mu, slip = straight_on("c", friction, 0.4, counts, mass, torque)
        assert slip.max() < 0.5 and np.mean(slip > 0.05) < 0.2


@pytest.mark.parametrize("scalar", ["double", "float"])
def test_rates_within_the_least_bound_are_compared_in_a_few_instructions(scalar):
    """With the bits of the whole comparison, for wheels near that bound, away from before, after a pause,
    and at any rates."""
    c, random, counts = runtime("noslip_grip.h"), np.random.default_rng(80), np.zeros(2, int)
    for _ in range(4000):
        size = 10.0 ** random.integers(-2, 2)
        friction = c.new(
            "noslip_friction", scalar, {"mu": 0.5, "period": 0.01, "lag": random.choice([0, 0.02])}
        )
        earned, grip = c.new("noslip_earned", scalar), c.new("noslip_grip", scalar)
        c.function("noslip_grip_init", scalar)(earned, grip, friction, 2)
        c.function("noslip_believe", scalar)(earned, grip, random.choice([0.01, 0.3, 0.4999, 0.5]))
        earned.pause = random.choice([0, 0, -0.003, 0.01])
        wheels = c.ffi.new(f"{SCALARS[scalar].name('noslip_wheel')}[2]")
        for wheel in wheels:
            c.function("noslip_wheel_init", scalar)(
                c.ffi.addressof(wheel), c.array(scalar, [0, 2.0, 0.15]), earned
            )
            wheel.expected, wheel.rate = random.normal(0, size), random.normal(0, 1)
            wheel.away, wheel.steps = random.choice([*[(0, 0)] * 6, (0.5, 1), (-0.2, 3)])
        beyond = (
            earned.error
            * grip.weight
            / 4
            * random.choice([1, 1 + 1e-7, 0.9, 0.5, 3], 2)
            * random.choice([-1, 1], 2)
        )
        rates = [
            wheel.rate + (wheel.expected + each) / wheel.rim
            for wheel, each in zip(wheels, beyond, strict=True)
        ]
        ground = c.array(scalar, random.normal(0, 30, 8))
        answers = []
        for name in ("noslip_earn", "noslip_compare"):
            copies = [c.ffi.new(c.ffi.typeof(each), each[0]) for each in (earned, grip)]
            own = c.ffi.new(c.ffi.typeof(wheels), list(wheels))
            c.function(name, scalar)(*copies, own, ground, c.array(scalar, rates), 2)
            answers.append(b"".join(bytes(c.ffi.buffer(each)) for each in (*copies, own)))
        assert answers[0] == answers[1]
        counts[int(max(abs(beyond)) < earned.error * grip.weight / 4 and earned.pause <= 0)] += 1
    assert min(counts) > 200


@pytest.mark.parametrize("direction", [1, -1])
def test_what_is_beyond_is_summed_over_steps_in_a_row(direction):
    """However little it is; from the beginning again where one step is within its bound. Too little for an
    alarm: mu is kept."""
    c = runtime("noslip_grip.h")
    earned, grip, wheel = (
        c.new("noslip_earned", "double"),
        c.new("noslip_grip", "double"),
        c.new("noslip_wheel", "double"),
    )
    friction = c.new("noslip_friction", "double", {"mu": 0.5, "period": 0.01, "coarse": 1e3, "known": 0.4})
    c.function("noslip_grip_init", "double")(earned, grip, friction, 1)
    c.function("noslip_wheel_init", "double")(wheel, c.array("double", [0, 2.0, 0.15]), earned)
    earned.pause = 0
    ground, steps = c.array("double", [50.0 * direction, 0, 0, 10.0]), 0
    for beyond in (0.01, 0.02, 0.03, -0.5, 0.04, 0.05):
        rate = wheel.rate + direction * (earned.error * grip.weight / 4 + beyond) / wheel.rim
        c.function("noslip_earn", "double")(earned, grip, wheel, ground, c.array("double", [rate]), 1)
        steps = steps + 1 if beyond > 0 else 0
        assert (wheel.steps, earned.mu) == (steps, 0.4 if beyond > 0 else pytest.approx(0.4 + earned.rise))
        c.function("noslip_believe", "double")(earned, grip, 0.4)
    assert wheel.away == pytest.approx(0.09 * direction, rel=1e-9)


def test_what_is_believed_stays_within_what_is_given():
    """At any states in any order, in which wheels seem to jump; also across errors, and other parameters."""
    random, made = np.random.default_rng(43), law("labmate", "type_iv_line")
    numbers = find_robot("labmate").parameter_values({})
    for backend in ("c", "cf", "casadi"):
        controller = make_controller(
            backend, made, numbers, [0, 0, 1, 0], [1, 2, 2], Limits((9.0, 9.0), "grip", earning())
        )
        found = []
        for k in range(300):
            state = random.normal(0, 1, 7) * [1, 1, 0.3, 1, 1, *[10.0 ** random.integers(-3, 4)] * 2]
            state[2] = math.nan if k % 50 == 49 else state[2]
            controller.step(state, np.array([0, 0, 0, random.normal(), 0]))
            found.append(controller.believed)
            if k % 70 == 69:
                controller.adapt(np.array(numbers) * random.uniform(0.9, 1.1))
                assert controller.believed == found[-1]
        assert 0 <= min(found) < 0.3 < max(found) <= 0.5 * (1 + 1e-6)


@pytest.mark.nightly
def test_friction_is_earned_with_a_contact_between_the_driven_wheels():
    plain = find_robot("tractor_trailer")
    ordered = copy(plain)
    ordered.contacts = [plain.contacts[k] for k in (0, 2, 1)]
    laws = [law_of(each, "type_iv_line") for each in (plain, ordered)]
    numbers, gains = plain.parameter_values({}), [1.0] * len(laws[0].gains)
    config = [0.3 if quantity.name == "direction" else 0.7 for quantity in laws[0].config]
    limits = Limits((0.0, 0.0), "grip", earning())
    controllers = [make_controller("c", each, numbers, config, gains, limits) for each in laws]
    random, believed = np.random.default_rng(7), []
    for _ in range(400):
        state = random.normal(0, 0.3, len(laws[0].groups["state"]))
        reference = random.normal(0, 0.3, len(laws[0].reference))
        answers = [each.step(state, reference) for each in controllers]
        assert answers[0][0] == answers[1][0]
        assert answers[0][1] == pytest.approx(answers[1][1], rel=1e-6, abs=1e-6)
        believed.append([each.believed for each in controllers])
    assert np.ptp(believed) > 0.1 and np.abs(np.diff(believed)).max() < 1e-8


@pytest.mark.nightly
def test_no_false_alarm_in_random_runs():
    """Wheels that roll, of robots whose masses are off by 20 %, with encoders and delays,
    from starts beside a line."""
    random = np.random.default_rng(43)
    text = """
robot = "labmate"
gains = { kp = 1.0, kd = 2.5, kv = 2.0 }
output = { type = "IV", path = { kind = "line", A = 1.0, B = -1.0, C = 0.0 } }
limits = { mode = "grip" }
contact = { mu = 0.5 }
reference = { speed = 1.0 }
initial = { point = [0.0, 0.0], heading = 0.0, speed = 0.0 }
simulation = { duration = 4.0, period = 0.01 }
"""
    sizes = dict(zip(("m_c", "m_w", "I_c", "I_w", "I_m"), (30.0, 1.0, 15.625, 0.005, 0.0025), strict=True))
    for _ in range(300):
        start = {
            "point": [0.0, random.uniform(-2, 2)],
            "heading": random.uniform(-1.2, 2.8),
            "speed": random.uniform(0, 1.5),
        }
        changes = {
            "plant": {name: size * random.uniform(0.8, 1.2) for name, size in sizes.items()},
            "simulation.delay": float(random.choice([0.0, 0.01])),
            "initial": start,
            "contact.mu": random.uniform(0.15, 0.9),
            "reference.speed": random.uniform(0.3, 1.5),
        }
        if counts := int(random.choice([0, 2048, 4096, 16384])):
            changes["sensors"] = {"counts": counts, "pose": "true"}
        run = simulate(varied(text, "test", changes))
        assert (np.diff(run.noticed[:, 0]) >= 0).all(), changes
