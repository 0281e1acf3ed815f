"""Springs that make an even skin of a mesh, and springs across its thin parts. Host side, float64."""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.mesh.corners import face_starts
from balloon_warp.mesh.geometry import face_volumes, vertex_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import is_closed, mesh_edges, vertex_components
from balloon_warp.scene import Balloon, Stiffness
from balloon_warp.springs import SpringKind, Springs
from balloon_warp.springs.across import AT, springs_across
from balloon_warp.springs.even import even_scales, film_tension

LEAST_RADIUS = 0.12
"""Mean radius of a shape over that of the sphere of equal area, below which springs across it bear the pressure"""
LEAST_SUM = 0.25
"""Least sum of a particle's springs for its mass, over that of the mean particle: contacts are as stiff at light
particles as at others"""


def strung(
    mesh: PolygonMesh, springs: Springs, balloon: Balloon
) -> tuple[Springs, NDArray[np.float64], NDArray[np.bool_] | None]:
    """Return the springs with those across tied thin parts, the scales of their constants, and which go across.

    Scales and mask have shape (spring_count,); the mask is None where none is asked for.

    Args:
        springs: over the surface, and between parts.
    """
    stiffness = balloon.stiffness
    constants = constants_of(stiffness)
    scale = even_scales(mesh, springs, constants) if stiffness.even else np.ones(springs.count)
    structural = constants[SpringKind.STRUCTURAL]
    if stiffness.thin != "tied" or balloon.material.is_membrane:
        return springs, scale, None
    if not structural:
        return springs, scale, np.zeros(springs.count, dtype=bool)
    found = springs_across(mesh, between_parts=balloon.parts == "held")
    more = ~springs.has(found.pairs)
    pressure = pressure_of_stretch(AT) * 2.0 * film_tension(constants) / max(mean_radius(mesh), 1e-30)
    both = springs.with_structural(found.pairs, mesh.points)
    across = np.zeros(both.count, dtype=bool)
    if more.any():
        across = Springs(found.pairs[more].astype(np.int32), both.kind[:0], both.rest_lengths[:0]).has(both.pairs)
    scales = np.empty(both.count)
    scales[~across] = scale  # in the same order
    scales[across] = pressure * found.loads[more] / structural
    return both, scales, across


def constants_of(stiffness: Stiffness) -> NDArray[np.float64]:
    """Return the constants of the three kinds of springs [N/m]."""
    return np.array([getattr(stiffness, row.name) for row in KINDS])


def spring_sums(
    mesh: PolygonMesh, springs: Springs, scales: NDArray[np.float64], stiffness: Stiffness
) -> NDArray[np.float64]:
    """Return the sum of each particle's spring constants [N/m], bounded below, shape (vertex_count,).

    Masses in proportion to it allow the longest step.
    """
    each = np.repeat(constants_of(stiffness)[springs.kind] * scales, 2)
    sums = np.bincount(springs.pairs.ravel(), each, mesh.vertex_count)
    mean = sums.sum() / max(np.count_nonzero(sums), 1)
    return np.maximum(sums, LEAST_SUM * mean or 1.0)


def pressure_of_stretch(stretch: float) -> float:
    """Return the pressure at a stretch of a sphere's skin over 2 K / R.

    K is its tension per unit strain, R its radius.
    """
    return stretch / (1.0 + stretch) ** 2


def mean_radius(mesh: PolygonMesh) -> float:
    """Return 3 V / A of the part with the largest area [m].

    It is a sphere's radius, and three halves of a tube's. It is at least `LEAST_RADIUS` of that of the sphere of equal
    area. An open mesh may become half a sphere, and has the radius of that.
    """
    edges, areas = mesh_edges(mesh), vertex_areas(mesh)
    parts = vertex_components(mesh, edges)
    of_parts = np.bincount(parts, areas, mesh.vertex_count)
    largest = int(of_parts.argmax())
    area = of_parts[largest]
    if not is_closed(edges):
        return float(np.sqrt(area / (2.0 * np.pi)))
    least = LEAST_RADIUS * np.sqrt(area / (4.0 * np.pi))
    volume = face_volumes(mesh)[(parts == largest)[mesh.face_vertex_indices[face_starts(mesh)]]].sum()
    return float(max(3.0 * abs(volume) / max(area, 1e-30), least))
