"""Small meshes as CAD programs write them: long triangles, fans, tiny features, thin walls, parts that overlap."""

from collections.abc import Callable

import numpy as np
import trimesh
from meshes import box, joined, mesh_of

from balloon_warp.mesh import PolygonMesh

MIDDLE = (0.0, 0.0, 0.0)


def clip() -> PolygonMesh:
    """Return an open ring of triangles from edge to edge, much finer at one of its ends, which face each other."""
    angles = np.concatenate([np.linspace(0.02, 0.12, 150), np.linspace(0.4, 2.0 * np.pi - 0.02, 24)])
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    corners = [(1.0, 0.0), (1.0, 0.8), (0.8, 0.8), (0.8, 0.0)]  # of the section: radius and height
    points = np.concatenate([np.insert(radius * ways, 1, height, axis=1) for radius, height in corners])
    rows = np.arange(len(points)).reshape(4, -1)
    pairs = zip(rows, np.roll(rows, -1, axis=0), strict=True)
    quads = np.concatenate([np.stack([one[:-1], two[:-1], two[1:], one[1:]], axis=1) for one, two in pairs])
    quads = np.concatenate([quads, [rows[::-1, 0], rows[:, -1]]])
    return mesh_of(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).tolist())


def disk() -> PolygonMesh:
    """Return a disk whose rim is of long thin triangles, with a fan of them on either side."""
    disk = trimesh.creation.cylinder(radius=1.0, height=0.4, sections=160)
    return mesh_of(disk.vertices, disk.faces.tolist())


def chamfered_box() -> PolygonMesh:
    """Return a box of triangles whose edges and corners are cut off by a thousandth."""
    signs = 2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0
    hull = trimesh.Trimesh(np.concatenate([signs * (1.0 - 1e-3 * (np.arange(3) != a)) for a in range(3)])).convex_hull
    return mesh_of(hull.vertices, hull.faces.tolist())


def slivers() -> PolygonMesh:
    """Return a plate of faces twenty times as long as wide."""
    return box(MIDDLE, (1.0, 0.3, 1.0), (6, 2, 120))


def parts() -> PolygonMesh:
    """Return two boxes that overlap by a millionth, as those of an assembly."""
    above = (0.0, 1.0 - 1e-6, 0.0)
    return joined(box(MIDDLE, (1.0, 1.0, 1.0), (5, 5, 5)), box(above, (1.0, 1.0, 1.0), (4, 4, 4)))


def sheet(thickness: float = 2e-3, cells: int = 12) -> PolygonMesh:
    """Return a sheet, one meter wide."""
    return box(MIDDLE, (1.0, thickness, 1.0), (cells, 1, cells))


def blocks() -> PolygonMesh:
    """Return nine small blocks side by side."""
    return joined(*(box((1.1 * i, 0.0, 1.1 * j), (1.0, 1.0, 1.0), (1, 1, 1)) for i in range(3) for j in range(3)))


SHAPES: dict[str, Callable[[], PolygonMesh]] = {
    "long triangles, with a gap": clip,
    "fans": disk,
    "a chamfer": chamfered_box,
    "slivers": slivers,
    "parts that overlap": parts,
    "thin walls": sheet,
}
