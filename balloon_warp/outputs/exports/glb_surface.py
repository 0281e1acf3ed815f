"""A part of a stage as triangles, of which each vertex has all that glTF says of one."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from balloon_warp.mesh.folds import CREASE
from balloon_warp.mesh.geometry import triangulate, vertex_normals
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.outputs.exports.parts import Part
from balloon_warp.outputs.render.creases import cut_at_creases, leave_whole
from balloon_warp.outputs.render.prims import is_round


class Surface(NamedTuple):
    """A mesh in triangles, with one normal, one texture coordinate and one color a vertex."""

    topology: PolygonMesh
    """Mesh in vertices of one normal each, whose points do not count"""
    points: NDArray[np.integer]
    """Point of the mesh at each of those, shape (topology.vertex_count,)"""
    vertices: NDArray[np.integer]
    """Topology vertex of each vertex, shape (vertex_count,)"""
    triangles: NDArray[np.uint32]
    """Triangles, shape (triangle_count, 3)"""
    covers: NDArray[np.integer]
    """Number of each triangle's material in the part, shape (triangle_count,)"""
    texture_coordinates: NDArray[np.float32] | None
    """Texture coordinates, shape (vertex_count, 2), v down as glTF has it"""
    colors: NDArray[np.float32] | None
    """Linear RGB, shape (vertex_count, 3), where a material has several colors"""

    def place(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return positions and unit normals for the mesh's points, each of shape (vertex_count, 3)."""
        moved = replace(self.topology, points=points[self.points])
        normals = vertex_normals(moved)
        normals[~normals.any(axis=1)] = (0.0, 1.0, 0.0)  # glTF wants unit vectors everywhere
        return moved.points[self.vertices].astype(np.float32), normals[self.vertices].astype(np.float32)


def surface_of(part: Part) -> Surface:
    """Return the surface of a part.

    Deformable parts are smooth everywhere: a sharp bend of one frame is round in the next.
    """
    smooth = part.soft or is_round(UsdGeom.Mesh(part.prim))
    cut = leave_whole(part.mesh) if smooth else cut_at_creases(part.mesh, CREASE)
    points, counts = part.mesh.points[cut.vertex_points], part.mesh.face_vertex_counts
    topology = PolygonMesh(points, counts, cut.corner_vertices)
    uv, colors = part.mesh.texture_coordinates, _many_colors(part)
    if uv is None and colors is None:
        triangles, faces = triangulate(topology)
        own = np.arange(len(points)), triangles.astype(np.uint32), part.covering.of_faces[faces]
        return Surface(topology, cut.vertex_points, *own, None, None)
    known = [values.astype(np.float64) for values in (uv, colors) if values is not None]
    corners = np.column_stack([cut.corner_vertices.astype(np.float64), *known])
    unique, number = np.unique(corners, axis=0, return_inverse=True)
    triangles, faces = triangulate(PolygonMesh(points, counts, number.ravel().astype(np.int32)))
    own = unique[:, 0].astype(np.int64), triangles.astype(np.uint32), part.covering.of_faces[faces]
    flipped = None if uv is None else (unique[:, 1:3] * [1.0, -1.0] + [0.0, 1.0]).astype(np.float32)
    return Surface(
        topology, cut.vertex_points, *own, flipped, None if colors is None else unique[:, -3:].astype(np.float32)
    )


def _many_colors(part: Part) -> NDArray[np.float32] | None:
    """Return linear RGB at the corners of a part's faces, white below images.

    None where each material has one color.
    """
    covering = part.covering
    of_corners = np.repeat(covering.of_faces, part.mesh.face_vertex_counts)
    alike, shown = True, np.ones_like(covering.colors)
    for number, cover in enumerate(covering.covers):
        here = of_corners == number
        if cover.texture is None:
            shown[here] = covering.colors[here]
            alike &= bool((covering.colors[here] == covering.colors[here][:1]).all())
    return None if alike else shown
