"""Meshes that tests share: simple and round ones, those whose faces meet oddly, and those from the wild."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import trimesh
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh, topology
from balloon_warp.mesh.repair import distinct_faces


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


def edge_lengths(mesh: PolygonMesh) -> NDArray[np.float64]:
    ends = mesh.points[topology.mesh_edges(mesh).ends]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def assert_closed_quads(mesh: PolygonMesh, holes_through: int = 0, parts: int = 1) -> None:
    edges = topology.mesh_edges(mesh)
    assert (mesh.face_vertex_counts == 4).all()
    assert (edges.face_counts == 2).all()
    assert topology.is_manifold(mesh, edges)
    assert len(topology.inconsistent_edges(edges)) == 0
    assert topology.component_count(mesh, edges) == parts
    assert topology.genus(mesh, edges) == holes_through
    assert topology.signed_volume(mesh) > 0.0


def assert_none_folded(mesh: PolygonMesh) -> None:
    """Require that each face points along the normals at its corners."""
    areas = topology.face_vector_areas(mesh)
    normals = topology.vertex_normals(mesh)[mesh.face_vertex_indices.reshape(-1, 4)]
    assert (np.einsum("fcj,fj->fc", normals, areas) > 0.0).all()


def sphere_distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(points, axis=1) - 1.0


def merged(mesh: PolygonMesh, digits: int = 6) -> PolygonMesh:
    """Return the mesh with coincident vertices merged: where boxes stand side by side, edges get three faces and four.
    Vertices of no face are left out."""
    first = topology.first_coincident(mesh.points.round(digits) + 0.0)[mesh.face_vertex_indices]
    used, numbers = np.unique(first, return_inverse=True)
    return replace(mesh, points=mesh.points[used], face_vertex_indices=numbers.astype(np.int32))


def without(mesh: PolygonMesh, drop: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh without some faces, by a mask."""
    kept = topology.with_corners(mesh, ~drop[topology.corner_faces(mesh)])
    return replace(kept, face_vertex_counts=mesh.face_vertex_counts[~drop])


def deformed(mesh: PolygonMesh, by: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> PolygonMesh:
    """Return the mesh with other points."""
    return replace(mesh, points=by(mesh.points))


def chair(holes: bool = True, mixed: bool = True, seed: int = 1) -> PolygonMesh:
    """Return a seat, a back and four thin legs: boxes of four materials that share vertices, so that edges have up to
    four faces and walls stand between; some faces are missing and some reversed. Y up, 1 m high."""
    seat = box((0.0, 0.45, 0.0), (0.4, 0.05, 0.4), (8, 1, 8))
    back = box((0.0, 0.725, -0.175), (0.4, 0.5, 0.05), (8, 10, 1))
    legs = [box((x, 0.2125, z), (0.05, 0.425, 0.05), (1, 8, 1)) for x in (-0.175, 0.175) for z in (-0.175, 0.175)]
    mesh = merged(joined(seat, back, *legs))
    numbers = np.random.default_rng(seed)
    if holes:
        mesh = without(mesh, numbers.random(mesh.face_count) < 0.06)
    return topology.flipped(mesh, numbers.random(mesh.face_count) < 0.3) if mixed else mesh


def walled() -> PolygonMesh:
    """Return two rooms of a box with the wall between them, whose edges have three faces."""
    rooms = [box((x, 0.0, 0.0), (0.5, 1.0, 1.0), (4, 8, 8)) for x in (0.25, -0.25)]
    return distinct_faces(merged(joined(*rooms)))[0]


def two_at_an_edge() -> PolygonMesh:
    """Return two boxes that share an edge, of four faces."""
    return merged(joined(*(box((x, x, 0.0), (0.5, 0.5, 0.5), (4, 4, 4)) for x in (0.25, -0.25))))


def two_at_a_vertex() -> PolygonMesh:
    """Return two boxes that share a vertex."""
    return merged(joined(*(box((x, x, x), (0.5, 0.5, 0.5), (4, 4, 4)) for x in (0.25, -0.25))))


def finned(cells: int = 8) -> PolygonMesh:
    """Return a ball with a sheet that stands on it, whose foot has edges of three faces."""
    ball = quad_sphere(cells, 0.5)
    around = np.flatnonzero(np.abs(ball.points[:, 0]) < 1e-9)
    around = around[ball.points[around, 1] > 0.1]
    around = around[np.argsort(ball.points[around, 2])]
    rim = ball.points[around] * 1.6
    strips = [
        [around[i], around[i + 1], ball.vertex_count + i + 1, ball.vertex_count + i] for i in range(len(around) - 1)
    ]
    faces = [*ball.face_vertex_indices.reshape(-1, 4).tolist(), *strips]
    return mesh_of(np.concatenate([ball.points, rim]), faces)


def band(quads: int = 40, rows: int = 4, turns: float = 0.5) -> PolygonMesh:
    """Return a strip that closes with so many half turns: with an odd number, it has one side."""
    turn, width = 2.0 * np.pi * np.arange(quads)[:, None] / quads, 0.3 * (2.0 * np.arange(rows + 1) / rows - 1.0)
    reach = 1.0 + width * np.cos(turns * turn)
    points = np.stack([reach * np.cos(turn), reach * np.sin(turn), width * np.sin(turns * turn)], axis=-1)
    across = np.arange(quads * (rows + 1)).reshape(quads, -1)
    last = across[0, ::-1] if round(2 * turns) % 2 else across[0]
    return mesh_of(points, lattice(np.vstack([across, last]).T).tolist())


def klein(n: int = 24, m: int = 12) -> PolygonMesh:
    """Return a Klein bottle: closed, and of one side."""
    u, v = np.meshgrid(2.0 * np.pi * np.arange(n) / n, 2.0 * np.pi * np.arange(m) / m, indexing="ij")
    reach = 1.0 + 0.4 * (np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v))
    height = 0.4 * (np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v))
    points = np.stack([reach * np.cos(u), reach * np.sin(u), height], axis=-1)
    around = np.vstack([closing(np.arange(n * m).reshape(n, m)), -np.arange(m + 1) % m])
    return mesh_of(points, lattice(around.T).tolist())


