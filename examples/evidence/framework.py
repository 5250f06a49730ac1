"""Definition of a figure: SPECs to simulate, a function that draws the runs, and claims about them."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import matplotlib.figure
import numpy as np

from ...codegen.files import digests, law_program, law_text, shared_files
from ...codegen.printing.scalar import SCALARS
from ...codegen.runtime import runtime_files
from ...model.law import ControlLaw
from ...model.mechanism import Mechanism
from ...model.vehicle import velocity_map
from ...readers.errors import BadInput
from ...readers.robots import find_robot, system_of
from ...simulation.closed_loop import simulate
from ...simulation.contact import Grip, grip
from ...simulation.controllers.odometry import vehicle_wheels
from ...simulation.engine.measured import FloorMeasurements
from ...simulation.guidance import vehicle_motion
from ...simulation.run import Outputs, Run
from ...simulation.specification.spec import ContactSection, Spec
from ...simulation.specification.vary import read_varied

SPECS = Path(__file__).resolve().parents[1] / "specs" / "figures"
ROLLS, AGREES = 1e-11, 1e-8  # bounds of the claims made for every run
ON_FLOOR = 1e-3  # m, m/s: what halving the engine's step changes (docs/engine.md)


@dataclass(frozen=True)
class Case:
    """A run of a figure: a file of examples/specs/figures and the entries that differ from it, dotted key ->
    TOML value.

    `singular`: the start is expected to be rejected as singular, which is what the figure shows. `engine`:
    the robot is on a floor in this engine, as with `simulate`; otherwise it rolls.
    """

    file: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    singular: bool = False
    engine: str | None = None

    def spec(self) -> Spec:
        """The SPEC to run. Raises BadInput."""
        return read_varied(SPECS / self.file, self.changes)


@dataclass(frozen=True)
class Claim:
    """A statement, the measured value, and whether it holds.

    `paper`: the statement is the paper's; else it is this project's. `expected` is False for a statement of
    the paper that does not hold; `note` then explains why.
    """

    text: str
    measured: str
    holds: bool
    note: str = ""
    paper: bool = False
    expected: bool = True

    @property
    def as_expected(self) -> bool:
        """Whether the result is the expected one."""
        return self.holds == self.expected

    @property
    def verdict(self) -> str:
        """The result as text."""
        if not self.as_expected:
            return "holds, which was not expected" if self.holds else "FAILS"
        return "holds" if self.holds else "does not hold (as found here)"


@dataclass(frozen=True, eq=False)
class FigureRun(Outputs):
    """A run on the generated C as figures see it: every array of `Run` by its name (t, q, nu, tau, y, forces,
    seen, ...), SI, with `energy` (J) and `power` (W) of inputs and friction.

    `parameters` are the true robot's. `place` (N, 2) is P_l in the vehicle: ahead of the centre of mass and
    left of it, m. `slip` is the worst ||A qdot|| (2), `integral` the worst change (rad) of phi - c (theta_r -
    theta_l) (28), None where the robot has no two wheels whose angles are coordinates, `agreement` the
    largest difference from the run on CasADi in any state, input or output; `grip` what friction rolling
    needs. A run on a floor has `floor`, what was measured there; `slip`, `agreement` and `grip` are then
    nothing. A start that was refused has the reason in `refused`, no arrays and no contacts.
    """

    spec: Spec
    parameters: Mapping[str, float] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    grip: Grip = Grip(np.zeros(0), (), ContactSection())
    warnings: tuple[str, ...] = ()
    slip: float = 0.0
    integral: float | None = None
    agreement: float = 0.0
    floor: FloorMeasurements | None = None
    sources: Mapping[str, str] = field(default_factory=dict)  # file of C that ran -> SHA-256
    refused: str = ""

    def __getattr__(self, name: str) -> np.ndarray:
        try:
            return self.__dict__["arrays"][name]
        except KeyError:
            raise AttributeError(f"a run has no array {name!r}") from None

    @property
    def robot(self) -> Mechanism:
        """What ran."""
        return find_robot(self.spec.robot)

    @property
    def plant(self) -> np.ndarray:
        """The true robot's parameters in the order of `robot.parameters`."""
        return np.array([self.parameters[p.name] for p in self.robot.parameters])

    @cached_property
    def motion(self) -> np.ndarray:
        """Place (m), heading (rad), forward speed (m/s) and yaw rate (rad/s) of the vehicle, (N, 5)."""
        return vehicle_motion(system_of(self.robot))(np.hstack([self.q, self.nu]).T, self.plant).full().T

    @cached_property
    def ahead(self) -> float:
        """How far the vehicle's point is ahead of the axle, m."""
        return vehicle_wheels(system_of(self.robot), self.plant)[2]

    @property
    def slipping(self) -> float:
        """Largest slip of a wheel on a floor, m/s; 0 where it rolls."""
        return 0.0 if self.floor is None else float(self.floor.slip.max())

    @property
    def exact(self) -> float:
        """What a length (m) or a speed (m/s) of this run may be off:
        on a floor as docs/engine.md states, else nothing."""
        return 0.0 if self.floor is None else ON_FLOOR

    @property
    def point(self) -> np.ndarray:
        """The vehicle's point, m, (N, 2)."""
        return self.motion[:, :2]

    @property
    def heading(self) -> np.ndarray:
        """phi, rad, (N,)."""
        return self.motion[:, 2]

    @property
    def forward(self) -> np.ndarray:
        """Unit vector along the heading, (N, 2)."""
        return np.column_stack([np.cos(self.heading), np.sin(self.heading)])

    @property
    def leftward(self) -> np.ndarray:
        """Unit vector to the left of the heading, (N, 2)."""
        return self.forward[:, ::-1] * (-1.0, 1.0)

    @property
    def P_o(self) -> np.ndarray:
        """Middle of the axle, m, (N, 2)."""
        return self.point - self.ahead * self.forward

    @property
    def P_l(self) -> np.ndarray:
        """Reference point, m, (N, 2)."""
        ahead, left = self.place.T
        return self.point + ahead[:, None] * self.forward + left[:, None] * self.leftward

    @property
    def speed(self) -> np.ndarray:
        """Forward speed of P_o, m/s, (N,)."""
        return self.motion[:, 3]

    @property
    def yaw_rate(self) -> np.ndarray:
        """Rate of the heading, rad/s, (N,)."""
        return self.motion[:, 4]

    @property
    def velocity(self) -> np.ndarray:
        """Velocity of P_l, m/s, (N, 2)."""
        ahead, left = self.place.T
        along = self.speed - left * self.yaw_rate
        across = (self.ahead + ahead) * self.yaw_rate
        return along[:, None] * self.forward + across[:, None] * self.leftward


