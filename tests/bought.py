"""URDFs of the kinds that are published: one function with parameters, and by name what makes a file like
that of a robot.

Names, frames, shapes and extensions are as such files have them; the numbers are ours.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .urdfs import numbers

AXES = {  # how files turn the axis of a wheel to the left: <axis>, rpy of the joint, rpy of a cylinder
    "y": ("0 1 0", "0 0 0", "1.5707963267948966 0 0"),
    "-y": ("0 -1 0", "0 0 0", "1.5707963267948966 0 0"),
    "z": ("0 0 1", "-1.5707963267948966 0 0", "0 0 0"),
    "-z": ("0 0 -1", "-1.5707963267948966 0 0", "0 0 0"),
    "z 1.57": ("0 0 1", "-1.57 0 0", "0 0 0"),
    "z up": ("0 0 -1", "1.5708 0 0", "0 0 0"),
    "x": ("1 0 0", "0 0 1.5708", "0 1.5707963 0"),
    "none": (None, "0 0 1.570796", "0 1.5707963 0"),
}


@dataclass
class Bought:
    """The text of a URDF, put together element by element, and what is in it: the centre of each wheel (m) in
    the frame of the root by joint, their radius (m), and where castors stand, by link.
    """

    name: str
    parts: list[str] = field(default_factory=list)
    wheels: dict[str, np.ndarray] = field(default_factory=dict)
    castors: dict[str, np.ndarray] = field(default_factory=dict)
    radius: float = 0.1
    options: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        return f'<?xml version="1.0"?>\n<robot name="{self.name}">\n' + "\n".join(self.parts) + "\n</robot>\n"

    def link(
        self,
        name: str,
        mass: float | None = None,
        shape: str = "",
        place=(0, 0, 0),
        moments=(1, 1, 1),
        rpy="0 0 0",
    ) -> None:
        inertial = ""
        if mass is not None:
            ixx, iyy, izz = (float(mass) * moment for moment in moments)
            inertial = (
                f'<inertial><origin xyz="{numbers(place)}" rpy="{rpy}"/><mass value="{mass!r}"/>'
                f'<inertia ixx="{ixx!r}" ixy="0" ixz="0" iyy="{iyy!r}" iyz="0" izz="{izz!r}"/></inertial>'
            )
        self.parts.append(f'<link name="{name}">{inertial}{shape}</link>')

    def joint(
        self,
        name: str,
        kind: str,
        parent: str,
        child: str,
        place=(0, 0, 0),
        rpy="0 0 0",
        axis: str | None = None,
        more="",
    ) -> None:
        about = f'<axis xyz="{axis}"/>' if axis else ""
        limit = (
            '<limit lower="-1" upper="1" effort="9" velocity="9"/>'
            if kind in ("revolute", "prismatic")
            else ""
        )
        self.parts.append(
            f'<joint name="{name}" type="{kind}"><origin xyz="{numbers(place)}" rpy="{rpy}"/><parent '
            f'link="{parent}"/><child link="{child}"/>{about}{limit}{more}</joint>'
        )

    def fixed(
        self, child: str, parent: str, place=(0, 0, 0), mass: float | None = None, shape: str = "", **more
    ) -> None:
        self.link(child, mass, shape, moments=(1e-4,) * 3, **more)
        self.joint(f"{child}_joint", "fixed", parent, child, place)


def shape(geometry: str, xyz="0 0 0", rpy="0 0 0", kinds: Sequence[str] = ("collision", "visual")) -> str:
    return "".join(
        f'<{kind}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></{kind}>' for kind in kinds
    )


def bought(
    name: str = "bought",
    radius: float = 0.1,
    track: float = 0.4,
    wheelbase: float = 0.0,
    mass: float = 8.0,
    centre: Sequence[float] = (0.03, 0.01, 0.15),
    axis: str = "y",
    names: Callable[[str], str] = "wheel_{}".format,
    root: str = "base_footprint",
    castors: Sequence[tuple[float, float]] = (),
    castor: str = "sphere",
    drive: str = "transmission",
    geometry: str = "cylinder",
    turned: str = "0.1 0.2 0.3",
    more: Callable[[Bought], None] = lambda made: None,
) -> Bought:
    """A body on two wheels, or with a `wheelbase` on four (m), whose axle, or the middle of the wheels, is
    above the origin of the root. `castors` are places ahead and to the left (m).
    """
    made = Bought(name, radius=radius)
    made.link("base_footprint")
    if root == "planar":
        made.parts.insert(0, '<link name="world"/><link name="slide"/><link name="turn"/>')
        made.joint("in_x", "prismatic", "world", "slide", axis="1 0 0")
        made.joint("in_y", "prismatic", "slide", "turn", axis="0 1 0")
        made.joint("about_z", "continuous", "turn", "base_footprint", axis="0 0 1")
    elif root in ("floating", "planar joint"):
        made.parts.insert(0, '<link name="world"/>')
        made.joint("placed", root.split()[0], "world", "base_footprint", axis="0 0 1")
    size = f'<box size="{max(0.5, wheelbase) + 0.1!r} {track - 0.06!r} 0.12"/>'
    box = shape(size, "0 0 0.1") if mass else ""
    made.link("base_link", mass, box, centre, (0.03, 0.05, 0.06), turned)
    made.joint("base_joint", "fixed", "base_footprint", "base_link", (0, 0, 0.02))
    about, rpy, lie = AXES[axis]
    ends = [("front_", wheelbase / 2), ("rear_", -wheelbase / 2)] if wheelbase else [("", 0.0)]
    for end, ahead in ends:
        for side, left in (("left", track / 2), ("right", -track / 2)):
            link, own = names(f"{end}{side}"), f'<cylinder radius="{radius!r}" length="0.03"/>'
            made.link(
                link,
                0.4,
                shape(own if geometry == "cylinder" else geometry.format(side), rpy=lie),
                moments=spun(radius, axis),
            )
            joint = f"{link}_joint"
            made.joint(
                joint,
                "continuous",
                "base_link",
                link,
                (ahead, left, radius - 0.02),
                rpy,
                about,
                '<limit effort="5" velocity="9"/>',
            )
            made.wheels[joint] = np.array([ahead, left, radius])
    for k, (ahead, left) in enumerate(castors):
        add_castor(made, castor, f"{'idler' if castor == 'idle' else 'caster'}_{k}", ahead, left)
    driven(made, drive)
    more(made)
    return made


def spun(radius: float, axis: str) -> tuple[float, float, float]:
    """The moments of a disc of 1 kg about its axle and across."""
    about, across = radius**2 / 2, radius**2 / 4
    k = {"y": 1, "z": 2, "x": 0, "n": 0}[axis.strip("-")[0]]
    return tuple(about if i == k else across for i in range(3))


def add_castor(made: Bought, kind: str, name: str, ahead: float, left: float) -> None:
    """A castor that stands ahead and to the left: a sphere, a box, or a wheel on a swivel,
    above it or with trail."""
    height = 0.04
    if kind in ("sphere", "box"):
        body = (
            f'<sphere radius="{height!r}"/>'
            if kind == "sphere"
            else f'<box size="0.03 0.03 {2 * height!r}"/>'
        )
        made.fixed(f"{name}_link", "base_link", (ahead, left, height - 0.02), 0.05, shape(body))
        made.castors[f"{name}_link"] = np.array([ahead, left, 0.0])
        return
    trail = 0.03 if kind == "swivel" else 0.0
    made.link(f"{name}_fork", 0.1, moments=(1e-4,) * 3)
    made.joint(
        f"{name}_pivot", "continuous", "base_link", f"{name}_fork", (ahead + trail, left, 0.1), axis="0 0 1"
    )
    body = shape(f'<cylinder radius="{height!r}" length="0.02"/>', rpy="1.5708 0 0")
    made.link(f"{name}_wheel", 0.1, body, moments=spun(height, "y"))
    made.joint(
        f"{name}_axle",
        "continuous",
        f"{name}_fork",
        f"{name}_wheel",
        (-trail, 0, height - 0.12),
        axis="0 1 0",
    )
    made.castors[f"{name}_wheel"] = np.array([ahead, left, 0.0])


def driven(made: Bought, how: str) -> None:
    """Say that the wheels are driven, as ROS 1, ROS 2 or Gazebo have it."""
    for joint in made.wheels:
        if how == "transmission":
            made.parts.append(
                f'<transmission name="{joint}_trans"><type>transmission_interface/SimpleTransmission</type>'
                f'<joint name="{joint}"><hardwareInterface>VelocityJointInterface</hardwareInterface></joint>'
                f'<actuator name="{joint}_motor"/></transmission>'
            )
        elif how == "ros2_control":
            made.parts.append(
                f'<ros2_control name="{joint}" type="system"><joint name="{joint}"><command_interface '
                'name="velocity"/><state_interface name="position"/></joint></ros2_control>'
            )
    if how == "gazebo":
        sides = "".join(f"<{j.split('_')[1]}_joint>{j}</{j.split('_')[1]}_joint>" for j in made.wheels)
        made.parts.append(
            f'<gazebo><plugin name="drive" filename="libgazebo_ros_diff_drive.so">{sides}</plugin></gazebo>'
        )
        made.parts.append(
            '<gazebo reference="base_link"><material>Gazebo/Orange</material><mu1>0.2</mu1></gazebo>'
        )


def sensors(made: Bought) -> None:
    """What hangs on many robots: frames, sensors of no or little mass, a mast that moves,
    a gripper that mimics, an arm."""
    made.parts += ['<material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>'] * 2
    made.fixed(
        "base_scan", "base_link", (0.1, 0, 0.2), 0.1, shape('<mesh filename="package://none/laser.dae"/>')
    )
    made.fixed("imu_link", "base_link", (0, 0, 0.1), 1e-5)
    made.fixed("sonar_link", "base_link", (0.2, 0, 0.1), 0.0, shape('<box size="0.01 0.01 0.01"/>'))
    made.fixed(
        "camera_link",
        "base_link",
        (0.2, 0, 0.3),
        None,
        shape('<box size="0.02 0.09 0.03"/>', "0.01 0 0", "1.57 0 1.57"),
    )
    made.fixed("camera_optical_frame", "camera_link")
    made.link("mast", 0.5, moments=(0.01,) * 3)
    made.joint("lift", "prismatic", "base_link", "mast", (-0.1, 0, 0.2), axis="0 0 1")
    for side, sign in (("left", 1), ("right", -1)):
        made.link(f"{side}_finger", 0.05, moments=(1e-4,) * 3)
        mimic = '<mimic joint="left_finger_joint"/>' if side == "right" else ""
        made.joint(
            f"{side}_finger_joint",
            "prismatic",
            "mast",
            f"{side}_finger",
            (0.3, 0.02 * sign, 0),
            axis=f"0 {sign} 0",
            more=mimic,
        )


def mesh_with_shaft(folder: Path, name: str, scale: float = 1000.0) -> None:
    """Write the tyre of radius 0.1 m from 0 to 25 mm along z, with a shaft of radius 10 mm on to 80 mm,
    in 1/scale m."""
    import trimesh

    tyre = trimesh.creation.cylinder(0.1, 0.025, sections=48)
    tyre.apply_translation([0, 0, 0.0125])
    shaft = trimesh.creation.cylinder(0.01, 0.055, sections=12)
    shaft.apply_translation([0, 0, 0.0525])
    whole = trimesh.util.concatenate([tyre, shaft])
    whole.apply_scale(scale)
    whole.export(folder / name)


KINDS: dict[str, Callable[[], Bought]] = {
    "burger": lambda: bought(
        radius=0.033,
        track=0.16,
        mass=0.9,
        centre=(-0.01, 0, 0.05),
        axis="z 1.57",
        castors=[(-0.08, 0)],
        castor="box",
    ),
    "waffle": lambda: bought(
        radius=0.033,
        track=0.287,
        mass=1.4,
        centre=(-0.03, 0.01, 0.05),
        axis="z 1.57",
        castors=[(-0.17, -0.06), (-0.17, 0.06)],
        castor="box",
    ),
    "kobuki": lambda: bought(
        radius=0.035, track=0.23, centre=(0.01, 0, 0.06), axis="z", castors=[(0.115, 0), (-0.135, 0)]
    ),
    "create": lambda: bought(
        radius=0.033, track=0.26, axis="y", castors=[(0.13, 0)], drive="gazebo", centre=(0.02, 0, 0.05)
    ),
    "p3dx": lambda: bought(
        track=0.33, castors=[(-0.21, 0)], castor="swivel", more=sensors, centre=(-0.05, 0, 0.1)
    ),
    "mir": lambda: bought(
        radius=0.0625,
        track=0.445,
        mass=60.0,
        castors=[(a, b) for a in (0.24, -0.26) for b in (-0.19, 0.19)],
        castor="swivel",
    ),
    "tiago": lambda: bought(
        radius=0.0985,
        track=0.4,
        mass=28.0,
        castors=[(a, b) for a in (0.17, -0.17) for b in (-0.1, 0.1)],
        castor="swivel",
        axis="z up",
        centre=(0, 0, 0.2),
    ),
    "freight": lambda: bought(
        mass=70.0, centre=(-0.004, 0, 0.2), more=sensors, drive="none", root="planar joint"
    ),
    "diffbot": lambda: bought(
        axis="z", castors=[(0.2, 0), (-0.2, 0)], drive="ros2_control", names="{}_wheel".format
    ),
    "linorobot": lambda: bought(axis="-y", centre=(-0.03, 0, 0.1), castors=[(-0.2, 0)], drive="gazebo"),
    "dingo": lambda: bought(
        axis="-z", castors=[(0.2, 0.1), (0.2, -0.1)], centre=(0.05, 0, 0.1), root="planar"
    ),
    "magni": lambda: bought(
        axis="x", castors=[(-0.3, 0.1), (-0.3, -0.1)], castor="swivel", centre=(-0.1, 0, 0.1), root="floating"
    ),
    "rb1": lambda: bought(
        axis="none",
        castors=[(0.2, 0), (-0.2, 0.1), (-0.2, -0.1)],
        drive="none",
        centre=(0, 0.02, 0.3),
        more=sensors,
    ),
    "idle": lambda: bought(castors=[(0.25, 0)], castor="idle", centre=(0.05, 0, 0.1)),
    "husky": lambda: bought(wheelbase=0.5, track=0.57, radius=0.17, mass=33.0, more=sensors),
    "jackal": lambda: bought(wheelbase=0.26, track=0.37, drive="none", centre=(0.01, 0.002, 0.07)),
    "p3at": lambda: bought(wheelbase=0.27, track=0.39, axis="-y", castors=[]),
}
SKID = {"husky": 1.1, "jackal": 0.7, "p3at": 0.8}  # effective tracks, m
