"""URDFs for tests: links with inertial frames that are turned and shifted, joints with turned frames,
fixed links."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

BESIDE = 0.02  # m from the joint of a wheel to its middle
QUARTER = 1.5707963267948966
WHEEL = "-1.5707963267948966 0 0"  # rpy of a joint whose z axis is then to the left


def numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


@dataclass
class Urdf:
    """The text of a URDF, put together link by link; random numbers are the same in every run."""

    name: str
    parts: list[str] = field(default_factory=list)
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(7))

    @property
    def text(self) -> str:
        return f'<?xml version="1.0"?>\n<robot name="{self.name}">\n' + "\n".join(self.parts) + "\n</robot>\n"

    def link(self, name: str, mass: float = 0.0, place=(0, 0, 0), shape: str = "") -> None:
        """A link, with a random inertia in a frame turned at random if it has a mass."""
        inertial = ""
        if mass:
            root = self.random.uniform(-0.1, 0.1, (3, 3))
            second = root @ root.T + 0.01 * np.eye(3)  # of a body: the inertia is its trace less it
            inertia = mass * (np.trace(second) * np.eye(3) - second)
            inertial = self.inertial(mass, place, self.random.uniform(-1, 1, 3), inertia)
        self.parts.append(f'<link name="{name}">{inertial}{shape}</link>')

    @staticmethod
    def inertial(mass, place, rpy, inertia) -> str:
        names = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
        entries = " ".join(f'{name}="{float(inertia[i][k])!r}"' for name, i, k in names)
        origin = f'<origin xyz="{numbers(place)}" rpy="{numbers(rpy)}"/>'
        return f'<inertial>{origin}<mass value="{mass!r}"/><inertia {entries}/></inertial>'

    def wheel(self, name: str, parent: str, place, radius=0.1, mass=0.5, backward=False, **joint) -> None:
        """A wheel about the z axis of its joint, which is to the left, or with `backward` to the right."""
        inertia = np.diag([0.6, 0.6, 1.0]) * mass * radius**2 / 2
        cylinder = f'<geometry><cylinder radius="{radius!r}" length="0.04"/></geometry>'
        shape = f'<collision>{cylinder}<origin xyz="0 0 {BESIDE}"/></collision>'
        self.parts.append(
            f'<link name="{name}">{self.inertial(mass, (0, 0, 0.01), (0, 0, 0.3), inertia)}{shape}</link>'
        )
        place = np.subtract(place, (0, BESIDE, 0))
        self.joint(
            f"{name}_joint", "continuous", parent, name, place, WHEEL, (0, 0, -1 if backward else 1), **joint
        )

    def joint(
        self, name, kind, parent, child, place=(0, 0, 0), rpy="0 0 0", axis=(0, 0, 1), limit=(-1.0, 1.0)
    ) -> None:
        limits = (
            f'<limit lower="{limit[0]}" upper="{limit[1]}" effort="1" velocity="1"/>'
            if kind in ("revolute", "prismatic")
            else ""
        )
        self.parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{numbers(place)}" rpy="{rpy}"/><axis xyz="{numbers(axis)}"/>{limits}</joint>'
        )

    def drives(self, *joints: str) -> None:
        self.parts += [
            f'<transmission name="of_{joint}"><joint name="{joint}"/></transmission>' for joint in joints
        ]


def body(name: str) -> Urdf:
    """A body whose frame is on the ground in the middle of the fixed axle,
    with a box fixed to it and a castor."""
    made = Urdf(name)
    made.link("base", 8.0, (0.1, 0.02, 0.2))
    made.link("box", 1.5, (0.05, 0.01, 0.03))
    made.joint("box_joint", "fixed", "base", "box", (-0.1, 0.08, 0.3), "0.4 -0.2 0.7")
    return made


def two_wheels() -> Urdf:
    made = body("cart")
    made.wheel("right", "base", (0, -0.2, 0.1), backward=True)
    made.wheel("left", "base", (0, 0.2, 0.1), mass=0.7)
    made.link("castor", 0.05, shape='<collision><geometry><sphere radius="0.03"/></geometry></collision>')
    made.joint("castor_joint", "fixed", "base", "castor", (0.25, 0, 0.03), "0.3 0 0")
    made.link("lidar", 0.2, (0.01, 0, 0))
    made.joint("lidar_joint", "continuous", "base", "lidar", (0.1, 0, 0.4), "0 0 0.2")
    return made


def trailers(count: int) -> Urdf:
    """Trailers, the first hitched behind the axle, the last by a joint that is upside down."""
    made = two_wheels()
    for k in range(1, count + 1):
        parent, hitch = (f"trailer_{k - 1}", (-0.5, 0, 0)) if k > 1 else ("base", (-0.1, 0, 0.1))
        turn, sign = (2 * QUARTER, -1) if k == count else (0.0, 1)
        made.link(f"trailer_{k}", 3.0, (-0.4, 0.02, 0.1))
        made.joint(f"hitch_{k}", "continuous", parent, f"trailer_{k}", hitch, f"{turn!r} 0 0")
        for side, name in ((-1, "right"), (1, "left")):
            made.wheel(f"{name}_{k}", f"trailer_{k}", (-0.5, sign * side * 0.15, 0), mass=0.5 + 0.1 * side)
    return made


def steered(pair: bool, front: bool = False, ahead: float = 0.0) -> Urdf:
    """A car or a tricycle, driven at the rear or in front, with wheels `ahead` (m) of their steering axes."""
    made = body("wagon" if pair else "trike")
    for side, name in ((-1, "right"), (1, "left")):
        made.wheel(name, "base", (0, side * 0.3, 0.1), backward=side > 0)
    for side, name in ((-1, "_right"), (1, "_left")) if pair else ((0, ""),):
        made.link(f"knuckle{name}", 0.4, (0.02, 0.01 * side, 0.03))
        down = side > 0
        made.joint(
            f"steering{name}",
            "revolute",
            "base",
            f"knuckle{name}",
            (0.8, side * 0.25, 0.1),
            axis=(0, 0, -1 if down else 1),
        )
        made.wheel(f"front{name}", f"knuckle{name}", (ahead, side * 0.05, 0), mass=0.6)
    made.drives(*(("front_joint",) if front else ("left_joint", "right_joint")))
    return made


def four_wheels() -> Urdf:
    made = body("husky_like")
    for ahead, place in ((0.25, "front"), (-0.25, "rear")):
        for side, name in ((-1, "right"), (1, "left")):
            made.wheel(f"{place}_{name}", "base", (ahead, side * 0.3, 0.1))
    return made


def mecanum(rollers: int = 8) -> Urdf:
    """Four wheels of radius 0.1 m with rollers, which have joints; without any, their wheels are cylinders.
    The left ones turn about an axis to the right.
    """
    made = body("mecanum_cart")
    for ahead, place in ((0.25, "front"), (-0.25, "rear")):
        for side, name in ((-1, "right"), (1, "left")):
            wheel = f"{place}_{name}"
            made.wheel(wheel, "base", (ahead, side * 0.25, 0.1), mass=0.6, backward=side > 0)
            if rollers:
                made.parts[-2] = made.parts[-2].partition("<collision>")[0] + "</link>"
            slant = np.sign(ahead) * -side * QUARTER / 2  # 45 deg for the front right one
            for k in range(rollers):
                angle = 2 * np.pi * k / rollers
                outward, tangent = (
                    np.array([np.cos(angle), np.sin(angle), 0]),
                    np.array([-np.sin(angle), np.cos(angle), 0]),
                )
                axis = np.cos(slant) * tangent - np.sin(slant) * np.array([0, 0, 1])
                roller, off = f"{wheel}_roller_{k}", -0.01 * axis  # its link's origin is off the middle
                shape = (
                    f'<collision><origin xyz="{numbers(-off)}"/><geometry><sphere '
                    'radius="0.02"/></geometry></collision>'
                )
                inertial = made.inertial(0.03, -off, (0, 0, 0), 1e-5 * np.eye(3))
                made.parts.append(f'<link name="{roller}">{inertial}{shape}</link>')
                place_of = 0.08 * outward + np.array([0, 0, BESIDE]) + off
                made.joint(f"{roller}_joint", "continuous", wheel, roller, place_of, axis=axis)
    return made


def with_arm(made: Urdf) -> Urdf:
    """With an arm: two vertical joints, the second upside down on a flange,
    and a wrist that cannot move in the plane."""
    made.link("upper_arm", 1.2, (0.2, 0.01, 0.05))
    made.joint("shoulder", "revolute", "base", "upper_arm", (-0.3, 0.03, 0.4), "0 0 0.5")
    made.link("flange", 0.1, (0.01, 0, 0))
    made.joint("flange_joint", "fixed", "upper_arm", "flange", (0.4, 0.02, 0.1), "0 0 -0.3")
    made.link("forearm", 0.8, (0.15, -0.02, 0.02))
    made.joint("elbow", "continuous", "flange", "forearm", axis=(0, 0, -1))
    made.link("hand", 0.3, (0.05, 0, 0))
    made.joint("wrist", "revolute", "forearm", "hand", (0.3, 0, 0), axis=(0, 1, 0))
    return made


def turtlebot3(model: str) -> Urdf:
    """The links of a TurtleBot3 that have mass, from ROBOTIS' turtlebot3_burger.urdf or
    turtlebot3_waffle_pi.urdf, without meshes.
    """
    mass, moments, half, castors, scan = {
        "burger": (
            8.2573504e-01,
            (2.2124416e-03, 2.1193702e-03, 2.0064271e-03),
            0.08,
            {"": (-0.081, 0, -0.004)},
            -0.032,
        ),
        "waffle_pi": (
            1.3729096,
            (8.7002718e-03, 8.6195418e-03, 1.4612727e-02),
            0.144,
            {"_right": (-0.177, -0.064, -0.004), "_left": (-0.177, 0.064, -0.004)},
            -0.064,
        ),
    }[model]
    made = Urdf(f"turtlebot3_{model}")

    def link(name: str, mass: float, moments, shape: str = "") -> None:
        made.parts.append(
            f'<link name="{name}">{made.inertial(mass, (0, 0, 0), (0, 0, 0), np.diag(moments))}{shape}</link>'
        )

    link("base_link", mass, moments)
    for name, side in (("left", half), ("right", -half)):
        rim = '<collision><geometry><cylinder length="0.018" radius="0.033"/></geometry></collision>'
        link(f"wheel_{name}_link", 2.8498940e-02, (1.1175580e-05, 1.1192413e-05, 2.0712558e-05), rim)
        made.joint(
            f"wheel_{name}_joint",
            "continuous",
            "base_link",
            f"wheel_{name}_link",
            (0, side, 0.023),
            "-1.57 0 0",
        )
    box = (
        '<collision><origin xyz="0 0.001 0"/><geometry><box size="0.030 0.009 0.020"/></geometry></collision>'
    )
    for name, place in castors.items():
        link(f"caster_back{name}_link", 0.005, (1e-3, 1e-3, 1e-3), box)
        made.joint(
            f"caster_back{name}_joint", "fixed", "base_link", f"caster_back{name}_link", place, "-1.57 0 0"
        )
    link("base_scan", 0.114, (1e-3, 1e-3, 1e-3))
    made.joint("scan_joint", "fixed", "base_link", "base_scan", (scan, 0, 0.172))
    return made


ROBOTS = {
    "two_wheels": two_wheels,
    "car": lambda: steered(pair=True),
    "tricycle": lambda: steered(pair=False, front=True),
    "tricycle_driven_at_the_rear": lambda: steered(pair=False),
    "skid_steer": four_wheels,
    "mecanum": mecanum,
    "trailer": lambda: trailers(1),
    "two_trailers": lambda: trailers(2),
    "arm": lambda: with_arm(two_wheels()),
    "arm_on_rollers": lambda: with_arm(mecanum()),
    "arm_on_a_car": lambda: with_arm(steered(pair=True)),
}
