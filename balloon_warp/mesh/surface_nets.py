"""Surface nets: from a signed distance to a closed mesh of even quads, relaxed and fitted to the surface.

Fitting of quads to their source surface: thickness of thin parts, tips and ridges.

All lengths are in cells of the grid.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh
import warp as wp
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from warp.geometry import IsoSurfaceNets

from balloon_warp.kernels.measure.crossings import signed_distances, unsigned_distances
from balloon_warp.mesh.crossings import without_crossings
from balloon_warp.mesh.orientation import oriented_outward
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    component_labels,
    face_vector_areas,
    first_coincident,
    triangulate,
    vertex_normals,
)
from balloon_warp.system.warp_threads import lock_of

SLAB = 1.5
"""Thickness below which something is thin, and of its slab, over the given thickness"""


class MeshDistance:
    """Distance to a triangle mesh, negative inside, where its winding number is above one half.

    Parts thinner than 1.5 times `thickness`, a sheet among them, count as a slab of that about the surface: a rod that
    is thicker has a node of a grid of that width in every cell along it, wherever it lies. So does such a slab;
    but not the edge of a wedge nor the tip of a cone, which are thin for a short way only. With 0, no part does.
    """

    def __init__(self, points: NDArray[np.float64], triangles: NDArray[np.integer[Any]], thickness: float):
        """Take points of shape (n, 3), outward triangles of shape (m, 3), and a thickness in the points' unit."""
        self._farthest = 10.0 * float(np.linalg.norm(np.ptp(points, axis=0))) + 10.0 * thickness
        self.half_slab = 0.5 * SLAB * thickness
        """Distance of a slab's surface from its source"""
        self._mesh = _warp_mesh(points, triangles, winding_number=True)
        self._sheets = self._thin_parts(points, triangles, thickness) if thickness > 0.0 else None

    @property
    def has_thin_parts(self) -> bool:
        """Return whether any part counts as a slab."""
        return self._sheets is not None

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of points of shape (n, 3), shape (n,)."""
        distances = self.solid(points)
        if self._sheets is None:
            return distances
        return np.minimum(distances, self._query(unsigned_distances, self._sheets, points) - self.half_slab)

    def solid(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances of points of shape (n, 3) to the mesh itself, without slabs, shape (n,)."""
        return self._query(signed_distances, self._mesh, points)

    def on_slabs(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of the points of shape (n, 3) at the zero level that are about at a slab's, shape (n,)."""
        if self._sheets is None:
            return np.zeros(len(points), dtype=bool)
        return self._query(unsigned_distances, self._sheets, points) < 1.3 * self.half_slab

    def _thin_parts(
        self, points: NDArray[np.float64], triangles: NDArray[np.integer[Any]], thickness: float
    ) -> wp.Mesh | None:
        """Return the surface where nothing solid lies behind it, in pieces no longer than the thickness."""
        points, triangles, *_ = trimesh.remesh.subdivide_to_size(points, triangles, thickness, max_iter=30)
        corners = points[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        triangles, centers = triangles[lengths > 0.0], corners.mean(axis=1)[lengths > 0.0]
        depth = SLAB * thickness * normals[lengths > 0.0] / lengths[lengths > 0.0, None]
        behind = self._query(signed_distances, self._mesh, centers - depth)
        thin = behind > 0.0

        # Worth it only where a part reaches away from anything thick.
        reaching = thin.copy()
        if not thin.all():
            thick = _warp_mesh(points, triangles[~thin])
            reaching[thin] = self._query(unsigned_distances, thick, centers[thin]) > 2.0 * thickness
        parts = _part_labels(points, triangles[thin])
        parts_kept = np.isin(parts, parts[reaching[thin]])
        return _warp_mesh(points, triangles[thin][parts_kept]) if parts_kept.any() else None

    def _query(self, kernel: Any, mesh: wp.Mesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
        with lock_of(wp.get_device()):
            distances = wp.empty(len(points), dtype=float)
            at = wp.array(points, dtype=wp.vec3)
            wp.launch(kernel, len(points), inputs=[mesh.id, at, self._farthest], outputs=[distances])
            return distances.numpy().astype(np.float64)


def _part_labels(points: NDArray[np.float64], triangles: NDArray[np.integer[Any]]) -> NDArray[np.int64]:
    """Return labels that connected triangles share, shape (triangle_count,)."""
    a, b, c = first_coincident(points)[triangles].T
    return component_labels(len(points), np.concatenate([a, a]), np.concatenate([b, c]))[a]


def _warp_mesh(
    points: NDArray[np.float64], triangles: NDArray[np.integer[Any]], winding_number: bool = False
) -> wp.Mesh:
    with lock_of(wp.get_device()):
        return wp.Mesh(
            points=wp.array(points, dtype=wp.vec3),
            indices=wp.array(triangles.ravel(), dtype=wp.int32),
            support_winding_number=winding_number,
        )


@dataclass(frozen=True)
class Level:
    """A distance in cells, about the middle of a surface: Warp measures in float32."""

    distance: MeshDistance
    reach: NDArray[np.float64]
    """Half the box of the level, in cells, shape (3,)"""
    middle: NDArray[np.float64]
    """Center of the surface, in its unit, shape (3,)"""
    cell: float
    """Width of a cell, in the surface's unit"""

    @classmethod
    def of(cls, mesh: PolygonMesh, cells: int) -> "Level":
        """Return the level of a surface whose longest side has so many cells."""
        used = mesh.points[np.unique(mesh.face_vertex_indices)]
        lower, upper = used.min(axis=0), used.max(axis=0)
        middle, cell = 0.5 * (lower + upper), cls.width(mesh, cells)
        triangles, _ = triangulate(oriented_outward(mesh))
        distance = MeshDistance((mesh.points - middle) / cell, triangles, thickness=1.0)
        # Half of a slab and its blend stand out of the box.
        return cls(distance, 0.5 * (upper - lower) / cell + 2.0, middle, cell)

    @staticmethod
    def width(mesh: PolygonMesh, cells: int) -> float:
        """Return the width of a cell."""
        return float(np.ptp(mesh.points[mesh.face_vertex_indices], axis=0).max()) / cells


Distance = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Signed distance, negative inside: points of shape (n, 3) to distances of shape (n,), in the unit of the points."""
SLIDES = 20
PROJECTIONS = 3
LOOSE = 0.25


def relax(mesh: PolygonMesh, distance: Distance, cell: float) -> PolygonMesh:
    """Slide each vertex towards the middle of its neighbors, along the zero level of `distance`, and end on it.

    Args:
        mesh: closed quad mesh within a cell of the zero level.
        distance: signed distance, whose zero level is the surface.
        cell: about the length of an edge.
    """
    quads = mesh.face_vertex_indices.reshape(-1, 4)
    points, at_points = mesh.points, distance(mesh.points)
    for _ in range(SLIDES):
        normals = vertex_normals(replace(mesh, points=points))
        slide = middles(points, quads) - points
        # Vertices that no step brings to the zero level, where the distance jumps as across a hole, form a membrane.
        held = np.abs(at_points) < LOOSE * cell
        slide[held] -= (_dot(slide, normals)[:, None] * normals)[held]
        points, at_points = nearer(points + 0.5 * slide, normals, distance, cell)
    for _ in range(PROJECTIONS):
        held = np.abs(at_points) < LOOSE * cell
        newton = newton_direction(points, distance, cell) * held[:, None]
        points, at_points = nearer(points, newton, distance, cell)
    return replace(mesh, points=points)


def middles(points: NDArray[np.float64], quads: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the mean of the neighbors of each vertex, the larger faces counting more."""
    corners = points[quads]
    neighbors = np.roll(corners, 1, axis=1) + np.roll(corners, -1, axis=1)
    diagonals = corners[:, 2:] - corners[:, :2]
    area = np.linalg.norm(np.cross(diagonals[:, 0], diagonals[:, 1]), axis=1)
    weights = np.repeat(area, 4)
    vertex = quads.ravel()
    sums = np.stack(
        [np.bincount(vertex, weights * neighbors[..., axis].ravel(), len(points)) for axis in range(3)], axis=1
    )
    return sums / (2.0 * np.bincount(vertex, weights, len(points)))[:, None]


def newton_direction(points: NDArray[np.float64], distance: Distance, cell: float) -> NDArray[np.float64]:
    """Return the gradient of the distance over its square, by central differences."""
    step = 0.02 * cell
    offsets = step * np.concatenate([np.eye(3), -np.eye(3)])
    around = distance((points[:, None] + offsets).reshape(-1, 3)).reshape(-1, 6)
    gradient = (around[:, :3] - around[:, 3:]) / (2.0 * step)
    # In a crease narrower than a cell the gradient may vanish.
    return gradient / np.maximum(_dot(gradient, gradient), 0.1)[:, None]


def nearer(
    points: NDArray[np.float64], direction: NDArray[np.float64], distance: Distance, cell: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points moved against `direction` by their distance, where that brings them nearer to the zero level.

    Returns:
        The points and their distances.
    """
    before = distance(points)
    steps = np.clip(before, -0.5 * cell, 0.5 * cell)
    moved = points - steps[:, None] * direction
    after = distance(moved)
    gain = np.abs(before) - np.abs(after)
    accepted = gain > 0.25 * np.abs(steps)
    return np.where(accepted[:, None], moved, points), np.where(accepted, after, before)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("ij,ij->i", a, b)


FIT_PROJECTIONS = 4
"""Number of projections of a slab onto its source"""
FIT_SLIDES = 6
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
    for _ in range(FIT_SLIDES):
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
    for _ in range(FIT_PROJECTIONS):
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


def surface_nets(distance: Distance, lower: ArrayLike, upper: ArrayLike, cell: float) -> PolygonMesh:
    """Mesh the zero level of a signed distance as a closed mesh of even quads, wound outward.

    It does not cross itself. The distance may be off in scale, as that of a smooth union is, but must be continuous
    near its zero level. The level is cut off at the box; parts thinner than a cell may be lost.

    Args:
        distance: the signed distance.
        lower: corner of the box to search, shape (3,).
        upper: the opposite corner, shape (3,). The grid is centered in the box and covers it.
        cell: width of a grid cell, about the length of an edge.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    # An odd number of cells: a plane of symmetry through the middle of the box then goes through vertices.
    cells = 2 * np.ceil((upper - lower) / (2.0 * cell)).astype(int) + 1
    lower = 0.5 * (lower + upper) - 0.5 * cell * cells
    values = distance(grid_nodes(lower, cell, cells)).reshape(cells + 1)
    # A solid larger than the box is cut off there: the level ends within the grid.
    for axis in range(3):
        ends = np.moveaxis(values, axis, 0)
        ends[[0, -1]] = np.maximum(ends[[0, -1]], 0.5 * cell)
    mesh = extract(values, lower, cell)
    return without_crossings(mesh, relax(mesh, distance, cell))


def grid_nodes(lower: NDArray[np.float64], cell: float, cells: NDArray[np.int_]) -> NDArray[np.float64]:
    """Return the nodes of a grid of `cells` cells along each axis, x slowest, shape (node_count, 3)."""
    index = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1)
    return lower + cell * index.reshape(-1, 3)


def extract(values: NDArray[np.float64], lower: NDArray[np.float64], cell: float) -> PolygonMesh:
    """Return the surface nets of a sampled signed distance: a quad for each grid edge that the zero level crosses.

    Where the level passes through a cell more than once, each pass has a vertex of its own (Warp sees to that), so
    each edge lies on exactly two faces, for any samples. Runs on Warp's default device.

    Args:
        values: the distance at the nodes of a grid, positive all around its border, shape (nx, ny, nz).
        lower: place of the first node, shape (3,).
        cell: width of a grid cell.
    """
    field: Any = wp.array3d(values, dtype=wp.float32)
    vertices, indices = IsoSurfaceNets.extract(field, 0.0, topology="quad")
    corners = indices.numpy().astype(np.int32)
    return PolygonMesh(
        # Warp gives points in grid units: placed here in float64.
        points=lower + cell * vertices.numpy().astype(np.float64),
        face_vertex_counts=np.full(len(corners) // 4, 4, dtype=np.int32),
        face_vertex_indices=corners,
    )
