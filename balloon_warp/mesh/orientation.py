"""Consistent outward winding for all faces of a mesh."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.corners import corner_faces, face_starts, flipped
from balloon_warp.mesh.geometry import face_areas, face_volumes, signed_volume
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.shells import pushed_outward
from balloon_warp.mesh.topology import (
    MeshEdges,
    border_edges,
    inconsistent_edges,
    mesh_edges,
    vertex_components,
)

# A component encloses nothing below this part of its area to the power of 3/2: a rounding error of float64.
NO_VOLUME = 1e-12


def oriented_outward(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with neighboring faces wound alike, and outward on the whole, by the fewest flips."""
    mesh = wound_alike(mesh)
    return flipped(mesh, np.ones(mesh.face_count, dtype=bool)) if signed_volume(mesh) < 0.0 else mesh


def facing_outward(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with faces wound consistently, and closed components outward.

    Hollows in the largest component stay inward; and where three faces or more meet, those that are between the inside
    and the outside face outward.
    """
    mesh, _ = pushed_outward(wound_alike(mesh))
    inward = inward_faces(mesh, mesh_edges(mesh))
    return flipped(mesh, inward) if inward.any() else mesh


def inward_faces(mesh: PolygonMesh, edges: MeshEdges) -> NDArray[np.bool_]:
    """Return a mask of the faces of components that face their inside, shape (face_count,).

    A component has an inside if it is closed and consistently wound.

    A component that lies in the box around the largest outward one is a hollow in it: it faces inward rightly.
    """
    component = vertex_components(mesh, edges)
    of_faces = component[mesh.face_vertex_indices[face_starts(mesh)]]
    has_inside = np.ones(mesh.vertex_count, dtype=bool)
    for spoiled in (border_edges(edges), inconsistent_edges(edges)):
        has_inside[component[edges.ends[spoiled, 0]]] = False
    volumes = np.bincount(of_faces, face_volumes(mesh), mesh.vertex_count) * has_inside
    areas = np.bincount(of_faces, face_areas(mesh), mesh.vertex_count)
    inward = volumes < -NO_VOLUME * areas**1.5
    largest = int(volumes.argmax())
    if inward.any() and volumes[largest] > 0.0:
        box = mesh.points[component == largest]
        outside = ((mesh.points <= box.min(axis=0)) | (mesh.points >= box.max(axis=0))).any(axis=1)
        sticks_out = np.bincount(component, outside, mesh.vertex_count) > 0
        inward &= sticks_out
    return inward[of_faces]


def wound_alike(mesh: PolygonMesh) -> PolygonMesh:
    """Return the mesh with neighboring faces wound alike where possible, by the fewest flips."""
    edges = mesh_edges(mesh)
    if not len(inconsistent_edges(edges)):
        return mesh
    pairs = edges.starts[edges.face_counts == 2]
    face = corner_faces(mesh)[edges.corners]
    first, second = face[pairs], face[pairs + 1]
    # Each face stands for two nodes, as it is and turned over; nodes that are wound alike are connected.
    turned = (edges.forward[pairs] == edges.forward[pairs + 1]) * mesh.face_count
    labels = component_labels(
        2 * mesh.face_count,
        np.concatenate([first, first + mesh.face_count]),
        np.concatenate([second + turned, second + mesh.face_count - turned]),
    )
    as_is, as_turned = labels[: mesh.face_count], labels[mesh.face_count :]
    sizes = np.bincount(as_is, minlength=2 * mesh.face_count)
    flip = (sizes[as_turned] > sizes[as_is]) | ((sizes[as_turned] == sizes[as_is]) & (as_turned < as_is))
    return flipped(mesh, flip)
