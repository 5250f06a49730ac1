"""What a log of the dynamics contains, as functions of the state: inputs of motors, and outputs."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import mpmath
import numpy as np

from ...model.mechanism import Quantity
from ...model.reduction import ReducedSystem
from ...model.vehicle import body_pose
from ...readers.errors import BadInput
from ..exact.extended import DIGITS, evaluate
from .bounds import Triangle, triangles
from .identifiability import RANGE, Combination, determined, generic_rank
from .motors import REQUIRED, check_names, logged_inputs, motor_quantities, torques, used_quantities

GYRO = "gyro"


def pose_names(system: ReducedSystem) -> tuple[str, str, str]:
    """Return the coordinates by which the vehicle's x, y and heading are displaced. Raises BadInput if there
    are none."""
    pose = body_pose(system)
    if pose is None:
        raise BadInput(
            f"{system.mechanism.name} is no vehicle with a pose of three coordinates, or of several"
        )
    return pose[0].name, pose[1].name, pose[2].name


def described(system: ReducedSystem) -> tuple[Quantity, ...]:
    """Return all parameters that can be set or fitted: those of the robot, of its motors, of the gyro. The
    robot's replace others of the same name.
    """
    own, bias = {p.name for p in system.mechanism.parameters}, bias_of_gyro()
    return (*system.mechanism.parameters, *motor_quantities(system), *([] if bias.name in own else [bias]))


def bias_of_gyro() -> Quantity:
    """Return the parameter by which a gyro is off."""
    return Quantity(
        f"bias_{GYRO}", "rad/s", "what the gyro reports at rest", symbol=ca.SX.sym(f"bias_{GYRO}")
    )


@dataclass(frozen=True, eq=False)
class Dynamics:
    """A robot with its motors and sensors. `kind` of KINDS: that of the logged inputs; `quantities`: all
    parameters, the robot's first; `inputs`: what is logged of each input; `torque` (r x 1): the robot's
    inputs that follow; `outputs`: measured ones, `measured` (ny x 1) as expressions.
    """

    system: ReducedSystem
    kind: str
    quantities: tuple[Quantity, ...]
    inputs: tuple[Quantity, ...]
    torque: ca.SX
    outputs: tuple[Quantity, ...]
    measured: ca.SX

    @classmethod
    def of(
        cls,
        system: ReducedSystem,
        kind: str = "torque",
        outputs: Sequence[str] | None = None,
        own: Collection[str] = (),
    ) -> "Dynamics":
        """Return the dynamics with inputs of a kind of KINDS. `outputs`: names of quasi-velocities,
        coordinates or "gyro", the rate of the vehicle's heading; None: the quasi-velocities. `own`:
        parameters of single motors that are used, NAME_INPUT; the others are those of all motors.

        Raises BadInput if the outputs do not determine the quasi-velocities, or a parameter of the robot has
        the name of one of the motors or the gyro that are used.
        """
        mechanism = system.mechanism
        check_names(system, kind)
        motors, bias = used_quantities(system, own), bias_of_gyro()
        named_so = any(p.name == bias.name for p in mechanism.parameters)
        logged = logged_inputs(system, kind)
        expressions = {q.name: (q, q.symbol) for q in system.state}
        if GYRO in (outputs or ()):
            if named_so:
                raise BadInput(
                    f"{mechanism.name}: {bias.name} is also the name of the gyro's parameter; rename the "
                    "robot's"
                )
            gyro = Quantity(GYRO, "rad/s", "rate of the heading", symbol=ca.SX.sym(GYRO))
            expressions[GYRO] = (gyro, system.qdot[_place(system, pose_names(system)[2])] + bias.symbol)
        names = [q.name for q in system.quasi_velocities] if outputs is None else outputs
        chosen = [expressions[name] for name in names]
        dynamics = cls(
            system,
            kind,
            (*mechanism.parameters, *motors, *([] if named_so else [bias])),
            logged,
            torques(system, kind, logged, motors),
            tuple(q for q, _ in chosen),
            ca.vertcat(*[expression for _, expression in chosen]),
        )
        dynamics._check_outputs()
        return dynamics

    @property
    def parameters(self) -> ca.SX:
        """All parameters, as a column."""
        return ca.vertcat(*[q.symbol for q in self.quantities])

    @property
    def robot(self) -> set[str]:
        """Names of the robot's own parameters."""
        return {p.name for p in self.system.mechanism.parameters}

    @property
    def logged(self) -> ca.SX:
        """The logged inputs, as a column."""
        return ca.vertcat(*[q.symbol for q in self.inputs])

    @property
    def state(self) -> ca.SX:
        """[q; nu] as a column."""
        return ca.vertcat(*[q.symbol for q in self.system.state])

    def values(self, given: Mapping[str, float]) -> np.ndarray:
        """Return the value of every parameter: the given one, for a single motor that of all motors,
        or its default."""
        known = {q.name: given.get(q.name, q.default) for q in self.quantities}
        motors = [name for name in known if name not in self.robot]
        shared = {f"{name}_{each.name}": name for each in self.system.mechanism.inputs for name in motors}
        return np.array(
            [given.get(name, known.get(shared.get(name, ""), value)) for name, value in known.items()]
        )

    def check(self, fitted: Sequence[str], given: Mapping[str, float]) -> None:
        """Raise BadInput if a motor's parameter that is needed is neither fitted nor given, one exceeds its
        largest value, or inertias are those of no body.
        """
        values = dict(zip((q.name for q in self.quantities), self.values(given).tolist(), strict=True))
        for each in self.triangles:
            inertias = dict.fromkeys((each.inertia, *each.others))
            if not inertias.keys() & set(fitted) and not each.holds(values):
                named = ", ".join(f"{name} = {values[name]:g}" for name in inertias)
                raise BadInput(f"no body has the inertias {named}: {each} must hold")
        for name, most in self.upper.items():
            if given.get(name, most) > most:
                raise BadInput(f"{name} = {given[name]:g} must be at most {most:g}")
        for name in fitted:
            if name.startswith("moving") and name not in self.robot:
                raise BadInput(f"--fit {name}: a log does not show it; give it with --set")
        for name in REQUIRED[self.kind]:
            single = {f"{name}_{each.name}" for each in self.system.mechanism.inputs}
            known = {*fitted, *given}
            if name not in known and not single <= known:
                raise BadInput(
                    f"the log has the {self.kind} of each input: give --set {name}=VALUE, or fit it, --fit "
                    f"{name}"
                )

    @property
    def upper(self) -> dict[str, float]:
        """The largest values of parameters: efficiencies do not exceed 1."""
        starts = ("efficiency", "back_efficiency")
        return {
            q.name: 1.0 for q in self.quantities if q.name.startswith(starts) and q.name not in self.robot
        }

    @property
    def triangles(self) -> tuple[Triangle, ...]:
        """What limits the inertias of the robot's bodies."""
        return triangles(self.system.mechanism)

    @cached_property
    def rates(self) -> ca.SX:
        """Derivatives by time of the outputs that are coordinates, and the other outputs themselves,
        ny x 1, in the state."""
        n = len(self.system.mechanism.coordinates)
        places = {q.name: k for k, q in enumerate(self.system.state)}
        rows = (
            self.system.qdot[places[q.name]] if places.get(q.name, n) < n else self.measured[k]
            for k, q in enumerate(self.outputs)
        )
        return ca.vertcat(*rows)

    @cached_property
    def direct(self) -> list[int]:
        """The outputs that are or become by differentiation linear in the quasi-velocities without any
        parameter."""
        jacobian = ca.jacobian(self.rates, self.system.nu)
        return [
            k
            for k in range(len(self.outputs))
            if not ca.depends_on(jacobian[k, :], self.parameters) and jacobian[k, :].nnz()
        ]

    def velocities_in(self, state: Collection[str]) -> list[str]:
        """Return the column that each quasi-velocity comes from, of a log with these columns of the state:
        its own, or the angle whose rate it is.
        """
        coordinates = self.system.mechanism.coordinates
        angles = ([coordinates[k].name for k in places] for places in self.system.coordinates_by_velocity)
        columns = ([q.name, *each] for q, each in zip(self.system.quasi_velocities, angles, strict=True))
        return [next((name for name in names if name in state), names[0]) for names in columns]

    @cached_property
    def start_places(self) -> list[int]:
        """The entries of the state that the start of a window leaves unknown:
        measured coordinates and quasi-velocities."""
        n = len(self.system.mechanism.coordinates)
        names = {q.name for q in self.outputs}
        return [k for k, q in enumerate(self.system.state) if k >= n or q.name in names]

    @cached_property
    def coordinates_needed(self) -> list[str]:
        """The coordinates on which the dynamics or the rates of the outputs depend."""
        system = self.system
        read = ca.veccat(system.Mbar, system.bias, system.input_map, self.torque, self.rates)
        return [q.name for q in system.mechanism.coordinates if ca.depends_on(read, q.symbol)]

    def _check_outputs(self) -> None:
        if generic_rank(ca.jacobian(self.rates, self.system.nu)[self.direct, :]) < self.system.dof:
            names, velocities = (
                ", ".join(q.name for q in each) for each in (self.outputs, self.system.quasi_velocities)
            )
            raise BadInput(
                f"outputs {names} do not determine the quasi-velocities {velocities} of "
                f"{self.system.mechanism.name} whatever its parameters; log these, or the angles of wheels "
                "and joints whose rates they are"
            )


