"""Spring constants of an even skin, springs across thin parts, and springs that hold the parts of a mesh together.

Springs that hold the parts of a mesh together: components that touch, overlap or hang apart become one thing.

In rounds, each part is tied to the part nearest to it, and counts as one with it from then on, until there is one
(Boruvka's spanning tree). A part is tied where it is near: at a few particles, far from each other, and each of them to
a few others, so that no tie is a hinge. Rest lengths are the distances at the start.

Spring constants that make an even skin, however a mesh divides it.

Springs of constant k, rest length L and direction t (a unit vector) make the tension 1/2 sum k L^2 t t^T / A of a
vertex of area A, for each unit of strain in all directions. A square grid has the same everywhere, K = k_structural +
2 k_shear + 4 k_flexion both ways. Here springs begin with the areas at their ends over their squared lengths (van
Gelder 1998), and are then multiplied by the excess or lack of tension at their ends along them, until each vertex
has K both ways: Sinkhorn's scaling (1964), of tensors. All constants stay above zero.

The narrow faces of CAD meshes would ask for so much of that along their short edges that a frame took hundreds of
substeps. Where all constants add up to more than in any mesh of good faces, the largest are lowered, all to one scale.

Springs across thin parts of a balloon, from wall to wall, as an air mattress has them.

A pressure drives the two walls of a plate, a cup or a blade apart, and would make a pillow of them: a film does not
resist bending. Here each vertex of a closed part is held to the opposite wall, by a spring that bears the
pressure on the vertex when it is stretched by `STRETCH`. The thicker a part is, the less of the pressure: a ball has
none.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.load import Parts
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import (
    border_edges,
    component_labels,
    mesh_edges,
    triangulate,
    vertex_areas,
    vertex_components,
    vertex_normals,
)
from balloon_warp.springs.build import SpringKind, Springs, build_springs

TIED = 12
"""Largest number of particles of a part that are tied in a round"""
EACH = 4
"""Number of springs of each tied particle"""
LEAST_TIED = 4
"""Least number of particles that are tied, however far"""
NEAR = 1.25
"""Distance that counts as near, over the least distance"""
FIRM = 0.1
"""Least stiffness against each motion and rotation over a spring's constant; below it a part is braced"""
BRACED = 4
"""Number of particles on either side of a brace, each joined to each"""
TOUCHING = 0.1
"""Distance that counts as touching, over the size of the smaller part"""


def balloon_springs(mesh: PolygonMesh, parts: Parts, kinds: Collection[SpringKind] = tuple(SpringKind)) -> Springs:
    """Return the springs of a mesh, and structural ones between components that are held together.

    A net, whose faces are edges, has none of the latter.

    Raises:
        InputError: there would be too many, see `build_springs`.
    """
    springs = build_springs(mesh).of_kinds(kinds)
    if parts == "free" or mesh.face_vertex_counts.max() == 2:
        return springs
    return springs.with_structural(tie_pairs(mesh), mesh.points)


def tie_pairs(mesh: PolygonMesh) -> NDArray[np.int64]:
    """Return pairs of particles that hold all components together, the lower first and in order, shape (n, 2)."""
    used = np.unique(mesh.face_vertex_indices)
    _, labels = np.unique(vertex_components(mesh, mesh_edges(mesh))[used], return_inverse=True)
    points = mesh.points[used]
    found: list[NDArray[np.int64]] = [np.zeros((0, 2), dtype=np.int64)]
    while labels.max(initial=0) > 0:
        nearest, distances = nearest_elsewhere(points, labels)
        sizes = _sizes(points, labels)
        touching = TOUCHING * np.minimum(sizes[labels], sizes[labels[nearest]])
        ties = _ties(points, labels, _tied(points, labels, distances, touching), NEAR * distances + touching)
        ties = np.concatenate([ties, *_braces(points, labels, nearest, distances, ties)])
        found.append(used[ties].astype(np.int64))
        joined = component_labels(len(sizes), labels[ties[:, 0]], labels[ties[:, 1]])
        _, labels = np.unique(joined[labels], return_inverse=True)
    return np.unique(np.sort(np.concatenate(found), axis=1), axis=0)


