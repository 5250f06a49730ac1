"""A robot in MuJoCo between two calls of its controller: what its physics,
be they of our floor or of a scene, have in common."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...model.algebra.direct import Direct
from ...model.algebra.portable import portable
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput, library
from ..contact import GRAVITY
from ..integrate import Refused
from ..plant import Plant
from ..specification.floor import Floor
from .frames import PlanarBodies
from .friction import coulomb
from .measured import Standing

if TYPE_CHECKING:
    from ..drive import Drive

FASTEST = 1e5  # m/s, rad/s
OVERTURNED = 1.0  # rad: ramps and bumps that wheels can climb lean a robot by less
UPRIGHT = np.cos(OVERTURNED)


class Stepped:
    """A plant that MuJoCo moves, in steps of at most `floor.step`, on a floor with that slope."""

    mu: float  # friction coefficient of the floor outside its patches
    _standing: list[int]  # bodies of MuJoCo that stand by themselves
    _up = np.array([0.0, 0.0, 1.0])  # in their axes, where they stand upright

    def __init__(self, plant: Plant, bodies: PlanarBodies, model: Any, floor: Floor):
        self._mujoco = installed()
        self.planar, self.model, self.data = bodies, model, self._mujoco.MjData(model)
        system = plant.system
        self._functions = {name: Direct(function) for name, function in _functions(system).items()}
        self._parameters, self._n, self._longest = (
            plant.parameters,
            len(system.mechanism.coordinates),
            floor.step,
        )
        self._floor = floor
        self._rates = np.linalg.inv(bodies.joints)  # of the coordinates, by those of the joints
        self._headings = np.array([bodies.frames[wheel.frame].heading for wheel in bodies.wheels])
        self._turned = np.array([wheel.turned for wheel in bodies.wheels])
        angle, heading = floor.slope
        model.opt.gravity = GRAVITY * np.array(
            [np.sin(angle) * np.cos(heading), np.sin(angle) * np.sin(heading), -np.cos(angle)]
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the wheels whose slip is measured: of the contacts,
        or of each wheel of a contact that stands for several."""
        return tuple(wheel.name for wheel in self.planar.wheels)

    @property
    def castors(self) -> tuple[str, ...]:
        """Names of what carries load without friction, as far as it is measured."""
        return ()

    @property
    def standing(self) -> Standing | None:
        """How the robot stands at rest, where the engine's bodies are those of the Mechanism."""
        return None

    def carried(self) -> np.ndarray:
        """Return the load of each of `castors`, N."""
        return np.zeros(0)

    def on_contacts(self, force: np.ndarray) -> np.ndarray:
        """Return the forces on each contact, (N, 2 c), of those on each of `names`."""
        return force

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Return q and qdot of the Mechanism."""
        raise NotImplementedError

    def look(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return for each of `names` slip (m/s), load (N), friction use, and the level force of the ground
        along and across in turn (N).
        """
        raise NotImplementedError

    def _directions(self, q: np.ndarray) -> np.ndarray:
        """Return the direction in which each wheel rolls, rad from the x axis."""
        return self._headings @ q + self._turned

    def _push_on(self, tau: np.ndarray) -> None:
        """Apply the inputs and what else acts during a step, whose positions MuJoCo knows."""
        raise NotImplementedError

    def _rub(
        self,
        J: np.ndarray,
        load: np.ndarray,
        mu: np.ndarray,
        creep: float,
        constrained: bool,
        ties: np.ndarray | None = None,
    ) -> np.ndarray:
        """Add to the applied forces the friction of this step at contacts with these loads (c,), N, whose
        velocities in the plane that they touch are J (2 c, nv) times those of the joints; return it, (2 c,),
        N.

        `constrained`: other forces of MuJoCo's constraints act in these directions too, such as those of
        bumps, or of `ties`, which keep these combinations (k, nv) of the velocities zero.
        """
        self._mujoco.mj_fwdAcceleration(self.model, self.data)
        without = self.data.qacc_smooth
        if constrained:
            self._mujoco.mj_fwdConstraint(self.model, self.data)
            without = self.data.qacc
        h, moved = self.model.opt.timestep, np.empty_like(J)
        self._mujoco.mj_solveM(self.model, self.data, moved, J)
        if ties is not None and len(ties):
            held = np.empty_like(ties)
            self._mujoco.mj_solveM(self.model, self.data, held, ties)
            moved -= np.linalg.solve(ties @ held.T, held @ J.T).T @ held
        force = coulomb(h * (J @ moved.T), J @ (self.data.qvel + h * without), load, mu, creep)
        self.data.qfrc_applied += J.T @ force
        return force

    def _weigh(self) -> None:
        """Note what the floor and motors did in the last step."""

    def _overturned(self) -> bool:
        """Return whether a body that stands by itself leans by more than OVERTURNED."""
        return bool((self.data.xmat[self._standing, 6:] @ self._up < UPRIGHT).any())

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know of the run so far."""
        return ()

    def state(self) -> np.ndarray:
        """Return [q; nu]: nu as the wheels' rates tell it, which the robot's motion need not."""
        q, qdot = self.coordinates()
        return np.concatenate([q, self._functions["nu"](q, qdot, self._parameters)[0]])

    def pushed(self, x: np.ndarray, impulse: np.ndarray) -> np.ndarray:
        """Return the state after an impulse (n-m) along the quasi-velocities, N s or N m s, from x, the state
        now: all velocities change as those of the robot that rolls, whatever the friction.
        """
        raise NotImplementedError

    def hold(
        self, t: float, x: np.ndarray, given: np.ndarray, duration: float, drive: Drive | None = None
    ) -> np.ndarray:
        """Return the state after `duration` seconds from x at time t, the state now, with the inputs (N, N m)
        `given`, or those that drives supply for what is given to them, at each step of the engine.

        Raises Refused, at time t: "range" where a velocity grows beyond FASTEST, as with wheels that spin
        without bound, "overturned" where a body that stands by itself falls over.
        """
        before = self.data.qpos.copy(), self.data.qvel.copy()
        steps = int(np.ceil(duration / self._longest - 1e-9))
        if not steps:
            return x
        self.model.opt.timestep = duration / steps
        overturned = False
        for _ in range(steps):
            self._mujoco.mj_step1(self.model, self.data)
            self._push_on(drive.torque(self.state(), given) if drive and drive.commands else given)
            self._mujoco.mj_step2(self.model, self.data)
            self._weigh()
            if overturned := self._overturned():
                break
        if overturned or not np.abs(self.data.qvel).max() < FASTEST:  # also when it is NaN
            self.data.qpos[:], self.data.qvel[:] = before
            raise Refused("overturned" if overturned else "range", t, x)
        return self.state()


def installed() -> Any:
    """Return MuJoCo. Raises BadInput if it is missing."""
    mujoco = library("mujoco", "--engine mujoco: MuJoCo is not installed", "physics")
    # What it warns of ends the run with a status; it would write a file as well
    mujoco.set_mju_user_warning(lambda _: None)
    return mujoco


@lru_cache(maxsize=16)
def _functions(system: ReducedSystem) -> dict[str, ca.Function]:
    """Of q, qdot, p: velocities of the contacts, quasi-velocities; of the inputs besides: forces on the
    coordinates; of [q; nu]: qdot; of q: S'MS.
    """
    mechanism = system.mechanism
    q, qdot, p, tau = mechanism.q, mechanism.qdot, mechanism.p, ca.SX.sym("tau", len(mechanism.inputs))
    resting = ca.substitute(mechanism.energy(), qdot, ca.SX.zeros(len(mechanism.coordinates)))
    force = mechanism.E @ tau - ca.gradient(resting, q)
    for value, velocity in mechanism.forces:
        force += ca.jacobian(velocity, qdot).T * value
    rows = mechanism.quasi_velocity_rows
    S = system.S
    nu = rows @ qdot if rows is not None else ca.solve(S.T @ S, S.T @ qdot)
    made = {
        "slip": ([q, qdot, p], mechanism.contact_rows @ qdot),
        "nu": ([q, qdot, p], nu),
        "force": ([q, qdot, tau, p], force),
        "qdot": ([ca.vertcat(q, system.nu), p], system.qdot),
        "mass": ([q, p], S.T @ mechanism.M @ S),
    }
    return {
        name: portable(ca.Function(name, given, [ca.densify(value)])) for name, (given, value) in made.items()
    }


def refuse_in_scene(where: str, name: str, bodies: PlanarBodies) -> None:
    """Raise BadInput for a robot that no scene can have. `where` is what asks for it, for the message."""
    if bodies.leaning:
        raise BadInput(
            f"{where}: {name} leans, and scenes are for robots that stand by themselves; leave it out"
        )
    if bodies.normal != 1.0:
        raise BadInput(
            f"{where}: {name} is on a slope of its own; use a robot on level ground, and [floor] slope"
        )
    if any(wheel.rollers or wheel.turned for wheel in bodies.wheels):
        raise BadInput(f"{where}: does not go with wheels that have rollers or are turned, as {name} has")


def on_joints(plant: Plant, bodies: PlanarBodies) -> np.ndarray:
    """Return the force on each of `PlanarBodies.joints` for each input, (n, r): N or N m for each unit of it.

    Raises BadInput for inputs that do not act on hinges and axles alone.
    """
    mechanism = plant.system.mechanism
    E = ca.Function("E", [mechanism.q, mechanism.p], [ca.densify(mechanism.E)])
    random = np.random.default_rng(1992)
    n = len(mechanism.coordinates)
    found = [
        np.linalg.inv(bodies.joints).T @ E(random.uniform(-3, 3, n), plant.parameters).full()
        for _ in range(3)
    ]
    forces = np.round(found[0], 12)
    for name, column, spread in zip(mechanism.inputs, forces.T, np.ptp(found, axis=0).T, strict=True):
        if np.abs(column[:3]).max() > 0 or spread.max() > 1e-9:
            raise BadInput(
                f"{mechanism.name}: its input {name.name} does not act on a joint, which a scene requires"
            )
    return forces
