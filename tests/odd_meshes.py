"""Meshes whose faces meet oddly: non-manifold edges, inconsistent winding, missing faces, a single side."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from meshes import box, closing, joined, lattice, mesh_of, quad_sphere
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.repair import distinct_faces
from balloon_warp.mesh.topology import corner_faces, face_centers, first_coincident, flipped, with_corners


def merged(mesh: PolygonMesh, digits: int = 6) -> PolygonMesh:
    """Return the mesh with coincident vertices merged: where boxes stand side by side, edges get three faces and four.
    Vertices of no face are left out."""
    first = first_coincident(mesh.points.round(digits) + 0.0)[mesh.face_vertex_indices]
    used, numbers = np.unique(first, return_inverse=True)
    return replace(mesh, points=mesh.points[used], face_vertex_indices=numbers.astype(np.int32))


def without(mesh: PolygonMesh, drop: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh without some faces, by a mask."""
    kept = with_corners(mesh, ~drop[corner_faces(mesh)])
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
    return flipped(mesh, numbers.random(mesh.face_count) < 0.3) if mixed else mesh


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
    upper = face_centers(whole)[:, 1] > 0.49
    finer = face_centers(top)[:, 1] > 0.49
    return merged(joined(without(whole, upper), without(top, ~finer)))


def doubled() -> PolygonMesh:
    """Return a ball with every face twice, the second time with vertices of its own."""
    return joined(quad_sphere(8, 0.5), quad_sphere(8, 0.5))
