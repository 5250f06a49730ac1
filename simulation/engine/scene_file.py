"""Reads a scene of the user's own, an MJCF or a URDF, into MuJoCo, and finds the joints,
motors and shapes that a SPEC names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...readers.errors import BadInput, suggestion
from ...readers.urdf.document import NO_BODY, parsed, read
from ...readers.urdf.rims import mesh_file
from .mjcf import DAMPED, HARD, STIFF
from .stepping import installed

FREE, HINGE = 0, 3  # mjtJoint
ON_JOINT = 0  # mjtTrn
ELLIPSOID, CYLINDER, MESH = 4, 5, 7  # mjtGeom
MESHES = (".stl", ".obj", ".msh")  # formats that MuJoCo reads
WHERE = "[scene]"


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A compiled scene. `paved`: it has no floor of its own and was given one;
    its friction is then not known yet."""

    file: str
    model: Any
    paved: bool

    def wrong(self, message: str) -> BadInput:
        """Return the error that says what is wrong with the file."""
        return BadInput(f"{WHERE} file = {self.file}: {message}")

    def joints(self, of: str, names: Sequence[str]) -> list[int]:
        """Return the numbers of joints, which must be hinges. `of` is what they are for, for messages."""
        found, known = [], [self.model.joint(k).name for k in range(self.model.njnt)]
        for name in names:
            if name not in known or not name:
                turns = [
                    each
                    for each, kind in zip(known, self.model.jnt_type, strict=True)
                    if each and kind == HINGE
                ]
                raise self.wrong(
                    f"{of}: there is no joint {name!r}; those that turn are {', '.join(turns) or 'none'}"
                )
            k = known.index(name)
            if self.model.jnt_type[k] != HINGE:
                raise self.wrong(
                    f"{of}: joint {name!r} does not turn; it must be a hinge (continuous or revolute)"
                )
            found.append(k)
        return found

    def motors(self, of: str, names: Sequence[str], joints: Sequence[int]) -> list[int]:
        """Return the numbers of actuators, which must be motors of these joints."""
        model, found = self.model, []
        known = [model.actuator(k).name for k in range(model.nu)]
        for name in names:
            if name not in known:
                raise self.wrong(f"{of}: there is no actuator {name!r}{suggestion(name, known)}")
            k = known.index(name)
            if not self._turns(k, joints):
                said = ", ".join(repr(model.joint(j).name) for j in joints)
                raise self.wrong(
                    f"{of}: actuator {name!r} must be a <motor> of {said}, which is given a torque"
                )
            found.append(k)
        return found

    def own_motor(self, name: str, joints: Sequence[int]) -> tuple[str, ...]:
        """Return the name of the motor of these joints that is called like an input;
        none if the file has no such motor."""
        known = [self.model.actuator(k).name for k in range(self.model.nu)]
        return (name,) if name in known and self._turns(known.index(name), joints) else ()

    def _turns(self, k: int, joints: Sequence[int]) -> bool:
        """Return whether actuator k is a motor of one of these joints."""
        model = self.model
        simple = not (model.actuator_gaintype[k] or model.actuator_biastype[k] or model.actuator_dyntype[k])
        return simple and model.actuator_trntype[k] == ON_JOINT and model.actuator_trnid[k, 0] in joints

    def gain(self, motor: int) -> float:
        """Return the force of a motor on its joint for each unit that it is given, N m."""
        found = float(self.model.actuator_gear[motor, 0] * self.model.actuator_gainprm[motor, 0])
        if not found:
            raise self.wrong(f"actuator {self.model.actuator(motor).name!r} has no gear or gain")
        return found

    def refuse_other_drives(self, joints: Iterable[int], motors: Iterable[int]) -> None:
        """Raise BadInput for an actuator that moves one of the joints by itself,
        such as one which holds its velocity."""
        model = self.model
        for k in set(range(model.nu)) - set(motors):
            own = model.actuator_biastype[k] or model.actuator_dyntype[k]
            if own and model.actuator_trntype[k] == ON_JOINT and model.actuator_trnid[k, 0] in joints:
                name, joint = model.actuator(k).name, model.joint(model.actuator_trnid[k, 0]).name
                raise self.wrong(
                    f"actuator {name!r} would hold joint {joint!r} by itself; make it a <motor>, or remove it"
                )

    def base(self, joints: Sequence[int]) -> int:
        """Return the body with a free joint that carries all of these joints."""
        model = self.model
        free = {int(model.jnt_bodyid[k]) for k in range(model.njnt) if model.jnt_type[k] == FREE}
        roots = {int(model.body_rootid[model.jnt_bodyid[k]]) for k in joints}
        if len(roots) > 1:
            raise self.wrong("the joints are on several robots; name those of one")
        if not roots <= free:
            name = model.body(roots.pop()).name
            raise self.wrong(
                f"the robot, body {name!r}, has no free joint and cannot move; give it <freejoint/>"
            )
        return roots.pop()

    def shapes(self, joint: int) -> list[int]:
        """Return the shapes that can touch something of the body of a joint and of what that carries."""
        model = self.model
        bodies = {int(model.jnt_bodyid[joint])}
        for k in range(model.nbody):  # parents come before their children
            if int(model.body_parentid[k]) in bodies:
                bodies.add(k)
        in_pairs = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
        touches = [
            model.geom_contype[g] or model.geom_conaffinity[g] or g in in_pairs for g in range(model.ngeom)
        ]
        return [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in bodies and touches[g]]

    def pave(self, wheels: Iterable[int]) -> None:
        """Let the robot stand, on a floor that the file did not have, without friction: that of wheels is the
        engine's. Cylinders of wheels touch as the ellipsoids in them do, in the middle. Shapes of the robot
        do not touch each other: in a URDF they often overlap.
        """
        model, wheels = self.model, set(wheels)
        for g in range(model.ngeom):
            touches = bool(model.geom_contype[g] or model.geom_conaffinity[g])
            model.geom_contype[g], model.geom_conaffinity[g] = (
                (touches, 0) if model.geom_bodyid[g] else (0, touches)
            )
            if model.geom_bodyid[g]:
                model.geom_priority[g] = 1
                model.geom_condim[g] = 1
                model.geom_solref[g] = STIFF, DAMPED
                if g in wheels and model.geom_type[g] == CYLINDER:
                    model.geom_type[g] = ELLIPSOID
                    model.geom_size[g] = model.geom_size[g, [0, 0, 1]]  # radius, and half its length
                model.geom_solimp[g, :3] = [float(part) for part in HARD.split()]


