"""Compares generated C with the model before it is written.

Every entry point, in double and in float, is compared with the plain expressions of the model (`ControlLaw`,
`ReducedSystem`) at random states, and its status where Phi is singular. The expressions of codegen/derivation
and codegen/dynamics.py are not used for the expected values. A difference is an error unless the model
itself, in extended precision, changes as much if its inputs are rounded.
"""

import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from pathlib import Path

import casadi as ca
import cffi
import numpy as np

from ...analysis.exact.extended import due_to_rounding
from ...codegen.derivation.grip import plain_ground
from ...codegen.dynamics import ENTRIES as DYNAMICS_ENTRIES
from ...codegen.ekf.ekf import NAME as FILTER_NAME
from ...codegen.ekf.filter import WITH_GYRO, WITHOUT_GYRO
from ...codegen.files import filter_program
from ...codegen.identity import DYNAMICS
from ...codegen.printing.lanes_c import FOLDER as LANES
from ...codegen.printing.scalar import SCALARS
from ...codegen.program import EVALUATE, FOLLOW, STEP
from ...codegen.runtime import runtime_files
from ...model.algebra.direct import Direct
from ...model.law import ControlLaw, symbols
from ...model.linearization import SINGULAR
from ...model.outputs import body_offsets
from ...model.reduction import ReducedSystem
from ...model.vehicle import estimated_pose, required_point
from ...readers.errors import BadInput
from ...readers.kept import keep, kept
from ...readers.progress import Reported, silent
from ...simulation.controllers.build import FLAGS, QUICK, DoesNotCompile, compiler, identity
from ...simulation.controllers.compiled import (
    BatchLibrary,
    CompiledController,
    CompiledDynamics,
    DynamicsLibrary,
    Library,
)
from ...simulation.controllers.controller import Limits
from ...simulation.controllers.estimation.ekf import Filter, FilterOptions, RobotPart
from ...simulation.controllers.runtime import load
from ...simulation.controllers.symbolic import slowed
from .check import RANDOM_LIMITS, TYPICAL, deviations_of, relative
from .sampling import REGULAR, RandomPlant, as_held, random_motions, random_plants

STATES, SEED = 200, 1992
MARK = ".compared"  # suffix of the file that records a comparison
LIMIT = {"double": RANDOM_LIMITS["c"].worst, "float": RANDOM_LIMITS["cf"].worst}  # as `noslip check`
SINGULAR_STATES = 8  # of each law, at most
HALVINGS = 60  # bisections to find one
SAYS_SINGULAR = "singular"  # a status
ANY_BITS = 60  # lanes of arbitrary bits, for each plant
TINY = 1e-6  # a limit above 0 where all inputs are 0
TICKS = (WITH_GYRO.name, WITHOUT_GYRO.name)  # of a filter
SURELY = 0.1  # of the threshold: below it Phi is singular in float as well


@dataclass(frozen=True, eq=False)
class Sample:
    """The result of an entry point at a state, and the model's value there. `inputs` are by group, SI."""

    label: str
    status: str
    value: np.ndarray | None
    expected: np.ndarray
    quantity: str
    inputs: Mapping[str, np.ndarray]


def differences(
    system: ReducedSystem,
    laws: Sequence[ControlLaw],
    files: Mapping[str, str],
    progress: Reported = silent,
    scaled: Sequence[str] | None = None,
) -> list[str]:
    """Return lines that describe where the C of `files` (name -> text) differs from the model; empty if it
    does not.

    `scaled`: of what the filter estimates the scale; None: there is no filter.
    Successful comparisons are cached. Without a C compiler for this machine, nothing is compared and a
    warning on standard error says so. Raises BadInput if the robot is regular at hardly any random state.
    """
    try:
        parts = list(_not_compared_before(system, laws, files, scaled))
        if parts:
            load(cffi.FFI(), {})  # the runtime's status: checks that the compiler builds for this machine
    except (BadInput, OSError) as reason:
        print(f"noslip: warning: the C is not compared with the model: {reason}", file=sys.stderr)
        return []
    wrong = []
    for k, (part, own, key) in enumerate(parts):
        progress(k, len(parts), "files compared with the model")
        wrong += _compared(part, own, key)
    return wrong


