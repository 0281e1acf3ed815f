"""Meshes that tests share."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import trimesh

from balloon_warp.mesh import PolygonMesh


def mesh_of(points: Sequence | np.ndarray, faces: Sequence[Sequence[int]], **fields) -> PolygonMesh:
    """Return a mesh of faces given as lists of vertices."""
    return PolygonMesh(
        points=np.array(points, dtype=np.float64).reshape(-1, 3),
        face_vertex_counts=np.array([len(face) for face in faces], dtype=np.int32),
        face_vertex_indices=np.array([vertex for face in faces for vertex in face], dtype=np.int32),
        **fields,
    )


def lattice(rows: Sequence | np.ndarray) -> np.ndarray:
    """Return the quads between neighboring rows of vertices, row by row, shape (quads, 4)."""
    rows = np.asarray(rows)
    return np.stack([rows[:-1, :-1], rows[:-1, 1:], rows[1:, 1:], rows[1:, :-1]], axis=-1).reshape(-1, 4)


def closing(rows: np.ndarray) -> np.ndarray:
    """Return rows that end with the vertex that they begin with."""
    return np.concatenate([rows, rows[:, :1]], axis=1)


def grid(nx: int, ny: int) -> PolygonMesh:
    """Return nx by ny unit quads in the plane z = 0, facing +z; vertices row by row."""
    points = [(x, y, 0) for y in range(ny + 1) for x in range(nx + 1)]
    return mesh_of(points, lattice(np.arange(len(points)).reshape(ny + 1, nx + 1)).tolist())


def zigzag(folds: int, gap: float) -> PolygonMesh:
    """Return a strip 30 cm wide, folded to and fro, whose layers are closer than its particles."""
    cells = 3
    strip = grid((folds + 1) * (cells + 1) - 1, cells)
    columns = strip.points[:, 0].astype(int)
    layers, within = np.divmod(columns, cells + 1)
    across = np.where(layers % 2 == 0, within, cells - within)
    return replace(strip, points=0.1 * np.column_stack([across, strip.points[:, 1], gap / 0.1 * layers]))


def box(center: Sequence[float], size: Sequence[float], cells: Sequence[int] = (2, 2, 2)) -> PolygonMesh:
    """Return a box of quads, so many along each side, winding outward."""
    numbers: dict[tuple[int, ...], int] = {}
    faces = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, cells[axis]):
            for i in range(cells[one]):
                for j in range(cells[two]):
                    face = []
                    for a, b in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)][:: 1 if side else -1]:
                        place = [0, 0, 0]
                        place[axis], place[one], place[two] = side, a, b
                        face.append(numbers.setdefault(tuple(place), len(numbers)))
                    faces.append(face)
    return mesh_of((np.array(list(numbers)) / np.array(cells) - 0.5) * np.array(size) + np.array(center), faces)


def quad_sphere(n: int, radius: float = 1.0) -> PolygonMesh:
    """Return a cube with n by n quads a side, projected to a sphere, outward: 6 n^2 + 2 vertices, 6 n^2 quads."""
    sides = box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0), (n, n, n))
    points = np.tan(sides.points * np.pi / 4.0)  # equal angles between the lines, which keeps the quads even
    return replace(sides, points=radius * points / np.linalg.norm(points, axis=1, keepdims=True))


def cube() -> PolygonMesh:
    """Return the unit cube, six quads, winding outward."""
    points = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    return mesh_of(points, [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])


def open_cube() -> PolygonMesh:
    """Return the unit cube without its side at x = 1: five quads, winding outward."""
    return mesh_of(cube().points, cube().face_vertex_indices.reshape(-1, 4)[:5].tolist())


def tetrahedron() -> PolygonMesh:
    """Return the corner of the unit cube, four triangles, winding outward."""
    return mesh_of([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def polygon(n: int) -> PolygonMesh:
    """Return a regular n-gon of radius 1, facing +z."""
    angles = 2.0 * np.pi * np.arange(n) / n
    return mesh_of(np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1), [list(range(n))])


def prism(n: int) -> PolygonMesh:
    """Return a regular n-gon of radius 1 from z = 0 to z = 1: two n-gons and n quads, winding outward."""
    ring = polygon(n).points
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    return mesh_of(np.concatenate([ring, ring + (0, 0, 1)]), [list(range(n))[::-1], list(range(n, 2 * n)), *sides])


def two_discs(rings: int, radius: float) -> PolygonMesh:
    """Return two discs of even triangles in rings around the centers; the first particle is the center of one disc, `1
    + 3 rings (rings + 1)` that of the other, and those before it are on the rim."""
    points, starts = [(0.0, 0.0)], [0]
    for ring in range(1, rings + 1):
        starts.append(len(points))
        angles = 2.0 * np.pi * np.arange(6 * ring) / (6 * ring)
        points += list(zip(ring / rings * np.cos(angles), ring / rings * np.sin(angles), strict=True))
    faces = []
    for ring in range(1, rings + 1):
        around, inside = 6 * ring, max(6 * (ring - 1), 1)
        for sector in range(6):
            for step in range(ring):
                outer = [starts[ring] + (sector * ring + step + k) % around for k in (0, 1)]
                inner = [starts[ring - 1] + (sector * (ring - 1) + step + k) % inside for k in (0, 1)]
                faces.append([*outer, inner[0]])
                faces += [[outer[1], inner[1], inner[0]]] if step < ring - 1 else []
    count, border = len(points), starts[-1]
    other = [[corner + count if corner < border else corner for corner in face[::-1]] for face in faces]
    flat = radius * np.array(points + points[:border])
    return mesh_of(np.column_stack([flat, np.zeros(len(flat))]), faces + other)


def two_quads_at_a_vertex() -> PolygonMesh:
    """Return two unit squares that share vertex 2 only."""
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 1, 0), (2, 2, 0), (1, 2, 0)]
    return mesh_of(points, [[0, 1, 2, 3], [2, 4, 5, 6]])


def moebius(n: int) -> PolygonMesh:
    """Return a strip of n quads that closes with half a turn: 2 n vertices."""
    turn, width = 2.0 * np.pi * np.arange(n) / n, np.array([[-0.3], [0.3]])
    reach = 1.0 + width * np.cos(turn / 2.0)
    points = np.stack([reach * np.cos(turn), reach * np.sin(turn), width * np.sin(turn / 2.0)], axis=-1)
    return mesh_of(points, lattice([[*range(n), n], [*range(n, 2 * n), 0]]).tolist())


def torus(n: int, m: int, major: float = 1.0, minor: float = 0.4) -> PolygonMesh:
    """Return n quads around the hole, m around the tube, winding outward."""
    around, across = np.meshgrid(2.0 * np.pi * np.arange(n) / n, 2.0 * np.pi * np.arange(m) / m, indexing="ij")
    reach = major + minor * np.cos(across)
    points = np.stack([reach * np.cos(around), reach * np.sin(around), minor * np.sin(across)], axis=-1)
    return mesh_of(points, lattice(closing(closing(np.arange(n * m).reshape(n, m)).T)).tolist())


def joined(*meshes: PolygonMesh) -> PolygonMesh:
    """Return all the meshes as one, each a component."""
    offsets = np.cumsum([0, *(mesh.vertex_count for mesh in meshes)])
    return PolygonMesh(
        points=np.concatenate([mesh.points for mesh in meshes]),
        face_vertex_counts=np.concatenate([mesh.face_vertex_counts for mesh in meshes]),
        face_vertex_indices=np.concatenate(
            [mesh.face_vertex_indices + offset for mesh, offset in zip(meshes, offsets[:-1].tolist(), strict=True)]
        ),
    )


def fans(mesh: PolygonMesh) -> trimesh.Trimesh:
    """Return each face as a fan of triangles about its center, as the simulation sees it."""
    points, triangles = list(mesh.points), []
    for face in np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1]):
        triangles += [(a, b, len(points)) for a, b in zip(np.roll(face, 1), face, strict=True)]
        points.append(mesh.points[face].mean(axis=0))
    return trimesh.Trimesh(points, triangles, process=False)


def hook(gap: float, across: int = 12, along: int = 48) -> PolygonMesh:
    """Return a tube bent into a ring of radius 1 m whose ends, closed by cones, stay `gap` apart; they overlap where it
    is negative."""
    around = np.linspace(0.0, 2.0 * np.pi, across, endpoint=False)
    ways = np.linspace(0.5 * gap, 2.0 * np.pi - 0.5 * gap, along)
    outward = np.stack([np.cos(ways), np.sin(ways), np.zeros(along)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    tube = outward[:, None] * (1.0 + 0.25 * np.cos(around)[:, None]) + 0.25 * np.sin(around)[:, None] * up
    return with_tips(tube[:, ::-1], outward[[0, -1]])


def at(mesh: PolygonMesh, place: Sequence[float], size: float = 1.0) -> PolygonMesh:
    """Return the mesh scaled, and then moved."""
    return replace(mesh, points=mesh.points * size + np.array(place))


def loose(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with vertices of its own for each face."""
    corners = mesh.face_vertex_indices
    return replace(mesh, points=mesh.points[corners], face_vertex_indices=np.arange(len(corners), dtype=np.int32))