def read_scene(file: str, tied: Iterable[Sequence[str]] = (), fixed: Sequence[str] = ()) -> SceneFile:
    """Read an MJCF or a URDF. A URDF gets a free joint; a file without anything that stands still gets a
    level floor. Vertical joints that are named together in `tied` turn together, as by a tie rod, unless the
    file has equalities of its own: about one centre on the axle of the wheels on joints `fixed`, or parallel
    without any. Other joints named together there turn as one.

    Raises BadInput for a file that is missing, and with the reason for one that is not a robot or that MuJoCo
    cannot read.
    """
    mujoco = installed()
    try:
        root = parsed(file)
        spec = _of_urdf(file, root) if root.tag == "robot" else mujoco.MjSpec.from_file(file)
        for mesh in spec.meshes:
            if mesh.file and not mesh.content_type and Path(mesh.file).suffix.lower() not in MESHES:
                raise BadInput(
                    f"its mesh {mesh.file} is none of {', '.join(MESHES)}; convert it, or give a shape "
                    "without one"
                )
        model = spec.compile()
        stands_still = model.body_weldid[model.geom_bodyid] == 0
        paved = not (
            model.npair or (stands_still & ((model.geom_contype > 0) | (model.geom_conaffinity > 0))).any()
        )
        if paved:
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50.0, 50.0, 1.0])
        if not model.neq:
            for names in tied:
                _tie(spec, model, names, fixed)
        model = spec.compile()
    except (BadInput, OSError, ValueError) as error:
        said = " ".join(str(error).removeprefix(f"{file}: ").removeprefix("Error: ").split())
        if isinstance(error, OSError):
            said = f"{error.strerror}; check the path"
        elif not isinstance(error, BadInput):
            said = f"MuJoCo cannot read it: {said}"
        raise BadInput(f"{WHERE} file = {file}: {said}") from error
    model.opt.integrator, model.opt.cone = mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtCone.mjCONE_ELLIPTIC
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return SceneFile(file, model, paved)


