"""Spring constants that make an even skin, however a mesh divides it.

Springs of constant k, rest length L and direction t (a unit vector) make the tension 1/2 sum k L^2 t t^T / A of a
vertex of area A, for each unit of strain in all directions. A square grid has the same everywhere, K = k_structural +
2 k_shear + 4 k_flexion both ways. Here springs begin with the areas at their ends over their squared lengths (van
Gelder 1998), and are then multiplied by the excess or lack of tension at their ends along them, until each vertex
has K both ways: Sinkhorn's scaling (1964), of tensors. All constants stay above zero.

The narrow faces of CAD meshes would ask for so much of that along their short edges that a frame took hundreds of
substeps. Where all constants add up to more than in any mesh of good faces, the largest are lowered, all to one scale.
"""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import vertex_areas, vertex_normals
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.springs.springs import Springs

GRID = np.array([1.0, 2.0, 4.0])
"""Squared lengths of the springs of each kind on a square grid over an edge's, and their shares in its tension"""
MOST = 30.0
"""Largest factor on a kind's constant, and largest divisor"""
MOST_SUM = 5.0
"""Largest sum of a vertex's constants over K, in the mean of all vertices: even meshes have 2 to 4"""
FEW = 1500
"""Number of vertices up to which meshes may have the total of that many: few particles are heavy"""
ROUNDS = 40
CLOSE = 0.01
"""Relative tolerance of K"""
LEAST = 1.0e-3
"""Least stiffness in any direction over K, where no spring leads that way"""


def film_tension(constants: NDArray[np.float64]) -> float:
    """Return the tension of an even skin for each unit of strain [N/m], from the constants of the kinds, shape (3,)."""
    return float(constants @ GRID)


def even_scales(mesh: PolygonMesh, springs: Springs, constants: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each spring's constant over that of its kind, shape (spring_count,).

    A square grid's are 1. Vertices without area, and springs without length, do not count. All constants add up to
    `MOST_SUM` at most.

    Args:
        constants: of the kinds [N/m], shape (3,).
    """
    areas, of_kinds = vertex_areas(mesh), constants[springs.kind]
    tension = film_tension(constants)
    lengths = np.where(springs.rest_lengths > 0.0, springs.rest_lengths, np.inf)
    if not tension or not areas.sum():
        return np.ones(springs.count)
    ends = springs.pairs.astype(np.int64).ravel()
    along = _along_surface(mesh, springs)  # (spring_count, 2, 2): of each spring, at each end
    lengths_along = np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-30)
    ways = along / lengths_along
    wanted = np.maximum(tension * areas, 1e-30)[:, None]
    products = np.stack([along[..., 0] ** 2, along[..., 0] * along[..., 1], along[..., 1] ** 2], axis=-1)
    least, most = of_kinds / MOST, of_kinds * MOST
    scaled = of_kinds * GRID[springs.kind] * 0.5 * areas[springs.pairs].sum(axis=1) / lengths**2
    scaled = np.clip(scaled, least, most)
    for _ in range(ROUNDS):
        pulls = (0.5 * scaled[:, None, None] * products).reshape(-1, 3)
        tensors = np.stack([np.bincount(ends, pulls[:, k], mesh.vertex_count) for k in range(3)], axis=1) / wanted
        if np.abs(tensors - (1.0, 0.0, 1.0))[areas > 0.0].max() < CLOSE:
            break
        inverse = _inverse(tensors)[springs.pairs]
        factors = (
            inverse[..., 0] * ways[..., 0] ** 2
            + 2.0 * inverse[..., 1] * ways[..., 0] * ways[..., 1]
            + inverse[..., 2] * ways[..., 1] ** 2
        )
        factors[areas[springs.pairs] <= 0.0] = 1.0
        scaled = np.clip(scaled * factors.mean(axis=1), least, most)
    scales = np.divide(scaled, of_kinds, out=np.ones(springs.count), where=of_kinds > 0.0)
    return _lowered(scales, of_kinds, 0.5 * MOST_SUM * tension * max(np.count_nonzero(areas), FEW))


def _lowered(scales: NDArray[np.float64], of_kinds: NDArray[np.float64], total: float) -> NDArray[np.float64]:
    """Return the scales with the largest lowered to one, at least 1, so that constants add up to a total [N/m]."""
    if scales @ of_kinds <= total:
        return scales
    order = np.argsort(scales)
    above = np.cumsum(of_kinds[order][::-1])[::-1]  # of the springs from each on
    below = np.cumsum(scales[order] * of_kinds[order]) - scales[order] * of_kinds[order]
    first = int((below + scales[order] * above > total).argmax())
    return np.minimum(scales, max((total - below[first]) / above[first], 1.0))


def _along_surface(mesh: PolygonMesh, springs: Springs) -> NDArray[np.float64]:
    """Return each spring in the plane that touches the surface at either end, shape (spring_count, 2, 2)."""
    normals = vertex_normals(mesh)
    aside = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, aside)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-30)
    axes = np.stack([first, np.cross(normals, first)], axis=1)
    between = mesh.points[springs.pairs[:, 1]] - mesh.points[springs.pairs[:, 0]]
    return np.einsum("seij,sj->sei", axes[springs.pairs], between)


def _inverse(tensors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverses of symmetric matrices by their components 11, 12 and 22, shape (n, 3)."""
    first, between, second = tensors[:, 0] + LEAST, tensors[:, 1], tensors[:, 2] + LEAST
    determinant = np.maximum(first * second - between**2, LEAST**2)
    return np.stack([second, -between, first], axis=1) / determinant[:, None]
