"""Springs across thin parts of a balloon, from wall to wall, as an air mattress has them.

A pressure drives the two walls of a plate, a cup or a blade apart, and would make a pillow of them: a film does not
resist bending. Here each vertex of a closed part is held to what is opposite to it, by a spring that bears the
pressure on the vertex when it is stretched by `STRETCH`. The thicker a part is, the less of the pressure: a ball has
none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from balloon_warp.mesh.geometry import vertex_areas, vertex_normals
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.mesh.topology import border_edges, mesh_edges, vertex_components

STRETCH = 0.2
"""of a thin part across, at the pressure that stretches a ball by `AT`"""
AT = 0.1
THIN, THICK = 1.2, 1.9
"""over the radius of the sphere of a part's area: up to the first, springs bear all of the pressure, and from the
second on none; a sphere has 2"""
OPPOSED = -0.3
"""the most that the product of the normals of opposite walls may be"""
OPEN = 0.02
"""of a part's edges may be on borders, of one that counts as closed"""
LOOKS = 60
"""along the way inward, at most"""


@dataclass(frozen=True)
class Across:
    """Pairs of particles across thin parts."""

    pairs: NDArray[np.int64]
    """the lower first, in order, shape (n, 2)"""
    loads: NDArray[np.float64]
    """a spring's constant for each pascal of the pressure at a stretch of `AT` [m], shape (n,)"""


def springs_across(mesh: PolygonMesh, between_parts: bool) -> Across:
    """The pairs of opposite particles of all parts of a mesh that are closed, but for small holes, and of each what it
    has to bear.

    Args:
        between_parts: whether the opposite wall may be another part's, as that of a cavity is.
    """
    from scipy.spatial import KDTree

    edges, areas, normals = mesh_edges(mesh), vertex_areas(mesh), vertex_normals(mesh)
    parts = vertex_components(mesh, edges)
    borders, all_edges = (
        np.bincount(parts[ends[:, 0]], minlength=mesh.vertex_count)
        for ends in (edges.ends[border_edges(edges)], edges.ends)
    )
    used = np.flatnonzero((areas > 0.0) & (borders <= OPEN * all_edges)[parts])
    if not len(used):
        return Across(np.zeros((0, 2), dtype=np.int64), np.zeros(0))
    radii = np.sqrt(np.bincount(parts, areas, mesh.vertex_count)[parts] / (4.0 * np.pi))
    apart = np.zeros((mesh.vertex_count, 1))
    if not between_parts:  # in a space of their own
        apart = 4.0 * np.linalg.norm(np.ptp(mesh.points, axis=0)) * parts[:, None]
    tree = KDTree(np.concatenate([mesh.points, apart], axis=1)[used])

    away, opposite = np.full(mesh.vertex_count, np.inf), np.zeros(mesh.vertex_count, dtype=np.int64)
    looking, depths = used, 1e-3 * radii[used]
    for _ in range(LOOKS):  # steps inward that cannot pass a wall
        places = mesh.points[looking] - depths[:, None] * normals[looking]
        near, which = map(np.asarray, tree.query(np.concatenate([places, apart[looking]], axis=1)))
        other = used[which]
        through = ((mesh.points[looking] - mesh.points[other]) * normals[looking]).sum(axis=1)
        found = (near <= 0.9 * np.sqrt(areas[other])) & (through > 0.0)
        found &= (normals[looking] * normals[other]).sum(axis=1) < OPPOSED
        away[looking[found]], opposite[looking[found]] = through[found], other[found]
        depths = depths + np.maximum(0.5 * near, 0.3 * np.sqrt(areas[looking]))
        on = ~found & (depths < THICK * radii[looking])
        if not on.any():
            break
        looking, depths = looking[on], depths[on]

    thin = np.clip((THICK - away / radii.clip(1e-30)) / (THICK - THIN), 0.0, 1.0)
    held = np.flatnonzero(thin > 0.0)
    pairs = np.sort(np.stack([held, opposite[held]], axis=1), axis=1)
    loads = 0.5 * areas[held] * thin[held] / (STRETCH * away[held])  # each of two ends has a spring to the other
    pairs, which = np.unique(pairs, axis=0, return_inverse=True)
    return Across(pairs, np.bincount(which.ravel(), loads, len(pairs)).astype(np.float64))
