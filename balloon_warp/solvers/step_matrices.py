"""The matrices of backward Euler's linear systems: one for each set of masses, damping and spring constants."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.kernels.laws.hooke import KINDS
from balloon_warp.model import Model

FACTORIZED = frozenset({"mass", "damping", "structural", "shear", "flexion", "string_stiffness"})
"""Parameters that the matrices depend on"""


class StepMatrices:
    """The distinct matrices A = M + h C + h^2 L of a model's worlds, and which world has which.

    L is the Laplacian of springs and strings weighted by their constants. A fixed particle has a row and a column of
    the identity: it moves as far as it is asked to, and nobody else notices.
    """

    def __init__(self, model: Model):
        worlds, h = model.world_count, model.step_seconds
        balloons = model.balloon_count

        def rows_of(name: str) -> NDArray[np.float64]:
            return model.parameters[name].numpy().astype(np.float64)

        kinds = np.stack(np.broadcast_arrays(*(rows_of(kind.name) for kind in KINDS)), axis=-1)
        parts = [rows_of("mass") + h * rows_of("damping"), kinds.reshape(-1, 3 * balloons)]
        if model.string_count:
            parts.append(rows_of("string_stiffness"))
        rows = np.concatenate([np.broadcast_to(part, (worlds, part.shape[1])) for part in parts], axis=1)
        self._rows, of_world = np.unique(rows, axis=0, return_inverse=True)
        self.of_world: NDArray[np.integer] = of_world.reshape(-1)
        """Matrix of each world, shape (world_count,)"""
        self._model = model
        self._balloon = np.asarray(model.particle_balloon.numpy(), dtype=np.int64)
        self._share = model.particle_mass_share.numpy().astype(np.float64)
        self._ends = np.asarray(model.spring_particles.numpy(), dtype=np.int64)
        self._kind = np.asarray(model.spring_kind.numpy(), dtype=np.int64)
        self._scale = model.spring_stiffness_scale.numpy().astype(np.float64)

    @property
    def count(self) -> int:
        """Number of distinct matrices."""
        return len(self._rows)

    def matrix(self, number: int) -> Any:
        """Return one matrix, as SciPy's CSC array."""
        return self._matrix(self._rows[number])

    def pattern(self) -> Any:
        """Make a matrix as they are, with no entry that happens to be zero."""
        return self._matrix(np.ones_like(self._rows[0]), np.ones_like(self._scale))

    def _matrix(self, row: NDArray[np.float64], scale: NDArray[np.float64] | None = None) -> Any:
        from scipy.sparse import csc_array

        model, h = self._model, self._model.step_seconds
        inertia, stiffness, strings = np.split(row, [model.balloon_count, 4 * model.balloon_count])
        moves = self._share > 0.0
        p, q = self._ends.T
        weight = h * h * stiffness[3 * self._balloon[p] + self._kind] * (self._scale if scale is None else scale)
        diagonal = np.where(moves, self._share * inertia[self._balloon], 1.0)
        np.add.at(diagonal, p, np.where(moves[p], weight, 0.0))
        np.add.at(diagonal, q, np.where(moves[q], weight, 0.0))
        held = np.asarray(model.string_particle.numpy(), dtype=np.int64)
        np.add.at(diagonal, held, np.where(moves[held], h * h * strings, 0.0))
        inner = moves[p] & moves[q]
        p, q, weight = p[inner], q[inner], weight[inner]
        own = np.arange(len(diagonal))
        rows, columns = np.concatenate([own, p, q]), np.concatenate([own, q, p])
        shape = (len(diagonal), len(diagonal))
        return csc_array((np.concatenate([diagonal, -weight, -weight]), (rows, columns)), shape=shape)
