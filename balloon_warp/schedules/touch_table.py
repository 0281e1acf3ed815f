"""Surfaces of balloons that touch, as kernels read them."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.tables import TouchTable
from balloon_warp.kernels.traits import Traits
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.model import Model
from balloon_warp.model.touch import STIFFNESSES, THICKNESS, edge_length

SEARCH_SECONDS = 1.0 / 480.0
"""between two searches: balloons that meet at 10 m/s come 2 cm nearer meanwhile"""
LEAST_SUBSTEPS = 4
"""between two searches, however long they are"""
SLACK = 0.1
"""of an edge, that each of two particles may gain on its way between two searches by accelerating"""
DEPTH = 0.25
"""of the least extent of a balloon at the start, down to which what is inside is pushed out"""
APART = 3.0
"""edges between parts of a balloon at the start that may touch"""
TRIANGLES = 16
"""of a patch, or as many as there are patches, over two, if that is more"""


def touch_table(model: Model, traits: Traits) -> Any:
    """The balloons' surfaces; empty where none touch."""
    table = TouchTable()
    if not traits.touches:
        return table
    shapes, offsets = model.shapes, model.particle_offsets
    triangles, patch_offsets, balloon_patches = [], [np.zeros(1, dtype=np.int64)], [0]
    for shape, first in zip(shapes, offsets[:-1], strict=True):
        own, ends = patches_of(shape.mesh)
        patch_offsets.append(ends[1:] + patch_offsets[-1][-1])
        balloon_patches.append(balloon_patches[-1] + len(ends) - 1)
        triangles.append(own + first)
    edges = np.array([edge_length(shape.mesh) for shape in shapes])

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=model.device)

    table.triangles = array(np.concatenate(triangles), wp.vec3i)
    table.patch_offsets = array(np.concatenate(patch_offsets), wp.int32)
    table.balloon_patches = array(balloon_patches, wp.int32)
    table.closed = array([shape.closed for shape in shapes], wp.int32)
    table.thickness = array(THICKNESS * edges, float)
    table.slack = array(SLACK * edges, float)
    extents = [np.ptp(shape.mesh.points[shape.mesh.face_vertex_indices], axis=0).min() for shape in shapes]
    table.depth = array(DEPTH * np.array(extents), float)
    table.stiffness = model.parameters[STIFFNESSES]
    rest = np.concatenate([shape.mesh.points for shape in shapes])
    table.rest_points = array(rest if traits.touches_itself else np.zeros((0, 3)), wp.vec3)
    table.apart = array(APART * edges, float)
    table.seconds = substeps_of_search(model) * model.step_seconds
    return table


def patches_of(mesh: PolygonMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """A mesh's triangles, patch by patch, shape (T, 3), and where each patch begins, and after the last, where they
    end. A patch is what halving by the longest extent comes to."""
    triangles = triangles_of(mesh)
    centers = mesh.points[triangles].mean(axis=1)
    most = max(TRIANGLES, int(0.5 * np.sqrt(len(triangles))))
    patches, waiting = [], [np.arange(len(triangles))]
    while waiting:
        some = waiting.pop()
        if len(some) <= most:
            patches.append(some)
            continue
        axis = int(np.ptp(centers[some], axis=0).argmax())
        some = some[np.argsort(centers[some, axis], kind="stable")]
        waiting += [some[len(some) // 2 :], some[: len(some) // 2]]
    return triangles[np.concatenate(patches)], np.cumsum([0, *(len(patch) for patch in patches)])


def triangles_of(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Faces in triangles: quads along their shorter diagonal, and others as fans from the first corner."""
    corners = np.asarray(mesh.face_vertex_indices, dtype=np.int64)
    triangles = []
    for begin, count in zip(np.cumsum([0, *mesh.face_vertex_counts[:-1]]), mesh.face_vertex_counts, strict=True):
        face = corners[begin : begin + count]
        if count == 4:
            across = np.linalg.norm(mesh.points[face[:2]] - mesh.points[face[2:]], axis=1)
            face = np.roll(face, -1) if across[1] < across[0] else face
        triangles += [(face[0], face[number], face[number + 1]) for number in range(1, count - 1)]
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def substeps_of_search(model: Model) -> int:
    """Substeps from one search to the next."""
    return max(int(SEARCH_SECONDS / model.step_seconds), LEAST_SUBSTEPS)
