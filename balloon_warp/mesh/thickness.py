"""Thickness of a surface around each of its vertices, measured along the surface alone.

On a plane, the area within a distance d is pi d^2. Around a thin part it falls behind, once d reaches around it: the
distance at which it has fallen to `PART` of the plane's is the *reach*, 2.4 radii of a sphere, 6.4 of a long tube, two
widths of a long flat band. A pressure p stretches a sphere of radius R with a tension of p R / 2, and a tube of radius
r around with p r, which is 0.21 and 0.16 of p times the reach: springs in proportion to the reach stretch nearly alike.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.corners import corner_faces, next_corners
from balloon_warp.mesh.geometry import face_areas
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import is_closed, mesh_edges, vertex_components

PART = 0.6
"""Fraction of a plane's area"""
LEAST = 0.05
"""Least relative thickness"""
PATCHES = 400
"""Approximate number of patches of the surface, between which distances are taken"""
VERTICES = 2
"""Least number of vertices of a patch, on average"""
NEAR = 3.0
"""Distance from which on distances are composed of shorter ones [patches]"""
ROWS = 64
"""Number of rows of a table of distances processed together, to bound the memory"""
FEWEST = 8
"""Number of patches of a component below which it counts as a sphere"""


def relative_thickness(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return each vertex's reach over that of a sphere, from `LEAST` to 1; shape (vertex_count,).

    The sphere has the area of the largest component. An open mesh counts as if it had a second side.
    """
    edges = mesh_edges(mesh)
    sides = 1.0 if is_closed(edges) else 2.0
    shares = sides * face_areas(mesh) / mesh.face_vertex_counts
    areas = _sums(mesh.face_vertex_indices, shares[corner_faces(mesh)], mesh.vertex_count)
    components = vertex_components(mesh, edges)
    totals = _sums(components, areas, mesh.vertex_count)
    used = np.count_nonzero(areas)
    spacing = float(np.sqrt(areas.sum() / max(min(PATCHES, used / VERTICES), 1.0)))
    if spacing == 0.0:
        return np.ones(mesh.vertex_count)
    reach = np.sqrt(totals / (PART * np.pi))[components]  # of a small component, all of it
    graph = length_graph(mesh)
    for component in np.flatnonzero(totals > FEWEST * spacing**2):
        members = np.flatnonzero(components == component)
        reach[members] = _reaches(mesh.points[members], areas[members], graph[members][:, members], spacing)
    # that of a sphere of radius R, at which 2 pi R^2 (1 - cos x) = PART pi (x R)^2, is 2.43 R
    return np.clip(reach / (2.43 * np.sqrt(totals.max() / (4.0 * np.pi))), LEAST, 1.0)


def _sums(numbers: NDArray[np.integer], values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the sum of the values of each number from 0, shape (count,)."""
    return np.bincount(numbers, values, count).astype(np.float64)


def length_graph(mesh: PolygonMesh) -> Any:
    """Return the sparse graph of lengths along edges, and from each corner of a face to the next but one.

    Shape (vertex_count, vertex_count).
    """
    from scipy.sparse import coo_array

    following = next_corners(mesh)
    corners = mesh.face_vertex_indices
    first = np.concatenate([corners, corners])
    second = np.concatenate([corners[following], corners[following[following]]])
    apart = first != second
    ends = np.minimum(first, second)[apart].astype(np.int64), np.maximum(first, second)[apart]
    low, high = np.divmod(np.unique(ends[0] * mesh.vertex_count + ends[1]), mesh.vertex_count)
    lengths = np.linalg.norm(mesh.points[high] - mesh.points[low], axis=1)
    least = 1e-9 * lengths.max(initial=1.0)  # a sparse matrix keeps no zeros
    shape = (mesh.vertex_count, mesh.vertex_count)
    numbers = low.astype(np.int32), high.astype(np.int32)  # older versions of SciPy take no others
    half = coo_array((np.maximum(lengths, least), numbers), shape=shape)
    return (half + half.T).tocsr()


def _reaches(
    points: NDArray[np.float64], areas: NDArray[np.float64], graph: Any, spacing: float
) -> NDArray[np.float64]:
    """Return the reach at each vertex of a component, shape (P,).

    Args:
        areas: shares of the vertices, shape (P,).
        graph: lengths between neighbors.
        spacing: between the middles of patches.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    cells = np.floor((points - points.min(axis=0)) / spacing).astype(np.int64)
    middles = np.sort(np.unique(cells, axis=0, return_index=True)[1])
    away, _, nearest = dijkstra(graph, directed=False, indices=middles, min_only=True, return_predecessors=True)
    patch, count = np.searchsorted(middles, nearest), len(middles)

    edges = graph.tocoo()
    between = patch[edges.row] != patch[edges.col]
    first, second = edges.row[between], edges.col[between]
    links = np.full((count, count), np.inf)
    np.minimum.at(links, (patch[first], patch[second]), away[first] + edges.data[between] + away[second])
    for begin in range(0, count, ROWS):  # shorter ways, to middles near by
        rows = slice(begin, begin + ROWS)
        near = dijkstra(graph, directed=False, indices=middles[rows], limit=NEAR * spacing)[:, middles]
        links[rows] = np.minimum(links[rows], near)
    linked = np.isfinite(links) & (links > 0.0)
    numbers = tuple(each.astype(np.int32) for each in np.nonzero(linked))
    apart = dijkstra(coo_array((links[linked], numbers), shape=links.shape).tocsr(), directed=False)
    reach = _reaches_of_patches(apart, _sums(patch, areas, count), spacing)[patch]

    # the steps from patch to patch are smoothed away
    around = (graph > 0.0).astype(np.float64)
    neighbors = np.maximum(around.sum(axis=1), 1.0)
    for _ in range(min(int((spacing / np.mean(graph.data)) ** 2) + 1, 200)):
        reach = 0.5 * (reach + (around @ reach) / neighbors)
    return reach


def _reaches_of_patches(apart: NDArray[np.float64], areas: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return Args: the distances of patches, shape (N, N), and their areas, shape (N,)."""
    distances = np.geomspace(2.0 * spacing, max(np.sqrt(areas.sum() / (PART * np.pi)), 2.1 * spacing), 30)
    reach = np.full(len(areas), distances[-1])
    open_ = np.ones(len(areas), dtype=bool)
    before = np.full(len(areas), np.nan)
    inside = np.empty_like(apart)  # the same memory again: to get it anew takes as long as to fill it
    for number, distance in enumerate(distances):
        if not open_.any():
            break
        np.subtract(distance, apart, out=inside)
        inside /= spacing
        inside += 0.5
        part = (np.clip(inside, 0.0, 1.0, out=inside) @ areas) / (np.pi * distance**2)
        fallen = open_ & (part <= PART)
        if number == 0:  # thinner than a patch: of a tube, the area grows with the distance
            reach[fallen] = (part * distance / PART)[fallen]
        else:
            blend = (before - PART) / np.maximum(before - part, 1e-12)
            step = distances[number - 1] + blend * (distance - distances[number - 1])
            reach[fallen] = step[fallen]
        open_ &= ~fallen
        before = part
    return reach
