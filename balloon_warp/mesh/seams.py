"""Welding: faces that end at the same place share their vertices there. Vertices keep their numbers; those that faces
have left move along with the ones that stand in for them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.geometry import first_coincident
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.repair import distinct_faces
from balloon_warp.mesh.topology import border_edges, mesh_edges


def welded(mesh: PolygonMesh) -> PolygonMesh:
    """The mesh with its faces joined where vertices lie at exactly the same place: all go to the first there."""
    return _joined(mesh, first_coincident(mesh.points), "that lay exactly on {others}", "")


def welded_along_seams(mesh: PolygonMesh) -> PolygonMesh:
    """The mesh with its faces joined along seams: open edges that lie exactly on one another, from end to end.

    Vertices that lie on others elsewhere, as where two bodies touch, stay apart.
    """
    edges = mesh_edges(distinct_faces(mesh)[0])
    ends = edges.ends[border_edges(edges)]
    places = first_coincident(mesh.points)[ends]
    turned = places[:, 0] > places[:, 1]
    ends[turned], places[turned] = ends[turned, ::-1], places[turned, ::-1]
    order = np.lexsort((places[:, 1], places[:, 0]))
    ends, places = ends[order], places[order]
    # Those at the same places follow one another; what has no length is no seam.
    same = (places[1:] == places[:-1]).all(axis=1) & (places[1:, 0] != places[1:, 1])
    stand_ins = component_labels(mesh.vertex_count, ends[:-1][same].ravel(), ends[1:][same].ravel())
    why = "; weld = false leaves the seams open"
    return _joined(mesh, stand_ins, "along seams, exactly on {others},", why)


def _joined(mesh: PolygonMesh, stand_ins: NDArray[np.int64], which: str, more: str) -> PolygonMesh:
    indices = stand_ins[mesh.face_vertex_indices].astype(np.int32)
    moved = len(np.unique(mesh.face_vertex_indices[indices != mesh.face_vertex_indices]))
    if not moved:
        return mesh
    one = moved == 1
    found = f"{moved:,} {'vertex' if one else 'vertices'} {which.format(others='another' if one else 'others')}"
    became = (
        "has been welded to it: it keeps its number" if one else "have been welded to them: they keep their numbers"
    )
    sentence = f"{found} {became} and move{'s' if one else ''} along{more}."
    return replace(mesh, face_vertex_indices=indices, stand_ins=stand_ins, warnings=(*mesh.warnings, sentence))
