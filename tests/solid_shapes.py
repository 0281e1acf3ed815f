"""Meshes of everyday shapes, divided in many ways; and small ones as CAD programs write them."""

from collections.abc import Callable

import numpy as np
import trimesh
from meshes import box as block
from meshes import joined, mesh_of, quad_sphere, with_tips
from scipy.spatial import ConvexHull

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.surface_nets import surface_nets


def uv_sphere(around: int, rings: int) -> PolygonMesh:
    """Return quads between rings, and a fan of triangles at each pole, as Blender makes them, up and down."""
    turns, heights = 2.0 * np.pi * np.arange(around) / around, np.pi * np.arange(1, rings) / rings
    circles = [
        np.stack([np.sin(h) * np.cos(turns), np.full(around, np.cos(h)), np.sin(h) * np.sin(turns)], axis=1)
        for h in heights
    ]
    return with_tips(np.array(circles), [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])


def scattered_sphere(count: int, denser: float = 1.0) -> PolygonMesh:
    """Return the convex hull of points at random on a sphere, in one half as many times denser."""
    chance = np.random.default_rng(3)
    points = chance.normal(size=(count, 3))
    points = points[(points[:, 0] > 0.0) | (chance.uniform(size=count) < 1.0 / denser)]
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return mesh_of(points, _outward(points, ConvexHull(points).simplices))


def _outward(points: np.ndarray, faces: np.ndarray) -> list[list[int]]:
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (normals * corners.mean(axis=1)).sum(axis=1) < 0.0
    return np.where(inward[:, None], faces[:, ::-1], faces).tolist()


def ico_sphere() -> PolygonMesh:
    ball = trimesh.creation.icosphere(subdivisions=3)
    return mesh_of(ball.vertices, ball.faces.tolist())


def stretched_quad_sphere() -> PolygonMesh:
    """Return a sphere whose quads are 1 to 3 times as long as wide."""
    ball = quad_sphere(8)
    points = ball.points * (1.0, 1.7, 0.6)
    return mesh_of(points / np.linalg.norm(points, axis=1, keepdims=True), ball.face_vertex_indices.reshape(-1, 4))


def box(points: np.ndarray, middle: tuple, half: tuple) -> np.ndarray:
    """Return the signed distance of a box."""
    beyond = np.abs(points - middle) - half
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def rod(points: np.ndarray, begin: tuple, end: tuple, radius: float) -> np.ndarray:
    """Return the signed distance of a line with thickness."""
    first, way = np.array(begin), np.subtract(end, begin)
    along = np.clip((points - first) @ way / (way @ way), 0.0, 1.0)
    return np.linalg.norm(points - first - along[:, None] * way, axis=1) - radius


def _feet(x: float, z: float) -> list[tuple[float, float]]:
    return [(a, b) for a in (-x, x) for b in (-z, z)]


def _animal(p: np.ndarray) -> np.ndarray:
    legs = [rod(p, (x, 0.05, z), (x, 0.55, z), 0.045) for x, z in _feet(0.3, 0.1)]
    neck, head = rod(p, (0.32, 0.72, 0.0), (0.5, 1.0, 0.0), 0.08), rod(p, (0.5, 1.0, 0.0), (0.66, 0.92, 0.0), 0.06)
    return np.minimum.reduce([rod(p, (-0.3, 0.66, 0.0), (0.3, 0.68, 0.0), 0.16), neck, head, *legs])


def _man(p: np.ndarray) -> np.ndarray:
    sides = [side for x in (-1.0, 1.0) for side in _limbs(p, x)]
    trunk, head = rod(p, (0.0, 0.95, 0.0), (0.0, 1.35, 0.0), 0.15), rod(p, (0.0, 1.5, 0.0), (0.0, 1.66, 0.0), 0.11)
    return np.minimum.reduce([trunk, head, *sides])


def _limbs(p: np.ndarray, x: float) -> list[np.ndarray]:
    leg, foot = (
        rod(p, (0.1 * x, 0.9, 0.0), (0.12 * x, 0.07, 0.0), 0.07),
        rod(p, (0.12 * x, 0.06, 0.0), (0.13 * x, 0.06, 0.14), 0.06),
    )
    return [leg, foot, rod(p, (0.15 * x, 1.4, 0.0), (0.4 * x, 0.95, 0.02), 0.055)]


