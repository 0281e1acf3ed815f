"""The global step by a sparse factorization: for the CPU, eight worlds side by side."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.solvers.linear_systems import FactorTable, factored_solver
from balloon_warp.launching import launch
from balloon_warp.model import Model
from balloon_warp.model.memory import Counting
from balloon_warp.solvers.step_matrices import StepMatrices


class SparseFactor:
    """Solves with L D L^T = A, ordered by minimum degree: some 40 entries a particle at 500 particles, 80 at 5,000.

    SciPy (SuperLU) factorizes once; a kernel solves, since SuperLU takes three times as long for many worlds, and its
    last bits depend on how many there are.

    Raises:
        ValueError: the device is not the CPU, whose vector instructions the kernel is made of.
    """

    def __init__(self, model: Model, matrices: StepMatrices):
        if not model.device.is_cpu:
            raise ValueError(f"SparseFactor runs on the CPU (got {model.device})")
        layout = _lay_out(matrices.pattern())
        factors = [layout.factorize(matrices.matrix(number)) for number in range(matrices.count)]
        shared = matrices.count == 1
        group_count = -(-model.world_count // LANE_COUNT)
        factor_type: Any = float if shared else Lanes

        def array(values: NDArray, dtype: Any) -> wp.array:
            return wp.array(values, dtype=dtype, device=model.device)

        def of_worlds(values: list[NDArray]) -> wp.array:
            """Shape (1, n) where all worlds are alike, or else (group_count, n) of eight worlds' numbers."""
            if shared:
                return array(values[0][None], float)
            worlds = np.minimum(np.arange(LANE_COUNT * group_count), model.world_count - 1)
            lanes = np.array(values, dtype=np.float32)[matrices.of_world[worlds]].reshape(group_count, LANE_COUNT, -1)
            return array(np.ascontiguousarray(lanes.transpose(0, 2, 1)), Lanes)

        self._device = model.device
        self._kernel = factored_solver(factor_type)
        self._factor = FactorTable()
        self._factor.place = array(layout.place, wp.int32)
        self._factor.offsets = array(layout.offsets, wp.int32)
        self._factor.rows = array(layout.rows, wp.int32)
        self._entries = of_worlds([entries for entries, _ in factors])
        self._inverse_pivots = of_worlds([1.0 / pivots for _, pivots in factors])
        self._work = wp.zeros((group_count, model.particle_count), dtype=Lanes3, device=model.device)

    @staticmethod
    def world_bytes(model: Model, matrices: StepMatrices) -> int:
        """Return the memory that it keeps for each world; for its own factor, an upper bound."""
        groups = -(-model.world_count // LANE_COUNT)
        entries = 0 if matrices.count == 1 else int(8 * np.log2(model.particle_count + 1)) * model.particle_count
        room = Counting()
        room.array((groups, model.particle_count), Lanes3)
        room.array((groups, entries), Lanes)
        return room.bytes // model.world_count

    def solve(self, right_sides: wp.array, solutions: wp.array, going: wp.array) -> None:
        """Find a solution for each right side, at least in the worlds that go on.

        Both have the shape (world_count, particle_count), vec3; the entry of `going`, int32, is not 0 in those worlds.
        """
        launch(
            self._kernel,
            self._work.shape[0],
            inputs=[
                *(self._factor, self._entries, self._inverse_pivots, right_sides, going),
                *(self._work, solutions),
            ],
            device=self._device,
        )


@dataclass(frozen=True)
class _Layout:
    """Places of the entries of L, column by column without the diagonal, independent of their values."""

    place: NDArray[np.int32]
    """Row of each particle"""
    offsets: NDArray[np.int32]
    rows: NDArray[np.int32]

    def factorize(self, matrix: Any) -> tuple[NDArray, NDArray]:
        """Find the entries of L, 0 where SuperLU leaves one out, and the pivots D."""
        order = np.argsort(self.place)
        lower, pivots, _ = _factors(matrix[order][:, order], "NATURAL")
        entries = np.zeros(len(self.rows))
        entries[np.searchsorted(self._keys(self.offsets, self.rows), self._keys(lower.indptr, lower.indices))] = (
            lower.data
        )
        return entries, pivots

    def _keys(self, offsets: NDArray, rows: NDArray) -> NDArray[np.int64]:
        """Return the entries by column, then row, as ascending numbers."""
        columns = np.repeat(np.arange(len(offsets) - 1, dtype=np.int64), np.diff(offsets))
        return columns * len(self.place) + rows


def _lay_out(pattern: Any) -> _Layout:
    lower, _, place = _factors(pattern, "MMD_AT_PLUS_A")
    return _Layout(place, lower.indptr, lower.indices)


def _factors(matrix: Any, ordering: str) -> tuple[Any, NDArray, NDArray]:
    """Return the factors of a symmetric matrix: L without its unit diagonal, D, and the place of each row.

    L is SciPy's CSC matrix.
    """
    from scipy.sparse import tril
    from scipy.sparse.linalg import splu

    factor = splu(matrix.tocsc(), permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    lower: Any = tril(factor.L, -1, format="csc")
    lower.sort_indices()
    return lower, factor.U.diagonal(), factor.perm_c
