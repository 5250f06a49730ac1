"""Reads a URDF: links, joints and their numbers, each complete and finite,
or an error that names the link or joint."""

import io
import math
import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import BadInput, check_named, library, naming
from ..files import read_input
from .from_mjcf import urdf_of
from .inertial import Inertial

QUARTER = math.pi / 2
# rad: an angle so near to a multiple of a quarter turn, such as 1.57, is read as that multiple
ROUNDED = 2e-3
LARGEST = 1e30  # of any number
TRIANGLE = 1e-9  # relative: by how much a principal moment may exceed the sum of the others
NO_BODY = (
    "no body has such an inertia, with a principal moment above the sum of the others; correct <inertia>"
)
COMPLETE = {  # attributes that have no default in URDF, by element
    "robot": ("name",),
    "link": ("name",),
    "joint": ("name", "type"),
    "parent": ("link",),
    "child": ("link",),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "box": ("size",),
    "mesh": ("filename",),
}
ELEMENTS = {
    "inertial": ("mass", "inertia"),
    "joint": ("parent", "child"),
    "visual": ("geometry",),
    "collision": ("geometry",),
}
# In an element
ONCE = ("inertial", "mass", "inertia", "origin", "axis", "parent", "child", "geometry", "limit", "mimic")
VECTORS = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3}  # attributes with several numbers
NUMBERS = {
    *COMPLETE["inertia"],
    "radius",
    "length",
    "value",
    "multiplier",
    "offset",
    "lower",
    "upper",
    "effort",
    "velocity",
}
UNUSED = (
    "material",
    "gazebo",
    "transmission",
    "ros2_control",
    "dynamics",
    "calibration",
    "safety_controller",
)
# Plugins of Gazebo
MOVES = re.compile(r"diff_?drive|skid_?steer|ackermann|tricycle|mecanum|planar_move", re.IGNORECASE)
# Elements of these that name joints which they do not drive
LISTENS = re.compile(r"encoder|publish|state", re.IGNORECASE)
TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


@dataclass(frozen=True)
class Document:
    """A URDF as a tree. `links` and `joints` are yourdfpy's, by name; `driven` the joints that have a
    transmission or are driven by a plugin; `notes` what was not taken literally; `without_axis` the joints
    that turn about the x axis of their frame because the file names none; `vertices` those of meshes read so
    far, or that are in no file, (count, 3), by the name in <mesh>.
    """

    path: Path
    name: str
    links: Mapping[str, Any]
    joints: Mapping[str, Any]
    driven: frozenset[str]
    notes: tuple[str, ...] = ()
    without_axis: frozenset[str] = frozenset()
    vertices: dict[str, np.ndarray] = field(default_factory=dict)
    _inertials: dict[str, Inertial | None] = field(default_factory=dict)

    @cached_property
    def root(self) -> str:
        """The link that no joint carries."""
        carried = {joint.child for joint in self.joints.values()}
        return next(name for name in self.links if name not in carried)

    @cached_property
    def carrier(self) -> dict[str, Any]:
        """The joint that carries each link, but the root."""
        return {joint.child: joint for joint in self.joints.values()}

    def below(self, link: str) -> list[Any]:
        """Return the joints whose parent is this link."""
        return self._below.get(link, [])

    def subtree(self, link: str, follow: Callable[[Any], bool] = lambda joint: True) -> list[str]:
        """Return a link and all that it carries by joints for which `follow` holds, each after its parent."""
        links = [link]
        for each in links:
            links += [joint.child for joint in self._below.get(each, ()) if follow(joint)]
        return links

    @cached_property
    def _below(self) -> dict[str, list[Any]]:
        children: dict[str, list[Any]] = {}
        for joint in self.joints.values():
            children.setdefault(joint.parent, []).append(joint)
        return children

    @cached_property
    def _poses(self) -> dict[str, np.ndarray]:
        poses = {self.root: np.eye(4)}
        for link in self.subtree(self.root)[1:]:
            joint = self.carrier[link]
            poses[link] = poses[joint.parent] @ placed(joint)
        return poses

    def pose(self, link: str) -> np.ndarray:
        """Return the frame of a link in that of the root, 4 x 4, with all joints at zero."""
        return self._poses[link]

    def axis(self, joint: Any) -> np.ndarray:
        """Return the axis of a joint in the frame of the root, of length 1, with all joints at zero."""
        return self.pose(joint.child)[:3, :3] @ (np.asarray(joint.axis) / np.linalg.norm(joint.axis))

    def moved(self, origins: Mapping[str, np.ndarray]) -> "Document":
        """Return the same tree with other origins of some joints, 4 x 4, by name."""
        joints = {
            name: replace(joint, origin=origins.get(name, joint.origin))
            for name, joint in self.joints.items()
        }
        return replace(self, joints=joints)

    @cached_property
    def weightless(self) -> tuple[str, ...]:
        """Return the links with a mass of zero, whose inertia then means nothing."""
        return tuple(
            name for name, link in self.links.items() if link.inertial is not None and link.inertial.mass == 0
        )

    def inertial(self, link: str) -> Inertial | None:
        """Return mass, centre and inertia of a link in its own frame; None of one without mass.

        Raises BadInput for a mass or an inertia that no body has.
        """
        if link not in self._inertials:
            self._inertials[link] = _inertial(self.links[link], f"{self.path}: link {link!r}")
        return self._inertials[link]

    @cached_property
    def impossible_inertias(self) -> tuple[str, ...]:
        """Return the links whose inertia no body has: a principal moment exceeds the sum of the others."""
        inertias = {link: own.inertia for link in self.links if (own := self.inertial(link))}
        a, b, c = np.linalg.eigvalsh(np.array([*inertias.values()]).reshape(-1, 3, 3)).T
        return tuple(link for link, wrong in zip(inertias, c - a - b > TRIANGLE * c, strict=True) if wrong)