def nearest_elsewhere(
    points: NDArray[np.float64], labels: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return, for each point, the nearest one of another label, and its distance, each of shape (n,).

    Two labels differ in some binary digit: for each digit, those with a 0 are asked for among those with a 1, and the
    other way around.

    Args:
        points: shape (n, 3).
        labels: numbers from 0, two or more of them, none left out, shape (n,).
    """
    from scipy.spatial import KDTree  # only for meshes of several parts

    nearest, distances = np.zeros(len(points), dtype=np.int64), np.full(len(points), np.inf)
    for digit in range(int(labels.max()).bit_length()):
        sides = [np.flatnonzero((labels >> digit) & 1 == side) for side in (0, 1)]
        for here, there in (sides, sides[::-1]):
            away, which = map(np.asarray, KDTree(points[there]).query(points[here]))
            nearer = away < distances[here]
            distances[here[nearer]], nearest[here[nearer]] = away[nearer], there[which[nearer]]
    return nearest, distances


def spread(points: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return points by farthest-point sampling from the first.

    As many at most, none at the place of another.
    """
    chosen, away = [0], np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count and away.max() > 0.0:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def _sizes(points: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the diagonal of the box around the points of each label."""
    lowest = np.full((int(labels.max()) + 1, 3), np.inf)
    highest = -lowest
    np.minimum.at(lowest, labels, points)
    np.maximum.at(highest, labels, points)
    return np.linalg.norm(highest - lowest, axis=1)


def _tied(
    points: NDArray[np.float64],
    labels: NDArray[np.int64],
    distances: NDArray[np.float64],
    touching: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Return the particles of each part that are to be tied: some of those that are near, or the nearest."""
    order = np.lexsort((distances, labels))
    tied = []
    for part in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1):
        near = distances[part] <= NEAR * distances[part[0]] + touching[part]
        near[:LEAST_TIED] = True
        candidates = part[near]
        tied.append(candidates[spread(points[candidates], TIED)])
    return np.concatenate(tied)


def _ties(
    points: NDArray[np.float64], labels: NDArray[np.int64], tied: NDArray[np.int64], reach: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return pairs of tied particles with some of other parts within reach, shape (n, 2).

    The reach is longer where there are too few.
    """
    from scipy.spatial import KDTree

    tree, farthest = KDTree(points), float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = []
    for particle in tied.tolist():
        around, radius = np.zeros(0, dtype=np.int64), float(reach[particle])
        while len(around) < EACH:
            ball = np.array(tree.query_ball_point(points[particle], radius, return_sorted=True))
            around = ball[labels[ball] != labels[particle]]
            if radius > farthest:
                break
            radius = max(1.5 * radius, 1e-3 * farthest)
        around = around[np.argsort(np.linalg.norm(points[around] - points[particle], axis=1), kind="stable")]
        pairs += [(particle, int(other)) for other in around[spread(points[around], EACH)]]
    return np.array(pairs)


def _braces(
    points: NDArray[np.float64],
    labels: NDArray[np.int64],
    nearest: NDArray[np.int64],
    distances: NDArray[np.float64],
    ties: NDArray[np.int64],
) -> list[NDArray[np.int64]]:
    """Return more pairs, each of shape (n, 2), for each part that its ties do not hold firmly to the nearest one."""
    order = np.lexsort((distances, labels))
    closest = order[np.searchsorted(labels[order], np.arange(labels.max() + 1))]
    sizes, at_ends = _sizes(points, labels), labels[ties]
    braces = []
    for part, particle in enumerate(closest.tolist()):
        other = int(nearest[particle])
        size = min(sizes[part], sizes[labels[other]])
        between = (at_ends == (part, labels[other])).all(axis=1), (at_ends == (labels[other], part)).all(axis=1)
        own = np.concatenate([ties[between[0]], ties[between[1]][:, ::-1]])
        if not _is_firm(points[own[:, 0]], points[own[:, 1]], 0.5 * size):
            reach = 1.5 * max(size, distances[particle])
            ends = [_spread_around(points, labels, middle, reach) for middle in (particle, other)]
            braces.append(np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, 2))
    return braces


def _is_firm(first: NDArray[np.float64], second: NDArray[np.float64], arm: float) -> bool:
    """Return whether springs between ends, each of shape (n, 3), hold rigid parts against every motion and rotation.

    A rotation is an angle times an arm; the least stiffness is `FIRM` of a spring's constant.
    """
    lengths = np.linalg.norm(second - first, axis=1)
    long = lengths > 0.0
    if np.count_nonzero(long) < 6:  # motions and turns
        return False
    ways = (second - first)[long] / lengths[long, None]
    offsets = (first - first[long].mean(axis=0))[long] / (arm or 1.0)
    rows = np.concatenate([ways, np.cross(offsets, ways)], axis=1)
    return bool(np.linalg.eigvalsh(rows.T @ rows)[0] > FIRM)


def _spread_around(
    points: NDArray[np.float64], labels: NDArray[np.int64], middle: int, reach: float
) -> NDArray[np.int64]:
    """Return particles of a part within reach of one, that one first, and far from each other."""
    part = np.flatnonzero(labels == labels[middle])
    away = np.linalg.norm(points[part] - points[middle], axis=1)
    part = part[np.argsort(away, kind="stable")][: np.count_nonzero(away <= reach)]
    return part[spread(points[part], BRACED)]


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


STRETCH = 0.2
"""Strain of springs across a thin part, at the pressure that stretches a sphere by `AT`"""
AT = 0.1
THIN, THICK = 1.2, 1.9
"""Radii over that of the sphere of a part's area: up to the first, springs bear all of the pressure, and from the
second on none; a sphere has 2"""
OPPOSED = -0.3
"""Largest dot product of the normals of opposite walls"""
OPEN = 0.02
"""Largest fraction of a part's edges on borders, for a part that counts as closed"""
SPACING = 0.15
"""Spacing of samples on walls, over the radius of the sphere of a part's area"""
MOST_PARTS = 16
"""Largest number of subdivisions of a side of a large face"""
LEAST_SHARE = 0.1
"""Least share of the load at a corner of a face, for a spring to it"""
MOST_SLANT = 2.0
"""Largest length of a spring over the distance across that its constant compensates"""
LEAST_AWAY = 2.0e-3
"""Distance across over the radius of the sphere of a part's area, below which springs become no stiffer: walls that all
but coincide would ask for a constant without limit"""
LOOKS = 60
"""Largest number of steps along the path inward"""


@dataclass(frozen=True)
class Across:
    """Pairs of particles across thin parts."""

    pairs: NDArray[np.int64]
    """Pairs of particles, the lower first, in order, shape (n, 2)"""
    loads: NDArray[np.float64]
    """Spring constant per pascal of the pressure at a stretch of `AT` [m], shape (n,)"""


@dataclass(frozen=True)
class _Walls:
    """Places on a surface, so close that no way inward gets past them: vertices, and more on large faces."""

    places: NDArray[np.float64]
    """Positions, shape (n, 3)"""
    corners: NDArray[np.int64]
    """Particles that each sample is between, shape (n, 3); the same one, at a vertex"""
    weights: NDArray[np.float64]
    """Barycentric weights of these particles, shape (n, 3)"""
    normals: NDArray[np.float64]
    """Normals, shape (n, 3)"""


def springs_across(mesh: PolygonMesh, between_parts: bool) -> Across:
    """Return pairs of opposite particles of all closed parts of a mesh, and their loads.

    Small holes are ignored. Where the opposite wall is amid a large face, its corners share the load.

    Args:
        between_parts: whether the opposite wall may be another part's, as that of a cavity is.
    """
    edges, areas = mesh_edges(mesh), vertex_areas(mesh)
    parts = vertex_components(mesh, edges)
    borders, all_edges = (
        np.bincount(parts[ends[:, 0]], minlength=mesh.vertex_count)
        for ends in (edges.ends[border_edges(edges)], edges.ends)
    )
    used = np.flatnonzero((areas > 0.0) & (borders <= OPEN * all_edges)[parts])
    if not len(used):
        return Across(np.zeros((0, 2), dtype=np.int64), np.zeros(0))
    radii = np.sqrt(np.bincount(parts, areas, mesh.vertex_count)[parts] / (4.0 * np.pi))
    spacings = np.minimum(np.sqrt(areas), SPACING * radii)
    walls = _walls(mesh, used, SPACING * radii)
    away, opposite = _distances_inward(mesh, walls, used, radii, spacings, None if between_parts else parts)

    thin = np.clip((THICK - away / radii.clip(1e-30)) / (THICK - THIN), 0.0, 1.0)
    held = np.flatnonzero(thin > 0.0)
    gaps = np.maximum(away[held], LEAST_AWAY * radii[held])
    loads = 0.5 * areas[held] * thin[held] / (STRETCH * gaps)  # each of two ends has a spring to the other
    ends, shares = walls.corners[opposite[held]].ravel(), walls.weights[opposite[held]].ravel()
    starts, loads, lengths = np.repeat(held, 3), np.repeat(loads, 3), np.repeat(away[held], 3)
    slant = np.linalg.norm(mesh.points[starts] - mesh.points[ends], axis=1) / lengths
    kept = (shares > LEAST_SHARE) & (starts != ends) & (slant > 0.0)
    loads = (loads * shares * np.minimum(slant, MOST_SLANT) ** 2)[kept]
    pairs = np.sort(np.stack([starts, ends], axis=1)[kept], axis=1)
    pairs, which = np.unique(pairs, axis=0, return_inverse=True)
    return Across(pairs, np.bincount(which.ravel(), loads, len(pairs)).astype(np.float64))


def _distances_inward(
    mesh: PolygonMesh,
    walls: _Walls,
    used: NDArray[np.int64],
    radii: NDArray[np.float64],
    spacings: NDArray[np.float64],
    parts: NDArray[np.int64] | None,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the distance from each vertex straight inward to the opposite wall [m], and the sample there.

    The distance is infinite where the wall is far or missing; shape (vertex_count,) each.

    Args:
        parts: Part of each vertex, where a part only sees its own walls.
    """
    from scipy.spatial import KDTree

    points, normals = mesh.points, vertex_normals(mesh)
    apart = np.zeros((mesh.vertex_count, 1))
    if parts is not None:  # in a space of their own
        apart = 4.0 * np.linalg.norm(np.ptp(points, axis=0)) * parts[:, None]
    tree = KDTree(np.concatenate([walls.places, apart[walls.corners[:, 0]]], axis=1))
    away, opposite = np.full(mesh.vertex_count, np.inf), np.zeros(mesh.vertex_count, dtype=np.int64)
    looking, depths = used, 1e-3 * radii[used]
    for _ in range(LOOKS):  # steps that cannot pass a wall
        inward = -normals[looking]
        places = points[looking] + depths[:, None] * inward
        near, which = map(np.asarray, tree.query(np.concatenate([places, apart[looking]], axis=1)))
        facing = (inward * walls.normals[which]).sum(axis=1)
        to_wall = walls.places[which] - points[looking]
        at_vertex = walls.corners[which, 0] == walls.corners[which, 1]
        through = (to_wall * np.where(at_vertex[:, None], inward, walls.normals[which])).sum(axis=1)
        through /= np.where(at_vertex | (facing <= 0.0), 1.0, facing)
        found = (facing > -OPPOSED) & (through > 0.0) & (near <= 0.9 * spacings[walls.corners[which, 0]])
        away[looking[found]], opposite[looking[found]] = through[found], which[found]
        depths = depths + np.maximum(0.5 * near, 0.3 * spacings[looking])
        on = ~found & (depths < THICK * radii[looking])
        if not on.any():
            break
        looking, depths = looking[on], depths[on]
    return away, opposite


def _walls(mesh: PolygonMesh, used: NDArray[np.int64], spacings: NDArray[np.float64]) -> _Walls:
    """Return samples of the walls at these vertices and their faces.

    Args:
        spacings: Spacings of samples on the faces around each vertex [m], shape (vertex_count,).
    """
    corners, _ = triangulate(mesh)
    corners = corners[np.isin(corners[:, 0], used)].astype(np.int64)
    sides = mesh.points[np.roll(corners, -1, axis=1)] - mesh.points[corners]
    normals = np.cross(sides[:, 0], sides[:, 1])
    areas = np.linalg.norm(normals, axis=1)
    divided = np.linalg.norm(sides, axis=2).max(axis=1) / spacings[corners[:, 0]].clip(1e-30)
    parts = np.where(areas > 0.0, np.clip(np.ceil(divided), 1, MOST_PARTS), 1).astype(np.int64)
    places, all_corners = [mesh.points[used]], [np.repeat(used[:, None], 3, axis=1)]
    weights, all_normals = [np.tile([1.0, 0.0, 0.0], (len(used), 1))], [vertex_normals(mesh)[used]]
    for count in np.unique(parts[parts > 1]).tolist():
        first, second = np.divmod(np.arange(count * count), count)
        inner = np.stack([first, second], axis=1)[first + second < count]
        shares = (inner + 1.0 / 3.0) / count
        shares = np.concatenate([shares, 1.0 - shares.sum(axis=1, keepdims=True)], axis=1)
        rows = np.flatnonzero(parts == count)
        places.append((shares @ mesh.points[corners[rows]]).reshape(-1, 3))
        all_corners.append(np.repeat(corners[rows], len(shares), axis=0))
        weights.append(np.tile(shares, (len(rows), 1)))
        all_normals.append(np.repeat(normals[rows] / areas[rows, None], len(shares), axis=0))
    joined = np.concatenate
    return _Walls(joined(places), joined(all_corners), joined(weights), joined(all_normals))
