"""A mesh as a balloon can be made of it. `describe_defects` names its defects and their treatment."""

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.corners import corner_faces, with_corners
from balloon_warp.mesh.holes import with_lids
from balloon_warp.mesh.orientation import facing_outward, wound_alike
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import duplicate_faces, repeated_corners


def repaired(mesh: PolygonMesh, source: object, holes: Literal["cap", "keep"] = "cap") -> PolygonMesh:
    """Return the mesh without repeated corners and faces, wound outward, and with lids on its holes.

    Vertices stay.

    Raises:
        InputError: no face is left; it names `source`.
    """
    mesh, kept = distinct_faces(mesh)
    if not len(kept):
        raise InputError(f"{source}: has no face with three different corners")
    return facing_outward(mesh if holes == "keep" else with_lids(wound_alike(mesh)))


def distinct_faces(mesh: PolygonMesh) -> tuple[PolygonMesh, NDArray[np.int64]]:
    """Return the mesh without repeated vertices in faces and without repeated faces, and the kept faces in order.

    A vertex stays where a face comes to it first. Faces that then have under three vertices, or the corners of an
    earlier face, go.
    """
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
