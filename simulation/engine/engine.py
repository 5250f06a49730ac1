"""A robot on a floor in MuJoCo: what moves it between two calls of its controller,
and what is measured there."""

from __future__ import annotations

import numpy as np

from ...readers.errors import BadInput
from ..contact import GRAVITY
from ..plant import Plant
from ..specification.floor import Floor
from ..specification.spec import ContactSection
from .frames import PlanarBodies, planar
from .friction import CREEP, LEAST
from .measured import Standing
from .mjcf import mjcf, stands, with_castors
from .stepping import Stepped, installed

SLIGHT = 1e-3  # of the weight: a contact that carries less at rest gives way as one that carries this
SETTLED, LONGEST = 1e-9, 4000  # m/s, rad/s: the robot stands still; steps until it must
# m/s, as CREEP: tyres give way where the wheels of an axle that leans come nearer to each other
ON_BUMPS = 1e-3


class FloorEngine(Stepped):
    """A plant on a floor. Starts at [q; nu] = `start`, rolling, settled on its contacts.

    MuJoCo has the bodies and the loads. Friction is Coulomb's law with the loads of the step before: MuJoCo's
    cones couple slip and load and lift a wheel that begins to slide, the more the lighter it is.
    """

    def __init__(self, plant: Plant, contact: ContactSection, floor: Floor, start: np.ndarray):
        """Raises BadInput if MuJoCo is missing, or if the robot is not made of bodies and wheels in the
        plane."""
        mujoco, bodies = (
            installed(),
            with_castors(planar(plant.system.mechanism, plant.parameters), contact.share),
        )
        self.xml = mjcf(plant.system.mechanism.name, bodies, contact.height, floor.bumps)
        super().__init__(plant, bodies, mujoco.MjModel.from_xml_string(self.xml), floor)
        self._plant = plant
        self.mu = contact.mu if floor.mu is None else floor.mu
        wheels = self.planar.wheels
        self.moving = self._dofs(self._joint_names())
        self._free = self._dofs([f"axle_{k}" for k, wheel in enumerate(wheels) if wheel.angle is None])
        # The contact of each wheel
        self._of = np.array([k for k, wheel in enumerate(wheels) for _ in wheel.places])
        names = [f"wheel_{k}_{j}" for k, wheel in enumerate(wheels) for j in range(len(wheel.places))]
        self._geoms = [self.model.geom(name).id for name in names]
        self._castors = [self.model.geom(f"castor_{k}").id for k in range(len(bodies.castors))]
        self._wheel_of = {geom: k for k, geom in enumerate(self._geoms)}
        self._castor_of = {geom: k for k, geom in enumerate(self._castors)}
        self._bodies = self.model.geom_bodyid[self._geoms]
        self._axles = np.array([self.model.joint(f"axle_{k}").id for k in self._of])
        self._radii = np.array([abs(wheels[k].radius) for k in self._of])
        self._arms = self._radii[:, None] * np.array([0.0, 0.0, -1.0])  # m, from its centre to a level floor
        self._yield_alike(bodies)
        if bodies.leaning and (contact.height or contact.share < 1):
            raise BadInput(
                "[contact] height and share are for robots whose bodies stay level; leave them out"
            )
        self._standing = [
            self.model.body(f"body_{k}").id for k in range(len(bodies.frames)) if stands(bodies, k)
        ]
        self._uneven = bool(floor.bumps)
        self._rollers = [k for k, of in enumerate(self._of) if wheels[of].rollers]
        if self._rollers and self._uneven:
            raise BadInput(
                "--engine mujoco: wheels with rollers on bumps are not described; leave out [floor] bump and "
                "rough"
            )
        count = len(self._of)
        # Directions of friction, in the plane that each wheel touches
        self._tangents = np.tile(np.eye(3)[:2], (count, 1, 1))
        self._push = np.zeros((count, 3))  # N, of the ground, at right angles to that plane
        self._load, self._limit, self._friction = np.zeros(count), np.ones(count), np.zeros(2 * count)
        self._carried = np.zeros(len(self._castors))  # N
        self._jacobian, self._slot = np.zeros((2 * count, self.model.nv)), np.zeros((3, self.model.nv))
        self._settle(start)
        self._stands = self._standing_at_rest(contact.height)

    def _joint_names(self) -> list[str]:
        axles = [f"axle_{k}" for k, wheel in enumerate(self.planar.wheels) if wheel.angle is not None]
        leaning = [f"lean_{k}" for k in range(len(self.planar.leaning))]
        return ["x", "y", *[f"yaw_{k}" for k in range(len(self.planar.frames))], *axles, *leaning]

    def _dofs(self, names: list[str]) -> np.ndarray:
        return np.array([self.model.joint(name).dofadr[0] for name in names], int)

    def _yield_alike(self, bodies: PlanarBodies) -> None:
        """Let wheels and castors give way as springs in proportion to their loads at rest: where the balance
        of forces and moments leaves loads open, at rest they are those of the Mechanism, and forces change
        them as `shift_by_forces` says.
        """
        shares = [bodies.wheels[k].load / len(bodies.wheels[k].places) for k in self._of]
        shares += [castor.load for castor in bodies.castors]
        least = SLIGHT * sum(shares)
        for geom, share in zip((*self._geoms, *self._castors), shares, strict=True):
            self.model.body_invweight0[self.model.geom_bodyid[geom]] = 1 / max(share, least)

    @property
    def names(self) -> tuple[str, ...]:
        """See Stepped."""
        return tuple(
            wheel.name if len(wheel.places) == 1 else f"{wheel.name} {j + 1}"
            for wheel in self.planar.wheels
            for j in range(len(wheel.places))
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """See Stepped."""
        if not self.planar.off:
            return ()
        off = (
            f"{self.planar.off:.1%} of its largest entry: parts that are steered together turn about one "
            "hinge there"
        )
        return (
            "--engine mujoco: the mass matrix of the engine's bodies differs from that of the robot "
            f"by {off}",
        )

    @property
    def castors(self) -> tuple[str, ...]:
        """See Stepped."""
        return tuple(castor.name for castor in self.planar.castors)

    @property
    def standing(self) -> Standing:
        """See Stepped."""
        return self._stands

    def carried(self) -> np.ndarray:
        """See Stepped."""
        return self._carried.copy()

    def on_contacts(self, force: np.ndarray) -> np.ndarray:
        """See Stepped."""
        groups = [np.flatnonzero(self._of == k) for k in range(len(self.planar.wheels))]
        each = force.reshape(len(force), -1, 2)
        return np.concatenate([each[:, of].sum(axis=1) for of in groups], axis=1)

    def _standing_at_rest(self, height: float) -> Standing:
        """Return how the robot stands now."""
        planar, mass = self.planar, float(self.model.body_mass.sum())
        known = [
            (f.mass, height if f.height is None else f.height) for f in planar.frames if f.height or height
        ]
        high = sum(own * h for own, h in known) / sum(own for own, _ in known) if known else None
        loads = dict(
            zip((*self.names, *self.castors), map(float, (*self._load, *self._carried)), strict=True)
        )
        places = {c.name: (float(c.place[0]), float(c.place[1])) for c in planar.castors}
        return Standing(mass, high, loads, places)

    def look(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """See Stepped."""
        q, qdot = self.coordinates()
        friction = self._friction.reshape(-1, 2)
        force = np.hypot(*friction.T)
        use = force / (np.maximum(self._limit, force) + LEAST)
        headings = self._directions(q)[self._of]
        c, s = np.cos(headings), np.sin(headings)
        x, y, _ = (np.einsum("ki,kij->kj", friction, self._tangents) + self._push).T
        if self._uneven or len(self._of) > len(self.planar.wheels):
            self._mujoco.mj_fwdPosition(self.model, self.data)
            slip = np.hypot(*(self._contact_rows() @ self.data.qvel).reshape(-1, 2).T)
        else:
            slip = np.hypot(*self._functions["slip"](q, qdot, self._parameters)[0].reshape(-1, 2).T)
        return slip, self._load.copy(), use, np.column_stack([c * x + s * y, c * y - s * x]).ravel()

    def _push_on(self, tau: np.ndarray) -> None:
        q, qdot = self.coordinates()
        self._aim(q)
        force = self._functions["force"](q, qdot, tau, self._parameters)[0]
        for body in self.planar.leaning:  # its weight is the engine's
            force[body.angle] -= GRAVITY * body.moment * np.sin(q[body.angle])
        self.data.qfrc_applied[:] = 0.0
        self.data.qfrc_applied[self.moving] = self._rates.T @ force
        mu = self._mu()
        # On bumps friction also sees the forces at right angles to what is touched, which between bumps are
        # not parallel.
        self._friction = self._rub(
            self._contact_rows(), self._load, mu, ON_BUMPS if self._uneven else CREEP, self._uneven
        )
        self._limit = mu * self._load

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """See Stepped."""
        return self._rates @ self.data.qpos[self.moving], self._rates @ self.data.qvel[self.moving]

    def pushed(self, x: np.ndarray, impulse: np.ndarray) -> np.ndarray:
        """See Stepped."""
        change = self._plant.pushed(x, impulse) - x
        change[: self._n] = x[: self._n]
        self.data.qvel[self.moving] += (
            self.planar.joints @ self._functions["qdot"](change, self._parameters)[0]
        )
        self._mujoco.mj_forward(self.model, self.data)
        self._roll_idle(x[: self._n])
        return self.state()

    def _aim(self, q: np.ndarray) -> None:
        """Let the friction of wheels with rollers act in the direction in which they roll,
        and not across it."""
        if not self._rollers:
            return
        directions = self._directions(q)[self._of]
        for k in self._rollers:
            self._tangents[k] = [[np.cos(directions[k]), np.sin(directions[k]), 0.0], [0.0, 0.0, 0.0]]

    def _weigh(self) -> None:
        """Note the load of each wheel, and on bumps the plane that it touches."""
        self._load[:], self._push[:], self._carried[:] = 0.0, 0.0, 0.0
        contacts = self.data.contact
        # The floor is the first geom, bumps are next.
        for other, address, frame in zip(
            contacts.geom.max(axis=1).tolist(), contacts.efc_address.tolist(), contacts.frame, strict=True
        ):
            if other in self._wheel_of and address >= 0:
                k, force = self._wheel_of[other], self.data.efc_force[address]
                self._load[k] = force
                self._push[k] += force * (frame[:3] if frame[2] > 0 else -frame[:3])
            elif other in self._castor_of and address >= 0:
                self._carried[self._castor_of[other]] += self.data.efc_force[address]
        if self._uneven:
            x, y, z = self._push.T
            self._load[:] = np.sqrt(x * x + y * y + z * z)
            for k, load in enumerate(self._load):
                self._tangents[k] = _tangents(self._push[k] / load if load > 0 else np.eye(3)[2])

    def _contact_rows(self) -> np.ndarray:
        """Return J (2 c, nv): the velocity of the lowest point of each wheel in its tangents is J times the
        joints' velocities.

        A wheel touches the floor at its radius from its centre, and what it gives way under its load does not
        count.
        """
        J = self._jacobian
        for k, geom in enumerate(self._geoms):
            arm = self._arms[k]
            if self._uneven:
                axle = self.data.geom_xmat[geom].reshape(3, 3)[:, 1]
                down = np.cross(self._tangents[k, 1], self._tangents[k, 0])
                down -= (down @ axle) * axle
                arm = self._radii[k] * (down / np.sqrt(down @ down))
            self._mujoco.mj_jac(
                self.model, self.data, self._slot, None, self.data.geom_xpos[geom] + arm, self._bodies[k]
            )
            J[2 * k : 2 * k + 2] = self._tangents[k] @ self._slot
            # It is turned by the axle of the first wheel of its contact
            if k and self._of[k] == self._of[k - 1]:
                axle = self._axles[k]
                J[2 * k : 2 * k + 2, self.model.jnt_dofadr[axle]] = self._tangents[k] @ np.cross(
                    self.data.xaxis[axle], arm
                )
        return J

    def _overturned(self) -> bool:
        """See Stepped; also whether what leans is below its axle."""
        q = self.coordinates()[0] if self.planar.leaning else np.zeros(0)
        return super()._overturned() or any(np.cos(q[body.angle]) < 0 for body in self.planar.leaning)

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
        if self._uneven:
            self._mujoco.mj_forward(self.model, self.data)
            highest = max(self._floor.height(x, y) for x, y, _ in self.data.geom_xpos[self._geoms])
            self.data.qpos[
                self._dofs([f"z_{k}" for k in range(len(self.planar.frames)) if stands(self.planar, k)])
            ] = highest
        self.model.opt.timestep = self._longest
        held = np.concatenate([self.moving, self._free])
        for _ in range(LONGEST):
            self._mujoco.mj_step(self.model, self.data)
            self.data.qpos[self.moving], self.data.qvel[held] = self.planar.joints @ q, 0.0
            if np.abs(self.data.qvel).max() < SETTLED:
                break
        else:
            raise BadInput(
                "--engine mujoco: the robot does not stand on its contacts; its centre of mass is beyond them"
            )
        self._weigh()
        qdot = self._functions["qdot"](start, self._parameters)[0]
        self.data.qvel[self.moving] = self.planar.joints @ qdot
        self._aim(q)
        self._mujoco.mj_forward(self.model, self.data)
        self._roll_idle(q)
        self.data.time = 0.0

    def _roll_idle(self, q: np.ndarray) -> None:
        """Turn the wheels whose rotation is no coordinate as they roll."""
        idle, directions = (
            [k for k, wheel in enumerate(self.planar.wheels) if wheel.angle is None],
            self._directions(q),
        )
        for k, dof in zip(idle, self._free, strict=True):
            first = int(np.flatnonzero(self._of == k)[0])
            geom = self._geoms[first]
            self._mujoco.mj_jac(
                self.model, self.data, self._slot, None, self.data.geom_xpos[geom], self._bodies[first]
            )
            x, y, _ = self._slot @ self.data.qvel
            self.data.qvel[dof] = (np.cos(directions[k]) * x + np.sin(directions[k]) * y) / self._radii[first]


def _tangents(normal: np.ndarray) -> np.ndarray:
    """Return two directions at right angles to a normal and to each other, (2, 3);
    those of x and y if it points upward."""
    x = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    x /= np.sqrt(x @ x)
    return np.array([x, np.cross(normal, x)])
