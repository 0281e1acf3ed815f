"""Pinned vertices of a mesh by itself."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.corners import corner_faces, face_starts
from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.prepare import Parts
from balloon_warp.mesh.shells import pushes
from balloon_warp.mesh.topology import border_edges, mesh_edges, vertex_components

MOST = 0.5
"""Fraction of a mesh's area in open parts from which on they are pinned at their borders"""


def pinned_at_borders(mesh: PolygonMesh, parts: Parts) -> NDArray[np.int64]:
    """Find the particles on the borders of open parts, in order; of a part without others, those of its first face.

    None where most of the surface is of closed parts, or where parts are free and some of them are closed: pins
    would leave those to fall. Faces that go all around something count as closed, with fins on them, too.

    Args:
        mesh: as it is simulated.
        parts: whether springs hold its components together.
    """
    edges = mesh_edges(mesh)
    component = vertex_components(mesh, edges)
    border = np.unique(edges.ends[border_edges(edges)])
    is_open = np.zeros(mesh.vertex_count, dtype=bool)
    is_open[component[border]] = True
    first_corners = mesh.face_vertex_indices[face_starts(mesh)]
    of_faces = component[first_corners]
    areas = face_areas(mesh)
    loose = is_open[of_faces] & (pushes(mesh, edges) == 0) if is_open.any() else is_open[of_faces]
    falls = not loose.all() if parts == "free" else areas[loose].sum() < MOST * areas.sum()
    if falls:
        return np.zeros(0, dtype=np.int64)
    used = np.unique(mesh.face_vertex_indices)
    has_others = np.zeros(mesh.vertex_count, dtype=bool)
    has_others[component[np.setdiff1d(used, border)]] = True
    _, first_faces = np.unique(of_faces, return_index=True)
    alone = first_faces[is_open[of_faces[first_faces]] & ~has_others[of_faces[first_faces]]]
    corners = np.isin(corner_faces(mesh), alone)
    return np.union1d(border[has_others[component[border]]], mesh.face_vertex_indices[corners])
