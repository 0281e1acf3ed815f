"""Springs from a mesh's faces, by the rules of the paper's section on the .obj loader and spring generation.

With the pairs of particles as sets, the rules read:

    structural  edges of faces
    shear       pairs in one face, without the structural ones
    flexion     pairs among the structural neighbors of one particle, without the structural and shear ones
"""

import numpy as np
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.mesh.corners import next_corners
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.springs.springs import SpringKind, Springs

# Springs grow with the square of a face's corners or a particle's neighbors: 4,096 of them give 8 million.
LARGEST_GROUP = 4096
# Pairs worked on at once, which bounds the memory.
CHUNK_PAIRS = 1 << 22


def build_springs(mesh: PolygonMesh) -> Springs:
    """Structural, shear and flexion springs of a mesh with any valence, face size, borders and non-manifold edges.

    Each pair of particles has at most one spring: of the first kind, in that order, whose rule it fits.

    Raises:
        InputError: a face has more than `LARGEST_GROUP` corners, or a particle as many neighbors.
    """
    count = mesh.vertex_count
    _check_size(mesh.face_vertex_counts, "face", "corners")
    corners = mesh.face_vertex_indices.astype(np.int64)

    structural = np.unique(_keys(corners, corners[next_corners(mesh)], count))
    shear = _without(_pairs_in_groups(corners, mesh.face_vertex_counts, count), structural)

    low, high = np.divmod(structural, count)
    neighbors = np.concatenate([high, low])[np.argsort(np.concatenate([low, high]), kind="stable")]
    valences = np.bincount(np.concatenate([low, high]), minlength=count)
    _check_size(valences, "particle", "neighbors")
    flexion = _without(_without(_pairs_in_groups(neighbors, valences, count), structural), shear)

    by_kind = {SpringKind.STRUCTURAL: structural, SpringKind.SHEAR: shear, SpringKind.FLEXION: flexion}
    pairs = np.stack(np.divmod(np.concatenate(list(by_kind.values())), max(count, 1)), axis=1)
    return Springs(
        pairs=pairs.astype(np.int32),
        kind=np.repeat(np.array(list(by_kind), dtype=np.int32), [len(keys) for keys in by_kind.values()]),
        rest_lengths=np.linalg.norm(mesh.points[pairs[:, 1]] - mesh.points[pairs[:, 0]], axis=1),
    )


def _keys(first: NDArray[np.int64], second: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """A number for each pair of different particles, the same in both orders: low * count + high."""
    keys = np.minimum(first, second) * count + np.maximum(first, second)
    return keys[first != second]


def _pairs_in_groups(members: NDArray[np.int64], sizes: NDArray, count: int) -> NDArray[np.int64]:
    """Sorted keys of the pairs of particles that stand together in a group.

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


def _without(keys: NDArray[np.int64], taken: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.setdiff1d(keys, taken, assume_unique=True)


def _check_size(sizes: NDArray, group: str, members: str) -> None:
    if len(sizes) and sizes.max() > LARGEST_GROUP:
        largest = int(sizes.argmax())
        raise InputError(
            f"{group} {largest + 1} (counted from 1) has {sizes[largest]:,} {members}; "
            f"springs can be made for at most {LARGEST_GROUP:,}"
        )