def t_junction() -> PolygonMesh:
    """Return a box with one side meshed finer than its neighbors (T-junctions): borders run along each other."""
    whole = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (4, 4, 4))
    top = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (6, 6, 6))
    upper = topology.face_centers(whole)[:, 1] > 0.49
    finer = topology.face_centers(top)[:, 1] > 0.49
    return merged(joined(without(whole, upper), without(top, ~finer)))


def doubled() -> PolygonMesh:
    """Return a ball with every face twice, the second time with vertices of its own."""
    return joined(quad_sphere(8, 0.5), quad_sphere(8, 0.5))


def _twice(mesh: PolygonMesh) -> NDArray[np.bool_]:
    """Return the faces that coincide with others: the walls between neighboring parts."""
    sets = [frozenset(f.tolist()) for f in np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])]
    counts = Counter(sets)
    return np.array([counts[corners] > 1 for corners in sets])


def ball_with_holes() -> PolygonMesh:
    """Return a ball of quads, from whose underside a round patch is missing, and a face elsewhere."""
    ball = quad_sphere(16, 0.5)
    centers = topology.face_centers(ball)
    drop = centers @ np.array([0.0, -1.0, 0.0]) > 0.5 * np.cos(0.22)
    drop[(centers @ np.array([1.0, 0.3, 0.0])).argmax()] = True
    return without(ball, drop)


def table() -> PolygonMesh:
    """Return a top on four thin legs, in one piece of quads, Z up."""
    top = box((0.0, 0.0, 0.7), (1.0, 0.6, 0.06), (20, 12, 1))
    legs = [box((x, y, 0.335), (0.05, 0.05, 0.67), (1, 1, 12)) for x in (-0.475, 0.475) for y in (-0.275, 0.275)]
    whole = merged(joined(top, *legs))
    return replace(without(whole, _twice(whole)), up_axis="Z")


def cup() -> PolygonMesh:
    """Return a closed cup, with a wall of a twelfth of its width."""
    outer = [(0.2, 0.0), (0.3, 0.0), *((0.3, h) for h in np.linspace(0.08, 0.7, 9))]
    inner = [*((0.25, h) for h in np.linspace(0.7, 0.1, 9)), (0.25, 0.05), (0.15, 0.05)]
    turn = 2.0 * np.pi * np.arange(32) / 32
    reach, height = np.array(outer + inner).T[..., None]
    circles = np.stack([reach * np.cos(turn), height + 0.0 * turn, -reach * np.sin(turn)], axis=-1)
    return with_tips(circles, [(0.0, 0.0, 0.0), (0.0, 0.05, 0.0)])


def bowl() -> PolygonMesh:
    """Return an open hemisphere."""
    ball = quad_sphere(12, 0.5)
    return without(ball, topology.face_centers(ball)[:, 1] > 0.0)


def sword() -> PolygonMesh:
    """Return a flat blade of 1 m by 5 cm by 4 mm, a guard and a grip, which overlap; Y up."""
    blade = box((0.0, 0.7, 0.0), (0.05, 1.0, 0.004), (3, 60, 1))
    blade = deformed(blade, lambda p: p * np.where(p[:, 1:2] > 1.05, [[0.3, 1.0, 1.0]], 1.0))
    guard = box((0.0, 0.2, 0.0), (0.2, 0.03, 0.03), (12, 2, 2))
    grip = box((0.0, 0.1, 0.0), (0.03, 0.19, 0.03), (2, 12, 2))
    return joined(blade, guard, grip)


