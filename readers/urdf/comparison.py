"""Compares a robot with the URDF that it was made from, whose bodies move in space, link by link."""

from collections.abc import Mapping

import casadi as ca
import numpy as np

from ...model.reduction import ReducedSystem
from .document import placed
from .parts import UP, Layout, LinkWheel, Part

STATES = 10
QUARTERS = 4  # turns of the wheels over which their bodies are averaged


class LinkMotion:
    """The motion of every link of a URDF, given the coordinates of a robot file by name and their rates."""

    def __init__(self, layout: Layout):
        self.layout, self.document = layout, layout.document
        left = np.cross(UP, layout.heading)
        root = np.eye(4)  # the frame of the base in that of the root
        root[:3, :3], root[:3, 3] = np.column_stack([layout.heading, left, UP]), layout.base.origin
        self.root = np.linalg.inv(root)
        self.wheels = {wheel.joint: (part, wheel) for part in layout.parts for wheel in part.wheels}
        self.carried = {part.joint: part for part in layout.parts if part.joint}
        self.middles = {}  # of the wheels, in the frames of their links
        for name, (_, wheel) in self.wheels.items():
            pose = self.document.pose(wheel.link)
            self.middles[name] = pose[:3, :3].T @ (wheel.centre - pose[:3, 3])
        self.corners = {wheel.joint: corner for corner, wheel in layout.corners.items()}
        self.axes = {}  # of the joints that move, exactly to the left or upward, in their own frames
        for joint, axis in [
            *((name, wheel.sign * left) for name, (_, wheel) in self.wheels.items()),
            *((name, part.sign * UP) for name, part in self.carried.items()),
        ]:
            self.axes[joint] = self.document.pose(self.document.joints[joint].child)[:3, :3].T @ axis

    def angle(self, part: Part, values: Mapping[str, float], suffix: str = "") -> float:
        """Return the angle (or with a suffix, the rate) of the vertical joint of a part."""
        if part in self.layout.arm:
            return part.sign * values[f"q_{self.layout.arm.index(part) + 1}{suffix}"]
        if part in self.layout.steered:
            return part.sign * values[f"delta{suffix}"]
        k = self.layout.trailers.index(part)
        before = f"phi_{k}" if k else "phi"
        return part.sign * (values[f"phi_{k + 1}{suffix}"] - values[f"{before}{suffix}"])

    def poses(self, q: Mapping[str, float], quarter: int = 0) -> dict[str, np.ndarray]:
        """Return the pose of every link; all wheels are turned by some quarter turns."""
        c, s = np.cos(q["phi"]), np.sin(q["phi"])
        plane = np.array([[c, -s, 0, q["x"]], [s, c, 0, q["y"]], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        poses = {self.document.root: plane @ self.root}
        for link in self.document.subtree(self.document.root)[1:]:
            joint = self.document.carrier[link]
            turn = np.eye(4)
            if joint.name in self.wheels:
                turn = _turned(self.axes[joint.name], quarter * np.pi / 2)
            elif joint.name in self.carried:
                turn = _turned(self.axes[joint.name], self.angle(self.carried[joint.name], q))
            poses[link] = poses[joint.parent] @ placed(joint) @ turn
        return poses

    def twists(self, q, rates: Mapping[str, float], poses: dict[str, np.ndarray]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return the velocity (m/s) of every link's frame and its angular velocity (rad/s), in the world."""
        turning = {name: self.angle(part, rates, "_dot") for name, part in self.carried.items()}
        without = self._moved(q, rates, poses, turning)
        speeds = {name: self._rolling(poses, without, wheel) for name, (_, wheel) in self.wheels.items()}
        spins = {name: self._spin(part, wheel, rates, speeds) for name, (part, wheel) in self.wheels.items()}
        return self._moved(q, rates, poses, turning | spins)

    def slip(self, q, rates: Mapping[str, float]) -> float:
        """Return the largest velocity (m/s) of the lowest point of a wheel over the ground."""
        poses = self.poses(q)
        twists = self.twists(q, rates, poses)
        worst = 0.0
        for _, wheel in self.wheels.values():
            v = self._middle(poses, twists, wheel) + np.cross(twists[wheel.link][1], -wheel.radius * UP)
            if wheel.roller is None:
                worst = max(worst, float(np.linalg.norm(v)))
            else:  # on a roller only the velocity along its axis is slip
                direction = q["phi"] + wheel.roller
                worst = max(worst, abs(float(v @ [np.cos(direction), np.sin(direction), 0.0])))
        return worst

    def mass_matrix(self, names: list[str], q: Mapping[str, float]) -> np.ndarray:
        """Return the mass matrix in coordinates of these names, its wheels averaged over a turn."""
        mean = np.zeros((len(names), len(names)))
        for quarter in range(QUARTERS):
            poses = self.poses(q, quarter)
            columns = [self.twists(q, {f"{n}_dot": float(n == name) for n in names}, poses) for name in names]
            for link, pose in poses.items():
                body = self.document.inertial(link)
                if body is None:
                    continue
                body = body.seen_from(pose)
                turns = np.array([column[link][1] for column in columns])
                arm = body.centre - pose[:3, 3]
                speeds = np.array([column[link][0] for column in columns]) + np.cross(turns, arm)
                mean += (body.mass * speeds @ speeds.T + turns @ body.inertia @ turns.T) / QUARTERS
        return mean

    def _moved(self, q, rates, poses, joints: Mapping[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        turn = rates["phi_dot"] * UP
        at = np.array([rates["x_dot"], rates["y_dot"], 0.0])
        root = self.document.root
        velocities = {root: (at + np.cross(turn, poses[root][:3, 3] - np.array([q["x"], q["y"], 0.0])), turn)}
        for link in list(poses)[1:]:
            joint = self.document.carrier[link]
            v, w = velocities[joint.parent]
            v = v + np.cross(w, poses[link][:3, 3] - poses[joint.parent][:3, 3])
            if joint.name in joints:
                w = w + joints[joint.name] * (poses[link][:3, :3] @ self.axes[joint.name])
            velocities[link] = v, w
        return velocities

    def _middle(self, poses, twists, wheel: LinkWheel) -> np.ndarray:
        """Return the velocity of the middle of a wheel, m/s."""
        v, w = twists[wheel.link]
        return v + np.cross(w, poses[wheel.link][:3, :3] @ self.middles[wheel.joint])

    def _rolling(self, poses, twists, wheel: LinkWheel) -> float:
        """Return the rate at which a wheel would roll forward, rad/s."""
        axle = poses[wheel.link][:3, :3] @ self.axes[wheel.joint] * wheel.sign
        return float(self._middle(poses, twists, wheel) @ np.cross(axle, UP)) / wheel.radius

    def _spin(self, part: Part, wheel: LinkWheel, rates: Mapping[str, float], speeds: Mapping[str, float]) -> float:
        """Return the rate of a wheel's joint: that of its coordinate, or, if it has none, that at which it rolls."""
        layout = self.layout
        left = layout.seen(wheel.centre, layout.base.origin)[1]
        if layout.kind == "mecanum":
            rolling = rates[f"theta_{self.corners[wheel.joint]}_dot"]
        elif part is layout.base and not layout.steered:
            rolling = rates["theta_l_dot" if left > 0 else "theta_r_dot"]
        elif part is layout.base and not layout.front:
            rolling = rates["theta_dot"] - left / wheel.radius * rates["phi_dot"]
        elif part in layout.steered and layout.front:
            rolling = rates["theta_dot"]
        else:
            alike = [each.joint for p in layout.steered for each in p.wheels] if part in layout.steered else [wheel.joint]
            rolling = float(np.mean([speeds[joint] for joint in alike]))
        return wheel.sign * rolling


def compare(system: ReducedSystem, layout: Layout) -> tuple[float, float | None]:
    """Return the largest relative difference of the mass matrix, and the largest velocity of a rim in rolling (of the fastest
    link's), at random states; None where a pair of wheels is described by one, or four by two.
    """
    robot, kinematics = system.mechanism, LinkMotion(layout)
    names = [coordinate.name for coordinate in robot.coordinates]
    values = [parameter.default for parameter in robot.parameters]
    M = ca.Function("M", [robot.q, robot.p], [ca.densify(robot.M)])
    S = ca.Function("S", [robot.q, robot.p], [ca.densify(system.S)])
    random, worst, slip = np.random.default_rng(1992), 0.0, 0.0
    for _ in range(STATES):
        numbers = random.uniform(-1.2, 1.2, len(names))
        q = dict(zip(names, numbers, strict=True))
        expected = kinematics.mass_matrix(names, q)
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        worst = max(worst, float(np.abs((M(numbers, values).full() - expected) / scale).max()))
        rates = S(numbers, values).full() @ random.uniform(-1.0, 1.0, system.dof)
        named = {f"{name}_dot": rate for name, rate in zip(names, rates, strict=True)}
        slip = max(slip, kinematics.slip(q, named) / float(np.abs(rates).max()))
    exact = layout.kind != "skid steer" and len(layout.steered) < 2
    return worst, slip if exact else None


def _turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation by an angle about an axis of length 1, 4 x 4 (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    transform = np.eye(4)
    transform[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return transform