Runs = Mapping[str, FigureRun]


@dataclass(frozen=True)
class Figure:
    """A figure of the report.

    `paper` says in our words what the paper shows or states, or why the figure is there; `assumed` what
    stands in for what the scan lost. `cases` are the runs by label; `draw` and `claims` get their outcomes
    under the same labels.
    """

    name: str
    title: str
    paper: str
    assumed: str
    cases: Mapping[str, Case]
    draw: Callable[[Runs], matplotlib.figure.Figure]
    claims: Callable[[Runs], list[Claim]]

    @property
    def engine(self) -> bool:
        """Whether it has runs in the physics engine, which is optional."""
        return any(case.engine for case in self.cases.values())

    def all_claims(self, runs: Runs) -> list[Claim]:
        """Its own, then those made for every run."""
        return [*self.claims(runs), *claims_of_every_run(runs)]


def carry_out(spec: Spec, singular: bool = False, engine: str | None = None) -> FigureRun:
    """Run a SPEC on the generated C and, without an `engine`, on CasADi. Raises BadInput unless a `singular`
    start is refused by both.
    """
    try:
        run = simulate(spec, "c", engine=engine)
    except BadInput as error:
        if not (singular and "singular" in str(error)):
            raise
        return FigureRun(spec, refused=_refusal(spec, "casadi") and str(error))
    arrays = {
        f.name: getattr(run, f.name)
        for f in dataclasses.fields(run)
        if isinstance(getattr(run, f.name), np.ndarray)
    }
    entries = [c.name for c in run.law.config]
    none = np.zeros(len(run.t))
    arrays["place"] = np.column_stack(
        [run.config[:, entries.index(n)] if n in entries else none for n in ("L", "W")]
    )
    names = [p.name for p in run.law.parameters]
    parameters = dict(zip(names, map(float, run.plant.parameters), strict=True))
    arrays |= {"energy": run.plant.energy(run.x), "power": run.plant.power(run.x, run.tau)}
    if run.floor:
        return FigureRun(
            spec, parameters, arrays, warnings=run.warnings, sources=sources_of(run.law), floor=run.floor
        )
    going = slice(None, -1) if run.stopped else slice(None)  # where it stopped, rates are without bound
    return FigureRun(
        spec=spec,
        parameters=parameters,
        arrays=arrays,
        grip=grip(run),
        warnings=run.warnings,
        slip=float(np.linalg.norm(run.plant.slip(run.x[going]), axis=1).max()),
        integral=_integral(run),
        agreement=_difference(run, simulate(spec, "casadi")),
        sources=sources_of(run.law),
    )


