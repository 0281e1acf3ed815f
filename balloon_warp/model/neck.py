"""Necks of balloons: the faces that close them in the mesh, and the particles that take the thrust."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import corner_faces, next_corners
from balloon_warp.model.fixed import group_of


class Neck(NamedTuple):
    """Neck of one balloon, whose particles are numbered within it."""

    edges: NDArray[np.int64]
    """Edges around the neck, in the order of the faces that close it, shape (n, 2); none if there is no neck"""
    weights: NDArray[np.float64]
    """Share of each particle in the thrust, by its mass among all moving particles at the neck, shape
    (particle_count,)"""


NO_NECK = Neck(np.zeros((0, 2), dtype=np.int64), np.zeros(0))


def neck_of(at: int | str, mesh: PolygonMesh, mass_share: NDArray[np.float64], up: NDArray[np.float64]) -> Neck:
    """Return the neck at a particle, or at the faces of a group.

    Args:
        at: the particle by the order of the file's vertices, "lowest" or "highest", or the group's name.
        mass_share: each particle's part of the balloon's mass.

    Raises:
        InputError: the mesh has no such particle, group, or faces there; or they are all of it.
    """
    faces = corner_faces(mesh)
    closing = _faces_at(at, mesh, up)
    corners = np.flatnonzero(closing[faces])
    if not len(corners):
        raise InputError(f"neck.at: {mesh.name} has no face at {at}; expected a vertex of a face, or a group of faces")
    begins = mesh.face_vertex_indices.astype(np.int64)
    edges = np.stack([begins, begins[next_corners(mesh)]], axis=1)[corners]
    keys, opposite = (edges @ [mesh.vertex_count, 1], edges @ [1, mesh.vertex_count])
    around = edges[~np.isin(keys, opposite)]
    if not len(around):
        raise InputError(f"neck.at: {at} covers all of {mesh.name}; expected a part")
    weights = np.zeros(mesh.vertex_count)
    particles = np.unique(begins[corners])
    weights[particles] = mass_share[particles]
    return Neck(around, weights / max(weights.sum(), np.finfo(float).tiny))


def _faces_at(at: int | str, mesh: PolygonMesh, up: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a mask of the faces around a particle, or with all corners in a group, shape (face_count,)."""
    faces = corner_faces(mesh)
    inside = np.zeros(mesh.vertex_count, dtype=bool)
    if isinstance(at, str) and at not in ("lowest", "highest"):
        inside[group_of(mesh, at, "neck.at")] = True
        return np.bincount(faces, ~inside[mesh.face_vertex_indices], mesh.face_count) == 0
    if isinstance(at, str):
        used = np.unique(mesh.face_vertex_indices)
        heights = mesh.points[used] @ up
        at = int(used[heights.argmax() if at == "highest" else heights.argmin()])
    elif at >= mesh.vertex_count:
        raise InputError(f"neck.at: {mesh.name} has particles 0 to {mesh.vertex_count - 1} (got {at})")
    inside[mesh.stand_in(at)] = True
    return np.bincount(faces, inside[mesh.face_vertex_indices], mesh.face_count) > 0
