"""The `projective` solver: backward Euler by local and global steps (Liu et al. 2013), stable at any step."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.lanes import LANE_COUNT, Lanes, Lanes3
from balloon_warp.kernels.laws.springs import HOOKE, KINDS
from balloon_warp.kernels.projective import (
    LEAST_ITERATIONS,
    MOST_ITERATIONS,
    PARTS,
    ROW_THREADS,
    TOLERANCE,
    WORTH_SAYING,
    FactorTable,
    InverseTable,
    Settling,
    factored_solver,
    inertia_function,
    local_step_kernel,
    multiply_own_inverse,
    prediction_kernel,
    settling_kernel,
    shared_inverse_product,
    take_displacements,
)
from balloon_warp.kernels.schedules.launched import GATHERED
from balloon_warp.kernels.substep import PROJECTIVE_STEP
from balloon_warp.model import Model, State
from balloon_warp.model.state import Counting, Room
from balloon_warp.schedules.launched import LaunchedSchedule, Moving, Own
from balloon_warp.schedules.tables import model_features, world_state
from balloon_warp.system.warp_threads import launch, launch_tiled

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


ITERATIONS_BETWEEN = 5
"""Number of iterations between two tests whether any world goes on"""
SETTLING_THREADS = 256
"""Number of threads that sum over the particles of a world on a GPU"""


class ProjectiveSolver(LaunchedSchedule):
    """Advances a state by whole frames, in place. Bit-reproducible.

    Springs, strings and damping are implicit; gravity, helium, other laws on particles and inflation are those at a
    substep's start, and contacts follow at its end, as in the schedules.

    Raises:
        InputError: the model has physics that it lacks, or a balloon is too large for a GPU, see `DenseInverse`.
    """

    name = "projective"
    access = GATHERED
    phases = PROJECTIVE_STEP

    def __init__(self, model: Model, global_step: type[SparseFactor] | type[DenseInverse] | None = None):
        if beyond := _beyond(model_features(model)):
            raise InputError(f'solver: "projective" does not support {beyond}; expected another solver')
        super().__init__(model)
        matrices = StepMatrices(model)
        self._global_step = (global_step or _global_step(model))(model, matrices)
        self._settling = _settling(model, matrices)

    @property
    def depends_on(self) -> frozenset[str]:
        """Parameters that the factors are made of."""
        return FACTORIZED

    @classmethod
    def allocate(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
        """Allocate six vectors for each particle.

        They are displacements without springs, those tried, those reached, points tried, residuals, and increments of
        displacements.
        """
        return tuple(room.array((model.world_count, model.particle_count), wp.vec3) for _ in range(6))

    @classmethod
    def world_bytes(cls, model: Model) -> int:
        """Return the device memory that it keeps for each world, beside the state."""
        return super().world_bytes(model) + _global_step(model).world_bytes(model, StepMatrices(model))

    def own(self) -> Mapping[str, Own]:
        """Name the phases that the solver itself replaces."""
        return {"settle": self._settle}

    def _settle(self, state: State, substep: int, now: Moving) -> None:
        """Run local and global steps in turn, until every world has converged."""
        free, tried, reached, trials, _, _ = self.vectors
        t, settling, inflations = self.tables, self._settling, self.launches.values["inflation"]
        begin = t, self.launches.clock, substep, world_state(state), inflations, settling
        self._over_particles(prediction_kernel(self.features), *begin, free, tried, reached, trials)
        most, device = int(settling.most), self.model.device
        can_ask = device.is_cpu or wp.is_conditional_graph_supported()
        if most <= ITERATIONS_BETWEEN or not can_ask:
            self._iterate(state, most)  # worlds that have settled do nothing more
        else:
            wp.capture_while(settling.any_going, self._iterate, state=state, count=ITERATIONS_BETWEEN)
        self._over_particles(take_displacements, t.step_seconds, reached, *now)

    def _iterate(self, state: State, count: int) -> None:
        """Run a number of iterations in the worlds that go on."""
        free, tried, reached, trials, residuals, increments = self.vectors
        t, settling, model = self.tables, self._settling, self.model
        settle = settling_kernel(self.features, inertia_function(self.features))
        for _ in range(count):
            self._over_particles(local_step_kernel(self.features), t, free, tried, trials, settling, residuals)
            self._global_step.solve(residuals, increments, settling.going)
            launch_tiled(
                settle,
                dim=[model.world_count],
                inputs=[t, state.frame, state.points, free, residuals, increments, settling, tried, reached, trials],
                outputs=[state.unsettled],
                block_dim=SETTLING_THREADS if model.device.is_cuda else 1,
                device=model.device,
            )

    def _over_particles(self, kernel: Any, *arguments: Any) -> None:
        """Launch a thread a (world, particle)."""
        shape = (self.model.world_count, self.model.particle_count)
        launch(kernel, shape, inputs=list(arguments), device=self.model.device)


def _settling(model: Model, matrices: StepMatrices) -> Any:
    """Make the stopping criteria of a model's iterations."""
    said = model.scene.solver_iterations
    settling = Settling()
    settling.least, settling.most = (LEAST_ITERATIONS, MOST_ITERATIONS) if said == "auto" else (said, said)
    settling.tolerance, settling.worth_saying = TOLERANCE, WORTH_SAYING
    diagonals = [matrices.matrix(number).diagonal() for number in range(matrices.count)]
    settling.diagonals = wp.array(np.stack(diagonals), dtype=float, device=model.device)
    settling.of_world = wp.array(matrices.of_world, dtype=wp.int32, device=model.device)
    for name, count in (("iterations", model.world_count), ("gathered", model.world_count), ("any_going", 1)):
        setattr(settling, name, wp.zeros(count, dtype=wp.int32, device=model.device))
    settling.going = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
    return settling


def _beyond(features: Features) -> str | None:
    """Name a feature that the solver does not simulate, or return None."""
    if features.touches:
        return "balloons that touch"
    if features.membranes:
        return f"{features.membranes[0].name.replace('_', '-')} material"
    if features.bodies:
        return "free rigid bodies"
    if features.small_spheres:
        return "spheres that touch faces"
    if features.pressures:
        return "pressure or gas"
    if features.corrected:
        return "position correction"
    for law in features.laws:
        implicit = law is HOOKE or law.kind == "string"
        if not implicit and law.kind != "particle":
            return law.name.replace("_", " ")
    known = {phase.name for phase in PROJECTIVE_STEP}
    for name in features.active:
        if name not in known:
            return f"the phase {name}"
    for given, words in (("water_load", "water"), ("area_vector", "drag in air")):
        if features.needs("particle", given):
            return words
    return None


def _global_step(model: Model) -> type[SparseFactor] | type[DenseInverse]:
    return SparseFactor if model.device.is_cpu else DenseInverse
