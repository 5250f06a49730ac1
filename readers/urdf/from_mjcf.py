"""An MJCF as a URDF: MuJoCo compiles it, and its bodies, joints and shapes are written as links and
joints."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import BadInput, library, naming

FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
ELLIPSOID = 4  # mjtGeom
OF_JOINT, OF_TENDON = 0, 3  # mjtTrn
SUMMED = 1  # mjtWrap: a joint whose angle a fixed tendon adds up
HOLDS = ("armature", "damping", "frictionloss", "limited", "stiffness")  # with which a tendon acts of itself
# a capsule counts as its cylinder
SHAPES = {2: "sphere", 3: "cylinder", ELLIPSOID: "mesh", 5: "cylinder", 6: "box", 7: "mesh"}


def urdf_of(file: str) -> tuple[Any, dict[str, np.ndarray]]:
    """Return the <robot> of an MJCF, and the vertices of its meshes, (count, 3), m, by the name in <mesh>.

    The body with a free joint is its root; what else stands on the world is left out.

    Raises BadInput for a file that MuJoCo cannot compile, and for a robot that a tree of links with one joint
    each cannot have.
    """
    mujoco = library("mujoco", "reading an MJCF requires mujoco", "physics")
    with naming(f"{file}: MuJoCo cannot compile it", ValueError):
        model = mujoco.MjModel.from_xml_path(file)
    scene = _Scene(file, model)
    return scene.robot(), scene.vertices


class _Scene:
    """A compiled model, and the file's name for messages. Bodies and joints without a name are called by
    their numbers."""

    def __init__(self, file: str, model: Any):
        self.file, self.model = file, model
        self.bodies = [model.body(k).name or f"body_{k}" for k in range(model.nbody)]
        self.vertices: dict[str, np.ndarray] = {}
        self.joints = [
            model.joint(k).name or f"{self.bodies[model.jnt_bodyid[k]]}_joint" for k in range(model.njnt)
        ]

    def robot(self) -> Any:
        from lxml import etree

        model = self.model
        free = [int(model.jnt_bodyid[k]) for k in range(model.njnt) if model.jnt_type[k] == FREE]
        if len(free) != 1:
            said = ", ".join(repr(self.bodies[k]) for k in free) or "none"
            raise BadInput(
                f"{self.file}: the robot is the body with a <freejoint/>; with one are: {said}; give it to "
                "one body"
            )
        if model.neq or any(getattr(model, f"tendon_{name}").any() for name in HOLDS):
            raise BadInput(
                f"{self.file}: equality constraints and tendons cannot be described as a tree; remove them"
            )
        root = etree.Element("robot", name=model.names.partition(b"\0")[0].decode())
        anchors = {free[0]: np.zeros(3)}
        for k in range(free[0], model.nbody):  # parents come before their children
            if k != free[0]:
                parent = int(model.body_parentid[k])
                if parent not in anchors:
                    continue
                anchors[k] = self._joint(root, k, parent, anchors[parent])
            self._link(root, k, anchors[k])
        for joint in sorted({joint for k in range(model.nu) for joint in self._driven(k)}):
            etree.SubElement(etree.SubElement(root, "transmission"), "joint", name=self.joints[joint])
        return root

    def _driven(self, k: int) -> list[int]:
        """Return the joints that actuator k drives, itself or by a tendon that is a sum of their angles."""
        model, kind, own = (
            self.model,
            int(self.model.actuator_trntype[k]),
            int(self.model.actuator_trnid[k, 0]),
        )
        if kind != OF_TENDON:
            return [own] if kind == OF_JOINT else []
        parts = slice(model.tendon_adr[own], model.tendon_adr[own] + model.tendon_num[own])
        joints = zip(model.wrap_type[parts].tolist(), model.wrap_objid[parts].tolist(), strict=True)
        return [joint for kind, joint in joints if kind == SUMMED]

    def _joint(self, root: Any, k: int, parent: int, before: np.ndarray) -> np.ndarray:
        """Add the joint that carries body k; return the place of its link's origin in the body, m."""
        from lxml import etree

        model, count = self.model, int(self.model.body_jntnum[k])
        if count > 1:
            raise BadInput(
                f"{self.file}: body {self.bodies[k]!r} has {count} joints; give each a body of its own"
            )
        j = int(model.body_jntadr[k])
        kind = int(model.jnt_type[j]) if count else BALL
        held, limited = kind == BALL, bool(count and model.jnt_limited[j])
        anchor = np.zeros(3) if held else model.jnt_pos[j].copy()
        made = etree.SubElement(root, "joint", name=self.joints[j] if count else f"{self.bodies[k]}_fixed")
        made.set(
            "type",
            "fixed" if held else "prismatic" if kind == SLIDE else "revolute" if limited else "continuous",
        )
        turn = Rotation.from_quat(model.body_quat[k], scalar_first=True)
        self._origin(made, model.body_pos[k] + turn.apply(anchor) - before, turn)
        etree.SubElement(made, "parent", link=self.bodies[parent])
        etree.SubElement(made, "child", link=self.bodies[k])
        if not held:
            etree.SubElement(made, "axis", xyz=_text(model.jnt_axis[j]))
            low, high = model.jnt_range[j] if limited else (0.0, 0.0)
            etree.SubElement(
                made, "limit", lower=repr(float(low)), upper=repr(float(high)), effort="0", velocity="0"
            )
            rubs = model.dof_damping[model.jnt_dofadr[j]], model.dof_frictionloss[model.jnt_dofadr[j]]
            if any(rubs):
                etree.SubElement(
                    made, "dynamics", damping=repr(float(rubs[0])), friction=repr(float(rubs[1]))
                )
        return anchor

    def _link(self, root: Any, k: int, anchor: np.ndarray) -> None:
        """Add body k with its mass and shapes, its origin at the anchor."""
        from lxml import etree

        model = self.model
        made = etree.SubElement(root, "link", name=self.bodies[k])
        if model.body_mass[k] > 0:
            inertial = etree.SubElement(made, "inertial")
            self._origin(
                inertial,
                model.body_ipos[k] - anchor,
                Rotation.from_quat(model.body_iquat[k], scalar_first=True),
            )
            etree.SubElement(inertial, "mass", value=repr(float(model.body_mass[k])))
            moments = dict(
                zip(("ixx", "iyy", "izz"), (repr(float(i)) for i in model.body_inertia[k]), strict=True)
            )
            etree.SubElement(inertial, "inertia", **moments, ixy="0", ixz="0", iyz="0")
        for g in range(model.body_geomadr[k], model.body_geomadr[k] + model.body_geomnum[k]):
            shape = SHAPES.get(int(model.geom_type[g]))
            if shape == "mesh":
                name, points = self._mesh(g)
                self.vertices[name] = points
            if shape:
                touches = model.geom_contype[g] or model.geom_conaffinity[g]
                seen = etree.SubElement(made, "collision" if touches else "visual")
                self._origin(
                    seen,
                    model.geom_pos[g] - anchor,
                    Rotation.from_quat(model.geom_quat[g], scalar_first=True),
                )
                size = {"filename": name} if shape == "mesh" else _size(shape, model.geom_size[g])
                etree.SubElement(etree.SubElement(seen, "geometry"), shape, **size)

    def _mesh(self, g: int) -> tuple[str, np.ndarray]:
        """Return name and vertices of a mesh, or of an ellipsoid, in the frame of its geom."""
        model = self.model
        if int(model.geom_type[g]) == ELLIPSOID:
            turns, heights = np.meshgrid(
                np.linspace(0, 2 * np.pi, 64, endpoint=False), np.linspace(0, np.pi, 33)
            )
            unit = [np.sin(heights) * np.cos(turns), np.sin(heights) * np.sin(turns), np.cos(heights)]
            return f"ellipsoid {g}", np.reshape(unit, (3, -1)).T * model.geom_size[g]
        k = int(model.geom_dataid[g])
        first = int(model.mesh_vertadr[k])
        return f"mesh {model.mesh(k).name}", model.mesh_vert[
            first : first + int(model.mesh_vertnum[k])
        ].astype(float)

    def _origin(self, element: Any, place: np.ndarray, turn: Rotation) -> None:
        from lxml import etree

        etree.SubElement(element, "origin", xyz=_text(place), rpy=_text(_roll_pitch_yaw(turn.as_matrix())))


def _size(shape: str, size: np.ndarray) -> dict[str, str]:
    """Return the attributes of a shape; MuJoCo has half lengths."""
    if shape == "box":
        return {"size": _text(2 * size)}
    radius = {"radius": repr(float(size[0]))}
    return radius if shape == "sphere" else radius | {"length": repr(2 * float(size[1]))}


def _roll_pitch_yaw(turn: np.ndarray) -> np.ndarray:
    """Return the angles of a rotation matrix, rad; no roll where the pitch is a quarter turn."""
    level = np.hypot(turn[0, 0], turn[1, 0])
    pitch = np.arctan2(-turn[2, 0], level)
    if level < 1e-9:
        return np.array([0.0, pitch, np.arctan2(-turn[0, 1], turn[1, 1])])
    return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])


def _text(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