def placed(element: Any) -> np.ndarray:
    """Return the origin of an element of yourdfpy, 4 x 4."""
    return np.eye(4) if element.origin is None else np.asarray(element.origin)


def read(file: str, root: Any = None) -> Document:
    """Read a URDF; `root` is its first element if it is `parsed` already, whose angles are then exact. Raises
    BadInput, naming the link or joint, for a file that is not one complete tree, and OSError.
    """
    etree, URDF = _parsers()
    root = parsed(file) if root is None else root
    vertices: dict[str, np.ndarray] = {}
    if root.tag == "mujoco":
        root, vertices = urdf_of(file)
    notes = _checked(file, root)
    driven = {
        j.get("name")
        for path in ("transmission/joint", "ros2_control/joint[command_interface]")
        for j in root.iterfind(path)
    }
    for plugin in root.iterfind("gazebo/plugin"):
        if MOVES.search(f"{plugin.get('filename')} {plugin.get('name')}"):
            driven |= {(e.text or "").strip() for e in plugin.iter() if not LISTENS.search(str(e.tag))}
    without_axis = {
        j.get("name") for j in root.iterfind("joint") if j.get("type") != "fixed" and j.find("axis") is None
    }
    rubbing = [e.getparent().get("name") for e in root.iterfind("joint/dynamics") if _rubs(e)]
    if rubbing:
        notes = (*notes, f"damping and friction are left out: joints {', '.join(rubbing)}")
    used = deepcopy(root)
    etree.strip_elements(used, *UNUSED, with_tail=False)
    with naming(f"{file}: yourdfpy cannot read it", Exception):  # what has not been checked above
        robot = URDF.load(io.BytesIO(etree.tostring(used)), build_scene_graph=False, load_meshes=False).robot
    joints = {joint.name: joint for joint in robot.joints}
    links, transmitted = {link.name: link for link in robot.links}, frozenset(driven & joints.keys())
    document = Document(
        Path(file), robot.name, links, joints, transmitted, notes, frozenset(without_axis), vertices
    )
    _check_tree(document)
    return document


