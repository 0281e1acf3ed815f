"""The `projective` solver: backward Euler by local and global steps (Liu et al. 2013), stable at any step."""

from collections.abc import Iterator
from typing import Any

import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.projective import (
    apply_increments,
    ending_kernel,
    foresee_displacements,
    local_step_kernel,
)
from balloon_warp.model import Model, State
from balloon_warp.model.memory import VECTOR_BYTES
from balloon_warp.schedules.health import HealthCheck
from balloon_warp.schedules.refresh import AimRefresher, refresh_ramp
from balloon_warp.schedules.spheres import SphereMover
from balloon_warp.schedules.tables import body_table, obstacle_table, spring_ends, spring_table, string_table
from balloon_warp.schedules.traits import beyond_basics, model_traits
from balloon_warp.solvers.dense_inverse import DenseInverse
from balloon_warp.solvers.sparse_factor import SparseFactor
from balloon_warp.solvers.step_matrices import StepMatrices


class ProjectiveSolver:
    """Advances a state by whole frames, in place. Bit-reproducible.

    Springs, strings and damping are implicit; gravity, helium and inflation are those at a substep's start, and
    contacts follow at its end, as in the schedules.

    Raises:
        InputError: the model has physics that it lacks, or a balloon is too large for a GPU, see `DenseInverse`.
    """

    name = "projective"
    capturable = True

    def __init__(self, model: Model, global_step: type[SparseFactor] | type[DenseInverse] | None = None):
        if beyond := beyond_basics(model):
            raise InputError(f'solver: "projective" does not simulate {beyond}; expected another solver')
        self.model = model
        self._health = HealthCheck(model)
        self._global_step = (global_step or _global_step(model))(model, StepMatrices(model))
        self._bodies = body_table(model)
        ends = spring_ends(model)
        self._local_step = local_step_kernel(model_traits(model))
        self._end_substep = ending_kernel(model_traits(model).impulses)
        self._springs = spring_table(model, ends)
        self._strings = string_table(model)
        self._obstacles = obstacle_table(model)
        self._aims = AimRefresher(model)
        self._spheres = SphereMover(model, self._bodies, self._obstacles)

        def vectors() -> wp.array:
            return wp.zeros((model.world_count, model.particle_count), dtype=wp.vec3, device=model.device)

        self._free_displacements, self._displacements, self._trial_points = vectors(), vectors(), vectors()
        self._residuals, self._increments = vectors(), vectors()

    @staticmethod
    def world_bytes(model: Model) -> int:
        """Device memory that it keeps for each world, beside the state."""
        vectors = 5 * VECTOR_BYTES * model.particle_count
        beside = SphereMover.world_bytes(model) + AimRefresher.world_bytes(model)
        return vectors + beside + _global_step(model).world_bytes(model, StepMatrices(model))

    def advance_frame(self, state: State) -> None:
        """One frame: the inflation refreshed, then every substep."""
        for _ in self.substeps(state):
            pass

    def substeps(self, state: State) -> Iterator[int]:
        """One frame that pauses after each substep, with its number from 0."""
        model = self.model
        refresh_ramp(model, state)
        self._spheres.begin_frame(state)
        for substep in range(model.substeps):
            if substep == 0 or model.scene.normals == "fresh":
                self._aims.refresh(state.points, state.inflation_aims)
            self._spheres.move(state)
            self._advance_substep(state, substep * model.step_seconds)
            yield substep
        self._spheres.end_frame(state)
        self._health.end_frame(state)

    def _advance_substep(self, state: State, time_in_frame: float) -> None:
        h, u, trial = self.model.step_seconds, self._displacements, self._trial_points
        self._launch(
            foresee_displacements,
            *(self._bodies, h, time_in_frame),
            *(state.inflation_aims, state.inflation_ramp, state.points, state.velocities),
            *(self._free_displacements, u, trial),
        )
        for _ in range(self.model.scene.solver_iterations):
            self._launch(
                self._local_step,
                *(self._bodies, self._springs, self._strings, h),
                *(self._free_displacements, u, trial),
                self._residuals,
            )
            self._global_step.solve(self._residuals, self._increments)
            self._launch(apply_increments, state.points, self._increments, u, trial)
        self._launch(
            self._end_substep,
            *(self._bodies, self._obstacles, h, time_in_frame),
            *(state.inflation_aims, state.inflation_ramp, state.sphere_positions, state.sphere_velocities),
            *(u, state.points, state.velocities, self._spheres.forces),
        )

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        shape = (self.model.world_count, self.model.particle_count)
        wp.launch(kernel, shape, inputs=list(arguments), device=self.model.device)


def _global_step(model: Model) -> type[SparseFactor] | type[DenseInverse]:
    return SparseFactor if model.device.is_cpu else DenseInverse
