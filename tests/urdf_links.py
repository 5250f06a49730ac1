"""The links of a URDF in space, from its XML and nothing else: mass matrix and velocities, for comparison
with what is imported.

Nothing of noslip is used. The velocities are those of a free flyer, as Pinocchio has them: the linear (m/s)
and angular (rad/s) velocity of the root's frame, in its own axes, then the rate of each joint that moves, in
the order of the file.
"""

import xml.etree.ElementTree as xml

import numpy as np


def vector(text: str | None, default: str = "0 0 0") -> np.ndarray:
    return np.array([float(number) for number in (text or default).split()])


def cross(v) -> np.ndarray:
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def turned(axis, angle: float) -> np.ndarray:
    K = cross(axis)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def origin(element) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and place of an element's <origin>."""
    at = None if element is None else element.find("origin")
    roll, pitch, yaw = vector(None if at is None else at.get("rpy"))
    turn = turned((0, 0, 1), yaw) @ turned((0, 1, 0), pitch) @ turned((1, 0, 0), roll)
    return turn, vector(None if at is None else at.get("xyz"))


class Links:
    """A tree of links. `moving` are the names of its joints that move, in the order of their rates."""

    def __init__(self, text: str):
        root = xml.fromstring(text)
        self.joints = {joint.get("name"): joint for joint in root.findall("joint")}
        self.links = {link.get("name"): link for link in root.findall("link")}
        self.moving = [name for name, joint in self.joints.items() if joint.get("type") != "fixed"]
        children = {joint.find("child").get("link") for joint in self.joints.values()}
        self.root = next(name for name in self.links if name not in children)

    def frames(self, angles: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Rotation, place and Jacobian (6 x 6 + moving, velocity then angular velocity) of each link in the
        frame of the root."""
        still = np.zeros((6, 6 + len(self.moving)))
        still[:, :6] = np.eye(6)
        frames, waiting = {self.root: (np.eye(3), np.zeros(3), still)}, list(self.joints.values())
        while waiting:
            joint = waiting.pop(0)
            parent = joint.find("parent").get("link")
            if parent not in frames:
                waiting.append(joint)
                continue
            R, p, J = frames[parent]
            turn, place = origin(joint)
            arm = R @ place
            J = J.copy()
            J[:3] -= cross(arm) @ J[3:]
            R, p = R @ turn, p + arm
            if joint.get("name") in self.moving:
                axis = vector(None if joint.find("axis") is None else joint.find("axis").get("xyz"), "1 0 0")
                axis, k = axis / np.linalg.norm(axis), 6 + self.moving.index(joint.get("name"))
                if joint.get("type") == "prismatic":
                    J[:3, k] = R @ axis
                    p = p + R @ axis * angles.get(joint.get("name"), 0.0)
                else:
                    J[3:, k] = R @ axis
                    R = R @ turned(axis, angles.get(joint.get("name"), 0.0))
            frames[joint.find("child").get("link")] = R, p, J
        return frames

    def mass_matrix(self, angles: dict[str, float]) -> np.ndarray:
        """The mass matrix of these velocities. A link with a mass of zero has no inertia."""
        M = 0.0
        for name, (R, _, J) in self.frames(angles).items():
            inertial = self.links[name].find("inertial")
            mass = 0.0 if inertial is None else float(inertial.find("mass").get("value"))
            if not mass:
                continue
            turn, place = origin(inertial)
            values = inertial.find("inertia")
            xx, xy, xz, yy, yz, zz = (
                float(values.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            )
            inertia = R @ turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ (R @ turn).T
            centre = J[:3] - cross(R @ place) @ J[3:]
            M = M + mass * centre.T @ centre + J[3:].T @ inertia @ J[3:]
        return M

    def centre_of_mass(self) -> tuple[float, np.ndarray]:
        """Mass (kg) and centre of mass (m) in the frame of the root, with all joints at zero."""
        M = self.mass_matrix({})
        return float(M[0, 0]), np.array([M[1, 5], M[2, 3], M[0, 4]]) / M[0, 0]
