"""Selection of the parts of a mesh that make up a balloon."""

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.corners import corner_faces, face_starts, with_corners
from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import border_edges, mesh_edges, vertex_components

Taken = Literal["all", "closed", "largest"]


def parts_taken(mesh: PolygonMesh, taken: Taken, source: object) -> tuple[NDArray[np.bool_], str | None]:
    """Return the vertices of the parts that are taken, shape (vertex_count,), and a sentence about those that are not.

    Args:
        taken: all parts, which share no vertex; those without a border; or the one of the largest area.
        source: where the mesh is from.

    Raises:
        InputError: none is closed; it names `source`.
    """
    edges = mesh_edges(mesh)
    component = vertex_components(mesh, edges)
    of_faces = component[mesh.face_vertex_indices[face_starts(mesh)]]
    parts = np.unique(of_faces)
    if taken == "all":
        kept = parts
    elif taken == "largest":
        kept = parts[[np.bincount(of_faces, face_areas(mesh), mesh.vertex_count)[parts].argmax()]]
    else:
        kept = np.setdiff1d(parts, component[edges.ends[border_edges(edges), 0]])
        if not len(kept):
            open_ = "its part is" if len(parts) == 1 else f"all of its {len(parts):,} parts are"
            raise InputError(
                f'{source}: has no closed part, {open_} open; expected taken = "all" or "largest", or a mesh that '
                "`balloon-warp remesh` made"
            )
    left = len(parts) - len(kept)
    if not left:
        return np.ones(mesh.vertex_count, dtype=bool), None
    faces = np.count_nonzero(~np.isin(of_faces, kept))
    which = "are open" if taken == "closed" else "are smaller than the largest"
    which = which.replace("are", "is") if left == 1 else which
    sentence = f"{left:,} of {len(parts):,} parts, of {faces:,} faces, {'is' if left == 1 else 'are'} left out: "
    return np.isin(component, kept), f"{sentence}{'it' if left == 1 else 'they'} {which}."


def of_vertices(mesh: PolygonMesh, kept: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with the faces of some vertices alone, by a mask; its vertices keep their numbers."""
    if kept.all():
        return mesh
    return _with_faces(mesh, kept[mesh.face_vertex_indices[face_starts(mesh)]])


def of_faces(mesh: PolygonMesh, faces: NDArray[np.bool_]) -> PolygonMesh:
    """Return the mesh with some of its faces alone, by a mask, and the vertices and groups that they have."""
    taken = _with_faces(mesh, faces)
    used, indices = np.unique(taken.face_vertex_indices, return_inverse=True)
    groups = {name: np.flatnonzero(np.isin(used, own)).astype(np.int32) for name, own in mesh.groups.items()}
    return replace(
        taken,
        points=mesh.points[used],
        face_vertex_indices=indices.ravel().astype(np.int32),
        groups={name: own for name, own in groups.items() if len(own)},
    )


def _with_faces(mesh: PolygonMesh, faces: NDArray[np.bool_]) -> PolygonMesh:
    return replace(with_corners(mesh, faces[corner_faces(mesh)]), face_vertex_counts=mesh.face_vertex_counts[faces])
