"""Looks of a surface on another mesh of it: each place looks as the nearest one of the surface."""

from dataclasses import replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.measure.crossings import nearest_places
from balloon_warp.mesh.geometry import face_centers, first_coincident, triangulate
from balloon_warp.mesh.polygon_mesh import Look, Looks, PolygonMesh, looks_of
from balloon_warp.mesh.topology import component_labels, corner_faces, face_starts


class PaintedSurface:
    """The triangles of a surface, by the corners of its faces, which have the looks."""

    def __init__(self, surface: PolygonMesh):
        apart = PolygonMesh(
            points=surface.points[surface.face_vertex_indices],
            face_vertex_counts=surface.face_vertex_counts,
            face_vertex_indices=np.arange(len(surface.face_vertex_indices), dtype=np.int32),
        )
        self._surface = surface
        self._middle = apart.points.mean(axis=0)
        self._size = float(np.ptp(apart.points, axis=0).max())
        self._points = self._scaled(apart.points)
        corners, _ = triangulate(apart)
        a, b, c = np.moveaxis(self._points[corners], 1, 0)
        flat = (np.cross(b - a, c - a) == 0.0).all(axis=1)
        self.corners = corners[~flat].astype(np.int64)
        """Corners of each triangle, shape (triangle_count, 3)"""

    def nearest(
        self, points: NDArray[np.float64], among: NDArray[np.int64] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the nearest triangle to each point, shape (n,), and the weights of its corners there, shape (n, 3).

        Args:
            points: in the surface's unit, shape (n, 3).
            among: the triangles that count; all, when missing.
        """
        corners = self.corners if among is None else self.corners[among]
        used, numbers = np.unique(corners, return_inverse=True)
        surface = wp.Mesh(
            points=wp.array(self._points[used], dtype=wp.vec3), indices=wp.array(numbers.ravel(), dtype=wp.int32)
        )
        triangles, weights = wp.zeros(len(points), dtype=wp.int32), wp.zeros(len(points), dtype=wp.vec3)
        at = wp.array(self._scaled(points), dtype=wp.vec3)
        wp.launch(nearest_places, len(points), inputs=[surface.id, at, 1e3], outputs=[triangles, weights])
        found = triangles.numpy().astype(np.int64)
        return found if among is None else among[found], weights.numpy().astype(np.float64)

    def charts(self, places: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the chart of a texture that each triangle is in.

        Faces of a chart are connected where they share vertices, places in the image and the material.

        Args:
            places: texture coordinates at the corners of the surface, shape (corner_count, 2).
        """
        vertices = first_coincident(self._surface.points)[self._surface.face_vertex_indices]
        looks = self._surface.looks
        material = np.full(len(vertices), -1) if looks is None else looks.of_corners
        keys = (material, places[:, 1], places[:, 0], vertices)
        order = np.lexsort(keys)
        alike = np.all([key[order[1:]] == key[order[:-1]] for key in keys], axis=0)
        same = order[np.maximum.accumulate(np.where(np.append(True, ~alike), np.arange(len(order)), 0))]
        firsts = face_starts(self._surface)[corner_faces(self._surface)]
        labels = component_labels(
            len(order), np.concatenate([order, np.arange(len(order))]), np.concatenate([same, firsts])
        )
        return labels[self.corners[:, 0]]

    def _scaled(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points centered and scaled to size 1, since Warp measures in float32."""
        return (points - self._middle) / self._size


MOST_CHARTS = 1000
"""Largest number of charts of a texture that faces of the other mesh extend beyond: with more, charts are smaller than
these faces"""


def dressed(mesh: PolygonMesh, surface: PolygonMesh) -> PolygonMesh:
    """Return a mesh with the materials, colors and texture coordinates of a surface that it is near to.

    A face has the material that is nearest to its middle, and lies within one chart of a texture. Runs on Warp's
    default device.

    Args:
        mesh: in the unit of the surface.
        surface: with looks and texture coordinates, or without.
    """
    if surface.looks is None and surface.texture_coordinates is None:
        return mesh
    painted = PaintedSurface(surface)
    middles, _ = painted.nearest(face_centers(mesh))
    middles = np.repeat(middles, mesh.face_vertex_counts)
    triangles, weights = painted.nearest(mesh.points)
    triangles, weights = triangles[mesh.face_vertex_indices], weights[mesh.face_vertex_indices]
    looks, places, warnings = surface.looks, surface.texture_coordinates, mesh.warnings
    if looks is not None:
        looks = _looks(looks, painted.corners[middles, 0], painted.corners[triangles], weights)
    if places is not None:
        places = _places(painted, places, mesh, middles, triangles, weights)
    if places is None and looks is not None and looks.pictures:
        looks = _without_pictures(looks)
        warnings = (*warnings, "The texture's pieces are smaller than the quads, which have its mean color instead.")
    return replace(mesh, looks=looks, texture_coordinates=places, warnings=warnings)


def _looks(
    looks: Looks, middles: NDArray[np.int64], corners: NDArray[np.int64], weights: NDArray[np.float64]
) -> Looks | None:
    """Return the looks at the corners of the other mesh.

    Args:
        middles: the corner of the surface that has the material, for each, shape (n,).
        corners: the three around the nearest place, for each, shape (n, 3).
        weights: of these, shape (n, 3).
    """
    whole = looks_of(looks.materials, looks.of_corners[middles])
    if looks.colors is None:
        return whole
    colors = np.einsum("nc,nci->ni", weights, looks.colors[corners])
    colors = np.where(np.isfinite(colors), colors, looks.colors[middles]).astype(np.float32)
    none = np.full(len(middles), -1, np.int32)
    return Looks(whole.materials, whole.of_corners, colors) if whole else Looks((), none, colors)


def _places(
    painted: PaintedSurface,
    places: NDArray[np.float32],
    mesh: PolygonMesh,
    middles: NDArray[np.int64],
    triangles: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> NDArray[np.float32] | None:
    """Return the texture coordinates at the corners of the other mesh; None where charts are too many for that.

    Args:
        places: those of the surface.
        middles: the triangle that is nearest to the middle of each corner's face.
        triangles: the one that is nearest to each corner.
        weights: of its corners.
    """
    charts = painted.charts(places)
    over = charts[triangles] != charts[middles]
    reached = np.unique(charts[middles[over]])
    if len(reached) > MOST_CHARTS:
        return None
    triangles, weights = triangles.copy(), weights.copy()
    for chart in reached:
        out = np.flatnonzero(over & (charts[middles] == chart))
        among = np.flatnonzero(charts == chart)
        triangles[out], weights[out] = painted.nearest(mesh.points[mesh.face_vertex_indices[out]], among)
    return np.einsum("nc,nci->ni", weights, places[painted.corners[triangles]]).astype(np.float32)


def _without_pictures(looks: Looks) -> Looks:
    """Return the looks with the mean of each image in its place."""

    def plain(look: Look) -> Look:
        if look.picture is None:
            return look
        red, green, blue = (shade * mean for shade, mean in zip(look.color, look.picture.mean, strict=True))
        return Look(look.name, (red, green, blue))

    return replace(looks, materials=tuple(map(plain, looks.materials)))
