"""A mesh as a balloon can be made of it. `describe_defects` says what is wrong with it, and what is done about it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.corners import corner_faces, with_corners
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.orientation import facing_outward
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import duplicate_faces, repeated_corners


def repaired(mesh: PolygonMesh, source: object) -> PolygonMesh:
    """The mesh with each corner of a face taken once, each face once, and one winding, outward. Vertices stay.

    Raises:
        InputError: no face is left; it names `source`.
    """
    mesh, kept = distinct_faces(mesh)
    if not len(kept):
        raise InputError(f"{source}: has no face with three different corners")
    return facing_outward(mesh)


def distinct_faces(mesh: PolygonMesh) -> tuple[PolygonMesh, NDArray[np.int64]]:
    """The mesh with each vertex where a face comes to it first, less the faces that have under three then, or the
    corners of an earlier face; and the faces that it has kept, in order."""
    mesh = _distinct_corners(mesh)
    keep = mesh.face_vertex_counts >= 3
    keep[duplicate_faces(mesh)] = False
    kept = with_corners(mesh, keep[corner_faces(mesh)])
    return replace(kept, face_vertex_counts=mesh.face_vertex_counts[keep]), np.flatnonzero(keep)


def _distinct_corners(mesh: PolygonMesh) -> PolygonMesh:
    first = np.ones(len(mesh.face_vertex_indices), dtype=bool)
    first[repeated_corners(mesh)] = False
    counts = np.bincount(corner_faces(mesh)[first], minlength=mesh.face_count).astype(np.int32)
    return replace(with_corners(mesh, first), face_vertex_counts=counts)


def welded(mesh: PolygonMesh) -> PolygonMesh:
    """The mesh with its faces joined where vertices lie at exactly the same place: all go to the first there. Vertices
    keep their numbers; those that faces have left belong to none."""
    first = first_coincident(mesh.points)
    indices = first[mesh.face_vertex_indices].astype(np.int32)
    moved = len(np.unique(mesh.face_vertex_indices[indices != mesh.face_vertex_indices]))
    if not moved:
        return mesh
    lay = "vertex that lay exactly on another has" if moved == 1 else "vertices that lay exactly on others have"
    sentence = f"{moved:,} {lay} been welded."
    return replace(mesh, face_vertex_indices=indices, warnings=(*mesh.warnings, sentence))