def _tie(spec: Any, model: Any, names: Sequence[str], fixed: Sequence[str]) -> None:
    """Add equalities by which joints turn with the first of them; none for names that are not in the file.

    Vertical joints steer. The axle of a wheel steered by delta passes through the centre of the turn, at l
    cot(delta) to the left of the joint at a distance l ahead of the fixed axle. For a joint that is y farther
    to the left, with t = tan(delta), tan(delta') is t / (1 - t y / l) (Ackermann). The equality is this as a
    polynomial of degree 4, the most that MuJoCo has.
    """
    mujoco = installed()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    known = [model.joint(k).name for k in range(model.njnt)]
    if len(names) < 2 or not {*names} <= {*known}:
        return
    axes = {name: data.xaxis[known.index(name)] for name in names}
    steers = abs(axes[names[0]][2]) > 0.5
    up = {name: float(np.sign(axis[2] if steers else axis @ axes[names[0]])) for name, axis in axes.items()}
    places, axle = (
        [data.xanchor[known.index(name)][:2] for name in each if name in known] for each in (names, fixed)
    )
    ahead = np.mean(places, axis=0) - np.mean(axle, axis=0) if axle else np.zeros(2)
    for name, place in list(zip(names, places, strict=True))[1:]:
        aside = place - places[0]
        # With the unit vector e = ahead / l the distance to the left is e x aside, and y / l = (ahead x
        # aside) / l^2.
        ratio = (
            float(ahead[0] * aside[1] - ahead[1] * aside[0]) / float(ahead @ ahead)
            if steers and ahead.any()
            else 0.0
        )
        tie = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=name, name2=names[0]
        )
        tie.data[:5] = up[name] * _ackermann(ratio) * up[names[0]] ** np.arange(5)
        tie.solref[:] = STIFF, DAMPED
        tie.solimp[:3] = [float(part) for part in HARD.split()]


def _ackermann(ratio: float) -> np.ndarray:
    """Return the Taylor coefficients of atan(t / (1 - t ratio)), t = tan(delta), by the power of delta,
    0 to 4."""
    return np.array([0.0, 1.0, ratio, ratio**2, ratio**3 - ratio / 3])


def _of_urdf(file: str, root: Any) -> Any:
    """Return the MuJoCo model, not compiled, of a URDF that `read` accepts, by its first element. Its base is
    free; links without <inertial> have no mass. Raises BadInput, also for a body that moves without a mass or
    has the inertia of no body, and for a mesh that is not found.
    """
    from lxml import etree

    document = read(file, root)
    if links := document.impossible_inertias:
        raise BadInput(f"{file}: link {links[0]!r}: {NO_BODY}")
    for top in (document.root, *(joint.child for joint in document.joints.values() if joint.type != "fixed")):
        if not any(
            [document.inertial(link) for link in document.subtree(top, lambda joint: joint.type == "fixed")]
        ):
            raise BadInput(
                f"{file}: link {top!r} moves, and has no <inertial> with a mass; give its mass and inertia"
            )
    for link in root.iterfind("link"):
        if link.get("name") in document.weightless:  # whose inertia means nothing
            link.remove(link.find("inertial"))
    spec = installed().MjSpec.from_string(etree.tostring(root, encoding="unicode"))
    for mesh in spec.meshes:
        found = mesh_file(document.path, mesh.file)
        if found is None:
            raise BadInput(
                f"{file}: its mesh {mesh.file} is not found; give the file, or a shape without one"
            )
        mesh.file = str(found)
    for geom in spec.geoms:
        geom.mass = 0.0
    for body in spec.worldbody.bodies:
        body.add_freejoint()
    return spec
