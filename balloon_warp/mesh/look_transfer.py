"""Looks of a surface on another mesh of it: each place looks as the nearest one of the surface."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import face_centers
from balloon_warp.mesh.looks import Look, Looks, looks_of
from balloon_warp.mesh.painted_surface import PaintedSurface
from balloon_warp.mesh.polygon_mesh import PolygonMesh

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