def _table(p: np.ndarray) -> np.ndarray:
    legs = [box(p, (x, 0.34, z), (0.04, 0.34, 0.04)) for x, z in _feet(0.42, 0.25)]
    return np.minimum.reduce([box(p, (0.0, 0.7, 0.0), (0.5, 0.04, 0.33)), *legs])


def _cup(p: np.ndarray) -> np.ndarray:
    away = np.hypot(p[:, 0], p[:, 2])
    outside, inside = np.maximum(away - 0.4, np.abs(p[:, 1] - 0.5) - 0.5), np.maximum(away - 0.32, 0.08 - p[:, 1])
    return np.maximum(outside, -inside)


def _sword(p: np.ndarray) -> np.ndarray:
    blade, guard = box(p, (0.0, 0.8, 0.0), (0.06, 0.5, 0.02)), box(p, (0.0, 0.28, 0.0), (0.18, 0.03, 0.03))
    return np.minimum.reduce([blade, guard, rod(p, (0.0, 0.05, 0.0), (0.0, 0.28, 0.0), 0.035)])


def _angle(p: np.ndarray) -> np.ndarray:
    foot, wall = box(p, (0.0, 0.05, 0.0), (0.5, 0.05, 0.4)), box(p, (-0.4, 0.3, 0.0), (0.07, 0.3, 0.4))
    bore = np.hypot(p[:, 0] - 0.15, p[:, 2]) - 0.12
    return np.maximum(np.minimum(foot, wall), -bore)


SHAPES = {  # signed distance, and the width of a cell
    "animal": (_animal, 0.035),
    "man": (_man, 0.042),
    "table": (_table, 0.035),
    "cup": (_cup, 0.045),
    "sword": (_sword, 0.02),
    "angle": (_angle, 0.045),
    "plate": (lambda p: box(p, (0.0, 0.04, 0.0), (0.5, 0.04, 0.5)), 0.05),
    "box": (lambda p: box(p, (0.0, 0.2, 0.0), (0.5, 0.2, 0.3)), 0.05),
    "cube": (lambda p: box(p, (0.0, 0.4, 0.0), (0.4, 0.4, 0.4)), 0.06),
    "ball": (lambda p: np.linalg.norm(p - (0.0, 0.4, 0.0), axis=1) - 0.4, 0.06),
    "ring": (lambda p: np.hypot(np.hypot(p[:, 0], p[:, 2]) - 0.45, p[:, 1] - 0.1) - 0.1, 0.045),
    "hollow": (lambda p: np.abs(box(p, (0.0, 0.4, 0.0), (0.36, 0.36, 0.36))) - 0.05, 0.05),
}


def solid(name: str) -> PolygonMesh:
    """Return a solid of `SHAPES`, of even quads, about a meter large, its feet at a height of 0."""
    distance, cell = SHAPES[name]
    return surface_nets(distance, (-0.75, -0.1, -0.6), (0.8, 1.9, 0.6), cell)


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
    return block(MIDDLE, (1.0, 0.3, 1.0), (6, 2, 120))


def parts() -> PolygonMesh:
    """Return two boxes that overlap by a millionth, as those of an assembly."""
    above = (0.0, 1.0 - 1e-6, 0.0)
    return joined(block(MIDDLE, (1.0, 1.0, 1.0), (5, 5, 5)), block(above, (1.0, 1.0, 1.0), (4, 4, 4)))


def sheet(thickness: float = 2e-3, cells: int = 12) -> PolygonMesh:
    """Return a sheet, one meter wide."""
    return block(MIDDLE, (1.0, thickness, 1.0), (cells, 1, cells))


def blocks() -> PolygonMesh:
    """Return nine small blocks side by side."""
    return joined(*(block((1.1 * i, 0.0, 1.1 * j), (1.0, 1.0, 1.0), (1, 1, 1)) for i in range(3) for j in range(3)))


CAD_SHAPES: dict[str, Callable[[], PolygonMesh]] = {
    "long triangles, with a gap": clip,
    "fans": disk,
    "a chamfer": chamfered_box,
    "slivers": slivers,
    "parts that overlap": parts,
    "thin walls": sheet,
}
