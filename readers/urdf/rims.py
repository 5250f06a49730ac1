"""The radius of a wheel, from the shapes of its link."""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .document import Document, placed
from .parts import UP

LYING = 0.1  # part upwards of the axis of a cylinder that lies on the ground
ALIGNED = 0.01  # rad between an axle and the direction that it should have
ROUND = 0.03  # of the radius: difference of a shape from a circle about its axle
ON_LINE = 0.05  # of the radius, or of the track: distances, ahead or aside, that are taken as none
RIM = 0.01  # of the radius: depth of what counts as the rim
LEVEL = 0.02  # of its height: depth of what counts as the bottom of a mesh
SMALL = 1e-9  # m
MESHES = (".stl", ".obj", ".ply", ".off")  # formats that trimesh reads by itself


class NotRound(Exception):
    """A link whose shapes do not show a radius. The message says why and what to do."""


@dataclass(frozen=True)
class Rim:
    """The rim of a wheel: its radius (m), how far its middle is from the joint along the axis (m), where this
    comes from, the `kind` of shapes that show it, "collision" or "visual", and the radius of the other kind,
    0 if that shows none.
    """

    radius: float
    along: float
    source: str
    kind: str
    other: float


def rim(document: Document, joint: Any) -> Rim:
    """Return the rim of the wheel on a joint. Raises NotRound.

    Cylinders and spheres come first, those of collisions before those of visuals, then meshes. The middle is
    that of all shapes that reach to the rim, as far as they do: a tyre with a shaft counts without the shaft.
    """
    links = document.subtree(joint.child, lambda below: below.type == "fixed")
    axis, centre = document.axis(joint), document.pose(joint.child)[:3, 3]
    reasons: list[str] = []
    rims: list[tuple[float, float, str, str]] = []  # in the order of preference
    for meshes in (False, True):
        for kind in ("collision", "visual"):
            circles = []
            for link, pose, geometry in _shapes(document, links, kind):
                if (geometry.mesh is not None) is not meshes:
                    continue
                try:
                    if circle := _circle(document, pose, geometry, axis, centre):
                        circles.append((*circle, f"link {link}, {kind} {_name(geometry)}"))
                except NotRound as error:
                    reasons.append(f"link {link!r}: {error}")
            if circles:
                radius, _, _, source = max(circles, key=lambda circle: circle[0])
                _, low, high, _ = zip(
                    *(circle for circle in circles if circle[0] >= (1 - RIM) * radius), strict=True
                )
                rims.append((radius, (min(low) + max(high)) / 2, source, kind))
    if not rims:
        reason = reasons[0] if reasons else f"link {joint.child!r} has no cylinder, sphere or mesh"
        raise NotRound(f"{reason}; give its radius by --radius {joint.child}=METRES")
    kind = rims[0][3]
    return Rim(*rims[0], next((radius for radius, *_, other in rims if other != kind), 0.0))


def bottoms(document: Document, link: str) -> list[tuple[float, np.ndarray]]:
    """Return height (m) and place (3) of the lowest point of each of a link's spheres, boxes, cylinders, and
    meshes that can be read; the lowest first. The place is the middle of what is lowest.
    """
    points = []
    for kind in ("collision", "visual"):
        for _, pose, geometry in _shapes(document, [link], kind):
            if geometry.mesh is None:
                points.append((pose[2, 3] - _half_height(pose, geometry), pose[:3, 3]))
                continue
            with suppress(NotRound):
                at = mesh_points(document, pose, geometry.mesh)
                bottom = at[at[:, 2] <= at[:, 2].min() + LEVEL * np.ptp(at[:, 2])]
                points.append((float(at[:, 2].min()), (bottom.min(axis=0) + bottom.max(axis=0)) / 2))
        if points:
            break
    return sorted(points, key=lambda pair: pair[0])


def lies_on(document: Document, link: str, ground: float, within: float) -> bool:
    """Return whether a link has a cylinder on a level axis whose rim is as high as the ground,
    within a height (all m)."""
    shapes = [shape for kind in ("collision", "visual") for shape in _shapes(document, [link], kind)]
    rims = [(pose, geometry.cylinder) for _, pose, geometry in shapes if geometry.cylinder is not None]
    level = [pose[2, 3] - each.radius for pose, each in rims if abs(pose[2, 2]) < LYING]
    return any(abs(lowest - ground) <= within for lowest in level)


