"""Sparse matrices of 3 by 3 blocks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

Values = NDArray[np.float64]
Numbers = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class BlockPattern:
    """Sparsity pattern of a matrix of blocks, sorted once for all matrices that are assembled with it."""

    order: Numbers
    """Order of the blocks, by column and row"""
    firsts: Numbers
    """First block of each place, in that order"""
    places: Numbers
    """Index of each block's numbers among those of the matrix"""
    indices: Numbers
    pointers: Numbers
    """Column pointers of the matrix in CSC format"""
    shape: tuple[int, int]

    @classmethod
    def of(cls, row: Numbers, column: Numbers, rows: int, columns: int) -> "BlockPattern":
        """Sort blocks.

        Args:
            row: of each block, shape (n,).
            column: likewise.
            rows: of blocks in the matrix.
            columns: likewise.
        """
        key = np.asarray(column, dtype=np.int64) * rows + row
        order = np.argsort(key, kind="stable")
        places, firsts = np.unique(key[order], return_index=True)
        row, column, three = places % rows, places // rows, np.arange(3)
        counts = np.bincount(column, minlength=columns)
        begins = np.cumsum(counts) - counts
        within = np.arange(len(places)) - begins[column]
        first = 9 * begins[column] + 3 * within
        entries = first[:, None, None] + three[:, None] + 3 * counts[column][:, None, None] * three
        indices = np.empty(9 * len(places), dtype=np.int32)
        indices[entries.ravel()] = np.broadcast_to(3 * row[:, None, None] + three[:, None], entries.shape).ravel()
        pointers = np.append((9 * begins[:, None] + 3 * counts[:, None] * three).ravel(), 9 * len(places))
        return cls(order, firsts, entries.ravel(), indices, pointers.astype(np.int32), (3 * rows, 3 * columns))

    def matrix(self, blocks: Values) -> sparse.csc_matrix:
        """Add blocks up to a matrix, shape (n, 3, 3)."""
        values = np.empty(len(self.places))
        if len(blocks):
            values[self.places] = np.add.reduceat(blocks[self.order], self.firsts, axis=0).ravel()
        return sparse.csc_matrix((values, self.indices, self.pointers), shape=self.shape)


def of_blocks(parts: Sequence[tuple[Numbers, Numbers, Values]], rows: int, columns: int) -> sparse.csc_matrix:
    """Add blocks up to a matrix.

    Args:
        parts: row and column of each block, shape (n,), and the blocks, shape (n, 3, 3).
        rows: of blocks in the matrix.
        columns: likewise.
    """
    row, column = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    blocks = np.concatenate([part[2] for part in parts])
    return BlockPattern.of(row, column, rows, columns).matrix(blocks)


def cross_matrices(vectors: Values) -> Values:
    """Return the matrices that multiply by a vector from the left, v x u = [v] u, shape (n, 3, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    return matrices - matrices.transpose(0, 2, 1)


def gathered(places: Numbers, vectors: Values, count: int) -> Values:
    """Add up vectors of shape (n, 3) by the particles they act on, shape (count, 3)."""
    sums = [np.bincount(places, vectors[:, axis], count) for axis in range(3)]
    return np.stack(sums, axis=1).astype(np.float64)
