"""Compares a robot with the URDF that it was made from, whose bodies move in space."""

from collections.abc import Mapping

import casadi as ca
import numpy as np

from ...model.reduction import ReducedSystem
from ..errors import BadInput
from .parts import UP, Layout, LinkWheel, Part
from .rims import ON_LINE, ROUND, touches

STATES = 10
QUARTERS = 4  # turns of the wheels over which their bodies are averaged
TURNS = 12  # of a wheel, at which its lowest points are looked for


class LinkMotion:
    """The motion of the links of a URDF that move by themselves, with what is fixed to them.

    It is given by the coordinates of a robot file, by name, and their rates.
    """

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
        self.axes = {}  # of the joints that move, in their own frames
        for joint, axis in [
            *((name, wheel.sign * left) for name, (_, wheel) in self.wheels.items()),
            *((name, part.sign * UP) for name, part in self.carried.items()),
        ]:
            self.axes[joint] = self.document.pose(self.document.joints[joint].child)[:3, :3].T @ axis
        moving = [self.document.joints[name].child for name in self.axes]
        self.tops = [
            link
            for link in self.document.subtree(self.document.root)
            if link in {self.document.root, *moving}
        ]
        self.before = {top: self._carrier(top) for top in self.tops[1:]}
        self.inertias = {top: self._inertia(top, {*moving}) for top in self.tops}

    def _carrier(self, link: str) -> str:
        """Return the link that moves by itself and carries this one."""
        while (link := self.document.carrier[link].parent) not in self.tops:
            pass
        return link

    def _inertia(self, top: str, moving: set[str]) -> np.ndarray:
        """Return the inertia of a link with all that is fixed to it, 6 x 6, about its origin and along its
        axes.

        It belongs to the velocity (m/s) and the angular velocity (rad/s) in these axes.
        """
        document, back = self.document, np.linalg.inv(self.document.pose(top))
        links = document.subtree(top, lambda below: below.child not in moving)
        weighing = [(document.pose(link), body) for link in links if (body := document.inertial(link))]
        bodies = [body for _, body in weighing]
        poses = np.array([back @ pose for pose, _ in weighing]).reshape(-1, 4, 4)
        turn, mass = poses[:, :3, :3], np.array([body.mass for body in bodies])
        centres = np.array([body.centre for body in bodies]).reshape(-1, 3)
        x, y, z = np.einsum("kij,kj->ik", turn, centres) + poses[:, :3, 3].T
        zero = np.zeros(len(bodies))
        # Velocity of the centre: arm @ w
        arm = np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
        own = turn @ np.array([body.inertia for body in bodies]).reshape(-1, 3, 3) @ turn.swapaxes(1, 2)
        mixed = np.einsum("k,kij->ij", mass, arm)
        about = np.einsum("k,kli,klj->ij", mass, arm, arm) + own.sum(axis=0)
        return np.block([[mass.sum() * np.eye(3), mixed], [mixed.T, about]])

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
        """Return the pose of every link that moves by itself; all wheels are turned by some quarter turns."""
        c, s = np.cos(q["phi"]), np.sin(q["phi"])
        plane = np.array([[c, -s, 0, q["x"]], [s, c, 0, q["y"]], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        poses = {self.document.root: plane @ self.root}
        for link in self.tops[1:]:
            joint, before = self.document.carrier[link], self.before[link]
            wheel = joint.name in self.wheels
            angle = quarter * np.pi / 2 if wheel else self.angle(self.carried[joint.name], q)
            place = np.linalg.inv(self.document.pose(before)) @ self.document.pose(link)
            poses[link] = poses[before] @ place @ _turned(self.axes[joint.name], angle)
        return poses

    def twists(
        self, q, rates: Mapping[str, float], poses: dict[str, np.ndarray]
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
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
                back = pose[:3, :3].T
                motion = np.array(
                    [[*(back @ column[link][0]), *(back @ column[link][1])] for column in columns]
                )
                mean += motion @ self.inertias[link] @ motion.T / QUARTERS
        return mean

    def _moved(
        self, q, rates, poses, joints: Mapping[str, float]
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        turn = rates["phi_dot"] * UP
        at = np.array([rates["x_dot"], rates["y_dot"], 0.0])
        root = self.document.root
        velocities = {root: (at + np.cross(turn, poses[root][:3, 3] - np.array([q["x"], q["y"], 0.0])), turn)}
        for link in self.tops[1:]:
            joint, before = self.document.carrier[link], self.before[link]
            v, w = velocities[before]
            v = v + np.cross(w, poses[link][:3, 3] - poses[before][:3, 3])
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

    def _spin(
        self, part: Part, wheel: LinkWheel, rates: Mapping[str, float], speeds: Mapping[str, float]
    ) -> float:
        """Return the rate of a wheel's joint: that of its coordinate, or, if it has none,
        that at which it rolls."""
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
            alike = (
                [each.joint for p in layout.steered for each in p.wheels]
                if part in layout.steered
                else [wheel.joint]
            )
            rolling = float(np.mean([speeds[joint] for joint in alike]))
        return wheel.sign * rolling


def compare(system: ReducedSystem, layout: Layout) -> tuple[float, float | None]:
    """Return the largest relative difference of the mass matrix, and the largest velocity of a rim in rolling
    (of the fastest link's), at random states; None where a pair of wheels is described by one, or four by
    two.
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


def check_wheels(layout: Layout) -> None:
    """Raise BadInput unless each wheel's shapes reach the ground where its middle and its radius say.

    No mass matrix shows a wrong middle. The wheel is turned, and its lowest points are compared within ROUND
    and ON_LINE.
    """
    document, left = layout.document, np.cross(UP, layout.heading)
    for wheel in (wheel for part in layout.parts for wheel in part.wheels if wheel.kind):
        found = [
            touches(document, wheel.link, wheel.kind, left, turn) for turn in np.linspace(0.1, 6.2, TURNS)
        ]
        depths, middles = np.transpose(found)
        radius = depths.max() if wheel.source.startswith("--radius") else wheel.radius
        off = float(np.median(middles)) - left @ (wheel.centre - document.pose(wheel.link)[:3, 3])
        if abs(depths.max() / radius - 1) > ROUND or abs(off) > ON_LINE * wheel.radius:
            raise BadInput(
                f"{document.path}: nothing is written: the lowest points of link {wheel.link!r} are "
                f"{depths.max():.4g} m below its joint and {abs(off):.2g} m beside the middle of the wheel, "
                f"whose radius is {wheel.radius:.4g} m; please report this"
            )


def _turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation by an angle about an axis of length 1, 4 x 4 (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    transform = np.eye(4)
    transform[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return transform