def parsed(file: str) -> Any:
    """Return the first element of a URDF or an MJCF, as lxml has it. Raises BadInput for another file,
    and OSError."""
    etree, _ = _parsers()
    with naming(f"{file}: not XML", etree.XMLSyntaxError, "correct it, or export it again"):
        root = etree.fromstring(read_input(file), etree.XMLParser(remove_comments=True, remove_pis=True))
    _refuse_unexpanded(file, root)
    if root.tag not in ("robot", "mujoco"):
        raise BadInput(
            f"{file}: the first element is <{root.tag}>, that of a URDF is <robot> and of an MJCF <mujoco>; "
            "give one"
        )
    return root


def _parsers() -> tuple[Any, Any]:
    """Return lxml's etree and yourdfpy's URDF. Raises BadInput if one is missing."""
    names = ("lxml.etree", "yourdfpy")
    etree, yourdfpy = (
        library(name, f"reading a URDF requires {name.split('.')[0]}", "physics") for name in names
    )
    return etree, yourdfpy.URDF


def _rubs(dynamics: Any) -> bool:
    """Return whether a joint has damping or friction."""
    return any(dynamics.get(name, "0").strip() not in ("0", "0.0") for name in ("damping", "friction"))


def _refuse_unexpanded(file: str, root: Any) -> None:
    """Raise BadInput for a xacro file."""
    lines = [
        element.sourceline
        for element in root.iter()
        if isinstance(element.tag, str)
        and (
            "xacro}" in element.tag
            or any(mark in value for value in element.attrib.values() for mark in ("${", "$("))
        )
    ]
    if file.endswith(".xacro") or lines:
        stem = re.sub(r"(\.urdf)?(\.xacro)?$", "", Path(file).name)
        line = f", line {lines[0]}" if lines else ""
        expanded = f"`xacro {file} -o {stem}.expanded.urdf` (pip install xacro)"
        raise BadInput(f"{file}{line}: a xacro file; expand it with {expanded} and give that")


def _checked(file: str, root: Any) -> tuple[str, ...]:
    """Check every number of links and joints and make angles such as 1.57 exact. Return notes about these.
    Raises BadInput."""
    rounded, repeated = list[str](), list[str]()
    named: dict[str, set[str]] = {"link": set(), "joint": set()}
    _check_complete(file, root)
    for owner in [e for kind in named for e in root.iterfind(kind)]:
        where = f"{file}: {owner.tag} {owner.get('name')!r}"
        if owner.get("name") in named[owner.tag]:
            raise BadInput(f"{where} is defined twice; rename one")
        named[owner.tag].add(owner.get("name"))
        for element in owner.iter():
            _check_complete(where, element)
            tags = [child.tag for child in element]
            repeated += [f"<{tag}> of {owner.tag} {owner.get('name')}" for tag in ONCE if tags.count(tag) > 1]
            for attribute in element.attrib:
                _check_numbers(where, element, attribute)
            if element.tag == "origin" and _make_exact(element):
                rounded.append(f"{owner.tag} {owner.get('name')}")
    exact = "rounded multiples of a quarter turn, such as 1.57, are taken as exact in rpy of"
    first = "warning: given more than once, of which the first counts, as in ROS:"
    said = {exact: ", ".join(dict.fromkeys(rounded)), first: ", ".join(repeated)}
    return tuple(f"{what} {names}" for what, names in said.items() if names)


def _check_complete(where: str, element: Any) -> None:
    """Raise BadInput unless an element has its attributes and elements."""
    line = f"{where}, line {element.sourceline}"
    for attribute in COMPLETE.get(element.tag, ()):
        if not element.get(attribute, "").strip():
            raise BadInput(f"{line}: <{element.tag}> has no {attribute}; add it")
    for child in ELEMENTS.get(element.tag, ()):
        if element.find(child) is None:
            raise BadInput(f"{line}: <{element.tag}> has no <{child}>; add it")
    if element.tag == "geometry" and [e.tag for e in element if e.tag != "material"] not in (
        ["box"],
        ["cylinder"],
        ["sphere"],
        ["mesh"],
    ):
        raise BadInput(f"{line}: <geometry> must be one box, cylinder, sphere or mesh")
    if element.tag == "joint":
        check_named(element.get("type"), TYPES, f"{line}: unknown type")


