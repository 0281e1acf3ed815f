"""Springs across thin parts of a balloon, from wall to wall, as an air mattress has them.

A pressure drives the two walls of a plate, a cup or a blade apart, and would make a pillow of them: a film does not
resist bending. Here each vertex of a closed part is held to the opposite wall, by a spring that bears the
pressure on the vertex when it is stretched by `STRETCH`. The thicker a part is, the less of the pressure: a ball has
none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import triangulate, vertex_areas, vertex_normals
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import border_edges, mesh_edges, vertex_components

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
    away, opposite = _ways_inward(mesh, walls, used, radii, spacings, None if between_parts else parts)

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


def _ways_inward(
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