def is_compared(
    system: ReducedSystem, laws: Sequence[ControlLaw], files: Mapping[str, str], scaled: Sequence[str] | None
) -> bool:
    """Return whether the comparison of all `files` with the model is cached;
    arguments as of `differences`."""
    try:
        return next(_not_compared_before(system, laws, files, scaled), None) is None
    except (BadInput, OSError):
        return False


def _not_compared_before(
    system: ReducedSystem, laws: Sequence[ControlLaw], files: Mapping[str, str], scaled: Sequence[str] | None
) -> Iterator[tuple["_InC", dict[str, str], tuple]]:
    """Yield each law, the dynamics and the filter in each scalar of `files`, their files,
    and the key in the cache."""
    settings = (STATES, SEED, sorted(LIMIT.items()))
    for scalar in SCALARS:
        filters = [] if scaled is None else [_FilterInC(system, scaled, scalar)]
        of_laws = [kind(law, scalar) for law in laws for kind in (_LawInC, _LanesInC)]
        for part in (*of_laws, _DynamicsInC(system, scalar), *filters):
            if part.names <= files.keys():
                own = {
                    Path(name).name: files[name]
                    for name in sorted({*part.names, *part.beside})
                    if name in files
                }
                key = (
                    *identity([*compiler(), *FLAGS, *QUICK]),
                    settings,
                    part.title,
                    sorted({**runtime_files(), **own}.items()),
                )
                if not kept(key, MARK):
                    yield part, own, key


def _compared(part: "_InC", files: Mapping[str, str], key: tuple) -> list[str]:
    """Return a line about a difference, if there is one; otherwise record the comparison under `key`."""
    samples: dict[str, list[Sample]] = {}
    try:
        for sample in part.samples(files):
            samples.setdefault(sample.label, []).append(sample)
    except DoesNotCompile as error:
        return [f"{part.title}: {error}"]
    wrong = [worst for each in samples.values() if (worst := part.first_wrong(each))]
    if not wrong:
        keep(key, MARK, b"")
        return []
    also = f"; so do {', '.join(sample.label for sample in wrong[1:])}" if wrong[1:] else ""
    return [f"{part.title}: {part.about(wrong[0])}{also}"]