def halved(mesh: PolygonMesh) -> PolygonMesh:
    """Return the triangles of a mesh of quads."""
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    return mesh_of(mesh.points, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]).tolist())


def rings(
    radii: Sequence | np.ndarray, heights: Sequence | np.ndarray, around: int = 16, lids: bool = True
) -> PolygonMesh:
    """Return quads between rings about the z axis, outward, and polygons at both ends."""
    angles = 2.0 * np.pi * np.arange(around) / around
    circles = [[r * np.cos(angles), r * np.sin(angles), h + 0.0 * angles] for r, h in zip(radii, heights, strict=True)]
    ring = np.arange(len(circles) * around).reshape(-1, around)
    ends = [ring[0, ::-1].tolist(), ring[-1].tolist()] if lids else []
    return mesh_of(np.array(circles).transpose(0, 2, 1), [*lattice(closing(ring)).tolist(), *ends])


def with_tips(circles: np.ndarray, tips: Sequence | np.ndarray) -> PolygonMesh:
    """Return quads between rings of points, shape (rings, around, 3), and a fan of triangles from the first and from
    the last ring to a tip."""
    count = circles.shape[0] * circles.shape[1]
    ring = closing(np.arange(count).reshape(circles.shape[:2]))
    fans = [[count, after, here] for here, after in pairwise(ring[0].tolist())]
    fans += [[count + 1, here, after] for here, after in pairwise(ring[-1].tolist())]
    return mesh_of(np.concatenate([circles.reshape(-1, 3), tips]), [*lattice(ring).tolist(), *fans])
