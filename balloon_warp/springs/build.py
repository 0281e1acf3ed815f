"""Springs from a mesh's faces, by the rules of the paper's section on the .obj loader and spring generation.

With the pairs of particles as sets, the rules read:

    structural  edges of faces
    shear       pairs in one face, without the structural ones
    flexion     pairs among the structural neighbors of one particle, without the structural and shear ones
"""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.arguments import checked
from balloon_warp.errors import InputError
from balloon_warp.mesh.check import LARGEST_FACE, LARGEST_FAN
from balloon_warp.mesh.corners import next_corners
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.springs.springs import SpringKind, Springs

# Pairs that a mesh may have at all: a gigabyte or two while they are sorted.
LARGEST_PAIR_COUNT = 1 << 24
# Pairs worked on at once, which bounds the memory.
CHUNK_PAIRS = 1 << 22


@checked
def build_springs(mesh: PolygonMesh) -> Springs:
    """Build the springs of a mesh with any valence, face size, borders and non-manifold edges.

    They are structural, shear and flexion springs.

    Each pair of particles has at most one spring. Its kind is the first of the three, in that order, whose rule it
    fits. Where a particle has more than `LARGEST_FAN` neighbors, a flexion spring joins each neighbor with the one
    half-way around only.

    Raises:
        InputError: a face has more than `LARGEST_FACE` corners, or all together have more than `LARGEST_PAIR_COUNT`
            pairs.
    """
    count = mesh.vertex_count
    _check_sizes(mesh)
    corners = mesh.face_vertex_indices.astype(np.int64)

    structural = np.unique(_keys(corners, corners[next_corners(mesh)], count))
    shear = _without(_pairs_in_groups(corners, mesh.face_vertex_counts, count), structural)

    low, high = np.divmod(structural, count)
    neighbors = np.concatenate([high, low])[np.argsort(np.concatenate([low, high]), kind="stable")]
    valences = np.bincount(np.concatenate([low, high]), minlength=count)
    _check_pair_count(valences[valences <= LARGEST_FAN], mesh, "pairs of neighbors of its particles")
    past_one = _pairs_past_particles(neighbors, valences, count)
    flexion = _without(_without(past_one, structural), shear)

    by_kind = {SpringKind.STRUCTURAL: structural, SpringKind.SHEAR: shear, SpringKind.FLEXION: flexion}
    pairs = np.stack(np.divmod(np.concatenate(list(by_kind.values())), max(count, 1)), axis=1)
    return Springs(
        pairs=pairs.astype(np.int32),
        kind=np.repeat(np.array(list(by_kind), dtype=np.int32), [len(keys) for keys in by_kind.values()]),
        rest_lengths=np.linalg.norm(mesh.points[pairs[:, 1]] - mesh.points[pairs[:, 0]], axis=1),
    )


def _keys(first: NDArray[np.int64], second: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Give a number to each pair of different particles, the same in both orders: low * count + high."""
    keys = np.minimum(first, second) * count + np.maximum(first, second)
    return keys[first != second]


def _pairs_in_groups(members: NDArray[np.int64], sizes: NDArray, count: int) -> NDArray[np.int64]:
    """Return the sorted keys of the pairs of particles that stand together in a group.

    Args:
        members: particles of all groups in order, shape (sizes.sum(),).
        sizes: members of each group, shape (group_count,).
        count: particle count.
    """
    starts = np.cumsum(sizes) - sizes
    found = [np.zeros(0, dtype=np.int64)]
    for size in np.unique(sizes[sizes > 1]):
        first, second = np.triu_indices(size, k=1)
        groups = starts[sizes == size]
        rows = max(CHUNK_PAIRS // len(first), 1)
        for begin in range(0, len(groups), rows):
            table = members[groups[begin : begin + rows, None] + np.arange(size)]
            found.append(np.unique(_keys(table[:, first].ravel(), table[:, second].ravel(), count)))
    return np.unique(np.concatenate(found))


def _pairs_past_particles(neighbors: NDArray[np.int64], valences: NDArray, count: int) -> NDArray[np.int64]:
    """Find the sorted keys of the pairs that flexion springs may join.

    They are all neighbors of a particle, or, where they are too many, each with the one half-way around.
    """
    is_hub = valences > LARGEST_FAN
    at_hub = np.repeat(is_hub, valences)
    across = [np.zeros(0, dtype=np.int64)]
    for rim in np.split(neighbors[at_hub], np.cumsum(valences[is_hub]))[:-1]:
        across.append(_keys(rim, np.roll(rim, -(len(rim) // 2)), count))
    return np.unique(np.concatenate([_pairs_in_groups(neighbors[~at_hub], valences[~is_hub], count), *across]))


def _without(keys: NDArray[np.int64], taken: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.setdiff1d(keys, taken, assume_unique=True)


def _check_sizes(mesh: PolygonMesh) -> None:
    sizes = mesh.face_vertex_counts.astype(np.int64)
    if len(sizes) and sizes.max() > LARGEST_FACE:
        raise InputError(
            f"face {int(sizes.argmax()) + 1} (counted from 1) has {sizes.max():,} corners; "
            f"springs can be made for at most {LARGEST_FACE:,}"
        )
    _check_pair_count(sizes, mesh, "pairs of corners in its faces")


def _check_pair_count(sizes: NDArray, mesh: PolygonMesh, pairs: str) -> None:
    found = int((sizes * (sizes - 1) // 2).sum())
    if found > LARGEST_PAIR_COUNT:
        raise InputError(f"{mesh.name}: has {found:,} {pairs}; springs can be made for at most {LARGEST_PAIR_COUNT:,}")
