"""Tables of tearing membranes."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.laws.tearing import PARAMETERS
from balloon_warp.kernels.wear_tables import TearTable
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.geometry import face_vector_areas, total_area
from balloon_warp.model import Model
from balloon_warp.model.memory import Allocating, Room

BRANCHING_WAY = 0.25
"""Distance between two branchings of a tear, over a balloon's diameter"""
MOST_TORN = 0.085
"""Largest fraction of the skin that tears, a face wide, are to take away"""
TEARS_BY_BRANCHINGS = (0.0, 1.5, 2.7, 4.5)
"""Length of all tears over a sphere's circumference, where they never branch, where they branch at their start only,
and once or twice after"""


def tear_arrays(model: Model, room: Room) -> dict[str, Any]:
    """Return the arrays of a substep's tears; empty where nothing tears."""
    worlds = model.world_count
    faces = (worlds, model.face_count if model.bursts else 0)
    return {
        "stresses": room.array((worlds, model.triangle_count if model.bursts else 0), wp.float32),
        "gone": room.array(faces, wp.int8),
        "ahead": room.array(faces, wp.float32),
        "face_stresses": room.array(faces, wp.float32),
        "weakest": room.array((worlds, model.balloon_count if model.bursts else 0), wp.int64),
        "areas": room.array((worlds, model.balloon_count if model.bursts else 0, 2), wp.int64),
    }


def tear_table(model: Model) -> Any:
    """Return the faces, their triangles, and who is beside them."""
    table = TearTable()
    for name, memory in tear_arrays(model, Allocating(model.device)).items():
        setattr(table, name, memory)
    firsts = np.cumsum([0, *(shape.mesh.face_count for shape in model.shapes)])
    faces = np.concatenate([shape.membrane.faces + first for shape, first in zip(model.shapes, firsts, strict=False)])
    meshes = [shape.mesh for shape in model.shapes]
    beside = [neighbors_of(mesh) for mesh in meshes]
    pairs = np.concatenate([each.faces + first for each, first in zip(beside, firsts, strict=False)])
    edges = np.concatenate([each.edges + first for each, first in zip(beside, model.particle_offsets, strict=False)])

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    numbers = np.arange(model.face_count + 1)
    order = np.argsort(faces, kind="stable")
    table.triangle_offsets = array(np.searchsorted(faces[order], numbers), wp.int32)
    table.triangles = array(order, wp.int32)
    table.neighbor_offsets = array(np.searchsorted(pairs[:, 0], numbers), wp.int32)
    table.neighbors, table.edges = array(pairs[:, 1], wp.int32), array(edges, wp.vec2i)
    table.rests = array(np.concatenate([_rests(mesh) for mesh in meshes]), wp.vec3)
    table.centers = array(np.concatenate([_centers(mesh) for mesh in meshes]), wp.vec3)
    table.normals = array(np.concatenate([_normals(mesh) for mesh in meshes]), wp.vec3)
    table.ways = array([BRANCHING_WAY * diameter_of(mesh) for mesh in meshes], wp.float32)
    table.branchings = array([branchings_of(mesh) for mesh in meshes], wp.int32)
    put_tear_parameters(table, model)
    return table


def tears_of_world(model: Model, tears: Any) -> Any:
    """Return a batch's table for one of its worlds."""
    table = TearTable()
    for name in TearTable.vars:
        memory = getattr(tears, name)
        setattr(table, name, memory[:1] if memory.ndim > 1 else memory)
    put_tear_parameters(table, model)
    return table


def put_tear_parameters(table: Any, model: Model) -> None:
    """Store the tear parameters of the balloons in the model's worlds."""
    for row in PARAMETERS:
        setattr(table, row.name, model.parameters[row.name])


class Neighbors(NamedTuple):
    """Pairs of faces that share an edge, each from both, sorted."""

    faces: NDArray[np.int64]
    """Two faces of each edge, shape (n, 2)"""
    edges: NDArray[np.int64]
    """Vertices of each edge, shape (n, 2)"""


def neighbors_of(mesh: PolygonMesh) -> Neighbors:
    """Return the neighbors of each face."""
    counts = np.asarray(mesh.face_vertex_counts, dtype=np.int64)
    begins = np.asarray(mesh.face_vertex_indices, dtype=np.int64)
    ends = np.sort(np.stack([begins, begins[next_corners(mesh)]], axis=1), axis=1)
    owners = np.repeat(np.arange(len(counts)), counts)
    order = np.lexsort([owners, ends[:, 1], ends[:, 0]])
    ends, owners = ends[order], owners[order]
    shared = (ends[1:] == ends[:-1]).all(axis=1) & (owners[1:] != owners[:-1])
    one, other = owners[:-1][shared], owners[1:][shared]
    pairs = np.concatenate([np.stack([one, other], axis=1), np.stack([other, one], axis=1)])
    pairs, first = np.unique(pairs, axis=0, return_index=True)
    return Neighbors(pairs, np.tile(ends[:-1][shared], (2, 1))[first])


def _rests(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the vertices about their middle, which keeps float32's digits [m]."""
    return np.asarray(mesh.points - mesh.points.mean(axis=0), dtype=np.float64)


def _centers(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the centers of faces [m]."""
    corners = _rests(mesh)[mesh.face_vertex_indices]
    offsets = np.cumsum(np.append(0, mesh.face_vertex_counts))
    return np.array([corners[begin:end].mean(axis=0) for begin, end in pairwise(offsets)])


def _normals(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the unit normals of faces."""
    vectors = face_vector_areas(mesh)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny)


def diameter_of(mesh: PolygonMesh) -> float:
    """Return the diameter of the sphere of equal area [m]."""
    return float(np.sqrt(total_area(mesh) / np.pi))


def share_of_tear(mesh: PolygonMesh) -> float:
    """Return the part of the surface that a tear once around a balloon takes away.

    A line meets a face as often as the face has perimeter, 1 / pi of it times the line's length over all area
    (Cauchy, Crofton).
    """
    corners = np.asarray(mesh.points, dtype=np.float64)[mesh.face_vertex_indices]
    lengths = np.linalg.norm(corners[next_corners(mesh)] - corners, axis=1)
    perimeters = np.bincount(corner_faces(mesh), lengths, mesh.face_count)
    areas = np.linalg.norm(face_vector_areas(mesh), axis=1)
    return float(diameter_of(mesh) * (perimeters @ areas) / max(areas.sum() ** 2, np.finfo(float).tiny))


def branchings_of(mesh: PolygonMesh) -> int:
    """Return the number of branchings of a tear for which its gaps, a face wide, leave nine tenths of the skin."""
    return int(np.searchsorted(TEARS_BY_BRANCHINGS, MOST_TORN / share_of_tear(mesh), side="right")) - 1
