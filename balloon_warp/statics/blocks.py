"""Sparse matrices of 3 by 3 blocks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

Values = NDArray[np.float64]
Numbers = NDArray[np.integer[Any]]


def of_blocks(parts: Sequence[tuple[Numbers, Numbers, Values]], rows: int, columns: int) -> sparse.csc_matrix:
    """Add blocks up to a matrix.

    Args:
        parts: row and column of each block, shape (n,), and the blocks, shape (n, 3, 3).
        rows: of blocks in the matrix.
        columns: likewise.
    """
    three = np.arange(3)
    row = np.concatenate([np.repeat(3 * np.asarray(r)[:, None] + three, 3) for r, _, _ in parts])
    column = np.concatenate([np.tile(3 * np.asarray(c)[:, None] + three, (1, 3)).ravel() for _, c, _ in parts])
    values = np.concatenate([block.ravel() for _, _, block in parts])
    return sparse.csc_matrix((values, (row, column)), shape=(3 * rows, 3 * columns))


def cross_matrices(vectors: Values) -> Values:
    """Return the matrices that multiply by a vector from the left, v x u = [v] u, shape (n, 3, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    return matrices - matrices.transpose(0, 2, 1)


def gathered(places: Numbers, vectors: Values, count: int) -> Values:
    """Add up vectors of shape (n, 3) by the particles they act on, shape (count, 3)."""
    sums = [np.bincount(places, vectors[:, axis], count) for axis in range(3)]
    return np.stack(sums, axis=1).astype(np.float64)
