"""Parts that lie on others, face on face, as where both sides of a surface are exported, each with its own vertices."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.corners import corner_faces, face_starts, with_corners
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.seams import rounding_of
from balloon_warp.mesh.topology import first_alike, mesh_edges, vertex_components

BESIDE = 4
"""Number of nearest places considered for each vertex"""


def counted_once(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with duplicate parts collapsed onto the parts that they lie on.

    A part that lies on others with every face gets the corners of those, whichever way they wind: then they are the
    same faces twice. A part shares no vertex with another. Vertices keep their numbers, and those of such a part move
    along with the parts that it lies on.
    """
    component = vertex_components(mesh, mesh_edges(mesh))
    starts = face_starts(mesh)
    own = component[mesh.face_vertex_indices[starts]]
    if not len(own) or (own == own[0]).all():
        return mesh
    places = _places(mesh)
    first = first_alike(replace(mesh, face_vertex_indices=places[mesh.face_vertex_indices].astype(np.int32)))
    owner = np.full(mesh.face_count, mesh.vertex_count)
    np.minimum.at(owner, first, own)
    owner = owner[first]  # of the faces that lie on one another, the first part
    copies = np.ones(mesh.vertex_count, dtype=bool)
    copies[own[own == owner]] = False
    copied = copies[own]
    if not copied.any():
        return mesh
    twin = np.full(mesh.face_count, -1)
    owned = np.flatnonzero(own == owner)[::-1]
    twin[first[owned]] = owned
    faces = np.where(copied, twin[first], np.arange(mesh.face_count))
    corners = np.arange(len(mesh.face_vertex_indices)) + (starts[faces] - starts)[corner_faces(mesh)]
    return replace(with_corners(mesh, corners), stand_ins=_stand_ins(mesh, places, copied[corner_faces(mesh)]))


def _stand_ins(mesh: PolygonMesh, places: NDArray[np.int64], gone: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return, for each vertex of which nothing but copies is left, the first other vertex at its place, else itself.

    Args:
        gone: corners, shape (corner_count,).
    """
    kept = np.sort(mesh.face_vertex_indices[~gone])[::-1]
    there = np.arange(mesh.vertex_count)
    there[places[kept]] = kept
    left = np.setdiff1d(mesh.face_vertex_indices[gone], kept)
    stand_ins = np.arange(mesh.vertex_count)
    stand_ins[left] = there[places[left]]
    return stand_ins if mesh.stand_ins is None else stand_ins[mesh.stand_ins]


def _places(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return the first vertex at the same place as each, but for rounding, shape (vertex_count,)."""
    from scipy.spatial import KDTree  # takes long to load: only for several parts

    places = first_coincident(mesh.points)
    used = np.unique(places[mesh.face_vertex_indices])
    reach = np.nextafter(rounding_of(mesh), np.inf)
    found = KDTree(mesh.points[used]).query(mesh.points[used], k=min(BESIDE, len(used)), distance_upper_bound=reach)
    others = np.asarray(found[1]).reshape(len(used), -1)
    first, slot = np.nonzero(others < len(used))
    return component_labels(mesh.vertex_count, used[first], used[others[first, slot]])[places]
