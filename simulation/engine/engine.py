"""A robot on a floor in MuJoCo: what moves it between two calls of its controller, and what is measured there."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ...controllers.direct import Direct
from ...model.algebra.portable import portable
from ...model.reduction import ReducedSystem
from ...readers.errors import BadInput
from ..contact import GRAVITY
from ..integrate import Refused
from ..plant import Plant
from ..specification.spec import ContactSection, Floor
from .frames import planar
from .friction import LEAST, coulomb
from .mjcf import mjcf

STEP = 1e-3  # s, the longest; half of it changes a path by less than 1 mm where no wheel chatters
SETTLED, LONGEST = 1e-9, 4000  # m/s, rad/s: the robot stands still; steps until it must
FASTEST = 1e5  # m/s, rad/s


class FloorEngine:
    """A plant on a floor. Starts at [q; nu] = `start`, rolling, settled on its contacts.

    MuJoCo has the bodies and the loads. Friction is Coulomb's law with the loads of the step before: MuJoCo's cones couple slip
    and load and lift a wheel that begins to slide, the more the lighter it is.
    """

    def __init__(self, plant: Plant, contact: ContactSection, floor: Floor, start: np.ndarray, step: float = STEP):
        """Raises BadInput if MuJoCo is missing, or if the robot is not made of bodies and wheels in the plane."""
        self._mujoco = _mujoco()
        system = plant.system
        self.planar = planar(system.mechanism, plant.parameters)
        self.xml = mjcf(system.mechanism.name, self.planar, contact.height, contact.share)
        self.model = self._mujoco.MjModel.from_xml_string(self.xml)
        self.data = self._mujoco.MjData(self.model)
        self._functions = {name: Direct(function) for name, function in _functions(system).items()}
        self._parameters, self._n, self._longest = plant.parameters, len(system.mechanism.coordinates), step
        self._floor, self.mu = floor, contact.mu if floor.mu is None else floor.mu
        wheels = self.planar.wheels
        self.moving = self._dofs(self._joint_names())
        self._free = self._dofs([f"axle_{k}" for k, wheel in enumerate(wheels) if wheel.angle is None])
        self._geoms = [self.model.geom(f"wheel_{k}").id for k in range(len(wheels))]
        self._bodies = self.model.geom_bodyid[self._geoms]
        self._radii = [abs(wheel.radius) for wheel in wheels]
        self._load, self._limit, self._friction = np.zeros(len(wheels)), np.ones(len(wheels)), np.zeros(2 * len(wheels))
        self._jacobian, self._slot = np.zeros((2 * len(wheels), self.model.nv)), np.zeros((3, self.model.nv))
        self._rates = np.linalg.inv(self.planar.joints)  # of the coordinates, by those of the joints
        self._headings = np.array([self.planar.frames[wheel.frame].heading for wheel in wheels])
        angle, heading = floor.slope
        self.model.opt.gravity = GRAVITY * np.array(
            [np.sin(angle) * np.cos(heading), np.sin(angle) * np.sin(heading), -np.cos(angle)]
        )
        self._settle(start)

    def _joint_names(self) -> list[str]:
        axles = [f"axle_{k}" for k, wheel in enumerate(self.planar.wheels) if wheel.angle is not None]
        return ["x", "y", *[f"yaw_{k}" for k in range(len(self.planar.frames))], *axles]

    def _dofs(self, names: list[str]) -> np.ndarray:
        return np.array([self.model.joint(name).dofadr[0] for name in names], int)

    def state(self) -> np.ndarray:
        """Return [q; nu]: nu as the wheels' rates tell it, which the robot's motion need not."""
        q, qdot = self.coordinates()
        return np.concatenate([q, self._functions["nu"](q, qdot, self._parameters)[0]])

    def hold(self, t: float, x: np.ndarray, tau: np.ndarray, duration: float) -> np.ndarray:
        """Return the state after `duration` seconds of constant inputs (N, N m) from x at time t, the state now.

        Raises Refused ("range") where a velocity grows beyond FASTEST, as with wheels that spin without bound.
        """
        before = self.data.qpos.copy(), self.data.qvel.copy()
        steps = int(np.ceil(duration / self._longest - 1e-9))
        if not steps:
            return x
        self.model.opt.timestep = duration / steps
        for _ in range(steps):
            self._mujoco.mj_step1(self.model, self.data)
            force = self._functions["force"](*self.coordinates(), tau, self._parameters)[0]
            self.data.qfrc_applied[:] = 0.0
            self.data.qfrc_applied[self.moving] = self._rates.T @ force
            self._rub()
            self._mujoco.mj_step2(self.model, self.data)
            self._weigh()
        if not np.abs(self.data.qvel).max() < FASTEST:  # also when it is NaN
            self.data.qpos[:], self.data.qvel[:] = before
            raise Refused("range", t, x)
        return self.state()

    def look(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return for each contact slip (m/s), load (N), friction use, and force along and across in turn (N)."""
        q, qdot = self.coordinates()
        slip = np.hypot(*self._functions["slip"](q, qdot, self._parameters)[0].reshape(-1, 2).T)
        c, s = np.cos(self._headings @ q), np.sin(self._headings @ q)
        x, y = self._friction.reshape(-1, 2).T
        use = np.hypot(x, y) / self._limit
        return slip, self._load.copy(), use, np.column_stack([c * x + s * y, c * y - s * x]).ravel()

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Return q and qdot of the Mechanism."""
        return self._rates @ self.data.qpos[self.moving], self._rates @ self.data.qvel[self.moving]

    def _weigh(self) -> None:
        """Note the load of each wheel."""
        self._load[:] = 0.0
        contacts = self.data.contact
        for other, address in zip(contacts.geom.max(axis=1), contacts.efc_address, strict=True):  # the floor is the first geom
            if other in self._geoms and address >= 0:
                self._load[self._geoms.index(other)] = self.data.efc_force[address]

    def _rub(self) -> None:
        """Add the friction of this step to the applied forces.

        A wheel touches the floor at its radius below its centre, and what it gives way under its load does not count.
        """
        self._mujoco.mj_fwdAcceleration(self.model, self.data)
        h = self.model.opt.timestep
        J = self._jacobian
        for k, geom in enumerate(self._geoms):
            point = self.data.geom_xpos[geom] - (0.0, 0.0, self._radii[k])
            self._mujoco.mj_jac(self.model, self.data, self._slot, None, point, self._bodies[k])
            J[2 * k : 2 * k + 2] = self._slot[:2]
        moved = np.empty_like(J)
        self._mujoco.mj_solveM(self.model, self.data, moved, J)
        free = J @ (self.data.qvel + h * self.data.qacc_smooth)
        mu = self._mu()
        self._friction = coulomb(h * (J @ moved.T), free, self._load, mu)
        self._limit = np.maximum(mu * self._load, np.hypot(*self._friction.reshape(-1, 2).T)) + LEAST
        self.data.qfrc_applied += J.T @ self._friction

    def _mu(self) -> np.ndarray:
        """Return the friction coefficient under each wheel."""
        mu = np.full(len(self._geoms), self.mu)
        for k, geom in enumerate(self._geoms if self._floor.patch else ()):
            x, y, _ = self.data.geom_xpos[geom]
            for patch in self._floor.patch:
                if patch.x[0] <= x <= patch.x[1] and patch.y[0] <= y <= patch.y[1]:
                    mu[k] = patch.mu
        return mu

    def _settle(self, start: np.ndarray) -> None:
        """Stand still at the start until the contacts carry the weight, then roll."""
        q = start[: self._n]
        self.data.qpos[self.moving] = self.planar.joints @ q
        self.model.opt.timestep = self._longest
        held = np.concatenate([self.moving, self._free])
        for _ in range(LONGEST):
            self._mujoco.mj_step(self.model, self.data)
            self.data.qpos[self.moving], self.data.qvel[held] = self.planar.joints @ q, 0.0
            if np.abs(self.data.qvel).max() < SETTLED:
                break
        else:
            raise BadInput("--engine mujoco: the robot does not stand on its contacts; its centre of mass is beyond them")
        self._weigh()
        qdot = self._functions["qdot"](start, self._parameters)[0]
        self.data.qvel[self.moving] = self.planar.joints @ qdot
        self._mujoco.mj_forward(self.model, self.data)
        idle = [k for k, wheel in enumerate(self.planar.wheels) if wheel.angle is None]
        for k, dof in zip(idle, self._free, strict=True):
            self._mujoco.mj_jac(self.model, self.data, self._slot, None, self.data.geom_xpos[self._geoms[k]], self._bodies[k])
            x, y, _ = self._slot @ self.data.qvel
            heading = self._headings[k] @ q
            self.data.qvel[dof] = (np.cos(heading) * x + np.sin(heading) * y) / self._radii[k]
        self.data.time = 0.0


def _mujoco() -> Any:
    try:
        import mujoco  # an extra of the package
    except ImportError as error:
        raise BadInput("--engine mujoco: MuJoCo is not installed; pip install 'noslip[physics]'") from error
    mujoco.set_mju_user_warning(lambda _: None)  # what it warns of ends the run with a status; it would write a file as well
    return mujoco


@lru_cache(maxsize=16)
def _functions(system: ReducedSystem) -> dict[str, ca.Function]:
    """Of q, qdot, p: velocities of the contacts, quasi-velocities; of the inputs besides: forces on the coordinates; of [q; nu]:
    qdot.
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
    }
    return {name: portable(ca.Function(name, given, [ca.densify(value)])) for name, (given, value) in made.items()}