def claims_of_every_run(runs: Runs) -> list[Claim]:
    """Return the claims of every run that rolls: constraints hold, including the integral, and the generated
    C agrees with the model.
    """
    done = [run for run in runs.values() if not run.refused and run.floor is None]
    if not done and any(run.floor for run in runs.values()):
        return []
    slip, agreement = (
        max((getattr(run, name) for run in done), default=0.0) for name in ("slip", "agreement")
    )
    integrals = [run.integral for run in done if run.integral is not None]
    integral = max(integrals, default=0.0)
    return [
        Claim(f"rolling in every run: ‖A q̇‖ ≤ {ROLLS:g}", f"{slip:.1e}", slip <= ROLLS),
        *[
            Claim(
                f"φ − c(θ_r − θ_l) constant in every run, to {ROLLS:g} rad",
                f"{integral:.1e} rad",
                integral <= ROLLS,
            )
        ]
        * bool(integrals or not done),
        Claim(
            f"generated C and CasADi agree in every run, to {AGREES:g} in every state, torque and "
            "output (SI)",
            f"{agreement:.1e}",
            agreement <= AGREES,
        ),
    ]


@lru_cache(maxsize=16)
def sources_of(law: ControlLaw) -> dict[str, str]:
    """SHA-256 of every file of the double-precision C that a run of this law is made of."""
    double = SCALARS["double"]
    return digests(
        {**runtime_files(), **shared_files(law.system, double), **law_text(law_program(law), double).files()}
    )


def _integral(run: Run) -> float | None:
    """The worst change of the heading less what two wheels' angles say, phi - c (theta_r - theta_l);
    None without these."""
    system = run.law.system
    rates = system.mechanism.quasi_velocity_rows
    if velocity_map(system) is None or rates is None or not rates.is_constant():
        return None
    _, turn, _ = vehicle_wheels(system, run.plant.parameters)
    heading = vehicle_motion(system)(run.x.T, run.plant.parameters).full()[2]
    drift = heading - run.q @ (turn @ ca.DM(rates).full())
    return float(np.abs(drift - drift[0]).max()) if turn.all() else None


def _refusal(spec: Spec, backend: str) -> str:
    """Why the backend refuses the start, empty when it runs."""
    try:
        simulate(spec, backend)
    except BadInput as error:
        return str(error)
    return ""


def _difference(run: Run, other: Run) -> float:
    """Largest difference of two runs in any state, input or output; infinite when they ended differently."""
    if run.stopped != other.stopped or len(run.t) != len(other.t):
        return float("inf")
    rows = slice(None, -1) if run.stopped else slice(None)  # where it stopped depends on the last bits
    return float(
        max(
            np.abs(getattr(run, name)[rows] - getattr(other, name)[rows]).max()
            for name in ("q", "nu", "tau", "y")
        )
    )
