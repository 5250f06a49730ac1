"""The radius of a wheel, from the shapes of its link."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .document import Document, placed

ALIGNED = 0.01  # rad between an axle and the direction that it should have
ROUND = 0.03  # of the radius: difference of a shape from a circle about its axle
SMALL = 1e-9  # m
MESHES = (".stl", ".obj", ".ply", ".off")  # formats that trimesh reads by itself


class NotRound(Exception):
    """A link whose shapes do not show a radius. The message says why and what to do."""


def rim(document: Document, joint: Any) -> tuple[float, float, str]:
    """Return the radius (m) of the wheel on a joint, how far its middle is from the joint along the axis (m), and the source.

    Cylinders and spheres come first, those of collisions before those of visuals, then meshes. Raises NotRound.
    """
    links = document.subtree(joint.child, lambda below: below.type == "fixed")
    axis, centre = document.axis(joint), document.pose(joint.child)[:3, 3]
    reasons: list[str] = []
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
                return max(circles)
    reason = reasons[0] if reasons else f"link {joint.child!r} has no cylinder, sphere or mesh"
    raise NotRound(f"{reason}; give its radius by --radius {joint.child}=METRES")


def lowest(document: Document, link: str) -> tuple[float, np.ndarray] | None:
    """Return height (m) and place (3) of the lowest point of a link's sphere, or of its box or cylinder; None without any."""
    points = []
    for kind in ("collision", "visual"):
        for _, pose, geometry in _shapes(document, [link], kind):
            if geometry.mesh is None:
                points.append((pose[2, 3] - _half_height(pose, geometry), pose[:3, 3]))
        if points:
            break
    return min(points, key=lambda pair: pair[0]) if points else None


def extent(document: Document, links: Sequence[str]) -> np.ndarray:
    """Return the corners of the boxes around the shapes of links but meshes, in the frame of the root, count x 3."""
    corners = []
    for kind in ("collision", "visual"):
        for _, pose, geometry in _shapes(document, links, kind):
            if geometry.mesh is None:
                half = _half_sizes(geometry)
                signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1)
                corners.append((pose[:3, :3] @ (signs * half[:, None]) + pose[:3, 3:]).T)
    return np.concatenate(corners) if corners else np.zeros((0, 3))


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
) -> tuple[float, float] | None:
    """Return the radius of one shape about an axle and its place along that; None of a box. Raises NotRound."""
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
    return size, float(axis @ offset)


def mesh_file(urdf: Path, name: str) -> Path | None:
    """Return the file of a mesh: `package://NAME/...` is searched for in the folders above the URDF, with and without NAME."""
    scheme, _, rest = name.rpartition("://")
    rests = [rest, *([rest.partition("/")[2]] if scheme == "package" else [])]
    folders = urdf.resolve().parents
    return next((folder / each for folder in folders for each in rests if each and (folder / each).is_file()), None)


def _circle_of_mesh(document: Document, pose: np.ndarray, mesh: Any, axis: np.ndarray, centre: np.ndarray) -> tuple[float, float]:
    """Return the largest distance of a mesh from the axle, with its scale and its origin, and its middle. Raises NotRound."""
    file = mesh_file(document.path, mesh.filename)
    if file is None:
        raise NotRound(f"its mesh {mesh.filename} is not found")
    if file.suffix.lower() not in MESHES:
        raise NotRound(f"its mesh {mesh.filename} is none of {', '.join(MESHES)}")
    import trimesh

    try:
        vertices = np.asarray(trimesh.load_mesh(file).vertices)
    except Exception as error:  # trimesh raises whatever its readers do
        raise NotRound(f"its mesh {mesh.filename} cannot be read") from error
    if not len(vertices):
        raise NotRound(f"its mesh {mesh.filename} is empty")
    scale = np.ones(3) if mesh.scale is None else np.asarray(mesh.scale) * np.ones(3)
    arms = (vertices * scale) @ pose[:3, :3].T + pose[:3, 3] - centre
    along = arms @ axis
    arms -= np.outer(along, axis)
    size = float(np.linalg.norm(arms, axis=1).max())
    if not size > SMALL:
        raise NotRound(f"its mesh {mesh.filename} has no size; correct its scale")
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    reach = [extreme for d in (side, np.cross(axis, side)) for extreme in (-(arms @ d).min(), (arms @ d).max())]
    if min(reach) < (1 - ROUND) * size:
        raise NotRound(f"its mesh {mesh.filename} is not round about the axle: it reaches from {min(reach):.3g} to {size:.3g} m")
    return size, float(along.max() + along.min()) / 2