def touches(document: Document, link: str, kind: str, axis: np.ndarray, turn: float) -> tuple[float, float]:
    """Return how far a wheel, turned by an angle (rad) about its level `axis`, reaches down from its joint,
    m, and where.

    Where is the middle, along the axis, of what is lowest, m from the joint. Both follow from the points of
    the link's shapes, and of the links fixed to it, without the circles of `rim`: import compares them.
    """
    links = document.subtree(link, lambda below: below.type == "fixed")
    centre = document.pose(link)[:3, 3]
    down = math.sin(turn) * np.cross(UP, axis) - math.cos(turn) * UP  # what points down after the turn
    points = []
    for _, pose, geometry in _shapes(document, links, kind):
        if geometry.mesh is not None:
            with suppress(NotRound):
                points.append(mesh_points(document, pose, geometry.mesh))
        elif geometry.sphere is not None:
            points.append(pose[None, :3, 3] + geometry.sphere.radius * down)
        elif geometry.cylinder is not None:
            along = pose[:3, 2]
            aside = down - (down @ along) * along
            ends = np.outer([-geometry.cylinder.length / 2, geometry.cylinder.length / 2], along)
            points.append(pose[:3, 3] + ends + geometry.cylinder.radius * aside / np.linalg.norm(aside))
    arms = np.concatenate(points) - centre
    depths = arms @ down
    reached = (arms @ axis)[depths >= (1 - RIM) * depths.max()]
    return float(depths.max()), float(reached.min() + reached.max()) / 2


def extent(document: Document, links: Sequence[str]) -> np.ndarray:
    """Return the corners of the boxes around the shapes of links but meshes, in the frame of the root,
    count x 3."""
    shapes = [
        s for kind in ("collision", "visual") for s in _shapes(document, links, kind) if s[2].mesh is None
    ]
    poses, halves = (
        np.array([s[1] for s in shapes]).reshape(-1, 4, 4),
        np.array([_half_sizes(s[2]) for s in shapes]),
    )
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1)
    corners = poses[:, :3, :3] @ (signs * halves.reshape(-1, 3, 1)) + poses[:, :3, 3:]
    return corners.swapaxes(1, 2).reshape(-1, 3)


def span(document: Document, link: str) -> float:
    """Return the size of the largest shape of a link, m; 0 without any that can be read."""
    sizes = [0.0]
    for _, pose, geometry in (s for kind in ("collision", "visual") for s in _shapes(document, [link], kind)):
        with suppress(NotRound):
            box = (
                2 * _half_sizes(geometry)
                if geometry.mesh is None
                else mesh_points(document, pose, geometry.mesh)
            )
            sizes.append(float(np.linalg.norm(box if geometry.mesh is None else np.ptp(box, axis=0))))
    return max(sizes)


def _shapes(document: Document, links: Sequence[str], kind: str) -> Iterator[tuple[str, np.ndarray, Any]]:
    for link in links:
        pose = document.pose(link)
        for element in getattr(document.links[link], f"{kind}s"):
            yield link, pose @ placed(element), element.geometry


def _name(geometry: Any) -> str:
    return next(name for name in ("cylinder", "sphere", "box", "mesh") if getattr(geometry, name) is not None)


def _half_sizes(geometry: Any) -> np.ndarray:
    if geometry.sphere is not None:
        return np.full(3, geometry.sphere.radius)
    if geometry.cylinder is not None:
        return np.array([geometry.cylinder.radius, geometry.cylinder.radius, geometry.cylinder.length / 2])
    return np.asarray(geometry.box.size) / 2


def _half_height(pose: np.ndarray, geometry: Any) -> float:
    if geometry.sphere is not None:
        return geometry.sphere.radius
    up, half = np.abs(pose[2, :3]), _half_sizes(geometry)
    if geometry.cylinder is not None:
        return float(math.hypot(up[0], up[1]) * half[0] + up[2] * half[2])
    return float(up @ half)


