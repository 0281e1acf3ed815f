"""Thickness, slenderness and nearness of parts of a surface; its up axis, and its least gaps.

Thickness of a surface around each of its vertices, measured along the surface alone.

On a plane, the area within a distance d is pi d^2. Around a thin part it falls behind, once d reaches around it: the
distance at which it has fallen to `PART` of the plane's is the *reach*, 2.4 radii of a sphere, 6.4 of a long tube, two
widths of a long flat band. A pressure p stretches a sphere of radius R with a tension of p R / 2, and a tube of radius
r around with p r, which is 0.21 and 0.16 of p times the reach: springs in proportion to the reach stretch nearly alike.

Least distances at the start between parts that may touch later: particles and triangles, and edges and edges.

They may touch if all their corners are a distance apart. Between short ones that bounds how near their points are; it
says nothing between long ones, which are measured.
"""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.orientation import triangles_of
from balloon_warp.mesh.polygon_mesh import NO_AXIS, PolygonMesh
from balloon_warp.mesh.topology import (
    corner_faces,
    even_samples,
    face_areas,
    face_starts,
    face_vector_areas,
    is_closed,
    mesh_edges,
    next_corners,
    total_area,
    vertex_components,
)

PART = 0.6
"""Fraction of a plane's area"""
LEAST = 0.05
"""Least relative thickness"""
RIBBONS = 16
"""Number of open parts above which they are not panes but hair"""
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


BANDS = 24
"""Number of bands into which the surface is cut along its length"""
LEAST_SLENDERNESS = 2.0
"""Least width of a band, in edges"""
FEW_BANDS = 4
"""Number of bands below which a surface has too few vertices along its length to bend"""
MOST_PARTS = 16
"""Largest number of components that are measured, of the largest areas"""


def slenderness(mesh: PolygonMesh) -> float:
    """Return the largest length of a part of a surface over its mean diameter, the length of a tube over its diameter.

    Distances along the surface from one of its ends cut it into bands. A part is some bands in a row, of area A over a
    length L; as a tube it has the diameter A / (pi L). A sphere has pi^2 / 4, a square sheet of two sides pi. An open
    mesh counts as if it had a second side. It is 0 where there are too few vertices along the length to bend.
    """
    from scipy.sparse.csgraph import dijkstra  # takes long to load

    edges = mesh_edges(mesh)
    shares = (1.0 if is_closed(edges) else 2.0) * face_areas(mesh) / mesh.face_vertex_counts
    areas = np.bincount(mesh.face_vertex_indices, shares[corner_faces(mesh)], mesh.vertex_count)
    components = vertex_components(mesh, edges)
    graph, most = length_graph(mesh), 0.0
    edge = float(graph.data.mean()) if graph.nnz else 1.0
    for component in np.argsort(-np.bincount(components, areas), kind="stable")[:MOST_PARTS]:
        members = np.flatnonzero((components == component) & (areas > 0.0))
        if not len(members):
            continue
        end = int(members[0])
        for _ in range(2):  # the farthest from anywhere is an end
            along = dijkstra(graph, directed=False, indices=end)[members]
            end = int(members[along.argmax()])
        along = dijkstra(graph, directed=False, indices=end)[members]
        count = int(np.clip(along.max() / (LEAST_SLENDERNESS * edge), 1, BANDS))
        if count < FEW_BANDS:
            continue
        bands = np.minimum((along * (count / along.max())).astype(int), count - 1)
        sums = np.cumsum([0.0, *np.bincount(bands, areas[members], count)])
        begin, finish = np.triu_indices(count + 1, 1)
        lengths = (finish - begin) * along.max() / count
        held = sums[finish] - sums[begin]
        most = max(most, float((np.pi * lengths[held > 0.0] ** 2 / held[held > 0.0]).max()))
    return most


SAMPLES = 4000
"""Number of samples on the surface, spread evenly by area"""
GROWTH = 1.5
"""Outward growth of a part, over the skin's stretch and over the radius of a sphere"""
FACING = -0.5
"""Cosine between normals of surfaces that face each other: a groove that opens by less than 60 degrees has such"""
DETOUR = 3.0
"""Least length of the path along the surface over the gap across: in a groove it is shorter"""
MOST_COMPARED = 10_000_000
"""Largest number of pairs of a vertex and a face that are compared to find that a mesh is convex"""
ROUNDING = 1e-9
"""Distance above a face times its area that is none, over the mesh's area to the power of 3/2"""
MOST_WAYS = 200
"""Largest number of sample pairs whose paths along the surface are measured"""