def combinations(dynamics: Dynamics, names: Sequence[str], values: Sequence[float]) -> list[Combination]:
    """Return a basis of what the equations of motion S'MS nudot + bias - S'E tau (10), and the rates of the
    measured coordinates, determine of the named parameters near `values` (all parameters).

    As `determined`, at random states and inputs with the nudot that follows: an equation that holds for other
    parameters after multiplication by a factor tells nothing, so that of torque constant and masses only the
    ratios are seen.
    """
    system, nudot = dynamics.system, ca.SX.sym("nudot", dynamics.system.dof)
    forces = system.input_map @ dynamics.torque - system.bias
    free = [*ca.vertsplit(dynamics.state), *ca.vertsplit(dynamics.logged)]
    parameters = {q.name: q.symbol for q in dynamics.quantities}
    symbols, dof = [*free, *parameters.values()], system.dof

    def point(random: np.random.Generator) -> list[float | mpmath.mpf]:
        drawn = random.uniform(*RANGE, len(free)).tolist()
        entries = evaluate(ca.densify(ca.horzcat(system.Mbar, forces)), symbols, [*drawn, *values])
        with mpmath.workdps(DIGITS):
            mass = mpmath.matrix([entries[k : dof * dof : dof] for k in range(dof)])
            return [*drawn, *mpmath.lu_solve(mass, mpmath.matrix(entries[dof * dof :]))]

    observed = ca.vertcat(system.Mbar @ nudot - forces, dynamics.rates)
    return determined(observed, [*free, *ca.vertsplit(nudot)], parameters, names, values, point)


def usual_outputs(system: ReducedSystem, columns: Collection[str]) -> list[str] | None:
    """Return the quasi-velocities that a log with these columns has, and if it has not all of them, also the
    coordinates whose rates are quasi-velocities or fixed functions of them; None if there are none.
    """
    names = [q.name for q in system.quasi_velocities if q.name in columns]
    if len(names) < system.dof:
        parameters = system.mechanism.p
        for k, q in enumerate(system.mechanism.coordinates):
            if q.name in columns and not ca.depends_on(system.qdot[k], parameters):
                names.append(q.name)
    return names or None


def _place(system: ReducedSystem, name: str) -> int:
    return [q.name for q in system.state].index(name)
