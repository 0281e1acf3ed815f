"""The global step by a dense inverse: for the GPU, one matrix product for all worlds."""

from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.solvers.linear_systems import (
    PARTS,
    ROW_THREADS,
    InverseTable,
    multiply_own_inverse,
    shared_inverse_product,
)
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model
from balloon_warp.solvers.step_matrices import StepMatrices

MANY_WORLDS = 400
"""Number of worlds that fill a GPU with several rows and worlds a thread: 96 products for each 20 numbers loaded"""
ROWS, WORLDS, THREADS = 8, 4, 128
MOST_PARTICLES = 4096
"""Largest number of particles of a balloon: its inverse then takes 64 MiB, and every iteration reads it"""


class DenseInverse:
    """Multiplies by A^-1, balloon by balloon. A world's product has the same bits among others as alone.

    Raises:
        InputError: a balloon has more than `MOST_PARTICLES`.
    """

    def __init__(self, model: Model, matrices: StepMatrices):
        counts = np.diff(model.particle_offsets)
        largest = int(counts.max())
        if largest > MOST_PARTICLES:
            raise InputError(
                f'solver: "projective" takes balloons of {MOST_PARTICLES:,} particles at most on a GPU (got '
                f"{largest:,}); use the device cpu, which takes any, or another solver"
            )

        def array(values: Any, dtype: Any) -> wp.array:
            return wp.array(np.asarray(values), dtype=dtype, device=model.device)

        self._model = model
        shared = matrices.count == 1 and model.world_count >= MANY_WORLDS
        self._product = shared_inverse_product(ROWS, WORLDS) if shared else None
        self._tiles = array(_tiles(counts, ROWS if shared else 1), wp.vec2i)
        self._inverse = InverseTable()
        self._inverse.particle_offsets = array(model.particle_offsets, wp.int32)
        self._inverse.entry_offsets = array(np.cumsum([0, *counts[:-1] ** 2]), wp.int32)
        inverses = [_inverses(matrices.matrix(number), model.particle_offsets) for number in range(matrices.count)]
        self._inverse.entries = array(np.stack(inverses), float)
        self._inverse.of_world = array(matrices.of_world, wp.int32)

    @staticmethod
    def world_bytes(model: Model, matrices: StepMatrices) -> int:
        """Return the memory that it keeps for each world."""
        return 4 * int((np.diff(model.particle_offsets) ** 2).sum()) * matrices.count // model.world_count

    def solve(self, right_sides: wp.array, solutions: wp.array, going: wp.array) -> None:
        """Find a solution for each right side, in the worlds that go on.

        Both have the shape (world_count, particle_count), vec3; the entry of `going`, int32, is not 0 in those worlds.
        """
        worlds, device, tiles = self._model.world_count, self._model.device, len(self._tiles)
        inputs = [self._inverse, self._tiles, right_sides, going, solutions]
        if self._product:
            groups = -(-worlds // WORLDS)
            launch(self._product, (groups, tiles, int(ROW_THREADS)), inputs=inputs, device=device, block_dim=THREADS)
        else:
            threads = int(PARTS * ROW_THREADS) if device.is_cuda else 1
            launch_tiled(multiply_own_inverse, dim=(worlds, tiles), inputs=inputs, device=device, block_dim=threads)


def _tiles(counts: NDArray[np.integer], rows: int) -> list[tuple[int, int]]:
    """Return the balloon and first row of each group of rows that threads beside each other multiply."""
    tile = rows * int(ROW_THREADS)
    return [(balloon, row) for balloon, count in enumerate(counts) for row in range(0, int(count), tile)]


def _inverses(matrix: Any, offsets: list[int]) -> NDArray[np.float32]:
    """Invert the matrix's diagonal blocks, flat, one after the other."""
    from scipy.linalg import get_lapack_funcs

    potrf, potri = get_lapack_funcs(("potrf", "potri"), dtype=np.float64)
    flat = []
    for begin, end in pairwise(offsets):
        factor, _ = potrf(matrix[begin:end, begin:end].toarray())  # positive definite: it cannot fail
        upper = np.triu(potri(factor)[0])
        flat.append((upper + np.triu(upper, 1).T).astype(np.float32).ravel())
    return np.concatenate(flat)