def nears_itself(mesh: PolygonMesh, stretch: float) -> bool:
    """Return whether parts of a closed mesh face each other across a gap that inflation may close.

    At a stretch of 1 + s a part of relative thickness t is taken to grow by `GROWTH` s t R, where R is the radius of a
    sphere of the mesh's area. Two samples are near each other where the one lies straight above the other, no farther
    than both grow, faces it, and is much farther away along the surface.
    """
    from scipy.spatial import KDTree  # takes long to load

    if not is_closed(mesh_edges(mesh)) or not total_area(mesh) or _is_convex(mesh):
        return False
    points, normals, vertices = even_samples(mesh, SAMPLES)
    most = GROWTH * stretch * float(np.sqrt(total_area(mesh) / (4.0 * np.pi)))
    pairs = KDTree(points).query_pairs(2.0 * most, output_type="ndarray")
    pairs = pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) < FACING]
    first, second = pairs.T
    between = points[second] - points[first]
    above, below = (np.einsum("ij,ij->i", way, normals[at]) for way, at in ((between, first), (-between, second)))
    gaps = np.linalg.norm(between, axis=1)
    aside = np.sqrt(np.maximum(gaps**2 - np.minimum(above, below) ** 2, 0.0))
    spacing = np.sqrt(total_area(mesh) / len(points))
    facing = np.flatnonzero((above > 0.0) & (below > 0.0) & (aside < np.maximum(above, spacing)))
    if not len(facing):
        return False
    grows = most * relative_thickness(mesh)[vertices]
    near = facing[gaps[facing] < grows[first[facing]] + grows[second[facing]]]
    chosen = near[:: -(-len(near) // MOST_WAYS) or 1]
    return _are_far_along(mesh, vertices[first[chosen]], vertices[second[chosen]], gaps[chosen])


def _is_convex(mesh: PolygonMesh) -> bool:
    """Return whether no vertex is above a face, whose plane goes through its highest corner; False for large meshes.

    It is the quick answer for balls: no two parts of a convex surface face each other.
    """
    if mesh.face_count * mesh.vertex_count > MOST_COMPARED:
        return False
    normals = face_vector_areas(mesh)
    corners = np.einsum("ij,ij->i", normals[corner_faces(mesh)], mesh.points[mesh.face_vertex_indices])
    highest = np.maximum.reduceat(corners, face_starts(mesh))
    above = normals @ mesh.points[np.unique(mesh.face_vertex_indices)].T - highest[:, None]
    return bool(above.max() <= ROUNDING * total_area(mesh) ** 1.5)


def _are_far_along(
    mesh: PolygonMesh, first: NDArray[np.integer], second: NDArray[np.integer], gaps: NDArray[np.float64]
) -> bool:
    """Return whether any two vertices are much farther from each other along the surface than across the gap."""
    from scipy.sparse.csgraph import dijkstra

    if not len(gaps):
        return False
    sources, rows = np.unique(first, return_inverse=True)
    limit = DETOUR * float(gaps.max())
    along = dijkstra(length_graph(mesh), directed=False, indices=sources, limit=limit)
    edge = np.sqrt(total_area(mesh) / mesh.vertex_count)  # the vertices are up to that far from the samples
    return bool((along[rows, second] > DETOUR * gaps + edge).any())


BY_CUSTOM: dict[str, Literal["Y", "Z"]] = {".stl": "Z", ".ply": "Y", ".off": "Y"}
"""Up axes of files without one: models for printing are drawn upright along Z"""
FLAT = 0.99
"""Least cosine between a flat side's faces and its axis"""
AT_THE_END = 0.01
"""Largest distance of a flat side from the end of the shape, over its size"""
SLAB = 0.15
"""Largest height of a slab over its width"""
LEAST_FLAT, CLEARLY = 0.02, 3.0
"""Least area of a flat side over that of the surface; and over that which the custom has below, to count for more"""


def standing(mesh: PolygonMesh, suffix: str) -> tuple[Literal["Y", "Z"], str] | None:
    """Return the axis that is probably up, and why, in words; None where there is nothing to guess.

    Args:
        suffix: of the mesh's file.
    """
    if mesh.up_known or suffix.lower() not in BY_CUSTOM or not mesh.face_count:
        return None
    custom = BY_CUSTOM[suffix.lower()]
    other: Literal["Y", "Z"] = "Y" if custom == "Z" else "Z"
    below = {axis: _wider_below(mesh, "XYZ".index(axis)) for axis in (custom, other)}
    if below[other] > max(CLEARLY * below[custom], LEAST_FLAT):
        return other, "which has its widest flat side below"
    if below[custom] > LEAST_FLAT:
        return custom, "which has its widest flat side below"
    return (custom, f"as by custom in {suffix.lower()[1:].upper()} files") if custom != mesh.up_axis else None


def up_axis_sentence(mesh: PolygonMesh, given: bool, why: str | None) -> str:
    """Return a sentence on the up axis of a mesh, and its source.

    Args:
        given: whether a user has said it.
        why: it was guessed, where it was.
    """
    if mesh.up_known and not why:
        return f"{mesh.up_axis} is up, as {'given' if given else 'its file says'}"
    reason = f", {why}" if why else ""
    return f"The {NO_AXIS}, so {mesh.up_axis} is up{reason}; --up {'Y' if mesh.up_axis == 'Z' else 'Z'} turns it"


def _wider_below(mesh: PolygonMesh, axis: int) -> float:
    """Return how much more of the surface is flat at the lower end of an axis than at the upper one, from -1 to 1.

    A slab lies, though both of its sides are flat.
    """
    vectors, areas = face_vector_areas(mesh)[:, axis], face_areas(mesh)
    used = mesh.points[mesh.face_vertex_indices]
    near = AT_THE_END * float(np.ptp(used, axis=0).max())
    heights = np.maximum.reduceat(used[:, axis], np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts)
    lows = np.minimum.reduceat(used[:, axis], np.cumsum(mesh.face_vertex_counts) - mesh.face_vertex_counts)
    flat = np.abs(vectors) > FLAT * areas
    lower = areas[flat & (heights < used[:, axis].min() + near)].sum()
    upper = areas[flat & (lows > used[:, axis].max() - near)].sum()
    if np.ptp(used[:, axis]) < SLAB * np.sort(np.ptp(used, axis=0))[1]:
        upper = 0.0
    return float((lower - upper) / max(areas.sum(), 1e-300))


Points = NDArray[np.float64]
GAP_ROWS = 2000
"""Number of triangles or edges that are compared together, to bound the memory"""


def min_gaps(mesh: PolygonMesh, apart: float, most: float) -> Points:
    """Return for each vertex the least distance between its triangles, edges or itself and parts that they may touch.

    Args:
        apart: distance between corners from which on they may touch [m].
        most: distance that counts as far [m], less than `apart` unless that is next to nothing.

    Returns:
        shape (vertex_count,) [m]; up to `most`. Smaller ones may belong to something beside the vertex.
    """
    points, triangles = mesh.points, triangles_of(mesh)
    gaps = np.full(len(points), most)
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0)
    used = np.unique(triangles)[:, None]
    for things, others in ((triangles, used), (edges, edges)):
        for mine, theirs in _pairs(points, things, others, apart, most):
            between = np.linalg.norm(points[mine][:, :, None] - points[theirs][:, None], axis=-1)
            may = (between >= apart).all(axis=(1, 2)) & (mine[:, :, None] != theirs[:, None]).all(axis=(1, 2))
            mine, theirs = mine[may], theirs[may]
            measure = _to_triangles if things is triangles else _between_edges
            found = measure(points[mine], points[theirs])
            for ends in (*mine.T, *theirs.T):
                np.minimum.at(gaps, ends, found)
    return gaps


def _pairs(
    points: Points, things: NDArray[np.int64], others: NDArray[np.int64], apart: float, most: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield the corners of long things and of others whose centers are so near that they may be within a distance."""
    from scipy.spatial import KDTree  # takes long to load

    def reach(which: NDArray[np.int64]) -> Points:
        return np.linalg.norm(points[which] - points[which].mean(axis=1, keepdims=True), axis=-1).max(axis=1)

    lengths = np.linalg.norm(points[things] - points[np.roll(things, -1, axis=1)], axis=-1).max(axis=1, initial=0.0)
    long = things[lengths**2 > 2.0 * max(apart**2 - most**2, 0.0)]
    tree, farthest = KDTree(points[others].mean(axis=1)), float(reach(others).max(initial=0.0))
    for begin in range(0, len(long), GAP_ROWS):
        own = long[begin : begin + GAP_ROWS]
        near = tree.query_ball_point(points[own].mean(axis=1), reach(own) + farthest + most)
        counts = [len(each) for each in near]
        yield np.repeat(own, counts, axis=0), others[np.concatenate([np.zeros(0, dtype=np.int64), *near]).astype(int)]


def _between_edges(first: Points, second: Points) -> Points:
    """Return the distances of pairs of edges, each of shape (n, 2, 3) (Ericson 2005, Real-Time Collision Detection)."""
    way, other, begin = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0], first[:, 0] - second[:, 0]
    a, e, b = _dot(way, way), _dot(other, other), _dot(way, other)
    c, f = _dot(way, begin), _dot(other, begin)
    across = a * e - b * b
    s = np.clip(np.divide(b * f - c * e, across, out=np.zeros_like(a), where=across > 1e-12 * a * e), 0.0, 1.0)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    return np.linalg.norm(begin + s[:, None] * way - t[:, None] * other, axis=1)


def _to_triangles(corners: Points, point: Points) -> Points:
    """Return the distances of points, shape (n, 1, 3), from triangles, shape (n, 3, 3)."""
    point = point[:, 0]
    alone = np.repeat(point[:, None], 2, axis=1)
    alone[:, 1] += 1e-12  # an edge that is a point
    found = np.min([_between_edges(corners[:, [k, (k + 1) % 3]], alone) for k in range(3)], axis=0)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    inside = length > 0.0
    for k in range(3):
        edge = corners[:, (k + 1) % 3] - corners[:, k]
        inside &= _dot(np.cross(edge, point - corners[:, k]), normal) >= 0.0
    height = np.abs(_dot(point - corners[:, 0], normal)) / np.where(length > 0.0, length, 1.0)
    return np.where(inside, height, found)


def _dot(first: Points, second: Points) -> Points:
    return np.einsum("ij,ij->i", first, second)
