"""The `projective` solver: backward Euler by local and global steps (Liu et al. 2013), stable at any step."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.features import Features
from balloon_warp.kernels.laws.hooke import HOOKE
from balloon_warp.kernels.schedules.launched.looks import GATHERED
from balloon_warp.kernels.solvers.projective import (
    foreseeing_kernel,
    inertia_function,
    local_step_kernel,
    take_displacements,
)
from balloon_warp.kernels.solvers.settling import (
    LEAST_ITERATIONS,
    MOST_ITERATIONS,
    TOLERANCE,
    WORTH_SAYING,
    Settling,
    settling_kernel,
)
from balloon_warp.kernels.substep import PROJECTIVE_STEP
from balloon_warp.launching import launch, launch_tiled
from balloon_warp.model import Model, State
from balloon_warp.model.memory import Room
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.launched import LaunchedSchedule
from balloon_warp.schedules.launches import Moving, Own
from balloon_warp.schedules.tables import world_state
from balloon_warp.solvers.dense_inverse import DenseInverse
from balloon_warp.solvers.sparse_factor import SparseFactor
from balloon_warp.solvers.step_matrices import FACTORIZED, StepMatrices

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
    look = GATHERED
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
    def allot(cls, model: Model, features: Features, room: Room) -> tuple[Any, ...]:
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
        self._over_particles(foreseeing_kernel(self.features), *begin, free, tried, reached, trials)
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
    for name in features.acting:
        if name not in known:
            return f"the phase {name}"
    for given, words in (("water_load", "water"), ("area_vector", "drag in air")):
        if features.needs("particle", given):
            return words
    return None


def _global_step(model: Model) -> type[SparseFactor] | type[DenseInverse]:
    return SparseFactor if model.device.is_cpu else DenseInverse
