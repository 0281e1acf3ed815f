"""Panels: a closed mesh cut along seams, each piece a disk that is laid flat."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.components import component_labels
from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.topology import mesh_edges

Values = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Panels:
    """The triangles of a mesh, sewn of panels."""

    mesh: PolygonMesh
    """Sewn mesh of triangles"""
    corners: Numbers
    """Corners of the triangles, as vertices of the panels, shape (t, 3)"""
    sewn_to: Numbers
    """Vertex of the mesh that each vertex of the panels becomes, shape (m,)"""
    of_faces: Numbers
    """Panel of each triangle, shape (t,)"""
    seams: Numbers
    """Two sides of each seam's edge, from the lower vertex of the mesh to the higher, shape (s, 2, 2)"""
    forward: NDArray[np.bool_]
    """Whether the panel's border runs that way, its inside on the left, shape (s, 2)"""

    @property
    def count(self) -> int:
        """Number of panels."""
        return int(self.of_faces.max()) + 1

    @cached_property
    def of_vertices(self) -> Numbers:
        """The panel of each vertex of the panels, shape (m,)."""
        panels = np.zeros(len(self.sewn_to), dtype=np.int64)
        panels[self.corners] = self.of_faces[:, None]
        return panels

    @cached_property
    def borders(self) -> list[Numbers]:
        """The vertices around each panel, in order, its inside on the left."""
        following: dict[int, int] = {}
        for ends, forward in zip(self.seams.reshape(-1, 2).tolist(), self.forward.ravel().tolist(), strict=True):
            begin, end = ends if forward else ends[::-1]
            following[begin] = end
        found = []
        for panel in range(self.count):
            first = here = next(vertex for vertex in following if self.of_vertices[vertex] == panel)
            order = [first]
            while (here := following[here]) != first:
                order.append(here)
            found.append(np.array(order))
        return found

    def flat_mesh(self, flat: Values) -> PolygonMesh:
        """Return the panels as a mesh in the plane, by their flat places, shape (m, 2)."""
        points = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
        counts = np.full(len(self.corners), 3, dtype=np.int32)
        return PolygonMesh(points, counts, self.corners.ravel().astype(np.int32), f"{self.mesh.name}_panels")


def cut_into_panels(mesh: PolygonMesh, seams: Numbers) -> Panels:
    """Cut a closed mesh of triangles along edges.

    Args:
        seams: the edges by their ends, shape (k, 2).

    Raises:
        InputError: the seams are no edges, or leave a panel that is no disk.
    """
    edges = mesh_edges(mesh)
    on_seam = _on_seams(mesh, edges.ends, seams)
    first, second = edges.corners.reshape(-1, 2).T
    following, faces = next_corners(mesh), corner_faces(mesh)
    forward = edges.forward.reshape(-1, 2)
    low = np.stack([np.where(forward[:, k], c, following[c]) for k, c in enumerate((first, second))], axis=1)
    high = np.stack([np.where(forward[:, k], following[c], c) for k, c in enumerate((first, second))], axis=1)
    joined = ~on_seam
    fans = component_labels(
        len(mesh.face_vertex_indices),
        np.concatenate([low[joined, 0], high[joined, 0]]),
        np.concatenate([low[joined, 1], high[joined, 1]]),
    )
    _, firsts, vertices = np.unique(fans, return_index=True, return_inverse=True)
    labels = component_labels(mesh.face_count, faces[first[joined]], faces[second[joined]])
    panels = Panels(
        mesh=mesh,
        corners=vertices.reshape(-1, 3).astype(np.int64),
        sewn_to=mesh.face_vertex_indices[firsts].astype(np.int64),
        of_faces=np.unique(labels, return_inverse=True)[1],
        seams=np.stack([vertices[low[on_seam]], vertices[high[on_seam]]], axis=2),
        forward=forward[on_seam],
    )
    _require_disks(panels)
    return panels


def _on_seams(mesh: PolygonMesh, ends: Numbers, seams: Numbers) -> NDArray[np.bool_]:
    """Return a mask of the edges on a seam."""
    keys = ends.min(axis=1) * mesh.vertex_count + ends.max(axis=1)
    wanted = seams.min(axis=1) * mesh.vertex_count + seams.max(axis=1)
    if not np.isin(wanted, keys).all():
        a, b = seams[~np.isin(wanted, keys)][0] + 1
        raise InputError(
            f"panels: no edge of {mesh.name} joins vertices {a} and {b}, counted from 1, of a seam; expected edges"
        )
    return np.isin(keys, wanted)


def _require_disks(panels: Panels) -> None:
    """Make sure that each panel can be laid flat."""
    for panel in range(panels.count):
        triangles = panels.corners[panels.of_faces == panel]
        pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        euler = len(np.unique(triangles)) - len(np.unique(pairs, axis=0)) + len(triangles)
        if euler == 1:
            continue
        middle = panels.mesh.points[panels.sewn_to[triangles]].mean(axis=(0, 1))
        where = "(" + ", ".join(f"{x:.3g}" for x in middle) + ") m"
        what = "is closed: the seams do not cut it" if euler == 2 else f"has {2 - euler} borders or a handle"
        raise InputError(
            f"panels: the piece of {len(triangles)} triangles about {where} of {panels.mesh.name} {what}; expected "
            "pieces with one border, which can be flattened"
        )
