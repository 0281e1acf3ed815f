"""The global step by a dense inverse: for the GPU, one matrix product for all worlds."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.linear_systems import ROW_LANES, InverseTable, inverse_product
from balloon_warp.model import Model
from balloon_warp.solvers.step_matrices import StepMatrices


@dataclass(frozen=True)
class Layout:
    """How the product is shared out; see `inverse_product`."""

    rows: int
    worlds: int
    unrolled: int
    threads: int
    """of a block"""


OF_MANY_WORLDS = Layout(rows=4, worlds=8, unrolled=2, threads=128)
"""which have the same matrix: 96 products for each 28 numbers loaded"""
OF_EACH_WORLD = Layout(rows=1, worlds=1, unrolled=16, threads=32)
"""with a matrix of its own, or too few of them to fill a GPU otherwise"""
MANY_WORLDS = 64
MOST_PARTICLES = 4096
"""of a balloon: its inverse takes 64 MiB then, and every iteration reads it"""


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
        self._layout = OF_MANY_WORLDS if shared else OF_EACH_WORLD
        self._tiles = array(_tiles(counts, self._layout.rows), wp.vec2i)
        self._inverse = InverseTable()
        self._inverse.particle_offsets = array(model.particle_offsets, wp.int32)
        self._inverse.entry_offsets = array(np.cumsum([0, *counts[:-1] ** 2]), wp.int32)
        inverses = [_inverses(matrices.matrix(number), model.particle_offsets) for number in range(matrices.count)]
        self._inverse.entries = array(np.stack(inverses), float)
        self._inverse.of_world = array(matrices.of_world, wp.int32)

    @staticmethod
    def world_bytes(model: Model, matrices: StepMatrices) -> int:
        """Memory that it keeps for each world."""
        return 4 * int((np.diff(model.particle_offsets) ** 2).sum()) * matrices.count // model.world_count

    def solve(self, right_sides: wp.array, solutions: wp.array) -> None:
        """A solution for each right side, both of shape (world_count, particle_count), vec3."""
        layout = self._layout
        wp.launch(
            inverse_product(layout.rows, layout.worlds, layout.unrolled),
            (-(-self._model.world_count // layout.worlds), len(self._tiles), int(ROW_LANES)),
            inputs=[self._inverse, self._tiles, right_sides, solutions],
            device=self._model.device,
            block_dim=layout.threads,
        )


def _tiles(counts: NDArray[np.integer], rows: int) -> list[tuple[int, int]]:
    """Balloon and first row of each group of rows that a row of threads multiplies."""
    tile = rows * int(ROW_LANES)
    return [(balloon, row) for balloon, count in enumerate(counts) for row in range(0, int(count), tile)]


def _inverses(matrix: Any, offsets: list[int]) -> NDArray[np.float32]:
    """The inverses of the matrix's diagonal blocks, flat, one after the other."""
    from scipy.linalg import get_lapack_funcs

    potrf, potri = get_lapack_funcs(("potrf", "potri"), dtype=np.float64)
    flat = []
    for begin, end in pairwise(offsets):
        factor, _ = potrf(matrix[begin:end, begin:end].toarray())  # positive definite: it cannot fail
        upper = np.triu(potri(factor)[0])
        flat.append((upper + np.triu(upper, 1).T).astype(np.float32).ravel())
    return np.concatenate(flat)