def head() -> PolygonMesh:
    """Return a round head with a brow, a nose and thin ears."""
    ball = quad_sphere(24, 0.5)

    def shaped(points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = points.T / 0.5
        more = 0.08 * np.exp(-((y - 0.35) ** 2) / 0.01) * (z > 0.2)  # brow
        more = more + 0.25 * np.exp(-(x**2 + (y - 0.05) ** 2) / 0.02) * (z > 0)  # nose
        more = more - 0.08 * np.exp(-((np.abs(x) - 0.3) ** 2 + (y - 0.17) ** 2) / 0.01) * (z > 0)  # eyes
        more = more + 0.5 * np.exp(-((y - 0.1) ** 2) / 0.08 - z**2 / 0.006) * (np.abs(x) > 0.5)  # ears
        return points * (1.0 + more)[:, None]

    return deformed(ball, shaped)


def hair(ribbons: int = 200, length: int = 10) -> PolygonMesh:
    """Return ribbons of quads that hang from a scalp, each by itself, one quad wide."""
    numbers = np.random.default_rng(3)
    strands = []
    for _ in range(ribbons):
        turn, tilt = numbers.uniform(0.0, 2.0 * np.pi), numbers.uniform(0.0, 1.2)
        out = np.array([np.sin(tilt) * np.cos(turn), np.cos(tilt), np.sin(tilt) * np.sin(turn)])
        side = 0.012 * np.array([-np.sin(turn), 0.0, np.cos(turn)])
        along = np.linspace(0.0, 1.0, length + 1)[:, None]
        middle = 0.12 * out + along * (0.1 * out + [0.0, -0.05, 0.0]) - [0.0, 0.25, 0.0] * along**2
        points = np.concatenate([middle - side, middle + side])
        strands.append(mesh_of(points, lattice(np.arange(2 * length + 2).reshape(2, -1)).tolist()))
    return joined(*strands)


def haired() -> PolygonMesh:
    """Return a closed head under open hair."""
    return joined(deformed(quad_sphere(12, 0.12), lambda p: p * [1.0, 1.2, 1.0]), hair(60))


def car(windshield: bool = True) -> PolygonMesh:
    """Return a body, a cabin, bumpers, lamps, doors, handles and wheels, thirty closed parts that touch and overlap;
    and an open windshield. Z up, 4 m long."""
    parts = [
        box((0.0, 0.0, 0.6), (4.0, 1.6, 0.5), (16, 8, 2)),
        box((-0.2, 0.0, 1.1), (1.8, 1.4, 0.5), (8, 6, 2)),
        box((2.05, 0.0, 0.45), (0.12, 1.7, 0.2), (1, 8, 2)),
        box((-2.05, 0.0, 0.45), (0.12, 1.7, 0.2), (1, 8, 2)),
        box((0.0, 0.0, 0.32), (2.0, 1.2, 0.06), (6, 4, 1)),
    ]
    for side in (-1.0, 1.0):
        parts += [box((x, 0.81 * side, 0.62), (0.7, 0.03, 0.4), (4, 1, 3)) for x in (-0.6, 0.2)]
        parts += [box((x, 0.85 * side, 0.7), (0.12, 0.02, 0.03), (2, 1, 1)) for x in (-0.6, 0.2)]
        parts += [box((0.8, 0.86 * side, 0.95), (0.08, 0.16, 0.1))]
        parts += [box((x, 0.55 * side, 0.65), (0.06, 0.25, 0.12)) for x in (-2.02, 2.02)]
        parts += [box((0.0, 0.55 * side, 1.37), (1.2, 0.04, 0.04), (6, 1, 1))]
    for x in (-1.25, 1.25):
        for side in (-1.0, 1.0):
            wheel = deformed(quad_sphere(4, 0.32), lambda p: p * [1.0, 0.35, 1.0])
            parts.append(deformed(wheel, lambda p, x=x, side=side: p + [x, 0.8 * side, 0.32]))
            parts.append(box((x, 0.9 * side, 0.32), (0.1, 0.06, 0.1)))
    if windshield:
        glass = deformed(grid(6, 3), lambda p: p / [6.0, 3.0, 1.0])
        parts.append(
            deformed(glass, lambda p: p @ [[0.0, 1.3, 0.0], [-0.35, 0.0, 0.4], [0.0] * 3] + [1.15, -0.65, 0.9])
        )
    return replace(joined(*parts), up_axis="Z")


ODD: dict[str, Callable[[], PolygonMesh]] = {
    **{
        make.__name__: make
        for make in (chair, walled, two_at_an_edge, two_at_a_vertex, finned, klein, t_junction, doubled)
    },
    "whole_chair": lambda: chair(holes=False, mixed=False),
    "mixed_chair": lambda: chair(holes=False),
    "moebius": band,
    "twisted": lambda: band(turns=1.0),
    **{make.__name__: make for make in (ball_with_holes, table, cup, bowl, sword, head, hair, haired, car)},
}
"""by name"""