class _InC(ABC):
    """The C of a law or dynamics in one scalar, and the model's expressions with which it is compared,
    by quantity."""

    def __init__(self, robot: str, own: str, scalar: str):
        name = SCALARS[scalar].name
        self.scalar = scalar
        self.names = {f"{name(stem)}.{kind}" for stem in (robot, f"{robot}_{own}") for kind in "ch"}
        self.beside: set[str] = set()  # files that are compiled with these, if they are there
        self.title = f"{robot}, {own}, {scalar}"

    @property
    @abstractmethod
    def groups(self) -> dict[str, ca.SX]:
        """Inputs of the model's function, by group."""

    @property
    @abstractmethod
    def expressions(self) -> dict[str, ca.SX]:
        """The model's quantities."""

    @abstractmethod
    def samples(self, files: Mapping[str, str]) -> Iterator[Sample]:
        """Yield results of the C of the files, with the model's values."""

    @cached_property
    def model(self) -> Direct:
        """Return the function from the inputs by group to the expressions."""
        dense = [ca.densify(expression) for expression in self.expressions.values()]
        return Direct(ca.Function("model", list(self.groups.values()), dense))

    def right(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the model's values; matrices have two dimensions."""
        values = self.model(*[inputs[group] for group in self.groups])
        shapes = [expression.shape for expression in self.expressions.values()]
        each = zip(self.expressions, values, shapes, strict=True)
        return {name: value.reshape(shape, order="F") for name, value, shape in each}

    def held(self, values: Sequence[float] | np.ndarray) -> np.ndarray:
        """Return the nearest values in the scalar."""
        return as_held(values, self.scalar)

    def first_wrong(self, samples: Sequence[Sample]) -> Sample | None:
        """Return the sample with the largest error that exceeds the limit and is not due to rounding;
        None if there is none."""
        failed = next((s for s in samples if s.value is None or not np.isfinite(s.value).all()), None)
        if failed:
            return failed
        valued = [(s, s.value) for s in samples if s.value is not None]
        values, expected = np.array([value for _, value in valued]), np.array([s.expected for s, _ in valued])
        errors = relative(deviations_of(values, expected), TYPICAL)
        for k in np.argsort(errors)[::-1]:
            if errors[k] <= LIMIT[self.scalar]:
                return None
            if not self._excused(*valued[k]):
                return valued[k][0]
        return None

    def _excused(self, sample: Sample, value: np.ndarray) -> bool:
        """Return whether the error is explained by rounding: the model at rounded inputs, in extended
        precision, differs as much.
        """
        if sample.quantity not in self.expressions:
            return False
        off = np.abs(value.ravel(order="F") - sample.expected.ravel(order="F")).max(initial=0.0)
        inputs = [sample.inputs[group] for group in self.groups]
        return due_to_rounding(
            off, self.expressions[sample.quantity], list(self.groups.values()), inputs, self.scalar
        )

    def about(self, sample: Sample) -> str:
        """Return the description of a difference: both values, and the inputs on which it depends."""
        from_c = f"status {sample.status}" if sample.value is None else _listed(sample.value)
        expected = _listed(sample.expected) if sample.quantity else f"status {SAYS_SINGULAR}"
        return (
            f"{sample.label} differs: the C gives {from_c}; the model gives {expected} (at "
            f"{self.inputs_of(sample)})"
        )

    def inputs_of(self, sample: Sample) -> str:
        """Return the inputs on which a sample depends, with their values."""
        model = self.expressions.get(sample.quantity, ca.vertcat(*self.groups.values()))
        used = [
            (name, group)
            for name, group in self.groups.items()
            if group.numel() and ca.depends_on(model, group)
        ]
        return "; ".join(f"{name} {_named(name, group, sample.inputs[name])}" for name, group in used)


def _named(name: str, group: ca.SX, values: Iterable[float]) -> str:
    each = zip(ca.vertsplit(group), values, strict=True)
    return ", ".join(f"{str(symbol).removeprefix(f'{name}.')} = {value:.9g}" for symbol, value in each)


def _listed(values: np.ndarray) -> str:
    return "[" + ", ".join(f"{value:.9g}" for value in np.ravel(values)) + "]"


class _LawInC(_InC):
    """A law."""

    def __init__(self, law: ControlLaw, scalar: str):
        super().__init__(law.system.mechanism.name, law.name, scalar)
        self.law = law
        self.answer = "command" if law.kinematic else "tau"
        batch = SCALARS[scalar].name(f"{law.system.mechanism.name}_{law.name}_steps")
        # One library is compiled for the law and its batch law
        self.beside = {f"{LANES}/{batch}.{kind}" for kind in "ch"}

    @cached_property
    def groups(self) -> dict[str, ca.SX]:
        """All groups on which a law depends."""
        groups = {**self.law.groups, "input": self.law.system.mechanism.inputs}
        return {name: symbols(members) for name, members in groups.items()}

    @cached_property
    def expressions(self) -> dict[str, ca.SX]:
        """The model's quantities, and the measures of singularity."""
        law, measure = self.law, _measures(self.law)
        quantities = law.quantities | {
            f"{self.answer}_of_v": law.tau_of_v,
            "slope": law.slope,
            "measure": measure,
        }
        ground = {} if law.kinematic else plain_ground(law.system)
        return quantities | {str(name): expression for name, expression in ground.items()}

    def samples(self, files: Mapping[str, str]) -> Iterator[Sample]:
        """Yield every entry point at random regular states, and the step at singular ones."""
        library = _library(self.law, self.scalar, tuple(files.items()))
        random, singular = np.random.default_rng(SEED), 0
        for plant in _plants(self.law):
            params, config, gains = (
                self.held(values) for values in (plant.params, plant.config, plant.gains)
            )
            numbers = {"params": params, "config": config, "gains": gains}
            controller = CompiledController(self.law, params, config, gains, made_by=library)
            for point in plant.points:
                inputs = numbers | {"state": self.held(point.state), "reference": self.held(point.reference)}
                inputs["virtual_input"] = self.held(random.uniform(-2, 2, len(self.law.virtual_input)))
                inputs["input"] = self.held(random.uniform(-2, 2, len(self.law.system.mechanism.inputs)))
                yield from self._at(controller, library, inputs)
                yield from self._at_foot(controller, library, inputs, random)
            if singular < SINGULAR_STATES:
                for state in self._singular_states(plant, numbers):
                    singular += 1
                    yield from self._refused(controller, inputs | {"state": state})

    def _at(self, controller: CompiledController, library: Library, inputs: Mapping) -> Iterator[Sample]:
        """Yield the results of the entry points that take the state."""
        right = self.right(inputs)
        state, reference = inputs["state"], inputs["reference"]
        evaluation, (status, tau) = controller.evaluate(state, reference), controller.step(state, reference)
        for name, value in (evaluation.values or dict.fromkeys(self.expressions, None)).items():
            if name in right:
                shaped = None if value is None else np.reshape(value, right[name].shape)
                yield Sample(f"{name} by evaluate", evaluation.status, shaped, right[name], name, inputs)
        value, name = tau[:, None] if status == "ok" else None, self.answer
        yield Sample(f"{name} by step", status, value, right[name], name, inputs)
        for entry, body in library.text.program.entries.items():
            if entry.public and not entry.at_foot and entry not in (EVALUATE, STEP):
                (name,) = body.quantities
                outcome = controller.entry(entry, state, more=inputs[entry.takes] if entry.takes else ())
                yield Sample(
                    f"{name} by {entry.name}",
                    outcome.status,
                    outcome.values.get(name),
                    right[name],
                    name,
                    inputs,
                )
        yield from self._slowed(library, inputs, right, "step")

    def _slowed(
        self, library: Library, inputs: Mapping, right: Mapping, entry: str, foot: Sequence[float] = ()
    ) -> Iterator[Sample]:
        """Yield the step with reduced acceleration: the input that is most sensitive is limited to nine
        tenths."""
        tau, slope = right[self.answer].ravel(), right["slope"].ravel()
        if not len(slope) or not np.abs(slope).max() or self.law.speed_row is None:
            return
        most = int(np.argmax(np.abs(slope)))
        if np.abs(tau[most]) < 0.1 * np.abs(tau).max():
            return
        torque = np.zeros(len(tau))
        torque[most] = self.held([0.9 * abs(tau[most])])[0]
        limits = np.where(torque > 0, torque, np.inf)
        params, config, gains = (
            inputs["made of"] if foot else (inputs[group] for group in ("params", "config", "gains"))
        )
        controller = CompiledController(
            self.law, params, config, gains, limits=Limits(tuple(torque), "slow"), made_by=library
        )
        which = next(e for e in library.text.program.entries if e.name == entry)
        outcome = controller.entry(which, inputs["state"], foot, inputs["reference"])
        value = next(iter(outcome.values.values()), None)
        expected = slowed(tau, slope, limits)[:, None]
        yield Sample(
            f"{self.answer} by {entry}, slowed", outcome.status, value, expected, self.answer, inputs
        )

    def _at_foot(
        self, controller: CompiledController, library: Library, inputs: Mapping, random: np.random.Generator
    ) -> Iterator[Sample]:
        """Yield `follow` at a random foot of P_l, and the model with a path and a vehicle in that relative
        position."""
        follow = FOLLOW if FOLLOW in library.text.program.entries else None
        if follow is None:
            return
        distance, heading, curvature = self.held(random.uniform(-1, 1, 3) * (1, np.pi, 0.5))
        foot = (distance, np.cos(heading), np.sin(heading), curvature)
        place = (
            _place_function(self.law)(inputs["config"], inputs["params"], distance, heading, curvature)
            .full()
            .ravel()
        )
        moved = dict(inputs) | {"state": np.array(inputs["state"]), "config": np.array(inputs["config"])}
        config = [q.name for q in self.law.groups["config"]]
        moved["state"][list(required_point(self.law.system).pose)] = *place[:2], heading
        for quantity, value in zip(self.law.output.required_path.parameters, place[2:], strict=True):
            moved["config"][config.index(quantity.name)] = value
        right = self.right(moved)
        if not (right["measure"][0::2] > REGULAR * right["measure"][1::2]).all():
            return
        outcome = controller.entry(follow, moved["state"], foot, inputs["reference"])
        value = next(iter(outcome.values.values()), None)
        yield Sample(
            f"{self.answer} by follow", outcome.status, value, right[self.answer], self.answer, moved
        )
        moved["made of"] = [inputs[group] for group in ("params", "config", "gains")]
        yield from self._slowed(library, moved, right, "follow", foot)

    def _singular_states(self, plant: RandomPlant, numbers: Mapping) -> Iterator[np.ndarray]:
        """Yield states between two random ones at which det Phi changes its sign, and det S'E."""
        for k in range(len(self.law.linearization.measures)):
            yield from self._singular_states_of(k, plant, numbers)

    def _singular_states_of(self, k: int, plant: RandomPlant, numbers: Mapping) -> Iterator[np.ndarray]:
        values, fixed = _inverted_function(self.law), (numbers["params"], numbers["config"])

        def sign(state: np.ndarray) -> float:
            matrix = values(*fixed, state)[1 + k]
            return np.sign(np.linalg.det(matrix.reshape(2 * (math.isqrt(len(matrix)),))))

        for one, other in zip(plant.points, plant.points[1:], strict=False):
            a, b = np.array(one.state), np.array(other.state)
            at_a = sign(a)
            if at_a * sign(b) >= 0:
                continue
            for _ in range(HALVINGS):
                middle = (a + b) / 2
                a, b = (middle, b) if sign(middle) == at_a else (a, middle)
            state = self.held(a)
            first, second = values(*fixed, state)[0][2 * k : 2 * k + 2]
            if first <= SURELY * SINGULAR * second:  # no pole
                yield state
                return

    def _refused(self, controller: CompiledController, inputs: Mapping) -> Iterator[Sample]:
        """Yield the status at a state where Phi is singular; there is no value."""
        for entry, status in (
            ("step", controller.step(inputs["state"], inputs["reference"])[0]),
            ("evaluate", controller.evaluate(inputs["state"], inputs["reference"]).status),
        ):
            none = np.zeros((0, 1))
            yield Sample(
                f"status of {entry}", status, none if status == SAYS_SINGULAR else None, none, "", inputs
            )


class _LanesInC(_LawInC):
    """A law's batch law, each lane compared with a step, bit by bit. In its samples the step has the place of
    the model."""

    def __init__(self, law: ControlLaw, scalar: str):
        super().__init__(law, scalar)
        self.names |= self.beside
        self.title += ", batch law"

    def samples(self, files: Mapping[str, str]) -> Iterator[Sample]:
        """Yield lanes at random regular states and at arbitrary bits,
        without limits and with limits that many of them exceed."""
        library, random = _library(self.law, self.scalar, tuple(files.items())), np.random.default_rng(SEED)
        for plant in _plants(self.law):
            params, config, gains = (
                self.held(values) for values in (plant.params, plant.config, plant.gains)
            )
            numbers = {"params": params, "config": config, "gains": gains}
            state, reference = self._lanes(plant, random)
            free = CompiledController(self.law, params, config, gains, made_by=library)
            usual = np.median(np.abs(free.steps(state, reference)[1][:, : len(plant.points)]), axis=1)
            limits = Limits(tuple(self.held(usual + TINY)))
            limited = CompiledController(self.law, params, config, gains, limits=limits, made_by=library)
            for controller in (free, limited):
                statuses, tau = controller.steps(state, reference)
                for k, (status, of_lane) in enumerate(zip(statuses, tau.T.astype(float), strict=True)):
                    inputs = numbers | {"state": state[:, k], "reference": reference[:, k]}
                    of_step, expected = controller.step(state[:, k], reference[:, k])
                    same = status == of_step
                    about = status if same else f"{status} with {of_lane}, not {of_step}"
                    yield Sample("a lane", about, of_lane if same else None, expected, self.answer, inputs)

    def _lanes(self, plant: RandomPlant, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return states and references, a column for each lane, the last of them with arbitrary bits."""
        kind = np.dtype(np.float32 if self.scalar == "float" else np.float64)
        regular = np.array([np.concatenate([point.state, point.reference]) for point in plant.points], kind).T
        any_bits = np.frombuffer(random.bytes(kind.itemsize * len(regular) * ANY_BITS), kind).reshape(
            len(regular), -1
        )
        state, reference = np.split(np.hstack([regular, any_bits]), [len(self.law.state)])
        return state, reference

    def first_wrong(self, samples: Sequence[Sample]) -> Sample | None:
        """Return the first lane that differs from its step in status or in a bit; None if there is none."""
        return next(
            (s for s in samples if s.value is None or s.value.tobytes() != s.expected.tobytes()), None
        )

    def about(self, sample: Sample) -> str:
        """Return the description of a difference: both values, and the inputs on which it depends."""
        from_c = f"status {sample.status}" if sample.value is None else _listed(sample.value)
        return (
            f"{sample.label} differs: it has {from_c}; the step gives {_listed(sample.expected)} (at "
            f"{self.inputs_of(sample)})"
        )


@lru_cache(maxsize=1)
def _library(law: ControlLaw, scalar: str, files: tuple[tuple[str, str], ...]) -> Library:
    """Return the law's compiled C of these files, with that of its batch law if it is there;
    one for both comparisons."""
    kind = BatchLibrary if any(name.endswith(("_steps.c", "_steps_f.c")) for name, _ in files) else Library
    return kind(law, scalar, dict(files))


@cache
def _plants(law: ControlLaw) -> list[RandomPlant]:
    """Return the plants, created once for both scalars."""
    return [plant for plant in random_plants(law, STATES, SEED) if plant.points]


def _measures(law: ControlLaw) -> ca.SX:
    """Return the measures of singularity, two entries each."""
    return ca.vertcat(*[part for pair in law.linearization.measures for part in pair])


@cache
def _inverted_function(law: ControlLaw) -> Direct:
    """Return the function (params, config, state) to the measures, to Phi and, if it changes,
    to what (12) inverts."""
    groups = [symbols(law.groups[name]) for name in ("params", "config", "state")]
    inverted = [law.linearization.Phi, law.system.distribution][: len(law.linearization.measures)]
    return Direct(ca.Function("inverted", groups, [_measures(law), *map(ca.densify, inverted)]))


@cache
def _place_function(law: ControlLaw) -> ca.Function:
    """Return the function (config, params, distance, heading, curvature) to the coordinates x and y of the
    vehicle, and the path's parameters, in the frame of P_l's foot.
    """
    distance, heading, curvature = ca.SX.sym("distance"), ca.SX.sym("heading"), ca.SX.sym("curvature")
    arm = ca.vertsplit(required_point(law.system).arm)
    ahead, left = (offset + own for offset, own in zip(body_offsets(law.config), arm, strict=True))
    x = -ahead * ca.cos(heading) + left * ca.sin(heading)
    y = distance - ahead * ca.sin(heading) - left * ca.cos(heading)
    there = ca.vertcat(x, y, *law.output.required_path.from_foot(distance, curvature))
    return ca.Function(
        "place", [symbols(law.config), law.system.mechanism.p, distance, heading, curvature], [there]
    )


class _DynamicsInC(_InC):
    """A robot's dynamics."""

    def __init__(self, system: ReducedSystem, scalar: str):
        super().__init__(system.mechanism.name, DYNAMICS, scalar)
        self.system = system

    @cached_property
    def groups(self) -> dict[str, ca.SX]:
        """All groups on which the dynamics depend."""
        mechanism = self.system.mechanism
        return {
            "params": mechanism.p,
            "state": symbols(self.system.state),
            "input": symbols(mechanism.inputs),
        }

    @cached_property
    def expressions(self) -> dict[str, ca.SX]:
        """The model's quantities (9) to (11)."""
        system = self.system
        quantities = {
            "qdot": system.qdot,
            "Mbar": system.Mbar,
            "bias": system.bias,
            "input_map": system.input_map,
        }
        return quantities | {"nudot": system.acceleration(self.groups["input"])}

    def samples(self, files: Mapping[str, str]) -> Iterator[Sample]:
        """Yield every entry point at random states."""
        library = DynamicsLibrary(self.system, self.scalar, files)
        for motion in _motions(self.system):
            values = (motion.params, motion.state, motion.tau)
            inputs = dict(zip(self.groups, map(self.held, values), strict=True))
            dynamics, right = CompiledDynamics(library, inputs["params"]), self.right(inputs)
            for entry in DYNAMICS_ENTRIES:
                outcome = dynamics.entry(entry, inputs["state"], inputs["input"])
                for name in entry.answers:
                    value = outcome.values.get(name)
                    shaped = None if value is None else value.reshape(right[name].shape)
                    yield Sample(f"{name} by {entry.name}", outcome.status, shaped, right[name], name, inputs)


class _FilterInC(_InC):
    """A robot's extended Kalman filter: a tick from a random estimate and covariance.

    The model estimates the errors of `turned` together with the states, with the full covariance and
    derivatives by CasADi.
    """

    def __init__(self, system: ReducedSystem, scaled: Sequence[str], scalar: str):
        super().__init__(system.mechanism.name, FILTER_NAME, scalar)
        self.system, self.scaled = system, tuple(scaled)
        self.states = ("x", "y", "heading", "bias", *(f"scale_{name}" for name in scaled))

    @cached_property
    def groups(self) -> dict[str, ca.SX]:
        """All groups on which a tick depends; of `q` the coordinates that are measured."""
        n, rates = len(self.states), [q.name for q in self.system.quasi_velocities]
        return {
            "params": self.system.mechanism.p,
            "noise": _symbols("noise", [*rates, "gyro", "bias_walk"]),
            "state": _symbols("state", self.states),
            "factors": _symbols("factors", [f"{i + 1}{j + 1}" for j in range(n) for i in range(j + 1)]),
            "q": self.system.mechanism.q,
            "sensed": _symbols("sensed", [*rates, "gyro", "dt"]),
        }

    @cached_property
    def expressions(self) -> dict[str, ca.SX]:
        """Estimate and variance of each state, and the correlations, after either tick."""
        return {
            f"{name} by {tick}": value
            for tick in TICKS
            for name, value in self._after(tick == WITH_GYRO.name).items()
        }

    def _after(self, by_gyro: bool) -> dict[str, ca.SX]:
        """Return the quantities after a tick."""
        groups, n, dof = self.groups, len(self.states), self.system.dof
        turned, gyro, dt = ca.vertsplit(groups["sensed"], [0, dof, dof + 1, dof + 2])
        noise, gyro_noise, walk = ca.vertsplit(groups["noise"], [0, dof, dof + 1, dof + 2])
        joint = ca.SX.sym("joint", n + dof)  # the states and the errors of `turned`
        moved = self._moved(joint, turned + joint[n:])
        P = ca.diagcat(_covariance(groups["factors"], n), ca.diag(noise**2 * ca.fabs(turned)))
        mean = ca.vertcat(groups["state"], ca.SX.zeros(dof))
        if by_gyro:
            seen = joint[3] * dt + moved[2]
            h = ca.substitute(ca.jacobian(seen, joint), joint, mean)
            K = P @ h.T / (h @ P @ h.T + gyro_noise**2 * dt)
            mean, P = mean + K * (gyro * dt - ca.substitute(seen, joint, mean)), P - K @ h @ P
        after = joint[:n] + ca.vertcat(moved, ca.SX.zeros(n - 3))
        F = ca.substitute(ca.jacobian(after, joint), joint, mean)
        P = F @ P @ F.T + ca.diag(ca.vertcat(0, 0, 0, walk**2 * dt, ca.SX.zeros(n - 4)))
        estimate, sd = ca.substitute(after, joint, mean), ca.sqrt(ca.diag(P))
        quantities = {name: estimate[k] for k, name in enumerate(self.states)}
        quantities |= {f"variance of {name}": P[k, k] for k, name in enumerate(self.states)}
        return quantities | {"correlations": P / (sd @ sd.T)}

    def _moved(self, joint: ca.SX, turned: ca.SX) -> ca.SX:
        """Return the change of the pose: its rate (6) at the heading in the middle of the tick."""
        mechanism, scales = (
            self.system.mechanism,
            dict(zip(self.scaled, ca.vertsplit(joint[4 : len(self.states)]), strict=False)),
        )
        factors = [scales.get(q.name, ca.SX(1)) for q in self.system.quasi_velocities]
        nominal = [p.symbol for p in mechanism.parameters]
        real = [scales.get(p.name, ca.SX(1)) * p.symbol for p in mechanism.parameters]
        vehicle = estimated_pose(self.system) or mechanism.required_vehicle
        rate = ca.jacobian(ca.vertcat(vehicle.x, vehicle.y, vehicle.heading), mechanism.q) @ self.system.S
        moved = ca.substitute([rate], nominal, real)[0] @ (ca.vertcat(*factors) * turned)
        turn = ca.substitute(moved[2], vehicle.heading, joint[2])
        return ca.substitute(moved, vehicle.heading, joint[2] + turn / 2)

    def samples(self, files: Mapping[str, str]) -> Iterator[Sample]:
        """Yield both ticks at random estimates."""
        library, random = (
            RobotPart(self.system, SCALARS[self.scalar], FILTER_NAME, files),
            np.random.default_rng(SEED),
        )
        n, dof, coordinates = len(self.states), self.system.dof, len(self.system.mechanism.coordinates)
        for motion in _motions(self.system):
            dt, q, nu = (
                10 ** random.uniform(-3, -1),
                motion.state[:coordinates],
                np.array(motion.state[coordinates:]),
            )
            state = [*random.uniform(-5, 5, 2), *random.uniform(-3, 3, 1), *random.uniform(-0.1, 0.1, 1)]
            factors = [
                random.uniform(-1, 1) if i < j else 10 ** random.uniform(-4, 0)
                for j in range(n)
                for i in range(j + 1)
            ]
            numbers = (
                motion.params,
                10 ** random.uniform(-3, -1, dof + 2),
                [*state, *random.uniform(0.9, 1.1, n - 4)],
                factors,
                q,
                [*(nu * dt), random.uniform(-1, 1), dt],
            )
            inputs = dict(zip(self.groups, map(self.held, numbers), strict=True))
            right = self.right(inputs)
            for tick in TICKS:
                status, values = self._tick(library, tick, inputs)
                for name, value in values.items():
                    shaped = np.reshape(value, right[name].shape) if status == "ok" else None
                    yield Sample(name, status, shaped, right[name], name, inputs)

    def _tick(self, library: RobotPart, tick: str, inputs: Mapping) -> tuple[str, dict[str, np.ndarray]]:
        """Return status and quantities after a tick of the C."""
        *noise, gyro_noise, walk = inputs["noise"]
        scale_sd = dict.fromkeys(self.scaled, 1.0)
        options = FilterOptions(
            noise=noise, gyro_noise=gyro_noise, bias_sd=1.0, bias_walk=walk, scale_sd=scale_sd
        )
        ours = Filter(self.system, inputs["params"], options, self.scalar, library)
        ours.place(inputs["state"], inputs["factors"])
        *turned, gyro, dt = inputs["sensed"]
        places = {q.name: k for k, q in enumerate(self.system.mechanism.coordinates)}
        measured = [
            inputs["q"][places[q.name]] for q in filter_program(self.system, self.scaled).motion.measured
        ]
        status = ours.tick(turned, dt, gyro if tick == WITH_GYRO.name else None, measured)
        P = ours.covariance
        values = {name: ours.state[k] for k, name in enumerate(self.states)}
        values |= {f"variance of {name}": P[k, k] for k, name in enumerate(self.states)}
        values["correlations"] = P / np.sqrt(np.outer(np.diag(P), np.diag(P)))
        return status, {f"{name} by {tick}": value for name, value in values.items()}


def _symbols(group: str, names: Iterable[str]) -> ca.SX:
    return ca.vertcat(*[ca.SX.sym(f"{group}.{name}") for name in names])


def _covariance(factors: ca.SX, n: int) -> ca.SX:
    """Return P = U D U' of the packed factors."""
    U, D, packed = ca.SX.eye(n), ca.SX.zeros(n), iter(ca.vertsplit(factors))
    for j in range(n):
        for i in range(j):
            U[i, j] = next(packed)
        D[j] = next(packed)
    return U @ ca.diag(D) @ U.T


@cache
def _motions(system: ReducedSystem) -> list:
    """Return the motions, created once for both scalars."""
    return list(random_motions(system, STATES, SEED))