def _circle(
    document: Document, pose: np.ndarray, geometry: Any, axis: np.ndarray, centre: np.ndarray
) -> tuple[float, float, float] | None:
    """Return the radius of one shape about an axle, and where its rim begins and ends along that, m; None of
    a box.

    Raises NotRound.
    """
    if geometry.box is not None:
        return None
    if geometry.mesh is not None:
        return _circle_of_mesh(document, pose, geometry.mesh, axis, centre)
    size = float((geometry.cylinder or geometry.sphere).radius)
    if not size > 0:
        raise NotRound(f"the radius of its {_name(geometry)} is {size:g} m")
    offset = pose[:3, 3] - centre
    if np.linalg.norm(offset - axis * (axis @ offset)) > ROUND * size:
        raise NotRound(f"its {_name(geometry)} is not centred on the axle")
    if geometry.cylinder is not None and abs(axis @ pose[:3, 2]) < math.cos(ALIGNED):
        raise NotRound("its cylinder is not along the axle")
    half = geometry.cylinder.length / 2 if geometry.cylinder is not None else 0.0
    return size, float(axis @ offset) - half, float(axis @ offset) + half


def mesh_file(urdf: Path, name: str) -> Path | None:
    """Return the file of a mesh: `package://NAME/...` is searched for in the folders above the URDF,
    with and without NAME."""
    scheme, _, rest = name.rpartition("://")
    rests = [rest, *([rest.partition("/")[2]] if scheme == "package" else [])]
    folders = urdf.resolve().parents
    return next(
        (folder / each for folder in folders for each in rests if each and (folder / each).is_file()), None
    )


def mesh_points(document: Document, pose: np.ndarray, mesh: Any) -> np.ndarray:
    """Return the vertices of a mesh at a pose, with its scale, (count, 3),
    m. Raises NotRound if there are none."""
    if mesh.filename not in document.vertices:
        document.vertices[mesh.filename] = _vertices(document.path, mesh.filename)
    scale = np.ones(3) if mesh.scale is None else np.asarray(mesh.scale) * np.ones(3)
    return (document.vertices[mesh.filename] * scale) @ pose[:3, :3].T + pose[:3, 3]


def _vertices(urdf: Path, name: str) -> np.ndarray:
    """Return the vertices of a mesh in a file, (count, 3). Raises NotRound."""
    file = mesh_file(urdf, name)
    if file is None:
        raise NotRound(f"its mesh {name} is not found")
    if file.suffix.lower() not in MESHES:
        raise NotRound(f"its mesh {name} is none of {', '.join(MESHES)}")
    import trimesh

    try:
        vertices = np.asarray(trimesh.load_mesh(file).vertices)
    except Exception as error:  # trimesh raises whatever its readers do
        raise NotRound(f"its mesh {name} cannot be read") from error
    if not len(vertices):
        raise NotRound(f"its mesh {name} is empty")
    return vertices


def _circle_of_mesh(
    document: Document, pose: np.ndarray, mesh: Any, axis: np.ndarray, centre: np.ndarray
) -> tuple[float, float, float]:
    """Return the largest distance of a mesh from the axle, and where what is so far from it begins and ends
    along it, m.

    Raises NotRound.
    """
    arms = mesh_points(document, pose, mesh) - centre
    along = arms @ axis
    arms -= np.outer(along, axis)
    distances = np.linalg.norm(arms, axis=1)
    size = float(distances.max())
    if not size > SMALL:
        raise NotRound(f"its mesh {mesh.filename} has no size; correct its scale")
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    reach = [
        extreme for d in (side, np.cross(axis, side)) for extreme in (-(arms @ d).min(), (arms @ d).max())
    ]
    if min(reach) < (1 - ROUND) * size:
        raise NotRound(
            f"its mesh {mesh.filename} is not round about the axle: it reaches from {min(reach):.3g} to "
            f"{size:.3g} m"
        )
    at_rim = along[distances >= (1 - RIM) * size]
    return size, float(at_rim.min()), float(at_rim.max())
