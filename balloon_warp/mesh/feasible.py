"""Early test that a surface can be remeshed to quads, and a test that the result has its volume."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.load import welded_along_seams
from balloon_warp.mesh.orientation import facing_outward, oriented_outward
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.thickness import RIBBONS
from balloon_warp.mesh.topology import (
    border_edges,
    face_areas,
    face_centers,
    face_starts,
    face_volumes,
    inconsistent_edges,
    mesh_edges,
    signed_volume,
    total_area,
    triangulate,
    vertex_components,
)

MOST_QUADS = 400_000
"""Largest number of quads of a result"""
MOST_BY_ITSELF = 60_000
"""Largest number of quads of a result with more cells than were asked for"""
DENSITY = 1.35
"""Number of quads in a square cell of the surface"""
PLACES = 100
"""Number of samples on a surface"""
MOSTLY = 0.5
"""Fraction of the surface that counts as most of it"""
OFF = 0.1
"""Relative tolerance of the volume"""


def quads_expected(mesh: PolygonMesh, cells: int) -> float:
    """Return the approximate number of quads of a surface, which has two sides where it is open."""
    used = mesh.points[mesh.face_vertex_indices]
    cell = float(np.ptp(used, axis=0).max()) / cells
    return DENSITY * total_area(mesh) / cell**2


def require_quads(mesh: PolygonMesh, cells: int) -> None:
    """Make sure that so many cells give no more quads than one can use.

    Raises:
        InputError: they do; it names how many cells give as many.
    """
    expected = quads_expected(mesh, cells)
    if expected > MOST_QUADS:
        most = int(cells * (MOST_QUADS / expected) ** 0.5)
        raise InputError(
            f"{mesh.name}: {cells} cells would make {expected:,.0f} quads; expected --cells {max(most, 4)} or fewer"
        )


def require_no_ribbons(mesh: PolygonMesh) -> None:
    """Make sure that a surface does not consist of ribbons, as hair does.

    Patches of a whole are many open parts, too, but wind around something.

    Raises:
        InputError: it does; the message names an input that can be taken.
    """
    whole = oriented_outward(welded_along_seams(mesh))
    edges = mesh_edges(whole)
    component = vertex_components(whole, edges)
    of_faces = component[whole.face_vertex_indices[face_starts(whole)]]
    open_parts = np.unique(component[edges.ends[border_edges(edges), 0]])
    areas = face_areas(whole) * np.isin(of_faces, open_parts)
    if len(open_parts) < RIBBONS or areas.sum() < MOSTLY * total_area(whole) or _winds_around(whole, areas) >= MOSTLY:
        return
    parts = len(np.unique(of_faces))
    helps = "--parts closed" if parts > len(open_parts) else "a surface with an inside, or a few sheets"
    raise InputError(
        f"{mesh.name}: {len(open_parts):,} of its {parts:,} parts are open, like hair, and enclose nothing; expected "
        f"{helps}"
    )


def _winds_around(mesh: PolygonMesh, areas: NDArray[np.float64]) -> float:
    """Return the fraction of sample points behind which the rest of the surface winds around something.

    There the winding number is a half on the surface itself, and it is 0 on a sheet (Van Oosterom and Strackee 1983).

    Args:
        areas: by which places are chosen, shape (face_count,).
    """
    triangles, of_faces = triangulate(mesh)
    corners = mesh.points[triangles]
    faces = np.unique(np.searchsorted(np.cumsum(areas), (np.arange(PLACES) + 0.5) / PLACES * areas.sum()))
    windings = []
    for face, center in zip(faces.tolist(), face_centers(mesh)[faces], strict=True):
        a, b, c = np.moveaxis(corners[of_faces != face] - center, 1, 0)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=1)
        flat = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
        windings.append(np.arctan2(volume, flat).sum() / (2.0 * np.pi))
    return float((np.abs(np.array(windings) - 0.5) < 0.25).mean())


def wrong_volume(mesh: PolygonMesh, quads: PolygonMesh) -> str | None:
    """Return the defect in the volume of a remeshed closed surface, as the end of a sentence.

    None where there is none, or the surface is open. Parts that overlap have less than their sum, but no less than the
    largest.
    """
    whole = facing_outward(welded_along_seams(mesh))
    edges = mesh_edges(whole)
    if len(border_edges(edges)) or len(inconsistent_edges(edges)):
        return None
    component = vertex_components(whole, edges)[whole.face_vertex_indices[face_starts(whole)]]
    volumes = np.bincount(component, face_volumes(whole), whole.vertex_count)
    made = signed_volume(quads)
    if (1.0 - OFF) * volumes.max() <= made <= (1.0 + OFF) * volumes.sum():
        return None
    return f"its volume changes from {volumes.sum():.3g} to {made:.3g}"
