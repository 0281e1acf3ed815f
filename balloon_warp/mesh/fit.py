"""Fitting of quads to their source surface: thickness of thin parts, tips and ridges.

All lengths are in cells of the grid.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.mesh.geometry import face_vector_areas, triangulate, vertex_normals
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.relaxation import middles, nearer, newton_direction

PROJECTIONS = 4
"""Number of projections of a slab onto its source"""
SLIDES = 6
"""Number of smoothing steps of its vertices along the surface afterwards"""
SKIN = 0.02
"""Depth behind a surface at which there is something solid, if at all"""
CHORD = 0.75
"""Factor by which corners stand out of a round surface, over the depth of the quads' centers within it"""
CUT_OFF = 0.15
"""Distance beyond the quads from which on something counts as a tip or a ridge"""
REACH = 1.3
"""Largest displacement of a vertex to a tip or a ridge"""
UPRIGHT = 0.3
"""Least cosine between normals of a quad before and after the displacement"""
PARTS = (1.0, 0.75, 0.5, 0.25)
"""Fractions of the displacement that are tried; the first that folds nothing is taken"""
PASSES = 2


def fitted(mesh: PolygonMesh, distance: MeshDistance, surface: NDArray[np.float64]) -> PolygonMesh:
    """Return the quads, with those of slabs on the faces that they stand for, and vertices on the tips that stand out.

    Args:
        mesh: closed, of quads, at the zero level of the distance.
        distance: to the surface, whose thin parts are slabs.
        surface: places on it, such as its vertices, shape (n, 3).
    """
    return with_tips(unfolded(mesh, without_slabs(mesh, distance)), surface)


def unfolded(before: PolygonMesh, after: PolygonMesh) -> PolygonMesh:
    """Return the quads of `after`, with vertices moved back around each quad that folds over.

    A quad folds over if it does not face the normals at its corners.
    """
    points = after.points.copy()
    quads = before.face_vertex_indices.reshape(-1, 4)
    moved = (points != before.points).any(axis=1)
    while moved.any():
        mesh = replace(after, points=points)
        upright = np.einsum("fcj,fj->fc", vertex_normals(mesh)[quads], face_vector_areas(mesh))
        back = np.zeros(len(points), dtype=bool)
        back[quads[(upright <= 0.0).any(axis=1)]] = True
        if not (back & moved).any():
            back[quads[back[quads].any(axis=1)]] = True
        back &= moved
        if not back.any():
            break
        points[back] = before.points[back]
        moved &= ~back
    return replace(after, points=points)


def slabs_left(mesh: PolygonMesh, distance: MeshDistance) -> bool:
    """Return whether vertices are on slabs, and not on the surface."""
    on_slab = distance.on_slabs(mesh.points)
    return bool((distance.solid(mesh.points[on_slab]) > 0.5 * distance.half_slab).any())


def without_slabs(mesh: PolygonMesh, distance: MeshDistance) -> PolygonMesh:
    """Return the quads with those of slabs moved to the surface, where there is a solid behind it.

    A sheet stays a slab.
    """
    on_slab = distance.on_slabs(mesh.points)
    if not on_slab.any():
        return mesh
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    points = _projected(mesh.points, on_slab, distance)
    for _ in range(SLIDES):
        normals = vertex_normals(replace(mesh, points=points))
        slide = 0.5 * (middles(points, quads) - points)
        slide -= (slide * normals).sum(axis=1)[:, None] * normals
        points = _projected(np.where(on_slab[:, None], points + slide, points), on_slab, distance)
    ways = newton_direction(points, distance.solid, 1.0)
    sizes = np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
    there = on_slab & (np.abs(distance.solid(points)) < SKIN) & (distance.solid(points - SKIN * ways / sizes) < 0.0)
    flat = replace(mesh, points=np.where(there[:, None], points, mesh.points))
    return replace(flat, points=flat.points + there[:, None] * _bulge(flat, distance)[:, None] * vertex_normals(flat))


def _bulge(mesh: PolygonMesh, distance: MeshDistance) -> NDArray[np.float64]:
    """Return the distance that each vertex must stand out of the surface for quads to have its volume.

    The centers of quads lie within a round surface: of a tube of four quads around, they have two thirds.
    """
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    within = np.clip(-distance.solid(mesh.points[quads].mean(axis=1)), 0.0, 0.5)
    counts = np.maximum(np.bincount(quads.ravel(), minlength=mesh.vertex_count), 1)
    return CHORD * np.bincount(quads.ravel(), np.repeat(within, 4), mesh.vertex_count) / counts


def _projected(points: NDArray[np.float64], which: NDArray[np.bool_], distance: MeshDistance) -> NDArray[np.float64]:
    points = points.copy()
    for _ in range(PROJECTIONS):
        ways = newton_direction(points[which], distance.solid, 1.0)
        points[which] = nearer(points[which], ways, distance.solid, 1.0)[0]
    return points


def with_tips(mesh: PolygonMesh, surface: NDArray[np.float64]) -> PolygonMesh:
    """Return the quads with a vertex at each tip of the surface, or on the way there.

    It goes as far as no quad is turned or folded over.
    """
    points = mesh.points.copy()
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    order = np.argsort(quads.ravel(), kind="stable")
    around = np.split(order // 4, np.cumsum(np.bincount(quads.ravel(), minlength=len(points)))[:-1])
    taken = np.zeros(len(points), dtype=bool)
    for _ in range(PASSES):
        outside = MeshDistance(points, triangulate(replace(mesh, points=points))[0], thickness=0.0)(surface)
        tips = np.flatnonzero((outside > CUT_OFF) & (outside < REACH))
        if not len(tips):
            break
        tips = tips[np.argsort(-outside[tips], kind="stable")]
        away, nearest = map(np.asarray, KDTree(points).query(surface[tips]))
        for tip, far, vertex in zip(tips.tolist(), away.tolist(), nearest.tolist(), strict=True):
            if far <= REACH and not taken[vertex]:
                taken[vertex] = _move(points, quads, around, vertex, surface[tip])
    return replace(mesh, points=points)


def _move(
    points: NDArray[np.float64],
    quads: NDArray[np.int32],
    around: list[NDArray[np.int64]],
    vertex: int,
    place: NDArray[np.float64],
) -> bool:
    """Move a vertex to a place, or as far towards it as no quad is turned or folded over; and whether it did move.

    Args:
        around: the quads of each vertex.
    """
    own = quads[around[vertex]]
    before, start = _normals(points[own]), points[vertex].copy()
    beside = [around[corner] for corner in np.unique(own)]
    for part in PARTS:
        points[vertex] = start + part * (place - start)
        after = _normals(points[own])
        if ((before * after).sum(axis=1) >= UPRIGHT).all() and not _folded(points, quads, beside):
            return True
    points[vertex] = start
    return False


def _folded(points: NDArray[np.float64], quads: NDArray[np.int32], around: list[NDArray[np.int64]]) -> bool:
    """Return whether a quad does not face the normal at a corner, the mean of its quads', for some vertices.

    Args:
        around: Quads of each of them.
    """
    counts = [len(own) for own in around]
    normals = _normals(points[quads[np.concatenate(around)]])
    at_vertices = np.add.reduceat(normals, np.cumsum([0, *counts[:-1]]))
    return bool(((normals * np.repeat(at_vertices, counts, axis=0)).sum(axis=1) <= 0.0).any())


def _normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normals of quads, shape (n, 4, 3)."""
    doubled = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    return doubled / np.maximum(np.linalg.norm(doubled, axis=1, keepdims=True), 1e-12)
