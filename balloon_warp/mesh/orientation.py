"""One winding for all faces of a mesh, outward."""

from dataclasses import replace

import numpy as np

from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.corners import corner_faces, flip_faces
from balloon_warp.mesh.geometry import signed_volume
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import mesh_edges


def oriented_outward(mesh: PolygonMesh) -> PolygonMesh:
    """The mesh with neighboring faces wound alike, and outward on the whole; as few faces are turned as it takes."""
    edges = mesh_edges(mesh)
    pairs = edges.starts[edges.face_counts == 2]
    face = corner_faces(mesh)[edges.corners]
    first, second = face[pairs], face[pairs + 1]
    # Each face stands for two nodes, as it is and turned over; what is wound alike is connected.
    turned = (edges.forward[pairs] == edges.forward[pairs + 1]) * mesh.face_count
    labels = component_labels(
        2 * mesh.face_count,
        np.concatenate([first, first + mesh.face_count]),
        np.concatenate([second + turned, second + mesh.face_count - turned]),
    )
    as_is, as_turned = labels[: mesh.face_count], labels[mesh.face_count :]
    sizes = np.bincount(as_is, minlength=2 * mesh.face_count)
    flip = (sizes[as_turned] > sizes[as_is]) | ((sizes[as_turned] == sizes[as_is]) & (as_turned < as_is))
    mesh = _flipped(mesh, flip)
    return _flipped(mesh, np.ones_like(flip)) if signed_volume(mesh) < 0.0 else mesh


def _flipped(mesh: PolygonMesh, flip: np.ndarray) -> PolygonMesh:
    at_corners = flip[corner_faces(mesh)]
    backwards = flip_faces(mesh.face_vertex_counts, mesh.face_vertex_indices)
    return replace(mesh, face_vertex_indices=np.where(at_corners, backwards, mesh.face_vertex_indices))