def _check_numbers(where: str, element: Any, attribute: str) -> None:
    """Raise BadInput for an attribute that should be numbers and is not."""
    count = VECTORS.get(attribute, 1 if attribute in NUMBERS else 0)
    if not count or (element.tag, attribute) == ("axis", "rpy"):  # which nobody reads
        return
    text = element.get(attribute)
    try:
        numbers = [
            float(part)
            for part in (text.replace(",", " ") if attribute in ("size", "scale") else text).split()
        ]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) <= LARGEST for number in numbers):
        requirement = "a finite number" if count == 1 else f"{count} finite numbers"
        raise BadInput(
            f"{where}, line {element.sourceline}: {attribute}={text!r} of <{element.tag}> must be "
            f"{requirement}"
        )


def _make_exact(origin: Any) -> bool:
    """Replace angles that are a rounded multiple of a quarter turn. Return whether one was replaced by more
    than rounding."""
    angles = [float(angle) for angle in origin.get("rpy", "0 0 0").split()]
    exact = [round(angle / QUARTER) * QUARTER for angle in angles]
    near = [0 < abs(angle - turn) <= ROUNDED and turn != 0 for angle, turn in zip(angles, exact, strict=True)]
    if not any(near):
        return False
    origin.set("rpy", " ".join(repr(e if n else a) for a, e, n in zip(angles, exact, near, strict=True)))
    return any(n and abs(a - e) > 1e-6 for a, e, n in zip(angles, exact, near, strict=True))


def _check_tree(document: Document) -> None:
    """Raise BadInput unless the joints connect all links to one tree and have axes."""
    where = document.path
    if not document.links:
        raise BadInput(f"{where}: it has no links")
    carried: dict[str, str] = {}
    for name, joint in document.joints.items():
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            check_named(link, document.links, f"{where}: joint {name!r}: its {role} is no link:")
        if joint.child in carried:
            raise BadInput(
                f"{where}: link {joint.child!r} is the child of joints {carried[joint.child]!r} and "
                f"{name!r}; a URDF is a tree"
            )
        carried[joint.child] = name
        if joint.type != "fixed" and not np.linalg.norm(joint.axis) > 0:
            raise BadInput(f"{where}: joint {name!r}: its axis has length zero")
        if joint.mimic is not None:
            check_named(
                joint.mimic.joint, document.joints, f"{where}: joint {name!r} mimics what is no joint:"
            )
    roots = [link for link in document.links if link not in carried]
    if len(roots) != 1:
        loose = (
            f"links {', '.join(map(repr, roots[:3]))} have no parent" if roots else "every link has a parent"
        )
        raise BadInput(f"{where}: {loose}; the joints must connect all links to one tree")
    if lost := set(document.links) - set(document.subtree(roots[0])):
        raise BadInput(
            f"{where}: link {min(lost)!r} is not connected to {roots[0]!r}; its joints form a circle"
        )


def _inertial(link: Any, where: str) -> Inertial | None:
    if link.inertial is None:
        return None
    mass, origin = float(link.inertial.mass), placed(link.inertial)
    if mass == 0:
        return None
    if mass < 0:
        raise BadInput(
            f"{where}: its mass is {mass:g} kg; give it a positive mass, or no <inertial> if it is a frame"
        )
    inertia = origin[:3, :3] @ link.inertial.inertia @ origin[:3, :3].T
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] < -1e-9 * abs(moments[2]):
        raise BadInput(
            f"{where}: its inertia has a negative principal moment, {moments[0]:.3g} kg m^2; correct it"
        )
    return Inertial(mass, origin[:3, 3], inertia)
