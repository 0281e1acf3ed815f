"""Springs that hold the parts of a mesh together: components that touch, overlap or hang apart become one thing.

In rounds, each part is tied to the part nearest to it, and counts as one with it from then on, until there is one
(Boruvka's spanning tree). A part is tied where it is near: at a few particles, far from each other, and each of them to
a few others, so that no tie is a hinge. Rest lengths are the distances at the start.
"""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.load import Parts
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import component_labels, mesh_edges, vertex_components
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
