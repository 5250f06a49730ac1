"""A robot in a scene of the user's own in MuJoCo, driven as the Mechanism: its joints are named,
its pose follows from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...readers.errors import BadInput
from ...readers.reading import check_keys
from ..contact import GRAVITY
from ..plant import Plant
from ..specification.floor import Floor
from ..specification.scene import SceneSection
from ..specification.spec import ContactSection
from .alignment import UP, align, middle
from .frames import PlanarBodies, planar
from .friction import CREEP
from .scene_file import MESH, WHERE, read_scene
from .stepping import Stepped, on_joints, refuse_in_scene

SETTLED, LONGEST = 1e-6, 5000  # m/s, rad/s: the robot stands still; steps until it must
DIFFERS = 0.01  # relative: what is worth a warning
FALLEN = 0.3  # rad
RAISED = 3  # times; the first raises what is below, the others what came to be the lowest
NO_LOAD = 1e-6  # of the weight
TIED = 2  # mjtEq, of joints
TINY = 1e-9  # N


@dataclass(frozen=True, eq=False)
class Touch:
    """A point where wheel `k`, by a `shape`, touches something at a `place` (m): `normal` away from that,
    load (N), friction coefficient, force on the wheel (N, 3) and velocity of the wheel over it (m/s, 3).
    """

    k: int
    shape: int
    place: np.ndarray
    normal: np.ndarray
    load: float
    mu: float
    force: np.ndarray
    velocity: np.ndarray


class SceneEngine(Stepped):
    """A plant whose bodies, shapes, contacts, friction and motors are those of a file. Starts at [q; nu] =
    `start`, rolling, settled.

    The Mechanism says what the coordinates are and on what its inputs act; the controller knows it alone. On
    a floor of the file MuJoCo's own friction acts, with elliptic cones; on one that the file did not have,
    that of FloorEngine.
    """

    def __init__(
        self, plant: Plant, section: SceneSection, contact: ContactSection, floor: Floor, start: np.ndarray
    ):
        """Raises BadInput if MuJoCo is missing, for a file that it cannot read,
        and for a robot that does not fit the file."""
        mechanism = plant.system.mechanism
        try:
            bodies = planar(mechanism, plant.parameters)
        except BadInput:  # masses that are not those of bodies on hinges do not matter here
            bodies = planar(mechanism, plant.parameters, weighed=False)
        refuse_in_scene(WHERE, mechanism.name, bodies)
        names = [coordinate.name for coordinate in mechanism.coordinates]
        steering = [section.joints.get(names[bodies.hinge(k)], ()) for k in range(1, len(bodies.frames))]
        together = [
            section.joints.get(names[w.angle], ()) for w in bodies.wheels if w.wheels and w.angle is not None
        ]
        self.scene = scene = read_scene(
            section.file, [*steering, *together], self._fixed_axle(plant, bodies, section)
        )
        if floor.patch or floor.bumps or not (scene.paved or floor.mu is None):
            raise scene.wrong(
                "[floor] mu, patch, bump and rough do not apply to a scene; change its own floor"
            )
        super().__init__(plant, bodies, scene.model, floor)
        self.name, self._forces = mechanism.name, mechanism.forces
        rolled, turned = self._joints(plant, section)
        every = [k for own in (*rolled, *turned) for k in own]
        if twice := [k for k in every if every.count(k) > 1]:
            raise scene.wrong(f"joint {self.model.joint(twice[0]).name!r} is named twice")
        self._root, self._heading = scene.base(every), 0.0
        first = self.model.body_jntadr[self._root]
        self._at, self._dof = int(self.model.jnt_qposadr[first]), int(self.model.jnt_dofadr[first])
        self._mujoco.mj_forward(self.model, self.data)
        self.aligned = align(scene, self.data, mechanism.name, bodies, turned, rolled)
        self._wheels = self.aligned.wheels
        own = [
            wheel
            for wheel, contact in zip(self._wheels, bodies.wheels, strict=True)
            if contact.angle is not None
        ]
        self._driven = [*self.aligned.hinges, *own]
        self._wheel_of = {
            g: k for k, wheel in enumerate(self._wheels) for shapes in wheel.shapes for g in shapes
        }
        self._rubbing: dict[int, np.ndarray] = {}  # friction at contacts of the last step, N
        self._loads = dict.fromkeys(self._wheel_of, 0.0)  # of shapes of wheels in the last step, N
        self._mu = contact.mu if floor.mu is None else floor.mu
        if scene.paved:
            scene.pave(self._wheel_of)
        self._drive(plant, section)
        self._jacobian = np.zeros((3, self.model.nv))
        self._settle(start)
        self._differs = tuple(self._differences(start[: self._n]))

    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Return q and qdot of the Mechanism."""
        d, turn = self.data, self._turn()
        ahead, arm, spin = (
            turn @ self.aligned.ahead,
            turn @ self.aligned.point,
            turn @ d.qvel[self._dof + 3 : self._dof + 6],
        )
        x, y, _ = d.qpos[self._at : self._at + 3] + arm
        vx, vy, _ = d.qvel[self._dof : self._dof + 3] + np.cross(spin, arm)
        ux, uy, _ = np.cross(spin, ahead)
        heading = np.arctan2(ahead[1], ahead[0])
        self._heading = heading + 2 * np.pi * np.round((self._heading - heading) / (2 * np.pi))
        yaw_rate = (ahead[0] * uy - ahead[1] * ux) / (ahead[0] ** 2 + ahead[1] ** 2)
        angles = [np.mean(joint.signs * (d.qpos[joint.at] - joint.zero)) for joint in self._driven]
        rates = [np.mean(joint.signs * d.qvel[joint.dofs]) for joint in self._driven]
        return self._rates @ np.array([x, y, self._heading, *angles]), self._rates @ np.array(
            [vx, vy, yaw_rate, *rates]
        )

    def look(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """See Stepped. A contact of several wheels, or one that touches at several points, has their mean
        slip, by load; in the air it has none.
        """
        count = len(self._wheels)
        load, held, limit = np.zeros(count), np.zeros(count), np.zeros(count)
        force, slip = np.zeros((count, 3)), np.zeros((count, 3))
        for touch in self._touches():
            k, normal = touch.k, touch.normal
            load[k] += touch.load
            limit[k] += touch.mu * touch.load
            held[k] += np.linalg.norm(touch.force - (touch.force @ normal) * normal)
            force[k] += touch.force
            slip[k] += touch.load * (touch.velocity - (touch.velocity @ normal) * normal)
        headings = self._directions(self.coordinates()[0])
        c, s = np.cos(headings), np.sin(headings)
        level = np.column_stack([c * force[:, 0] + s * force[:, 1], c * force[:, 1] - s * force[:, 0]])
        return (
            np.linalg.norm(slip, axis=1) / np.maximum(load, TINY),
            load,
            held / np.maximum(limit, TINY),
            level.ravel(),
        )

    @staticmethod
    def _fixed_axle(plant: Plant, bodies: PlanarBodies, section: SceneSection) -> list[str]:
        """Return the joints of the wheels on the first frame, about whose axle others are steered;
        none unless it is one axle."""
        names = [coordinate.name for coordinate in plant.system.mechanism.coordinates]
        on_body = [wheel for wheel in bodies.wheels if wheel.frame == 0]
        found: list[str] = []
        for wheel in on_body if len({wheel.place[0] for wheel in on_body}) == 1 else ():
            own = wheel.name if wheel.angle is None else names[wheel.angle]
            found += (section.wheels if wheel.angle is None else section.joints).get(own, (own,))
        return found

    # -- what is named ---------------------------------------------------------------------------------------

    def _joints(self, plant: Plant, section: SceneSection) -> tuple[list[list[int]], list[list[int]]]:
        """Return the joints of each wheel, and of each frame but the first."""
        bodies, scene = self.planar, self.scene
        names = [coordinate.name for coordinate in plant.system.mechanism.coordinates]
        turned = [names[bodies.hinge(k)] for k in range(1, len(bodies.frames))]
        idle = [wheel.name for wheel in bodies.wheels if wheel.angle is None]
        driven = [names[wheel.angle] for wheel in bodies.wheels if wheel.angle is not None]
        check_keys(section.joints, [*turned, *driven], f"{WHERE} joints")
        check_keys(section.wheels, idle, f"{WHERE} wheels")
        found = {
            name: scene.joints(f"joints {name}", section.joints.get(name, (name,)))
            for name in (*turned, *driven)
        }
        found |= {name: scene.joints(f"wheels {name!r}", section.wheels.get(name, (name,))) for name in idle}
        axles = [wheel.name if wheel.angle is None else names[wheel.angle] for wheel in bodies.wheels]
        return [found[name] for name in axles], [found[name] for name in turned]

    def _drive(self, plant: Plant, section: SceneSection) -> None:
        """Prepare what each unit of an input is: a force at joints, or what motors are given."""
        model, mechanism = self.model, plant.system.mechanism
        inputs = [entry.name for entry in mechanism.inputs]
        check_keys(section.motors, inputs, f"{WHERE} motors")
        self._at_joints, self._at_motors = (
            np.zeros((model.nv, len(inputs))),
            np.zeros((model.nu, len(inputs))),
        )
        self._gains = np.zeros((model.nv, model.nu))  # N m at joints for each unit that a motor is given
        # Where a motor did not supply what it was given: since when (s), N m
        self._short: dict[int, tuple[float, float]] = {}
        used: list[int] = []
        for i, (name, forces) in enumerate(zip(inputs, on_joints(plant, self.planar)[3:].T, strict=True)):
            acts = [(self._driven[k], force) for k, force in enumerate(forces) if force]
            named = section.motors.get(name) or (
                self.scene.own_motor(name, acts[0][0].joints) if len(acts) == 1 else ()
            )
            if not named:
                for joint, force in acts:
                    self._at_joints[joint.dofs, i] = joint.signs * force / len(joint.joints)
                continue
            if len(acts) > 1:
                raise self.scene.wrong(f"motors {name}: this input acts on several joints; leave it out")
            joint, force = acts[0]
            motors = self.scene.motors(f"motors {name}", named, joint.joints)
            used += motors
            for motor in motors:
                sign = joint.signs[joint.joints.index(int(model.actuator_trnid[motor, 0]))]
                self._at_motors[motor, i] = sign * force / (len(motors) * self.scene.gain(motor))
                self._gains[model.jnt_dofadr[model.actuator_trnid[motor, 0]], motor] = self.scene.gain(motor)
        self.scene.refuse_other_drives([k for joint in self._driven for k in joint.joints], used)

    def _push_on(self, tau: np.ndarray) -> None:
        self.data.qfrc_applied[:] = self._at_joints @ tau
        self.data.ctrl[:] = self._at_motors @ tau
        if self.scene.paved:
            self._rub_wheels()

    def _rub_wheels(self) -> None:
        """Add the friction of wheels; where a shape touches at several points,
        each carries an equal part of its load."""
        geoms = self.data.contact.geom
        touching = [(c, g) for c, pair in enumerate(geoms.tolist()) for g in pair if g in self._wheel_of]
        if not touching:
            self._rubbing = {}
            return
        counts = Counter(g for _, g in touching)
        J, tangents = np.zeros((2 * len(touching), self.model.nv)), []
        for k, (c, g) in enumerate(touching):
            tangents.append(self.data.contact.frame[c].reshape(3, 3)[1:])
            self._mujoco.mj_jac(
                self.model,
                self.data,
                self._jacobian,
                None,
                self.data.contact.pos[c],
                self.model.geom_bodyid[g],
            )
            J[2 * k : 2 * k + 2] = tangents[k] @ self._jacobian
        load = np.array([self._loads[g] / counts[g] for _, g in touching])
        self._mujoco.mj_fwdActuation(self.model, self.data)
        force = self._rub(J, load, np.full(len(load), self._mu), CREEP, True, self._ties()).reshape(-1, 2)
        self._rubbing = {c: force[k] @ tangents[k] for k, (c, _) in enumerate(touching)}

    def _ties(self) -> np.ndarray:
        """Return G, (k, nv): equalities between joints keep G qvel zero."""
        model, ties = self.model, []
        for one, other, kind, poly in zip(
            model.eq_obj1id, model.eq_obj2id, model.eq_type, model.eq_data, strict=True
        ):
            if kind == TIED and other >= 0:
                row = np.zeros(model.nv)
                angle = self.data.qpos[model.jnt_qposadr[other]] - model.qpos0[model.jnt_qposadr[other]]
                row[model.jnt_dofadr[one]] = 1.0
                row[model.jnt_dofadr[other]] = -(poly[1:5] * np.arange(1, 5)) @ angle ** np.arange(4)
                ties.append(row)
        return np.array(ties).reshape(-1, model.nv)

    def _weigh(self) -> None:
        """Note the loads of wheels, and where motors were at their limits, which MuJoCo does not say."""
        self._loads = dict.fromkeys(self._wheel_of, 0.0)
        contact = self.data.contact
        for pair, address in zip(contact.geom.tolist(), contact.efc_address.tolist(), strict=True):
            for g in pair:
                if g in self._wheel_of and address >= 0:
                    self._loads[g] += float(self.data.efc_force[address])
        short = np.abs(self._gains @ self.data.ctrl - self.data.qfrc_actuator) * self._gains.any(axis=1)
        for dof in np.flatnonzero(short > TINY).tolist():
            since, most = self._short.get(dof, (self.data.time - self.model.opt.timestep, 0.0))
            self._short[dof] = since, max(most, short[dof])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the file differs from the Mechanism, and so far motors supplied less than they were given."""
        short = (
            f"motor {self.model.actuator(motor).name!r} is at its limit, first at t = {since:.4g} s, and "
            f"supplies up to {most:.3g} N m less than the columns of the inputs say; set [limits] torque to "
            "what it can supply"
            for dof, (since, most) in self._short.items()
            for motor in np.flatnonzero(self._gains[dof])
        )
        return tuple(f"{WHERE} file = {self.scene.file}: {said}" for said in (*self._differs, *short))

    # -- the start -------------------------------------------------------------------------------------------

    def _settle(self, start: np.ndarray) -> None:
        """Stand still at the start until the contacts carry the weight, then roll."""
        d, target = self.data, self.planar.joints @ start[: self._n]
        self._heading = float(target[2])
        self.model.opt.timestep = self._longest
        held = [self._dof, self._dof + 1, self._dof + 5]
        held += [dof for joint in (*self.aligned.hinges, *self._wheels) for dof in joint.dofs]
        if self.scene.paved:
            self._lift(target)
        before = self._turn()[2]
        for _ in range(LONGEST):
            self._put(target)
            self._mujoco.mj_step(self.model, d)
            d.qvel[held] = 0.0
            if self._turn()[2] @ before < np.cos(FALLEN):
                raise self.scene.wrong("the robot falls over; wheels and castors must carry it")
            if np.abs(d.qvel).max() < SETTLED:
                break
        else:
            seconds = LONGEST * self._longest
            raise self.scene.wrong(
                f"the robot does not come to rest within {seconds:g} s; it must stand by itself"
            )
        self._put(target)
        self._mujoco.mj_forward(self.model, d)
        self._standing, self._up = [self._root], self._turn()[2]
        weight = GRAVITY * float(self.model.body_subtreemass[self._root])
        for wheel, load in zip(self.planar.wheels, self.look()[1], strict=True):
            if not load > NO_LOAD * weight:
                raise self.scene.wrong(f"at rest no wheel of {wheel.name!r} stands on the floor")
        self.mu = min(touch.mu for touch in self._touches())
        d.qvel[:] = self._rolling(start[: self._n], self._functions["qdot"](start, self._parameters)[0])
        self._mujoco.mj_forward(self.model, d)
        self._weigh()
        d.time = 0.0

    def _lift(self, target: np.ndarray) -> None:
        """Raise the robot until nothing of it is below the floor that the file did not have."""
        for _ in range(RAISED):
            self._put(target)
            self._mujoco.mj_forward(self.model, self.data)
            self.data.qpos[self._at + 2] -= min([0.0, *self.data.contact.dist])

    def _put(self, target: np.ndarray) -> None:
        """Move the base to a place and heading, and the driven joints to angles,
        all in `target` as in PlanarBodies.joints."""
        d, at = self.data, self._at
        ahead = self._turn() @ self.aligned.ahead
        half, turned = (target[2] - np.arctan2(ahead[1], ahead[0])) / 2, np.zeros(4)
        self._mujoco.mju_mulQuat(
            turned, np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), d.qpos[at + 3 : at + 7].copy()
        )
        d.qpos[at + 3 : at + 7] = turned
        d.qpos[at : at + 2] = target[:2] - (self._turn() @ self.aligned.point)[:2]
        for joint, angle in zip(self._driven, target[3:], strict=True):
            d.qpos[joint.at] = joint.zero + joint.signs * angle

    def _rolling(self, q: np.ndarray, qdot: np.ndarray) -> np.ndarray:
        """Return the velocities of all joints at rates of the coordinates, at the pose of now; several wheels
        that share a coordinate turn as each of them rolls.
        """
        qvel, turn, rates = np.zeros(self.model.nv), self._turn(), self.planar.joints @ qdot
        spin = rates[2] * UP
        qvel[self._dof : self._dof + 3] = np.array([*rates[:2], 0.0]) - np.cross(
            spin, turn @ self.aligned.point
        )
        qvel[self._dof + 3 : self._dof + 6] = turn.T @ spin
        for joint, rate in zip(self._driven, rates[3:], strict=True):
            qvel[joint.dofs] = joint.signs * rate
        for wheel, contact, heading in zip(
            self._wheels, self.planar.wheels, self._directions(q), strict=True
        ):
            ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
            speeds = []
            for k, shapes in zip(wheel.joints, wheel.shapes, strict=True):
                centre, body = middle(self.scene, self.data, k, shapes), self.model.jnt_bodyid[k]
                self._mujoco.mj_jac(self.model, self.data, self._jacobian, None, centre, body)
                speeds.append(float(ahead @ self._jacobian @ qvel))
            mean = np.mean(speeds) if contact.angle is not None else 0.0
            qvel[wheel.dofs] += wheel.signs * (np.array(speeds) - mean) / contact.radius
        return qvel

    def _differences(self, q: np.ndarray) -> Iterator[str]:
        """Yield where the file differs from the Mechanism by more than DIFFERS: places, radii, masses."""
        aligned, wheels = self.aligned, self.planar.wheels
        if aligned.off > DIFFERS * aligned.size:
            yield f"joints are {aligned.off:.3g} m away from where {self.name} has its wheels and hinges"
        if len(wheels) > 1 and all((wheel.signs < 0).all() for wheel in self._wheels):
            yield (
                "all wheels turn about axes to the right: left and right may be interchanged in [scene] "
                "joints"
            )
        for contact, wheel in zip(wheels, self._wheels, strict=True):
            own = abs(contact.radius)
            for k, shapes in zip(wheel.joints, wheel.shapes, strict=True):
                centre, axis = middle(self.scene, self.data, k, shapes), self.data.xaxis[k]
                arms = np.array([touch.place - centre for touch in self._touches() if touch.shape in shapes])
                if not len(arms):
                    continue
                joint, breadth = self.model.joint(k).name, float(np.ptp(arms @ axis))
                if any(self.model.geom_type[g] == MESH for g in shapes):
                    yield (
                        f"the wheel on {joint!r} is a mesh, which rolls from facet to facet; give it a "
                        "cylinder or an ellipsoid"
                    )
                radius = float(np.linalg.norm(arms - np.outer(arms @ axis, axis), axis=1).max())
                if abs(radius / own - 1) > DIFFERS:
                    yield (
                        f"the wheel on {joint!r} has a radius of {radius:.4g} m, that of {self.name} "
                        f"{own:.4g} m"
                    )
                if breadth > DIFFERS * own:
                    yield (
                        f"the wheel on {joint!r} touches at points {breadth:.3g} m apart along its axle and "
                        "resists turning on the spot; a sphere or an ellipsoid as its shape does not"
                    )
        if not self._forces and (
            rubs := [k for joint in (*self._driven, *self._wheels) for k in joint.joints if self._rubs(k)]
        ):
            said = ", ".join(repr(self.model.joint(k).name) for k in dict.fromkeys(rubs))
            yield (
                f"joints {said} have friction or damping, which the equations of {self.name} do not have; "
                "add force(...) there"
            )
        mass, own = float(self.model.body_subtreemass[self._root]), self.planar.mass
        if own and abs(mass / own - 1) > DIFFERS:
            yield f"the mass is {mass:.4g} kg, that of {self.name} {own:.4g} kg"
        off = self.mass_matrix_difference(q)
        if off > DIFFERS:
            yield (
                f"the mass matrix of the rolling robot differs from that of {self.name} by {off:.1%} of "
                "its largest entry"
            )

    def _rubs(self, joint: int) -> bool:
        """Return whether a joint of the file has friction or damping."""
        dof = self.model.jnt_dofadr[joint]
        return bool(self.model.dof_frictionloss[dof] or self.model.dof_damping[dof])

    def mass_matrix_difference(self, q: np.ndarray) -> float:
        """Return how far S'MS of the scene is from that of the Mechanism at q, the pose of now,
        relative to its largest entry."""
        dof = len(self.state()) - self._n
        qdots = [
            self._functions["qdot"](np.concatenate([q, unit]), self._parameters)[0] for unit in np.eye(dof)
        ]
        velocities = np.column_stack([self._rolling(q, qdot) for qdot in qdots])
        full = np.zeros((self.model.nv, self.model.nv))
        self._mujoco.mj_fullM(self.model, self.data, full)
        own = self._functions["mass"](q, self._parameters)[0].reshape(dof, dof)
        return float(np.abs(velocities.T @ full @ velocities - own).max() / np.abs(own).max())

    # -- what the engine says --------------------------------------------------------------------------------

    def _touches(self) -> Iterator[Touch]:
        """Yield where wheels touch what is not of the robot, as the last step had it."""
        contacts, supplied, root = self.data.contact, np.zeros(6), self.model.body_rootid
        for c, (first, second) in enumerate(contacts.geom.tolist()):
            own, other, sign = (second, first, 1.0) if second in self._wheel_of else (first, second, -1.0)
            if own not in self._wheel_of or root[self.model.geom_bodyid[other]] == self._root:
                continue
            self._mujoco.mj_contactForce(self.model, self.data, c, supplied)
            frame, place = contacts.frame[c].reshape(3, 3), contacts.pos[c].copy()
            velocity = self._velocity(place, own) - self._velocity(place, other)
            mu = (
                self._mu
                if self.scene.paved
                else float(contacts.friction[c, 0])
                if contacts.dim[c] > 1
                else 0.0
            )
            load, force = float(supplied[0]), sign * supplied[:3] @ frame + self._rubbing.get(c, 0.0)
            yield Touch(self._wheel_of[own], own, place, sign * frame[0], load, mu, force, velocity)

    def _velocity(self, place: np.ndarray, shape: int) -> np.ndarray:
        """Return the velocity of a point of a shape's body, m/s."""
        self._mujoco.mj_jac(self.model, self.data, self._jacobian, None, place, self.model.geom_bodyid[shape])
        return self._jacobian @ self.data.qvel

    def _turn(self) -> np.ndarray:
        """Return the rotation of the base."""
        matrix = np.zeros(9)
        self._mujoco.mju_quat2Mat(matrix, self.data.qpos[self._at + 3 : self._at + 7])
        return matrix.reshape(3, 3)
