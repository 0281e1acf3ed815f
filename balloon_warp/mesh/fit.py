"""Quads fitted to the surface that they are made of: thin parts as thin as they are, tips and ridges where they were.
All lengths are in cells of the grid."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from balloon_warp.mesh.geometry import face_vector_areas, triangulate, vertex_normals
from balloon_warp.mesh.mesh_distance import MeshDistance
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.relaxation import middles, nearer, newton_direction

PROJECTIONS = 4
"""of a slab onto what it stands for"""
RETREATS = 20
"""of quads that fitting has folded"""
SLIDES = 6
"""of its vertices afterwards, along the surface"""
SKIN = 0.02
"""behind a surface is something solid, if it is so much behind it"""
CHORD = 0.75
"""of how far the middles of quads are within a round surface, their corners stand out to make up for it"""
CUT_OFF = 0.15
"""what stands out of the quads by more is a tip or a ridge"""
REACH = 1.3
"""that a vertex goes to one, at most"""
UPRIGHT = 0.3
"""the cosine between normals of a quad before and after that, at least"""
PASSES = 2


def fitted(mesh: PolygonMesh, distance: MeshDistance, surface: NDArray[np.float64]) -> PolygonMesh:
    """The quads, with those of slabs on the faces that they stand for, and vertices on the tips that stand out.

    Args:
        mesh: closed, of quads, at the zero level of the distance.
        distance: to the surface, whose thin parts are slabs.
        surface: places on it, such as its vertices, shape (n, 3).
    """
    return with_tips(_without_folds(mesh, without_slabs(mesh, distance)), surface)


def _without_folds(before: PolygonMesh, after: PolygonMesh) -> PolygonMesh:
    """Quads on the surface, where none is folded there: the corners of those that would be stay on the slab."""
    quads = after.face_vertex_indices.reshape(-1, 4)
    points = after.points.copy()
    for _ in range(RETREATS):
        mesh = replace(after, points=points)
        facing = np.einsum("fcj,fj->fc", vertex_normals(mesh)[quads], face_vector_areas(mesh))
        folded = (facing <= 0.0).any(axis=1)
        if not folded.any():
            return mesh
        back = np.unique(quads[folded])
        if (points[back] == before.points[back]).all():
            back = np.unique(quads[np.isin(quads, back).any(axis=1)])  # those beside them, too
        points[back] = before.points[back]
    return replace(after, points=points)


def slabs_left(mesh: PolygonMesh, distance: MeshDistance) -> bool:
    """Whether vertices are on slabs, and not on the surface."""
    on_slab = distance.on_slabs(mesh.points)
    return bool((distance.solid(mesh.points[on_slab]) > 0.5 * distance.half_slab).any())


def without_slabs(mesh: PolygonMesh, distance: MeshDistance) -> PolygonMesh:
    """The quads, with those of slabs on the surface, where something solid is behind it: a sheet stays a slab."""
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
    """How far each vertex is to stand out of the surface, so that quads, whose middles lie within it where it is round,
    have its volume: of a tube of four quads around, they have two thirds."""
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
    """The quads, with a vertex at each place of the surface that stands out of them the most, where no quad is turned
    over by that."""
    points = mesh.points.copy()
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    around = [np.zeros(0, dtype=np.int64)] * len(points)
    order = np.argsort(quads.ravel(), kind="stable")
    parts = np.split(order // 4, np.cumsum(np.bincount(quads.ravel(), minlength=len(points)))[:-1])
    around = parts if len(parts) == len(points) else around
    taken = np.zeros(len(points), dtype=bool)
    for _ in range(PASSES):
        outside = MeshDistance(points, triangulate(replace(mesh, points=points))[0], thickness=0.0)(surface)
        tips = np.flatnonzero((outside > CUT_OFF) & (outside < REACH))
        if not len(tips):
            break
        tips = tips[np.argsort(-outside[tips], kind="stable")]
        away, nearest = map(np.asarray, KDTree(points).query(surface[tips]))
        for tip, far, vertex in zip(tips.tolist(), away.tolist(), nearest.tolist(), strict=True):
            if far > REACH or taken[vertex]:
                continue
            own = quads[around[vertex]]
            before, kept = _normals(points[own]), points[vertex].copy()
            points[vertex] = surface[tip]
            after = _normals(points[own])
            sizes = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
            if ((before * after).sum(axis=1) < UPRIGHT * sizes).any() or (sizes == 0.0).any():
                points[vertex] = kept
            else:
                taken[vertex] = True
    return replace(mesh, points=points)


def _normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of quads, shape (n, 4, 3): twice their vector areas."""
    return np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
